"""Solvers in machine code, many steps per call, for laws that are traced or held: RK45, DOP853 and Rodas5P.

What a compiled loop cannot decide, a state that must be examined, is one step by SciPy's solver, or of Rodas5P one of
the same loop run by the interpreter around the recursion, which names what is wrong.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property
from itertools import accumulate
from operator import mul
from typing import Any

import numpy as np

from ..basics.spatial import Array
from ..errors import NotFiniteError
from ..kernels.kernel import Kernel
from . import rosenbrock, runge_kutta
from .base import RODAS, Interpolant, Sampler, Steps, System
from .loops import compiled
from .runge_kutta import AFTER_A_JUMP, ANEW, GO_ON, Limits, power, tableau
from .scipy_methods import AdaptiveSolver

take_steps, take_samples = compiled(runge_kutta.take_steps), compiled(runge_kutta.take_samples)
add_stages, add_sampled_stages = compiled(runge_kutta.add_stages), compiled(runge_kutta.add_sampled_stages)
take_stiff_steps = compiled(rosenbrock.take_steps)
FIRST = 1e-6  # of the time to go: a first step of Rodas5P to try, from which they grow tenfold


class Block(Steps):
    """Steps of a compiled loop.

    Parameters
    ----------
    solver : CompiledSolver
    T, X : ndarray
        As of Steps.
    K : ndarray, shape (k, stages, size)
        The slopes of each step's stages.
    u : ndarray or None
        What the right-hand side took beside time and state: torques that are held, and modes of friction.
    U : ndarray, shape (k, n), optional
        The torques held in each step, where samples were taken between them.
    """

    def __init__(
        self, solver: CompiledSolver, T: Array, X: Array, K: Array, u: Array | None, U: Array | None = None
    ) -> None:
        super().__init__(T, X)
        self.solver, self.K, self.u, self.U = solver, K, u, U
        self.span = solver.system.span

    @property
    def jumps(self) -> list[bool]:
        """Whether torques that are held change where a step begins; at the first, whatever was held before."""
        if self.U is None:
            return super().jumps
        return [True, *(self.U[1:] != self.U[:-1]).any(axis=1).tolist()]

    @cached_property
    def polynomials(self) -> Array:
        """The coefficients of each step's interpolant, as SciPy's, shape (k, degree, size): F of DOP853, Q of RK45."""
        from scipy.integrate import DOP853, RK45

        h, K = np.diff(self.T)[:, None], self.K
        if self.solver.method == "RK45":
            Q: Array = h[:, None] * (RK45.P.T @ K)
            return Q
        self.solver.extend(self)
        change, first, last = np.diff(self.X, axis=0), h * K[:, 0], h * K[:, DOP853.n_stages]
        low = np.stack([change, first - change, 2 * change - first - last], axis=1)
        return np.concatenate([low, h[:, None] * (DOP853.D @ K)], axis=1)

    def _factors(self, s: Any) -> Array:
        """What multiplies the coefficients at fractions s: s, s^2, ... of RK45, s, s (1 - s), s (1 - s) s, ..."""
        is_power = self.solver.method == "RK45"
        turns = [s if is_power or j % 2 == 0 else 1 - s for j in range(self.polynomials.shape[1])]
        return np.array(list(accumulate(turns, mul)))

    def states(self, times: Array, k: Array) -> Array:
        """States at times within the steps k, shape (m, size)."""
        s = (times - self.T[k]) / (self.T[k + 1] - self.T[k])
        states: Array = self.X[k] + np.einsum("jm,mjn->mn", self._factors(s), self.polynomials[k])
        return states

    def inside(self, k: int) -> Interpolant:
        """The states inside one step."""
        begin, h, x, P = float(self.T[k]), float(self.T[k + 1] - self.T[k]), self.X[k], self.polynomials[k]
        return lambda t: (x + self._factors((t - begin) / h).T @ P).T


class CompiledSolver:
    """An explicit method of SciPy's whose steps are taken in machine code, many per call.

    A step that the compiled loop leaves undone is taken by SciPy's solver, which names what is wrong.

    Parameters
    ----------
    method : {"RK45", "DOP853"}
    rtol, atol : float
    kernel : Kernel
        The right-hand side, of time, state and what the system gives as `inputs`.
    """

    def __init__(self, method: str, rtol: float, atol: float, kernel: Kernel) -> None:
        self.method, self.rtol, self.atol, self.kernel = method, rtol, atol, kernel
        self.rates, self.tableau = kernel.address(), tableau(method)
        self.h, self.longest, self.how, self.examined = 0.0, np.inf, ANEW, 0
        self.size = 16 if method == "DOP853" else 7  # slopes of a step, those for interpolants included

    def start(self, system: Any, t: float, x: Array, end: float, longest: float = np.inf) -> None:
        """Begin anew at time t; steps are at most `longest` long."""
        self.resume(system, t, x, end)
        self.longest, self.h, self.how = longest, 0.0, ANEW

    def resume(self, system: Any, t: float, x: Array, end: float) -> None:
        """Go on after a jump of the torques with the length of the last step, or try the first as far as the end."""
        self.system, self.t, self.x, self.end = system, t, x, end
        self.h, self.how = self.h or end - t, AFTER_A_JUMP
        self.f = np.zeros(len(x))

    @property
    def note(self) -> str:
        """For the message of a run."""
        return f"in machine code{f', {self.examined} steps by SciPy' if self.examined else ''}"

    @property
    def is_running(self) -> bool:
        """False when the end was reached."""
        return self.t < self.end

    def steps(self, most: int) -> Steps:
        """The next steps, at most so many."""
        work = self._arrays(most)
        u = None if self.system.held is None else np.array(self.system.held)
        arguments = _arguments(len(self.x), u)
        taken = take_steps(self.rates, arguments, self._limits(), self.how, (*self.tableau, work[0]), *work[1:])
        return self._taken(taken, work, u) if taken else self._examined(self.end)

    def _arrays(self, most: int) -> tuple[Array, ...]:
        """Room for an estimate of errors; T, X, K, H and the counts of evaluations, with what is known."""
        n = len(self.x)
        T, X, K = np.empty(most + 1), np.empty((most + 1, n)), np.empty((most, self.size, n))
        H, count = np.empty(most + 1), np.zeros(most, dtype=np.int64)
        T[0], X[0], K[0, 0], H[0] = self.t, self.x, self.f, self.h
        return np.empty(n), T, X, K, H, count

    def _limits(self) -> Limits:
        return Limits(self.end, self.longest, self.rtol, self.atol, power(self.method), *self.system.span)

    def _taken(self, taken: int, work: tuple[Array, ...], u: Array | None, U: Array | None = None) -> Block:
        """The block, behind which the next one begins."""
        _, T, X, K, H, count = work
        self.system.evaluations += int(count.sum())
        self.t, self.x, self.h, self.how = float(T[taken]), X[taken], float(H[taken]), GO_ON
        self.f = K[taken - 1, len(self.tableau.B)]
        return Block(self, T[: taken + 1], X[: taken + 1], K[:taken], u, U)

    def _examined(self, end: float) -> Steps:
        """One step by SciPy's solver."""
        self.examined += 1
        solver = AdaptiveSolver(self.method, self.rtol, self.atol)
        first = min(self.h, end - self.t) if self.h > 0 else None
        solver.start(self.system, self.t, self.x, end, self.longest, first)
        steps = solver.steps(1)
        self.t, self.x, self.h, self.how = float(steps.T[-1]), steps.X[-1], float(solver.scipy.h_abs), AFTER_A_JUMP
        return steps

    def extend(self, block: Block) -> None:
        """Add the stages that only interpolants need, by the recursion where a state must be examined."""
        from scipy.integrate import DOP853

        A, C = (np.ascontiguousarray(x) for x in (DOP853.A_EXTRA, DOP853.C_EXTRA))
        arguments = _arguments(block.X.shape[1], None if block.u is None else block.u.copy())
        limits = Limits(0.0, 0.0, 0.0, 0.0, 0.0, *block.span)
        given = self.rates, arguments, limits, A, C, block.T, block.X, block.K
        sound = add_stages(*given) if block.U is None else add_sampled_stages(*given, block.U)
        if sound:
            self.system.evaluations += len(C) * len(block.K)
            return
        for k, (t, h, x, K) in enumerate(zip(block.T, np.diff(block.T), block.X, block.K, strict=False)):
            u = block.u
            if u is not None and block.U is not None:
                u = np.concatenate([block.U[k], u[block.U.shape[1] :]])
            for s, (a, c) in enumerate(zip(A, C, strict=True), start=len(K) - len(C)):
                self.system.evaluations += 1
                K[s] = self.system.rates(np.clip(t + c * h, *block.span), x + h * (a[:s] @ K[:s]), u)


