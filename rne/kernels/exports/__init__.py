"""Kernels in other packages: a file for each, named after what it leads to."""
