"""Many motions by an explicit method in NumPy: all side by side, each with its own steps.

Entry [i, k] of an array is component i of motion k. No motion affects the bits of another.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np

from ..basics.piecewise import rows_of_tables
from ..basics.spatial import Array
from ..dynamics.quantity import OK, PrecisionStatus
from ..errors import NotFiniteError, SingularMassMatrixError
from ..kernels.kernel import Kernel
from ..kernels.numpy_backend import BlockProgram
from .step_control import LARGEST, MOST_STEPS, SAFETY, SMALLEST, THIRD, Interval, first_lengths, shortest_step, squares
from .tableaus import Tableau

EVERY = slice(None)
FULL = 0.75  # share of running motions below which the finished ones are dropped: a new width costs time
LOOK = 500  # steps between two checks for stiffness
SLOW, FAST_DECAY = 20_000, 3.0  # steps of the whole motion at the present rate; time constants per step
EARLY = 100  # steps before which no motion is given up as slow
NEEDS_RECURSION, STIFF = 1, 2  # codes of motions not finished: machine code cannot decide a state; stiff
Progress = Callable[[int], Any]  # called with units of work: motions, or steps of all motions where these are equal


class BatchResult(NamedTuple):
    """Result of a batch: codes of the motions, 0 for completed ones, and False if it was interrupted."""

    code: Array
    evaluations: int
    verdict: PrecisionStatus
    is_done: bool


class Rates:
    """Function dx/dt of the motions still running, by a kernel of time, state and numbers of the run.

    The numbers have shape (p,), or (N, p) of each motion; errors name the motions by their `places`, shape (N,).
    """

    def __init__(self, kernel: Kernel, numbers: Array, places: Array, interval: Interval) -> None:
        self.kernel, self.numbers, self.places, self.interval = kernel, numbers, places, interval
        self.coefficients, self.table = kernel.coefficients(numbers), interval.table
        self.evaluations, self.moving, self.verdict = 0, len(places), OK
        self.program = None
        if kernel.is_unrolled:
            self.program = kernel.blocks if kernel.engine == "numpy" else BlockProgram(kernel.traced)

    def keep(self, chosen: Array) -> None:
        """Drop all but some motions."""
        self.places = self.places[chosen]
        self.numbers, self.coefficients = (_of(a, chosen) for a in (self.numbers, self.coefficients))
        self.table = self.table[chosen] if len(self.table) > 1 else self.table

    def __call__(self, t: Any, x: Array, out: Array | None = None, chosen: Any = EVERY) -> Array:
        """dx/dt at times t, of all motions or of some."""
        count, out = x.shape[1], np.empty_like(x) if out is None else out
        self.evaluations += self.moving if chosen is EVERY else count
        within = np.clip(t, self.interval.first, self.interval.last)
        times = np.broadcast_to(within.astype(x.dtype), count)[:, None]
        given = times, x.T, *rows_of_tables(self.table, times[:, 0], chosen)
        states = [*given, _of(self.coefficients, chosen)]
        to_check = np.arange(count) if self.program is None else np.flatnonzero(~self.program.sound(states, out.T))
        if len(to_check):
            some = [_of(a, to_check) for a in (*given, _of(self.numbers, chosen))]
            out[:, to_check] = self._by_recursion(some, self.places[chosen][to_check])
        return out

    def _by_recursion(self, states: Sequence[Array], places: Array) -> Array:
        """Rates of single states by the recursion, whose errors name the cause."""
        try:
            rates, verdict = self.kernel.by_recursion(*states)
        except NotFiniteError as error:
            k, grid, cure = error.state[0], self.interval.grid, ""
            if len(grid):
                cure = f"; steps of {grid[1] - grid[0]:g} s may be too long for the fastest decay: try shorter ones"
            t = float(states[0][k, 0])
            raise NotFiniteError(f"start {places[k]} at t = {t:.6g} s: {error.args[0]}{cure}", t) from None
        if verdict.error is not None:
            (k,) = verdict.error.state
            text = f"start {places[k]} at t = {states[0][k, 0]:.6g} s: {verdict.error.what}"
            raise SingularMassMatrixError(text, verdict.error.cause, verdict.error.joints)
        self.verdict = self.verdict.worse(verdict.with_state(lambda state: (int(places[state[0]]),)))
        return np.asarray(rates.T)


def _of(array: Array, chosen: Any) -> Array:
    """Rows of some motions; a vector is common to all."""
    return array if array.ndim == 1 else array[chosen]


def combine(weights: Array, K: Array) -> Array:
    """Sum of weights[j] K[j], term by term, so that no column's rounding depends on the others."""
    total, term = np.zeros(K.shape[1:], K.dtype), np.empty(K.shape[1:], K.dtype)
    for w, k in zip(weights.tolist(), K, strict=False):
        if w:
            np.add(total, np.multiply(k, w, out=term), out=total)
    return total


