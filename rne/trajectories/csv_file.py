"""Samples of a motion from a CSV file, columns by joint name."""

from __future__ import annotations

import csv
import io
import math
import os
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Literal, NamedTuple

import numpy as np

from ..basics.spatial import Array
from ..basics.text import MAX_NAME, cut
from .time_units import UNITS, guessed_unit

QUANTITIES = ("q", "qd", "qdd", "tau")
MAX_NAMES = 4  # columns that a message names


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


def read_csv(
    path: str | os.PathLike[str], joint_names: Sequence[str], *, time_unit: Literal["s", "ms", "us", "ns"] | None = None
) -> Samples:
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


def in_seconds(
    path: str | os.PathLike[str], samples: Samples, unit: str | None, cure: str = "", limits: Array | None = None
) -> Samples:
    """Samples with times in seconds, given in a unit, or seconds unless they look like another."""
    if unit is not None and unit not in UNITS:
        raise ValueError(f'`time_unit` must be "s", "ms", "us" or "ns", got {unit!r}')
    if unit is None and samples.q is not None:
        seems = guessed_unit(samples.t, samples.q, samples.qd, limits)
        if seems is not None:
            raise ValueError(f"{os.fspath(path)}: column 't' {seems.said}; {cure.format(seems.symbol)}")
    return samples._replace(t=samples.t / UNITS[unit or "s"])


def read_samples(
    path: str | os.PathLike[str],
    joint_names: Sequence[str],
    *,
    needed: Sequence[str] = (),
    gaps: bool = False,
    timed: bool = True,
) -> Samples:
    """The samples of a file that must have the quantities `needed`; with `gaps`, NaN for entries left out but times.

    Of points that are not `timed`, the times are their numbers, and a column for them is ignored.
    """
    if isinstance(joint_names, str) or not isinstance(joint_names, Iterable):
        given = type(joint_names).__name__
        raise TypeError(f"`joint_names` must be a sequence of str, such as robot.joint_names, got {given}")
    joint_names = tuple(joint_names)
    name = os.fspath(path)
    rows = _rows(name, _text(Path(path)))
    if not rows:
        raise ValueError(f"{name}: the file is empty")
    while rows[1:] and rows[1][1][0].lstrip().startswith("#"):
        rows.pop(0)  # a comment above the heading
    (row, heading), *body = rows
    columns = [column.strip() for column in (heading[0].strip().lstrip("#"), *heading[1:])]
    wanted = _wanted(f"{name}, row {row}", columns, joint_names, needed, timed)
    if not timed:
        columns = ["t", *("" if column == "t" else column for column in columns)]
        body = [(at, [str(k), *fields]) for k, (at, fields) in enumerate(body)]
    if not body:
        raise ValueError(f"{name}: there are no rows below the names of the columns")
    table = np.array([_numbers(name, row, fields, columns, wanted, gaps) for row, fields in body])
    place = {column: k for k, column in enumerate(wanted)}
    _check_times(name, [row for row, _ in body], table[:, 0])
    arrays = {
        quantity: table[:, [place[f"{quantity}.{joint}"] for joint in joint_names]]
        for quantity in QUANTITIES
        if joint_names and f"{quantity}.{joint_names[0]}" in place
    }
    return Samples(table[:, 0], **arrays)


def _text(path: Path) -> str:
    data = path.read_bytes()
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError:
        text = "\0"
    if "\0" in text:
        raise ValueError(f"{path}: is not a text file in UTF-8; a CSV file is needed")
    return text


def _rows(name: str, text: str) -> list[tuple[int, list[str]]]:
    """Every row that is not blank, with its number."""
    reader = csv.reader(io.StringIO(text, newline=""), strict=True)
    try:
        return [(reader.line_num, row) for row in reader if any(field.strip() for field in row)]
    except csv.Error as error:
        raise ValueError(f"{name}, row {reader.line_num}: is not CSV ({error})") from None


def _wanted(
    place: str, columns: Sequence[str], joint_names: Sequence[str], needed: Sequence[str], timed: bool
) -> list[str]:
    """The columns to read: t, and every quantity that is there for all joints."""
    if all(math.isfinite(_as_number(column)) for column in columns):
        example = ",".join([*["t"] * timed, *(f"q.{joint}" for joint in joint_names)])
        raise ValueError(
            f"{place}: the names of the columns are missing; above the numbers is needed, for example, {example!r}"
        )
    twice = [column for k, column in enumerate(columns) if column and column in columns[:k]]
    if twice:
        raise ValueError(f"{place}: column {twice[0]!r} is there twice")
    hint = "; separate columns by commas" if len(columns) == 1 and len(joint_names) + timed > 1 else ""
    if timed and "t" not in columns:
        raise MissingColumn(f"{place}: there is no column 't'; there are {_listed(columns)}{hint}")
    wanted = ["t"]
    for quantity in QUANTITIES:
        own = [f"{quantity}.{joint}" for joint in joint_names]
        missing = [column for column in own if column not in columns]
        if missing and quantity in needed:
            alike = [column for column in columns if column.startswith(f"{quantity}.")]
            raise MissingColumn(
                f"{place}: there is no column {_listed(missing)}, which is needed; there are "
                f"{_listed(alike or columns)}{hint}"
            )
        if missing and len(missing) < len(own):
            raise MissingColumn(
                f"{place}: no column {_listed(missing)}; the {quantity} of all joints or of none are needed"
            )
        wanted += own if not missing else []
    return wanted


def _numbers(
    name: str, row: int, fields: Sequence[str], columns: Sequence[str], wanted: Sequence[str], gaps: bool
) -> list[float]:
    if len(fields) != len(columns):
        raise ValueError(f"{name}, row {row}: must have {len(columns)} entries as the heading has, got {len(fields)}")
    entry = dict(zip(columns, fields, strict=True))
    numbers = [_as_number(entry[column]) for column in wanted]
    for column, number in zip(wanted, numbers, strict=True):
        left_out = gaps and column != "t" and entry[column].strip().lower() in ("", "nan")
        if not (math.isfinite(number) or left_out):
            got = repr(cut(entry[column], MAX_NAME))
            raise ValueError(f"{name}, row {row}, column {column!r}: must be a finite number, got {got}")
    return numbers


def _as_number(text: str) -> float:
    """The number that a text is, NaN if it is none."""
    try:
        return float(text) if text.isascii() and "_" not in text else math.nan
    except ValueError:
        return math.nan


def _check_times(name: str, rows: Sequence[int], t: Array) -> None:
    late = np.flatnonzero(np.diff(t) <= 0)
    if len(late):
        k = int(late[0])
        raise ValueError(
            f"{name}, row {rows[k + 1]}, column 't': times must ascend, got {t[k + 1]:.10g} after {t[k]:.10g}"
        )


def _listed(names: Sequence[str]) -> str:
    shown = ", ".join(repr(cut(name, MAX_NAME)) for name in names[:MAX_NAMES])
    return shown if len(names) <= MAX_NAMES else f"{shown} and {len(names) - MAX_NAMES} more"
