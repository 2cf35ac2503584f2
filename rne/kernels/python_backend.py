"""Program as plain Python on floats, for one state per call."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from ..basics.spatial import Array
from ..graph.graph import BINARY, UNARY
from ..graph.program import Operand, Program
from .soundness import Conditions, NeedsRecursion, Trace

SYMBOLS = {"add": "+", "subtract": "-", "multiply": "*", "divide": "/"}
FUNCTIONS = {name: f"{name}({{}})" for name in ("sin", "cos", "sqrt", "abs", "tanh", "exp", "sign")}
FUNCTIONS |= {"minimum": "minimum({}, {})", "maximum": "maximum({}, {})", "arctan2": "atan2({}, {})"}
FUNCTIONS |= {"less": "float({} < {})", "less_equal": "float({} <= {})"}
FUNCTIONS |= {"negative": "-{}", "where": "({1} if {0} else {2})"}
LONGEST_SUM = 64  # terms in one written-out sum
DEEPEST = 12  # nested parentheses in one expression
IMPORTED = ("atan2", "cos", "exp", "inf", "nan", "sin", "sqrt", "tanh")  # from math
FUNCTION_NAMES: dict[str, Any] = {name: getattr(math, name) for name in IMPORTED} | {"sign": UNARY["sign"], **BINARY}


def expressions(
    program: Program,
    entry: Callable[[int], str] = "x{}".format,
    functions: Mapping[str, str] = FUNCTIONS,
    number: Callable[[float], str] = repr,
) -> tuple[list[str], list[str]]:
    """Assignments in order, and an expression for each output; a result that is read once is written inline.

    Texts are given by `entry` for inputs, by `functions` for operations other than + - * /, infinity and NaN, and by
    `number` for other constants.
    """
    uses = Counter(arg for instruction in program.instructions for arg in instruction.args)
    uses.update(program.outputs)
    texts: dict[Operand, tuple[str, int]] = {}
    lines: list[str] = []

    def text(arg: Operand) -> tuple[str, int]:
        if arg.kind == "input":
            return entry(int(arg.value)), 0
        if arg.kind == "constant":
            size = abs(arg.value)
            return f"{'-' if arg.value < 0 else ''}{functions.get(repr(size)) or number(size)}", 0
        return texts[arg]

    for k, instruction in enumerate(program.instructions):
        operand = Operand("result", k)
        args, depths = zip(*[text(arg) for arg in instruction.args], strict=True)
        symbol, depth = SYMBOLS.get(instruction.kind), 1 + max(depths)
        expression = f" {symbol} ".join(args) if symbol else functions[instruction.kind].format(*args)
        if uses[operand] > 1 or depth >= DEEPEST:
            lines.append(f"t{k} = {expression}")
            expression, depth = f"t{k}", 0
        elif symbol or instruction.kind == "negative":
            expression = f"({expression})"
        texts[operand] = expression, depth
    return lines, [text(output)[0] for output in program.outputs]


AS_TEXT = Conditions(
    finite=lambda names: f"isfinite({_total(names)})",
    within=lambda names, bound: f"{_total([f'{name} * {name}' for name in names])} <= {bound**2!r}",
    above=lambda names, factor, others: " and ".join(
        f"{a} > {factor!r} * {b}" for a, b in zip(names, others, strict=True)
    ),
)


def state_source(trace: Trace, *, apart: bool = False) -> str:
    """Source of a Python function of one float64 vector per argument, which returns an array or raises NeedsRecursion.

    If the numbers of a run are `apart`, each of them is an argument.
    """
    lines, outputs = expressions(trace.program)
    names = iter([f"x{k}" for k in range(trace.program.inputs)])
    taken = [[next(names) for _ in range(width)] for width in trace.widths]
    alone = trace.of_run if apart else None
    unpacked = [f"[{', '.join(group)}] = a{k}.tolist()" for k, group in enumerate(taken) if group and k != alone]
    results = [f"r{k}" for k in range(trace.entries)]
    before = trace.sound_inputs([name for group in taken for name in group], np.float64, AS_TEXT)
    after = trace.sound_results([*results, *outputs[len(results) :]], np.float64, AS_TEXT)
    body = [
        *_unless(before),
        *lines,
        *(f"{result} = {output}" for result, output in zip(results, outputs, strict=False)),
        *_unless(after),
    ]
    arguments = ", ".join(name for k, group in enumerate(taken) for name in (group if k == alone else [f"a{k}"]))
    text = [f"def kernel({arguments}):", *unpacked, "try:", *(f"    {line}" for line in body)]
    text.append("except (ValueError, ArithmeticError): raise NeedsRecursion from None")
    return "\n    ".join([*text, f"return {_array(results, trace.shape)}"]) + "\n"


def _unless(conditions: Sequence[str]) -> list[str]:
    return [f"if not ({' and '.join(conditions)}): raise NeedsRecursion"] if conditions else []


def _total(names: Sequence[str]) -> str:
    """Text of a sum, in a form that the compiler takes however many terms there are."""
    if len(names) > LONGEST_SUM:
        return f"sum(({', '.join(names)}))"
    return " + ".join(names) or "0.0"


def _array(results: Sequence[str], shape: tuple[int, ...]) -> str:
    if not shape:
        return f"float64({results[0]})"
    flat = f"array(({', '.join(results)}{',' if len(results) == 1 else ''}))"
    return flat if len(shape) == 1 else f"{flat}.reshape({shape})"


def state_function(trace: Trace, *, apart: bool = False) -> Callable[..., Array]:
    """Compiled function of `state_source`, whose text holds only numbers and generated names."""
    names = {"isfinite": math.isfinite, "array": np.array, "float64": np.float64, "NeedsRecursion": NeedsRecursion}
    namespace: dict[str, Any] = FUNCTION_NAMES | names
    exec(compile(state_source(trace, apart=apart), "<rne kernel>", "exec"), namespace)
    compiled: Callable[..., Array] = namespace["kernel"]
    return compiled
