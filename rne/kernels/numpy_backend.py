"""Program run on blocks of states: one NumPy call per operation, in registers that fit the cache."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import cache, cached_property, partial
from math import isfinite
from typing import Any, NamedTuple

import numpy as np

from ..basics.spatial import Array
from ..dynamics.quantity import OK, PrecisionStatus
from ..graph.program import Operand, Program
from .soundness import Conditions, Recursion, Trace

Call = tuple[Callable[..., Any], tuple[Any, ...]]
LINE = 64  # size of a cache line [bytes]
REGISTER_BYTES = 8 * 2**20  # largest size of all registers [bytes]: more no longer pay for fewer calls
MAX_BLOCK, MIN_BLOCK = 8192, 256  # states per block


class Step(NamedTuple):
    """Instruction with the registers of its operands and results."""

    kind: str
    args: tuple[Operand | int, ...]
    out: tuple[int, ...]


class Layout(NamedTuple):
    """The use of the registers: inputs first, then outputs, then intermediate results."""

    steps: tuple[Step, ...]
    registers: int
    copies: tuple[tuple[int, Operand | int], ...]  # output rows that repeat another register or hold a constant


def allocate(program: Program) -> Layout:
    """Register allocation by liveness: each is free again after its last reader, which may put its result there."""
    place, copies = _places(program)
    last = {arg: k for k, instruction in enumerate(program.instructions) for arg in instruction.args}
    kept = {*program.outputs, *(arg for arg in last if arg.kind == "constant")}
    registers = itertools.count(program.inputs + len(program.outputs))
    free: list[int] = []
    partners = _sine_and_cosine(program)
    steps: list[Step] = []

    def result(k: int) -> int:
        operand = Operand("result", k)
        if operand not in place:
            place[operand] = free.pop() if free else next(registers)
        return place[operand]

    for k, (kind, operands) in enumerate(program.instructions):
        args = tuple(place.get(arg, arg) for arg in operands)
        finished = [place[arg] for arg in set(operands) if arg not in kept and last[arg] == k]
        is_whole = kind != "where" and k not in partners  # written in one part, so the result may overlap an operand
        free += finished if is_whole else []
        if k not in partners:
            steps.append(Step(kind, args, (result(k),)))
        elif k < partners[k]:  # the second comes with the first
            sine, cosine = (k, partners[k]) if kind == "sin" else (partners[k], k)
            steps.append(Step("sincos", args, (result(sine), result(cosine))))
        free += [] if is_whole else finished
    return Layout(tuple(steps), next(registers), copies)


def _places(program: Program) -> tuple[dict[Operand, int], tuple[tuple[int, Operand | int], ...]]:
    """Registers of inputs and outputs, and the outputs that repeat another register or are constant."""
    place = {Operand("input", k): k for k in range(program.inputs)}
    copies: list[tuple[int, Operand | int]] = []
    for row, output in enumerate(program.outputs, program.inputs):
        if output.kind == "result" and output not in place:
            place[output] = row
        else:
            copies.append((row, place.get(output, output)))
    return place, tuple(copies)


def _sine_and_cosine(program: Program) -> dict[int, int]:
    """Sines and cosines of the same input, each with the other."""
    first: dict[tuple[str, Operand], int] = {}
    partners: dict[int, int] = {}
    for k, (kind, args) in enumerate(program.instructions):
        if kind in ("sin", "cos") and args[0].kind == "input":
            other = first.get(("cos" if kind == "sin" else "sin", args[0]))
            if other is not None:
                partners |= {other: k, k: other}
            first[kind, args[0]] = k
    return partners


class BlockProgram:
    """Trace that runs on arrays of states, block by block; a vector instead of such an array is common to all."""

    def __init__(self, trace: Trace) -> None:
        self.trace = trace
        edges = itertools.accumulate(trace.widths, initial=0)
        self.inputs = [slice(a, b) for a, b in itertools.pairwise(edges)]
        self.workspaces: dict[str, list[Workspace]] = {}

    @cached_property
    def layout(self) -> Layout:
        """Registers of the program."""
        return allocate(self.trace.program)

    def run(self, states: Sequence[Array], results: Array, recursion: Recursion) -> PrecisionStatus:
        """Fill `results`, shape (count, entries), from one array of shape (count, width) per argument.

        A block that is not known to be sound is left to the recursion, whose first error ends the run.
        """
        status = OK
        for block, conditions in self._blocks(states, results, OF_ROWS):
            if not all(conditions):
                found, its_status = recursion(block.start, block.stop)
                status = status.worse(its_status)
                if status.error is not None:
                    break
                results[block] = found
        return status

    def sound(self, states: Sequence[Array], results: Array) -> Array:
        """Fill `results`, each state's bits independent of the others; True for each that is sound, others are void."""
        found = np.ones(len(results), dtype=bool)
        for block, conditions in self._blocks(states, results, OF_STATES):
            found[block] = np.logical_and.reduce(conditions)
        return found

    def _blocks(self, states: Sequence[Array], results: Array, write: Conditions) -> Iterator[tuple[slice, list[Any]]]:
        """Run block by block; yields the conditions under which each is sound."""
        count, dtype, trace = len(results), results.dtype, self.trace
        length = min(block_length(self.layout.registers, dtype.itemsize), _rounded(max(count, 1)))
        with np.errstate(all="ignore"), self._workspace(length, dtype) as workspace:
            for begin in range(0, count, length):
                block = slice(begin, min(begin + length, count))
                rows = workspace.rows[:, : block.stop - begin]
                for place, array in zip(self.inputs, states, strict=True):
                    rows[place] = array[block].T if array.ndim > 1 else array[:, None]
                conditions = trace.sound_inputs(rows, dtype, write)
                for call, arguments in workspace.calls(min(_rounded(block.stop - begin), length)):
                    call(*arguments)
                outputs = rows[trace.program.inputs :]
                store(outputs[: trace.entries], results[block])
                yield block, conditions + trace.sound_results(outputs, dtype, write)

    @contextmanager
    def _workspace(self, length: int, dtype: np.dtype[Any]) -> Iterator[Workspace]:
        """A workspace of the pool, returned when done, so that threads never share one."""
        pool = self.workspaces.setdefault(dtype.name, [])
        try:
            workspace = pool.pop()
        except IndexError:
            workspace = Workspace(self.layout, length, dtype)
        if workspace.rows.shape[1] < length:
            workspace = Workspace(self.layout, length, dtype)
        try:
            yield workspace
        finally:
            pool.append(workspace)


