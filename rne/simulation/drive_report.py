"""Loads of drives, gears and bearings over the cycle of a motion: planned, simulated or measured."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..basics.arrays import cached_array, per_joint_array, real_array
from ..basics.spatial import Array
from ..basics.text import InNotebooks, column, counted, six_digits, summary, table
from ..dynamics.limits import limit_shares, share_texts
from ..dynamics.recursion_record import bearing_loads, not_known
from ..model.model import Model
from ..robot import Robot, robot_argument
from .scene import Scene
from .springs import Springs
from .trajectory import MOST_LOADS, Trajectory, between, motors_at, samples_of

LOGGER = logging.getLogger("rne")
EVERY = 1e-3  # [s] between the instants of a motion that is a function of time
MOVING = 0.01  # of a joint's largest speed, above which its drive is on duty
OVER = 1.005  # share of a limit that is above it: plans keep to 1 by some 1e-3
COARSE = 2e-3  # of all energy exchanged: twice what a run with the default tolerances leaves at its own steps


@dataclass(frozen=True, eq=False)
class BearingPeaks(InNotebooks):
    """The largest loads on every joint's bearing over the samples of a motion; `print` shows them as a table.

    Attributes
    ----------
    joints : tuple of str
        The moving joints, nb of them, and behind them the L pivots that close linkages, by their links.
    force, torque : ndarray, shape (nb + L,)
        Largest force and torque on the bearing, without the component along the axis that the drive provides. The
        pivots of closed linkages (`rne.model.four_bar`, `rne.model.cylinder`) share the forces in their plane; all else
        is carried by the joints of the tree. NaN of those in `not_known` [N, N m].
    force_time, torque_time : ndarray, shape (nb + L,)
        When each was first reached [s].
    start, end : float
        Times of the first and last sample [s].
    samples : int
        Number of samples; peaks between them are not found.
    not_known : tuple of str
        Joints whose loads are not known, as they move together with others by parts that the robot does not have.
    follow : tuple of str
        Joints that follow by such parts: mimics, and those of `rne.model.coupled`.

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


