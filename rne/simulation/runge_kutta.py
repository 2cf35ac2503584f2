"""SciPy's explicit Runge-Kutta methods as one loop in machine code, which takes many steps per call.

Coefficients, norms and the control of steps are those of `scipy.integrate`: Hairer, Norsett and Wanner 1993, II.4 and
II.5. The right-hand side is a compiled kernel. What the loop cannot decide, an evaluation that must be examined or a
step that becomes too small, is left to SciPy's solver, which names it.
"""

from __future__ import annotations

import functools
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numba import njit, types
from numba.extending import overload
from scipy.integrate import DOP853, RK45

from ..basics.spatial import Array
from ..kernels.kernel import Kernel
from .solver import AdaptiveSolver, Steps

SAFETY, SMALLEST, LARGEST = 0.9, 0.2, 10.0  # factors between steps, as SciPy's
SOLVERS: dict[str, Any] = {"RK45": RK45, "DOP853": DOP853}
GIVEN = types.Array(types.float64, 2, "A", readonly=True, aligned=False)
FILLED = types.Array(types.float64, 2, "C")
MATRIX, VECTOR, BLOCK = (types.Array(types.float64, ndim, "C") for ndim in (2, 1, 3))
COUNTS = types.Array(types.int64, 1, "C")


def evaluate(rates: Any, t: Any, x: Any, u: Any, k: Any) -> bool:
    """In compiled code: dx/dt into k, under torques u where `rates` takes them; True if it is sound."""
    raise NotImplementedError


@overload(evaluate, inline="always")
def _evaluate(rates, t, x, u, k):  # type: ignore[no-untyped-def]
    if len(rates.signature.args) == 6:
        return lambda rates, t, x, u, k: rates(t, x, u, k, 0, 1) == 1
    return lambda rates, t, x, u, k: rates(t, x, k, 0, 1) == 1


def take_steps(
    rates: Any, u: Any, limits: Any, A: Any, B: Any, C: Any, E: Any, T: Any, X: Any, K: Any, H: Any, count: Any
) -> int:
    """Steps into T, X and K from T[0], X[0] and the slope K[0, 0]; how many.

    `limits` has the end, the longest step, rtol, atol, the power of the error, and the times within which torques
    are evaluated. H[k] is the length with which step k is tried first, `count` has the evaluations of each step.
    """
    end, longest, rtol, atol, power, first, last = limits
    stages, n = len(B), X.shape[1]
    time, x = np.empty((1, 1)), np.empty((1, n))
    for step in range(len(T) - 1):
        t, y, k = T[step], X[step], K[step]
        smallest = 10 * abs(np.nextafter(t, np.inf) - t)
        h = min(max(H[step], smallest), longest)
        rejected = False
        while True:
            if not h >= smallest:
                return step
            reached = min(t + h, end)
            h = reached - t
            for s in range(1, stages + 1):
                row, ahead = (A[s], C[s] * h) if s < stages else (B, h)
                x[0] = 0.0
                for j in range(s):
                    if row[j] != 0.0:
                        for i in range(n):
                            x[0, i] += row[j] * k[j, i]
                for i in range(n):
                    x[0, i] = y[i] + h * x[0, i]
                time[0, 0] = min(max(t + ahead, first), last)
                count[step] += 1
                if not evaluate(rates, time, x, u, k[s : s + 1]):
                    return step
            fifth, third = 0.0, 0.0
            for i in range(n):
                scale = atol + rtol * max(abs(y[i]), abs(x[0, i]))
                e5, e3 = 0.0, 0.0
                for j in range(stages + 1):
                    e5 += E[0, j] * k[j, i]
                    e3 += E[1, j] * k[j, i]
                fifth += (e5 / scale) ** 2
                third += (e3 / scale) ** 2
            error = h * fifth / np.sqrt((fifth + 0.01 * third) * n) if fifth > 0 else 0.0
            if error < 1:
                factor = LARGEST if error == 0 else min(LARGEST, SAFETY * error**power)
                T[step + 1], X[step + 1] = reached, x[0]
                h *= min(1.0, factor) if rejected else factor
                break
            h *= max(SMALLEST, SAFETY * error**power)
            rejected = True
        H[step + 1] = h
        if T[step + 1] >= end:
            return step + 1
        if step + 2 < len(T):
            K[step + 1, 0] = k[stages]
    return len(T) - 1


def add_stages(rates: Any, u: Any, span: Any, A: Any, C: Any, T: Any, X: Any, K: Any) -> bool:
    """The stages that only interpolants need, in the last rows of K; False if one of them is not sound."""
    n, sound = X.shape[1], True
    time, x = np.empty((1, 1)), np.empty((1, n))
    for step in range(len(K)):
        h, k = T[step + 1] - T[step], K[step]
        for extra in range(len(C)):
            s = K.shape[1] - len(C) + extra
            x[0] = 0.0
            for j in range(s):
                for i in range(n):
                    x[0, i] += A[extra, j] * k[j, i]
            for i in range(n):
                x[0, i] = X[step, i] + h * x[0, i]
            time[0, 0] = min(max(T[step] + C[extra] * h, span[0]), span[1])
            sound &= evaluate(rates, time, x, u, k[s : s + 1])
    return sound


