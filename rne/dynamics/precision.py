"""Precision of forward dynamics: M's pivots decide on singularity, Skeel's amplification on the digits left.

The criteria are `pivot_bound`, `velocity_bound` and `amplifications`; no other module defines such bounds. Functions
and batches apply them by `check_accelerations`; kernels compare pivots and joint velocities with the two bounds and
leave states beyond them to it; `diagnose` and simulations with stiction use `pivots_below`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, DTypeLike

from ..basics.arrays import real_numbers
from ..basics.spatial import Array, rotate
from ..basics.text import InNotebooks, summary
from ..errors import SingularMassMatrixError
from ..model.model import Model, joint_array, model_argument
from ..model.parameters import of_states
from .crba import factorise, mass_matrix, solve_factored
from .quantity import OK, BatchIndex, PrecisionLoss, PrecisionStatus, check_arguments
from .rnea import External, bias_torque, gravity_torque

MIN_DIGITS = 3.0  # decimal digits below which a warning is given
# Rounding changes a pivot of M by up to about n eps M_kk (Higham 2002, Accuracy and Stability, theorem 10.3). A pivot
# up to 8 of these, which include the errors of M's own entries, may be only rounding: M is singular, an error. A pivot
# above 10^MIN_DIGITS of them keeps MIN_DIGITS digits; between, the digits left are estimated.
SINGULAR, NEARLY_SINGULAR = 8.0, 10**MIN_DIGITS
NEGATIVE = 1e-9  # largest negative rounding error relative to M's largest entry, or of M scaled to unit diagonal


def pivot_bound(units: float, n: int, dtype: DTypeLike) -> float:
    """Fraction of M's diagonal entry up to which a pivot of M is at most `units` rounding errors of n eps."""
    return units * n * float(np.finfo(dtype).eps)


def pivots_below(units: float, pivots: Array, diagonal: Array) -> Array:
    """True where a pivot of M is at most `units` n eps of M's diagonal entry, or NaN, shape (..., n).

    For mpmath numbers, whose eps is not that of a dtype, the bound is 0.
    """
    pivots, diagonal = pivots.real, diagonal.real
    bound = pivot_bound(units, pivots.shape[-1], pivots.dtype) if pivots.dtype != object else 0.0
    return ~np.asarray(pivots > bound * diagonal, dtype=bool)


def velocity_bound(dtype: np.dtype[Any]) -> float:
    """Joint velocity eps^(-1/4) [rad/s or m/s], 8192 in float64, above which the digits left are estimated.

    Its square is eps^(-1/2): where torques cancel C qd + g, half the digits of the dtype are left.
    """
    return float(np.finfo(dtype).eps ** -0.25)


def check_singularity(
    model: Model, arguments: Mapping[str, Any], result: Array, pivots: Array, diagonal: Array
) -> PrecisionStatus:
    """Status of a solution with M: an error if M is singular; digits are not estimated."""
    singular = pivots_below(SINGULAR, pivots, diagonal).any(axis=-1)
    if not singular.any():
        return OK
    state = tuple(int(k) for k in np.argwhere(singular)[0])
    M = mass_matrix.core(of_states(model, state), arguments["q"][state]).real
    return PrecisionStatus(error=singular_error(model, M, state))


def check_accelerations(
    model: Model, arguments: Mapping[str, Any], qdd: Array, pivots: Array, diagonal: Array
) -> PrecisionStatus:
    """Status of forward dynamics: an error if M is singular, a loss if fewer than MIN_DIGITS digits are left.

    Digits are estimated only in states whose M is nearly singular or whose joint velocities exceed `velocity_bound`:
    everywhere else there are enough of them.
    """
    status = check_singularity(model, arguments, qdd, pivots, diagonal)
    if status.error is not None or qdd.dtype.kind != "f":
        return status
    nearly = np.asarray(pivots_below(NEARLY_SINGULAR, pivots, diagonal).any(axis=-1))
    fast = np.asarray(np.abs(arguments["qd"]).max(axis=-1, initial=0.0) > velocity_bound(qdd.dtype))
    suspect = nearly | fast
    if not suspect.any():
        return OK
    q, qd, tau = (arguments[name][suspect].astype(np.float64) for name in ("q", "qd", "tau"))
    external = {link: wrench[suspect].astype(np.float64) for link, wrench in (arguments.get("external") or {}).items()}
    lost = amplifications(of_states(model, suspect), q, qd, tau, external, qdd.dtype)
    k = int(np.argmax(lost))
    digits = _digits_left(lost[k], qdd.dtype)
    if digits >= MIN_DIGITS:
        return OK
    state = tuple(int(i) for i in np.argwhere(suspect)[k])
    cause = f"the torques and C qd + g cancel at joint velocities of {np.abs(qd[k]).max():.1e} rad/s or m/s"
    return PrecisionStatus(loss=PrecisionLoss(float(digits), state, "M is nearly singular" if nearly[state] else cause))


