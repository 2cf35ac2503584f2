"""A program run on blocks of states: one NumPy call an operation, in registers that fit the cache."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from ..spatial import Array
from .program import Instruction, Operand, Program
from .schedule import frugal
from .trig import METHODS, Call, faster

UFUNCS: dict[str, Callable[..., Any]] = {
    "add": np.add,
    "subtract": np.subtract,
    "multiply": np.multiply,
    "divide": np.divide,
    "negative": np.negative,
    "sin": np.sin,
    "cos": np.cos,
    "sqrt": np.sqrt,
    "abs": np.absolute,
    "tanh": np.tanh,
    "sign": np.sign,
    "minimum": lambda a, b, out: np.minimum(a, b, out=out),
    "maximum": lambda a, b, out: np.maximum(a, b, out=out),
}
LINE = 64  # bytes of a cache line
BUDGET = 8 * 2**20  # bytes of registers: more no longer pay for fewer calls
LONGEST, SHORTEST = 8192, 256  # states a block


class Step(NamedTuple):
    """One instruction with the registers of its operands and results."""

    kind: str
    args: tuple[Operand | int, ...]
    out: tuple[int, ...]


class Layout(NamedTuple):
    """Where everything is: inputs in the first registers, then outputs, then the rest."""

    steps: tuple[Step, ...]
    registers: int
    copies: tuple[tuple[int, Operand | int], ...]  # output rows that repeat another register or hold a constant


def allocate(program: Program) -> Layout:
    """Registers by liveness: a register is free again after its last reader. Of two orders, the one with fewer."""
    layouts = [_Allocator(ordered).layout() for ordered in (program, frugal(program))]
    return min(layouts, key=lambda layout: layout.registers)


class _Allocator:
    def __init__(self, program: Program) -> None:
        self.program = program
        self.free: list[int] = []
        self.registers = program.inputs + len(program.outputs)
        self.place: dict[int, int] = {}
        self.paired: set[int] = set()
        self.last = self._last_readers()
        self.copies: list[tuple[int, Operand | int]] = []
        self._place_outputs()

    def _last_readers(self) -> dict[Operand, int]:
        last: dict[Operand, int] = {}
        for k, instruction in enumerate(self.program.instructions):
            for arg in instruction.args:
                if arg.kind != "constant":
                    last[arg] = k
        return last

    def _place_outputs(self) -> None:
        """An output is computed where it is to be found; repeated and constant ones are copied."""
        for k, output in enumerate(self.program.outputs):
            row = self.program.inputs + k
            if output.kind == "result" and output.value not in self.place:
                self.place[int(output.value)] = row
            else:
                source = self.place[int(output.value)] if output.kind == "result" else output
                self.copies.append((row, int(output.value) if output.kind == "input" else source))
        self.fixed = {Operand("result", k) for k in self.place} | set(self.program.outputs)

    def _take(self) -> int:
        if self.free:
            return self.free.pop()
        self.registers += 1
        return self.registers - 1

    def _where(self, arg: Operand) -> Operand | int:
        if arg.kind == "constant":
            return arg
        return int(arg.value) if arg.kind == "input" else self.place[int(arg.value)]

    def _result(self, k: int) -> int:
        if k not in self.place:
            self.place[k] = self._take()
        return self.place[k]

    def _release(self, k: int, instruction: Instruction) -> None:
        for arg in set(instruction.args):
            if arg.kind != "constant" and self.last[arg] == k and arg not in self.fixed:
                self.free.append(int(arg.value) if arg.kind == "input" else self.place[int(arg.value)])

    def layout(self) -> Layout:
        """Steps in order; a result may take the register of an operand that is read for the last time."""
        partners = self._sine_and_cosine()
        steps = []
        for k, instruction in enumerate(self.program.instructions):
            if k in self.paired:
                self._release(k, instruction)
                continue
            args = tuple(self._where(arg) for arg in instruction.args)
            if k in partners:
                steps.append(self._pair(k, partners[k], args))
                self._release(k, instruction)
                continue
            if instruction.kind == "where":  # written in two parts, so its result must not overlay an operand
                steps.append(Step("where", args, (self._result(k),)))
                self._release(k, instruction)
                continue
            self._release(k, instruction)
            steps.append(Step(instruction.kind, args, (self._result(k),)))
        return Layout(tuple(steps), self.registers, tuple(self.copies))

    def _pair(self, k: int, partner: int, args: tuple[Operand | int, ...]) -> Step:
        self.paired.add(partner)
        sine, cosine = (k, partner) if self.program.instructions[k].kind == "sin" else (partner, k)
        return Step("sincos", args, (self._result(sine), self._result(cosine)))

    def _sine_and_cosine(self) -> dict[int, int]:
        """The first of each sine and cosine of the same angle, with the other one."""
        first: dict[tuple[str, Any], int] = {}
        partners = {}
        for k, instruction in enumerate(self.program.instructions):
            if instruction.kind in ("sin", "cos") and instruction.args[0].kind == "input":
                other = first.get(("cos" if instruction.kind == "sin" else "sin", instruction.args[0]))
                if other is not None:
                    partners[other] = k
                first[(instruction.kind, instruction.args[0])] = k
        return partners


class Workspace:
    """Registers of one thread, and the calls that run the program in them."""

    def __init__(self, layout: Layout, length: int, dtype: np.dtype[Any], trig: str | None = None) -> None:
        self.layout = layout
        self.dtype = dtype
        self.trig = METHODS[trig or faster(dtype.name)]
        self.rows = aligned_zeros(layout.registers, length, dtype)
        self.constants: dict[float, Array] = {}
        self._calls: dict[int, list[Call]] = {}

    def calls(self, length: int) -> list[Call]:
        """The program as NumPy calls on the first `length` states of the registers."""
        calls = self._calls.get(length)
        if calls is None:
            rows = list(self.rows[:, :length])
            calls = [call for step in self.layout.steps for call in self._of(step, rows)]
            calls += [(np.copyto, (rows[row], self._operand(source, rows))) for row, source in self.layout.copies]
            if len(self._calls) > 4:
                self._calls.clear()
            self._calls[length] = calls
        return calls

    def _operand(self, arg: Operand | int, rows: list[Array]) -> Array:
        if isinstance(arg, int):
            return rows[arg]
        return self.constants.setdefault(float(arg.value), np.array(arg.value, dtype=self.dtype))

    def _of(self, step: Step, rows: list[Array]) -> list[Call]:
        args = [self._operand(arg, rows) for arg in step.args]
        out = [rows[k] for k in step.out]
        if step.kind == "sincos":
            return self.trig(args[0], out[0], out[1], lambda x: self._operand(Operand("constant", x), rows))
        if step.kind == "less":
            return [(_compare, (np.less, *args, out[0]))]
        if step.kind == "less_equal":
            return [(_compare, (np.less_equal, *args, out[0]))]
        if step.kind == "where":
            return [(_where, (*args, out[0]))]
        return [(UFUNCS[step.kind], (*args, out[0]))]


def aligned_zeros(rows: int, length: int, dtype: np.dtype[Any]) -> Array:
    """Zeros whose every row starts on a cache line: vector loads that straddle two cost twice."""
    line = LINE // dtype.itemsize
    stride = (-(-length // line) + 1) * line  # one more, so that rows do not fall on the same sets of the cache
    flat = np.zeros(rows * stride + line, dtype=dtype)
    start = -flat.ctypes.data % LINE // dtype.itemsize
    return flat[start : start + rows * stride].reshape(rows, stride)


def _compare(ufunc: Callable[..., Any], a: Array, b: Array, out: Array) -> None:
    ufunc(a, b, out=out, casting="unsafe")


def _where(condition: Array, a: Array, b: Array, out: Array) -> None:
    np.copyto(out, b)
    np.copyto(out, a, where=condition != 0)


def block_length(registers: int, itemsize: int) -> int:
    """States a block: as many as keep the registers in the cache, few enough calls to pay for their overhead."""
    return max(SHORTEST, min(LONGEST, BUDGET // (max(registers, 1) * itemsize) // 64 * 64))
