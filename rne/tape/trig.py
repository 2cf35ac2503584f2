"""Sine and cosine of whole registers: from NumPy's sin and cos, or both from one tangent of half the angle.

sin = 2 t / (1 + t^2) and cos = (1 - t^2) / (1 + t^2) with t = tan(q / 2), to an absolute error of 2 eps. Near
q = +-pi t is large but finite, since no floating-point number is an odd multiple of pi / 2. Where NumPy has a fast
tangent, as on AVX-512, this is several times faster; which one runs is measured once, where it runs.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np

from ..spatial import Array

Call = tuple[Callable[..., Any], tuple[Any, ...]]


def by_functions(angle: Array, sin: Array, cos: Array, spare: Array, half: Array, one: Array) -> list[Call]:
    """Calls for NumPy's own sine and cosine."""
    return [(np.sin, (angle, sin)), (np.cos, (angle, cos))]


def by_tangent(angle: Array, sin: Array, cos: Array, spare: Array, half: Array, one: Array) -> list[Call]:
    """Calls for both from one tangent; `sin`, `cos` and `spare` are distinct from each other and from `angle`."""
    return [
        (np.multiply, (angle, half, sin)),
        (np.tan, (sin, sin)),
        (np.multiply, (sin, sin, cos)),
        (np.add, (cos, one, spare)),
        (np.subtract, (one, cos, cos)),
        (np.divide, (cos, spare, cos)),
        (np.add, (sin, sin, sin)),
        (np.divide, (sin, spare, sin)),
    ]


METHODS = {"functions": by_functions, "tangent": by_tangent}


@cache
def faster(dtype: str) -> str:
    """The faster of the two methods for this dtype, measured once in this process."""
    angle = np.linspace(-3.0, 3.0, 4096, dtype=dtype)
    sin, cos, spare = (np.empty_like(angle) for _ in range(3))
    half, one = np.array(0.5, dtype=dtype), np.array(1.0, dtype=dtype)

    def cost(method: str) -> float:
        calls = METHODS[method](angle, sin, cos, spare, half, one)
        best = float("inf")
        for _ in range(5):
            start = time.perf_counter()
            for call, arguments in calls:
                call(*arguments)
            best = min(best, time.perf_counter() - start)
        return best

    return min(METHODS, key=cost)
