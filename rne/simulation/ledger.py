"""The ledger of a motion: work of the drives and friction losses, integrated along the motion that is returned.

A panel is a few of the solver's steps. On it every power, on the steps' interpolants, is replaced by its polynomial
through Gauss's nodes, which is integrated exactly. A panel on which the polynomial's coefficients have not decayed is
halved; the number of steps in a panel follows from how often that happens.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cache
from typing import NamedTuple

import numpy as np

from ..basics.spatial import Array
from ..integrators.base import Steps
from ..integrators.scipy_methods import states_at

Powers = Callable[[Array, Array], Array]  # times (N,), states (N, size) -> (N, k)

DEGREE = 8  # of the polynomials
NEGLIGIBLE = 1e-8  # estimated error of a panel, in units of all energy exchanged so far
DECAY = 1.5  # the first coefficient left out is this power of the decay of the last ones times them
EASY = 1e-2  # of NEGLIGIBLE: below it panels may be twice as long
HALVINGS, SHORTEST = 12, 1e-13  # panels are not halved more often, nor below that part of the time
MOST_HALVED = 32  # panels at once, as a multiple of those at first
BLOCK, MOST_AT_ONCE = 24, 768  # panels evaluated together, at first and later
FIRST_STEPS, MOST_STEPS = 4, 64  # in a panel
MOST_KEPT = 20_000  # steps whose interpolants are kept
ALIKE = 4.0  # largest ratio of its steps' lengths: a jump hides among short steps, where a long panel has no node


@cache
def gauss() -> tuple[Array, Array]:
    """Gauss's nodes in [-1, 1], and the matrix from values there to coefficients of Legendre's polynomials."""
    from numpy.polynomial import legendre

    nodes, _ = legendre.leggauss(DEGREE + 1)
    return nodes, np.linalg.inv(legendre.legvander(nodes, DEGREE))


class Part(NamedTuple):
    """So many steps, the last as far as `end`, with some joints at rest; whether the part before goes on in it."""

    steps: Steps
    taken: int
    end: float
    at_rest: Array | None
    goes_on: bool


class Taken:
    """Steps that were taken one behind the other, as arrays with an entry for each."""

    def __init__(self, parts: Sequence[Part]) -> None:
        self.parts = parts
        self.begins: list[float] = []
        self.ends: list[float] = []
        self.jumps: list[bool] = []
        for part in parts:
            times = part.steps.T[: part.taken].tolist()
            self.begins += times
            self.ends += [*times[1:], part.end]
            first, *others = part.steps.jumps[: part.taken]
            self.jumps += [first or not part.goes_on, *others]
        counts = [part.taken for part in parts]
        self.part, self.number = np.repeat(np.arange(len(parts)), counts), np.concatenate([*map(np.arange, counts)])
        self.begin, self.end = np.array(self.begins), np.array(self.ends)

    def panel(self, first: int, most: int) -> int:
        """Where a panel ends that begins with step `first`: of steps of similar lengths between which nothing jumps."""
        begins, ends, last = self.begins, self.ends, first + 1
        length, beyond = ends[first] - begins[first], min(len(ends), first + most)
        while last < beyond and not self.jumps[last]:
            if not 1 / ALIKE <= (ends[last] - begins[last]) / length <= ALIKE:
                break
            last += 1
        return last

    def halves(self, panels: Array) -> Array:
        """Two halves of each panel: of its steps, between which the interpolants have corners, or of the only one."""
        begin, end, first, last = panels.T
        middle = (first + last) // 2
        several = last - first > 1
        time = np.where(several, self.begin[middle.astype(int)], (begin + end) / 2)
        before = np.stack([begin, time, first, np.where(several, middle, last)], axis=1)
        after = np.stack([time, end, np.where(several, middle, first), last], axis=1)
        return np.stack([before, after], axis=1).reshape(-1, 4)

    def states(self, panels: Array, nodes: Array) -> tuple[Array, Array]:
        """Times and states at nodes in [-1, 1] of each panel, shapes (P N,) and (P N, size)."""
        begin, end = panels[:, :1], panels[:, 1:2]
        times = (begin + (end - begin) * (1 + nodes) / 2).ravel()
        first, last = (np.repeat(panels[:, k].astype(int), len(nodes)) for k in (2, 3))
        k = np.clip(np.searchsorted(self.end, times), first, last - 1)
        states = states_at(times, [part.steps for part in self.parts], self.part[k], self.number[k])
        for number in np.unique(self.part[k]).tolist() if self.parts[0].at_rest is not None else ():
            states[np.ix_(self.part[k] == number, self.parts[number].at_rest)] = 0.0
        return times, states


class Ledger:
    """Energies since the start, as a function of time.

    Parameters
    ----------
    powers : callable
        The powers in many states.
    names : sequence of str
        Theirs.
    """

    def __init__(self, powers: Powers, names: Sequence[str]) -> None:
        self.powers, self.names = powers, names
        # Begins and lengths of panels, shape (P,), and their coefficients, (P, DEGREE + 1, k)
        self.pieces: list[tuple[Array, Array, Array]] = []
        self.exchanged = 0.0  # integral of the powers' sizes
        self.steps, self.block = FIRST_STEPS, BLOCK  # in a panel, and panels evaluated together
        self._parts: list[Part] = []  # to be integrated
        self._is_open = False  # no torques jump, and no joint comes to rest, before the next step
        self._count = 0  # of steps in the parts

    @property
    def end(self) -> float:
        """The time up to which it was integrated."""
        return float(self.pieces[-1][0][-1] + self.pieces[-1][1][-1]) if self.pieces else 0.0

    def add(self, steps: Steps, count: int, end: float, at_rest: Array | None) -> None:
        """So many steps were taken, the last as far as `end`."""
        _ = getattr(steps, "interpolants", None)  # made while the solver still has them
        if end > steps.T[0]:
            self._parts.append(Part(steps, count, end, at_rest, self._is_open))
        self._is_open, self._count = True, self._count + count
        if self._count > MOST_KEPT:
            self.integrate()

    def close(self) -> None:
        """The torques that are held, or the joints at rest, change here."""
        self._is_open = False

    def integrate(self) -> None:
        """Integrate over the steps that were added."""
        parts, self._parts, self._is_open, self._count = self._parts, [], False, 0
        if not parts:
            return
        taken, panels, first = Taken(parts), [], 0
        while first < len(taken.end):
            last = taken.panel(first, self.steps)
            panels.append((taken.begins[first], taken.ends[last - 1], first, last))
            first = last
            if len(panels) >= self.block or last == len(taken.end):
                self._integrate(taken, np.array(panels))
                panels, self.block = [], min(2 * self.block, MOST_AT_ONCE)

    def _integrate(self, taken: Taken, panels: Array) -> None:
        """Integrate over panels, rows of (begin, end, first step, last step)."""
        done: list[tuple[Array, Array, Array]] = []
        most = MOST_HALVED * len(panels)
        for halving in range(HALVINGS + 1):
            if not len(panels):
                break
            lengths = panels[:, 1] - panels[:, 0]
            powers = self.powers(*taken.states(panels, gauss()[0]))
            coefficients = gauss()[1] @ powers.reshape(len(panels), DEGREE + 1, len(self.names))
            errors = lengths * _truncation(coefficients)
            if halving == 0:
                self.exchanged += float((lengths * np.abs(coefficients[:, 0]).sum(axis=1)).sum())
                self._adapt(errors)
            divisible = lengths > SHORTEST * np.abs(panels[:, 1])
            rough = (errors > NEGLIGIBLE * self.exchanged) & divisible & (halving < HALVINGS)
            if 2 * rough.sum() > most:  # no kinks here and there but noise, which halving does not end
                rough[:] = False
            done.append((panels[~rough, 0], lengths[~rough], coefficients[~rough]))
            panels = taken.halves(panels[rough])
        found = [np.concatenate(part) for part in zip(*done, strict=True)]
        order = np.argsort(found[0])
        self.pieces.append((found[0][order], found[1][order], found[2][order]))

    def _adapt(self, errors: Array) -> None:
        """The length of the next panels."""
        if np.mean(errors > NEGLIGIBLE * self.exchanged) > 0.1:
            self.steps = max(1, self.steps // 2)
        elif np.mean(errors > EASY * NEGLIGIBLE * self.exchanged) < 0.1:
            self.steps = min(MOST_STEPS, self.steps * 2)

    def at(self, times: Array) -> Array:
        """Energies since the start at times that were integrated over, shape (T, k)."""
        self.integrate()
        if not self.pieces:
            return np.zeros((len(times), len(self.names)))
        begins, lengths, polynomials = (np.concatenate(part) for part in zip(*self.pieces, strict=True))
        whole = np.concatenate(
            [np.zeros((1, len(self.names))), np.cumsum(lengths[:, None] * polynomials[:, 0], axis=0)]
        )
        k = np.clip(np.searchsorted(begins, times, side="right") - 1, 0, len(begins) - 1)
        s = np.clip(2 * (times - begins[k]) / lengths[k] - 1, -1, 1)
        found: Array = whole[k] + lengths[k, None] / 2 * (_antiderivatives(s)[:, :, None] * polynomials[k]).sum(axis=1)
        return found


def _truncation(coefficients: Array) -> Array:
    """Estimated sizes of the first coefficients left out, shape (P,): the decay of the last ones goes on.

    At the end of a panel the integral is far better, exact to twice the degree; the estimate is of its interior.
    """
    sizes = np.abs(coefficients).sum(axis=2)
    last, before = sizes[:, -2:].sum(axis=1), sizes[:, -4:-2].sum(axis=1)
    error: Array = last * np.minimum(1.0, last / np.maximum(before, np.finfo(float).tiny)) ** DECAY
    return error


def _antiderivatives(s: Array) -> Array:
    """Integrals of Legendre's polynomials from -1 to s, shape (T, DEGREE + 1)."""
    from numpy.polynomial import legendre

    P = legendre.legvander(s, DEGREE + 1)
    return np.stack([s + 1] + [(P[:, j + 1] - P[:, j - 1]) / (2 * j + 1) for j in range(1, DEGREE + 1)], axis=1)
