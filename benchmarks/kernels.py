"""Kernels beside Pinocchio: python -m benchmarks.kernels [--quick]

Operations, time per state in batches and in single calls, and the error of the very same calls against long double;
Pinocchio in the same interleaved run, one thread each. Writes benchmarks/results/kernels.json.
"""

from __future__ import annotations

import time
import tracemalloc
from concurrent.futures import ProcessPoolExecutor
from typing import Any

import numpy as np

import rne
from benchmarks.cases import QUANTITIES, load, states, title
from benchmarks.measure import QUICK_NOTE, interleaved, is_quick, many, nanoseconds, per_state, ratio, write
from benchmarks.pages import table
from benchmarks.peers.pinocchio import Pinocchio
from rne.model.robots.generators import straight_chain

ROBOTS = ("irb140", "ur5", "panda")
EXACT = 200  # states whose error is taken, against long double
TIMES = 200  # single calls in a repeat
HEAD = [
    "robot",
    "quantity",
    "operations",
    "error [eps]",
    "ns per state",
    "times faster than Pinocchio's batch call",
    "float32, times faster than float64",
    "single call [µs]",
    "times slower than Pinocchio's",
]


def error(function: Any, robot: rne.Robot, kernel: rne.Kernel, arrays: list[np.ndarray]) -> float:
    """Largest error of the kernel relative to the largest entry, against the recursion in long double."""
    arrays = [a[:EXACT] for a in arrays]
    exact = function(robot.model, *(a.astype(np.longdouble) for a in arrays))
    return float(np.abs(kernel(*arrays) - exact).max() / np.abs(exact).max())


def compare(robot: rne.Robot, count: int, repeats: int) -> dict[str, Any]:
    """All figures of one robot, whose methods are compiled before they are timed."""
    robot.compile()
    everything = states(robot.n, count)
    theirs = Pinocchio(robot.model, everything)
    rows: dict[str, Any] = {}
    for quantity, (function, arity) in QUANTITIES.items():
        kernel, method, arrays = robot.kernel(function), getattr(robot, quantity), everything[:arity]
        arrays32 = [a.astype(np.float32) for a in arrays]
        out, out32 = kernel(*arrays), kernel(*arrays32)
        one = [a[0].copy() for a in arrays]
        loop, looped = theirs.loop(quantity)
        calls = {
            "batch": (lambda k=kernel, a=arrays, o=out: k(*a, out=o), count),
            "float32": (lambda k=kernel, a=arrays32, o=out32: k(*a, out=o), count),
            "pinocchio": theirs.fastest(quantity),
            "single": (many(lambda m=method, s=one: m(*s), TIMES), TIMES),
            "pinocchio_single": (loop, looped),
        }
        each = per_state(calls, repeats)
        rows[quantity] = {
            "operations": sum(kernel.operations.values()),
            "registers": kernel.blocks.layout.registers,
            "error_eps": error(function, robot, kernel, arrays) / np.finfo(float).eps,
            "ns_per_state": nanoseconds(each["batch"]),
            "pinocchio_ns_per_state": nanoseconds(each["pinocchio"]),
            "batch_times_faster": ratio(each, "pinocchio", "batch"),
            "float32_times_faster": ratio(each, "batch", "float32"),
            "single_us": nanoseconds(each["single"]) / 1e3,
            "single_times_slower": ratio(each, "single", "pinocchio_single"),
        }
    rows["inverse_dynamics_derivatives"] = derivatives(robot, theirs, everything, repeats)
    return rows


def derivatives(robot: rne.Robot, theirs: Pinocchio, states: list[np.ndarray], repeats: int) -> dict[str, Any]:
    """Derivatives of inverse dynamics, one state and a batch, beside computeRNEADerivatives in a loop."""
    batch = [a[:10_000] for a in states]
    one = [a[0].copy() for a in states]
    robot.inverse_dynamics_derivatives(*batch)
    calls = {
        "single": (many(lambda: robot.inverse_dynamics_derivatives(*one), 100), 100),
        "batch": (lambda: robot.inverse_dynamics_derivatives(*batch), len(batch[0])),
        "pinocchio": theirs.loop("inverse_dynamics_derivatives"),
    }
    each = per_state(calls, repeats)
    return {
        "operations": sum(robot.kernel(rne.inverse_dynamics, "q", "qd").operations.values()),
        "single_times_slower": ratio(each, "single", "pinocchio"),
        "batch_times_faster": ratio(each, "pinocchio", "batch"),
    }


