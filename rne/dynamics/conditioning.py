"""How many digits forward dynamics keep: M's pivots decide whether it is singular, Skeel's amplification the digits.

`pivot_grade` and `amplifications` are the only criteria: functions, kernels, batches and simulations apply them
through `judge_accelerations`, `rne.dynamics.diagnose` directly.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from ..basics.spatial import Array
from ..errors import SingularMassMatrixError
from ..model.model import Model
from ..model.parameters import of_states
from .crba import mass_matrix
from .rnea import External, bias_torque, gravity_torque
from .verdict import SOUND, BatchIndex, PrecisionLoss, Verdict

MIN_DIGITS = 3.0  # decimal digits below which a result is warned of
# A pivot of M up to SINGULAR n eps M_kk is only rounding error: M is singular, an error. Up to NEARLY_SINGULAR
# n eps M_kk the digits left are estimated.
SINGULAR, NEARLY_SINGULAR = 8, 1000
NEGATIVE = 1e-9  # of M's largest entry, or of M scaled to unit diagonal: more below zero is no rounding error


def pivot_grade(pivots: Array, diagonal: Array) -> Array:
    """Grade of each pivot of M: 0 for a sound one, 1 if M is nearly singular, 2 if it is singular, shape (..., n).

    A pivot that is not a number counts as singular.
    """
    below = [pivots_below(units, pivots, diagonal) for units in (NEARLY_SINGULAR, SINGULAR)]
    condition: Array = below[0].astype(np.int8) + below[1]
    return condition


def pivots_below(units: float, pivots: Array, diagonal: Array) -> Array:
    """Where a pivot of M is at most `units` n eps of M's diagonal entry, or not a number, shape (..., n)."""
    pivots, diagonal = pivots.real, diagonal.real
    eps = float(np.finfo(pivots.dtype).eps) if pivots.dtype != object else 0.0
    return ~np.asarray(pivots > units * pivots.shape[-1] * eps * diagonal, dtype=bool)


def rate_bound(dtype: np.dtype[Any]) -> float:
    """Joint rate eps^(-1/4) [rad/s or m/s], 8192 in float64, above which the digits left are estimated.

    Its square is eps^(-1/2): where torques cancel C qd + g, half the digits of the dtype are left.
    """
    return float(np.finfo(dtype).eps ** -0.25)


def judge_singularity(
    model: Model, arguments: Mapping[str, Any], result: Array, pivots: Array, diagonal: Array
) -> Verdict:
    """The Verdict on a solution with M alone: an error if M is singular; digits are not estimated."""
    singular = pivot_grade(pivots, diagonal).max(axis=-1, initial=0) == 2
    if not singular.any():
        return SOUND
    state = tuple(int(k) for k in np.argwhere(singular)[0])
    return Verdict(
        error=singular_error(model, mass_matrix.core(of_states(model, state), arguments["q"][state]).real, state)
    )


