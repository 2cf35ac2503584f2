"""Program as LLVM instructions, on one number or on a vector of states per operand.

LLVM does the rest: registers, order, machine code. Products and sums may be fused and the sign of zero ignored; nothing
is reassociated and no operand is assumed to be finite, so that NaN appears where it would in NumPy.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Sequence
from typing import Any

from llvmlite import ir

from ..graph.program import Operand, Program

FAST = ("contract", "nsz")
ARITHMETIC = {"add": "fadd", "subtract": "fsub", "multiply": "fmul", "divide": "fdiv"}
NUMBERS = {"float64": ir.DoubleType(), "float32": ir.FloatType()}
SUFFIXES = {"double": "f64", "float": "f32"}
INDEX = ir.IntType(32)
SIDE_BY_SIDE = 8  # arguments of one state computed side by side
LARGEST = 1e5  # largest angle for the polynomials [rad]
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
ROUNDER = 1.5 * 2.0**52  # adds a whole number into the last bits
HALF_LOG_2 = (3.4657359027994517e-01, 2.7489615093541856e-14)  # 42 + 53 bits
# mpmath.chebyfit((r coth r - 1) / r^2, [0, 0.068], 6) in r^2, to 7e-19 of r coth r
HYPERBOLIC = (
    3.333333333333333e-01,
    -2.2222222222211242e-02,
    2.116402114517397e-03,
    -2.1164009326217294e-04,
    2.1374435217277587e-05,
    -2.120247188456499e-06,
)


class Emitter:
    """Appends instructions in float64 or float32 to a function that is being built.

    An operand has one number for each lane; of several lanes it is a vector.
    """

    def __init__(self, builder: ir.IRBuilder, dtype: str, lanes: int) -> None:
        self.builder, self.dtype, self.lanes = builder, dtype, lanes
        self.number = NUMBERS[dtype]
        self.type = self.number if lanes == 1 else ir.VectorType(self.number, lanes)

    def constant(self, value: float) -> ir.Value:
        """A number repeated in every lane."""
        one = ir.Constant(self.number, float(value))
        return one if self.lanes == 1 else ir.Constant(self.type, [one] * self.lanes)

    def from_table(self, k: int) -> ir.Value:
        """Number k of the module's table, which is filled when the code is loaded."""
        table = self.builder.module.globals["table"]
        return self.repeated(self.builder.gep(table, [INDEX(0), INDEX(k)]))

    def repeated(self, place: ir.Value) -> ir.Value:
        """The number at a place in memory, in every lane."""
        zero, one = INDEX(0), self.builder.load(place)
        if self.lanes == 1:
            return one
        first = self.builder.insert_element(ir.Constant(self.type, ir.Undefined), one, zero)
        return shuffled(self.builder, first, first, [0] * self.lanes)

    def pack(self, numbers: Sequence[ir.Value]) -> ir.Value:
        """Operand of the numbers of all lanes."""
        if self.lanes == 1:
            return numbers[0]
        vector: ir.Value = ir.Constant(self.type, ir.Undefined)
        for lane, number in enumerate(numbers):
            vector = self.builder.insert_element(vector, number, INDEX(lane))
        return vector

    def unpack(self, value: ir.Value) -> list[ir.Value]:
        """The number in each lane of an operand."""
        if self.lanes == 1:
            return [value]
        return [self.builder.extract_element(value, INDEX(lane)) for lane in range(self.lanes)]

    def _declared(self, name: str, number: ir.Type, count: int) -> ir.Value:
        """A function of `count` numbers of a type, declared in the module once."""
        module = self.builder.module
        if name not in module.globals:
            ir.Function(module, ir.FunctionType(number, [number] * count), name)
        return module.globals[name]

    def intrinsic(self, name: str, *args: ir.Value) -> ir.Value:
        """A call of one of LLVM's own functions."""
        suffix = SUFFIXES[str(self.number)]
        full = f"llvm.{name}.{suffix if self.lanes == 1 else f'v{self.lanes}{suffix}'}"
        return self.builder.call(self._declared(full, self.type, len(args)), args, fastmath=["nsz"])

    def by_the_c_library(self, name: str, *args: ir.Value) -> ir.Value:
        """Call a function that LLVM has no instruction for, state by state."""
        full = name if str(self.number) == "double" else f"{name}f"
        function = self._declared(full, self.number, len(args))
        return self.pack([self.builder.call(function, lane) for lane in zip(*map(self.unpack, args), strict=True)])

    def outputs(self, program: Program, inputs: Any) -> list[ir.Value]:
        """Outputs of the program; elementary functions that do not depend on others are computed first, together."""
        early, needed = early_arguments(program)
        results: list[ir.Value] = [None] * len(program.instructions)

        def value(arg: Operand) -> ir.Value:
            if arg.kind == "constant":
                return self.constant(arg.value)
            if arg.kind == "table":
                return self.from_table(int(arg.value))
            return (inputs if arg.kind == "input" else results)[int(arg.value)]

        def append(k: int) -> None:
            kind, args = program.instructions[k]
            if kind in ELEMENTARY:
                function, part = ELEMENTARY[kind]
                if (function, args[0]) not in known:
                    known[function, args[0]] = self.elementary(function, [value(args[0])])[0]
                results[k] = known[function, args[0]][part]
            else:
                results[k] = self._result(kind, [value(arg) for arg in args])

        known: dict[tuple[Function, Operand], tuple[ir.Value, ...]] = {}
        for k in sorted(needed):
            append(k)
        for function, args in early.items():
            found = self.elementary(function, [value(arg) for arg in args])
            known.update(zip([(function, arg) for arg in args], found, strict=True))
        for k in range(len(results)):
            if k not in needed:
                append(k)
        return [value(output) for output in program.outputs]

    def elementary(self, function: Function, arguments: Sequence[ir.Value]) -> list[tuple[ir.Value, ...]]:
        """Values of a function for each argument; of one state, several are computed side by side."""
        if self.lanes > 1:
            return function(self, arguments)
        found: list[tuple[ir.Value, ...]] = []
        while len(found) < len(arguments):
            some = arguments[len(found) : len(found) + SIDE_BY_SIDE]
            lanes = next(lanes for lanes in (2, 4, SIDE_BY_SIDE) if lanes >= len(some))
            wide = Emitter(self.builder, self.dtype, lanes)
            (values,) = function(wide, [wide.pack([*some, *[some[0]] * (lanes - len(some))])])
            found += list(zip(*map(wide.unpack, values), strict=True))[: len(some)]
        return found

    def _result(self, kind: str, args: list[ir.Value]) -> ir.Value:
        builder = self.builder
        if kind in ARITHMETIC:
            return getattr(builder, ARITHMETIC[kind])(*args, flags=FAST)
        if kind == "negative":
            return builder.fneg(args[0])
        if kind in ("less", "less_equal"):
            return builder.uitofp(builder.fcmp_ordered("<" if kind == "less" else "<=", *args), self.type)
        if kind == "where":
            return builder.select(builder.fcmp_unordered("!=", args[0], self.constant(0.0)), args[1], args[2])
        if kind == "sign":  # x itself where it is not a number
            (x,), zero = args, self.constant(0.0)
            below = builder.select(builder.fcmp_ordered("<", x, zero), self.constant(-1.0), x)
            return builder.select(builder.fcmp_ordered(">", x, zero), self.constant(1.0), below)
        if kind == "arctan2":
            return self.by_the_c_library("atan2", *args)
        return self.intrinsic("fabs" if kind == "abs" else kind, *args)

    def total(self, values: Sequence[ir.Value]) -> ir.Value:
        """Sum of values."""
        result = self.constant(0.0)
        for value in values:
            result = self.builder.fadd(result, value)
        return result

    def at_most(self, a: ir.Value, b: ir.Value) -> ir.Value:
        """Condition a <= b, in each lane."""
        return self.builder.fcmp_ordered("<=", a, b)

    def finite(self, values: Sequence[ir.Value]) -> ir.Value:
        """Condition that every value is finite: x - x = 0 for their sum x."""
        x = self.total(values)
        return self.builder.fcmp_ordered("==", self.builder.fsub(x, x), self.constant(0.0))

    def within(self, values: Sequence[ir.Value], bound: float) -> ir.Value:
        """Condition that the sum of squares is at most the bound's."""
        return self.at_most(self.total([self.builder.fmul(x, x) for x in values]), self.constant(bound**2))

    def above(self, values: Sequence[ir.Value], factor: float, others: Sequence[ir.Value]) -> ir.Value:
        """Condition that each value exceeds the factor times its partner."""
        least = [self.builder.fmul(self.constant(factor), other) for other in others]
        pairs = zip(values, least, strict=True)
        return functools.reduce(self.builder.and_, [self.builder.fcmp_ordered(">", a, b) for a, b in pairs])

    def lanes_of(self, conditions: Sequence[ir.Value]) -> ir.Value:
        """Number with one bit for each lane, set if all conditions hold there."""
        return self.builder.bitcast(functools.reduce(self.builder.and_, conditions), ir.IntType(self.lanes))

    def all(self, conditions: Sequence[ir.Value]) -> ir.Value:
        """True if all conditions hold in all lanes."""
        bits = ir.Constant(ir.IntType(self.lanes), -1)
        return self.builder.icmp_unsigned("==", self.lanes_of(conditions), bits)


