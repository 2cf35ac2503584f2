"""The torques that a model is judged by: motions, torques of another model or measured ones, and their uncertainty."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..basics.spatial import Array
from ..dynamics.rnea import gravity_torque
from ..model.model import joint_array
from ..model.standard_parameters import MEASURED, StandardParameters
from ..robot import Robot
from .equations import stacked
from .least_squares import repeats_of_filtered_noise
from .prepared import Prepared
from .record import Record
from .rigid_body_test import torque_noise, torque_noise_of_positions

SMALLEST = 1e-6  # of the largest torque of a robot: a joint with smaller torques is judged as if it had this


@dataclass(frozen=True, eq=False)
class Evidence:
    """Motions with torques, beside those of a robot.

    Attributes
    ----------
    robot : Robot
        What the torques are compared with.
    q, qd, qdd : ndarray, shape (R, n)
        States of the rows.
    tau : ndarray, shape (R, n)
        Torques of the other model, or measured and filtered [N m or N].
    columns : ndarray, shape (R, n, P)
        Torques per unit of each standard parameter, filtered as `tau` is.
    gravity : ndarray, shape (R, n, 3)
        Torques per unit of each component of gravity.
    standard : StandardParameters
        Names and places of the P parameters.
    valid : ndarray of bool, shape (R, n)
    sigma : ndarray, shape (n,)
        Standard deviation of `tau`, or the rounding that is allowed [N m or N].
    limit : float
        Largest root mean square of a residual that counts as explained, in units of `sigma`.
    exact : bool
        True if `sigma` is a tolerance and not noise: residuals below it are equally good.
    repeats : float
        How many torques count as one, because the filter makes neighbours alike.
    predict : callable
        Torques of the robot, filtered as `tau` is, of a map of states (q, qd, qdd) -> torques.
    """

    robot: Robot
    q: Array
    qd: Array
    qdd: Array
    tau: Array
    columns: Array
    gravity: Array
    standard: StandardParameters
    valid: Array
    sigma: Array
    limit: float
    exact: bool
    repeats: float
    predict: Callable[[Callable[[Array, Array, Array], Array]], Array]

    @cached_property
    def expected(self) -> Array:
        """The robot's own torques, shape (R, n); joint friction is not among them."""
        values = self.standard.values.copy()
        for symbol in ("Fv", "Fc"):
            values[self.standard.groups[symbol]] = 0
        torques: Array = self.columns @ values
        return torques

    @cached_property
    def difference(self) -> Array:
        """tau less the robot's own torques, shape (R, n)."""
        return self.tau - self.expected

    @property
    def count(self) -> int:
        """Number of torques."""
        return int(self.valid.sum())

    @property
    def independent(self) -> float:
        """Number of independent torques."""
        return self.count / self.repeats

    def weighted(self, residual: Array) -> Array:
        """Residuals, or columns of them, in units of `sigma`; zero where not valid; shape (R n, ...)."""
        weight = (self.valid / self.sigma).reshape(*self.valid.shape, *[1] * (residual.ndim - 2))
        scaled: Array = residual * weight
        return scaled.reshape(-1, *residual.shape[2:])

    def ratios(self, residual: Array) -> Array:
        """Root mean square of each joint's residual in units of `sigma`, shape (n,)."""
        squares = (self.weighted(residual) ** 2).reshape(self.valid.shape).sum(0)
        ratios: Array = np.sqrt(squares / np.maximum(self.valid.sum(0), 1))
        return ratios

    def relative(self, residual: Array) -> Array:
        """|residual| / |tau| of each joint, shape (n,)."""
        size = np.sqrt(((self.tau * self.valid) ** 2).sum(0))
        least = max(SMALLEST * size.max(initial=0), np.finfo(float).tiny)
        relative: Array = np.sqrt(((residual * self.valid) ** 2).sum(0)) / np.maximum(size, least)
        return relative

    def explains(self, residual: Array) -> bool:
        """True if no joint's residual is larger than rounding or noise."""
        return bool((self.ratios(residual) <= self.limit).all())

    def score(self, residual: Array, numbers: int, alternatives: float) -> float:
        """Bayesian information criterion (Schwarz 1978): smaller is better.

        N log(chi^2 / N) + k log N + 2 log A, for k free numbers and a choice among A alternatives.
        """
        mean = float((self.weighted(residual) ** 2).sum() / self.count)
        mean = max(mean, self.limit**2 if self.exact else np.finfo(float).tiny)
        N = self.independent
        return float(N * np.log(mean) + numbers * np.log(N) + 2 * np.log(alternatives))


def all_parameters(robot: Robot) -> StandardParameters:
    """Bodies, rotors, friction and offsets."""
    return StandardParameters(robot.model, MEASURED)


def gravity_columns(robot: Robot, q: Array) -> Array:
    """Torques per unit of each component of gravity, shape (..., n, 3): each as if gravity had that direction."""
    units = [replace(robot.model, gravity=e, notes={}) for e in np.eye(3)]
    return np.stack([gravity_torque(model, q) for model in units], axis=-1)


