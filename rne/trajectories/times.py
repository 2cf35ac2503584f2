"""Times at which a reference motion is evaluated."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from ..basics.arrays import real_array
from ..basics.spatial import Array


def is_traced(times: Array) -> bool:
    """True for an array of traced numbers, which stand for times that are not known yet."""
    return times.dtype == object and all(hasattr(x, "__truediv__") for x in times.flat)


def broadcast_times(t: ArrayLike) -> Array:
    """Times in a shape that broadcasts against (n,); traced numbers are passed on unchecked."""
    times = np.asarray(t)
    if not is_traced(times):
        times = real_array("t", times, "(T,)")
    return times if times.ndim == 0 or times.shape[-1] == 1 else times[..., None]
