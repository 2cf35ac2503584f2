"""Tables in text: their rows, and the numbers in them."""

from __future__ import annotations

import csv
import io
import math
import re
from codecs import BOM_UTF16_BE, BOM_UTF16_LE
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path
from statistics import mode
from typing import Any, NamedTuple

import numpy as np

from ..basics.archive import bytes_of
from ..basics.spatial import Array
from ..basics.text import MAX_NAME, cut

MAX_NAMES = 4  # columns named in a message
SNIFFED, MIDDLE = 20, 2**16  # rows by which the format is found, and characters from the middle on that have them
FORMATS = [(";", "."), (";", ","), ("\t", "."), ("\t", ","), (",", "."), (" ", "."), (" ", ",")]
HEAD = 2**16  # characters, in which a table of numbers alone begins
FOLLOWS = {".": "0e,\n", "e": "0-", "-": "0.", ",": "0.-", "\n": "0.-", "0": "0.e,\n"}  # 0 any digit, - any sign
KIND = bytes(1 + ".e-,\n0".find({"+": "-"}.get(x, "0" if x in "0123456789" else x)) for x in map(chr, range(256)))
FOLLOWING = bytes(KIND[ord(a)] << 4 | KIND[ord(b)] for a, after in FOLLOWS.items() for b in after)


class TableBody(NamedTuple):
    """Rows below the names of columns: their numbers in the file, and an array of finite numbers, or texts."""

    places: Sequence[int]
    numbers: Array | None = None
    texts: Sequence[Sequence[str]] = ()

    @property
    def width(self) -> int:
        """Number of entries that most rows have."""
        return mode(map(len, self.texts or [()])) if self.numbers is None else int(self.numbers.shape[1])

    def columns(self, name: str, width: int, of: str = "", cure: str = "") -> list[Any]:
        """Columns of numbers or of texts; an error if a row has not so many entries."""
        for at, row in zip(self.places, self.texts if self.numbers is None else self.numbers[:1], strict=False):
            if len(row) != width:
                raise ValueError(f"{name}, row {at}: must have {width} entries{of}, got {len(row)}{cure}")
        return [*zip(*self.texts, strict=True)] or [()] * width if self.numbers is None else [*self.numbers.T]


def text_of(path: Path) -> str:
    """Text of a file in UTF-8, or in UTF-16 that begins with its mark, as Windows writes it."""
    data = bytes_of(path)
    try:
        text = data.decode("utf-16" if data[:2] in (BOM_UTF16_LE, BOM_UTF16_BE) else "utf-8-sig")
    except UnicodeDecodeError:
        text = "\0"
    if "\0" in text:
        raise ValueError(f"{path}: is not a text file in UTF-8; a CSV file is needed")
    return text


