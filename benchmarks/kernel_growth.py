"""Costs of compilations, time per state by the size of the batch, the memory of the largest, and two processes."""

from __future__ import annotations

import statistics
import time
import tracemalloc
from concurrent.futures import ProcessPoolExecutor
from typing import Any

import numpy as np

import rne
from benchmarks.cases import QUANTITIES
from benchmarks.measure import Spread, interleaved, per_state, ratio
from tests.random_robots import straight_chain

LENGTH, QUICK_LENGTH = 100, 10  # joints of the chain
SIZES, QUICK_SIZES = (1000, 10_000, 100_000, 1_000_000), (1000, 10_000)
REPEATS = 5


def start_up(engine: str) -> float:
    """Seconds of the first kernel of this process, of which nearly all is the loading of the engine."""
    begun = time.perf_counter()
    rne.compile(rne.dynamics.mass_matrix, straight_chain(2), engine=engine)(np.zeros(2))
    return time.perf_counter() - begun


def growth(engine: str, quick: bool) -> dict[str, Any]:
    """All figures of one engine."""
    length, sizes = (QUICK_LENGTH, QUICK_SIZES) if quick else (LENGTH, SIZES)
    chain, seconds = compiled(straight_chain(length), engine, {"inverse_dynamics": 3}, singly=False)
    _, three = compiled(rne.irb140(), engine, {name: arity for name, (_, arity) in QUANTITIES.items()}, singly=True)
    return {
        "compile_three_s": three,
        "compile_chain_s": seconds,
        "chain_joints": length,
        "chain_registers": chain.blocks.layout.registers if engine == "numpy" else None,
        **by_size(engine, sizes),
    }


def compiled(
    model: rne.Model, engine: str, quantities: dict[str, int], singly: bool
) -> tuple[rne.kernels.Kernel, float]:
    """The last of the kernels, and the seconds of tracing and compiling all, for one state too if wanted."""
    begun = time.perf_counter()
    for name, arity in quantities.items():
        kernel = rne.compile(getattr(rne.dynamics, name), model, engine=engine)
        if singly:
            kernel(*[np.zeros(model.n)] * arity)
        kernel(*[np.zeros((2, model.n))] * arity)
    return kernel, time.perf_counter() - begun


def by_size(engine: str, sizes: tuple[int, ...]) -> dict[str, Any]:
    """Inverse dynamics of the IRB 140: times per state, and the memory that a call of the largest batch takes."""
    kernel = rne.compile(rne.dynamics.inverse_dynamics, rne.irb140(), engine=engine)
    times = {}
    for count in sizes:
        q = np.random.default_rng(0).uniform(-3, 3, (count, 6))
        out = kernel(q, q, q)
        each = per_state({"run": (lambda q=q, o=out: kernel(q, q, q, out=o), count)}, REPEATS)
        times[count] = statistics.median(each["run"]) * 1e9
    fresh = rne.compile(rne.dynamics.inverse_dynamics, rne.irb140())
    run = kernel if engine != "numpy" else fresh  # NumPy's kernel keeps the memory that it took in its first call
    tracemalloc.start()
    run(q, q, q, out=out)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    return {"ns_per_state": times, "peak_extra_MB": peak / 1e6}


def processes(count: int, repeats: int) -> Spread:
    """Speed of two processes relative to one, without the transfer of the data."""
    kernel = rne.load("irb140").kernel(rne.dynamics.inverse_dynamics)
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


def _work(job: tuple[rne.kernels.Kernel, int]) -> float:
    kernel, count = job
    q = np.random.default_rng(0).uniform(-3, 3, (5000, kernel.model.n))
    for _ in range(count // 5000):
        kernel(q, q, q)
    return float(q[0, 0])
