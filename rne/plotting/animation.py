"""Animations of a motion, as GIF files."""

from __future__ import annotations

import math
import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ..basics.arrays import positive_number
from ..basics.paths import output_file
from ..basics.spatial import Array
from ..robot import Robot
from ..simulation.trajectory import Trajectory
from .motions import motion_argument
from .plots import literal
from .robot_picture import Picture, blank_axes, check_robot

MIN_FPS = 0.01  # [1/s]; GIF stores at most 655 s per frame
MAX_FPS = 50.0  # [1/s]; viewers slow down files that ask for more
MAX_FRAMES = 2000  # all of them are kept in memory until the file is written
DPI = 90


def animate(
    robot: Robot,
    motion: Trajectory | Sequence[Any],
    path: str | os.PathLike[str],
    fps: float = 20,
    speed: float = 1.0,
) -> Path:
    """Write a motion as an animated GIF.

    Parameters
    ----------
    robot : Robot
        The robot.
    motion : Trajectory or tuple of array_like
        A motion of this robot, or arrays (t, q) of shapes (T,) and (T, n), such as measured ones.
    path : str or path-like
        The file to write, ending in .gif, in an existing folder.
    fps : float
        Frames per second, from 0.01 to 50. GIF stores the time of a frame in hundredths of a second, to which it is
        rounded.
    speed : float
        Seconds of the motion per second of the animation.

    Returns
    -------
    pathlib.Path
        The file written.

    Raises
    ------
    TypeError
        If `robot`, `motion` or `path` is of another type.
    ValueError
        If `motion` has no samples or is not of this robot, an argument is out of range, or there would be more
        than 2000 frames.
    FileNotFoundError
        If the folder of `path` does not exist.
    ImportError
        If matplotlib is not installed.

    Notes
    -----
    The frames are evenly spaced in time, with the first and the last sample among them. A simulated motion is evaluated
    at these times, and is smooth even where the solver took long steps; arrays are interpolated by straight lines.

    Examples
    --------
    >>> import rne
    >>> robot = rne.load("irb140")
    >>> swing = rne.simulate(robot, [0] * 6, [0] * 6, 2.0)
    >>> file = rne.plotting.animate(robot, swing, "swing.gif")  # doctest: +SKIP
    """
    check_robot(robot)
    shown = motion_argument("motion", motion)
    if "q" not in shown.samples:
        raise ValueError("`motion` must hold positions, got None for them")
    if shown.n != robot.n:
        raise ValueError(f"`motion` must have {robot.n} joints as robot {robot.model.name!r} has, got {shown.n}")
    file = output_file(path, ".gif")
    delay = _hundredths(positive_number("fps", fps))
    t = _frame_times(shown.t, delay, positive_number("speed", speed))
    ax = blank_axes("")
    _write(file, ax, robot, t, shown.positions(t), delay)
    return file


def _hundredths(fps: float) -> int:
    """Time of a frame [0.01 s]."""
    if not MIN_FPS <= fps <= MAX_FPS:
        raise ValueError(f"`fps` must be between {MIN_FPS:g} and {MAX_FPS:g}, got {fps:g}")
    return round(100 / fps)


def _frame_times(samples: Array, delay: int, speed: float) -> Array:
    """Times of the frames [s], both ends of the motion among them."""
    first, last = float(samples[0]), float(samples[-1])
    frames = (last - first) / speed / (delay / 100)
    if frames + 1 > MAX_FRAMES:
        raise ValueError(
            f"the animation would have {frames + 1:.6g} frames, at most {MAX_FRAMES}: raise `speed` or lower `fps`"
        )
    return np.linspace(first, last, max(round(frames), 1) + 1 if last > first else 1)


def _write(path: Path, ax: Any, robot: Robot, t: Array, q: Array, delay: int) -> None:
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from PIL import Image

    picture = Picture(ax, robot.model, robot.link_poses(q))
    decimals = max(2, math.ceil(-math.log10(t[1] - t[0]))) if len(t) > 1 else 2
    ax.figure.set_dpi(DPI)
    canvas: Any = FigureCanvasAgg(ax.figure)

    def render(frame: int) -> Any:
        picture.place(frame)
        ax.set_title(f"{literal(robot.model.name)}, t = {t[frame]:.{decimals}f} s")
        canvas.draw()
        return Image.fromarray(np.array(canvas.buffer_rgba())[..., :3])

    palette = _common_palette([render(frame) for frame in sorted({0, len(t) // 2, len(t) - 1})])
    images = [render(frame).quantize(palette=palette, dither=Image.Dither.NONE) for frame in range(len(t))]
    images[0].save(path, save_all=True, append_images=images[1:], duration=10 * delay, loop=0, disposal=1)


def _common_palette(images: Sequence[Any]) -> Any:
    """256 colours for all frames: with a palette per frame the colours of resting parts would flicker."""
    from PIL import Image

    sample = Image.fromarray(np.concatenate([np.asarray(image) for image in images]))
    return sample.quantize(method=Image.Quantize.MAXCOVERAGE, kmeans=1)
