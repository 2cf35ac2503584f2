"""Samples of a motion in a table, by columns `t` and `q.<joint>`, `qd.<joint>` and so on; of logs also commands."""

from __future__ import annotations

import math
import os
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from ..basics.archive import File
from ..basics.spatial import Array
from ..basics.text import plain
from .tables import as_number, listed_names, text_of
from .time_units import UNITS, TimeSymbol, guessed_unit

if TYPE_CHECKING:
    from .logs import Log, LogOptions

QUANTITIES = ("q", "qd", "qdd", "tau")
COMMANDS = ("command", "command_rate")


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
    """Raised for a file without a column that is needed."""


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
        all columns of q, qd, qdd and tau are those of other joints;
        an entry is not a finite decimal number; or the times do not ascend. The message contains the file, the row
        (counted from 1) and the column. If the times look like milliseconds, microseconds or nanoseconds: they are
        later than the year 5138, `qd` has another unit, or in steps of 0.1 s and more no joint that moves is faster
        than 0.01 rad/s or m/s, which would be up to 10 in such a unit.
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


def read_samples(path: File, joint_names: Sequence[str], *, needed: Sequence[str] = (), timed: bool = True) -> Samples:
    """Samples of a CSV file that must have the quantities `needed`; times that are not `timed` are row numbers."""
    from .logs import LogOptions, read_table

    log = read_table(os.fspath(path), text_of(Path(path)), LogOptions(separator=",", decimal=".", exact=True))
    return Samples(**_arrays_of(log, joint_names, needed, timed=timed))


def logged(log: Log, options: LogOptions) -> dict[str, Any]:
    """Samples of a log in columns with exact names, NaN for empty entries; commands if there are no torques."""
    there = {x.partition(".")[0] for x in log.columns}
    needed = ("q", "command" if "command" in there and "tau" not in there else "tau")
    x = _arrays_of(log, options.joints, needed, gaps=True)
    x["t"] = in_seconds(log.place, Samples(x["t"]), options.time_unit).t
    return {kind: x[kind] for kind in ("t", "q", "tau", "qd", *COMMANDS) if kind in x}


def _arrays_of(
    log: Log, joint_names: Any, needed: Sequence[str], *, gaps: bool = False, timed: bool = True
) -> dict[str, Array]:
    """Arrays in columns that are named exactly, with `gaps` of a log: NaN for entries left out, and commands."""
    if isinstance(joint_names, str) or not isinstance(joint_names, Iterable):
        given = type(joint_names).__name__
        raise TypeError(f"`joint_names` must be a sequence of str, such as robot.joint_names, got {given}")
    joint_names = tuple(plain(str(joint)) for joint in joint_names)  # as robots from files have them
    commands = [x for x in COMMANDS if gaps and (x in needed or all(f"{x}.{j}" in log.columns for j in joint_names))]
    kinds = (*QUANTITIES, *commands)
    wanted = _wanted(log, joint_names, needed, kinds, timed)
    if not log.rows:
        raise log.error("there are no rows below the names of the columns")
    read = {x: log.decimals(x, gaps and x != "t") for x in wanted}
    t = read["t"] if timed else np.arange(float(len(log.rows)))
    for k in np.flatnonzero(np.diff(t) <= 0).tolist():
        late = f"got {t[k + 1]:.10g} after {t[k]:.10g}"
        raise ValueError(f"{log.place}, row {log.rows[k + 1]}, column 't': times must ascend, {late}")
    own = {x: [read[f"{x}.{joint}"] for joint in joint_names if f"{x}.{joint}" in read] for x in kinds}
    return {"t": t} | {x: np.column_stack(columns) for x, columns in own.items() if columns}


def _wanted(
    log: Log, joint_names: Sequence[str], needed: Sequence[str], quantities: Sequence[str], timed: bool
) -> list[str]:
    """Names of the columns to read: t if there are times, and every quantity that is present for all joints."""
    place, columns = f"{log.place}, row {log.heading}", [*log.columns, *log.twice]
    if all(math.isfinite(as_number(column)) for column in columns):
        example = ",".join([*["t"] * timed, *(f"q.{joint}" for joint in joint_names)])
        above = f"above the numbers is needed, for example, {example!r}"
        raise ValueError(f"{place}: the names of the columns are missing; {above}")
    hint = "; separate columns by commas" if len(columns) == 1 and len(joint_names) + timed > 1 else ""
    if hint and timed:
        hint += "; rne.identification.Record.from_log reads others too, of logs that have torques or commands"
    if timed and "t" not in columns:
        raise MissingColumn(f"{place}: there is no column 't'; there are {listed_names(columns)}{hint}")
    wanted = ["t"] * timed
    for quantity in quantities:
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
    others = [column for column in columns if column.partition(".")[0] in quantities and "." in column]
    if joint_names and others and len(wanted) == timed:
        example = f"{others[0].partition('.')[0]}.{joint_names[0]}"
        there = f"there are {listed_names(others)}"
        raise MissingColumn(f"{place}: {there}, but no column of a joint here, such as {example!r}")
    if twice := [column for column in wanted if columns.count(column) > 1]:
        raise ValueError(f"{place}: column {twice[0]!r} is there twice")
    return wanted
