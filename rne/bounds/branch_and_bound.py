"""Proven maximum of a convex function of a polynomial array over a box, by branch and bound on equal cells.

In a cell of half widths r, A(q) differs from the multilinear interpolation of its values at the corners by at most
sum_k K_k r_k^2 / 2 in the norm of K_k >= |d^2 A / dq_k^2|. The interpolation is a mean of the corners' values, so that
what holds for the corners with this slack holds for the whole cell. Cells share corners; all are halved along the
coordinate with the largest term, until each is proven or the budget is spent.
"""

from __future__ import annotations

import functools
import itertools
import time
from collections.abc import Callable, Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np

from ..basics.spatial import Array
from .articulated import ArticulatedSearch, applies
from .criteria import ROUNDING, Criterion
from .polynomials import Polynomial, PositionBox

BLOCK = 8192  # positions tested at once
DENSE = 2**27  # most corners of a whole grid stored as a table of bytes
MOST_CORNERS = 10**8  # most corners of all cells, shared ones counted for each
SMALL = 1e-14  # cost of leaving a coordinate out, relative to the sum of modes
FEW = 512  # random positions tested before the corners: if none passes, cells are too large
CLIMB = 1e-12  # least relative gain of a step
STARTS, SAMPLES = 6, 1000  # starts of a local search, the best of so many random positions
WORTH_GRIDS = 1e5  # expected corners from which grids are used
LITTLE = 0.1  # share of a curvature below which a group of modes gets no grid
CLOSE = 1.4  # ratio to the tolerance below which fractions are searched at the tolerance itself
USELESS = 1e3  # largest fraction that is searched
SHORTEST = 1e-3  # least assumed work of a search
OPERATIONS = 2e9  # operations per unit of work: 0.4 to 1 s on a core of 2 to 3 GHz
OF_CORNER = 16  # operations per corner of each cell
VANISHES = 4  # proven bound of a value that vanishes, relative to its rounding
ROUNDS = 20  # most rounds of the reduction of a basis of angles
STEPS = (10, 8, 6)  # steps of a full turn, per degree
OF_ENTRY = 16  # operations per number on a grid
MOST_POINTS, MOST_NUMBERS = 250_000, 4e6  # limits of a grid, the larger one counts


class Clock:
    """Clock that counts the work of proofs, equal on every machine, unless `seconds` of wall time stop it."""

    def __init__(self, seconds: float = np.inf) -> None:
        self.work, self.stopped, self.stop = 0.0, False, time.monotonic() + seconds

    def now(self) -> float:
        """Work done, in units of `Robot.bounds(budget=)`; infinite once it is stopped."""
        self.stopped = self.stopped or (self.stop < np.inf and time.monotonic() > self.stop)
        return np.inf if self.stopped else self.work

    def count(self, operations: float) -> None:
        """Add operations."""
        self.work += operations / OPERATIONS


class ProvenMaximum(NamedTuple):
    """Largest value of a criterion: proven bounds, the value attained, and its position."""

    lower: float
    upper: float
    attained: float
    q: Array


class Proof:
    """Proofs that a criterion exceeds the value attained by ever smaller fractions, down to `tolerance`.

    A value within the rounding error of 0 counts as 0.
    """

    def __init__(
        self, criterion: Criterion, box: PositionBox, tolerance: float, clock: Clock, upper: float = np.inf
    ) -> None:
        self.criterion, self.box, self.tolerance, self.clock = criterion, box, tolerance, clock
        self.kind: Any = ArticulatedSearch if applies(criterion, box) else CellSearch
        self.values = functools.partial(criterion.counted, clock=clock)
        self.q, self.best = local_maximum(self.values, box.lower, box.upper)
        self.fraction, self.cost, self.fails = self.kind.first, 0.0, not np.isfinite(self.best)
        self.floor = 0.0 if self.fails else criterion.rounding(0.0)
        self.upper = upper if self.fails else min(upper, criterion.size + criterion.rounding(self.best))

    @property
    def vanishes(self) -> bool:
        """True if the value attained is within the rounding error."""
        return self.best <= self.floor

    @property
    def gap(self) -> float:
        """Relative gap, upper / attained - 1."""
        return self.upper / max(self.best, self.floor) - 1

    @property
    def is_open(self) -> bool:
        """True if another search may prove more."""
        enough = VANISHES * self.floor if self.vanishes else (1 + self.tolerance) * self.best
        return not self.fails and self.upper > enough

    @property
    def result(self) -> ProvenMaximum:
        """Bounds proven so far; none for a value that may vanish but is not proven to."""
        if self.vanishes:
            return ProvenMaximum(0.0, self.upper if self.upper <= VANISHES * self.floor else np.inf, 0.0, self.q)
        lower = 0.0 if self.fails else max(self.best - self.criterion.rounding(self.best), 0.0)
        return ProvenMaximum(lower, self.upper, self.best, self.q)

    def step(self, work: float) -> None:
        """Run one search with a limit of its work; what it took decides the next fraction."""
        fraction = min(self.fraction, 0.7 * self.gap)
        fraction = self.tolerance if fraction < CLOSE * self.tolerance else fraction
        target = VANISHES * self.floor if self.vanishes else (1 + fraction) * self.best
        search = self.kind(self.criterion, self.box, self.q, target, self.clock)
        end = self.clock.now() + work
        proven = search.run(end)
        left = max(end - self.clock.now(), 0.0)
        if search.higher is not None:
            self.q, self.best = local_maximum(self.values, self.box.lower, self.box.upper, search.higher)
        elif proven:
            last = max(self.clock.now() - search.began, SHORTEST)
            factor = max(search.patience * left / last, 1) ** (-1 / search.exponent)
            factor = min(max(factor, search.step), 0.9)
            self.upper, self.fraction, self.cost = search.target, fraction * factor, last * factor**-search.exponent
        elif self.vanishes or fraction > min(0.69 * self.gap, USELESS):
            self.fails, self.cost = left > 0, 2 * work
        else:
            self.fraction = min(4 * fraction, float(np.sqrt(fraction * self.gap)))


