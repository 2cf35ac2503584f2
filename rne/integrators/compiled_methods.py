"""Solvers in machine code, many steps per call, for laws that are traced or held: explicit methods and Rodas5P.

At a state that needs the recursion, SciPy's solver takes one step, or Python runs the loop of Rodas5P for one step; the
recursion's errors have the cause.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property
from itertools import accumulate
from operator import mul
from typing import Any

import numpy as np

from ..basics.piecewise import NO_TABLES
from ..basics.spatial import Array
from ..basics.text import counted
from ..kernels.kernel import Kernel
from . import rosenbrock, runge_kutta
from .base import RODAS, GaveUpError, IntegrationOptions, Interpolant, Sampler, Solver, Steps, System
from .frozen_steps import Function, Holding
from .loops import compiled
from .runge_kutta import CONTINUE, KEEP_LENGTH, RESTART
from .scipy_methods import SciPySolver
from .step_control import Problem, Storage, until_break
from .tableaus import tableau

take_segments, take_samples = compiled(runge_kutta.take_segments), compiled(runge_kutta.take_samples)
add_stages, take_stiff_segments = compiled(runge_kutta.add_stages), compiled(rosenbrock.take_segments)
FIRST = 1e-6  # first step length of Rodas5P to try, relative to the remaining time; steps grow tenfold


class Block(Steps):
    """Steps of a compiled loop, with the stage derivatives K of each step.

    Inputs of the right-hand side are u; where samples were taken between the steps, the first ones were U, (k, n).
    """

    def __init__(
        self, solver: CompiledSolver, T: Array, X: Array, K: Array, u: Array | None, U: Array | None = None
    ) -> None:
        super().__init__(T, X)
        self.solver, self.K, self.u, self.U = solver, K, u, U
        self.interval = solver.interval()

    @property
    def jumps(self) -> list[bool]:
        """True for each step if held inputs change where it begins; the first compares with the last block."""
        if self.U is None:
            return super().jumps
        return [True, *(self.U[1:] != self.U[:-1]).any(axis=1).tolist()]

    @cached_property
    def polynomials(self) -> Array:
        """The coefficients of each step's interpolant, as of Tableau, shape (k, degree, size)."""
        self.solver.extend(self)
        coefficients: Array = np.diff(self.T)[:, None, None] * (self.solver.tableau.D @ self.K[..., : self.X.shape[1]])
        return coefficients

    def _factors(self, s: Any) -> Array:
        """Basis functions of the interpolant at fractions s: s, s (1 - s), s (1 - s) s, ..."""
        return np.array([*accumulate([s if j % 2 == 0 else 1 - s for j in range(self.polynomials.shape[1])], mul)])

    def states(self, times: Array, k: Array) -> Array:
        """States at times within the steps k, shape (m, size)."""
        s = (times - self.T[k]) / (self.T[k + 1] - self.T[k])
        states: Array = self.X[k] + np.einsum("jm,mjn->mn", self._factors(s), self.polynomials[k])
        return states

    def inside(self, k: int) -> Interpolant:
        """The states inside one step."""
        begin, h, x, P = float(self.T[k]), float(self.T[k + 1] - self.T[k]), self.X[k], self.polynomials[k]
        return lambda t: (x + self._factors((t - begin) / h).T @ P).T