@dataclass(frozen=True, eq=False)
class DriveReport(InNotebooks):
    """Loads of drives, gears and bearings over a cycle, found by `rne.drives`; `print` shows them as tables.

    Integrals over time are those of the trapezoidal rule over the samples.

    Attributes
    ----------
    robot : Robot
        Robot that moves, with the payload of its scene.
    t : ndarray, shape (T,)
        Times of the samples; that of a jump stands twice, first with the values before it [s].
    q, qd, qdd, tau : ndarray, shape (T, n)
        Positions, velocities, accelerations and torques of the joints, behind the gears
        [rad or m; rad/s or m/s; rad/s^2 or m/s^2; N m or N].
    gear, rotor, efficiency : ndarray, shape (n,)
        Arguments of `drives`, for each drive.
    speed : ndarray, shape (T, n)
        Velocities of the drives behind their gears: `qd`, or behind elastic joints the motors' [rad/s or m/s].
    work_error : float or None
        Differences of the work of all drives by these samples from the `work` of a simulated motion, summed over the
        steps from one of its samples to the next [J].
    springs : Springs or None
        Those of the scene, which load the bearings.

    Examples
    --------
    >>> import rne
    >>> robot = rne.load("irb140")
    >>> motion = rne.trajectories.quintic([0] * 6, [1, 0.5, 0, 0, 0, 0], 1.0)
    >>> report = rne.drives(robot, motion, gear=100, rotor=1e-4, efficiency=0.8)
    >>> report.peak_speed.round(3)[0].item(), report.motor_speed[500, 0].round(1).item()
    (1.875, 187.5)
    >>> balance = report.energy_taken - report.energy_returned - report.work - report.gear_losses - report.rotor_energy
    >>> bool(abs(balance).max() < 1e-12 * report.energy_taken.max())
    True
    """

    robot: Robot
    t: Array
    q: Array
    qd: Array
    qdd: Array
    tau: Array
    gear: Array
    rotor: Array
    efficiency: Array
    speed: Array
    work_error: float | None = None
    springs: Springs | None = None

    def __repr__(self) -> str:
        return f"DriveReport({len(self.joints)} joints, {self.t[0]:g} to {self.t[-1]:g} s, {len(self.t)} samples)"

    @property
    def joints(self) -> tuple[str, ...]:
        """Names of the joints."""
        return self.robot.joint_names

    @property
    def effort_limit(self) -> Array:
        """Largest torques of the drives, infinite where unknown, shape (n,) [N m or N]."""
        return self.robot.effort_limit

    @property
    def velocity_limit(self) -> Array:
        """Largest velocities of the joints, infinite where unknown, shape (n,) [rad/s or m/s]."""
        return self.robot.velocity_limit

    @cached_property
    def bearings(self) -> BearingPeaks:
        """Largest loads on the bearings."""
        return _bearing_peaks(self.robot, self.springs, self.t, self.q, self.qd, self.qdd)

    @cached_property
    def _shares(self) -> dict[str, Array]:
        return limit_shares(self.robot.model.coordinate_limits(), self.speed, self.qdd, self.drive_torque)

    @property
    def duration(self) -> float:
        """Time from the first to the last sample [s]."""
        return float(self.t[-1] - self.t[0])

    @property
    def power(self) -> Array:
        """Mechanical power of each drive, behind its gear, shape (T, n) [W]."""
        return np.asarray(self.tau * self.speed)

    @property
    def drive_torque(self) -> Array:
        """Torque of each drive behind its gear, its rotor's share included, which limits count, (T, n) [N m or N]."""
        return np.asarray(self.tau + self.rotor * self.gear**2 * self.qdd)

    @property
    def motor_speed(self) -> Array:
        """Velocity of each motor, shape (T, n) [rad/s]."""
        return np.asarray(self.gear * self.speed)

    @cached_array
    def motor_torque(self) -> Array:
        """Torque of each motor, shape (T, n): rotor, and load with the gear's losses, which change sides [N m]."""
        return self.rotor * self.gear * self.qdd + self._gear_input / self.gear

    @property
    def motor_power(self) -> Array:
        """Mechanical power of each motor, shape (T, n) [W]."""
        return self.motor_torque * self.motor_speed

    @cached_property
    def _gear_input(self) -> Array:
        """Torque of the load with the gear's losses, on the side of the joint."""
        return np.where(self.power < 0, self.tau * self.efficiency, self.tau / self.efficiency)

    def _integral(self, values: Array) -> Array:
        return np.asarray(np.trapezoid(values, self.t, axis=0))

    def _mean(self, values: Array) -> Array:
        return self._integral(values) / self.duration

    @property
    def peak_torque(self) -> Array:
        """Largest magnitude of each joint's torque, shape (n,) [N m or N]."""
        return np.asarray(np.abs(self.tau).max(0))

    @property
    def peak_torque_time(self) -> Array:
        """When it is first reached, shape (n,) [s]."""
        return np.asarray(self.t[np.abs(self.tau).argmax(0)])

    @property
    def rms_torque(self) -> Array:
        """Root of the mean square of each joint's torque over time, which heats its motor, shape (n,) [N m or N]."""
        return np.sqrt(self._mean(self.tau**2))

    @property
    def peak_speed(self) -> Array:
        """Largest magnitude of each drive's `speed`, shape (n,) [rad/s or m/s]."""
        return np.asarray(np.abs(self.speed).max(0))

    @property
    def mean_speed(self) -> Array:
        """Mean magnitude of each drive's `speed` over time, which wears its gear, shape (n,) [rad/s or m/s]."""
        return self._mean(np.abs(self.speed))

    @property
    def peak_power(self) -> Array:
        """Largest magnitude of each motor's mechanical power, shape (n,) [W]."""
        return np.asarray(np.abs(self.motor_power).max(0))

    @property
    def energy_taken(self) -> Array:
        """Energy that each motor gives to its shaft while it drives, shape (n,) [J]."""
        return self._integral(np.maximum(self.motor_power, 0))

    @property
    def energy_returned(self) -> Array:
        """Energy that each motor takes from its shaft while it brakes, shape (n,) [J]."""
        return self._integral(np.maximum(-self.motor_power, 0))

    @property
    def work(self) -> Array:
        """Work that each drive does on the arm, behind its gear, friction of the joint included, shape (n,) [J]."""
        return self._integral(self.power)

    @property
    def gear_losses(self) -> Array:
        """Energy lost in each gear, shape (n,) [J]."""
        return self._integral((self._gear_input - self.tau) * self.speed)

    @property
    def rotor_energy(self) -> Array:
        """Work that accelerates each rotor, zero from rest to rest but for the rule of integration, shape (n,) [J]."""
        return self._integral(self.rotor * self.gear * self.qdd * self.motor_speed)

    @property
    def duty(self) -> Array:
        """Share of the time in which each joint moves, at more than 1 % of its largest speed, shape (n,)."""
        return self._mean((np.abs(self.speed) > MOVING * self.peak_speed).astype(float))

    @property
    def torque_share(self) -> Array:
        """Peak torques, those of the rotors added, over their limits, 0 where there is none, shape (n,)."""
        return np.asarray(self._shares["torque"].max(0))

    @property
    def speed_share(self) -> Array:
        """Peak speeds over their limits, 0 where there is none, shape (n,)."""
        return np.asarray(self._shares["velocity"].max(0))

    def __str__(self) -> str:
        title = f"Drives over a cycle of {six_digits(self.duration)} s, {len(self.t)} samples"
        heads = ("peak torque", "at t [s]", "of limit", "rms", "peak speed", "of limit", "mean", "duty")
        torques = column(self.peak_torque, ".4g"), column(self.peak_torque_time, ".3f")
        speeds = share_texts(self._shares["velocity"], self.velocity_limit), column(self.mean_speed, ".4g")
        load = table(
            *("joint", heads, self.joints, *torques, share_texts(self._shares["torque"], self.effort_limit)),
            *(column(self.rms_torque, ".4g"), column(self.peak_speed, ".4g"), *speeds, column(self.duty, ".0%")),
        )
        titles = ("peak torque", "rms", "peak speed", "peak power", "taken [J]", "returned", "gear loss")
        peaks = np.abs(self.motor_torque).max(0), np.sqrt(self._mean(self.motor_torque**2))
        energies = self.peak_power, self.energy_taken, self.energy_returned, self.gear_losses
        columns = (column(x, ".4g") for x in (*peaks, np.abs(self.motor_speed).max(0), *energies))
        motor = table("motor", titles, self.joints, *columns)
        sums = (x.sum() for x in (self.energy_taken, self.energy_returned, self.work, self.gear_losses))
        total = "All motors: {:.4g} J taken, {:.4g} J returned, {:.3g} J of work on the arm, {:.4g} J lost in gears"
        units = "SI units: N m, rad/s, W; N and m/s for joints that slide"
        lines = [title, *load, *motor, total.format(*sums), units]
        doubt = "The samples are too far apart to be trusted: from one to the next, work by them differs from the "
        doubt += "simulation's by {:.3g} J in all; simulate without t_eval, with a finer one or smaller tolerances"
        over = [f"{j} {x:.0%}" for j, x in zip(self.joints, self.torque_share, strict=True) if x > OVER]
        if over and self.rotor.any():
            lines.append(
                f"With their rotors drives exceed their torque limits: {', '.join(over)}; a motion that counts"
            )
            lines.append("them is planned for robot.with_armature(rotor * gear**2)")
        if (error := self.work_error or 0.0) > COARSE * self._integral(np.abs(self.power)).sum():
            lines.append(doubt.format(error))
        return "\n".join([*lines, str(self.bearings)])


