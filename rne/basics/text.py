"""Texts for consoles and notebooks: short texts, tables of numbers, never pages of arrays."""

from __future__ import annotations

import re
import textwrap
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import fields
from typing import Any, ClassVar, NamedTuple

import numpy as np

from .arrays import ReadOnlyArrays

MAX_NAME = 40  # largest number of characters of a joint's name
DIGITS = 6  # significant digits
WIDTH = 100  # characters of a line
LONGEST = 120  # largest number of characters of one value
FEW = 7  # largest number of numbers that are written out
FEW_NAMES = 6  # largest number of names that are written out
UNBROKEN = "\xa0"  # a space at which no line ends

# Units of joint arrays, and of results with an entry for each joint: of a rotating and of a sliding joint.
UNITS = {
    "q": ("rad", "m"),
    "qd": ("rad/s", "m/s"),
    "qdd": ("rad/s^2", "m/s^2"),
    "qdr": ("rad/s", "m/s"),
    "qddr": ("rad/s^2", "m/s^2"),
    "tau": ("N m", "N"),
}


def summary(thing: Any, **shown: Any) -> str:
    """Class and fields of a dataclass, each value in a few words, in lines of at most 100 characters.

    Fields that are None or have their default value are left out; `shown` replaces the values of fields of these names.
    """
    values = {f.name: shown.get(f.name, getattr(thing, f.name)) for f in fields(thing)}
    left_out = {f.name for f in fields(thing) if values[f.name] is None or values[f.name] is f.default}
    parts = [f"{name}={brief(value)}" for name, value in values.items() if name not in left_out]
    parts = [part.replace(" ", UNBROKEN) if len(part) < WIDTH - 4 else part for part in parts]
    return wrapped(f"{type(thing).__name__}({', '.join(parts)})").replace(UNBROKEN, " ")


def wrapped(text: str) -> str:
    """Text in lines of at most 100 characters, the further ones indented; no word is broken."""
    whole: dict[str, Any] = {"break_long_words": False, "break_on_hyphens": False}
    lines = (textwrap.wrap(line, WIDTH, subsequent_indent="  ", **whole) for line in text.splitlines())
    return "\n".join(part for line in lines for part in line)


def brief(value: Any) -> str:
    """Text of a value of any type in at most 120 characters."""
    text = _brief(value)
    whole, space, _ = text[: LONGEST - 3].rpartition(" ")
    return text if len(text) <= LONGEST else f"{whole} ..." if space else cut(text, LONGEST)


def _brief(value: Any) -> str:
    if isinstance(value, str):
        return f"'{short(value)}'"
    if isinstance(value, bool | np.bool_) or value is None:
        return str(value)
    if isinstance(value, float | np.floating):
        return f"{value:.6g}"
    if isinstance(value, Mapping):
        return "{" + _cut([f"{brief(key)}: {brief(x)}" for key, x in value.items()]) + "}"
    numbers = _numbers(value)
    if numbers is not None:
        return brief_array(numbers)
    if isinstance(value, Sequence) and not hasattr(value, "_fields"):
        return "[" + _cut([brief(x) for x in value]) + "]"
    model: Any = getattr(value, "model", None)
    if hasattr(model, "moving_joints"):
        return f"{type(value).__name__} '{short(model.name)}'"
    if hasattr(value, "__qualname__"):  # functions: the rest of their repr is an address
        return str(value.__qualname__)
    return " ".join(repr(value).split())


def brief_array(x: Any) -> str:
    """Text of an array of numbers: all of a few, otherwise the shape, the smallest and the largest."""
    if x.ndim == 0:
        return f"{x[()]:.6g}"
    if x.ndim == 1 and len(x) <= FEW:
        return "[" + ", ".join(f"{entry:.4g}" for entry in x) + "]"
    shape = " x ".join(map(str, x.shape))
    if not x.size:
        return f"<{shape} numbers>"
    low, high = x.min(), x.max()
    return f"<{shape} numbers, " + (f"all {low:.4g}>" if low == high else f"{low:.4g} to {high:.4g}>")


def listed(names: Sequence[str]) -> str:
    """First names, and the number of others."""
    return _cut([short(name) for name in names])


def did_you_mean(name: str, known: Iterable[str]) -> str:
    """End of an error that suggests similar known names, or ""; case and punctuation are ignored."""
    import difflib  # only for errors

    plain = {re.sub(r"[\W_]", "", x).lower(): x for x in known}
    wanted = re.sub(r"[\W_]", "", name).lower()
    near = [wanted] if wanted in plain else difflib.get_close_matches(wanted, plain, n=3)
    return f"; did you mean {' or '.join(repr(plain[x]) for x in near)}?" if near else ""


