"""Reference motions from rest to rest: functions of time that give (q, qd, qdd), plain or traced."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from .basics.arrays import positive_number, real_array
from .basics.spatial import Array
from .elementwise import clip, less, where


@dataclass(frozen=True, eq=False)
class Quintic:
    """Rest to rest with continuous acceleration; see `quintic`."""

    start: Array
    end: Array
    duration: float

    def __call__(self, t: float) -> tuple[Array, Array, Array]:
        """(q, qd, qdd) at time t [rad, rad/s, rad/s^2]; at rest before the start and after the end."""
        s = clip(t / self.duration, 0.0, 1.0)
        move = self.end - self.start
        q = self.start + move * (s * s * s * (10.0 - 15.0 * s + 6.0 * s * s))
        qd = move * (s * s * (30.0 - 60.0 * s + 30.0 * s * s)) / self.duration
        qdd = move * (s * (60.0 - 180.0 * s + 120.0 * s * s)) / self.duration**2
        return q, qd, qdd


def quintic(start: ArrayLike, end: ArrayLike, duration: float) -> Quintic:
    """A motion from rest to rest along a polynomial of fifth degree.

    Parameters
    ----------
    start, end : array_like, shape (n,)
        [rad or m]
    duration : float
        [s]

    Returns
    -------
    Quintic
        f(t) -> (q, qd, qdd).

    Raises
    ------
    ValueError
        If the shapes differ or a number is not finite, or `duration` is not positive.

    Notes
    -----
    Siciliano et al. 2009, section 4.2.1. Its peak rate is 15/8 of the mean, its peak acceleration
    10/sqrt(3) move/duration^2.

    Examples
    --------
    >>> import rne
    >>> [x.tolist() for x in rne.trajectories.quintic([0.0], [2.0], 4.0)(2.0)]
    [[1.0], [0.9375], [0.0]]
    """
    a, b = _ends(start, end)
    return Quintic(a, b, positive_number("duration", duration))


@dataclass(frozen=True, eq=False)
class Trapezoidal:
    """Constant acceleration, constant rate, constant deceleration; see `trapezoidal`."""

    start: Array
    end: Array
    duration: float
    ramp: float

    @property
    def breaks(self) -> tuple[float, ...]:
        """Times at which the acceleration jumps [s]."""
        return 0.0, self.ramp, self.duration - self.ramp, self.duration

    def __call__(self, t: float) -> tuple[Array, Array, Array]:
        """(q, qd, qdd) at time t [rad, rad/s, rad/s^2]; at rest before the start and after the end."""
        T, r = self.duration, self.ramp
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
        [rad or m]
    duration : float
        [s]
    ramp : float
        Time of acceleration, and of deceleration; at most half the duration [s].

    Returns
    -------
    Trapezoidal
        f(t) -> (q, qd, qdd). Its acceleration jumps at its `breaks`, which simulations step onto.

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
    >>> [x.tolist() for x in rne.trajectories.trapezoidal([0.0], [3.0], 4.0, 1.0)(1.0)]
    [[0.5], [1.0], [0.0]]
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
