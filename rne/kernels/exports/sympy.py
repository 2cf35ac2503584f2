"""A kernel as SymPy's expressions, with the inertial parameters by name where they are inputs."""

from __future__ import annotations

import math
import operator
from collections.abc import Callable, Sequence
from typing import Any

from ..program import Operand, without_judged

PARAMETERS = ("m", "mx", "my", "mz", "Ixx", "Ixy", "Iyy", "Ixz", "Iyz", "Izz")  # of a body
WRENCH = ("nx", "ny", "nz", "fx", "fy", "fz")
DIGITS = 12  # a decimal number of so few, up to rounding, is meant exactly
ROUNDING = 4 * 2.0**-52  # relative, of a product of a few numbers


def to_sympy(kernel: Any) -> Any:
    """`Kernel.to_sympy`."""
    try:
        import sympy
    except ImportError:
        raise ImportError("`to_sympy` needs SymPy, which is not installed: pip install 'rne[sympy]'") from None
    functions, trace = _functions(sympy), kernel.traced
    pairs = zip(kernel.names, kernel.widths, strict=True)
    symbols = [sympy.Symbol(name) for argument, width in pairs for name in names(argument, width)]
    program, values = without_judged(trace.program, trace.entries), list[Any]()

    def value(arg: Operand) -> Any:
        if arg.kind == "constant":
            return _number(sympy, arg.value)
        return (symbols if arg.kind == "input" else values)[int(arg.value)]

    for kind, args in program.instructions:
        values.append(functions[kind](*map(value, args)))
    entries = [value(output) for output in program.outputs]
    if not trace.shape:
        return entries[0]
    if len(trace.shape) <= 2:
        return sympy.Matrix(*(*trace.shape, 1)[:2], entries)
    return sympy.ImmutableDenseNDimArray(entries, trace.shape)


def names(argument: str, width: int) -> Sequence[str]:
    """The symbols of an argument's entries."""
    if argument == "parameters":
        return [f"{name}_{body + 1}" for body in range(width // len(PARAMETERS)) for name in PARAMETERS]
    if argument.startswith("external_"):
        return [f"{name}_{argument.removeprefix('external_')}" for name in WRENCH]
    return [f"{argument}_{k + 1}" for k in range(width)]


def _number(sympy: Any, x: float) -> Any:
    """A rational number if x is a short decimal one, up to rounding; otherwise x."""
    text = f"{x:.{DIGITS}g}"
    return sympy.Rational(text) if math.isfinite(x) and abs(float(text) - x) <= ROUNDING * abs(x) else sympy.Float(x)


def _functions(sympy: Any) -> dict[str, Callable[..., Any]]:
    def holds(relation: Any) -> Any:
        return sympy.Piecewise((1, relation), (0, True))

    return {
        "add": operator.add,
        "subtract": operator.sub,
        "multiply": operator.mul,
        "divide": operator.truediv,
        "negative": operator.neg,
        **{name: getattr(sympy, name) for name in ("sin", "cos", "sqrt", "tanh", "exp", "sign")},
        "abs": sympy.Abs,
        "arctan2": sympy.atan2,
        "minimum": sympy.Min,
        "maximum": sympy.Max,
        "less": lambda a, b: holds(sympy.Lt(a, b)),
        "less_equal": lambda a, b: holds(sympy.Le(a, b)),
        "where": lambda c, a, b: sympy.Piecewise((a, sympy.Ne(c, 0)), (b, True)),
    }
