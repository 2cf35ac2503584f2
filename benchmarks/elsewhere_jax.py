"""Dynamics inside JAX: python -m benchmarks.elsewhere_jax [--quick]

The UR5's inverse dynamics in 20,000 states, and the gradient of a loss by positions, velocities and accelerations: our
machine code called by XLA, the same program in jax.numpy, and frax where it is installed. One core, CPU times of calls
that take turns, errors against our recursion in NumPy and its gradient kernel, CPU time up to the first gradient.
"""

from __future__ import annotations

import os
import tempfile
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np

import rne
from benchmarks.cases import engines, states
from benchmarks.measure import QUICK_NOTE, is_quick, ratio
from benchmarks.pages import table, three
from benchmarks.peers.registry import import_failure

ONE_CORE = "--xla_cpu_multi_thread_eigen=false intra_op_parallelism_threads=1"
COUNT, REPEATS = 20_000, 15
QUICK_COUNT, QUICK_REPEATS = 500, 2
OURS, PRINTED, FRAX = "machine code", "program in jax.numpy", "frax"

Results = dict[str, Any]


def run(quick: bool) -> Results:
    """All figures; empty without JAX or Numba."""
    os.environ["XLA_FLAGS"] = ONE_CORE
    if import_failure("jax") or "numba" not in engines():
        return {}
    import jax

    jax.config.update("jax_enable_x64", True)
    robot, count = rne.load("ur5"), QUICK_COUNT if quick else COUNT
    arrays = [jax.numpy.asarray(a) for a in states(robot.n, count)]
    expected = robot.inverse_dynamics(*map(np.asarray, arrays))
    slopes = rne.kernels.gradient(rne.dynamics.inverse_dynamics, robot.model)(*map(np.asarray, arrays), 2 * expected)
    found: Results = {"states": count, "calls": {}}
    calls: dict[str, Callable[[], Any]] = {}
    for name, make in MAKERS.items():
        if name == FRAX and import_failure("frax"):
            continue
        start = time.process_time()
        function = make(robot.model)
        value = jax.jit(function)
        gradient = jax.jit(jax.grad(lambda *x, function=function: (function(*x) ** 2).sum(), (0, 1, 2)))
        got = np.concatenate(jax.block_until_ready(gradient(*arrays)), -1)
        errors = {"value": error(value(*arrays), expected), "gradient": error(got, slopes)}
        found["calls"][name] = {"first_gradient_s": time.process_time() - start, "errors": errors}
        calls |= {f"{name}, value": lambda f=value: f(*arrays), f"{name}, gradient": lambda f=gradient: f(*arrays)}
    seconds = cpu_seconds(calls, QUICK_REPEATS if quick else REPEATS)
    for name, row in found["calls"].items():
        for what in ("value", "gradient"):
            row[f"{what}_ns"] = median(seconds[f"{name}, {what}"]) / count * 1e9
            row[f"{what}_times"] = ratio(seconds, f"{name}, {what}", f"{OURS}, {what}")
    return found


def machine_code(model: rne.Model) -> Callable[..., Any]:
    """Ours by engine "numba", nothing of it kept on disk."""
    os.environ["RNE_CACHE"] = ""
    return rne.compile(rne.dynamics.inverse_dynamics, model, engine="numba").to_jax()


def program(model: rne.Model) -> Callable[..., Any]:
    """Ours by engine "numpy"."""
    return rne.compile(rne.dynamics.inverse_dynamics, model).to_jax()


def frax(model: rne.Model) -> Callable[..., Any]:
    """The recursion of frax on our robot, one state after another by vmap."""
    import frax
    import jax

    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "robot.urdf")
        path.write_text(rne.to_urdf(model), encoding="utf-8")
        robot = frax.Robot(str(path), joint_ordering=list(model.joint_names))
    upward = np.concatenate([-np.array(model.gravity), np.zeros(3)])
    return jax.vmap(lambda q, qd, qdd: robot.rnea(q, qd, qdd, upward, None))


MAKERS: dict[str, Callable[[rne.Model], Callable[..., Any]]] = {OURS: machine_code, PRINTED: program, FRAX: frax}


def error(got: Any, expected: np.ndarray) -> float:
    """Worst of the states, relative to its largest entry."""
    return float((np.abs(np.asarray(got) - expected).max(-1) / np.abs(expected).max(-1)).max())


def cpu_seconds(calls: Mapping[str, Callable[[], Any]], repeats: int) -> dict[str, list[float]]:
    """CPU seconds of each call, run in turn."""
    import jax

    seconds: dict[str, list[float]] = {name: [] for name in calls}
    for _ in range(repeats):
        for name, call in calls.items():
            start = time.process_time()
            jax.block_until_ready(call())
            seconds[name].append(time.process_time() - start)
    return seconds


def tables(results: Results) -> dict[str, str]:
    """The table of the page."""
    head = [
        "inside JAX",
        "value [ns per state]",
        "gradient [ns per state]",
        "times rne's",
        "its gradient",
        "worst error",
    ]
    head.append("first gradient [CPU s]")
    lines = [
        [
            name,
            *(f"{row[f'{what}_ns']:.0f}" for what in ("value", "gradient")),
            *(three(row[f"{what}_times"]) for what in ("value", "gradient")),
            f"{max(row['errors'].values()):.0e}",
            f"{row['first_gradient_s']:.2f}",
        ]
        for name, row in results.get("calls", {}).items()
    ]
    return {"jax": table(head, lines)} if lines else {}


def main() -> None:
    quick = is_quick(__doc__)
    print("\n\n".join(tables(run(quick)).values()))
    if quick:
        print(QUICK_NOTE)


if __name__ == "__main__":
    main()
