"""A program compiled by Numba: one function for one state, one for batches, which releases the interpreter's lock.

The program becomes LLVM instructions (`machine_code`) inside functions that Numba compiles and calls. A batch runs
in groups of as many states as a vector register holds. A group with an angle beyond the reach of the polynomials, or
whose result must be examined, runs state by state; a state that must be examined is left to the recursion.
"""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from llvmlite import binding
from numba import njit, types
from numba.extending import intrinsic

from ..basics.spatial import Array
from ..dynamics.conditioning import NEARLY_SINGULAR, rate_bound
from ..dynamics.verdict import SOUND, Verdict
from .engines import Fallback
from .machine_code import Emitter, Rows
from .machine_sine import LARGEST
from .program import Program
from .python_backend import Guard, Refused

LOGGER = logging.getLogger("rne")
LOCK = threading.Lock()
SLOW = 1.0  # s of a compilation that is announced
EXAMINED = 1024  # states that the recursion examines together
REGISTER_BITS = 512 if binding.get_host_cpu_features().get("avx512f") else 256
TYPES: dict[str, Any] = {"float64": types.float64, "float32": types.float32}


def lanes_of(dtype: str) -> int:
    """States per group: numbers in a vector register."""
    return REGISTER_BITS // 8 // np.dtype(dtype).itemsize


class Section:
    """What one group of states runs: load, compute, check, store.

    Parameters
    ----------
    program : Program
    widths : sequence of int
        Number of inputs of each argument.
    entries : int
        Number of entries of the result.
    guard : Guard or None
    """

    def __init__(self, program: Program, widths: Sequence[int], entries: int, guard: Guard | None) -> None:
        self.program, self.widths, self.entries, self.guard = program, tuple(widths), entries, guard

    def inlined(self, dtype: str, lanes: int) -> Any:
        """For compiled code: group(arguments, out, row) -> True if the results of these states are sound."""

        def codegen(context: Any, builder: Any, signature: Any, args: Sequence[Any]) -> Any:
            given, out_type, _ = signature.args
            emitter = Emitter(builder, dtype, lanes)
            inputs = []
            for k, (kind, width) in enumerate(zip(given, self.widths, strict=True)):
                array = context.make_array(kind)(context, builder, builder.extract_value(args[0], k))
                rows = Rows(emitter, array, kind.ndim, args[2])
                inputs += [rows.load(column) for column in range(width)]
            outputs, angles = emitter.outputs(self.program, inputs)
            results = outputs[: self.entries]
            array = context.make_array(out_type)(context, builder, args[1])
            rows = Rows(emitter, array, out_type.ndim, args[2])
            for column, result in enumerate(results):
                rows.store(column, result)
            return emitter.all(self._conditions(emitter, inputs, outputs, angles))

        @intrinsic
        def group(typing_context: Any, arguments: Any, out: Any, row: Any) -> Any:
            return types.boolean(arguments, out, row), codegen

        return group

    def _conditions(self, emitter: Emitter, inputs: list[Any], outputs: list[Any], angles: list[Any]) -> list[Any]:
        """When a group needs no closer look: finite inputs and results, moderate angles and rates, sound pivots."""
        builder, n = emitter.builder, self.entries
        unchecked = [inputs[k] for k in self.program.unchecked_inputs]
        conditions = [emitter.is_finite(emitter.total([*unchecked, *outputs[:n]]))]
        for angle in angles:
            conditions.append(builder.fcmp_ordered("<=", emitter.intrinsic("fabs", angle), emitter.constant(LARGEST)))
        if self.guard is not None:
            rates = [builder.fmul(inputs[k], inputs[k]) for k in self.guard.rates]
            bound = emitter.constant(self.guard.rate_bound**2)
            conditions.append(builder.fcmp_ordered("<=", emitter.total(rates), bound))
            factor = emitter.constant(self.guard.pivot_factor)
            behind = n + self.guard.n
            for pivot, diagonal in zip(outputs[n:behind], outputs[behind:], strict=True):
                conditions.append(builder.fcmp_ordered(">", pivot, builder.fmul(factor, diagonal)))
        return conditions


