"""Stability of PD gains without simulation: fastest mode, largest stable sample time, stiffness of gravity."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from ..basics.arrays import positive_number
from ..basics.spatial import Array
from ..basics.text import summary
from ..dynamics.forward import solve_mass_matrix
from ..dynamics.rnea import gravity_torque
from ..robot import Robot
from .laws import checked_vectors

SAMPLES, REFINED = 2048, 4  # configurations that are drawn, and the best of them that are refined
TRIED, SHORTEST = 1024, 1e-6  # sample times of the scan, and the shortest of them, of the longest
ROUNDS = 20  # of lowering the sample time and searching again
FREE = np.pi  # range of a coordinate without limits: -pi to pi [rad or m]


@dataclass(frozen=True, eq=False)
class Gains:
    """Stability of PD gains, as found by `check_gains`.

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
    sample_time_q : ndarray, shape (n,)
        Configuration that becomes unstable first [rad or m].
    gravity_stiffness : float
        Largest norm of dg/dq over the workspace: without gravity compensation every Kp must exceed it [N m/rad].
    beats_gravity : bool
        True if the smallest Kp exceeds it.
    sample_time : float or None
        The given sample time [s].
    stable : bool or None
        True if the sample time is below the limit; None if none was given.

    Examples
    --------
    >>> import rne
    >>> gains = rne.check_gains(rne.load("irb140"), 50, 20)
    >>> gains.beats_gravity, gains.stable is None
    (False, True)
    """

    largest_mode: float
    worst_q: Array
    fastest_pole: float
    sample_time_limit: float
    sample_time_q: Array
    gravity_stiffness: float
    beats_gravity: bool
    sample_time: float | None
    stable: bool | None

    __repr__ = summary

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
        The robot.
    kp, kd : float or array_like, shape (n,)
        Gains of each joint, positive [N m/rad, N m s/rad].
    sample_time : float, optional
        Time between samples, over which torques are held [s].

    Returns
    -------
    Gains
        Fastest modes, the limit of the sample time, and where they are reached.

    Raises
    ------
    ValueError
        If a gain or the sample time is not positive and finite, or has the wrong shape.
    SingularMassMatrixError
        If M is singular somewhere in the workspace; names the joints.

    Notes
    -----
    With gravity compensated, M qdd = -Kp e - Kd qd near a reference, e = q - q_ref. Evaluated continuously this loop is
    stable for all positive gains. Evaluated every T and held, it is the linear map of (e, qd) from sample to sample, in
    which the compensated gravity is held too: exact but for terms of second order in e and qd. The limit is the
    smallest T at which an eigenvalue of that map leaves the unit circle, over all configurations. For one configuration
    this is certain; over the workspace it is a search: random configurations within the joints' limits (seeded), the
    worst of them refined by L-BFGS-B. Åström and Wittenmark 1997, Computer-Controlled Systems, section 2.3.

    Examples
    --------
    >>> import rne
    >>> gains = rne.check_gains(rne.load("irb140"), [50] * 5 + [60], [20] * 5 + [22], 1.3e-4)
    >>> round(gains.sample_time_limit * 1e4, 3), gains.stable
    (1.308, True)
    """
    p, d = checked_vectors(robot, sign="positive", kp=kp, kd=kd)
    if sample_time is not None:
        positive_number("sample_time", sample_time)
    n = robot.n
    if n == 0:
        stable = None if sample_time is None else True
        return Gains(0.0, np.zeros(0), 0.0, np.inf, np.zeros(0), 0.0, True, sample_time, stable)
    lower, upper = workspace(robot)
    half = np.sqrt(d)

    def fastest(q: Array) -> Array:
        return np.linalg.eigvalsh(half[:, None] * inverse_mass_matrix(robot, q) * half)[..., -1]

    slope = robot.kernel(gravity_torque, "q")
    largest, worst = largest_over(fastest, lower, upper)
    stiffness, _ = largest_over(lambda q: np.linalg.norm(slope(q), 2, axis=(-2, -1)), lower, upper)
    inverse = inverse_mass_matrix(robot, worst)
    A = np.block([[np.zeros((n, n)), np.eye(n)], [-inverse * p, -inverse * d]])
    limit, limit_q = SampledLoop(robot, p, d).limit(2 / largest, worst)
    return Gains(
        largest,
        worst,
        float(-np.linalg.eigvals(A).real.min()),
        limit,
        limit_q,
        stiffness,
        bool(p.min() > stiffness),
        sample_time,
        None if sample_time is None else bool(sample_time < limit),
    )


def inverse_mass_matrix(robot: Robot, q: Array) -> Array:
    """M^-1 in configurations q, shape (..., n, n); raises SingularMassMatrixError, which names joints."""
    check, M = robot.kernel(solve_mass_matrix), robot.mass_matrix(q)
    check(q, np.zeros(robot.n))
    return np.asarray(np.linalg.inv(M))


