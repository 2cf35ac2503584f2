"""The instants of a run that are reported: those asked for, or the solver's steps."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..basics.spatial import Array
from .solver import Steps

SAME = 8 * float(np.finfo(np.float64).eps)  # relative: times that are equal up to rounding


class Record:
    """Times and states in ascending order; where something jumps, those after the jump.

    Parameters
    ----------
    t_eval : ndarray, shape (T,), or None
        Times to report; None for the beginnings of segments and the ends of steps.
    size : int
        Length of the state.
    same : float
        Relative: times that far before a sample are there.
    """

    def __init__(self, t_eval: Array | None, size: int, same: float = SAME) -> None:
        self.t_eval, self.size, self.same = t_eval, size, same
        self.parts: list[tuple[Array, Array, Array | None]] = []  # times, states, accelerations where they are given
        self.asked = 0  # times of `t_eval` that were reported

    @property
    def last(self) -> float:
        """The last time so far."""
        return float(self.parts[-1][0][-1]) if self.parts else -np.inf

    def arrays(self) -> tuple[Array, Array, Array | None]:
        """Times (T,), states (T, size) and, where they are given, accelerations (T, n)."""
        if not self.parts:
            return np.zeros(0), np.zeros((0, self.size)), None
        t, x, qdd = zip(*self.parts, strict=True)
        return np.concatenate(t), np.concatenate(x), None if qdd[0] is None else np.concatenate(qdd)

    def begin(self, t: float, x: Array, system: Any) -> None:
        """A segment begins."""
        if self.t_eval is None:
            self.add(np.array([t]), x[None], system)

    def take(self, steps: Steps, count: int, end: float, x: Array, system: Any) -> None:
        """So many steps were taken, the last as far as `end`, where the state is x."""
        if self.t_eval is None:
            before = slice(1, count)
            return self.add(np.append(steps.T[before], end), np.concatenate([steps.X[before], x[None]]), system)
        first, self.asked = self.asked, int(np.searchsorted(self.t_eval, end * (1 - SAME), side="left"))
        times = self.t_eval[first : self.asked]
        if len(times):
            self.add(times, steps.states(times, np.searchsorted(steps.T[1:count], times)), system)
        return None

    def finish(self, t: float, x: Array, system: Any, *, stopped: bool) -> None:
        """The run ends: the last instant, if it is asked for or a stop."""
        times = np.array([t]) if self.t_eval is None else self.t_eval[self.asked :]
        if self.t_eval is not None:
            times = times[times <= t * (1 + SAME)]
        if len(times):
            self.add(times, np.repeat(x[None], len(times), axis=0), system)
        if stopped and not self.last >= t:
            self.add(np.array([t]), x[None], system)

    def cut(self, end: float) -> None:
        """Forget what follows."""
        t, x, qdd = self.arrays()
        here = t <= end
        self.parts = [(t[here], x[here], None if qdd is None else qdd[here])] if here.any() else []

    def add(self, t: Array, x: Array, system: Any) -> None:
        """Instants that follow those before, of which the last gives way if it is not earlier."""
        while self.parts and self.last >= t[0]:
            before, states, qdd = self.parts.pop()
            if len(before) > 1:
                self.parts.append((before[:-1], states[:-1], None if qdd is None else qdd[:-1]))
        if system.at_rest is not None:
            x = x.copy()
            x[:, system.at_rest] = 0.0
        self.parts.append((t, x, system.accelerations_at(t, x, self.same)))
