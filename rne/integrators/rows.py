"""Many motions by an explicit method in NumPy: all side by side, each with its own steps.

Entry [i, k] of an array is component i of motion k. No motion affects the bits of another.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np

from ..basics.spatial import Array
from ..dynamics.quantity import OK
from ..errors import NotFiniteError, SingularMassMatrixError
from ..kernels.kernel import Kernel
from ..kernels.numpy_backend import BlockProgram
from .runge_kutta import LARGEST, SAFETY, SMALLEST, Tableau

EPS = float(np.finfo(np.float64).eps)
EVERY = slice(None)
FULL = 0.75  # part of the columns that are on their way, below which the others are dropped: a new width costs time
LOOK = 500  # steps between two looks whether the motion is stiff
SLOW, STIFF = 20_000, 3.0  # steps of the whole way at this pace, and time constants of the fastest mode in a step
EARLY, MOST_STEPS = 100, 1e10  # after that many steps a motion is given up that at this pace would take so many
Tick = Callable[[int], Any]


class Course(NamedTuple):
    """How motions are run from one time to another.

    Attributes
    ----------
    table : Tableau
        Of the method.
    begin, end : float
    first, last : float
        Times within which torques are evaluated.
    times : ndarray, shape (S,)
        To report, ascending, the end as the last.
    grid : ndarray
        The begin, and the ends of steps that are not controlled; empty for those that are.
    norm : (int, float, float, float)
        The number of components whose errors count, rtol, atol, and the power of the error.
    positions : int
        The number of components that move with the rates at the end of the step.
    watched : bool
        True to leave motions in which a fast decay, not the error, holds the steps to short ones.
    """

    table: Tableau
    begin: float
    end: float
    first: float
    last: float
    times: Array
    grid: Array
    norm: tuple[int, float, float, float]
    positions: int = 0
    watched: bool = False


class Rates:
    """dx/dt of the motions that are still on their way.

    Parameters
    ----------
    kernel : Kernel
        Of time, state and perhaps inertial parameters.
    parameters : ndarray, shape (N, 10 nb), or (N, 0)
    numbers : ndarray, shape (N,)
        Of the motions, for errors.
    course : Course
    """

    def __init__(self, kernel: Kernel, parameters: Array, numbers: Array, course: Course) -> None:
        self.kernel, self.parameters, self.numbers, self.course = kernel, parameters, numbers, course
        self.evaluations, self.moving, self.verdict, self.is_done = 0, len(numbers), OK, True
        self.stiff = np.zeros(len(numbers), dtype=bool)  # motions that were left
        self.program = None
        if kernel.is_unrolled:
            self.program = kernel.blocks if kernel.engine == "numpy" else BlockProgram(kernel.traced)

    def keep(self, chosen: Array) -> None:
        """Forget the other motions."""
        self.parameters, self.numbers = self.parameters[chosen], self.numbers[chosen]

    def __call__(self, t: Any, x: Array, out: Array | None = None, chosen: Any = EVERY) -> Array:
        """dx/dt at times t, of all motions or of some."""
        count, out = x.shape[1], np.empty_like(x) if out is None else out
        self.evaluations += self.moving if chosen is EVERY else count
        within = np.clip(t, self.course.first, self.course.last)
        times = np.broadcast_to(within.astype(x.dtype), count)[:, None]
        states = [times, x.T, self.parameters[chosen]][: len(self.kernel.names)]
        doubtful = np.arange(count) if self.program is None else np.flatnonzero(~self.program.sound(states, out.T))
        if len(doubtful):
            out[:, doubtful] = self._examined([a[doubtful] for a in states], self.numbers[chosen][doubtful])
        return out

    def _examined(self, states: Sequence[Array], numbers: Array) -> Array:
        """The same by the recursion, which names what is wrong."""
        try:
            rates, verdict = self.kernel.by_recursion(*states)
        except NotFiniteError as error:
            k, grid, cure = error.state[0], self.course.grid, ""
            if len(grid):
                cure = f"; steps of {grid[1] - grid[0]:g} s may be too long for the fastest decay: try shorter ones"
            t = float(states[0][k, 0])
            raise NotFiniteError(f"start {numbers[k]} at t = {t:.6g} s: {error.args[0]}{cure}", t) from None
        if verdict.error is not None:
            (k,) = verdict.error.state
            text = f"start {numbers[k]} at t = {states[0][k, 0]:.6g} s: {verdict.error.what}"
            raise SingularMassMatrixError(text, verdict.error.cause, verdict.error.joints)
        self.verdict = self.verdict.worse(verdict.with_state(lambda state: (int(numbers[state[0]]),)))
        return np.asarray(rates.T)


def combine(weights: Array, K: Array) -> Array:
    """The sum of weights[j] K[j], term by term, so that each column's bits are its own."""
    total, term = np.zeros(K.shape[1:], K.dtype), np.empty(K.shape[1:], K.dtype)
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


