"""How many digits forward dynamics keep, and a warning where they are few."""

from __future__ import annotations

import sys
import warnings
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from contextvars import ContextVar
from pathlib import Path
from typing import NamedTuple

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


class Few(NamedTuple):
    """The state of a call with the fewest digits, and why."""

    digits: float
    state: tuple[int, ...]
    cause: str


_gathered: ContextVar[list[Few] | None] = ContextVar("gathered", default=None)


def amplifications(model: Model, q: Array, qd: Array, tau: Array, external: Mapping[str, Array] | None = None) -> Array:
    """By how much relative errors in M, C qd + g and tau grow in qdd = M^-1 (tau - C qd - g), shape (...).

    Skeel 1979, componentwise: max |M^-1| (|M| |qdd| + |tau| + |C qd + g|) / max |qdd|. Infinite where it overflows or
    M cannot be inverted.
    """
    double = model.astype(np.float64)
    with np.errstate(all="ignore"):
        M, h = mass_matrix.core(double, q), bias_torque.core(double, q, qd, external=external)
        inverse = _inverse(M)
        qdd = (inverse @ (tau - h)[..., None])[..., 0]
        spread = np.abs(M) @ np.abs(qdd)[..., None] + (np.abs(tau) + np.abs(h))[..., None]
        grown = (np.abs(inverse) @ spread)[..., 0].max(axis=-1, initial=0.0)
        found = np.where(grown == 0, 1.0, grown / np.abs(qdd).max(axis=-1, initial=0.0))
    return np.where(np.isfinite(found), found, np.inf)


def _inverse(M: Array) -> Array:
    """Of each state; NaN where there is none."""
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


def pivots_below(units: float, pivots: Array, diagonal: Array) -> Array:
    """Where a pivot of M is at most `units` n eps of M's diagonal entry, or not a number at all, shape (..., n)."""
    pivots, diagonal = pivots.real, diagonal.real
    eps = float(np.finfo(pivots.dtype).eps) if pivots.dtype != object else 0.0
    return ~np.asarray(pivots > units * pivots.shape[-1] * eps * diagonal, dtype=bool)


def may_be_fast(qd: ArrayLike) -> bool:
    """True if rates may exceed eps^(-1/4), whose square leaves half the digits of the dtype.

    By the sum of their squares, which is cheap and never too small.
    """
    try:
        rates = np.asarray(qd)
    except ValueError:
        return False  # no array: said where arguments are checked
    if rates.dtype.kind in "iu":
        rates = rates.astype(np.float64)
    if rates.dtype.kind != "f":
        return False
    return not float(np.vdot(rates, rates)) <= float(np.finfo(rates.dtype).eps) ** -0.5


def warn_of_few_digits(
    model: Model,
    state: tuple[ArrayLike, ArrayLike, ArrayLike],
    qdd: Array,
    doubtful: Array | None = None,
    external: Mapping[str, Array] | None = None,
) -> None:
    """A PrecisionWarning if fewer than FEWEST digits are left in a state (q, qd, tau) that is fast or doubtful."""
    if qdd.dtype.kind != "f":
        return
    eps = float(np.finfo(qdd.dtype).eps)
    q, qd, tau = (np.broadcast_to(np.asarray(a), qdd.shape) for a in state)
    looked_at = np.zeros(qdd.shape[:-1], dtype=bool) if doubtful is None else doubtful
    if may_be_fast(qd):
        looked_at = looked_at | (np.abs(qd).max(axis=-1, initial=0.0) > eps**-0.25)
    if not looked_at.any():
        return
    few = [a[looked_at].astype(np.float64) for a in (q, qd, tau)]
    wrenches = {
        link: np.broadcast_to(wrench, (*qdd.shape[:-1], 6))[looked_at].astype(np.float64)
        for link, wrench in (external or {}).items()
    }
    lost = eps * amplifications(model, few[0], few[1], few[2], wrenches or None)
    k = int(np.argmax(lost))
    where = tuple(int(i) for i in np.argwhere(looked_at)[k])
    near = doubtful is not None and bool(doubtful[where])
    cause = "M is nearly singular" if near else f"the torques and C qd + g cancel at {np.abs(few[1][k]).max():.1e}/s"
    give([Few(max(0.0, -float(np.log10(lost[k]))), where, cause)])


def give(found: list[Few], won: float = 0.0) -> None:
    """The worst as a warning, if it has fewer than FEWEST digits and `won`, or to whoever gathers them."""
    found = [few._replace(digits=few.digits + won) for few in found]
    found = [few for few in found if few.digits < FEWEST]
    if not found:
        return
    worst = min(found, key=lambda few: (few.digits, few.state))
    gathered = _gathered.get()
    if gathered is not None:
        gathered.append(worst)
        return
    where = f" at state {worst.state}" if worst.state else ""
    text = f"forward dynamics keep about {worst.digits:.0f} digits{where}: {worst.cause}; see Robot.diagnose"
    warnings.warn(text, PrecisionWarning, stacklevel=_depth_of_caller())


@contextmanager
def gather() -> Iterator[list[Few]]:
    """What would be warned of within, in a list."""
    found: list[Few] = []
    token = _gathered.set(found)
    try:
        yield found
    finally:
        _gathered.reset(token)


def _depth_of_caller() -> int:
    """Frames from the one that warns to the first outside the package, whose line the warning is to show."""
    package, frame, depth = str(Path(__file__).parents[1]), sys._getframe(1), 1
    while frame.f_back is not None and frame.f_code.co_filename.startswith(package):
        frame, depth = frame.f_back, depth + 1
    return depth
