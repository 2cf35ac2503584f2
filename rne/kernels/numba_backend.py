"""A program compiled by Numba: one function for one state, one for batches, which releases the interpreter's lock.

The program becomes LLVM instructions (`machine_code`) inside functions that Numba compiles and calls. A batch runs
in groups of as many states as a vector register holds. A group with an angle beyond the reach of the polynomials, or
whose result must be examined, runs state by state; a state that must be examined is left to the recursion.
"""

from __future__ import annotations

import itertools
import logging
import threading
import time
import weakref
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from llvmlite import binding
from numba import njit, types
from numba.extending import intrinsic

from ..basics.spatial import Array
from ..dynamics.quantity import OK, PrecisionStatus
from .machine_code import LARGEST, Emitter, Rows
from .program import NeedsRecursion, Recursion, Trace

LOGGER = logging.getLogger("rne")
LOCK = threading.Lock()  # of the compilation of batches: threads of an ensemble ask for the same one at once
SLOW = 1.0  # s of a compilation of which the logger tells afterwards
LONG = 2000  # operations of a program whose compilation it announces
FEW, MANY = 16, 1024  # states that the recursion examines together
REGISTER_BITS = 512 if binding.get_host_cpu_features().get("avx512f") else 256
TYPES: dict[str, Any] = {"float64": types.float64, "float32": types.float32}


class Section:
    """The instructions that a group of states runs, as many as it has lanes: load, compute, store, check.

    Results are stored before it is known whether they are sound; those that are not are computed anew.
    """

    def __init__(self, trace: Trace, dtype: str, lanes: int) -> None:
        self.trace, self.dtype, self.lanes = trace, dtype, lanes
        self.key = next(KEYS)
        SECTIONS[self.key] = self

    def emit(self, context: Any, builder: Any, signature: Any, args: Sequence[Any]) -> Any:
        """Append the section to a function that Numba is building; true if the results are sound."""
        _, given, out_type, _ = signature.args
        _, arguments, out, row = args
        emitter, trace = Emitter(builder, self.dtype, self.lanes), self.trace
        inputs = []
        for k, (kind, width) in enumerate(zip(given, trace.widths, strict=True)):
            array = context.make_array(kind)(context, builder, builder.extract_value(arguments, k))
            rows = Rows(emitter, array, kind.ndim, row)
            inputs += [rows.load(column) for column in range(width)]
        outputs, angles = emitter.outputs(trace.program, inputs)
        rows = Rows(emitter, context.make_array(out_type)(context, builder, out), out_type.ndim, row)
        for column, result in enumerate(outputs[: trace.entries]):
            rows.store(column, result)
        sound = trace.sound_inputs(inputs, self.dtype, emitter) + trace.sound_results(outputs, self.dtype, emitter)
        moderate = [emitter.at_most(emitter.intrinsic("fabs", angle), emitter.constant(LARGEST)) for angle in angles]
        return emitter.all(sound + moderate)


# Numba keeps every intrinsic for ever. There is one, which finds its section by a number that is constant in the text.
KEYS = itertools.count()
SECTIONS: weakref.WeakValueDictionary[int, Section] = weakref.WeakValueDictionary()


def _codegen(context: Any, builder: Any, signature: Any, args: Sequence[Any]) -> Any:
    return SECTIONS[signature.args[0].literal_value].emit(context, builder, signature, args)


@intrinsic(prefer_literal=True)
def run_section(typing_context: Any, key: Any, arguments: Any, out: Any, row: Any) -> Any:
    """In compiled code: the section on the states from `row` on; True if their results are sound."""
    return types.boolean(key, arguments, out, row), _codegen


def state_function(trace: Trace) -> Callable[..., Array]:
    """A function of one float64 vector per argument, as `python_backend.state_function`."""
    single, shape = Section(trace, "float64", 1), trace.shape
    out = types.Array(types.float64, max(len(shape), 1), "C")
    compiled = _compiled(STATE, trace, _vectors(trace, 1, types.float64) + [out], {"single": single.key})
    # An array that Python makes costs less than one that compiled code hands over.
    text = CALL.format(arguments=_arguments(trace), result="out" if shape else "out[0]")
    namespace = {"compiled": compiled, "empty": np.empty, "shape": shape or (1,), "NeedsRecursion": NeedsRecursion}
    exec(text, namespace)
    function: Any = namespace["function"]
    function.seconds = compiled.seconds
    return function  # type: ignore[no-any-return]


