"""Chart B: wall time against error of a free swing of 1 s, our right-hand side and Pinocchio's ABA in the same solvers.

The error is that of the joint positions at the end, against Gragg-Bulirsch-Stoer extrapolation in long double with the
recursion; how far the reference itself may be off is what halving its steps changes.
"""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable
from typing import Any

import numpy as np
import pinocchio as pin
from scipy.integrate import solve_ivp

import rne
from benchmarks.kernels import robots
from benchmarks.measure import interleaved, ratio
from benchmarks.peers import Pinocchio
from benchmarks.pictures import OURS, PINOCCHIO, table, three
from rne.plant import Plant
from rne.report.plots import blank_figure

DURATION = 1.0  # [s]
TOLERANCES: dict[str, tuple[float, ...]] = {  # relative; absolute ones are a thousandth
    "RK45": (1e-4, 1e-6, 1e-8, 1e-10),
    "DOP853": (1e-4, 1e-6, 1e-8, 1e-10, 1e-12),
    "LSODA": (1e-4, 1e-6, 1e-8, 1e-10, 1e-12),
    "Radau": (1e-4, 1e-6, 1e-8),
}
MARKERS = {"RK45": "o", "DOP853": "s", "LSODA": "^", "Radau": "D"}
WAYS = {"rne": "rne in solve_ivp", "simulate": "rne.simulate, energies included", "pinocchio": "Pinocchio in solve_ivp"}
LEVELS = 9  # of the extrapolation
Rates = Callable[[float, np.ndarray], np.ndarray]


def extrapolated(rates: Rates, x: np.ndarray, steps: int) -> np.ndarray:
    """The state after DURATION: each step by modified midpoint with 2, 4, 6, ... substeps, extrapolated to none."""
    H = np.longdouble(DURATION) / steps
    for _ in range(steps):
        rows: list[np.ndarray] = []
        start = rates(0.0, x)
        for level in range(1, LEVELS + 1):
            h = H / (2 * level)
            before, now = x, x + h * start
            for _ in range(2 * level - 1):
                before, now = now, before + 2 * h * rates(0.0, now)
            row = [(before + now + h * rates(0.0, now)) / 2]
            for k in range(1, level):
                ratio_squared = (np.longdouble(level) / (level - k)) ** 2
                row.append(row[k - 1] + (row[k - 1] - rows[-1][k - 1]) / (ratio_squared - 1))
            rows.append(row)
        x = rows[-1][-1]
    return x


def reference(robot: rne.Robot, x0: np.ndarray, steps: int) -> tuple[np.ndarray, float]:
    """The state at the end, and what twice the steps change in it."""
    n = robot.n
    model = robot.model.astype(np.longdouble)
    still = np.zeros(n, dtype=np.longdouble)

    def rates(_t: float, x: np.ndarray) -> np.ndarray:
        return np.concatenate([x[n:], rne.forward_dynamics.core(model, x[:n], x[n:], still)[0]])

    x = x0.astype(np.longdouble)
    coarse, fine = extrapolated(rates, x, steps), extrapolated(rates, x, 2 * steps)
    return fine, float(np.abs(fine - coarse)[:n].max())


def right_hand_sides(robot: rne.Robot, xml: str) -> dict[str, tuple[Rates, Rates]]:
    """dx/dt and its exact Jacobian, ours and Pinocchio's."""
    n = robot.n
    plant = Plant(rne.Scene(robot).right_hand_side, None)
    theirs = Pinocchio(robot.model, xml, [np.zeros((1, n))] * 3)
    model, data, still = theirs.model, theirs.data, np.zeros(n)
    if model.nq != n or theirs.oracle.v.tolist() != list(range(n)):
        raise ValueError(f"Pinocchio's coordinates of {robot.model.name!r} are not ours")

    def rates(_t: float, x: np.ndarray) -> np.ndarray:
        return np.concatenate([x[n:], pin.aba(model, data, x[:n], x[n:], still)])

    def jacobian(_t: float, x: np.ndarray) -> np.ndarray:
        dq, dqd, _ = pin.computeABADerivatives(model, data, x[:n], x[n:], still)
        J = np.zeros((2 * n, 2 * n))
        J[:n, n:] = np.eye(n)
        J[n:, :n], J[n:, n:] = dq, dqd
        return J

    return {"rne": (plant, plant.jacobian), "pinocchio": (rates, jacobian)}


