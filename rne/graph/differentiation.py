"""Derivatives of a graph's outputs, as further operations: forwards, backwards, and both for the second order.

Each operation has one rule for each operand: a function, linear in a derivative, that carries it through the operation.
Forwards (Jacobians), derivatives go from the operands to the result, and are summed; backwards (gradients of a weighted
sum of the outputs) from the result to each operand. See Griewank and Walther 2008, chapter 3.

At a kink the derivative of one side is taken: for minimum and maximum of equal operands, of the constant one if there
is one, otherwise of the one traced later; abs and sign have derivative 0 at 0. What `where` does not take contributes
nothing, even if its derivative is infinite.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import cache, partial, reduce
from typing import Any, NamedTuple

import numpy as np

from ..basics.spatial import Array, note_solution
from .graph import COMPARISONS, Graph, LinearSystem
from .program import ON_ARRAYS, Operand, Program, interpret, lower
from .scalar import Scalar, references

Rule = Callable[[Graph, int, int, int, int], int]  # (graph, value, operands a and b, derivative) -> derivative
_Change = tuple[int, int]  # references of a node's derivative, and of 1, or 0 where `where` takes a constant


class Order(NamedTuple):
    """Order of differentiation of a kernel: values, or derivatives of some kind."""

    title: str  # "" for the values and the Jacobian, which are named by the function
    inputs: tuple[str, ...] = ()  # after the function's own
    axes: int = 0  # of the result that belong to the arguments to differentiate by
    digits: float = 0.0  # decimal digits that it loses beyond those that the function does, at most, as measured


ORDERS = {
    "values": Order(""),
    "jacobian": Order("", axes=1),
    "gradient": Order("gradient of ", ("weights",), 1, 0.5),
    "hessian": Order("Hessian of ", ("weights",), 2, 1.0),
    "hessian_product": Order("Hessian times a vector of ", ("weights", "vector"), 1, 1.0),
}


def _chain(factor: Callable[[Graph, int, int], int]) -> tuple[Rule]:
    """Rule of a function of one operand, from its derivative by value and operand."""
    return (lambda g, v, a, b, s: g.multiply(factor(g, v, a), s),)


def _squares(g: Graph, y: int, x: int) -> int:
    return g.add(g.multiply(x, x), g.multiply(y, y))


RULES: dict[str, tuple[Rule, ...]] = {
    "add": (lambda g, v, a, b, s: s, lambda g, v, a, b, s: s),
    "subtract": (lambda g, v, a, b, s: s, lambda g, v, a, b, s: g.negate(s)),
    "multiply": (lambda g, v, a, b, s: g.multiply(b, s), lambda g, v, a, b, s: g.multiply(a, s)),
    "divide": (lambda g, v, a, b, s: g.divide(s, b), lambda g, v, a, b, s: g.negate(g.multiply(v, g.divide(s, b)))),
    "arctan2": (
        lambda g, v, y, x, s: g.multiply(x, g.divide(s, _squares(g, y, x))),
        lambda g, v, y, x, s: g.negate(g.multiply(y, g.divide(s, _squares(g, y, x)))),
    ),
    "negative": (lambda g, v, a, b, s: g.negate(s),),
    "sin": _chain(lambda g, v, a: g.unary("cos", a)),
    "cos": _chain(lambda g, v, a: g.negate(g.unary("sin", a))),
    "sqrt": (lambda g, v, a, b, s: g.divide(g.multiply(s, g.constant(0.5)), v),),
    "abs": _chain(lambda g, v, a: g.unary("sign", a)),
    "tanh": _chain(lambda g, v, a: g.add(g.constant(1.0), g.negate(g.multiply(v, v)))),
    "exp": _chain(lambda g, v, a: v),
}
FLAT = {"sign", *COMPARISONS}  # derivative is 0
SINGULAR = {"divide", "arctan2", "sqrt"}  # derivative may be infinite at a finite value


def _choice(g: Graph, index: int) -> tuple[int, int, int] | None:
    """The condition of `where`, minimum and maximum, its value where it holds, and elsewhere."""
    kind, args = g.nodes[index]
    if kind == "where":
        return args
    if kind not in ("minimum", "maximum"):
        return None
    a, b = args if g.value(args[0]) is None else args[::-1]
    return g.binary("less", *((a, b) if kind == "minimum" else (b, a))), a, b


def differentiate(graph: Graph, order: str, outputs: Sequence[int], by: Sequence[int], first: int) -> list[int]:
    """References of derivatives of the outputs, of an order in ORDERS, with respect to the inputs `by`.

    `first` is the number of the first input after the function's own: weights, one for each output, then the vector,
    one entry for each of `by`.
    """
    one, sweeps = graph.constant(1.0), Sweeps(graph)
    if order == "jacobian":
        columns = [sweeps.forwards(outputs, {k: one}) for k in by]
        return [column[i] for i in range(len(outputs)) for column in columns]
    weights = [graph.input(first + k) for k in range(len(outputs))]
    slopes = sweeps.gradient(outputs, weights, by)
    if order == "gradient":
        return slopes
    sweeps = Sweeps(graph)  # that knows the systems solved backwards
    if order == "hessian_product":
        return sweeps.forwards(slopes, {k: graph.input(first + len(outputs) + j) for j, k in enumerate(by)})
    lower = [sweeps.forwards(slopes[j:], {k: one}) for j, k in enumerate(by)]
    return [lower[min(i, j)][abs(i - j)] for i in range(len(by)) for j in range(len(by))]


class _SystemNodes(NamedTuple):
    """Solved linear system with references of x and r(x); r(x) has separate nodes, after x."""

    solve: Callable[[Any], Any]
    product: Callable[[Any], Any]
    x: list[int]
    residual: list[int]
    nodes: list[int]  # between x and r(x), in order
    before: list[int]  # nodes before x that r(x) is made of

    @property
    def first(self) -> int:
        """First node of x."""
        return min(ref >> 1 for ref in self.x)


class Sweeps:
    """Sweeps through a graph, forwards and backwards.

    The solution x of a linear system r(x) = 0 is not differentiated through its factors: it changes by -M^-1 dr at
    constant x, and derivatives with respect to r are -M^-1 times those with respect to x. With r = M qdd + h - tau by a
    recursion few digits are lost; through the factors of M, or its entries, twice as many would be, as large terms
    cancel where M is nearly singular.
    """

    def __init__(self, graph: Graph) -> None:
        self.graph = graph
        self.zero, self.one = graph.constant(0.0), graph.constant(1.0)
        found = [solved for system in graph.systems if (solved := _nodes_of(graph, system)) is not None]
        self.solved = {ref >> 1: solved for solved in found for ref in solved.x}

    def _depends(self, index: int) -> list[int]:
        """Nodes that the derivatives of a node depend on."""
        solved = self.solved.get(index)
        if solved is None:
            return self.graph.arguments(index)
        return solved.before if index == solved.first else [solved.first]

    def _order(self, outputs: Sequence[int]) -> list[int]:
        return sorted(self.graph.needed(outputs, self._depends))

    def forwards(self, outputs: Sequence[int], by: Mapping[int, int]) -> list[int]:
        """Derivatives of the outputs in a direction of the inputs in `by`, given by their numbers."""
        changes = self.changes(outputs, {k: (slope, self.one) for k, slope in by.items()})
        return [self._of(ref, changes) for ref in outputs]

    def changes(self, outputs: Sequence[int], by: Mapping[int, _Change]) -> dict[int, _Change]:
        """Derivatives of the nodes that depend on the inputs in `by`, and 1 each, 0 where `where` takes constants."""
        found = {self.graph.input(k) >> 1: change for k, change in by.items()}
        for index in self._order(outputs):
            if index not in found and any(k in found for k in self._depends(index)):
                if index in self.solved:
                    self._solution_forwards(self.solved[index], found)
                else:
                    self._forward(index, found)
        return found

    def _of(self, ref: int, changes: Mapping[int, _Change]) -> int:
        """Derivative of a reference from its node's."""
        return _signed(self.graph, ref, changes[ref >> 1][0]) if ref >> 1 in changes else self.zero

    def _moves(self, refs: Sequence[int], changes: Mapping[int, _Change]) -> int:
        """Reference of 1 where one of some references changes."""
        found = sorted({changes[ref >> 1][1] for ref in refs if ref >> 1 in changes})
        return self.one if self.one in found else reduce(partial(self.graph.binary, "maximum"), found, self.zero)

    def _forward(self, index: int, changes: dict[int, _Change]) -> None:
        g = self.graph
        slope = _forward(g, index, lambda ref: self._of(ref, changes))
        if slope == self.zero:
            return
        if choice := _choice(g, index):
            condition, *taken = choice
            moves = g.where(condition, *(self._moves([ref], changes) for ref in taken))
        else:
            moves = self._moves(g.nodes[index].args, changes)
            if g.nodes[index].kind in SINGULAR or g.is_doubtful(index):
                slope = g.where(moves, slope, self.zero)
        changes[index] = slope, moves

    def _solution_forwards(self, solved: _SystemNodes, changes: dict[int, _Change]) -> None:
        g, inner = self.graph, {k: changes[k] for k in solved.before if k in changes}
        for index in solved.nodes:
            self._forward(index, inner)
        right, moves = [g.negate(self._of(ref, inner)) for ref in solved.residual], self._moves(solved.residual, inner)
        if any(slope != self.zero for slope in right):
            for ref, slope in zip(solved.x, references(g, solved.solve(_row(g, right))), strict=True):
                changes[ref >> 1] = _signed(g, ref, slope), moves

    def gradient(self, outputs: Sequence[int], weights: Sequence[int], by: Sequence[int]) -> list[int]:
        """References of d (weights . outputs) / d input, by one sweep from the outputs to the inputs."""
        slopes = _Slopes(self.graph)
        for ref, weight in zip(outputs, weights, strict=True):
            slopes.give(ref, weight, self.one)
        for index in reversed(self._order(outputs)):
            solved = self.solved.get(index)
            if solved is None:
                slopes.backward(index)
            elif index == solved.first:  # all that is made of x has been passed
                self._solution_backwards(solved, slopes)
        return [slopes.of.get(self.graph.input(k) >> 1, self.zero) for k in by]

    def _solution_backwards(self, solved: _SystemNodes, slopes: _Slopes) -> None:
        g, nodes = self.graph, {ref >> 1 for ref in solved.x}
        taken = [slopes.taken[k] for k in nodes if k in slopes.taken]
        if not taken:
            return
        is_taken = reduce(partial(g.binary, "maximum"), taken)
        inner, zero = _Slopes(g), self.zero
        right = _row(g, [_signed(g, ref, slopes.of.get(ref >> 1, zero)) for ref in solved.x])
        p = solved.solve(right)
        note_solution(p, solved.solve, solved.product, lambda p: solved.product(p) - right)
        for ref, slope in zip(solved.residual, references(g, p), strict=True):
            inner.give(ref, g.negate(slope), is_taken)
        for index in reversed(solved.nodes):
            inner.backward(index)
        for k in solved.before:
            if k in inner.of:
                slopes.give(2 * k, inner.of[k], inner.taken[k])


