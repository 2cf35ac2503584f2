"""Machine code that Python calls like its own functions in C, and that reads arrays in place.

An array is taken as it is, by the addresses of its numbers, shape and strides, which are where array_layout has them.
For arguments of other types than the code was made for the result is None.
"""

from __future__ import annotations

import ctypes
import sys
from collections.abc import Callable, Sequence
from math import prod
from typing import Any

import numpy as np
from llvmlite import ir

from .array_layout import AXES, DATA, DTYPE, FLAGS, HEAD, ITEMS, PLAIN, SHAPE, STRIDES, TUPLES, WRITEABLE
from .object_code import Library

INTEGER, NUMBER, BYTES = ir.IntType(64), ir.DoubleType(), ir.IntType(8).as_pointer()
FASTCALL = 0x80  # METH_FASTCALL: f(self, arguments, their number)
KEYWORDS = 0x02  # METH_KEYWORDS: and the names of those at the end that are given by name, or NULL
OUT = sys.intern("out")
# Objects in `self`, in this order, for comparisons.
FLOAT64, INT64 = np.dtype("float64"), np.dtype("int64")
KNOWN = (None, np.ndarray, int, float, np.float64, INT64, FLOAT64)


class MethodDefinition(ctypes.Structure):
    """Structure PyMethodDef."""

    _fields_ = (
        ("name", ctypes.c_char_p),
        ("function", ctypes.c_void_p),
        ("flags", ctypes.c_int),
        ("doc", ctypes.c_char_p),
    )


def python_function(
    library: Library, dtype: np.dtype[Any] = FLOAT64, name: str = "call", otherwise: Any = None
) -> Callable[..., Any]:
    """Python function of a library; arrays are of this dtype, and "into" leaves others to `otherwise`."""
    flags = FASTCALL | (KEYWORDS if name == "into" else 0)
    method = MethodDefinition(name.encode(), library.address[name], flags, None)
    make = ctypes.pythonapi.PyCFunction_NewEx
    make.restype, make.argtypes = ctypes.py_object, (ctypes.c_void_p, ctypes.py_object, ctypes.c_void_p)
    # The last two are included so that they live as long as the function.
    own = *KNOWN[:-1], dtype, otherwise, OUT, library, method
    function: Callable[..., Any] = make(ctypes.addressof(method), own, None)
    return function