def shuffled(builder: ir.IRBuilder, a: ir.Value, b: ir.Value, places: Sequence[int]) -> ir.Value:
    """Elements at some places of two concatenated vectors."""
    mask = ir.Constant(ir.VectorType(INDEX, len(places)), list(places))
    return builder.shuffle_vector(a, b, mask)


Function = Callable[[Emitter, Sequence[ir.Value]], list[tuple[ir.Value, ...]]]
OnOne = Callable[[Emitter, ir.Value], tuple[ir.Value, ...]]


def early_arguments(program: Program) -> tuple[dict[Function, dict[Operand, None]], set[int]]:
    """Arguments by elementary function that are known before any of them, and the instructions for these."""
    late: set[int] = set()  # instructions that need an elementary function
    early: dict[Function, dict[Operand, None]] = {}
    for k, (kind, args) in enumerate(program.instructions):
        if any(arg.kind == "result" and arg.value in late for arg in args):
            late.add(k)
        elif kind in ELEMENTARY:
            late.add(k)
            early.setdefault(ELEMENTARY[kind][0], {})[args[0]] = None
    needed: set[int] = set()
    open_ones = [arg for found in early.values() for arg in found]
    while open_ones:
        arg = open_ones.pop()
        if arg.kind == "result" and arg.value not in needed:
            needed.add(int(arg.value))
            open_ones += program.instructions[int(arg.value)].args
    return early, needed


