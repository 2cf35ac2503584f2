"""How sure a predicted torque is: the parameters' covariance through the regressor, and residuals that were held out.

The variance of a torque is y C y^T + s^2, with the torque's row y of the regressor of the base parameters, their
covariance C, and the variance s^2 of what no parameters explain, by joint: Draper and Smith 1998, section 1.4 and 5.5.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from ..basics.arrays import ReadOnlyArrays
from ..basics.spatial import Array
from ..basics.text import listed, short
from ..dynamics.base_inertial_parameters import BaseParameters
from . import thresholds
from .fit.equations import RegressionData, blocks_of_time, solve
from .fit.least_squares import LeastSquares
from .log.prepared import rows_without


@dataclass(frozen=True, eq=False)
class Bands(ReadOnlyArrays):
    """Standard deviations of torques predicted by base parameters, and residuals of the blocks that were held out."""

    base: BaseParameters
    root: Array  # L of the parameters' covariance L L^T, shape (count, r)
    unknown: Array  # directions of the parameters that no measured torque depends on, shape (count, u)
    lengths: Array  # of the columns of the weighted equations, shape (count,)
    in_motion: Array  # standard deviation of the residuals, shape (n,) [N m or N]
    at_rest: Array  # likewise of slow joints, whose friction has any value up to Coulomb's
    minimum_velocity: Array  # of joints in motion, shape (n,) [rad/s or m/s]
    residuals: Array  # measured less predicted torques of each block by a fit to the others, shape (rows, n) [N m or N]
    covered: Array  # share of these in motion within the band of parameters and noise alone, NaN without any, (n,)
    largest: Array  # that 95 % of these are within, in motion and at rest, likewise [N m or N]

    def is_moving(self, speed: Array) -> Array:
        """True where joints of these speeds are in motion."""
        return np.asarray((speed > self.minimum_velocity) | (self.minimum_velocity == 0))

    def std(self, Y: Array, is_moving: Array) -> Array:
        """Standard deviations of torques with columns (..., n, P) per unit of the standard parameters, (..., n)."""
        y = Y[..., list(self.base.independent)]
        residual = np.where(is_moving, self.in_motion, self.at_rest)
        own, size = np.linalg.norm(y @ self.unknown, axis=-1), np.linalg.norm(y / self.lengths, axis=-1)
        total = np.hypot(np.linalg.norm(y @ self.root, axis=-1), residual)
        return np.where(own > thresholds.UNDETERMINED * size, np.inf, total)

    def text(self, names: Any, units: Any) -> str:
        """How far torques of another motion are from those predicted, in a sentence or two."""
        told = [
            f"+- {x:.2g} {unit} ({short(name)})"
            for name, unit, x in zip(names, units, self.largest, strict=True)
            if np.isfinite(x)
        ]
        if not told:
            return "how far torques of another motion are from those predicted is not known: none was held out"
        lines = [f"95 % of torques of another motion like these are within {listed(told)} of those predicted"]
        share = zip(names, self.covered, strict=True)
        poor = [f"{short(name)} {100 * x:.0f} %" for name, x in share if x < thresholds.COVERED]
        if poor:
            lines.append(
                "the model, not the noise, is at fault, as where friction is beyond it, of joints of whose torques "
                f"held out less than 90 % are within the 95 % band of noise and parameters: {listed(poor)}"
            )
        return ". ".join(lines)


def bands_of(base: BaseParameters, data: RegressionData, estimate: LeastSquares, folds: Array, coulomb: Array) -> Bands:
    """The bands of a fit to these equations, with the standard parameters (folds, P) of fits without each block.

    At rest the residuals' deviation is that of joints that rest for a while in the log or, where hardly any does,
    contains Coulomb friction.
    """
    blocks = blocks_of_time(data.prepared, len(data.fitted.factors) // len(data.prepared))
    residuals = np.concatenate([data.tau[b] - data.Y[b] @ x for b, x in zip(blocks, folds, strict=True)])
    A = data.fitted.mapped(base.back).merged().weighted(estimate.sigma)
    unit, lengths = solve(A).unit, np.linalg.norm(A[:, :-1], axis=0)
    lengths = np.where(unit.any(0), lengths, 1.0)
    _, S, V = np.linalg.svd(unit)
    unknown = V[thresholds.DEPENDENT * S.max(initial=0) >= S].T / lengths[:, None]
    root, used = square_root(estimate.covariance), data.used
    rest = [rows_without(record, np.abs(record.qd) > data.minimum_velocity) for record in data.prepared]
    rest = data.valid & ~used & np.concatenate(rest)  # not where a joint turns back
    spread = np.linalg.norm(data.Y[..., list(base.independent)] @ root, axis=-1)
    squares = mean_square(residuals, used) - mean_square(spread, used)
    in_motion = np.where(used.any(0), np.sqrt(np.maximum(squares, estimate.sigma**2)), np.inf)
    times = data.correlation_time(residuals, rest)
    is_known = rest.sum(0) > thresholds.FEWEST_FREE * times
    at_rest = np.where(is_known, np.sqrt(mean_square(residuals, rest)), np.hypot(in_motion, coulomb))
    within = np.abs(residuals) <= thresholds.BAND * np.hypot(spread, estimate.sigma)
    covered, largest = np.full((2, len(coulomb)), np.nan)
    for j in np.flatnonzero(used.any(0)):
        covered[j] = within[used[:, j], j].mean()
        largest[j] = np.quantile(np.abs(residuals[data.valid[:, j], j]), thresholds.WITHIN)
    of_joints = in_motion, at_rest, data.minimum_velocity
    return Bands(base, root, unknown, lengths, *of_joints, residuals, covered, largest)


def mean_square(x: Array, rows: Array) -> Array:
    """Mean squares over the rows of each joint, zero without any, shape (n,)."""
    return np.asarray((x**2 * rows).sum(0) / np.maximum(rows.sum(0), 1))


def square_root(covariance: Array) -> Array:
    """L with L L^T = covariance, which may be singular."""
    size = np.sqrt(np.diag(covariance))
    size = np.where(size == 0, 1.0, size)
    values, axes = np.linalg.eigh(covariance / np.outer(size, size))
    return np.asarray(size[:, None] * axes * np.sqrt(np.maximum(values, 0)))