def compare(robot: rne.Robot, xml: str, tolerances: dict[str, tuple[float, ...]], repeats: int, steps: int) -> Any:
    """Every method and tolerance, three ways."""
    n = robot.n
    x0 = np.concatenate([np.linspace(0.3, 0.8, n), np.zeros(n)])
    end, uncertain = reference(robot, x0, steps)
    sides = right_hand_sides(robot, xml)
    rows: dict[str, Any] = {}
    for method, levels in tolerances.items():
        for rtol in levels:
            options: dict[str, Any] = {"method": method, "rtol": rtol, "atol": rtol * 1e-3}

            def solve(who: str, options: dict[str, Any] = options) -> np.ndarray:
                rates, jacobian = sides[who]
                exact = {"jac": jacobian} if options["method"] == "Radau" else {}
                y: np.ndarray = solve_ivp(rates, (0.0, DURATION), x0, **options, **exact).y[:n, -1]
                return y

            def simulate(options: dict[str, Any] = options) -> np.ndarray:
                return rne.simulate(robot, x0[:n], x0[n:], DURATION, **options).q[-1]

            calls = {"rne": lambda s=solve: s("rne"), "pinocchio": lambda s=solve: s("pinocchio"), "simulate": simulate}
            errors = {who: float(np.abs(call() - end[:n]).max()) for who, call in calls.items()}
            seconds = interleaved(calls, repeats)
            rows[f"{method} {rtol:.0e}"] = {
                "method": method,
                "rtol": rtol,
                "seconds": {who: statistics.median(runs) for who, runs in seconds.items()},
                "errors": errors,
                "times_slower": ratio(seconds, "rne", "pinocchio"),
                "simulate_times_slower": ratio(seconds, "simulate", "pinocchio"),
            }
    return {"reference_uncertainty": uncertain, "runs": rows}


def run(quick: bool) -> dict[str, Any]:
    """IRB 140 and UR5."""
    tolerances = {m: levels[:1] for m, levels in TOLERANCES.items()} if quick else TOLERANCES
    repeats, steps = (1, 4) if quick else (5, 40)
    start = time.perf_counter()
    found = {name: r for name, r in robots().items() if name in ("irb140", "ur5")}
    if quick:
        found.pop("ur5")
    rows = {name: compare(*r, tolerances, repeats, steps) for name, r in found.items()}
    return {"repeats": repeats, "duration": DURATION, "took_s": time.perf_counter() - start, "robots": rows}


def picture(results: dict[str, Any]) -> Any:
    """Work-precision lines, a panel for each robot."""
    found = results["robots"]
    figure = blank_figure(7.5 * len(found), 6.5)
    grid = np.atleast_1d(figure.subplots(1, len(found), sharex=True, sharey=True))
    figure.suptitle(f"Free swing of {results['duration']:g} s: lower left is better (log scales)")
    for ax, (robot, result) in zip(grid, found.items(), strict=True):
        for method, marker in MARKERS.items():
            runs = [r for r in result["runs"].values() if r["method"] == method]
            for who, color, style in (("rne", OURS, "-"), ("simulate", OURS, ":"), ("pinocchio", PINOCCHIO, "-")):
                ax.plot(
                    [r["seconds"][who] * 1e3 for r in runs],
                    [r["errors"][who] for r in runs],
                    marker=marker,
                    linestyle=style,
                    color=color,
                    markersize=5,
                    fillstyle="none" if who == "simulate" else "full",
                    label=f"{method}, {WAYS[who]}",
                )
        ax.set(xscale="log", yscale="log", title=robot, xlabel="wall time [ms]")
        uncertain = result["reference_uncertainty"]
        ax.axhline(uncertain, color="0.5", linestyle="--", linewidth=0.8)
        ax.annotate(
            "what halving the reference's steps changes",
            (0.02, uncertain),
            xycoords=("axes fraction", "data"),
            xytext=(0, 3),
            textcoords="offset points",
            fontsize=7,
            color="0.4",
        )
        ax.grid(True, alpha=0.25)
    grid[0].set_ylabel("largest error of a joint's position at the end [rad]")
    grid[0].set_ylim(bottom=1e-16)
    grid[-1].legend(loc="center left", bbox_to_anchor=(1.0, 0.5), fontsize="small", frameon=False)
    return figure


def tables(results: dict[str, Any]) -> str:
    """All runs."""
    rows = [
        [
            robot,
            r["method"],
            f"{r['rtol']:.0e}",
            *(f"{r['seconds'][who] * 1e3:.1f}" for who in WAYS),
            *(f"{r['errors'][who]:.1e}" for who in WAYS),
            three(r["times_slower"]),
            three(r["simulate_times_slower"]),
        ]
        for robot, result in results["robots"].items()
        for r in result["runs"].values()
    ]
    head = ["robot", "method", "rtol", "ms, rne in solve_ivp", "rne.simulate", "Pinocchio in solve_ivp", "error"]
    return table([*head, "rne.simulate's", "Pinocchio's", "times Pinocchio's time", "rne.simulate's"], rows)
