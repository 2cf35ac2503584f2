"""Peaks of the loads of bearings over the cycle of a motion, planned, simulated or measured."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ..basics.arrays import real_array
from ..basics.spatial import Array
from ..basics.text import InNotebooks, counted, six_digits, summary, table
from ..dynamics.recursion_record import bearing_loads, not_known
from ..model.model import Model
from ..robot import Robot, robot_argument
from .scene import Scene
from .springs import Springs
from .trajectory import MOST_LOADS, Trajectory, between, samples_of

LOGGER = logging.getLogger("rne")
EVERY = 1e-3  # interval between the instants of a motion that is a function of time [s]


@dataclass(frozen=True, eq=False)
class BearingPeaks(InNotebooks):
    """Largest loads on every joint's bearing in a motion, found by `rne.bearing_peaks`; `print` shows them as a table.

    Attributes
    ----------
    joints : tuple of str
        Names of the nb moving joints, followed by the L pivots that close linkages, named by their links.
    force, torque : ndarray, shape (nb + L,)
        Largest force and torque on the bearing, without the component along the axis that the drive provides. The
        pivots of closed linkages (`rne.model.four_bar`, `rne.model.cylinder`) share the forces in their plane; the
        joints of the tree carry all other loads. NaN for the joints in `not_known` [N, N m].
    force_time, torque_time : ndarray, shape (nb + L,)
        When each was first reached [s].
    start, end : float
        Times of the first and last sample [s].
    samples : int
        Number of samples; peaks between them are not found.
    not_known : tuple of str
        Joints whose loads are not known, as they move together with others by parts that the robot does not have.
    follow : tuple of str
        Joints that follow others by such parts: mimics, and joints of `rne.model.coupled`.
    """

    joints: tuple[str, ...]
    force: Array
    force_time: Array
    torque: Array
    torque_time: Array
    start: float
    end: float
    samples: int
    not_known: tuple[str, ...] = ()
    follow: tuple[str, ...] = ()

    __repr__ = summary

    def __str__(self) -> str:
        span = f"{six_digits(self.start)} ... {six_digits(self.end)} s, {counted(self.samples, 'sample')}"
        title = f"Peak loads on the bearings, {span}"
        if not self.joints:
            return f"{title}: no moving joints"
        heads = ("force [N]", "at t [s]", "torque [N m]", "at t [s]")
        columns = (self.force, self.force_time, self.torque, self.torque_time)
        texts = (["not known" if np.isnan(x) else six_digits(x) for x in values] for values in columns)
        return "\n".join([title, *table("joint", heads, self.joints, *texts), *not_known(self)])


def bearing_peaks(robot: Robot | Scene, motion: Any) -> BearingPeaks:
    """Largest force and torque on every joint's bearing during a motion, and when they occur.

    Parameters
    ----------
    robot : Robot or Scene
        Robot that moved; for a Scene, its robot with mounting, payload and locked joints, and its springs without their
        damping.
    motion : Trajectory, FastestMotion, Record or function of time
        Any motion that `rne.drives` takes; one sample is enough.

    Returns
    -------
    BearingPeaks
        Loads and times, joint by joint: the `bearings` of `rne.drives`.

    Raises
    ------
    TypeError
        If `robot` is no Robot or Scene, or `motion` is no motion.
    ValueError
        If the motion has no samples or is of a robot with another number of joints, or a load overflows.

    Notes
    -----
    Høifødt 2011, (3.24), (3.27) and section 5.3: the drive provides b_i^T tau_i, the bearing the rest of f_i and tau_i.
    Accelerations are those recorded in the motion; between the solver's steps they are interpolated.

    Examples
    --------
    >>> import rne
    >>> robot = rne.load("irb140")
    >>> peaks = rne.bearing_peaks(robot, rne.simulate(robot, [0] * 6, [0] * 6, 0.1))
    >>> peaks.joints[0], peaks.force[0].round(1).item()  # less than its weight of 736 N: the arm falls
    ('joint_1', 686.9)
    """
    scene = scene_of(robot, motion)
    parts = scene.resolved
    peaks = peaks_of(parts.robot, parts.springs, *cycle_samples(scene, motion, instant=True)[:4])
    if peaks.not_known:  # printed with the peaks, but arrays are read too
        LOGGER.warning(" ".join(map(str.strip, not_known(peaks))))
    return peaks


def peaks_of(robot: Robot, springs: Springs | None, t: Array, q: Array, qd: Array, qdd: Array) -> BearingPeaks:
    """Largest loads over samples of a robot's motion."""
    external = None if springs is None else springs.wrenches(robot, q)
    record = robot.recursion(q, qd, qdd, external=external)
    (force, force_time), (torque, torque_time) = (_peaks(t, x) for x in bearing_loads(record, robot.model))
    joints, span = (*record.joints, *record.pivots), (float(t[0]), float(t[-1]), len(t))
    return BearingPeaks(joints, force, force_time, torque, torque_time, *span, record.not_known, record.follow)


