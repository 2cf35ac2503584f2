"""Many motions by an explicit method in NumPy: all side by side, each with its own steps.

Entry [i, k] of an array is component i of motion k. No motion affects the bits of another.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from ..basics.spatial import Array
from ..dynamics.quantity import OK
from ..errors import NotFiniteError, SingularMassMatrixError
from ..kernels.explicit_methods import EPS, LARGEST, SAFETY, SMALLEST, Method
from ..kernels.kernel import Kernel
from ..kernels.numpy_backend import BlockProgram

EVERY = slice(None)
FULL = 0.75  # part of the columns that are on their way, below which the others are dropped: a new width costs time


class Rates:
    """dx/dt of the motions that are still on their way.

    Parameters
    ----------
    kernel : Kernel
        Of time, state and perhaps inertial parameters.
    parameters : ndarray, shape (N, 10 nb), or (N, 0)
    numbers : ndarray, shape (N,)
        Of the motions, for errors.
    span : (float, float)
        Times within which torques are evaluated.
    cure : str
        What may help where a state overflows.
    """

    def __init__(self, kernel: Kernel, parameters: Array, numbers: Array, span: tuple[float, float], cure: str) -> None:
        self.kernel, self.parameters, self.numbers, self.span, self.cure = kernel, parameters, numbers, span, cure
        self.verdict = OK
        self.program = None
        if kernel.is_unrolled:
            self.program = kernel.blocks if kernel.engine == "numpy" else BlockProgram(kernel.traced)

    def keep(self, chosen: Array) -> None:
        """Forget the other motions."""
        self.parameters, self.numbers = self.parameters[chosen], self.numbers[chosen]

    def __call__(self, t: Any, x: Array, out: Array, chosen: Any = EVERY) -> None:
        """dx/dt at times t, of all motions or of some."""
        count = x.shape[1]
        times = np.broadcast_to(np.clip(t, *self.span).astype(x.dtype), count)[:, None]
        states = [times, x.T, self.parameters[chosen]][: len(self.kernel.names)]
        doubtful = np.arange(count) if self.program is None else np.flatnonzero(~self.program.sound(states, out.T))
        if len(doubtful):
            out[:, doubtful] = self._examined([a[doubtful] for a in states], self.numbers[chosen][doubtful])

    def _examined(self, states: Sequence[Array], numbers: Array) -> Array:
        """The same by the recursion, which names what is wrong."""
        try:
            rates, verdict = self.kernel.by_recursion(*states)
        except NotFiniteError as error:
            raise self._located(error, states, numbers) from None
        if verdict.error is not None:
            (k,) = verdict.error.state
            text = f"start {numbers[k]} at t = {states[0][k, 0]:.6g} s: {verdict.error.what}"
            raise SingularMassMatrixError(text, verdict.error.cause, verdict.error.joints)
        self.verdict = self.verdict.worse(verdict.with_state(lambda state: (int(numbers[state[0]]),)))
        return rates.T

    def _located(self, error: NotFiniteError, states: Sequence[Array], numbers: Array) -> NotFiniteError:
        """The error with the first motion at fault, the time, and what may help."""
        for k in range(len(numbers)):
            try:
                self.kernel.by_recursion(*(a[k] for a in states))
            except NotFiniteError as found:
                error = found
                break
        t = float(states[0][k, 0])
        return NotFiniteError(f"start {numbers[k]} at t = {t:.6g} s: {error}{self.cure}", t)


def combine(weights: Array, K: Array) -> Array:
    """The sum of weights[j] K[j], term by term, so that each column's bits are its own."""
    total, term = np.zeros_like(K[0]), np.empty_like(K[0])
    for w, k in zip(weights.tolist(), K, strict=False):
        if w:
            np.add(total, np.multiply(k, w, out=term), out=total)
    return total


def squares(values: Array) -> Array:
    """The sum of each column's squares, in one order whatever the number of columns."""
    total = np.zeros(values.shape[1])
    for row in values:
        total += row * row
    return total