def formatted(text: str, separator: str | None = None, decimal: str | None = None) -> tuple[str, str, str]:
    """Text, with single blanks if they separate, and the separator and decimal sign that make most entries numbers."""
    lines = [line for line in text[:HEAD].splitlines() if line.strip()]
    pairs = ((x, below) for x, below in pairwise(lines) if not below.lstrip().startswith("#"))
    heading, first = next(pairs, ("", ""))
    names = [x.strip(' "') for x in heading.lstrip(" #").split(",")]
    # Commas separate if one of the names between them is `t`, whatever is in other columns.
    if separator is None and "t" in names and first.count(",") >= len(names) - 1:
        separator = ","
    lines = [line for line in text[len(text) // 2 * (len(text) > MIDDLE) :][:MIDDLE].splitlines() if line.strip()]
    lines = [re.sub(r'\[.*?\]|"', "", line) for line in lines[len(lines) // 2 :][:SNIFFED]]

    def numbers(form: tuple[str, str]) -> int:
        fields = [x for line in lines for x in (line.split() if form[0] == " " else line.split(form[0]))]
        return sum(math.isfinite(as_number(x, form[1])) for x in fields)

    possible = [f for f in FORMATS if separator in (None, f[0]) and decimal in (None, f[1])]
    separator, decimal = max(possible or [(separator or ",", decimal or ".")], key=numbers)
    if separator == " ":
        text = "\n".join(" ".join(line.split()) for line in text.splitlines())
    return text, separator, decimal


def csv_rows(name: str, text: str, separator: str = ",") -> list[tuple[int, list[str]]]:
    """Rows that are not blank, with their numbers."""
    reader = csv.reader(io.StringIO(text, newline=""), strict=True, delimiter=separator)
    try:
        return [(reader.line_num, row) for row in reader if any(field.strip() for field in row)]
    except csv.Error as error:
        raise ValueError(f"{name}, row {reader.line_num}: is not CSV ({error})") from None


def below_comments(rows: list[tuple[int, list[str]]]) -> list[tuple[int, list[str]]]:
    """Rows from the last comment on, which is the heading, or all."""
    while rows[1:] and rows[1][1][0].lstrip().startswith("#"):
        rows = rows[1:]
    return rows


def numeric_block(text: str, separator: str = ",", decimal: str = ".") -> tuple[str, TableBody] | None:
    """Text above a table of finite decimal numbers, and this table; None if there is anything else in it.

    SciPy's reader of Matrix Market files takes a quarter of the time of `numpy.loadtxt`, and stops at the end of each
    number without looking at the rest of the entry. Hence the entries are checked before, by what may follow what.
    """
    from scipy.io import mmread

    start, entries = 0, list[str]()
    for line in text[:HEAD].splitlines(keepends=True):
        entries = line.split(separator)
        found = sum(math.isfinite(as_number(x, decimal)) for x in entries)
        if found == len(entries):
            break
        filled = sum(bool(x.strip()) for x in entries)
        if 2 * found >= filled > 0:  # a row with something else in it, or with entries left out
            return None
        start += len(line)
    else:
        return None
    data = text[start:].rstrip().encode() + b"\n"
    changes = [("\r\n", "\n"), (f"{separator} ", separator), ("E", "e")]
    changes += [(".", "?"), (decimal, ".")] if decimal != "." else []
    changes += [(",", "?"), (separator, ",")] if separator != "," else []
    for old, new in changes:
        if all(x.encode() in data for x in old):  # a pair of characters is looked for ten times as long as each
            data = data.replace(old.encode(), new.encode())
    marks, count = data.translate(None, b"0123456789+-"), data.count(b"\n")
    kinds = np.frombuffer(data.translate(KIND), np.uint8)
    odd = (kinds[:-1] << 4 | kinds[1:]).tobytes().translate(None, FOLLOWING)
    if odd or marks.translate(None, b".e") != (b"," * (len(entries) - 1) + b"\n") * count:
        return None
    if any(x in marks for x in (b"..", b"e.", b"ee")):
        return None
    head = f"%%MatrixMarket matrix array real general\n{count * len(entries)} 1\n".encode()
    try:
        numbers = mmread(io.BytesIO(head + data.replace(b",", b"\n"))).reshape(count, len(entries))
    except (ValueError, OverflowError):
        return None
    first = text.count("\n", 0, start) + 1
    return (text[:start], TableBody(range(first, first + count), numbers)) if np.isfinite(numbers).all() else None


def finite_numbers(
    place: str, column: str, rows: Sequence[int], texts: Sequence[str], decimal: str = ".", gaps: bool = True
) -> Array:
    """Numbers of a column; with `gaps`, NaN for empty entries."""
    numbers = np.array([as_number(text, decimal) for text in texts])
    for k in np.flatnonzero(~np.isfinite(numbers)).tolist():
        if not gaps or texts[k].strip().lower() not in ("", "nan"):
            got = repr(cut(texts[k], MAX_NAME))
            raise ValueError(f"{place}, row {rows[k]}, column {column!r}: must be a finite number, got {got}")
    return numbers


def as_number(text: str, decimal: str = ".") -> float:
    """Number of a text, NaN if it is none."""
    if decimal != ".":
        text = text.replace(".", "?").replace(decimal, ".")
    try:
        return float(text) if text.isascii() and "_" not in text else math.nan
    except ValueError:
        return math.nan


def listed_names(names: Sequence[str], most: int = MAX_NAMES) -> str:
    """First names in quotes, and the number of others."""
    shown = ", ".join(repr(cut(name, MAX_NAME)) for name in names[:most])
    return shown if len(names) <= most else f"{shown} and {len(names) - most} more"
