"""SciPy's solvers, one step at a time."""

from __future__ import annotations

from math import isfinite
from typing import Any

import numpy as np

from ..basics.spatial import Array
from ..errors import NotFiniteError
from .events import Interpolant

IMPLICIT = ("Radau", "BDF", "LSODA")
EXPLICIT = ("RK45", "RK23", "DOP853")


class Step:
    """The last step of a solver: its ends, and the state at the end."""

    __slots__ = ("_interpolant", "_solver", "begin", "end", "x")

    def __init__(self, solver: Any, begin: float) -> None:
        self._solver, self._interpolant = solver, None
        self.begin, self.end, self.x = begin, float(solver.t), solver.y.copy()

    @property
    def interpolant(self) -> Interpolant:
        """The states inside the step; to be asked for before the next step."""
        if self._interpolant is None:
            self._interpolant = self._solver.dense_output()
        return self._interpolant  # type: ignore[return-value]


class AdaptiveSolver:
    """One of SciPy's solvers, that can be restarted.

    Parameters
    ----------
    method : str
        Name of a solver of `scipy.integrate`.
    rtol, atol : float
    """

    def __init__(self, method: str, rtol: float, atol: float) -> None:
        self.method, self.rtol, self.atol = method, rtol, atol
        self._solver: Any = None

    def start(
        self, system: Any, t: float, x: Array, end: float, longest: float = np.inf, first: float | None = None
    ) -> None:
        """Begin anew at time t; steps are at most `longest` long."""
        import scipy.integrate

        options: dict[str, Any] = {"rtol": self.rtol, "atol": self.atol, "max_step": longest, "first_step": first}
        if self.method in IMPLICIT and system.jacobian is not None:
            options["jac"] = system.jacobian
        self._solver = getattr(scipy.integrate, self.method)(system, t, x, end, **options)

    def resume(self, system: Any, t: float, x: Array, end: float) -> None:
        """Go on after a jump of the torques: an explicit solver with the length of its last step."""
        if self._solver is None or self.method not in EXPLICIT:
            return self.start(system, t, x, end, first=end - t if self._solver is None else None)
        solver = self._solver  # a Runge-Kutta method stores one slope
        solver.t, solver.y, solver.f = t, np.array(x), system(t, x)
        solver.t_bound, solver.status = end, "running"
        return None

    @property
    def is_running(self) -> bool:
        """False when the end was reached."""
        return bool(self._solver.status == "running")

    def step(self) -> Step:
        """The next step; NotFiniteError if there is none or its end is not finite."""
        solver = self._solver
        begin = float(solver.t)
        message = solver.step()
        if solver.status == "failed":
            raise NotFiniteError(f"{self.method} gave up: {message}", begin)
        if not isfinite(sum(solver.y.tolist())) and not np.isfinite(solver.y).all():
            raise NotFiniteError(f"state is not finite at t = {solver.t:.6g} s", float(solver.t))
        return Step(solver, begin)