def _digits_left(amplification: Array, dtype: np.dtype[Any]) -> Array:
    """Decimal digits left by relative errors of eps, at least 0."""
    with np.errstate(divide="ignore"):
        return np.asarray(np.maximum(0.0, -np.log10(float(np.finfo(dtype).eps) * amplification)))


def amplifications(
    model: Model,
    q: Array,
    qd: Array,
    tau: Array,
    external: External | None = None,
    dtype: np.dtype[Any] | type = np.float64,
) -> Array:
    """Factor by which relative errors in M, C qd + g and tau grow in qdd = M^-1 (tau - C qd - g), shape (...).

    Skeel 1979, componentwise: max |M^-1| (|M| |qdd| + |tau| + |C qd + g|) / max |qdd|. Infinite where it overflows or
    M cannot be inverted. Where much larger terms cancel in C qd + g, it is at least their rounding errors in `dtype`
    relative to the accelerations that torques and gravity give.
    """
    double = model.astype(np.float64)
    with np.errstate(all="ignore"):
        M, h = mass_matrix.core(double, q), bias_torque.core(double, q, qd, external=external)
        L, D = factorise(M, model.coordinate_parent)
        columns = solve_factored(L[..., None, :, :], D[..., None, :], model.coordinate_parent, np.eye(model.n))
        inverse = np.abs(columns)

        def largest(torque: Array) -> Array:  # acceleration that torques of these sizes can give
            return np.asarray(rotate(inverse, torque).max(axis=-1, initial=0.0))

        qdd = solve_factored(L, D, model.coordinate_parent, tau - h)
        size = np.abs(qdd).max(axis=-1, initial=0.0)
        grown = largest(rotate(np.abs(M), np.abs(qdd)) + np.abs(tau) + np.abs(h))
        found = np.where(grown == 0, 1.0, grown / size)
        noise = largest(_rounding_noise(model, q, qd, external, np.dtype(dtype)))
        scale = np.maximum(largest(np.abs(tau) + np.abs(gravity_torque.core(double, q))), size)
        found = np.maximum(found, np.where(scale > 0, noise / scale, 0.0))
    return np.where(np.isfinite(found), found, np.inf)


def _rounding_noise(model: Model, q: Array, qd: Array, external: External | None, dtype: np.dtype[Any]) -> Array:
    """Rounding errors of C qd + g in a dtype, from a wider dtype, in units of eps, shape (..., n)."""
    wide = np.dtype(np.float64 if dtype == np.float32 else np.longdouble)

    def bias(precision: np.dtype[Any]) -> Array:  # of positions and velocities rounded to `dtype`
        state = (x.astype(dtype).astype(precision) for x in (q, qd))
        wrenches = {link: wrench.astype(precision) for link, wrench in (external or {}).items()}
        return np.asarray(bias_torque.core(model.astype(precision), *state, external=wrenches)).astype(wide)

    noise = np.abs(bias(dtype) - bias(wide)) / np.finfo(dtype).eps
    return np.where(np.isfinite(noise), noise, np.inf).astype(np.float64)


def weakest_motion(model: Model, M: Array) -> tuple[tuple[str, ...], float]:
    """Joints whose combined motion moves the least inertia, and the smallest eigenvalue of M scaled to unit diagonal.

    If diagonal entries are not positive, these are the joints, and the eigenvalue is 0.
    """
    M = M.astype(np.float64)
    diagonal = np.diagonal(M)
    still = [name for name, m in zip(model.joint_names, diagonal, strict=True) if not m > 0]
    if still:
        return tuple(still), 0.0
    scale = 1 / np.sqrt(diagonal)  # unit diagonal: the units of a joint do not count
    values, vectors = np.linalg.eigh(M * scale[:, None] * scale)
    motion = np.abs(vectors[:, 0])
    joints = tuple(name for name, x in zip(model.joint_names, motion, strict=True) if x > 1e-3 * motion.max())
    return joints, float(values[0])


