"""Joint-space inertia matrix M(q) by the composite-rigid-body algorithm (CRBA)."""

from __future__ import annotations

from functools import partial

import numpy as np

from ..basics.spatial import Array, Map, cross, cross_matrix, dot, mirrored, note_solution, rotate, transpose, zeros
from ..model.model import Model
from ..model.solids import Moments
from ..model.topology import carriers
from .kinematics import BASE, coordinate_map, joint_transforms
from .quantity import Solved, quantity


def composite_inertias(model: Model, R: list[Array], p: list[Array]) -> dict[int, Moments]:
    """Mass, first moment and inertia of each body with its whole subtree (I^C_i of Featherstone), in frame i."""
    composites = {i: model.body_moments(i) for i in range(model.nb)}
    for i in reversed(range(model.nb)):
        parent = model.parent[i]
        if parent != BASE:
            composites[parent] = composites[parent].plus(move_to_parent(composites[i], R[i], p[i]))
    return composites


def move_to_parent(body: Moments, R: Array, p: Array) -> Moments:
    """Moments of a body in the parent's frame: rotated by R, then its reference point moved by p.

    Featherstone 2008, (2.66) in three-vectors: I - (S + S^T) with S = [p]x [h + m p / 2]x.
    """
    m, h_i, I = body
    h = rotate(R, h_i)
    S = cross_matrix(p) @ cross_matrix(h + (m / 2) * p)
    return Moments(m, h + m * p, mirrored(R @ I @ transpose(R) - (S + transpose(S))))


def unit_acceleration(body: Moments, s: Array, t: Array) -> tuple[Array, Array]:
    """Force and moment I^C S that a composite body takes for a unit acceleration of its joint with axes s and t."""
    m, h, I = body
    return m * t + cross(s, h), rotate(I, s) + cross(h, t)


@quantity(base_parameters=True)
def mass_matrix(model: Model, q: Array) -> Array:
    """Joint-space inertia matrix M(q): the torques per unit acceleration of each joint.

    Composite-rigid-body algorithm, Featherstone 2008, table 6.2. O(n d), d the depth of the tree. Parameters,
    result and errors are those of `rne.Robot.mass_matrix`, with the model first.
    """
    R, p = joint_transforms(model, q)
    s, t = model.angular_axis, model.linear_axis
    composites = composite_inertias(model, R, p)
    M = zeros((*q.shape[:-1], model.nb, model.nb), like=q)
    for j in range(model.nb):
        f, n = unit_acceleration(composites[j], s[j], t[j])
        M[..., j, j] = dot(n, s[j]) + dot(f, t[j]) + model.armature[j]
        i = j
        while model.parent[i] != BASE:
            f = rotate(R[i], f)
            n = rotate(R[i], n) + cross(p[i], f)
            i = model.parent[i]
            M[..., i, j] = M[..., j, i] = dot(n, s[i]) + dot(f, t[i])
    G = coordinate_map(model, q)
    return mirrored(transpose(G) @ M @ G) if model.has_mimics else M


def mass_diagonal(model: Model, composites: dict[int, Moments], like: Array) -> Array:
    """Diagonal of M: the inertia that each joint accelerates with all others locked, shape (..., nb)."""
    diagonal = zeros(like.shape, like=like)
    for j, (s, t) in enumerate(zip(model.angular_axis, model.linear_axis, strict=True)):
        f, n = unit_acceleration(composites[j], s, t)
        diagonal[..., j] = dot(n, s) + dot(f, t) + model.armature[j]
    return diagonal


def factorise(M: Array, parent: tuple[int, ...]) -> tuple[Array, Array]:
    """L (unit lower triangular) and pivots D with M = L^T D L, no fill-in between branches of the tree.

    Featherstone 2008, section 6.5, without square roots: joints are eliminated from the tips inwards, the order
    that loses no digits of a light tip.
    """
    L = M.copy()
    D = zeros(M.shape[:-1], like=M)
    for k in reversed(range(len(parent))):
        above = np.array(carriers(parent, parent[k])[::-1], dtype=int)
        row = L[..., k, above]
        D[..., k] = L[..., k, k]
        scaled = row / D[..., k, None]
        L[..., above[:, None], above] = L[..., above[:, None], above] - scaled[..., :, None] * row[..., None, :]
        L[..., k, above] = scaled
    return L, D


def solve_with_pivots(M: Array, parent: tuple[int, ...], y: Array, product: Map | None = None) -> Solved:
    """Solution x of M x = y, the pivots of M = L^T D L and the diagonal of M, shape (..., n) each.

    Derivatives of x are computed from `product`, which gives M x; a recursion loses fewer digits than M itself.
    """
    L, D = factorise(M, parent)
    solve, product = partial(solve_factored, L, D, parent), product or partial(rotate, M)
    x = solve(y)
    note_solution(x, solve, product, lambda x: product(x) - y)
    return x, D, np.diagonal(M, axis1=-2, axis2=-1)


def solve_factored(L: Array, D: Array, parent: tuple[int, ...], y: Array) -> Array:
    """Solve L^T D L x = y, shape (..., n)."""
    x = np.array(np.broadcast_to(y, np.broadcast_shapes(y.shape, D.shape)))
    for k in reversed(range(len(parent))):  # L^T z = y
        above = carriers(parent, parent[k])[::-1]
        x[..., above] = x[..., above] - L[..., k, above] * x[..., k, None]
    x = x / D
    for k in range(len(parent)):  # L x = z
        above = carriers(parent, parent[k])[::-1]
        x[..., k] = x[..., k] - (L[..., k, above] * x[..., above]).sum(-1)
    return x
