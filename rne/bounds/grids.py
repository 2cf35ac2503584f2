"""Bounds of a polynomial's second derivatives by its values on a grid, as shares of the sums of its modes.

A trigonometric polynomial of degree d is nowhere larger than its largest value at N equal steps over cos(pi d / N), as
follows from a theorem of M. Riesz (Ehlich and Zeller 1964, Mathematische Zeitschrift 86, 41). Of several angles the
factors are multiplied. It holds for each seminorm of an array, because that is a largest value of linear functions.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from ..basics.spatial import Array
from .criteria import ROUNDING, Criterion
from .polynomials import Polynomial

STEPS = (10, 8, 6)  # of a full turn, per degree
OF_ENTRY = 16  # operations for each number on a grid
MOST_POINTS, MOST_NUMBERS = 250_000, 4e6  # of a grid, whichever allows more


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
    """The real part of a sum of modes at equal steps of each coordinate, in blocks of one value of a coordinate."""
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
    criterion: Criterion, frequency: Array, on: Array, weights: Array, steps: Array, clock: Any, work: float
) -> float | None:
    """Bound of phi of the weighted sum of modes `on`, over the sum of their phi; None if it takes more than `work`."""
    most, began = 0.0, clock.now()
    coefficients = (weights * criterion.grid_coefficients[on].T).T
    for number, values in enumerate(values_on_grid(frequency, coefficients, steps), start=1):
        most = criterion.ratio(values, on, weights, most)
        clock.count(values.size * OF_ENTRY)
        if (clock.now() - began) * steps.max() > number * work:
            return None
    between = np.cos(np.pi * abs(frequency).max(axis=0) / steps).prod()
    return float(min(most / between + ROUNDING, 1.0))