class Call:
    """Body of "call" in a module, which takes its arguments one by one, and ends if one is unsuitable."""

    def __init__(self, module: ir.Module, name: str = "call") -> None:
        self.module = module
        kind = [BYTES, BYTES, INTEGER, *([BYTES] if name == "into" else [])]
        function = ir.Function(module, ir.FunctionType(BYTES, kind), name)
        self.own, self.given, self.count, *self.names = function.args
        self.builder = ir.IRBuilder(function.append_basic_block())
        self.refused = function.append_basic_block("refused")
        with self.builder.goto_block(self.refused):
            if name == "into":
                given = self.field(self.own, ITEMS + 8 * len(KNOWN)), self.given, self.count, *self.names
                self.builder.ret(self.c_function("PyObject_Vectorcall", BYTES, *given))
            else:
                self.give_object(self.known(None))

    def c_function(self, name: str, result: ir.Type, *args: ir.Value) -> ir.Value:
        """Call one of Python's functions in C."""
        known = self.module.globals
        if name not in known:
            ir.Function(self.module, ir.FunctionType(result, [a.type for a in args]), name)
        return self.builder.call(known[name], args)

    def field(self, address: ir.Value, offset: int, kind: ir.Type = BYTES) -> ir.Value:
        """Field of an object."""
        place = self.builder.gep(address, [INTEGER(offset)])
        return self.builder.load(self.builder.bitcast(place, kind.as_pointer()))

    def known(self, what: object) -> ir.Value:
        """Address of one of the objects of KNOWN."""
        return self.field(self.own, ITEMS + 8 * next(k for k, x in enumerate(KNOWN) if x is what))

    def argument(self, k: int) -> ir.Value:
        """Address of an argument."""
        return self.field(self.given, 8 * k)

    def require(self, a: ir.Value, *choices: ir.Value | int) -> None:
        """Refuse the call unless a is one of the choices: numbers or addresses."""
        builder = self.builder
        equal: ir.Value = ir.Constant(ir.IntType(1), 0)
        for b in choices:
            b = ir.Constant(a.type, b) if isinstance(b, int) else b
            equal = builder.or_(equal, builder.icmp_unsigned("==", a, b))
        following = builder.append_basic_block()
        builder.cbranch(equal, following, self.refused)
        builder.position_at_end(following)

    def require_out(self, count: int) -> None:
        """Refuse the call unless there is one argument more than `count`, the last one, by name or not."""
        builder, (names,) = self.builder, self.names
        by_name, by_place, following = (builder.append_basic_block() for _ in range(3))
        builder.cbranch(builder.icmp_unsigned("==", names, BYTES(None)), by_place, by_name)
        builder.position_at_end(by_place)
        self.require(self.count, count + 1)
        builder.branch(following)
        builder.position_at_end(by_name)
        self.require(self.count, count)
        self.require(self.field(names, HEAD, INTEGER), 1)
        self.require(self.field(names, ITEMS), self.field(self.own, ITEMS + 8 * (len(KNOWN) + 1)))
        builder.branch(following)
        builder.position_at_end(following)

    def array(self, array: ir.Value, dtype: object, axes: int) -> tuple[ir.Value, ir.Value, ir.Value]:
        """Addresses of an array's numbers, shape and strides."""
        self.require(self.field(array, HEAD - 8), self.known(np.ndarray))
        self.require(self.field(array, DTYPE), self.known(dtype))
        self.require(self.field(array, AXES, ir.IntType(32)), axes)
        return self.field(array, DATA), self.field(array, SHAPE), self.field(array, STRIDES)

    def plain_array(self, array: ir.Value, dtype: object, axes: int, needed: int = PLAIN) -> tuple[Any, list[Any]]:
        """Address of the numbers of an array in C order, and its shape."""
        data, shape, _ = self.array(array, dtype, axes)
        flags = self.builder.and_(self.field(array, FLAGS, ir.IntType(32)), ir.Constant(ir.IntType(32), needed))
        self.require(flags, needed)
        return data, [self.field(shape, 8 * k, INTEGER) for k in range(axes)]

    def integer(self, value: ir.Value) -> ir.Value:
        """Number of an int."""
        self.require(self.field(value, HEAD - 8), self.known(int))
        return self.c_function("PyLong_AsSsize_t", INTEGER, value)

    def number(self, value: ir.Value) -> ir.Value:
        """Number of a float."""
        self.require(self.field(value, HEAD - 8), self.known(float), self.known(np.float64))
        return self.c_function("PyFloat_AsDouble", NUMBER, value)

    def items(self, value: ir.Value, count: int) -> list[ir.Value]:
        """Addresses of the items of a tuple, named or not."""
        flags = self.c_function("PyType_GetFlags", INTEGER, self.field(value, HEAD - 8))
        self.require(self.builder.and_(flags, INTEGER(TUPLES)), TUPLES)
        self.require(self.field(value, HEAD, INTEGER), count)
        return [self.field(value, ITEMS + 8 * k) for k in range(count)]

    def unlocked(self, function: ir.Function, args: Sequence[ir.Value]) -> ir.Value:
        """Call a function while other threads may run Python."""
        thread = self.c_function("PyEval_SaveThread", BYTES)
        result = self.builder.call(function, args)
        restore = ir.FunctionType(ir.VoidType(), [BYTES])
        self.builder.call(ir.Function(self.module, restore, "PyEval_RestoreThread"), [thread])
        return result

    def give_object(self, address: ir.Value) -> None:
        """Return an object."""
        self.builder.ret(self.c_function("Py_NewRef", BYTES, address))

    def give(self, integer: ir.Value) -> None:
        """Return an int."""
        self.builder.ret(self.c_function("PyLong_FromSsize_t", BYTES, integer))


def emit_state_call(module: ir.Module, function: ir.Function, widths: Sequence[int]) -> None:
    """Add "call" of one float64 vector per argument, followed by `out`; its result is the function's."""
    call = Call(module)
    data = []
    for k, width in enumerate(widths):
        numbers, shape = call.plain_array(call.argument(k), FLOAT64, 1)
        call.require(shape[0], width)
        data.append(numbers)
    data.append(call.field(call.argument(len(widths)), DATA))
    addresses = [call.builder.bitcast(d, a.type) for d, a in zip(data, function.args, strict=True)]
    call.give(call.builder.call(function, addresses))