class Workspace:
    """Registers of one thread, and the calls that run the program in them."""

    def __init__(self, layout: Layout, length: int, dtype: np.dtype[Any]) -> None:
        self.layout = layout
        self.dtype = dtype
        self.trig = METHODS[faster(dtype.name)]
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
            if len(self._calls) > 16:
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
        return [(SPECIAL.get(step.kind) or getattr(np, step.kind), (*args, out[0]))]


def _rounded(states: int) -> int:
    """Number of states rounded up by at most a quarter, so that calls made for other numbers can be reused."""
    step = 2 ** (states.bit_length() - 3)
    return states if states < 256 else -(-states // step) * step


def aligned_zeros(rows: int, length: int, dtype: np.dtype[Any]) -> Array:
    """Zeros with every row aligned to a cache line, since vector loads across two lines cost twice."""
    line = LINE // dtype.itemsize
    stride = (-(-length // line) + 1) * line  # one more, so that rows do not share the same sets of the cache
    flat = np.zeros(rows * stride + line, dtype=dtype)
    start = -flat.ctypes.data % LINE // dtype.itemsize
    return flat[start : start + rows * stride].reshape(rows, stride)


def _where(condition: Array, a: Array, b: Array, out: Array) -> None:
    np.copyto(out, b)
    np.copyto(out, a, where=condition != 0)


# Operations that are not NumPy's function of the same name, called as np.add(a, b, out).
SPECIAL: dict[str, Callable[..., Any]] = {
    "minimum": lambda a, b, out: np.minimum(a, b, out=out),
    "maximum": lambda a, b, out: np.maximum(a, b, out=out),
    "less": partial(np.less, casting="unsafe"),
    "less_equal": partial(np.less_equal, casting="unsafe"),
    "where": _where,
}


def block_length(registers: int, itemsize: int) -> int:
    """Number of states per block: registers fit the cache, while the overhead of calls stays small."""
    return max(MIN_BLOCK, min(MAX_BLOCK, REGISTER_BYTES // (max(registers, 1) * itemsize) // 64 * 64))


def store(rows: Array, results: Array) -> None:
    """Copy registers to states: column by column while these share a cache line, otherwise in one sweep."""
    if len(rows) > 8:
        results[...] = rows.T
        return
    for k, row in enumerate(rows):
        results[:, k] = row


def all_finite(rows: Array) -> bool:
    """True if every entry is finite; a finite sum, which may overflow, shows it at once."""
    return isfinite(rows.sum()) or bool(np.isfinite(rows).all())


# Conditions of soundness of each state, and of all states of a block at once.
OF_STATES = Conditions(
    finite=lambda values: np.isfinite(values.sum(axis=0) if isinstance(values, np.ndarray) else sum(values)),
    within=lambda values, bound: np.abs(values).max(axis=0, initial=0.0) <= bound,
    above=lambda values, factor, others: (values > factor * others).all(axis=0),
)
OF_ROWS = Conditions(
    finite=lambda values: all_finite(values) if isinstance(values, np.ndarray) else all(map(all_finite, values)),
    within=lambda values, bound: values.max(initial=0.0) <= bound and values.min(initial=0.0) >= -bound,
    above=lambda values, factor, others: (values > factor * others).all(),
)


def check_out(
    out: Array, shape: tuple[int, ...], dtype: np.dtype[Any], names: Sequence[str], arrays: Sequence[Array]
) -> Array:
    """Raise a ValueError for an `out` of another shape or dtype, or one that overlaps an input."""
    check_array("out", out, shape, dtype, "writeable")
    for name, array in zip(names, arrays, strict=True):
        if np.may_share_memory(out, array):
            raise ValueError(f"`out` must not share memory with `{name}`")
    return out


def check_array(name: str, array: Any, shape: tuple[int, ...], dtype: np.dtype[Any], flag: str = "aligned") -> None:
    """Raise a ValueError for anything but an array of this shape and dtype in C order."""
    if not isinstance(array, np.ndarray) or array.shape != shape or array.dtype != dtype:
        got = f"{array.dtype} {array.shape}" if isinstance(array, np.ndarray) else type(array).__name__
        raise ValueError(f"`{name}` must be a {dtype} array of shape {shape}, got {got}")
    if not array.flags.c_contiguous or not getattr(array.flags, flag):
        raise ValueError(f"`{name}` must be C-contiguous and {flag}")


def by_tangent(angle: Array, sin: Array, cos: Array, number: Callable[[float], Array]) -> list[Call]:
    """Calls for sine and cosine from t = tan(q / 2): r = 2 / (1 + t^2), sin = t r, cos = r - 1, to an error of 2 eps.

    Near q = +-pi t is large but finite, since no floating-point number is an odd multiple of pi / 2. The three arrays
    are distinct. Where NumPy has a vectorised tangent, as on AVX-512, this is several times faster in float64.
    """
    one = number(1.0)
    return [
        (np.multiply, (angle, number(0.5), sin)),
        (np.tan, (sin, sin)),
        (np.multiply, (sin, sin, cos)),
        (np.add, (cos, one, cos)),
        (np.divide, (number(2.0), cos, cos)),  # r = 2 / (1 + t^2)
        (np.multiply, (sin, cos, sin)),  # t r
        (np.subtract, (cos, one, cos)),  # r - 1
    ]


METHODS: dict[str, Callable[..., list[Call]]] = {
    "functions": lambda angle, sin, cos, number: [(np.sin, (angle, sin)), (np.cos, (angle, cos))],
    "tangent": by_tangent,
}


@cache
def faster(dtype: str) -> str:
    """Faster of the two methods for this dtype, by the instructions that NumPy uses here for its tangent.

    In float32 sine and cosine are vectorised wherever the tangent is, and two of them cost less than the formulas.
    """
    tangents = np.lib.introspect.opt_func_info(func_name="^tan$").get("tan", {})
    vectorised = not tangents.get("dd", {}).get("current", "baseline").startswith("baseline")
    return "tangent" if vectorised and dtype == "float64" else "functions"
