"""Export of a kernel as SymPy expressions, with inertial parameters by name where they are inputs."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import partial
from typing import Any

from ...graph.program import ON_ARRAYS, interpret, without_judged

PARAMETERS = ("m", "mx", "my", "mz", "Ixx", "Ixy", "Iyy", "Ixz", "Iyz", "Izz")  # of a body
WRENCH = ("nx", "ny", "nz", "fx", "fy", "fz")
DIGITS = 12  # most digits of a decimal number that is meant exactly
ROUNDING = 4 * 2.0**-52  # relative rounding of a product of a few numbers
NAMES = {"abs": "Abs", "arctan2": "atan2", "minimum": "Min", "maximum": "Max"}
NAMES |= {name: name for name in ("sin", "cos", "sqrt", "tanh", "exp", "sign")}


def to_sympy(kernel: Any) -> Any:
    """SymPy expressions of a kernel; see `Kernel.to_sympy`."""
    try:
        import sympy
    except ImportError:
        raise ImportError("`to_sympy` needs SymPy, which is not installed: pip install 'rne[sympy]'") from None
    functions = ON_ARRAYS | {kind: getattr(sympy, name) for kind, name in NAMES.items()}  # + - * / are those of Python
    functions["less"] = lambda a, b: sympy.Piecewise((1, sympy.Lt(a, b)), (0, True))
    functions["less_equal"] = lambda a, b: sympy.Piecewise((1, sympy.Le(a, b)), (0, True))
    functions["where"] = lambda c, a, b: sympy.Piecewise((a, sympy.Ne(c, 0)), (b, True))
    pairs = zip(kernel.names, kernel.widths, strict=True)
    symbols = [sympy.Symbol(name) for argument, width in pairs for name in _names(argument, width)]
    shape, program = kernel.traced.shape, without_judged(kernel.printable.program, kernel.traced.entries)
    entries = interpret(program, symbols, functions, partial(_number, sympy))
    if len(shape) > 2:
        return sympy.ImmutableDenseNDimArray(entries, shape)
    return sympy.Matrix(*(*shape, 1)[:2], entries) if shape else entries[0]


def _names(argument: str, width: int) -> Sequence[str]:
    if argument == "parameters":
        return [f"{name}_{body + 1}" for body in range(width // len(PARAMETERS)) for name in PARAMETERS]
    kind, _, number = argument.partition("_")
    return [f"{name}_{number}" for name in WRENCH] if number else [f"{kind}_{k + 1}" for k in range(width)]


def _number(sympy: Any, x: float) -> Any:
    """Rational number if x is a short decimal one, up to rounding; otherwise x."""
    text = f"{x:.{DIGITS}g}"
    return sympy.Rational(text) if math.isfinite(x) and abs(float(text) - x) <= ROUNDING * abs(x) else sympy.Float(x)
