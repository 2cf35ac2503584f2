"""Fourier series of joint positions, and limits of motions as inequalities in their coefficients."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ...basics.arrays import real_array
from ...basics.spatial import Array
from ...model.modify import limit_array
from ...model.standard_parameters import DriveModel, StandardParameters
from ...robot import Robot
from .. import thresholds

NAMES = ("lower", "upper", "velocity_limit", "acceleration_limit", "effort_limit")

Locked = Mapping[Any, float] | Iterable[Any]  # joints by name or index, with their positions or without
States = tuple[Array, Array, Array]  # q, qd and qdd, or the matrices that give them


@dataclass(frozen=True)
class FourierBasis:
    """q(t) = q0 + sum over k of a_k / (k w) sin(k w t) - b_k / (k w) cos(k w t), with w = 2 pi / duration.

    Swevers et al. 1997, (4). A coefficient vector is (q0, a_1 ... a_H, b_1 ... b_H): 2 H + 1 numbers per joint.
    """

    duration: float  # the period [s]
    harmonics: int  # the number H of them

    @property
    def frequencies(self) -> Array:
        """Angular frequencies k w of the harmonics, shape (H,) [rad/s]."""
        return 2 * np.pi / self.duration * np.arange(1, self.harmonics + 1)

    def states(self, t: Array, coefficients: Array) -> States:
        """q, qd and qdd of n series, coefficients of shape (n, 2 H + 1), at times of shape (..., 1)."""
        w = self.frequencies
        q0, a, b = coefficients[:, 0], coefficients[:, 1 : self.harmonics + 1], coefficients[:, self.harmonics + 1 :]
        s, c = np.sin(t * w), np.cos(t * w)
        return q0 + s @ (a / w).T - c @ (b / w).T, c @ a.T + s @ b.T, c @ (b * w).T - s @ (a * w).T

    def grid(self, count: int) -> States:
        """Matrices, shape (count, 2 H + 1), from coefficients to q, qd and qdd at equal intervals of one period."""
        t = np.arange(count) * (self.duration / count)
        return self.states(t[:, None], np.eye(2 * self.harmonics + 1))

    def grid_share(self, count: int) -> float:
        """Smallest ratio of a series' maximum on a grid to its maximum over all times.

        cos(pi H / count): next to a maximum a trigonometric polynomial of degree H falls no faster than the cosine of
        its highest harmonic (Bernstein and Szego; Ehlich and Zeller 1964).
        """
        return float(np.cos(np.pi * self.harmonics / count))


def motion_limits(robot: Robot, given: Mapping[str, ArrayLike] | None) -> dict[str, Array]:
    """Limits of the robot, including mimic joints, replaced by those given; shape (n,) each."""
    if given is None:
        given = {}
    if not isinstance(given, Mapping):
        raise TypeError(f"`limits` must be a mapping of names to arrays, got {type(given).__name__}")
    known = robot.model.coordinate_limits()
    known["acceleration_limit"] = np.minimum(known["acceleration_limit"], known["deceleration_limit"])
    values = {name: known[name] for name in NAMES}
    for name, limit in given.items():
        if name not in NAMES:
            raise ValueError(f"`limits` must name some of {list(NAMES)}, got {name!r}")
        values[name] = limit_array(name, limit, robot.joint_names, values[name], f"limits[{name!r}]")
    return values


def locked_positions(robot: Robot, locked: Locked | None, values: Mapping[str, Array]) -> dict[int, float]:
    """Coordinates that are locked with their positions, by default the middle of their ranges."""
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
    """Limits of one robot for series x: coefficients over the velocity limits, zero in mid-range."""

    robot: Robot
    basis: FourierBasis
    rest: bool  # series start with zero velocities and accelerations
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
                raise ValueError(f"joint {joint!r} has no finite velocity limit; give `limits` with 'velocity_limit'")
            if not low < high:
                raise ValueError(f"`limits`: the range of joint {joint!r} is empty, from {low:g} to {high:g}")
            for name, limit in zip(NAMES[2:], others, strict=True):
                if not limit > 0:
                    raise ValueError(f"`limits`: {name} of joint {joint!r} must be positive, got {limit:g}")

    @property
    def centre(self) -> Array:
        """Middle of the ranges."""
        return (self.lower + self.upper) / 2

    @cached_property
    def free(self) -> Array:
        """Orthonormal basis of one joint's coefficients, as columns: with `rest` qd(0) = qdd(0) = 0."""
        from scipy.linalg import null_space

        _, qd, qdd = self.basis.grid(1)
        at_rest = np.vstack([qd, qdd / self.basis.frequencies[-1]])
        return np.asarray(null_space(at_rest) if self.rest else np.eye(at_rest.shape[1]))

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
        """Derivatives with respect to x from those with respect to the coefficients, shape (..., n, 2 H + 1)."""
        slopes = (by_coefficients @ self.free) * self.velocity_limit[:, None]
        return slopes.reshape(*slopes.shape[:-2], -1)

    def states(self, x: Array, matrices: States) -> States:
        """q, qd and qdd, shape (..., T, n) each."""
        rows = np.swapaxes(self.coefficients(x), -1, -2)
        q, qd, qdd = (m @ rows for m in matrices)
        return q, qd, qdd

    def linear(self, count: int) -> dict[str, Array]:
        """Matrix A, (n, count, size of one joint): |A x| <= 1 on the grid keeps the limits at all times."""
        matrices = (m @ self.free / self.basis.grid_share(count) for m in self.basis.grid(count))
        limits = self.upper - self.centre, self.velocity_limit, self.acceleration_limit
        kinds = zip(("position", "velocity", "acceleration"), matrices, limits, strict=True)
        return {kind: m * (self.velocity_limit / limit)[:, None, None] for kind, m, limit in kinds}

    @cached_property
    def rows(self) -> Array:
        """Matrix A of the optimiser's inequalities A x <= 1."""
        n, m = self.robot.n, self.free.shape[1]
        blocks = []
        for A in self.linear(thresholds.GRID * self.basis.harmonics).values():
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
        """Viscous and Coulomb friction of the model, per coordinate."""
        known = StandardParameters(self.robot.model, DriveModel(friction="viscous+coulomb"))
        return known.values[known.groups["Fv"]], known.values[known.groups["Fc"]]

    def torques(self, states: States) -> Array:
        """Torques of the drives over their limits, with the model's viscous friction."""
        viscous, _ = self._friction
        return np.asarray((self.robot.inverse_dynamics(*states) + viscous * states[1]) / self.effort_limit)

    @property
    def coulomb(self) -> Array:
        """Coulomb friction over the torques' limits, taken as a load of the drive."""
        return self._friction[1] / self.effort_limit

    def torque_use(self, x: Array) -> Array:
        """Largest share of the torque limits used by series, shape (..., n), with parabolas between samples."""
        if not len(self.driven):
            return np.zeros((*x.shape[:-1], self.robot.n))
        tau = self.torques(self.states(x, self._fine[1]))
        bend = np.abs(np.roll(tau, 1, -2) - 2 * tau + np.roll(tau, -1, -2)).max(-2) / 8
        return np.asarray(np.abs(tau).max(-2) + self.coulomb + bend)

    def torque_slack(self, x: Array, matrices: States) -> Array:
        """Distances of torques from their limits, to be kept positive: by sign, time and joint."""
        limit, tau = 1 - thresholds.TORQUE_MARGIN - self.coulomb, self.torques(self.states(x, matrices))
        return np.concatenate([(limit + sign * tau)[:, self.driven].ravel() for sign in (-1, 1)])

    def torque_slack_slopes(self, x: Array, matrices: States) -> Array:
        """Exact derivatives of `torque_slack` with respect to x."""
        dq, dqd, M = self.robot.inverse_dynamics_derivatives(*self.states(x, matrices))
        by_states = zip((dq, dqd + np.diag(self._friction[0]), M), matrices, strict=True)
        by_coefficients = sum(d[:, self.driven, :, None] * m[:, None, None, :] for d, m in by_states)
        slopes = self.gradient(np.asarray(by_coefficients)) / self.effort_limit[self.driven, None]
        slopes = slopes.reshape(-1, self.size)
        return np.concatenate([-slopes, slopes])

    @cached_property
    def _fine(self) -> tuple[dict[str, Array], States]:
        count = thresholds.FINE * self.basis.harmonics
        return self.linear(count), self.basis.grid(count)

    def linear_use(self, x: Array) -> dict[str, Array]:
        """Upper bound of the share of position, velocity and acceleration limits used at any time."""
        parts = x.reshape(*x.shape[:-1], self.robot.n, -1)
        return {kind: np.abs(np.einsum("jti,...ji->...jt", A, parts)).max(-1) for kind, A in self._fine[0].items()}

    def use(self, x: Array) -> dict[str, Array]:
        """Upper bound of the share of each limit used by series, shape (..., n) each; see `torque_use`."""
        return self.linear_use(x) | {"torque": self.torque_use(x)}

    def holds(self, x: Array) -> bool:
        """True if a series keeps its limits of positions, velocities and accelerations at all times."""
        return all(bool((share <= 1).all()) for share in self.use(x).values())
