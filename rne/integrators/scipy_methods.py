"""SciPy's solvers, one step at a time, and the states inside steps."""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Sequence
from functools import cached_property
from math import isfinite
from typing import Any, Literal

import numpy as np

from ..basics.spatial import Array
from ..errors import NotFiniteError
from .base import FAILURES, IMPLICIT, SAME, GaveUpError, IntegrationOptions, Interpolant, Solver, Steps, System
from .step_control import EPS
from .tableaus import scipy_class

Keeps = Sequence[float] | Literal[True] | None
SMALLEST_RTOL = 100 * EPS  # smallest relative tolerance of SciPy's solvers


class SolverSteps(Steps):
    """Steps of one of SciPy's solvers with their interpolants; a single step may leave its own in `solver`."""

    def __init__(self, T: Array, X: Array, solver: Any, interpolants: list[Any]) -> None:
        super().__init__(T, X)
        self._solver, self._kept = solver, interpolants

    @cached_property
    def interpolants(self) -> list[Any]:
        """Interpolants of SciPy, one for each step, None where none is needed."""
        return self._kept if self._kept != [None] else [self._solver.dense_output()]

    def states(self, times: Array, k: Array) -> Array:
        """States at ascending times within the steps k, shape (m, size)."""
        return _on_polynomials(times, k, self.interpolants)

    def inside(self, k: int) -> Interpolant:
        """SciPy's interpolant of a step."""
        interpolant: Interpolant = self.interpolants[k]
        return interpolant


class SciPySolver(Solver):
    """One of SciPy's solvers, or a user's tableau in its RK45.

    Interpolants are needed in the steps of some times that it `keeps`, in all if that is True; with None each step is
    returned before the next one.
    """

    def __init__(self, options: IntegrationOptions, keeps: Keeps = None) -> None:
        super().__init__(options)
        self.method, self.keeps, self.note = options.method, keeps, ""
        self.scipy: Any = None  # SciPy's
        self.failure: Exception | None = None  # of the step after those that were returned

    def start(
        self, system: System, t: float, x: Array, end: float, max_step: float = np.inf, first: float | None = None
    ) -> None:
        """Begin at time t; steps are at most `max_step` long."""
        options: dict[str, Any] = {"max_step": max_step, "first_step": first}
        options |= _tolerances(self.options, system, len(x))
        if self.method in IMPLICIT:
            options["jac"] = system.jacobian
        self.scipy = scipy_class(self.method)(system, t, x, end, **options)

    def resume(self, system: System, t: float, x: Array, end: float) -> None:
        """Continue after a jump of the inputs: an explicit solver with the length of its last step."""
        if self.scipy is None or self.method in IMPLICIT:
            first = end - t if self.scipy is None and self.method != "LSODA" else None  # its first step must be short
            return self.start(system, t, x, end, first=first)
        solver = self.scipy  # a Runge-Kutta method stores one derivative
        solver.t, solver.y, solver.f = t, np.array(x), system(t, x)
        solver.t_bound, solver.status = end, "running"
        return None

    @property
    def is_running(self) -> bool:
        """False at the end of the interval."""
        return self.failure is not None or bool(self.scipy.status == "running")

    def steps(self, max_steps: int) -> Steps:
        """Next steps, at most this many; NotFiniteError if there is none or its end is not finite."""
        if self.failure is not None:
            raise self.failure
        solver, keeps = self.scipy, self.keeps
        asked = keeps if isinstance(keeps, list | tuple) else ()
        T, X, kept = [float(solver.t)], [np.array(solver.y)], []
        while len(T) <= (1 if keeps is None else max_steps) and (len(T) == 1 or solver.status == "running"):
            try:
                self._step()
                first, last = (bisect_left(asked, t * (1 - SAME)) for t in (T[-1], float(solver.t)))
                kept.append(solver.dense_output() if keeps is True or last > first else None)
            except FAILURES as error:
                if len(T) == 1:
                    raise
                self.failure = error
                break
            T.append(float(solver.t))
            X.append(solver.y)
        return SolverSteps(np.array(T), np.array(X), solver, kept)

    def _step(self) -> None:
        """One step of SciPy's solver."""
        solver = self.scipy
        begin, message = float(solver.t), solver.step()
        if solver.status == "failed":
            raise GaveUpError(f"{self.method} gave up: {message}", begin)
        if not isfinite(sum(solver.y.tolist())) and not np.isfinite(solver.y).all():
            raise NotFiniteError(f"state is not finite at t = {solver.t:.6g} s", float(solver.t))


def _tolerances(options: IntegrationOptions, system: System, size: int) -> dict[str, Any]:
    """Tolerances of SciPy's solvers: those of integrals include `integral_scale`.

    The norm is a root mean square over all components, which is made one over those that count, and LSODA's a maximum.
    """
    counted = system.counted
    if counted == size:
        return {"rtol": options.rtol, "atol": options.atol}
    allowed = options.rtol * system.integral_scale
    share = 1.0 if options.method == "LSODA" else (counted / size) ** 0.5
    return {
        "rtol": max(share * options.rtol, SMALLEST_RTOL),
        "atol": np.append(np.full(counted, share * options.atol), np.full(size - counted, share * allowed)),
    }


def _on_polynomials(times: Array, which: Array, given: Sequence[Any]) -> Array:
    """States on SciPy's interpolants.

    Those of LSODA, sums of yh_j ((t - t_n) / h)^j, all at once: one by one they take as long as the steps.
    """
    numbers, which = np.unique(which, return_inverse=True)
    polynomials = [given[number] for number in numbers.tolist()]
    if not all(hasattr(p, "yh") for p in polynomials):
        of_each = np.split(times, 1 + np.flatnonzero(np.diff(which)))
        return np.concatenate([p(t).T for p, t in zip(polynomials, of_each, strict=True)])
    most = max(p.yh.shape[1] for p in polynomials)
    coefficients = np.zeros((len(polynomials), len(polynomials[0].yh), most))
    for k, p in enumerate(polynomials):
        coefficients[k, :, : p.yh.shape[1]] = p.yh
    t, h = (np.array([getattr(p, name) for p in polynomials])[which] for name in ("t", "h"))
    powers = ((times - t) / h)[:, None] ** np.arange(most)
    states: Array = np.einsum("tnj,tj->tn", coefficients[which], powers)
    return states
