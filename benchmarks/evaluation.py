"""Chart A: time a state against error to 50 digits, for inverse dynamics, M and forward dynamics.

The reference is the recursion on mpmath numbers of 50 digits; that it is right and not only consistent is
Pinocchio's to say, whose points would lie high otherwise. All states are representable in float32, and Pinocchio
computes with our very placements and inertias: nobody is charged for another's rounding of the inputs. Pinocchio's
batch call of forward dynamics works in the world's frame, its single call in the links': hence their different errors.

Every other package is asked for what it does fastest from Python on one thread. MuJoCo reads the URDF and turns
inertias to their principal axes, which its error contains; it is called once a state, its call for many (`rollout`)
being of whole time steps, and its forward dynamics computes more than the accelerations. CasADi runs our kernel's own
source, the same operations in the same order, mapped over all states on NumPy's own memory: in its virtual machine
(VM), and as the C that it writes, compiled by `cc -O3 -march=native`. What it is compared in is thus how the
operations are run and not which. The Robotics Toolbox gets modified Denavit-Hartenberg frames and our masses and
inertias turned into them, because its DH robots have their recursion in C; M and forward dynamics are its own Python
loops around that recursion. adam reads the URDF; M and the bias force are its own, from which inverse and forward
dynamics are put together, since it has them for a fixed base in no other form: on batches in NumPy, and its CasADi
expressions in C like the kernel's, with CasADi's LDL for the forward dynamics; its JAX and PyTorch are not timed.
"Kernel, refined once" adds a pass of iterative refinement, whose residual is the recursion's in long double: the price
of the digits that it wins where M is ill-conditioned, see [Where methods fail](../stability.md), which these states are
not. Calls that take long are timed on fewer states: 2000 for single calls, 1000 for adam's NumPy, 200 for the toolbox's
loops. A batch call of the kernel has a fixed cost, which compiled calls have not: chart C shows what it does to small
batches.
"""

from __future__ import annotations

import statistics
import time
from functools import partial
from typing import Any

import mpmath
import numpy as np

import rne
from benchmarks.kernels import QUANTITIES, robots
from benchmarks.measure import interleaved, many, ratio
from benchmarks.peers import PEERS, Case, Pinocchio, Point, left_out
from benchmarks.pictures import OTHER, OURS, PINOCCHIO, label_points, lay_out, table, three
from rne.plotting.plots import blank_figure

RATES = (np.pi, 10.0, 50.0)  # largest angles [rad], rates [rad/s], accelerations [rad/s²] or torques [N m]
MARKERS = {"float32": "s", "float64": "o", "longdouble": "^"}
TIMES = 200  # calls of one state in a repeat
DISAGREES = 1e-3  # an error that is no rounding, not even float32's
LEVEL = 0.1  # times that differ by less are not told apart
KERNEL = "kernel, batch"


def states(n: int, count: int, seed: int = 0) -> list[np.ndarray]:
    """Random states that float32 holds exactly."""
    rng = np.random.default_rng(seed)
    return [rng.uniform(-x, x, (count, n)).astype(np.float32).astype(float) for x in RATES]


def exact(function: Any, model: rne.Model, arrays: list[np.ndarray]) -> np.ndarray:
    """On 50 digits."""
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


def compare(
    robot: rne.Robot, xml: str, quantity: str, sizes: dict[str, int], refused: dict[str, str]
) -> dict[str, Any]:
    """Each call's time a state and its error; sizes: states of a batch, of the recursion's batch, exact ones."""
    function, arity = QUANTITIES[quantity]
    everything = states(robot.n, sizes["batch"])
    case = Case(robot, quantity, robot.kernel(function), everything)
    reference = exact(function, robot.model, [a[: sizes["exact"]] for a in everything[:arity]])
    points = ours(case, sizes["recursion"]) + pinocchio(Pinocchio(robot.model, xml, everything), quantity)
    points += others(case, refused)
    found: dict[str, list[float]] = {}
    for point in points:
        error = errors(np.asarray(point.results(len(reference))), reference)
        if max(error) < DISAGREES:
            found[point.name] = error
        else:
            refused[f"{point.name} ({quantity.replace('_', ' ')})"] = f"it is off by {max(error):.0e} of the result"
    points = [point for point in points if point.name in found]
    seconds = interleaved({point.name: point.call for point in points}, sizes["repeats"])
    each = {point.name: [s / point.count for s in seconds[point.name]] for point in points}
    return {point.name: row(point, found[point.name], each) for point in points}


