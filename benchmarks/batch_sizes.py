"""Time per state against the size of a batch: the recursion, its kernel by each engine, Pinocchio; on the IRB 140."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import Any

import numpy as np

import rne
from benchmarks.cases import QUANTITIES, load, states, title
from benchmarks.measure import many, nanoseconds, per_state, ratio, repeats_within
from benchmarks.pages import table, three
from benchmarks.peers.pinocchio import BATCH, Pinocchio
from benchmarks.pictures import NUMBA, OURS, PINOCCHIO

SIZES = (1, 10, 100, 1000, 10_000, 100_000)
LEAST = 300  # states in a run of short calls
SECONDS = 1.0  # for the repeats of one comparison
EXACT = 50  # states whose error is taken, against long double
LINES = {  # calls by their name: how the picture shows them
    "recursion": ("rne, recursion", OURS, "s--"),
    "kernel": ("rne, kernel", OURS, "o-"),
    "kernel, one state": ("rne, kernel, one state per call", OURS, ":"),
    "Numba kernel": ("rne, kernel by Numba", NUMBA, "o-"),
    "Numba kernel, one state": ("rne, kernel by Numba, one state per call", NUMBA, ":"),
    "Pinocchio": ("Pinocchio, batch call", PINOCCHIO, "o-"),
    "Pinocchio, one state": ("Pinocchio, one state per call in a loop", PINOCCHIO, ":"),
}


def error(function: Any, model: rne.Model, arrays: list[np.ndarray], got: np.ndarray) -> float:
    """Worst of the first states, relative to the state's largest entry, against the recursion in long double."""
    few = min(EXACT, len(got))
    exact = function(model, *(a[:few].astype(np.longdouble) for a in arrays)).reshape(few, -1)
    return float((np.abs(got[:few].reshape(few, -1) - exact).max(1) / np.abs(exact).max(1)).max())


def of_size(
    robot: rne.Robot, quantity: str, machine_code: rne.kernels.Kernel | None, count: int, repeats: int | None
) -> dict[str, Any]:
    """Times per state and errors of one quantity in batches of one size; `repeats` are as many as the time allows."""
    function, arity = QUANTITIES[quantity]
    kernel, everything = robot.kernel(function), states(robot.n, count)
    arrays = everything[:arity]
    theirs = Pinocchio(robot.model, everything)
    recursion = partial(function, robot.model, *arrays)
    times = max(1, LEAST // count)
    loop, looped = theirs.loop(quantity)
    calls = {
        "recursion": (many(recursion, times), times * count),
        **kernel_calls("kernel", kernel, arrays),
        **({} if machine_code is None else kernel_calls("Numba kernel", machine_code, arrays)),
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
        "error": error(function, robot.model, arrays, kernel(*arrays)),
        "pinocchio_error": error(function, robot.model, arrays, theirs.results(quantity, min(EXACT, count))),
        **({} if machine_code is None else of_numba(each, against, machine_code, arrays)),
    }


def of_numba(each: Any, against: str, kernel: rne.kernels.Kernel, arrays: list[np.ndarray]) -> dict[str, Any]:
    """The ratios and the error of Numba's kernel."""
    return {
        "numba_times_faster": ratio(each, against, "Numba kernel"),
        "numba_single_times_faster": ratio(each, "Pinocchio, one state", "Numba kernel, one state"),
        "numba_error": error(kernel.function, kernel.model, arrays, kernel(*arrays)),
    }


def kernel_calls(name: str, kernel: rne.kernels.Kernel, arrays: list[np.ndarray]) -> dict[str, Any]:
    """A kernel on a batch, and on one state."""
    count = len(arrays[0])
    out, one, times = kernel(*arrays), [a[0].copy() for a in arrays], max(1, LEAST // count)
    return {
        name: (many(lambda: kernel(*arrays, out=out), times), times * count),
        f"{name}, one state": (many(lambda: kernel(*one), LEAST), LEAST),
    }


def run(quick: bool, compiled: Sequence[str]) -> dict[str, Any]:
    """All sizes of all quantities; Numba takes part in those that are named."""
    robot = load("irb140")
    sizes, repeats = ((1, 100), 1) if quick else (SIZES, None)
    found = {}
    for quantity, (function, _) in QUANTITIES.items():
        kernel = rne.compile(function, robot.model, engine="numba") if quantity in compiled else None
        found[quantity] = {count: of_size(robot, quantity, kernel, count, repeats) for count in sizes}
    return found


def panels(axes: Any, results: dict[str, Any]) -> None:
    """One for each quantity."""
    for ax, (quantity, rows) in zip(axes, results.items(), strict=True):
        for name, (label, color, style) in LINES.items():
            values = {count: row["ns_per_state"].get(name) for count, row in rows.items()}
            if all(values.values()):
                ax.plot(list(values), list(values.values()), style, color=color, label=label, markersize=5)
        ax.set(xscale="log", yscale="log", xlabel="states in the batch [1]", ylim=(10, 3e7))
        ax.set_title(f"irb140: {title(quantity)}, by the size of the batch", fontsize="medium")
        ax.grid(True, alpha=0.25)
        ax.legend(fontsize="small", frameon=False, loc="upper right")
    axes[0].set_ylabel("time per state [ns]")


def by_size(results: dict[str, Any]) -> str:
    """A row for each quantity and size."""
    rows = []
    for quantity, sizes in results.items():
        for count, row in sizes.items():
            calls = ("recursion", "kernel", "Numba kernel", "Pinocchio")
            singles = ("kernel, one state", "Numba kernel, one state", "Pinocchio, one state")
            batch_ratios = ("recursion_times_faster", "times_faster", "numba_times_faster")
            single_ratios = ("single_times_faster", "numba_single_times_faster")
            worst = ("recursion_error", "error", "numba_error", "pinocchio_error")
            batch = [*_times(row, calls), *_ratios(row, batch_ratios)]
            single = [*_times(row, singles), *_ratios(row, single_ratios)]
            errors = [f"{row[key]:.1e}" if key in row else "-" for key in worst]
            rows.append([title(quantity), str(count), *batch, *single, *errors])
    head = ["quantity", "batch", "recursion, ns per state", "kernel", "Numba kernel", "Pinocchio's batch call"]
    head += ["recursion, times Pinocchio's speed", "kernel, times its speed", "Numba kernel, times its speed"]
    head += ["kernel, one state per call, ns", "Numba kernel, one state, ns", "Pinocchio, one state per call, ns"]
    head += ["kernel, times its speed with one state", "Numba kernel, times that speed"]
    return table([*head, "error of the recursion", "of the kernel", "of the Numba kernel", "of Pinocchio"], rows)


def _times(row: dict[str, Any], calls: Sequence[str]) -> list[str]:
    ns = row["ns_per_state"]
    return [f"{ns[name]:.0f}" if name in ns else "-" for name in calls]


def _ratios(row: dict[str, Any], keys: Sequence[str]) -> list[str]:
    return [three(row[key]) if key in row else "-" for key in keys]