def _peaks(t: Array, loads: Array) -> tuple[Array, Array]:
    """Largest loads over the samples and their times; NaN for both where unknown."""
    peaks = loads.max(axis=0)
    return peaks, np.where(np.isnan(peaks), np.nan, t[np.argmax(loads, axis=0)])


def scene_of(robot: Robot | Scene, motion: Any) -> Scene:
    """Scene given, otherwise the one that the motion was planned for with the robot, or a scene of only the robot."""
    if isinstance(robot, Scene):
        return robot
    robot, planned = robot_argument(robot), getattr(motion, "scene", None)
    moved = planned.robot.model if isinstance(planned, Scene) else getattr(motion, "model", None)
    if isinstance(moved, Model) and not set(moved.joint_names) <= set(robot.joint_names):
        raise ValueError(
            f"`motion` must be of the robot {robot.model.name!r} with joints {list(robot.joint_names)}, "
            f"it is of {moved.name!r} with {list(moved.joint_names)}"
        )
    if not isinstance(planned, Scene):
        return Scene(robot)
    return planned if planned.robot.model == robot.model else replace(planned, robot=robot)


def _times(motion: Any) -> Array:
    """Times at which to sample a function of time, on both sides of its jumps."""
    own = np.concatenate([np.ravel(getattr(motion, name, ())) for name in ("t", "instants")])
    start, end = (own.min(), own.max()) if hasattr(motion, "t") else (0.0, getattr(motion, "duration", None))
    if end is None:
        cure = 'rne.trajectories.sampled(t, q, "cubic") makes a motion of its positions'
        raise TypeError(f"`motion` must have a `duration`, or arrays t, q and qd; got only a function of time: {cure}")
    grid = np.linspace(start, end, max(int(np.ceil(round((end - start) / EVERY, 6))), 1) + 1)
    sides = np.nextafter(np.ravel(getattr(motion, "breaks", ())), [[-np.inf], [np.inf]]).ravel()
    return np.unique(np.concatenate([grid, own, sides[(sides >= start) & (sides <= end)]]))


def cycle_samples(scene: Scene, motion: Any, *, instant: bool = False) -> tuple[Array, Array, Array, Array, Array]:
    """Samples t, q, qd, qdd and tau of a motion; a single one is allowed for an `instant`."""
    found: Sequence[Any]
    if isinstance(motion, Trajectory):
        found = samples_of(motion, between(motion.t, samples=MOST_LOADS))
    elif callable(motion):
        t = _times(motion)
        own = hasattr(motion, "torques") and getattr(motion, "scene", scene) is scene
        found = t, *motion(t), motion.torques(t) if own else None
    else:
        given = motion.prepare() if hasattr(motion, "prepare") else motion
        if not all(hasattr(given, name) for name in ("t", "q", "qd")):
            raise TypeError(
                f"`motion` must be a function of time or have arrays t, q and qd, got {type(motion).__name__}"
            )
        found = tuple(getattr(given, name, None) for name in ("t", "q", "qd", "qdd", "tau"))
    t, q, qd, qdd, tau = found
    t = real_array("motion.t", t, "(T,)").astype(float)
    for k in np.flatnonzero(np.diff(t) < 0)[:1]:
        raise ValueError(f"times of `motion` must ascend, got {t[k + 1]:g} s after {t[k]:g} s")
    if not len(t):
        raise ValueError("`motion` must have at least one sample, got none")
    if t[0] == t[-1] and (qdd is None or not instant):
        raise ValueError(f"`motion` must last longer than an instant, got {counted(len(t), 'sample')}")
    shape = f"({len(t)}, {scene.resolved.robot.n})"
    q, qd = (real_array(f"motion.{name}", x, shape).astype(float) for name, x in (("q", q), ("qd", qd)))
    qdd = real_array("motion.qdd", np.gradient(qd, t, axis=0) if qdd is None else qdd, shape).astype(float)
    tau = scene.inverse_dynamics(q, qd, qdd) if tau is None else tau
    return t, q, qd, qdd, real_array("motion.tau", tau, shape).astype(float)