def compiled_function(
    program: Program, widths: Sequence[int], shape: tuple[int, ...], guard: Guard | None = None
) -> Callable[..., Array]:
    """A function of one float64 vector per argument, as `python_backend.compiled_function`."""
    single = Section(program, widths, int(np.prod(shape, dtype=np.int64)), guard).inlined("float64", 1)
    out = types.Array(types.float64, max(len(shape), 1), "C")
    text = "return single(({arguments},), out.ravel(), 0)"
    compiled = _compiled(text, len(widths), {"single": single}, _vector(1), ["out"], [out])
    namespace = {"compiled": compiled, "empty": np.empty, "shape": shape or (1,), "Refused": Refused}
    arguments = ", ".join(f"a{k}" for k in range(len(widths)))
    lines = [
        f"def function({arguments}):",
        "    out = empty(shape)",  # which costs less than an array that compiled code hands over
        f"    if not compiled({arguments}, out):",
        "        raise Refused",
        f"    return {'out' if shape else 'out[0]'}",
    ]
    exec("\n".join(lines) + "\n", namespace)
    function: Any = namespace["function"]
    function.seconds = compiled.seconds
    return function  # type: ignore[no-any-return]


class BatchProgram:
    """A program that runs on arrays of states, as `numpy_backend.BlockProgram`.

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
        self.program, self.widths, self.entries, self.pivots, self.rates = program, widths, entries, pivots, rates
        self._functions: dict[np.dtype[Any], Any] = {}
        self.built_on: dict[Any, Any] = {}  # compiled loops that call it

    @property
    def seconds(self) -> float:
        """Time that compilations took [s]."""
        return float(sum(function.seconds for function in self._functions.values()))

    def function(self, dtype: np.dtype[Any]) -> Any:
        """Compiled: f(*arguments, out, begin, end) -> number of the first state to be examined, or end."""
        if dtype not in self._functions:
            with LOCK:  # or each thread would compile it
                if dtype not in self._functions:
                    self._functions[dtype] = self._function(dtype.name)
        return self._functions[dtype]

    def _function(self, dtype: str) -> Any:
        guard = None
        if self.pivots is not None:
            factor = NEARLY_SINGULAR * self.pivots * float(np.finfo(dtype).eps)
            guard = Guard(factor, self.pivots, self.rates, rate_bound(np.dtype(dtype)))
        section = Section(self.program, self.widths, self.entries, guard)
        lanes = lanes_of(dtype)
        names = {"group": section.inlined(dtype, lanes), "single": section.inlined(dtype, 1), "lanes": lanes}
        number = TYPES[dtype]
        out = types.Array(number, 2, "C")
        further, their_types = ["out", "begin", "end"], [out, types.int64, types.int64]
        return _compiled(BATCH, len(self.widths), names, _vector(2, number), further, their_types)

    def run(self, states: Sequence[Array], results: Array, fallback: Fallback) -> Verdict:
        """Fill `results`, shape (count, entries), from one array of shape (count, width) per argument.

        States that need a closer look are left to `fallback`. An error among the verdicts ends the run.
        """
        function = self.function(results.dtype)
        arrays = [a.astype(results.dtype, copy=False) for a in states]
        verdict, count = SOUND, len(results)
        begin = function(*arrays, results, 0, count)
        while begin < count:
            end = min(begin + EXAMINED, count)
            block, found = fallback(begin, end)
            verdict = verdict.worse(found)
            if verdict.error is not None:
                break
            results[begin:end] = block
            begin = function(*arrays, results, end, count)
        return verdict


BATCH = """k = begin
while k < end:
    last = min(k + lanes, end)
    if k + lanes > end or not group(({arguments},), out, k):
        for row in range(k, last):
            if not single(({arguments},), out, row): return row
    k = last
return end"""


def _vector(ndim: int, number: Any = types.float64) -> Any:
    """The type of an argument: any strides, not written to."""
    return types.Array(number, ndim, "A", readonly=True, aligned=False)


def _compiled(
    body: str, count: int, names: Mapping[str, Any], argument: Any, further: Sequence[str], their_types: Sequence[Any]
) -> Any:
    """The compiled function of `count` arrays, named in the text by {arguments}, and further arguments."""
    arguments = ", ".join(f"a{k}" for k in range(count))
    text = body.format(arguments=arguments).replace("\n", "\n    ")
    namespace = dict(names)
    exec(f"def function({', '.join([arguments, *further])}):\n    {text}\n", namespace)
    began = time.perf_counter()
    compiled: Any = njit([(*[argument] * count, *their_types)], nogil=len(further) > 1)(namespace["function"])
    compiled.seconds = time.perf_counter() - began
    if compiled.seconds > SLOW:
        LOGGER.info("Numba took %.1f s to compile a kernel", compiled.seconds)
    return compiled
