"""Kernels of one robot timed by both engines and by Pinocchio, all in one interleaved run per quantity.

Inverse and forward dynamics return fresh arrays, as they do where a user calls them; M, whose fresh arrays would be
most of its time, is written into `out=`. Pinocchio's batch calls write into an array that is given.
"""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

import rne
from benchmarks.cases import QUANTITIES, states
from benchmarks.kernel_errors import EXACT, reference, relative_error, single_results
from benchmarks.measure import Call, many, nanoseconds, per_state, ratio
from benchmarks.peers.pinocchio import BATCH, Pinocchio

SMALL = 1000  # states of the smaller batches
TIMES = 200  # single calls in a repeat
SMALL_TIMES = 20  # smaller batches in a repeat
FEW = 10_000  # states of a batch of derivatives
Robots = Mapping[str, rne.Robot]  # the same robot by engine
Calls = dict[str, tuple[Call, int]]  # a call and how many states it computes


@dataclass(frozen=True)
class Sizes:
    """Sizes of runs: states of a large batch, repeats, and the quantities that an engine takes part in."""

    count: int
    repeats: int
    quantities: Mapping[str, tuple[str, ...]]

    def of(self, robots: Robots, quantity: str) -> Robots:
        """The robot by the engines that take part in a quantity."""
        return {engine: robot for engine, robot in robots.items() if quantity in self.quantities[engine]}


def compare(robots: Robots, sizes: Sizes) -> dict[str, Any]:
    """All figures of one robot, by quantity."""
    robot = robots["numpy"]
    everything = states(robot.n, sizes.count)
    theirs = Pinocchio(robot.model, everything), Pinocchio(robot.model, [a[:SMALL] for a in everything])
    found = {
        quantity: of_quantity(sizes.of(robots, quantity), quantity, everything, theirs, sizes.repeats)
        for quantity in QUANTITIES
    }
    name = "inverse_dynamics_derivatives"
    return found | {name: derivatives(sizes.of(robots, name), theirs[0], everything, sizes.repeats)}


def of_quantity(
    robots: Robots, quantity: str, everything: list[np.ndarray], theirs: tuple[Pinocchio, Pinocchio], repeats: int
) -> dict[str, Any]:
    """One quantity by every engine, and by Pinocchio."""
    function, arity = QUANTITIES[quantity]
    arrays = everything[:arity]
    kernels: dict[str, rne.kernels.Kernel] = {}
    built: dict[str, dict[str, float]] = {}
    for engine, robot in robots.items():
        kernels[engine], built[engine] = build(robot, function, arrays)
    calls = their_calls(quantity, theirs)
    for engine, robot in robots.items():
        calls |= our_calls(engine, getattr(robot, quantity), kernels[engine], quantity, arrays)
    each = per_state(calls, repeats)
    exact = reference(function, robots["numpy"].model, [a[:EXACT] for a in arrays])
    plain = kernels["numpy"]
    found: dict[str, Any] = {
        "operations": sum(plain.operations.values()),
        "registers": plain.blocks.layout.registers,
        "pinocchio": their_figures(each),
    }
    for engine, robot in robots.items():
        errors = {
            "error_eps": relative_error(kernels[engine](*arrays)[:EXACT], exact),
            "single_error_eps": relative_error(single_results(getattr(robot, quantity), arrays), exact),
        }
        found[engine] = our_figures(each, engine) | errors | built[engine]
    return found


def build(robot: rne.Robot, function: Any, arrays: list[np.ndarray]) -> tuple[rne.kernels.Kernel, dict[str, float]]:
    """The robot's kernel, traced and compiled for one state and for batches, and how long that took."""
    begun = time.perf_counter()
    kernel = robot.kernel(function)
    traced = time.perf_counter()
    kernel(*(a[0].copy() for a in arrays))
    single = time.perf_counter()
    kernel(*(a[:2] for a in arrays))
    batch = time.perf_counter()
    return kernel, {"trace_s": traced - begun, "compile_single_s": single - traced, "compile_batch_s": batch - single}


