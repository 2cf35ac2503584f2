"""Traced numbers: arithmetic on them is recorded in a graph."""

from __future__ import annotations

import numbers
from typing import Any

import numpy as np

from ..basics.spatial import Array
from .graph import Graph


class Scalar:
    """A traced number: arithmetic on it adds operations to its graph.

    It has no value. An operation that needs one (a branch, float(), conversion to an array) raises TypeError instead
    of freezing one outcome into the kernel.
    """

    __slots__ = ("graph", "ref")
    __array_ufunc__ = None  # NumPy's own scalars defer to the methods below

    def __init__(self, graph: Graph, ref: int) -> None:
        self.graph = graph
        self.ref = ref

    def _other(self, other: Any) -> int:
        if isinstance(other, Scalar):
            return other.ref
        if isinstance(other, numbers.Real | np.bool_):
            return self.graph.constant(float(other))
        raise TypeError(
            f"a traced number cannot be combined with {type(other).__name__}; index arrays with [..., i, None]"
        )

    def __add__(self, other: Any) -> Scalar:
        return Scalar(self.graph, self.graph.add(self.ref, self._other(other)))

    __radd__ = __add__

    def __sub__(self, other: Any) -> Scalar:
        return Scalar(self.graph, self.graph.add(self.ref, self._other(other) ^ 1))

    def __rsub__(self, other: Any) -> Scalar:
        return Scalar(self.graph, self.graph.add(self.ref ^ 1, self._other(other)))

    def __mul__(self, other: Any) -> Scalar:
        return Scalar(self.graph, self.graph.multiply(self.ref, self._other(other)))

    __rmul__ = __mul__

    def __truediv__(self, other: Any) -> Scalar:
        return Scalar(self.graph, self.graph.divide(self.ref, self._other(other)))

    def __rtruediv__(self, other: Any) -> Scalar:
        return Scalar(self.graph, self.graph.divide(self._other(other), self.ref))

    def __neg__(self) -> Scalar:
        return Scalar(self.graph, self.ref ^ 1)

    def __pos__(self) -> Scalar:
        return self

    def __abs__(self) -> Scalar:
        return self._unary("abs")

    def __pow__(self, power: Any) -> Scalar:
        if power == 2:
            return self * self
        raise TypeError(f"a traced number can be squared, not raised to the power {power!r}")

    def _unary(self, kind: str) -> Scalar:
        return Scalar(self.graph, self.graph.unary(kind, self.ref))

    def sin(self) -> Scalar:
        """For np.sin on object arrays."""
        return self._unary("sin")

    def cos(self) -> Scalar:
        """For np.cos on object arrays."""
        return self._unary("cos")

    def sqrt(self) -> Scalar:
        """For np.sqrt on object arrays."""
        return self._unary("sqrt")

    def tanh(self) -> Scalar:
        """For np.tanh on object arrays."""
        return self._unary("tanh")

    def sign(self) -> Scalar:
        """-1, 0 or 1."""
        return self._unary("sign")

    def minimum(self, other: Any) -> Scalar:
        """The smaller of two numbers."""
        return Scalar(self.graph, self.graph.binary("minimum", self.ref, self._other(other)))

    def maximum(self, other: Any) -> Scalar:
        """The larger of two numbers."""
        return Scalar(self.graph, self.graph.binary("maximum", self.ref, self._other(other)))

    def where(self, a: Any, b: Any) -> Scalar:
        """`a` where this number is not 0, `b` elsewhere."""
        return Scalar(self.graph, self.graph.where(self.ref, self._other(a), self._other(b)))

    def __lt__(self, other: Any) -> Scalar:
        return Scalar(self.graph, self.graph.binary("less", self.ref, self._other(other)))

    def __gt__(self, other: Any) -> Scalar:
        return Scalar(self.graph, self.graph.binary("less", self._other(other), self.ref))

    def __le__(self, other: Any) -> Scalar:
        return Scalar(self.graph, self.graph.binary("less_equal", self.ref, self._other(other)))

    def __ge__(self, other: Any) -> Scalar:
        return Scalar(self.graph, self.graph.binary("less_equal", self._other(other), self.ref))

    def _no_value(self, *_: Any, **__: Any) -> Any:
        raise TypeError("a traced number has no value: a branch, float() or array conversion would freeze one outcome")

    __bool__ = __float__ = __int__ = __index__ = __array__ = _no_value
    __eq__ = __ne__ = _no_value
    __hash__ = None  # type: ignore[assignment]

    def __repr__(self) -> str:
        return f"Scalar({'-' if self.ref & 1 else ''}{self.graph.nodes[self.ref >> 1].kind})"


def inputs(graph: Graph, shape: tuple[int, ...], start: int) -> Array:
    """An object array of traced inputs, numbered from `start`."""
    count = int(np.prod(shape))
    array = np.empty(count, dtype=object)
    for k in range(count):
        array[k] = Scalar(graph, graph.input(start + k))
    return array.reshape(shape)


def references(graph: Graph, array: Array) -> list[int]:
    """The references of an array of traced numbers and plain ones."""
    return [x.ref if isinstance(x, Scalar) else graph.constant(float(x)) for x in np.asarray(array).flat]


def is_traced(array: Any) -> bool:
    """True for an array that holds traced numbers."""
    return isinstance(array, np.ndarray) and array.dtype == object and any(isinstance(x, Scalar) for x in array.flat)
