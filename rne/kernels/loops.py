"""Loops in machine code around kernels: what a loop's text may call, and its compilation.

A loop's text is Python that works on arrays of float64 or int64, C-contiguous, on numbers and on tuples of these. It
allocates nothing, raises nothing, and calls only `evaluate`, texts marked by `inline` and functions of `math`. Run as
it stands it is the same algorithm with functions in place of addresses.
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import Any, TypeVar

from ..basics.spatial import Array

Text = TypeVar("Text", bound=Callable[..., Any])
INLINED: list[Callable[..., Any]] = []  # texts that other texts call, not yet known to Numba


def _lanes() -> int:
    try:
        from .object_code import REGISTER_BITS
    except ImportError:
        return 4
    return REGISTER_BITS // 64


LANES = _lanes()  # float64 in a vector register


def evaluate(function: Any, arguments: tuple[Array, ...], out: Array) -> bool:
    """A kernel on one state or on LANES states side by side; True if the result in `out` is sound.

    In machine code `function` is the address that `Kernel.address` gives, here any f(*arguments, out) -> bool.
    """
    return bool(function(*arguments, out))


def inline(text: Text) -> Text:
    """Mark a text that other texts call."""
    INLINED.append(text)
    return text


def compiled(text: Callable[..., Any]) -> Callable[..., Any]:
    """A text in machine code, called like the text itself; compiled for the types of its first arguments."""

    @functools.wraps(text)
    def call(*arguments: Any) -> Any:
        return _dispatcher(text)(*arguments)

    return call


@functools.cache
def _dispatcher(text: Callable[..., Any]) -> Any:
    from numba import njit
    from numba.extending import register_jitable

    _teach_evaluate()
    while INLINED:
        register_jitable(fastmath={"contract", "nsz"})(INLINED.pop())
    return njit(nogil=True, error_model="numpy", fastmath={"contract", "nsz"})(text)


@functools.cache
def _teach_evaluate() -> None:
    """Tell Numba how to call an address."""
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
