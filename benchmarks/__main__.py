"""All charts: python -m benchmarks [--quick]

Evaluation, integration, growth and scenes, ours and Pinocchio's in the same interleaved runs, one thread each. Writes
benchmarks/results/charts.json, and docs/benchmarks/index.md with its pictures. Of the other packages, which the extra
`peers` installs, those that are there take part in the first chart.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from pathlib import Path
from typing import Any

from benchmarks import evaluation, growth, integration, scenes
from benchmarks.measure import machine, write
from benchmarks.peers import left_out, versions

PAGE = Path(__file__).resolve().parents[1] / "docs" / "benchmarks"
CHARTS: dict[str, tuple[Any, str]] = {
    "evaluation": (evaluation, "A. What an evaluation costs and what it is worth"),
    "integration": (integration, "B. What a simulation costs and what it is worth"),
    "growth": (growth, "C. Growth with joints and states"),
    "scenes": (scenes, "D. What a scene pays"),
}
THREADS = 1


def text(title: str, name: str, module: Any, result: dict[str, Any]) -> str:
    """A section of the page."""
    notes = (module.__doc__ or "").split("\n", 1)[1].strip().replace("\n\n", "\0").replace("\n", " ")
    parts = [f"## {title}", notes.replace("\0", "\n\n"), f"![{title}]({name}.png)", *found(module, result)]
    return "\n\n".join(parts) + "\n"


def found(module: Any, result: dict[str, Any]) -> list[str]:
    """What is concluded, where a chart concludes something, and the table."""
    conclude = getattr(module, "conclusion", None)
    return [*([conclude(result)] if conclude else []), module.tables(result)]


def head(about: dict[str, Any], refused: dict[str, dict[str, str]]) -> str:
    """What a reader needs to judge the figures."""
    there = ", ".join(f"{name} {value}" for name, value in about.items() if name not in ("cpu", "cores", "threads"))
    lines = [
        "# Benchmarks",
        "",
        "Written by `python -m benchmarks`; the figures are kept in `benchmarks/results/charts.json`.",
        "",
        f"{about['cpu']}, {about['cores']} cores, {about['threads']} thread a call; {there}.",
        "",
        "Times are medians of repeats in which all compared calls take turns. Ratios are ratios of medians, with the",
        "smallest and largest ratio of neighbouring runs in brackets. Compare ratios, not times: a machine's moods",
        "change these by tens of percent. An error is that of the very call that was timed.",
        "",
    ]
    for name, reason in left_out().items():
        lines.append(f"- {name} is left out: {reason}.")
    for robot, reasons in refused.items():
        lines += [f"- {name} is left out on {robot}: {why}." for name, why in reasons.items()]
    return "\n".join(lines) + "\n"


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m benchmarks", description=__doc__)
    parser.add_argument("--quick", action="store_true", help="small batches, few repeats, nothing written")
    quick = parser.parse_args().quick
    results: dict[str, Any] = {}
    for name, (module, title) in CHARTS.items():
        start = time.perf_counter()
        results[name] = module.run(quick)
        print("\n\n".join([f"## {title}", *found(module, results[name])]) + "\n", flush=True)
        print(f"{name} took {time.perf_counter() - start:.1f} s", file=sys.stderr)
    pictures = {name: module.picture(results[name]) for name, (module, _) in CHARTS.items()}
    if quick:
        return
    about = machine() | versions() | {"threads": THREADS}
    write("charts.json", {"threads": THREADS, "compared": versions(), "left_out": left_out(), "charts": results})
    PAGE.mkdir(parents=True, exist_ok=True)
    for name, figure in pictures.items():
        figure.savefig(PAGE / f"{name}.png", facecolor="white")
    results = json.loads(json.dumps(results))
    sections = [text(title, name, module, results[name]) for name, (module, title) in CHARTS.items()]
    (PAGE / "index.md").write_text("\n".join([head(about, results["evaluation"]["refused"]), *sections]))


if __name__ == "__main__":
    main()
