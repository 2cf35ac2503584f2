"""Joints that move together: the smallest groups of bodies whose coordinates move no body of another group."""

from __future__ import annotations

from itertools import product
from math import prod

import numpy as np

from ..basics.spatial import Array
from .model import Model

GRID = 1000  # samples of a group at most on a grid
SEEDED = 400  # samples of a group otherwise
LONGEST = 400  # samples of one coordinate


def joint_groups(model: Model) -> list[tuple[int, ...]]:
    """Bodies by groups, in tree order; each group is carried by one body outside of it, or by the base.

    A joint that mimics no other and is mimicked by none is a group by itself. Others are joined with those that mimic
    them, and with the bodies on the paths between them.
    """
    carriers: list[set[int]] = []  # of each body, itself included
    for i, parent in enumerate(model.parent):
        carriers.append({i} | (carriers[parent] if parent >= 0 else set()))
    group = list(range(model.nb))
    while True:
        before = list(group)
        for k in range(model.n):
            _join(group, {i for i in range(model.nb) if model.coordinate[i] == k})
        for label in sorted(set(group)):
            bodies = [i for i in range(model.nb) if group[i] == label]
            if len(bodies) > 1:
                outside = set.intersection(*(carriers[i] - {i} for i in bodies))
                _join(group, set.union(*(carriers[i] for i in bodies)) - outside)
        if group == before:
            return [tuple(i for i in range(model.nb) if group[i] == label) for label in sorted(set(group))]


def _join(group: list[int], bodies: set[int]) -> None:
    labels = {group[i] for i in bodies}
    group[:] = [min(labels) if label in labels else label for label in group]


def sample_positions(model: Model, bodies: tuple[int, ...], coordinates: list[int]) -> Array:
    """Positions of a group's coordinates that determine its energies for all others, shape (samples, coordinates).

    Energies are of degree two in the sine and cosine of a rotating joint, and in the position of a sliding one. So five
    angles, or three positions, determine them. For several joints on one coordinate they are sums of exponentials and
    powers, and as many samples determine them. Several coordinates have a grid of these samples. If that is too large,
    positions at random are used: the span of the energies is then the true one except for a set of positions of measure
    zero. The first position is zero.
    """
    samples = [_samples_of_coordinate(model, bodies, k) for k in coordinates]
    if prod(map(len, samples)) <= GRID:
        return np.array(list(product(*samples)))
    largest = [np.abs(x).max() for x in samples]
    positions: Array = np.random.default_rng(0).uniform(-1, 1, (SEEDED, len(coordinates))) * largest
    positions[0] = 0
    return positions


def _samples_of_coordinate(model: Model, bodies: tuple[int, ...], k: int) -> Array:
    driven = [i for i in bodies if model.coordinate[i] == k and model.multiplier[i] != 0]
    factors = [abs(float(model.multiplier[i])) for i in driven if model.is_revolute[i]]
    powers = 1 + 2 * (len(driven) - len(factors))
    frequencies = np.zeros(1)
    for factor in factors:
        sums = (frequencies[:, None] + factor * np.arange(-2, 3)).ravel()
        frequencies = np.unique(sums.round(9))
    if len(driven) == 1 and factors:
        return np.asarray(np.arange(5) * (2 * np.pi / 5 / factors[0]))
    step, count = 1.0 / powers, powers
    if factors:  # shorter than half a period of the fastest, together longer than one of the slowest beat
        step = np.pi / (frequencies.max() + min(factors))
        beat = 2 * np.pi / np.diff(frequencies).min()
        count = min(LONGEST, max(2 * powers * len(frequencies) + 1, int(np.ceil(beat / step))))
    steps = np.arange(count) - count // 2
    return np.asarray(step * steps[np.argsort(np.abs(steps), kind="stable")])
