"""Chart A's calls of this package: the kernel by NumPy and by Numba, and the recursion it was traced from."""

from __future__ import annotations

import time
from functools import partial

import numpy as np

import rne
from benchmarks.measure import many
from benchmarks.peers import Case, Point

DTYPES = ("float32", "float64", "longdouble")
TIMES, SLOW_TIMES = 200, 20  # calls of one state in a repeat, of the kernel and of the recursion
KERNEL, KERNEL_SINGLE = "kernel, batch", "kernel, one state"
NUMBA, NUMBA_SINGLE = "Numba kernel, batch", "Numba kernel, one state"
OWN = ("kernel", "recursion", "Numba kernel")  # how their names begin


def ours(case: Case, few: int) -> list[Point]:
    """The kernel on a batch and on one state, and the recursion it was traced from."""
    kernel, arrays, model, function = case.kernel, case.arrays, case.robot.model, case.kernel.function
    arrays32 = [a.astype(np.float32) for a in arrays]
    out, out32 = kernel(*arrays), kernel(*arrays32)
    one = [a[0].copy() for a in arrays]
    start = time.perf_counter()
    rne.compile(function, model)(*(a[:2] for a in arrays))
    build_s = time.perf_counter() - start
    found = [
        Point(KERNEL, lambda: kernel(*arrays, out=out), len(out), lambda k: out[:k], build_s=build_s),
        Point("kernel, batch, float32", lambda: kernel(*arrays32, out=out32), len(out), lambda k: out32[:k], "float32"),
        Point(
            KERNEL_SINGLE,
            many(lambda: kernel(*one), TIMES),
            TIMES,
            lambda k: np.array([kernel(*(a[i].copy() for a in arrays)) for i in range(k)]),
        ),
    ]
    for dtype in DTYPES:
        typed = [a[:few].astype(dtype) for a in arrays]
        name = "recursion, batch" if dtype == "float64" else f"recursion, batch, {dtype}"
        call = partial(function, model, *typed)
        found.append(Point(name, call, len(typed[0]), lambda k, call=call: call()[:k], dtype))

    def singles(few: int) -> np.ndarray:
        return np.array([function(model, *(a[i] for a in arrays)) for i in range(few)])

    call = many(partial(function, model, *one), SLOW_TIMES)
    return [*found, Point("recursion, one state", call, SLOW_TIMES, singles)]


def by_numba(case: Case) -> list[Point]:
    """Kernel by Numba, on a batch and on one state."""
    arrays, begun = case.arrays, time.perf_counter()
    kernel = rne.compile(case.kernel.function, case.robot.model, engine="numba")
    kernel(*(a[:2] for a in arrays))
    build_s = time.perf_counter() - begun
    arrays32 = [a.astype(np.float32) for a in arrays]
    out, out32 = kernel(*arrays), kernel(*arrays32)
    one = [a[0].copy() for a in arrays]

    def singles(few: int) -> np.ndarray:
        return np.array([kernel(*(a[i].copy() for a in arrays)) for i in range(few)])

    half = "Numba kernel, batch, float32"
    return [
        Point(NUMBA, lambda: kernel(*arrays, out=out), len(out), lambda k: out[:k], build_s=build_s),
        Point(half, lambda: kernel(*arrays32, out=out32), len(out), lambda k: out32[:k], "float32"),
        Point(NUMBA_SINGLE, many(lambda: kernel(*one), TIMES), TIMES, singles),
    ]
