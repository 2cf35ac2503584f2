"""Limits of a motion's positions, rates, accelerations and torques as inequalities in its coefficients."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..basics.arrays import convert_numbers, real_array
from ..basics.spatial import Array
from ..model.standard_parameters import DriveModel, StandardParameters
from ..robot import Robot
from .fourier import FourierBasis, States

GRID, FINE = 16, 64  # times per period of the highest harmonic: of the optimiser, of the final check
TORQUE_MARGIN = 0.01  # of the limits, which the optimiser leaves for torques between its samples
NAMES = ("lower", "upper", "velocity_limit", "acceleration_limit", "effort_limit")

Locked = Mapping[Any, float] | Iterable[Any]  # joints by name or index, with their positions or without


def motion_limits(robot: Robot, given: Mapping[str, ArrayLike] | None) -> dict[str, Array]:
    """The robot's limits, those of joints that mimic others included, replaced by those given; shape (n,) each.

    Raises
    ------
    TypeError
        If `given` is no mapping.
    ValueError
        If a name is unknown or a shape wrong.
    """
    if given is None:
        given = {}
    if not isinstance(given, Mapping):
        raise TypeError(f"`limits` must be a mapping of names to arrays, got {type(given).__name__}")
    model, lower, upper, rate = robot.model, robot.lower.copy(), robot.upper.copy(), robot.velocity_limit.copy()
    for i, k in enumerate(model.coordinate):
        m = model.multiplier[i]
        if i != model.independent_joints[k] and m != 0:
            ends = sorted(((model.lower[i] - model.offset[i]) / m, (model.upper[i] - model.offset[i]) / m))
            lower[k], upper[k] = max(lower[k], ends[0]), min(upper[k], ends[1])
            rate[k] = min(rate[k], model.velocity_limit[i] / abs(m))
    values = dict(zip(NAMES, (lower, upper, rate, np.full(robot.n, np.inf), robot.effort_limit), strict=True))
    for name, limit in given.items():
        if name not in NAMES:
            raise ValueError(f"`limits` must name some of {list(NAMES)}, got {name!r}")
        values[name] = array = np.array(convert_numbers(f"limits[{name!r}]", limit, f"({robot.n},)"), dtype=float)
        if array.shape != (robot.n,):
            raise ValueError(f"`limits[{name!r}]` must have shape ({robot.n},), got {array.shape}")
        if np.isnan(array).any():
            index = int(np.isnan(array).argmax())
            raise ValueError(f"`limits[{name!r}]` must not be NaN, got nan at index ({index},)")
    return values


def locked_positions(robot: Robot, locked: Locked | None, values: Mapping[str, Array]) -> dict[int, float]:
    """Coordinates that stay where they are with their positions, by default the middle of their ranges.

    Raises
    ------
    TypeError
        If `locked` is neither a mapping nor a list.
    ValueError
        If it names another joint, a position is not in the joint's range, or no joint is left.
    """
    if isinstance(locked, str) or not isinstance(locked, Iterable | None):
        raise TypeError(f"`locked` must be a list of joints or a mapping to positions, got {type(locked).__name__}")
    names, found = robot.joint_names, {}
    positions = locked if isinstance(locked, Mapping) else dict.fromkeys(locked or ())
    for joint, position in positions.items():
        k = names.index(joint) if joint in names else joint
        if not isinstance(k, int | np.integer) or isinstance(k, bool) or not -robot.n <= k < robot.n:
            raise ValueError(f"`locked` must have joints of {list(names)} or their indices, got {joint!r}")
        low, high = (float(values[end][k]) for end in NAMES[:2])
        if position is None and not np.isfinite([low, high]).all():
            raise ValueError(f"`locked`: joint {names[k]!r} has no finite range; give its position")
        found[range(robot.n)[k]] = at = (low + high) / 2 if position is None else position
        if not low <= float(real_array(f"locked[{joint!r}]", at, "()")) <= high:
            raise ValueError(f"`locked[{joint!r}]` must be in the joint's range, {low:g} to {high:g}, got {at:g}")
    if len(found) == robot.n:
        raise ValueError("`locked` must leave a joint that moves, got all of them")
    return found


@dataclass(frozen=True, eq=False)
class MotionLimits:
    """The limits of one robot, and its series x: coefficients over the rate limits, zero in mid-range.

    Attributes
    ----------
    robot : Robot
    basis : FourierBasis
    rest : bool
        True for series that start with zero rates and accelerations.
    lower, upper, velocity_limit, acceleration_limit, effort_limit : ndarray, shape (n,)
        Accelerations and torques may be unlimited.

    Raises
    ------
    ValueError
        If a range is empty, a limit negative, or a joint has no range or rate limit.
    """

    robot: Robot
    basis: FourierBasis
    rest: bool
    lower: Array
    upper: Array
    velocity_limit: Array
    acceleration_limit: Array
    effort_limit: Array

    def __post_init__(self) -> None:
        for k, joint in enumerate(self.robot.joint_names):
            low, high, *others = (float(getattr(self, name)[k]) for name in NAMES)
            if not np.isfinite([low, high]).all():
                raise ValueError(f"joint {joint!r} has no finite range; give `limits` with 'lower' and 'upper'")
            if not np.isfinite(others[0]):
                raise ValueError(f"joint {joint!r} has no finite rate limit; give `limits` with 'velocity_limit'")
            if not low < high:
                raise ValueError(f"`limits`: the range of joint {joint!r} is empty, from {low:g} to {high:g}")
            for name, limit in zip(NAMES[2:], others, strict=True):
                if not limit > 0:
                    raise ValueError(f"`limits`: {name} of joint {joint!r} must be positive, got {limit:g}")

    @property
    def centre(self) -> Array:
        """The middle of the ranges."""
        return (self.lower + self.upper) / 2

    @property
    def half_range(self) -> Array:
        """Half the width of the ranges."""
        return (self.upper - self.lower) / 2

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
        found: Array = (x.reshape(*x.shape[:-1], self.robot.n, -1) * self.velocity_limit[:, None]) @ self.free.T
        found[..., 0] += self.centre
        return found

    def gradient(self, by_coefficients: Array) -> Array:
        """Derivatives by x from those by the coefficients, shape (..., n, 2 H + 1)."""
        rates = (by_coefficients @ self.free) * self.velocity_limit[:, None]
        return rates.reshape(*rates.shape[:-2], -1)

    def states(self, x: Array, matrices: States) -> States:
        """q, qd and qdd, shape (..., T, n) each."""
        rows = np.swapaxes(self.coefficients(x), -1, -2)
        q, qd, qdd = (m @ rows for m in matrices)
        return q, qd, qdd

    def linear(self, count: int) -> dict[str, Array]:
        """Bounds A x of positions, rates and accelerations over their limits, shape (n, count, size of one joint).

        Values between the times of the grid are included: |A x| <= 1 on the grid keeps the limit at all times.
        """
        matrices = (m @ self.free / self.basis.grid_share(count) for m in self.basis.grid(count))
        limits = {"position": self.half_range, "rate": self.velocity_limit, "acceleration": self.acceleration_limit}
        shares = (self.velocity_limit / limit for limit in limits.values())
        return {kind: m * v[:, None, None] for kind, m, v in zip(limits, matrices, shares, strict=True)}

    @cached_property
    def rows(self) -> Array:
        """A of the optimiser's inequalities A x <= 1."""
        n, m = self.robot.n, self.free.shape[1]
        blocks = []
        for A in self.linear(GRID * self.basis.harmonics).values():
            for j in np.flatnonzero(A.any((1, 2))):  # no rows of unlimited accelerations
                block = np.zeros((A.shape[1], n, m))
                block[:, j] = A[j]
                blocks.append(block.reshape(-1, n * m))
        one_side = np.concatenate(blocks)
        return np.concatenate([one_side, -one_side])

    @cached_property
    def driven(self) -> Array:
        """Joints with limited torques."""
        return np.flatnonzero(np.isfinite(self.effort_limit))

    @cached_property
    def _friction(self) -> tuple[Array, Array]:
        """Viscous and Coulomb friction that the model has, per coordinate."""
        known = StandardParameters(self.robot.model, DriveModel(friction="viscous+coulomb"))
        return known.values[known.groups["Fv"]], known.values[known.groups["Fc"]]

    def torques(self, states: States) -> Array:
        """Torques of the drives over their limits, with the model's viscous friction."""
        viscous, _ = self._friction
        shares: Array = (self.robot.inverse_dynamics(*states) + viscous * states[1]) / self.effort_limit
        return shares

    @property
    def coulomb(self) -> Array:
        """Coulomb friction over the torques' limits: always counted against the drive."""
        return self._friction[1] / self.effort_limit

    def torque_use(self, x: Array) -> Array:
        """The largest share of the efforts that series use, shape (..., n).

        Between samples of the fine grid what a parabola through three of them says.
        """
        if not len(self.driven):
            return np.zeros((*x.shape[:-1], self.robot.n))
        tau = self.torques(self.states(x, self._fine[1]))
        bend = np.abs(np.roll(tau, 1, -2) - 2 * tau + np.roll(tau, -1, -2)).max(-2) / 8
        use: Array = np.abs(tau).max(-2) + self.coulomb + bend
        return use

    def torque_slack(self, x: Array, matrices: States) -> Array:
        """What the optimiser keeps positive, of each joint with a limit, at each time, of either sign of the torque."""
        limit, tau = 1 - TORQUE_MARGIN - self.coulomb, self.torques(self.states(x, matrices))
        return np.concatenate([(limit + sign * tau)[:, self.driven].ravel() for sign in (-1, 1)])

    def torque_slack_slopes(self, x: Array, matrices: States) -> Array:
        """Its derivatives by x, exact."""
        dq, dqd, M = self.robot.inverse_dynamics_derivatives(*self.states(x, matrices))
        by_states = zip((dq, dqd + np.diag(self._friction[0]), M), matrices, strict=True)
        by_coefficients = sum(d[:, self.driven, :, None] * m[:, None, None, :] for d, m in by_states)
        slopes = self.gradient(np.asarray(by_coefficients)) / self.effort_limit[self.driven, None]
        slopes = slopes.reshape(-1, self.size)
        return np.concatenate([-slopes, slopes])

    @cached_property
    def _fine(self) -> tuple[dict[str, Array], States]:
        count = FINE * self.basis.harmonics
        return self.linear(count), self.basis.grid(count)

    def linear_use(self, x: Array) -> dict[str, Array]:
        """The largest share of the limits of positions, rates and accelerations at all times, at most."""
        parts = x.reshape(*x.shape[:-1], self.robot.n, -1)
        return {kind: np.abs(np.einsum("jti,...ji->...jt", A, parts)).max(-1) for kind, A in self._fine[0].items()}

    def use(self, x: Array) -> dict[str, Array]:
        """The largest share of each limit that series use, at most, shape (..., n) each; see `torque_use`."""
        return self.linear_use(x) | {"torque": self.torque_use(x)}

    def holds(self, x: Array) -> bool:
        """True if a series keeps its limits: positions, rates and accelerations at all times."""
        return all(bool((share <= 1).all()) for share in self.use(x).values())