def sines_and_cosines(emitter: Emitter, angles: Sequence[ir.Value]) -> list[tuple[ir.Value, ...]]:
    """Sine and cosine of vectors of angles, by polynomials; where one exceeds LARGEST, by the C library."""
    builder, largest = emitter.builder, emitter.constant(LARGEST)
    near = [in_float64(emitter, sine_and_cosine, angle) for angle in angles]
    moderate = emitter.all([emitter.at_most(emitter.intrinsic("fabs", angle), largest) for angle in angles])
    begin = builder.block
    with builder.if_then(builder.not_(moderate), likely=False):
        far = [builder.call(_far(emitter), [angle, *pair]) for angle, pair in zip(angles, near, strict=True)]
        far_pairs = [[builder.extract_value(pair, k) for k in range(2)] for pair in far]
        end = builder.block
    chosen = []
    for pair, far_pair in zip(near, far_pairs, strict=True):
        phis = [builder.phi(emitter.type) for _ in pair]
        for phi, value, far_value in zip(phis, pair, far_pair, strict=True):
            phi.add_incoming(value, begin)
            phi.add_incoming(far_value, end)
        chosen.append((phis[0], phis[1]))
    return chosen


def _far(emitter: Emitter) -> ir.Value:
    """Function that replaces sines and cosines of angles beyond LARGEST."""
    module, name = emitter.builder.module, f"far_{emitter.dtype}_{emitter.lanes}"
    if name in module.globals:
        return module.globals[name]
    pair = ir.LiteralStructType([emitter.type] * 2)
    function = ir.Function(module, ir.FunctionType(pair, [emitter.type] * 3), name)
    function.linkage = "internal"
    for attribute in ("noinline", "cold"):
        function.attributes.add(attribute)
    angle, *near = function.args
    own = Emitter(ir.IRBuilder(function.append_basic_block()), emitter.dtype, emitter.lanes)
    moderate = own.at_most(own.intrinsic("fabs", angle), own.constant(LARGEST))
    result: ir.Value = ir.Constant(pair, ir.Undefined)
    for k, name in enumerate(("sin", "cos")):
        value = own.builder.select(moderate, near[k], own.by_the_c_library(name, angle))
        result = own.builder.insert_value(result, value, k)
    own.builder.ret(result)
    return function


def in_float64(emitter: Emitter, function: OnOne, argument: ir.Value) -> tuple[ir.Value, ...]:
    """Result of a float64 function for a vector of either type."""
    if isinstance(emitter.number, ir.DoubleType):
        return function(emitter, argument)
    wide = Emitter(emitter.builder, "float64", emitter.lanes)
    found = function(wide, emitter.builder.fpext(argument, wide.type))
    return tuple(emitter.builder.fptrunc(value, emitter.type) for value in found)


