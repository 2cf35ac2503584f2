"""Tables in text: their rows, the numbers in them, and the samples of a motion by names of joints."""

from __future__ import annotations

import csv
import io
import math
import os
import re
from codecs import BOM_UTF16_BE, BOM_UTF16_LE
from collections.abc import Iterable, Sequence
from itertools import pairwise
from pathlib import Path
from statistics import mode
from typing import Any, NamedTuple

import numpy as np

from ..basics.archive import bytes_of
from ..basics.spatial import Array
from ..basics.text import MAX_NAME, cut, plain
from .time_units import UNITS, TimeSymbol, guessed_unit

File = str | os.PathLike[str]
QUANTITIES = ("q", "qd", "qdd", "tau")
MAX_NAMES = 4  # columns that a message names
SNIFFED, MIDDLE = 20, 2**16  # rows by which the format is found, and characters from the middle on that have them
FORMATS = [(";", "."), (";", ","), ("\t", "."), ("\t", ","), (",", "."), (" ", "."), (" ", ",")]
HEAD = 2**16  # characters, in which a table of numbers alone begins
FOLLOWS = {".": "0e,\n", "e": "0-", "-": "0.", ",": "0.-", "\n": "0.-", "0": "0.e,\n"}  # 0 any digit, - any sign
KIND = bytes(1 + ".e-,\n0".find({"+": "-"}.get(x, "0" if x in "0123456789" else x)) for x in map(chr, range(256)))
FOLLOWING = bytes(KIND[ord(a)] << 4 | KIND[ord(b)] for a, after in FOLLOWS.items() for b in after)


class Samples(NamedTuple):
    """Samples of a motion; what a file does not give is None.

    Attributes
    ----------
    t : ndarray, shape (K,)
        Times, ascending [s].
    q, qd, qdd, tau : ndarray, shape (K, n), or None
        Joint positions, velocities, accelerations and torques [rad or m; rad/s or m/s; rad/s^2 or m/s^2; N m or N].

    Examples
    --------
    >>> import numpy as np, rne
    >>> samples = rne.trajectories.Samples(np.array([0.0, 1.0]), q=np.zeros((2, 6)))
    >>> samples.q.shape, samples.tau is None
    ((2, 6), True)
    """

    t: Array
    q: Array | None = None
    qd: Array | None = None
    qdd: Array | None = None
    tau: Array | None = None


class TableBody(NamedTuple):
    """Rows below the names of columns: their numbers in the file, and an array of finite numbers, or texts."""

    places: Sequence[int]
    numbers: Array | None = None
    texts: Sequence[Sequence[str]] = ()

    @property
    def width(self) -> int:
        """Return the number of entries that most rows have."""
        return mode(map(len, self.texts)) if self.numbers is None else int(self.numbers.shape[1])

    def columns(self, name: str, width: int, of: str = "", cure: str = "") -> list[Any]:
        """Columns of numbers or of texts; an error if a row has not so many entries."""
        for at, row in zip(self.places, self.texts if self.numbers is None else self.numbers[:1], strict=False):
            if len(row) != width:
                raise ValueError(f"{name}, row {at}: must have {width} entries{of}, got {len(row)}{cure}")
        return [*zip(*self.texts, strict=True)] if self.numbers is None else [*self.numbers.T]


class MissingColumn(ValueError):
    """A file without a column that is needed."""


def read_csv(path: File, joint_names: Sequence[str], *, time_unit: TimeSymbol | None = None) -> Samples:
    """Read the samples of a motion from a CSV file.

    Parameters
    ----------
    path : path-like
        A text file in UTF-8. Its first row, the heading, names the columns: `t` [s] and, for each joint, `q.<joint>`,
        `qd.<joint>`, `qdd.<joint>` or `tau.<joint>` [rad or m, per s and s^2; N m or N], in any order. Other columns
        are ignored. The heading may begin with "#", below other such rows, as `numpy.savetxt` writes it.
    joint_names : sequence of str
        The joints in the order of the arrays, such as `robot.joint_names`.
    time_unit : {"s", "ms", "us", "ns"}, optional
        Unit of the column `t`. If it is not given, seconds, and times that are hardly in seconds are refused.

    Returns
    -------
    Samples
        The arrays t, q, qd, qdd, tau; a quantity without any column is None.

    Raises
    ------
    TypeError
        If `joint_names` is no sequence of str.
    ValueError
        If the file is empty or no text; the heading or a column is missing, or there for some joints only, or twice;
        an entry is not a finite decimal number; or the times do not ascend. Names the file, the row (counted from 1)
        and the column. If the times look like milliseconds, microseconds or nanoseconds: they are later than the year
        5138, `qd` is that of another unit, or in steps of 0.1 s and more no joint that moves is faster than 0.01 rad/s
        or m/s, which would be up to 10 in such a unit.
    OSError
        If the file cannot be read.

    Examples
    --------
    >>> import pathlib, tempfile
    >>> import rne
    >>> file = pathlib.Path(tempfile.mkdtemp()) / "motion.csv"
    >>> _ = file.write_text("t,q.lift,q.turn\\n0,0.1,1\\n0.5,0.2,1.5\\n")
    >>> samples = rne.trajectories.read_csv(file, ["turn", "lift"])
    >>> samples.q.tolist(), samples.qd
    ([[1.0, 0.1], [1.5, 0.2]], None)
    """
    samples = read_samples(path, joint_names)
    return in_seconds(path, samples, time_unit, 'give time_unit="{}", or "s" if they are seconds')


