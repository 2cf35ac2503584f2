"""Forward dynamics: M factored as L^T D L, and what is said when M is singular."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from ..errors import SingularMassMatrixError
from ..model import Model
from ..spatial import Array, zeros
from .checks import judged
from .composite import mass_matrix
from .newton_euler import External, bias_torque
from .precision import DOUBTFUL, SINGULAR, pivots_below, warn_of_few_digits


def ancestors(parent: tuple[int, ...], k: int) -> list[int]:
    """The coordinates above k in the tree, from the base outwards."""
    chain: list[int] = []
    while parent[k] >= 0:
        k = parent[k]
        chain.insert(0, k)
    return chain


def factorise(M: Array, parent: tuple[int, ...]) -> tuple[Array, Array]:
    """L (unit lower triangular) and pivots D with M = L^T D L, no fill-in between branches of the tree.

    Featherstone 2008, section 6.5, without square roots: joints are eliminated from the tips inwards, which is
    the order that keeps a light tip's digits.
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


def judge_pivots(model: Model, result: tuple[Array, Array, Array], arguments: Mapping[str, Any]) -> Array:
    """Accelerations, if M was regular."""
    qdd, pivots, diagonal = result
    raise_if_singular(model, pivots, diagonal, arguments["q"])
    return qdd


def judge_accelerations(model: Model, result: tuple[Array, Array, Array], arguments: Mapping[str, Any]) -> Array:
    """Accelerations, if M was regular; with a warning if few of their digits are left."""
    qdd = judge_pivots(model, result, arguments)
    doubtful = np.asarray(pivots_below(DOUBTFUL, *result[1:]).any(axis=-1))
    state = arguments["q"], arguments["qd"], arguments["tau"]
    warn_of_few_digits(model, state, qdd, doubtful, arguments.get("external"))
    return qdd


def raise_if_singular(model: Model, pivots: Array, diagonal: Array, q: Array) -> None:
    """Raise SingularMassMatrixError for the first state with a pivot that is only rounding."""
    singular = pivots_below(SINGULAR, pivots, diagonal)
    if singular.any():
        state = tuple(int(k) for k in np.argwhere(singular)[0][:-1])
        raise singular_error(model, mass_matrix.core(model, q[state]).real, state)


def weakest_motion(model: Model, M: Array) -> tuple[tuple[str, ...], float]:
    """The joints whose combined motion moves the least inertia, and the smallest eigenvalue of M of unit diagonal.

    A joint whose diagonal entry is not positive moves none by itself; the eigenvalue is 0 then.
    """
    M = M.astype(np.float64)
    diagonal = np.diagonal(M)
    still = [name for name, m in zip(model.joint_names, diagonal, strict=True) if not m > 0]
    if still:
        return tuple(still), 0.0
    scale = 1 / np.sqrt(diagonal)  # unit diagonal: no joint counts for more through its units
    values, vectors = np.linalg.eigh(M * scale[:, None] * scale)
    motion = np.abs(vectors[:, 0])
    joints = tuple(name for name, x in zip(model.joint_names, motion, strict=True) if x > 1e-3 * motion.max())
    return joints, float(values[0])


def singular_error(model: Model, M: Array, state: tuple[int, ...]) -> SingularMassMatrixError:
    """The error that names the joints whose combined motion moves no inertia."""
    joints, value = weakest_motion(model, M)
    names = ", ".join(repr(name) for name in joints)
    if not (np.diagonal(M) > 0).all():
        return SingularMassMatrixError("M is singular", f": nothing with inertia moves with {names}", joints, state)
    return SingularMassMatrixError(
        "M is singular to working precision",
        f": a combined motion of {names} moves no inertia "
        f"(smallest eigenvalue {value:.1e} of M scaled to unit diagonal)",
        joints,
        state,
    )


@judged(judge_pivots)
def solve_mass_matrix(model: Model, q: Array, tau: Array) -> tuple[Array, Array, Array]:
    """M^-1 tau: the accelerations that torques add, or the rates of the momenta p = M qd, shape (..., n)."""
    M = mass_matrix.core(model, q)
    L, D = factorise(M, model.coordinate_parent)
    return solve_factored(L, D, model.coordinate_parent, tau), D, np.diagonal(M, axis1=-2, axis2=-1)


@judged(judge_accelerations)
def forward_dynamics(
    model: Model, q: Array, qd: Array, tau: Array, *, external: External | None = None
) -> tuple[Array, Array, Array]:
    """Joint accelerations that the torques tau give: qdd = M^-1 (tau - C qd - g).

    Parameters
    ----------
    model : Model
    q, qd, tau : ndarray, shape (..., n)
        Joint positions, rates and torques [rad or m, /s, N m or N].
    external : mapping of str to ndarray, shape (..., 6), optional
        Wrenches [moment; force] acting on the robot at the named link's origin, in its axes [N m, N].

    Returns
    -------
    ndarray, shape (..., n)
        [rad/s^2 or m/s^2]

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
    >>> rne.forward_dynamics(rne.irb140(), [0] * 6, [0] * 6, [0] * 6).round(2)[5].item()
    0.0
    """
    M = mass_matrix.core(model, q)
    h = bias_torque.core(model, q, qd, external=external)
    L, D = factorise(M, model.coordinate_parent)
    return solve_factored(L, D, model.coordinate_parent, tau - h), D, np.diagonal(M, axis1=-2, axis2=-1)
