"""Weighted least squares: each joint's equations are weighted by its own residual.

Gautier 1997; Siciliano et al. 2009, section 7.3. The noise of a joint is its residual over its degrees of freedom.
These depend on the fit, and the fit on the noise: it is repeated until neither changes.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from ...basics.arrays import ReadOnlyArrays
from ...basics.inertia import PARAMETERS
from ...basics.spatial import Array
from ...dynamics.base_inertial_parameters import BaseParameters
from .. import thresholds
from .consistent import consistent_fit
from .equations import Equations, RegressionData, solve, with_prior


@dataclass(frozen=True, eq=False)
class LeastSquares(ReadOnlyArrays):
    """Estimates with standard errors, such as by `rne.identify`.

    Attributes
    ----------
    values, errors : ndarray, shape (P,)
        Estimates and their standard errors; an error is infinite where the motion does not determine an unknown, and
        the estimate is then the one of smallest norm.
    covariance : ndarray, shape (P, P)
        Covariance of the estimates, of the part that the motion determines.
    sigma : ndarray, shape (n,)
        Standard deviation of each joint's residual [N m or N].
    condition : float
        Condition number of the weighted equations; infinite if unknowns depend on each other.
    scaled_condition : float
        Condition number of the equations with columns of unit length.
    """

    values: Array
    errors: Array
    covariance: Array
    sigma: Array
    condition: float
    scaled_condition: float

    def with_covariance(self, covariance: Array) -> LeastSquares:
        """Estimates with another covariance; infinite errors stay infinite."""
        errors = np.where(np.isinf(self.errors), np.inf, np.sqrt(np.diag(covariance)))
        return replace(self, covariance=covariance, errors=errors)


def weighted_fit(equations: Equations, sigma: Array) -> tuple[Array, Array]:
    """Solution of equations weighted by the joints' noise, and the number of unknowns that each joint determines."""
    solution = solve(equations.weighted(sigma))
    return solution.x, solution.spent(equations, sigma)


def least_squares(equations: Equations, noise: Array | None = None) -> LeastSquares:
    """Estimates of all unknowns from the equations of all blocks and joints; noise by residuals unless given."""
    equations = equations.merged()
    size = equations.rms_torques()
    least = np.maximum(thresholds.EXACT * np.maximum(size, size.max(initial=0) * thresholds.EXACT), thresholds.SILENT)
    sigma = np.maximum(size if noise is None else noise, least)
    for _ in range(thresholds.WEIGHTINGS if noise is None else 0):
        x, spent = weighted_fit(equations, sigma)
        freedom = equations.rows.sum(0) - spent
        found = np.sqrt(equations.residuals(x) / np.maximum(freedom, 1))
        found = np.maximum(np.where(freedom < thresholds.FEWEST_FREE, size, found), least)  # few leave no residual
        settled = np.abs(found / sigma - 1).max(initial=0) <= thresholds.NOISE_SETTLED
        sigma = found
        if settled:
            break
    factor = equations.weighted(sigma)
    solution = solve(factor)
    covariance = solution.inverse @ solution.inverse.T
    errors = np.where(solution.free, np.inf, np.sqrt(np.diag(covariance)))
    singular = np.linalg.svd(factor[:, :-1], compute_uv=False)
    conditions = [
        float(s[0] / s[-1]) if len(s) and s[-1] > thresholds.DEPENDENT * s[0] else np.inf
        for s in (singular, solution.singular)
    ]
    return LeastSquares(solution.x, errors, covariance, sigma, *conditions)


def with_correlation(estimate: LeastSquares, equations: Equations, correlation_time: Array) -> LeastSquares:
    """Estimates with standard errors for residuals of a correlation time in rows."""
    equations = equations.merged()
    solution = solve(equations.weighted(estimate.sigma))
    covariance = np.zeros_like(estimate.covariance)
    for j, A in enumerate(equations.predicted(estimate.sigma)):  # G (sum over joints of tau_j A_j^T A_j) G^T
        share = solution.inverse @ (A @ solution.inverse).T
        covariance += correlation_time[j] * share @ share.T
    return estimate.with_covariance(covariance)


