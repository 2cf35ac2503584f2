"""The largest value of a convex function of a polynomial array over a box, with proof: branch and bound on equal cells.

In a cell of half widths r, A(q) differs from the multilinear interpolation of its values at the corners by at most
sum_k K_k r_k^2 / 2 in the norm of K_k >= |d^2 A / dq_k^2|. The interpolation is a mean of the corners' values, so that
what holds for the corners with this slack holds for the whole cell. Cells share corners; all are halved along the
coordinate with the largest term, until each is proven or the budget is spent.
"""

from __future__ import annotations

import itertools
import time
from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import numpy as np

from ..basics.spatial import Array
from .articulated import ArticulatedSearch, applies
from .criteria import ROUNDING, Criterion
from .polynomials import Box

BLOCK = 8192  # positions that are tested at once
DENSE = 2**27  # corners of a whole grid that are held as a table of bytes
MOST_CORNERS = 10**8  # of all cells, shared ones counted for each
SMALL = 1e-14  # of the sum of modes: what leaving a coordinate out may cost
FEW = 512
CLIMB = 1e-12  # least relative gain of a step
STARTS, SAMPLES = 6, 1000
ROUNDS = 20  # of the reduction of a basis of angles


class Clock:
    """Measures a budget of seconds."""

    def now(self) -> float:
        """Seconds since some moment."""
        return time.monotonic()

    def count(self, positions: int) -> None:
        """Called for positions that are tested."""


class PositionCounter(Clock):
    """Measures a budget of positions, so that results do not depend on the speed of the machine."""

    def __init__(self) -> None:
        self.positions = 0

    def now(self) -> float:
        """Positions that were tested."""
        return self.positions

    def count(self, positions: int) -> None:
        """Add positions."""
        self.positions += positions


class Extreme(NamedTuple):
    """A constant proven to be between `lower` and `upper`, the value attained, and where."""

    lower: float
    upper: float
    attained: float
    q: Array


def largest(criterion: Criterion, box: Box, tolerance: float, budget: float, clock: Clock) -> Extreme:
    """The largest value, proven within ever smaller fractions of the one attained, to `tolerance` within the budget.

    Where what is attained is within the rounding of 0, it is called 0.
    """
    deadline = clock.now() + budget
    q, best = climbed(criterion.values, box.lower, box.upper)
    if best <= criterion.rounding(0.0):
        return Extreme(0.0, criterion.size + criterion.rounding(0.0), 0.0, q)
    kind: Any = ArticulatedSearch if applies(criterion, box) else Search
    upper, fraction = criterion.size + criterion.rounding(best), kind.first
    while upper > (1 + tolerance) * best and (began := clock.now()) < deadline:
        gap = upper / best - 1
        fraction = max(tolerance, min(fraction, 0.7 * gap))
        search = kind(criterion, box, q, (1 + fraction) * best, clock)
        proven = search.run(began + kind.patience * (deadline - began))
        if search.higher is not None:
            q, best = climbed(criterion.values, box.lower, box.upper, search.higher)
        elif proven:
            upper, now = search.target, clock.now()
            left = (deadline - now) / 2 / max(now - began, 1e-3)  # times the last search, about fraction^-exponent
            fraction *= np.clip(left ** (-1 / kind.exponent), kind.step, 0.8) if left > 0 else 0.8
        elif fraction > 0.69 * gap:
            break
        else:
            fraction = min(4 * fraction, np.sqrt(fraction * gap))
    return Extreme(best - criterion.rounding(best), upper, best, q)


