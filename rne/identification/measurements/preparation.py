"""From segments on an equally spaced grid to positions, rates, accelerations and torques for a fit."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from ...basics.arrays import positive_number
from ...basics.spatial import Array
from ...basics.text import counted
from .bandwidth import FASTEST, choose_cutoff
from .filtering import MARGIN, derivatives, low_pass, settling
from .prepared import Prepared

POSITIONS = 5.0  # cut-off of the positions' filter, as a multiple of the parallel filter's
HIGHEST = 0.25  # of that, as a part of the sample rate
ROUNDING = 1e-6  # of a ratio of rates
PASS_BAND = 0.8  # cut-off as a part of half the reduced rows' rate (Gautier, Janot and Vandanjon 2013)


class Part(NamedTuple):
    """A segment on its grid: times, shape (T,), and positions, torques and where these are usable, shape (T, n)."""

    t: Array
    q: Array
    tau: Array
    usable: Array


def prepare(name: str, parts: Sequence[Part], rate: float, cutoff: float | None, decimation: int | None) -> Prepared:
    """Filter and differentiate the positions of every segment that is long enough; rate is the grid's [Hz]."""
    cutoff, note = _cutoff(name, parts, rate, cutoff)
    decimation = _decimation(decimation, cutoff, rate)
    position_cutoff = min(POSITIONS * cutoff, HIGHEST * rate)
    drop = max(2 * settling(position_cutoff, rate), MARGIN)  # twice, for the accelerations
    needed = 2 * (drop + settling(cutoff, rate)) + decimation
    kept = [part for part in parts if len(part.t) >= needed]
    if not kept:
        longest = max((len(part.t) for part in parts), default=0)
        raise ValueError(
            f"{name}: a cut-off of {cutoff:.3g} Hz needs a segment of {needed} samples, the longest has {longest}; "
            "give a higher `cutoff`, or record longer without gaps"
        )
    differentiated = [_differentiated(part, position_cutoff, rate, drop) for part in kept]
    t, q, qd, qdd, tau, usable = (np.concatenate(arrays) for arrays in zip(*differentiated, strict=True))
    ends = np.cumsum([0, *(len(arrays[0]) for arrays in differentiated)]).tolist()
    segments = tuple(slice(a, b) for a, b in pairwise(ends))
    notes = [note, f"{drop} samples at either end of a segment dropped after the filter of the positions"]
    if len(kept) < len(parts):
        left_out = [len(part.t) for part in parts if len(part.t) < needed]
        notes.append(
            f"{counted(len(left_out), 'segment')}, {sum(left_out)} samples in all, left out: "
            f"the filters need {needed} samples without a gap"
        )
    return Prepared(t, q, qd, qdd, tau, segments, rate, cutoff, position_cutoff, decimation, usable, tuple(notes))


def _cutoff(name: str, parts: Sequence[Part], rate: float, given: float | None) -> tuple[float, str]:
    if given is None:
        try:
            return choose_cutoff([part.q for part in parts], rate)
        except ValueError as error:
            raise ValueError(f"{name}: {error}; give `cutoff` [Hz]") from None
    cutoff = positive_number("cutoff", given)
    if cutoff > FASTEST * rate:
        raise ValueError(
            f"`cutoff` must be at most {FASTEST * rate:.6g} Hz, a fifth of the sample rate, got {cutoff:.6g}"
        )
    return cutoff, f"cut-off {cutoff:.3g} Hz, as given"


def _decimation(given: int | None, cutoff: float, rate: float) -> int:
    most = int(rate / (2 * cutoff) + ROUNDING)
    if given is None:
        return max(1, int(PASS_BAND * rate / (2 * cutoff) + ROUNDING))
    if isinstance(given, bool) or not isinstance(given, int | np.integer) or not 1 <= given <= most:
        raise ValueError(
            f"`decimation` must be an integer from 1 to {most}, to keep twice the cut-off or more, got {given!r}"
        )
    return int(given)


def _differentiated(part: Part, cutoff: float, rate: float, drop: int) -> tuple[Array, ...]:
    """Times, positions, rates, accelerations, torques and where usable, without `drop` samples at either end."""
    inner = slice(drop, len(part.t) - drop)
    q = low_pass(part.q, cutoff, rate)
    qd, qdd = derivatives(q[drop - MARGIN : len(q) - drop + MARGIN], rate)
    return part.t[inner], q[inner], qd, qdd, part.tau[inner], part.usable[inner]
