"""Piecewise polynomials through samples; loading those of SciPy takes 0.1 to 0.4 s."""

from __future__ import annotations

from typing import Any, NamedTuple, cast

import numpy as np

from .arrays import TIME_ROUNDING
from .spatial import Array

NO_TABLE: Array = np.zeros((0, 0))
NO_TABLES: Array = np.zeros((0, 0, 0))


class Piecewise(NamedTuple):
    """Polynomials in ((time - t[k]) / (t[k + 1] - t[k])), the last one also at the end.

    Attributes
    ----------
    t : ndarray, shape (N + 1,)
        Ends of the pieces [s].
    c : ndarray, shape (degree + 1, N, n)
        Coefficients, in ascending powers.
    """

    t: Array
    c: Array

    def __call__(self, times: Array) -> Array:
        """Values at times (T,), shape (T, n)."""
        k = np.clip(np.searchsorted(self.t, times, side="right") - 1, 0, len(self.t) - 2)
        return self._at(k, (times - self.t[k]) / (self.t[k + 1] - self.t[k]))

    def _at(self, k: Array, s: Array) -> Array:
        """Values at fractions s of pieces k."""
        total = self.c[-1, k]
        for c in self.c[-2::-1]:
            total = total * s[:, None] + c[k]
        return np.asarray(total)

    def at_fractions(self, s: Array) -> tuple[Array, Array]:
        """Times and values at fractions s of every piece, shapes (N S,) and (N S, n)."""
        times = (self.t[:-1, None] + np.diff(self.t)[:, None] * s).reshape(-1)
        pieces = len(self.t) - 1
        return times, self._at(np.repeat(np.arange(pieces), len(s)), np.tile(s, pieces))

    def derivative(self) -> Piecewise:
        """Derivative with respect to time."""
        powers = np.arange(1, len(self.c))[:, None, None]
        return Piecewise(self.t, self.c[1:] * powers / np.diff(self.t)[:, None])

    @property
    def table(self) -> Array:
        """Table with a row per piece: begin, end, ascending coefficients of n values, shape (N, 2 + (degree + 1) n)."""
        rows = self.c.transpose(1, 0, 2).reshape(len(self.t) - 1, -1)
        return np.column_stack([self.t[:-1], self.t[1:], rows])


def numbers_at(table: Array, t: Array) -> Array:
    """Indices of the rows of a table (N, width) for times; a ValueError outside of all, except for rounding.

    Where two pieces meet, it is the later one.
    """
    start, end = float(table[0, 0]), float(table[-1, 1])
    outside = t[np.abs(t - np.clip(t, start, end)) > TIME_ROUNDING * max(abs(start), abs(end))]
    if outside.size:
        raise ValueError(f"`t` must be within the samples, {start:g} to {end:g} s, got {outside.flat[0]:g}")
    return np.maximum(np.searchsorted(table[:, 0], t, side="right") - 1, 0)


def rows_at(table: Array, t: Array) -> Array:
    """Rows of a table for times t, (..., width)."""
    return np.asarray(table[numbers_at(table, t)])


def pieces_at(table: Array, t: Array) -> tuple[Array, ...]:
    """Rows for times t of shape (..., 1) as arguments of a kernel; none without a table."""
    return (rows_at(table, t[..., 0]),) if len(table) else ()


def rows_of_tables(tables: Array, t: Array, which: Any = slice(None)) -> tuple[Array, ...]:
    """Rows for times (T,) of the tables (M, N, width) of M motions, or of one for all; none without tables.

    All tables have the same ends of pieces.
    """
    if not len(tables):
        return ()
    k = numbers_at(tables[0], t)
    return (tables[0, k] if len(tables) == 1 else tables[np.arange(len(tables))[which], k],)


def tables_of(motion: Any, samples: Array) -> Array:
    """Tables (M, N, width) of the motion through the samples (M, K, n) of each of M motions."""
    count, K, n = samples.shape
    together = motion.with_samples(samples.transpose(1, 0, 2).reshape(K, count * n)).table
    parts = together[:, 2:].reshape(len(together), -1, count, n).transpose(2, 0, 1, 3)
    ends = np.broadcast_to(together[:, :2], (count, len(together), 2))
    return np.ascontiguousarray(np.concatenate([ends, parts.reshape(count, len(together), -1)], axis=2))


