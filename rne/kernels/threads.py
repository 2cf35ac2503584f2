"""A batch shared by threads: each takes a stretch of the states."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor

import numpy as np

from ..basics.spatial import Array
from ..dynamics.quantity import PrecisionStatus
from .engines import Batches, Fallback


def check_workers(workers: int) -> None:
    """Refuse anything but a positive whole number."""
    if isinstance(workers, bool) or not isinstance(workers, int | np.integer) or workers < 1:
        raise ValueError(f"`workers` must be a positive whole number, got {workers!r}")


def run_in_threads(
    batches: Batches, states: Sequence[Array], results: Array, fallback: Fallback, workers: int
) -> PrecisionStatus:
    """Fill `results` as `batches.run` does, in `workers` threads."""
    count = len(results)
    workers = min(workers, count)
    if workers <= 1:
        return batches.run(states, results, fallback)
    edges = [count * k // workers for k in range(workers + 1)]

    def run(stretch: tuple[int, int]) -> PrecisionStatus:
        first, last = stretch
        arrays = [a[first:last] for a in states]
        return batches.run(arrays, results[first:last], lambda i, j: fallback(first + i, first + j))

    own, *others = itertools.pairwise(edges)
    with ThreadPoolExecutor(workers - 1) as pool:
        futures = [pool.submit(run, stretch) for stretch in others]
        status = run(own)
        for future in futures:
            if status.error is None:  # of several errors that of the first state is told
                status = status.worse(future.result())
    return status
