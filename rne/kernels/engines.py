"""What runs a traced program: NumPy, the default, or machine code that Numba compiles."""

from __future__ import annotations

import importlib.util
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple, Protocol

from ..basics.spatial import Array
from ..dynamics.quantity import PrecisionStatus

ENGINES = ("numpy", "numba")

# The recursion's answer for states begin to end, counted in the whole batch, where the program has none.
Fallback = Callable[[int, int], tuple[Array, PrecisionStatus]]


class Batches(Protocol):
    """A program that runs on arrays of states."""

    def run(self, states: Sequence[Array], results: Array, fallback: Fallback) -> PrecisionStatus: ...


class Engine(NamedTuple):
    """The two forms of a program.

    Attributes
    ----------
    state_function : callable
        (program, widths, shape, guard) -> a function of one float64 vector per argument, which raises Refused where the
        recursion must look closer.
    batches : callable
        (program, widths, entries, pivots, rates) -> Batches.
    """

    state_function: Callable[..., Callable[..., Array]]
    batches: Callable[..., Any]


def engine_argument(engine: str) -> str:
    """The engine's name, checked, and that what it needs is installed."""
    if engine not in ENGINES:
        raise ValueError(f"`engine` must be one of {list(ENGINES)}, got {engine!r}")
    if engine == "numba" and importlib.util.find_spec("numba") is None:
        raise ImportError("engine 'numba' needs Numba, which is not installed: pip install 'rne[numba]'")
    return engine


def engine_of(name: str) -> Engine:
    """The engine of a name that has been checked; Numba is imported when its first kernel is compiled."""
    if name == "numba":
        from . import numba_backend

        return Engine(numba_backend.compiled_function, numba_backend.BatchProgram)
    from . import numpy_backend, python_backend

    return Engine(python_backend.compiled_function, numpy_backend.BlockProgram)