def largest(
    criteria: Sequence[Criterion],
    box: PositionBox,
    tolerance: float,
    end: float,
    clock: Clock,
    uppers: Sequence[float] | None = None,
) -> list[ProvenMaximum]:
    """Largest values of criteria, improved until the clock shows `end`, from known `uppers` if there are any.

    The least tight one comes first, of those whose next search fits an equal share of the work, or fits at all.
    """
    known = [np.inf] * len(criteria) if uppers is None else uppers
    proofs = [Proof(c, box, tolerance, clock, upper) for c, upper in zip(criteria, known, strict=True)]
    while (open_ones := [proof for proof in proofs if proof.is_open]) and (left := end - clock.now()) > 0:
        share = left / len(open_ones)
        able = [p for p in open_ones if p.cost <= share] or [p for p in open_ones if p.cost <= left]
        if not able:
            break
        worst = max(able, key=lambda proof: proof.gap)
        worst.step(share if worst.cost <= share else left)
    return [proof.result for proof in proofs]


def local_maximum(
    values_of: Callable[[Array], Array],
    lower: Array,
    upper: Array,
    start: Array | None = None,
    starts: int = STARTS,
    last: float = 1e-9,
) -> tuple[Array, float]:
    """Local maximum from the best of random positions, by steps along the axes and at random, halved to `last`."""
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
    """Integer matrix B of q = B x, det B = 1, with small second derivatives with respect to x, diag(B^T gram B).

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


def groups(polynomial: Polynomial, frequency: Array, share: Array, entries: int) -> Iterator[tuple[Array, Array]]:
    """Modes that a grid of moderate size determines, shape (modes,), and its steps of each coordinate, shape (n,).

    Coordinates of least share are left out of a grid that would be too large; their modes are of a later group. Powers
    of sliding joints and frequencies that are not whole belong to no group and keep the sum of their moduli.
    """
    left = (polynomial.power == 0).all(axis=1) & (frequency == np.round(frequency)).all(axis=1)
    while left.any():
        degree = abs(frequency[left]).max(axis=0).astype(int)
        weight = np.where(degree > 0, share[left] @ abs(frequency[left]), np.inf)
        sizes = [np.maximum(steps * degree, 1) for steps in STEPS]
        most = max(MOST_POINTS, MOST_NUMBERS / entries)
        while not (fitting := [size for size in sizes if size.prod(dtype=float) <= most]):
            k = weight.argmin()
            weight[k] = np.inf
            sizes = [np.where(np.arange(len(size)) == k, 1, size) for size in sizes]
        on = left & (frequency[:, fitting[0] == 1] == 0).all(axis=1)
        if not on.any():
            return
        yield on, fitting[0]
        left &= ~on


def values_on_grid(frequency: Array, coefficients: Array, steps: Array) -> Iterator[Array]:
    """Real part of a sum of modes at equal steps of each coordinate, in blocks of one value of a coordinate."""
    degree = abs(frequency).max(axis=0).astype(int)
    sums = np.zeros((*(2 * degree + 1), *coefficients.shape[1:]), dtype=complex)
    np.add.at(sums, tuple((frequency.astype(int) + degree).T), coefficients)
    order, waves = np.argsort(-steps, kind="stable"), []
    for k in order:  # exp(i m x) = cos(m x) + i sin(m x)
        m, x = np.arange(-degree[k], degree[k] + 1), 2 * np.pi / steps[k] * np.arange(steps[k])
        real = (abs(m) == m[:, None]) - 1j * np.sign(m) * (-abs(m) == m[:, None])
        sums = np.moveaxis(np.tensordot(real, sums, (1, k)), 0, k)
        waves.append(np.where(m < 0, np.sin(np.outer(x, m)), np.cos(np.outer(x, m))))
    sums = np.ascontiguousarray(sums.real.transpose([*order, *range(len(order), sums.ndim)]))
    for first in waves[0]:
        block = np.tensordot(first, sums, 1)
        for wave in waves[1:]:
            block = np.tensordot(block, wave, (0, 1))
        yield np.moveaxis(block.reshape(*coefficients.shape[1:], -1), -1, 0)


def ratio_on_grid(
    criterion: Criterion, frequency: Array, on: Array, weights: Array, steps: Array, clock: Clock, work: float
) -> float | None:
    """Bound of phi of the weighted sum of modes `on`, over the sum of their phi; None if it takes more than `work`.

    A trigonometric polynomial of degree d is nowhere larger than its largest value at N equal steps over cos(pi d / N),
    as follows from a theorem of M. Riesz (Ehlich and Zeller 1964, Mathematische Zeitschrift 86, 41). Of several angles
    the factors are multiplied. It holds for each seminorm of an array, a largest value of linear functions.
    """
    most, began = 0.0, clock.now()
    coefficients = (weights * criterion.grid_coefficients[on].T).T
    for number, values in enumerate(values_on_grid(frequency, coefficients, steps), start=1):
        most = criterion.ratio(values, on, weights, most)
        clock.count(values.size * OF_ENTRY)
        if (clock.now() - began) * steps.max() > number * work:
            return None
    between = np.cos(np.pi * abs(frequency).max(axis=0) / steps).prod()
    return float(min(most / between + ROUNDING, 1.0))


class CellSearch:
    """Search over a grid of cells, which are halved until the target is proven for all."""

    first = 1.0  # fraction at which searches begin
    patience = 0.7  # part of the work left that the next search shall take

    def __init__(self, criterion: Criterion, box: PositionBox, q: Array, target: float, clock: Clock) -> None:
        self.criterion, self.box, self.target, self.clock = criterion, box, target, clock
        self.step, self.exponent = criterion.time_model
        self.best = float(criterion.values(q[None])[0])
        self.began = 0.0
        self.radius = (box.upper - box.lower) / 2
        polynomial, share = criterion.polynomial, criterion.importance(q)
        frequency = polynomial.frequency
        self.basis = short_basis(np.einsum("m,mi,mj->ij", share, frequency, frequency), box.circle)
        self.share = share
        slope, self.curvatures = polynomial.derivatives(self.basis)
        # A coordinate that A hardly depends on stays at its middle, at the cost of its derivative times the half width.
        cost = share @ slope * self.radius
        self.free = cost > SMALL * share.sum()
        self.fixed_weights = ROUNDING + slope @ np.where(self.free, 0.0, self.radius)
        self.counts = np.ones(len(self.radius), dtype=np.int64)
        self.cells = np.zeros((1, len(self.radius)), dtype=np.int64)
        self.samples = np.random.default_rng(2).uniform(box.lower, box.upper, (FEW, len(self.radius)))
        self.higher: Array | None = None

    def slack(self) -> Any:
        """Slack of cells of the present size."""
        terms = np.where(self.free, (self.radius / self.counts) ** 2 / 2, 0.0)
        return self.criterion.slack(self.fixed_weights + self.curvatures @ terms)

    def run(self, deadline: float) -> bool:
        """True if all cells are proven, False after the deadline or if a position is `higher`."""
        if self.criterion.has_ratios and self.corners_expected() > WORTH_GRIDS:
            self.use_grids(deadline)
        self.began = self.clock.now()
        while self.prove(deadline):
            if not len(self.cells):
                return True
            if len(self.cells) * 2.0 ** self.free.sum() > MOST_CORNERS or not self.free.any():
                return False
            self.halve()
        return False

    @property
    def curvature(self) -> Array:
        """Bound K_k of the second derivative with respect to each coordinate; -1 for those kept at their middle."""
        return np.where(self.free, self.share @ self.curvatures, -1.0)

    def corners_expected(self) -> float:
        """Number of corners, over the whole box, of cells whose slack is the gap."""
        terms = self.free.sum() * self.curvature * self.radius**2 / (2 * (self.target - self.best))
        return float(np.sqrt(np.maximum(terms, 1)).prod())

    def use_grids(self, deadline: float) -> None:
        """Replace sums of moduli by the smaller bounds of second derivatives that grids prove, if work is left."""
        criterion, known = self.criterion, self.criterion.ratios
        frequency = criterion.polynomial.frequency @ self.basis
        parts = groups(criterion.polynomial, frequency, self.share, criterion.grid_coefficients[0].size)
        for number, (on, steps) in enumerate(parts):
            matters = self.share[on] @ self.curvatures[on] > LITTLE * self.curvature
            places = np.flatnonzero(self.free & matters).tolist()
            for place, k in enumerate(places):
                weights = self.curvatures[on, k]
                work = (deadline - self.clock.now()) / (len(places) - place)
                found = known.get((number, k))
                ratio = found or ratio_on_grid(criterion, frequency[on], on, weights, steps, self.clock, work)
                if ratio is None:
                    return
                known[number, k] = ratio
                self.curvatures[on, k] = weights * ratio

    def halve(self) -> None:
        """Halve the cells along the coordinate with the largest term of the slack."""
        k = int((self.curvature / self.counts**2 * self.radius**2).argmax())
        self.counts[k] *= 2
        self.cells[:, k] *= 2
        other = self.cells.copy()
        other[:, k] += 1
        self.cells = np.vstack([self.cells, other])

    def prove(self, deadline: float) -> bool:
        """Drop the cells whose corners all pass; False after the deadline or if a corner is above the target."""
        if self.clock.now() > deadline:
            return False
        slack = self.slack()
        self.clock.count(FEW * self.criterion.operations)
        if not self.criterion.holds(self.samples, self.target, slack).any():
            return True  # cells are too large for any to hold
        self.clock.count(OF_CORNER * len(self.cells) * 2.0 ** self.free.sum())
        corners = Corners(self.cells, self.counts, self.free, self.box)
        holds = np.zeros(len(corners.numbers), dtype=bool)
        for start in range(0, len(holds), BLOCK):
            if self.clock.now() > deadline:
                return False
            q = corners.positions(corners.numbers[start : start + BLOCK]) @ self.basis.T
            self.clock.count(len(q) * self.criterion.operations)
            now = holds[start : start + BLOCK] = self.criterion.holds(q, self.target, slack)
            if self._is_higher(q[~now]):
                return False
        self.cells = self.cells[~corners.all_of(holds)]
        return True

    def _is_higher(self, q: Array) -> bool:
        """True if the value at a position exceeds the target, which becomes `higher`."""
        self.clock.count(len(q) * self.criterion.operations)
        q = q[~self.criterion.holds(q, self.target, 0 * self.slack())] if len(q) else q
        values = self.criterion.counted(q, self.clock) if len(q) else np.zeros(0)
        if (values > self.target).any():
            self.higher = q[values.argmax()]
        return self.higher is not None


class Corners:
    """Corners of cells, each counted once."""

    def __init__(self, cells: Array, counts: Array, free: Array, box: PositionBox) -> None:
        self.cells, self.counts, self.free, self.box = cells, counts, free, box
        self.points = np.where(free, counts + ~box.circle, 1)  # on each axis; a circle ends where it begins
        total = int(self.points.prod(dtype=float))
        whole = np.int32 if total < 2**31 else np.int64
        self.strides = np.concatenate([[1], np.cumprod(self.points[:-1])]).astype(whole)
        self.table: Array | None = None  # of all corners: True for those of cells, then for those that hold
        if total <= DENSE:
            self.table = np.zeros(total, dtype=bool)
            for numbers in self.sides():
                self.table[numbers] = True
            self.numbers = np.flatnonzero(self.table)
        else:
            numbers = np.sort(np.concatenate(list(self.sides())))  # np.unique's hash table takes eight times the time
            self.numbers = numbers[np.append(True, numbers[1:] > numbers[:-1])]

    def sides(self) -> Iterator[Array]:
        """Indices of one corner of every cell, corner by corner."""
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
        return np.asarray(self.box.lower + np.where(self.free, index / self.counts, 0.5) * width)

    def all_of(self, holds: Array) -> Array:
        """True for each cell all of whose corners hold."""
        if self.table is not None:
            self.table[self.numbers] = holds
        proven = np.ones(len(self.cells), dtype=bool)
        for numbers in self.sides():
            proven &= self.table[numbers] if self.table is not None else holds[np.searchsorted(self.numbers, numbers)]
        return proven
