"""Largest gravity torques of joints that make full turns, exact up to a grid of angles.

The first moment s_i(q) of the bodies behind joint i is seen from frame i. Its largest component along w, h_i(w), is
convex in w, and after a full turn of the joint in front it depends on the angle between w and that joint's axis alone:
one table of a single angle for each joint, from the last to the first, whatever the number of joints.
"""

from __future__ import annotations

import numpy as np

from ..basics.spatial import Array
from ..model.model import Model
from .criteria import ROUNDING
from .polynomials import sizes_of_terms

HALF = 180  # steps from 0 to pi / 2
UNKNOWN = 1e150  # a bound of what is not known, whose square is finite


def angle(v: Array, w: Array) -> Array:
    """Angle between vectors, shape (...) [rad]."""
    return np.asarray(np.arctan2(np.linalg.norm(np.cross(v, w), axis=-1), (v * w).sum(axis=-1)))


def gravity_torques_of_full_turns(model: Model) -> Array:
    """Upper bounds of |g_i|, shape (nb,); UNKNOWN for sliding joints, and UNKNOWN or 0 for the joints before them."""
    weight = np.linalg.norm(model.gravity)
    most = np.array([tables[HALF] for tables in support_tables(model)])
    torque = weight * largest_sine(model) * most + ROUNDING * sizes_of_terms(model)[0]
    return np.where(model.is_revolute, torque, UNKNOWN)


def support_tables(model: Model) -> Array:
    """Upper bounds of h_i(w) over unit vectors w at angles of 0 to pi from axis i, shape (nb, 2 HALF + 1).

    Between angles a convex function that is homogeneous in w is at most the chord's value. The unit circle of w's
    component across the axis is enclosed by a polygon.
    """
    polar, turn = np.linspace(0, np.pi, 2 * HALF + 1), np.linspace(0, 2 * np.pi, 4 * HALF, endpoint=False)
    across = np.sin(polar) / np.cos(turn[1] / 2)
    tables, mass = np.zeros((model.nb, len(polar))), model.mass.copy()
    moment = model.mass[:, None] * model.com
    axes = np.einsum("nij,nj->ni", model.rotation, model.axis)

    def of_joint(i: int, w: Array) -> Array:
        theta = angle(w, axes[i])
        k = np.minimum((theta / polar[1]).astype(int), 2 * HALF - 1)
        parts = np.sin(polar[k + 1] - theta) * tables[i, k] + np.sin(theta - polar[k]) * tables[i, k + 1]
        return np.asarray(np.linalg.norm(w, axis=-1) * parts / np.sin(polar[1]))

    for i in reversed(range(model.nb)):
        behind = [j for j in range(model.nb) if model.parent[j] == i]
        mass[i] += mass[behind].sum()
        if not model.is_revolute[i] or (tables[behind] == UNKNOWN).any():
            tables[i] = UNKNOWN
            continue
        moment[i] += mass[behind] @ model.translation[behind]
        x, y = np.linalg.svd(model.axis[i][None])[2][1:]
        circle = np.cos(turn)[:, None] * x + np.sin(turn)[:, None] * y
        w = np.cos(polar)[:, None, None] * model.axis[i] + across[:, None, None] * circle
        h = w @ moment[i] + sum(of_joint(j, w) for j in behind)
        tables[i] = h.max(axis=1)
    return tables


def largest_sine(model: Model) -> Array:
    """Largest sine of the angle between gravity and each axis, from the interval of these angles, shape (nb,)."""
    low, high = np.zeros((2, model.nb))
    for i, p in enumerate(model.parent):
        axis = model.rotation[i] @ model.axis[i]
        if p < 0:
            low[i] = high[i] = angle(model.gravity, axis) if model.gravity.any() else 0.0
            continue
        between, ends = angle(model.axis[p], axis), (low[p], high[p])
        low[i] = abs(between - np.clip(between, *ends))
        high[i] = np.pi - abs(np.pi - between - np.clip(np.pi - between, *ends))
    return np.asarray(np.sin(np.clip(np.pi / 2, low, high)))
