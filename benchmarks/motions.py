"""The atlas of simulation, for docs/stability.md: every experiment of tests/stability/steps.py and motions.py."""

from __future__ import annotations

from typing import Any

import numpy as np

import rne
from benchmarks.pictures import table
from tests.stability import motions, steps

SCALES = (0.01, 0.1, 1.0, 10.0, 100.0)
DAMPINGS = (1.0, 10.0, 100.0, 1e3, 1e4, 1e5, 1e6)
EXPLICIT_UP_TO = 100.0  # [N m s/rad], beyond which explicit methods take hundreds of thousands of evaluations
SPINS = (1e2, 3e2, 1e3, 3e3, 1e4)
RTOLS = (1e-4, 1e-6, 1e-8, 1e-10)
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
    """Evaluations and errors of each method that is asked."""
    methods = ["auto", "LSODA", "BDF", "Radau"] + (["RK45", "DOP853"] if damping <= EXPLICIT_UP_TO else [])
    return {name: e._asdict() for name, e in motions.stiff_damping(robot, damping, methods).items()}


def spun(spin: float) -> dict[str, Any]:
    """Evaluations, and drifts of momentum and energy, by method."""
    found: dict[str, Any] = {"nutation": motions.Top.of().nutation(spin)}
    for method in ("DOP853", "LSODA", "gauss-4"):
        try:
            effort, drift = motions.released_top(spin, method=method)
            found[method] = effort._asdict() | {"energy": drift}
        except rne.SimulationError as error:
            found[method] = {"refused": str(error)}
    return found


def pulsed(robot: rne.Robot, width: float) -> dict[str, float]:
    """Errors without and with the pulse's edges named."""
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


def section(found: dict[str, Any]) -> str:
    """Of docs/stability.md."""
    parts = [
        "## Simulation",
        f"**Step against gain.** {_steps(found['steps'])}",
        "![Largest stable steps, and the error in single precision](stability/steps.png)",
        f"**Single precision.** {_floats(found['float'])}",
        f"**Stiff damping.** {_damping(found['damping'])}",
        "![Evaluations under damping and for fast tops](stability/effort.png)",
        f"**Fast tops.** {_tops(found['tops'])}",
        f"**Chaos.** {_chaos(found['chaos'])}",
        "![Errors in chaos, and departures from an unstable rest](stability/growth.png)",
        f"**Unstable rest.** {_rest(found['rest'])}",
        f"**Pulses.** {_pulses(found['pulses'])}",
    ]
    return "\n\n".join(parts) + "\n"


def _steps(rows: list[dict[str, Any]]) -> str:
    worst = max(abs(r["measured"] / r["predicted"] - 1) for r in rows)
    thesis = {r["method"]: r for r in rows if r["scale"] == 1}
    at = ", ".join(f"{m} {r['predicted'] * 1e3:.4f} ms" for m, r in thesis.items())
    return (
        "The thesis's PD gains with gravity compensated, times 0.01 to 100, at the configuration where the loop is "
        "fastest. The largest step is predicted from the spectral radius of a step of the linearised loop, and found "
        f"by bisection on the nonlinear one: within {worst:.1%} of each other everywhere. At the thesis's gains: {at}. "
        "*sampled* holds the torques between samples: no solver helps, `rne.check_gains` gives the limit beforehand. "
        "Against rk4's and semi-implicit Euler's limit take `simulate`'s \"auto\"."
    )


def _floats(found: dict[str, dict[str, float]]) -> str:
    rows = [[f"{float(step) * 1e3:g}", *(f"{found[t][step]:.1e}" for t in found)] for step in found["float64"]]
    single, double = found["float32"], found["float64"]
    follows = min((float(step) for step in single if single[step] < 1.1 * double[step]), default=float("nan"))
    best = min(single, key=lambda step: single[step])
    return (
        "32 swings of 0.5 s by `rne.ensemble`'s rk4, largest error of a position. Single precision follows double down "
        f"to steps of {follows * 1e3:g} ms and is best at {float(best) * 1e3:g} ms, {single[best]:.0e} rad; below, "
        "every step adds its rounding. For more digits take float64.\n\n"
        + table(["step [ms]", *(f"{t}, error [rad]" for t in found)], rows)
    )


