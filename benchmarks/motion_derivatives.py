"""Derivatives of motions: python -m benchmarks.motion_derivatives [--quick]

Gradients of a cost of PD motions of the UR5 beside the motion alone, by the same steps and as `rne.simulate` and
`rne.ensemble` run it; sensitivities at many times; a chart of error against time beside differences, CasADi, JAX and
MuJoCo. One core, CPU times of calls that take turns, and the error of the very call that was timed. Writes
benchmarks/results/motion_derivatives.json, the tables of motion_derivatives.md and gradient-errors.md in
docs/benchmarks, and their picture.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from statistics import median
from typing import Any, NamedTuple

import numpy as np

import rne
from benchmarks import motion_derivative_peers as peers
from benchmarks import motion_derivatives_picture
from benchmarks.cases import ENGINES, engines
from benchmarks.measure import QUICK_NOTE, interleaved, is_quick, ratio, write
from benchmarks.motion_derivative_cases import (
    OF_FIT,
    OF_POSE,
    OF_SWAY,
    START,
    arm,
    by_complex_steps,
    elasticities,
    error,
    final,
    largest_decay,
    pose,
    sway,
    values,
)
from benchmarks.pages import DOCS, rewrite, table, three
from benchmarks.peers.registry import import_failure
from rne.integrators.tableaus import tableau
from rne.simulation.frozen_motion import FrozenScene, SideBySide, flat, schedule_of

PAGES = tuple(DOCS / "benchmarks" / f"{name}.md" for name in ("motion_derivatives", "gradient-errors"))
STEP, DURATION, SIDE_BY_SIDE = 1e-3, 10.0, 256  # [s], [s], motions
TIGHT: dict[str, Any] = {"method": "DOP853", "rtol": 1e-13, "atol": 1e-15}
CONTROLLED: dict[str, Any] = {"method": "DOP853", "rtol": 1e-8, "atol": 1e-11}
SHARES = tuple(10.0**-k for k in range(2, 12))  # of finite differences,
SHARE = "1e-06"  # of which one is timed
CHART = 1.0  # [s]
Call = Callable[[], Any]
Results = dict[str, Any]


class Case(NamedTuple):
    """A gradient: its title, names, number of motions and options."""

    title: str
    names: tuple[str, ...]
    count: int
    how: dict[str, Any]


CASES = (
    Case("42 numbers, RK4 at 1 ms", OF_SWAY, 1, {"step": STEP}),
    Case("102 numbers, bodies among them, RK4 at 1 ms", (*OF_SWAY, "parameters"), 1, {"step": STEP}),
    Case(f"42 numbers, RK4 at 1 ms, {SIDE_BY_SIDE} motions side by side", OF_SWAY, SIDE_BY_SIDE, {"step": STEP}),
    Case("42 numbers, DOP853 at 1e-8", OF_SWAY, 1, CONTROLLED),
)


def run(quick: bool) -> Results:
    """All figures."""
    scene = sway("ur5", "numpy")
    found: Results = {"duration": 0.02 if quick else DURATION, "step": STEP, "decay": largest_decay(scene)}
    cases, robots = CASES[: 1 if quick else None], (("irb140", OF_FIT), ("ur5", OF_POSE))
    found["costs"] = [cost_of(case, engine, quick) for case in cases for engine in engines()]
    found["forward"] = [forward_of(*case, quick) for case in robots[: 1 if quick else None]]
    found["rollouts"] = beside_rollouts(quick)
    found["chart"] = chart(quick)
    return found


def starts(count: int) -> tuple[Any, Any]:
    """Start of one motion, or of several that differ."""
    if count == 1:
        return START
    moved = START[0] + np.linspace(-0.2, 0.2, count)[:, None]
    return moved, np.tile(START[1], (count, 1))


def cost_of(case: Case, engine: str, quick: bool) -> Results:
    """Times of a gradient, of the motion alone and as it is simulated; NumPy's of a shorter one, and of fewer."""
    by_machine = engine == "numba"
    count = case.count if by_machine else min(case.count, 32)
    end = 0.02 if quick else DURATION if by_machine else DURATION / 50
    scene, given = sway("ur5", engine), starts(count)
    frozen = FrozenScene(scene, case.names)

    def gradient(**how: Any) -> Any:
        return rne.motion_gradient(scene, *given, end, final=final, wrt=case.names, **how)

    calls: dict[str, Call] = {"gradient": lambda: gradient(**case.how)}
    if "step" in case.how:
        rows = tuple(np.atleast_2d(x) for x in given)
        calls["simulated"] = lambda: rne.ensemble(scene, *rows, end, step=STEP, keep=2)
        calls["alone"] = alone(frozen, rows, end, by_machine=by_machine)
        steps = round(end / STEP) * count
    else:
        calls["simulated"] = lambda: rne.simulate(scene, *given, end, **case.how)
        steps = len(rne.simulate(scene, *given, end, **case.how).t) - 1
    if case is CASES[0]:
        calls["step control"] = lambda: rne.simulate(scene, *given, end)
    seconds = interleaved(calls, 1 if quick else 9 if count == 1 and by_machine else 3, clock=time.process_time)
    exact, one = gradient(**TIGHT) if count == 1 else None, starts(count)
    if exact is None:  # of the last one
        exact = rne.motion_gradient(scene, one[0][-1], one[1][-1], end, final=final, wrt=case.names, **TIGHT)
    slopes = {k: x if count == 1 else x[-1] for k, x in gradient(**case.how).gradient.items()}
    numbers = values(scene, case.names) | {"q0": np.atleast_2d(one[0])[-1], "qd0": np.atleast_2d(one[1])[-1]}
    row = {"case": case.title, "engine": engine, "motions": count, "duration": end, "steps": steps}
    row |= {"seconds": {name: median(runs) for name, runs in seconds.items()}}
    row["times"] = {name: ratio(seconds, "gradient", name) for name in calls if name != "gradient"}
    return row | {"error": error(slopes, exact.gradient, numbers)}


