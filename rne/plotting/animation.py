"""A motion as a moving picture."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np

from ..basics.arrays import positive_number
from ..basics.spatial import Array
from ..robot import Robot
from ..simulation.trajectory import Trajectory
from .plots import check_trajectory
from .robot_picture import Picture, blank_axes, check_robot

FASTEST = 50.0  # [1/s]; viewers slow down files that ask for more
MOST_FRAMES = 2000  # all of them are held until the file is written
DPI = 90


def animate(robot: Robot, trajectory: Trajectory, path: str | Path, fps: float = 20, speed: float = 1.0) -> Path:
    """Write a motion as an animated GIF.

    Parameters
    ----------
    robot : Robot
    trajectory : Trajectory
        A motion of this robot.
    path : str or Path
        The file, ending in .gif.
    fps : float
        Frames a second of the film, at most 50. GIF counts in hundredths of a second: the time of a frame is rounded
        to them.
    speed : float
        Seconds of the motion in one second of the film.

    Returns
    -------
    Path
        The file written.

    Raises
    ------
    ValueError
        If `trajectory` has no samples or is not of this robot, an argument is out of range, or the film would have
        more than 2000 frames.
    ImportError
        If matplotlib is not installed.

    Notes
    -----
    Frames are even in time from the first sample to the last. Between samples each joint follows the cubic through
    the positions and rates of its neighbours, so that a solver's long steps still make a smooth motion.

    Examples
    --------
    >>> import rne
    >>> robot = rne.load("irb140")
    >>> swing = rne.simulate(robot, [0] * 6, [0] * 6, 2.0)
    >>> file = rne.plotting.animate(robot, swing, "swing.gif")  # doctest: +SKIP
    """
    check_robot(robot)
    check_trajectory(trajectory)
    if trajectory.q.shape[1] != robot.n:
        raise ValueError(
            f"`trajectory` must be of {robot.n} joints for robot {robot.model.name!r}, got {trajectory.q.shape[1]}"
        )
    path = Path(path)
    if path.suffix.lower() != ".gif":
        raise ValueError(f"`path` must end in .gif, got {path.name!r}")
    delay = _hundredths(positive_number("fps", fps))
    t = _frame_times(trajectory, delay, positive_number("speed", speed))
    ax = blank_axes("")
    _write(path, ax, robot, t, _positions(trajectory, t), delay)
    return path


def _hundredths(fps: float) -> int:
    if fps > FASTEST:
        raise ValueError(f"`fps` must be at most {FASTEST:g}, got {fps:g}")
    return round(100 / fps)


def _frame_times(trajectory: Trajectory, delay: int, speed: float) -> Array:
    """Times of the frames [s], both ends of the motion among them."""
    first, last = float(trajectory.t[0]), float(trajectory.t[-1])
    frames = (last - first) / speed / (delay / 100)
    if frames + 1 > MOST_FRAMES:
        raise ValueError(
            f"the film would have {frames + 1:.0f} frames, at most {MOST_FRAMES}: raise `speed` or lower `fps`"
        )
    return np.linspace(first, last, max(round(frames), 1) + 1 if last > first else 1)


def _positions(trajectory: Trajectory, t: Array) -> Array:
    """Joint positions at the given times, by cubics through positions and rates of the samples."""
    from scipy.interpolate import CubicHermiteSpline

    new = np.append(True, np.diff(trajectory.t) > 0)
    if new.sum() < 2:
        return np.repeat(trajectory.q[:1], len(t), axis=0)
    q: Array = CubicHermiteSpline(trajectory.t[new], trajectory.q[new], trajectory.qd[new])(t)
    return q


def _write(path: Path, ax: Any, robot: Robot, t: Array, q: Array, delay: int) -> None:
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from PIL import Image

    picture = Picture(ax, robot.model, robot.link_poses(q))
    decimals = max(2, math.ceil(-math.log10(t[1] - t[0]))) if len(t) > 1 else 2
    ax.figure.set_dpi(DPI)
    canvas: Any = FigureCanvasAgg(ax.figure)

    def shot(frame: int) -> Any:
        picture.place(frame)
        ax.set_title(f"{robot.model.name}, t = {t[frame]:.{decimals}f} s")
        canvas.draw()
        return Image.fromarray(np.array(canvas.buffer_rgba())[..., :3])

    palette = _palette([shot(frame) for frame in sorted({0, len(t) // 2, len(t) - 1})])
    images = [shot(frame).quantize(palette=palette, dither=Image.Dither.NONE) for frame in range(len(t))]
    images[0].save(path, save_all=True, append_images=images[1:], duration=10 * delay, loop=0, disposal=1)


def _palette(images: list[Any]) -> Any:
    """One palette for all frames, lest colours flicker: half for large areas, half for what is small but bright."""
    from PIL import Image

    sample = Image.fromarray(np.concatenate([np.asarray(image) for image in images]))
    colors: list[int] = []
    for method in (Image.Quantize.MEDIANCUT, Image.Quantize.MAXCOVERAGE):
        colors += (sample.quantize(128, method=method).getpalette() or [])[: 3 * 128]
    palette = Image.new("P", (1, 1))
    palette.putpalette(colors)
    return palette