def drives(
    robot: Robot | Scene, motion: Any, *, gear: ArrayLike = 1.0, rotor: ArrayLike = 0.0, efficiency: ArrayLike = 1.0
) -> DriveReport:
    """Loads of the drives, gears and bearings of a robot over the cycle of a motion.

    Parameters
    ----------
    robot : Robot or Scene
        Robot that moves; a Scene with its payload, friction and springs, which count for planned motions, in place of
        those that were planned for, and where a motion brings no torques of its own.
    motion : FastestMotion, Trajectory, Record or function of time
        Planned, simulated or measured: a function of time with a `duration`, such as a `Quintic`, taken every
        millisecond, at its `t` and `instants` and on both sides of its `breaks`, where it has them; or anything with
        arrays t, q and qd, and tau and qdd if they are known. A `rne.identification.Record` is prepared first, which
        filters its torques. Of a Trajectory its samples, what lies between the solver's own steps and both sides of
        jumps; if it has times of `t_eval`, these alone, and `print` says where they are too far apart.
    gear : float or array_like, shape (n,), optional
        Revolutions of the motor per revolution of the joint; rad/m for joints that slide.
    rotor : float or array_like, shape (n,), optional
        Inertia of motor and gear on the motor's side, in addition to the robot's `armature`; 0 for measured torques
        that contain it, and for motions with elastic joints, whose rotors are the scene's [kg m^2].
    efficiency : float or array_like, shape (n,), optional
        Efficiency of the gear, from above 0 to 1: load torque over motor torque in driving, the inverse in braking.

    Returns
    -------
    DriveReport
        Peaks, means and energies, joint by joint.

    Raises
    ------
    TypeError
        If `robot` is no Robot or Scene, or `motion` is no motion.
    ValueError
        If an array has the wrong shape or is not finite, times do not ascend, or a number is out of its range.

    Notes
    -----
    Motor torque = rotor gear qdd + tau / (gear efficiency) while the joint takes power, tau efficiency / gear while it
    returns power. Energy taken less returned is the work on the arm, the losses of the gear and the rotors' energy.
    Between the steps of a simulation torques are monotone cubics, without peaks of their own: peaks were up to 4 % low
    with the default tolerances, 1 % with `rtol=1e-8`.

    Examples
    --------
    >>> import rne
    >>> robot = rne.load("irb140").with_limits(effort=[250, 250, 150, 50, 50, 20])
    >>> turned = robot.with_armature(100**2 * 1e-4)  # the rotors are in what limits the motion
    >>> motion = rne.trajectories.fastest(turned, [[0] * 6, [1, 0.5, 0, 0, 0, 0]])
    >>> report = rne.drives(robot, motion, gear=100, rotor=1e-4, efficiency=0.85)
    >>> report.torque_share.round(2).tolist()
    [1.0, 1.0, 0.3, 0.05, 0.01, 0.0]
    """
    scene = _scene_of(robot, motion)
    moved = scene.resolved.robot
    t, q, qd, qdd, tau = _samples(scene, motion)
    gears = per_joint_array("gear", gear, moved.n, sign="positive")
    rotors = per_joint_array("rotor", rotor, moved.n, sign="not negative")
    efficiencies = per_joint_array("efficiency", efficiency, moved.n, sign="positive")
    if (efficiencies > 1).any():
        raise ValueError(f"`efficiency` must be at most 1, got {efficiencies.max():g}")
    is_elastic = isinstance(motion, Trajectory) and motion.motor_q.size > 0
    if is_elastic and rotors.any():
        raise ValueError("`rotor` must be 0 for a motion with elastic joints: the rotors are in its torques")
    speed = motors_at(motion, t)[1] if is_elastic else qd
    error = _work_error(motion, t, (tau * speed).sum(1)) if isinstance(motion, Trajectory) else None
    return DriveReport(moved, t, q, qd, qdd, tau, gears, rotors, efficiencies, speed, error, scene.resolved.springs)


