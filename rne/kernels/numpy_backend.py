"""A program run on blocks of states: one NumPy call per operation, in registers that fit the cache."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from functools import cached_property
from typing import Any

import numpy as np

from ..basics.spatial import Array
from ..dynamics.precision import NEARLY_SINGULAR, pivots_below, velocity_bound
from ..dynamics.quantity import OK, PrecisionStatus
from .engines import Fallback
from .program import Operand, Program
from .registers import Layout, Step, allocate
from .sine_cosine import METHODS, Call, faster

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
    "exp": np.exp,
    "arctan2": lambda y, x, out: np.arctan2(y, x, out=out),
    "sign": np.sign,
    "minimum": lambda a, b, out: np.minimum(a, b, out=out),
    "maximum": lambda a, b, out: np.maximum(a, b, out=out),
}
LINE = 64  # bytes of a cache line
REGISTER_BYTES = 8 * 2**20  # of all registers: more no longer pay for fewer calls
MAX_BLOCK, MIN_BLOCK = 8192, 256  # states per block


class BlockProgram:
    """A program that runs on arrays of states, block by block.

    Parameters
    ----------
    program : Program
    widths : sequence of int
        Number of inputs of each argument.
    entries : int
        Number of entries of the result, the first outputs of the program.
    pivots : int or None
        Number of pivots of M behind them, with the diagonal of M after these; None if there are none.
    rates : range
        Inputs that are joint rates, whose squares may cost digits.
    """

    def __init__(self, program: Program, widths: Sequence[int], entries: int, pivots: int | None, rates: range) -> None:
        self.program, self.entries, self.pivots, self.rates = program, entries, pivots, rates
        edges = np.cumsum([0, *widths]).tolist()
        self.inputs = [slice(a, b) for a, b in itertools.pairwise(edges)]
        self.first_output: int = edges[-1]
        self.workspaces: dict[str, list[Workspace]] = {}

    @cached_property
    def layout(self) -> Layout:
        """Registers of the program."""
        return allocate(self.program)

    def run(self, states: Sequence[Array], results: Array, fallback: Fallback) -> PrecisionStatus:
        """Fill `results`, shape (count, entries), from one array of shape (count, width) per argument.

        A block with an input or output that is not finite, or a result that may have lost digits, is left to
        `fallback`. An error among the verdicts ends the run.
        """
        count, dtype = len(results), results.dtype
        length = min(block_length(self.layout.registers, dtype.itemsize), max(count, 1))
        status = OK
        with np.errstate(all="ignore"), _Borrowed(self, length, dtype) as workspace:
            for begin in range(0, count, length):
                end = min(begin + length, count)
                if not self._run_block(workspace, [a[begin:end] for a in states], results[begin:end]):
                    block, found = fallback(begin, end)
                    status = status.worse(found)
                    if status.error is not None:
                        return status
                    results[begin:end] = block
        return status

    def _run_block(self, workspace: Workspace, states: Sequence[Array], results: Array) -> bool:
        """Run one block; False if its results need a closer look."""
        m = len(results)
        rows = workspace.rows[:, :m]
        for place, array in zip(self.inputs, states, strict=True):
            rows[place] = array.T
        if not all([all_finite(rows[k]) for k in self.program.unchecked_inputs]):
            return False
        rates = rows[self.rates.start : self.rates.stop]
        bound = velocity_bound(results.dtype)
        if rates.size and not (rates.max() <= bound and rates.min() >= -bound):
            return False
        for call, arguments in workspace.calls(m):
            call(*arguments)
        outputs = rows[self.first_output :]
        if not all_finite(outputs[: self.entries]):
            return False
        if self.pivots is not None:
            behind = self.entries + self.pivots
            pivots, diagonal = outputs[self.entries : behind].T, outputs[behind : behind + self.pivots].T
            if pivots_below(NEARLY_SINGULAR, pivots, diagonal).any():
                return False
        store(outputs[: self.entries], results)
        return True


class _Borrowed:
    """A workspace of the program's pool, returned when done, so that threads never share one."""

    def __init__(self, owner: BlockProgram, length: int, dtype: np.dtype[Any]) -> None:
        self.pool = owner.workspaces.setdefault(dtype.name, [])
        self.owner, self.length, self.dtype = owner, length, dtype

    def __enter__(self) -> Workspace:
        try:
            self.workspace = self.pool.pop()
        except IndexError:
            self.workspace = Workspace(self.owner.layout, self.length, self.dtype)
        if self.workspace.rows.shape[1] < self.length:
            self.workspace = Workspace(self.owner.layout, self.length, self.dtype)
        return self.workspace

    def __exit__(self, *_: object) -> None:
        self.pool.append(self.workspace)


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
    """Zeros with every row aligned to a cache line, since vector loads across two lines cost twice."""
    line = LINE // dtype.itemsize
    stride = (-(-length // line) + 1) * line  # one more, so that rows do not share the same sets of the cache
    flat = np.zeros(rows * stride + line, dtype=dtype)
    start = -flat.ctypes.data % LINE // dtype.itemsize
    return flat[start : start + rows * stride].reshape(rows, stride)


def _compare(ufunc: Callable[..., Any], a: Array, b: Array, out: Array) -> None:
    ufunc(a, b, out=out, casting="unsafe")


def _where(condition: Array, a: Array, b: Array, out: Array) -> None:
    np.copyto(out, b)
    np.copyto(out, a, where=condition != 0)


def block_length(registers: int, itemsize: int) -> int:
    """States per block: as many as keep the registers in the cache, few enough calls to pay for their overhead."""
    return max(MIN_BLOCK, min(MAX_BLOCK, REGISTER_BYTES // (max(registers, 1) * itemsize) // 64 * 64))


def store(rows: Array, results: Array) -> None:
    """Registers to states: column by column while these share a cache line, otherwise in one sweep."""
    if len(rows) > 8:
        results[...] = rows.T
        return
    for k, row in enumerate(rows):
        results[:, k] = row


def all_finite(rows: Array) -> bool:
    """True if every entry is finite; a finite sum shows it at once."""
    with np.errstate(all="ignore"):
        return bool(np.isfinite(rows.sum())) or bool(np.isfinite(rows).all())


def check_out(
    out: Array, shape: tuple[int, ...], dtype: np.dtype[Any], names: Sequence[str], arrays: Sequence[Array]
) -> Array:
    """Refuse an `out` of another shape or dtype, or one that overlaps an input."""
    if not isinstance(out, np.ndarray) or out.shape != shape or out.dtype != dtype:
        got = f"{out.dtype} {out.shape}" if isinstance(out, np.ndarray) else type(out).__name__
        raise ValueError(f"`out` must be a {dtype} array of shape {shape}, got {got}")
    if not out.flags.c_contiguous or not out.flags.writeable:
        raise ValueError("`out` must be C-contiguous and writeable")
    for name, array in zip(names, arrays, strict=True):
        if np.may_share_memory(out, array):
            raise ValueError(f"`out` must not share memory with `{name}`")
    return out