class CompiledSolver(Solver):
    """An explicit method whose steps are taken in machine code, many per call.

    The kernel gives the right-hand side, and perhaps further numbers, of time, state and what the system holds. A step
    that the compiled loop cannot take is left to SciPy's solver.
    """

    takes_breaks = True

    def __init__(self, options: IntegrationOptions, kernel: Kernel) -> None:
        super().__init__(options)
        self.kernel, self.rates, self.tableau = kernel, kernel.address(), tableau(options.method)
        self.how, self.by_scipy = RESTART, 0

    def start(self, system: System, t: float, x: Array, end: float, max_step: float = np.inf) -> None:
        """Begin at time t, where no step before says how long the first one is to be."""
        super().start(system, t, x, end, max_step)
        self.how = RESTART

    def resume(self, system: System, t: float, x: Array, end: float) -> None:
        """Restart after the inputs changed, with the last step's length, or the whole interval's if there is none."""
        super().resume(system, t, x, end)
        self.how, self.f = KEEP_LENGTH, np.zeros(system.width)
        self.coefficients = self.kernel.coefficients(system.numbers)

    @property
    def note(self) -> str:  # type: ignore[override]
        """Remark of the method for the message of a run."""
        return "in machine code" + (f", {counted(self.by_scipy, 'step')} by SciPy" if self.by_scipy else "")

    def steps(self, max_steps: int) -> Steps:
        """Next steps, at most this many."""
        work, u = self._storage(max_steps), None if self.system.held is None else np.array(self.system.held)
        problem = Problem(self.rates, self._arguments(u), self.interval())
        taken = take_segments(problem, self.how, work)
        if not taken:
            return self._step_by_scipy(self.end)
        block = self._taken(taken, work, u)
        if self.t in self.options.breaks:  # the derivative there is the one before it
            self.how = RESTART
        return block

    def _arguments(self, u: Array | None) -> tuple[Array, ...]:
        """Arrays for the arguments of the right-hand side."""
        return _arguments(len(self.x), u, self.coefficients, self.system.table)

    def _storage(self, max_steps: int) -> Storage:
        """Arrays for steps, filled with what is known of the first."""
        n, stages = len(self.x), self.tableau.D.shape[1]
        (T, H), X = np.empty((2, max_steps + 1)), np.empty((max_steps + 1, n))
        K, count = np.empty((max_steps, stages, self.system.width)), np.zeros(max_steps, dtype=np.int64)
        T[0], X[0], K[0, 0], H[0] = self.t, self.x, self.f, self.h
        return Storage(T, X, K, H, count, np.empty(n))

    def _taken(self, taken: int, work: Storage, u: Array | None, U: Array | None = None) -> Block:
        """Block of the steps taken; the next one starts at its end."""
        T, X, K, H, count, _ = work
        self.system.evaluations += int(count.sum())
        self.t, self.x, self.h, self.how = float(T[taken]), X[taken], float(H[taken]), CONTINUE
        self.f = K[taken - 1, len(self.tableau.B)]
        return Block(self, T[: taken + 1], X[: taken + 1], K[:taken], u, U)

    def _step_by_scipy(self, end: float) -> Steps:
        self.by_scipy += 1
        solver, part, span = SciPySolver(self.options), until_break(self.interval(), self.t), self.system.span
        first = min(self.h, end - self.t, part.end - self.t) if self.h > 0 else None
        self.system.span = part.first, part.last
        try:
            solver.start(self.system, self.t, self.x, min(end, part.end), self.max_step, first)
            steps = solver.steps(1)
        finally:
            self.system.span = span
        self.t, self.x, self.h, self.how = float(steps.T[-1]), steps.X[-1], float(solver.scipy.h_abs), KEEP_LENGTH
        return steps

    def extend(self, block: Block) -> None:
        """Add the stages that only interpolants need; the recursion evaluates those that the kernel cannot."""
        A, C, system, interval = self.tableau.A2, self.tableau.C2, self.system, block.interval
        if not len(C):
            return
        u = None if block.u is None else block.u.copy()
        U = np.zeros((len(block.K), 0)) if block.U is None else block.U
        system.evaluations += len(C) * len(block.K)
        problem = Problem(self.rates, self._arguments(u), interval)
        if add_stages(problem, block.T, block.X, block.K, U):
            return
        for t, h, x, K, held in zip(block.T, np.diff(block.T), block.X, block.K, U, strict=False):
            if u is not None:
                u[: len(held)] = held
            for s, (a, c) in enumerate(zip(A, C, strict=True), start=len(K) - len(C)):
                time = min(max(t + c * h, interval.first), interval.last)
                K[s, : len(x)] = system.rates(time, x + h * (a[:s] @ K[:s, : len(x)]), u)


class SampledSolver(CompiledSolver):
    """Compiled explicit method with a traced law that is sampled between the steps."""

    takes_samples, takes_breaks = True, False

    def __init__(self, options: IntegrationOptions, kernel: Kernel, sampler: Sampler) -> None:
        super().__init__(options, kernel)
        self.sampler, self.law, self.bounds = sampler, sampler.traced, sampler.bounds()

    def steps(self, max_steps: int) -> Steps:
        """Next steps, at most this many."""
        sampler, n, m = self.sampler, self.bounds.shape[1], len(self.sampler.state)
        work, u = self._storage(max_steps), np.array(self.system.held)
        moving, (law, holding) = self.law.widths[1] - m, self._sampling()
        (begun, came), (U, W) = np.empty((2, max_steps + 1), np.int64), np.empty((2, max_steps + 1, n))
        Z, timing, number = np.empty((max_steps + 1, m)), (sampler.period, *sampler.delay), np.zeros(2, np.int64)
        problem = Problem(self.rates, self._arguments(u), self.interval())
        held = runge_kutta.HeldCommands(number, begun, came, U, W, Z, np.empty(n))
        taken = take_samples(law, holding, problem, timing, self.how, work, held)
        begun, came = begun[: number[0]], came[: number[1]]
        last = max((*begun[-1:], *came[-1:]), default=-1)
        if last >= 0:
            samples = work.T[begun], work.X[begun, :moving], W[: len(begun)], Z[: len(begun)]
            acting = (work.T[came], work.X[came, :moving], U[came]) if any(sampler.delay) else samples[:3]
            sampler.note(samples, acting, holding.states, self.system.evaluations + int(work.evaluations[:last].sum()))
        if taken:
            block = self._taken(taken, work, u, U[:taken])
            if last == taken:  # the derivative there is the one before the sample
                self.how = KEEP_LENGTH
            return block
        if self.t >= sampler.next:
            sampler.renew(self.t, self.x)
        return self._step_by_scipy(min(sampler.next, self.end))

    def _sampling(self) -> tuple[Function, Holding]:
        """Law, and what is held between its samples, for loops."""
        sampler, law, table = self.sampler, self.law, self.sampler.law_table
        given = _arguments(law.widths[1], None, law.coefficients(sampler.numbers), table)
        tables, found = table[None] if len(table) else NO_TABLES, np.empty(law.traced.entries)
        function = Function(law.address(), given, found, tables, len(given) - 2, np.zeros(1))
        states, counts = np.stack([sampler.state, sampler.next_state]), np.array([sampler.count, sampler.arrived])
        return function, Holding(sampler.update, self.bounds, sampler.pending, states, counts)


