"""Forward dynamics by the Euler-Lagrange formulation: its M, factored as L^T D L, and its bias torques."""

from __future__ import annotations

import numpy as np

from ..basics.spatial import Array
from ..model.model import Model
from .conditioning import judge_accelerations
from .forward import factorise, solve_factored
from .kinematics import joint_rates
from .lagrange import equations
from .quantity import judged_quantity


@judged_quantity(judge_accelerations, moments=False)
def lagrange_forward_dynamics(model: Model, q: Array, qd: Array, tau: Array) -> tuple[Array, Array, Array]:
    """Joint accelerations by the Euler-Lagrange formulation; equal to those of `forward_dynamics`.

    Parameters
    ----------
    model : Model
        The robot's parameters.
    q, qd, tau : ndarray, shape (..., n)
        Joint positions, rates and torques [rad or m; rad/s or m/s; N m or N].

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
    Høifødt 2011, (7.4), with the terms of Siciliano et al. 2009, section 7.1. O(n^4).
    `lagrange_forward_dynamics.core` returns (qdd, pivots, diagonal of M).

    Examples
    --------
    >>> import rne
    >>> rne.dynamics.lagrange_forward_dynamics(rne.irb140(), [0] * 6, [0] * 6, [0] * 6).round(2)[5].item()
    0.0
    """
    M, bias = equations(model, q, joint_rates(model, qd))
    if model.has_mimics:
        G = model.coordinate_map
        M, bias = G.T @ M @ G, bias @ G
    L, D = factorise(M, model.coordinate_parent)
    return solve_factored(L, D, model.coordinate_parent, tau - bias), D, np.diagonal(M, axis1=-2, axis2=-1)