def sine_and_cosine(emitter: Emitter, angle: ir.Value) -> tuple[ir.Value, ir.Value]:
    """Sine and cosine of a vector of angles without a branch, in float64.

    Reduction by pi/2 as Cody and Waite, in three parts with the rounding of the remainder kept; two polynomials on
    [-pi/4, pi/4] with the coefficients of fdlibm (Sun Microsystems 1993, k_sin.c and k_cos.c), chosen by quadrant.
    Errors stay below 1 unit in the last place up to LARGEST; beyond it the result is meaningless.
    """
    builder, constant = emitter.builder, emitter.constant
    quarter = emitter.intrinsic("rint", builder.fmul(angle, constant(2 / math.pi)))
    sine, cosine = _near_zero(emitter, *_remainder(emitter, angle, quarter))
    integers = ir.VectorType(ir.IntType(64), emitter.lanes)

    def integer(k: int) -> ir.Value:
        return ir.Constant(integers, [k] * emitter.lanes)

    def with_sign(value: ir.Value, quadrant: ir.Value) -> ir.Value:
        """The negative where the second bit of the quadrant is set."""
        bit = builder.shl(builder.and_(quadrant, integer(2)), integer(62))
        return builder.bitcast(builder.xor(builder.bitcast(value, integers), bit), emitter.type)

    quadrant = builder.bitcast(builder.fadd(quarter, constant(ROUNDER)), integers)
    swapped = builder.icmp_unsigned("!=", builder.and_(quadrant, integer(1)), integer(0))
    return (
        with_sign(builder.select(swapped, cosine, sine), quadrant),
        with_sign(builder.select(swapped, sine, cosine), builder.add(quadrant, integer(1))),
    )


def _remainder(emitter: Emitter, angle: ir.Value, quarter: ir.Value) -> tuple[ir.Value, ir.Value]:
    """Remainder angle - quarter pi/2, as a number and its rounding."""
    builder = emitter.builder
    first, second, third = (emitter.constant(-part) for part in HALF_PI)
    r1 = emitter.intrinsic("fmuladd", quarter, first, angle)  # exact
    r2 = emitter.intrinsic("fmuladd", quarter, second, r1)
    lost = emitter.intrinsic("fmuladd", quarter, second, builder.fsub(r1, r2))
    rest = emitter.intrinsic("fmuladd", quarter, third, lost)
    r = builder.fadd(r2, rest)
    return r, builder.fsub(rest, builder.fsub(r, r2))


def _near_zero(emitter: Emitter, r: ir.Value, tail: ir.Value) -> tuple[ir.Value, ir.Value]:
    """Sine and cosine of r + tail, |r| <= pi/4: r + r^3 S(r^2) + tail cos r, and 1 - r^2/2 + r^4 C(r^2) - tail r.

    The rounding error of 1 - r^2/2 is kept, and small terms are added first.
    """
    builder, one = emitter.builder, emitter.constant(1.0)
    z = builder.fmul(r, r)
    half = builder.fmul(z, emitter.constant(0.5))
    near = builder.fsub(one, half)
    small = emitter.intrinsic("fmuladd", builder.fmul(r, z), _polynomial(emitter, SINE, z), builder.fmul(tail, near))
    rest = builder.fsub(builder.fsub(builder.fsub(one, near), half), builder.fmul(r, tail))
    rest = emitter.intrinsic("fmuladd", builder.fmul(z, z), _polynomial(emitter, COSINE, z), rest)
    return builder.fadd(r, small), builder.fadd(near, rest)


def _polynomial(emitter: Emitter, coefficients: tuple[float, ...], x: ir.Value) -> ir.Value:
    """Polynomial by Horner's rule, lowest power first."""
    result = emitter.constant(coefficients[-1])
    for coefficient in coefficients[-2::-1]:
        result = emitter.intrinsic("fmuladd", result, x, emitter.constant(coefficient))
    return result


