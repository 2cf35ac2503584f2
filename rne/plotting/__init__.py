"""Pictures and pages about a robot and its motion. Nothing is computed here that the library does not offer."""

from .animation import animate
from .plots import plot
from .robot_picture import draw

__all__ = ["animate", "draw", "plot"]