def first_steps(
    rates: Callable[[Array, Array], Array], t: float, x: Array, f: Array, longest: float, controls: tuple[Any, ...]
) -> Array:
    """Lengths to try first: Hairer, Norsett and Wanner 1993, II.4, as SciPy.

    `controls` has the number of components that count, rtol, atol and the power of the error.
    """
    count, rtol, atol, power = controls
    scale = atol + rtol * np.abs(x[:count])

    def size(v: Array) -> Array:
        return np.sqrt(squares(v) / count)

    with np.errstate(all="ignore"):
        d0, d1 = size(x[:count] / scale), size(f[:count] / scale)
        h0 = np.minimum(np.where((d0 < 1e-5) | (d1 < 1e-5), 1e-6, 0.01 * d0 / d1), longest)
        d2 = size((rates(t + h0, x + h0 * f) - f)[:count] / scale) / h0
        flat = np.maximum(1e-6, h0 * 1e-3)
        h1 = np.where((d1 <= 1e-15) & (d2 <= 1e-15), flat, (0.01 / np.maximum(d1, d2)) ** -power)
        return np.minimum(np.minimum(100 * h0, h1), longest)


def equal_steps(
    rates: Rates, method: Method, positions: int, grid: Array, x: Array, times: Array, X: Array, tick: Any
) -> None:
    """Steps from one time of the grid to the next; states at `times`, which are among these, into X[time, motion]."""
    B, C, x, reported = method.B, method.C.tolist(), x.T.copy(), 0
    K = np.empty((len(B), *x.shape), x.dtype)
    for t, end in zip(grid[:-1].tolist(), grid[1:].tolist(), strict=True):
        h = end - t
        rates(t, x, K[0])
        for s in range(1, len(B)):
            rates(t + C[s] * h, x + h * combine(method.A[s, :s], K), K[s])
        new = x + h * combine(B, K)
        new[:positions] = x[:positions] + h * new[positions : 2 * positions]
        x = new
        if end == times[reported]:
            X[reported] = x.T
            reported += 1
        tick(x.shape[1])


