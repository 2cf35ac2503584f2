"""Tables of numbers in plain text: six significant digits, decimal points below each other."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

MAX_NAME = 40  # characters of a joint's name
DIGITS = 6
SMALLEST, LARGEST = -5, 5  # decimal exponents written without one


class Row(NamedTuple):
    """A line of a table: its head, and the cells to be aligned."""

    head: str
    cells: Sequence[str] = ()
    words: bool = False  # cells are titles, which end where their column does


def short(name: str) -> str:
    """A name from a file, fit for one line of a table."""
    text = repr(name)[1:-1]
    return text if len(text) <= MAX_NAME else f"{text[: MAX_NAME - 3]}..."


def six_digits(x: Any) -> str:
    """A real number of any type to six significant digits: no zeros at the end, and no sign on a zero."""
    if hasattr(x, "context"):  # mpmath
        text = x.context.nstr(x, DIGITS, min_fixed=0, max_fixed=0, show_zero_exponent=True)
    else:
        number = x if isinstance(x, np.floating) else float(x)
        text = np.format_float_scientific(number, precision=DIGITS - 1, unique=False)
    mantissa, power = text.split("e")
    digits = mantissa.lstrip("-").replace(".", "").rstrip("0")
    if not digits:
        return "0"
    sign, exponent = "-" * mantissa.startswith("-"), int(power)
    if not SMALLEST <= exponent <= LARGEST:
        whole, fraction, ending = digits[0], digits[1:], f"e{exponent}"
    elif exponent < 0:
        whole, fraction, ending = "0", "0" * (-exponent - 1) + digits, ""
    else:
        whole, fraction, ending = digits[: exponent + 1].ljust(exponent + 1, "0"), digits[exponent + 1 :], ""
    return f"{sign}{whole}{'.' if fraction else ''}{fraction}{ending}"


def aligned(rows: Sequence[Row]) -> list[str]:
    """The rows as lines, every column's decimal points below each other."""
    split = [[] if row.words else [_at_the_point(cell) for cell in row.cells] for row in rows]
    columns = range(max(len(row.cells) for row in rows))
    before, after = (
        [max((len(cells[k][side]) for cells in split if k < len(cells)), default=0) for k in columns] for side in (0, 1)
    )
    for row in rows:
        for k, title in enumerate(row.cells if row.words else ()):
            before[k] = max(before[k], len(title) - after[k])
    head = max((len(row.head) for row in rows if row.cells), default=0)
    lines = []
    for row, cells in zip(rows, split, strict=True):
        numbers = [f"{a:>{before[k]}}{b:<{after[k]}}" for k, (a, b) in enumerate(cells)]
        numbers += [f"{title:>{before[k] + after[k]}}" for k, title in enumerate(row.cells if row.words else ())]
        lines.append("  ".join([f"{row.head:<{head}}" if numbers else row.head, *numbers]).rstrip())
    return lines


def _at_the_point(text: str) -> tuple[str, str]:
    match = re.search(r"(?<=\d)[.e].*", text)
    return (text[: match.start()], match.group()) if match else (text, "")
