"""Stability of PD gains without simulation: fastest mode, largest stable sample time, stiffness of gravity."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from ..basics.arrays import positive_number, vector
from ..basics.spatial import Array
from ..dynamics.rnea import gravity_torque
from ..robot import Robot

SAMPLES, REFINED = 4096, 4  # configurations drawn, and the best of them that are followed uphill
FREE = np.pi  # range of a coordinate without limits: -pi to pi [rad or m]


@dataclass(frozen=True, eq=False)
class Gains:
    """What `check_gains` found.

    Attributes
    ----------
    largest_mode : float
        Largest eigenvalue of M^-1 Kd over the workspace: the fastest decay of the closed loop, up to Kp [1/s].
    worst_q : ndarray, shape (n,)
        Configuration with the largest mode [rad or m].
    fastest_pole : float
        Fastest decay of the loop in that configuration, Kp included [1/s].
    sample_time_limit : float
        Sample time above which held torques make the loop unstable somewhere in the workspace [s].
    gravity_stiffness : float
        Largest norm of dg/dq over the workspace: without gravity compensation every Kp must exceed it [N m/rad].
    beats_gravity : bool
        True if the smallest Kp exceeds it.
    sample_time : float or None
        The given sample time [s].
    stable : bool or None
        True if the sample time is below the limit; None if none was given.
    """

    largest_mode: float
    worst_q: Array
    fastest_pole: float
    sample_time_limit: float
    gravity_stiffness: float
    beats_gravity: bool
    sample_time: float | None
    stable: bool | None

    def __str__(self) -> str:
        verdict = "" if self.stable is None else f" {self.sample_time:g} s is {'' if self.stable else 'NOT '}stable."
        exceed = "exceed" if self.beats_gravity else "do NOT exceed"
        return (
            f"fastest mode M^-1 Kd {self.largest_mode:.6g} 1/s, fastest pole {self.fastest_pole:.6g} 1/s\n"
            f"largest stable sample time {self.sample_time_limit:.4g} s.{verdict}\n"
            f"gravity's stiffness {self.gravity_stiffness:.4g} N m/rad: without compensation the gains {exceed} it"
        )


def check_gains(robot: Robot, kp: ArrayLike, kd: ArrayLike, sample_time: float | None = None) -> Gains:
    """Stability of PD gains over a robot's workspace, continuous or sampled.

    Parameters
    ----------
    robot : Robot
    kp, kd : array_like, shape (n,)
        Gains of each joint, positive [N m/rad, N m s/rad].
    sample_time : float, optional
        Time between samples, over which torques are held [s].

    Returns
    -------
    Gains

    Raises
    ------
    ValueError
        If a gain or the sample time is not positive and finite, or has the wrong shape.

    Notes
    -----
    With gravity compensated, M qdd = -Kp (q - q_ref) - Kd qd near the reference. A mode of M^-1 Kd = lambda under
    torques held for T is stable for lambda T < 2, for any Kp, as long as Kp T < 2 Kd; both conditions are checked.
    The maximum is searched for from random configurations within the joints' limits by L-BFGS-B; it is not proved.

    Examples
    --------
    >>> import rne
    >>> gains = rne.check_gains(rne.load("irb140"), [50] * 5 + [60], [20] * 5 + [22], 1.3e-4)
    >>> round(gains.sample_time_limit * 1e4, 3), gains.stable
    (1.308, True)
    """
    if not isinstance(robot, Robot):
        raise TypeError(f"`robot` must be an rne.Robot, got {type(robot).__name__}")
    p, d = (vector(name, gain, robot.n, sign="positive") for name, gain in (("kp", kp), ("kd", kd)))
    if sample_time is not None:
        positive_number("sample_time", sample_time)
    if robot.n == 0:
        return Gains(0.0, np.zeros(0), 0.0, np.inf, 0.0, True, sample_time, None if sample_time is None else True)
    lower, upper = workspace(robot)
    half = np.sqrt(d)

    def fastest(q: Array) -> Array:
        return np.linalg.eigvalsh(half[:, None] * np.linalg.inv(robot.mass_matrix(q)) * half)[..., -1]

    slope = robot.kernel(gravity_torque, "q")
    largest, worst = largest_over(fastest, lower, upper)
    stiffness, _ = largest_over(lambda q: np.linalg.norm(slope(q), 2, axis=(-2, -1)), lower, upper)
    inverse = np.linalg.inv(robot.mass_matrix(worst))
    n = robot.n
    A = np.block([[np.zeros((n, n)), np.eye(n)], [-inverse * p, -inverse * d]])
    limit = _sample_limit(inverse, p, d, 2 / largest)
    return Gains(
        largest,
        worst,
        float(-np.linalg.eigvals(A).real.min()),
        limit,
        stiffness,
        bool(p.min() > stiffness),
        sample_time,
        None if sample_time is None else bool(sample_time < limit),
    )


def workspace(robot: Robot) -> tuple[Array, Array]:
    """Bounds of every coordinate: its limits, or -pi to pi where it has none."""
    drivers = list(robot.model.independent_joints)
    lower, upper = robot.model.lower[drivers].astype(float), robot.model.upper[drivers].astype(float)
    return np.where(np.isfinite(lower), lower, -FREE), np.where(np.isfinite(upper), upper, FREE)


def largest_over(value: Callable[[Array], Array], lower: Array, upper: Array) -> tuple[float, Array]:
    """The largest value found between two corners of the workspace, and where."""
    from scipy.optimize import minimize

    rng = np.random.default_rng(0)
    drawn = rng.uniform(np.minimum(lower, upper), np.maximum(lower, upper), (SAMPLES, len(lower)))
    drawn = np.concatenate([np.clip(np.zeros((1, len(lower))), lower, upper), drawn])
    values = value(drawn)
    best, where = float(values.max()), drawn[int(values.argmax())]
    for start in drawn[np.argsort(values)[-REFINED:]]:
        climbed = minimize(
            lambda q: -float(value(q)), start, method="L-BFGS-B", bounds=list(zip(lower, upper, strict=True))
        )
        if -climbed.fun > best:
            best, where = float(-climbed.fun), np.asarray(climbed.x)
    return best, where


def _sample_limit(inverse: Array, kp: Array, kd: Array, first: float) -> float:
    """Largest T for which the loop with torques held for T is stable, at most `first`."""
    n = len(kp)
    P, D, one = inverse * kp, inverse * kd, np.eye(n)

    def radius(T: float) -> float:
        step = np.block([[one - T * T / 2 * P, T * one - T * T / 2 * D], [-T * P, one - T * D]])
        return float(np.abs(np.linalg.eigvals(step)).max())

    if radius(first * (1 - 1e-6)) < 1:
        return first
    low, high = 0.0, first
    for _ in range(60):
        middle = (low + high) / 2
        low, high = (middle, high) if radius(middle) < 1 else (low, middle)
    return low