def in_seconds(path: File, samples: Samples, unit: str | None, cure: str = "", limits: Array | None = None) -> Samples:
    """Samples with times in seconds, given in a unit, or seconds unless they look like another."""
    if unit is not None and unit not in UNITS:
        raise ValueError(f'`time_unit` must be "s", "ms", "us" or "ns", got {unit!r}')
    if unit is None and samples.q is not None:
        seems = guessed_unit(samples.t, samples.q, samples.qd, limits)
        if seems is not None:
            raise ValueError(f"{os.fspath(path)}: column 't' {seems.said}; {cure.format(seems.symbol)}")
    return samples._replace(t=samples.t / UNITS[unit or "s"])


def read_samples(
    path: File, joint_names: Sequence[str], *, needed: Sequence[str] = (), is_log: bool = False, timed: bool = True
) -> Samples:
    """The samples of a file that must have the quantities `needed`; of a log in any format, NaN for entries left out.

    Points that are not `timed` have their numbers for times, and a column of times is ignored.
    """
    if isinstance(joint_names, str) or not isinstance(joint_names, Iterable):
        given = type(joint_names).__name__
        raise TypeError(f"`joint_names` must be a sequence of str, such as robot.joint_names, got {given}")
    joint_names = tuple(plain(str(joint)) for joint in joint_names)  # as robots from files have them
    name = os.fspath(path)
    text = text_of(Path(path))
    lines = [line for line in text[:HEAD].splitlines() if line.strip()] if is_log else []
    names = next((x for x, below in pairwise(lines) if not below.lstrip().startswith("#")), "").lstrip(" #").split(",")
    has_commas = "t" in [x.strip(' "') for x in names]  # whatever texts in other columns have between their numbers
    text, separator, decimal = formatted(text, "," if has_commas else None) if is_log else (text, ",", ".")
    (row, heading), body = _below_heading(name, text, separator, decimal)
    columns = [plain(column.strip()) for column in (heading[0].strip().lstrip("#"), *heading[1:])]
    wanted = _wanted(f"{name}, row {row}", columns, joint_names, needed, timed)
    if not body.places:
        raise ValueError(f"{name}: there are no rows below the names of the columns")
    there = dict(zip(columns, body.columns(name, len(columns), " as the heading has"), strict=True))
    read = {x: there[x] for x in wanted if x in there}
    if body.numbers is None:
        read = {x: finite_numbers(name, x, body.places, y, decimal, is_log and x != "t") for x, y in read.items()}
    t = read["t"] if timed else np.arange(float(len(body.places)))
    for k in np.flatnonzero(np.diff(t) <= 0).tolist():
        late = f"got {t[k + 1]:.10g} after {t[k]:.10g}"
        raise ValueError(f"{name}, row {body.places[k + 1]}, column 't': times must ascend, {late}")
    kinds = [x for x in QUANTITIES if joint_names and f"{x}.{joint_names[0]}" in read]
    return Samples(t, **{x: np.column_stack([read[f"{x}.{joint}"] for joint in joint_names]) for x in kinds})


def _below_heading(name: str, text: str, separator: str, decimal: str) -> tuple[tuple[int, list[str]], TableBody]:
    """The row with the names of columns, which comments may stand between, and the rows below it."""
    above, body = numeric_block(text, separator, decimal) or (text, None)
    rows = _below_comments(csv_rows(name, above, separator))
    if body is not None and len(rows) != 1:
        rows, body = _below_comments(csv_rows(name, text, separator)), None
    if not rows:
        raise ValueError(f"{name}: the file is empty")
    return rows[0], body or TableBody([at for at, _ in rows[1:]], texts=[fields for _, fields in rows[1:]])


