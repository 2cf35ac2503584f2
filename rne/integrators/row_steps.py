"""Steps of many states, each a row, and their derivatives: as many side by side as a vector register holds.

A row has the state of the equations, a law's states, the commands that wait, the oldest first, and perhaps the one that
acts. In machine code a state that needs the recursion is marked and left; the result of a row does not depend on the
others. By NumPy all rows are side by side.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from ..basics.spatial import Array
from .array_loops import fill
from .frozen_steps import Function, Holding, Kept, Schedule, advance, pull_back
from .loops import by_loops, inline

Flat = tuple[Array, ...]  # arrays of states side by side: entry i L + k is component i of state k of L


class Ranges(NamedTuple):
    """The first coordinates' ranges, at whose ends an interval ends inelastically."""

    ends: Array  # (2, n L), lower and upper; (2, 0) without
    first: int  # of their velocities in the state, times L
    met: Array  # (n L,), at which end a coordinate is, -1 or 1, twice that if its velocity was lost there


class RowGroup(NamedTuple):
    """L states side by side, as `frozen_steps` takes them."""

    rates: Function
    law: Function
    schedule: Schedule
    holding: Holding
    room: tuple[Any, ...]
    kept: Kept
    begin: Flat  # the parts of a row: the state, the law's states, the commands that wait, and the one that acts
    end: Flat  # the same after the interval
    given: Flat  # what else differs from row to row: commands, which must be finite, and numbers
    ranges: Ranges


class Slopes(NamedTuple):
    """Derivatives of a number by what states side by side are made of; see `frozen_steps.Adjoint`."""

    gradient: Function
    law: Function
    adjoint: Any
    end: Flat  # by the parts of a row at the end
    begin: Flat
    others: Flat  # by commands that are given, numbers, bounds and pieces


