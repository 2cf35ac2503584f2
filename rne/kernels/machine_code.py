"""A program as LLVM instructions, on one number or on a vector of states per operand.

LLVM, through Numba, does the rest: registers, order, machine code. Products and sums may be fused and the sign of zero
ignored; nothing is reassociated and no operand is assumed to be finite, so that NaN shows where it would in NumPy.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Sequence
from typing import Any

from llvmlite import ir

from .program import Instruction, Operand, Program

FAST = ("contract", "nsz")
ARITHMETIC = {"add": "fadd", "subtract": "fsub", "multiply": "fmul", "divide": "fdiv"}
NUMBERS = {"float64": ir.DoubleType(), "float32": ir.FloatType()}
SUFFIXES = {"double": "f64", "float": "f32"}
INDEX = ir.IntType(32)
LARGEST = 1e5  # rad
HALF_PI = (1.57079632673412561417e00, 6.07710050630396597660e-11, 2.02226624879595063154e-21)  # 33 + 33 + 53 bits
SINE = (
    -1.66666666666666324348e-01,
    8.33333333332248946124e-03,
    -1.98412698298579493134e-04,
    2.75573137070700676789e-06,
    -2.50507602534068634195e-08,
    1.58969099521155010221e-10,
)
COSINE = (
    4.16666666666666019037e-02,
    -1.38888888888741095749e-03,
    2.48015872894767294178e-05,
    -2.75573143513906633035e-07,
    2.08757232129817482790e-09,
    -1.13596475577881948265e-11,
)
ROUNDER = 1.5 * 2.0**52  # a whole number added to it stands in its last bits


class Emitter:
    """Appends instructions in float64 or float32 to a function that is being built.

    An operand has one number for each lane. A single lane takes the C library's sine and cosine; several are vectors,
    with polynomials for angles up to LARGEST.
    """

    def __init__(self, builder: Any, dtype: str, lanes: int) -> None:
        self.builder, self.lanes = builder, lanes
        self.number = NUMBERS[dtype]
        self.type = self.number if lanes == 1 else ir.VectorType(self.number, lanes)

    def constant(self, value: float) -> Any:
        """A number repeated in every lane."""
        one = ir.Constant(self.number, float(value))
        return one if self.lanes == 1 else ir.Constant(self.type, [one] * self.lanes)

    def pack(self, numbers: Sequence[Any]) -> Any:
        """One operand of the numbers of all lanes."""
        if self.lanes == 1:
            return numbers[0]
        vector: Any = ir.Constant(self.type, ir.Undefined)
        for lane, number in enumerate(numbers):
            vector = self.builder.insert_element(vector, number, ir.Constant(INDEX, lane))
        return vector

    def unpack(self, value: Any) -> list[Any]:
        """The number in each lane of an operand."""
        if self.lanes == 1:
            return [value]
        return [self.builder.extract_element(value, ir.Constant(INDEX, lane)) for lane in range(self.lanes)]

    def _declared(self, name: str, number: Any, count: int) -> Any:
        """A function of `count` numbers of a type, declared in the module once."""
        module = self.builder.module
        if name not in module.globals:
            ir.Function(module, ir.FunctionType(number, [number] * count), name)
        return module.globals[name]

    def intrinsic(self, name: str, *args: Any) -> Any:
        """A call of one of LLVM's own functions."""
        suffix = SUFFIXES[str(self.number)]
        full = f"llvm.{name}.{suffix if self.lanes == 1 else f'v{self.lanes}{suffix}'}"
        return self.builder.call(self._declared(full, self.type, len(args)), args)

    def _by_the_c_library(self, name: str, *args: Any) -> Any:
        """A function that LLVM has no instruction for, state by state."""
        full = name if str(self.number) == "double" else f"{name}f"
        function = self._declared(full, self.number, len(args))
        return self.pack([self.builder.call(function, lane) for lane in zip(*map(self.unpack, args), strict=True)])

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
        if kind in ARITHMETIC:
            return getattr(builder, ARITHMETIC[kind])(*args, flags=FAST)
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
        return self.intrinsic("fabs" if kind == "abs" else kind, *args)

    def _sign(self, x: Any) -> Any:
        """-1, 0 or 1; x itself where it is not a number."""
        zero = self.constant(0.0)
        below = self.builder.select(self.builder.fcmp_ordered("<", x, zero), self.constant(-1.0), x)
        return self.builder.select(self.builder.fcmp_ordered(">", x, zero), self.constant(1.0), below)

    def total(self, values: Sequence[Any]) -> Any:
        """The sum of values."""
        result = self.constant(0.0)
        for value in values:
            result = self.builder.fadd(result, value)
        return result

    def at_most(self, a: Any, b: Any) -> Any:
        """a <= b, in each lane."""
        return self.builder.fcmp_ordered("<=", a, b)

    def finite(self, values: Sequence[Any]) -> Any:
        """Every value is finite: x - x = 0 for their sum x."""
        x = self.total(values)
        return self.builder.fcmp_ordered("==", self.builder.fsub(x, x), self.constant(0.0))

    def within(self, values: Sequence[Any], bound: float) -> Any:
        """The sum of squares is at most the bound's."""
        return self.at_most(self.total([self.builder.fmul(x, x) for x in values]), self.constant(bound**2))

    def above(self, values: Sequence[Any], factor: float, others: Sequence[Any]) -> Any:
        """Each value exceeds the factor times its partner."""
        least = [self.builder.fmul(self.constant(factor), other) for other in others]
        pairs = zip(values, least, strict=True)
        return functools.reduce(self.builder.and_, [self.builder.fcmp_ordered(">", a, b) for a, b in pairs])

    def all(self, conditions: Sequence[Any]) -> Any:
        """True if all conditions hold in all lanes."""
        result = functools.reduce(self.builder.and_, conditions)
        if self.lanes == 1:
            return result
        bits = ir.IntType(self.lanes)
        return self.builder.icmp_unsigned("==", self.builder.bitcast(result, bits), ir.Constant(bits, -1))


