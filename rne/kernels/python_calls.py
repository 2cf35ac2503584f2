"""Machine code that Python calls as it calls its own functions in C, and that reads arrays where they are.

An array is taken as it is: the addresses of its numbers, of its shape and of its strides stand behind the head that all
of Python's objects have (numpy/ndarraytypes.h, PyArrayObject_fields).
"""

from __future__ import annotations

import ctypes
from collections.abc import Sequence
from typing import Any

import numpy as np
from llvmlite import ir

from .object_code import Library

INTEGER, BYTES = ir.IntType(64), ir.IntType(8).as_pointer()
HEAD = object.__basicsize__  # ends with the type
DATA, AXES, SHAPE, STRIDES, DTYPE = (HEAD + k for k in (0, 8, 16, 24, 40))
FASTCALL = 0x80  # METH_FASTCALL: f(self, arguments, their number)


class Method(ctypes.Structure):
    """PyMethodDef."""

    _fields_ = (
        ("name", ctypes.c_char_p),
        ("function", ctypes.c_void_p),
        ("flags", ctypes.c_int),
        ("doc", ctypes.c_char_p),
    )


def python_function(library: Library, name: str, *self_items: Any) -> Any:
    """A function of a library as a function of Python's; its `self` is a tuple of some objects."""
    method = Method(name.encode(), library.address[name], FASTCALL, None)
    make = ctypes.pythonapi.PyCFunction_NewEx
    make.restype, make.argtypes = ctypes.py_object, (ctypes.c_void_p, ctypes.py_object, ctypes.c_void_p)
    return make(ctypes.addressof(method), (*self_items, library, method), None)  # which keeps them alive


class _Reader:
    """Reads the fields of objects."""

    def __init__(self, builder: ir.IRBuilder) -> None:
        self.builder = builder

    def field(self, address: Any, offset: int, kind: Any = BYTES) -> Any:
        place = self.builder.gep(address, [ir.Constant(INTEGER, offset)])
        return self.builder.load(self.builder.bitcast(place, kind.as_pointer()))

    def all_equal(self, pairs: Sequence[tuple[Any, Any]]) -> Any:
        result: Any = ir.Constant(ir.IntType(1), 1)
        for a, b in pairs:
            expected = ir.Constant(a.type, b) if isinstance(b, int) else b
            result = self.builder.and_(result, self.builder.icmp_unsigned("==", a, expected))
        return result


def emit_call(module: Any, function: Any, widths: Sequence[int], dtype: str, entries: int | None = None) -> None:
    """Add "call", which gives `function` the addresses of arrays if each is an array of this dtype and width.

    `self` begins with the type of arrays and the dtype. For batches, where `entries` are given, the arguments are
    followed by `out` and the first row; rows have any stride, and the lock is released. For one state they are vectors,
    followed by `out`. The result is the function's, or -1 for other arguments.
    """
    size = np.dtype(dtype).itemsize
    kind = ir.FunctionType(BYTES, [BYTES, BYTES, INTEGER])
    call = ir.Function(module, kind, "call")
    own, given, _ = call.args
    builder = ir.IRBuilder(call.append_basic_block())
    reader = _Reader(builder)
    field, c_function = reader.field, functions_of_c(module)
    answer = builder.alloca(INTEGER)
    builder.store(ir.Constant(INTEGER, -1), answer)
    arrays = [field(given, 8 * k) for k in range(len(widths) + 1)]
    array_type, array_dtype = (field(own, tuple.__basicsize__ + 8 * k) for k in range(2))
    with builder.if_then(reader.all_equal([(field(a, HEAD - 8), array_type) for a in arrays])):
        shapes, strides = ([field(a, offset) for a in arrays] for offset in (SHAPE, STRIDES))
        axes = 1 if entries is None else 2
        wanted = [(field(a, DTYPE), array_dtype) for a in arrays[:-1]]
        wanted += [(field(a, AXES, ir.IntType(32)), axes) for a in arrays[:-1]]
        with builder.if_then(reader.all_equal(wanted)):
            last = 8 * (axes - 1)
            wanted = [(field(s, last, INTEGER), width) for s, width in zip(shapes, widths, strict=False)]
            wanted += [(field(s, last, INTEGER), size) for s, width in zip(strides, widths, strict=False) if width > 1]
            if entries is not None:
                count = field(shapes[-1], 0, INTEGER)
                wanted += [(field(s, 0, INTEGER), count) for s in shapes[:-1]]
            with builder.if_then(reader.all_equal(wanted)):
                data = [field(a, DATA) for a in arrays]
                if entries is None:
                    result = builder.call(
                        function, [builder.bitcast(d, a.type) for d, a in zip(data, function.args, strict=True)]
                    )
                else:
                    begin = builder.call(
                        c_function("PyLong_AsSsize_t", INTEGER, BYTES), [field(given, 8 * len(arrays))]
                    )
                    row_strides = [field(s, 0, INTEGER) for s in strides[:-1]] + [ir.Constant(INTEGER, entries * size)]
                    pairs = [x for pair in zip(data, row_strides, strict=True) for x in pair]
                    thread = builder.call(c_function("PyEval_SaveThread", BYTES), [])
                    result = builder.call(function, [*pairs, begin, count])
                    builder.call(c_function("PyEval_RestoreThread", ir.VoidType(), BYTES), [thread])
                builder.store(result, answer)
    builder.ret(builder.call(c_function("PyLong_FromSsize_t", BYTES, INTEGER), [builder.load(answer)]))


def functions_of_c(module: Any) -> Any:
    """Declares functions of Python's in a module."""
    return lambda name, result, *kinds: ir.Function(module, ir.FunctionType(result, kinds), name)
