"""Sine and cosine of a vector of angles without a branch: reduction by pi/2, two polynomials, choice by quadrant.

Reduction as Cody and Waite, with pi/2 in three parts and the rounding of the remainder kept; polynomials on
[-pi/4, pi/4] with the coefficients of fdlibm (Sun Microsystems 1993, k_sin.c and k_cos.c). Errors stay below 1 unit in
the last place up to LARGEST; larger angles are left to the C library.
"""

from __future__ import annotations

import math
from typing import Any

from llvmlite import ir

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


def sine_and_cosine(emitter: Any, angle: Any) -> tuple[Any, Any]:
    """Sine and cosine of a vector of angles, computed in float64."""
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
