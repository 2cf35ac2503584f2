"""The simulations of docs/stability: every experiment of tests/stability/steps.py and motions.py."""

from __future__ import annotations

from typing import Any

import numpy as np

import rne
from benchmarks.pages import table
from tests.stability import motions, steps

SCALES = (0.01, 0.1, 1.0, 10.0, 100.0)
DAMPINGS = (1.0, 10.0, 100.0, 1e3, 1e4, 1e5, 1e6)
EXPLICIT_UP_TO = 100.0  # [N m s/rad]; beyond it explicit methods take hundreds of thousands of evaluations
SPINS = (1e2, 3e2, 1e3, 3e3, 1e4)
RTOLS = (1e-4, 1e-6, 1e-8, 1e-10)
EXPLICIT = ("RK45", "DOP853")
STIFF = ("auto", "LSODA", "BDF", "Radau")
TOPS = ("DOP853", "LSODA")
PUSHES = (1e-3, 1e-6, 1e-9, 1e-12, 0.0)
WIDTHS = (1e-1, 1e-3, 1e-5)
STEPS = (2e-2, 1e-2, 5e-3, 2e-3, 1e-3, 5e-4)


def run() -> dict[str, Any]:
    """All of them, as numbers that JSON can hold."""
    robot = rne.load("irb140")
    return {
        "steps": boundaries(robot),
        "damping": [{"damping": d} | damped(robot, d) for d in DAMPINGS],
        "tops": [{"spin": spin} | spun(spin) for spin in SPINS],
        "chaos": {f"{k:.0e}": _lists(v) for k, v in motions.chaos(robot, RTOLS).items()},
        "rest": _lists(motions.unstable_rest(PUSHES)),
        "pulses": [{"width": w} | pulsed(robot, w) for w in WIDTHS],
        "float": {
            np.dtype(t).name: {f"{k:g}": e for k, e in motions.equal_steps(robot, STEPS, t).items()}
            for t in (np.float64, np.float32)
        },
    }


def boundaries(robot: rne.Robot) -> list[dict[str, Any]]:
    """Largest stable steps, predicted and measured, over four decades of gain."""
    q = rne.check_gains(robot, steps.KP, steps.KD).worst_q
    found = []
    for scale in SCALES:
        one = steps.loop(robot, scale, q)
        for method in steps.METHODS:
            both = steps.predicted(method, one), float(steps.measured(method, one))
            found.append({"scale": scale, "method": method, "predicted": both[0], "measured": both[1]})
    return found


def damped(robot: rne.Robot, damping: float) -> dict[str, Any]:
    """Evaluations and errors by method."""
    methods = STIFF + (EXPLICIT if damping <= EXPLICIT_UP_TO else ())
    return {name: e._asdict() for name, e in motions.stiff_damping(robot, damping, methods).items()}


def spun(spin: float) -> dict[str, Any]:
    """Evaluations, and drifts of momentum and energy, by method."""
    found: dict[str, Any] = {"nutation": motions.Top.of().nutation(spin)}
    for method in TOPS:
        effort, drift = motions.released_top(spin, method=method)
        found[method] = effort._asdict() | {"energy": drift}
    return found


def pulsed(robot: rne.Robot, width: float) -> dict[str, float]:
    """Errors without and with the edges of the pulse given as breaks."""
    return {
        f"{method}{', breaks' if named else ''}": motions.pulse_missed(robot, width, method, named)
        for method in ("DOP853", "LSODA")
        for named in (False, True)
    }


def _lists(found: Any) -> dict[str, Any]:
    def plain(x: Any) -> Any:
        if isinstance(x, dict):
            return {f"{k:g}": plain(v) for k, v in x.items()}
        return x.tolist() if isinstance(x, np.ndarray) else x

    return {name: plain(value) for name, value in found._asdict().items()}


def tables(found: dict[str, Any]) -> dict[str, str]:
    """Tables of docs/stability, by name."""
    return {
        "largest-steps": of_steps(found["steps"]),
        "single-precision": of_precisions(found["float"]),
        "damping": of_damping(found["damping"]),
        "tops": of_tops(found["tops"]),
        "chaos": of_chaos(found["chaos"]),
        "unstable-rest": of_rest(found["rest"]),
        "pulses": of_pulses(found["pulses"]),
    }


def of_steps(rows: list[dict[str, Any]]) -> str:
    """Predicted and measured limits, a column for each method."""
    by_scale: dict[float, dict[str, str]] = {}
    for row in rows:
        pair = f"{row['predicted'] * 1e3:#.4g}, {row['measured'] * 1e3:#.4g}"
        by_scale.setdefault(row["scale"], {})[row["method"]] = pair
    methods = list(next(iter(by_scale.values())))
    head = ["gains, times the thesis's", *(f"{m}, predicted and measured [ms]" for m in methods)]
    return table(head, [[f"{scale:g}", *(pairs[m] for m in methods)] for scale, pairs in by_scale.items()])


def of_precisions(found: dict[str, dict[str, float]]) -> str:
    """Errors by step."""
    rows = [[f"{float(step) * 1e3:g}", *(f"{found[t][step]:.1e}" for t in found)] for step in found["float64"]]
    return table(["step [ms]", *(f"{t}, error [rad]" for t in found)], rows)


def of_damping(rows: list[dict[str, Any]]) -> str:
    """Evaluations and errors by damping."""
    methods = STIFF + EXPLICIT
    cells = [
        [f"{r['damping']:g}", *(f"{r[m]['evaluations']} ({r[m]['error']:.0e})" if m in r else "-" for m in methods)]
        for r in rows
    ]
    return table(["damping [N m s/rad]", *methods], cells)


def of_tops(rows: list[dict[str, Any]]) -> str:
    """Evaluations and drifts by spin."""

    def cell(one: dict[str, Any]) -> str:
        return f"{one['evaluations']} ({one['error']:.0e}, {one['energy']:.0e})"

    cells = [[f"{r['spin']:g}", f"{r['nutation']:.0f}", *(cell(r[m]) for m in TOPS)] for r in rows]
    return table(["spin [rad/s]", "nutation [rad/s]", *TOPS], cells)


def of_chaos(found: dict[str, Any]) -> str:
    """When the error passes 1e-3 rad, as measured and as estimated."""
    cells = []
    for rtol, one in found.items():
        beyond = np.array(one["measured"]) > 1e-3
        seen = f"{np.array(one['t'])[np.argmax(beyond)]:.2f}" if beyond.any() else "not within the run"
        cells.append([rtol, seen, f"{one['horizon']:.2f}"])
    return table(["rtol", "error passes 1e-3 rad at [s]", "trusted horizon [s]"], cells)


def of_rest(found: dict[str, Any]) -> str:
    """When the arm departs from upright, as measured and as ln(0.1 / push) / rate predicts."""
    t, rate = np.array(found["t"]), found["rate"]
    cells = []
    for push, departure in found["departure"].items():
        fallen = np.array(departure) > 0.1
        predicted = f"{np.log(0.1 / float(push)) / rate:.2f}" if float(push) else "-"
        cells.append([push, f"{t[np.argmax(fallen)]:.2f}" if fallen.any() else "-", predicted])
    head = ["push [rad]", "departs by 0.1 rad at [s]", f"predicted with the rate {rate:.3f} 1/s [s]"]
    return table(head, cells)


def of_pulses(rows: list[dict[str, Any]]) -> str:
    """Errors by width."""
    names = [k for k in rows[0] if k != "width"]
    return table(["width [s]", *names], [[f"{r['width']:g}", *(f"{r[k]:.1e}" for k in names)] for r in rows])
