"""Integrators of dx/dt = f(t, x, u): SciPy's, and methods in machine code for one motion or many.

They know no robot: `simulation` gives them the right-hand side.
"""