class SampledSolver(CompiledSolver):
    """The same with a traced controller that is sampled between the steps.

    Parameters
    ----------
    method, rtol, atol, kernel
        As of CompiledSolver.
    hold : Sampler
        With a traced law.
    """

    def __init__(self, method: str, rtol: float, atol: float, kernel: Kernel, hold: Sampler) -> None:
        super().__init__(method, rtol, atol, kernel)
        assert hold.traced is not None
        self.hold, self.law = hold, hold.traced
        self.bounds = hold.bounds()

    def steps(self, most: int) -> Steps:
        """The next steps, at most so many."""
        hold, n, m = self.hold, self.bounds.shape[1], len(self.hold.state)
        work, u = self._arrays(most), np.array(self.system.held)
        arguments, law_arguments = _arguments(len(self.x), u), _arguments(2 * n + m, None)
        number, z = np.array([hold.count, 0]), np.stack([hold.state, hold.next_state])
        begun, U, Z = np.empty(most + 1, dtype=np.int64), np.empty((most + 1, n)), np.empty((most + 1, m))
        found = np.empty(self.law.traced.entries)
        taken = take_samples(
            *(self.law.address(), law_arguments, found, self.rates, arguments, self._limits(), hold.period, self.how),
            *((*self.tableau, work[0]), *work[1:], (number, self.bounds, z, begun, U, Z)),
        )
        begun = begun[: number[1]]
        if len(begun):
            before = int(work[-1][: begun[-1]].sum())
            samples = work[1][begun], work[2][begun], U[begun], Z[: len(begun)]
            hold.note(samples, z, self.system.evaluations + before)
        if taken:
            return self._taken(taken, work, u, U[:taken])
        if self.t >= hold.next:
            hold.sample(self.t, self.x)
        return self._examined(min(hold.next, self.end))


