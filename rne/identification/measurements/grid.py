"""Samples at measured times brought to an equally spaced grid, in segments between gaps."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ...basics.spatial import Array

REGULAR = 0.02  # deviation of stamps from an equally spaced grid that is none, as a part of the period


class Segment(NamedTuple):
    """Samples without a gap.

    Attributes
    ----------
    rows : ndarray, shape (K,)
        Indices of the samples in the record.
    t : ndarray, shape (T,)
        The grid [s].
    is_regular : bool
        True if the samples lie on the grid as they are.
    """

    rows: Array
    t: Array
    is_regular: bool

    def on_grid(self, stamps: Array, values: Array) -> Array:
        """Values at the record's samples, shape (..., n), on the grid: unchanged, or by a cubic spline."""
        if self.is_regular:
            return values[self.rows]
        from scipy.interpolate import CubicSpline

        resampled: Array = CubicSpline(stamps[self.rows], values[self.rows], axis=0)(self.t)
        return resampled

    def nearest(self, stamps: Array, flags: Array) -> Array:
        """Flags at the record's samples, shape (..., n), on the grid: false where one of the two samples beside is."""
        if self.is_regular:
            return flags[self.rows]
        after = np.clip(np.searchsorted(stamps[self.rows], self.t), 0, len(self.rows) - 1)
        both: Array = flags[self.rows[after]] & flags[self.rows[np.maximum(after - 1, 0)]]
        return both


def sample_period(t: Array, bridge: int) -> float:
    """Time from one sample to the next: the slope of the times over the counted samples, apart for each segment."""
    steps = np.diff(t)
    median = float(np.median(steps))
    gap = steps > (bridge + 1.5) * median
    count = np.concatenate([[0.0], np.cumsum(np.where(gap, 0, np.rint(steps / median)))])
    group = np.concatenate([[0], np.cumsum(gap)])
    size = np.bincount(group)
    count -= (np.bincount(group, count) / size)[group]
    centred = t - (np.bincount(group, t) / size)[group]
    return float(centred @ count / (count @ count)) if count.any() else median


def split(t: Array, kept: Array, period: float, bridge: int, cuts: Array) -> list[Segment]:
    """Segments of at least two samples, between gaps of more than `bridge` missing samples and after each of `cuts`."""
    rows = np.flatnonzero(kept)
    gap = np.diff(t[rows]) > (bridge + 1.5) * period
    gap |= np.searchsorted(cuts, rows[1:]) > np.searchsorted(cuts, rows[:-1])
    gaps = np.flatnonzero(gap) + 1
    return [_segment(part, t[part], period) for part in np.split(rows, gaps) if len(part) > 1]


def _segment(rows: Array, t: Array, period: float) -> Segment:
    count = int(np.rint((t[-1] - t[0]) / period)) + 1
    grid = period * np.arange(count)
    if count == len(rows):
        centred = grid + np.mean(t - grid)
        if np.abs(t - centred).max() <= REGULAR * period:
            return Segment(rows, centred, True)
    grid += t[0]
    return Segment(rows, grid[grid <= t[-1] + REGULAR * period], False)
