"""Motions that excite the parameters of a robot: Fourier series of least criterion within limits."""
