"""Kernels against Pinocchio: python -m benchmarks.kernels [--quick]

Operations, time a state in batches and in single calls, and the error of the very same calls against long double;
Pinocchio in the same interleaved run, one thread each. Writes benchmarks/results/kernels.json.
"""

from __future__ import annotations

import argparse
import statistics
import time
import tracemalloc
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from typing import Any

import numpy as np
import pinocchio as pin

import rne
from benchmarks.measure import interleaved, many, ratio, write
from benchmarks.validation import data_robots
from rne.analysis.pinocchio import Oracle
from rne.model.robots.generators import straight_chain

QUANTITIES: dict[str, tuple[Any, int]] = {
    "inverse_dynamics": (rne.inverse_dynamics, 3),
    "mass_matrix": (rne.mass_matrix, 1),
    "forward_dynamics": (rne.forward_dynamics, 3),
}


def robots() -> dict[str, tuple[rne.Robot, str]]:
    """The compared robots with the URDF text that Pinocchio reads."""
    data = data_robots()
    found = {"irb140": (rne.load("irb140"), rne.to_urdf(rne.irb140()))}
    for short, name in (("ur5", "ur_description/ur5_robot"), ("panda", "panda_description/panda")):
        found[short] = (rne.load(data[name]), data[name].read_text())
    return found


class Theirs:
    """Pinocchio's calls on the same states, in its own order and memory layout."""

    def __init__(self, oracle: Oracle, states: list[np.ndarray]) -> None:
        self.model, self.data, self.pool = oracle.theirs, oracle.data, pin.ModelPool(oracle.theirs, 1)
        q = np.array([oracle.q(x) for x in states[0]])
        rates = [np.array([oracle.rates(x) for x in array]) for array in states[1:]]
        self.arrays = [np.asfortranarray(a.T) for a in (q, *rates)]
        self.out = np.asfortranarray(np.zeros((self.model.nv, len(q))))
        self.one = [np.ascontiguousarray(a[:, 0]) for a in self.arrays]

    def batch(self, quantity: str, loop: int) -> tuple[Callable[[], Any], int]:
        """The fastest call for many states, and how many it does."""
        if quantity == "inverse_dynamics":
            return lambda: pin.rneaInParallel(1, self.pool, *self.arrays, self.out), self.out.shape[1]
        if quantity == "forward_dynamics":
            return lambda: pin.abaInParallel(1, self.pool, *self.arrays, self.out), self.out.shape[1]
        columns = [np.ascontiguousarray(self.arrays[0][:, k]) for k in range(loop)]
        return lambda: [pin.crba(self.model, self.data, q) for q in columns], loop

    def single(self, quantity: str) -> Callable[[], Any]:
        """One state."""
        call = {"inverse_dynamics": pin.rnea, "mass_matrix": pin.crba, "forward_dynamics": pin.aba}[quantity]
        count = QUANTITIES[quantity][1]
        return lambda: call(self.model, self.data, *self.one[:count])


def error(function: Any, robot: rne.Robot, kernel: rne.Kernel, arrays: list[np.ndarray]) -> float:
    """Largest error of the kernel relative to the largest entry, against the recursion in long double."""
    arrays = [a[:200] for a in arrays]
    exact = function(robot.model, *(a.astype(np.longdouble) for a in arrays))
    return float(np.abs(kernel(*arrays) - exact).max() / np.abs(exact).max())


def compare(name: str, robot: rne.Robot, xml: str, count: int, repeats: int) -> dict[str, Any]:
    """All figures of one robot."""
    rng = np.random.default_rng(0)
    states = [rng.uniform(-np.pi, np.pi, (count, robot.n)) for _ in range(3)]
    theirs = Theirs(Oracle(robot.model, xml), states)
    rows: dict[str, Any] = {"derivatives": derivatives(robot, theirs, states, repeats)}
    for quantity, (function, arity) in QUANTITIES.items():
        kernel = robot.kernel(function)
        method = getattr(robot, quantity)
        out = kernel(*states[:arity])
        singles = [a.astype(np.float32) for a in states[:arity]]
        out32 = kernel(*singles)
        one = [a[0].copy() for a in states[:arity]]
        batch, theirs_count = theirs.batch(quantity, min(count, 5000))
        seconds = interleaved(
            {
                "batch": lambda k=kernel, a=arity, o=out: k(*states[:a], out=o),
                "float32": lambda k=kernel, s=singles, o=out32: k(*s, out=o),
                "threads": lambda k=kernel, a=arity, o=out: k(*states[:a], out=o, workers=2),
                "pinocchio": batch,
                "single": many(lambda m=method, s=one: m(*s), 200),
                "pinocchio_single": many(theirs.single(quantity), 200),
            },
            repeats,
        )
        seconds["pinocchio"] = [s * count / theirs_count for s in seconds["pinocchio"]]
        rows[quantity] = {
            "operations": sum(kernel.operations.values()),
            "registers": kernel.layout.registers,
            "error_eps": error(function, robot, kernel, states[:arity]) / np.finfo(float).eps,
            "ns_a_state": statistics.median(seconds["batch"]) / count * 1e9,
            "pinocchio_ns_a_state": statistics.median(seconds["pinocchio"]) / count * 1e9,
            "batch_times_faster": ratio(seconds, "pinocchio", "batch"),
            "threads_times_faster": ratio(seconds, "batch", "threads"),
            "float32_times_faster": ratio(seconds, "batch", "float32"),
            "single_us": statistics.median(seconds["single"]) / 200 * 1e6,
            "single_times_slower": ratio(seconds, "single", "pinocchio_single"),
        }
        print_row(name, quantity, rows[quantity])
    return rows