def alone(frozen: FrozenScene, rows: tuple[Any, ...], end: float, *, by_machine: bool) -> Call:
    """The steps of a gradient without anything else: one motion, or as many side by side as machine code takes."""
    count = len(rows[0])
    lanes = rne.integrators.loops.LANES if by_machine and count > 1 else count
    group = SideBySide(frozen, {}, lanes, by_machine=by_machine)
    schedule = schedule_of(tableau("rk4"), frozen.equal_steps(end, STEP), *frozen.instants(end))
    x0 = [flat(frozen.start(group.numbers, *(x[k : k + lanes] for x in rows))) for k in range(0, count, lanes)]

    def call() -> None:
        for x in x0:
            group.advance(schedule, x.copy(), group.kept(0, 0))

    return call


def forward_of(name: str, names: tuple[str, ...], quick: bool) -> Results:
    """Sensitivities at 100 times a second, RK4 at 1 ms."""
    made = sway if names is OF_FIT else pose
    found: Results = {"robot": name, "columns": sum(x.size for x in values(made(name, "numpy"), names).values())}
    for engine in engines():
        end = 0.02 if quick else DURATION if engine == "numba" else DURATION / 50
        scene, grid = made(name, engine), np.linspace(0.0, end, round(100 * end) + 1)

        def call(scene: rne.Scene = scene, grid: Any = grid, **how: Any) -> Any:
            how = how or {"step": STEP}
            return rne.sensitivities(scene, *START, grid[-1], wrt=names, t_eval=grid, **how)

        seconds = interleaved({"forward": call}, 1 if quick else 7, clock=time.process_time)
        numbers = values(scene, names)
        ours, exact = (elasticities(motion.dq, numbers) for motion in (call(), call(**TIGHT)))
        found[engine] = {
            "duration": end,
            "seconds": median(seconds["forward"]),
            "error": float(np.abs(ours - exact).max() / np.abs(exact).max()),
        }
    return found


def beside_rollouts(quick: bool) -> Results:
    """Derivatives of the UR5's motion to a pose by 36 numbers: ours, and by 37 rollouts in MuJoCo."""
    if import_failure("mujoco") or "numba" not in engines():
        return {}
    end, scene = 0.02 if quick else DURATION, pose("ur5", "numba")
    grid = np.linspace(0.0, end, round(100 * end) + 1)
    calls: dict[str, Call] = {
        "rne.motion_gradient": lambda: rne.motion_gradient(scene, *START, end, final=final, wrt=OF_POSE, step=STEP),
        "rne.sensitivities": lambda: rne.sensitivities(scene, *START, end, wrt=OF_POSE, step=STEP, t_eval=grid),
    }
    for integrator in ("RK4", "Euler"):
        calls[f"MuJoCo, {integrator}"] = peers.by_mujoco(arm("ur5", "numba"), end, STEP, integrator, 1e-6)
    seconds = interleaved(calls, 1 if quick else 3, clock=time.process_time)
    times = {
        f"{theirs} over {ours}": ratio(seconds, theirs, ours) for ours in list(calls)[:2] for theirs in list(calls)[2:]
    }
    return {"duration": end, "seconds": {name: median(runs) for name, runs in seconds.items()}, "times": times}


