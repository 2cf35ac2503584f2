"""Loads of drives, gears and bearings over the cycle of a motion: planned, simulated or measured."""

from __future__ import annotations

import logging
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..basics.arrays import cached_array, per_joint_array
from ..basics.spatial import Array
from ..basics.text import InNotebooks, column, six_digits, table
from ..dynamics.limits import limit_shares, share_texts
from ..robot import Robot
from .bearings import BearingPeaks, cycle_samples, peaks_of, scene_of
from .scene import Scene
from .springs import Springs
from .trajectory import Trajectory, motors_at

LOGGER = logging.getLogger("rne")
MOVING = 0.01  # speed of a drive on duty relative to the joint's largest
OVER = 1.005  # share of a limit above which it counts as exceeded: plans keep to 1 within about 1e-3
COARSE = 2e-3  # error of work relative to all energy exchanged: twice that of a run with default tolerances


@dataclass(frozen=True, eq=False)
class DriveReport(InNotebooks):
    """Loads of drives, gears and bearings over a cycle, found by `rne.drives`; `print` shows them as tables.

    Integrals over time are by the trapezoidal rule over the samples.

    Attributes
    ----------
    robot : Robot
        Robot that moves, with the payload of its scene.
    t : ndarray, shape (T,)
        Times of the samples; the time of a jump occurs twice, first with the values before it [s].
    q, qd, qdd, tau : ndarray, shape (T, n)
        Positions, velocities, accelerations and torques of the joints, on the output side of the gears
        [rad or m; rad/s or m/s; rad/s^2 or m/s^2; N m or N].
    gear, rotor, efficiency : ndarray, shape (n,)
        Arguments of `drives`, for each drive.
    speed : ndarray, shape (T, n)
        Velocities of the drives on the output side of their gears: `qd`, or with elastic joints the motors' [rad/s or
        m/s].
    work_error : float or None
        Differences between the work of all drives computed from these samples and the `work` of a simulated motion,
        summed over the steps from one of its samples to the next [J].
    springs : Springs or None
        Springs of the scene, which load the bearings.
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
        return peaks_of(self.robot, self.springs, self.t, self.q, self.qd, self.qdd)

    @cached_property
    def _shares(self) -> dict[str, Array]:
        return limit_shares(self.robot.model.coordinate_limits(), self.speed, self.qdd, self.drive_torque)

    @property
    def duration(self) -> float:
        """Time from the first to the last sample [s]."""
        return float(self.t[-1] - self.t[0])

    @property
    def power(self) -> Array:
        """Mechanical power of each drive on the output side of its gear, shape (T, n) [W]."""
        return np.asarray(self.tau * self.speed)

    @property
    def drive_torque(self) -> Array:
        """Torque of each drive at its gear's output, its rotor's share included as in limits, (T, n) [N m or N]."""
        return np.asarray(self.tau + self.rotor * self.gear**2 * self.qdd)

    @property
    def motor_speed(self) -> Array:
        """Velocity of each motor, shape (T, n) [rad/s]."""
        return np.asarray(self.gear * self.speed)

    @cached_array
    def motor_torque(self) -> Array:
        """Torque of each motor, shape (T, n): for its rotor, and for the load with the losses of the gear [N m]."""
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
        """Time at which the peak torque is first reached, shape (n,) [s]."""
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
        """Work that each drive does on the arm, after its gear, friction of the joint included, shape (n,) [J]."""
        return self._integral(self.power)

    @property
    def gear_losses(self) -> Array:
        """Energy lost in each gear, shape (n,) [J]."""
        return self._integral((self._gear_input - self.tau) * self.speed)

    @property
    def rotor_energy(self) -> Array:
        """Work that accelerates each rotor, zero from rest to rest except for integration errors, shape (n,) [J]."""
        return self._integral(self.rotor * self.gear * self.qdd * self.motor_speed)

    @property
    def duty(self) -> Array:
        """Share of the time in which each joint moves, at more than 1 % of its largest speed, shape (n,)."""
        return self._mean((np.abs(self.speed) > MOVING * self.peak_speed).astype(float))

    @property
    def torque_share(self) -> Array:
        """Peak torques, rotors included, over their limits, 0 where there is none, shape (n,)."""
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
        doubt = "The samples are too far apart: the work computed from them differs from the simulation's by a total "
        doubt += "of {:.3g} J; simulate without t_eval, with a finer one or smaller tolerances"
        over = [f"{j} {x:.0%}" for j, x in zip(self.joints, self.torque_share, strict=True) if x > OVER]
        if over and self.rotor.any():
            lines.append(f"With their rotors included, drives exceed their torque limits: {', '.join(over)}; to take")
            lines.append("rotors into account, plan the motion for robot.with_armature(rotor * gear**2)")
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
        Robot that moves; for a Scene with its payload, friction and springs, which replace those that a motion was
        planned for, and give the torques of a motion that has none.
    motion : FastestMotion, Trajectory, Record or function of time
        Planned, simulated or measured: a function of time with a `duration`, such as a `Quintic`, evaluated every
        millisecond, at its `t` and `instants` and on both sides of its `breaks`, where it has them; or anything with
        arrays t, q and qd, and tau and qdd if they are known. A `rne.identification.Record` is prepared first, which
        filters its torques. A Trajectory is evaluated at its samples, between the solver's own steps and on both sides
        of jumps; with `t_eval` only at its times, and `print` says if they are too far apart.
    gear : float or array_like, shape (n,), optional
        Revolutions of the motor per revolution of the joint; rad/m for joints that slide.
    rotor : float or array_like, shape (n,), optional
        Inertia of motor and gear on the motor's side, in addition to the robot's `armature`; 0 for measured torques
        that contain it, and for motions with elastic joints, whose rotors are the scene's [kg m^2].
    efficiency : float or array_like, shape (n,), optional
        Efficiency of the gear, above 0 and at most 1: load torque over motor torque while driving, the inverse while
        braking.

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
    Between the steps of a simulation torques are monotone cubics without further peaks: peaks were up to 4 % low
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
    scene = scene_of(robot, motion)
    moved = scene.resolved.robot
    t, q, qd, qdd, tau = cycle_samples(scene, motion)
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


def _work_error(motion: Trajectory, t: Array, power: Array) -> float:
    """Differences between the work by samples and by the simulation, summed over the motion's samples."""
    work = np.append(0.0, np.cumsum((power[1:] + power[:-1]) / 2 * np.diff(t)))
    return float(np.abs(np.diff(work[np.searchsorted(t, motion.t, side="right") - 1] - motion.work)).sum())
