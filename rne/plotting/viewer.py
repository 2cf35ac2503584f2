"""A motion as one HTML page with a 3-D view that needs no network and no server."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..basics.arrays import positive_number
from ..basics.paths import output_file
from ..robot import Robot
from ..simulation.trajectory import Trajectory
from .shapes import INSTALL
from .viewer_camera import FOV, add_floor, aim
from .viewer_motions import frame_times, motion, other_motion, placed, some_frames
from .viewer_page import PAGE, Page, finished, legend
from .viewer_scene import build, corners

HOLD = 0.5  # [s] that the last frame stands before the page starts again


def view(
    robot: Robot | Trajectory,
    path: str | os.PathLike[str] | None = None,
    *,
    q: ArrayLike | None = None,
    t: ArrayLike | None = None,
    other: Any = None,
    labels: Sequence[str] = ("motion", "other"),
    speed: float = 1.0,
    frames: bool = False,
    inertia: bool = False,
) -> Page:
    """Write a robot or its motion as one HTML page with a 3-D view, for any browser, without network or server.

    Parameters
    ----------
    robot : Robot or Trajectory
        A motion, or a robot whose positions are `q`.
    path : str or path-like, optional
        The file to write, ending in .html, in an existing folder. Without it the page is kept in memory, for notebooks.
    q : array_like, shape (n,) or (T, n), optional
        One position of the robot, zero if not given, or with `t` those of a motion [rad or m].
    t : array_like, shape (T,), optional
        Times of the positions, increasing [s]; between them the positions are interpolated linearly.
    other : Trajectory, array_like of shape (n,), or tuple of t and q, optional
        A second motion or position, of the same robot or of a Trajectory's own, shown half transparent in orange: a
        measured motion, or that of another controller.
    labels : sequence of two str
        Names of the motion and of the other one in the legend.
    speed : float
        Seconds of the motion per second of the page at the speed 1x; the page offers 0.5x to 8x of it.
    frames, inertia : bool
        True if the links' frames, or centres of mass and inertia ellipsoids, are to be visible at first, with the
        links half transparent. The list of the scene's parts in the page shows and hides them in any case.

    Returns
    -------
    Page
        With `path`, `html`, `save(path)` and `show()`. As the last value of a notebook's cell it shows itself.

    Raises
    ------
    TypeError
        If `robot`, `path` or `other` is of another type.
    ValueError
        If an array has the wrong shape or is not finite, times do not increase, a trajectory has no samples or no
        model, or `q` or `t` is given with a trajectory.
    FileNotFoundError
        If the folder of `path` does not exist.
    ImportError
        If viser is not installed.

    Warns
    -----
    UserWarning
        For visual shapes of the robot's URDF that cannot be shown, such as a mesh that is not found.

    Notes
    -----
    Shown are the visual shapes of the URDF, meshes simplified to about 12 000 triangles a robot, and lines for links
    that have none; the joint axes; a floor whose grid is named in the legend. Up is against gravity. An inertia
    ellipsoid is the solid ellipsoid of even density that has the body's mass and inertia. There are 30 frames per
    second of the page, in long motions fewer. A local server of viser makes the page: it is bound to 127.0.0.1 and is
    stopped before this function returns.

    Examples
    --------
    >>> import rne
    >>> robot = rne.load("irb140")
    >>> swing = rne.simulate(robot, [0] * 6, [0] * 6, 2.0)
    >>> page = rne.view(swing, "swing.html", other=rne.simulate(robot.with_payload(6.0), [0] * 6, [0] * 6, 2.0),
    ...                 labels=["unloaded", "6 kg"])  # doctest: +SKIP
    """
    file = None if path is None else output_file(path, *PAGE)
    names = _labels(labels)
    rate = positive_number("speed", speed)
    first = motion(robot, q, t)
    second = None if other is None else other_motion(other, first.robot)
    times = frame_times([first] if second is None else [first, second], rate)
    with _scene_server() as server:
        main = placed(first, times)
        ghost = None if second is None else placed(second, times, main)
        points = np.concatenate([corners(x, some_frames(len(times))) for x in (main, ghost) if x is not None])
        camera, seen = server.initial_camera, aim(points)
        camera.position, camera.look_at, camera.up, camera.fov = seen.position, seen.target, (0.0, 0.0, 1.0), FOV
        cell = add_floor(server.scene, points)
        groups = build(server.scene, main, ghost, frames=frames, inertia=inertia)
        recording = server.get_scene_serializer()
        for k, pause in enumerate(np.diff(times) / rate, 1):
            recording.insert_sleep(float(pause))
            for group in groups:
                group.place(k)
        if len(times) > 1:
            recording.insert_sleep(HOLD)
        text = recording.as_html()
    key = legend(main, names if second else names[:1], cell, times, rate)
    return Page(finished(text, main.model.name, key, seen), file)


@contextmanager
def _scene_server() -> Iterator[Any]:
    """A server of viser on 127.0.0.1, which is stopped in the end and prints nothing."""
    try:
        import fast_simplification  # noqa: F401
        import rich
        import trimesh  # noqa: F401
        import viser
    except ModuleNotFoundError as error:
        raise ImportError(f"the viewer needs {error.name}, which is not installed: {INSTALL}") from None
    console = rich.get_console()
    quiet, console.quiet = console.quiet, True
    try:
        server = viser.ViserServer(host="127.0.0.1", port=0, verbose=False)
        try:
            yield server
        finally:
            server.stop()
    finally:
        console.quiet = quiet


def _labels(labels: Sequence[str]) -> tuple[str, str]:
    if isinstance(labels, str) or len(labels) != 2 or not all(isinstance(label, str) for label in labels):
        raise ValueError(f"`labels` must be two str, got {labels!r}")
    return labels[0], labels[1]
