"""Instruments of an identification: motions without noise that resemble the measured ones (Janot et al. 2014)."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import Any

import numpy as np

from ...basics.arrays import real_array
from ...basics.spatial import Array
from ...basics.text import counted
from ..log.record import Record
from .equations import Motion, along

KINDS_OF_INSTRUMENTS = (
    "`instruments` must be, for each record, a function of time that returns q, qd and qdd, a Trajectory, or positions "
    "at the record's times, shape (T, n), without the noise of the measured ones"
)


def motions_of(given: Any, records: Sequence[Record]) -> tuple[Motion, ...]:
    """Motions of the instruments, one for each record; empty if not given."""
    from scipy.interpolate import CubicSpline

    if given is None:
        return ()
    for x in given if isinstance(given, Sequence) else [given]:
        if isinstance(x, Record | str):
            raise TypeError(f"{KINDS_OF_INSTRUMENTS}, got a {type(x).__name__}")
    several = isinstance(given, Sequence) and all(callable(x) or np.ndim(x) == 2 for x in given)
    each = list(given) if several else [given] * (len(records) if callable(given) else 1)
    if len(each) != len(records):
        wanted = f"one motion for each of {counted(len(records), 'record')}"
        raise ValueError(f"`instruments` must have {wanted}, got {counted(len(each), 'motion')}")
    motions = []
    for k, (motion, record) in enumerate(zip(each, records, strict=True)):
        if not callable(motion):
            t, rows = np.unique(record.t, return_index=True)
            q = real_array(f"instruments[{k}]", motion, f"({len(record.t)}, {record.n})")[rows]
            if len(t) < 2:
                raise ValueError(f"`instruments[{k}]` needs a record of several times, {record.name!r} has {len(t)}")
            spline = CubicSpline(t, q)
            motion = partial(lambda s, t: (s(t), s(t, 1), s(t, 2)), spline)
        motions.append(evaluated_once(motion))
    return tuple(motions)


def evaluated_once(motion: Motion) -> Motion:
    """Motion with cached values, as each round of a fit evaluates it at the same times."""
    found: dict[bytes, tuple[Array, Array, Array]] = {}

    def at(t: Array) -> tuple[Array, Array, Array]:
        times = np.asarray(t).tobytes()
        if times not in found:
            found[times] = motion(t)
        return found[times]

    return at


def cutoff_of_instruments(records: Sequence[Record], motions: Sequence[Motion]) -> float:
    """Cut-off for noise-free motions, which do not show the noise of the measured positions [Hz]."""
    moved = [along(record.prepare(), motion) for record, motion in zip(records, motions, strict=True)]
    return max(Record(m.t, m.q, m.tau).prepare().cutoff for m in moved)