class ControlledSteps:
    """Steps of each motion's own lengths.

    Parameters
    ----------
    rates : Rates
    method : Method
    controls : tuple
        The number of components whose errors count, rtol and atol.
    span : (float, float)
        Begin and end.
    times : ndarray, shape (S,)
        Times to report, ascending up to the end.
    X : ndarray, shape (S, N, size)
        The states at these times.
    """

    def __init__(
        self,
        rates: Rates,
        method: Method,
        controls: tuple[int, float, float],
        span: tuple[float, float],
        times: Array,
        X: Array,
    ) -> None:
        self.rates, self.method, self.controls, self.times, self.X = rates, method, controls, times, X
        self.begin, self.end = span

    def run(self, x: Array, tick: Any) -> None:
        """From states x, shape (N, size), to the end."""
        self.x, N = x.T.copy(), len(x)
        self.t, self.row, self.reported = np.full(N, self.begin), np.arange(N), np.zeros(N, dtype=int)
        self.K = np.empty((self.method.D.shape[1], *self.x.shape))
        self.rates(self.t, self.x, self.K[0])
        first = (*self.controls, self.method.power)
        self.h = first_steps(self._trial, self.begin, self.x, self.K[0], self.end - self.begin, first)
        self.taken = np.ones(N, dtype=bool)  # the step before
        moving = len(x)
        while moving:
            self._step()
            on_its_way = self.t < self.end
            before, moving = moving, int(on_its_way.sum())
            tick(before - moving)
            if moving <= FULL * len(on_its_way):
                self._keep(on_its_way)

    def _trial(self, t: Array, x: Array) -> Array:
        out = np.empty_like(x)
        self.rates(t, x, out)
        return out

    def _keep(self, chosen: Array) -> None:
        self.rates.keep(chosen)
        for name in ("t", "row", "reported", "h", "taken"):
            setattr(self, name, getattr(self, name)[chosen])
        self.x, first = self.x[:, chosen], self.K[0][:, chosen]
        self.K = np.empty((len(self.K), *self.x.shape))
        self.K[0] = first

    def _step(self) -> None:
        """Try a step of every motion."""
        t, x, K = self.t, self.x, self.K
        smallest = 10 * EPS * np.abs(t)
        for k in np.flatnonzero(~self.taken & ~(self.h >= smallest)):
            text = f"start {self.rates.numbers[k]} at t = {t[k]:.6g} s: the step needed is less than the spacing of numbers"
            raise NotFiniteError(text, float(t[k]))
        ahead = np.minimum(t + np.maximum(self.h, smallest), self.end)
        h = ahead - t
        new = self._stages(h)
        error = self._error(h, new)
        with np.errstate(all="ignore"):
            factor = SAFETY * error**self.method.power
        taken = error < 1
        factor = np.where(taken, np.minimum(np.where(self.taken, LARGEST, 1.0), factor), np.fmax(SMALLEST, factor))
        self._report(ahead, h, new, taken)
        self.x = np.where(taken, new, x)
        K[0] = np.where(taken, K[len(self.method.B)], K[0])
        self.t, self.h, self.taken = np.where(taken, ahead, t), h * factor, taken

    def _stages(self, h: Array) -> Array:
        """The states after steps of lengths h, and the slopes."""
        A, B, C = self.method.A, self.method.B, self.method.C
        t, x, K = self.t, self.x, self.K
        for s in range(1, len(B)):
            self.rates(t + C[s] * h, x + h * combine(A[s, :s], K), K[s])
        new = x + h * combine(B, K)
        self.rates(t + h, new, K[len(B)])
        return new

    def _error(self, h: Array, new: Array) -> Array:
        count, rtol, atol = self.controls
        scale = atol + rtol * np.maximum(np.abs(self.x[:count]), np.abs(new[:count]))
        fifth, third = (squares(combine(e, self.K[:, :count]) / scale) for e in self.method.E)
        both = np.sqrt((fifth + 0.01 * third) * count)
        return h * np.divide(fifth, both, out=np.zeros_like(both), where=fifth > 0)

    def _report(self, ahead: Array, h: Array, new: Array, taken: Array) -> None:
        """States at the times within the steps that are taken."""
        times, before = self.times, self.reported
        self.reported = np.where(taken, np.searchsorted(times, ahead, side="right"), before)
        many = self.reported - before
        which = np.repeat(np.arange(len(many)), many)  # for each state its motion, and its time below
        time = np.arange(len(which)) - np.repeat(np.cumsum(many) - many - before, many)
        inside = times[time] < ahead[which]
        states = new[:, which]
        if inside.any():
            chosen, place = np.unique(which[inside], return_inverse=True)
            Q = self._interpolants(chosen, h)
            u = (times[time[inside]] - self.t[which[inside]]) / h[which[inside]]
            found = np.zeros_like(states[:, inside])
            for j in reversed(range(len(Q))):  # Horner's scheme in u and 1 - u by turns
                found = (found + Q[j][:, place]) * (u if j % 2 == 0 else 1 - u)
            states[:, inside] = self.x[:, which[inside]] + h[which[inside]] * found
        self.X[time, self.row[which]] = states.T

    def _interpolants(self, chosen: Array, h: Array) -> list[Array]:
        """Coefficients of the interpolants of some motions' steps."""
        stages, (A, C, D) = len(self.method.B) + 1, self.method[4:7]
        t, x, h, K = self.t[chosen], self.x[:, chosen], h[chosen], self.K[:, :, chosen]
        for s in range(len(C)):
            self.rates(t + C[s] * h, x + h * combine(A[s], K[: stages + s]), K[stages + s], chosen)
        return [combine(d, K) for d in D]
