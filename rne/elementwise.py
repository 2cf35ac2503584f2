"""Elementwise functions for control laws and friction that can be traced, where NumPy's own would need values.

They take numbers and traced numbers, and are NumPy's functions of the same names. A branch written with `where` remains
a branch in the kernel: both its values are computed.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable
from functools import partial
from typing import Any, ParamSpec

import numpy as np
from numpy.typing import ArrayLike

from .basics.arrays import plain_array
from .basics.spatial import Array

P = ParamSpec("P")
# Functions that NumPy lacks for mpmath's numbers, with their names there.
OF_MPMATH = {"tanh": "tanh", "exp": "exp", "arctan2": "atan2"}
SHARED = ("tanh", "exp", "sign", "arctan2", "minimum", "maximum")  # functions of the names of operations of kernels
CHOOSING = ("sign", "less", "minimum", "maximum")  # functions that are not analytic
SECTIONS = """Parameters
----------
{names} : array_like
    Numbers or traced numbers, broadcast against each other.

Returns
-------
ndarray
    Result of the broadcast shape.

Examples
"""


def _entry(name: str, *x: Any) -> Any:
    """One entry of a result: the method of a traced number, or NumPy's function of numbers."""
    if name == "less":
        return x[0] < x[1]
    context = next((number.context for number in x if hasattr(number, "context")), None)  # mpmath's
    if context is not None and name in OF_MPMATH:
        return getattr(context, OF_MPMATH[name])(*x)
    if name in ("minimum", "maximum") and not hasattr(x[0], name):
        x = x[::-1]
    if name == "arctan2" and hasattr(x[1], name):
        x = x[0] + 0 * x[1], x[1]
    return getattr(x[0], name)(*x[1:]) if hasattr(x[0], name) else np.asarray(getattr(np, name)(*x))[()]


def _apply(name: str, **x: ArrayLike) -> Array:
    arrays = [plain_array(argument, value) for argument, value in x.items()]
    if any(array.dtype == object for array in arrays):  # of single ones the number itself, which np.array can take
        found: Any = np.frompyfunc(partial(_entry, name), len(arrays), 1)(*arrays)
        single: Array = found.single() if hasattr(found, "single") else found
        return single
    if name == "arctan2" and any(array.dtype.kind == "c" for array in arrays):  # a complex step: NumPy has reals only
        a, b = arrays
        turned = (a * b.real - b * a.real) / (b * b.real + a * a.real)  # the tangent of the rest of the angle
        return np.asarray(np.arctan2(a.real, b.real) + np.arctan(turned))
    if name in CHOOSING and any(array.dtype.kind == "c" for array in arrays):  # by real parts, as kernels do
        return _by_real_parts(name, *arrays)
    return np.asarray(getattr(np, name)(*arrays))


def _by_real_parts(name: str, a: Any, b: Any = 0.0) -> Array:
    """A function of CHOOSING of complex numbers, for complex steps; of equal real parts the second is taken."""
    if name == "sign":
        return np.asarray(np.sign(a.real).astype(a.dtype))
    first, second = (b.real, a.real) if name == "maximum" else (a.real, b.real)
    return np.asarray(first < second if name == "less" else np.where((first < second) | np.isnan(a), a, b))


def _documented(function: Callable[P, Array]) -> Callable[P, Array]:
    """Put the sections on parameters and result, which all these functions share, before the example."""
    names = ", ".join(inspect.signature(function).parameters)
    if function.__doc__:  # there is none under -OO
        text = inspect.cleandoc(function.__doc__) + "\n"  # as Python 3.13 has it, without indentation
        function.__doc__ = text.replace("Examples\n", SECTIONS.format(names=names))
    return function


@_documented
def tanh(x: ArrayLike) -> Array:
    """Hyperbolic tangent: tanh(x / width) is a smooth replacement of `sign`.

    Examples
    --------
    >>> from rne.elementwise import tanh
    >>> tanh([-100.0, 0.0, 100.0]).tolist()
    [-1.0, 0.0, 1.0]
    """
    return _apply("tanh", x=x)


@_documented
def exp(x: ArrayLike) -> Array:
    """Exponential function.

    Examples
    --------
    >>> from rne.elementwise import exp
    >>> exp([0.0, 1.0]).round(6).tolist()
    [1.0, 2.718282]
    """
    return _apply("exp", x=x)


@_documented
def arctan2(y: ArrayLike, x: ArrayLike) -> Array:
    """Angle of the vector (x, y), from -pi to pi; where y is 0 and x negative, a kernel may give either [rad].

    Examples
    --------
    >>> from rne.elementwise import arctan2
    >>> arctan2([0.0, 1.0], [1.0, 0.0]).round(6).tolist()
    [0.0, 1.570796]
    """
    return _apply("arctan2", y=y, x=x)


@_documented
def sign(x: ArrayLike) -> Array:
    """Sign of each entry: -1, 0 or 1.

    Examples
    --------
    >>> from rne.elementwise import sign
    >>> sign([-3.0, 0.0, 2.0]).tolist()
    [-1.0, 0.0, 1.0]
    """
    return _apply("sign", x=x)


@_documented
def minimum(a: ArrayLike, b: ArrayLike) -> Array:
    """The smaller of two arrays, entry by entry.

    Examples
    --------
    >>> from rne.elementwise import minimum
    >>> minimum([1.0, 5.0], 3.0).tolist()
    [1.0, 3.0]
    """
    return _apply("minimum", a=a, b=b)


@_documented
def maximum(a: ArrayLike, b: ArrayLike) -> Array:
    """The larger of two arrays, entry by entry.

    Examples
    --------
    >>> from rne.elementwise import maximum
    >>> maximum([1.0, 5.0], 3.0).tolist()
    [3.0, 5.0]
    """
    return _apply("maximum", a=a, b=b)


@_documented
def less(a: ArrayLike, b: ArrayLike) -> Array:
    """True where a < b, or traced conditions, for `where`.

    Examples
    --------
    >>> from rne.elementwise import less
    >>> less([1.0, 5.0], 3.0).tolist()
    [True, False]
    """
    return _apply("less", a=a, b=b)


@_documented
def where(condition: ArrayLike, a: ArrayLike, b: ArrayLike) -> Array:
    """Entries of a where the condition holds, which `less` returns, and of b elsewhere.

    Examples
    --------
    >>> from rne.elementwise import less, where
    >>> where(less([1.0, 5.0], 3.0), 0.0, [7.0, 8.0]).tolist()
    [0.0, 8.0]
    """
    return _apply("where", condition=condition, a=a, b=b)


@_documented
def clip(x: ArrayLike, lower: ArrayLike, upper: ArrayLike) -> Array:
    """Entries limited to the range from lower to upper.

    Examples
    --------
    >>> from rne.elementwise import clip
    >>> clip([-50.0, 5.0, 50.0], -20.0, 20.0).tolist()
    [-20.0, 5.0, 20.0]
    """
    return minimum(maximum(x, lower), upper)