class RowSteps:
    """Steps of individual or given lengths of many motions; states at the times to report go into X[time, motion]."""

    def __init__(self, rates: Rates, X: Array) -> None:
        self.rates, self.interval, self.X = rates, rates.interval, X
        self.tableau: Tableau = self.interval.tableau
        self.is_fixed, self.code = len(self.interval.grid) > 0, np.zeros(X.shape[1], dtype=np.int64)

    def run(self, x: Array, progress: Progress) -> None:
        """Integrate from states x, shape (N, size), to the end."""
        interval, N = self.interval, len(x)
        self.x, self.t = x.T.copy(), np.full(N, interval.begin)
        self.row, self.reported, self.steps = np.arange(N), np.zeros(N, dtype=int), np.zeros(N, dtype=int)
        self.K = np.empty((self.tableau.D.shape[1], *self.x.shape), x.dtype)
        self.rates(self.t, self.x, self.K[0])
        self.h = np.zeros(N) if self.is_fixed else first_lengths(self.rates, interval, self.x, self.K[0])
        self.taken = np.ones(N, dtype=bool)  # the step before
        while self.rates.moving:
            self._step()
            on_its_way = self.t < interval.end
            before, self.rates.moving = self.rates.moving, int(on_its_way.sum())
            progress(N if self.is_fixed else before - self.rates.moving)
            if self.rates.moving <= FULL * len(on_its_way):
                self._keep(on_its_way)

    def _keep(self, chosen: Array) -> None:
        self.rates.keep(chosen)
        for name in ("t", "row", "reported", "steps", "h", "taken"):
            setattr(self, name, getattr(self, name)[chosen])
        self.x, first = self.x[:, chosen], self.K[0][:, chosen]
        self.K = np.empty((len(self.K), *self.x.shape), self.x.dtype)
        self.K[0] = first

    def _step(self) -> None:
        """Try a step of every motion."""
        ends = self.interval.grid[self.steps + 1] if self.is_fixed else self._ends()
        h = ends - self.t
        new = self._stages(ends, h)
        taken, factor = (self.taken, 1.0) if self.is_fixed else self._accept(h, new)
        self._report(ends, h, new, taken)
        self.steps += taken
        is_stiff = self._is_stiff(ends, h, new) & taken if self.interval.watched else None
        self.x = new if taken.all() else np.where(taken, new, self.x)
        np.copyto(self.K[0], self.K[len(self.tableau.B)], where=taken)
        self.t, self.h, self.taken = np.where(taken, ends, self.t), h * factor, taken
        if is_stiff is not None and is_stiff.any():
            self.t[is_stiff] = self.interval.end
            self.code[self.row[is_stiff]] = STIFF

    def _ends(self) -> Array:
        """Ends of the steps to be tried."""
        smallest, interval = shortest_step(self.t), self.interval
        endless = self.steps * (interval.end - interval.begin) > MOST_STEPS * (self.t - interval.begin)
        short = ~(self.taken | (self.h >= smallest)) | np.isnan(self.h)
        for k in np.flatnonzero(short | endless & (self.steps >= EARLY)):
            where = f"start {self.rates.places[k]} at t = {self.t[k]:.6g} s"
            if endless[k]:
                text = f"{where}: {self.steps[k]} steps came no further, and the motion would take more than"
                raise NotFiniteError(f"{text} {MOST_STEPS:g}", float(self.t[k]))
            raise NotFiniteError(f"{where}: the step needed is less than the spacing between numbers", float(self.t[k]))
        return np.asarray(np.minimum(self.t + np.maximum(self.h, smallest), interval.end))

    def _accept(self, h: Array, new: Array) -> tuple[Array, Array]:
        """Mask of accepted steps, and the factors from their lengths to the next ones'."""
        error = self._error(h, new)
        with np.errstate(all="ignore"):
            factor = SAFETY * error**self.tableau.exponent
        taken = error < 1
        largest = np.where(self.taken, LARGEST, 1.0)
        return taken, np.where(taken, np.minimum(largest, factor), np.fmax(SMALLEST, factor))

    def _is_stiff(self, ends: Array, h: Array, new: Array) -> Array:
        """True for stiff motions: derivatives of two states at one time, Hairer and Wanner 1996, IV.2."""
        interval, last, count = self.interval, len(self.tableau.B), self.interval.counted
        paces = self.steps * (interval.end - interval.begin) > SLOW * (ends - interval.begin)
        found = (self.steps % LOOK == 0) & paces
        if found.any():
            slopes, states = self.K[last] - self.K[last - 1], new - self.before
            with np.errstate(all="ignore"):
                found &= h * np.sqrt(squares(slopes[:count]) / squares(states[:count])) > FAST_DECAY
        return np.asarray(found)

    def _stages(self, ends: Array, h: Array) -> Array:
        """States after steps of lengths h, and the stage derivatives."""
        A, B, C = self.tableau.A, self.tableau.B, self.tableau.C
        t, x, K, n = self.t, self.x, self.K, self.interval.positions
        length = h.astype(x.dtype)
        for s in range(1, len(B)):
            self.before = x + length * combine(A[s, :s], K)  # in the end that before the new one, at the same time
            self.rates(t + C[s] * h, self.before, K[s])
        new = x + length * combine(B, K)
        new[:n] = x[:n] + length * new[n : 2 * n] if n else new[:n]
        if not self.is_fixed or ends.max(initial=0.0) < self.interval.end:
            self.rates(ends, new, K[len(B)])
        return np.asarray(new)

    def _error(self, h: Array, new: Array) -> Array:
        count = self.interval.counted
        scale = self.interval.atol + self.interval.rtol * np.maximum(np.abs(self.x[:count]), np.abs(new[:count]))
        fifth, *third = (squares(combine(e, self.K[:, :count]) / scale) for e in self.tableau.E)
        both = np.sqrt((fifth + sum(THIRD * t for t in third)) * count)
        return h * np.divide(fifth, both, out=np.zeros_like(both), where=fifth > 0)

    def _report(self, ends: Array, h: Array, new: Array, taken: Array) -> None:
        """Write the states at the times to report within accepted steps."""
        times, before = self.interval.t_eval, self.reported
        self.reported = np.where(taken, np.searchsorted(times, ends, side="right"), before)
        many = self.reported - before
        if not many.any():
            return
        which = np.repeat(np.arange(len(many)), many)  # for each state its motion, and its time below
        time = np.arange(len(which)) - np.repeat(np.cumsum(many) - many - before, many)
        inside = times[time] < ends[which]
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
        """Coefficients of the interpolants of the steps of some motions."""
        stages, (A, C, D) = len(self.tableau.B) + 1, self.tableau[4:7]
        t, x, h, K = self.t[chosen], self.x[:, chosen], h[chosen], self.K[:, :, chosen]
        for s in range(len(C)):
            self.rates(t + C[s] * h, x + h * combine(A[s], K[: stages + s]), K[stages + s], chosen)
        return [combine(d, K) for d in D]


def run_rows(
    interval: Interval, kernel: Kernel, numbers: Array, places: Array, x: Array, X: Array, progress: Progress
) -> BatchResult:
    """Integrate motions from states x, shape (N, size), into X[time, motion]."""
    rates, is_done = Rates(kernel, numbers, places, interval), True
    rows = RowSteps(rates, X)
    try:
        rows.run(x, progress)
    except KeyboardInterrupt:
        is_done = False
    return BatchResult(rows.code, rates.evaluations, rates.verdict, is_done)