def _take(rows: Any, first: Any, last: Any, column: Any, lanes: Any, part: Any) -> None:
    for k in range(lanes):
        row = min(first + k, last - 1, len(rows) - 1)
        for i in range(len(part) // lanes):
            part[i * lanes + k] = rows[row, column + i]


@by_loops(_take)
def take(rows: Any, first: Any, last: Any, column: Any, lanes: Any, part: Any) -> None:
    """Rows from the first to before the last, which fills up, into lanes; a single one is that of all."""
    few = rows[np.minimum(np.arange(first, first + lanes), min(last, len(rows)) - 1)]
    part.reshape(-1, lanes)[:] = few[:, column : column + len(part) // lanes].T


def _give(part: Any, first: Any, last: Any, column: Any, lanes: Any, rows: Any) -> None:
    for k in range(min(lanes, last - first)):
        for i in range(len(part) // lanes):
            rows[first + k, column + i] = part[i * lanes + k]


@by_loops(_give)
def give(part: Any, first: Any, last: Any, column: Any, lanes: Any, rows: Any) -> None:
    """From lanes into rows."""
    few = part.reshape(-1, lanes)[:, : last - first]
    rows[first:last, column : column + len(few)] = few.T


def _is_finite(part: Any) -> bool:
    total = 0.0
    for e in range(len(part)):
        total += part[e] - part[e]
    return total == 0.0


@by_loops(_is_finite)
def is_finite(part: Any) -> bool:
    """False in machine code if an entry is not finite; NumPy leaves that to the caller."""
    return True


@inline
def take_parts(rows: Any, first: Any, last: Any, lanes: Any, parts: Any) -> None:
    """The columns of rows into their parts."""
    column = 0
    for k in range(len(parts)):
        take(rows, first, last, column, lanes, parts[k])
        column += len(parts[k]) // lanes


@inline
def give_parts(parts: Any, first: Any, last: Any, lanes: Any, rows: Any) -> None:
    """Parts into the columns of rows."""
    column = 0
    for k in range(len(parts)):
        give(parts[k], first, last, column, lanes, rows)
        column += len(parts[k]) // lanes


@inline
def are_finite(parts: Any) -> bool:
    """As `is_finite`, of several parts."""
    found = True
    for k in range(len(parts)):
        found = found and is_finite(parts[k])
    return found


def _end_at(ends: Any, first: Any, x: Any, met: Any) -> None:
    for e in range(len(met)):
        lower, upper, q = ends[0, e], ends[1, e], x[e]
        met[e] = 1.0 if q > upper else -1.0 if q < lower else 0.0
        if met[e] != 0.0:
            x[e] = upper if q > upper else lower
            if x[first + e] * met[e] > 0.0:
                x[first + e], met[e] = 0.0, 2.0 * met[e]


@by_loops(_end_at)
def end_at(ends: Any, first: Any, x: Any, met: Any) -> None:
    """End an interval inelastically: coordinates within their ranges, without velocities that lead out of them."""
    q, qd = x[: len(met)], x[first : first + len(met)]
    met[:] = (q > ends[1]) * 1.0 - (q < ends[0])
    q[:] = np.clip(q, ends[0], ends[1])
    met[met * qd > 0] *= 2
    qd[np.abs(met) > 1] = 0.0


@inline
def pull_back_ends(ranges: Any, slope: Any) -> None:
    """Backwards through `end_at`."""
    for e in range(len(ranges.met)):
        if ranges.met[e] != 0.0:
            slope[e] = 0.0
        if abs(ranges.met[e]) > 1.0:
            slope[ranges.first + e] = 0.0


@inline
def interval(group: Any, rows: Any, given: Any, first: Any, last: Any) -> bool:
    """One interval of some rows; False if a state needs the recursion, or one, or a command, is not finite."""
    lanes, holding, x = len(group.rates.begins), group.holding, group.begin[0]
    take_parts(rows, first, last, lanes, group.begin)
    for k in range(len(given)):
        take(given[k], first, last, 0, lanes, group.given[k])
    holding.counts[0], holding.counts[1] = len(holding.pending) - 1, 0
    if not (are_finite(group.begin) and is_finite(group.given[0])):
        return False
    taken = advance(group.rates, group.law, group.schedule, holding, x, group.room, group.kept)
    end_at(group.ranges.ends, group.ranges.first, x, group.ranges.met)
    return taken == len(group.schedule.lengths) and are_finite(group.end)


def step_rows(group: Any, rows: Any, given: Any, span: Any, out: Any, left: Any) -> int:
    """One interval of rows, from the first of a span to before its end; how many are left, marked, to the caller."""
    lanes, count, (begin, last), alone = len(group.rates.begins), 0, span, 0
    while begin < last:
        end = begin + 1 if alone > 0 else min(begin + lanes, last)
        if interval(group, rows, given, begin, end):
            give_parts(group.end, begin, end, lanes, out)
        elif end - begin > 1:
            alone = end - begin  # one by one, so that no row depends on its neighbours
            continue
        else:
            left[begin] = 1
            count += 1
        alone, begin = alone - 1, end
    return count


@inline
def pull_back_interval(group: Any, slopes: Any, rows: Any, given: Any, weights: Any, first: Any, last: Any) -> bool:
    """Derivatives of weighted states at the end of an interval; False as of `interval`."""
    if not interval(group, rows, given, first, last):
        return False
    for k in range(len(slopes.others)):
        fill(0.0, slopes.others[k])
    for k in range(len(slopes.begin)):
        fill(0.0, slopes.begin[k])
    take_parts(weights, first, last, len(group.rates.begins), slopes.end)
    pull_back_ends(group.ranges, slopes.adjoint.x)
    failed = pull_back(slopes.gradient, slopes.law, group.schedule, group.holding, group.kept, slopes.adjoint)
    return failed == 0 and are_finite(slopes.begin)


def pull_back_rows(
    group: Any, slopes: Any, rows: Any, given: Any, weights: Any, span: Any, out: Any, others: Any, left: Any
) -> int:
    """Derivatives of weighted rows at the end of their interval, by the rows into `out`, and by what else differs."""
    lanes, count, (begin, last), alone = len(group.rates.begins), 0, span, 0
    while begin < last:
        end = begin + 1 if alone > 0 else min(begin + lanes, last)
        if pull_back_interval(group, slopes, rows, given, weights, begin, end):
            give_parts(slopes.begin, begin, end, lanes, out)
            for k in range(len(others)):
                give(slopes.others[k], begin, end, 0, lanes, others[k])
        elif end - begin > 1:
            alone = end - begin
            continue
        else:
            left[begin] = 1
            count += 1
        alone, begin = alone - 1, end
    return count
