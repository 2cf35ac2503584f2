"""A program compiled by LLVM: machine code for one state and for batches, which releases the interpreter's lock.

A batch runs in groups of as many states as a vector register holds. A state that must be examined is left to the
recursion.
"""

from __future__ import annotations

import ctypes
import logging
import threading
import time
import weakref
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cache, partial
from typing import Any

import numpy as np
from llvmlite import ir

from ..basics.spatial import Array
from ..dynamics.quantity import OK, PrecisionStatus
from ..graph.program import with_table
from .machine_code import NUMBERS, Emitter, shuffled
from .object_code import REGISTER_BITS, Library, library
from .python_calls import BYTES, FLOAT64, INTEGER, emit_into, emit_rows_call, emit_state_call, python_function
from .soundness import Conditions, NeedsRecursion, Recursion, Trace

LOGGER = logging.getLogger("rne")
LOCK = threading.Lock()  # for compilations of batches: threads of an ensemble may need the same one
SLOW = 1.0  # duration of a compilation that is logged afterwards [s]
LONG = 5000  # operations of a program whose compilation is announced
FEW, MANY = 16, 1024  # fewest and most states that the recursion examines together


class Inputs:
    """Inputs of a program, loaded where they are first read."""

    def __init__(self, loads: Sequence[Callable[[], ir.Value]]) -> None:
        self.loads = loads
        self.values: dict[int, ir.Value] = {}

    def __getitem__(self, key: Any) -> Any:
        if isinstance(key, slice):
            return [self[k] for k in range(*key.indices(len(self.loads)))]
        if key not in self.values:
            self.values[key] = self.loads[key]()
        return self.values[key]


def emit_group(
    emitter: Emitter, trace: Trace, loads: Sequence[Callable[[], ir.Value]], store: Callable[[list[ir.Value]], None]
) -> ir.Value:
    """Emit the program on the states in the lanes; returns one bit per lane, set where its results are sound."""
    inputs, write = Inputs(loads), Conditions(emitter.finite, emitter.within, emitter.above)
    conditions = trace.sound_inputs(inputs, emitter.dtype, write)
    outputs = emitter.outputs(trace.program, inputs)
    store(outputs[: trace.entries])  # also those that are not sound, which are computed anew
    return emitter.lanes_of(conditions + trace.sound_results(outputs, emitter.dtype, write))


def emit_plain(module: ir.Module, trace: Trace, lanes: int, *, common: bool = False) -> ir.Function:
    """int64 f(const double* a0, ..., double* out): 1 if the results are sound, else 0.

    Argument k has shape (width, lanes), out (entries, lanes), in C order; where the argument that is the same over a
    run is `common` to the lanes, it has shape (width,).
    """
    pointers = [NUMBERS["float64"].as_pointer()] * (len(trace.widths) + 1)
    function = ir.Function(module, ir.FunctionType(INTEGER, pointers), "function")
    builder = ir.IRBuilder(function.append_basic_block())
    emitter = Emitter(builder, "float64", lanes)

    def place(array: ir.Value, k: int) -> ir.Value:
        return builder.bitcast(builder.gep(array, [INTEGER(k * lanes)]), emitter.type.as_pointer())

    def load(array: ir.Value, k: int, *, repeated: bool = False) -> Callable[[], ir.Value]:
        if repeated:
            return lambda: emitter.repeated(builder.gep(array, [INTEGER(k)]))
        return lambda: builder.load(place(array, k), align=1)

    def store(values: list[ir.Value]) -> None:
        for k, value in enumerate(values):
            builder.store(value, place(out, k), align=1)

    *given, out = function.args
    out.add_attribute("noalias")
    loads = [
        load(a, k, repeated=common and number == trace.of_run)
        for number, (a, width) in enumerate(zip(given, trace.widths, strict=True))
        for k in range(width)
    ]
    sound = emit_group(emitter, trace, loads, store)
    builder.ret(builder.zext(builder.icmp_unsigned("==", sound, ir.Constant(sound.type, -1)), INTEGER))
    return function


