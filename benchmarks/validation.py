"""The README's validation table: python -m benchmarks.validation [--quick]

Worst differences from Pinocchio over random states, for the IRB 140, UR5, Panda and every loadable robot of
example-robot-data.
"""

from __future__ import annotations

import argparse
import importlib.metadata
import json
import platform
from pathlib import Path

import numpy as np

import rne
from rne.analysis.validation import against_pinocchio

OUT = Path(__file__).parent / "results"


def data_robots() -> dict[str, Path]:
    """URDF files of example-robot-data, by short name."""
    files = importlib.metadata.files("example-robot-data") or []
    return {
        f"{f.parts[f.parts.index('robots') + 1]}/{f.stem}": Path(str(f.locate())) for f in files if f.suffix == ".urdf"
    }


def compare(robot: rne.Robot, samples: int, xml: str | None = None) -> dict[str, float]:
    """Worst relative difference by quantity; forward dynamics is left out where M is singular."""
    worst: dict[str, float] = {}
    try:
        for row in against_pinocchio(robot, samples, xml):
            worst[row.quantity] = row.worst
    except rne.SingularMassMatrixError:
        worst["singular"] = 1.0
    return worst


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="few states")
    samples = 20 if parser.parse_args().quick else 1000
    named = data_robots()
    results = {"irb140": compare(rne.load("irb140"), samples)}
    for name in ("ur_description/ur5_robot", "panda_description/panda"):
        results[name] = compare(rne.load(named[name]), samples, named[name].read_text())
    others: dict[str, dict[str, float]] = {}
    for name, path in sorted(named.items()):
        try:
            robot = rne.load(path)
        except rne.UrdfError:
            continue
        if robot.n:
            others[name] = compare(robot, max(samples // 50, 5), path.read_text())
    quantities = ["inverse dynamics", "mass matrix", "gravity", "bias"]
    key = f"worst of {len(others)} data robots"
    results[key] = {k: max(o[k] for o in others.values()) for k in quantities}
    print("| robot | " + " | ".join(quantities) + " | forward after inverse |")
    print("|---|" + "---|" * (len(quantities) + 1))
    for name, worst in results.items():
        cells = [f"{worst[k]:.1e}" if k in worst else "-" for k in [*quantities, "forward after inverse"]]
        print(f"| {name} | " + " | ".join(cells) + " |")
    singular = sorted(name for name, worst in others.items() if "singular" in worst)
    print(f"\nM is singular, and forward dynamics says so, on: {', '.join(singular) or 'none'}")
    versions = {"python": platform.python_version(), "numpy": np.__version__}
    versions |= {p: importlib.metadata.version(p) for p in ("pin", "example-robot-data")}
    OUT.mkdir(exist_ok=True)
    text = json.dumps({"samples": samples, "versions": versions, "worst": results, "robots": others}, indent=1)
    if not parser.parse_args().quick:
        (OUT / "validation.json").write_text(text + "\n")


if __name__ == "__main__":
    main()
