"""Parameters from linear equations: least squares, and physically consistent bodies."""
