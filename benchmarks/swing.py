"""Free swing of 1 s: wall time against the error of the joint positions at the end."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

import rne
from benchmarks.runs import TURN, Arms, Motion, Row, in_solve_ivp, measured, simulated, start, their_side, tolerance

DURATION = 1.0  # [s]
TOLERANCES: dict[str, tuple[float, ...]] = {
    "RK45": (1e-4, 1e-6, 1e-8, 1e-10),
    "DOP853": (1e-4, 1e-6, 1e-8, 1e-10, 1e-12),
    "LSODA": (1e-4, 1e-6, 1e-8, 1e-10, 1e-12),
    "Radau": (1e-4, 1e-6, 1e-8),
}
LEVELS = 9  # of the extrapolation, whose order is 18


def extrapolated(
    rates: Callable[[np.ndarray, np.ndarray], np.ndarray], t: np.ndarray, x: np.ndarray, h: np.ndarray, levels: int
) -> tuple[np.ndarray, np.ndarray]:
    """The states one step later, and how much the last level of extrapolation changed them.

    The modified midpoint rule with 2, 4, 6, ... substeps, extrapolated to step size 0.
    Gragg, Bulirsch and Stoer; Hairer, Norsett, Wanner 1993, Solving Ordinary Differential Equations I, II.9.

    Parameters
    ----------
    rates : callable
        f(t, x), shapes (...) and (..., size).
    t, h : ndarray, shape (...)
        Start and length of each step [s].
    x : ndarray, shape (..., size)
        The states at the start.
    levels : int
        The order is twice this.
    """
    ends = []
    start = rates(t, x)
    for level in range(1, levels + 1):
        part = h / (2 * level)
        before, now = x, x + part[..., None] * start
        for k in range(1, 2 * level):
            before, now = now, before + 2 * part[..., None] * rates(t + k * part, now)
        ends.append((before + now + part[..., None] * rates(t + h, now)) / 2)
    coarser = without_steps(ends[:-1])
    finest = without_steps(ends)
    return finest, np.abs(finest - coarser)


def without_steps(ends: list[np.ndarray]) -> np.ndarray:
    """The limit of results with steps h/2, h/4, h/6, ...: Neville's scheme in their squares."""
    ends = list(ends)
    for k in range(1, len(ends)):
        for level in range(len(ends) - 1, k - 1, -1):
            squared = (np.ones((), dtype=ends[0].dtype) * (level + 1) / (level + 1 - k)) ** 2
            ends[level] = ends[level] + (ends[level] - ends[level - 1]) / (squared - 1)
    return ends[-1]


def reference(robot: rne.Robot, x0: np.ndarray, steps: int) -> tuple[np.ndarray, float]:
    """The joint positions at the end by extrapolation in long double, and what twice the steps change in them."""
    n = robot.n
    model = robot.model.astype(np.longdouble)

    def rates(_t: np.ndarray, x: np.ndarray) -> np.ndarray:
        q, qd = x[..., :n], x[..., n:]
        return np.concatenate([qd, rne.dynamics.forward_dynamics.core(model, q, qd, 0 * q)[0]], axis=-1)

    def end(steps: int) -> np.ndarray:
        x, h = x0.astype(np.longdouble), np.array(np.longdouble(DURATION) / steps)
        for k in range(steps):
            x, _ = extrapolated(rates, k * h, x, h, LEVELS)
        return x[:n]

    coarse, fine = end(steps), end(2 * steps)
    return fine, float(np.abs(fine - coarse).max())


def compare(arms: Arms, tolerances: dict[str, tuple[float, ...]], repeats: int, steps: int) -> dict[str, Any]:
    """Every method and tolerance: rne.simulate by each engine, and Pinocchio in SciPy's solver."""
    robot = arms["numpy"]
    x0 = start(robot.n)
    end, uncertain = reference(robot, x0, steps)
    theirs = their_side(robot)
    rows: list[Row] = []

    def error(motion: Motion) -> float:
        return float(np.abs(motion[0][-1] - end).max())

    for method, levels in tolerances.items():
        for rtol in levels:
            o = tolerance(method, rtol)
            calls = {"pinocchio": lambda o=o: in_solve_ivp(theirs, x0, DURATION, o)}
            calls |= {engine: lambda o=o, arm=arm: simulated(arm, x0, DURATION, **o) for engine, arm in arms.items()}
            rows.append(measured(method, f"{rtol:.0e}", calls, error, repeats, turn=TURN))
    return {"reference_uncertainty": uncertain, "runs": rows}


def run(found: dict[str, Arms], quick: bool) -> dict[str, Any]:
    """On each robot."""
    tolerances = {m: TOLERANCES[m][:1] for m in ("RK45", "Radau")} if quick else TOLERANCES
    repeats, steps = (1, 2) if quick else (3, 40)
    rows = {name: compare(arms, tolerances, repeats, steps) for name, arms in found.items()}
    return {"duration": DURATION, "repeats": repeats, "robots": rows}
