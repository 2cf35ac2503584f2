"""Weighted least squares: each joint's equations count by its own residual.

Gautier 1997; Siciliano et al. 2009, section 7.3. The noise of a joint is its residual over its degrees of freedom,
which depend on the fit, which depends on the noise: the fit is repeated until neither changes.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from ...basics.spatial import Array
from .equations import Equations

ROUNDS = 30  # of weighting; it settles in a few
SETTLED = 1e-6  # relative change of the noise at which weighting ends
FEWEST = 5  # degrees of freedom of a joint, from which its residual says what its noise is
ROUNDING = 1e-13  # of the torques: data without noise have this for it
DEPENDENT = 1e-10  # singular values below this part of the largest, of columns of unit length, are rounding
UNDETERMINED = 1e-6  # share of an unknown in the directions that the equations leave free


@dataclass(frozen=True, eq=False)
class LeastSquares:
    """Estimates and how far to trust them.

    Attributes
    ----------
    values, errors : ndarray, shape (P,)
        Estimates and their standard errors; an error is infinite where the motion says nothing of an unknown, and the
        estimate is then that of the smallest norm.
    covariance : ndarray, shape (P, P)
        Of the part that the motion determines.
    sigma : ndarray, shape (n,)
        Standard deviation of each joint's residual [N m or N].
    condition : float
        Condition number of the weighted equations; infinite if unknowns depend on each other.
    scaled_condition : float
        The same with columns of unit length.

    Examples
    --------
    >>> import numpy as np, rne
    >>> robot, t = rne.load("irb140"), np.arange(0, 10, 0.002)
    >>> q, qd, qdd = rne.trajectories.quintic([0] * 6, [1] * 6, 10.0)(t)
    >>> record = rne.identification.Record(t, q, robot.inverse_dynamics(q, qd, qdd))
    >>> rne.identify(robot, record, consistent=False).estimate.values.shape
    (36,)
    """

    values: Array
    errors: Array
    covariance: Array
    sigma: Array
    condition: float
    scaled_condition: float


class Solution(NamedTuple):
    """Solution x of A x = b with smallest residual; of those, with the smallest length per column."""

    x: Array
    inverse: Array  # G of shape (P, rank): x = G U^T b, its covariance is G G^T
    singular: Array  # singular values of A with columns of unit length
    free: Array  # true for unknowns that the equations do not determine


def solve(factor: Array) -> Solution:
    """The solution of triangular equations [A b]."""
    A, b = factor[:, :-1], factor[:, -1]
    lengths = np.linalg.norm(A, axis=0)
    lengths[lengths == 0] = 1
    U, S, V = np.linalg.svd(A / lengths, full_matrices=False)
    kept = DEPENDENT * S.max(initial=0) < S
    inverse = (V[kept].T / S[kept]) / lengths[:, None]
    free = np.linalg.norm(V[~kept], axis=0) > UNDETERMINED
    return Solution(inverse @ (U.T[kept] @ b), inverse, S, free)


def least_squares(equations: Equations) -> LeastSquares:
    """Estimates of all unknowns from the equations of all blocks and joints.

    Parameters
    ----------
    equations : Equations

    Returns
    -------
    LeastSquares
    """
    equations = equations.merged()
    rows = equations.rows[0]
    size = np.sqrt(equations.torques() / np.maximum(rows, 1))
    least = np.maximum(ROUNDING * np.maximum(size, size.max(initial=0) * ROUNDING), np.finfo(float).tiny)
    sigma = np.maximum(size, least)
    for _ in range(ROUNDS):
        found = noise(equations, sigma, size, least)
        settled = np.abs(found / sigma - 1).max(initial=0) <= SETTLED
        sigma = found
        if settled:
            break
    factor = equations.weighted(sigma)
    solution = solve(factor)
    covariance = solution.inverse @ solution.inverse.T
    errors = np.where(solution.free, np.inf, np.sqrt(np.diag(covariance)))
    singular = np.linalg.svd(factor[:, :-1], compute_uv=False)
    conditions = [float(s[0] / s[-1]) if s[-1] > DEPENDENT * s[0] else np.inf for s in (singular, solution.singular)]
    return LeastSquares(solution.x, errors, covariance, sigma, *conditions)


def with_correlation(estimate: LeastSquares, equations: Equations, repeats: Array) -> LeastSquares:
    """The same estimates, with the standard errors of correlated residuals.

    Parameters
    ----------
    estimate : LeastSquares
        Of these equations.
    equations : Equations
    repeats : ndarray, shape (n,)
        How many equations of a joint count as one.

    Returns
    -------
    LeastSquares
    """
    equations = equations.merged()
    solution = solve(equations.weighted(estimate.sigma))
    covariance = np.zeros_like(estimate.covariance)
    for j, factor in enumerate(equations.factors[0]):  # G (sum over joints of repeats A_j^T A_j) G^T of the sandwich
        share = solution.inverse @ (factor[:, :-1] @ solution.inverse / estimate.sigma[j]).T
        covariance += repeats[j] * share @ share.T
    errors = np.where(solution.free, np.inf, np.sqrt(np.diag(covariance)))
    return replace(estimate, covariance=covariance, errors=errors)


def noise(equations: Equations, sigma: Array, start: Array, least: Array) -> Array:
    """Standard deviation of each joint's residual, of a fit weighted by `sigma`.

    A joint with hardly more equations than it has unknowns of its own leaves no residual: it keeps the value `start`.
    """
    solution = solve(equations.weighted(sigma))
    spent = ((equations.factors[..., :-1] @ solution.inverse) ** 2).sum((0, 2, 3)) / sigma**2
    freedom = equations.rows.sum(0) - spent
    found = np.sqrt(equations.residuals(solution.x) / np.maximum(freedom, 1))
    return np.maximum(np.where(freedom < FEWEST, start, found), least)
