"""Free swing of 1 s: wall time against the error of the joint positions at the end."""

from __future__ import annotations

from typing import Any

import numpy as np

import rne
from benchmarks.runs import Row, in_solve_ivp, measured, our_side, simulated, start, their_side, tolerance
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


def compare(robot: rne.Robot, tolerances: dict[str, tuple[float, ...]], repeats: int, steps: int) -> dict[str, Any]:
    """Every method and tolerance: rne and Pinocchio in SciPy's solver, and rne.simulate."""
    x0 = start(robot.n)
    end, uncertain = reference(robot, x0, steps)
    ours, theirs = our_side(robot), their_side(robot)
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


def run(found: dict[str, rne.Robot], quick: bool) -> dict[str, Any]:
    """On each robot."""
    tolerances = {m: TOLERANCES[m][:1] for m in ("RK45", "Radau")} if quick else TOLERANCES
    repeats, steps = (1, 2) if quick else (3, 40)
    rows = {name: compare(robot, tolerances, repeats, steps) for name, robot in found.items()}
    return {"duration": DURATION, "repeats": repeats, "robots": rows}
