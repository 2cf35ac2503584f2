"""Exact derivatives of a graph by the chain rule, in the same graph."""

from __future__ import annotations

from .graph import Graph


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
    """The derivative of one operation from those of its arguments."""
    node = graph.nodes[index]
    a, da = node.args[0], slopes[0]
    if node.kind in ("add", "subtract"):
        return graph.add(da, graph.negate(slopes[1]) if node.kind == "subtract" else slopes[1])
    if node.kind == "multiply":
        b, db = node.args[1], slopes[1]
        return graph.add(graph.multiply(da, b), graph.multiply(a, db))
    if node.kind == "divide":
        b, db = node.args[1], slopes[1]
        return graph.divide(graph.add(da, graph.negate(graph.multiply(2 * index, db))), b)
    if node.kind in ("minimum", "maximum"):
        first = graph.binary("less", *((a, node.args[1]) if node.kind == "minimum" else (node.args[1], a)))
        return graph.where(first, da, slopes[1])
    if node.kind == "arctan2":  # of y by x: (x dy - y dx) / (x^2 + y^2)
        x, dx = node.args[1], slopes[1]
        turn = graph.add(graph.multiply(x, da), graph.negate(graph.multiply(a, dx)))
        return graph.divide(turn, graph.add(graph.multiply(x, x), graph.multiply(a, a)))
    if node.kind == "where":
        return graph.where(a, slopes[1], slopes[2])
    return _unary_slope(graph, node.kind, 2 * index, a, da)


def _unary_slope(graph: Graph, kind: str, value: int, a: int, da: int) -> int:
    if kind == "sin":
        return graph.multiply(graph.unary("cos", a), da)
    if kind == "cos":
        return graph.negate(graph.multiply(graph.unary("sin", a), da))
    if kind == "negative":
        return graph.negate(da)
    if kind == "sqrt":
        return graph.divide(graph.multiply(da, graph.constant(0.5)), value)
    if kind == "abs":
        return graph.multiply(graph.unary("sign", a), da)
    if kind == "tanh":
        return graph.multiply(graph.add(graph.constant(1.0), graph.negate(graph.multiply(value, value))), da)
    if kind == "exp":
        return graph.multiply(value, da)
    return graph.constant(0.0)  # sign and comparisons are piecewise constant
