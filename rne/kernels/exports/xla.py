"""Machine code that XLA calls, by its typed foreign function interface: a handler in front of the program.

Its structures are those of xla/ffi/api/c_api.h, here of version 0.3, in bytes for addresses of 64 bits. What later
minor versions add goes behind; the sizes of the two structures within the frame are looked at in every call.
"""

from __future__ import annotations

import re
import threading
from functools import cache, partial
from pathlib import Path

import numpy as np
from llvmlite import ir

from ...basics import disk_cache
from ..llvm_backend import emit_rows, trace_library
from ..object_code import Library
from ..program import Trace
from ..python_calls import BYTES, INTEGER

EXTENSION, API, ARGS, RETS = 8, 16, 40, 80  # of XLA_FFI_CallFrame
SIZE, LIST = 40, 32  # of XLA_FFI_Args and XLA_FFI_Rets; their list of buffers
DATA, RANK, DIMS = 24, 32, 40  # of XLA_FFI_Buffer
TYPE, METADATA, VERSION = 8, 24, 24  # of XLA_FFI_Metadata_Extension; the version in XLA_FFI_Metadata
IS_METADATA = 1  # XLA_FFI_Extension_Metadata
ERROR_CREATE = 48  # of XLA_FFI_Api
INTERNAL = 13  # XLA_FFI_Error_Code_INTERNAL
REFUSED = "rne: XLA passes arguments in another form than xla/ffi/api/c_api.h has them in version 0.3"
SHORT = ir.IntType(32)
LOCK = threading.Lock()
LIBRARIES: dict[str, Library] = {}  # that XLA may call as long as the process lives, by their targets


@cache
def version() -> tuple[int, int]:
    """Major and minor version of the interface of this jaxlib; the known one if its header is missing."""
    from jax.ffi import include_dir

    header = Path(include_dir(), "xla/ffi/api/c_api.h")
    text = header.read_text(encoding="utf-8") if header.exists() else ""
    found = [int(number) for number in re.findall(r"#define XLA_FFI_API_M(?:AJ|IN)OR (\d+)", text)]
    return (found[0], found[1]) if len(found) == 2 else (0, 3)


def target(trace: Trace, dtype: str) -> str:
    """The name by which XLA calls the program on rows of numbers; a digest of it, so that equal programs share it."""
    import jax.ffi

    name = "rne_" + disk_cache.key(repr(trace), dtype)
    with LOCK:
        if name not in LIBRARIES:
            emit = partial(emit_handler, dtype=dtype)
            found = trace_library(trace, f"XLA {version()}", dtype, ("handler",), emit)
            jax.ffi.register_ffi_target(name, jax.ffi.pycapsule(found.address["handler"]), platform="cpu")
            LIBRARIES[name] = found
    return name


def emit_handler(module: ir.Module, trace: Trace, dtype: str) -> None:
    """Add "handler" of one row-major buffer per argument and one of results; states to be examined become NaN."""
    rows = emit_rows(module, trace, dtype)
    function = ir.Function(module, ir.FunctionType(BYTES, [BYTES]), "handler")
    (frame,) = function.args
    builder = ir.IRBuilder(function.append_basic_block())
    nothing = ir.Constant(BYTES, None)

    def place(address: ir.Value, offset: int, kind: ir.Type = BYTES) -> ir.Value:
        return builder.bitcast(builder.gep(address, [INTEGER(offset)]), kind.as_pointer())

    def field(address: ir.Value, offset: int, kind: ir.Type = BYTES) -> ir.Value:
        return builder.load(place(address, offset, kind))

    extension = field(frame, EXTENSION)
    with builder.if_then(builder.icmp_unsigned("!=", extension, nothing)):
        is_metadata = builder.icmp_unsigned("==", field(extension, TYPE, SHORT), SHORT(IS_METADATA))
        with builder.if_then(is_metadata):  # XLA asks which version this is made for, as it registers the handler
            for k, part in enumerate(version()):
                builder.store(SHORT(part), place(field(extension, METADATA), VERSION + 4 * k, SHORT))
            builder.ret(nothing)
    for inner in (ARGS, RETS):
        with builder.if_then(builder.icmp_unsigned("!=", field(frame, inner, INTEGER), INTEGER(SIZE))):
            builder.ret(_refused(builder, field(field(frame, API), ERROR_CREATE)))
    given = [field(field(frame, ARGS + LIST), 8 * k) for k in range(len(trace.widths))]
    count = _rows_of(builder, field(given[0], RANK, INTEGER), field(given[0], DIMS))
    buffers = [*given, field(field(frame, RETS + LIST), 0)]
    strides = [INTEGER(np.dtype(dtype).itemsize * width) for width in (*trace.widths, trace.entries)]
    arrays = [x for buffer, stride in zip(buffers, strides, strict=True) for x in (field(buffer, DATA), stride)]
    memset = ir.Function(module, ir.FunctionType(BYTES, [BYTES, SHORT, INTEGER]), "memset")

    before, states, examined, done = builder.block, *(function.append_basic_block() for _ in range(3))
    builder.branch(states)
    builder.position_at_end(states)
    begin = builder.phi(INTEGER)
    begin.add_incoming(INTEGER(0), before)
    stop = builder.call(rows, [*arrays, begin, count])
    builder.cbranch(builder.icmp_signed("<", stop, count), examined, done)
    builder.position_at_end(examined)
    builder.call(memset, [builder.gep(arrays[-2], [builder.mul(stop, strides[-1])]), SHORT(255), strides[-1]])  # NaN
    begin.add_incoming(builder.add(stop, INTEGER(1)), examined)
    builder.branch(states)
    builder.position_at_end(done)
    builder.ret(nothing)


def _rows_of(builder: ir.IRBuilder, rank: ir.Value, dims: ir.Value) -> ir.Value:
    """The product of all dimensions but the last."""
    before, loop, after = builder.block, *(builder.append_basic_block() for _ in range(2))
    dims = builder.bitcast(dims, INTEGER.as_pointer())
    builder.branch(loop)
    builder.position_at_end(loop)
    k, product = builder.phi(INTEGER), builder.phi(INTEGER)
    following = builder.add(k, INTEGER(1))
    k.add_incoming(INTEGER(0), before)
    product.add_incoming(INTEGER(1), before)
    product.add_incoming(builder.mul(product, builder.load(builder.gep(dims, [k]))), loop)
    k.add_incoming(following, loop)
    builder.cbranch(builder.icmp_signed("<", following, rank), loop, after)
    builder.position_at_end(after)
    return product


def _refused(builder: ir.IRBuilder, create: ir.Value) -> ir.Value:
    """An error of XLA's, made by its XLA_FFI_Error_Create of size, extension, message and code."""
    kind = ir.LiteralStructType([INTEGER, BYTES, BYTES, SHORT])
    text = bytearray(REFUSED.encode() + b"\0")
    message = ir.Constant(ir.ArrayType(ir.IntType(8), len(text)), text)
    given, said = builder.alloca(kind), builder.alloca(message.type)
    builder.store(message, said)
    parts = INTEGER(28), ir.Constant(BYTES, None), builder.bitcast(said, BYTES), SHORT(INTERNAL)
    for k, part in enumerate(parts):
        builder.store(part, builder.gep(given, [SHORT(0), SHORT(k)]))
    function = ir.FunctionType(BYTES, [given.type]).as_pointer()
    return builder.call(builder.bitcast(create, function), [given])