class _Slopes:
    """Derivatives of the weighted sum of the outputs by nodes, accumulated over their readers."""

    def __init__(self, graph: Graph) -> None:
        self.graph = graph
        self.zero, self.one = graph.constant(0.0), graph.constant(1.0)
        self.of: dict[int, int] = {}
        self.taken: dict[int, int] = {}  # of each of these nodes: 1 if some output takes it, 0 if `where` takes others

    def give(self, ref: int, slope: int, is_taken: int) -> None:
        """Add to the derivative of a reference's node."""
        g, k = self.graph, ref >> 1
        if g.nodes[k].kind == "constant" or g.value(slope) == 0:
            return
        slope = _signed(g, ref, slope)
        self.of[k] = g.add(self.of[k], slope) if k in self.of else slope
        before = self.taken.get(k, self.zero)
        self.taken[k] = self.one if self.one in (before, is_taken) else g.binary("maximum", before, is_taken)

    def backward(self, index: int) -> None:
        """Propagate the derivative of a node, if it has one, to its operands."""
        if index not in self.of:
            return
        g, s, is_taken = self.graph, self.of[index], self.taken[index]
        kind, args = g.nodes[index]
        if choice := _choice(g, index):
            condition, a, b = choice
            self.give(a, g.where(condition, s, self.zero), g.where(condition, is_taken, self.zero))
            self.give(b, g.where(condition, self.zero, s), g.where(condition, self.zero, is_taken))
            return
        may_be_infinite = kind in SINGULAR or g.is_doubtful(index)
        for operand, rule in zip(args, RULES.get(kind, ()), strict=False):
            slope = rule(g, 2 * index, args[0], args[-1], s)
            self.give(operand, g.where(is_taken, slope, self.zero) if may_be_infinite else slope, is_taken)


