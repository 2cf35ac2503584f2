"""One set of parameters for all joints against a set for each: the F-test of nested linear models.

A joint's own fit may take every combination of parameters that its torque depends on. That of all joints has to share
them, which costs a joint with independent noise no more than chance; F compares the cost with the joint's own residual
(Draper and Smith 1998, section 6.1). Residuals that are like their neighbours count as fewer.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...basics.spatial import Array
from ..estimation.equations import Equations
from ..estimation.least_squares import solve

PRECISION = 1e-6  # of a joint's torques: no fit is taken for more exact
BELIEVED = 1e-6  # singular values below this part of the largest say nothing


@dataclass(frozen=True, eq=False)
class JointStatistics:
    """Residuals of each joint: together with the others, and alone; shape (n,) each.

    Attributes
    ----------
    parameters : ndarray, shape (count,)
        Base parameters of all joints together.
    held_out : ndarray
        |predicted - measured| / |measured| on blocks of time that were not fitted, together.
    together, alone : ndarray
        Standard deviation of the residual, with the parameters that a joint spends taken into account, in |measured|.
    F : ndarray
        Ratio of the mean squares; about 1 if one set of parameters serves all joints.
    probability : ndarray
        That chance alone makes F so large.
    independent : ndarray
        Number of independent equations.
    """

    parameters: Array
    held_out: Array
    together: Array
    alone: Array
    F: Array
    probability: Array
    independent: Array


def joint_statistics(fitted: Equations, measured: Equations, repeats: Array) -> JointStatistics:
    """The comparison, for equations of the base parameters.

    Parameters
    ----------
    fitted, measured : Equations
        Those that are fitted, and those that held-out errors are taken of.
    repeats : ndarray, shape (n,)
        How many equations of a joint count as one.

    Returns
    -------
    JointStatistics
    """
    n, all_rows = fitted.joints, fitted.rows.sum(0)
    size = fitted.torques()
    least = PRECISION**2 * np.maximum(size, PRECISION**2 * size.max(initial=0)) + np.finfo(float).tiny
    own = [own_fit(fitted.of_joint(j)) for j in range(n)]
    squares, ranks = (np.array(x) for x in zip(*((s, r) for _, s, r in own), strict=True))
    squares = np.maximum(squares, least)
    sigma = np.sqrt(squares / np.maximum(all_rows - ranks, 1))
    x, spent = joint_fit(fitted, sigma)
    freedom, independent = np.maximum(all_rows - ranks, 1), np.maximum(all_rows / repeats - ranks, 1)
    total = np.maximum(fitted.residuals(x), squares)
    free = np.maximum(ranks - spent, 1)
    F = (total - squares) / free / (squares / freedom) / repeats
    from scipy.stats import f

    def share(squares: Array, freedom: Array) -> Array:
        return np.asarray(np.sqrt(squares / freedom * all_rows / np.maximum(size, np.finfo(float).tiny)))

    held = held_out_together(fitted, measured, sigma)
    return JointStatistics(
        x,
        np.sqrt(held / np.maximum(measured.torques(), np.finfo(float).tiny)),
        share(total, np.maximum(all_rows - spent, 1)),
        share(squares, freedom),
        F,
        np.asarray(f.sf(F, free, independent)),
        independent,
    )


def own_fit(equations: Equations) -> tuple[Array, float, int]:
    """Estimates, |residual|^2 and rank of the equations of one joint."""
    factor = equations.weighted(np.ones(1))
    x, rank = truncated(factor)
    return x, float(equations.residuals(x)[0]), rank


def truncated(factor: Array) -> tuple[Array, int]:
    """The solution of smallest length in the directions that the equations determine."""
    A, b = factor[:, :-1], factor[:, -1]
    lengths = np.linalg.norm(A, axis=0)
    lengths[lengths == 0] = 1
    x, _, rank, _ = np.linalg.lstsq(A / lengths, b, rcond=BELIEVED)
    return x / lengths, int(rank)


def joint_fit(equations: Equations, sigma: Array) -> tuple[Array, Array]:
    """Estimates of all joints together, and how many parameters each joint's equations determine."""
    solution = solve(equations.weighted(sigma))
    spent = ((equations.factors[..., :-1] @ solution.inverse) ** 2).sum((0, 2, 3)) / sigma**2
    return solution.x, spent


def held_out_together(fitted: Equations, measured: Equations, sigma: Array) -> Array:
    """|residual|^2 of each joint on blocks that were not fitted."""
    squares = np.zeros(fitted.joints)
    for k in range(len(fitted.factors)):
        others = np.arange(len(fitted.factors)) != k
        x, _ = joint_fit(fitted.of_blocks(others), sigma)
        squares += measured.of_blocks(~others).residuals(x)
    return squares
