"""Events inside a solver's steps: crossings of zero that come and go between the ends of a step; the joints' stops.

An event is a function of times and states, negative before it happens and positive after. All are evaluated on the
interpolants of some steps at NODES points of each. An event is searched for only where one may have happened: between
those points and around each local maximum, so that a value that passes zero and returns is found.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from ..basics.spatial import Array
from ..errors import RneError
from ..integrators.base import Interpolant, Steps
from ..model.model import Model

NODES = 10  # intervals per step at whose ends events are evaluated
NEXT = 1e-3  # distance of two more points from the ends of a step, relative to an interval
HIGHEST = 4  # largest height of a peak over the highest point, relative to the rise to it; a parabola's is 1/4
CLOSE = 1e-14  # tolerance of an event's time in addition to rounding [s]
EPS = float(np.finfo(np.float64).eps)
PLACES = np.array([0, NEXT, *range(1, NODES), NODES - NEXT, NODES]) / NODES  # of points in a step, relative

# times (m,), states (m, size), torques that are held where samples were taken, or None -> values (m,)
Event = Callable[[Array, Array, Array | None], Array]


class Crossing(NamedTuple):
    """The first event of some steps: its step, its place in the list of events, its time, and the state there.

    `event` is None where a sample at the end of the step makes a value positive.
    """

    step: int
    event: int | None
    t: float
    x: Array


def first_crossing(events: Sequence[Event], steps: Steps, first: int = 0, last: int | None = None) -> Crossing | None:
    """First event on the interpolants of steps `first` to before `last`, or None."""
    if not events:
        return None
    numbers = np.arange(len(steps.T) - 1)[first:last]
    begins, ends = steps.T[numbers, None], steps.T[numbers + 1, None]
    times = begins + (ends - begins) * PLACES
    times[:, -1:] = ends  # exactly
    try:
        states = steps.states(times.ravel(), np.repeat(numbers, len(PLACES)))
        u = None if steps.U is None else np.repeat(steps.U[numbers], len(PLACES), axis=0)
        values = np.stack([event(times.ravel(), states, u) for event in events], axis=-1)
    except (RneError, ValueError):  # perhaps in a step that an event before it makes void
        if len(numbers) == 1:
            raise
        half = first + len(numbers) // 2
        return first_crossing(events, steps, first, half) or first_crossing(events, steps, half, last)
    values = values.reshape(*times.shape, len(events))
    rises, peaks = _passages(values)
    suspects = np.asarray((rises | peaks).any(axis=1))
    jumped = np.zeros(len(numbers), dtype=bool)
    if steps.U is not None:
        jumped[1:] = (values[1:, 0] > 0).any(axis=1)
    for row in np.flatnonzero(jumped | suspects.any(axis=1)).tolist():
        k = first + row
        if jumped[row]:
            return Crossing(k - 1, None, float(steps.T[k]), steps.X[k])
        found, interpolant = [], steps.inside(k)
        for j in np.flatnonzero(suspects[row]).tolist():
            value = _value(events[j], interpolant, None if steps.U is None else steps.U[k : k + 1])
            passage = _first_passage(value, times[row].tolist(), rises[row, :, j], peaks[row, :, j])
            if passage is not None:
                found.append((passage, j))
        if found:
            t, j = min(found)
            return Crossing(k, j, t, np.array(interpolant(t)))
    return None


def _passages(values: Array) -> tuple[Array, Array]:
    """Intervals of points between which events pass zero in each step, from values (steps, points, events).

    Those that rise from each point to the next, and those that may pass zero and return around it.
    """
    rises = (values[:, :-1] <= 0) & (values[:, 1:] > 0)
    before, here, after = values[:, :-2], values[:, 1:-1], values[:, 2:]
    peaks = np.zeros_like(rises)
    peaks[:, 1:] = (here < 0) & (before <= here) & (here >= after)
    peaks[:, 1:] &= here + HIGHEST * (here - np.minimum(before, after)) >= 0
    return rises, peaks


def _value(event: Event, interpolant: Interpolant, u: Array | None) -> Callable[[float], float]:
    """Value of an event at one time of a step."""
    return lambda t: float(event(np.array([t]), interpolant(t)[None], u)[0])


def _first_passage(value: Callable[[float], float], times: Sequence[float], rises: Array, peaks: Array) -> float | None:
    """Time of the first passage from negative to positive, clipped to the ends of its interval."""
    from scipy.optimize import brentq, minimize_scalar

    for j in np.flatnonzero(rises | peaks).tolist():
        before, after = times[j] if rises[j] else times[j - 1], times[j + 1]
        if peaks[j]:
            width = {"xatol": 1e-10 * (after - before)}
            peak = minimize_scalar(lambda t: -value(t), bounds=(before, after), method="bounded", options=width)
            after = float(peak.x)
            if value(after) <= 0:
                continue
        try:
            return float(brentq(value, before, after, xtol=CLOSE))
        except ValueError:  # of two values of one sign, or of the event itself
            return before if value(before) > 0 else after
    return None


class Stop:
    """One end of a joint's range, for a joint at `multiplier * q[coordinate] + offset`, or at that of its coupling.

    So mimic joints and those that follow by couplings have stops too. As an event it is the distance beyond the stop.
    """

    def __init__(self, model: Model, i: int, bound: float, sign: float) -> None:
        self.joint, self.bound, self.sign = model.moving_joints[i], bound, sign
        self.coordinate = int(model.coordinate[i])
        self.multiplier, self.offset = float(model.multiplier[i]), float(model.offset[i])
        self.follows = next(((drivers, coupling) for k, drivers, coupling in model.coupled_joints if k == i), None)
        self.slack = 4 * EPS * max(1.0, abs(bound))  # a joint at rest on its stop has not just reached it
        self.slope, self.constant = sign * self.multiplier, sign * (self.offset - bound) - self.slack

    def position(self, X: Array) -> Array:
        """The joint's position in states of shape (..., size) [rad or m]."""
        if self.follows:
            drivers, coupling = self.follows
            return np.asarray(coupling.position(X[..., drivers]))
        return self.multiplier * X[..., self.coordinate] + self.offset

    def __call__(self, t: Array, X: Array, u: Array | None = None) -> Array:
        if self.follows:
            return self.sign * (self.position(X) - self.bound) - self.slack
        return self.slope * X[..., self.coordinate] + self.constant

    def message(self, t: float) -> str:
        """The message of a run that ended here."""
        return f"{self.joint!r} reached its stop at {self.bound:.6g} at t = {t:.6g} s"


def stops(model: Model) -> list[Stop]:
    """The stops of every moving joint."""
    ends = [(i, model.upper[i], 1.0) for i in range(len(model.moving_joints))]
    ends += [(i, model.lower[i], -1.0) for i in range(len(model.moving_joints))]
    return [Stop(model, i, float(bound), sign) for i, bound, sign in ends if np.isfinite(bound)]


def check_within_stops(found: Sequence[Stop], x0: Array) -> None:
    """Raise a ValueError for an initial state beyond a stop."""
    for stop in found:
        if stop(np.zeros(()), x0) > 0:
            raise ValueError(
                f"`q0` must be within the stops, got {stop.position(x0):.6g} for joint {stop.joint!r}, "
                f"whose stop is at {stop.bound:.6g}"
            )
