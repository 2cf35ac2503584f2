"""Sine and cosine of whole registers: from NumPy's sin and cos, or both from one tangent of half the angle.

With t = tan(q / 2) and r = 2 / (1 + t^2), sin = t r and cos = r - 1, to an absolute error of 2 eps. Near
q = +-pi t is large but finite, since no floating-point number is an odd multiple of pi / 2. Where NumPy has a
vectorised tangent, as on AVX-512, this is several times faster in float64.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np

from ..basics.spatial import Array

Call = tuple[Callable[..., Any], tuple[Any, ...]]


def by_functions(angle: Array, sin: Array, cos: Array, number: Callable[[float], Array]) -> list[Call]:
    """Calls for NumPy's own sine and cosine."""
    return [(np.sin, (angle, sin)), (np.cos, (angle, cos))]


def by_tangent(angle: Array, sin: Array, cos: Array, number: Callable[[float], Array]) -> list[Call]:
    """Calls for both from one tangent; `sin` and `cos` are distinct from each other and from `angle`."""
    one = number(1.0)
    return [
        (np.multiply, (angle, number(0.5), sin)),
        (np.tan, (sin, sin)),
        (np.multiply, (sin, sin, cos)),
        (np.add, (cos, one, cos)),
        (np.divide, (number(2.0), cos, cos)),  # r = 2 / (1 + t^2)
        (np.multiply, (sin, cos, sin)),  # t r
        (np.subtract, (cos, one, cos)),  # r - 1
    ]


METHODS = {"functions": by_functions, "tangent": by_tangent}


@cache
def faster(dtype: str) -> str:
    """The faster of the two methods for this dtype, by the instructions that NumPy uses here for its tangent.

    In float32 sine and cosine are vectorised wherever the tangent is, and two of them cost less than the formulas.
    """
    tangents = np.lib.introspect.opt_func_info(func_name="^tan$").get("tan", {})
    vectorised = not tangents.get("dd", {}).get("current", "baseline").startswith("baseline")
    return "tangent" if vectorised and dtype == "float64" else "functions"
