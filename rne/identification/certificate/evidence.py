"""The torques that a model is judged by: motions, torques of another model or measured ones, and their uncertainty."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from ...basics.spatial import Array
from ...dynamics.rnea import gravity_torque
from ...model.standard_parameters import StandardParameters
from ...robot import Robot

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
    return StandardParameters(robot.model, rotor=True, friction="viscous+coulomb", offset=True)


def gravity_columns(robot: Robot, q: Array) -> Array:
    """Torques per unit of each component of gravity, shape (..., n, 3): each as if gravity had that direction."""
    units = [replace(robot.model, gravity=e, notes={}) for e in np.eye(3)]
    return np.stack([gravity_torque(model, q) for model in units], axis=-1)