class Rows:
    """Rows of a row-major array, one for each lane, at offsets from the first one in bytes."""

    def __init__(self, emitter: Emitter, first: ir.Value, offsets: Sequence[ir.Value], width: int) -> None:
        self.emitter, self.width = emitter, width
        self.addresses = [emitter.builder.gep(first, [offset]) for offset in offsets]

    def _pointer(self, lane: int, column: int, kind: ir.Type) -> ir.Value:
        builder = self.emitter.builder
        offset = INTEGER(column * np.dtype(self.emitter.dtype).itemsize)
        return builder.bitcast(builder.gep(self.addresses[lane], [offset]), kind.as_pointer())

    def load(self, column: int) -> ir.Value:
        """Load one column."""
        emitter, lanes = self.emitter, range(self.emitter.lanes)
        return emitter.pack([emitter.builder.load(self._pointer(k, column, emitter.number), align=1) for k in lanes])

    def store(self, values: list[ir.Value]) -> None:
        """Set all columns, two at once: singly they would cost a mass matrix a third of its time."""
        emitter, builder = self.emitter, self.emitter.builder
        two, lanes = ir.VectorType(emitter.number, 2), emitter.lanes
        for first in range(0, self.width - 1, 2):
            left, right = values[first : first + 2]
            for odd in (0, 1):  # rows
                mixed = shuffled(builder, left, right, [k + side for k in range(odd, lanes, 2) for side in (0, lanes)])
                for k in range(0, lanes, 2):
                    row = shuffled(builder, mixed, mixed, [k, k + 1])
                    builder.store(row, self._pointer(k + odd, first, two), align=1)
        if self.width % 2:
            for lane, number in enumerate(emitter.unpack(values[-1])):
                builder.store(number, self._pointer(lane, self.width - 1, emitter.number), align=1)


def emit_rows(module: ir.Module, trace: Trace, dtype: str) -> ir.Function:
    """int64 f(const char* a0, int64 stride0, ..., number* out, int64 begin, int64 end) for rows of arrays.

    It returns the number of the first state to be examined, or `end`. The last group overlaps the one before it, and
    of fewer states than lanes the last one is repeated, so that bits do not depend on the number of states.
    """
    lanes = REGISTER_BITS // 8 // np.dtype(dtype).itemsize
    taken = [BYTES, INTEGER] * (len(trace.widths) + 1) + [INTEGER, INTEGER]
    function = ir.Function(module, ir.FunctionType(INTEGER, taken), "rows")
    function.linkage = "internal"
    *given, begin, end = function.args
    start, group, after, stop = (function.append_basic_block(name) for name in ("start", "group", "after", "stop"))
    builder = ir.IRBuilder(start)

    def least(a: ir.Value, b: ir.Value) -> ir.Value:
        return builder.select(builder.icmp_signed("<", a, b), a, b)

    filled = least(INTEGER(lanes), builder.sub(end, begin))
    last = [least(INTEGER(lane), builder.sub(filled, INTEGER(1))) for lane in range(lanes)]
    arrays = zip(given[::2], given[1::2], (*trace.widths, trace.entries), strict=True)
    offsets = [[builder.mul(lane, stride) for lane in last] for stride in given[1::2]]
    builder.cbranch(builder.icmp_signed("<", begin, end), group, stop)

    builder.position_at_end(group)
    first = builder.phi(INTEGER)
    first.add_incoming(begin, start)
    emitter = Emitter(builder, dtype, lanes)
    *read, written = (
        Rows(emitter, builder.gep(array, [builder.mul(first, stride)]), offset, width)
        for (array, stride, width), offset in zip(arrays, offsets, strict=True)
    )
    loads = [partial(rows.load, k) for rows in read for k in range(rows.width)]
    sound = emit_group(emitter, trace, loads, written.store)
    following = builder.add(first, INTEGER(lanes))
    first.add_incoming(least(following, builder.sub(end, filled)), after)  # the last group overlaps the one before
    examined = builder.block
    unsound = builder.add(first, builder.cttz(builder.not_(builder.zext(sound, INTEGER)), ir.IntType(1)(1)))
    builder.cbranch(builder.icmp_unsigned("==", sound, ir.Constant(sound.type, -1)), after, stop)

    builder.position_at_end(after)
    builder.cbranch(builder.icmp_signed("<", following, end), group, stop)

    builder.position_at_end(stop)
    result = builder.phi(INTEGER)
    result.add_incoming(end, start)
    result.add_incoming(end, after)
    result.add_incoming(unsound, examined)
    builder.ret(result)
    return function


