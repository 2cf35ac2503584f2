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
damping and constraints are off. A SciPy method gives the energies between its steps by its own interpolation, which
costs Radau most; equal steps meet the times exactly. Repeats: three for the swing of 1 s and the closed loop, two for
10 s; the runs of 100 s are measured once, on the UR5 alone.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from typing import Any

from benchmarks import closed_loop, long_runs, swing
from benchmarks.integration_picture import picture
from benchmarks.kernels import robots
from benchmarks.pictures import table, three
from benchmarks.runs import WAYS, Row

__all__ = ["conclusion", "picture", "run", "tables"]

TITLES = {
    "swing": "Free swing of {:g} s, error of the joint positions at the end [rad]",
    "drift_10": "Free swing of {:g} s, energy drift [J]",
    "closed_loop": "Stiff closed loop of {:g} s, error of the joint positions at the end [rad]",
    "drift_100": "Free swing of {:g} s, energy drift [J]",
}


def run(quick: bool) -> dict[str, Any]:
    """All four."""
    begin = time.perf_counter()
    found = robots()
    irb140, ur5 = ({name: found[name]} for name in ("irb140", "ur5"))
    both = irb140 if quick else irb140 | ur5
    panels = {
        "swing": swing.run(both, quick),
        "drift_10": long_runs.run(both, "10 s", quick),
        "closed_loop": closed_loop.run(*irb140["irb140"], quick),
        "drift_100": long_runs.run(ur5, "100 s", quick),
    }
    return {"took_s": time.perf_counter() - begin, "panels": panels}


def tables(results: dict[str, Any]) -> str:
    """One for each comparison."""
    parts = []
    for name, panel in results["panels"].items():
        ways = [who for who in WAYS if any(who in row["seconds"] for _, row in _rows(panel))]
        ratios = [who for who in ways if any(who in row["times_slower"] for _, row in _rows(panel))]
        head = ["robot", "method", "rtol or step", *(f"ms, {WAYS[who]}" for who in ways)]
        head += [*(f"error, {WAYS[who]}" for who in ways), *(f"times Pinocchio's time, {WAYS[who]}" for who in ratios)]
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
    first = list(_rows(panels["swing"]))
    same = [row["times_slower"]["rne"][0] for _, row in first]
    whole = [row["times_slower"]["simulate"][0] for _, row in first]
    said = [
        f"In the same solver at the same error of the free swing, rne takes {min(same):.1f} to {max(same):.1f} times "
        f"Pinocchio's time, rne.simulate with all it reports {min(whole):.1f} to {max(whole):.1f} times."
    ]
    loop = [row for _, row in _rows(panels["closed_loop"])]
    implicit = {row["setting"]: row for row in loop if row["method"] == "LSODA"}
    explicit = [row for row in loop if row["method"] == "RK45"]
    ratios = [row["times_slower"]["simulate"][0] for row in loop]
    sentence = f"On the stiff loop rne.simulate takes {min(ratios):.1f} to {max(ratios):.1f} times Pinocchio's time"
    for row in explicit:
        times = row["seconds"]["simulate"] / implicit[row["setting"]]["seconds"]["simulate"]
        sentence += f", and RK45 {times:.0f} times LSODA's at the tolerance {row['setting']}"
    said.append(sentence + ".")
    long = [row for _, row in _rows(panels["drift_100"])]
    said.append(f"Over {panels['drift_100']['duration']:g} s {_beside_gauss(long)}.")
    return " ".join(said)


def _beside_gauss(rows: list[Row]) -> str:
    """The drift of gauss-4 beside what the others reach in no more time."""
    gauss = min((row for row in rows if row["method"] == "gauss-4"), key=lambda row: row["errors"]["simulate"])
    drift, seconds = gauss["errors"]["simulate"], gauss["seconds"]["simulate"]
    words = []
    for method in ("RK45", "DOP853"):
        reached = [
            row["errors"]["simulate"]
            for row in rows
            if row["method"] == method and row["seconds"]["simulate"] <= seconds
        ]
        if reached:
            times = drift / min(reached)
            much = f"{times:.2g} times larger" if times > 1 else f"{1 / times:.2g} times smaller"
            words.append(f"{much} than {method}'s best in no more time")
    compared = " and ".join(words) or "reached by neither RK45 nor DOP853 in so short a time"
    return f"gauss-4's drift of {drift:.1e} J in {seconds:.1f} s is {compared}"
