"""Impulses of the joints' momentum between samples, and error bounds of the rules that integrate them.

They take numbers and traced numbers, of one interval or of many: observers along samples and observers in control laws
are the same equations.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import reduce
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ..basics.spatial import Array
from ..dynamics.energy import lagrangian_derivatives
from ..elementwise import less, maximum, where
from ..model.friction_laws import magnitude
from ..robot import Robot
from .laws import under_load

IMPULSE_ERROR = 1e-10  # error of momenta and impulses relative to them, above rounding and a solver's errors

Bodies = Sequence[tuple[Robot, Array | None]]  # robots, and inertial parameters instead of their own


class Sample(NamedTuple):
    """Positions and velocities, (..., n), and M qd and C^T qd - g of some robots there, (..., robots, n)."""

    q: Array
    qd: Array
    momentum: Array
    force: Array

    def rows(self, which: slice) -> Sample:
        """Slice of the samples."""
        return Sample(*(x[which] for x in self))


class Between(NamedTuple):
    """Change between two samples: changes of momenta that forces of the models do not explain."""

    momentum: Array  # (..., robots, n)
    error: Array  # bounds of the momenta's errors, (..., n): the largest of all robots
    rates: tuple[Array, Array, Array]  # velocities at both ends and halfway between them, (..., n)


class FrictionModel(NamedTuple):
    """The friction of a robot, and the share by which it may be larger or smaller."""

    friction: Any
    robot: Robot
    error: float

    def torque(self, qd: Array, tau: Array) -> Array:
        """Torques of friction, under load of the drives' torques."""
        f = self.friction
        if f is None:
            return 0.0 * qd
        if not under_load(f):
            return np.asarray(f.torque(self.robot.model, qd))
        return np.asarray(tau - f.transmitted(tau - f.torque(self.robot.model, qd, np.zeros(qd.shape)), qd))

    def held(self, rates: tuple[Array, Array, Array], tau: Array, step: float) -> tuple[Array, Array]:
        """Impulses of held torques minus the impulses of friction, and bounds of their errors."""
        first, last, halfway = (self.torque(qd, tau) for qd in rates)
        slowed, bound = simpson(first, halfway, last, step)
        if self.error:
            size, of_size = simpson(np.abs(first), np.abs(halfway), np.abs(last), step)
            bound = bound + self.error * (size + of_size)
        return tau * step - slowed, bound + self.sticking(rates[0], rates[1], step)

    def sticking(self, first: Array, last: Array, step: float) -> Array | float:
        """Bounds of impulses of dry friction between velocities of which some are zero."""
        f = self.friction
        if not getattr(f, "sticks", False):
            return 0.0
        slipping = np.maximum(f.coulomb, f.coulomb_back) + np.maximum(f.stribeck_rise, 0)
        most = slipping if f.static is None else f.static
        a, b = (where(less(0, magnitude(qd)), 0.0, 1.0) for qd in (first, last))  # 1 at rest
        return np.asarray(step * (1 + self.error) * most * (2 * (a + b) - 3 * a * b))  # once if both are, twice if one


def sampled(bodies: Bodies, q: Array, qd: Array) -> Sample:
    """The sample at positions and velocities."""
    both = np.stack(
        [robot.kernels.evaluate_quantity(lagrangian_derivatives, q, qd, parameters=pi) for robot, pi in bodies], axis=-2
    )
    n = both.shape[-1] // 2
    return Sample(q, qd, both[..., :n], both[..., n:])


def unexplained(bodies: Bodies, first: Sample, last: Sample, step: float) -> Between:
    """Unexplained changes between samples, by the cubic polynomials through positions and velocities of both."""
    moved, change = last.q - first.q, last.qd - first.qd
    rate = 1.5 * moved / step - (first.qd + last.qd) / 4
    middle = sampled(bodies, first.q + moved / 2 - change * (step / 8), rate)
    impulse, error = simpson(first.force, middle.force, last.force, step)
    sizes = [largest(x.momentum, -1) + step * largest(x.force, -1) for x in (first, last)]
    bound = largest(error + IMPULSE_ERROR * (sizes[0] + sizes[1]), -2)[..., 0, :]
    return Between(last.momentum - first.momentum - impulse, bound, (first.qd, last.qd, rate))


def simpson(first: Array, middle: Array, last: Array, step: float) -> tuple[Array, Array]:
    """Integrals by Simpson's rule, and their differences from those of the trapezoidal rule."""
    correction = (2 * middle - first - last) * (step / 3)
    return (first + last) * (step / 2) + correction, np.abs(correction)


def largest(x: Array, axis: int) -> Array:
    """The largest |x| along an axis, which is kept."""
    if not x.shape[axis]:  # of a robot without joints
        return np.asarray(x.sum(axis, keepdims=True))
    parts = np.split(np.abs(x), x.shape[axis], axis=axis)
    return reduce(maximum, parts)


def bilinear(gain: float, step: float) -> tuple[float, float]:
    """Coefficients (a, b) of the filter: r at a sample is a times r at the last one plus b times the impulse."""
    half = gain * step / 2
    return (1 - half) / (1 + half), gain / (1 + half)


def with_thresholds(filtered: Array, bound: Array, floor: ArrayLike) -> tuple[Array, Array]:
    """Residuals of the model, the first of robots (..., robots, n), and thresholds, by bounds (..., n)."""
    return filtered[..., 0, :], largest(filtered - filtered[..., :1, :], -2)[..., 0, :] + bound + floor
