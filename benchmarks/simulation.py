"""Simulations by both engines beside Pinocchio's ABA: python -m benchmarks.simulation [--quick]

An ensemble of the IRB 140 by RK4, beside the time of its right-hand sides alone and beside abaInParallel driving the
same RK4 in NumPy; swings of UR5 and IRB 140 and the thesis's closed loop 6.5-1 by SciPy's methods, beside Pinocchio's
functions in the same ones; "auto" beside RK45 on the thesis's closed loops. Interleaved, one thread each. Writes
benchmarks/results/simulation.json.
"""

from __future__ import annotations

from typing import Any

from benchmarks import swarm
from benchmarks.cases import ENGINES, engines, engines_left_out
from benchmarks.measure import is_quick, write
from benchmarks.pages import table, three
from benchmarks.single_motions import automatic, stiff_loop, swings

Results = dict[str, Any]


def run(quick: bool) -> Results:
    """All figures; a quick run compiles one arm's swing by Numba, and no more."""
    there, plain = engines(), ("numpy",)
    few = plain if quick else there
    return {
        "engines_left_out": engines_left_out(),
        "ensemble": swarm.run(few, 100, 5, 1) if quick else swarm.run(there, 10_000, 100, 10),
        "motions": {
            "swing of the ur5": swings("ur5", there, 0.2 if quick else 10.0, 1 if quick else 5, quick),
            "swing of the irb140": swings("irb140", few, 0.2 if quick else 4.0, 1 if quick else 5, quick),
            "closed loop 6.5-1": stiff_loop(few, 0.02 if quick else 5.0, 1 if quick else 5, quick),
        },
        "closed_loops": automatic(1, 0.02) if quick else automatic(3, 5.0),
    }


def tables(results: Results) -> dict[str, str]:
    """Every table, by its title."""
    swarm = results["ensemble"]
    return {
        f"{swarm['starts']} starts, {swarm['steps']} steps of RK4": of_ensemble(swarm),
        "Single motions": of_motions(results["motions"]),
        "The thesis's closed loops, NumPy": of_loops(results["closed_loops"]),
    }


def of_ensemble(found: Results) -> str:
    """A row for each engine, and Pinocchio's."""
    head = ["robot", "by", "s", "times Pinocchio's speed", "times its right-hand sides alone"]
    head += ["two threads, times one's speed", "positions at the end, difference from Pinocchio's [rad]"]
    lines = [["irb140", "Pinocchio", f"{found['pinocchio_seconds']:.1f}", "-", "-", "-", "-"]]
    for engine in (e for e in ENGINES if e in found):
        own = found[engine]
        keys = ("times_faster_than_pinocchio", "times_its_right_hand_sides", "two_threads_times_faster")
        ratios = [three(own[key]) for key in keys]
        lines.append(["irb140", ENGINES[engine], f"{own['seconds']:.1f}", *ratios, f"{own['difference']:.0e}"])
    return table(head, lines)


def of_motions(motions: Results) -> str:
    """A row for each motion, method and engine, and Pinocchio's."""
    head = ["motion", "method", "rtol", "by", "rne.simulate [ms]", "times Pinocchio's time", "bare solve_ivp [ms]"]
    head += ["times Pinocchio's time", "rne.simulate, times the bare solver's time", "error [rad]", "first run [s]"]
    lines = []
    for name, motion in motions.items():
        what = f"{name}, {motion['duration']:g} s"
        for row in motion["runs"]:
            ms = {who: f"{seconds * 1e3:.1f}" for who, seconds in row["seconds"].items()}
            errors = {who: f"{error:.0e}" for who, error in row["errors"].items()}
            run = [what, row["method"], row["setting"]]
            lines.append([*run, "Pinocchio", "-", "-", ms["pinocchio"], "-", "-", errors["pinocchio"], "-"])
            for engine, first in motion["first_run_s"].items():
                bare, slower = f"{engine} bare", row["times_slower"]
                cells = [ms[engine], three(slower[engine]), ms[bare], three(slower[bare])]
                cells += [three(row["times_second"][engine]), errors[engine], f"{first:.2f}"]
                lines.append([*run, ENGINES[engine], *cells])
    return table(head, lines)


def of_loops(loops: list[Results]) -> str:
    """A row for each closed loop."""
    head = ["loop", "evaluations of auto", "of RK45", "times RK45's speed", "difference at the end [rad]"]
    lines = [
        [
            f"6.5-{k + 1}",
            str(loop["evaluations"]),
            str(loop["RK45_evaluations"]),
            three(loop["auto_times_faster"]),
            f"{loop['difference']:.0e}",
        ]
        for k, loop in enumerate(loops)
    ]
    return table(head, lines)


def main() -> None:
    quick = is_quick(__doc__)
    results = run(quick)
    for name, text in tables(results).items():
        print(f"{name}:\n\n{text}\n")
    for name, reason in results["engines_left_out"].items():
        print(f"{name} is left out: {reason}.")
    if not quick:
        write("simulation.json", results)


if __name__ == "__main__":
    main()