STATES = 120  # at which two models are compared
RATE, ACCELERATION = 1.5, 5.0  # standard deviations [rad/s or m/s; rad/s^2 or m/s^2]
TURNING, SLIDING = np.pi, 0.3  # largest positions where a joint has no limits [rad; m]
TOLERANCE = 1e-8  # of torques: two models that differ by less are the same
NOISE = 1.3  # times the noise: a residual that is explained by it

Other = Robot | Callable[[Array, Array, Array], Any] | Sequence[Any] | Record


def states_of(robot: Robot, other: Other, seed: int) -> tuple[Array, Array, Array, Array]:
    """States and the other's torques."""
    n = robot.n
    if isinstance(other, Robot):
        if other.n != n:
            raise ValueError(f"`other` must have {n} joints, as the robot, got {other.n}")
        q, qd, qdd = random_states(robot, seed)
        return q, qd, qdd, other.inverse_dynamics(q, qd, qdd)
    if callable(other):
        q, qd, qdd = random_states(robot, seed)
        tau = np.asarray(other(q, qd, qdd), dtype=np.float64)
        if tau.shape != q.shape:
            raise ValueError(f"`other` must return torques of shape {q.shape}, got {tau.shape}")
    elif isinstance(other, Sequence) and len(other) == 4:
        q, qd, qdd, tau = (np.asarray(joint_array(name, x, robot.model), np.float64) for name, x in _named(other))
        if q.ndim != 2 or not q.shape == qd.shape == qdd.shape == tau.shape:
            raise ValueError(f"`other` must be four arrays of shape (N, {n}), got {[np.shape(x) for x in other]}")
        fewest = -(-all_parameters(robot).count // max(n, 1))  # as many torques as standard parameters
        if len(q) < fewest:
            raise ValueError(f"`other` must have at least {fewest} states for {n} joints, got {len(q)}")
    else:
        raise TypeError(
            "`other` must be an rne.Robot, a function of (q, qd, qdd), arrays (q, qd, qdd, tau) or an "
            f"rne.identification.Record, got {type(other).__name__}"
        )
    if not np.isfinite(tau).all():
        raise ValueError("`other`: the torques must be finite")
    return q, qd, qdd, tau


def _named(other: Sequence[ArrayLike]) -> list[tuple[str, ArrayLike]]:
    return list(zip(("q", "qd", "qdd", "tau"), other, strict=True))


def random_states(robot: Robot, seed: int) -> tuple[Array, Array, Array]:
    """States all over the ranges of the joints."""
    rng = np.random.default_rng(seed)
    model = robot.model
    drive = list(model.independent_joints)
    reach = np.array([SLIDING if model.joint_types[j] == "prismatic" else TURNING for j in drive])
    lower, upper = (np.clip(x[drive], -reach, reach) for x in (model.lower, model.upper))
    q = rng.uniform(lower, upper, (STATES, robot.n))
    scale = np.where(reach == SLIDING, SLIDING, 1.0)
    qd = RATE * scale * rng.standard_normal(q.shape)
    qdd = ACCELERATION * scale * rng.standard_normal(q.shape)
    return q, qd, qdd


def model_evidence(robot: Robot, q: Array, qd: Array, qdd: Array, tau: Array, tolerance: float) -> Evidence:
    """Torques of another model."""
    standard = all_parameters(robot)
    columns = np.concatenate([robot.regressor(q, qd, qdd), standard.drive_columns(qd, qdd)], axis=-1)
    size = np.sqrt((tau**2).mean(0)) + np.sqrt((robot.inverse_dynamics(q, qd, qdd) ** 2).mean(0))
    sigma = tolerance * np.maximum(np.maximum(size, SMALLEST * size.max()), np.finfo(float).tiny)
    gravity = gravity_columns(robot, q)
    valid = np.ones(tau.shape, bool)

    def predict(torques: Callable[[Array, Array, Array], Array]) -> Array:
        return torques(q, qd, qdd)

    return Evidence(robot, q, qd, qdd, tau, columns, gravity, standard, valid, sigma, 1.0, True, 1.0, predict)


def measured_evidence(robot: Robot, record: Prepared) -> Evidence:
    """Measured torques, filtered."""
    standard = all_parameters(robot)
    rows = stacked(robot, standard, record, np.zeros(robot.n))
    q, qd, qdd = (record.reduce(x) for x in (record.q, record.qd, record.qdd))
    gravity = record.reduce(gravity_columns(robot, record.q))
    by_positions = torque_noise_of_positions(record, robot.inverse_dynamics(record.q, record.qd, record.qdd))
    least = TOLERANCE * np.sqrt((rows.tau**2).mean(0)).max()
    sigma = np.sqrt(torque_noise(record) ** 2 + by_positions**2 + least**2)

    def predict(torques: Callable[[Array, Array, Array], Array]) -> Array:
        return record.reduce(torques(record.q, record.qd, record.qdd))

    repeats = repeats_of_filtered_noise(record.cutoff, record.sample_rate, record.decimation)
    return Evidence(
        robot, q, qd, qdd, rows.tau, rows.Y, gravity, standard, rows.valid, sigma, NOISE, False, repeats, predict
    )