def lanes_library(trace: Trace, lanes: int, *, common: bool = True) -> Library:
    """Library of the program on states side by side: "function" by the interface of loops."""
    form = f"{lanes} lanes, {'common' if common else 'own'} numbers"
    return trace_library(trace, form, "float64", ("function",), partial(emit_plain, lanes=lanes, common=common))


def trace_library(
    trace: Trace, form: str, dtype: str, functions: tuple[str, ...], emit: Callable[[ir.Module, Trace], object]
) -> Library:
    """Library of a form of the program; programs that differ only in numbers share the object code."""
    began = time.perf_counter()
    program, numbers = with_table(trace.program)
    shared = replace(trace, program=program, of_numbers=None)

    def text() -> str:
        count = len(program.instructions)
        if count > LONG:
            LOGGER.info("LLVM compiles a kernel of %d operations, which takes some seconds", count)
        module = ir.Module("rne")
        table = ir.GlobalVariable(module, ir.ArrayType(NUMBERS[dtype], max(len(numbers), 1)), "table")
        table.initializer = ir.Constant(table.value_type, None)
        emit(module, shared)
        return str(module)

    found = library((*functions, "table"), (form, dtype, repr(shared)), text, loops=False)
    with np.errstate(over="ignore"):
        content = np.array(numbers, dtype).tobytes()
    ctypes.memmove(found.address["table"], content, len(content))
    found.seconds = time.perf_counter() - began
    if found.seconds > SLOW:
        LOGGER.info("LLVM took %.1f s to compile a kernel", found.seconds)
    return found


def state_function(trace: Trace) -> Any:
    """Function of one float64 vector per argument, as `python_backend.state_function`."""

    def emit(module: ir.Module, trace: Trace) -> None:
        plain = emit_plain(module, trace, 1)
        emit_state_call(module, plain, trace.widths)
        emit_into(module, plain, trace.widths, trace.shape)

    found = trace_library(trace, "state", "float64", ("function", "call", "into"), emit)
    function = from_text(STATE, trace, state=python_function(found))
    function.seconds, function.library = found.seconds, found
    return function


def into(kernel: Any) -> Callable[..., Array]:
    """Machine code of `Kernel.into`, which leaves all but sound results of right arguments to Python."""
    kept, recipe = weakref.ref(kernel), kernel.__reduce__()  # a cycle would keep machine code until it is looked for
    again: Any = cache(lambda: recipe[0](*recipe[1]))  # of a kernel that no one else has kept

    def otherwise(*arrays: Any, out: Array | None = None) -> Any:
        return (kept() or again()).checked_into(*arrays, out=out)

    otherwise.__qualname__ = "Kernel.into"  # for Python's errors
    return python_function(kernel.state_function.library, name="into", otherwise=otherwise)


def fast_call(kernel: Any) -> Callable[..., Array | None]:
    """Function of plain float64 arrays, vectors or rows, compiled at its first call; it returns None for others."""
    kept: Any = weakref.ref(kernel)  # a cycle would keep machine code until it is looked for

    def state(*arrays: Any) -> Any:
        names = kept().fast_call.__globals__
        names["state"] = kept().state_function.__globals__["state"]
        return names["state"](*arrays)

    def rows(*arrays: Any) -> Any:
        names = kept().fast_call.__globals__
        names["rows"] = kept().blocks.compiled(FLOAT64)
        return names["rows"](*arrays)

    call: Callable[..., Array] = from_text(FAST, kernel.traced, state=state, rows=rows)
    return call


