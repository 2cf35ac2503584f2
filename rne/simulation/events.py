"""Events inside a solver's step: crossings of zero that come and go between the ends of the step.

An event is a function of (t, x) with attributes `terminal` and `direction`, as of SciPy's solve_ivp: it happens where
its value passes zero in that direction. SciPy compares the ends of a step only. Here the step's interpolant is examined
at NODES points, and around each local extremum between them, so that a value that passes zero and returns is found.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np

from ..basics.spatial import Array

NODES = 10  # intervals per step at whose ends events are evaluated
NEXT = 1e-3  # of an interval: distance from the ends of the step of two more points, which show where values rise there
HIGHEST = 4  # how far a peak may lie above the highest point, in units of the rise to it; a parabola's, 1/4
Interpolant = Callable[[float], Array]


class Crossing(NamedTuple):
    """The first event inside a step: its place in the list, and times before and after it, close to each other."""

    event: int
    before: float
    after: float


def first_crossing(events: Sequence[Any], interpolant: Interpolant, begin: float, end: float) -> Crossing | None:
    """The first crossing of an event on a step's interpolant, or None."""
    if not events:
        return None
    times = np.linspace(begin, end, NODES + 1)
    near = NEXT * (times[1] - times[0])
    times = np.concatenate([[begin, begin + near], times[1:-1], [end - near, end]])
    values = np.array([_values(events, interpolant, float(t)) for t in times])
    found = [_crossing(k, event, interpolant, times, values[:, k]) for k, event in enumerate(events)]
    return min((crossing for crossing in found if crossing is not None), key=lambda c: c.after, default=None)


def _values(events: Sequence[Any], interpolant: Interpolant, t: float) -> list[float]:
    """Every event at one time, negative before it happens and positive after."""
    x = interpolant(t)
    return [event.direction * event(t, x) for event in events]


def _crossing(k: int, event: Any, interpolant: Interpolant, times: Array, values: Array) -> Crossing | None:
    """The first passage of one event from negative to positive."""
    for j in range(len(times) - 1):
        if values[j] <= 0 < values[j + 1]:
            return Crossing(k, float(times[j]), float(times[j + 1]))
        is_peak = j > 0 and values[j] < 0 and values[j - 1] <= values[j] >= values[j + 1]
        if is_peak and values[j] + HIGHEST * (values[j] - min(values[j - 1], values[j + 1])) >= 0:
            peak = _peak(event, interpolant, float(times[j - 1]), float(times[j + 1]))
            if event.direction * event(peak, interpolant(peak)) > 0:
                return Crossing(k, float(times[j - 1]), peak)
    return None


def _peak(event: Any, interpolant: Interpolant, begin: float, end: float) -> float:
    """Where an event comes closest to happening between two times."""
    from scipy.optimize import minimize_scalar

    found = minimize_scalar(
        lambda t: -event.direction * event(t, interpolant(t)),
        bounds=(begin, end),
        method="bounded",
        options={"xatol": 1e-10 * (end - begin)},
    )
    return float(found.x)
