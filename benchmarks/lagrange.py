"""Euler-Lagrange against Newton-Euler on the IRB 140: python -m benchmarks.lagrange [--quick]

Table 7.1 of Høifødt 2011 asks what the formulation costs: 10 s of free motion took 6 s of computing with Newton-Euler
and 7 min with Euler-Lagrange. Here both are run as written and as kernels traced from the same text, on the same
states in turn: operations, time, and the error against the long double recursion.
Writes benchmarks/results/lagrange.json.
"""

from __future__ import annotations

import argparse
import statistics
import time
from collections import Counter
from collections.abc import Callable
from dataclasses import fields
from typing import Any, ClassVar

import numpy as np

import rne
from benchmarks.measure import interleaved, many, ratio, write
from rne.dynamics.quantity import Checked, checked
from rne.model.robots.generators import straight_chain

THESIS = 7 * 60 / 6  # table 7.1, 10 s open loop: Euler-Lagrange over Newton-Euler
ARITHMETIC = {"add", "subtract", "multiply", "divide", "negative", "sin", "cos", "matmul"}
# The same recursion under another name is compiled from the bodies as the robot has them, without grouping.
AS_GIVEN: Checked[Any, Any, Any] = checked(rne.inverse_dynamics.core)
AS_WRITTEN: dict[str, Checked[Any, Any, Any]] = {
    "lagrange": rne.lagrange_inverse_dynamics,
    "newton_euler": rne.inverse_dynamics,
}
COMPILED: dict[str, Checked[Any, Any, Any]] = {
    "lagrange_kernel": rne.lagrange_inverse_dynamics,
    "newton_euler_kernel_as_given": AS_GIVEN,
    "newton_euler_kernel": rne.inverse_dynamics,
}
NAMES = {
    "lagrange": "Lagrange as written",
    "lagrange_kernel": "Lagrange kernel (expanded)",
    "newton_euler": "Newton-Euler as written",
    "newton_euler_kernel_as_given": "Newton-Euler kernel, masses not grouped",
    "newton_euler_kernel": "Newton-Euler kernel",
}


class Counted(np.ndarray):
    """An array that counts the operations NumPy does on it, zeros and ones included, and its calls.

    What a core does to an array of zeros it made itself is missed until that array meets another: under 2 % here.
    """

    total: ClassVar[Counter[str]] = Counter()

    def __array_ufunc__(self, ufunc: Any, method: str, *inputs: Any, out: Any = None, **options: Any) -> Any:
        plain = [np.asarray(x) for x in inputs]
        if out is not None:
            options["out"] = tuple(np.asarray(x) for x in out)
        result = getattr(ufunc, method)(*plain, **options)
        if ufunc.__name__ in ARITHMETIC:
            each = 2 * plain[0].shape[-1] - 1 if ufunc is np.matmul else 1  # products and sums of an entry
            Counted.total["calls"] += 1
            Counted.total["operations"] += plain[0].size - result.size if method == "reduce" else each * result.size
        return np.asarray(result).view(Counted)


def count_as_written(function: Any, model: rne.Model) -> Counter[str]:
    """Operations and NumPy calls of one plain run of a core on one state."""
    arrays = {f.name: getattr(model, f.name) for f in fields(model)}
    counted = rne.Model(**arrays)
    counted._freeze({name: a.view(Counted) for name, a in arrays.items() if isinstance(a, np.ndarray)})
    _ = counted.moments  # once a robot, not once a state
    state = [np.linspace(0.1, 1, model.n).view(Counted) for _ in range(3)]
    Counted.total = Counter()
    function.core(counted, *state)
    return Counted.total


