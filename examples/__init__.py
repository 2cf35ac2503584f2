"""Programs on top of `rne` that run in a clone; they are not installed with it."""
