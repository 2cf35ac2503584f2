"""Measurements on an equidistant grid, with velocities and accelerations, and the filter that reduces them."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, partial

import numpy as np
from numpy.typing import ArrayLike

from ...basics.arrays import ReadOnlyArrays, cached_array, positive_number
from ...basics.filters import low_pass, settling
from ...basics.spatial import Array
from ...basics.text import counted, summary
from .. import thresholds
from . import filtering
from .findings import CleanRecord, torques_of
from .screening import consecutive


@dataclass(frozen=True, eq=False)
class Prepared(ReadOnlyArrays):
    """Measurements on an equidistant grid with velocities and accelerations, from `Record.prepare`.

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
        Samples of the grid per second [Hz].
    cutoff : float
        Cut-off of the parallel filter that `reduce` applies, where its gain is 1/2 [Hz].
    position_cutoff : float
        Cut-off of the filter that the positions have passed [Hz].
    decimation : int
        Samples of the grid per reduced row: the cut-off is at most 0.8 times half the rate of the rows.
    usable : ndarray, shape (T, n)
        False where a torque is measured but not to be used: a constant channel, a saturated drive.
    notes : tuple of str
        Choice of the cut-off, and what was cut, bridged and dropped, in words.
    start : float
        First stamp of the record, from which texts count [s].

    Examples
    --------
    >>> import numpy as np, rne
    >>> t = np.arange(2000) / 500
    >>> q = np.sin(2 * np.pi * np.outer(t, [0.5, 1.0]))
    >>> prepared = rne.identification.Record(t, q, np.cos(q)).prepare(cutoff=10.0)
    >>> prepared.decimation, prepared.reduce(prepared.tau).shape, prepared.times.shape
    (20, (91, 2), (91,))
    >>> prepared.blocks(2)
    (slice(0, 46, None), slice(46, 91, None))
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
    notes: tuple[str, ...]
    start: float

    __repr__ = summary

    def reduce(self, columns: ArrayLike) -> Array:
        """Low-pass filter, cut the ends and decimate: the same for torques and for the columns of a regressor.

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
            If the first axis does not have the length of the grid, or a value is not finite.

        Notes
        -----
        Each segment by itself: a Butterworth filter of fourth order forwards and backwards, gain 1/2 at `cutoff`. At
        either end of a segment 1.25 / cutoff are dropped, after which less than 1 % of a step is left. The map is
        linear, so that tau = Y pi holds for reduced rows as before.
        """
        values = np.asarray(columns, dtype=np.float64)
        if not values.ndim or len(values) != len(self.t):
            rows = f"{len(self.t)} rows, one for each time of the grid"
            raise ValueError(f"`columns` must have {rows}, got {values.shape}")
        if not np.isfinite(values).all():
            raise ValueError("`columns` must be finite")
        filtered = partial(low_pass, cutoff=self.cutoff, sample_rate=self.sample_rate)
        parts = zip(self.segments, self._segment_rows, strict=True)
        return np.concatenate([filtered(values[part], kept=rows - part.start) for part, rows in parts])

    @cached_array
    def times(self) -> Array:
        """Times of the reduced rows, shape (R,) [s]."""
        return np.asarray(self.t[self.row_samples])

    @property
    def row_samples(self) -> Array:
        """Indices of the grid samples of the reduced rows, shape (R,)."""
        return np.concatenate(self._segment_rows)

    @cached_array
    def valid(self) -> Array:
        """True where a reduced row of a joint's torque may be used, shape (R, n)."""
        return rows_without(self, ~self.usable)

    def blocks(self, k: int) -> tuple[slice, ...]:
        """Contiguous blocks of the reduced rows, for cross-validation.

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
        return consecutive(sizes)

    @property
    def segment_lengths(self) -> tuple[int, ...]:
        """Number of reduced rows of each segment."""
        return tuple(len(rows) for rows in self._segment_rows)

    @cached_property
    def _segment_rows(self) -> tuple[Array, ...]:
        drop = settling(self.cutoff, self.sample_rate)
        return tuple(np.arange(part.start + drop, part.stop - drop, self.decimation) for part in self.segments)


def undisturbed(flags: Array, rows: Array, reach: int) -> Array:
    """True at rows without a flagged sample in reach; flags have shape (T, n), the result (len(rows), n)."""
    count = np.vstack([np.zeros((1, flags.shape[1]), int), np.cumsum(flags, axis=0)])
    return np.asarray(count[rows + reach] == count[rows - reach])


def prepare(name: str, clean: CleanRecord, cutoff: float | None, start: float) -> Prepared:
    """Filter and differentiate the positions of every segment that is long enough."""
    rate, parts = 1 / clean.period, clean.segments
    positions, spectrum, notes = _fused(clean, [clean.q[part] for part in parts], rate)
    cutoff, reasons = _cutoff(name, clean, cutoff, positions, spectrum)
    decimation = max(1, int(thresholds.PASS_BAND * rate / (2 * cutoff) + thresholds.WHOLE_RATIO))
    position_cutoff = min(thresholds.POSITION_CUTOFF * cutoff, thresholds.HIGHEST_POSITION_CUTOFF * rate)
    drop = max(2 * settling(position_cutoff, rate), filtering.MARGIN)  # twice, for the accelerations
    needed = 2 * (drop + settling(cutoff, rate)) + decimation
    lengths = [len(q) for q in positions]
    kept = [k for k, length in enumerate(lengths) if length >= needed]
    if not kept:
        raise ValueError(
            f"{name}: a cut-off of {cutoff:.3g} Hz needs a segment of {needed} samples, the longest has "
            f"{max(lengths, default=0)}; give a higher `cutoff`, or record longer without gaps"
        )
    by_segment = (_differentiated(positions[k], position_cutoff, rate, drop) for k in kept)
    q, qd, qdd = (np.concatenate(arrays) for arrays in zip(*by_segment, strict=True))
    rows = np.concatenate([np.arange(parts[k].start + drop, parts[k].stop - drop) for k in kept])
    segments = consecutive(lengths[k] - 2 * drop for k in kept)
    notes = [*reasons, *notes, f"{drop} samples at either end of a segment dropped after the filter of the positions"]
    if len(kept) < len(parts):
        short = [length for length in lengths if length < needed]
        left_out = f"{counted(len(short), 'segment')}, {sum(short)} samples in all, left out"
        notes.append(f"{left_out}: the filters need {needed} samples without a gap")
    if start:
        notes.append(f"times are counted from the first stamp, {start:.3f} s")
    notes += [*clean.notes, *(str(finding) for finding in clean.findings)]
    t, tau, usable = (x[rows] for x in (clean.t, torques_of(clean), clean.usable))
    of_filters = rate, cutoff, position_cutoff, decimation
    return Prepared(t, q, qd, qdd, tau, segments, *of_filters, usable, tuple(notes), start)


def _cutoff(
    name: str, clean: CleanRecord, given: float | None, positions: list[Array], spectrum: tuple[Array, ...] | None
) -> tuple[float, tuple[str, ...]]:
    """Cut-off [Hz], and the reason: given, or by the spectrum of the positions of each segment."""
    rate, torques = 1 / clean.period, [torques_of(clean)[part] for part in clean.segments]
    if given is None:
        try:
            if spectrum is None:
                spectrum = filtering.motion_spectrum(positions, rate)
            return filtering.choose_cutoff(spectrum, rate, positions, torques)
        except ValueError as error:
            raise ValueError(f"{name}: {error}; give `cutoff` [Hz]") from None
    cutoff = positive_number("cutoff", given)
    if cutoff > thresholds.PRINTED * thresholds.HIGHEST_CUTOFF * rate:
        most = f"{thresholds.HIGHEST_CUTOFF * rate:.6g} Hz, a fifth of the sample rate"
        raise ValueError(f"`cutoff` must be at most {most}, got {cutoff:.6g}")
    return cutoff, (f"cut-off {cutoff:.3g} Hz, as given",)


def _fused(
    clean: CleanRecord, positions: list[Array], rate: float
) -> tuple[list[Array], tuple[Array, ...] | None, list[str]]:
    """Positions fused with measured velocities where these are better, the spectrum used, and a note."""
    if clean.qd is None or not clean.believed.any():
        return positions, None, []
    integrals = [filtering.integral(clean.qd[part], rate) for part in clean.segments]
    try:
        spectrum = filtering.motion_spectrum(positions, rate, integrals, clean.believed)
    except ValueError:  # too short a record for a spectrum
        return positions, None, []
    crossover = spectrum[-1]
    if np.isinf(crossover).all():
        return positions, spectrum, ["velocities from the positions: the measured ones are noisier, or late"]
    fused = [filtering.complementary_filter(q, Q, crossover, rate) for q, Q in zip(positions, integrals, strict=True)]
    named = ", ".join(f"{f:.3g}" if np.isfinite(f) else "none" for f in crossover)
    note = f"velocities as measured above a crossover, from the positions below it: {named} Hz by joint"
    return fused, spectrum, [note]


def _differentiated(q: Array, cutoff: float, rate: float, drop: int) -> tuple[Array, Array, Array]:
    """Positions, velocities and accelerations, without `drop` samples at either end."""
    filtered = low_pass(q, cutoff, rate)
    qd, qdd = filtering.derivatives(filtered[drop - filtering.MARGIN : len(q) - drop + filtering.MARGIN], rate)
    return filtered[drop : len(q) - drop], qd, qdd


def rows_without(record: Prepared, flags: Array) -> Array:
    """True at reduced rows whose filter uses no flagged sample; flags have shape (T, n), the result (R, n)."""
    reach = settling(record.cutoff, record.sample_rate)
    parts = zip(record.segments, record._segment_rows, strict=True)
    return np.concatenate([undisturbed(flags[part], rows - part.start, reach) for part, rows in parts])
