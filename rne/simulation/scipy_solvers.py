"""SciPy's solvers with failures caught, and with steps split where an event happens inside them.

An error inside a step ends the run and keeps the motion so far.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from ..basics.spatial import Array
from ..errors import NotFiniteError, SingularMassMatrixError
from .events import first_crossing

FAILURES = (NotFiniteError, SingularMassMatrixError)


def guarded_solver(
    method: str, failures: list[tuple[float, str]], last: list[Array], events: Sequence[Any] = ()
) -> Any:
    """A subclass of one of SciPy's OdeSolver classes that reports a failed step as status 'failed'.

    Parameters
    ----------
    method : str
        Name of a solver of `scipy.integrate`.
    failures : list
        Receives (time, cause) of a failure.
    last : list of one ndarray
        Holds the state after the last successful step.
    events : sequence of callable
        A step in which one of these happens is handed out in parts, cut shortly before and after it, so that
        solve_ivp, which compares the ends of a step, sees it.
    """
    import scipy.integrate

    base = getattr(scipy.integrate, method)

    class GuardedSolver(base):  # type: ignore[misc, valid-type]
        t: float
        t_old: float
        y: Array
        status: str
        parts: tuple[tuple[float, Array], ...] = ()  # of the last step, still to be handed out
        interpolant: Any = None

        def step(self) -> str | None:
            if self.parts:
                self._hand_out()
                return None
            self.interpolant = None
            try:
                message: str | None = super().step()
                if self.status != "failed" and np.isfinite(self.y).all():
                    last[0] = np.array(self.y)
                    if events:
                        self._cut()
                    return message
            except FAILURES as error:
                return self._fail(getattr(error, "time", None), str(error))
            if self.status != "failed":
                return self._fail(None, f"state is not finite at t = {self.t:.6g} s")
            failures.append((float(self.t), f"{method} gave up: {message}"))
            return message

        def _cut(self) -> None:
            """Cut the step where an event happens inside it."""
            begin, end = self.t_old, self.t
            self.interpolant = super().dense_output()
            crossing = first_crossing(events, self.interpolant, begin, end)
            if crossing is None or crossing.after >= end:
                return
            cuts = [t for t in (crossing.before, crossing.after) if begin < t]
            self.parts = (*((t, np.asarray(self.interpolant(t))) for t in cuts), (end, np.array(self.y)))
            self.t = begin
            self._hand_out()

        def _hand_out(self) -> None:
            self.t_old = self.t
            (self.t, self.y), *rest = self.parts
            self.parts = tuple(rest)
            at_end = self.t == self.t_bound
            self.status = "finished" if at_end else "running"

        def dense_output(self) -> Any:
            return super().dense_output() if self.interpolant is None else self.interpolant

        def _fail(self, time: float | None, cause: str) -> str:
            self.status = "failed"
            failures.append((float(self.t if time is None else time), cause))
            return cause

    GuardedSolver.__name__ = method
    return GuardedSolver
