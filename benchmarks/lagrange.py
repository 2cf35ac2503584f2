"""Euler-Lagrange beside Newton-Euler on the IRB 140: python -m benchmarks.lagrange [--quick]

In table 7.1 of Høifødt 2011, 10 s of free motion took 6 s of computing with Newton-Euler and 7 min with Euler-Lagrange.
Here both are run as written and as kernels traced from the same text, on the same states in turn: operations, time, and
the error against the recursion in long double. Writes benchmarks/results/lagrange.json.
"""

from __future__ import annotations

import time
from collections import Counter
from dataclasses import fields
from functools import partial
from typing import Any, ClassVar

import numpy as np

import rne
from benchmarks.cases import states
from benchmarks.measure import is_quick, many, nanoseconds, per_state, ratio, write
from benchmarks.pages import table, three
from rne.dynamics.quantity import Declared, quantity
from tests.random_robots import straight_chain

THESIS = 7 * 60 / 6  # table 7.1, 10 s open loop: Euler-Lagrange over Newton-Euler
TIMES = 50  # single calls in a repeat
ARITHMETIC = {"add", "subtract", "multiply", "divide", "negative", "sin", "cos", "matmul"}
# Not declared to depend on the base parameters only: compiled from the masses of the robot as they are.
AS_GIVEN = quantity(base_parameters=False)(rne.dynamics.inverse_dynamics.core)
AS_WRITTEN: dict[str, Any] = {
    "lagrange": rne.dynamics.lagrange_inverse_dynamics,
    "newton_euler": rne.dynamics.inverse_dynamics,
}
COMPILED: dict[str, Declared] = {
    "lagrange_kernel": rne.dynamics.lagrange_inverse_dynamics,
    "newton_euler_kernel_as_given": AS_GIVEN,
    "newton_euler_kernel": rne.dynamics.inverse_dynamics,
}
NAMES = {
    "lagrange": "Lagrange as written",
    "lagrange_kernel": "Lagrange kernel",
    "newton_euler": "Newton-Euler as written",
    "newton_euler_kernel_as_given": "Newton-Euler kernel, without base parameters",
    "newton_euler_kernel": "Newton-Euler kernel",
}
PAIRS = {
    "as_written": ("lagrange", "newton_euler"),
    "kernels": ("lagrange_kernel", "newton_euler_kernel"),
}


class Counted(np.ndarray):
    """An array that counts NumPy's operations on it, zeros and ones included, and its calls.

    Operations on arrays of zeros that a core has made itself are not counted: under 2 % here.
    """

    total: ClassVar[Counter[str]] = Counter()

    def __array_ufunc__(self, ufunc: Any, method: str, *inputs: Any, out: Any = None, **options: Any) -> Any:
        plain = [np.asarray(x) for x in inputs]
        if out is not None:
            options["out"] = tuple(np.asarray(x) for x in out)
        result = getattr(ufunc, method)(*plain, **options)
        if ufunc.__name__ in ARITHMETIC:
            each = 2 * plain[0].shape[-1] - 1 if ufunc is np.matmul else 1  # products and sums per entry
            Counted.total["calls"] += 1
            Counted.total["operations"] += plain[0].size - result.size if method == "reduce" else each * result.size
        return np.asarray(result).view(Counted)


def count_as_written(function: Any, model: rne.Model) -> Counter[str]:
    """Operations and NumPy calls of one plain run of a core on one state."""
    arrays = {f.name: getattr(model, f.name) for f in fields(model)}
    counted = rne.Model(**arrays)
    counted._freeze({name: a.view(Counted) for name, a in arrays.items() if isinstance(a, np.ndarray)})
    _ = counted.moments, counted.angular_axis, counted.linear_axis  # once per robot, not once per state
    state = [np.linspace(0.1, 1, model.n).view(Counted) for _ in range(3)]
    Counted.total = Counter()
    function.core(counted, *state)
    return Counted.total


