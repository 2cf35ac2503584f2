"""All charts: python -m benchmarks [--quick] [--only CHART]

Evaluation, integration, growth and scenes, with Pinocchio in the same interleaved runs, one thread each. Writes
benchmarks/results/charts.json, tables and pictures of the pages in docs/benchmarks, whose text is written by hand, and
the chart of the start page. Peers that are installed take part in the first chart:
pip install $(python -m benchmarks.peers). With `--only`, other charts stay as they were kept.
"""

from __future__ import annotations

import json
import sys
import time
from datetime import date
from typing import Any

from benchmarks import (
    engines,
    evaluation,
    evaluation_picture,
    growth,
    growth_picture,
    integration,
    integration_picture,
    readme_picture,
    scenes,
)
from benchmarks.cases import engines_left_out
from benchmarks.measure import QUICK_NOTE, RESULTS, command_line, machine, write
from benchmarks.pages import DOCS, rewrite
from benchmarks.peers import left_out, versions

CHARTS: dict[str, tuple[Any, Any]] = {
    "evaluation": (evaluation, evaluation_picture.picture),
    "integration": (integration, integration_picture.picture),
    "growth": (growth, growth_picture.picture),
    "scenes": (scenes, scenes.picture),
}
PAGES = tuple(
    DOCS / "benchmarks" / f"{name}.md"
    for name in (
        *("evaluation", "evaluation-machine-code", "evaluation-calls", "batch-sizes"),
        *("simulation", "energy-drift", "closed-loops", "joints", "scenes"),
    )
)


def about(refused: dict[str, dict[str, str]]) -> str:
    """Day, processor, versions, and which peers are left out."""
    found = machine() | versions()
    packages = ", ".join(f"{name} {value}" for name, value in found.items() if name not in ("cpu", "cores"))
    lines = [f"- {date.today()}: {found['cpu']}, {found['cores']} cores, one thread per call; {packages}."]
    missing = engines_left_out() | left_out()
    lines += [f"- {name} is left out: {reason}." for name, reason in missing.items()]
    lines += [
        f"- {name} is left out on {robot}: {reason}."
        for robot, reasons in refused.items()
        for name, reason in reasons.items()
    ]
    return "\n".join(lines)


def main() -> None:
    parser = command_line(__doc__)
    parser.add_argument("--only", nargs="+", default=list(CHARTS), choices=list(CHARTS), help="charts to measure anew")
    given = parser.parse_args()
    results: dict[str, Any] = {}
    for name, module in ((name, CHARTS[name][0]) for name in given.only):
        start = time.perf_counter()
        results[name] = module.run(given.quick)
        print("\n\n".join(module.tables(results[name]).values()) + "\n", flush=True)
        print(f"{name} took {time.perf_counter() - start:.1f} s", file=sys.stderr)
    figures = {name: CHARTS[name][1](results[name]) for name in results}
    if given.quick:
        print(QUICK_NOTE)
        return
    if len(results) < len(CHARTS):
        results = json.loads((RESULTS / "charts.json").read_text(encoding="utf-8"))["charts"] | results
    write("charts.json", {"compared": versions(), "left_out": left_out(), "charts": results})
    for name, figure in figures.items():
        figure.savefig(DOCS / "benchmarks" / f"{name}.png", facecolor="white")
    tables = {"machine": about(results["evaluation"]["refused"])}
    for name, (module, _) in CHARTS.items():
        tables |= module.tables(results[name])
    rewrite(tables, *PAGES)
    engines.fill()
    readme_picture.main()


if __name__ == "__main__":
    main()
