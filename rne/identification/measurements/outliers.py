"""Single samples that the samples beside them contradict: wild values, jumps, repeated positions."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ...basics.spatial import Array
from .findings import runs

BOUND = 10.0  # times the usual deviation from neighbours, above which a value is wild
LONGEST = 3  # wild values in a row that are found
WINDOW = 101  # samples from which the usual deviation is taken
NORMAL = 1.4826  # standard deviation of normal noise, per median of its magnitude
EXCEEDED = 95  # per cent of a record's deviations that are below twice the least usual one
LATTICE = 0.15  # scatter of differences about multiples of a step, as a part of it; 0.29 without a step
MULTIPLES = 5  # of the step, up to which differences are compared with it
REFINED = 5  # times that a step is fitted
NEGLIGIBLE = 1e-5  # step as a part of the median difference, that is rounding of numbers
FEWEST = 40  # differences from which a step is told
BESIDE = 6  # samples on either side of a repetition, through which a parabola is laid
CATCH_UP = 1.5  # step after a repetition, in steps beside
STUCK = 8.0  # deviation of repeated samples from the parabola, in deviations of the samples beside


class Neighbours(NamedTuple):
    """What the two samples before and the two after `length` samples say of these."""

    deviation: Array  # smallest magnitude among the samples, from the cubic through the four neighbours
    disagreement: Array  # between the lines through the two before and the two after, at the middle
    step: Array  # the larger of the steps before and after


def encoder_step(x: Array) -> float:
    """The step of which all differences of neighbours are multiples; zero if there is none."""
    steps = np.abs(np.diff(x))
    steps = np.sort(steps[steps > 0])
    if len(steps) < FEWEST:
        return 0.0
    step = float(np.median(steps[:FEWEST]))
    for _ in range(REFINED):
        small = steps[steps < MULTIPLES * step]
        multiples = np.rint(small / step)
        if not multiples.any():
            return 0.0
        step = float(small @ multiples / (multiples @ multiples))
    scatter = np.sqrt(np.mean((small / step - multiples) ** 2))
    return step if scatter < LATTICE and step > NEGLIGIBLE * np.median(steps) else 0.0


def neighbours(x: Array, length: int) -> Neighbours:
    """For every start k from 2 to len(x) - length - 2 of `length` samples."""
    count = len(x) - length - 3
    a, b, c, d = (x[k : k + count] for k in (0, 1, 2 + length, 3 + length))
    ends = np.array([-2.0, -1.0, length, length + 1.0])
    deviation = np.full(count, np.inf)
    for k in range(length):
        weights = [np.prod([(k - o) / (e - o) for o in ends if o != e]) for e in ends]  # Lagrange's polynomials
        expected = weights[0] * a + weights[1] * b + weights[2] * c + weights[3] * d
        deviation = np.minimum(deviation, np.abs(x[2 + k : 2 + k + count] - expected))
    middle = (length + 1) / 2
    disagreement = np.abs((b + middle * (b - a)) - (c - middle * (d - c)))
    return Neighbours(deviation, disagreement, np.maximum(np.abs(b - a), np.abs(d - c)))


def usual_deviation(x: Array, step: float) -> Array:
    """Usual deviation of a sample from its neighbours: of the samples about it, or of the record if that is more.

    About a sample the median, of the record the deviation that one in twenty exceeds; at least half a step.
    """
    deviation = np.pad(neighbours(x, 1).deviation, 2, mode="edge")
    blocks = np.array_split(deviation, max(1, len(deviation) // WINDOW))
    local = np.concatenate([np.full(len(block), NORMAL * np.median(block)) for block in blocks])
    usual: Array = np.maximum(local, max(float(np.percentile(deviation, EXCEEDED)) / 2, step / 2))
    return usual


def wild_values(x: Array, usual: Array) -> Array:
    """True at samples off the curve through their neighbours, up to `LONGEST` in a row, where these agree."""
    wild = np.zeros(len(x), dtype=bool)
    size = np.abs(x).max() * 1e-12
    for length in range(1, LONGEST + 1):
        off = neighbours(x, length)
        bound = BOUND * usual[2 : 2 + len(off.step)] + off.disagreement + off.step / 2 + size
        for k in np.flatnonzero(off.deviation > bound) + 2:
            wild[k : k + length] = True
    return wild


def jumps(x: Array, usual: Array) -> Array:
    """Samples k between which and the next one the position jumps, while the rates before and after agree."""
    steps = np.diff(x)
    before, at, after = steps[:-2], steps[1:-1], steps[2:]
    level = np.maximum(usual[1:-2], usual[2:-1])
    excess = np.abs(at - (before + after) / 2)
    smooth = np.maximum(np.abs(before), np.abs(after))
    bound = 2 * BOUND * level + 3 * np.abs(after - before) + smooth
    found: Array = np.flatnonzero(excess > bound) + 1
    return found


def repeated(x: Array, step: float) -> Array:
    """True at samples equal to the one before, off the curve of the motion, which the next sample makes up for.

    Positions rounded to coarse steps repeat too, but on the curve: they are as far from it as the samples beside.
    """
    found = np.zeros(len(x), dtype=bool)
    steps = np.abs(np.diff(x))
    least = max(step / 2, float(np.median(neighbours(x, 1).deviation)))
    for a, b in runs(np.concatenate([[False], steps == 0])):
        if a < BESIDE or b + BESIDE > len(x) or steps[b - 1] < CATCH_UP * max(steps[a - 2], steps[b], step):
            continue
        beside = np.concatenate([np.arange(a - BESIDE, a), np.arange(b, b + BESIDE)])
        curve = np.polynomial.Polynomial.fit(beside, x[beside], 2)
        usual = np.abs(x[beside] - curve(beside)).max()
        found[a:b] = np.abs(x[a:b] - curve(np.arange(a, b))).max() > STUCK * max(float(usual), least)
    return found
