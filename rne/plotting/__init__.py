"""Pictures of robots and motions; matplotlib and viser are imported when a function is called."""

from . import notebook as _notebook  # noqa: F401  registers what notebooks show
from .animation import animate
from .plots import fan, plot
from .robot_picture import draw

__all__ = ["animate", "draw", "fan", "plot"]
