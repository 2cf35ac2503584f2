"""Events inside a solver's step: crossings of zero that come and go between the ends of the step.

An event is a function of (t, x), negative before it happens and positive after. It is evaluated on the step's
interpolant at NODES points, and around each local maximum between them, so that a value that passes zero and returns is
found.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from ..basics.spatial import Array

NODES = 10  # intervals per step at whose ends events are evaluated
NEXT = 1e-3  # of an interval: distance from the ends of the step of two more points, which show where values rise there
HIGHEST = 4  # how far a peak may lie above the highest point, in units of the rise to it; a parabola's, 1/4
CLOSE = 1e-14  # [s] of the time of an event, beside rounding

Event = Callable[[float, Array], float]
Interpolant = Callable[[Array | float], Array]  # a time gives (size,), times of shape (m,) give (size, m)


class Crossing(NamedTuple):
    """The first event of a step: its place in the list, its time, and the state there."""

    event: int
    t: float
    x: Array


def first_crossing(events: Sequence[Event], interpolant: Interpolant, begin: float, end: float) -> Crossing | None:
    """The first event on a step's interpolant, or None."""
    times = np.linspace(begin, end, NODES + 1)
    near = NEXT * (times[1] - times[0])
    times = np.concatenate([[begin, begin + near], times[1:-1], [end - near, end]])
    states = interpolant(times)
    values = [[event(float(t), x) for event in events] for t, x in zip(times, states.T, strict=True)]
    found = []
    for k, event in enumerate(events):
        bracket = _bracket(event, interpolant, times.tolist(), [row[k] for row in values])
        if bracket is not None:
            found.append((_root(event, interpolant, *bracket), k))
    if not found:
        return None
    t, k = min(found)
    return Crossing(k, t, np.array(interpolant(t)))


def _bracket(
    event: Event, interpolant: Interpolant, times: list[float], values: list[float]
) -> tuple[float, float] | None:
    """Times before and after the first passage from negative to positive."""
    for j in range(len(times) - 1):
        if values[j] <= 0 < values[j + 1]:
            return times[j], times[j + 1]
        is_peak = j > 0 and values[j] < 0 and values[j - 1] <= values[j] >= values[j + 1]
        if is_peak and values[j] + HIGHEST * (values[j] - min(values[j - 1], values[j + 1])) >= 0:
            peak = _peak(event, interpolant, times[j - 1], times[j + 1])
            if event(peak, interpolant(peak)) > 0:
                return times[j - 1], peak
    return None


def _peak(event: Event, interpolant: Interpolant, begin: float, end: float) -> float:
    """Where an event comes closest to happening between two times."""
    from scipy.optimize import minimize_scalar

    found = minimize_scalar(
        lambda t: -event(t, interpolant(t)),
        bounds=(begin, end),
        method="bounded",
        options={"xatol": 1e-10 * (end - begin)},
    )
    return float(found.x)


def _root(event: Event, interpolant: Interpolant, before: float, after: float) -> float:
    """The time of the passage."""
    from scipy.optimize import brentq

    return float(brentq(lambda t: event(t, interpolant(t)), before, after, xtol=CLOSE))
