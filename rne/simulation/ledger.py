"""The ledger of a motion: work of the drives and friction losses, integrated along the motion that is returned.

A panel is a few of the solver's steps. On it every power, on the steps' interpolants, is replaced by its polynomial
through Gauss's nodes, which is integrated exactly. A panel on which the polynomial's coefficients have not decayed is
halved; the number of steps in a panel follows from how often that happens.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import NamedTuple

import numpy as np

from ..basics.spatial import Array
from .solver import Interpolant, states_at

Powers = Callable[[Array, Array, Array | None], Array]  # times (N,), states (N, size), held torques -> (N, k)

DEGREE = 8  # of the polynomials
NEGLIGIBLE = 1e-8  # estimated error of a panel, in units of all energy exchanged so far
DECAY = 1.5  # the first coefficient left out is this power of the decay of the last ones times them
EASY = 1e-2  # of NEGLIGIBLE: below it panels may be twice as long
HALVINGS, SHORTEST = 12, 1e-13  # panels are not halved more often, nor below that part of the time
BLOCK = 24  # panels evaluated together
FIRST_STEPS, MOST_STEPS = 4, 64  # in a panel
ALIKE = 4.0  # largest ratio of its steps' lengths: a jump hides among short steps, where a long panel has no node


@cache
def gauss() -> tuple[Array, Array]:
    """Gauss's nodes in [-1, 1], and the matrix from values there to coefficients of Legendre's polynomials."""
    from numpy.polynomial import legendre

    nodes, _ = legendre.leggauss(DEGREE + 1)
    return nodes, np.linalg.inv(legendre.legvander(nodes, DEGREE))


class Span(NamedTuple):
    """A step, or its part before an event."""

    begin: float
    end: float
    interpolant: Interpolant


class Panel(NamedTuple):
    """Some spans, or a part of them from `begin` to `end`, in which the same torques are held and joints at rest."""

    begin: float
    end: float
    spans: tuple[Span, ...]
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
    count : int
        How many there are.
    """

    def __init__(self, powers: Powers, count: int) -> None:
        self.powers, self.count = powers, count
        self.pieces: list[tuple[float, float, Array]] = []  # begin, length and coefficients, shape (DEGREE + 1, k)
        self.exchanged = 0.0  # integral of the powers' sizes
        self.steps = FIRST_STEPS  # in a panel
        self._spans: list[Span] = []
        self._first_length = 0.0  # of the first of them
        self._held: Array | None = None
        self._at_rest: Array | None = None
        self._panels: list[Panel] = []

    @property
    def end(self) -> float:
        """The time up to which it was integrated."""
        return self.pieces[-1][0] + self.pieces[-1][1] if self.pieces else 0.0

    def add(self, span: Span, held: Array | None, at_rest: Array | None, *, is_last: bool) -> None:
        """Integrate over a step; the last one before the torques that are held or the joints at rest change."""
        length = span.end - span.begin
        if self._spans and not 1 / ALIKE <= length / self._first_length <= ALIKE:
            self._close_panel()
        if not self._spans:
            self._first_length = length
        if length > 0:
            self._spans.append(span)
        self._held, self._at_rest = held, at_rest
        if is_last or len(self._spans) >= self.steps:
            self._close_panel()

    def _close_panel(self) -> None:
        """Make a panel of the steps that were added since the last; enough of them are integrated together."""
        if self._spans:
            spans, self._spans = tuple(self._spans), []
            self._panels.append(Panel(spans[0].begin, spans[-1].end, spans, self._held, self._at_rest))
            if len(self._panels) >= BLOCK:
                self.integrate()

    def integrate(self) -> None:
        """Integrate over the panels that were added."""
        panels, self._panels = self._panels, []
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
        return self.powers(times, states, held).reshape(len(panels), DEGREE + 1, self.count)

    def at(self, times: Array) -> Array:
        """Energies since the start at times that were integrated over, shape (T, k)."""
        self._close_panel()
        self.integrate()
        if not self.pieces:
            return np.zeros((len(times), self.count))
        begins, lengths, polynomials = (np.array(part) for part in zip(*self.pieces, strict=True))
        whole = np.concatenate([np.zeros((1, self.count)), np.cumsum(lengths[:, None] * polynomials[:, 0], axis=0)])
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
