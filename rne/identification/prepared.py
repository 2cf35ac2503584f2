"""Measurements on an equally spaced grid with rates and accelerations, and the filter that reduces them for a fit."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ..basics.arrays import positive_number
from ..basics.spatial import Array
from ..basics.text import counted, summary
from .filtering import FASTEST, MARGIN, choose_cutoff, derivatives, low_pass, settling


@dataclass(frozen=True, eq=False)
class Prepared:
    """Measurements on an equally spaced grid with rates and accelerations, as `Record.prepare` returns them.

    Attributes
    ----------
    t : ndarray, shape (T,)
        Times of the grid, all segments after each other [s].
    q, qd, qdd : ndarray, shape (T, n)
        Positions after the position filter, and their derivatives [rad or m; rad/s or m/s; rad/s^2 or m/s^2].
    tau : ndarray, shape (T, n)
        Measured torques, not filtered [N m or N].
    segments : tuple of slice
        The parts of the grid without gaps.
    sample_rate : float
        Of the grid [Hz].
    cutoff : float
        Of the parallel filter that `reduce` applies, where its gain is 1/2 [Hz].
    position_cutoff : float
        Of the filter that the positions have passed [Hz].
    decimation : int
        Samples of the grid per reduced row.
    usable : ndarray, shape (T, n)
        False where a torque is measured but not to be used: a constant channel, a saturated drive.
    notes : tuple of str
        What was done, in words: the cut-off's choice, what was cut, bridged and dropped.

    Examples
    --------
    >>> import numpy as np, rne
    >>> t = np.arange(2000) / 500
    >>> q = np.sin(2 * np.pi * np.outer(t, [0.5, 1.0]))
    >>> prepared = rne.identification.Record(t, q, np.cos(q)).prepare(cutoff=10.0)
    >>> prepared.decimation, prepared.reduce(prepared.tau).shape, prepared.times.shape
    (20, (91, 2), (91,))
    """

    t: Array
    q: Array
    qd: Array
    qdd: Array
    tau: Array
    segments: tuple[slice, ...]
    sample_rate: float
    cutoff: float
    position_cutoff: float
    decimation: int
    usable: Array
    notes: tuple[str, ...] = ()

    __repr__ = summary

    def reduce(self, columns: ArrayLike) -> Array:
        """Low-pass, drop the ends and decimate: the same for torques and for the columns of a regressor.

        Parameters
        ----------
        columns : array_like, shape (T, ...)
            Values on the grid, such as `tau` or a regressor.

        Returns
        -------
        ndarray, shape (R, ...)
            One row for each of `times`.

        Raises
        ------
        ValueError
            If the first axis has not the length of the grid, or a value is not finite.

        Notes
        -----
        Each segment by itself: a Butterworth filter of fourth order forwards and backwards, gain 1/2 at `cutoff`. At
        either end of a segment 1.25 / cutoff are dropped, after which less than 1 % of a step is left. The map is
        linear, so that tau = Y pi holds for reduced rows as before.

        Examples
        --------
        >>> import numpy as np, rne
        >>> t = np.arange(2000) / 500
        >>> prepared = rne.identification.Record(t, np.sin(t)[:, None], np.cos(t)[:, None]).prepare(cutoff=5.0)
        >>> bool(np.allclose(prepared.reduce(2 * prepared.tau), 2 * prepared.reduce(prepared.tau), rtol=1e-12))
        True
        """
        values = np.asarray(columns, dtype=np.float64)
        if not values.ndim or len(values) != len(self.t):
            raise ValueError(
                f"`columns` must have {len(self.t)} rows, one for each time of the grid, got {values.shape}"
            )
        if not np.isfinite(values).all():
            raise ValueError("`columns` must be finite")
        return np.concatenate(
            [
                low_pass(values[part], self.cutoff, self.sample_rate, rows - part.start)
                for part, rows in zip(self.segments, self._segment_rows, strict=True)
            ]
        )

    @property
    def times(self) -> Array:
        """Times of the reduced rows, shape (R,) [s]."""
        return self.t[self._rows]

    @cached_property
    def valid(self) -> Array:
        """True where a reduced row of a joint's torque may be used, shape (R, n)."""
        reach = settling(self.cutoff, self.sample_rate)
        valid = []
        for part, rows in zip(self.segments, self._segment_rows, strict=True):
            bad = np.vstack([np.zeros((1, self.q.shape[1]), int), np.cumsum(~self.usable[part], axis=0)])
            inner = rows - part.start
            valid.append(bad[inner + reach] == bad[inner - reach])
        return np.concatenate(valid)

    def blocks(self, k: int) -> tuple[slice, ...]:
        """Contiguous blocks of the reduced rows, to be held out in turn.

        Parameters
        ----------
        k : int
            Number of blocks, at least 2.

        Returns
        -------
        tuple of slice
            The k blocks, in order, of all rows; none lies across two segments if there are as many blocks as segments.

        Raises
        ------
        ValueError
            If `k` is below 2 or above the number of rows.

        Examples
        --------
        >>> import numpy as np, rne
        >>> t = np.arange(2000) / 500
        >>> prepared = rne.identification.Record(t, np.sin(t)[:, None], np.cos(t)[:, None]).prepare(cutoff=10.0)
        >>> prepared.blocks(2)
        (slice(0, 46, None), slice(46, 91, None))
        """
        lengths = [len(rows) for rows in self._segment_rows]
        if isinstance(k, bool) or not isinstance(k, int | np.integer) or not 2 <= k <= sum(lengths):
            raise ValueError(f"`k` must be an integer from 2 to the number of reduced rows, {sum(lengths)}, got {k!r}")
        if k < len(lengths):
            lengths = [sum(lengths)]
        counts = [1] * len(lengths)
        while sum(counts) < k:  # one more for the segment whose blocks are longest
            counts[int(np.argmax(np.divide(lengths, counts)))] += 1
        sizes = [len(part) for m, c in zip(lengths, counts, strict=True) for part in np.array_split(np.arange(m), c)]
        ends = np.cumsum([0, *sizes]).tolist()
        return tuple(slice(a, b) for a, b in pairwise(ends))

    @property
    def segment_lengths(self) -> tuple[int, ...]:
        """Number of reduced rows of each segment."""
        return tuple(len(rows) for rows in self._segment_rows)

    @cached_property
    def _segment_rows(self) -> tuple[Array, ...]:
        drop = settling(self.cutoff, self.sample_rate)
        return tuple(np.arange(part.start + drop, part.stop - drop, self.decimation) for part in self.segments)

    @cached_property
    def _rows(self) -> Array:
        return np.concatenate(self._segment_rows)


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
