"""Limits of a motion's positions, rates, accelerations and torques as inequalities in its coefficients."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..basics.arrays import convert_numbers
from ..basics.spatial import Array
from ..model.standard_parameters import DriveModel, StandardParameters
from ..robot import Robot
from .fourier import FourierBasis

GRID, FINE = 16, 64  # times per period of the highest harmonic: of the optimiser, of the final check
ROUNDING = 1e-12  # relative
TORQUE_MARGIN = 0.01  # of the limits, which the optimiser leaves for torques between its samples

Matrices = tuple[Array, Array, Array]


@dataclass(frozen=True, eq=False)
class SeriesLimits:
    """Series x of one robot within its limits; x scales coefficients by the rate limits, and is zero at mid-range.

    Attributes
    ----------
    robot : Robot
    limits : MotionLimits
    basis : FourierBasis
    rest : bool
        True for series that start with zero rates and accelerations.
    """

    robot: Robot
    limits: MotionLimits
    basis: FourierBasis
    rest: bool

    @cached_property
    def free(self) -> Array:
        """Coefficient vectors of one joint that x combines, as columns."""
        return self.basis.from_rest if self.rest else np.eye(2 * self.basis.harmonics + 1)

    @property
    def size(self) -> int:
        """Length of x."""
        return self.robot.n * int(self.free.shape[1])

    def coefficients(self, x: Array) -> Array:
        """(q0, a, b) of each joint, shape (..., n, 2 H + 1)."""
        rates: Array = x.reshape(*x.shape[:-1], self.robot.n, -1) * self.limits.velocity_limit[:, None]
        found: Array = rates @ self.free.T
        found[..., 0] += self.limits.centre
        return found

    def gradient(self, by_coefficients: Array) -> Array:
        """Derivatives by x from those by the coefficients, shape (..., n, 2 H + 1)."""
        rates = (by_coefficients @ self.free) * self.limits.velocity_limit[:, None]
        return rates.reshape(*rates.shape[:-2], -1)

    def states(self, x: Array, matrices: Matrices) -> tuple[Array, Array, Array]:
        """q, qd and qdd, shape (..., T, n) each."""
        rows = np.swapaxes(self.coefficients(x), -1, -2)
        q, qd, qdd = (m @ rows for m in matrices)
        return q, qd, qdd

    def linear(self, count: int) -> dict[str, Array]:
        """Bounds A x of positions, rates and accelerations over their limits, shape (n, count, size of one joint).

        Values between the times of the grid are included: |A x| <= 1 on the grid keeps the limit at all times.
        """
        q, qd, qdd = (m @ self.free / self.basis.grid_share(count) for m in self.basis.grid(count))
        v, limits = self.limits.velocity_limit[:, None, None], self.limits
        return {
            "position": q * v / limits.half_range[:, None, None],
            "rate": qd * v / v,
            "acceleration": qdd * v / limits.acceleration_limit[:, None, None],
        }

    @cached_property
    def rows(self) -> Array:
        """A of the optimiser's inequalities A x <= 1."""
        n, m = self.robot.n, self.free.shape[1]
        blocks = []
        for kind, A in self.linear(GRID * self.basis.harmonics).items():
            for j in range(n):
                if kind != "acceleration" or np.isfinite(self.limits.acceleration_limit[j]):
                    block = np.zeros((A.shape[1], n, m))
                    block[:, j] = A[j]
                    blocks.append(block.reshape(-1, n * m))
        one_side = np.concatenate(blocks)
        return np.concatenate([one_side, -one_side])

    @cached_property
    def driven(self) -> Array:
        """Joints with limited torques."""
        return np.flatnonzero(np.isfinite(self.limits.effort_limit))

    @cached_property
    def _friction(self) -> tuple[Array, Array]:
        """Viscous and Coulomb friction that the model has, per coordinate."""
        known = StandardParameters(self.robot.model, DriveModel(friction="viscous+coulomb"))
        return known.values[known.groups["Fv"]], known.values[known.groups["Fc"]]

    def torques(self, states: tuple[Array, Array, Array]) -> Array:
        """Torques of the drives with the model's viscous friction."""
        torques: Array = self.robot.inverse_dynamics(*states) + self._friction[0] * states[1]
        return torques

    def torque_shares(self, states: tuple[Array, Array, Array]) -> Array:
        """Torques over their limits, Coulomb friction always against the drive."""
        shares: Array = (np.abs(self.torques(states)) + self._friction[1]) / self.limits.effort_limit
        return shares

    def torque_use(self, x: Array) -> Array:
        """The largest share of the efforts that series use, shape (..., n).

        Between samples of the fine grid what a parabola through three of them says.
        """
        if not len(self.driven):
            return np.zeros((*x.shape[:-1], self.robot.n))
        states = self.states(x, self._fine[1])
        tau = self.torques(states) / self.limits.effort_limit
        bend = np.abs(np.roll(tau, 1, -2) - 2 * tau + np.roll(tau, -1, -2)).max(-2) / 8
        use: Array = self.torque_shares(states).max(-2) + bend
        return use

    def torque_slack(self, x: Array, matrices: Matrices) -> Array:
        """What the optimiser keeps positive, of each joint with a limit, at each time, of either sign of the torque."""
        limit, tau = self._torque_limit, self.torques(self.states(x, matrices))[:, self.driven] / self._scale
        return np.concatenate([(limit - tau).ravel(), (limit + tau).ravel()])

    def torque_slack_slopes(self, x: Array, matrices: Matrices) -> Array:
        """Its derivatives by x, exact."""
        dq, dqd, M = self.robot.inverse_dynamics_derivatives(*self.states(x, matrices))
        dqd = dqd + np.diag(self._friction[0])
        by_coefficients = sum(
            d[:, self.driven, :, None] * m[:, None, None, :] for d, m in zip((dq, dqd, M), matrices, strict=True)
        )
        slopes = self.gradient(np.asarray(by_coefficients)) / self._scale[:, None]
        slopes = slopes.reshape(-1, self.size)
        return np.concatenate([-slopes, slopes])

    @property
    def _scale(self) -> Array:
        return self.limits.effort_limit[self.driven]

    @property
    def _torque_limit(self) -> Array:
        return 1 - TORQUE_MARGIN - self._friction[1][self.driven] / self._scale

    @cached_property
    def _fine(self) -> tuple[dict[str, Array], Matrices]:
        count = FINE * self.basis.harmonics
        return self.linear(count), self.basis.grid(count)

    def use(self, x: Array) -> dict[str, Array]:
        """The largest share of each limit that a series uses, at most, shape (n,) each."""
        parts = x.reshape(self.robot.n, -1)
        found = {kind: np.abs(np.einsum("jti,ji->jt", A, parts)).max(1) for kind, A in self._fine[0].items()}
        return found | {"torque": self.torque_use(x)}

    def holds(self, x: Array) -> bool:
        """True if a series keeps its limits.

        Proven at all times for positions, rates and accelerations; torques are checked at the samples of the fine grid,
        with a parabola between them.
        """
        return all(bool((share <= 1).all()) for share in self.use(x).values())


