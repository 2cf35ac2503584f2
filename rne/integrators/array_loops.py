"""Vector operations for functions that run by NumPy or in machine code, each with its loops for the latter.

The vector that is written to, `out`, may be shorter than the others: their first entries count.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from .loops import by_loops


def _put(x: Any, out: Any) -> None:
    for e in range(len(out)):
        out[e] = x[e]


@by_loops(_put)
def put(x: Any, out: Any) -> None:
    """Copy the first entries of a vector into another one."""
    out[:] = x[: len(out)]


def _fill(number: Any, out: Any) -> None:
    for e in range(len(out)):
        out[e] = number


@by_loops(_fill)
def fill(number: Any, out: Any) -> None:
    """Fill a vector with one number."""
    out[:] = number


def _add(x: Any, out: Any) -> None:
    for e in range(len(out)):
        out[e] += x[e]


@by_loops(_add)
def add(x: Any, out: Any) -> None:
    """Add the first entries of a vector to another one."""
    out += x[: len(out)]


def _move(x: Any, h: Any, slope: Any, out: Any) -> None:
    for e in range(len(out)):
        out[e] = x[e] + h * slope[e]


@by_loops(_move)
def move(x: Any, h: Any, slope: Any, out: Any) -> None:
    """out = x + h slope, for the length of `out`."""
    out[:] = x[: len(out)] + h * slope[: len(out)]


def _combine(weights: Any, count: Any, K: Any, out: Any) -> None:
    for e in range(len(out)):
        out[e] = 0.0
    for j in range(count):
        w = weights[j]
        if w != 0.0:
            for e in range(len(out)):
                out[e] += w * K[j, e]


@by_loops(_combine)
def combine(weights: Any, count: Any, K: Any, out: Any) -> None:
    """Sum of weights[j] K[j] over j < count, term by term: no entry's rounding depends on the others."""
    out[:] = 0.0
    for w, k in zip(weights[:count].tolist(), K[:count], strict=True):
        if w:
            out += w * k[: len(out)]


def _add_product(A: Any, first: Any, x: Any, p: Any, out: Any) -> None:
    for i in range(len(out) // p):
        for j in range(len(x) // p):
            a = A[i, first + j]
            if a != 0.0:
                for e in range(p):
                    out[i * p + e] += a * x[j * p + e]


@by_loops(_add_product)
def add_product(A: Any, first: Any, x: Any, p: Any, out: Any) -> None:
    """Add A X to a matrix of p columns, both flattened; A consists of columns of a matrix from `first` on."""
    out.reshape(-1, p)[:] += A[: len(out) // p, first : first + len(x) // p] @ x.reshape(-1, p)


def _add_columns(A: Any, first: Any, columns: Any, p: Any, out: Any) -> None:
    for i in range(len(out) // p):
        for j in range(len(columns)):
            if columns[j] >= 0:
                out[i * p + columns[j]] += A[i, first + j]


@by_loops(_add_columns)
def add_columns(A: Any, first: Any, columns: Any, p: Any, out: Any) -> None:
    """Add columns of a matrix, from `first` on, to the given columns of a flattened matrix of p; -1 adds to none."""
    taken = np.flatnonzero(columns >= 0)
    out.reshape(-1, p)[:, columns[taken]] += A[: len(out) // p, first + taken]