def run(count: int, repeats: int) -> dict[str, Any]:
    """All figures by formulation and way to run it; errors relative to the largest torque."""
    model = rne.irb140()
    rng = np.random.default_rng(0)
    states = [rng.uniform(-x, x, (count, model.n)) for x in (np.pi, 10.0, 50.0)]
    exact = rne.inverse_dynamics(model, *(a.astype(np.longdouble) for a in states))
    kernels, compile_ms = {}, {}
    for name, function in COMPILED.items():
        start = time.perf_counter()
        kernels[name] = rne.compile(function, model)
        compile_ms[name] = (time.perf_counter() - start) * 1e3
    as_written = {name: (lambda *s, f=f: f(model, *s)) for name, f in AS_WRITTEN.items()}
    calls: dict[str, Callable[..., Any]] = as_written | kernels
    one = [a[0].copy() for a in states]
    single = interleaved({name: many(lambda c=c: c(*one), 50) for name, c in calls.items()}, repeats)
    batch = interleaved({name: lambda c=c: c(*states) for name, c in calls.items()}, repeats)
    rows: dict[str, Any] = {}
    for name, call in calls.items():
        counted = count_as_written(AS_WRITTEN[name], model) if name in AS_WRITTEN else Counter()
        operations = counted["operations"] or sum(kernels[name].operations.values())
        rows[name] = {
            "operations": operations,
            "numpy_calls": counted["calls"] or None,
            "compile_ms": compile_ms.get(name),
            "single_us": statistics.median(single[name]) / 50 * 1e6,
            "batch_us_a_state": statistics.median(batch[name]) / count * 1e6,
            "error_eps": float(np.abs(call(*states) - exact).max() / np.abs(exact).max() / np.finfo(float).eps),
            "single_times_the_kernel": ratio(single, name, "newton_euler_kernel"),
            "batch_times_the_kernel": ratio(batch, name, "newton_euler_kernel"),
        }
    pairs = (("lagrange", "newton_euler"), ("lagrange_kernel", "newton_euler_kernel"))
    rows["lagrange_over_newton_euler"] = {
        "as_written": {"single": ratio(single, *pairs[0]), "batch": ratio(batch, *pairs[0])},
        "kernels": {"single": ratio(single, *pairs[1]), "batch": ratio(batch, *pairs[1])},
    }
    return rows


def growth(lengths: tuple[int, ...]) -> dict[int, list[int]]:
    """Operations of both kernels on straight chains: Lagrange first."""
    pair = (rne.lagrange_inverse_dynamics, rne.inverse_dynamics)
    return {n: [sum(rne.compile(f, straight_chain(n)).operations.values()) for f in pair] for n in lengths}


def print_table(rows: dict[str, Any], count: int) -> None:
    """The table, and the ratios that table 7.1 asks for."""
    print(f"| robot | formulation | operations | in NumPy calls | µs one state | µs a state of {count} | error [eps] |")
    print("|---|---|---|---|---|---|---|")
    for name, title in NAMES.items():
        row = rows[name]
        print(
            f"| irb140 | {title} | {row['operations']} | {row['numpy_calls'] or '-'} | {row['single_us']:.1f} "
            f"| {row['batch_us_a_state']:.3f} | {row['error_eps']:.1f} |"
        )
    print(f"\nLagrange over Newton-Euler (the thesis's simulations: {THESIS:.0f}), smallest and largest of the runs:")
    for way, ratios in rows["lagrange_over_newton_euler"].items():
        texts = [f"{title} {m:.1f} ({low:.1f}-{high:.1f})" for title, (m, low, high) in ratios.items()]
        print(f"{way.replace('_', ' ')}: {', '.join(texts)}")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="small batches, few repeats, nothing written")
    quick = parser.parse_args().quick
    count, repeats = (500, 2) if quick else (10_000, 15)
    rows = run(count, repeats)
    print_table(rows, count)
    grown = growth((2, 4) if quick else (2, 4, 8, 12, 16))
    print("operations on straight chains, Lagrange and Newton-Euler:", end=" ")
    print("; ".join(f"{n} joints {a}, {b}" for n, (a, b) in grown.items()))
    if not quick:
        write("lagrange.json", {"states": count, "repeats": repeats, "irb140": rows, "chains": grown})


if __name__ == "__main__":
    main()
