"""Chart A: time per state against the error to 50 digits, for inverse dynamics, M and forward dynamics.

The reference is the recursion on mpmath numbers of 50 digits. Every peer that is installed takes part; see
`benchmarks.peers`.
"""

from __future__ import annotations

import statistics
import time
from functools import partial
from typing import Any

import mpmath
import numpy as np

import rne
from benchmarks.cases import QUANTITIES, load, states, title
from benchmarks.measure import many, nanoseconds, per_state, ratio
from benchmarks.pages import table, three
from benchmarks.peers import PEERS, Case, Point
from benchmarks.pictures import OTHER, OURS, PINOCCHIO, label_points, lay_out
from rne.plotting.plots import blank_figure

MARKERS = {"float32": "s", "float64": "o", "longdouble": "^"}
TIMES = 200  # calls of one state in a repeat
DISAGREES = 1e-3  # a larger error is not rounding, not even float32's
KERNEL, PINOCCHIO_BATCH = "kernel, batch", "Pinocchio, batch"


def exact(function: Any, model: rne.Model, arrays: list[np.ndarray]) -> np.ndarray:
    """The result on 50 digits."""
    with mpmath.workdps(50):
        number = np.vectorize(mpmath.mpf, otypes=[object])
        result: np.ndarray = function(model, *(number(a) for a in arrays))
        return result


def errors(got: np.ndarray, reference: np.ndarray) -> list[float]:
    """Of each state, relative to its largest entry."""
    with mpmath.workdps(50):
        found = []
        for a, b in zip(got.reshape(len(got), -1), reference.reshape(len(reference), -1), strict=True):
            pairs = zip((_number(x) for x in a), b, strict=True)
            found.append(float(max(abs(x - y) for x, y in pairs) / max(abs(y) for y in b)))
    return found


def _number(x: Any) -> Any:
    if isinstance(x, np.longdouble):  # mpmath takes doubles: two of them hold a long double
        high = float(x)
        return mpmath.mpf(high) + mpmath.mpf(float(x - np.longdouble(high)))
    return mpmath.mpf(float(x))


def compare(robot: rne.Robot, quantity: str, sizes: dict[str, int], refused: dict[str, str]) -> dict[str, Any]:
    """Time per state and error of each call.

    `sizes` are the numbers of states of a batch, of the recursion's batch, and of states compared with 50 digits.
    """
    function, arity = QUANTITIES[quantity]
    everything = states(robot.n, sizes["batch"])
    case = Case(robot, quantity, robot.kernel(function), everything)
    reference = exact(function, robot.model, [a[: sizes["exact"]] for a in everything[:arity]])
    found: dict[str, list[float]] = {}
    points = []
    for point in ours(case, sizes["recursion"]) + theirs(case, refused):
        error = errors(np.asarray(point.results(len(reference))), reference)
        if max(error) < DISAGREES:
            found[point.name] = error
            points.append(point)
        else:
            refused[f"{point.name} ({title(quantity)})"] = f"its error is {max(error):.0e} of the result"
    each = per_state({point.name: (point.call, point.count) for point in points}, sizes["repeats"])
    return {point.name: row(point, found[point.name], each) for point in points}


def row(point: Point, error: list[float], each: dict[str, list[float]]) -> dict[str, Any]:
    """The figures of one call."""
    against = PINOCCHIO_BATCH if "batch" in point.name and PINOCCHIO_BATCH in each else "Pinocchio, one state"
    return {
        "precision": point.precision,
        "ns_per_state": nanoseconds(each[point.name]),
        "states": point.count,
        "worst_error": max(error),
        "median_error": statistics.median(error),
        "against": against,
        "times_faster": ratio(each, against, point.name),
        "kernel_faster": ratio(each, point.name, KERNEL),
        "build_s": point.build_s,
    }


def ours(case: Case, few: int) -> list[Point]:
    """The kernel on a batch and on one state, and the recursion it was traced from."""
    kernel, arrays, model, function = case.kernel, case.arrays, case.robot.model, case.kernel.function
    arrays32 = [a.astype(np.float32) for a in arrays]
    out, out32 = kernel(*arrays), kernel(*arrays32)
    one = [a[0].copy() for a in arrays]
    start = time.perf_counter()
    rne.compile(function, model)(*(a[:2] for a in arrays))
    build_s = time.perf_counter() - start
    found = [
        Point(KERNEL, lambda: kernel(*arrays, out=out), len(out), lambda k: out[:k], build_s=build_s),
        Point("kernel, batch, float32", lambda: kernel(*arrays32, out=out32), len(out), lambda k: out32[:k], "float32"),
        Point(
            "kernel, one state",
            many(lambda: kernel(*one), TIMES),
            TIMES,
            lambda k: np.array([kernel(*(a[i].copy() for a in arrays)) for i in range(k)]),
        ),
    ]
    for dtype in MARKERS:
        typed = [a[:few].astype(dtype) for a in arrays]
        name = "recursion" if dtype == "float64" else f"recursion, {dtype}"
        call = partial(function, model, *typed)
        found.append(Point(name, call, len(typed[0]), lambda k, call=call: call()[:k], dtype))
    return found


