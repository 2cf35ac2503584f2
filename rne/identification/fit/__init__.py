"""Least squares on the equations of a motion, with physically consistent parameters."""