def workspace(robot: Robot) -> tuple[Array, Array]:
    """Bounds of every coordinate: its limits, or -pi to pi where it has none."""
    lower, upper = robot.lower, robot.upper
    return np.where(np.isfinite(lower), lower, -FREE), np.where(np.isfinite(upper), upper, FREE)


def random_configurations(lower: Array, upper: Array) -> Array:
    """Configurations between two corners of the workspace, the one nearest to zero first, shape (SAMPLES + 1, n)."""
    drawn = np.random.default_rng(0).uniform(np.minimum(lower, upper), np.maximum(lower, upper), (SAMPLES, len(lower)))
    return np.concatenate([np.clip(np.zeros((1, len(lower))), lower, upper), drawn])


def largest_over(
    value: Callable[[Array], Array], lower: Array, upper: Array, drawn: Array | None = None
) -> tuple[float, Array]:
    """The largest value found between two corners of the workspace, and where; refined from the best drawn ones."""
    from scipy.optimize import Bounds, minimize

    drawn, bounds = random_configurations(lower, upper) if drawn is None else drawn, Bounds(lower, upper)
    found = [
        minimize(lambda q: -float(value(q)), start, method="L-BFGS-B", jac="3-point", bounds=bounds)
        for start in drawn[np.argsort(value(drawn))[-REFINED:]]
    ]
    best = min(found, key=lambda result: result.fun)
    return -float(best.fun), np.asarray(best.x)


class SampledLoop:
    """The linearised loop of a robot under sampled PD control with gravity compensation, in many configurations."""

    def __init__(self, robot: Robot, kp: Array, kd: Array) -> None:
        self.robot, self.kp, self.kd = robot, kp, kd
        self.slope = robot.kernel(gravity_torque, "q")

    def radius(self, q: Array, T: float | Array) -> Array:
        """Spectral radius of `step` for configurations q, shape (...)."""
        radius: Array = np.abs(np.linalg.eigvals(self.step(q, T))).max(axis=-1)
        return radius

    def step(self, q: Array, T: float | Array) -> Array:
        """The matrix of the map of (e, qd) over one sample time T, for configurations q, shape (..., 2 n, 2 n)."""
        inverse = inverse_mass_matrix(self.robot, q)
        W = inverse @ self.slope(q) * T * T  # gravity's stiffness: y'' = -(W / T^2) y + a while torques are held
        one = np.broadcast_to(np.eye(len(self.kp)), W.shape)
        position, velocity, force = one, one, one / 2  # y(T) = force a T^2, y'(T) = velocity a T, e(T) = position e
        term = one
        for k in range(1, 12):  # their power series
            term = -term @ W / ((2 * k - 1) * (2 * k))
            position = position + term
            velocity = velocity + term / (2 * k + 1)
            force = force + term / ((2 * k + 1) * (2 * k + 2))
        P, D = inverse * self.kp, inverse * self.kd
        by_error = [one - T * T * force @ P, -T * velocity @ P]
        by_velocity = [T * velocity - T * T * force @ D, position - T * velocity @ D]
        return np.concatenate([np.concatenate(by_error, -2), np.concatenate(by_velocity, -2)], -1)

    def limit(self, upper: float, start: Array) -> tuple[float, Array]:
        """The smallest sample time, at most about `upper`, that is unstable in some configuration, and where.

        `start` is a configuration that is examined along with the random ones.
        """
        low, high = workspace(self.robot)
        drawn = np.concatenate([start[None], random_configurations(low, high)])
        T, where = self.first_unstable(start, upper * (1 + 1e-9)), start
        for _ in range(ROUNDS):
            tried = T * (1 - 1e-6)
            radii = self.radius(drawn, tried)
            spread = float(np.ptp(radii)) or 1.0  # lightly damped loops differ in the fifth digit only
            largest, q = largest_over(lambda x: (self.radius(x, tried) - 1) / spread, low, high, drawn)  # noqa: B023
            if largest < 0 or T == 0:
                break
            T, where = self.first_unstable(q, T), q
        return T, where

    def first_unstable(self, q: Array, upper: float) -> float:
        """The smallest sample time up to `upper` at which configuration q is unstable; `upper` if there is none.

        Windows between neighbouring times of the scan are not seen; 0 if its shortest time is unstable already.
        """
        from scipy.optimize import brentq

        tried = upper * np.geomspace(SHORTEST, 1.0, TRIED)
        unstable = self.radius(q[None], tried[:, None, None]) >= 1
        k = int(unstable.argmax())
        if not unstable[k]:
            return upper
        if k == 0:
            return 0.0
        T = tried[k]
        return float(T * brentq(lambda part: self.radius(q[None], part * T)[0] - 1, tried[k - 1] / T, 1.0))