def derivatives(robot: rne.Robot, theirs: Theirs, states: list[np.ndarray], repeats: int) -> dict[str, Any]:
    """Derivatives of inverse dynamics, one state and a batch, against computeRNEADerivatives in a loop."""
    count = min(len(states[0]), 10_000)
    batch = [a[:count] for a in states]
    one = [a[0].copy() for a in states]
    columns = [tuple(np.ascontiguousarray(a[:, k]) for a in theirs.arrays) for k in range(count)]
    seconds = interleaved(
        {
            "single": many(lambda: robot.inverse_dynamics_derivatives(*one), 100),
            "pinocchio_single": many(lambda: pin.computeRNEADerivatives(theirs.model, theirs.data, *theirs.one), 100),
            "batch": lambda: robot.inverse_dynamics_derivatives(*batch),
            "pinocchio": lambda: [pin.computeRNEADerivatives(theirs.model, theirs.data, *c) for c in columns],
        },
        repeats,
    )
    return {
        "operations": sum(robot.kernel(rne.inverse_dynamics, "q", "qd").operations.values()),
        "single_times_slower": ratio(seconds, "single", "pinocchio_single"),
        "batch_times_faster": ratio(seconds, "pinocchio", "batch"),
    }


def growth(quick: bool) -> dict[str, Any]:
    """Compile times, time a state from a thousand states to a million, and the extra memory of the largest batch."""
    start = time.perf_counter()
    for function, arity in QUANTITIES.values():
        kernel = rne.compile(function, rne.irb140())
        kernel(*[np.zeros(6)] * arity)
        kernel(*[np.zeros((2, 6))] * arity)
    three = time.perf_counter() - start
    chain = straight_chain(100)
    start = time.perf_counter()
    long = rne.compile(rne.inverse_dynamics, chain)
    long(*[np.zeros((2, 100))] * 3)
    hundred = time.perf_counter() - start
    kernel = rne.compile(rne.inverse_dynamics, rne.irb140())
    flat = {}
    for count in (1000, 10_000, 100_000) if quick else (1000, 10_000, 100_000, 1_000_000):
        q = np.random.default_rng(0).uniform(-3, 3, (count, 6))
        out = kernel(q, q, q)
        seconds = interleaved({"run": lambda q=q, out=out: kernel(q, q, q, out=out)}, 5)["run"]
        flat[count] = statistics.median(seconds) / count * 1e9
    fresh = rne.compile(rne.inverse_dynamics, rne.irb140())
    tracemalloc.start()
    fresh(q, q, q, out=out)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    return {
        "compile_three_ms": three * 1e3,
        "compile_chain_100_s": hundred,
        "chain_100_registers": long.layout.registers,
        "ns_a_state": flat,
        "peak_extra_MB": peak / 1e6,
    }


def print_row(name: str, quantity: str, row: dict[str, Any]) -> None:
    """One line of the table."""
    print(
        f"| {name} | {quantity.replace('_', ' ')} | {row['operations']} | {row['error_eps']:.1f} "
        f"| {row['ns_a_state']:.0f} | {row['batch_times_faster'][0]:.1f} | {row['threads_times_faster'][0]:.2f} "
        f"| {row['float32_times_faster'][0]:.2f} | {row['single_us']:.1f} | {row['single_times_slower'][0]:.1f} |",
        flush=True,
    )


def processes(count: int, repeats: int) -> tuple[float, float, float]:
    """How many times faster two processes do a batch than one, data sent to and fro left out."""
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


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="small batches, few repeats, nothing written")
    quick = parser.parse_args().quick
    count, repeats = (2000, 2) if quick else (100_000, 9)
    print(
        "| robot | quantity | operations | error [eps] | ns a state | times faster than Pinocchio's batch call", end=""
    )
    print(" | two threads | float32 | µs a single call | times slower than Pinocchio's |")
    print("|---|---|---|---|---|---|---|---|---|---|")
    results = {name: compare(name, *robot, count, repeats) for name, robot in robots().items()}
    for name, rows in results.items():
        row = rows["derivatives"]
        print(
            f"derivatives of inverse dynamics, {name}: {row['operations']} operations, one state "
            f"{row['single_times_slower'][0]:.1f} times slower than Pinocchio, batch "
            f"{row['batch_times_faster'][0]:.1f} times faster than it in a loop"
        )
    grown = growth(quick)
    print(f"compile time, growth and memory: {grown}")
    shares = processes(20_000 if quick else 2_000_000, 1 if quick else 5)
    print(f"\ntwo processes against one: {shares[0]:.2f}")
    if not quick:
        write(
            "kernels.json",
            {"states": count, "repeats": repeats, "robots": results, "growth": grown, "two_processes": shares},
        )


if __name__ == "__main__":
    main()
