"""Forward dynamics by the joint-space inertia matrix: M factored as L^T D L along the tree."""

from __future__ import annotations

from functools import partial

from ..basics.spatial import Array
from ..model.model import Model
from .crba import mass_matrix, solve_with_pivots
from .precision import check_accelerations, check_singularity
from .quantity import Solved, checked_quantity
from .rnea import External, bias_torque, inertia_torque


@checked_quantity(check_singularity)
def solve_mass_matrix(model: Model, q: Array, tau: Array) -> Solved:
    """Solution of M qdd = tau: accelerations from torques, or velocities from momenta p = M qd, shape (..., n)."""
    M = mass_matrix.core(model, q)
    return solve_with_pivots(M, model.coordinate_parent, tau, partial(inertia_torque, model, q))


@checked_quantity(check_accelerations)
def forward_dynamics(model: Model, q: Array, qd: Array, tau: Array, *, external: External | None = None) -> Solved:
    """Joint accelerations that the torques tau give: qdd = M^-1 (tau - C qd - g).

    M from composite bodies, factored as L^T D L without forming its inverse: Featherstone 2008, section 6.5. The
    relative error is about eps times the condition number of M. `forward_dynamics.core` returns (qdd, pivots,
    diagonal of M). Parameters, result and errors are those of `rne.Robot.forward_dynamics`, with the model first.
    """
    M = mass_matrix.core(model, q)
    h = bias_torque.core(model, q, qd, external=external)
    return solve_with_pivots(M, model.coordinate_parent, tau - h, partial(inertia_torque, model, q))
