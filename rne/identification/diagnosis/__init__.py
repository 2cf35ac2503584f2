"""What a fit leaves unexplained, its likely causes, and tests of the parameters it found."""
