"""Chart A: time per state against the error to 50 digits, for inverse dynamics, M and forward dynamics.

The reference is the recursion on mpmath numbers of 50 digits. Every peer that is installed takes part; see
`benchmarks.peers`. Batches are compared with batches, and calls of one state with calls of one state; a package without
a batch call computes a batch in a loop. The kernel runs by NumPy, and as machine code by Numba where that is installed.
"""

from __future__ import annotations

import statistics
from typing import Any

import mpmath
import numpy as np

import rne
from benchmarks import batch_sizes
from benchmarks.cases import QUANTITIES, compiled_by_numba, engines_left_out, load, states, title
from benchmarks.evaluation_calls import KERNEL, KERNEL_SINGLE, NUMBA, NUMBA_SINGLE, OWN, by_numba, ours
from benchmarks.measure import nanoseconds, per_state, ratio
from benchmarks.pages import table, three
from benchmarks.peers import PEERS, Case, Point

DISAGREES = 1e-3  # a larger error is not rounding, not even float32's
PINOCCHIO_BATCH, PINOCCHIO_SINGLE = "Pinocchio, batch", "Pinocchio, one state"


def exact(function: Any, model: rne.Model, arrays: list[np.ndarray]) -> np.ndarray:
    """The result on 50 digits."""
    with mpmath.workdps(50):
        number = np.vectorize(mpmath.mpf, otypes=[object])
        result: np.ndarray = function(model, *(number(a) for a in arrays))
        return result


def errors(got: np.ndarray, reference: np.ndarray) -> list[float]:
    """Errors of each state, relative to its largest entry."""
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


def compare(robot: rne.Robot, quantity: str, sizes: dict[str, Any], refused: dict[str, str]) -> dict[str, Any]:
    """Time per state and error of each call.

    `sizes` are the numbers of states of a batch, of the recursion's batch, and of states compared with 50 digits, the
    repeats, and the quantities that Numba compiles.
    """
    function, arity = QUANTITIES[quantity]
    everything = states(robot.n, sizes["batch"])
    case = Case(robot, quantity, robot.kernel(function), everything)
    reference = exact(function, robot.model, [a[: sizes["exact"]] for a in everything[:arity]])
    found: dict[str, list[float]] = {}
    points = []
    own = ours(case, sizes["recursion"]) + (by_numba(case) if quantity in sizes["numba"] else [])
    for point in own + theirs(case, refused):
        error = errors(np.asarray(point.results(len(reference))), reference)
        if max(error) < DISAGREES:
            found[point.name] = error
            points.append(point)
        else:
            refused[f"{point.name} ({title(quantity)})"] = f"its error is {max(error):.0e} of the result"
    each = per_state({point.name: (point.call, point.count) for point in points}, sizes["repeats"])
    return {point.name: row(point, found[point.name], each) for point in points}


def is_batch(name: str) -> bool:
    """True for a call that takes many states."""
    return "batch" in name


def row(point: Point, error: list[float], each: dict[str, list[float]]) -> dict[str, Any]:
    """The figures of one call."""
    batch = is_batch(point.name)
    against = PINOCCHIO_BATCH if batch and PINOCCHIO_BATCH in each else PINOCCHIO_SINGLE
    return {
        "precision": point.precision,
        "ns_per_state": nanoseconds(each[point.name]),
        "batch": point.count if batch else 1,
        "states": point.count,
        "worst_error": max(error),
        "median_error": statistics.median(error),
        "against": "batch" if against == PINOCCHIO_BATCH else "loop" if batch else "one state",
        "times_faster": ratio(each, against, point.name),
        "kernel_faster": ratio(each, point.name, KERNEL if batch else KERNEL_SINGLE),
        "kernel_batch_faster": ratio(each, point.name, KERNEL),
        **({} if NUMBA not in each else numba_faster(point.name, each)),
        "build_s": point.build_s,
    }


