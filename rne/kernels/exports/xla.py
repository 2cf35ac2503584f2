"""Machine code called by XLA's typed foreign function interface: a handler in front of the program.

The offsets are those of xla/ffi/api/c_api.h, version 0.3, on 64 bits. Minor versions add fields at the end.
"""

from __future__ import annotations

import re
import threading
from functools import partial
from pathlib import Path

import numpy as np
from llvmlite import ir

from ...basics import disk_cache
from ..llvm_backend import emit_rows, trace_library
from ..object_code import Library
from ..python_calls import BYTES, INTEGER
from ..soundness import Trace

EXTENSION, ARGS = 8, 40  # of XLA_FFI_CallFrame; XLA_FFI_Rets follows XLA_FFI_Args, which begins with its size
LIST = 32  # buffers, of both
DATA, RANK, DIMS = 24, 32, 40  # of XLA_FFI_Buffer
TYPE, METADATA, IS_METADATA = 8, 24, 1  # of XLA_FFI_Metadata_Extension; its type, XLA_FFI_Extension_Metadata
VERSION = 24  # major and minor, of XLA_FFI_Metadata
SHORT = ir.IntType(32)
LOCK = threading.Lock()
LIBRARIES: dict[str, Library] = {}  # kept for the life of the process, as XLA may call them, by their targets


def version() -> tuple[int, int]:
    """Version of the interface: the minor one of this jaxlib's header, as a compiler would take it."""
    from jax.ffi import include_dir

    header = Path(include_dir(), "xla/ffi/api/c_api.h")
    found = re.search(r"#define XLA_FFI_API_MINOR (\d+)", header.read_text("utf-8") if header.exists() else "")
    return 0, int(found[1]) if found else 3


def target(trace: Trace, dtype: str) -> str:
    """Name by which XLA calls the program: its digest, by which JAX's cache finds it in other processes."""
    import jax.ffi

    name = "rne_" + disk_cache.key(repr(trace), dtype)
    with LOCK:
        if name not in LIBRARIES:
            emit = partial(emit_handler, dtype=dtype, version=version())
            found = trace_library(trace, f"XLA {version()}", dtype, ("handler",), emit)
            jax.ffi.register_ffi_target(name, jax.ffi.pycapsule(found.address["handler"]), platform="cpu")
            LIBRARIES[name] = found
    return name


def emit_handler(module: ir.Module, trace: Trace, dtype: str, version: tuple[int, int]) -> None:
    """Add "handler" of one row-major buffer per argument and one of results; states to be examined become NaN."""
    rows = emit_rows(module, trace, dtype)
    function = ir.Function(module, ir.FunctionType(BYTES, [BYTES]), "handler")
    builder, nothing = ir.IRBuilder(function.append_basic_block()), ir.Constant(BYTES, None)

    def place(address: ir.Value, offset: int, kind: ir.Type = BYTES) -> ir.Value:
        return builder.bitcast(builder.gep(address, [INTEGER(offset)]), kind.as_pointer())

    def field(address: ir.Value, offset: int, kind: ir.Type = BYTES) -> ir.Value:
        return builder.load(place(address, offset, kind))

    extension = field(function.args[0], EXTENSION)
    with builder.if_then(builder.icmp_unsigned("!=", extension, nothing)):
        is_metadata = builder.icmp_unsigned("==", field(extension, TYPE, SHORT), SHORT(IS_METADATA))
        with builder.if_then(is_metadata):  # as it registers the handler, XLA asks which version it is made for
            for k, number in enumerate(version):
                builder.store(SHORT(number), place(field(extension, METADATA), VERSION + 4 * k, SHORT))
            builder.ret(nothing)
    given = builder.gep(function.args[0], [INTEGER(ARGS)])
    results = builder.gep(given, [field(given, 0, INTEGER)])
    buffers = [field(field(given, LIST), 8 * k) for k in range(len(trace.widths))] + [field(field(results, LIST), 0)]
    strides = [INTEGER(np.dtype(dtype).itemsize * width) for width in (*trace.widths, trace.entries)]
    arrays = [x for buffer, stride in zip(buffers, strides, strict=True) for x in (field(buffer, DATA), stride)]
    count = _rows_of(builder, field(buffers[0], RANK, INTEGER), field(buffers[0], DIMS, INTEGER.as_pointer()))

    before, states, examined, done = builder.block, *(function.append_basic_block() for _ in range(3))
    builder.branch(states)
    builder.position_at_end(states)
    begin = builder.phi(INTEGER)
    begin.add_incoming(INTEGER(0), before)
    stop = builder.call(rows, [*arrays, begin, count])
    builder.cbranch(builder.icmp_signed("<", stop, count), examined, done)
    builder.position_at_end(examined)
    fill = ir.Function(module, ir.FunctionType(BYTES, [BYTES, SHORT, INTEGER]), "memset")
    row = builder.gep(arrays[-2], [builder.mul(stop, strides[-1])])
    builder.call(fill, [row, SHORT(255), strides[-1]])  # all bits set are a NaN
    begin.add_incoming(builder.add(stop, INTEGER(1)), examined)
    builder.branch(states)
    builder.position_at_end(done)
    builder.ret(nothing)


def _rows_of(builder: ir.IRBuilder, rank: ir.Value, dims: ir.Value) -> ir.Value:
    """Product of all dimensions but the last."""
    before, loop, after = builder.block, builder.append_basic_block(), builder.append_basic_block()
    builder.branch(loop)
    builder.position_at_end(loop)
    k, product = builder.phi(INTEGER), builder.phi(INTEGER)
    following, larger = builder.add(k, INTEGER(1)), builder.mul(product, builder.load(builder.gep(dims, [k])))
    for phi, first, then in ((k, 0, following), (product, 1, larger)):
        phi.add_incoming(INTEGER(first), before)
        phi.add_incoming(then, loop)
    builder.cbranch(builder.icmp_signed("<", following, rank), loop, after)
    builder.position_at_end(after)
    return product
