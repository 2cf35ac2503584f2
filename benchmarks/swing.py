"""Free swing of 1 s: wall time against the error of the joint positions at the end."""

from __future__ import annotations

from typing import Any

import numpy as np

import rne
from benchmarks.runs import TURN, Arms, Motion, Row, in_solve_ivp, measured, simulated, start, their_side, tolerance
from rne.simulation.error_growth import extrapolated

DURATION = 1.0  # [s]
TOLERANCES: dict[str, tuple[float, ...]] = {
    "RK45": (1e-4, 1e-6, 1e-8, 1e-10),
    "DOP853": (1e-4, 1e-6, 1e-8, 1e-10, 1e-12),
    "LSODA": (1e-4, 1e-6, 1e-8, 1e-10, 1e-12),
    "Radau": (1e-4, 1e-6, 1e-8),
}
LEVELS = 9  # of the extrapolation, whose order is 18


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
