"""Step-size control by error estimates, as functions of loops in machine code and for rows in NumPy.

Norms, factors and first lengths are those of Hairer, Norsett and Wanner 1993, II.4 and II.5, as in `scipy.integrate`.
The first `counted` components of a state are controlled to the tolerances. The others are integrals, such as energies:
their errors are relative to `integral_scale` plus their size, so that they hardly shorten a step unless the first ones
are exact on it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np

from ..basics.spatial import Array
from .array_loops import combine, move
from .loops import NO_PIECES, evaluate, inline, put_time, rows_begun

SAFETY, SMALLEST, LARGEST = 0.9, 0.2, 10.0  # safety, smallest and largest factor between step lengths, as SciPy's
EPS = float(np.finfo(np.float64).eps)
ROUNDINGS, TINY = 10 * EPS, 1e-300  # shortest step relative to the time, and at time 0 [s]
NEARLY = 1 - 1e-12  # share of the time to the end up to which samples are taken; later ones are at the end
MOST_STEPS = 1e10  # most steps that a motion may need at its present rate
THIRD = 0.01  # weight of DOP853's second error estimate in the norm
# First length: norm below which a state is negligible, length used then; largest relative change of state or
# derivative; norm of a negligible derivative; largest ratio of the length to the guess.
UNKNOWN, GUESS, CHANGE, FLAT, GROWTH = 1e-5, 1e-6, 0.01, 1e-15, 100


class Interval(NamedTuple):
    """Interval of time without a switch, and the options of its steps; the last four are those of batches."""

    tableau: Any  # of the method
    begin: float
    end: float
    first: float  # from here to `last` the right-hand side is evaluated
    last: float
    rtol: float
    atol: float
    counted: int  # number of the first components of the state, whose errors count
    max_step: float = float("inf")
    # Added to the size of a component after `counted`, to which its error is relative; infinite: it does not count
    integral_scale: float = float("inf")
    t_eval: Array = np.zeros(0)  # (S,), times to report, ascending, the end as the last
    grid: Array = np.zeros(0)  # the begin, and the ends of steps that are not controlled; empty for those that are
    positions: int = 0  # number of components that move with the rates at the end of the step
    watched: int = 0  # 1 to leave motions whose steps a fast decay holds short; a bool takes a detour in machine code
    # Pieces of a motion that the right-hand side takes as its argument before the last; of batches (1, N, width), or
    # (motions, N, width)
    table: Array = NO_PIECES
    breaks: Array = np.zeros((0, 3))  # times at which the right-hand side jumps, the last one before, the first after


class Problem(NamedTuple):
    """Function dx/dt for loops: its address, arrays for t, x and other arguments (overwritten); the interval."""

    rates: Any
    arguments: Any
    interval: Any


class Storage(NamedTuple):
    """Storage of steps: ends, states, derivatives, the lengths to try first, numbers of evaluations, and workspace."""

    T: Array
    X: Array
    K: Array
    H: Array
    evaluations: Array
    work: Any


@inline
def until_break(interval: Any, t: Any) -> Any:
    """Interval from t to the next break, or to its end; evaluated on its own side of each break."""
    breaks, passed = interval.breaks, rows_begun(interval.breaks, t)
    first = max(interval.first, breaks[passed - 1, 2]) if passed > 0 else interval.first
    end, before = interval.end, interval.last
    if passed < len(breaks):
        end, before = breaks[passed, 0], breaks[passed, 1]
    return Interval(interval.tableau, t, end, first, before, *interval[5:])


@inline
def shortest_step(t: Any) -> Any:
    """Length below which a step is given up."""
    return ROUNDINGS * abs(t) + TINY


@inline
def step_factor(error: Any, exponent: Any) -> Any:
    """Factor to the next step length; smallest for an error that is not a number."""
    if error == 0.0:
        return LARGEST
    factor = SAFETY * error**exponent
    return min(factor, LARGEST) if factor > SMALLEST else SMALLEST


@inline
def integral_errors(errors: Any, x: Any, y: Any, interval: Any) -> float:
    """Sum of squares of the integrals' errors on a step from x to y, in units of their tolerance."""
    total, scale = 0.0, interval.integral_scale
    if scale == float("inf"):
        return total
    for i in range(interval.counted, len(x)):
        total += (errors[i] / (interval.rtol * (scale + max(abs(x[i]), abs(y[i]))))) ** 2
    return total


