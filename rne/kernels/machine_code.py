"""A program as LLVM instructions, on one number or on a vector of states per operand.

LLVM, through Numba, does the rest: registers, order, machine code. Products and sums may be fused and the sign of zero
ignored; nothing is reassociated and no operand is assumed to be finite, so that NaN shows where it would in NumPy.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from llvmlite import ir

from .machine_sine import sine_and_cosine
from .program import Instruction, Operand, Program

FAST = ("contract", "nsz")
INTRINSICS = {"sqrt": "sqrt", "abs": "fabs", "tanh": "tanh", "minimum": "minimum", "maximum": "maximum"}
NUMBERS = {"float64": ir.DoubleType(), "float32": ir.FloatType()}
SUFFIXES = {"double": "f64", "float": "f32"}
INDEX = ir.IntType(32)


class Emitter:
    """Appends instructions to a function that is being built.

    Parameters
    ----------
    builder : llvmlite.ir.IRBuilder
    dtype : {"float64", "float32"}
    lanes : int
        States per operand: 1 for plain numbers, with the C library's sine and cosine; more for vectors, with
        polynomials, for angles up to `machine_sine.LARGEST`.
    """

    def __init__(self, builder: Any, dtype: str, lanes: int) -> None:
        self.builder, self.lanes = builder, lanes
        self.number = NUMBERS[dtype]
        self.type = self.number if lanes == 1 else ir.VectorType(self.number, lanes)

    def constant(self, value: float) -> Any:
        """The same number in every lane."""
        one = ir.Constant(self.number, float(value))
        return one if self.lanes == 1 else ir.Constant(self.type, [one] * self.lanes)

    def intrinsic(self, name: str, *args: Any) -> Any:
        """A call of one of LLVM's own functions."""
        suffix = SUFFIXES[str(self.number)]
        full = f"llvm.{name}.{suffix if self.lanes == 1 else f'v{self.lanes}{suffix}'}"
        module = self.builder.module
        function = module.globals.get(full)
        if function is None:
            function = ir.Function(module, ir.FunctionType(self.type, [self.type] * len(args)), full)
        return self.builder.call(function, args)

    def outputs(self, program: Program, inputs: Sequence[Any]) -> tuple[list[Any], list[Any]]:
        """The program's outputs, and the angles whose sine or cosine it took."""
        results: list[Any] = []
        pairs: dict[Operand, tuple[Any, Any]] = {}

        def value(arg: Operand) -> Any:
            if arg.kind == "constant":
                return self.constant(arg.value)
            return (inputs if arg.kind == "input" else results)[int(arg.value)]

        for instruction in program.instructions:
            if instruction.kind in ("sin", "cos") and self.lanes > 1:
                (angle,) = instruction.args
                if angle not in pairs:
                    pairs[angle] = sine_and_cosine(self, value(angle))
                results.append(pairs[angle][instruction.kind == "cos"])
            else:
                results.append(self._result(instruction, [value(arg) for arg in instruction.args]))
        return [value(output) for output in program.outputs], [value(angle) for angle in pairs]

    def _result(self, instruction: Instruction, args: list[Any]) -> Any:
        kind, builder = instruction.kind, self.builder
        operations = {
            "add": builder.fadd,
            "subtract": builder.fsub,
            "multiply": builder.fmul,
            "divide": builder.fdiv,
        }
        if kind in operations:
            return operations[kind](*args, flags=FAST)
        if kind == "negative":
            return builder.fneg(args[0])
        if kind in ("less", "less_equal"):
            return builder.uitofp(builder.fcmp_ordered("<" if kind == "less" else "<=", *args), self.type)
        if kind == "where":
            return builder.select(builder.fcmp_unordered("!=", args[0], self.constant(0.0)), args[1], args[2])
        if kind == "sign":
            return self._sign(args[0])
        if kind == "arctan2":
            return self._by_the_c_library("atan2", *args)
        return self.intrinsic(INTRINSICS.get(kind, kind), *args)

    def _by_the_c_library(self, name: str, *args: Any) -> Any:
        """A function that LLVM has no instruction for, state by state."""
        full = name if str(self.number) == "double" else f"{name}f"
        module, builder = self.builder.module, self.builder
        function = module.globals.get(full)
        if function is None:
            function = ir.Function(module, ir.FunctionType(self.number, [self.number] * len(args)), full)
        if self.lanes == 1:
            return builder.call(function, args)
        vector: Any = ir.Constant(self.type, ir.Undefined)
        for lane in range(self.lanes):
            place = ir.Constant(INDEX, lane)
            number = builder.call(function, [builder.extract_element(arg, place) for arg in args])
            vector = builder.insert_element(vector, number, place)
        return vector

    def _sign(self, x: Any) -> Any:
        """-1, 0 or 1; x itself where it is not a number."""
        zero = self.constant(0.0)
        below = self.builder.select(self.builder.fcmp_ordered("<", x, zero), self.constant(-1.0), x)
        return self.builder.select(self.builder.fcmp_ordered(">", x, zero), self.constant(1.0), below)

    def total(self, values: Sequence[Any]) -> Any:
        """Their sum."""
        result = self.constant(0.0)
        for value in values:
            result = self.builder.fadd(result, value)
        return result

    def is_finite(self, x: Any) -> Any:
        """x - x = 0, in every lane."""
        return self.builder.fcmp_ordered("==", self.builder.fsub(x, x), self.constant(0.0))

    def all(self, conditions: Sequence[Any]) -> Any:
        """True if all conditions hold in all lanes."""
        result = conditions[0]
        for condition in conditions[1:]:
            result = self.builder.and_(result, condition)
        if self.lanes == 1:
            return result
        bits = ir.IntType(self.lanes)
        return self.builder.icmp_unsigned("==", self.builder.bitcast(result, bits), ir.Constant(bits, -1))


