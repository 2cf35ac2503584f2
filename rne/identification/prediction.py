"""Uncertainty of predicted torques: the parameters' covariance through the regressor, and validation residuals.

The variance of a torque is y C y^T + s^2, with the torque's row y of the regressor of the base parameters, their
covariance C, and the variance s^2 of what no parameters explain, by joint: Draper and Smith 1998, section 1.4 and 5.5.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..basics.arrays import ReadOnlyArrays, whole_number
from ..basics.inertia import PARAMETERS, pseudo_inertia
from ..basics.spatial import Array
from ..basics.text import listed, short
from ..dynamics.base_inertial_parameters import BaseParameters
from ..elementwise import less, maximum, where
from ..errors import IdentificationError
from . import thresholds
from .fit.consistent import TRACE, scaling
from .fit.equations import Equations, RegressionData, blocks_of_time, solve
from .fit.least_squares import LeastSquares
from .log.prepared import Prepared, rows_without


@dataclass(frozen=True, eq=False)
class Bands(ReadOnlyArrays):
    """Standard deviations of torques predicted by base parameters, and their coverage of validation blocks."""

    base: BaseParameters
    root: Array  # L of the parameters' covariance L L^T, shape (count, r)
    unknown: Array  # directions of the parameters that no measured torque depends on, shape (count, u)
    known: Array  # rows of functions of the parameters that the log determines, shape (count - u, count)
    lengths: Array  # of the columns of the weighted equations, shape (count,)
    in_motion: Array  # standard deviation of the residuals, shape (n,) [N m or N]
    at_rest: Array  # likewise of slow joints, without the next two
    friction: Array  # with which slow joints break away, of any sign; zero where at_rest contains it, (n,) [N m or N]
    of_load: Array  # likewise, per size of the load of friction that is proportional to it, shape (n,)
    minimum_velocity: Array  # of joints in motion, shape (n,) [rad/s or m/s]
    covered: Array  # coverage of validation residuals in motion: the band of parameters and noise alone, or NaN, (n,)
    largest: Array  # that 95 % of these are within, in motion and at rest, likewise [N m or N]

    def std(self, Y: Array, speed: Array, load: Array | None = None) -> Array:
        """Standard deviations of torques with columns (..., n, P) per unit of the standard parameters, (..., n).

        Joints are in motion by their speed (..., n); their load has the same shape, if friction depends on it.
        """
        y = Y[..., list(self.base.independent)]
        residual = np.where(speed > self.minimum_velocity, self.in_motion, np.sqrt(self._squares_at_rest(load)))
        own, size = np.linalg.norm(y @ self.unknown, axis=-1), np.linalg.norm(y / self.lengths, axis=-1)
        total = np.hypot(np.linalg.norm(y @ self.root, axis=-1), residual)
        return np.where(own > thresholds.UNDETERMINED * size, np.inf, total)

    def _squares_at_rest(self, load: Array | None) -> Array:
        """Squared deviations of slow joints, whose friction is undetermined up to a torque."""
        friction = self.friction if load is None else self.friction + self.of_load * maximum(load, -load)
        return np.asarray(self.at_rest**2 + friction * friction)

    def written(self, columns: Array, qd: Array, load: Array | None = None) -> Array:
        """Standard deviations of one state, all finite, in operations that can be traced, shape (n,)."""
        is_moving = less(self.minimum_velocity, maximum(qd, -qd))
        residual = where(is_moving, self.in_motion**2, self._squares_at_rest(load))
        y = columns[..., list(self.base.independent)] @ self.root
        return np.asarray(np.sqrt((y * y).sum(-1) + residual))

    def text(self, names: Any, units: Any) -> str:
        """Sentences on the deviations of another motion's torques from predicted ones."""
        each = zip(names, units, self.largest, strict=True)
        told = [f"+- {x:.2g} {unit} ({short(name)})" for name, unit, x in each if np.isfinite(x)]
        if not told:
            return "the error of predictions for another motion is unknown: no block of the log was left out of a fit"
        lines = [f"95 % of torques of another motion like these are within {listed(told)} of those predicted"]
        share = zip(names, self.covered, strict=True)
        poor = [f"{short(name)} {100 * x:.0f} %" for name, x in share if x < thresholds.COVERED]
        if poor:
            lines.append(
                "The model, not the noise, is at fault where less than 90 % of the validation torques are within the "
                f"95 % band of parameters and noise, as with friction beyond the model: {listed(poor)}"
            )
        return ". ".join(lines)


