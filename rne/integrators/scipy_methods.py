"""SciPy's solvers, one step at a time, and the states inside steps."""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Sequence
from functools import cached_property
from itertools import chain, pairwise
from math import isfinite
from typing import Any, Literal

import numpy as np

from ..basics.spatial import Array
from ..errors import NotFiniteError
from .base import EXPLICIT, FAILURES, IMPLICIT, SAME, Interpolant, Steps

Keeps = Sequence[float] | Literal[True] | None


class SolverSteps(Steps):
    """Steps of one of SciPy's solvers with their interpolants, or one whose interpolant `solver` has until the next."""

    def __init__(self, T: Array, X: Array, solver: Any, interpolants: list[Any]) -> None:
        super().__init__(T, X)
        self._solver, self._kept = solver, interpolants

    @cached_property
    def interpolants(self) -> list[Any]:
        """SciPy's, one for each step, None where none is needed."""
        return self._kept if self._kept != [None] else [self._solver.dense_output()]

    def states(self, times: Array, k: Array) -> Array:
        """States at ascending times within the steps k, shape (m, size)."""
        return _on_polynomials(times, k, self.interpolants)

    def inside(self, k: int) -> Interpolant:
        """SciPy's interpolant itself."""
        return self.interpolants[k]  # type: ignore[no-any-return]


class AdaptiveSolver:
    """One of SciPy's solvers, that can be restarted.

    Parameters
    ----------
    method : str
        Name of a solver of `scipy.integrate`.
    rtol, atol : float
    keeps : sequence of float, True or None
        Times in whose steps interpolants are needed; True: in all; None: each step is returned before the next one.
    """

    def __init__(self, method: str, rtol: float, atol: float, keeps: Keeps = None) -> None:
        self.method, self.rtol, self.atol, self.keeps, self.note = method, rtol, atol, keeps, ""
        self.scipy: Any = None  # SciPy's
        self.failure: Exception | None = None  # of the step after those that were returned

    def start(
        self, system: Any, t: float, x: Array, end: float, longest: float = np.inf, first: float | None = None
    ) -> None:
        """Begin anew at time t; steps are at most `longest` long."""
        import scipy.integrate

        options: dict[str, Any] = {"rtol": self.rtol, "atol": self.atol, "max_step": longest, "first_step": first}
        if self.method in IMPLICIT and system.jacobian is not None:
            options["jac"] = system.jacobian
        self.scipy = getattr(scipy.integrate, self.method)(system, t, x, end, **options)

    def resume(self, system: Any, t: float, x: Array, end: float) -> None:
        """Go on after a jump of the torques: an explicit solver with the length of its last step."""
        if self.scipy is None or self.method not in EXPLICIT:
            first = end - t if self.scipy is None and self.method != "LSODA" else None  # its first step must be short
            return self.start(system, t, x, end, first=first)
        solver = self.scipy  # a Runge-Kutta method stores one slope
        solver.t, solver.y, solver.f = t, np.array(x), system(t, x)
        solver.t_bound, solver.status = end, "running"
        return None

    @property
    def is_running(self) -> bool:
        """False when the end was reached."""
        return self.failure is not None or bool(self.scipy.status == "running")

    def steps(self, most: int) -> Steps:
        """The next steps, at most so many. NotFiniteError if there is none or its end is not finite."""
        if self.failure is not None:
            raise self.failure
        solver, keeps = self.scipy, self.keeps
        asked = keeps if isinstance(keeps, list | tuple) else ()
        T, X, kept = [float(solver.t)], [np.array(solver.y)], []
        while len(T) <= (1 if keeps is None else most) and (len(T) == 1 or solver.status == "running"):
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
            raise NotFiniteError(f"{self.method} gave up: {message}", begin)
        if not isfinite(sum(solver.y.tolist())) and not np.isfinite(solver.y).all():
            raise NotFiniteError(f"state is not finite at t = {solver.t:.6g} s", float(solver.t))


def states_at(times: Array, steps: Sequence[Steps], which: Array, k: Array) -> Array:
    """States at ascending times, each within step k of one of some steps, shape (T, size)."""
    if all(isinstance(one, SolverSteps) for one in steps):
        polynomials = [one.interpolants for one in steps]  # type: ignore[attr-defined]
        first = np.cumsum([0, *map(len, polynomials)])
        return _on_polynomials(times, first[which] + k, [*chain(*polynomials)])
    cuts = [0, *(1 + np.flatnonzero(which[1:] != which[:-1])).tolist(), len(times)]
    return np.concatenate([steps[which[a]].states(times[a:b], k[a:b]) for a, b in pairwise(cuts)])


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