def _damping(rows: list[dict[str, Any]]) -> str:
    methods = ["auto", "LSODA", "BDF", "Radau", "RK45", "DOP853"]
    cells = [
        [f"{r['damping']:g}", *(f"{r[m]['evaluations']} ({r[m]['error']:.0e})" if m in r else "-" for m in methods)]
        for r in rows
    ]
    return (
        "A swing of 1 s under viscous friction at every joint, rtol 1e-6: evaluations, and the error of the positions "
        "in brackets [rad]. Explicit methods take steps in proportion to 1/damping whatever the tolerance, and are not "
        'asked beyond 100; "auto" changes to LSODA.\n\n' + table(["damping [N m s/rad]", *methods], cells)
    )


def _tops(rows: list[dict[str, Any]]) -> str:
    def cell(r: dict[str, Any], m: str) -> str:
        one = r[m]
        return "refused" if "refused" in one else f"{one['evaluations']} ({one['error']:.0e}, {one['energy']:.0e})"

    methods = ["DOP853", "LSODA", "gauss-4"]
    cells = [[f"{r['spin']:g}", f"{r['nutation']:.0f}", *(cell(r, m) for m in methods)] for r in rows]
    return (
        "A heavy top let go at a spin, 1 s, rtol 1e-9, gauss-4 at its 5 ms: evaluations; in brackets the drift of the "
        "momentum about the vertical relative to the spin's, and of the energy relative to the weight's moment. The "
        "work grows with the nutation's rate. Where gauss-4's stages do not converge it says so and names the step; "
        "take a smaller one.\n\n" + table(["spin [rad/s]", "nutation [rad/s]", *methods], cells)
    )


def _chaos(found: dict[str, Any]) -> str:
    cells = []
    for rtol, one in found.items():
        beyond = np.array(one["measured"]) > 1e-3
        seen = f"{np.array(one['t'])[np.argmax(beyond)]:.2f}" if beyond.any() else "not within the run"
        cells.append([rtol, seen, f"{one['horizon']:.2f}"])
    rtols, horizons = [float(rtol) for rtol in found], [one["horizon"] for one in found.values()]
    decade = (horizons[-1] - horizons[0]) / np.log10(rtols[0] / rtols[-1])
    return (
        f"A free swing of the IRB 140 by DOP853: a tenth of the tolerance buys {decade:.1f} s, whatever the method. "
        "`Trajectory.trusted_horizon(1e-3)` says when the error passes 1 mrad, from the error of every step and the "
        "variational equation (dashed); measured against a run at rtol 1e-13. Beyond it the motion is one that the arm "
        "could make, its energy right, but not the one asked for.\n\n"
        + table(["rtol", "error passes 1e-3 rad at [s]", "trusted horizon [s]"], cells)
    )


def _rest(found: dict[str, Any]) -> str:
    t, rate = np.array(found["t"]), found["rate"]
    cells = []
    for push, departure in found["departure"].items():
        fallen = np.array(departure) > 0.1
        predicted = f"{np.log(0.1 / float(push)) / rate:.2f}" if float(push) else "-"
        cells.append([push, f"{t[np.argmax(fallen)]:.2f}" if fallen.any() else "-", predicted])
    return (
        f"Two links upright, pushed along the mode that grows at {rate:.3f} 1/s: the time to depart by 0.1 rad is "
        "ln(0.1 / push) / rate. Without any push rounding falls for it: pi/2 is no double.\n\n"
        + table(["push [rad]", "departs by 0.1 rad at [s]", "predicted [s]"], cells)
    )


def _pulses(rows: list[dict[str, Any]]) -> str:
    names = [k for k in rows[0] if k != "width"]
    cells = [[f"{r['width']:g}", *(f"{r[k]:.1e}" for k in names)] for r in rows]
    return (
        "A pulse of torque on an arm at rest without gravity, relative error of the rates after it. A method that "
        "chooses its steps steps over a pulse it was not told of, and nothing in its results shows it: give the "
        "instants as `breaks`, or as the law's own `breaks`; rne.trajectories' references have theirs.\n\n"
        + table(["width [s]", *names], cells)
    )
