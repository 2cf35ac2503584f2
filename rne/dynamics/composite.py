"""The joint-space inertia matrix from composite rigid bodies."""

from __future__ import annotations

import numpy as np

from ..model import Model
from ..spatial import IDENTITY, Array, cross, dot, outer, point_mass_inertia, rotate, transpose, zeros
from .checks import checked
from .kinematics import joint_transforms

Composite = tuple[Array, Array, Array]  # mass, first moment m c, inertia about the frame's origin


def composite_inertias(model: Model, R: list[Array], p: list[Array]) -> list[Composite]:
    """Mass, first moment and inertia about its frame's origin of each body with all it carries, in its axes."""
    composites: list[Composite] = []
    for i in range(model.nb):
        m, c = model.mass[i], model.com[i]
        composites.append((m, m * c, model.inertia[i] + point_mass_inertia(m, c)))
    for i in reversed(range(model.nb)):
        parent = model.parent[i]
        if parent >= 0:
            composites[parent] = _add(composites[parent], _seen_from_parent(composites[i], R[i], p[i]))
    return composites


def _add(a: Composite, b: Composite) -> Composite:
    return a[0] + b[0], a[1] + b[1], a[2] + b[2]


def _seen_from_parent(body: Composite, R: Array, p: Array) -> Composite:
    """Featherstone 2008, (2.66) in three-vectors: turn, then move the reference point by p."""
    mass, moment, inertia = body
    h = rotate(R, moment)
    cross_terms = inertia_product(h, p) + inertia_product(p, h) + mass * inertia_product(p, p)
    return mass, h + mass * p, R @ inertia @ transpose(R) + cross_terms


def inertia_product(a: Array, b: Array) -> Array:
    """(a.b) 1 - b a^T, the matrix of -[a]x [b]x: parallel-axis terms."""
    product: Array = dot(a, b)[..., None, None] * IDENTITY - outer(b, a)
    return product


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
        mass, moment, inertia = composites[j]
        b = model.axis[j]
        if model.is_revolute(j):
            f, n = cross(b, moment), rotate(inertia, b)
        else:
            f, n = mass * b, cross(moment, b)
        M[..., j, j] = dot(n if model.is_revolute(j) else f, b) + model.armature[j]
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
        mass, _, inertia = composites[j]
        b = model.axis[j]
        diagonal[..., j] = (dot(rotate(inertia, b), b) if model.is_revolute(j) else mass) + model.armature[j]
    return diagonal


def reduce_to_coordinates(model: Model, M: Array) -> Array:
    """G^T M G for joints that mimic others, exactly symmetric."""
    G = model.coordinate_map
    reduced: Array = G.T @ M @ G
    lower_rows, lower_columns = np.tril_indices(model.n, -1)
    reduced[..., lower_columns, lower_rows] = reduced[..., lower_rows, lower_columns]
    return reduced
