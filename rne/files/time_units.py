"""Units of times: the likely unit of a log's times, where it is not stated."""

from __future__ import annotations

from typing import Literal, NamedTuple

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from ..basics.spatial import Array

TimeSymbol = Literal["s", "ms", "us", "ns"]
UNITS = {"s": 1.0, "ms": 1e3, "us": 1e6, "ns": 1e9}  # units per second
NAMES = {"ms": "milliseconds", "us": "microseconds", "ns": "nanoseconds"}
NO_SECONDS = 1e11  # times beyond which the unit is not seconds [s]: the year 5138
SINCE_1970 = 1.2e9, 5e9  # the years 2008 to 2128 [s]
LONG, ENDLESS = 0.1, 1e3  # step below which milliseconds are unlikely, and above which seconds are [s]
STEPS = 2e-5, 10.0  # range of the steps of logs [s]
TRAVEL = 1e-3  # smallest motion [rad or m], except in such steps
SLOW, FAST = 2e-3, 2.0  # plausible range of speeds relative to the joints' limits
CREEPING = 1e-3  # relative speed below which a date in a unit is doubted
SPEED = 5.0  # speed instead of an unknown limit [rad/s or m/s]
AGREE, FACTOR = 0.8, 3.0  # correlation of measured velocities with differences of positions, and error of their ratio
SPIKED = 10  # samples from which single jumps do not count as motion, and ratios of velocities are estimated


class TimeUnit(NamedTuple):
    """Likely unit of times: its symbol, and the reason why they are not taken as seconds."""

    symbol: str
    reason: str

    @property
    def divisor(self) -> str:
        """Divisor of times in this unit, as text."""
        return f"{UNITS[self.symbol]:g}".replace("e+0", "e")

    @property
    def said(self) -> str:
        """Text of the unit and the divisor."""
        return f"looks like {NAMES[self.symbol]}, not seconds: {self.reason}"


def guessed_unit(t: Array, q: Array, qd: Array | None = None, limits: Array | None = None) -> TimeUnit | None:
    """Unit of times (K,) that are hardly in seconds; None where seconds are plausible.

    Seconds are not plausible if measured velocities fit another unit, times are later than any date, or steps are long
    and no joint reaches 1/500 of its velocity limit although one moves. The unit returned gives steps of 20 us to 10 s
    and the largest speeds below twice the limits; of a robot at rest it is that of a date.
    """
    if len(t) < 2:
        return None
    h, size = float(np.median(np.diff(t))), float(np.abs(t).max())
    ratio = 0.0 if qd is None else velocity_ratio(t, q, qd)
    for symbol in NAMES:
        if 1 / FACTOR < ratio / UNITS[symbol] < FACTOR:
            return TimeUnit(symbol, f"qd is {ratio:.3g} times the differences of q over those of t")
    if h < LONG and size < NO_SECONDS:
        return None
    share, speed = _speeds(t, q, limits)
    possible = [s for s in NAMES if STEPS[0] <= h / UNITS[s] <= STEPS[1] and size / UNITS[s] < NO_SECONDS]
    plausible = [symbol for symbol in possible if share * UNITS[symbol] <= FAST]
    if size >= NO_SECONDS:
        dates = [s for s in possible if SINCE_1970[0] < size / UNITS[s] < SINCE_1970[1]]
        dates = [s for s in dates if not share or CREEPING < share * UNITS[s] <= FAST]
        found = (dates or plausible[::-1] or possible or list(NAMES)[-1:])[0]
        return TimeUnit(found, f"up to {size:.4g}, in steps of {h:.4g}")
    if not 0 < share < SLOW or not plausible or 1 / FACTOR < ratio < FACTOR:
        return None
    return TimeUnit(plausible[-1], f"its steps are {h:.4g}, and no joint would be faster than {speed:.2g} rad/s or m/s")


def _speeds(t: Array, q: Array, limits: Array | None) -> tuple[float, float]:
    """Largest speed relative to its limit, and the largest of all; zero where no joint moves."""
    known = np.full(q.shape[1], SPEED) if limits is None else np.where((limits > 0) & (limits < np.inf), limits, SPEED)
    steps = np.diff(t)
    speed = np.abs(np.diff(q, axis=0)[steps > 0] / steps[steps > 0, None])
    if len(speed) >= SPIKED:
        speed = np.median(sliding_window_view(speed, 5, axis=0), axis=-1)
    moves = np.ptp(q, axis=0) > (TRAVEL if np.median(steps) < ENDLESS else 0)
    return float((speed / known)[:, moves].max(initial=0.0)), float(speed[:, moves].max(initial=0.0))


def velocity_ratio(t: Array, q: Array, qd: Array) -> float:
    """Ratio of velocities to differences of positions, zero where they are uncorrelated."""
    moved, area = np.diff(q, axis=0), np.diff(t)[:, None] * (qd[1:] + qd[:-1]) / 2
    common, a, b = float((moved * area).sum()), float((moved**2).sum()), float((area**2).sum())
    return common / a if abs(common) > AGREE * np.sqrt(a * b) > 0 else 0.0
