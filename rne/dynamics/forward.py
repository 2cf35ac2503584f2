"""Forward dynamics by the joint-space inertia matrix: M factored as L^T D L along the tree."""

from __future__ import annotations

import numpy as np

from ..basics.spatial import Array, zeros
from ..model.model import Model
from .conditioning import judge_accelerations, judge_singularity
from .crba import mass_matrix
from .quantity import judged_quantity
from .rnea import External, bias_torque


def ancestors(parent: tuple[int, ...], k: int) -> list[int]:
    """The coordinates above k in the tree, from the base outwards."""
    chain: list[int] = []
    while parent[k] >= 0:
        k = parent[k]
        chain.insert(0, k)
    return chain


def factorise(M: Array, parent: tuple[int, ...]) -> tuple[Array, Array]:
    """L (unit lower triangular) and pivots D with M = L^T D L, no fill-in between branches of the tree.

    Featherstone 2008, section 6.5, without square roots: joints are eliminated from the tips inwards, the order
    that loses no digits of a light tip.
    """
    L = M.copy()
    D = zeros(M.shape[:-1], like=M)
    for k in reversed(range(len(parent))):
        above = np.array(ancestors(parent, k), dtype=int)
        row = L[..., k, above]
        D[..., k] = L[..., k, k]
        scaled = row / D[..., k, None]
        L[..., above[:, None], above] = L[..., above[:, None], above] - scaled[..., :, None] * row[..., None, :]
        L[..., k, above] = scaled
    return L, D


def solve_factored(L: Array, D: Array, parent: tuple[int, ...], y: Array) -> Array:
    """Solve L^T D L x = y, shape (..., n)."""
    x = np.zeros_like(y + D)
    x[...] = y
    for k in reversed(range(len(parent))):  # L^T z = y
        above = ancestors(parent, k)
        x[..., above] = x[..., above] - L[..., k, above] * x[..., k, None]
    x = x / D
    for k in range(len(parent)):  # L x = z
        above = ancestors(parent, k)
        x[..., k] = x[..., k] - (L[..., k, above] * x[..., above]).sum(-1)
    return x


@judged_quantity(judge_singularity)
def solve_mass_matrix(model: Model, q: Array, tau: Array) -> tuple[Array, Array, Array]:
    """M^-1 tau: the accelerations that torques add, or the rates of the momenta p = M qd, shape (..., n)."""
    M = mass_matrix.core(model, q)
    L, D = factorise(M, model.coordinate_parent)
    return solve_factored(L, D, model.coordinate_parent, tau), D, np.diagonal(M, axis1=-2, axis2=-1)


@judged_quantity(judge_accelerations)
def forward_dynamics(
    model: Model, q: Array, qd: Array, tau: Array, *, external: External | None = None
) -> tuple[Array, Array, Array]:
    """Joint accelerations that the torques tau give: qdd = M^-1 (tau - C qd - g).

    Parameters
    ----------
    model : Model
        The robot's parameters.
    q, qd, tau : ndarray, shape (..., n)
        Joint positions, rates and torques [rad or m; rad/s or m/s; N m or N].
    external : mapping of str to ndarray, shape (..., 6), optional
        Wrenches [moment; force] acting on the robot at the named link's origin, in its axes [N m, N].

    Returns
    -------
    ndarray, shape (..., n)
        Accelerations [rad/s^2 or m/s^2].

    Raises
    ------
    ValueError
        If an array has the wrong shape or is not finite, or the acceleration overflows.
    SingularMassMatrixError
        If M is singular to working precision; names the joints whose combination moves no inertia.

    Warns
    -----
    PrecisionWarning
        If fewer than 3 digits are left, M nearly singular or the torques cancelled by great rates.

    Notes
    -----
    M from composite bodies, factored as L^T D L without forming its inverse: Featherstone 2008, section 6.5.
    The relative error is about eps times the condition number of M. `forward_dynamics.core` returns
    (qdd, pivots, diagonal of M).

    Examples
    --------
    >>> import rne
    >>> rne.dynamics.forward_dynamics(rne.irb140(), [0] * 6, [0] * 6, [0] * 6).round(2)[5].item()
    0.0
    """
    M = mass_matrix.core(model, q)
    h = bias_torque.core(model, q, qd, external=external)
    L, D = factorise(M, model.coordinate_parent)
    return solve_factored(L, D, model.coordinate_parent, tau - h), D, np.diagonal(M, axis1=-2, axis2=-1)