def climbed(
    values_of: Callable[[Array], Array],
    lower: Array,
    upper: Array,
    start: Array | None = None,
    starts: int = STARTS,
    last: float = 1e-9,
) -> tuple[Array, float]:
    """A local maximum from the best of random positions, by steps along the axes and at random, halved to `last`."""
    rng = np.random.default_rng(1)
    width = upper - lower
    q = rng.uniform(lower, upper, (max(SAMPLES, starts), len(width)))
    q = np.vstack([q, (lower + upper) / 2] + ([] if start is None else [start]))
    values = values_of(q)
    order = np.argsort(-values)[:starts]
    q, values = q[order], values[order]
    step = np.full(len(q), 0.1)
    while step.max() > last:
        moves = np.vstack([np.eye(len(width)), -np.eye(len(width)), rng.normal(size=(2 * len(width), len(width))) / 2])
        tried = np.clip(q[:, None] + step[:, None, None] * width * moves, lower, upper)
        found = values_of(tried.reshape(-1, len(width))).reshape(len(q), -1)
        k = found.argmax(axis=1)
        better = found[range(len(q)), k] > values + CLIMB * abs(values)
        q = np.where(better[:, None], tried[range(len(q)), k], q)
        values = np.where(better, found[range(len(q)), k], values)
        step = np.where(better, np.minimum(1.5 * step, 0.1), step / 2)
    return q[values.argmax()], float(values.max())


def short_basis(gram: Array, circle: Array) -> Array:
    """Whole numbers B of q = B x, det B = 1, for which the second derivatives by x, diag(B^T gram B), are small.

    Full turns of all angles are full turns of all x. Pairs of columns are reduced as by Lagrange (Cohen 1993, 1.3).
    Where axes are parallel, x are sums of angles.
    """
    basis = np.eye(len(gram))
    for _ in range(ROUNDS):
        before = basis.copy()
        for a, b in itertools.permutations(np.flatnonzero(circle), 2):
            size = basis[:, b] @ gram @ basis[:, b]
            basis[:, a] -= np.round(basis[:, a] @ gram @ basis[:, b] / size) * basis[:, b] if size > 0 else 0
        if (basis == before).all():
            break
    return basis


class Search:
    """Cells of a grid that are not proven yet."""

    first, step = 1.0, 0.3  # fraction at which searches begin, and least factor on it
    exponent = 2.5  # time is about fraction^-exponent
    patience = 0.6  # part of the time left for one search

    def __init__(self, criterion: Criterion, box: Box, q: Array, target: float, clock: Clock) -> None:
        self.criterion, self.box, self.target, self.clock = criterion, box, target, clock
        self.radius = (box.upper - box.lower) / 2
        polynomial, share = criterion.polynomial, criterion.importance(q)
        self.basis = short_basis(
            np.einsum("m,mi,mj->ij", share, polynomial.frequency, polynomial.frequency), box.circle
        )
        slope, self.curvatures = polynomial.derivatives(self.basis)
        # A coordinate on which A hardly depends stays at its middle, at the cost of its slope times the half width.
        cost = share @ slope * self.radius
        self.free = cost > SMALL * share.sum()
        self.curvature = np.where(self.free, share @ self.curvatures, -1.0)
        self.fixed_weights = ROUNDING + slope @ np.where(self.free, 0.0, self.radius)
        self.counts = np.ones(len(self.radius), dtype=np.int64)
        self.cells = np.zeros((1, len(self.radius)), dtype=np.int64)
        self.samples = np.random.default_rng(2).uniform(box.lower, box.upper, (FEW, len(self.radius)))
        self.higher: Array | None = None

    def slack(self) -> Any:
        """Of cells of the present size."""
        terms = np.where(self.free, (self.radius / self.counts) ** 2 / 2, 0.0)
        return self.criterion.slack(self.fixed_weights + self.curvatures @ terms)

    def run(self, deadline: float) -> bool:
        """True if all cells are proven, False after the deadline or if a position is `higher`."""
        while self.prove(deadline):
            if not len(self.cells):
                return True
            if len(self.cells) * 2.0 ** self.free.sum() > MOST_CORNERS or not self.free.any():
                return False
            self.halve()
        return False

    def halve(self) -> None:
        """Halve the cells along the coordinate that the slack owes most to."""
        k = int((self.curvature / self.counts**2 * self.radius**2).argmax())
        self.counts[k] *= 2
        self.cells[:, k] *= 2
        other = self.cells.copy()
        other[:, k] += 1
        self.cells = np.vstack([self.cells, other])

    def prove(self, deadline: float) -> bool:
        """Drop the cells whose corners all hold; False after the deadline or if a corner is above the target."""
        if self.clock.now() > deadline:
            return False
        slack = self.slack()
        self.clock.count(FEW)
        if not self.criterion.holds(self.samples, self.target, slack).any():
            return True  # cells are too large for any to hold
        corners = Corners(self.cells, self.counts, self.free, self.box)
        holds = np.zeros(len(corners.numbers), dtype=bool)
        for start in range(0, len(holds), BLOCK):
            if self.clock.now() > deadline:
                return False
            q = corners.positions(corners.numbers[start : start + BLOCK]) @ self.basis.T
            self.clock.count(len(q))
            now = holds[start : start + BLOCK] = self.criterion.holds(q, self.target, slack)
            if self._is_higher(q[~now]):
                return False
        self.cells = self.cells[~corners.all_of(holds)]
        return True

    def _is_higher(self, q: Array) -> bool:
        """Whether the value at one of the positions is above the target; then it is `higher`."""
        q = q[~self.criterion.holds(q, self.target, 0 * self.slack())] if len(q) else q
        values = self.criterion.values(q) if len(q) else np.zeros(0)
        if (values > self.target).any():
            self.higher = q[values.argmax()]
        return self.higher is not None