def counted(number: int, noun: str) -> str:
    """Text of a number of things, such as "1 joint" or "6 joints"."""
    return f"{number} {noun}{'s' * (number != 1)}"


def _cut(texts: list[str]) -> str:
    more = [f"... {len(texts) - FEW_NAMES + 1} more"] if len(texts) > FEW_NAMES else []
    return ", ".join(texts[: FEW_NAMES - 1] + more if more else texts)


def _numbers(value: Any) -> Any:
    """Value as an array of real numbers, or None."""
    if not isinstance(value, np.ndarray | list | tuple | int | np.number) or hasattr(value, "_fields"):
        return None
    try:
        array = np.asarray(value)
    except ValueError:  # ragged
        return None
    return array if array.dtype.kind in "iuf" else None


SMALLEST, LARGEST = -5, 5  # decimal exponents written without one


class Row(NamedTuple):
    """Line of a table: its head, and the cells to be aligned."""

    head: str
    cells: Sequence[str] = ()
    words: bool = False  # True for titles, which are right-aligned


def short(name: str) -> str:
    """Name from a file, fit for one line of a table."""
    return cut(plain(name), MAX_NAME)


def plain(text: str) -> str:
    """Text with escapes for line ends and other characters that move a terminal's cursor or overwrite text."""
    if text.isprintable():
        return text
    from unicodedata import category

    return "".join(c if c.isprintable() or category(c) == "Zs" else repr(c)[1:-1] for c in text)


def cut(text: str, most: int) -> str:
    """Text, cut to at most `most` characters with dots."""
    return text if len(text) <= most else f"{text[: most - 3]}..."


def six_digits(x: Any) -> str:
    """Text of a real number of any type to six significant digits: no zeros at the end, no sign on a zero."""
    from decimal import Decimal  # only this function needs it

    if hasattr(x, "context"):  # mpmath
        text = x.context.nstr(x, DIGITS, min_fixed=0, max_fixed=0, show_zero_exponent=True)
    else:
        number = x if isinstance(x, np.floating) else float(x)
        text = np.format_float_scientific(number, precision=DIGITS - 1, unique=False)
    rounded = Decimal(text).normalize()
    if not rounded:
        return "0"
    return f"{rounded:f}" if SMALLEST <= rounded.adjusted() <= LARGEST else f"{rounded:e}".replace("+", "")


def aligned(rows: Sequence[Row]) -> list[str]:
    """Rows as lines, every column's decimal points below each other."""
    texts = [list(row.cells) for row in rows]
    for k in range(max(map(len, texts))):
        column = [(cells, row.words) for cells, row in zip(texts, rows, strict=True) if k < len(cells)]
        decimals = max((len(_from_the_point(cells[k])) for cells, is_title in column if not is_title), default=0)
        for cells, is_title in column:
            cells[k] += "" if is_title else " " * (decimals - len(_from_the_point(cells[k])))
        width = max(len(cells[k]) for cells, _ in column)
        for cells, _ in column:
            cells[k] = cells[k].rjust(width)
    head = max((len(row.head) for row in rows if row.cells), default=0)
    heads = [f"{row.head:<{head}}" if row.cells else row.head for row in rows]
    return ["  ".join([first, *cells]).rstrip() for first, cells in zip(heads, texts, strict=True)]


def table(
    head: str, titles: Sequence[str], names: Iterable[str], *columns: Iterable[str], indent: str = ""
) -> list[str]:
    """Lines of a table: titles of the columns, then a line for each name, decimal points below each other."""
    rows = [Row(f"{indent}{short(name)}", cells) for name, *cells in zip(names, *columns, strict=True)]
    return aligned([Row(head, titles, words=True), *rows])


def column(values: Iterable[float], form: str, unknown: str = "nan") -> list[str]:
    """Numbers as texts of one format, such as ".4g", and a text for NaN."""
    return [format(value, form) if value == value else unknown for value in values]


def _from_the_point(text: str) -> str:
    match = re.search(r"(?<=\d)[.e].*", text)
    return match.group() if match else ""


class InNotebooks(ReadOnlyArrays):
    """Base of results: `print` shows the report of those that have one; notebooks show HTML, mostly of that text."""

    _repr_html_: ClassVar[Callable[[Any], str]]  # set by `rne/__init__.py`, above all of them
    _plotted: ClassVar[Callable[..., Any]]  # likewise, of Sensitivities

    def __str__(self) -> str:
        return str(self.report()) if hasattr(self, "report") else repr(self)


def numbered_joints(n: int) -> tuple[str, ...]:
    """Names of joints that have none."""
    return tuple(f"joint_{k + 1}" for k in range(n))
