"""Ways out: a kernel as a function of another package, a file for each, named after what it leads to."""
