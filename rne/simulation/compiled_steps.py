"""Equal steps of an ensemble as one loop compiled by Numba around the compiled right-hand side.

Initial states are taken in blocks that stay in the cache. A step in which some state must be examined is left to the
steps in NumPy, which examine it.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numba import njit

from ..kernels.kernel import Kernel

BLOCK = 128  # initial states


def compiled_steps(kernel: Kernel, method: str, dtype: np.dtype[Any]) -> Any:
    """f(x, t, p, k, total, stage, h, first, last) -> number of steps taken, from step `first` on, at most to `last`.

    Compiled once for each kernel, method and dtype; x holds the states, p their inertial parameters if the kernel takes
    these; the other arrays are for intermediate results.
    """
    rates = _rates(kernel.blocks.function(dtype), "parameters" in kernel.names)
    if method == "rk4":
        return kernel.blocks.loop((method, dtype), lambda: njit(nogil=True)(_rk4(rates, dtype.type)))
    n = kernel.model.n
    return kernel.blocks.loop((method, dtype), lambda: njit(nogil=True)(_semi_implicit(rates, n, dtype.type)))


def _rates(function: Any, with_parameters: bool) -> Any:
    """The kernel as f(t, x, p, k) -> True if all rates are sound."""

    def at_parameters(t: Any, x: Any, p: Any, k: Any) -> bool:
        return function(t, x, p, k, 0, len(x)) == len(x)  # type: ignore[no-any-return]

    def plain(t: Any, x: Any, p: Any, k: Any) -> bool:
        return function(t, x, k, 0, len(x)) == len(x)  # type: ignore[no-any-return]

    return njit(nogil=True)(at_parameters if with_parameters else plain)


def _rk4(rates: Any, number: Any) -> Callable[..., int]:
    """The classical Runge-Kutta method of order 4, as `equal_steps._rk4`."""
    ahead = np.array([0.5, 0.5, 1.0, 0.0])  # of the state at which the next slope is taken, in steps
    at = np.array([0.0, 0.5, 0.5, 1.0])
    weight = np.array([1.0, 2.0, 2.0, 1.0])

    def steps(x: Any, t: Any, p: Any, k: Any, total: Any, stage: Any, h: float, first: int, last: int) -> int:
        flat, slope, summed, moved = x.ravel(), k.ravel(), total.ravel(), stage.ravel()
        for step in range(first, last):
            summed[:] = 0.0
            moved[:] = flat
            for s in range(4):
                t[:] = step * h + at[s] * h
                if not rates(t, stage, p, k):
                    return step
                w, a = number(weight[s]), number(ahead[s] * h)
                for i in range(len(flat)):
                    summed[i] += w * slope[i]
                    moved[i] = flat[i] + a * slope[i]
            sixth = number(h / 6)
            for i in range(len(flat)):
                flat[i] += sixth * summed[i]
        return last

    return steps


def _semi_implicit(rates: Any, n: int, number: Any) -> Callable[..., int]:
    """Semi-implicit Euler: rates first, then positions with the new rates, as `equal_steps._semi_implicit`."""

    def steps(x: Any, t: Any, p: Any, k: Any, total: Any, stage: Any, h: float, first: int, last: int) -> int:
        width = number(h)
        for step in range(first, last):
            t[:] = step * h
            if not rates(t, x, p, k):
                return step
            for i in range(len(x)):
                for j in range(n, x.shape[1]):
                    x[i, j] += width * k[i, j]
                for j in range(n):
                    x[i, j] += width * x[i, n + j]
        return last

    return steps
