"""The pseudo-inertia of a body: its ten inertial parameters as one symmetric 4 x 4 matrix, the second moments of mass.

P = [[Sigma, h], [h^T, m]] with Sigma = tr(I) / 2 1 - I, the integral of r r^T dm, and h = m c. A body that some
distribution of mass has is one with P positive semidefinite; Wensing, Kim and Slotine 2018.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from ..basics.spatial import Array, zeros
from .parameters import PARAMETERS, PRODUCTS

# P = sum over k of pi_k UNITS[k]: the pseudo-inertia per unit of each parameter
UNITS = np.zeros((PARAMETERS, 4, 4))
UNITS[0, 3, 3] = 1.0
for _k in range(3):
    UNITS[1 + _k, _k, 3] = UNITS[1 + _k, 3, _k] = 1.0
for _k, (_i, _j) in enumerate(PRODUCTS):
    if _i == _j:
        UNITS[4 + _k, :3, :3] = np.eye(3) / 2
        UNITS[4 + _k, _i, _i] -= 1.0
    else:
        UNITS[4 + _k, _i, _j] = UNITS[4 + _k, _j, _i] = -1.0


def pseudo_inertia(pi: Array) -> Array:
    """The pseudo-inertias of bodies.

    Parameters
    ----------
    pi : ndarray, shape (..., 10 nb)
        Inertial parameters, ten per body, as of `Robot.parameters`; numbers or traced numbers.

    Returns
    -------
    ndarray, shape (..., nb, 4, 4)
        Second moments [kg m^2], first moments [kg m] and mass [kg], about the point and in the axes of the parameters.

    Examples
    --------
    >>> import numpy as np, rne
    >>> from rne.model.pseudo_inertia import pseudo_inertia
    >>> P = pseudo_inertia(rne.load("irb140").parameters)
    >>> P.shape, P[1, 3, 3].item(), bool((np.linalg.eigvalsh(P[1]) > 0).all())
    ((6, 4, 4), 22.0, True)
    """
    return combined(pi, UNITS)


def parameters_of_pseudo_inertia(P: Array) -> Array:
    """The inertial parameters of bodies with these pseudo-inertias.

    Parameters
    ----------
    P : ndarray, shape (..., nb, 4, 4)
        Symmetric matrices; numbers or traced numbers.

    Returns
    -------
    ndarray, shape (..., 10 nb)
        In the order of `Robot.parameters`.

    Examples
    --------
    >>> import numpy as np, rne
    >>> from rne.model.pseudo_inertia import parameters_of_pseudo_inertia, pseudo_inertia
    >>> pi = rne.load("irb140").parameters
    >>> np.allclose(parameters_of_pseudo_inertia(pseudo_inertia(pi)), pi)
    True
    """
    pi = zeros((*P.shape[:-2], PARAMETERS), like=P)
    pi[..., 0] = P[..., 3, 3]
    pi[..., 1:4] = P[..., :3, 3]
    trace = P[..., 0, 0] + P[..., 1, 1] + P[..., 2, 2]
    for k, (i, j) in enumerate(PRODUCTS):  # I = tr(Sigma) 1 - Sigma
        pi[..., 4 + k] = trace - P[..., i, i] if i == j else -P[..., i, j]
    return pi.reshape(*P.shape[:-3], -1)


def dual_of_gradient(slope: Array) -> Array:
    """The symmetric matrices S with tr(S dP) = slope . dpi for every change dpi of the parameters.

    Parameters
    ----------
    slope : ndarray, shape (..., 10 nb)
        Derivatives by each parameter; numbers or traced numbers.

    Returns
    -------
    ndarray, shape (..., nb, 4, 4)

    Examples
    --------
    >>> import numpy as np
    >>> from rne.model.pseudo_inertia import dual_of_gradient, pseudo_inertia
    >>> slope, change = np.random.default_rng(0).normal(size=(2, 20))
    >>> np.isclose(np.sum(dual_of_gradient(slope) * pseudo_inertia(change)), slope @ change).item()
    True
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


# tr(DUALS[k] UNITS[l]) is 1 for k = l, otherwise 0
DUALS = (
    np.linalg.pinv(UNITS.reshape(PARAMETERS, 16)).T.reshape(PARAMETERS, 4, 4).round(12) + 0.0
)  # entries are 0, 1/2 and 1
