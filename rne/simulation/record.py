"""The instants of a run that are reported: those asked for, or the solver's steps, or a controller's samples."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from ..basics.spatial import Array
from .solver import Step, states_at

SAME = 8 * float(np.finfo(np.float64).eps)  # relative: times that are equal up to rounding


class Instant(NamedTuple):
    """What is reported of one instant.

    Held torques and their work, a sampled controller's states, and accelerations, where they apply.
    """

    t: float
    x: Array
    held: Array | None
    work: float
    controller_state: Array | None
    qdd: Array | None


class Record:
    """Instants in ascending order; where something jumps, the values after the jump.

    Parameters
    ----------
    t_eval : ndarray, shape (T,), or None
        Times to report; None for the beginnings of segments and, with `every_step`, the ends of steps.
    every_step : bool
    """

    def __init__(self, t_eval: Array | None, every_step: bool) -> None:
        self.t_eval, self.every_step = t_eval, every_step
        self.instants: list[Instant] = []
        self.asked = 0  # times of `t_eval` that were reported

    @property
    def takes_steps(self) -> bool:
        """True if the end of every step is reported."""
        return self.t_eval is None and self.every_step

    @property
    def t(self) -> Array:
        """The times so far."""
        return np.array([instant.t for instant in self.instants])

    def begin(self, t: float, x: Array, loop: Any) -> None:
        """A segment begins."""
        if self.t_eval is None:
            self._add(t, x, loop)

    def take(self, steps: Sequence[Step], end: float, x: Array, loop: Any) -> None:
        """Steps were taken, the last as far as `end`, where the state is x."""
        if self.t_eval is None:
            if self.every_step:
                for step in steps[:-1]:
                    self._add(step.end, step.x, loop)
                self._add(end, x, loop)
            return
        first, self.asked = self.asked, int(np.searchsorted(self.t_eval, end * (1 - SAME), side="left"))
        times = self.t_eval[first : self.asked]
        if len(times):
            for t, state in zip(times.tolist(), states_at(times, steps), strict=True):
                self._add(t, state, loop)

    def finish(self, t: float, x: Array, loop: Any, *, stopped: bool) -> None:
        """The run ends: the last instant, if it is asked for or a stop."""
        if self.t_eval is None:
            self._add(t, x, loop)
            return
        for time in self.t_eval[self.asked :]:
            if time <= t * (1 + SAME):
                self._add(float(time), x, loop)
        if stopped and not (self.instants and self.instants[-1].t >= t):
            self._add(t, x, loop)

    def cut(self, end: float) -> None:
        """Forget what follows."""
        self.instants = [instant for instant in self.instants if instant.t <= end]

    def _add(self, t: float, x: Array, loop: Any) -> None:
        instants, system, held = self.instants, loop.system, loop.plant.held
        if instants and instants[-1].t >= t:
            instants.pop()
        z = None if loop.hold is None else loop.hold.state
        work = 0.0 if held is None else loop.work(x)
        instants.append(Instant(t, system.reported(x), held, work, z, system.accelerations_at(t, x)))