def emit_into(module: ir.Module, function: ir.Function, widths: Sequence[int], shape: Sequence[int]) -> None:
    """Add "into" of one float64 vector per argument, followed by `out`, which it returns, all without common memory."""
    call = Call(module, "into")
    call.require_out(len(widths))
    builder, out, ends = call.builder, call.argument(len(widths)), []
    for k, stated in enumerate([shape, *((width,) for width in widths)]):
        array, needed = (out, PLAIN | WRITEABLE) if k == 0 else (call.argument(k - 1), PLAIN)
        numbers, found = call.plain_array(array, FLOAT64, len(stated), needed)
        for size, wanted in zip(found, stated, strict=True):
            call.require(size, wanted)
        ends.append((numbers, builder.gep(numbers, [INTEGER(8 * prod(stated))])))
    (written, behind), *given = ends
    for first, last in given:
        apart = [builder.icmp_unsigned("<=", a, b) for a, b in ((last, written), (behind, first))]
        call.require(builder.or_(*apart), 1)
    places = [*(first for first, _ in given), written]
    pointers = [builder.bitcast(place, a.type) for place, a in zip(places, function.args, strict=True)]
    call.require(builder.call(function, pointers), 1)
    call.give_object(out)


def emit_rows_call(module: ir.Module, function: ir.Function, widths: Sequence[int], entries: int, size: int) -> None:
    """Add "call" of one array of rows per argument, followed by `out` and the first row to begin with.

    Rows have any stride; numbers in a row follow one another. The interpreter's lock is released.
    """
    call = Call(module)
    out = call.argument(len(widths))
    count = call.field(call.field(out, SHAPE), 0, INTEGER)
    pairs = []
    for k, width in enumerate(widths):
        numbers, shape, strides = call.array(call.argument(k), FLOAT64, 2)
        call.require(call.field(shape, 0, INTEGER), count)
        call.require(call.field(shape, 8, INTEGER), width)
        if width > 1:
            call.require(call.field(strides, 8, INTEGER), size)
        pairs += [numbers, call.field(strides, 0, INTEGER)]
    pairs += [call.field(out, DATA), INTEGER(entries * size)]
    begin = call.integer(call.argument(len(widths) + 1))
    call.give(call.unlocked(function, [*pairs, begin, count]))


RETURNED = {"int64": INTEGER, "float64": NUMBER, "bool": ir.IntType(8), "none": BYTES}


def emit_loop_call(module: ir.Module, name: str, arguments: Sequence[Any], returned: str) -> None:
    """Add "call" of a function that Numba made for such arguments, and that returns a type of RETURNED.

    Numba's convention (numba.core.callconv.CPUCallConv): int32 f(result*, error**, flattened arguments); an array is
    its owner, its parent, number and size of its numbers, their address, shape and strides.
    """
    call = Call(module)
    values = [x for k, kind in enumerate(arguments) for x in _flattened(call, call.argument(k), kind)]
    result, error = call.builder.alloca(RETURNED[returned]), call.builder.alloca(BYTES)
    native = ir.FunctionType(ir.IntType(32), [x.type for x in (result, error, *values)])
    status = call.unlocked(ir.Function(module, native, name), [result, error, *values])
    call.require(status, 0, -2)  # anything else is an exception; -2 is None
    found = call.builder.load(result)
    if returned == "float64":
        call.builder.ret(call.c_function("PyFloat_FromDouble", BYTES, found))
    elif returned == "bool":
        call.builder.ret(call.c_function("PyBool_FromLong", BYTES, call.builder.zext(found, INTEGER)))
    else:
        call.give(found if returned == "int64" else INTEGER(0))


def _flattened(call: Call, value: ir.Value, kind: Any) -> list[ir.Value]:
    """Argument of a `kind` in Numba's form."""
    if isinstance(kind, tuple):
        pairs = zip(call.items(value, len(kind)), kind, strict=True)
        return [x for item, like in pairs for x in _flattened(call, item, like)]
    if isinstance(kind, int):
        return [call.integer(value)]
    if isinstance(kind, float):
        return [call.number(value)]
    nothing, size = BYTES(None), INTEGER(8)
    numbers, shape = call.plain_array(value, FLOAT64 if kind.dtype.kind == "f" else INT64, kind.ndim)
    strides = [size]
    for count in reversed(shape):
        strides.insert(0, call.builder.mul(strides[0], count))
    return [nothing, nothing, call.builder.sdiv(strides[0], size), size, numbers, *shape, *strides[1:]]
