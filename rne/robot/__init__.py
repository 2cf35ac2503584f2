"""The Robot: a model with each quantity as a method, grouped by theme."""

from .robot import Robot

__all__ = ["Robot"]
