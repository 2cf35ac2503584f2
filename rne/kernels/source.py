"""A program as source text: Python, NumPy, MATLAB (and Octave) or C. Joints are numbers; names are in comments only."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import product
from typing import NamedTuple

from .program import Program
from .python_backend import FUNCTIONS, expressions

LANGUAGES = ("python", "numpy", "matlab", "c")


class Printable(NamedTuple):
    """A program to print: its name, arguments with their lengths, shape of its result, lines of its heading."""

    program: Program
    name: str
    arguments: tuple[str, ...]
    widths: tuple[int, ...]
    shape: tuple[int, ...]
    heading: Sequence[str] = ()


def to_source(printable: Printable, language: str) -> str:
    """Source text of a function.

    Parameters
    ----------
    printable : Printable
    language : {"python", "numpy", "matlab", "c"}

    Returns
    -------
    str

    Raises
    ------
    ValueError
        For any other language.
    """
    printers = {"python": _python, "numpy": _numpy, "matlab": _matlab, "c": _c}
    if language not in LANGUAGES:
        raise ValueError(f"`language` must be one of {list(LANGUAGES)}, got {language!r}")
    return printers[language](printable)


def _lines(
    printable: Printable, index: Callable[[str, int], str], functions: dict[str, str]
) -> tuple[list[str], list[str]]:
    entries = [index(name, k) for name, w in zip(printable.arguments, printable.widths, strict=True) for k in range(w)]
    return expressions(printable.program, entries.__getitem__, functions)


def _entries(shape: tuple[int, ...]) -> list[tuple[int, ...]]:
    return list(product(*(range(size) for size in shape)))


def _python(p: Printable) -> str:
    lines, outputs = _lines(p, lambda name, k: f"{name}[{k}]", FUNCTIONS)
    flat = ", ".join(outputs[: len(_entries(p.shape))])
    body = [*lines, f"return [{flat}]" if p.shape else f"return {flat}"]
    doc = f'"""Entries of the result, shape {p.shape}, row by row."""'
    head = [*(f"# {line}" for line in p.heading), f"from math import {_imported(body)}", "", ""]
    if any("sign(" in line for line in body):
        head += ["def sign(x):", "    return float(x > 0) - float(x < 0)", "", ""]
    head += [f"def {p.name}({', '.join(p.arguments)}):", f"    {doc}"]
    return "\n".join([*head, *(f"    {line}" for line in body)]) + "\n"


def _imported(lines: Sequence[str]) -> str:
    """Names from the module `math`: always the same four, and rarer ones where they are used."""
    rarer = {name for name in ("atan2", "exp") if any(f"{name}(" in line for line in lines)}
    return ", ".join(sorted({"cos", "sin", "sqrt", "tanh"} | rarer))


def _numpy(p: Printable) -> str:
    functions = FUNCTIONS | {
        **{name: f"np.{name}({{}})" for name in ("sin", "cos", "sqrt", "tanh", "exp", "sign", "abs")},
        **{name: f"np.{name}({{}}, {{}})" for name in ("minimum", "maximum", "arctan2")},
        "less": "np.less({}, {}).astype(float)",
        "less_equal": "np.less_equal({}, {}).astype(float)",
        "where": "np.where({} != 0, {}, {})",
    }
    lines, outputs = _lines(p, lambda name, k: f"{name}[..., {k}]", functions)
    stores = [
        f"result[{', '.join(['...', *map(str, entry)])}] = {output}"
        for entry, output in zip(_entries(p.shape), outputs, strict=False)
    ]
    names = ", ".join(p.arguments)
    leading = f"np.broadcast_shapes({', '.join(f'{name}.shape[:-1]' for name in p.arguments)})"
    body = [
        *lines,
        f"result = np.zeros({leading} + {p.shape}, dtype=np.result_type({names}))",
        *stores,
        "return result",
    ]
    comments = [f"# {line}" for line in p.heading]
    head = [*comments, "import numpy as np", "", "", f"def {p.name}({', '.join(p.arguments)}):"]
    return "\n".join([*head, *(f"    {line}" for line in body)]) + "\n"


def _matlab(p: Printable) -> str:
    functions = FUNCTIONS | {
        "minimum": "min({}, {})",
        "maximum": "max({}, {})",
        "less": "double({} < {})",
        "less_equal": "double({} <= {})",
        "where": "(({0} ~= 0) * {1} + ({0} == 0) * {2})",
    }
    lines, outputs = _lines(p, lambda name, k: f"{name}({k + 1})", functions)
    stores = [
        f"result({', '.join(str(k + 1) for k in entry) or '1'}) = {output}"
        for entry, output in zip(_entries(p.shape), outputs, strict=False)
    ]
    size = ", ".join(map(str, p.shape if len(p.shape) > 1 else (*p.shape, 1) if p.shape else (1, 1)))
    body = [*lines, f"result = zeros({size})", *stores]
    head = f"function result = {p.name}({', '.join(p.arguments)})"
    comments = [f"% {line}" for line in p.heading]
    return "\n".join([head, *comments, *(f"  {line};" for line in body), "end"]) + "\n"


def _c(p: Printable) -> str:
    functions = FUNCTIONS | {
        "abs": "fabs({})",
        "sign": "(({0} > 0.0) - ({0} < 0.0))",
        "minimum": "fmin({}, {})",
        "maximum": "fmax({}, {})",
        "less": "(double)({} < {})",
        "less_equal": "(double)({} <= {})",
        "where": "({} != 0.0 ? {} : {})",
    }
    lines, outputs = _lines(p, lambda name, k: f"{name}[{k}]", functions)
    stores = [f"result[{k}] = {output}" for k, output in enumerate(outputs[: len(_entries(p.shape))])]
    arguments = ", ".join([f"const double *{name}" for name in p.arguments] + ["double *result"])
    body = [*(f"const double {line};" for line in lines), *(f"{store};" for store in stores)]
    comments = [f"/* {line} */" for line in p.heading]
    head = [
        *comments,
        "#include <math.h>",
        "",
        f"/* {_size(p.shape)} {'entries, row by row' if p.shape else 'entry'}. */",
        f"void {p.name}({arguments})",
        "{",
    ]
    return "\n".join([*head, *(f"    {line}" for line in body), "}"]) + "\n"


def _size(shape: Sequence[int]) -> str:
    return " x ".join(map(str, shape)) or "1"
