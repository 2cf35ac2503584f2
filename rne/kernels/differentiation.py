"""Exact derivatives of a graph by the chain rule, in the same graph."""

from __future__ import annotations

from collections.abc import Callable

from .graph import COMPARISONS, Graph


def differentiate(graph: Graph, outputs: list[int], inputs: list[int]) -> list[int]:
    """References of d output / d input, output by output, each by all inputs, which are given by their numbers.

    Forward mode: from each input through the operations that depend on it. Zeros and repeated terms are folded away.
    """
    operations = sorted(graph.needed(outputs))
    columns = [_column(graph, operations, outputs, k) for k in inputs]
    return [column[i] for i in range(len(outputs)) for column in columns]


def _column(graph: Graph, operations: list[int], outputs: list[int], k: int) -> list[int]:
    """Derivatives of the outputs by input k."""
    zero = graph.constant(0.0)
    slopes = {graph.input(k) >> 1: graph.constant(1.0)}  # of the nodes that depend on it
    for index in operations:
        args = graph.nodes[index].args
        if any(ref >> 1 in slopes for ref in args):
            slope = _slope(graph, index, [_signed(graph, slopes.get(ref >> 1, zero), ref) for ref in args])
            if slope != zero:
                slopes[index] = slope
    return [_signed(graph, slopes.get(ref >> 1, zero), ref) for ref in outputs]


def _signed(graph: Graph, slope: int, ref: int) -> int:
    """The slope of a reference from that of its node."""
    return graph.negate(slope) if ref & 1 else slope


def _slope(graph: Graph, index: int, slopes: list[int]) -> int:
    """The derivative of one operation from those of its arguments; 0 of signs and comparisons."""
    kind, args = graph.nodes[index]
    if kind == "where":
        return graph.where(args[0], *slopes[1:])
    if kind == "sign" or kind in COMPARISONS:
        return graph.constant(0.0)
    return RULES[kind](graph, 2 * index, args[0], slopes[0], args[-1], slopes[-1])


def _times(g: Graph, a: int, slope: int) -> int:
    """a times a slope; of what does not depend on the input there is no term, whatever a is."""
    return slope if g.value(slope) == 0 else g.multiply(a, slope)


def _quotient(g: Graph, value: int, a: int, da: int, b: int, db: int) -> int:
    return g.divide(g.add(da, g.negate(_times(g, value, db))), b)


def _angle(g: Graph, value: int, y: int, dy: int, x: int, dx: int) -> int:
    """(x dy - y dx) / (x^2 + y^2)."""
    turn = g.add(_times(g, x, dy), g.negate(_times(g, y, dx)))
    return g.divide(turn, g.add(g.multiply(x, x), g.multiply(y, y)))


# d value of value = f(a, b), or f(a), from da and db
RULES: dict[str, Callable[[Graph, int, int, int, int, int], int]] = {
    "add": lambda g, v, a, da, b, db: g.add(da, db),
    "subtract": lambda g, v, a, da, b, db: g.add(da, g.negate(db)),
    "multiply": lambda g, v, a, da, b, db: g.add(_times(g, b, da), _times(g, a, db)),
    "divide": _quotient,
    "arctan2": _angle,
    "minimum": lambda g, v, a, da, b, db: g.where(g.binary("less", a, b), da, db),
    "maximum": lambda g, v, a, da, b, db: g.where(g.binary("less", b, a), da, db),
    "sin": lambda g, v, a, da, *_: g.multiply(g.unary("cos", a), da),
    "cos": lambda g, v, a, da, *_: g.negate(g.multiply(g.unary("sin", a), da)),
    "negative": lambda g, v, a, da, *_: g.negate(da),
    "sqrt": lambda g, v, a, da, *_: g.divide(g.multiply(da, g.constant(0.5)), v),
    "abs": lambda g, v, a, da, *_: g.multiply(g.unary("sign", a), da),
    "tanh": lambda g, v, a, da, *_: g.multiply(g.add(g.constant(1.0), g.negate(g.multiply(v, v))), da),
    "exp": lambda g, v, a, da, *_: g.multiply(v, da),
}
