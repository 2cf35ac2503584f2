"""Proven constants of a robot, by branch and bound on trigonometric polynomials; see `Robot.bounds`."""

from .bounds import Bound, Bounds

__all__ = ["Bound", "Bounds"]
