"""The student's view in print: six significant digits, points below each other, an equation number on every line."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

if TYPE_CHECKING:
    from .record import Recursion

# Attribute of the record, equation of Høifødt 2011, unit. a_o has no number of its own: it is its parent's (3.38).
VECTORS = (
    ("omega", "(3.29)", "rad/s"),
    ("alpha", "(3.33)", "rad/s^2"),
    ("a_o", "", "m/s^2"),
    ("a_c", "(3.37)", "m/s^2"),
    ("a_e", "(3.38)", "m/s^2"),
    ("gravity", "(5.33)", "m/s^2"),
    ("f", "(3.24)", "N"),
    ("tau", "(3.27)", "N m"),
)
LEGEND = (
    "Each vector in the axes of its own link; in brackets the equations of Høifødt 2011.",
    "omega, alpha: spin and its rate. a_c, a_e: true accelerations of centre of mass and end.",
    "f, tau: of the joint on its link, at the joint. u: the drive's share of them.",
)
BRANCHED = "The links of a branched robot have no single end: a_o, the origin's acceleration, stands for a_e."
NAME = 40  # characters of a joint's name
DIGITS = 6
SMALLEST, LARGEST = -5, 5  # decimal exponents written without one


class Row(NamedTuple):
    """A line of a table: its head, and the cells to be aligned."""

    head: str
    cells: Sequence[str] = ()


def recursion_table(record: Recursion) -> str:
    """The record, or the first state of its batch, joint by joint in at most 100 columns."""
    batch = record.batch
    if 0 in batch:
        return f"Recursion of no states: leading shape {batch}"
    if not record.joints:
        return "Recursion of a robot without moving joints"
    lines = []
    if batch:
        last = tuple(k - 1 for k in batch)
        index = str(last[0]) if len(last) == 1 else str(last)
        lines.append(f"The first of {np.prod(batch)} states, leading shape {batch}; record.state({index}) is the last.")
        record = record.state((0,) * len(batch))
    lines += LEGEND if record.a_e is not None else [*LEGEND, BRANCHED]
    rows = [Row("", ("x", "y", "z"))]
    for i in range(len(record.joints)):
        rows += _joint(record, i)
    return "\n".join([*lines, *aligned(rows)])


def _joint(record: Recursion, i: int) -> Iterator[Row]:
    """The rows of one joint and the body behind it; u only where a drive is, not at a mimic joint."""
    yield Row(f"{short(record.joints[i])}, {record.joint_types[i]}{'' if i in record.drivers else ', mimic'}")
    for name, equation, unit in VECTORS:
        vectors = getattr(record, name)
        if vectors is None or i >= len(vectors) or (name == "a_o" and record.a_e is not None):
            continue
        yield from _numbers(name, equation, unit, vectors[i])
    if i in record.drivers:
        unit = "N" if record.joint_types[i] == "prismatic" else "N m"
        yield from _numbers("u", "(5.3)", unit, [record.u[record.drivers.index(i)]])


def _numbers(name: str, equation: str, unit: str, values: Iterable[Any]) -> Iterator[Row]:
    values = list(values)
    yield Row(f"  {name:<7} {equation:<6} {unit:<7}", [six_digits(x.real) for x in values])
    if any(np.iscomplexobj(x) or x.imag != 0 for x in values):
        yield Row(f"  {'':<7} {'imag':<6} {unit:<7}", [six_digits(x.imag) for x in values])


def short(name: str) -> str:
    """A name from a file, fit for one line of a table."""
    text = repr(name)[1:-1]
    return text if len(text) <= NAME else f"{text[: NAME - 3]}..."


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
    split = [[_at_the_point(cell) for cell in row.cells] for row in rows]
    columns = range(max(len(cells) for cells in split))
    before, after = (
        [max((len(cells[k][side]) for cells in split if k < len(cells)), default=0) for k in columns] for side in (0, 1)
    )
    head = max((len(row.head) for row in rows if row.cells), default=0)
    lines = []
    for row, cells in zip(rows, split, strict=True):
        numbers = (f"{a:>{before[k]}}{b:<{after[k]}}" for k, (a, b) in enumerate(cells))
        lines.append("  ".join([f"{row.head:<{head}}" if cells else row.head, *numbers]).rstrip())
    return lines


def _at_the_point(text: str) -> tuple[str, str]:
    match = re.search(r"(?<=\d)[.e].*", text)
    return (text[: match.start()], match.group()) if match else (text, "")
