"""Forward dynamics by the joint-space inertia matrix: M factored as L^T D L along the tree."""

from __future__ import annotations

import numpy as np

from ..basics.spatial import Array
from ..model.model import Model
from .crba import factorise, mass_matrix, solve_factored
from .precision import check_accelerations, check_singularity
from .quantity import checked_quantity
from .rnea import External, bias_torque


@checked_quantity(check_singularity)
def solve_mass_matrix(model: Model, q: Array, tau: Array) -> tuple[Array, Array, Array]:
    """M^-1 tau: the accelerations that torques add, or the rates of the momenta p = M qd, shape (..., n)."""
    M = mass_matrix.core(model, q)
    L, D = factorise(M, model.coordinate_parent)
    return solve_factored(L, D, model.coordinate_parent, tau), D, np.diagonal(M, axis1=-2, axis2=-1)


@checked_quantity(check_accelerations)
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
        If fewer than 3 digits are left, M nearly singular or the torques cancelled at high joint velocities.

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
