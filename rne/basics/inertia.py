"""Inertial parameters of a rigid body: ten numbers about a point, and the pseudo-inertia with these entries.

The pseudo-inertia of a body is the symmetric 4 x 4 matrix of its second moments of mass, P = [[Sigma, h], [h^T, m]]
with Sigma = tr(I) / 2 1 - I, the integral of r r^T dm, and h = m c. A body that some distribution of mass has is one
with P positive semidefinite; Wensing, Kim and Slotine 2018.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from .spatial import IDENTITY, Array, dot, outer, point_mass_inertia, symmetric, zeros

PARAMETERS = 10  # number of inertial parameters of a body
PRODUCTS = ((0, 0), (0, 1), (1, 1), (0, 2), (1, 2), (2, 2))  # indices of the inertia's entries, in their order
ROWS, COLUMNS = (np.array(indices) for indices in zip(*PRODUCTS, strict=True))
ENTRIES = np.zeros((3, 3), np.intp)  # index among the PRODUCTS of each entry of a symmetric matrix
ENTRIES[ROWS, COLUMNS] = ENTRIES[COLUMNS, ROWS] = range(len(PRODUCTS))
# The inertia per unit of each of its entries; small integers are promoted to the dtype of the other operand.
BASIS = np.array([[[int({r, c} == {i, j}) for c in range(3)] for r in range(3)] for i, j in PRODUCTS], np.int8)


def parameters_of_bodies(mass: Array, centre: Array, inertia: Array) -> Array:
    """Ten parameters about a point, (..., 10), of bodies with centres of mass seen from there."""
    inertia = inertia + point_mass_inertia(mass[..., None, None], centre)
    moments = mass[..., None] * centre
    return np.concatenate([mass[..., None], moments, inertia[..., ROWS, COLUMNS]], axis=-1)


def parameters_seen_from(m: Array, h: Array, inertia: Array, p: Array) -> Array:
    """Ten parameters (..., 10) of bodies about another point, from where the former one is at p."""
    shift = 2 * dot(h, p)[..., None, None] * IDENTITY - outer(h, p) - outer(p, h)
    inertia = inertia + shift + point_mass_inertia(m[..., None, None], p)
    return np.concatenate([m[..., None], h + m[..., None] * p, inertia[..., ROWS, COLUMNS]], axis=-1)


def body_of_parameters(pi: Array) -> tuple[Array, Array, Array]:
    """Mass, centre of mass, and inertia about it, of a body with ten parameters about a point."""
    mass, centre = pi[0], pi[1:4] / pi[0] if pi[0] else np.zeros(3)
    return mass, centre, pi[4:].take(ENTRIES, -1) - point_mass_inertia(mass[None, None], centre)


# P = sum over k of pi_k UNITS[k]: the pseudo-inertia per unit of each parameter
UNITS = np.zeros((PARAMETERS, 4, 4))
UNITS[0, 3, 3] = 1.0
UNITS[1:4, :3, 3] = UNITS[1:4, 3, :3] = np.eye(3)
UNITS[4:, :3, :3] = np.trace(BASIS, axis1=1, axis2=2)[:, None, None] / 2 * np.eye(3) - BASIS


def pseudo_inertia(pi: Array) -> Array:
    """Pseudo-inertias (..., nb, 4, 4) of bodies with inertial parameters (..., 10 nb), numbers or traced numbers.

    Second moments [kg m^2], first moments [kg m] and mass [kg], about the point and in the axes of the parameters.
    """
    return combined(pi, UNITS)


def parameters_of_pseudo_inertia(P: Array) -> Array:
    """Inertial parameters (..., 10 nb) of bodies with pseudo-inertias (..., nb, 4, 4), numbers or traced."""
    pi = zeros((*P.shape[:-2], PARAMETERS), like=P)
    pi[..., 0] = P[..., 3, 3]
    pi[..., 1:4] = P[..., :3, 3]
    trace = P[..., 0, 0] + P[..., 1, 1] + P[..., 2, 2]
    for k, (i, j) in enumerate(PRODUCTS):  # I = tr(Sigma) 1 - Sigma
        pi[..., 4 + k] = trace - P[..., i, i] if i == j else -P[..., i, j]
    return pi.reshape(*P.shape[:-3], -1)


def dual_of_gradient(slope: Array) -> Array:
    """Symmetric matrices S (..., nb, 4, 4) with tr(S dP) = slope . dpi for every change dpi of the parameters.

    `slope` (..., 10 nb) are the derivatives with respect to the parameters, numbers or traced numbers.
    """
    return combined(slope, DUALS)


def combined(coefficients: Array, matrices: Array) -> Array:
    """Sum of the ten matrices, times ten coefficients per body, shape (..., nb, 4, 4)."""
    rows = np.asarray(coefficients).reshape(*np.shape(coefficients)[:-1], -1, PARAMETERS)
    total: Any = zeros((*rows.shape[:-1], 4, 4), like=rows)
    for k, matrix in enumerate(matrices):
        for i, j in np.argwhere(matrix):  # products with zeros would be operations of a kernel
            total[..., i, j] += matrix[i, j] * rows[..., k]
    return np.asarray(total)


# tr(DUALS[k] UNITS[l]) is 1 for k = l, otherwise 0: tr(DUALS[k] P) is parameter k of P
DUALS = symmetric(parameters_of_pseudo_inertia(np.eye(16).reshape(16, 4, 4)).reshape(4, 4, PARAMETERS).T)
