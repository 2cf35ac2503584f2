"""Measured motions: what is wrong with them, and what a fit needs of them."""
