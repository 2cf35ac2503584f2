"""SciPy's solvers, one step at a time, and the states inside steps."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from math import isfinite
from typing import Any

import numpy as np

from ..basics.spatial import Array
from ..errors import NotFiniteError

Interpolant = Callable[[Array | float], Array]  # a time gives (size,), times of shape (m,) give (size, m)

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

    def steps(self, most: int) -> Sequence[Step]:
        """The next steps, at most so many: one."""
        return [self.step()]

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


def states_at(times: Array, spans: Sequence[Any]) -> Array:
    """States at ascending times within steps, or parts of steps, on their interpolants, shape (T, size)."""
    which = np.searchsorted([span.end for span in spans[:-1]], times)
    polynomials = [span.interpolant for span in spans]
    if all(hasattr(p, "yh") for p in polynomials):
        return _of_powers(times, which, polynomials)
    if all(hasattr(p, "block") for p in polynomials):
        return _of_blocks(times, which, polynomials)
    used, firsts = np.unique(which, return_index=True)
    cuts = [*firsts.tolist(), len(times)]
    parts = [polynomials[k](times[a:b]) for k, a, b in zip(used.tolist(), cuts, cuts[1:], strict=False)]
    return np.array(np.concatenate(parts, axis=1).T)


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


def _of_blocks(times: Array, which: Array, polynomials: list[Any]) -> Array:
    """States within steps that a compiled loop took, those of each block at once."""
    blocks = {id(p.block): p.block for p in polynomials}
    number = np.array([id(p.block) for p in polynomials])[which]
    steps = np.array([p.k for p in polynomials])[which]
    asked = [(block, number == k) for k, block in blocks.items() if (number == k).any()]
    states: Array = np.concatenate([block.states(times[here], steps[here]) for block, here in asked])
    return states
