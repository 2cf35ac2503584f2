"""First and second derivatives beside the peers: python -m benchmarks.derivatives [--quick]

Operations of inverse and forward dynamics, of their gradients and Hessians; time per state in batches and error
against 50 digits, of Pinocchio's first derivatives, CasADi's of a hand-written recursion, complex steps and differences
in the same interleaved runs, one thread each; what a new process waits for. Writes benchmarks/results/derivatives.json,
the tables of docs/derivatives.md and of derivatives.md and derivatives-forward.md in docs/benchmarks, and the picture.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from statistics import median
from typing import Any

import mpmath
import numpy as np

import rne
from benchmarks import derivative_calls, derivatives_picture, readme_picture
from benchmarks.cases import engines, states
from benchmarks.derivative_calls import HESSIAN, NAMES
from benchmarks.measure import QUICK_NOTE, is_quick, many, nanoseconds, per_state, ratio, write
from benchmarks.pages import DOCS, rewrite, table, three
from rne.graph.program import evaluate

PAGES = (
    DOCS / "derivatives.md",
    DOCS / "benchmarks" / "derivatives.md",
    DOCS / "benchmarks" / "derivatives-forward.md",
)
ROBOTS = ("irb140", "ur5")
COUNT, REPEATS, EXACT = 1024, 15, 8
QUICK_COUNT, QUICK_REPEATS = 64, 1
TURN = 4  # calls in a turn, of which the first finds the caches cold
FUNCTIONS = {"inverse_dynamics": rne.dynamics.inverse_dynamics, "forward_dynamics": rne.dynamics.forward_dynamics}
PINOCCHIO = "Pinocchio, first derivatives"

Results = dict[str, Any]


def run(quick: bool) -> Results:
    """All figures."""
    count, repeats = (QUICK_COUNT, QUICK_REPEATS) if quick else (COUNT, REPEATS)
    robots = ROBOTS[:1] if quick else ROBOTS
    found: Results = {"states": count, "robots": {}, "operations": {}, "processes": {}}
    for name in robots:
        robot = rne.load(name)
        for title, function in FUNCTIONS.items():
            found["operations"][f"{name} {title}"] = operations(robot, function)
            found["robots"][f"{name} {title}"] = compare(robot, title, count, repeats)
    if "numba" in engines():
        for case in derivative_calls.FIRST[:1] if quick else derivative_calls.FIRST:
            found["processes"][" ".join(case)] = seconds_of(derivative_calls.first_call(*case), 1 if quick else 3)
    return found


def seconds_of(script: str, repeats: int) -> tuple[float, float]:
    """Output of a script in a process with an empty folder of compiled code, and the median of later ones."""
    with tempfile.TemporaryDirectory() as folder:
        environment = os.environ | {"RNE_CACHE": folder}
        command = [sys.executable, "-c", script]
        first, *later = [
            float(subprocess.run(command, env=environment, capture_output=True, text=True, check=True).stdout)
            for _ in range(repeats + 1)
        ]
    return first, median(later)


def operations(robot: rne.Robot, function: Any) -> dict[str, int]:
    """Operations of the function and its derivatives."""
    kernels = {name: make(function, robot.model) for name, make in derivative_calls.MAKERS.items()}
    return {name: sum(kernel.operations.values()) for name, kernel in kernels.items()}


def compare(robot: rne.Robot, title: str, count: int, repeats: int) -> Results:
    """Time per state and error of each call."""
    function, model = FUNCTIONS[title], robot.model
    arrays = [*states(robot.n, count), np.random.default_rng(1).uniform(-1, 1, (count, robot.n))]
    if title == "forward_dynamics":
        arrays[2] = robot.inverse_dynamics(*arrays[:3])
    points = derivative_calls.points(robot, title, arrays)
    truth = {name: exact(make(function, model), arrays) for name, make in derivative_calls.MAKERS.items()}
    truth["hessian of one sum"] = truth.pop("hessian")
    calls = {name: (many(point.call, TURN), TURN * point.count) for name, point in points.items()}
    each = per_state(calls, repeats)
    rows = {}
    for name, point in points.items():
        reference = truth["hessian of one sum" if point.order == HESSIAN else point.order]
        rows[name] = {
            "order": point.order,
            "ns_per_state": nanoseconds(each[name]),
            "worst_error": error(point.results(EXACT), reference),
            "pinocchio_faster": ratio(each, PINOCCHIO, name),
            "value_times": ratio(each, name, f"{name.split(',')[0]}, values") if name.startswith(NAMES) else None,
            "casadi_faster": ratio(each, "CasADi, Hessian", name) if "CasADi, Hessian" in each else None,
        }
    return rows


def exact(kernel: Any, arrays: list[np.ndarray]) -> np.ndarray:
    """The program on 50 digits, for the first states."""
    rows = np.concatenate([a[:EXACT] for a in arrays[: len(kernel.names)]], axis=-1)
    with mpmath.workdps(50):
        numbers = np.vectorize(mpmath.mpf, otypes=[object])(rows)
        found = evaluate(kernel.traced.program, kernel.traced.entries, numbers)
    return found.astype(float).reshape(EXACT, *kernel.traced.shape)


def error(got: np.ndarray, reference: np.ndarray) -> float:
    """Worst of the states, relative to its largest entry."""
    got, reference = (x.reshape(EXACT, -1) for x in (got, reference))
    return float((np.abs(got - reference).max(-1) / np.abs(reference).max(-1)).max())


def tables(results: Results) -> dict[str, str]:
    """Every table of the page, by its name."""
    head = ["robot", "of", *derivative_calls.TITLES.values()]
    lines = []
    for case, counts in results["operations"].items():
        value = counts["values"]
        cells = [f"{count} ({count / value:.1f})" for count in counts.values()]
        robot, function = case.split(" ", 1)
        lines.append([robot, function.replace("_", " "), *cells])
    found = {"operations": table(head, lines)}
    head = ["call", "ns per state", "times the values'", "times Pinocchio's speed", "worst error"]
    for case, rows in results["robots"].items():
        lines = [
            [
                name,
                f"{row['ns_per_state']:.0f}",
                f"{row['value_times'][0]:.1f}" if row["value_times"] else "-",
                three(row["pinocchio_faster"]),
                f"{row['worst_error']:.0e}",
            ]
            for name, row in rows.items()
        ]
        found[case.replace(" ", "-").replace("_", "-")] = table(head, lines)
    rows = results["processes"]
    lines = [[case.replace("_", " "), *(f"{s:.2f}" for s in seconds)] for case, seconds in rows.items()]
    found["processes"] = table(["kernel", "first process [s]", "second process [s]"], lines)
    return found


def main() -> None:
    quick = is_quick(__doc__)
    results = run(quick)
    print("\n\n".join(f"{name}:\n\n{text}" for name, text in tables(results).items()))
    figure = derivatives_picture.picture(results)
    if quick:
        print(QUICK_NOTE)
        return
    write("derivatives.json", results)
    figure.savefig(DOCS / "benchmarks" / "derivatives.png", facecolor="white")
    rewrite(tables(results), *PAGES)
    readme_picture.main()


if __name__ == "__main__":
    main()
