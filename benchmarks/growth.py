"""Chart C: growth with the number of joints and with the number of states, Pinocchio's beside ours.

Two families of n-joint arms. In a straight chain all axes are parallel, and the tracer drops what is zero by it; in a
crooked chain axes, placements and inertias are random, and nothing can be dropped. Pinocchio computes the same on both.
Errors are the worst of 50 states against long double, relative to the state's largest entry.
"""

from __future__ import annotations

import statistics
import time
from typing import Any

import numpy as np

import rne
from benchmarks.evaluation import states
from benchmarks.kernels import QUANTITIES
from benchmarks.measure import interleaved, many, ratio, repeats_within
from benchmarks.peers import Pinocchio
from benchmarks.pictures import OURS, PINOCCHIO, table, three
from rne.model.robots.generators import random_tree, straight_chain
from rne.plotting.plots import blank_figure

BATCH = 2000
LENGTHS = (2, 3, 4, 6, 9, 12, 16, 24, 32, 48, 64, 100)
LONGEST = {  # joints beyond which a quantity is left out: it is not written out, or compiles for long
    ("straight", "mass_matrix"): 100,
    ("crooked", "mass_matrix"): 32,
    ("crooked", "forward_dynamics"): 48,
}
SECONDS = 0.8  # for the repeats of one comparison
EXACT = 50  # states whose error is taken, against long double
STATES = (1, 3, 10, 30, 100, 300, 1000, 3000, 10_000, 100_000, 1_000_000)
LINES = {"straight": "-", "crooked": "--"}


def chain(family: str, n: int) -> rne.Model:
    """An arm of n turning joints."""
    return straight_chain(n) if family == "straight" else random_tree(n, 1, prismatic=0.0, branching=0.0)


def error(function: Any, model: rne.Model, arrays: list[np.ndarray], got: np.ndarray) -> float:
    """Worst of the first states, relative to the state's largest entry, against the recursion in long double."""
    few = min(EXACT, len(got))
    exact = function(model, *(a[:few].astype(np.longdouble) for a in arrays)).reshape(few, -1)
    return float((np.abs(got[:few].reshape(few, -1) - exact).max(1) / np.abs(exact).max(1)).max())


def of_length(family: str, n: int, count: int, repeats: int) -> dict[str, Any]:
    """All quantities of one arm."""
    robot = rne.Robot(chain(family, n))
    everything = states(n, count)
    theirs = Pinocchio(robot.model, rne.to_urdf(robot.model), everything)
    rows: dict[str, Any] = {}
    for quantity, (_, arity) in QUANTITIES.items():
        if n > LONGEST.get((family, quantity), n):
            continue
        arrays = everything[:arity]
        start = time.perf_counter()
        kernel = robot.kernel(robot.forward_method if quantity == "forward_dynamics" else QUANTITIES[quantity][0])
        out = kernel(*arrays)
        compiled = time.perf_counter() - start
        batch = theirs.batch(quantity)
        call, calls = (batch, count) if batch is not None else theirs.loop(quantity)
        pair: dict[str, Any] = {"ours": lambda k=kernel, a=arrays, o=out: k(*a, out=o), "theirs": call}
        seconds = interleaved(pair, repeats_within(pair, SECONDS) if repeats > 1 else 1)
        each = {"ours": [s / count for s in seconds["ours"]], "theirs": [s / calls for s in seconds["theirs"]]}
        few = min(EXACT, count)
        result = theirs.results(quantity, few) if batch is None else theirs.ours(theirs.out[:, :few])
        rows[quantity] = {
            "operations": sum(kernel.operations.values()) if kernel.is_unrolled else None,
            "method": kernel.function.__name__,
            "compile_s": compiled,
            "ns_a_state": statistics.median(each["ours"]) * 1e9,
            "pinocchio_ns_a_state": statistics.median(each["theirs"]) * 1e9,
            "times_faster": ratio(each, "theirs", "ours"),
            "error": error(kernel.function, robot.model, arrays, out),
            "pinocchio_error": error(kernel.function, robot.model, arrays, result),
        }
    return rows