def row(point: Point, error: list[float], each: dict[str, list[float]]) -> dict[str, Any]:
    """Of a call's figures."""
    has_batch = "Pinocchio, batch" in each
    against = "Pinocchio, batch" if "batch" in point.name and has_batch else "Pinocchio, one state"
    return {
        "precision": point.precision,
        "ns_a_state": statistics.median(each[point.name]) * 1e9,
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
    if case.quantity == "forward_dynamics":
        short = [a[:few] for a in arrays]
        refined = partial(case.robot.forward_dynamics, *short, refine=1)
        found.append(Point("kernel, refined once", refined, few, lambda k: refined()[:k]))
    for dtype in MARKERS:
        typed = [a[:few].astype(dtype) for a in arrays]
        name = "recursion" if dtype == "float64" else f"recursion, {dtype}"
        call = partial(function, model, *typed)
        found.append(Point(name, call, len(typed[0]), lambda k, call=call: call()[:k], dtype))
    return found


def pinocchio(peer: Pinocchio, quantity: str) -> list[Point]:
    """Its call for one state, and for many where it has one."""
    call, count = peer.loop(quantity)
    found = [Point("Pinocchio, one state", call, count, lambda k: peer.results(quantity, k))]
    batch = peer.batch(quantity)
    if batch is not None:

        def results(k: int) -> np.ndarray:
            batch()
            return peer.ours(peer.out[:, :k])

        found.append(Point("Pinocchio, batch", batch, peer.count, results))
    return found


def others(case: Case, refused: dict[str, str]) -> list[Point]:
    """Of the packages that are there and take the robot."""
    found: list[Point] = []
    for name, points in PEERS.items():
        if name in left_out():
            continue
        try:
            found += points(case)
        except ValueError as error:
            refused[name] = "it refuses the robot: " + str(error).splitlines()[0].removeprefix("Error: ")
    return found


def run(quick: bool) -> dict[str, Any]:
    """All calls, by robot and quantity."""
    sizes = {"batch": 20_000, "recursion": 1000, "exact": 20, "repeats": 15}
    if quick:
        sizes = {"batch": 200, "recursion": 20, "exact": 2, "repeats": 1}
    found = {name: r for name, r in robots().items() if name in ("irb140", "ur5")}
    refused: dict[str, dict[str, str]] = {name: {} for name in found}
    rows = {name: {q: compare(*robot, q, sizes, refused[name]) for q in QUANTITIES} for name, robot in found.items()}
    return {"sizes": sizes, "robots": rows, "refused": refused}


def color(name: str) -> str:
    """By project."""
    return PINOCCHIO if name.startswith("Pinocchio") else OURS if name.startswith(("kernel", "recursion")) else OTHER


def picture(results: dict[str, Any]) -> Any:
    """Log-log, a panel for each robot and quantity."""
    found = results["robots"]
    figure = blank_figure(17, 12.5)
    grid = np.atleast_2d(figure.subplots(len(found), 3, sharex=True, sharey=True))
    figure.suptitle("What an evaluation costs and what it is worth: lower left is better (log scales)")
    times = [r["ns_a_state"] for quantities in found.values() for rows in quantities.values() for r in rows.values()]
    left, right = min(25.0, min(times) / 8), max(1e5, 3 * max(times))
    for axes, (robot, quantities) in zip(grid, found.items(), strict=True):
        for ax, (quantity, rows) in zip(axes, quantities.items(), strict=True):
            ax.set(xscale="log", yscale="log", xlim=(left, right), ylim=(3e-21, 1e-5))
            ax.set_title(f"{robot}: {quantity.replace('_', ' ')}", fontsize="medium")
            ax.grid(True, alpha=0.25)
            for dtype, marker in MARKERS.items():
                eps = float(np.finfo(dtype).eps)
                ax.axhline(eps, color="0.6", linestyle=":", linewidth=0.9)
                ax.text(1.1 * left, eps / 1.35, f"eps of {dtype}", fontsize=7, color="0.45", va="top")
                for name, row in rows.items():
                    if row["precision"] == dtype:
                        ax.plot(row["ns_a_state"], row["worst_error"], marker, color=color(name), markersize=6)
    for ax in grid[:, 0]:
        ax.set_ylabel("worst error of the states, relative to largest entry [1]")
    for ax in grid[-1]:
        ax.set_xlabel("time a state [ns]")
    lay_out(figure)
    for axes, quantities in zip(grid, found.values(), strict=True):
        for ax, rows in zip(axes, quantities.values(), strict=True):
            label_points(ax, [(r["ns_a_state"], r["worst_error"], n, color(n)) for n, r in rows.items()])
    return figure


def conclusion(results: dict[str, Any]) -> str:
    """How many times faster the kernel's batch is than each other package, and which of them are faster than it."""
    columns = {
        f"{robot}, {quantity.replace('_', ' ')}": rows
        for robot, quantities in results["robots"].items()
        for quantity, rows in quantities.items()
    }
    names = list(dict.fromkeys(name for rows in columns.values() for name in rows if color(name) != OURS))
    cells, ahead, lines = [], [], []
    for name in names:
        there = {where: rows for where, rows in columns.items() if name in rows}
        times = {where: rows[name]["kernel_faster"] for where, rows in there.items()}
        worst = [max(rows[who]["worst_error"] for rows in there.values()) for who in (name, KERNEL)]
        shown = [three(times[where]) if where in times else "-" for where in columns]
        cells.append([name, *shown, f"{worst[0]:.1e}, {worst[1]:.1e}"])
        medians = [spread[0] for spread in times.values()]
        if min(medians) > 1 + LEVEL:
            ahead.append(f"{name} ({min(medians):.1f} to {max(medians):.1f} times)")
        else:
            lines.append(f"- {name}, beside the kernel's batch: {standing(times)}.")
    if ahead:
        lines.insert(0, f"- The kernel's batch is faster, wherever both run, than {'; '.join(ahead)}.")
    lines.insert(0, f"Batches are of {results['sizes']['batch']} states:\n")
    head = ["times the kernel's batch is faster than", *columns, "worst error, the kernel's there"]
    return "\n".join([*lines, building(columns), "", table(head, cells)])


def standing(times: dict[str, tuple[float, float, float]]) -> str:
    """Where a package is faster than the kernel's batch, where level with it and where slower."""
    level = f"level within {LEVEL:.0%}"
    groups: dict[str, list[str]] = {"faster": [], level: [], "slower": []}
    for where, (median, _, _) in times.items():
        group = "faster" if median < 1 - LEVEL else "slower" if median > 1 + LEVEL else level
        by = f" ({max(median, 1 / median):.2f} times)" if group != level else ""
        groups[group].append(where.replace(",", "") + by)
    return "; ".join(f"{group} on {', '.join(cases)}" for group, cases in groups.items() if cases)


def building(columns: dict[str, Any]) -> str:
    """What it takes to get a call that is built."""
    seconds: dict[str, list[float]] = {}
    for rows in columns.values():
        for name, row in rows.items():
            if row["build_s"] is not None:
                seconds.setdefault(name, []).append(row["build_s"])
    spans = [f"{name} {min(taken):.2f} to {max(taken):.2f}" for name, taken in seconds.items()]
    return f"- Built once before, in seconds: {'; '.join(spans)}."


def tables(results: dict[str, Any]) -> str:
    """All points."""
    head = ["robot", "quantity", "call", "ns a state", "error, worst", "median", "times Pinocchio's speed", "of its"]
    rows = [
        [
            robot,
            quantity.replace("_", " "),
            name,
            f"{row['ns_a_state']:.0f}",
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
