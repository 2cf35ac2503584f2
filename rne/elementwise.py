"""Elementwise functions for control laws and friction that can be traced, where NumPy's own would need values.

They take numbers and traced numbers, and are NumPy's functions of the same names. A branch written with `where` remains
a branch in the kernel: both its values are computed.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np

from .basics.arrays import plain_array
from .basics.spatial import Array

DOCSTRING = """{summary}

    Parameters
    ----------
    {names} : array_like
        Numbers or traced numbers, broadcast against each other.

    Returns
    -------
    ndarray
        Of the broadcast shape.

    Examples
    --------
    >>> from rne.elementwise import {imported}
    >>> {example}
    {result}
    """


def _entry(name: str, *x: Any) -> Any:
    """One entry of a result: the method of a traced number, or NumPy's function of numbers."""
    if name == "clip":
        return _entry("minimum", _entry("maximum", x[0], x[1]), x[2])
    if name == "less":
        return x[0] < x[1]
    if name in ("minimum", "maximum") and not hasattr(x[0], name):
        x = x[::-1]
    if name == "arctan2" and hasattr(x[1], name):
        x = x[0] + 0 * x[1], x[1]
    return getattr(x[0], name)(*x[1:]) if hasattr(x[0], name) else getattr(np, name)(*x)[()]


def _function(name: str, arguments: str, summary: str, example: str, result: str) -> Callable[..., Array]:
    """NumPy's function of a name and these arguments, for traced numbers too, with its docstring."""
    names = arguments.split(", ")
    signature = inspect.Signature([inspect.Parameter(x, inspect.Parameter.POSITIONAL_OR_KEYWORD) for x in names])
    of_arrays, of_entries = getattr(np, name), np.frompyfunc(partial(_entry, name), len(names), 1)

    def function(*given: Any, **named: Any) -> Array:
        if named or len(given) != len(names):
            given = signature.bind(*given, **named).args
        arrays = list(map(plain_array, names, given))
        traced = any([array.dtype == object for array in arrays])
        return np.asarray((of_entries if traced else of_arrays)(*arrays))

    imported = "less, where" if name == "where" else name
    function.__doc__ = DOCSTRING.format(
        summary=summary, names=arguments, imported=imported, example=example, result=result
    )
    function.__name__ = function.__qualname__ = name
    function.__signature__ = signature.replace(return_annotation=Array)  # type: ignore[attr-defined]
    return function


tanh = _function(
    "tanh",
    "x",
    "Hyperbolic tangent: tanh(x / width) is a smooth replacement of `sign`.",
    "tanh([-100.0, 0.0, 100.0]).tolist()",
    "[-1.0, 0.0, 1.0]",
)
exp = _function("exp", "x", "Exponential function.", "exp([0.0, 1.0]).round(6).tolist()", "[1.0, 2.718282]")
arctan2 = _function(
    "arctan2",
    "y, x",
    "Angle of the vector (x, y), from -pi to pi; where y is 0 and x negative, a kernel may give either [rad].",
    "arctan2([0.0, 1.0], [1.0, 0.0]).round(6).tolist()",
    "[0.0, 1.570796]",
)
sign = _function("sign", "x", "Sign of each entry: -1, 0 or 1.", "sign([-3.0, 0.0, 2.0]).tolist()", "[-1.0, 0.0, 1.0]")
minimum = _function(
    "minimum", "a, b", "The smaller of two arrays, entry by entry.", "minimum([1.0, 5.0], 3.0).tolist()", "[1.0, 3.0]"
)
maximum = _function(
    "maximum", "a, b", "The larger of two arrays, entry by entry.", "maximum([1.0, 5.0], 3.0).tolist()", "[3.0, 5.0]"
)
less = _function(
    "less",
    "a, b",
    "True where a < b, or traced conditions, for `where`.",
    "less([1.0, 5.0], 3.0).tolist()",
    "[True, False]",
)
where = _function(
    "where",
    "condition, a, b",
    "Entries of a where the condition holds, which `less` returns, and of b elsewhere.",
    "where(less([1.0, 5.0], 3.0), 0.0, [7.0, 8.0]).tolist()",
    "[0.0, 8.0]",
)
clip = _function(
    "clip",
    "x, lower, upper",
    "Entries limited to the range from lower to upper.",
    "clip([-50.0, 5.0, 50.0], -20.0, 20.0).tolist()",
    "[-20.0, 5.0, 20.0]",
)