def _nodes_of(g: Graph, system: LinearSystem) -> _SystemNodes | None:
    """Nodes of a linear system; None where entries of x are constant, one expression, or operands of r.

    r is made of inputs instead of x, so that no operation of r is combined with one of x, as 2 (u / 2) to u.
    """
    x = references(g, system.x)
    own = {ref >> 1 for ref in x}
    if len(own) < len(x) or any(g.value(ref) is not None for ref in x):
        return None
    first, given = min(own), [g.input(-len(g.nodes) - k) for k in range(1, len(x) + 1)]
    residual = references(g, system.residual(_row(g, [p ^ (ref & 1) for p, ref in zip(given, x, strict=True)])))
    place = {p >> 1: ref & ~1 for p, ref in zip(given, x, strict=True)}

    def moved(ref: int) -> int:
        return place.get(ref >> 1, ref & ~1) ^ (ref & 1)

    for k in g.needed(residual):
        if not own.isdisjoint(g.arguments(k)):
            return None
        if any(j in place for j in g.arguments(k)):
            place[k] = g.repeated(k, [moved(ref) for ref in g.nodes[k].args])
    residual = [moved(ref) for ref in residual]

    def after(index: int) -> list[int]:
        return g.arguments(index) if index > first and index not in own else []

    nodes = sorted(g.needed(residual, after))
    read = {k for index in nodes for k in g.arguments(index)} | {ref >> 1 for ref in residual}
    before = sorted(k for k in read if k < first and g.value(2 * k) is None)
    return _SystemNodes(system.solve, system.product, x, residual, nodes, before)


