"""Motions from rest to rest: polynomial and trapezoidal profiles, with numbers or traced."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from ..basics.arrays import positive_number, real_array
from ..basics.short_text import summary
from ..basics.spatial import Array
from ..elementwise import clip, less, where
from .times import broadcast_times


@dataclass(frozen=True, eq=False)
class Quintic:
    """A motion along a polynomial of fifth degree, made by `quintic`.

    Attributes
    ----------
    start, end : ndarray, shape (n,)
        Joint positions [rad or m].
    duration : float
        Time from start to end [s].

    Examples
    --------
    >>> import rne
    >>> rne.trajectories.quintic([0.0], [2.0], 4.0)(4.0)[0].tolist()
    [2.0]
    """

    start: Array
    end: Array
    duration: float

    __repr__ = summary

    def __call__(self, t: ArrayLike) -> tuple[Array, Array, Array]:
        """Positions, rates and accelerations at given times.

        Parameters
        ----------
        t : float or array_like, shape (T,) or (..., 1)
            Times [s]. An array whose last axis has length one holds one time per state, as in control laws: it is
            broadcast against joint arrays of shape (..., n). Any other array is an array of times.

        Returns
        -------
        q, qd, qdd : ndarray, shape (n,) for one time, (T, n) for T times, (..., n) for times of shape (..., 1)
            [rad or m], [rad/s or m/s], [rad/s^2 or m/s^2]. At rest before the start and after the end.

        Raises
        ------
        ValueError
            If `t` is not real or not finite.
        """
        s = clip(broadcast_times(t) / self.duration, 0.0, 1.0)
        distance = self.end - self.start
        q = self.start + distance * (s * s * s * (10.0 - 15.0 * s + 6.0 * s * s))
        qd = distance * (s * s * (30.0 - 60.0 * s + 30.0 * s * s)) / self.duration
        qdd = distance * (s * (60.0 - 180.0 * s + 120.0 * s * s)) / self.duration**2
        return q, qd, qdd


def quintic(start: ArrayLike, end: ArrayLike, duration: float) -> Quintic:
    """A motion from rest to rest along a polynomial of fifth degree, with continuous acceleration.

    Parameters
    ----------
    start, end : array_like, shape (n,)
        Joint positions [rad or m].
    duration : float
        Time from start to end [s].

    Returns
    -------
    Quintic
        A function f(t) -> (q, qd, qdd), each of shape (n,) for one time and (T, n) for an array of T times.

    Raises
    ------
    ValueError
        If the shapes differ, a number is not finite, or `duration` is not positive.

    Notes
    -----
    Siciliano et al. 2009, section 4.2.1. The peak rate is 15/8 times distance / duration, the peak acceleration
    10 / sqrt(3) times distance / duration^2.

    Examples
    --------
    >>> import rne
    >>> path = rne.trajectories.quintic([0.0], [2.0], 4.0)
    >>> [x.tolist() for x in path(2.0)]
    [[1.0], [0.9375], [0.0]]
    >>> path([0.0, 2.0, 4.0])[0].tolist()
    [[0.0], [1.0], [2.0]]
    """
    a, b = _ends(start, end)
    return Quintic(a, b, positive_number("duration", duration))


@dataclass(frozen=True, eq=False)
class Trapezoidal:
    """Constant acceleration, constant rate, constant deceleration, made by `trapezoidal`.

    Attributes
    ----------
    start, end : ndarray, shape (n,)
        Joint positions [rad or m].
    duration : float
        Time from start to end [s].
    ramp : float
        Time of acceleration, and of deceleration [s].

    Examples
    --------
    >>> import rne
    >>> rne.trajectories.trapezoidal([0.0], [3.0], 4.0, ramp=1.0)(2.0)[1].tolist()
    [1.0]
    """

    start: Array
    end: Array
    duration: float
    ramp: float

    __repr__ = summary

    @property
    def breaks(self) -> tuple[float, ...]:
        """Times at which the acceleration jumps [s]."""
        return 0.0, self.ramp, self.duration - self.ramp, self.duration

    def __call__(self, t: ArrayLike) -> tuple[Array, Array, Array]:
        """Positions, rates and accelerations at given times.

        Parameters
        ----------
        t : float or array_like, shape (T,) or (..., 1)
            Times [s]. An array whose last axis has length one holds one time per state, as in control laws: it is
            broadcast against joint arrays of shape (..., n). Any other array is an array of times.

        Returns
        -------
        q, qd, qdd : ndarray, shape (n,) for one time, (T, n) for T times, (..., n) for times of shape (..., 1)
            [rad or m], [rad/s or m/s], [rad/s^2 or m/s^2]. At rest before the start and after the end.

        Raises
        ------
        ValueError
            If `t` is not real or not finite.
        """
        t, T, r = broadcast_times(t), self.duration, self.ramp
        rate = (self.end - self.start) / (T - r)
        up, level, down = clip(t, 0.0, r), clip(t, r, T - r) - r, clip(t, T - r, T) - (T - r)
        q = self.start + rate * (up * up / (2 * r) + level + down - down * down / (2 * r))
        qd = rate * ((up - down) / r)
        rising = where(less(0.0, t), 1.0, 0.0) * where(less(t, r), 1.0, 0.0)
        falling = where(less(T - r, t), 1.0, 0.0) * where(less(t, T), 1.0, 0.0)
        return q, qd, rate * ((rising - falling) / r)


def trapezoidal(start: ArrayLike, end: ArrayLike, duration: float, ramp: float) -> Trapezoidal:
    """A motion from rest to rest with a trapezoidal profile of the rate.

    Parameters
    ----------
    start, end : array_like, shape (n,)
        Joint positions [rad or m].
    duration : float
        Time from start to end [s].
    ramp : float
        Time of acceleration, and of deceleration; at most half the duration [s].

    Returns
    -------
    Trapezoidal
        A function f(t) -> (q, qd, qdd), each of shape (n,) for one time and (T, n) for an array of T times. Its
        acceleration jumps at the times `breaks`; `rne.simulate` ends a step at each of them,
        `rne.ensemble` with its equal steps does not, and is of order 1 there.

    Raises
    ------
    ValueError
        If the shapes differ, a number is not finite or a time is out of range.

    Notes
    -----
    Siciliano et al. 2009, (4.8).

    Examples
    --------
    >>> import rne
    >>> path = rne.trajectories.trapezoidal([0.0], [3.0], 4.0, 1.0)
    >>> [x.tolist() for x in path(1.0)]
    [[0.5], [1.0], [0.0]]
    >>> path.breaks
    (0.0, 1.0, 3.0, 4.0)
    """
    a, b = _ends(start, end)
    T, r = positive_number("duration", duration), positive_number("ramp", ramp)
    if 2 * r > T:
        raise ValueError(f"`ramp` must be at most half the duration of {T:g} s, got {r:g}")
    return Trapezoidal(a, b, T, r)


def _ends(start: ArrayLike, end: ArrayLike) -> tuple[Array, Array]:
    a, b = (real_array(name, x, "(n,)").astype(np.float64) for name, x in (("start", start), ("end", end)))
    if a.ndim != 1 or a.shape != b.shape:
        raise ValueError(f"`start` and `end` must have the same shape (n,), got {a.shape} and {b.shape}")
    return a, b
