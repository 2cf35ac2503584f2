"""What is wrong with a record, and what is done about it."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Literal

import numpy as np

from ...basics.spatial import Array
from ...basics.text import counted, summary

NAMED = 3  # samples that a text names


@dataclass(frozen=True)
class RecordFinding:
    """One error or warning about measurements.

    Attributes
    ----------
    severity : {"error", "warning"}
        A record with errors is not prepared for a fit; of warnings, the cure says what is done.
    record : str
        The record's name.
    joint : str
        The joint; empty if all are concerned.
    kind : str
        What was found, such as "wild position" or "gap".
    text : str
        Where, and by how much.
    cure : str
        What is done about it, or what to do.
    samples : tuple of int
        The samples concerned, as indices of the record's arrays.

    Examples
    --------
    >>> import rne
    >>> finding = rne.identification.RecordFinding("warning", "run 1", "", "gap", "after sample 7", "cut here", (7,))
    >>> print(finding)
    warning: run 1: gap after sample 7; cut here
    """

    severity: Literal["error", "warning"]
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
        """All but the severity."""
        joint = f"{self.joint}: " if self.joint else ""
        return f"{self.record}: {joint}{self.kind} {self.text}; {self.cure}"


class Findings:
    """Collects the findings on one record; `rows` are the record's samples that indices refer to."""

    def __init__(self, record: str, joint_names: tuple[str, ...], t: Array) -> None:
        self.record, self.joint_names, self.t = record, joint_names, t
        self.rows: Array = np.arange(len(t))
        self.found: list[RecordFinding] = []

    def error(self, joint: int | None, kind: str, text: str, cure: str, samples: Iterable[int] = ()) -> None:
        """Add an error; `joint` is None for all joints."""
        self._add("error", joint, kind, text, cure, samples)

    def warning(self, joint: int | None, kind: str, text: str, cure: str, samples: Iterable[int] = ()) -> None:
        """Add a warning; `joint` is None for all joints."""
        self._add("warning", joint, kind, text, cure, samples)

    def _add(
        self,
        severity: Literal["error", "warning"],
        joint: int | None,
        kind: str,
        text: str,
        cure: str,
        samples: Iterable[int],
    ) -> None:
        name = "" if joint is None else self.joint_names[joint]
        indices = tuple(int(self.rows[k]) for k in samples)
        self.found.append(RecordFinding(severity, self.record, name, kind, text, cure, indices))

    @property
    def has_errors(self) -> bool:
        """True if an error is among them."""
        return any(finding.severity == "error" for finding in self.found)

    def at(self, samples: Array) -> str:
        """Where these samples are, the first ones with their times."""
        named = ", ".join(f"{k} (t = {self.t[k]:.6g} s)" for k in self.rows[samples[:NAMED]])
        if len(samples) == 1:
            return f"at sample {named}"
        more = f" and {len(samples) - NAMED} more" if len(samples) > NAMED else ""
        return f"at {counted(len(samples), 'sample')}: {named}{more}"


def runs(flags: Array) -> list[tuple[int, int]]:
    """Start and end (exclusive) of each run of True in a vector."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], flags, [False]]).astype(np.int8)))
    return [(int(a), int(b)) for a, b in edges.reshape(-1, 2)]