def of_batches(counts: tuple[int, ...], repeats: int) -> dict[int, Any]:
    """Inverse dynamics of the IRB 140 in batches of each size, and one state a call."""
    robot = rne.load("irb140")
    kernel, xml = robot.kernel(rne.inverse_dynamics), rne.to_urdf(robot.model)
    rows: dict[int, Any] = {}
    for count in counts:
        arrays = states(6, count)
        theirs = Pinocchio(robot.model, xml, arrays)
        out = kernel(*arrays)
        one = [a[0].copy() for a in arrays]
        times = max(1, 3000 // count)
        batch = theirs.batch("inverse_dynamics")
        assert batch is not None
        loop, calls = theirs.loop("inverse_dynamics")
        done = {
            "ours": (many(lambda k=kernel, a=arrays, o=out: k(*a, out=o), times), times * count),
            "theirs": (many(batch, times), times * count),
            "our single call": (many(lambda k=kernel, a=one: k(*a), 300), 300),
            "their single call": (many(loop, -(-300 // calls)), -(-300 // calls) * calls),
        }
        calls_alone = {name: call for name, (call, _) in done.items()}
        seconds = interleaved(calls_alone, repeats_within(calls_alone, 2 * SECONDS) if repeats > 1 else 1)
        each = {name: [s / done[name][1] for s in runs] for name, runs in seconds.items()}
        rows[count] = {f"{name} ns_a_state": statistics.median(runs) * 1e9 for name, runs in each.items()}
        rows[count] |= {
            "times_faster": ratio(each, "theirs", "ours"),
            "single_times_faster": ratio(each, "their single call", "our single call"),
            "error": error(rne.inverse_dynamics, robot.model, arrays, out),
            "pinocchio_error": error(rne.inverse_dynamics, robot.model, arrays, theirs.ours(theirs.out[:, :EXACT])),
        }
    return rows


def run(quick: bool) -> dict[str, Any]:
    """Both growths."""
    count, repeats = (20, 1) if quick else (BATCH, 5)
    lengths = (2, 6) if quick else LENGTHS
    chains = {f: {n: of_length(f, n, count, repeats) for n in lengths} for f in LINES}
    return {
        "batch": count,
        "repeats": "5 to 41, by time" if repeats > 1 else 1,
        "chains": chains,
        "states": of_batches((1, 100) if quick else STATES, 1 if quick else 7),
    }


def picture(results: dict[str, Any]) -> Any:
    """Time a state against n for each quantity, operations and compile time against n, time a state against N."""
    figure = blank_figure(15, 9)
    axes = figure.subplots(2, 3)
    figure.suptitle("Growth with the number of joints n and of states N (log scales)")
    for ax, quantity in zip(axes[0], QUANTITIES, strict=True):
        for family, style in LINES.items():
            rows = {n: r[quantity] for n, r in results["chains"][family].items() if quantity in r}
            for who, key, color in (
                ("rne", "ns_a_state", OURS),
                ("Pinocchio", "pinocchio_ns_a_state", PINOCCHIO),
            ):
                values = [r[key] for r in rows.values()]
                ax.plot(list(rows), values, "." + style, color=color, label=f"{who}, {family} chain")
        calls = "one call a state" if quantity == "mass_matrix" else "batch call"
        ax.set(title=quantity.replace("_", " "), ylabel=f"time a state [ns], batch of {results['batch']}")
        ax.legend(fontsize="small", frameon=False, title=f"Pinocchio: {calls}", title_fontsize="small")
    for ax, key, label in ((axes[1, 0], "operations", "operations a state [1]"), (axes[1, 1], "compile_s", None)):
        for family, style in LINES.items():
            for quantity, color in zip(QUANTITIES, (OURS, "#2f8a4a", "#7d4bb0"), strict=True):
                rows = {n: r[quantity][key] for n, r in results["chains"][family].items() if quantity in r}
                rows = {n: v for n, v in rows.items() if v}
                name = f"{quantity.replace('_', ' ')}, {family}"
                ax.plot(list(rows), list(rows.values()), "." + style, color=color, label=name)
        ax.set_ylabel(label or "time to trace, allocate and run once [s]")
        ax.set_title("rne: operations" if label else "rne: compile time")
        ax.legend(fontsize="small", frameon=False)
    for ax in [*axes[0], *axes[1, :2]]:
        ax.set_xlabel("joints n [1]")
        ax.set(xscale="log", yscale="log")
        ticks = [n for n in (2, 6, 12, 24, 48, 100) if n <= max(results["chains"]["straight"])]
        ax.set_xticks(ticks, [str(n) for n in ticks], minor=False)
        ax.minorticks_off()
    _states(axes[1, 2], results["states"])
    for ax in axes.flat:
        ax.grid(True, alpha=0.25)
    return figure


def _states(ax: Any, rows: dict[int, Any]) -> None:
    for who, key, color, style in (
        ("rne, batch call", "ours", OURS, ".-"),
        ("rne, one call a state", "our single call", OURS, ".:"),
        ("Pinocchio, batch call", "theirs", PINOCCHIO, ".-"),
        ("Pinocchio, one call a state", "their single call", PINOCCHIO, ".:"),
    ):
        ax.plot(list(rows), [r[f"{key} ns_a_state"] for r in rows.values()], style, color=color, label=who)
    ax.set(xscale="log", yscale="log", xlabel="states N [1]", ylabel="time a state [ns]")
    ax.set_title("irb140: inverse dynamics")
    ax.legend(fontsize="small", frameon=False)


def tables(results: dict[str, Any]) -> str:
    """By n, then by N."""
    rows = [
        [
            family,
            quantity.replace("_", " "),
            str(n),
            str(row["operations"] or "not written out"),
            f"{row['compile_s']:.2f}",
            f"{row['ns_a_state']:.0f}",
            f"{row['pinocchio_ns_a_state']:.0f}",
            three(row["times_faster"]),
            f"{row['error']:.1e}",
            f"{row['pinocchio_error']:.1e}",
        ]
        for family, lengths in results["chains"].items()
        for quantity in QUANTITIES
        for n, quantities in lengths.items()
        if quantity in quantities
        for row in [quantities[quantity]]
    ]
    head = ["chain", "quantity", "n", "operations", "compile s", "ns a state", "Pinocchio ns", "times its speed"]
    first = table([*head, "error", "Pinocchio's error"], rows)
    rows = [
        [
            f"{count}",
            f"{r['ours ns_a_state']:.0f}",
            f"{r['theirs ns_a_state']:.0f}",
            three(r["times_faster"]),
            f"{r['our single call ns_a_state']:.0f}",
            f"{r['their single call ns_a_state']:.0f}",
            three(r["single_times_faster"]),
            f"{r['error']:.1e}",
            f"{r['pinocchio_error']:.1e}",
        ]
        for count, r in results["states"].items()
    ]
    head = ["N", "batch ns a state", "Pinocchio ns", "times its speed", "single call ns", "Pinocchio ns"]
    return first + "\n\n" + table([*head, "times its speed", "error of the batch", "Pinocchio's error"], rows)
