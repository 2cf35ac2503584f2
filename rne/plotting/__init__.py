"""Pictures of robots and motions; matplotlib is imported when a function is called."""

from .animation import animate
from .plots import plot
from .robot_picture import draw

__all__ = ["animate", "draw", "plot"]