def plain_copy(array: Array, dtype: np.dtype[Any] = FLOAT64) -> Array:
    """Copy in C order with this very dtype object, which a pickled array does not have."""
    copy = np.empty(np.shape(array), dtype)
    copy[...] = array
    return copy


def from_text(text: str, trace: Trace, **names: Any) -> Any:
    """Function defined by a text, with the arguments of a trace."""
    arguments = ", ".join(f"a{k}" for k in range(len(trace.widths)))
    namespace = {"empty": np.empty, "plain_copy": plain_copy, "ndarray": np.ndarray, "shape": trace.shape, **names}
    namespace["NeedsRecursion"] = NeedsRecursion
    exec(text.format(arguments=arguments, result="out" if trace.shape else "out[()]"), namespace)
    return namespace.pop("function")


# An array that Python makes costs less than one that machine code hands over.
STATE = """def function({arguments}):
    out = empty(shape)
    sound = state({arguments}, out)
    if sound is None:
        sound = state(*[plain_copy(a) for a in ({arguments},)], out)
    if sound == 1:
        return {result}
    if sound == 0:
        raise NeedsRecursion
    raise TypeError("not one vector per argument")
"""
FAST = """def function({arguments}):
    if type(a0) is not ndarray:
        return
    if a0.ndim == 1:
        out = empty(shape)
        sound = state({arguments}, out)
        if sound == 1:
            return {result}
        if sound == 0:
            raise NeedsRecursion
    elif a0.ndim == 2:
        out = empty((len(a0), *shape))
        if rows({arguments}, out, 0) == len(a0):
            return out
"""


class BatchProgram:
    """Trace that runs on arrays of states, as `numpy_backend.BlockProgram`."""

    def __init__(self, trace: Trace) -> None:
        self.trace = trace
        self.seconds = 0.0  # that compilations took
        self._functions: dict[np.dtype[Any], Callable[..., Any]] = {}

    def compiled(self, dtype: np.dtype[Any]) -> Callable[..., Any]:
        """f(*arguments, out, begin) -> first state to be examined, or number of states; None for other arrays."""

        def emit(module: ir.Module, trace: Trace) -> None:
            function = emit_rows(module, trace, dtype.name)
            emit_rows_call(module, function, trace.widths, trace.entries, dtype.itemsize)

        if dtype not in self._functions:
            with LOCK:
                if dtype not in self._functions:
                    found = trace_library(self.trace, "rows", dtype.name, ("call",), emit)
                    self.seconds += found.seconds
                    self._functions[dtype] = python_function(found, dtype)
        return self._functions[dtype]

    def run(self, states: Sequence[Array], results: Array, recursion: Recursion) -> PrecisionStatus:
        """Fill `results`, shape (count, entries), from one array of shape (count, width) per argument.

        States not known to be sound are left to the recursion, whose first error ends the run: few at first, more
        where they follow one another.
        """
        dtype = np.dtype(results.dtype.type)  # the one that arrays share, but those that were pickled
        function, count, status, stretch = self.compiled(dtype), len(results), OK, FEW
        if not count:
            return OK
        states = [a if a.ndim > 1 else np.broadcast_to(a, (count, len(a))) for a in states]  # common to all
        begin = function(*states, results, 0)
        if begin is None:
            with np.errstate(all="ignore"):
                states = [plain_copy(a, dtype) for a in states]
            begin = function(*states, results, 0)
        while begin < count:
            end = min(begin + stretch, count)
            with np.errstate(all="ignore"):
                block, found = recursion(begin, end)
            status = status.worse(found)
            if status.error is not None:
                break
            results[begin:end] = block
            begin = function(*states, results, end)
            stretch = min(2 * stretch, MANY) if begin == end else FEW
        return status