def chart(quick: bool) -> list[Results]:
    """Time and error of gradients of a motion of 1 s by 36 numbers, by each way and setting."""
    end, shares = (0.02, [1e-6]) if quick else (CHART, SHARES)
    engine = engines()[-1]
    scene, robot = pose("ur5", engine), arm("ur5", engine)
    exact = by_complex_steps(scene, OF_POSE, end, 10 if quick else 500)
    calls: dict[tuple[str, str], Call] = {}
    for made in engines():
        for step in (1e-3,) if quick or made == "numpy" else (8e-3, 4e-3, 2e-3, 1e-3, 5e-4):
            calls[f"rne, RK4, {ENGINES[made]}", f"{1e3 * step:g} ms"] = ours(pose("ur5", made), end, step=step)
    for rtol in (1e-6,) if quick else (1e-2, 1e-4, 1e-6, 1e-8, 1e-10, 1e-12):
        how = {"method": "DOP853", "rtol": rtol, "atol": 1e-3 * rtol}
        calls[f"rne, DOP853, {ENGINES[engine]}", f"{rtol:.0e}"] = ours(scene, end, **how)
    for share in shares:
        calls["differences of rne.ensemble", f"{share:.0e}"] = peers.by_ensemble(scene, end, STEP, share)
        calls["differences of rne.simulate", f"{share:.0e}"] = peers.by_simulate(scene, end, share)
        for integrator in ("RK4", "Euler") if import_failure("mujoco") is None else ():
            name = f"differences of MuJoCo's {integrator}"
            calls[name, f"{share:.0e}"] = peers.by_mujoco(robot, end, STEP, integrator, share)
    if import_failure("casadi") is None:
        calls |= {(name, "1 ms"): call for name, call in peers.by_casadi(scene, end, STEP).items()}
    if import_failure("jax") is None and engine == "numba":
        calls["JAX, machine code", "1 ms"] = peers.by_jax(scene, end, STEP)
    numbers = values(scene, OF_POSE)
    errors = {key: error(call(), exact, numbers) for key, call in calls.items()}
    timed = {(by, setting): (by, SHARE if by.startswith("differences") else setting) for by, setting in calls}
    once = {"\n".join(key): calls[key] for key in dict.fromkeys(timed.values())}  # differences take one time
    seconds = interleaved(once, 1 if quick else 7, clock=time.process_time)
    return [
        {"by": key[0], "setting": key[1], "ms": 1e3 * median(seconds["\n".join(timed[key])]), "error": errors[key]}
        for key in calls
    ]


def ours(scene: rne.Scene, end: float, **how: Any) -> Call:
    """A gradient by `rne.motion_gradient`."""
    return lambda: rne.motion_gradient(scene, *START, end, final=final, wrt=OF_POSE, **how).gradient


def tables(results: Results) -> dict[str, str]:
    """Every table of the page, by its name."""
    return {
        "gradients": of_costs(results),
        "forward": of_forward(results),
        "rollouts": of_rollouts(results["rollouts"]),
        "chart": of_chart(results["chart"]),
    }


def of_costs(results: Results) -> str:
    """A row for each gradient and engine."""
    head = ["UR5, by", "engine", "motions", "steps", "motion [ms]", "as simulated [ms]", "gradient [ms]"]
    head += ["times the motion", "times as simulated", "worst error"]
    lines = []
    for row in results["costs"]:
        ms = {name: f"{1e3 * s:.4g}" for name, s in row["seconds"].items()}
        times = [three(row["times"][name]) if name in ms else "-" for name in ("alone", "simulated")]
        cells = [ms.get("alone", "-"), ms["simulated"], ms["gradient"], *times, f"{row['error']:.0e}"]
        lines.append([row["case"], ENGINES[row["engine"]], str(row["motions"]), str(row["steps"]), *cells])
    return table(head, lines)


def of_forward(results: Results) -> str:
    """A row for each robot and engine."""
    head = ["robot", "columns", "engine", "motion of [s]", "sensitivities [s]", "worst error"]
    return table(
        head,
        [
            [
                row["robot"],
                str(row["columns"]),
                ENGINES[engine],
                f"{row[engine]['duration']:g}",
                f"{row[engine]['seconds']:.3g}",
                f"{row[engine]['error']:.0e}",
            ]
            for row in results["forward"]
            for engine in ENGINES
            if engine in row
        ],
    )


def of_rollouts(found: Results) -> str:
    """Times, and those of MuJoCo over ours."""
    if not found:
        return "MuJoCo or Numba is not installed."
    mine = [name for name in found["seconds"] if name.startswith("rne")]
    lines = [
        [
            name,
            f"{1e3 * s:.4g}",
            *(three(found["times"][f"{name} over {own}"]) if name not in mine else "-" for own in mine),
        ]
        for name, s in found["seconds"].items()
    ]
    return table(["UR5, by 36 numbers", "CPU time [ms]", *(f"times {name}" for name in mine)], lines)


def of_chart(rows: list[Results]) -> str:
    """A row for each point."""
    lines = [[row["by"], row["setting"], f"{row['ms']:.3g}", f"{row['error']:.1e}"] for row in rows]
    return table(["gradient by", "step, tolerance or share", "CPU time [ms]", "worst error"], lines)


def main() -> None:
    quick = is_quick(__doc__)
    results = run(quick)
    decay = results["decay"]
    print(f"largest decay rate {decay:.0f} 1/s, times the step of {1e3 * STEP:g} ms {decay * STEP:.2f}\n")
    print("\n\n".join(f"{name}:\n\n{text}" for name, text in tables(results).items()))
    figure = motion_derivatives_picture.picture(results["chart"])
    if quick:
        print(QUICK_NOTE)
        return
    write("motion_derivatives.json", results)
    figure.savefig(DOCS / "benchmarks" / "motion_derivatives.png", facecolor="white", dpi=150)
    rewrite(tables(results), *PAGES)


if __name__ == "__main__":
    main()