def fit_base_parameters(base: BaseParameters, data: RegressionData) -> LeastSquares:
    """Fit the base parameters to the equations of measured motions, by weighted least squares.

    Parameters
    ----------
    base : BaseParameters
        The combinations of parameters that torques depend on, of `Robot.base_parameters`.
    data : RegressionData
        The equations, of `regression`.

    Returns
    -------
    LeastSquares
        Values in the order of `base.names`, with standard errors that contain the correlation of the residuals, and the
        noise of each joint.

    Notes
    -----
    Gautier 1997; Siciliano et al. 2009, section 7.3; correlation of residuals: Sokal 1997, section 3.

    Examples
    --------
    >>> estimate = rne.identification.fit_base_parameters(base, data)  # doctest: +SKIP
    """
    fitted = data.fitted.mapped(base.back)
    estimate = least_squares(fitted)
    return with_correlation(estimate, fitted, data.correlation_time(data.residuals(base.back @ estimate.values)))


class Bias(NamedTuple):
    """Test of Durbin, Wu and Hausman on a bias of least squares: Hausman 1978; of fits by `rne.identify`.

    Attributes
    ----------
    shift : ndarray, shape (P,)
        Base parameters by least squares less those by instrumental variables, in their units.
    errors : ndarray, shape (P,)
        Standard errors of least squares, which do not contain the bias, in the same units.
    probability : float
        Probability that unbiased estimates differ by so much.
    """

    shift: Array
    errors: Array
    probability: float


def bias_of_least_squares(estimate: LeastSquares, equations: Equations, correlation_time: Array) -> Bias:
    """Test on equations with instruments, given the `estimate` by instrumental variables."""
    from scipy.stats import f

    equations, sigma = equations.merged(), estimate.sigma
    plain = equations.without_instruments()
    ours, theirs = (solve(e.weighted(sigma)) for e in (equations, plain))
    both = np.concatenate([equations.predicted(sigma), equations.columns[0, ..., :-1] / sigma[:, None, None]], axis=-1)
    difference = np.concatenate([-ours.inverse @ ours.inverse.T, theirs.inverse @ theirs.inverse.T])
    covariance = sum(t * share.T @ share for t, share in zip(correlation_time, both @ difference, strict=True))
    shift = theirs.x - ours.x
    scale = np.maximum(estimate.errors, thresholds.TINY)
    U, S, _ = np.linalg.svd(covariance / np.outer(scale, scale), hermitian=True)
    told = thresholds.DEPENDENT * S.max(initial=0) < S
    rank, rows = int(told.sum()), float((equations.rows[0] / correlation_time).sum())
    F = ((U.T[told] @ (shift / scale)) ** 2 / S[told]).sum() / max(rank, 1)
    errors = with_correlation(replace(estimate, values=theirs.x), plain, correlation_time).errors
    return Bias(shift, errors, float(f.sf(F, max(rank, 1), max(rows - 2 * rank, 1))))


def believed_noise(equations: Equations, sigma: Array) -> Array:
    """Noise of the joints, at least a thousandth of the torques."""
    return np.maximum(sigma, thresholds.LEAST_NOISE * equations.rms_torques())


