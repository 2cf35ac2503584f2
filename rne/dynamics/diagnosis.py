"""How near M is to singular in given states, by which motion, and how many digits forward dynamics keep there."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, DTypeLike

from ..basics.arrays import real_array
from ..basics.spatial import Array
from ..basics.text import summary
from ..model.model import Model, joint_array, model_argument
from .conditioning import amplifications, pivot_grade, weakest_motion
from .crba import mass_matrix
from .forward import factorise
from .quantity import common_leading_shape


@dataclass(frozen=True, eq=False)
class Diagnosis:
    """How near M is to singular, for every state of a batch.

    Attributes
    ----------
    condition : ndarray, shape (...)
        Condition number of M scaled to unit diagonal, so that units and sizes do not count; infinite if M is singular
        to working precision.
    pivot : ndarray, shape (...)
        The smallest ratio of a pivot of M = L^T D L to M's diagonal entry: 1 for a joint that no other joint
        moves, a few eps where forward dynamics raise an error.
    digits : ndarray, shape (...)
        Decimal digits left in forward dynamics, at least 0: -log10(eps condition), or with rates and torques given
        -log10(eps amplification), which includes the cancellation in tau - C qd - g.
    worst_state : tuple of int
        The state with the fewest digits; empty for a single one.
    worst_joint : tuple of str
        In that state, the joints of the combined motion that moves the least inertia.

    Examples
    --------
    >>> import rne
    >>> print(rne.dynamics.diagnose(rne.irb140(), [0] * 6))  # doctest: +ELLIPSIS
    condition 3.0e+00, smallest pivot 8.0e-01 of its diagonal entry, about 15 digits in forward dynamics; ...
    """

    condition: Array
    pivot: Array
    digits: Array
    worst_state: tuple[int, ...]
    worst_joint: tuple[str, ...]

    __repr__ = summary

    def __str__(self) -> str:
        if not self.condition.size:
            return "no states"
        k = self.worst_state
        where = f"worst of {self.condition.size} states is {k}: " if k else ""
        motion = ", ".join(self.worst_joint)
        if not np.isfinite(self.condition[k]):
            return f"{where}M is singular to working precision: a motion of {motion} moves no inertia"
        least = f"; a motion of {motion} moves the least inertia" if motion else ""
        return (
            f"{where}condition {self.condition[k]:.1e}, smallest pivot {self.pivot[k]:.1e} of its diagonal entry, "
            f"about {self.digits[k]:.0f} digits in forward dynamics{least}"
        )


def diagnose(
    model: Model,
    q: ArrayLike,
    qd: ArrayLike | None = None,
    tau: ArrayLike | None = None,
    *,
    dtype: DTypeLike | None = None,
) -> Diagnosis:
    """Digits that forward dynamics keep in given states, and the motion that limits them.

    Parameters
    ----------
    model : Model
        The robot's parameters.
    q : array_like, shape (..., n)
        Joint positions [rad or m].
    qd, tau : array_like, shape (..., n), optional
        Joint rates and torques, both or neither [rad/s or m/s; N m or N].
    dtype : real floating data type, optional
        The arithmetic to diagnose for; by default that of `q`.

    Returns
    -------
    Diagnosis
        Condition of M scaled to unit diagonal, digits left, and the joints whose motion limits them.

    Raises
    ------
    ValueError
        If an array has the wrong shape or is not finite and real, `dtype` is not real floating point, or only one of
        `qd` and `tau` is given.

    Notes
    -----
    A singular M is not an error here: its condition number is infinite and its digits are 0. Scaling to unit diagonal
    comes within a factor n of the smallest condition number that any scaling of the joints gives (van der Sluis 1969).
    The amplification is Skeel's (1979) for M qdd = tau - C qd - g with relative errors in M, tau and C qd + g.

    Examples
    --------
    >>> import rne
    >>> print(rne.dynamics.diagnose(rne.irb140(), [0] * 6).digits.round())
    15.0
    """
    positions = joint_array("q", q, model_argument(model))
    arithmetic = np.dtype(positions.dtype if dtype is None else dtype)
    if dtype is None and arithmetic.kind == "O":
        arithmetic = np.dtype(np.float64)
    if arithmetic.kind != "f" or positions.dtype.kind == "c":
        name, got = ("q", positions.dtype) if dtype is None or arithmetic.kind == "f" else ("dtype", arithmetic)
        raise ValueError(f"`{name}` must be real floating point, got {got}")
    motion = _motion(model, positions, qd, tau)
    if motion is not None:
        positions = motion[0]
    M = mass_matrix(model, positions.astype(np.result_type(arithmetic, np.float64)))
    condition, pivot = _condition(M, model, arithmetic)
    lost = condition if motion is None else np.where(np.isinf(condition), np.inf, amplifications(model, *motion))
    with np.errstate(divide="ignore"):
        digits = np.maximum(0.0, -np.log10(float(np.finfo(arithmetic).eps) * lost))
    state, joints = _worst(lost, M, model)
    return Diagnosis(condition, pivot, np.asarray(digits), state, joints)


def _motion(model: Model, q: Array, qd: ArrayLike | None, tau: ArrayLike | None) -> tuple[Array, Array, Array] | None:
    """Positions, rates and torques of one leading shape; None if neither of the last two is given."""
    if qd is None and tau is None:
        return None
    if qd is None or tau is None:
        raise ValueError(f"`qd` and `tau` go together, got only `{'qd' if tau is None else 'tau'}`")
    arrays = {"q": q} | {
        name: joint_array(name, real_array(name, x, "(..., n)"), model) for name, x in (("qd", qd), ("tau", tau))
    }
    leading = common_leading_shape(arrays)
    states = [np.broadcast_to(x, leading + x.shape[-1:]).astype(np.float64) for x in arrays.values()]
    return states[0], states[1], states[2]


def _condition(M: Array, model: Model, arithmetic: np.dtype[Any]) -> tuple[Array, Array]:
    """Condition number of M scaled to unit diagonal, and the smallest pivot ratio; inf and 0 if M is singular."""
    if model.n == 0:
        return np.ones(M.shape[:-2]), np.ones(M.shape[:-2])
    diagonal = np.diagonal(M, axis1=-2, axis2=-1)
    with np.errstate(all="ignore"):
        root = np.sqrt(np.where(diagonal > 0, diagonal, 1))
        scaled = M / root[..., :, None] / root[..., None, :]
        pivots = factorise(scaled, model.coordinate_parent)[1]
        pivots = np.where(np.isfinite(pivots), pivots, 0)
        values = np.linalg.eigvalsh(scaled.astype(np.float64))
        condition = values[..., -1] / np.maximum(values[..., 0], 0)
    ones = np.ones(pivots.shape, dtype=arithmetic)
    singular = (pivot_grade(pivots.astype(arithmetic), ones) == 2).any(axis=-1)
    pivot = np.maximum(pivots.min(axis=-1), 0).astype(np.float64)
    return np.where(singular | ~np.isfinite(condition), np.inf, condition), np.asarray(pivot)


def _worst(lost: Array, M: Array, model: Model) -> tuple[tuple[int, ...], tuple[str, ...]]:
    if not lost.size:
        return (), ()
    state = tuple(int(k) for k in np.unravel_index(int(np.argmax(lost)), lost.shape))
    return state, weakest_motion(model, M[state])[0] if model.n else ()
