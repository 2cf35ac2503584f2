"""Loops in machine code around kernels: their compilation, and the functions they may call.

The source of a loop is Python that works on contiguous arrays of float64 or int64, numbers and tuples of these, named
or not. It allocates nothing, raises nothing, and calls only `evaluate`, functions marked by `inline` or `by_loops`, and
those of `math`. Python can run it too, with functions instead of addresses. Numba translates it once; the code that
LLVM makes of it is kept on disk, so that other processes need no Numba.
"""

from __future__ import annotations

import functools
import importlib.util
import inspect
import logging
import math
import re
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

import numpy as np

from ..basics.arrays import TIME_ROUNDING
from ..basics.spatial import Array

LOGGER = logging.getLogger("rne")
Text = TypeVar("Text", bound=Callable[..., Any])
INLINED: list[Callable[..., Any]] = []  # functions called by others, not yet registered with Numba
REPLACED: list[tuple[Callable[..., Any], Callable[..., Any]]] = []  # functions of NumPy and their loops, likewise
TRANSLATING = threading.Lock()
NO_PIECES: Array = np.zeros(0)  # placeholder for a table of pieces
OPTIONS: Any = {"error_model": "numpy", "fastmath": {"contract", "nsz"}, "no_cpython_wrapper": True}
OPTIONS |= {"no_cfunc_wrapper": True, "_nrt": False}  # loops own no memory, so count no references


def _lanes() -> int:
    try:
        from ..kernels.object_code import REGISTER_BITS
    except ImportError:
        return 4
    return REGISTER_BITS // 64


LANES = _lanes()  # number of float64 in a vector register


def evaluate(function: Any, arguments: tuple[Array, ...], out: Array) -> bool:
    """Evaluate a kernel on one state or on LANES states side by side; True if the result in `out` is valid.

    In machine code `function` is the address that `Kernel.address` gives, here any f(*arguments, out) -> bool.
    """
    return bool(function(*arguments, out))


def inline(text: Text) -> Text:
    """Mark a function that compiled loops may call."""
    INLINED.append(text)
    return text


def by_loops(loops: Callable[..., Any]) -> Callable[[Text], Text]:
    """Mark a function of whole arrays that machine code replaces by loops with the same arguments."""

    def mark(function: Text) -> Text:
        REPLACED.append((function, loops))
        return function

    return mark


class StateUpdate(NamedTuple):
    """Numbers that give a sampled law's states at the next sample: keep z + gain times what the law returned for z."""

    keep: float  # 1 or 0
    gain: float

    @classmethod
    def of(cls, period: float, *, discrete: bool) -> StateUpdate:
        """Update by Euler's rule from rates dz/dt over a sample time, or by the next states of a discrete law."""
        return cls(0.0, 1.0) if discrete else cls(1.0, period)


@inline
def next_state(update: Any, z: Any, returned: Any) -> Any:
    """A sampled law's state, or states, at the next sample: a `keep` that is a factor would change how sums round."""
    return (z if update.keep != 0.0 else 0.0) + update.gain * returned


@inline
def rows_begun(table: Any, t: Any) -> Any:
    """Number of rows of a table that begin at t or before; first entries ascend."""
    lower, upper = 0, len(table)
    while lower < upper:
        middle = (lower + upper) // 2
        lower, upper = (middle + 1, upper) if table[middle, 0] <= t else (lower, middle)
    return lower


@inline
def row_at(table: Any, t: Any) -> Any:
    """Index of the row of a table of pieces, (N, width), that holds at a time; -1 outside of it."""
    start, end = table[0, 0], table[-1, 1]
    slack = TIME_ROUNDING * max(abs(start), abs(end))
    return max(rows_begun(table, t) - 1, 0) if start - slack <= t <= end + slack else -1


@inline
def put_piece(table: Any, t: Any, piece: Any, k: Any, lanes: Any) -> None:
    """Write the row that holds at a time into lane k of `piece`, NaN outside of the table; nothing for NO_PIECES."""
    if table.ndim == 1:  # known when machine code is made: no loop without a table looks for one
        return
    if piece[k] <= t < piece[lanes + k]:
        return
    row = row_at(table, t)
    for i in range(table.shape[1]):
        piece[i * lanes + k] = table[row, i] if row >= 0 else math.nan


@inline
def put_time(arguments: Any, interval: Any, t: Any) -> None:
    """Write the time of a stage, clipped to the interval, and the piece of a motion that holds then."""
    time = min(max(t, interval.first), interval.last)
    arguments[0][0] = time
    put_piece(interval.table, time, arguments[-2], 0, 1)


@functools.cache
def compiled(text: Callable[..., Any]) -> Callable[..., Any]:
    """Function in machine code, called like the original; compiled for the kinds of its arguments at a first call."""
    made: dict[str, Any] = {}
    last: Any = lambda *_: None  # noqa: E731

    @functools.wraps(text)
    def call(*arguments: Any) -> Any:
        nonlocal last
        result = last(*arguments)
        if result is None:  # it was made for other kinds of arguments
            arguments = _plain(arguments)
            kind = kind_of(arguments)
            with TRANSLATING:  # threads that begin together wait for one compilation
                if kind not in made:
                    made[kind] = _compiled(text, arguments, kind)
            last = found = made[kind]  # another thread may set `last` for its own kinds
            result = found(*arguments)
            if result is None:
                raise RuntimeError(f"{text.__qualname__} raised an exception in machine code")
        return result

    return call


