"""Pictures of robots and motions; matplotlib and viser are imported when a function is called."""

from .plots import plot, prediction_plot, quantile_plot, sensitivity_plot, torque_speed
from .robot_picture import animate, draw

__all__ = ["animate", "draw", "plot", "prediction_plot", "quantile_plot", "sensitivity_plot", "torque_speed"]
