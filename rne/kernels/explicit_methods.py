"""Explicit one-step methods as tables of coefficients, and the control of their steps.

Those with step control are SciPy's, with its coefficients: Dormand and Prince of orders 5 and 8, in Hairer, Norsett and
Wanner 1993, II.5 and II.6.
"""

from __future__ import annotations

import functools
from typing import Any, NamedTuple

import numpy as np

from ..basics.spatial import Array

SAFETY, SMALLEST, LARGEST = 0.9, 0.2, 10.0  # factors between the lengths of steps, as SciPy's
EPS = float(np.finfo(np.float64).eps)
FIXED, CONTROLLED = ("rk4", "semi-implicit-euler"), ("RK45", "DOP853")


class Method(NamedTuple):
    """Stages k_s = f(t + C_s h, x + h sum A_sj k_j), the next state x + h sum B_j k_j, and its slope behind them.

    `E` gives two estimates of the error, of which the second may be zero. On a step x(t + u h) is x plus
    h u (d_0 + (1 - u) (d_1 + u (d_2 + ...))), d = D k, with stages `A2`, `C2` that only this needs.
    """

    A: Array
    B: Array
    C: Array
    E: Array
    A2: Array
    C2: Array
    D: Array
    power: float  # of the error, in the factor between steps

    @property
    def tables(self) -> tuple[Array, ...]:
        """The coefficients alone."""
        return tuple(self[:7])


@functools.cache
def method_named(name: str) -> Method:
    """The method's coefficients."""
    if name in FIXED:
        return _fixed(name)
    import scipy.integrate

    solver = getattr(scipy.integrate, name)
    if name == "RK45":
        P = solver.P.T
        D = np.stack([P.sum(0), -P[1:].sum(0), -P[2] - 2 * P[3], P[3]])  # of 1, u, u^2, u^3 in the form above
        none = np.zeros((0, len(solver.E)))
        return _method(solver.A, solver.B, solver.C, [solver.E, 0 * solver.E], none, np.zeros(0), D, -1 / 5)
    unit = np.eye(solver.D.shape[1])
    B, first, last = solver.B @ unit[: len(solver.B)], unit[0], unit[len(solver.B)]
    D = np.concatenate([[B, first - B, 2 * B - first - last], solver.D])
    errors = [solver.E5, solver.E3]
    return _method(solver.A, solver.B, solver.C, errors, solver.A_EXTRA, solver.C_EXTRA, D, -1 / 8)


def _fixed(name: str) -> Method:
    """A method of equal steps; semi-implicit Euler is told apart by the one who steps."""
    if name == "rk4":
        A, B, C = np.diag([0.5, 0.5, 1.0], -1), np.array([1, 2, 2, 1]) / 6, np.array([0, 0.5, 0.5, 1])
    else:
        A, B, C = np.zeros((1, 1)), np.ones(1), np.zeros(1)
    rows = len(B) + 1
    return _method(A, B, C, np.zeros((2, rows)), np.zeros((0, rows)), np.zeros(0), np.zeros((0, rows)), 0.0)


def _method(*tables: Any) -> Method:
    *arrays, power = tables
    return Method(*(np.ascontiguousarray(a, dtype=np.float64) for a in arrays), power)
