"""Straight-line programs: the operations of a graph that the outputs need, in order."""

from __future__ import annotations

import math
import operator
from collections import Counter
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from .. import elementwise
from ..basics.spatial import Array, sincos, sqrt
from .graph import Graph

# Every operation on arrays of any numbers: long double, complex, mpmath's, traced ones.
ON_ARRAYS: dict[str, Callable[..., Any]] = {
    "add": operator.add,
    "subtract": operator.sub,
    "multiply": operator.mul,
    "divide": operator.truediv,
    "negative": operator.neg,
    "abs": lambda x: np.where(x.real < 0, -x, x) if x.dtype.kind == "c" else abs(x),
    "sin": lambda x: sincos(x)[0],
    "cos": lambda x: sincos(x)[1],
    "sqrt": sqrt,
    "less_equal": lambda a, b: elementwise.where(elementwise.less(b, a), 0.0, 1.0),
}
ON_ARRAYS |= {k: getattr(elementwise, k) for k in (*elementwise.SHARED, "less", "where")}
BLOCK = 256  # states evaluated at once where every result is kept


class Operand(NamedTuple):
    """Operand: an input, a constant, a number of a table, or the result of instruction k."""

    kind: str  # "input", "constant", "table", "result"
    value: float | int


class Instruction(NamedTuple):
    """Operation of the program."""

    kind: str
    args: tuple[Operand, ...]


@dataclass(frozen=True)
class Program:
    """Instructions in order, and the operand of each output entry."""

    instructions: tuple[Instruction, ...]
    outputs: tuple[Operand, ...]
    inputs: int  # number of scalar inputs

    @cached_property
    def operations(self) -> dict[str, int]:
        """Number of operations by kind; a sine counts as one, however it is evaluated."""
        return dict(sorted(Counter(instruction.kind for instruction in self.instructions).items()))

    @property
    def is_finite(self) -> bool:
        """True if no constant is NaN and none that is a result infinite; comparisons and choices read infinite ones."""
        args = [arg.value for instruction in self.instructions for arg in instruction.args if arg.kind == "constant"]
        results = [output.value for output in self.outputs if output.kind == "constant"]
        return not any(map(math.isnan, args)) and all(map(math.isfinite, results))

    @cached_property
    def reads(self) -> Array:
        """True for each input that an output depends on, shape (inputs,)."""
        found: list[Array] = []

        def of(operand: Operand) -> Array:
            if operand.kind == "result":
                return found[int(operand.value)]
            return np.asarray(np.arange(self.inputs) == (operand.value if operand.kind == "input" else -1))

        for instruction in self.instructions:
            found.append(np.any([of(operand) for operand in instruction.args], axis=0))
        return np.asarray(np.any([of(operand) for operand in self.outputs], axis=0))


def interpret(
    program: Program, inputs: Any, operations: Mapping[str, Callable[..., Any]], constant: Callable[..., Any]
) -> list[Any]:
    """Outputs for inputs of any kind with arithmetic; `constant` makes one of a number."""
    results: list[Any] = []

    def value(arg: Operand) -> Any:
        if arg.kind == "constant":
            return constant(arg.value)
        return (inputs if arg.kind == "input" else results)[int(arg.value)]

    for kind, args in program.instructions:
        results.append(operations[kind](*map(value, args)))
    return list(map(value, program.outputs))


def evaluate(program: Program, entries: int, inputs: Array) -> Array:
    """First outputs, (states, entries), for inputs (states, width) of any type of number."""
    found = np.zeros((len(inputs), entries), dtype=inputs.dtype)
    number: Any = np.asarray if inputs.dtype == object else inputs.dtype.type
    with np.errstate(all="ignore"):
        for k in range(0, len(inputs), BLOCK):
            outputs = interpret(program, inputs[k : k + BLOCK].T, ON_ARRAYS, number)
            for row, output in zip(found[k : k + BLOCK].T, outputs, strict=False):
                row[...] = output
    return found


def with_table(program: Program) -> tuple[Program, list[float]]:
    """Program with its constants other than 0, 1 and -1 in a table: those that differ only in these are equal."""
    table: list[float] = []

    def place(arg: Operand) -> Operand:
        if arg.kind != "constant" or arg.value in (0, 1, -1):
            return arg
        table.append(arg.value)
        return Operand("table", len(table) - 1)

    return _replaced(program.instructions, program.outputs, program.inputs, place), table


def _replaced(
    instructions: Iterable[Instruction],
    outputs: Iterable[Operand],
    inputs: int,
    place: Callable[[Operand], Operand],
) -> Program:
    """Program of instructions and outputs with other operands."""
    placed = tuple(Instruction(kind, tuple(map(place, args))) for kind, args in instructions)
    return Program(placed, tuple(map(place, outputs)), inputs)