def run(count: int, repeats: int) -> dict[str, Any]:
    """All figures by formulation and way to run it; errors relative to the largest torque."""
    model = rne.irb140()
    arrays = states(model.n, count)
    one = [a[0].copy() for a in arrays]
    exact = rne.dynamics.inverse_dynamics(model, *(a.astype(np.longdouble) for a in arrays))
    kernels, compile_ms = {}, {}
    for name, function in COMPILED.items():
        start = time.perf_counter()
        kernels[name] = rne.compile(function, model)
        compile_ms[name] = (time.perf_counter() - start) * 1e3
    calls: dict[str, Any] = {name: partial(f, model) for name, f in AS_WRITTEN.items()} | kernels
    single = per_state({name: (many(partial(c, *one), TIMES), TIMES) for name, c in calls.items()}, repeats)
    batch = per_state({name: (partial(c, *arrays), count) for name, c in calls.items()}, repeats)
    rows: dict[str, Any] = {}
    for name, call in calls.items():
        counted = count_as_written(AS_WRITTEN[name], model) if name in AS_WRITTEN else Counter()
        rows[name] = {
            "operations": counted["operations"] or sum(kernels[name].operations.values()),
            "numpy_calls": counted["calls"] or None,
            "compile_ms": compile_ms.get(name),
            "single_us": nanoseconds(single[name]) / 1e3,
            "batch_us_per_state": nanoseconds(batch[name]) / 1e3,
            "error_eps": float(np.abs(call(*arrays) - exact).max() / np.abs(exact).max() / np.finfo(float).eps),
            "single_times_the_kernel": ratio(single, name, "newton_euler_kernel"),
            "batch_times_the_kernel": ratio(batch, name, "newton_euler_kernel"),
        }
    rows["lagrange_over_newton_euler"] = {
        way: {"single": ratio(single, *pair), "batch": ratio(batch, *pair)} for way, pair in PAIRS.items()
    }
    return rows


def growth(lengths: tuple[int, ...]) -> dict[int, list[int]]:
    """Operations of both kernels on straight chains: Lagrange first."""
    pair = (rne.dynamics.lagrange_inverse_dynamics, rne.dynamics.inverse_dynamics)
    return {n: [sum(rne.compile(f, straight_chain(n)).operations.values()) for f in pair] for n in lengths}


def print_tables(rows: dict[str, Any], count: int, grown: dict[int, list[int]]) -> None:
    """By formulation, the ratios to compare with table 7.1, and by the number of joints."""
    head = ["robot", "formulation", "operations", "NumPy calls", "one state [µs]", f"{count} states [µs per state]"]
    lines = [
        [
            "irb140",
            title,
            str(rows[name]["operations"]),
            str(rows[name]["numpy_calls"] or "-"),
            f"{rows[name]['single_us']:.1f}",
            f"{rows[name]['batch_us_per_state']:.3f}",
            f"{rows[name]['error_eps']:.1f}",
        ]
        for name, title in NAMES.items()
    ]
    print(table([*head, "error [eps]"], lines))
    print(f"\nLagrange over Newton-Euler, smallest and largest of the runs (the thesis's simulations: {THESIS:.0f}):\n")
    ratios = rows["lagrange_over_newton_euler"]
    lines = [[way.replace("_", " "), *(three(spread) for spread in pair.values())] for way, pair in ratios.items()]
    print(table(["run", "one state", "batch"], lines))
    print("\nOperations on straight chains:\n")
    print(table(["joints", "Lagrange", "Newton-Euler"], [[str(n), *map(str, pair)] for n, pair in grown.items()]))


def main() -> None:
    quick = is_quick(__doc__)
    count, repeats = (200, 1) if quick else (10_000, 15)
    rows, grown = run(count, repeats), growth((2, 4) if quick else (2, 4, 8, 12, 16))
    print_tables(rows, count, grown)
    if not quick:
        write("lagrange.json", {"states": count, "repeats": repeats, "irb140": rows, "chains": grown})


if __name__ == "__main__":
    main()