def growth(quick: bool) -> dict[str, Any]:
    """Compile times, time per state from a thousand states to a million, and the extra memory of the largest batch."""
    start = time.perf_counter()
    for function, arity in QUANTITIES.values():
        kernel = rne.compile(function, rne.irb140())
        kernel(*[np.zeros(6)] * arity)
        kernel(*[np.zeros((2, 6))] * arity)
    three = time.perf_counter() - start
    length = 10 if quick else 100
    start = time.perf_counter()
    long = rne.compile(rne.inverse_dynamics, straight_chain(length))
    long(*[np.zeros((2, length))] * 3)
    chain = time.perf_counter() - start
    kernel = rne.compile(rne.inverse_dynamics, rne.irb140())
    times = {}
    for count in (1000, 10_000) if quick else (1000, 10_000, 100_000, 1_000_000):
        q = np.random.default_rng(0).uniform(-3, 3, (count, 6))
        out = kernel(q, q, q)
        times[count] = nanoseconds(per_state({"run": (lambda q=q, o=out: kernel(q, q, q, out=o), count)}, 5)["run"])
    fresh = rne.compile(rne.inverse_dynamics, rne.irb140())
    tracemalloc.start()
    fresh(q, q, q, out=out)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    return {
        "compile_three_ms": three * 1e3,
        "compile_chain_s": chain,
        "chain_joints": length,
        "chain_registers": long.blocks.layout.registers,
        "ns_per_state": times,
        "peak_extra_MB": peak / 1e6,
    }


def processes(count: int, repeats: int) -> tuple[float, float, float]:
    """How many times faster two processes compute a batch than one, without the transfer of the data."""
    kernel = rne.load("irb140").kernel(rne.inverse_dynamics)
    with ProcessPoolExecutor(2) as pool:
        list(pool.map(_work, [(kernel, 1000)] * 2))
        seconds = interleaved(
            {
                "one": lambda: list(pool.map(_work, [(kernel, count)])),
                "two": lambda: list(pool.map(_work, [(kernel, count // 2)] * 2)),
            },
            repeats,
        )
    return ratio(seconds, "one", "two")


def _work(job: tuple[rne.Kernel, int]) -> float:
    kernel, count = job
    q = np.random.default_rng(0).uniform(-3, 3, (5000, kernel.model.n))
    for _ in range(count // 5000):
        kernel(q, q, q)
    return float(q[0, 0])


def cells(robot: str, quantity: str, row: dict[str, Any]) -> list[str]:
    """A line of the table."""
    return [
        robot,
        title(quantity),
        str(row["operations"]),
        f"{row['error_eps']:.1f}",
        f"{row['ns_per_state']:.0f}",
        f"{row['batch_times_faster'][0]:.1f}",
        f"{row['float32_times_faster'][0]:.2f}",
        f"{row['single_us']:.1f}",
        f"{row['single_times_slower'][0]:.1f}",
    ]


def main() -> None:
    quick = is_quick(__doc__)
    count, repeats = (500, 1) if quick else (100_000, 9)
    results = {name: compare(load(name), count, repeats) for name in (ROBOTS[:1] if quick else ROBOTS)}
    print(table(HEAD, [cells(name, q, rows[q]) for name, rows in results.items() for q in QUANTITIES]))
    print("\nDerivatives of inverse dynamics, Pinocchio's in a loop:\n")
    head = ["robot", "operations", "one state: times slower than Pinocchio", "batch: times faster"]
    lines = {name: rows["inverse_dynamics_derivatives"] for name, rows in results.items()}
    ratios = ("single_times_slower", "batch_times_faster")
    print(table(head, [[n, str(r["operations"]), *(f"{r[k][0]:.1f}" for k in ratios)] for n, r in lines.items()]))
    grown = growth(quick)
    print(f"\ncompile times, time per state and memory: {grown}")
    shares = processes(20_000 if quick else 2_000_000, 1 if quick else 5)
    print(f"two processes: {shares[0]:.2f} times faster than one")
    if quick:
        print(f"\n{QUICK_NOTE}")
    else:
        content = {"states": count, "repeats": repeats, "robots": results, "growth": grown, "two_processes": shares}
        write("kernels.json", content)


if __name__ == "__main__":
    main()
