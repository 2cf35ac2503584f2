"""What a viewer page is given: positions of robots over time, as the poses of their links in every frame."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ..basics.arrays import real_array
from ..basics.spatial import Array
from ..robot import Robot
from ..simulation.trajectory import Trajectory
from .shapes import link_shapes
from .viewer_scene import Motion

FPS = 30.0  # frames per second of the page
MAX_POSES = 10_000  # of links in a page: of a long motion there are fewer frames per second


class Positions(NamedTuple):
    """A robot with its positions as a function of times (T,) from `start` to `end`."""

    robot: Robot
    start: float
    end: float
    at: Callable[[Array], Array]


def motion(robot: Any, q: ArrayLike | None, t: ArrayLike | None) -> Positions:
    """The motion that `rne.view` is given first."""
    if isinstance(robot, Trajectory):
        for name, value in (("q", q), ("t", t)):
            if value is not None:
                raise ValueError(f"`{name}` is for a robot; a trajectory has its own")
        return _of_trajectory(robot, "robot", None)
    if not isinstance(robot, Robot):
        raise TypeError(f"`robot` must be an rne.Robot or rne.Trajectory, got {type(robot).__name__}")
    return _of_arrays(robot, np.zeros(robot.n) if q is None else q, t)


def other_motion(other: Any, robot: Robot) -> Positions:
    """The motion that `rne.view` is given as `other`, of the same robot where it does not bring its own."""
    if isinstance(other, Trajectory):
        return _of_trajectory(other, "other", robot)
    if isinstance(other, tuple) and len(other) == 2 and np.ndim(other[1]) == 2:
        return _of_arrays(robot, other[1], other[0], "other[1]", "other[0]")
    if isinstance(other, str | Robot):
        raise TypeError(f"`other` must be an rne.Trajectory, positions or a tuple (t, q), got {type(other).__name__}")
    return _of_arrays(robot, other, None, "other", "other[0]")


def _of_trajectory(trajectory: Trajectory, name: str, robot: Robot | None) -> Positions:
    if not len(trajectory.t):
        raise ValueError(f"`{name}` must have at least one sample, got none")
    if trajectory.model is not None:
        robot = Robot(trajectory.model)
    if robot is None:
        raise ValueError("this trajectory has no model: give it one by dataclasses.replace(trajectory, model=...)")
    if trajectory.q.shape[1] != robot.n:
        expected = f"{robot.n} joints as robot {robot.model.name!r} has"
        raise ValueError(f"`{name}` must have {expected}, got {trajectory.q.shape[1]}")
    first, last, n = float(trajectory.t[0]), float(trajectory.t[-1]), robot.n
    return Positions(robot, first, last, lambda times: trajectory(times)[0].reshape(len(times), n))


def _of_arrays(robot: Robot, q: ArrayLike, t: ArrayLike | None, q_name: str = "q", t_name: str = "t") -> Positions:
    expected = f"({robot.n},)" if t is None else f"(T, {robot.n})"
    positions = real_array(q_name, q, expected)
    if t is None:
        if positions.shape != (robot.n,):
            cure = "; motions need times `t`" if positions.ndim == 2 else ""
            raise ValueError(f"`{q_name}` must have shape {expected}, got {positions.shape}{cure}")
        return Positions(robot, 0.0, 0.0, lambda times: np.repeat(positions[None], len(times), axis=0))
    instants = real_array(t_name, t, "(T,)")
    if instants.ndim != 1 or not len(instants):
        raise ValueError(f"`{t_name}` must have shape (T,), got {instants.shape}")
    if positions.shape != (len(instants), robot.n):
        raise ValueError(f"`{q_name}` must have shape ({len(instants)}, {robot.n}), got {positions.shape}")
    if (np.diff(instants) <= 0).any():
        raise ValueError(f"`{t_name}` must increase from sample to sample")

    def at(times: Array) -> Array:
        columns = [np.interp(times, instants, column) for column in positions.T]
        return np.array(columns).T.reshape(len(times), robot.n)

    return Positions(robot, float(instants[0]), float(instants[-1]), at)


def frame_times(motions: Sequence[Positions], speed: float) -> Array:
    """Times of the frames [s], from the first start to the last end."""
    moving = [motion for motion in motions if motion.end > motion.start]
    if not moving:
        return np.array([motions[0].start])
    start, end = min(motion.start for motion in moving), max(motion.end for motion in moving)
    links = sum(len(motion.robot.model.link_names) for motion in motions)
    frames = min(round((end - start) / speed * FPS), MAX_POSES // links)
    return np.linspace(start, end, max(frames, 1) + 1)


def some_frames(count: int) -> Array:
    """At most 60 frames, spread over all."""
    return np.unique(np.linspace(0, count - 1, 60).round().astype(int))


def placed(motion: Positions, times: Array, first: Motion | None = None) -> Motion:
    """The links in all frames, in a world whose z axis is up; before and after its own time a motion stands still.

    Shapes of the same file are those of the first motion: what is lost of them is told once.
    """
    model = motion.robot.model
    poses = motion.robot.link_poses(motion.at(np.clip(times, motion.start, motion.end)))
    up = np.eye(4)
    up[:3, :3] = _upright(model.gravity)
    is_same = first is not None and model.source is not None and model.source == first.model.source
    return Motion(model, first.shapes if first is not None and is_same else link_shapes(model), up @ poses)


def _upright(gravity: Array) -> Array:
    """The shortest rotation that turns what is up in the root link's axes to z."""
    from scipy.spatial.transform import Rotation

    g = float(np.linalg.norm(gravity))
    if g == 0:
        return np.eye(3)
    up = -gravity / g
    axis = np.cross(up, [0.0, 0.0, 1.0])
    sine = float(np.linalg.norm(axis))
    axis = axis / sine if sine > 0 else np.array([1.0, 0.0, 0.0])
    rotation: Array = Rotation.from_rotvec(np.arctan2(sine, up[2]) * axis).as_matrix()
    return rotation