def our_calls(engine: str, method: Any, kernel: rne.kernels.Kernel, quantity: str, arrays: list[np.ndarray]) -> Calls:
    """Batches, batches shared by two threads, and the Robot's method for one state, its checks included."""
    small = [a[:SMALL].copy() for a in arrays]
    single = [a[0].copy() for a in arrays]
    count, few = len(arrays[0]), len(small[0])
    return {
        f"{engine} batch": (batch_call(kernel, quantity, arrays), count),
        f"{engine} two threads": (batch_call(kernel, quantity, arrays, workers=2), count),
        f"{engine} small": (many(batch_call(kernel, quantity, small), SMALL_TIMES), SMALL_TIMES * few),
        f"{engine} float32": (batch_call(kernel, quantity, [a.astype(np.float32) for a in arrays]), count),
        f"{engine} single": (many(lambda: method(*single), TIMES), TIMES),
    }


def batch_call(kernel: rne.kernels.Kernel, quantity: str, arrays: list[np.ndarray], workers: int = 1) -> Call:
    """A call that returns a fresh array, or writes M into one that is there."""
    if quantity != "mass_matrix":
        return lambda: kernel(*arrays, workers=workers)
    out = kernel(*arrays)
    return lambda: kernel(*arrays, out=out, workers=workers)


def their_calls(quantity: str, theirs: tuple[Pinocchio, Pinocchio]) -> Calls:
    """Pinocchio's batch call, or the loop over single calls where it has none, and its single calls."""
    large, small = theirs
    call, few = small.fastest(quantity)
    calls = {
        "pinocchio batch": large.fastest(quantity),
        "pinocchio small": (many(call, SMALL_TIMES), SMALL_TIMES * few),
        "pinocchio single": large.loop(quantity),
    }
    return calls | ({"pinocchio two threads": large.in_threads(quantity, 2)} if quantity in BATCH else {})


def their_figures(each: dict[str, list[float]]) -> dict[str, Any]:
    """Pinocchio's times per state."""
    found: dict[str, Any] = {
        "ns_per_state": nanoseconds(each["pinocchio batch"]),
        "small_ns_per_state": nanoseconds(each["pinocchio small"]),
        "single_us": nanoseconds(each["pinocchio single"]) / 1e3,
    }
    if "pinocchio two threads" in each:
        found["two_threads_times_faster"] = ratio(each, "pinocchio batch", "pinocchio two threads")
    return found


def our_figures(each: dict[str, list[float]], engine: str) -> dict[str, Any]:
    """Times of an engine per state, and relative to Pinocchio's."""
    batch, small, single = (f"{engine} {what}" for what in ("batch", "small", "single"))
    return {
        "ns_per_state": nanoseconds(each[batch]),
        "small_ns_per_state": nanoseconds(each[small]),
        "single_us": nanoseconds(each[single]) / 1e3,
        "batch_times_faster": ratio(each, "pinocchio batch", batch),
        "small_times_faster": ratio(each, "pinocchio small", small),
        "single_times_slower": ratio(each, single, "pinocchio single"),
        "float32_times_faster": ratio(each, batch, f"{engine} float32"),
        "two_threads_times_faster": ratio(each, batch, f"{engine} two threads"),
    }


def derivatives(robots: Robots, theirs: Pinocchio, states: list[np.ndarray], repeats: int) -> dict[str, Any]:
    """Derivatives of inverse dynamics, one state and a batch, beside computeRNEADerivatives in a loop."""
    batch = [a[:FEW] for a in states]
    one = [a[0].copy() for a in states]
    calls: Calls = {"pinocchio": theirs.loop("inverse_dynamics_derivatives")}
    for engine, robot in robots.items():
        call = robot.inverse_dynamics_derivatives
        call(*batch)
        calls[f"{engine} single"] = many(lambda c=call: c(*one), 100), 100
        calls[f"{engine} batch"] = (lambda c=call: c(*batch)), len(batch[0])
    each = per_state(calls, repeats)
    found: dict[str, Any] = {
        engine: {
            "single_us": nanoseconds(each[f"{engine} single"]) / 1e3,
            "ns_per_state": nanoseconds(each[f"{engine} batch"]),
            "single_times_slower": ratio(each, f"{engine} single", "pinocchio"),
            "batch_times_faster": ratio(each, "pinocchio", f"{engine} batch"),
        }
        for engine in robots
    }
    kernel = robots["numpy"].kernel(rne.dynamics.inverse_dynamics, "q", "qd")
    return {"operations": sum(kernel.operations.values())} | found
