"""The Robot: a model with each quantity as a method."""

from .robot import Robot, robot_argument

__all__ = ["Robot", "robot_argument"]