def judge_accelerations(
    model: Model, arguments: Mapping[str, Any], qdd: Array, pivots: Array, diagonal: Array
) -> Verdict:
    """The Verdict on forward dynamics: an error if M is singular, a loss if fewer than MIN_DIGITS digits are left.

    Digits are estimated only in states whose M is nearly singular or whose rates exceed `rate_bound`: everywhere else
    there are enough of them.
    """
    verdict = judge_singularity(model, arguments, qdd, pivots, diagonal)
    if verdict.error is not None or qdd.dtype.kind != "f":
        return verdict
    nearly = np.asarray(pivot_grade(pivots, diagonal).max(axis=-1, initial=0) > 0)
    fast = np.asarray(np.abs(arguments["qd"]).max(axis=-1, initial=0.0) > rate_bound(qdd.dtype))
    suspect = nearly | fast
    if not suspect.any():
        return SOUND
    q, qd, tau = (arguments[name][suspect].astype(np.float64) for name in ("q", "qd", "tau"))
    wrenches = {link: wrench[suspect].astype(np.float64) for link, wrench in (arguments.get("external") or {}).items()}
    lost = float(np.finfo(qdd.dtype).eps) * amplifications(
        of_states(model, suspect), q, qd, tau, wrenches or None, qdd.dtype
    )
    k = int(np.argmax(lost))
    digits = max(0.0, -float(np.log10(lost[k])))
    if digits >= MIN_DIGITS:
        return SOUND
    state: BatchIndex = tuple(int(i) for i in np.argwhere(suspect)[k])
    cause = f"the torques and C qd + g cancel at rates of {np.abs(qd[k]).max():.1e} rad/s or m/s"
    return Verdict(loss=PrecisionLoss(digits, state, "M is nearly singular" if nearly[state] else cause))


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
    M cannot be inverted. Where terms of C qd + g cancel that are much larger than it, their rounding errors in `dtype`
    count, beside the accelerations that torques and gravity give.
    """
    double = model.astype(np.float64)
    with np.errstate(all="ignore"):
        M, h = mass_matrix.core(double, q), bias_torque.core(double, q, qd, external=external)
        inverse = _inverse(M)
        qdd = (inverse @ (tau - h)[..., None])[..., 0]
        spread = np.abs(M) @ np.abs(qdd)[..., None] + (np.abs(tau) + np.abs(h))[..., None]
        grown = (np.abs(inverse) @ spread)[..., 0].max(axis=-1, initial=0.0)
        found = np.where(grown == 0, 1.0, grown / np.abs(qdd).max(axis=-1, initial=0.0))
        noise = _accelerated(inverse, _rounding_noise(model, q, qd, external, np.dtype(dtype)))
        scale = _accelerated(inverse, np.abs(tau) + np.abs(gravity_torque.core(double, q)))
        scale = np.maximum(scale, np.abs(qdd).max(axis=-1, initial=0.0))
        found = np.maximum(found, np.where(scale > 0, noise / scale, 0.0))
    return np.where(np.isfinite(found), found, np.inf)


def _accelerated(inverse: Array, torque: Array) -> Array:
    """Largest acceleration that torques of these sizes can give."""
    largest: Array = (np.abs(inverse) @ torque[..., None])[..., 0].max(axis=-1, initial=0.0)
    return largest


def _rounding_noise(model: Model, q: Array, qd: Array, external: External | None, dtype: np.dtype[Any]) -> Array:
    """Rounding errors of C qd + g in a dtype, found by a wider one, in units of its eps, shape (..., n)."""
    wide = np.dtype(np.float64 if dtype == np.float32 else np.longdouble)

    def bias(precision: np.dtype[Any]) -> Array:
        wrenches = {link: wrench.astype(precision) for link, wrench in (external or {}).items()} or None
        state = rounded.astype(precision), rates.astype(precision)
        return np.asarray(bias_torque.core(model.astype(precision), *state, external=wrenches)).astype(wide)

    rounded, rates = q.astype(dtype), qd.astype(dtype)
    noise = np.abs(bias(dtype) - bias(wide)) / np.finfo(dtype).eps
    return np.where(np.isfinite(noise), noise, np.inf).astype(np.float64)


def _inverse(M: Array) -> Array:
    """The inverse for every state; NaN where there is none."""
    try:
        return np.linalg.inv(M)
    except np.linalg.LinAlgError:
        inverse = np.full(M.shape, np.nan)
        for state in np.ndindex(M.shape[:-2]):
            try:
                inverse[state] = np.linalg.inv(M[state])
            except np.linalg.LinAlgError:
                continue
        return inverse


def weakest_motion(model: Model, M: Array) -> tuple[tuple[str, ...], float]:
    """The joints whose combined motion moves the least inertia, and the smallest eigenvalue of M of unit diagonal.

    A joint whose diagonal entry is not positive moves none by itself; the eigenvalue is 0 then.
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
    """The error that names the joints whose combined motion moves no inertia, or a negative one."""
    joints, value = weakest_motion(model, M)
    names = ", ".join(repr(name) for name in joints)
    if value < -NEGATIVE or np.diagonal(M).min() < -NEGATIVE * np.abs(M).max():  # of bodies that are not possible
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
