"""The joint-space inertia matrix from composite rigid bodies."""

from __future__ import annotations

import numpy as np

from ..model import Model
from ..spatial import (
    Array,
    cross,
    cross_matrix,
    dot,
    mirrored,
    rotate,
    transpose,
    zeros,
)
from .checks import checked
from .kinematics import joint_transforms

Composite = tuple[Array, Array, Array]  # mass, first moment, and inertia about the frame's origin


def composite_inertias(model: Model, R: list[Array], p: list[Array]) -> list[Composite]:
    """Mass, first moment and inertia about its frame's origin of each body with all it carries, in its axes."""
    mass, first, inertia = model.moments
    composites: list[Composite] = [(mass[i], first[i], inertia[i]) for i in range(model.nb)]
    for i in reversed(range(model.nb)):
        parent = model.parent[i]
        if parent >= 0:
            a, b = composites[parent], seen_from_parent(composites[i], R[i], p[i])
            composites[parent] = (a[0] + b[0], a[1] + b[1], a[2] + b[2])
    return composites


def seen_from_parent(body: Composite, R: Array, p: Array) -> Composite:
    """Featherstone 2008, (2.66) in three-vectors: turn, then move the reference point by p."""
    m, first, inertia = body
    h = rotate(R, first)
    steiner = cross_matrix(p) @ cross_matrix(h + (m / 2) * p)
    return m, h + m * p, mirrored(R @ inertia @ transpose(R) - (steiner + transpose(steiner)))


def unit_acceleration(model: Model, j: int, body: Composite) -> tuple[Array, Array]:
    """Force and moment that body j, with all it carries, asks of its joint for a unit acceleration of the joint."""
    m, h, inertia = body
    b = model.axis[j]
    if model.is_revolute(j):
        return cross(b, h), rotate(inertia, b)
    return m * b, cross(h, b)


@checked
def mass_matrix(model: Model, q: Array) -> Array:
    """Joint-space inertia matrix M(q): the torques per unit acceleration of each joint.

    Parameters
    ----------
    model : Model
    q : ndarray, shape (..., n)
        Joint positions [rad or m].

    Returns
    -------
    ndarray, shape (..., n, n)
        Full and exactly symmetric, `model.armature` included [kg m^2, kg m or kg].

    Raises
    ------
    ValueError
        If `q` has the wrong shape or is not finite, or M overflows.

    Notes
    -----
    Composite rigid bodies: Featherstone 2008, table 6.2. O(n d), d the depth of the tree.

    Examples
    --------
    >>> import rne
    >>> rne.mass_matrix(rne.irb140(), [0] * 6)[5, 5].round(6).item()
    0.001458
    """
    R, p = joint_transforms(model, q)
    composites = composite_inertias(model, R, p)
    M = zeros((*q.shape[:-1], model.nb, model.nb), like=q)
    for j in range(model.nb):
        f, n = unit_acceleration(model, j, composites[j])
        M[..., j, j] = dot(n if model.is_revolute(j) else f, model.axis[j]) + model.armature[j]
        i = j
        while model.parent[i] >= 0:
            f, n = rotate(R[i], f), rotate(R[i], n) + cross(p[i], rotate(R[i], f))
            i = model.parent[i]
            M[..., i, j] = M[..., j, i] = dot(n if model.is_revolute(i) else f, model.axis[i])
    return reduce_to_coordinates(model, M) if model.has_mimics else M


def mass_diagonal(model: Model, composites: list[Composite], like: Array) -> Array:
    """The diagonal of M alone: what each joint moves with all others locked, shape (..., nb)."""
    diagonal = zeros(like.shape, like=like)
    for j in range(model.nb):
        f, n = unit_acceleration(model, j, composites[j])
        diagonal[..., j] = dot(n if model.is_revolute(j) else f, model.axis[j]) + model.armature[j]
    return diagonal


def reduce_to_coordinates(model: Model, M: Array) -> Array:
    """G^T M G for joints that mimic others, exactly symmetric."""
    G = model.coordinate_map
    reduced: Array = G.T @ M @ G
    lower_rows, lower_columns = np.tril_indices(model.n, -1)
    reduced[..., lower_columns, lower_rows] = reduced[..., lower_rows, lower_columns]
    return reduced