class Rows:
    """A row-major array of states: its address, its strides in bytes, and the row of the first lane.

    The array of one state has one axis and no stride between states.
    """

    def __init__(self, emitter: Emitter, array: Any, ndim: int, row: Any) -> None:
        self.emitter, self.row = emitter, row
        builder = emitter.builder
        self.address = builder.ptrtoint(array.data, row.type)
        strides = [builder.extract_value(array.strides, k) for k in range(ndim)]
        self.column_stride = strides[-1]
        self.row_stride = strides[0] if ndim > 1 else ir.Constant(row.type, 0)

    def _pointer(self, lane: int, column: int) -> Any:
        builder, integer = self.emitter.builder, self.row.type
        row = builder.add(self.row, ir.Constant(integer, lane))
        offset = builder.add(
            builder.mul(row, self.row_stride), builder.mul(ir.Constant(integer, column), self.column_stride)
        )
        return builder.inttoptr(builder.add(self.address, offset), self.emitter.number.as_pointer())

    def load(self, column: int) -> Any:
        """One column of the states in the lanes."""
        emitter, builder = self.emitter, self.emitter.builder
        align = 1  # of the array's owner nothing is known
        if emitter.lanes == 1:
            return builder.load(self._pointer(0, column), align=align)
        vector: Any = ir.Constant(emitter.type, ir.Undefined)
        for lane in range(emitter.lanes):
            number = builder.load(self._pointer(lane, column), align=align)
            vector = builder.insert_element(vector, number, ir.Constant(INDEX, lane))
        return vector

    def store(self, column: int, value: Any) -> None:
        """Set one column of the states in the lanes."""
        emitter, builder = self.emitter, self.emitter.builder
        for lane in range(emitter.lanes):
            number = value if emitter.lanes == 1 else builder.extract_element(value, ir.Constant(INDEX, lane))
            builder.store(number, self._pointer(lane, column), align=1)
