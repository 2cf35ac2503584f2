"""SciPy's solvers with failures caught: an error inside a step ends the run and keeps the motion so far."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..basics.spatial import Array
from ..errors import NotFiniteError, SingularMassMatrixError

FAILURES = (NotFiniteError, SingularMassMatrixError)


def guarded_solver(method: str, failures: list[tuple[float, str]], last: list[Array]) -> Any:
    """A subclass of one of SciPy's OdeSolver classes that reports a failed step as status 'failed'.

    Parameters
    ----------
    method : str
        Name of a solver of `scipy.integrate`.
    failures : list
        Receives (time, cause) of a failure.
    last : list of one ndarray
        Holds the state after the last successful step.
    """
    import scipy.integrate

    base = getattr(scipy.integrate, method)

    class GuardedSolver(base):  # type: ignore[misc, valid-type]
        def step(self) -> str | None:
            try:
                message: str | None = super().step()
            except FAILURES as error:
                return self._fail(getattr(error, "time", None), str(error))
            if self.status != "failed" and not np.isfinite(self.y).all():
                return self._fail(None, f"state is not finite at t = {self.t:.6g} s")
            if self.status == "failed":
                failures.append((float(self.t), f"{method} gave up: {message}"))
            else:
                last[0] = np.array(self.y)
            return message

        def _fail(self, time: float | None, cause: str) -> str:
            self.status = "failed"
            failures.append((float(self.t if time is None else time), cause))
            return cause

    GuardedSolver.__name__ = method
    return GuardedSolver
