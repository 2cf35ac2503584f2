"""From a graph to a straight-line program: the operations that the outputs need, in order, signs written out."""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

from .graph import Graph


class Operand(NamedTuple):
    """An operand of an instruction: input k, a constant, or the result of instruction k."""

    kind: str  # "input", "constant", "result"
    value: float | int


class Instruction(NamedTuple):
    """One operation of the program."""

    kind: str
    args: tuple[Operand, ...]


@dataclass(frozen=True)
class Program:
    """Instructions in order, and the operand that holds each output entry.

    Attributes
    ----------
    instructions : tuple of Instruction
    outputs : tuple of Operand
        One for each entry.
    inputs : int
        Number of scalar inputs.
    """

    instructions: tuple[Instruction, ...]
    outputs: tuple[Operand, ...]
    inputs: int

    @property
    def operations(self) -> dict[str, int]:
        """Number of operations by kind; a sine counts as one, however it is evaluated."""
        return dict(sorted(Counter(instruction.kind for instruction in self.instructions).items()))

    @property
    def is_finite(self) -> bool:
        """True if every constant is finite; a product may overflow for a model with numbers near the largest."""
        args = [arg for instruction in self.instructions for arg in instruction.args]
        return all(math.isfinite(arg.value) for arg in (*args, *self.outputs) if arg.kind == "constant")

    @cached_property
    def unused_inputs(self) -> list[int]:
        """Inputs that no operation and no output reads."""
        read = [arg for instruction in self.instructions for arg in instruction.args]
        used = {arg.value for arg in (*read, *self.outputs) if arg.kind == "input"}
        return [k for k in range(self.inputs) if k not in used]


def lower(graph: Graph, outputs: list[int], inputs: int) -> Program:
    """The program of some outputs (references of the graph)."""
    return _Lowering(graph, outputs).program(inputs)


class _Lowering:
    def __init__(self, graph: Graph, outputs: list[int]) -> None:
        self.graph = graph
        self.outputs = outputs
        self.order = self._needed()
        self.uses = Counter(a for k in self.order for a in self._arguments(k))
        self.flipped = self._flipped()

    def _arguments(self, k: int) -> list[int]:
        node = self.graph.nodes[k]
        return [] if node.kind in ("input", "constant") else [ref >> 1 for ref in node.args]

    def _needed(self) -> list[int]:
        """Operations the outputs need, each after its arguments and close before its first use."""
        done: set[int] = set()
        order = []
        for output in self.outputs:
            stack = [(output >> 1, False)]
            while stack:
                k, ready = stack.pop()
                if ready:
                    order.append(k)
                elif k not in done:
                    done.add(k)
                    stack.append((k, True))
                    stack.extend((a, False) for a in reversed(self._arguments(k)))
        return [k for k in order if self.graph.nodes[k].kind not in ("input", "constant")]

    def _flipped(self) -> set[int]:
        """Operations used only with the opposite sign, and those that can be rewritten for it at no cost."""
        signs: dict[int, set[int]] = {}
        for output in self.outputs:
            signs.setdefault(output >> 1, set()).add(output & 1)
        flipped: set[int] = set()
        for k, wanted in signs.items():
            if wanted == {1} and not self.uses[k]:
                flipped |= self._flip(k) or set()
        return flipped

    def _flip(self, k: int) -> set[int] | None:
        """The operations to flip so that operation k gives its negative; None if it would cost one."""
        node = self.graph.nodes[k]
        if node.kind == "subtract" or (node.kind == "multiply" and self.graph.value(node.args[0]) is not None):
            return {k}
        if node.kind in ("multiply", "divide", "add"):
            outputs = {output >> 1 for output in self.outputs}
            for a in self._arguments(k):
                inner = self._flip(a) if self.uses[a] == 1 and a not in outputs else None
                if inner is not None:
                    return inner | {k}
        return None

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
            node = self.graph.nodes[ref >> 1]
            if node.kind == "input":
                return Operand("input", node.args[0])
            value = self.graph.value(ref)
            return place[ref >> 1] if value is None else Operand("constant", value)

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
