"""Samples of a motion from a CSV file, columns by joint name; units of times, for all readers of logs."""

from __future__ import annotations

import csv
import io
import math
import os
from codecs import BOM_UTF16_BE, BOM_UTF16_LE
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Literal, NamedTuple

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from ..basics.archive import bytes_of
from ..basics.spatial import Array
from ..basics.text import MAX_NAME, cut, plain

File = str | os.PathLike[str]
TimeSymbol = Literal["s", "ms", "us", "ns"]
QUANTITIES = ("q", "qd", "qdd", "tau")
MAX_NAMES = 4  # columns that a message names
UNITS = {"s": 1.0, "ms": 1e3, "us": 1e6, "ns": 1e9}  # of each in a second
NAMES = {"ms": "milliseconds", "us": "microseconds", "ns": "nanoseconds"}
NO_SECONDS = 1e11  # [s], the year 5138: later times are in another unit
SINCE_1970 = 1.2e9, 5e9  # [s], the years 2008 to 2128
LONG, ENDLESS = 0.1, 1e3  # [s], steps below which they are hardly in milliseconds, and above which hardly in seconds
STEPS = 2e-5, 10.0  # [s], between which the steps of logs are
TRAVEL = 1e-3  # rad or m, less than which is no motion but in such steps
SLOW, FAST = 2e-3, 2.0  # speeds as parts of the joints' limits, below and above which no motion is expected
CREEPING = 1e-3  # such a part, slower than which a date in a unit is doubted
SPEED = 5.0  # rad/s or m/s, instead of a limit that is not known
AGREE, FACTOR = 0.8, 3.0  # correlation of measured velocities with differences of positions, and error of their ratio
SPIKED = 10  # samples from which single jumps and spikes do not count as motion, and ratios of velocities are told


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
    path: File, joint_names: Sequence[str], *, needed: Sequence[str] = (), gaps: bool = False, timed: bool = True
) -> Samples:
    """The samples of a file that must have the quantities `needed`; with `gaps`, NaN for entries left out but times.

    Points that are not `timed` have their numbers for times, and a column of times is ignored.
    """
    if isinstance(joint_names, str) or not isinstance(joint_names, Iterable):
        given = type(joint_names).__name__
        raise TypeError(f"`joint_names` must be a sequence of str, such as robot.joint_names, got {given}")
    joint_names = tuple(plain(str(joint)) for joint in joint_names)  # as robots from files have them
    name = os.fspath(path)
    rows = csv_rows(name, text_of(Path(path)))
    if not rows:
        raise ValueError(f"{name}: the file is empty")
    while rows[1:] and rows[1][1][0].lstrip().startswith("#"):
        rows.pop(0)  # a comment above the heading
    (row, heading), *body = rows
    columns = [plain(column.strip()) for column in (heading[0].strip().lstrip("#"), *heading[1:])]
    wanted = _wanted(f"{name}, row {row}", columns, joint_names, needed, timed)
    if not timed:
        columns = ["t", *("" if column == "t" else column for column in columns)]
        body = [(at, [str(k), *fields]) for k, (at, fields) in enumerate(body)]
    if not body:
        raise ValueError(f"{name}: there are no rows below the names of the columns")
    if wrong := [(at, len(fields)) for at, fields in body if len(fields) != len(columns)]:
        counts = f"must have {len(columns)} entries as the heading has, got {wrong[0][1]}"
        raise ValueError(f"{name}, row {wrong[0][0]}: {counts}")
    places, entries = zip(*body, strict=True)
    texts = dict(zip(columns, zip(*entries, strict=True), strict=True))
    read = {x: finite_numbers(name, x, places, texts[x], gaps=gaps and x != "t") for x in wanted}
    t = read["t"]
    for k in np.flatnonzero(np.diff(t) <= 0).tolist():
        late = f"got {t[k + 1]:.10g} after {t[k]:.10g}"
        raise ValueError(f"{name}, row {places[k + 1]}, column 't': times must ascend, {late}")
    there = [x for x in QUANTITIES if joint_names and f"{x}.{joint_names[0]}" in read]
    arrays = {x: np.column_stack([read[f"{x}.{joint}"] for joint in joint_names]) for x in there}
    return Samples(t, **arrays)


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


