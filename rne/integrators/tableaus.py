"""Explicit Runge-Kutta methods by their tableaus: SciPy's, classical ones of equal steps, and others in SciPy's terms.

A method of one's own is a class of coefficients as those of `scipy.integrate.RK45`, with its citation, in `OWN`. It
then runs in SciPy's solver, in machine code, sampled and in ensembles.
"""

from __future__ import annotations

import functools
from typing import Any, NamedTuple

import numpy as np

from ..basics.spatial import Array

FIXED = ("rk4", "semi-implicit-euler")  # methods without an error estimate


class Tsit5:
    """C. Tsitouras 2011, Runge-Kutta pairs of order 5(4) satisfying only the first column simplifying assumption,
    Computers and Mathematics with Applications 62, 770-775."""

    order, error_estimator_order, n_stages = 5, 4, 6
    C = np.array([0, 0.161, 0.327, 0.9, 0.9800255409045097, 1])
    A = np.zeros((6, 6))
    A[1, :1] = 0.161
    A[2, :2] = -0.008480655492356989, 0.335480655492357
    A[3, :3] = 2.8971530571054935, -6.359448489975075, 4.3622954328695815
    A[4, :4] = 5.325864828439257, -11.748883564062828, 7.4955393428898365, -0.09249506636175525
    A[5, :5] = 5.86145544294642, -12.92096931784711, 8.159367898576159, -0.071584973281401, -0.028269050394068383
    B = np.array([0.09646076681806523, 0.01, 0.4798896504144996, 1.379008574103742, -3.290069515436081,
                  2.324710524099774])  # fmt: skip
    E = np.array([-0.00178001105222577714, -0.0008164344596567469, 0.007880878010261995, -0.1447110071732629,
                  0.5823571654525552, -0.45808210592918697, 1 / 66])  # fmt: skip
    P = np.zeros((7, 4))  # of u, u^2, u^3, u^4
    P[0] = 1, -2.763706197274826, 2.9132554618219126, -1.0530884977290216
    P[1:, 1] = 0.1317, 3.9302962368947516, -12.411077166933676, 37.50931341651104, -27.896526289197286, 1.5
    P[1:, 2] = -0.2234, -5.941033872131505, 30.33818863028232, -88.1789048947664, 65.09189467479366, -4
    P[1:, 3] = 0.1017, 2.490627285651253, -16.548102889244902, 47.37952196281928, -34.87065786149661, 2.5


OWN: dict[str, type] = {"Tsit5": Tsit5}
EXPLICIT = ("RK45", "RK23", "DOP853", *OWN)


class Tableau(NamedTuple):
    """A method's coefficients, one or two estimates of its error, and its interpolant.

    Within a step x(t + u h) is x plus h u (d_0 + (1 - u) (d_1 + u (d_2 + ...))), d = D k, with stages `A2`, `C2` that
    only this needs. The factor between two steps goes with the error to the power of `exponent`: minus one by the order
    of the estimate, plus one.
    """

    A: Array
    B: Array
    C: Array
    E: Array
    A2: Array
    C2: Array
    D: Array
    exponent: float


def scipy_class(method: str) -> Any:
    """Solver class of SciPy for a method."""
    import scipy.integrate

    return type(method, (OWN[method], scipy.integrate.RK45), {}) if method in OWN else getattr(scipy.integrate, method)


@functools.cache
def tableau(method: str) -> Tableau:
    """Tableau of a method, adaptive or with fixed steps; semi-implicit Euler has explicit Euler's."""
    A2, C2 = np.zeros((0, 1)), np.zeros(0)
    if method in FIXED:
        A, B, C = np.zeros((1, 1)), np.ones(1), np.zeros(1)
        if method == "rk4":
            A, B, C = np.diag([0.5, 0.5, 1.0], -1), np.array([1, 2, 2, 1]) / 6, np.array([0, 0.5, 0.5, 1])
        return Tableau(A, B, C, np.zeros((2, 1)), A2, C2, np.zeros((0, len(B) + 1)), 0.0)
    made = scipy_class(method)
    if method == "DOP853":
        E, A2, C2 = np.stack([made.E5, made.E3]), made.A_EXTRA, made.C_EXTRA
        unit, stages = np.eye(made.D.shape[1]), len(made.B)
        B, first, last = made.B @ unit[:stages], unit[0], unit[stages]
        D = np.concatenate([[B, first - B, 2 * B - first - last], made.D])
    else:
        E, D = made.E[None], _by_turns(made.P.shape[1]) @ made.P.T
    arrays = (np.ascontiguousarray(x, dtype=np.float64) for x in (made.A, made.B, made.C, E, A2, C2, D))
    return Tableau._make([*arrays, -1.0 / (float(made.error_estimator_order) + 1.0)])


def _by_turns(degree: int) -> Array:
    """Matrix from coefficients of u, u^2, ... to those of u, u (1 - u), u (1 - u) u, ..."""
    rows, rest = [], np.eye(degree)
    while len(rest):
        rows.append(rest.sum(axis=0))  # remainder at u = 1, divided by u; that at 0 below
        rest = np.array([-rest[k + 1 :].sum(axis=0) for k in range(len(rest) - 1)]).reshape(-1, degree)
        rows, rest = [*rows, *rest[:1]], rest[1:]
    return np.array(rows)