class Rows:
    """A row-major array of states: its address, its strides in bytes, and the row of the first lane.

    The array of one state has one axis; its row is 0.
    """

    def __init__(self, emitter: Emitter, array: Any, ndim: int, row: Any) -> None:
        self.emitter, self.row = emitter, row
        builder = emitter.builder
        self.address = builder.ptrtoint(array.data, row.type)
        strides = [builder.extract_value(array.strides, k) for k in range(ndim)]
        self.row_stride, self.column_stride = strides[0], strides[-1]

    def _pointer(self, lane: int, column: int) -> Any:
        builder, integer = self.emitter.builder, self.row.type
        row = builder.add(self.row, ir.Constant(integer, lane))
        offset = builder.add(
            builder.mul(row, self.row_stride), builder.mul(ir.Constant(integer, column), self.column_stride)
        )
        return builder.inttoptr(builder.add(self.address, offset), self.emitter.number.as_pointer())

    def load(self, column: int) -> Any:
        """One column of the states in the lanes; of the alignment of the owner's array nothing is known."""
        emitter = self.emitter
        return emitter.pack([emitter.builder.load(self._pointer(k, column), align=1) for k in range(emitter.lanes)])

    def store(self, column: int, value: Any) -> None:
        """Set one column of the states in the lanes."""
        for lane, number in enumerate(self.emitter.unpack(value)):
            self.emitter.builder.store(number, self._pointer(lane, column), align=1)