def bearing_peaks(robot: Robot | Scene, motion: Any) -> BearingPeaks:
    """Largest force and torque on every joint's bearing during a motion, and when they occur.

    Parameters
    ----------
    robot : Robot or Scene
        Robot that moved; of a Scene, its robot with mounting, payload and locked joints, and its springs but for their
        damping.
    motion : Trajectory, FastestMotion, Record or function of time
        Any motion that `rne.drives` takes, and of one sample at least.

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
    Accelerations are those recorded in the motion, and between the solver's steps between those recorded.

    Examples
    --------
    >>> import rne
    >>> robot = rne.load("irb140")
    >>> peaks = rne.bearing_peaks(robot, rne.simulate(robot, [0] * 6, [0] * 6, 0.1))
    >>> peaks.joints[0], peaks.force[0].round(1).item()  # less than its weight of 736 N: the arm falls
    ('joint_1', 686.9)
    """
    scene = _scene_of(robot, motion)
    parts = scene.resolved
    peaks = _bearing_peaks(parts.robot, parts.springs, *_samples(scene, motion, instant=True)[:4])
    if peaks.not_known:  # printed with the peaks, but arrays are read too
        LOGGER.warning(" ".join(map(str.strip, not_known(peaks))))
    return peaks


def _bearing_peaks(robot: Robot, springs: Springs | None, t: Array, q: Array, qd: Array, qdd: Array) -> BearingPeaks:
    """Largest loads over samples of a robot's motion."""
    external = None if springs is None else springs.wrenches(robot, q)
    record = robot.recursion(q, qd, qdd, external=external)
    (force, force_time), (torque, torque_time) = (_peaks(t, x) for x in bearing_loads(record, robot.model))
    joints, span = (*record.joints, *record.pivots), (float(t[0]), float(t[-1]), len(t))
    return BearingPeaks(joints, force, force_time, torque, torque_time, *span, record.not_known, record.follow)