def divided(program: Program, first: int, count: int) -> tuple[Program, Program]:
    """Program of what depends only on some inputs, and the rest, which takes its results as inputs.

    Those inputs, `count` from the `first` on, are numbers that stay the same while the rest is evaluated many times.
    """
    fixed = {Operand("input", k): Operand("input", k - first) for k in range(first, first + count)}
    kept: list[list[Instruction]] = [[], []]  # of the numbers, and of the rest
    place: dict[Operand, Operand] = {}
    for k, (kind, args) in enumerate(program.instructions):
        varies = any(arg.kind != "constant" and arg not in fixed for arg in args)
        target = place if varies else fixed
        kept[varies].append(Instruction(kind, args))
        target[Operand("result", k)] = Operand("result", len(kept[varies]) - 1)
    read = [arg for instruction in kept[1] for arg in instruction.args] + [*program.outputs]
    handed = list(dict.fromkeys(arg for arg in read if arg in fixed))
    place |= {arg: Operand("input", first + k) for k, arg in enumerate(handed)}
    for k in range(first + count, program.inputs):
        place[Operand("input", k)] = Operand("input", k - count + len(handed))
    of_numbers = _replaced(kept[0], handed, count, lambda arg: fixed.get(arg, arg))
    inputs = program.inputs - count + len(handed)
    return of_numbers, _replaced(kept[1], program.outputs, inputs, lambda arg: place.get(arg, arg))


def without_judged(program: Program, entries: int) -> Program:
    """Program of the first outputs only, which are the result."""
    needed, kept = {*program.outputs[:entries]}, list[int]()
    for k in reversed(range(len(program.instructions))):
        if Operand("result", k) in needed:
            needed |= {*program.instructions[k].args}
            kept.append(k)
    kept.reverse()
    place = {Operand("result", k): Operand("result", new) for new, k in enumerate(kept)}
    instructions = [program.instructions[k] for k in kept]
    return _replaced(instructions, program.outputs[:entries], program.inputs, lambda arg: place.get(arg, arg))


def lower(graph: Graph, outputs: list[int], inputs: int) -> Program:
    """Program of some outputs (references of the graph)."""
    return _Lowering(graph, outputs).program(inputs)


NONE = -1  # no operation


class _Lowering:
    def __init__(self, graph: Graph, outputs: list[int]) -> None:
        self.graph = graph
        self.outputs = outputs
        self.order = graph.needed(outputs)
        self.uses = Counter(a for k in self.order for a in self.graph.arguments(k))
        self.flipped = self._flipped()

    def _flipped(self) -> set[int]:
        """Operations used only with the opposite sign, and those that can be negated at no cost."""
        signs: dict[int, set[int]] = {}
        for output in self.outputs:
            signs.setdefault(output >> 1, set()).add(output & 1)
        flips, flipped = self._flips({*signs}), set[int]()
        for k, wanted in signs.items():
            following = k if wanted == {1} and not self.uses[k] else NONE
            while following in flips:
                flipped.add(following)
                following = flips[following]
        return flipped

    def _flips(self, outputs: set[int]) -> dict[int, int]:
        """Operations that can be negated at no cost, with the operand to negate for each, or NONE."""
        found: dict[int, int] = {}
        for k in self.order:
            node = self.graph.nodes[k]
            if node.kind == "subtract" or (node.kind == "multiply" and self.graph.value(node.args[0]) is not None):
                found[k] = NONE
            elif node.kind in ("multiply", "divide", "add"):
                inner = [a for a in self.graph.arguments(k) if a in found and self.uses[a] == 1 and a not in outputs]
                if inner:
                    found[k] = inner[0]
        return found

    def _written(self, k: int) -> tuple[str, list[int]]:
        """Kind and arguments of operation k, with its sign as wanted."""
        kind, refs = self.graph.nodes[k].kind, list(self.graph.nodes[k].args)
        if k not in self.flipped:
            return kind, refs
        if kind == "subtract":
            return kind, refs[::-1]
        if kind == "add":  # -(a + b) = (-a) - b, where the operation for a gives -a
            return "subtract", refs if refs[0] >> 1 in self.flipped else refs[::-1]
        if self.graph.value(refs[0]) is not None:
            return kind, [refs[0] ^ 1, *refs[1:]]
        return kind, refs

    def program(self, inputs: int) -> Program:
        instructions: list[Instruction] = []
        place: dict[int, Operand] = {}
        negatives: dict[int, Operand] = {}

        def operand(ref: int) -> Operand:
            found = place.get(ref >> 1)
            if found is None:
                value, node = self.graph.value(ref), self.graph.nodes[ref >> 1]
                found = Operand("input", node.args[0]) if value is None else Operand("constant", value)
            return found

        def emit(kind: str, *args: Operand) -> Operand:
            instructions.append(Instruction(kind, args))
            return Operand("result", len(instructions) - 1)

        for k in self.order:
            kind, refs = self._written(k)
            place[k] = emit(kind, *(operand(ref) for ref in refs))
        results = []
        for ref in self.outputs:
            found = operand(ref)
            negative = bool(ref & 1) and found.kind != "constant"
            if negative and ref >> 1 not in self.flipped:
                if ref not in negatives:
                    negatives[ref] = emit("negative", found)
                found = negatives[ref]
            results.append(found)
        return Program(tuple(instructions), tuple(results), inputs)