def numba_faster(name: str, each: dict[str, list[float]]) -> dict[str, Any]:
    """Ratio of another call's time to that of Numba's kernel."""
    return {
        "numba_faster": ratio(each, name, NUMBA if is_batch(name) else NUMBA_SINGLE),
        "numba_batch_faster": ratio(each, name, NUMBA),
    }


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
    sizes: dict[str, Any] = {"batch": 20_000, "recursion": 1000, "exact": 20, "repeats": 15}
    if quick:
        sizes = {"batch": 200, "recursion": 20, "exact": 2, "repeats": 1}
    sizes["numba"] = compiled_by_numba(quick)
    found = {name: load(name) for name in (("irb140",) if quick else ("irb140", "ur5"))}
    refused: dict[str, dict[str, str]] = {name: {} for name in found}
    rows = {name: {q: compare(robot, q, sizes, refused[name]) for q in QUANTITIES} for name, robot in found.items()}
    sizes_of_batches = batch_sizes.run(quick, sizes["numba"])
    return {"sizes": sizes, "robots": rows, "refused": refused, "batch_sizes": sizes_of_batches}


def tables(results: dict[str, Any]) -> dict[str, str]:
    """The kernel by each engine beside other packages, all calls, and the sizes of batches."""
    columns = {
        f"{robot}, {title(quantity)}": rows
        for robot, quantities in results["robots"].items()
        for quantity, rows in quantities.items()
    }
    return {
        "kernel-beside-peers": beside_peers(columns, "kernel", (KERNEL, KERNEL_SINGLE)),
        "numba-beside-peers": numba_beside_peers(columns),
        "evaluation": every_call(results),
        "batch-sizes": batch_sizes.by_size(results["batch_sizes"]),
    }


def numba_beside_peers(columns: dict[str, Any]) -> str:
    """Speed of machine code relative to the others, NumPy's kernel included; or the reason why there is none."""
    compiled = {title: rows for title, rows in columns.items() if NUMBA in rows}
    if not compiled:
        return "\n".join(f"{name} is left out: {reason}." for name, reason in engines_left_out().items())
    return beside_peers(compiled, "numba", (NUMBA, NUMBA_SINGLE), (KERNEL, KERNEL_SINGLE))


def beside_peers(columns: dict[str, Any], who: str, own: tuple[str, str], further: tuple[str, ...] = ()) -> str:
    """Speed of the kernel of one engine relative to the others, and the errors of both where both run.

    `who` begins the names of its ratios, `own` are its calls of a batch and of one state, and `further` calls of this
    package stand beside them.
    """
    names = list(dict.fromkeys(name for rows in columns.values() for name in rows))
    peers = [name for name in names if name in further or not name.startswith(OWN)]
    batches, singles = [n for n in peers if is_batch(n)], [n for n in peers if not is_batch(n)]
    batch, single = own
    lines = [_beside(columns, name, batch, f"{who}_faster", name) for name in (batch, *batches)]
    for name in singles:  # a batch in a loop, where the package has no batch call
        without = {title: {} if name.replace("one state", "batch") in rows else rows for title, rows in columns.items()}
        if any(without.values()):
            label = name.replace("one state", "a batch in a loop")
            lines.append(_beside(without, name, batch, f"{who}_batch_faster", label))
    lines += [_beside(columns, name, single, f"{who}_faster", name) for name in singles]
    kernel = "kernel" if who == "kernel" else "Numba kernel"
    head = [f"times the {kernel} is faster than", *columns, "worst error", f"the {kernel}'s", "time to build [s]"]
    return table(head, lines)


def _beside(columns: dict[str, Any], name: str, kernel: str, key: str, label: str) -> list[str]:
    there = [rows for rows in columns.values() if name in rows]
    times = [three(rows[name][key]) if name in rows else "-" for rows in columns.values()]
    worst = [max(rows[who]["worst_error"] for rows in there) for who in (name, kernel)]
    built = [rows[name]["build_s"] for rows in there if rows[name]["build_s"] is not None]
    span = f"{min(built):.2f} to {max(built):.2f}" if built else "-"
    return [label, *times, *(f"{error:.1e}" for error in worst), span]


def every_call(results: dict[str, Any]) -> str:
    """All points."""
    head = ["robot", "quantity", "call", "states per call", "ns per state", "error, worst", "median"]
    rows = [
        [
            robot,
            title(quantity),
            name,
            str(row["batch"]),
            f"{row['ns_per_state']:.0f}",
            f"{row['worst_error']:.1e}",
            f"{row['median_error']:.1e}",
            three(row["times_faster"]),
            row["against"],
        ]
        for robot, quantities in results["robots"].items()
        for quantity, calls in quantities.items()
        for name, row in calls.items()
    ]
    return table([*head, "times Pinocchio's speed", "of its"], rows)