def hyperbolic_tangent(emitter: Emitter, x: ir.Value) -> tuple[ir.Value]:
    """Hyperbolic tangent of a vector of numbers without a branch, in float64.

    With |x| = k log(2)/2 + r, -0.09 < r < 0.26 up to k = 52, S = 2^-k, and R = r coth r by a polynomial,

        tanh |x| = ((1 - S) R + (1 + S) r) / ((1 + S) R + (1 - S) r).

    The rounding errors of both sums are kept and correct the quotient. Errors stay below 1 unit in the last place, on
    processors without fused multiply-add below 2.
    """
    builder, constant = emitter.builder, emitter.constant
    size = _minimum(emitter, emitter.intrinsic("fabs", x), 20.0)  # whose tangent is 1
    k = emitter.intrinsic("rint", emitter.intrinsic("fmuladd", size, constant(2 / math.log(2)), constant(-0.25)))
    k = _minimum(emitter, k, 52.0)  # 1 + S is exact
    r, rest = _near_log_2(emitter, size, k)
    S, one = _power_of_two(emitter, builder.fneg(k)), constant(1.0)
    a, b = builder.fsub(one, S), builder.fadd(one, S)

    def total(a: ir.Value, b: ir.Value) -> tuple[ir.Value, ir.Value]:
        """a R + b r, as a number and a small one."""
        found = emitter.intrinsic("fmuladd", b, r, a)
        lost = emitter.intrinsic("fmuladd", b, r, builder.fsub(a, found))
        return found, emitter.intrinsic("fmuladd", a, rest, lost)

    (n, n_rest), (d, d_rest) = total(a, b), total(b, a)
    inverse = builder.fdiv(one, builder.fadd(d, d_rest))
    found = builder.fmul(builder.fadd(n, n_rest), inverse)
    less = builder.fneg(found)
    left = emitter.intrinsic("fmuladd", less, d, n)
    left = builder.fadd(left, emitter.intrinsic("fmuladd", less, d_rest, n_rest))
    return (emitter.intrinsic("copysign", emitter.intrinsic("fmuladd", left, inverse, found), x),)


def exponential(emitter: Emitter, x: ir.Value) -> tuple[ir.Value]:
    """Exponential function of a vector of numbers without a branch, in float64.

    With x/2 = k log(2)/2 + r, |r| < 0.18, and R as in `hyperbolic_tangent`,

        e^x = 2^k (R + r) / (R - r) = 2^k (1 + 2 r + 2 r v / (1 - v)),  v = r + 1 - R.

    2^k is two factors, so that a result below the normal numbers is rounded once more, not twice. Errors stay below
    1.1 units in the last place.
    """
    builder, constant = emitter.builder, emitter.constant
    x = builder.fneg(_minimum(emitter, builder.fneg(_minimum(emitter, x, 800.0)), 800.0))  # beyond: infinite, or 0
    k = emitter.intrinsic("rint", builder.fmul(x, constant(1 / math.log(2))))
    r, rest = _near_log_2(emitter, builder.fmul(x, constant(0.5)), k)
    v, twice, one = builder.fsub(r, rest), builder.fadd(r, r), constant(1.0)
    small = builder.fadd(twice, builder.fdiv(builder.fmul(twice, v), builder.fsub(one, v)))
    half = emitter.intrinsic("rint", builder.fmul(k, constant(0.5)))
    found = builder.fmul(builder.fadd(one, small), _power_of_two(emitter, half))
    return (builder.fmul(found, _power_of_two(emitter, builder.fsub(k, half))),)


def _minimum(emitter: Emitter, x: ir.Value, bound: float) -> ir.Value:
    """Minimum of a number and a bound; NaN stays."""
    most = emitter.constant(bound)
    return emitter.builder.select(emitter.builder.fcmp_ordered("<", most, x), most, x)


def _near_log_2(emitter: Emitter, x: ir.Value, k: ir.Value) -> tuple[ir.Value, ir.Value]:
    """r = x - k log(2)/2, in two parts of which the first is exact, and r coth r - 1."""
    builder = emitter.builder
    first, second = (emitter.constant(-part) for part in HALF_LOG_2)
    r = emitter.intrinsic("fmuladd", k, second, emitter.intrinsic("fmuladd", k, first, x))
    z = builder.fmul(r, r)
    return r, builder.fmul(z, _polynomial(emitter, HYPERBOLIC, z))


def _power_of_two(emitter: Emitter, k: ir.Value) -> ir.Value:
    """2^k of whole numbers, -1023 < k < 1024."""
    builder, integers = emitter.builder, ir.VectorType(ir.IntType(64), emitter.lanes)
    bits = builder.bitcast(builder.fadd(k, emitter.constant(ROUNDER + 1023)), integers)
    return builder.bitcast(builder.shl(bits, ir.Constant(integers, [52] * emitter.lanes)), emitter.type)


def each(function: OnOne) -> Function:
    """Apply a float64 function to each of some arguments."""
    return lambda emitter, arguments: [in_float64(emitter, function, x) for x in arguments]


# By operation: the function, and which of its results it is
ELEMENTARY: dict[str, tuple[Function, int]] = {
    "sin": (sines_and_cosines, 0),
    "cos": (sines_and_cosines, 1),
    "tanh": (each(hyperbolic_tangent), 0),
    "exp": (each(exponential), 0),
}