def _signed(g: Graph, ref: int, slope: int) -> int:
    """Derivative of a reference from its node's, or the other way around."""
    return g.negate(slope) if ref & 1 else slope


def _row(g: Graph, refs: Sequence[int]) -> Any:
    """References as an array of traced numbers, shape (1, n)."""
    return np.array([[Scalar(g, ref) for ref in refs]], dtype=object)


def _forward(g: Graph, index: int, of: Callable[[int], int]) -> int:
    """Derivative of an operation from its operands'."""
    kind, args = g.nodes[index]
    if kind in FLAT:
        return g.constant(0.0)
    if choice := _choice(g, index):
        condition, a, b = choice
        return g.where(condition, of(a), of(b))
    v, a, b = 2 * index, args[0], args[-1]
    if kind == "divide":  # one division instead of two
        return g.divide(g.add(of(a), g.negate(_times(g, v, of(b)))), b)
    if kind == "arctan2":
        return g.divide(g.add(_times(g, b, of(a)), g.negate(_times(g, a, of(b)))), _squares(g, a, b))
    slope = g.constant(0.0)
    for operand, rule in zip(args, RULES[kind], strict=True):
        s = of(operand)
        if g.value(s) != 0:  # of what does not depend on the inputs there is no term, whatever it is multiplied by
            slope = g.add(slope, rule(g, v, a, b, s))
    return slope


def _times(g: Graph, a: int, slope: int) -> int:
    """Product of a and a derivative; zero for what does not depend on the input, whatever a is."""
    return slope if g.value(slope) == 0 else g.multiply(a, slope)


@cache
def _with_slope(kind: str, slopes: tuple[bool, ...], moves: tuple[bool, ...]) -> Program:
    """Operation with its derivative, and its dependence on the inputs as in `Sweeps.changes`.

    Its inputs are the operands, then their derivatives, if they have one, then where they move, if not everywhere.
    """
    graph, count = Graph(), len(slopes)
    result, one, zero = graph.node(kind, *map(graph.input, range(count))), graph.constant(1.0), graph.constant(0.0)
    places = [graph.input(2 * count + k) if moves[k] else one for k in range(count)]
    by = {k: (graph.input(count + k), places[k]) for k in range(count) if slopes[k]}
    slope, where = Sweeps(graph).changes([result], by).get(result >> 1, (zero, zero))
    return lower(graph, [result, graph.where(where, slope, zero), where], 3 * count)


def accumulated(program: Program, entries: int, inputs: Array, by: Sequence[int]) -> Array:
    """Jacobian of a program's first outputs, (states, entries, k), for inputs (states, width) of any number type.

    Forwards along all inputs `by` at once, operation by operation, for programs too large to be differentiated.
    """
    slopes = np.zeros((len(inputs), entries, len(by)), dtype=inputs.dtype)
    units, results = dict(zip(by, np.eye(len(by), dtype=inputs.dtype)[..., None], strict=True)), list[Any]()

    def found(arg: Operand) -> Any:
        if arg.kind == "constant":
            return np.asarray(arg.value), None, None
        k = int(arg.value)
        return results[k] if arg.kind == "result" else (inputs[:, k], units.get(k), None)

    with np.errstate(all="ignore"):
        for kind, args in program.instructions:
            if kind in ("minimum", "maximum") and args[0].kind == "constant":
                args = args[::-1]  # of which `_choice` cannot know here
            values, *changes = zip(*map(found, args), strict=True)
            piece = _with_slope(kind, *(tuple(part is not None for part in parts) for parts in changes))
            value, *change = interpret(piece, [*values, *changes[0], *changes[1]], ON_ARRAYS, np.asarray)
            fixed = [output.kind == "constant" for output in piece.outputs[1:]]
            results.append((value, *(None if is_fixed else part for is_fixed, part in zip(fixed, change, strict=True))))
    for column, output in zip(np.moveaxis(slopes, 1, 0), program.outputs, strict=False):
        column[...] = 0.0 if (slope := found(output)[1]) is None else slope.T
    return slopes
