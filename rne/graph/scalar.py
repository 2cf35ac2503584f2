"""Traced numbers: arithmetic on them is recorded in a graph."""

from __future__ import annotations

import math
import numbers
from collections.abc import Callable, Iterable
from typing import Any

import numpy as np

from ..basics.spatial import Array
from .graph import Graph

MAX_POWER = 64


def _operator(operation: Callable[[Graph, int, int], int]) -> Callable[[Scalar, Any], Scalar]:
    """Operator of a traced number and another number; an array takes it entry by entry."""

    def method(self: Scalar, other: Any) -> Scalar:
        if type(other) is Scalar:
            ref = other.ref
        elif type(other) is float:
            ref = self.graph.constant(other)
        elif isinstance(other, np.ndarray):
            return NotImplemented  # type: ignore[no-any-return]
        else:
            ref = self._other(other)
        result = operation(self.graph, self.ref, ref)
        return self if result == self.ref else Scalar(self.graph, result)

    return method


def _elementary(kind: str) -> Callable[[Scalar], Scalar]:
    """Elementary function of a traced number."""
    return lambda x: Scalar(x.graph, x.graph.unary(kind, x.ref))


class Scalar:
    """Traced number: arithmetic on it adds operations to its graph.

    It has no value. An operation that needs one (a branch, float(), conversion to an array) raises TypeError instead
    of freezing one outcome into the kernel.
    """

    __slots__ = ("graph", "ref")

    def __init__(self, graph: Graph, ref: int) -> None:
        self.graph = graph
        self.ref = ref

    def __array_ufunc__(self, ufunc: np.ufunc, method: str, *inputs: Any, **options: Any) -> Any:
        """Apply a NumPy function entry by entry, by the methods below."""
        if method != "__call__" or options:
            return NotImplemented
        return ufunc(*[_as_entry(x) if isinstance(x, Scalar) else _in_double(x) for x in inputs])

    def _other(self, other: Any) -> int:
        if isinstance(other, Scalar):
            return other.ref
        if type(other) in (float, int) or isinstance(other, numbers.Real | np.bool_):
            return self.graph.constant(float(other))
        raise TypeError(f"a traced number cannot be combined with {type(other).__name__}")

    __add__ = __radd__ = _operator(Graph.add)
    __sub__ = _operator(lambda graph, x, y: graph.add(x, y ^ 1))
    __rsub__ = _operator(lambda graph, x, y: graph.add(x ^ 1, y))
    __mul__ = __rmul__ = _operator(Graph.multiply)
    __truediv__ = _operator(Graph.divide)
    __rtruediv__ = _operator(lambda graph, x, y: graph.divide(y, x))
    __lt__ = _operator(lambda graph, x, y: graph.binary("less", x, y))
    __gt__ = _operator(lambda graph, x, y: graph.binary("less", y, x))
    __le__ = _operator(lambda graph, x, y: graph.binary("less_equal", x, y))
    __ge__ = _operator(lambda graph, x, y: graph.binary("less_equal", y, x))

    def __neg__(self) -> Scalar:
        return Scalar(self.graph, self.ref ^ 1)

    def __pos__(self) -> Scalar:
        return self

    conjugate = __pos__  # np.vecdot and np.linalg.norm along an axis ask for it

    def __pow__(self, power: Any) -> Scalar:
        p = float(power) if isinstance(power, numbers.Real) else float("nan")
        if p.is_integer() and abs(p) <= MAX_POWER:
            return self._whole_power(int(p)) if p >= 0 else 1.0 / self._whole_power(int(-p))
        if p == 0.5:
            return self.sqrt()
        raise TypeError(f"a traced number can be raised to whole powers up to {MAX_POWER} and to 0.5, not to {power!r}")

    def _whole_power(self, k: int) -> Scalar:
        """Power with a whole exponent by repeated squaring."""
        if k == 0:
            return Scalar(self.graph, self.graph.constant(1.0))
        half = self._whole_power(k // 2) if k > 1 else None
        if half is None:
            return self
        return half * half * self if k % 2 else half * half

    # By these names NumPy's functions, and for some of them rne.elementwise, ask the entries of an object array.
    __abs__, sin, cos, sqrt, tanh, exp, sign = map(_elementary, ("abs", "sin", "cos", "sqrt", "tanh", "exp", "sign"))
    minimum = _operator(lambda graph, x, y: graph.binary("minimum", x, y))
    maximum = _operator(lambda graph, x, y: graph.binary("maximum", x, y))
    arctan2 = _operator(Graph.arctan2)

    def where(self, a: Any, b: Any) -> Scalar:
        """`a` where this number is not 0, `b` elsewhere."""
        return Scalar(self.graph, self.graph.where(self.ref, self._other(a), self._other(b)))

    def single(self) -> Single:
        """Traced number with the type of numbers that rne.elementwise returns."""
        return Single(self.graph, self.ref)

    def _no_value(self, *_: Any, **__: Any) -> Any:
        raise TypeError(
            "a traced number has no value: a branch, float() or array conversion would freeze one outcome; "
            "rne.elementwise has where, less, minimum, maximum, clip and sign for this"
        )

    __bool__ = __float__ = __int__ = __index__ = _no_value
    __eq__ = __ne__ = _no_value
    __hash__ = None  # type: ignore[assignment]

    def __getattr__(self, name: str) -> Any:
        raise AttributeError(
            f"a traced number has no {name!r}, only NumPy's sin, cos, sqrt and rne.elementwise's functions"
        )

    def __repr__(self) -> str:
        return f"Scalar({'-' if self.ref & 1 else ''}{self.graph.nodes[self.ref >> 1].kind})"


class Single(Scalar):
    """Traced number with the subscripts () and None of a NumPy number, as NumPy takes others for sequences then."""

    __slots__ = ()
    __iter__ = None

    def __getitem__(self, index: Any) -> Any:
        return _as_entry(self)[index]


def _as_entry(x: Scalar) -> Array:
    array = np.empty((), dtype=object)  # np.array would ask x for an array
    array[()] = x
    return array


def _in_double(x: Any) -> Any:
    """Long double numbers as doubles: as entries they would call NumPy's function again, without end."""
    return x.astype(np.float64) if getattr(x, "dtype", None) == np.longdouble else x


def inputs(graph: Graph, shape: tuple[int, ...], start: int, *of: Any) -> Array:
    """Object array of traced inputs, numbered from `start`; of an outline, results `of` a kernel."""
    numbered = [Scalar(graph, graph.node("input", start + k, *of)) for k in range(math.prod(shape))]
    return np.array(numbered, dtype=object).reshape(shape)


def references(graph: Graph, array: Array) -> list[int]:
    """References of an array of traced numbers and plain ones."""
    entries = [x[()] if isinstance(x, np.ndarray) else x for x in np.asarray(array).flat]  # np.array nests those of ()
    return [x.ref if isinstance(x, Scalar) else graph.constant(float(x)) for x in entries]


def _entries(array: Any) -> Iterable[Any]:
    """Entries of an array of objects or of a list."""
    is_array = isinstance(array, np.ndarray) and array.dtype == object
    return array.flat if is_array else array if isinstance(array, list) else ()


def is_traced(array: Any) -> bool:
    """True for an array or a list that holds traced numbers."""
    return any(isinstance(x, Scalar) for x in _entries(array))


def is_present(value: Any) -> bool:
    """True if an entry is traced or not zero, so that what it multiplies must be computed."""
    array = np.asarray(value)
    return any(isinstance(x, Scalar) or x != 0 for x in array.flat) if array.dtype == object else bool(array.any())


def outline_of(arrays: Iterable[Any]) -> Graph | None:
    """Graph of traced numbers if it is an outline."""
    graph = next(x.graph for array in arrays for x in _entries(array) if isinstance(x, Scalar))
    return graph if graph.is_outline else None
