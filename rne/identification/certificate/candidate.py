"""A hypothesis with what it leaves unexplained, and the fit of its free numbers."""

from __future__ import annotations

from dataclasses import dataclass
from math import comb

import numpy as np

from ...basics.spatial import Array
from .evidence import Evidence
from .groups import Group

RANK = 1e-9  # singular values below this part of the largest, of columns of unit length, are rounding
PAIR = " and "  # between the causes of a pair
NEAR = 0.2  # distance of a fitted coefficient from a named one at which that is tried


@dataclass(frozen=True, eq=False)
class Candidate:
    """A hypothesis on the difference between two models, of `ModelComparison.candidates`.

    Attributes
    ----------
    causes : tuple of str
        One cause, or two that act together.
    text : str
        What it says of the other model.
    numbers : int
        Free numbers that were fitted.
    alternatives : float
        How many hypotheses it was chosen from.
    residual : ndarray, shape (R, n)
        Torques that it does not explain [N m or N].
    score : float
        Smaller is better.
    explains : bool
        True if no joint's residual is above rounding or noise.

    Examples
    --------
    >>> import rne
    >>> robot = rne.load("irb140")
    >>> best = rne.compare_models(robot, robot.with_payload(3.0)).candidates[0]
    >>> best.causes, best.numbers, best.explains
    (('payload',), 4, True)
    """

    causes: tuple[str, ...]
    text: str
    numbers: int
    alternatives: float
    residual: Array
    score: float
    explains: bool

    @classmethod
    def of(
        cls, evidence: Evidence, causes: tuple[str, ...], text: str, numbers: int, alternatives: float, residual: Array
    ) -> Candidate:
        score = evidence.score(residual, numbers, alternatives)
        return cls(causes, text, numbers, alternatives, residual, score, evidence.explains(residual))

    def followed_by(self, evidence: Evidence, other: Candidate) -> Candidate:
        """Both together; the other was fitted to what this one leaves."""
        causes, text = (*self.causes, *other.causes), f"{self.text}; {other.text}"
        numbers, alternatives = self.numbers + other.numbers, self.alternatives * other.alternatives
        return Candidate.of(evidence, causes, text, numbers, alternatives, other.residual)


@dataclass(frozen=True, eq=False)
class Fit:
    """Coefficients of columns, and how many of them are free."""

    coefficients: Array
    rank: int


class Fitter:
    """Least squares of one residual by the columns of one group."""

    def __init__(self, evidence: Evidence, group: Group, difference: Array) -> None:
        self.evidence, self.group, self.difference = evidence, group, difference
        self.A = evidence.weighted(group.columns)
        self.b = evidence.weighted(difference)
        self.lengths = np.linalg.norm(self.A, axis=0)

    def fit(self, kept: Array) -> Fit:
        """Coefficients of the columns chosen; the others are zero."""
        kept = kept[self.lengths[kept] > 0]
        coefficients = np.zeros(self.A.shape[1])
        if not len(kept):
            return Fit(coefficients, 0)
        scaled = self.A[:, kept] / self.lengths[kept]
        found, _, rank, _ = np.linalg.lstsq(scaled, self.b, rcond=RANK)
        coefficients[kept] = found / self.lengths[kept]
        return Fit(coefficients, int(rank))

    def candidate(self, fit: Fit, kept: int) -> Candidate:
        """The hypothesis that a fit makes; `kept` columns were chosen among those of the group."""
        alternatives = self.group.alternatives * (comb(self.A.shape[1], kept) if self.group.prune else 1)
        c = fit.coefficients
        return self._made(tuple(self.group.cause.split(PAIR)), self.group.text(c), fit.rank, alternatives, c)

    def _made(self, causes: tuple[str, ...], text: str, numbers: int, alternatives: float, c: Array) -> Candidate:
        return Candidate.of(
            self.evidence, causes, text, numbers, alternatives, self.difference - self.group.columns @ c
        )

    def pruned(self) -> Candidate:
        """The best fit with as few columns as possible: those that matter least are left out one after another."""
        kept = np.arange(self.A.shape[1])
        best = self.candidate(self.fit(kept), len(kept))
        while self.group.prune and len(kept) > 1:
            fit = self.fit(kept)
            sizes = np.abs(fit.coefficients[kept]) * self.lengths[kept]
            kept = np.delete(kept, int(np.argmin(sizes)))
            candidate = self.candidate(self.fit(kept), len(kept))
            if candidate.score < best.score or (candidate.explains and not best.explains):
                best = candidate
        return best

    def named(self) -> list[Candidate]:
        """Hypotheses without free numbers."""
        found = [
            self._made((named.cause,), named.text, 0, named.alternatives, named.values) for named in self.group.named
        ]
        for value in self.group.values:
            full = self.fit(np.arange(self.A.shape[1])).coefficients
            c = np.where(np.abs(full / value - 1) < NEAR, value, 0.0)
            chosen = int(np.count_nonzero(c))
            if chosen:
                alternatives = self.group.alternatives * comb(len(c), chosen)
                found.append(self._made((self.group.cause,), self.group.text(c), 0, alternatives, c))
        return found

    def best(self) -> list[Candidate]:
        """All hypotheses of the group: with and without free numbers."""
        free = [] if self.group.values else [self.pruned()]
        return [*self.named(), *free]


def joint_group(first: Group, second: Group) -> Group:
    """Two causes at once."""
    columns = np.concatenate([first.columns, second.columns], axis=-1)
    k = first.columns.shape[-1]

    def text(c: Array) -> str:
        return f"{first.text(c[:k])}; {second.text(c[k:])}"

    return Group(f"{first.cause}{PAIR}{second.cause}", columns, text, prune=False)
