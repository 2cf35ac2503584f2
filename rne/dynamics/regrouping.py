"""From combinations that torques depend on to parameters that are kept, each with the others regrouped to it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..basics.spatial import Array
from ..model.standard_parameters import StandardParameters
from .identifiability import observed_combinations, span

ROUNDING = 1e-12  # coefficients this small, or this close to a whole number, are roundings of 0 and of that number
PIVOT = 0.05  # of the largest entry, at least


def regrouped(standard: StandardParameters, tolerance: float) -> tuple[tuple[int, ...], Array]:
    """Places of the kept parameters, and the matrix B of beta = B pi, with the identity in these places."""
    rows, units = _combinations(standard, tolerance)
    rows = span(rows, tolerance)
    kept = _independent_columns(rows)
    matrix: Array = np.linalg.solve(rows[:, kept], rows)
    matrix[np.abs(matrix) < ROUNDING] = 0
    matrix *= units[kept, None] / units
    whole = np.abs(matrix - matrix.round()) < ROUNDING
    matrix[whole] = matrix[whole].round()
    matrix[:, kept] = np.eye(len(kept))
    matrix.setflags(write=False)
    return tuple(kept), matrix


def _combinations(standard: StandardParameters, tolerance: float) -> tuple[Array, Array]:
    """Independent combinations that torques depend on, in units of the second result, for all standard parameters."""
    frictionless = replace(standard, friction=None)
    energies, scales = observed_combinations(frictionless, tolerance)
    place = [standard.names.index(name) for name in frictionless.names]
    rows, units = np.zeros((len(energies), standard.count)), np.ones(standard.count)
    rows[:, place], units[place] = energies, scales
    return np.concatenate([rows, *(_friction_rows(standard, symbol) for symbol in ("Fv", "Fc"))]), units


def _friction_rows(standard: StandardParameters, symbol: str) -> Array:
    """Combinations of the drives' and further shafts' friction that torques depend on; it is odd in the rates.

    Torques of viscous friction are the matrix sum of Fv a a^T times qd. Those of Coulomb friction are independent
    unless shafts turn at the same rate; a factor between rates counts only if friction is smooth.
    """
    if symbol not in standard.groups:
        return np.zeros((0, standard.count))
    columns = [standard.groups[name] for name in (symbol, f"{symbol} of shafts")]
    shafts = np.concatenate([np.eye(standard.model.n), np.asarray(standard.shafts)])
    if symbol == "Fv":
        upper = np.triu_indices(standard.model.n)
        entries = (shafts[:, :, None] * shafts[:, None, :])[:, upper[0], upper[1]].T
    else:
        sizes = np.linalg.norm(shafts, axis=1)
        turning = np.flatnonzero(sizes)
        directions = shafts[turning] / sizes[turning, None]
        same = np.abs(np.abs(directions @ directions.T) - 1) < ROUNDING
        if standard.smoothing:
            same &= np.abs(sizes[turning, None] - sizes[turning]) < ROUNDING
        entries = np.zeros((len(turning), len(shafts)))
        entries[:, turning] = np.where(same, sizes[turning], 0)
    rows = np.zeros((len(entries), standard.count))
    n = standard.model.n
    rows[:, columns[0]], rows[:, columns[1]] = entries[:, :n], entries[:, n:]
    found: Array = rows[entries.any(axis=1)]
    return found


def _independent_columns(rows: Array) -> list[int]:
    """As many columns as there are orthonormal rows, independent: the first ones that leave no large coefficients.

    Threshold pivoting. A combination of the rows that is orthogonal to the kept columns has unit length; the next
    column's entry in it must not be small beside the largest. The largest column left always passes, so the loop ends.
    """
    kept: list[int] = []
    left = rows.copy()
    while len(kept) < len(rows):
        for k in range(rows.shape[1]):
            size = np.linalg.norm(left[:, k])
            if len(kept) == len(rows) or k in kept or size**2 * rows.shape[1] <= PIVOT**2:
                continue
            direction = left[:, k] / size
            others = direction @ left
            if size > PIVOT * np.abs(others).max():
                left -= direction[:, None] * others
                kept.append(k)
    return sorted(kept)