def bands_of(
    base: BaseParameters, data: RegressionData, estimate: LeastSquares, correlation_time: Array, friction: ArrayLike
) -> Bands:
    """Bands of a fit to these equations, with the largest friction of a joint at rest, and more per load, (2, n).

    At rest the standard deviation of the residuals is that of the rests in the log or, where there are hardly any,
    contains this friction.
    """
    equations, sigma = data.fitted.mapped(base.back), estimate.sigma
    A, y = equations.weighted(sigma), data.Y[..., list(base.independent)]
    unit, lengths = solve(A).unit, np.linalg.norm(A[:, :-1], axis=0)
    lengths = np.where(unit.any(0), lengths, 1.0)
    _, S, V = np.linalg.svd(unit)
    is_free = thresholds.DEPENDENT * S.max(initial=0) >= S
    directions = V[is_free].T / lengths[:, None], V[~is_free] * lengths
    residuals, spread = held_out_residuals(data, equations, y, estimate)
    spread *= np.sqrt(correlation_time)
    used, rest = data.used, [rows_without(r, np.abs(r.qd) > data.minimum_velocity) for r in data.prepared]
    rest = data.valid & ~used & np.concatenate(rest)  # not where a joint turns back
    in_motion = np.sqrt(np.maximum(mean_square(residuals, used) - mean_square(spread, used), sigma**2))
    in_motion = np.where(used.any(0), in_motion, np.inf)
    is_known = rest.sum(0) > thresholds.FEWEST_FREE * data.correlation_time(residuals, rest)
    is_smooth = data.minimum_velocity == 0  # friction, or there is none
    at_rest = np.where(is_known & ~is_smooth, np.sqrt(mean_square(residuals, rest)), in_motion)
    breakaway, of_load = np.where(is_known | is_smooth, 0.0, friction)
    within = np.abs(residuals) <= thresholds.BAND * np.hypot(spread, sigma)
    covered, largest = np.full((2, len(sigma)), np.nan)
    for j in np.flatnonzero(used.any(0)):
        covered[j] = within[used[:, j], j].mean()
        largest[j] = np.quantile(np.abs(residuals[data.valid[:, j], j]), thresholds.WITHIN)
    own = in_motion, at_rest, breakaway, of_load, data.minimum_velocity
    return Bands(base, square_root(estimate.covariance), *directions, lengths, *own, covered, largest)


