"""How many digits forward dynamics keep, and a warning where they are few."""

from __future__ import annotations

import sys
import warnings
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from ..errors import PrecisionWarning
from ..model import Model
from ..spatial import Array
from .composite import mass_matrix
from .newton_euler import bias_torque

FEWEST = 3.0  # decimal digits that are returned without a word
# Units of n eps of M's diagonal entry: a pivot below the first is nothing but rounding, below the second it is looked
# at how many digits are left.
SINGULAR, DOUBTFUL = 8, 1000


def amplifications(model: Model, q: Array, qd: Array, tau: Array) -> Array:
    """By how much relative errors in M, C qd + g and tau grow in qdd = M^-1 (tau - C qd - g), shape (...).

    Skeel 1979, componentwise: max |M^-1| (|M| |qdd| + |tau| + |C qd + g|) / max |qdd|. Infinite where it overflows or
    M cannot be inverted.
    """
    double = model.astype(np.float64)
    with np.errstate(all="ignore"):
        M, h = mass_matrix.core(double, q), bias_torque.core(double, q, qd)
        try:
            inverse = np.linalg.inv(M)
        except np.linalg.LinAlgError:
            return np.full(q.shape[:-1], np.inf)
        qdd = (inverse @ (tau - h)[..., None])[..., 0]
        spread = np.abs(M) @ np.abs(qdd)[..., None] + (np.abs(tau) + np.abs(h))[..., None]
        grown = (np.abs(inverse) @ spread)[..., 0].max(axis=-1, initial=0.0)
        found = np.where(grown > 0, grown / np.abs(qdd).max(axis=-1, initial=0.0), 1.0)
    return np.where(np.isfinite(found), found, np.inf)


def pivots_below(units: float, pivots: Array, diagonal: Array) -> Array:
    """Where a pivot of M is at most `units` n eps of M's diagonal entry, or not a number at all, shape (..., n)."""
    pivots, diagonal = pivots.real, diagonal.real
    eps = float(np.finfo(pivots.dtype).eps) if pivots.dtype != object else 0.0
    return ~np.asarray(pivots > units * pivots.shape[-1] * eps * diagonal, dtype=bool)


def may_be_fast(qd: Array) -> bool:
    """True if rates may exceed eps^(-1/4), whose square leaves half the digits of the dtype.

    By the sum of their squares, which is cheap and never too small.
    """
    return not float(np.vdot(qd, qd)) <= float(np.finfo(qd.dtype).eps) ** -0.5


def warn_if_fast(model: Model, q: ArrayLike, qd: ArrayLike, tau: ArrayLike, qdd: Array) -> None:
    """`warn_of_few_digits` for what a kernel returned, which has looked at M and not at the rates."""
    rates = np.asarray(qd, dtype=qdd.dtype)
    if rates.dtype.kind == "f" and may_be_fast(rates):
        warn_of_few_digits(model, np.asarray(q), rates, np.asarray(tau), qdd)


def warn_of_few_digits(
    model: Model, q: Array, qd: Array, tau: Array, qdd: Array, doubtful: Array | None = None
) -> None:
    """A PrecisionWarning if fewer than FEWEST digits are left in a state that is fast or marked as doubtful."""
    if qdd.dtype.kind != "f":
        return
    eps = float(np.finfo(qdd.dtype).eps)
    looked_at = np.zeros(qdd.shape[:-1], dtype=bool) if doubtful is None else doubtful
    if qd.dtype.kind == "f" and may_be_fast(qd):
        looked_at = looked_at | (np.abs(qd).max(axis=-1, initial=0.0) > eps**-0.25)
    if not looked_at.any():
        return
    states = [np.broadcast_to(a, qdd.shape)[looked_at].astype(np.float64) for a in (q, qd, tau)]
    lost = eps * amplifications(model, *states)
    k = int(np.argmax(lost))
    digits = max(0.0, -float(np.log10(lost[k])))
    if digits >= FEWEST:
        return
    state = tuple(int(i) for i in np.argwhere(looked_at)[k])
    near = doubtful is not None and bool(doubtful[state])
    cause = "M is nearly singular" if near else f"the torques and C qd + g cancel at {np.abs(states[1][k]).max():.1e}/s"
    where = f" at state {state}" if state else ""
    text = f"forward dynamics keep about {digits:.0f} digits{where}: {cause}; see Robot.diagnose"
    warnings.warn(text, PrecisionWarning, stacklevel=_depth_of_caller())


def _depth_of_caller() -> int:
    """Frames from the one that warns to the first outside the package, whose line the warning is to show."""
    package, frame, depth = str(Path(__file__).parents[1]), sys._getframe(1), 1
    while frame.f_back is not None and frame.f_code.co_filename.startswith(package):
        frame, depth = frame.f_back, depth + 1
    return depth
