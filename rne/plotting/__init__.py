"""Pictures of robots and motions; matplotlib and viser are imported when a function is called."""

from .plots import fan, plot, torque_speed
from .robot_picture import animate, draw

__all__ = ["animate", "draw", "fan", "plot", "torque_speed"]