@inline
def error_norm(E: Any, K: Any, h: Any, x: Any, y: Any, interval: Any, work: Any) -> float:
    """Estimated error of a step from x to y relative to the tolerance, from one or two estimates, as E has."""
    count, rtol, atol, sums = interval.counted, interval.rtol, interval.atol, (0.0, 0.0)
    for e in range(len(E)):
        combine(E[e], len(K), K, work)
        total = integral_errors(work, x, y, interval)
        for i in range(count):
            total += (work[i] / (atol + rtol * max(abs(x[i]), abs(y[i])))) ** 2
        sums = (total, sums[0])
    if len(E) == 1:
        return float(h * (sums[0] / count) ** 0.5)
    third, fifth = sums
    return float(h * fifth / ((fifth + THIRD * third) * count) ** 0.5) if fifth > 0 else 0.0


@inline
def first_length(problem: Any, t: Any, x: Any, K: Any) -> float:
    """Length of the first step from the derivative K[0]; 0 if the derivative after a guess is not valid."""
    rates, arguments, interval = problem
    count, rtol, atol, longest = interval.counted, interval.rtol, interval.atol, interval.end - t
    d0, d1, y = integral_errors(x, x, x, interval), integral_errors(K[0], x, x, interval), arguments[1]
    for i in range(count):
        scale = atol + rtol * abs(x[i])
        d0 += (x[i] / scale) ** 2
        d1 += (K[0, i] / scale) ** 2
    d0, d1 = (d0 / count) ** 0.5, (d1 / count) ** 0.5
    h = min(GUESS if d0 < UNKNOWN or d1 < UNKNOWN else CHANGE * d0 / d1, longest)
    put_time(arguments, interval, t + h)
    move(x, h, K[0], y)
    if not evaluate(rates, arguments, K[1]):
        return 0.0
    move(K[1], -1.0, K[0], K[1, : len(x)])
    d2 = integral_errors(K[1], x, x, interval)
    for i in range(count):
        d2 += (K[1, i] / (atol + rtol * abs(x[i]))) ** 2
    d2 = (d2 / count) ** 0.5 / h
    steepest = max(d1, d2)
    step = max(GUESS, h * 1e-3) if steepest <= FLAT else (CHANGE / steepest) ** -interval.tableau.exponent
    return float(min(GROWTH * h, step, longest, interval.max_step))


def aligned(times: Array, instants: Sequence[Array]) -> Array:
    """Times with those that equal one of the instants up to rounding replaced by it."""
    others = np.unique(np.concatenate([[-np.inf, np.inf], *instants]))
    k = np.searchsorted(others, times)
    nearest = np.where(np.abs(others[k - 1] - times) < np.abs(others[k] - times), others[k - 1], others[k])
    return np.asarray(np.where(np.abs(nearest - times) <= (1 - NEARLY) * times, nearest, times))


def equal_steps(end: float, step: float, *instants: Array) -> Array:
    """Ends of the longest equal steps between instants, from 0 on, (K + 1,), none longer than a step."""
    inner = np.concatenate(instants)
    edges = np.unique([0.0, *inner[(inner > 0) & (inner < end)], end])
    lengths = np.diff(edges)
    counts = np.maximum(1, np.ceil(lengths / step * NEARLY)).astype(int)
    last = np.cumsum(counts)
    number = np.arange(1, 1 + last[-1]) - np.repeat(last - counts, counts)
    ends = number * np.repeat(lengths / counts, counts) + np.repeat(edges[:-1], counts)
    ends[last - 1] = edges[1:]
    return np.concatenate([[0.0], ends])


def squares(values: Array) -> Array:
    """Sum of each column's squares, in an order that does not depend on the number of columns."""
    total = np.zeros(values.shape[1])
    for row in values:
        total += row * row
    return total


def first_lengths(rates: Callable[[Array, Array], Array], interval: Interval, x: Array, f: Array) -> Array:
    """Lengths of the first steps of many motions; states and derivatives are the columns of x and f."""
    count, longest, exponent = interval.counted, interval.end - interval.begin, interval.tableau.exponent
    scale = interval.atol + interval.rtol * np.abs(x[:count])

    def size(v: Array) -> Array:
        return np.asarray(np.sqrt(squares(v[:count] / scale) / count))

    with np.errstate(all="ignore"):
        d0, d1 = size(x), size(f)
        h = np.minimum(np.where((d0 < UNKNOWN) | (d1 < UNKNOWN), GUESS, CHANGE * d0 / d1), longest)
        d2 = size(rates(interval.begin + h, x + h * f) - f) / h
        steepest = np.maximum(d1, d2)
        step = np.where(steepest <= FLAT, np.maximum(GUESS, h * 1e-3), (CHANGE / steepest) ** -exponent)
        return np.asarray(np.minimum(np.minimum(GROWTH * h, step), longest))