class RosenbrockSteps(Steps):
    """Steps of Rodas5P, with the vectors of their interpolants."""

    def __init__(self, T: Array, X: Array, vectors: Array) -> None:
        super().__init__(T, X)
        self.vectors = vectors

    def states(self, times: Array, k: Array) -> Array:
        """States at times within the steps k, shape (T, size)."""
        s = ((times - self.T[k]) / (self.T[k + 1] - self.T[k]))[:, None]
        return rosenbrock.inside(self.X[k], self.X[k + 1], self.vectors[k], s)


class RosenbrockSolver(Solver):
    """Rodas5P, many steps per call, by the system's implicit equations; see `rosenbrock`."""

    takes_breaks = True

    def __init__(self, options: IntegrationOptions, system: System) -> None:
        super().__init__(options)
        (self.n, self.slopes), self.tableau = system.implicit, rosenbrock.TABLEAU
        self.functions: tuple[Any, Any] = (system.kernel.address(), self.slopes.address())

    def steps(self, max_steps: int) -> Steps:
        """Next steps, at most this many; NotFiniteError if there is none."""
        steps = self._take(max_steps, take_stiff_segments, self.functions)
        if len(steps.T) == 1:
            with np.errstate(all="ignore"):
                steps = self._take(1, rosenbrock.take_segments, (self._rates, self._slopes))
        if len(steps.T) == 1:
            raise GaveUpError(f"{RODAS} gave up: steps would be shorter than the rounding of times", self.t)
        return steps

    def _take(self, max_steps: int, loop: Callable[..., int], functions: tuple[Any, Any]) -> Steps:
        system, n, size, count = self.system, self.n, len(self.x), np.zeros(2, dtype=np.int64)
        (T, H), X, P = np.empty((2, max_steps + 1)), np.empty((max_steps + 1, size)), np.empty((max_steps, 3, size))
        work = rosenbrock.workspace(n, system.counted, size)
        T[0], X[0], H[0] = self.t, self.x, self.h or FIRST * (self.end - self.t)
        u, numbers = None if system.held is None else np.array(system.held), system.numbers
        time, x, *given, _ = arguments = _arguments(size, u, system.kernel.coefficients(numbers), system.table)
        slopes = functions[1], (time, x, np.empty(n), *given, self.slopes.coefficients(numbers))
        taken = loop(Problem(functions[0], arguments, self.interval()), slopes, Storage(T, X, P, H, count, work))
        system.evaluations += int(count[0]) + system.counted * int(count[1])
        self.t, self.x, self.h = float(T[taken]), X[taken], float(H[taken])
        return RosenbrockSteps(T[: taken + 1], X[: taken + 1], P[:taken])

    def _rates(self, t: Array, x: Array, *rest: Array) -> bool:
        """Write dx/dt for held inputs into the last array."""
        rest[-1][:] = self.system.rates(float(t[0]), x, None if self.system.held is None else rest[0])
        return True

    def _slopes(self, *arguments: Array) -> bool:
        """Write the derivatives of the equations of motion into the last array."""
        arguments[-1][:] = self.slopes(*arguments[:-2], self.system.numbers)
        return True


def _arguments(size: int, u: Array | None, coefficients: Array, table: Array) -> tuple[Array, ...]:
    """Arrays for a function's arguments: t, x, inputs and piece if any, and the coefficients of the numbers."""
    piece = (np.full(table.shape[1], np.nan),) if len(table) else ()
    return (np.empty(1), np.empty(size), *(() if u is None else (u,)), *piece, coefficients)
