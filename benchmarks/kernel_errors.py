"""Errors of kernels against the recursion in long double, in units of float64's eps; of angles up to 1e12 rad as well.

The long double recursion agrees with the one on 50 digits to 1e-18; see chart A, which compares with the latter.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

import rne
from benchmarks.cases import QUANTITIES, states

EXACT = 200  # states whose error is taken
ANGLES = (np.pi, 1e3, 1e5, 1e6, 1e9, 1e12)  # largest angles [rad]
EPS = float(np.finfo(float).eps)


def reference(function: Any, model: rne.Model, arrays: list[np.ndarray]) -> np.ndarray:
    """The recursion in long double."""
    return np.asarray(function(model, *(a.astype(np.longdouble) for a in arrays)))


def relative_error(got: np.ndarray, exact: np.ndarray) -> float:
    """Largest error relative to the largest entry [eps]."""
    return float(np.abs(got - exact).max() / np.abs(exact).max()) / EPS


def error_of_states(got: np.ndarray, exact: np.ndarray) -> float:
    """Largest error of a state relative to its own largest entry [eps]."""
    count = len(exact)
    wrong, entries = np.abs(got - exact).reshape(count, -1), np.abs(exact).reshape(count, -1)
    return float((wrong.max(1) / entries.max(1)).max()) / EPS


def single_results(method: Any, arrays: list[np.ndarray]) -> np.ndarray:
    """Results of calls of one state for the first states."""
    return np.array([method(*(a[k].copy() for a in arrays)) for k in range(min(EXACT, len(arrays[0])))])


def large_angles(robots: Mapping[str, rne.Robot], quantity: str) -> list[dict[str, Any]]:
    """Errors of every engine, a row for each size of the angles; linear joints keep within pi m."""
    function, arity = QUANTITIES[quantity]
    model, rows = robots["numpy"].model, []
    turns = np.array([model.is_revolute[model.moving_joints.index(name)] for name in model.joint_names])
    for angle in ANGLES:
        arrays = states(model.n, EXACT, seed=1)[:arity]
        reach = np.where(turns, angle, np.pi)
        arrays[0] = np.random.default_rng(2).uniform(-reach, reach, (EXACT, model.n))
        exact = reference(function, model, arrays)
        row: dict[str, Any] = {"angle": angle}
        for engine, robot in robots.items():
            row[engine] = {
                "batch": error_of_states(robot.kernel(function)(*arrays), exact),
                "single": error_of_states(single_results(getattr(robot, quantity), arrays), exact),
            }
        rows.append(row)
    return rows
