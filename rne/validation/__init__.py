"""Comparison of the dynamics with Pinocchio or, where it is not installed, with the energies; of two models."""
