"""Simulations by both engines and Pinocchio: python -m benchmarks.simulation [--quick] [--only PART] [--before TREE]

Swings, sampled control and the thesis's stiff loop, with Pinocchio's functions in SciPy's solvers; an ensemble of a
thousand swings; what a new process waits for; what a call costs whatever it computes; a dozen scenes with dry friction,
stops and limits, beside another tree's if `--before` names its folder; how many of the fuzz's scenes run in machine
code. Interleaved, one thread each; ratios are ratios
of medians, with the smallest and largest of neighbouring runs. A whole run writes benchmarks/results/simulation.json.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any

from benchmarks import fixed_costs, fuzz_share, hard_scenes, second_process, single_motions, swarm
from benchmarks.cases import ENGINES, engines, engines_left_out
from benchmarks.measure import QUICK_NOTE, command_line, write
from benchmarks.pages import table, three

Results = dict[str, Any]
Parts = dict[str, tuple[Callable[[], Any], Callable[[Any], str]]]


def parts(quick: bool, before: Path | None = None) -> Parts:
    """Parts with their measurement and presentation; a quick run compiles one arm's swing, and no more."""
    there = engines()
    few = there[:1] if quick else there
    return {
        "motions": (lambda: single_motions.run(there, few, quick), of_motions),
        "ensemble": (lambda: swarm.run(few, *((20, 0.1, 1) if quick else (1000, 1.0, 5))), of_ensemble),
        "second_process": (lambda: second_process.run(few, *((1, 0.01) if quick else (9, 1.0))), of_processes),
        "fixed_costs": (lambda: fixed_costs.run(few, *((1, 1) if quick else (31, 20))), of_costs),
        "hard_scenes": (
            lambda: hard_scenes.compare(before, few, *((1, 0.01) if quick else (5, 1.0))),
            of_scenes,
        ),
        "fuzz": (lambda: fuzz_share.run(*((4, few[-1]) if quick else (200, few[-1]))), of_fuzz),
    }


def run(quick: bool, only: Sequence[str] = (), before: Path | None = None) -> Results:
    """The figures of all parts, or of some."""
    results: Results = {"engines_left_out": engines_left_out()}
    for name, (measure, show) in parts(quick, before).items():
        if not only or name in only:
            begun = time.perf_counter()
            results[name] = measure()
            print(f"{name}:\n\n{show(results[name])}\n", flush=True)
            print(f"{name} took {time.perf_counter() - begun:.1f} s", file=sys.stderr)
    return results


def who(name: str) -> str:
    """Name in tables."""
    for engine, title in ENGINES.items():
        name = name.replace(engine, title)
    return name.replace("pinocchio", "Pinocchio")


def of_motions(motions: Results) -> str:
    """A row for each motion, setting and way."""
    head = ["motion", "method", "rtol", "by", "ms", "times Pinocchio's speed", "error [rad]", "times Pinocchio's error"]
    head += ["first run [s]"]
    lines = []
    for name, motion in motions.items():
        for row in motion["runs"]:
            for way, seconds in row["seconds"].items():
                error, theirs = row["errors"][way], row["errors"]["pinocchio"]
                line = [f"{name}, {motion['duration']:g} s", row["method"], row["setting"], who(way)]
                line += [f"{seconds * 1e3:.3g}", faster(row["times_slower"].get(way)), f"{error:.1e}"]
                line += [f"{error / theirs:.2g}" if theirs else "-"]
                lines.append([*line, f"{motion['first_run_s'][way]:.2f}" if way in motion["first_run_s"] else "-"])
    return table(head, lines)


def faster(times_slower: Iterable[float] | None) -> str:
    """The ratio the other way round."""
    if times_slower is None:
        return "-"
    median, low, high = times_slower
    return three((1 / median, 1 / high, 1 / low))