def sine_and_cosine(emitter: Any, angle: Any) -> tuple[Any, Any]:
    """Sine and cosine of a vector of angles without a branch, computed in float64.

    Reduction by pi/2 as Cody and Waite, in three parts with the rounding of the remainder kept; two polynomials on
    [-pi/4, pi/4] with the coefficients of fdlibm (Sun Microsystems 1993, k_sin.c and k_cos.c), chosen by quadrant.
    Errors stay below 1 unit in the last place up to LARGEST; larger angles are left to the C library.
    """
    builder = emitter.builder
    if isinstance(emitter.number, ir.DoubleType):
        return _in_float64(emitter, angle)
    wide = type(emitter)(builder, "float64", emitter.lanes)
    sine, cosine = _in_float64(wide, builder.fpext(angle, wide.type))
    return builder.fptrunc(sine, emitter.type), builder.fptrunc(cosine, emitter.type)


def _in_float64(emitter: Any, angle: Any) -> tuple[Any, Any]:
    builder, constant = emitter.builder, emitter.constant
    quarter = emitter.intrinsic("rint", builder.fmul(angle, constant(2 / math.pi)))
    sine, cosine = _near_zero(emitter, *_remainder(emitter, angle, quarter))
    integers = ir.VectorType(ir.IntType(64), emitter.lanes)

    def integer(k: int) -> Any:
        return ir.Constant(integers, [k] * emitter.lanes)

    def with_sign(value: Any, quadrant: Any) -> Any:
        """The negative where the second bit of the quadrant is set."""
        bit = builder.shl(builder.and_(quadrant, integer(2)), integer(62))
        return builder.bitcast(builder.xor(builder.bitcast(value, integers), bit), emitter.type)

    quadrant = builder.bitcast(builder.fadd(quarter, constant(ROUNDER)), integers)
    swapped = builder.icmp_unsigned("!=", builder.and_(quadrant, integer(1)), integer(0))
    return (
        with_sign(builder.select(swapped, cosine, sine), quadrant),
        with_sign(builder.select(swapped, sine, cosine), builder.add(quadrant, integer(1))),
    )


def _remainder(emitter: Any, angle: Any, quarter: Any) -> tuple[Any, Any]:
    """angle - quarter pi/2, as a number and what rounding took from it."""
    builder = emitter.builder
    first, second, third = (emitter.constant(-part) for part in HALF_PI)
    r1 = emitter.intrinsic("fmuladd", quarter, first, angle)  # exact
    r2 = emitter.intrinsic("fmuladd", quarter, second, r1)
    lost = emitter.intrinsic("fmuladd", quarter, second, builder.fsub(r1, r2))
    rest = emitter.intrinsic("fmuladd", quarter, third, lost)
    r = builder.fadd(r2, rest)
    return r, builder.fsub(rest, builder.fsub(r, r2))


def _near_zero(emitter: Any, r: Any, tail: Any) -> tuple[Any, Any]:
    """Sine and cosine of r + tail, |r| <= pi/4: r + r^3 S(r^2) + tail cos r, and 1 - r^2/2 + r^4 C(r^2) - tail r.

    The rounding of 1 - r^2/2 is kept. What is small is added up first.
    """
    builder, one = emitter.builder, emitter.constant(1.0)
    z = builder.fmul(r, r)
    half = builder.fmul(z, emitter.constant(0.5))
    near = builder.fsub(one, half)
    small = emitter.intrinsic("fmuladd", builder.fmul(r, z), _polynomial(emitter, SINE, z), builder.fmul(tail, near))
    rest = builder.fsub(builder.fsub(builder.fsub(one, near), half), builder.fmul(r, tail))
    rest = emitter.intrinsic("fmuladd", builder.fmul(z, z), _polynomial(emitter, COSINE, z), rest)
    return builder.fadd(r, small), builder.fadd(near, rest)


def _polynomial(emitter: Any, coefficients: tuple[float, ...], x: Any) -> Any:
    """By Horner's rule, lowest power first."""
    result = emitter.constant(coefficients[-1])
    for coefficient in coefficients[-2::-1]:
        result = emitter.intrinsic("fmuladd", result, x, emitter.constant(coefficient))
    return result