@functools.cache
def compiled(with_torques: bool) -> tuple[Any, Any]:
    """`take_steps` and `add_stages` for right-hand sides with or without torques as an argument."""
    rates = types.FunctionType(types.int64(*[GIVEN] * (2 + with_torques), FILLED, types.int64, types.int64))
    pair, seven = (types.UniTuple(types.float64, count) for count in (2, 7))  # type: ignore[no-untyped-call]
    tableau = MATRIX, VECTOR, VECTOR, MATRIX
    signature = types.int64(rates, MATRIX, seven, *tableau, VECTOR, MATRIX, BLOCK, VECTOR, COUNTS)
    extension = types.boolean(rates, MATRIX, pair, MATRIX, VECTOR, VECTOR, MATRIX, BLOCK)
    first = njit([signature], nogil=True, cache=True)(take_steps)
    return first, njit([extension], nogil=True, cache=True)(add_stages)


class Method(NamedTuple):
    """A method's tableau, and two estimates of its error, of which the second may be zero."""

    A: Array
    B: Array
    C: Array
    E: Array


@functools.cache
def tableau(method: str) -> Method:
    """The method's coefficients."""
    solver = SOLVERS[method]
    errors = (solver.E5, solver.E3) if method == "DOP853" else (solver.E, 0 * solver.E)
    return Method(
        *(np.ascontiguousarray(x, dtype=np.float64) for x in (solver.A, solver.B, solver.C, np.stack(errors)))
    )


class Block(Steps):
    """Steps of the compiled loop."""

    def __init__(self, solver: CompiledSolver, u: Array, T: Array, X: Array, K: Array) -> None:
        super().__init__(T, X)
        self.solver, self.u, self.span, self.K = solver, u, solver.plant.span, K

    @cached_property
    def polynomials(self) -> Array:
        """The coefficients of each step's interpolant, as SciPy's: F of DOP853, Q of RK45."""
        h, K = np.diff(self.T)[:, None], self.K
        if self.solver.method == "RK45":
            Q: Array = h[:, None] * (np.swapaxes(K, 1, 2) @ RK45.P)
            return Q
        self.solver.extend(self)
        change, first, last = np.diff(self.X, axis=0), h * K[:, 0], h * K[:, DOP853.n_stages]
        low = np.stack([change, first - change, 2 * change - first - last], axis=1)
        return np.concatenate([low, h[:, None] * (DOP853.D @ K)], axis=1)

    def states(self, times: Array, k: Array) -> Array:
        """States at times within the steps k, shape (T, size)."""
        x = ((times - self.T[k]) / (self.T[k + 1] - self.T[k]))[:, None]
        P, found = self.polynomials[k], 0.0
        if self.solver.method == "RK45":
            found = (P @ (x ** np.arange(1, P.shape[-1] + 1))[:, :, None])[..., 0]
        else:  # Horner's scheme in x and 1 - x by turns
            for j in reversed(range(P.shape[1])):
                found = (found + P[:, j]) * (x if j % 2 == 0 else 1 - x)
        states: Array = self.X[k] + found
        return states


class CompiledSolver(AdaptiveSolver):
    """An explicit method of SciPy's whose steps are taken in machine code, many per call.

    The SciPy solver holds the state between calls: it begins, and takes the steps that the compiled loop leaves to it.
    """

    def __init__(self, method: str, rtol: float, atol: float, kernel: Kernel) -> None:
        super().__init__(method, rtol, atol)
        self.rates = kernel.blocks.function(np.dtype(np.float64))
        self.take_steps, self.add_stages = compiled("u" in kernel.names)

    def start(
        self, system: Any, t: float, x: Array, end: float, longest: float = np.inf, first: float | None = None
    ) -> None:
        """Begin anew at time t; steps are at most `longest` long."""
        super().start(system, t, x, end, longest, first)
        self.plant = system

    def steps(self, most: int) -> Steps:
        """The next steps, at most so many."""
        solver = self._solver
        n, rows = len(solver.y), solver.n_stages + 1 + len(getattr(solver, "C_EXTRA", ()))
        T, X, H = np.empty(most + 1), np.empty((most + 1, n)), np.empty(most + 1)
        K, count = np.empty((most, rows, n)), np.zeros(most, dtype=np.int64)
        T[0], X[0], K[0, 0], H[0] = solver.t, solver.y, solver.f, solver.h_abs
        u = np.zeros((1, 0)) if self.plant.held is None else np.array(self.plant.held[None])
        limits = (solver.t_bound, solver.max_step, self.rtol, self.atol, solver.error_exponent, *self.plant.span)
        taken = self.take_steps(self.rates, u, limits, *tableau(self.method), T, X, K, H, count)
        self.plant.evaluations += int(count.sum())
        solver.h_abs = H[taken]
        if not taken:
            return super().steps(1)
        solver.t, solver.y, solver.f = float(T[taken]), X[taken], K[taken - 1, solver.n_stages].copy()
        solver.status = "finished" if solver.t >= solver.t_bound else "running"
        return Block(self, u, T[: taken + 1], X[: taken + 1], K[:taken])

    def extend(self, block: Block) -> None:
        """Add the stages that only interpolants need, by the recursion where a state must be examined."""
        T, X, K = block.T, block.X, block.K
        A, C = (np.ascontiguousarray(x) for x in (DOP853.A_EXTRA, DOP853.C_EXTRA))
        if self.add_stages(self.rates, block.u, block.span, A, C, T, X, K):
            self.plant.evaluations += len(C) * len(K)
            return
        u = block.u[0] if block.u.size else None  # what was held then
        for t, h, x, k in zip(T, np.diff(T), X, K, strict=False):
            for s, (a, c) in enumerate(zip(A, C, strict=True), start=len(k) - len(C)):
                self.plant.evaluations += 1
                k[s] = self.plant.rates(np.clip(t + c * h, *block.span), x + h * (a[:s] @ k[:s]), u)
