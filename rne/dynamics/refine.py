"""Iterative refinement of forward dynamics: digits that rounding has taken, for the price of M and bias in long double.

With the residual in more digits than the accelerations, each pass multiplies the error by about eps times M's
condition: Wilkinson 1963, Rounding Errors in Algebraic Processes, section 3.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ..model import Model
from ..spatial import Array
from .composite import mass_matrix
from .newton_euler import External, bias_torque

# Digits that long double has more than double.
WON = float(np.log10(np.finfo(np.float64).eps / np.finfo(np.longdouble).eps))


def refine(
    model: Model,
    solve: Callable[[Array, Array], Array],
    state: tuple[Array, Array, Array],
    qdd: Array,
    passes: int,
    external: External | None = None,
) -> Array:
    """Accelerations after some passes of refinement, in their own dtype.

    The residual tau - M qdd - (C qd + g) is taken in long double; where `np.longdouble` has no more digits than
    float64, nothing is gained.

    Parameters
    ----------
    model : Model
    solve : callable
        M^-1 of a torque: f(q, residual).
    state : tuple of ndarray
        q, qd, tau.
    qdd : ndarray, shape (..., n)
        What forward dynamics gave.
    passes : int
    external : mapping of str to ndarray, optional
    """
    if isinstance(passes, bool) or not isinstance(passes, int | np.integer) or passes < 0:
        raise ValueError(f"`refine` must be a whole number, at least 0, got {passes!r}")
    if qdd.dtype not in (np.float32, np.float64):
        raise ValueError(
            f"`refine` is for float32 and float64, whose residual is taken in long double; got {qdd.dtype}"
        )
    q, qd, tau = (np.asarray(x, dtype=qdd.dtype) for x in state)
    M = mass_matrix(model, q.astype(np.longdouble))
    h = bias_torque(model, q.astype(np.longdouble), qd.astype(np.longdouble), external=external)
    better = qdd.astype(np.longdouble)
    for _ in range(passes):
        residual = tau - h - (M * better[..., None, :]).sum(axis=-1)
        better = better + solve(q, residual.astype(qdd.dtype))
    return better.astype(qdd.dtype)
