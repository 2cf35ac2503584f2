"""Chart B: wall time against error of simulations, ours beside Pinocchio's ABA and MuJoCo's integrators.

Four comparisons. *Free swing of 1 s*: the error of the joint positions at the end, against Gragg-Bulirsch-Stoer
extrapolation in long double with the recursion; how far this reference may be off is what halving its steps changes.
*Free swing of 10 s* and *of 100 s*: the energy drift, which is the largest |E(t) - E(0)| at 1000 equally spaced times,
with the same energy function for all. *Stiff closed loop*: the IRB 140 under PD with gravity compensation and the gains
of the thesis, whose fastest mode decays at 15 300 1/s; the error of the joint positions after 1 s, against Radau at
1e-12; how far that may be off is the largest difference to it of LSODA and of Radau on Pinocchio's side.

Pinocchio is its ABA in the very solvers of SciPy that ours runs in, with the same tolerances (the absolute one is a
thousandth of the relative one) and exact Jacobians on both sides where a method takes one. `rne.simulate` contains what
it reports: energies, torques and accelerations at all times, and in the closed loop the work of the drives as a
further state. gauss-4 and implicit-midpoint are ours alone. MuJoCo steps in C with its own integrators at equal steps;
damping and constraints are off. Between its steps a SciPy method gives the states by its own interpolation, whose
error can be some ten times that of the steps; equal steps meet the times exactly. Repeats: three for the swing of 1 s
and the closed loop, two for 10 s; the runs of 100 s are measured once.
"""

from __future__ import annotations

import statistics
import time
from collections.abc import Iterator
from typing import Any

import numpy as np

from benchmarks import closed_loop, long_runs, swing
from benchmarks.integration_picture import picture
from benchmarks.kernels import robots
from benchmarks.pictures import table, three
from benchmarks.runs import WAYS, Row

__all__ = ["conclusion", "picture", "run", "tables"]

TITLES = {
    "swing": "Free swing of {:g} s, error of the joint positions at the end [rad]",
    "drift_10": "Free swing of {:g} s, energy drift [J]",
    "drift_100": "Free swing of {:g} s, energy drift [J]",
    "closed_loop": "Stiff closed loop of {:g} s, error of the joint positions at the end [rad]",
}


def run(quick: bool) -> dict[str, Any]:
    """All four."""
    begin = time.perf_counter()
    found = robots()
    irb140, ur5 = ({name: found[name]} for name in ("irb140", "ur5"))
    panels = {
        "swing": swing.run(irb140 if quick else irb140 | ur5, quick),
        "drift_10": long_runs.run(irb140 if quick else irb140 | ur5, "10 s", quick),
        "drift_100": long_runs.run(ur5 if quick else irb140 | ur5, "100 s", quick),
        "closed_loop": closed_loop.run(*irb140["irb140"], quick),
    }
    return {"took_s": time.perf_counter() - begin, "panels": panels}


def tables(results: dict[str, Any]) -> str:
    """One for each comparison."""
    parts = []
    for name, panel in results["panels"].items():
        ways = [who for who in WAYS if any(who in row["seconds"] for _, row in _rows(panel))]
        ratios = [who for who in ways if any(who in row["times_slower"] for _, row in _rows(panel))]
        what = "drift [J]" if name.startswith("drift") else "error [rad]"
        head = ["robot", "method", "rtol or step", *(f"ms, {WAYS[who]}" for who in ways)]
        head += [*(f"{what}, {WAYS[who]}" for who in ways), *(f"times Pinocchio's time, {WAYS[who]}" for who in ratios)]
        lines = [
            [
                robot,
                row["method"],
                row["setting"],
                *(f"{row['seconds'][who] * 1e3:.1f}" if who in row["seconds"] else "-" for who in ways),
                *(f"{row['errors'][who]:.1e}" if who in row["errors"] else "-" for who in ways),
                *(three(row["times_slower"][who]) if who in row["times_slower"] else "-" for who in ratios),
            ]
            for robot, row in _rows(panel)
        ]
        notes = "".join(f"\n\n{note}" for note in _notes(panel))
        parts.append(f"### {TITLES[name].format(panel['duration'])}\n\n{table(head, lines)}{notes}")
    return "\n\n".join(parts)


def _rows(panel: dict[str, Any]) -> Iterator[tuple[str, Row]]:
    for robot, result in panel["robots"].items():
        for row in result["runs"]:
            yield robot, row


def _notes(panel: dict[str, Any]) -> Iterator[str]:
    for robot, result in panel["robots"].items():
        if "reference_uncertainty" in result:
            yield f"{robot}: the reference may be off by {result['reference_uncertainty']:.0e} rad."
        if "auto" in result:
            yield f'{robot}: `method="auto"` takes {result["auto"]}.'
        for name, why in result.get("refused", {}).items():
            yield f"{robot}: {name} is left out: {why}."


def conclusion(results: dict[str, Any]) -> str:
    """What the figures say, in words."""
    panels = results["panels"]
    said = []
    for words, name, who in (
        ("In the same solver at the same error of the free swing rne takes", "swing", "rne"),
        ("rne.simulate, with all it reports, takes", "swing", "simulate"),
        ("On the stiff loop rne.simulate takes", "closed_loop", "simulate"),
    ):
        times = [row["times_slower"][who][0] for _, row in _rows(panels[name])]
        spread = f"{min(times):.1f} to {max(times):.1f} over methods and tolerances"
        said.append(f"{words} {statistics.median(times):.1f} times Pinocchio's time ({spread}).")
    loop = {(row["method"], row["setting"]): row["seconds"]["simulate"] for _, row in _rows(panels["closed_loop"])}
    for (method, setting), seconds in loop.items():
        if method == "RK45":
            times = seconds / loop["LSODA", setting]
            said.append(f"There RK45 takes {times:.0f} times the time of LSODA at the same tolerance {setting}.")
    duration = panels["drift_100"]["duration"]
    for robot, result in panels["drift_100"]["robots"].items():
        said.append(f"Over {duration:g} s of the {robot} {_beside_gauss(result['runs'])}.")
    return " ".join(said)


def _beside_gauss(rows: list[Row]) -> str:
    """The least drift of gauss-4 beside that of others on the lines through their runs; MuJoCo's least."""

    def runs(method: str, who: str) -> list[tuple[float, float]]:
        return sorted(
            (r["seconds"][who], r["errors"][who]) for r in rows if r["method"] == method and who in r["seconds"]
        )

    drift, seconds = min((e, s) for s, e in runs("gauss-4", "simulate"))
    words = []
    for method in ("RK45", "DOP853"):
        times, drifts = np.log(runs(method, "simulate")).T
        if np.log(seconds) >= times[0]:  # beyond the last run that run's drift counts
            factor = float(drift / np.exp(np.interp(np.log(seconds), times, drifts)))
            much = float(f"{max(factor, 1 / factor):.2g}")
            words.append(f"{method} {much:g} times {'less' if factor > 1 else 'more'}")
    beside = f", in no more time {' and '.join(words)}" if words else ""
    said = f"rne.simulate's gauss-4 drifts by {drift:.1e} J in {seconds:.1f} s of wall time{beside}"
    peers = [(e, s, method) for method in ("RK4", "Euler", "implicit") for s, e in runs(method, "mujoco")]
    if not peers:
        return said
    drift, seconds, method = min(peers)
    return f"{said}; MuJoCo's {method}, stepped in C, by {drift:.1e} J in {seconds:.1f} s"