class RosenbrockSteps(Steps):
    """Steps of Rodas5P, with the vectors of their interpolants."""

    def __init__(self, T: Array, X: Array, vectors: Array) -> None:
        super().__init__(T, X)
        self.vectors = vectors

    def states(self, times: Array, k: Array) -> Array:
        """States at times within the steps k, shape (T, size)."""
        s = ((times - self.T[k]) / (self.T[k + 1] - self.T[k]))[:, None]
        return rosenbrock.inside(self.X[k], self.X[k + 1], self.vectors[k], s)


class RosenbrockSolver(CompiledSolver):
    """Rodas5P, many steps per call.

    Parameters
    ----------
    rtol, atol : float
    system : System
    slopes : Kernel
        Of the equations of motion by state, accelerations and time; functions of these and of what is held.
    n : int
        Number of accelerations.
    """

    def __init__(self, rtol: float, atol: float, system: System, slopes: Kernel, n: int) -> None:
        self.method, self.rtol, self.atol, self.system, self.slopes, self.n = RODAS, rtol, atol, system, slopes, n
        self.functions: tuple[Any, Any] = (system.kernel.address(), slopes.address())
        self.h, self.longest = 0.0, np.inf

    def steps(self, most: int) -> Steps:
        """The next steps, at most so many; NotFiniteError if there is none."""
        steps = self._take(most, take_stiff_steps, self.functions)
        if len(steps.T) == 1:
            with np.errstate(all="ignore"):
                steps = self._take(1, rosenbrock.take_steps, (self._rates, self._slopes))
        if len(steps.T) == 1:
            raise NotFiniteError(f"{RODAS} gave up: steps would be shorter than the rounding of times", self.t)
        return steps

    def _take(self, most: int, loop: Callable[..., int], functions: tuple[Any, Any]) -> Steps:
        system, n, size = self.system, self.n, len(self.x)
        T, X, H, P = np.empty(most + 1), np.empty((most + 1, size)), np.empty(most + 1), np.empty((most, 3, size))
        T[0], X[0], H[0] = self.t, self.x, self.h or FIRST * (self.end - self.t)
        time, x, *held = arguments = _arguments(size, None if system.held is None else np.array(system.held))
        limits = float(self.end), float(self.longest), self.rtol, self.atol, *map(float, system.span)
        count, work = np.zeros(2, dtype=np.int64), rosenbrock.workspace(n, size)
        at_accelerations = time, x, np.empty(n), *held
        taken = loop(*functions, arguments, at_accelerations, limits, rosenbrock.TABLEAU, T, X, P, H, count, work)
        system.evaluations += int(count[0]) + size * int(count[1])
        self.t, self.x, self.h = float(T[taken]), X[taken], float(H[taken])
        return RosenbrockSteps(T[: taken + 1], X[: taken + 1], P[:taken])

    def _rates(self, t: Array, x: Array, *rest: Array) -> bool:
        """dx/dt, under held torques, into the last array."""
        rest[-1][:] = self.system.rates(float(t[0]), x, rest[0] if len(rest) == 2 else None)
        return True

    def _slopes(self, *arguments: Array) -> bool:
        """The slopes of the equations of motion into the last array."""
        arguments[-1][:] = self.slopes(*arguments[:-1])
        return True


def _arguments(size: int, u: Array | None) -> tuple[Array, ...]:
    """Arrays for the arguments of a right-hand side."""
    return (np.empty(1), np.empty(size)) if u is None else (np.empty(1), np.empty(size), u)
