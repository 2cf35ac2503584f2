"""Measurements during and after screening, and the findings on them."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field, fields
from typing import Literal

import numpy as np

from ...basics.arrays import ReadOnlyArrays
from ...basics.spatial import Array
from ...basics.text import counted, summary

Severity = Literal["error", "warning"]
NAMED = 3  # number of samples named in a text
NO_COMMANDS = "the record has torques and no commands: rne.identify fits a model from these"
NO_TORQUES = "the record has commands and no torques: fit it by rne.identify_motion (rne identify --without-torques)"


def seconds(t: float) -> str:
    """Seconds since a record's first stamp, to a millisecond."""
    return f"{round(float(t), 3):.12g}"


@dataclass(frozen=True)
class RecordFinding:
    """Error or warning about measurements.

    Attributes
    ----------
    severity : {"error", "warning"}
        A record with errors is not prepared for a fit; of warnings, the cure says what is done.
    record : str
        The record's name.
    joint : str
        The joint; empty if all are concerned.
    kind : str
        Kind of the fault, such as "position spike" or "gap".
    text : str
        Where, and by how much.
    cure : str
        Its treatment, or advice.
    samples : tuple of int
        The samples concerned, as indices of the record's arrays.

    Examples
    --------
    >>> import rne
    >>> finding = rne.identification.RecordFinding("warning", "run 1", "", "gap", "after sample 7", "cut here", (7,))
    >>> print(finding)
    warning: run 1: gap after sample 7; cut here
    """

    severity: Severity
    record: str
    joint: str
    kind: str
    text: str
    cure: str
    samples: tuple[int, ...] = ()

    __repr__ = summary

    def __str__(self) -> str:
        return f"{self.severity}: {self.message}"

    @property
    def message(self) -> str:
        """Text of a finding without the severity."""
        joint = f"{self.joint}: " if self.joint else ""
        return f"{self.record}: {joint}{self.kind} {self.text}; {self.cure}"


@dataclass
class Screened:
    """Measurements of a record on equidistant grids, without unusable parts, and the findings.

    Findings refer to samples of the record by `rows`, the indices of the samples that are kept.
    """

    name: str
    joint_names: tuple[str, ...]
    t: Array  # the record's stamps, then the grid, all segments after each other, shape (T,) [s]
    q: Array  # shape (T, n), single spikes and missing values interpolated; the same for torques and velocities
    tau: Array | None
    qd: Array | None
    bridge: int  # most samples in a row that are interpolated
    kind_of_stamps: str  # see `Record`
    columns: dict[str, slice] = field(init=False)  # of positions, torques and velocities in arrays of all values
    steps: Array = field(init=False)  # smallest step of each of these columns; zero where there is none
    interpolated: Array = field(init=False)  # True where a position is no sample, shape (T, n)
    usable: Array = field(init=False)  # False where a torque is not to be used, shape (T, n)
    believed: Array = field(init=False)  # True for joints whose measured velocities agree with the positions
    segments: tuple[slice, ...] = ()  # the parts of the grid between gaps
    period: float = float("nan")  # from one sample to the next [s]
    notes: tuple[str, ...] = ()  # changes that correct no fault
    command: Array | None = None  # commanded positions and velocities, without missing values, shape (T, n)
    command_rate: Array | None = None
    findings: list[RecordFinding] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.stamps, self.rows = self.t, np.arange(len(self.t))
        self.usable, self.interpolated = np.ones(self.q.shape, bool), np.zeros(self.q.shape, bool)
        self.believed = np.zeros(self.q.shape[1], bool)

    def warning(
        self, joint: int | None, kind: str, text: str, cure: str, at: Iterable[int] = (), severity: Severity = "warning"
    ) -> None:
        """Add a finding; `joint` is None for all joints."""
        name = "" if joint is None else self.joint_names[joint]
        indices = tuple(int(self.rows[k]) for k in at)
        self.findings.append(RecordFinding(severity, self.name, name, kind, text, cure, indices))

    def error(self, kind: str, text: str, cure: str, samples: Iterable[int] = ()) -> None:
        """Add an error that concerns all joints."""
        self.warning(None, kind, text, cure, samples, "error")

    def cleaned(self) -> CleanRecord:
        """Clean record of the measurements, after screening."""
        own = {x.name: getattr(self, x.name) for x in fields(CleanRecord) if x.name != "encoder_step"}
        own |= {"findings": tuple(self.findings), "encoder_step": self.steps[self.columns["position"]]}
        return CleanRecord(**own)

    @property
    def has_errors(self) -> bool:
        """True if a finding is an error."""
        return any(finding.severity == "error" for finding in self.findings)

    def at(self, samples: Array) -> str:
        """Text of the number of samples and the times of the first ones, since the first stamp."""
        rows = self.rows[samples[:NAMED]]
        named = ", ".join(f"{k} (t = {seconds(self.stamps[k] - self.stamps[0])} s)" for k in rows)
        if len(samples) == 1:
            return f"at sample {named}"
        more = f" and {len(samples) - NAMED} more" if len(samples) > NAMED else ""
        return f"at {counted(len(samples), 'sample')}: {named}{more}"

    def after(self, samples: Array) -> str:
        """Text of the samples after which something occurs, the first ones with their times."""
        return "after " + self.at(samples).removeprefix("at ")