def _below_comments(rows: list[tuple[int, list[str]]]) -> list[tuple[int, list[str]]]:
    """Rows from the last comment on, which is the heading, or all."""
    while rows[1:] and rows[1][1][0].lstrip().startswith("#"):
        rows.pop(0)
    return rows


def text_of(path: Path) -> str:
    """The text of a file in UTF-8, or in UTF-16 that begins with its mark, as Windows writes it."""
    data = bytes_of(path)
    try:
        text = data.decode("utf-16" if data[:2] in (BOM_UTF16_LE, BOM_UTF16_BE) else "utf-8-sig")
    except UnicodeDecodeError:
        text = "\0"
    if "\0" in text:
        raise ValueError(f"{path}: is not a text file in UTF-8; a CSV file is needed")
    return text


def formatted(text: str, separator: str | None = None, decimal: str | None = None) -> tuple[str, str, str]:
    """A text, its separator and decimal sign, by which most entries are numbers; blanks that separate become one."""
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
    """Every row that is not blank, with its number."""
    reader = csv.reader(io.StringIO(text, newline=""), strict=True, delimiter=separator)
    try:
        return [(reader.line_num, row) for row in reader if any(field.strip() for field in row)]
    except csv.Error as error:
        raise ValueError(f"{name}, row {reader.line_num}: is not CSV ({error})") from None


def numeric_block(text: str, separator: str = ",", decimal: str = ".") -> tuple[str, TableBody] | None:
    """The text above a table of finite decimal numbers, and this table; None if there is anything else in it.

    SciPy's reader of Matrix Market files takes a quarter of the time of `numpy.loadtxt`, and stops at the end of each
    number without looking at what is left of the entry. Hence the entries are checked before, by what may follow what.
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


def _wanted(
    place: str, columns: Sequence[str], joint_names: Sequence[str], needed: Sequence[str], timed: bool
) -> list[str]:
    """The columns to read: t, and every quantity that is there for all joints."""
    if all(math.isfinite(as_number(column)) for column in columns):
        example = ",".join([*["t"] * timed, *(f"q.{joint}" for joint in joint_names)])
        above = f"above the numbers is needed, for example, {example!r}"
        raise ValueError(f"{place}: the names of the columns are missing; {above}")
    hint = "; separate columns by commas" if len(columns) == 1 and len(joint_names) + timed > 1 else ""
    if hint and timed:
        hint += ", or read the file by rne.identification.Record.from_log"
    if timed and "t" not in columns:
        raise MissingColumn(f"{place}: there is no column 't'; there are {listed_names(columns)}{hint}")
    wanted = ["t"] * timed
    for quantity in QUANTITIES:
        own = [f"{quantity}.{joint}" for joint in joint_names]
        missing = [column for column in own if column not in columns]
        if missing and quantity in needed:
            there = listed_names([column for column in columns if column.startswith(f"{quantity}.")] or columns)
            what = f"there is no column {listed_names(missing)}, which is needed; there are {there}{hint}"
            raise MissingColumn(f"{place}: {what}")
        if missing and len(missing) < len(own):
            what = f"no column {listed_names(missing)}; the {quantity} of all joints or of none are needed"
            raise MissingColumn(f"{place}: {what}")
        wanted += own if not missing else []
    if twice := [column for column in wanted if columns.count(column) > 1]:
        raise ValueError(f"{place}: column {twice[0]!r} is there twice")
    return wanted


def finite_numbers(
    place: str, column: str, rows: Sequence[int], texts: Sequence[str], decimal: str = ".", gaps: bool = True
) -> Array:
    """The numbers of a column; with `gaps`, NaN for entries left out."""
    numbers = np.array([as_number(text, decimal) for text in texts])
    for k in np.flatnonzero(~np.isfinite(numbers)).tolist():
        if not gaps or texts[k].strip().lower() not in ("", "nan"):
            got = repr(cut(texts[k], MAX_NAME))
            raise ValueError(f"{place}, row {rows[k]}, column {column!r}: must be a finite number, got {got}")
    return numbers


def as_number(text: str, decimal: str = ".") -> float:
    """The number that a text is, NaN if it is none."""
    if decimal != ".":
        text = text.replace(".", "?").replace(decimal, ".")
    try:
        return float(text) if text.isascii() and "_" not in text else math.nan
    except ValueError:
        return math.nan


def listed_names(names: Sequence[str], most: int = MAX_NAMES) -> str:
    """The first names in quotes, and how many more there are."""
    shown = ", ".join(repr(cut(name, MAX_NAME)) for name in names[:most])
    return shown if len(names) <= most else f"{shown} and {len(names) - most} more"