def theirs(case: Case, refused: dict[str, str]) -> list[Point]:
    """The calls of the peers that are installed and take the robot; `refused` gets the reasons of the others."""
    found: list[Point] = []
    for name, peer in PEERS.items():
        if peer.missing():
            continue
        try:
            found += peer.points(case)
        except ValueError as error:
            refused[name] = str(error)
    return found


def run(quick: bool) -> dict[str, Any]:
    """All calls, by robot and quantity."""
    sizes = {"batch": 20_000, "recursion": 1000, "exact": 20, "repeats": 15}
    if quick:
        sizes = {"batch": 200, "recursion": 20, "exact": 2, "repeats": 1}
    found = {name: load(name) for name in (("irb140",) if quick else ("irb140", "ur5"))}
    refused: dict[str, dict[str, str]] = {name: {} for name in found}
    rows = {name: {q: compare(robot, q, sizes, refused[name]) for q in QUANTITIES} for name, robot in found.items()}
    return {"sizes": sizes, "robots": rows, "refused": refused}


def color(name: str) -> str:
    """By project."""
    return PINOCCHIO if name.startswith("Pinocchio") else OURS if name.startswith(("kernel", "recursion")) else OTHER


def picture(results: dict[str, Any]) -> Any:
    """Log-log, a panel for each robot and quantity."""
    found = results["robots"]
    figure = blank_figure(17, 6.25 * len(found))
    grid = figure.subplots(len(found), 3, sharex=True, sharey=True, squeeze=False)
    figure.suptitle("Speed and accuracy of an evaluation: lower left is better (log scales)")
    times = [r["ns_per_state"] for quantities in found.values() for rows in quantities.values() for r in rows.values()]
    left, right = min(25.0, min(times) / 8), max(1e5, 3 * max(times))
    panels = [
        (ax, f"{robot}: {title(quantity)}", rows)
        for axes, (robot, quantities) in zip(grid, found.items(), strict=True)
        for ax, (quantity, rows) in zip(axes, quantities.items(), strict=True)
    ]
    for ax, name, rows in panels:
        ax.set(xscale="log", yscale="log", xlim=(left, right), ylim=(3e-21, 1e-5))
        ax.set_title(name, fontsize="medium")
        panel(ax, rows, left)
    for ax in grid[:, 0]:
        ax.set_ylabel("worst error of the states, relative to largest entry [1]")
    for ax in grid[-1]:
        ax.set_xlabel("time per state [ns]")
    lay_out(figure)
    for ax, _, rows in panels:
        label_points(ax, [(r["ns_per_state"], r["worst_error"], n, color(n)) for n, r in rows.items()])
    return figure


def panel(ax: Any, rows: dict[str, Any], left: float) -> None:
    """A point for each call, and a line at the eps of each precision."""
    ax.grid(True, alpha=0.25)
    for dtype, marker in MARKERS.items():
        eps = float(np.finfo(dtype).eps)
        ax.axhline(eps, color="0.6", linestyle=":", linewidth=0.9)
        ax.text(1.1 * left, eps / 1.35, f"eps of {dtype}", fontsize=7, color="0.45", va="top")
        for name, row in rows.items():
            if row["precision"] == dtype:
                ax.plot(row["ns_per_state"], row["worst_error"], marker, color=color(name), markersize=6)


def tables(results: dict[str, Any]) -> dict[str, str]:
    """The kernel's batch beside each other package, and all calls."""
    return {"kernel-beside-peers": beside_peers(results), "evaluation": every_call(results)}


def beside_peers(results: dict[str, Any]) -> str:
    """How many times faster the kernel's batch is, and the errors of both where both run."""
    columns = {
        f"{robot}, {title(quantity)}": rows
        for robot, quantities in results["robots"].items()
        for quantity, rows in quantities.items()
    }
    names = list(dict.fromkeys(name for rows in columns.values() for name in rows))
    lines = []
    for name in (KERNEL, *(n for n in names if color(n) != OURS)):
        there = [rows for rows in columns.values() if name in rows]
        times = [three(rows[name]["kernel_faster"]) if name in rows else "-" for rows in columns.values()]
        worst = [max(rows[who]["worst_error"] for rows in there) for who in (name, KERNEL)]
        built = [rows[name]["build_s"] for rows in there if rows[name]["build_s"] is not None]
        span = f"{min(built):.2f} to {max(built):.2f}" if built else "-"
        lines.append([name, *times, *(f"{error:.1e}" for error in worst), span])
    head = ["times the kernel's batch is faster than", *columns, "worst error", "the kernel's", "time to build [s]"]
    return table(head, lines)


def every_call(results: dict[str, Any]) -> str:
    """All points."""
    head = ["robot", "quantity", "call", "ns per state", "error, worst", "median", "times Pinocchio's speed", "of its"]
    rows = [
        [
            robot,
            title(quantity),
            name,
            f"{row['ns_per_state']:.0f}",
            f"{row['worst_error']:.1e}",
            f"{row['median_error']:.1e}",
            three(row["times_faster"]),
            row["against"].removeprefix("Pinocchio, "),
        ]
        for robot, quantities in results["robots"].items()
        for quantity, calls in quantities.items()
        for name, row in calls.items()
    ]
    return table(head, rows)
