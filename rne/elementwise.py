"""Elementwise functions for control laws and friction that can be traced, where NumPy's own would need values.

A branch written with `where` remains a branch in the kernel.
"""

from __future__ import annotations

import operator
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from .basics.spatial import Array


def _on_objects(name: str, inputs: int) -> Any:
    """The method `name` of traced numbers, the NumPy function of any others, entry by entry."""
    plain = getattr(np, name)

    def apply(*x: Any) -> Any:
        for k, first in enumerate(x[:2] if name != "where" else x[:1]):
            if hasattr(first, name):
                return getattr(first, name)(*x[:k], *x[k + 1 :])
        return plain(*x)[()]

    return np.frompyfunc(apply, inputs, 1)


def _arctan2(y: Any, x: Any) -> Any:
    """The angle of one vector, of which either component may be traced."""
    if hasattr(x, "arctan2") and not hasattr(y, "arctan2"):
        y = y + 0 * x
    return y.arctan2(x) if hasattr(y, "arctan2") else np.arctan2(y, x)


_OBJECTS = {name: _on_objects(name, 1) for name in ("exp", "tanh", "sign")}
_OBJECTS |= {name: _on_objects(name, 2) for name in ("minimum", "maximum")}
_OBJECTS["where"] = _on_objects("where", 3)
_object_arctan2 = np.frompyfunc(_arctan2, 2, 1)
_object_less = np.frompyfunc(operator.lt, 2, 1)


def _apply(name: str, *x: ArrayLike) -> Array:
    arrays = [np.asarray(a) for a in x]
    function = _OBJECTS[name] if any(a.dtype == object for a in arrays) else getattr(np, name)
    return np.asarray(function(*arrays))


def tanh(x: ArrayLike) -> Array:
    """Hyperbolic tangent, elementwise.

    Parameters
    ----------
    x : array_like
        Numbers or traced numbers.

    Returns
    -------
    ndarray, shape of x
        Between -1 and 1; a smooth replacement of `sign`, tanh(x / width).

    Examples
    --------
    >>> from rne.elementwise import tanh
    >>> tanh([-100.0, 0.0, 100.0]).tolist()
    [-1.0, 0.0, 1.0]
    """
    return _apply("tanh", x)


def exp(x: ArrayLike) -> Array:
    """Exponential function, elementwise.

    Parameters
    ----------
    x : array_like
        Numbers or traced numbers.

    Returns
    -------
    ndarray, shape of x
        Positive numbers.

    Examples
    --------
    >>> from rne.elementwise import exp
    >>> exp([0.0, 1.0]).round(6).tolist()
    [1.0, 2.718282]
    """
    return _apply("exp", x)


def arctan2(y: ArrayLike, x: ArrayLike) -> Array:
    """Angle of the vector (x, y), entry by entry.

    Parameters
    ----------
    y, x : array_like
        Numbers or traced numbers, broadcast against each other.

    Returns
    -------
    ndarray
        Of the broadcast shape, from -pi to pi [rad]. On the cut itself, where y is 0 and x negative, a kernel may give
        either of both.

    Examples
    --------
    >>> from rne.elementwise import arctan2
    >>> arctan2([0.0, 1.0], [1.0, 0.0]).round(6).tolist()
    [0.0, 1.570796]
    """
    if any(np.asarray(a).dtype == object for a in (y, x)):
        return np.asarray(_object_arctan2(y, x))
    return np.asarray(np.arctan2(y, x))


def sign(x: ArrayLike) -> Array:
    """Sign of each entry.

    Parameters
    ----------
    x : array_like
        Numbers or traced numbers.

    Returns
    -------
    ndarray, shape of x
        -1, 0 or 1.

    Examples
    --------
    >>> from rne.elementwise import sign
    >>> sign([-3.0, 0.0, 2.0]).tolist()
    [-1.0, 0.0, 1.0]
    """
    return _apply("sign", x)


def minimum(a: ArrayLike, b: ArrayLike) -> Array:
    """The smaller of two arrays, entry by entry.

    Parameters
    ----------
    a, b : array_like
        Numbers or traced numbers, broadcast against each other.

    Returns
    -------
    ndarray
        Of the broadcast shape.

    Examples
    --------
    >>> from rne.elementwise import minimum
    >>> minimum([1.0, 5.0], 3.0).tolist()
    [1.0, 3.0]
    """
    return _apply("minimum", a, b)


def maximum(a: ArrayLike, b: ArrayLike) -> Array:
    """The larger of two arrays, entry by entry.

    Parameters
    ----------
    a, b : array_like
        Numbers or traced numbers, broadcast against each other.

    Returns
    -------
    ndarray
        Of the broadcast shape.

    Examples
    --------
    >>> from rne.elementwise import maximum
    >>> maximum([1.0, 5.0], 3.0).tolist()
    [3.0, 5.0]
    """
    return _apply("maximum", a, b)


def less(a: ArrayLike, b: ArrayLike) -> Array:
    """True where a < b, for the condition of `where`.

    Parameters
    ----------
    a, b : array_like
        Numbers or traced numbers, broadcast against each other.

    Returns
    -------
    ndarray
        Of the broadcast shape: booleans, or traced conditions.

    Examples
    --------
    >>> from rne.elementwise import less
    >>> less([1.0, 5.0], 3.0).tolist()
    [True, False]
    """
    if any(np.asarray(x).dtype == object for x in (a, b)):
        return np.asarray(_object_less(a, b))
    return np.less(a, b)


def where(condition: ArrayLike, a: ArrayLike, b: ArrayLike) -> Array:
    """Choose between two arrays, entry by entry; both are computed, and the branch remains in a kernel.

    Parameters
    ----------
    condition : array_like
        What `less` returns, or booleans.
    a : array_like
        Values where the condition holds.
    b : array_like
        Values elsewhere.

    Returns
    -------
    ndarray
        Of the broadcast shape.

    Examples
    --------
    >>> from rne.elementwise import less, where
    >>> where(less([1.0, 5.0], 3.0), 0.0, [7.0, 8.0]).tolist()
    [0.0, 8.0]
    """
    return _apply("where", condition, a, b)


def clip(x: ArrayLike, lower: ArrayLike, upper: ArrayLike) -> Array:
    """Limit an array to a range, entry by entry.

    Parameters
    ----------
    x : array_like
        Numbers or traced numbers.
    lower, upper : array_like
        The range, broadcast against `x`.

    Returns
    -------
    ndarray
        Of the broadcast shape.

    Examples
    --------
    >>> from rne.elementwise import clip
    >>> clip([-50.0, 5.0, 50.0], -20.0, 20.0).tolist()
    [-20.0, 5.0, 20.0]
    """
    return minimum(maximum(x, lower), upper)
