"""Pictures and pages about a robot and its motion. Nothing is computed here that the library does not offer."""

from .animation import animate
from .pictures import draw
from .plots import plot

__all__ = ["animate", "draw", "plot"]