def of_ensemble(found: Results) -> str:
    """A row for each engine, and Pinocchio's."""
    head = ["robot", "motions", "by", "s", "times Pinocchio's speed", "two threads, times one's speed"]
    head += ["error [rad], median, largest", "RK4's step of this error [ms]", "times the speed of these steps"]
    what = ["irb140", f"{found['starts']} of {found['duration']:g} s"]
    what[1] += f", rtol {found['rtol']:g}" if found["step_control"] else ", equal steps"
    errors = {by: ", ".join(f"{e:.0e}" for e in pair) for by, pair in found["errors"].items()}
    lines = [[*what, "Pinocchio", f"{found['pinocchio_seconds']:.3g}", "-", "-", errors["pinocchio"], "-", "-"]]
    for engine in (e for e in ENGINES if e in found):
        own = found[engine]
        line = [*what, ENGINES[engine], f"{own['seconds']:.3g}", three(own["times_faster_than_pinocchio"])]
        line += [three(own["two_threads_times_faster"]), errors[engine], f"{own['equal_step'] * 1e3:.3g}"]
        lines.append([*line, three(own["times_faster_than_equal_steps"])])
    return table(head, lines)


def of_processes(found: Results) -> str:
    """A row for each stage and engine."""
    head = ["irb140", "engine", "first process [s]", "second process [s]", "times NumPy's time"]
    return table(
        head,
        [
            [stage, ENGINES[engine], f"{own['first_process']:.3f}", f"{own['seconds']:.3f}", three(own["times_numpy"])]
            for stage in found["numpy"]
            for engine, own in ((engine, stages[stage]) for engine, stages in found.items())
        ],
    )


def of_costs(found: Results) -> str:
    """Two tables."""
    runs = [[*who(name).split(", ", 1), f"{ms:.3f}"] for name, ms in found["simulate"].items()]
    calls = [
        [ENGINES[r["engine"]], str(r["states"]), f"{r['us']:.1f}", three(r["times_faster"])]
        for r in found["inverse_dynamics"]
    ]
    head = ["engine", "states", "robot.inverse_dynamics [us]", "times the speed of Pinocchio's batch of 1000"]
    return "\n\n".join([table(["engine", "rne.simulate over 1 us", "ms"], runs), table(head, calls)])


def of_scenes(rows: list[Results]) -> str:
    """A row for each scene and engine."""
    head = ["scene", "engine", "ms", "ms, all read", "before [ms]", "times the speed before", "all read"]
    head += ["largest difference at the end [rad]", "message"]
    lines = []
    for row in rows:
        line = [row["scene"], ENGINES[row["engine"]], *(f"{row[k]['now'] * 1e3:.3g}" for k in TIMED)]
        if "difference" in row:
            line += [f"{row['run_seconds']['before'] * 1e3:.3g}"]
            line += [*(three(row[f"{k}_times_faster"]) for k in ("run", "read")), f"{row['difference']:.0e}"]
        else:
            line += ["-"] * 4
        lines.append([*line, row["message"]])
    return table(head, lines)


def of_fuzz(found: Results) -> str:
    """The share, and the scenes that need SciPy's steps."""
    lines = [["all", f"{found['wholly']} of {found['scenes']} without a step of SciPy's solvers"]]
    return table(["seed", "scenes of the fuzz"], lines + [[str(seed), why] for seed, why in found["others"].items()])


TIMED = ("run_seconds", "read_seconds")


def main() -> None:
    parser = command_line(__doc__)
    parser.add_argument("--only", nargs="+", default=(), choices=list(parts(True)), help="parts; no file is written")
    parser.add_argument("--before", type=Path, help="the folder of another tree, for the scenes with friction")
    given = parser.parse_args()
    results = run(given.quick, given.only, given.before)
    for name, reason in results["engines_left_out"].items():
        print(f"{name} is left out: {reason}.")
    if given.quick:
        print(QUICK_NOTE)
    elif not given.only:
        write("simulation.json", results)


if __name__ == "__main__":
    main()
