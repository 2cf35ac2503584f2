"""Vectors, rotations, arrays and tables of numbers: nothing here knows about robots."""