NAMES = ("lower", "upper", "velocity_limit", "acceleration_limit", "effort_limit")


@dataclass(frozen=True, eq=False)
class MotionLimits:
    """Limits per coordinate, shape (n,) each; accelerations and torques may be unlimited."""

    lower: Array
    upper: Array
    velocity_limit: Array
    acceleration_limit: Array
    effort_limit: Array

    @property
    def centre(self) -> Array:
        """The middle of the ranges."""
        return (self.lower + self.upper) / 2

    @property
    def half_range(self) -> Array:
        """Half the width of the ranges."""
        return (self.upper - self.lower) / 2


def motion_limits(robot: Robot, given: Mapping[str, ArrayLike] | None) -> MotionLimits:
    """The robot's limits, replaced by those given.

    Raises
    ------
    TypeError
        If `given` is no mapping.
    ValueError
        If a name is unknown, a shape wrong, a range empty, a limit negative, or a joint has no range or rate limit.
    """
    if given is None:
        given = {}
    if not isinstance(given, Mapping):
        raise TypeError(f"`limits` must be a mapping of names to arrays, got {type(given).__name__}")
    for name in given:
        if name not in NAMES:
            raise ValueError(f"`limits` must name some of {list(NAMES)}, got {name!r}")
    values: dict[str, Array] = _of_robot(robot)
    for name, limit in given.items():
        values[name] = _limit(f"limits[{name!r}]", limit, robot.n)
    _check(robot, values)
    return MotionLimits(**values)


def _of_robot(robot: Robot) -> dict[str, Array]:
    """Those of the robot's joints, joints that mimic others included."""
    model = robot.model
    lower, upper, rate = robot.lower.copy(), robot.upper.copy(), robot.velocity_limit.copy()
    for i, k in enumerate(model.coordinate):
        m = model.multiplier[i]
        if i == model.independent_joints[k] or m == 0:
            continue
        ends = sorted(((model.lower[i] - model.offset[i]) / m, (model.upper[i] - model.offset[i]) / m))
        lower[k], upper[k] = max(lower[k], ends[0]), min(upper[k], ends[1])
        rate[k] = min(rate[k], model.velocity_limit[i] / abs(m))
    free = np.full(robot.n, np.inf)
    return {
        "lower": lower,
        "upper": upper,
        "velocity_limit": rate,
        "acceleration_limit": free,
        "effort_limit": robot.effort_limit,
    }


def _limit(name: str, value: Any, n: int) -> Array:
    array = np.array(convert_numbers(name, value, f"({n},)"), dtype=float)
    if array.shape != (n,):
        raise ValueError(f"`{name}` must have shape ({n},), got {array.shape}")
    if np.isnan(array).any():
        raise ValueError(f"`{name}` must not be NaN, got nan at index ({int(np.isnan(array).argmax())},)")
    return array


def _check(robot: Robot, values: Mapping[str, Array]) -> None:
    for k, joint in enumerate(robot.joint_names):
        low, high, rate = (float(values[name][k]) for name in NAMES[:3])
        if not np.isfinite([low, high]).all():
            raise ValueError(f"joint {joint!r} has no finite range; give `limits` with 'lower' and 'upper'")
        if not np.isfinite(rate):
            raise ValueError(f"joint {joint!r} has no finite rate limit; give `limits` with 'velocity_limit'")
        if not low < high:
            raise ValueError(f"`limits`: the range of joint {joint!r} is empty, from {low:g} to {high:g}")
        for name in NAMES[2:]:
            if not values[name][k] > 0:
                raise ValueError(f"`limits`: {name} of joint {joint!r} must be positive, got {values[name][k]:g}")
