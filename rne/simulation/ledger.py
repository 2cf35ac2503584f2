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
from .solver import Span, Steps, states_at

Powers = Callable[[Array, Array, Array | None], Array]  # times (N,), states (N, size), held torques -> (N, k)

DEGREE = 8  # of the polynomials
NEGLIGIBLE = 1e-8  # estimated error of a panel, in units of all energy exchanged so far
DECAY = 1.5  # the first coefficient left out is this power of the decay of the last ones times them
EASY = 1e-2  # of NEGLIGIBLE: below it panels may be twice as long
HALVINGS, SHORTEST = 12, 1e-13  # panels are not halved more often, nor below that part of the time
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


class Panel(NamedTuple):
    """Some spans, or a part of them from `begin` to `end`, in which the same torques are held and joints at rest."""

    begin: float
    end: float
    spans: list[Span]
    held: Array | None
    at_rest: Array | None

    def halves(self) -> tuple[Panel, Panel]:
        """Two halves: of the spans, between which the interpolants have corners, or of the only one."""
        if len(self.spans) > 1:
            first, second = self.spans[: len(self.spans) // 2], self.spans[len(self.spans) // 2 :]
            middle = first[-1].end
            return self._replace(end=middle, spans=first), self._replace(begin=middle, spans=second)
        middle = (self.begin + self.end) / 2
        return self._replace(end=middle), self._replace(begin=middle)


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
        self.pieces: list[tuple[float, float, Array]] = []  # begin, length and coefficients, shape (DEGREE + 1, k)
        self.exchanged = 0.0  # integral of the powers' sizes
        self.steps, self.block = FIRST_STEPS, BLOCK  # in a panel, and panels evaluated together
        self._taken: list[tuple[Steps, int, float, Array | None, Array | None, bool]] = []  # to be integrated
        self._is_open = False  # the torques that are held, and the joints at rest, are those of the steps before
        self._count = 0  # of steps taken

    @property
    def end(self) -> float:
        """The time up to which it was integrated."""
        return self.pieces[-1][0] + self.pieces[-1][1] if self.pieces else 0.0

    def add(self, steps: Steps, count: int, end: float, held: Array | None, at_rest: Array | None) -> None:
        """So many steps were taken, the last as far as `end`."""
        steps.keep()
        self._taken.append((steps, count, end, held, at_rest, self._is_open))
        self._is_open, self._count = True, self._count + count
        if self._count > MOST_KEPT:
            self.integrate()

    def close(self) -> None:
        """The torques that are held, or the joints at rest, change here."""
        self._is_open = False

    def integrate(self) -> None:
        """Integrate over the steps that were added."""
        taken, self._taken, self._is_open, self._count = self._taken, [], False, 0
        panels: list[Panel] = []
        for group in _groups(taken):
            first, spans = 0, group.spans
            while first < len(spans):
                last = self._last(spans, first)
                begin, end = spans[first].begin, spans[last - 1].end
                panels.append(group._replace(begin=begin, end=end, spans=spans[first:last]))
                first = last
                if len(panels) >= self.block:
                    self._integrate(panels)
                    panels, self.block = [], min(2 * self.block, MOST_AT_ONCE)
        self._integrate(panels)

    def _last(self, spans: list[Span], first: int) -> int:
        """Where a panel of steps of similar lengths ends that begins with span `first`."""
        length, last = spans[first].end - spans[first].begin, first + 1
        while last < min(len(spans), first + self.steps):
            if not 1 / ALIKE <= (spans[last].end - spans[last].begin) / length <= ALIKE:
                break
            last += 1
        return last

    def _integrate(self, panels: list[Panel]) -> None:
        done: list[tuple[float, float, Array]] = []
        for halving in range(HALVINGS + 1):
            if not panels:
                break
            lengths = np.array([panel.end - panel.begin for panel in panels])
            coefficients = gauss()[1] @ self._at_nodes(panels)
            errors = lengths * _truncation(coefficients)
            if halving == 0:
                self.exchanged += float((lengths * np.abs(coefficients[:, 0]).sum(axis=1)).sum())
                self._adapt(errors)
            divisible = lengths > SHORTEST * np.array([abs(panel.end) for panel in panels])
            rough = (errors > NEGLIGIBLE * self.exchanged) & divisible & (halving < HALVINGS)
            done += [
                (panel.begin, float(length), c)
                for panel, length, c, bad in zip(panels, lengths, coefficients, rough, strict=True)
                if not bad
            ]
            panels = [half for panel, bad in zip(panels, rough, strict=True) if bad for half in panel.halves()]
        self.pieces += sorted(done, key=lambda piece: piece[0])

    def _adapt(self, errors: Array) -> None:
        """The length of the next panels."""
        if np.mean(errors > NEGLIGIBLE * self.exchanged) > 0.1:
            self.steps = max(1, self.steps // 2)
        elif np.mean(errors > EASY * NEGLIGIBLE * self.exchanged) < 0.1:
            self.steps = min(MOST_STEPS, self.steps * 2)

    def _at_nodes(self, panels: list[Panel]) -> Array:
        """Powers at the nodes of each panel, shape (P, DEGREE + 1, k)."""
        begins, ends = (np.array([panel[k] for panel in panels])[:, None] for k in (0, 1))
        times = (begins + (ends - begins) * (1 + gauss()[0]) / 2).ravel()
        states = states_at(times, [span for panel in panels for span in panel.spans])
        held = None
        if panels[0].held is not None:
            held = np.repeat([panel.held for panel in panels], DEGREE + 1, axis=0)
        for k, panel in enumerate(panels):
            if panel.at_rest is not None:
                states[k * (DEGREE + 1) : (k + 1) * (DEGREE + 1), panel.at_rest] = 0.0
        return self.powers(times, states, held).reshape(len(panels), DEGREE + 1, len(self.names))

    def at(self, times: Array) -> Array:
        """Energies since the start at times that were integrated over, shape (T, k)."""
        self.integrate()
        if not self.pieces:
            return np.zeros((len(times), len(self.names)))
        begins, lengths, polynomials = (np.array(part) for part in zip(*self.pieces, strict=True))
        whole = np.concatenate(
            [np.zeros((1, len(self.names))), np.cumsum(lengths[:, None] * polynomials[:, 0], axis=0)]
        )
        k = np.clip(np.searchsorted(begins, times, side="right") - 1, 0, len(begins) - 1)
        s = np.clip(2 * (times - begins[k]) / lengths[k] - 1, -1, 1)
        found: Array = whole[k] + lengths[k, None] / 2 * (_antiderivatives(s)[:, :, None] * polynomials[k]).sum(axis=1)
        return found


def _groups(taken: Sequence[tuple[Steps, int, float, Array | None, Array | None, bool]]) -> list[Panel]:
    """Steps that were taken under the same torques, with the same joints at rest."""
    groups: list[Panel] = []
    for steps, count, until, held, at_rest, goes_on in taken:
        ends, own = [*steps.T[:count].tolist(), until], steps.torques(np.arange(count))
        new = np.zeros(count, dtype=bool)
        new[0] = own is not None or not goes_on
        if own is not None:
            new[1:] = (own[1:] != own[:-1]).any(axis=1)
        for k, is_new in enumerate(new.tolist()):
            if is_new:
                groups.append(Panel(ends[k], ends[k + 1], [], held if own is None else own[k], at_rest))
            if ends[k + 1] > ends[k]:
                groups[-1].spans.append(Span(ends[k], ends[k + 1], steps, k))
    return groups


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