def held_out_residuals(
    data: RegressionData, equations: Equations, y: Array, estimate: LeastSquares
) -> tuple[Array, Array]:
    """Validation residuals of each block, and deviations of independent rows by the parameters fitted without it.

    Blocks in which the joints go the same way, as in another period, are left out too, unless these are most of all or
    the others do not determine the parameters. Both have shape (rows, n).
    """
    blocks = blocks_of_time(data.prepared, len(equations.factors) // len(data.prepared))
    again = repeated(data.prepared, blocks)
    residuals, spread = np.zeros((2, *data.tau.shape))
    for k, block in enumerate(blocks):
        others = np.arange(len(blocks)) != k
        for chosen in (others & ~again[k], others):
            solution = solve(equations.of_blocks(chosen).weighted(estimate.sigma))
            if 2 * chosen.sum() >= len(blocks) and not (solution.free & np.isfinite(estimate.errors)).any():
                break
        residuals[block] = data.tau[block] - y[block] @ solution.x
        spread[block] = np.linalg.norm(y[block] @ solution.inverse, axis=-1)
    return residuals, spread


def repeated(records: Sequence[Prepared], blocks: Sequence[slice]) -> Array:
    """True for pairs of blocks that partly have nearly the same positions and velocities, (blocks, blocks)."""
    from scipy.spatial import KDTree

    found = np.zeros((len(blocks), len(blocks)), bool)
    ranges = np.max([np.ptp(record.q, axis=0) for record in records], axis=0)
    moved = ranges > thresholds.RESTS  # others differ by noise
    if not moved.any():
        return found
    states = np.concatenate([np.concatenate([r.q[:, moved], r.qd[:, moved]], axis=1)[r.row_samples] for r in records])
    size = states.std(0)
    states /= np.where(size > 0, size, 1.0) * np.sqrt(states.shape[1])
    for k, block in enumerate(blocks):
        distances = KDTree(states[block]).query(states)[0]
        found[:, k] = [np.quantile(distances[b], thresholds.REPEATED_PART) < thresholds.REPEATED for b in blocks]
    return found | found.T


def mean_square(x: Array, rows: Array) -> Array:
    """Mean squares over the rows of each joint, zero without any, shape (n,)."""
    return np.asarray((x**2 * rows).sum(0) / np.maximum(rows.sum(0), 1))


def square_root(covariance: Array) -> Array:
    """L with L L^T = covariance, which may be singular; lower triangular."""
    size = np.sqrt(np.diag(covariance))
    size = np.where(size == 0, 1.0, size)
    values, axes = np.linalg.eigh(covariance / np.outer(size, size))
    return np.asarray(np.linalg.qr((size[:, None] * axes * np.sqrt(np.maximum(values, 0))).T, mode="r")).T


def possible_draws(pi: Array, scale: Array, bodies: slice, known: Array, root: Array, count: int, seed: int) -> Array:
    """Random parameters of physically consistent bodies, distributed as the estimate, shape (count, P).

    Before the measurements, parameters are pi + scale z with z ~ N(0, 1); these give the functions `known` of them, of
    shape (r, P), with errors root e, e ~ N(0, 1). Draws are of the posterior of this linear model. What the
    measurements do not determine, on which torques do not depend, is shortened until the bodies are possible.
    """
    whole_number("count", count, least=1)
    rng, A, found, tried = np.random.default_rng(seed), known @ scale, np.zeros((0, len(pi))), 0
    gain = np.linalg.solve(A @ A.T + root @ root.T, A).T
    determined = np.linalg.pinv(A, rcond=thresholds.DEPENDENT) @ A
    while len(found) < count and tried < thresholds.DRAWS_TRIED * count:
        z, e = rng.normal(size=(count, scale.shape[1])), rng.normal(size=(count, root.shape[1]))
        z += (e @ root.T - z @ A.T) @ gain.T
        own, possible, x = z @ determined.T, np.zeros(count, bool), np.zeros((count, len(pi)))
        for part in np.linspace(1, 0, thresholds.SHORTENED):
            x[~possible] = pi + (own + part * (z - own))[~possible] @ scale.T
            least = np.linalg.eigvalsh(pseudo_inertia(x[:, bodies]))[..., 0]
            possible = least.min(1, initial=np.inf) > 0
        found, tried = np.concatenate([found, x[possible]]), tried + count
    if len(found) < count:
        share = f"only {100 * len(found) / tried:.2g} % of the trials give possible bodies"
        raise IdentificationError(f"{share}: excite the motion more, or fit with a smaller `prior_std`")
    return found[:count]


def prior_scale(bodies: Array, std: float, drives: Array, cure: str) -> Array:
    """Standard deviations, as columns, of bodies' parameters (10 nb,) under the prior, and of drives."""
    if np.linalg.eigvalsh(pseudo_inertia(bodies)).min(initial=np.inf) <= 0:
        raise IdentificationError(f"the bodies found are no possible ones: {cure}")
    of_bodies = np.tile(std * np.where(TRACE, 1.0, np.sqrt(0.5)), len(bodies) // PARAMETERS)
    return scaling(pseudo_inertia(bodies), drives) * np.append(of_bodies, np.ones(len(drives)))