def _plain(value: Any) -> Any:
    """An argument as an array, an int, a float or a tuple of these."""
    if isinstance(value, tuple):
        return type(value)(*map(_plain, value)) if hasattr(value, "_fields") else tuple(map(_plain, value))
    if isinstance(value, np.ndarray):
        for dtype in (np.dtype("float64"), np.dtype("int64")):
            if value.dtype == dtype and value.flags.c_contiguous and value.flags.aligned:
                return value.view(np.ndarray).view(dtype)
        raise TypeError(f"loops take C-contiguous arrays of float64 or int64, got {value.dtype}, {value.strides}")
    return int(value) if isinstance(value, (int, np.integer, np.bool_)) else float(value)


def kind_of(value: Any) -> str:
    """Kind of an argument for which code is compiled: "f2" for a float64 matrix, "i" for an int, (f1 f) for a tuple."""
    if isinstance(value, tuple):
        return f"({' '.join(map(kind_of, value))})"
    if isinstance(value, np.ndarray):
        return f"{value.dtype.kind}{value.ndim}"
    return "i" if isinstance(value, int) else "f"


def _compiled(text: Callable[..., Any], arguments: tuple[Any, ...], kind: str) -> Any:
    from ..kernels.object_code import library
    from ..kernels.python_calls import python_function

    if text.__closure__:
        raise TypeError(f"{text.__qualname__} depends on variables of the function that it stands in")
    source = Path(inspect.getfile(text)).read_text(encoding="utf-8")
    description = ("loop", numba_version(), _sources(), source, text.__qualname__, kind)
    return python_function(library(["call"], description, lambda: _llvm_text(text, arguments), loops=True))


@functools.cache
def _sources() -> str:
    """Source files of this folder, whose functions call one another: a change in one invalidates the cache on disk."""
    return "".join(path.read_text(encoding="utf-8") for path in sorted(Path(__file__).parent.glob("*.py")))


@functools.cache
def numba_version() -> str:
    """The version of Numba, found without importing it; empty if it is not installed."""
    found = importlib.util.find_spec("numba")
    if found is None or found.origin is None:
        return ""
    return " ".join(sorted(path.name for path in Path(found.origin).parents[1].glob("numba-*")))


@functools.cache
def _announce() -> None:
    """Log once per process why the first simulation takes long."""
    LOGGER.info("Numba translates the loops of simulations, about 10 s in all, once on this machine")


def _llvm_text(text: Callable[..., Any], arguments: tuple[Any, ...]) -> str:
    """LLVM instructions of a function, with "call" for Python and without names that belong to Numba."""
    from llvmlite import ir
    from numba import njit, types
    from numba.extending import register_jitable

    from ..kernels.python_calls import RETURNED, emit_loop_call

    _announce()
    _teach_evaluate()
    while INLINED:
        register_jitable(**OPTIONS)(INLINED.pop())
    while REPLACED:
        _teach_loops(*REPLACED.pop())
    kinds = tuple(map(_numba_type, arguments))
    function: Any = njit(kinds, **OPTIONS)(text)
    made = function.overloads[kinds]
    name, returned = made.fndesc.llvm_func_name, str(types.unliteral(made.signature.return_type))  # type: ignore[no-untyped-call]
    if returned not in RETURNED:
        raise TypeError(f"{text.__qualname__} returns {returned}, not one of {', '.join(RETURNED)}")
    module = ir.Module("call")
    emit_loop_call(module, name, arguments, returned)
    call = [line for line in str(module).splitlines() if not line.startswith(("target", f'declare i32 @"{name}"'))]
    body = re.sub(r"^define (linkonce_odr )?", "define internal ", made.library.get_llvm_str(), flags=re.M)
    body = re.sub(r" = common \w+ global ptr null$", " = internal global ptr null", body, flags=re.M)
    body = re.sub(r"@numba_(\w+)", r"@\1", body)  # Numba's copies of functions of the C library
    return "\n".join([body, *call])


def _numba_type(value: Any) -> Any:
    from numba import types

    if isinstance(value, tuple):
        items = [_numba_type(item) for item in value]
        return types.NamedTuple(items, type(value)) if hasattr(value, "_fields") else types.Tuple(items)  # type: ignore[no-untyped-call]
    if isinstance(value, np.ndarray):
        return types.Array(types.float64 if value.dtype.kind == "f" else types.int64, value.ndim, "C")
    return types.int64 if isinstance(value, int) else types.float64


def _teach_loops(function: Callable[..., Any], loops: Callable[..., Any]) -> None:
    """Register with Numba the loops that replace functions of NumPy."""
    from numba.extending import overload

    def chosen(*_: Any) -> Callable[..., Any]:
        return loops

    chosen.__signature__ = inspect.signature(loops)  # type: ignore[attr-defined]
    overload(function, jit_options=OPTIONS)(chosen)


@functools.cache
def _teach_evaluate() -> None:
    """Register with Numba how an address is called."""
    from llvmlite import ir
    from numba import types
    from numba.extending import intrinsic, overload

    def emit(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        _, given, out = signature.args
        arrays = [(kind, builder.extract_value(args[1], k)) for k, kind in enumerate(given)] + [(out, args[2])]
        number = ir.DoubleType().as_pointer()
        pointers = [context.make_array(kind)(context, builder, value).data for kind, value in arrays]
        function = ir.FunctionType(ir.IntType(64), [number] * len(pointers)).as_pointer()
        sound = builder.call(builder.inttoptr(args[0], function), pointers)
        return builder.icmp_unsigned("!=", sound, ir.Constant(ir.IntType(64), 0))

    call: Any = intrinsic(
        lambda typing_context, function, arguments, out: (types.boolean(function, arguments, out), emit)
    )
    overload(evaluate)(lambda function, arguments, out: lambda function, arguments, out: call(function, arguments, out))
