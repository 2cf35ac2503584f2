"""Time per state against the size of a batch: the recursion, its kernel, and Pinocchio, on the IRB 140."""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np

import rne
from benchmarks.cases import QUANTITIES, load, states, title
from benchmarks.measure import many, nanoseconds, per_state, ratio, repeats_within
from benchmarks.pages import table, three
from benchmarks.peers.pinocchio import BATCH, Pinocchio
from benchmarks.pictures import OURS, PINOCCHIO

SIZES = (1, 10, 100, 1000, 10_000, 100_000)
LEAST = 300  # states in a run of short calls
SECONDS = 1.0  # for the repeats of one comparison
EXACT = 50  # states whose error is taken, against long double
LINES = {  # calls by their name: how the picture shows them
    "recursion": ("rne, recursion", OURS, "s--"),
    "kernel": ("rne, kernel", OURS, "o-"),
    "kernel, one state": ("rne, kernel, one state per call", OURS, ":"),
    "Pinocchio": ("Pinocchio, batch call", PINOCCHIO, "o-"),
    "Pinocchio, one state": ("Pinocchio, one state per call in a loop", PINOCCHIO, ":"),
}


def error(function: Any, model: rne.Model, arrays: list[np.ndarray], got: np.ndarray) -> float:
    """Worst of the first states, relative to the state's largest entry, against the recursion in long double."""
    few = min(EXACT, len(got))
    exact = function(model, *(a[:few].astype(np.longdouble) for a in arrays)).reshape(few, -1)
    return float((np.abs(got[:few].reshape(few, -1) - exact).max(1) / np.abs(exact).max(1)).max())


def of_size(robot: rne.Robot, quantity: str, count: int, repeats: int | None) -> dict[str, Any]:
    """Times per state and errors of one quantity in batches of one size; `repeats` are as many as the time allows."""
    function, arity = QUANTITIES[quantity]
    kernel, everything = robot.kernel(function), states(robot.n, count)
    arrays = everything[:arity]
    theirs = Pinocchio(robot.model, everything)
    out, one = kernel(*arrays), [a[0].copy() for a in arrays]
    recursion = partial(function, robot.model, *arrays)
    times = max(1, LEAST // count)
    loop, looped = theirs.loop(quantity)
    calls = {
        "recursion": (many(recursion, times), times * count),
        "kernel": (many(lambda: kernel(*arrays, out=out), times), times * count),
        "kernel, one state": (many(lambda: kernel(*one), LEAST), LEAST),
        "Pinocchio, one state": (many(loop, -(-LEAST // looped)), -(-LEAST // looped) * looped),
    }
    if quantity in BATCH:
        calls["Pinocchio"] = (many(theirs.fastest(quantity)[0], times), times * count)
    each = per_state(calls, repeats or repeats_within([call for call, _ in calls.values()], SECONDS))
    against = "Pinocchio" if quantity in BATCH else "Pinocchio, one state"
    return {
        "ns_per_state": {name: nanoseconds(runs) for name, runs in each.items()},
        "recursion_times_faster": ratio(each, against, "recursion"),
        "times_faster": ratio(each, against, "kernel"),
        "single_times_faster": ratio(each, "Pinocchio, one state", "kernel, one state"),
        "recursion_error": error(function, robot.model, arrays, recursion()),
        "error": error(function, robot.model, arrays, out),
        "pinocchio_error": error(function, robot.model, arrays, theirs.results(quantity, min(EXACT, count))),
    }


def run(quick: bool) -> dict[str, Any]:
    """All sizes of all quantities."""
    robot = load("irb140")
    sizes, repeats = ((1, 100), 1) if quick else (SIZES, None)
    return {q: {count: of_size(robot, q, count, repeats) for count in sizes} for q in QUANTITIES}


def panels(axes: Any, results: dict[str, Any]) -> None:
    """One for each quantity."""
    for ax, (quantity, rows) in zip(axes, results.items(), strict=True):
        for name, (label, color, style) in LINES.items():
            values = {count: row["ns_per_state"].get(name) for count, row in rows.items()}
            if all(values.values()):
                ax.plot(list(values), list(values.values()), style, color=color, label=label, markersize=5)
        ax.set(xscale="log", yscale="log", xlabel="states in the batch [1]", ylim=(60, 2e6))
        ax.set_title(f"irb140: {title(quantity)}, by the size of the batch", fontsize="medium")
        ax.grid(True, alpha=0.25)
        ax.legend(fontsize="small", frameon=False, loc="upper right")
    axes[0].set_ylabel("time per state [ns]")


def by_size(results: dict[str, Any]) -> str:
    """A row for each quantity and size."""
    rows = []
    for quantity, sizes in results.items():
        for count, row in sizes.items():
            ns = {name: f"{value:.0f}" for name, value in row["ns_per_state"].items()}
            batch = [ns["recursion"], ns["kernel"], ns.get("Pinocchio", "-")]
            ratios = [three(row["recursion_times_faster"]), three(row["times_faster"])]
            single = [ns["kernel, one state"], ns["Pinocchio, one state"], three(row["single_times_faster"])]
            worst = [f"{row[key]:.1e}" for key in ("recursion_error", "error", "pinocchio_error")]
            rows.append([title(quantity), str(count), *batch, *ratios, *single, *worst])
    head = ["quantity", "batch", "recursion, ns per state", "kernel", "Pinocchio's batch call"]
    head += ["recursion, times Pinocchio's speed", "kernel, times its speed"]
    head += ["kernel, one state per call, ns", "Pinocchio, one state per call, ns", "times its speed"]
    return table([*head, "error of the recursion", "of the kernel", "of Pinocchio"], rows)