class Corners:
    """The corners of cells, each once."""

    def __init__(self, cells: Array, counts: Array, free: Array, box: Box) -> None:
        self.cells, self.counts, self.free, self.box = cells, counts, free, box
        self.points = np.where(
            free, counts + np.where(box.circle, 0, 1), 1
        )  # on each axis; a circle ends where it begins
        total = int(self.points.prod(dtype=float))
        whole = np.int32 if total < 2**31 else np.int64
        self.strides = np.concatenate([[1], np.cumprod(self.points[:-1])]).astype(whole)
        if total <= DENSE:
            present = np.zeros(total, dtype=bool)
            for numbers in self.sides():
                present[numbers] = True
            self.numbers = np.flatnonzero(present)
        else:
            self.numbers = np.unique(np.concatenate(list(self.sides())))

    def sides(self) -> Iterator[Array]:
        """Number of each cell's corner on one side after the other."""
        axes = np.flatnonzero(self.free)
        cells, points, strides = self.cells[:, axes].T, self.points[axes, None], self.strides[axes, None]
        cells, points = cells.astype(strides.dtype), points.astype(strides.dtype)
        ends = list(zip(cells * strides, (cells + 1) % points * strides, strict=True))

        def sums(k: int, partial: Array) -> Iterator[Array]:
            if k == len(ends):
                yield partial
            else:
                for end in ends[k]:
                    yield from sums(k + 1, partial + end)

        return sums(0, np.zeros(len(self.cells), dtype=self.strides.dtype))

    def positions(self, numbers: Array) -> Array:
        """Positions of corners, shape (N, n)."""
        index = numbers[:, None] // self.strides % self.points
        width = self.box.upper - self.box.lower
        q: Array = self.box.lower + np.where(self.free, index / self.counts, 0.5) * width
        return q

    def all_of(self, holds: Array) -> Array:
        """True for each cell all of whose corners hold."""
        total = int(self.points.prod(dtype=float))
        table = np.zeros(total, dtype=bool) if total <= DENSE else None
        if table is not None:
            table[self.numbers[holds]] = True
        proven = np.ones(len(self.cells), dtype=bool)
        for numbers in self.sides():
            proven &= table[numbers] if table is not None else holds[np.searchsorted(self.numbers, numbers)]
        return proven