def _peaks(t: Array, loads: Array) -> tuple[Array, Array]:
    """Largest loads over the samples, and when; NaN both where they are not known."""
    peaks = loads.max(axis=0)
    return peaks, np.where(np.isnan(peaks), np.nan, t[np.argmax(loads, axis=0)])


def _scene_of(robot: Robot | Scene, motion: Any) -> Scene:
    """The scene that is given, otherwise the one that the motion was planned for with the robot, or the robot alone."""
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


def _work_error(motion: Trajectory, t: Array, power: Array) -> float:
    """Differences of the work by samples from that of a simulation, summed over the motion's samples."""
    work = np.append(0.0, np.cumsum((power[1:] + power[:-1]) / 2 * np.diff(t)))
    return float(np.abs(np.diff(work[np.searchsorted(t, motion.t, side="right") - 1] - motion.work)).sum())


def _times(motion: Any) -> Array:
    """Times at which to sample a function of time, those on both sides of its jumps among them."""
    own = np.concatenate([np.ravel(getattr(motion, name, ())) for name in ("t", "instants")])
    start, end = (own.min(), own.max()) if hasattr(motion, "t") else (0.0, getattr(motion, "duration", None))
    if end is None:
        raise TypeError("`motion` must have a `duration`, or arrays t, q and qd; got a function of time alone")
    grid = np.linspace(start, end, max(int(np.ceil(round((end - start) / EVERY, 6))), 1) + 1)
    sides = np.nextafter(np.ravel(getattr(motion, "breaks", ())), [[-np.inf], [np.inf]]).ravel()
    return np.unique(np.concatenate([grid, own, sides[(sides >= start) & (sides <= end)]]))


def _samples(scene: Scene, motion: Any, *, instant: bool = False) -> tuple[Array, Array, Array, Array, Array]:
    """Samples t, q, qd, qdd and tau of a motion; those of an `instant` suffice, if it is allowed."""
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
