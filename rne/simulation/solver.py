"""SciPy's solvers, one step at a time, and the states inside steps."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cached_property
from itertools import pairwise
from math import isfinite
from typing import Any

import numpy as np

from ..basics.spatial import Array
from ..errors import NotFiniteError

Interpolant = Callable[[Array | float], Array]  # a time gives (size,), times of shape (m,) give (size, m)

IMPLICIT = ("Radau", "BDF", "LSODA")
EXPLICIT = ("RK45", "RK23", "DOP853")
RODAS, GAUSS = "Rodas5P", "gauss-4"  # the methods that are not SciPy's


class Steps:
    """Steps of a solver that follow one another, and the motion inside them.

    Parameters
    ----------
    T : ndarray, shape (k + 1,)
        The ends of the steps [s].
    X : ndarray, shape (k + 1, size)
        The states there.
    """

    U: Array | None = None  # torques held in each step, where samples were taken between them

    def __init__(self, T: Array, X: Array) -> None:
        self.T, self.X = T, X

    def states(self, times: Array, k: Array) -> Array:
        """States at times within the steps numbered k, shape (m, size)."""
        raise NotImplementedError

    def keep(self) -> None:
        """Make what the interpolants need, while the solver still has it."""

    @property
    def jumps(self) -> list[bool]:
        """Whether torques that are held change where a step begins, of k steps."""
        return [False] * (len(self.T) - 1)

    def inside(self, k: int) -> Interpolant:
        """The states inside one step: (size,) at a time, (size, m) at times of shape (m,)."""

        def interpolant(t: Array | float) -> Array:
            times = np.asarray(t, dtype=np.float64)
            states = self.states(times.reshape(-1), np.full(times.size, k)).T
            return states if times.ndim else states[:, 0]

        return interpolant


class SolverStep(Steps):
    """The last step of one of SciPy's solvers; its interpolant is to be asked for before the next step."""

    def __init__(self, solver: Any, begin: float, x: Array) -> None:
        super().__init__(np.array([begin, solver.t]), np.array([x, solver.y]))
        self._solver = solver

    @cached_property
    def interpolant(self) -> Any:
        """SciPy's."""
        return self._solver.dense_output()

    def keep(self) -> None:
        """Ask for the interpolant."""
        _ = self.interpolant

    def states(self, times: Array, k: Array) -> Array:
        """States at times within the step."""
        found: Array = self.interpolant(times).T
        return found

    def inside(self, k: int) -> Interpolant:
        """SciPy's interpolant itself."""
        return self.interpolant  # type: ignore[no-any-return]


class AdaptiveSolver:
    """One of SciPy's solvers, that can be restarted.

    Parameters
    ----------
    method : str
        Name of a solver of `scipy.integrate`.
    rtol, atol : float
    """

    def __init__(self, method: str, rtol: float, atol: float) -> None:
        self.method, self.rtol, self.atol, self.note = method, rtol, atol, ""
        self.scipy: Any = None  # SciPy's

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
        return bool(self.scipy.status == "running")

    def steps(self, most: int) -> Steps:
        """The next steps, at most so many: one. NotFiniteError if there is none or its end is not finite."""
        solver = self.scipy
        begin, x = float(solver.t), np.array(solver.y)
        message = solver.step()
        if solver.status == "failed":
            raise NotFiniteError(f"{self.method} gave up: {message}", begin)
        if not isfinite(sum(solver.y.tolist())) and not np.isfinite(solver.y).all():
            raise NotFiniteError(f"state is not finite at t = {solver.t:.6g} s", float(solver.t))
        return SolverStep(solver, begin, x)


def states_at(times: Array, steps: Sequence[Steps], which: Array, k: Array) -> Array:
    """States at ascending times, each within step k of one of some steps, shape (T, size)."""
    if all(hasattr(getattr(one, "interpolant", None), "yh") for one in steps):
        return _of_powers(times, which, [one.interpolant for one in steps])  # type: ignore[attr-defined]
    cuts = [0, *(1 + np.flatnonzero(which[1:] != which[:-1])).tolist(), len(times)]
    return np.concatenate([steps[which[a]].states(times[a:b], k[a:b]) for a, b in pairwise(cuts)])


def _of_powers(times: Array, which: Array, polynomials: list[Any]) -> Array:
    """States on LSODA's interpolants, sums of yh_j ((t - t_n) / h)^j, all at once: one by one they take as long as the
    steps."""
    most = max(p.yh.shape[1] for p in polynomials)
    coefficients = np.zeros((len(polynomials), len(polynomials[0].yh), most))
    for k, p in enumerate(polynomials):
        coefficients[k, :, : p.yh.shape[1]] = p.yh
    t, h = (np.array([getattr(p, name) for p in polynomials])[which] for name in ("t", "h"))
    powers = ((times - t) / h)[:, None] ** np.arange(most)
    states: Array = np.einsum("tnj,tj->tn", coefficients[which], powers)
    return states