def first_steps(rates: Callable[[Array, Array], Array], course: Course, x: Array, f: Array) -> Array:
    """Lengths of the first steps: Hairer, Norsett and Wanner 1993, II.4, as SciPy's."""
    (count, rtol, atol, order), longest = course.norm, course.end - course.begin
    scale = atol + rtol * np.abs(x[:count])

    def size(v: Array) -> Array:
        return np.asarray(np.sqrt(squares(v[:count] / scale) / count))

    with np.errstate(all="ignore"):
        d0, d1 = size(x), size(f)
        h0 = np.minimum(np.where((d0 < 1e-5) | (d1 < 1e-5), 1e-6, 0.01 * d0 / d1), longest)
        d2 = size(rates(course.begin + h0, x + h0 * f) - f) / h0
        largest = np.maximum(d1, d2)
        h1 = np.where(largest <= 1e-15, np.maximum(1e-6, h0 * 1e-3), (0.01 / largest) ** -order)
        return np.asarray(np.minimum(np.minimum(100 * h0, h1), longest))


class RowSteps:
    """Steps of each motion's own lengths, or those of the grid; states at the times to report into X[time, motion]."""

    def __init__(self, rates: Rates, course: Course, X: Array) -> None:
        self.rates, self.course, self.X = rates, course, X
        self.table, self.times, self.is_fixed = course.table, course.times, len(course.grid) > 0

    def run(self, x: Array, tick: Tick) -> None:
        """From states x, shape (N, size), to the end."""
        course, N = self.course, len(x)
        self.x, self.t = x.T.copy(), np.full(N, course.begin)
        self.row, self.reported, self.steps = np.arange(N), np.zeros(N, dtype=int), np.zeros(N, dtype=int)
        self.K = np.empty((self.table.D.shape[1], *self.x.shape), x.dtype)
        self.rates(self.t, self.x, self.K[0])
        self.h = np.zeros(N) if self.is_fixed else first_steps(self.rates, course, self.x, self.K[0])
        self.taken = np.ones(N, dtype=bool)  # the step before
        while self.rates.moving:
            self._step()
            on_its_way = self.t < course.end
            before, self.rates.moving = self.rates.moving, int(on_its_way.sum())
            tick(N if self.is_fixed else before - self.rates.moving)
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
        ahead = self.course.grid[self.steps + 1] if self.is_fixed else self._ahead()
        h = ahead - self.t
        new = self._stages(ahead, h)
        taken, factor = (self.taken, 1.0) if self.is_fixed else self._judge(h, new)
        self._report(ahead, h, new, taken)
        self.steps += taken
        is_stiff = self._is_stiff(ahead, h, new) & taken if self.course.watched else None
        self.x = new if taken.all() else np.where(taken, new, self.x)
        np.copyto(self.K[0], self.K[len(self.table.B)], where=taken)
        self.t, self.h, self.taken = np.where(taken, ahead, self.t), h * factor, taken
        if is_stiff is not None and is_stiff.any():
            self.t[is_stiff] = self.course.end
            self.rates.stiff[self.row[is_stiff]] = True

    def _ahead(self) -> Array:
        """The ends of steps of the lengths to be tried."""
        smallest, course = 10 * EPS * np.abs(self.t), self.course
        endless = self.steps * (course.end - course.begin) > MOST_STEPS * (self.t - course.begin)
        short = ~(self.taken | (self.h >= smallest)) | np.isnan(self.h)
        for k in np.flatnonzero(short | endless & (self.steps >= EARLY)):
            where = f"start {self.rates.numbers[k]} at t = {self.t[k]:.6g} s"
            if endless[k]:
                text = f"{where}: {self.steps[k]} steps came no further, and the motion would take more than"
                raise NotFiniteError(f"{text} {MOST_STEPS:g}", float(self.t[k]))
            raise NotFiniteError(f"{where}: the step needed is less than the spacing between numbers", float(self.t[k]))
        return np.asarray(np.minimum(self.t + np.maximum(self.h, smallest), course.end))

    def _judge(self, h: Array, new: Array) -> tuple[Array, Array]:
        """Which steps are taken, and the factors between their lengths and the next ones'."""
        error = self._error(h, new)
        with np.errstate(all="ignore"):
            factor = SAFETY * error ** self.course.norm[3]
        taken = error < 1
        most = np.where(self.taken, LARGEST, 1.0)
        return taken, np.where(taken, np.minimum(most, factor), np.fmax(SMALLEST, factor))

    def _is_stiff(self, ahead: Array, h: Array, new: Array) -> Array:
        """By slopes of the last two states, which have one time: Hairer and Wanner 1996, IV.2."""
        course, last, count = self.course, len(self.table.B), self.course.norm[0]
        found = (self.steps % LOOK == 0) & (self.steps * (course.end - course.begin) > SLOW * (ahead - course.begin))
        if found.any():
            slopes, states = self.K[last] - self.K[last - 1], new - self.before
            with np.errstate(all="ignore"):
                found &= h * np.sqrt(squares(slopes[:count]) / squares(states[:count])) > STIFF
        return np.asarray(found)

    def _stages(self, ahead: Array, h: Array) -> Array:
        """The states after steps of lengths h, and the slopes."""
        A, B, C = self.table.A, self.table.B, self.table.C
        t, x, K, n = self.t, self.x, self.K, self.course.positions
        length = h.astype(x.dtype)
        for s in range(1, len(B)):
            self.before = x + length * combine(A[s, :s], K)  # in the end that before the new one, at the same time
            self.rates(t + C[s] * h, self.before, K[s])
        new = x + length * combine(B, K)
        new[:n] = x[:n] + length * new[n : 2 * n] if n else new[:n]
        if not self.is_fixed or ahead.max(initial=0.0) < self.course.end:
            self.rates(ahead, new, K[len(B)])
        return np.asarray(new)

    def _error(self, h: Array, new: Array) -> Array:
        count, rtol, atol, _ = self.course.norm
        scale = atol + rtol * np.maximum(np.abs(self.x[:count]), np.abs(new[:count]))
        fifth, *third = (squares(combine(e, self.K[:, :count]) / scale) for e in self.table.E)
        both = np.sqrt((fifth + sum(0.01 * t for t in third)) * count)
        return h * np.divide(fifth, both, out=np.zeros_like(both), where=fifth > 0)

    def _report(self, ahead: Array, h: Array, new: Array, taken: Array) -> None:
        """States at the times within the steps that are taken."""
        times, before = self.times, self.reported
        self.reported = np.where(taken, np.searchsorted(times, ahead, side="right"), before)
        many = self.reported - before
        if not many.any():
            return
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
        stages, (A, C, D) = len(self.table.B) + 1, self.table[4:7]
        t, x, h, K = self.t[chosen], self.x[:, chosen], h[chosen], self.K[:, :, chosen]
        for s in range(len(C)):
            self.rates(t + C[s] * h, x + h * combine(A[s], K[: stages + s]), K[stages + s], chosen)
        return [combine(d, K) for d in D]


def by_rows(course: Course, kernel: Kernel, parameters: Array, numbers: Array, x: Array, X: Array, tick: Tick) -> Rates:
    """Motions from states x into X[time, motion]; what was evaluated, how sound it was, and whether all were run."""
    rates = Rates(kernel, parameters, numbers, course)
    try:
        RowSteps(rates, course, X).run(x, tick)
    except KeyboardInterrupt:
        rates.is_done = False
    return rates
