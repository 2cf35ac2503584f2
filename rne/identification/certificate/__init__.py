"""Whether torques can come from one rigid-body model, and the likely cause of a difference."""