def on_rows(t: Any, rows: Array, n: int) -> tuple[Array, Array, Array]:
    """Values, rates and second derivatives of n values at times t by rows of a table, (..., width); may be traced."""
    begin, end = rows[..., :1], rows[..., 1:2]
    *lower, value = (rows[..., k : k + n] for k in range(2, rows.shape[-1], n))
    zero = 0 * value
    if not lower:
        return value, zero, zero
    rate = 1 / (end - begin)
    s, slope, curvature = (t - begin) * rate, cast("Any", None), cast("Any", None)
    for c in reversed(lower):  # Horner's scheme for a polynomial and its derivatives, without sums of zeros
        curvature = slope if curvature is None else curvature * s + slope
        slope = value if slope is None else slope * s + value
        value = value * s + c
    return value, slope * rate, zero if curvature is None else 2 * curvature * rate * rate


def quintic(t: Array, q: Array, qd: Array, begin: Array, end: Array) -> Piecewise:
    """Polynomials of fifth degree through positions and velocities (N + 1, n) and each step's accelerations (N, n)."""
    h = np.diff(t)[:, None]
    v0, v1, a0, a1, change = h * qd[:-1], h * qd[1:], h * h * begin / 2, h * h * end / 2, np.diff(q, axis=0)
    third = 10 * change - 6 * v0 - 4 * v1 - 3 * a0 + a1
    fourth = -15 * change + 8 * v0 + 7 * v1 + 3 * a0 - 2 * a1
    return Piecewise(t, np.stack([q[:-1], v0, a0, third, fourth, 6 * change - 3 * (v0 + v1) - a0 + a1]))


def cubic(t: Array, begin: Array, end: Array, slopes: Array, end_slopes: Array) -> Piecewise:
    """Polynomials of third degree through values and derivatives at both ends of each step, shapes (N, n)."""
    h, change = np.diff(t)[:, None], end - begin
    m0, m1 = h * slopes, h * end_slopes
    return Piecewise(t, np.stack([begin, m0, 3 * change - 2 * m0 - m1, m0 + m1 - 2 * change]))


def monotone(t: Array, begin: Array, end: Array, jumps: Array) -> Piecewise:
    """Monotone cubics without overshoot between `jumps`, the indices of the steps that begin with a jump.

    Slopes are those of Fritsch and Butland 1984, as in SciPy's PchipInterpolator; a step between two jumps is linear.
    """
    h, k = np.diff(t)[:, None], np.arange(len(t) - 1)
    first = np.isin(k, [0, *jumps])  # steps with which a piece begins
    last = np.append(first[1:], True)
    secants = (end - begin) / h
    before, after = secants[:-1], secants[1:]
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        mean = 3 * (h[:-1] + h[1:]) / ((2 * h[1:] + h[:-1]) / before + (h[1:] + 2 * h[:-1]) / after)
    mean = np.where((before > 0) & (after > 0) | (before < 0) & (after < 0), mean, 0.0)
    none = np.zeros_like(secants[:1])
    at_begin = _end_slopes(h, secants, np.where(last, k, k + 1))
    at_end = _end_slopes(h, secants, np.where(first, k, k - 1))
    slopes = np.where(first[:, None], at_begin, np.append(none, mean, axis=0))
    end_slopes = np.where(last[:, None], at_end, np.append(mean, none, axis=0))
    return cubic(t, begin, end, slopes, end_slopes)


def _end_slopes(h: Array, secants: Array, k: Array) -> Array:
    """Limited three-point derivatives at the ends of steps that have only one neighbour, step k."""
    h1, other = h[k], secants[k]
    slopes = ((2 * h + h1) * secants - h * other) / (h + h1)
    most = np.where(secants * other < 0, 3 * np.abs(secants), np.inf)
    return np.where(slopes * secants > 0, np.sign(secants) * np.minimum(np.abs(slopes), most), 0.0)