@dataclass(frozen=True, eq=False)
class CleanRecord(ReadOnlyArrays):
    """Measurements on equidistant grids, without unusable parts, see `Record.cleaned`.

    Attributes
    ----------
    name : str
        That of the record.
    joint_names : tuple of str
        Of the joints.
    t : ndarray, shape (T,)
        Times of the grid, all segments after each other [s].
    q, tau, qd : ndarray, shape (T, n)
        Positions, torques and velocities, single spikes and missing values interpolated; `tau` and `qd` are None
        without measured ones [rad or m; N m or N; rad/s or m/s].
    usable : ndarray, shape (T, n)
        False where a torque is measured but not to be used: a constant channel, a saturated drive.
    believed : ndarray, shape (n,)
        True for joints whose measured velocities agree with the positions.
    encoder_step : ndarray, shape (n,)
        Smallest step of the positions; zero where there is none [rad or m].
    segments : tuple of slice
        The parts of the grid between gaps.
    period : float
        From one sample to the next [s].
    notes : tuple of str
        Changes that correct no fault, in words.
    findings : tuple of RecordFinding
        What is wrong, and what was done about it.
    interpolated : ndarray, shape (T, n)
        True where a position was not measured.
    command, command_rate : ndarray, shape (T, n), or None
        Commanded positions and velocities that hold at these times, missing ones filled [rad or m; rad/s or m/s].

    Examples
    --------
    >>> import numpy as np, rne
    >>> t = np.arange(2000) / 500
    >>> q = np.sin(2 * np.pi * np.outer(t, [0.5, 1.0]))
    >>> clean = rne.identification.Record(np.delete(t, 9), np.delete(q, 9, axis=0), np.cos(q[1:])).cleaned
    >>> len(clean.t), [finding.kind for finding in clean.findings]
    (2000, ['missing samples'])
    """

    name: str
    joint_names: tuple[str, ...]
    t: Array
    q: Array
    tau: Array | None
    qd: Array | None
    usable: Array
    believed: Array
    encoder_step: Array
    segments: tuple[slice, ...]
    period: float
    notes: tuple[str, ...]
    findings: tuple[RecordFinding, ...]
    interpolated: Array
    command: Array | None = None
    command_rate: Array | None = None

    __repr__ = summary


def torques_of(clean: CleanRecord) -> Array:
    """Torques, shape (T, n); a ValueError if there are none."""
    if clean.tau is None:
        raise ValueError(f"{clean.name}: {NO_TORQUES}")
    return clean.tau
