"""Largest loads on the bearings of the joints during a motion."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..basics.spatial import Array
from ..basics.text import Row, aligned, short, six_digits, summary
from ..dynamics.recursion_record import bearing_loads
from ..robot import Robot
from .scene import Scene
from .trajectory import MOST_LOADS, Trajectory, between, samples_of


@dataclass(frozen=True, eq=False)
class BearingPeaks:
    """The largest loads on every joint's bearing over the samples of a motion; `print` shows them as a table.

    Attributes
    ----------
    joints : tuple of str
        The moving joints, nb of them.
    force, torque : ndarray, shape (nb,)
        Largest force and torque on the bearing, without the component along the axis that the drive provides [N, N m].
    force_time, torque_time : ndarray, shape (nb,)
        When each was first reached [s].
    start, end : float
        Times of the first and last sample [s].
    samples : int
        Number of samples; peaks between them are not found.

    Examples
    --------
    >>> import rne
    >>> robot = rne.load("irb140")
    >>> print(rne.bearing_peaks(robot, rne.simulate(robot, [0] * 6, [0] * 6, 0.1)))  # doctest: +ELLIPSIS
    Peak loads on the bearings, 0 ... 0.1 s, ... samples
    ...
    """

    joints: tuple[str, ...]
    force: Array
    force_time: Array
    torque: Array
    torque_time: Array
    start: float
    end: float
    samples: int

    __repr__ = summary

    def __str__(self) -> str:
        samples = f"{self.samples} samples" if self.samples > 1 else "1 sample"
        title = f"Peak loads on the bearings, {six_digits(self.start)} ... {six_digits(self.end)} s, {samples}"
        if not self.joints:
            return f"{title}: no moving joints"
        rows = [Row("joint", ("force [N]", "at t [s]", "torque [N m]", "at t [s]"), words=True)]
        columns = (self.force, self.force_time, self.torque, self.torque_time)
        for i, joint in enumerate(self.joints):
            rows.append(Row(short(joint), [six_digits(column[i]) for column in columns]))
        return "\n".join([title, *aligned(rows)])


def bearing_peaks(robot: Robot | Scene, motion: Trajectory) -> BearingPeaks:
    """Largest force and torque on every joint's bearing during a motion, and when they occur.

    Parameters
    ----------
    robot : Robot or Scene
        What moved; of a Scene, its robot with mounting, payload and locked joints.
    motion : Trajectory
        A motion of this robot. Loads are computed at the solver's steps, between them and on both sides of jumps, or at
        the times of `t_eval` alone.

    Returns
    -------
    BearingPeaks
        Loads and times, joint by joint.

    Raises
    ------
    TypeError
        If `robot` is no Robot or Scene, or `motion` no Trajectory.
    ValueError
        If the motion has no samples or is of a robot with another number of joints, or a load overflows.

    Notes
    -----
    Høifødt 2011, (3.24), (3.27) and section 5.3: the drive provides b_i^T tau_i, the bearing the rest of f_i and tau_i.
    Accelerations are those recorded in the motion, and between the solver's steps between those recorded.

    Examples
    --------
    >>> import rne
    >>> robot = rne.load("irb140")
    >>> peaks = rne.bearing_peaks(robot, rne.simulate(robot, [0] * 6, [0] * 6, 0.1))
    >>> peaks.joints[0], peaks.force[0].round(1).item()  # less than its weight of 736 N: the arm falls
    ('joint_1', 686.9)
    """
    moved = robot.resolved.robot if isinstance(robot, Scene) else robot
    if not isinstance(moved, Robot):
        raise TypeError(f"`robot` must be an rne.Robot or rne.Scene, got {type(robot).__name__}")
    if not isinstance(motion, Trajectory):
        raise TypeError(f"`motion` must be an rne.Trajectory, got {type(motion).__name__}")
    t, q = motion.t, motion.q
    if not len(t):
        raise ValueError("`motion` must have at least one sample, got none")
    if q.shape != (len(t), moved.n):
        raise ValueError(
            f"`motion.q` must have shape ({len(t)}, {moved.n}) for robot {moved.model.name!r}, got {q.shape}"
        )
    return peaks_of(moved, *samples_of(motion, between(t, samples=MOST_LOADS))[:4])


def peaks_of(robot: Robot, t: Array, q: Array, qd: Array, qdd: Array) -> BearingPeaks:
    """The largest loads over samples of a robot's motion."""
    force, torque = bearing_loads(robot.recursion(q, qd, qdd), robot.model)
    return BearingPeaks(
        joints=robot.model.moving_joints,
        force=force.max(axis=0),
        force_time=t[np.argmax(force, axis=0)],
        torque=torque.max(axis=0),
        torque_time=t[np.argmax(torque, axis=0)],
        start=float(t[0]),
        end=float(t[-1]),
        samples=len(t),
    )