def csv_rows(name: str, text: str, separator: str = ",") -> list[tuple[int, list[str]]]:
    """Every row that is not blank, with its number; of blanks as separators, any number is one."""
    if separator == " ":
        text = "\n".join(" ".join(line.split()) for line in text.splitlines())
    reader = csv.reader(io.StringIO(text, newline=""), strict=True, delimiter=separator)
    try:
        return [(reader.line_num, row) for row in reader if any(field.strip() for field in row)]
    except csv.Error as error:
        raise ValueError(f"{name}, row {reader.line_num}: is not CSV ({error})") from None


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
    wanted = ["t"]
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


class TimeUnit(NamedTuple):
    """A unit that times seem to have: its symbol, and why they are not taken as seconds."""

    symbol: str
    reason: str

    @property
    def divisor(self) -> str:
        """Divisor of times in this unit, as text."""
        return f"{UNITS[self.symbol]:g}".replace("e+0", "e")

    @property
    def said(self) -> str:
        """The unit and what to divide by, in words."""
        return f"looks like {NAMES[self.symbol]}, not seconds: {self.reason}"


def guessed_unit(t: Array, q: Array, qd: Array | None = None, limits: Array | None = None) -> TimeUnit | None:
    """The unit of times (K,) that are hardly in seconds; None where seconds are plausible.

    They are not where measured velocities are those of another unit; where times are later than any date; and where
    steps are long and no joint reaches a five-hundredth of its velocity limit, although a joint moves. Named is the
    unit that gives steps of 20 us to 10 s and the largest speeds below twice the limits, at rest that of a date.
    """
    if len(t) < 2:
        return None
    h, size = float(np.median(np.diff(t))), float(np.abs(t).max())
    share, speed = _speeds(t, q, limits)
    ratio = 0.0 if qd is None else velocity_ratio(t, q, qd)
    for symbol in NAMES:
        if 1 / FACTOR < ratio / UNITS[symbol] < FACTOR:
            return TimeUnit(symbol, f"qd is {ratio:.3g} times the differences of q over those of t")
    possible = [s for s in NAMES if STEPS[0] <= h / UNITS[s] <= STEPS[1] and size / UNITS[s] < NO_SECONDS]
    plausible = [symbol for symbol in possible if share * UNITS[symbol] <= FAST]
    if size >= NO_SECONDS:
        dates = [s for s in possible if SINCE_1970[0] < size / UNITS[s] < SINCE_1970[1]]
        dates = [s for s in dates if not share or CREEPING < share * UNITS[s] <= FAST]
        found = (dates or plausible[::-1] or possible or list(NAMES)[-1:])[0]
        return TimeUnit(found, f"up to {size:.4g}, in steps of {h:.4g}")
    if h < LONG or not 0 < share < SLOW or not plausible or 1 / FACTOR < ratio < FACTOR:
        return None
    return TimeUnit(plausible[-1], f"its steps are {h:.4g}, and no joint would be faster than {speed:.2g} rad/s or m/s")


def _speeds(t: Array, q: Array, limits: Array | None) -> tuple[float, float]:
    """The largest speed as a part of its limit, and the largest of all; zero where no joint moves."""
    known = np.full(q.shape[1], SPEED) if limits is None else np.where((limits > 0) & (limits < np.inf), limits, SPEED)
    steps = np.diff(t)
    speed = np.abs(np.diff(q, axis=0)[steps > 0] / steps[steps > 0, None])
    if len(speed) >= SPIKED:
        speed = np.median(sliding_window_view(speed, 5, axis=0), axis=-1)
    moves = np.ptp(q, axis=0) > (TRAVEL if np.median(steps) < ENDLESS else 0)
    return float((speed / known)[:, moves].max(initial=0.0)), float(speed[:, moves].max(initial=0.0))


def velocity_ratio(t: Array, q: Array, qd: Array) -> float:
    """Velocities over the differences of positions, zero where they have little in common."""
    moved, area = np.diff(q, axis=0), np.diff(t)[:, None] * (qd[1:] + qd[:-1]) / 2
    common, a, b = float((moved * area).sum()), float((moved**2).sum()), float((area**2).sum())
    return common / a if abs(common) > AGREE * np.sqrt(a * b) > 0 else 0.0
