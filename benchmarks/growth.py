"""Chart C: growth with the number of joints, compared with Pinocchio's.

Two families of arms. In a straight chain all axes are parallel, and much of the arithmetic is zero; in a crooked chain
axes, placements and inertias are random, and nothing can be dropped.
"""

from __future__ import annotations

import time
from typing import Any

import rne
from benchmarks.batch_sizes import EXACT, error
from benchmarks.cases import QUANTITIES, states, title
from benchmarks.measure import nanoseconds, per_state, ratio, repeats_within
from benchmarks.pages import table, three
from benchmarks.peers.pinocchio import Pinocchio
from tests.random_robots import random_tree, straight_chain

BATCH = 2000
LENGTHS = (2, 3, 4, 6, 9, 12, 16, 24, 32, 48, 64, 100)
LONGEST = {  # joints beyond which a quantity is left out: too large to be unrolled, or slow to compile
    ("straight", "mass_matrix"): 100,
    ("crooked", "mass_matrix"): 32,
    ("crooked", "forward_dynamics"): 48,
}
SECONDS = 0.8  # for the repeats of one comparison
FAMILIES = ("straight", "crooked")


def chain(family: str, n: int) -> rne.Model:
    """An arm of n revolute joints."""
    return straight_chain(n) if family == "straight" else random_tree(n, 1, prismatic=0.0, branching=0.0)


def of_length(family: str, n: int, count: int, repeats: int) -> dict[str, Any]:
    """All quantities of one arm."""
    robot = rne.Robot(chain(family, n))
    everything = states(n, count)
    theirs = Pinocchio(robot.model, everything)
    rows: dict[str, Any] = {}
    for quantity, (function, arity) in QUANTITIES.items():
        if n > LONGEST.get((family, quantity), n):
            continue
        arrays = everything[:arity]
        start = time.perf_counter()
        kernel = robot.kernel(robot.kernels.forward_method if quantity == "forward_dynamics" else function)
        out = kernel(*arrays)
        compiled = time.perf_counter() - start
        pair = {"ours": (lambda k=kernel, a=arrays, o=out: k(*a, out=o), count), "theirs": theirs.fastest(quantity)}
        calls = [call for call, _ in pair.values()]
        each = per_state(pair, repeats_within(calls, SECONDS) if repeats > 1 else 1)
        rows[quantity] = {
            "operations": sum(kernel.operations.values()) if kernel.is_unrolled else None,
            "method": kernel.quantity.name,
            "compile_s": compiled,
            "ns_per_state": nanoseconds(each["ours"]),
            "pinocchio_ns_per_state": nanoseconds(each["theirs"]),
            "times_faster": ratio(each, "theirs", "ours"),
            "error": error(kernel.function, robot.model, arrays, out),
            "pinocchio_error": error(kernel.function, robot.model, arrays, theirs.results(quantity, min(EXACT, count))),
        }
    return rows


def run(quick: bool) -> dict[str, Any]:
    """Both families."""
    count, repeats = (20, 1) if quick else (BATCH, 5)
    lengths = (2, 4) if quick else LENGTHS
    chains = {family: {n: of_length(family, n, count, repeats) for n in lengths} for family in FAMILIES}
    return {
        "batch": count,
        "repeats": "5 to 41, by time" if repeats > 1 else 1,
        "chains": chains,
    }


def tables(results: dict[str, Any]) -> dict[str, str]:
    """By the number of joints."""
    return {"joints": by_joints(results["chains"])}


def by_joints(chains: dict[str, Any]) -> str:
    """A row for each family, quantity and length."""
    rows = [
        [
            family,
            title(quantity),
            str(n),
            str(row["operations"] or "not unrolled"),
            f"{row['compile_s']:.2f}",
            f"{row['ns_per_state']:.0f}",
            f"{row['pinocchio_ns_per_state']:.0f}",
            *ratio_and_errors(row),
        ]
        for family, lengths in chains.items()
        for quantity in QUANTITIES
        for n, quantities in lengths.items()
        if quantity in quantities
        for row in [quantities[quantity]]
    ]
    head = ["chain", "quantity", "n", "operations", "compile s", "ns per state", "Pinocchio ns", "times its speed"]
    return table([*head, "error", "Pinocchio's error"], rows)


def ratio_and_errors(row: dict[str, Any]) -> list[str]:
    """Three cells."""
    return [three(row["times_faster"]), f"{row['error']:.1e}", f"{row['pinocchio_error']:.1e}"]
