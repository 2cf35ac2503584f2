"""Free swing of 1 s: wall time against the error of the joint positions at the end."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

import rne
from benchmarks.runs import Row, in_solve_ivp, measured, our_side, simulated, start, their_side, tolerance
from rne.simulation.error_growth import without_steps

DURATION = 1.0  # [s]
TOLERANCES: dict[str, tuple[float, ...]] = {
    "RK45": (1e-4, 1e-6, 1e-8, 1e-10),
    "DOP853": (1e-4, 1e-6, 1e-8, 1e-10, 1e-12),
    "LSODA": (1e-4, 1e-6, 1e-8, 1e-10, 1e-12),
    "Radau": (1e-4, 1e-6, 1e-8),
}
LEVELS = 9  # of the extrapolation


def extrapolated(rates: Callable[[np.ndarray], np.ndarray], x: np.ndarray, steps: int) -> np.ndarray:
    """The state after DURATION: each step by modified midpoint with 2, 4, 6, ... substeps, extrapolated to none.

    The levels go side by side as one batch, those with few substeps leave it first.
    """
    h = np.longdouble(DURATION) / steps / (2 * np.arange(1, LEVELS + 1)[:, None])
    for _ in range(steps):
        before, now = np.tile(x, (LEVELS, 1)), x + h * rates(x)
        ends = []
        for j in range(1, 2 * LEVELS + 1):
            done = (j - 1) // 2  # levels with fewer substeps than j
            slope, width = rates(now[done:]), h[done:]
            if j == 2 * (done + 1):
                ends.append((before[done] + now[done] + width[0] * slope[0]) / 2)
            before[done:], now[done:] = now[done:].copy(), before[done:] + 2 * width * slope
        x = without_steps(ends)
    return x


def reference(robot: rne.Robot, x0: np.ndarray, steps: int) -> tuple[np.ndarray, float]:
    """The joint positions at the end, and what twice the steps change in them."""
    n = robot.n
    model = robot.model.astype(np.longdouble)

    def rates(x: np.ndarray) -> np.ndarray:
        q, qd = x[..., :n], x[..., n:]
        return np.concatenate([qd, rne.forward_dynamics.core(model, q, qd, 0 * q)[0]], axis=-1)

    x = x0.astype(np.longdouble)
    coarse, fine = extrapolated(rates, x, steps)[:n], extrapolated(rates, x, 2 * steps)[:n]
    return fine, float(np.abs(fine - coarse).max())


def compare(robot: rne.Robot, xml: str, tolerances: dict[str, tuple[float, ...]], repeats: int, steps: int) -> Any:
    """Every method and tolerance, three ways."""
    x0 = start(robot.n)
    end, uncertain = reference(robot, x0, steps)
    ours, theirs = our_side(robot), their_side(robot, xml)
    rows: list[Row] = []
    for method, levels in tolerances.items():
        for rtol in levels:
            o = tolerance(method, rtol)
            calls = {
                "rne": lambda o=o: in_solve_ivp(ours, x0, DURATION, o),
                "pinocchio": lambda o=o: in_solve_ivp(theirs, x0, DURATION, o),
                "simulate": lambda o=o: simulated(robot, x0, DURATION, **o),
            }
            rows.append(measured(method, f"{rtol:.0e}", calls, lambda m: float(np.abs(m[0][-1] - end).max()), repeats))
    return {"reference_uncertainty": uncertain, "runs": rows}


def run(found: dict[str, Any], quick: bool) -> dict[str, Any]:
    """On each robot."""
    tolerances = {m: levels[:1] for m, levels in TOLERANCES.items()} if quick else TOLERANCES
    repeats, steps = (1, 4) if quick else (3, 40)
    rows = {name: compare(*r, tolerances, repeats, steps) for name, r in found.items()}
    return {"duration": DURATION, "repeats": repeats, "robots": rows}
