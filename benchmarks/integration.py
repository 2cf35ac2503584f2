"""Chart B: wall time against the error of simulations, with Pinocchio's ABA and MuJoCo's integrators.

A free swing of 1 s (error of the joint positions at the end), free swings of 10 s and of 100 s (energy drift), the
stiff closed loop of the thesis and control sampled at 1 kHz (errors of the positions), and an ensemble of swings.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from benchmarks import closed_loop, long_runs, sampled_loop, swarm, swing
from benchmarks.cases import engines, load
from benchmarks.pages import table, three
from benchmarks.runs import WAYS, Row


def run(quick: bool) -> dict[str, Any]:
    """All of them; a quick run is NumPy's."""
    there = engines()[:1] if quick else engines()
    irb140, ur5 = ({name: {engine: load(name, engine) for engine in there}} for name in ("irb140", "ur5"))
    both = irb140 if quick else irb140 | ur5
    return {
        "swing": swing.run(both, quick),
        "drift-10": long_runs.run(both, "10 s", quick),
        "drift-100": long_runs.run(ur5 if quick else both, "100 s", quick),
        "closed-loop": closed_loop.run(irb140["irb140"], quick),
        "sampled": sampled_loop.run(irb140["irb140"], quick),
        "ensemble": swarm.panel(irb140["irb140"], quick),
    }


def tables(results: dict[str, Any]) -> dict[str, str]:
    """One for each comparison."""
    return {name: of_panel(name, panel) for name, panel in results.items()}


def of_panel(name: str, panel: dict[str, Any]) -> str:
    """The runs of a comparison, and what the reference and the automatic choice of the method were."""
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
    return "\n\n".join([table(head, lines), *_notes(panel)])


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