STATE = """def function({arguments}, out):
    return run_section({single}, ({arguments},), out.ravel(), 0)
"""
CALL = """def function({arguments}):
    out = empty(shape)
    if not compiled({arguments}, out):
        raise NeedsRecursion
    return {result}
"""
# The last group overlaps the one before it, so that bits do not depend on the number of states.
BATCH = """def function({arguments}, out, begin, end):
    k = begin
    while k < end:
        last = min(k + {lanes}, end)
        first = max(last - {lanes}, begin)
        if last - first < {lanes} or not run_section({group}, ({arguments},), out, first):
            for row in range(first, last):
                if not run_section({single}, ({arguments},), out, row):
                    return row
        k = last
    return end
"""


class BatchProgram:
    """A trace that runs on arrays of states, as `numpy_backend.BlockProgram`."""

    def __init__(self, trace: Trace) -> None:
        self.trace = trace
        self._functions: dict[np.dtype[Any], Any] = {}
        self._loops: dict[Any, Any] = {}

    @property
    def seconds(self) -> float:
        """Time that compilations took [s]."""
        return float(sum(function.seconds for function in self._functions.values()))

    def function(self, dtype: np.dtype[Any]) -> Any:
        """Compiled: f(*arguments, out, begin, end) -> number of the first state to be examined, or end."""
        if dtype not in self._functions:
            with LOCK:
                if dtype not in self._functions:
                    self._functions[dtype] = self._function(dtype.name)
        return self._functions[dtype]

    def loop(self, key: Any, make: Callable[[], Any]) -> Any:
        """A compiled loop that calls `function`, made once for each key."""
        if key not in self._loops:
            self._loops[key] = make()
        return self._loops[key]

    def _function(self, dtype: str) -> Any:
        lanes, number = REGISTER_BITS // 8 // np.dtype(dtype).itemsize, TYPES[dtype]
        group, single = (Section(self.trace, dtype, n) for n in (lanes, 1))
        kinds = [*_vectors(self.trace, 2, number), types.Array(number, 2, "C"), types.int64, types.int64]
        keys = {"group": group.key, "single": single.key, "lanes": lanes}
        return _compiled(BATCH, self.trace, kinds, keys, releases_lock=True)

    def run(self, states: Sequence[Array], results: Array, recursion: Recursion) -> PrecisionStatus:
        """Fill `results`, shape (count, entries), from one array of shape (count, width) per argument.

        States that are not known to be sound are left to the recursion: few at first, more where they follow one
        another. Its first error ends the run.
        """
        function, count, status, stretch = self.function(results.dtype), len(results), OK, FEW
        with np.errstate(all="ignore"):
            arrays = [a.astype(results.dtype, copy=False) for a in states]
            begin = function(*arrays, results, 0, count)
            while begin < count:
                end = min(begin + stretch, count)
                block, found = recursion(begin, end)
                status = status.worse(found)
                if status.error is not None:
                    break
                results[begin:end] = block
                begin = function(*arrays, results, end, count)
                stretch = min(2 * stretch, MANY) if begin == end else FEW
        return status


def _arguments(trace: Trace) -> str:
    return ", ".join(f"a{k}" for k in range(len(trace.widths)))


def _vectors(trace: Trace, ndim: int, number: Any) -> list[Any]:
    """Types of the arguments: any strides, not written to."""
    return [types.Array(number, ndim, "A", readonly=True, aligned=False)] * len(trace.widths)


def _compiled(
    text: str, trace: Trace, kinds: Sequence[Any], keys: Mapping[str, int], releases_lock: bool = False
) -> Any:
    """The `function` of a text, compiled for arguments of these types."""
    count = len(trace.program.instructions)
    if count > LONG:
        LOGGER.info("Numba compiles a kernel of %d operations, which takes some seconds", count)
    namespace: dict[str, Any] = {"run_section": run_section}
    exec(text.format(arguments=_arguments(trace), **keys), namespace)
    began = time.perf_counter()
    compiled: Any = njit([tuple(kinds)], nogil=releases_lock)(namespace["function"])
    compiled.seconds = time.perf_counter() - began
    if compiled.seconds > SLOW:
        LOGGER.info("Numba took %.1f s to compile a kernel", compiled.seconds)
    return compiled
