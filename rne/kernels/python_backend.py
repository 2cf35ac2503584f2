"""A program as plain Python on floats, for one state per call."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from ..basics.spatial import Array
from ..dynamics.precision import NEARLY_SINGULAR, velocity_bound
from .program import Instruction, Operand, Program

SYMBOLS = {"add": "+", "subtract": "-", "multiply": "*", "divide": "/"}
FUNCTIONS = {
    "negative": "-{}",
    "sin": "sin({})",
    "cos": "cos({})",
    "sqrt": "sqrt({})",
    "abs": "abs({})",
    "tanh": "tanh({})",
    "exp": "exp({})",
    "arctan2": "atan2({}, {})",
    "sign": "sign({})",
    "minimum": "min({}, {})",
    "maximum": "max({}, {})",
    "less": "float({} < {})",
    "less_equal": "float({} <= {})",
    "where": "({1} if {0} else {2})",
}
LONGEST_SUM = 64  # terms in one written-out sum
DEEPEST = 12  # nested parentheses in one expression


class Refused(Exception):
    """Raised for a state whose inputs, result or pivots of M must be examined by the recursion."""


class Guard(NamedTuple):
    """Conditions under which a state needs no examination by the recursion.

    Attributes
    ----------
    pivot_factor : float
        Each pivot of M must exceed this times M's diagonal entry.
    n : int
        Number of pivots; they stand behind the result's entries, the diagonal behind them.
    rates : range
        Inputs that are joint rates.
    velocity_bound : float
        Largest norm of the rates.
    """

    pivot_factor: float
    n: int
    rates: range
    velocity_bound: float

    @classmethod
    def of(cls, n: int, rates: range, dtype: np.dtype[Any]) -> Guard:
        """That of computations in a dtype."""
        return cls(NEARLY_SINGULAR * n * float(np.finfo(dtype).eps), n, rates, velocity_bound(dtype))


def sign(x: float) -> float:
    """-1, 0 or 1."""
    return math.copysign(1.0, x) if x else 0.0


IMPORTED = ("atan2", "cos", "exp", "sin", "sqrt", "tanh")  # from math
FUNCTION_NAMES: dict[str, Any] = {name: getattr(math, name) for name in IMPORTED} | {"sign": sign}


def expressions(
    program: Program, entry: Callable[[int], str] = "x{}".format, functions: Mapping[str, str] = FUNCTIONS
) -> tuple[list[str], list[str]]:
    """Assignments in order, and an expression for each output; a result that is read once is written inline.

    Parameters
    ----------
    program : Program
    entry : callable
        Text of input k.
    functions : mapping of str to str
        Text of the operations other than + - * /.
    """
    uses = Counter(arg for instruction in program.instructions for arg in instruction.args)
    uses.update(program.outputs)
    texts: dict[Operand, tuple[str, int]] = {}
    lines: list[str] = []

    def text(arg: Operand) -> tuple[str, int]:
        if arg.kind == "input":
            return entry(int(arg.value)), 0
        return (repr(arg.value), 0) if arg.kind == "constant" else texts[arg]

    for k, instruction in enumerate(program.instructions):
        operand = Operand("result", k)
        expression, depth = _expression(instruction, [text(arg) for arg in instruction.args], functions)
        if uses[operand] > 1 or depth >= DEEPEST:
            lines.append(f"t{k} = {expression}")
            expression, depth = f"t{k}", 0
        elif instruction.kind in SYMBOLS or instruction.kind == "negative":
            expression = f"({expression})"
        texts[operand] = expression, depth
    return lines, [text(output)[0] for output in program.outputs]


def _expression(
    instruction: Instruction, args: Sequence[tuple[str, int]], functions: Mapping[str, str]
) -> tuple[str, int]:
    depth = 1 + max(d for _, d in args)
    if instruction.kind in SYMBOLS:
        return f" {SYMBOLS[instruction.kind]} ".join(a for a, _ in args), depth
    return functions[instruction.kind].format(*(a for a, _ in args)), depth


def source(program: Program, widths: Sequence[int], shape: tuple[int, ...], guard: Guard | None = None) -> str:
    """A Python function of one float64 vector per argument that returns the result as an array.

    Parameters
    ----------
    program : Program
    widths : sequence of int
        Number of inputs of each argument.
    shape : tuple of int
        Of the result.
    guard : Guard, optional

    Returns
    -------
    str
        The function raises Refused for inputs or a result that are not finite and for a guard that fails.
    """
    lines, outputs = expressions(program)
    groups, start = [], 0
    for k, width in enumerate(widths):
        names = [f"x{start + j}" for j in range(width)]
        groups.append(
            f"{', '.join(names)}{',' if width == 1 else ''} = a{k}.tolist()" if width else f"() = a{k}.tolist()"
        )
        start += width
    size = math.prod(shape)
    results = [f"r{k}" for k in range(size)]
    body = [f"if not isfinite({_total([f'x{k}' for k in range(start)])}): raise Refused"]
    if guard is not None and guard.rates:
        body.append(f"if {_total([f'x{k} * x{k}' for k in guard.rates])} > {guard.velocity_bound**2!r}: raise Refused")
    body += lines
    if guard is not None:
        body += [f"d{k} = {outputs[size + k]}" for k in range(guard.n)]
        holds = [f"d{k} > {guard.pivot_factor!r} * {outputs[size + guard.n + k]}" for k in range(guard.n)]
        body.append(f"if not ({' and '.join(holds) or 'True'}): raise Refused")
    body += [f"{result} = {output}" for result, output in zip(results, outputs, strict=False)]
    body.append(f"if not isfinite({_total(results)}): raise Refused")
    arguments = ", ".join(f"a{k}" for k in range(len(widths)))
    text = [f"def kernel({arguments}):", *groups, "try:", *(f"    {line}" for line in body)]
    text += ["except (ValueError, ArithmeticError): raise Refused from None", f"return {_array(results, shape)}"]
    return "\n    ".join(text) + "\n"


def _total(names: Sequence[str]) -> str:
    """The sum of numbers, in a form that the compiler takes however many there are."""
    if len(names) > LONGEST_SUM:
        return f"sum(({', '.join(names)}))"
    return " + ".join(names) or "0.0"


def _array(results: Sequence[str], shape: tuple[int, ...]) -> str:
    if not shape:
        return f"float64({results[0]})"
    flat = f"array(({', '.join(results)}{',' if len(results) == 1 else ''}))"
    return flat if len(shape) == 1 else f"{flat}.reshape({shape})"


def compiled_function(
    program: Program, widths: Sequence[int], shape: tuple[int, ...], guard: Guard | None = None
) -> Callable[..., Array]:
    """The compiled function of `source`, which holds nothing but numbers and generated names."""
    names: dict[str, Any] = {"isfinite": math.isfinite, "array": np.array, "float64": np.float64, "Refused": Refused}
    namespace = FUNCTION_NAMES | names
    exec(compile(source(program, widths, shape, guard), "<rne kernel>", "exec"), namespace)
    compiled: Callable[..., Array] = namespace["kernel"]
    return compiled
