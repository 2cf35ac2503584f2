"""Chart A: time a state against error to 50 digits, for inverse dynamics, M and forward dynamics.

The reference is the recursion on mpmath numbers of 50 digits; that it is right and not only consistent is
Pinocchio's to say, whose points would lie high otherwise. All states are representable in float32, and Pinocchio
computes with our very placements and inertias: nobody is charged for another's rounding of the inputs. MuJoCo reads
the URDF itself and turns inertias to their principal axes, which its error contains. CasADi's virtual machine runs our
kernel's own source. Pinocchio's batch call of forward dynamics works in the world's frame, its single call in the
links': hence their different errors.
"""

from __future__ import annotations

import statistics
from typing import Any

import mpmath
import numpy as np

import rne
from benchmarks.kernels import QUANTITIES, robots
from benchmarks.measure import interleaved, many, ratio
from benchmarks.peers import CasADi, MuJoCo, Pinocchio, left_out
from benchmarks.pictures import OTHER, OURS, PINOCCHIO, label_points, lay_out, table, three
from rne.report.plots import blank_figure

RATES = (np.pi, 10.0, 50.0)  # largest angles [rad], rates [rad/s], accelerations [rad/s²] or torques [N m]
MARKERS = {"float32": "s", "float64": "o", "longdouble": "^"}
TIMES = 200  # calls of one state in a repeat


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
    arrays, count, few = everything[:arity], sizes["batch"], sizes["exact"]
    short = [a[: sizes["recursion"]] for a in arrays]
    kernel = robot.kernel(function)
    out, out32 = kernel(*arrays), kernel(*[a.astype(np.float32) for a in arrays])
    arrays32 = [a.astype(np.float32) for a in arrays]
    one = [a[0].copy() for a in arrays]
    theirs = Pinocchio(robot.model, xml, everything)
    calls: dict[str, tuple[Any, int, str]] = {
        "kernel, batch": (lambda: kernel(*arrays, out=out), count, "float64"),
        "kernel, batch, float32": (lambda: kernel(*arrays32, out=out32), count, "float32"),
        "kernel, one state": (many(lambda: kernel(*one), TIMES), TIMES, "float64"),
        "Pinocchio, one state": (*theirs.loop(quantity), "float64"),
    }
    recursions: dict[str, Any] = {}
    for dtype in MARKERS:
        typed = [a.astype(dtype) for a in short]
        name = "recursion" if dtype == "float64" else f"recursion, {dtype}"
        recursions[name] = lambda a=typed: function(robot.model, *a)
        calls[name] = (recursions[name], len(short[0]), dtype)
    batch = theirs.batch(quantity)
    if batch is not None:
        calls["Pinocchio, batch"] = (batch, count, "float64")
    results = {name: np.asarray(call()[:few]) for name, call in recursions.items()}
    results |= {"kernel, batch": out[:few], "kernel, batch, float32": out32[:few]}
    results["kernel, one state"] = np.array([kernel(*(a[k].copy() for a in arrays)) for k in range(few)])
    results["Pinocchio, one state"] = theirs.results(quantity, few)
    if batch is not None:
        batch()
        results["Pinocchio, batch"] = theirs.ours(theirs.out[:, :few])
    if "mujoco" not in left_out():
        try:
            mujoco = MuJoCo(robot.model, everything)
        except ValueError as error:
            refused["MuJoCo"] = str(error).splitlines()[0].removeprefix("Error: ")
        else:
            calls["MuJoCo, one state"] = (*mujoco.loop(quantity), "float64")
            results["MuJoCo, one state"] = mujoco.results(quantity, few)
    if "casadi" not in left_out():
        casadi = CasADi(kernel, arrays)
        calls["CasADi's virtual machine, batch"] = (casadi.batch, count, "float64")
        results["CasADi's virtual machine, batch"] = casadi.results(few)
    seconds = interleaved({name: call for name, (call, _, _) in calls.items()}, sizes["repeats"])
    each = {name: [s / calls[name][1] for s in runs] for name, runs in seconds.items()}
    reference = exact(function, robot.model, [a[:few] for a in arrays])
    rows: dict[str, Any] = {}
    for name, (_, _, dtype) in calls.items():
        error = errors(results[name], reference)
        against = "Pinocchio, batch" if "batch" in name and batch is not None else "Pinocchio, one state"
        rows[name] = {
            "precision": dtype,
            "ns_a_state": statistics.median(each[name]) * 1e9,
            "worst_error": max(error),
            "median_error": statistics.median(error),
            "against": against,
            "times_faster": ratio(each, against, name),
        }
    return rows


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
    return PINOCCHIO if name.startswith("Pinocchio") else OURS if name[0] in "kr" else OTHER


def picture(results: dict[str, Any]) -> Any:
    """Log-log, a panel for each robot and quantity."""
    found = results["robots"]
    figure = blank_figure(17, 11.5)
    grid = np.atleast_2d(figure.subplots(len(found), 3, sharex=True, sharey=True))
    figure.suptitle("What an evaluation costs and what it is worth: lower left is better (log scales)")
    times = [r["ns_a_state"] for quantities in found.values() for rows in quantities.values() for r in rows.values()]
    left, right = min(60.0, min(times) / 2), max(1e5, 2 * max(times))
    for axes, (robot, quantities) in zip(grid, found.items(), strict=True):
        for ax, (quantity, rows) in zip(axes, quantities.items(), strict=True):
            ax.set(xscale="log", yscale="log", xlim=(left, right), ylim=(3e-21, 1e-3))
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


def tables(results: dict[str, Any]) -> str:
    """One table of all points."""
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