def singular_error(model: Model, M: Array, state: BatchIndex) -> SingularMassMatrixError:
    """Error that names the joints whose combined motion moves no inertia, or a negative one."""
    joints, value = weakest_motion(model, M)
    names = ", ".join(repr(name) for name in joints)
    if value < -NEGATIVE or np.diagonal(M).min() < -NEGATIVE * np.abs(M).max():  # bodies are not physical
        cause = f": a motion of {names} moves negative inertia"
        return SingularMassMatrixError("M is not positive definite", cause, joints, state)
    if not (np.diagonal(M) > 0).all():
        return SingularMassMatrixError("M is singular", f": nothing with inertia moves with {names}", joints, state)
    return SingularMassMatrixError(
        "M is singular to working precision",
        f": a combined motion of {names} moves no inertia "
        f"(smallest eigenvalue {value:.1e} of M scaled to unit diagonal)",
        joints,
        state,
    )


@dataclass(frozen=True, eq=False)
class Diagnosis(InNotebooks):
    """Distance of M from singularity, for every state of a batch.

    Attributes
    ----------
    condition : ndarray, shape (...)
        Condition number of M scaled to unit diagonal, so that units and sizes do not count; infinite if M is singular
        to working precision.
    pivot : ndarray, shape (...)
        The smallest ratio of a pivot of M = L^T D L to M's diagonal entry: 1 for a joint that no other joint
        moves, a few eps where forward dynamics raise an error.
    digits : ndarray, shape (...)
        Decimal digits left in forward dynamics, at least 0: -log10(eps condition), or with velocities and torques given
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

    Scaling M to unit diagonal comes within a factor n of the smallest condition number that any scaling of the
    joints gives (van der Sluis 1969). The amplification is Skeel's (1979) for M qdd = tau - C qd - g with relative
    errors in M, tau and C qd + g. Parameters, result and errors are those of `rne.Robot.diagnose`, with the model
    first.
    """
    positions = joint_array("q", q, model_argument(model))
    arithmetic = np.dtype(positions.dtype if dtype is None else dtype)
    if dtype is None and arithmetic.kind == "O":
        arithmetic = np.dtype(np.float64)
    if arithmetic.kind != "f" or positions.dtype.kind == "c":
        name, got = ("q", positions.dtype) if dtype is None or arithmetic.kind == "f" else ("dtype", arithmetic)
        raise ValueError(f"`{name}` must be real floating point, got {got}")
    if (qd is None) != (tau is None):
        raise ValueError(f"`qd` and `tau` go together, got only `{'qd' if tau is None else 'tau'}`")
    given = {name: real_numbers(name, x, "(..., n)") for name, x in (("qd", qd), ("tau", tau)) if x is not None}
    states = check_arguments(model, {"q": positions} | given)[1]
    M = mass_matrix(model, states["q"].astype(np.result_type(arithmetic, np.float64)))
    condition, pivot = _condition(M, model, arithmetic)
    lost = condition
    if given:
        doubles = (x.astype(np.float64) for x in states.values())
        lost = np.where(np.isinf(condition), np.inf, amplifications(model, *doubles))
    state: BatchIndex = ()
    if lost.size:
        state = tuple(int(k) for k in np.unravel_index(int(np.argmax(lost)), lost.shape))
    joints = weakest_motion(model, M[state])[0] if lost.size and model.n else ()
    return Diagnosis(condition, pivot, _digits_left(lost, arithmetic), state, joints)


def _condition(M: Array, model: Model, arithmetic: np.dtype[Any]) -> tuple[Array, Array]:
    """Condition number of M scaled to unit diagonal, and the smallest pivot ratio; inf if M is singular."""
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
    singular = pivots_below(SINGULAR, pivots.astype(arithmetic), ones).any(axis=-1)
    pivot = np.maximum(pivots.min(axis=-1), 0).astype(np.float64)
    return np.where(singular | ~np.isfinite(condition), np.inf, condition), np.asarray(pivot)