class Estimator(NamedTuple):
    """Estimator of parameters from equations: base parameters by least squares, standard ones by the consistent fit."""

    base: BaseParameters
    prior: Array | None  # pseudo-inertias, shape (nb, 4, 4); None for least squares only
    weight: float  # of the divergence from the prior
    others: Array | None = None  # standard parameters in addition to E beta, by default those of the model
    noise: Array | None = None  # of each joint, by default from its residual

    def fit(self, equations: Equations, of_base: Equations | None = None) -> tuple[LeastSquares, Array]:
        """Base parameters, and standard parameters: consistent ones, or the nearest to the model's."""
        estimate = least_squares(equations.mapped(self.base.back) if of_base is None else of_base, self.noise)
        if self.prior is not None:
            return estimate, self._consistent(equations, estimate.sigma, self.prior)
        model = self.base.standard.values
        others = model - self.base.back @ (self.base.matrix @ model) if self.others is None else self.others
        return estimate, others + self.base.back @ estimate.values

    def _consistent(self, equations: Equations, sigma: Array, prior: Array) -> Array:
        """Physically consistent standard parameters; drives that the equations do not contain stay as given."""
        standard, factor = self.base.standard, equations.merged().weighted(believed_noise(equations, sigma))
        bodies, lengths = PARAMETERS * standard.model.nb, np.linalg.norm(factor[:, :-1], axis=0)
        free = np.array([name.startswith(("tau0", "c_")) for name in standard.names], bool)
        fitted = lengths > thresholds.NOTHING * lengths.max(initial=0)
        fitted[:bodies], known = True, np.where(free, standard.values, np.maximum(standard.values, 0))
        bounded, lengths, drives = ~free[fitted][bodies:], lengths[fitted][bodies:], known[fitted][bodies:]
        factor = with_prior(factor[:, np.append(fitted, True)], bodies, thresholds.HELD * lengths, drives)
        known[fitted] = consistent_fit(factor, prior, self.weight, bounded, 1 / lengths)
        return known


class Unexplained(NamedTuple):
    """Validation errors |predicted - measured| / |measured| per joint, over folds left out in turn by `rne.identify`.

    NaN for a joint of which no such torque was measured.

    Attributes
    ----------
    everywhere : ndarray, shape (n,)
        The share of all torques.
    in_motion : ndarray, shape (n,)
        The share of torques at more than the minimum velocity, which are fitted.
    at_rest : ndarray, shape (n,)
        The share of the slower torques.
    """

    everywhere: Array
    in_motion: Array
    at_rest: Array


def held_out(estimator: Estimator, fitted: Equations, measured: Equations) -> Unexplained:
    """Validation errors of all measured torques, of those in motion, which are fitted, and of those at rest."""
    return unexplained(fits_without_block(estimator, fitted), fitted, measured)


def fits_without_block(estimator: Estimator, fitted: Equations) -> list[Array]:
    """Standard parameters fitted to all blocks but one, for each block."""
    of_base, blocks = fitted.mapped(estimator.base.back), np.arange(len(fitted.factors))
    others = [blocks != k for k in blocks]
    return [estimator.fit(fitted.of_blocks(x), of_base.of_blocks(x))[1] for x in others]


def blocks_left_out(base: BaseParameters, data: RegressionData) -> list[Array]:
    """Standard parameters fitted to all blocks but one, for each, with common weights, in a tenth of the time."""
    noise = least_squares(data.fitted.mapped(base.back)).sigma
    return fits_without_block(Estimator(base, None, 1.0, noise=noise), data.fitted)


def unexplained(estimates: Sequence[Array], fitted: Equations, measured: Equations) -> Unexplained:
    """Validation error of blocks, each by the parameters fitted without it."""
    squares = np.zeros((2, fitted.joints))
    for k, x in enumerate(estimates):
        squares += [equations.of_blocks(np.array([k])).residuals(x) for equations in (measured, fitted)]
    torques, rows = (np.array([f(measured), f(fitted)]) for f in (Equations.torques, lambda e: e.rows.sum(0)))
    squares, torques, rows = (np.concatenate([x, [x[0] - x[1]]]) for x in (squares, torques, rows))
    shares = np.sqrt(np.maximum(squares, 0) / np.maximum(torques, thresholds.TINY))
    return Unexplained(*np.where(rows == 0, np.nan, shares))
