"""A program compiled by LLVM alone: functions in machine code that take arrays by their addresses."""

from __future__ import annotations

from typing import Any

from llvmlite import ir

from .machine_code import LARGEST, NUMBERS, Emitter
from .object_code import Library, compiled
from .program import Trace

INTEGER = ir.IntType(64)


def emit_section(emitter: Emitter, trace: Trace, dtype: str, inputs: list[Any], store: Any) -> Any:
    """The program on the states in the lanes; true if the results are sound.

    Results are stored before it is known whether they are sound; those that are not are computed anew.
    """
    outputs, angles = emitter.outputs(trace.program, inputs)
    for k, result in enumerate(outputs[: trace.entries]):
        store(k, result)
    sound = trace.sound_inputs(inputs, dtype, emitter) + trace.sound_results(outputs, dtype, emitter)
    moderate = [emitter.at_most(emitter.intrinsic("fabs", angle), emitter.constant(LARGEST)) for angle in angles]
    return emitter.all(sound + moderate)


def plain_function(trace: Trace, lanes: int) -> Library:
    """`function`, int64 f(const double* a0, ..., double* out): 1 if the results are sound, else 0.

    Argument k has shape (width, lanes), out (entries, lanes), in C order.
    """
    module = ir.Module("rne")
    number = NUMBERS["float64"]
    pointers = [number.as_pointer()] * (len(trace.widths) + 1)
    function = ir.Function(module, ir.FunctionType(INTEGER, pointers), "function")
    builder = ir.IRBuilder(function.append_basic_block())
    emitter = Emitter(builder, "float64", lanes)

    def place(array: Any, k: int) -> Any:
        return builder.bitcast(builder.gep(array, [ir.Constant(INTEGER, k * lanes)]), emitter.type.as_pointer())

    *given, out = function.args
    inputs = [
        builder.load(place(array, k), align=8)
        for array, width in zip(given, trace.widths, strict=True)
        for k in range(width)
    ]

    def store(k: int, value: Any) -> None:
        builder.store(value, place(out, k), align=8)

    builder.ret(builder.zext(emit_section(emitter, trace, "float64", inputs, store), INTEGER))
    return Library(compiled(str(module)), ["function"])
