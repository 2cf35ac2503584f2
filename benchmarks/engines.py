"""Tables of the engines: python -m benchmarks.engines [--quick]

From the last runs of `python -m benchmarks.kernels` and `python -m benchmarks.simulation`, whose JSON files are read,
the tables of engines, kernels and single motions are written anew where a page has a place for one. `--quick` runs both
benchmarks with few states and prints the tables.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from benchmarks import kernels, simulation
from benchmarks.cases import ENGINES, QUANTITIES, title
from benchmarks.measure import QUICK_NOTE, RESULTS, is_quick
from benchmarks.pages import DOCS, places, rewrite, table

README = Path(__file__).resolve().parents[1] / "README.md"
PAGES = (
    README,
    DOCS / "explanation" / "kernels.md",
    DOCS / "benchmarks" / "engines.md",
    DOCS / "benchmarks" / "index.md",
)
RUNS = {  # files of results behind docs/benchmarks/index.md, and what writes them
    "kernels.json": "python -m benchmarks.kernels",
    "simulation.json": "python -m benchmarks.simulation",
    "charts.json": "python -m benchmarks",
}
SHOWN = ("irb140", "panda")  # robots of the table of kernels
Results = dict[str, Any]


def tables(found: Results, motions: Results) -> dict[str, str]:
    """By the name of their place in a page."""
    return {
        "engines": beside_each_other(found, motions),
        "kernels": of_kernels(found),
        "motions": of_motions(motions),
        "record": record(),
    }


def record() -> str:
    """A row for each kept run: command, date, machine, and the hash of its results."""
    lines = []
    for name, command in RUNS.items():
        text = (RESULTS / name).read_text(encoding="utf-8")
        kept = json.loads(text)
        machine = f"{kept['machine']['cpu']}, {kept['machine']['cores']} cores, {kept['numpy_simd'][-1]}"
        digest = hashlib.sha256(text.encode()).hexdigest()[:12]
        lines.append([f"`{command}`", kept["date"], machine, f"`benchmarks/results/{name}`", f"`{digest}`"])
    return table(["command", "date", "machine", "results", "SHA-256 begins with"], lines)


def beside_each_other(found: Results, motions: Results) -> str:
    """A row for each engine: how its times compare with Pinocchio's, from the worst to the best case."""
    sizes = [f"batch of {thousands(found[key])}" for key in ("small", "states")]
    swing = motions["motions"]["swing of the ur5"]
    starts = thousands(motions["ensemble"]["starts"])
    head = ["engine", "one state", *sizes, f"swing of {swing['duration']:g} s", f"ensemble of {starts}"]
    lines = []
    for engine, name in ENGINES.items():
        rows = [row[engine] for robot in found["robots"].values() for row in quantities(robot) if engine in row]
        if not rows:
            continue
        cells = [words(1 / row["single_times_slower"][0] for row in rows)]
        cells += [words(row[f"{size}_times_faster"][0] for row in rows) for size in ("small", "batch")]
        cells.append(words(1 / r["times_slower"][engine][0] for r in swing["runs"] if engine in r["times_slower"]))
        ensemble = motions["ensemble"].get(engine)
        cells.append(words([ensemble["times_faster_than_pinocchio"][0]]) if ensemble else "-")
        lines.append([name, *cells])
    return table(head, lines)


def quantities(robot: Results) -> list[Results]:
    """The figures of each quantity of a robot."""
    return [robot[quantity] for quantity in QUANTITIES]


def words(times_faster: Iterable[float]) -> str:
    """Comparison of ratios: "5.1 to 9.7 times faster", "1.2 times slower to 1.3 times faster", "equally fast"."""
    values = sorted(times_faster)
    numbers = [f"{max(value, 1 / value):.1f}" for value in values]
    ways = ["faster" if value > 1 else "slower" for value in values]
    sides = {way for number, way in zip(numbers, ways, strict=True) if number != "1.0"}
    if not sides:
        return "equally fast" if values else "-"
    if len(sides) == 2:
        return f"{numbers[0]} times slower to {numbers[-1]} times faster"
    first, last = sorted((numbers[0], numbers[-1]), key=float)
    return f"{first if first == last else f'{first} to {last}'} times {sides.pop()}"


def of_kernels(found: Results) -> str:
    """A row for each robot, quantity and engine: ratios to Pinocchio's times."""
    head = ["robot", "quantity", "operations", "engine", "error [eps]", f"batch of {thousands(found['states'])}, ns"]
    head += ["times faster than Pinocchio", f"batch of {thousands(found['small'])}, ns", "times faster"]
    head += ["one state, µs", "times Pinocchio's time"]
    lines = []
    for robot in (name for name in SHOWN if name in found["robots"]):
        for quantity in QUANTITIES:
            row = found["robots"][robot][quantity]
            for engine in (e for e in ENGINES if e in row):
                own = row[engine]
                start = [robot, title(quantity), str(row["operations"]), ENGINES[engine]]
                error = max(own["error_eps"], own["single_error_eps"])
                large = [f"{own['ns_per_state']:.0f}", f"{own['batch_times_faster'][0]:.1f}"]
                small = [f"{own['small_ns_per_state']:.0f}", f"{own['small_times_faster'][0]:.1f}"]
                single = [f"{own['single_us']:.1f}", f"{own['single_times_slower'][0]:.2f}"]
                lines.append([*start, f"{error:.1f}", *large, *small, *single])
    return table(head, lines)


def of_motions(motions: Results) -> str:
    """A row for each single motion and method: times of rne.simulate as multiples of Pinocchio's."""
    engines = [e for e in ENGINES if e in motions["motions"]["swing of the ur5"]["first_run_s"]]
    head = ["motion", "method", "Pinocchio [ms]"]
    head += [f"{ENGINES[e]}, times Pinocchio's time" for e in engines]
    lines = []
    for name, motion in motions["motions"].items():
        for row in motion["runs"]:
            start = [f"{name}, {motion['duration']:g} s", f"{row['method']} at {row['setting']}"]
            cells = [_median(row["times_slower"], e) for e in engines]
            lines.append([*start, f"{row['seconds']['pinocchio'] * 1e3:.0f}", *cells])
    return table(head, lines)


def _median(ratios: Mapping[str, Any], engine: str) -> str:
    return f"{ratios[engine][0]:.2f}" if engine in ratios else "-"


def thousands(count: int) -> str:
    """With a space between thousands, from ten thousand on."""
    return f"{count:,}".replace(",", " ") if count >= 10_000 else str(count)


def read(name: str) -> Results:
    """The results of the last run of a benchmark."""
    found: Results = json.loads((RESULTS / name).read_text(encoding="utf-8"))
    return found


def fill() -> dict[str, str]:
    """Write the tables of the kept results into the pages that have a place for them, and return them."""
    found = tables(read("kernels.json"), read("simulation.json"))
    for page in PAGES:
        rewrite({name: found[name] for name in places(page)}, page)
    return found


def main() -> None:
    quick = is_quick(__doc__)
    found = tables(kernels.run(True), simulation.run(True, ("motions", "ensemble"))) if quick else fill()
    print("\n\n".join(found.values()))
    if quick:
        print(f"\n{QUICK_NOTE}")


if __name__ == "__main__":
    main()
