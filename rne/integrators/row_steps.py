"""Steps of a batch of states and their derivatives, in lanes: as many states at once as a vector register holds.

A state is a row of the batch:

    | q  [motor_q] | qd  [motor_qd] |   z    |     held     |  waiting 1  | ... |  waiting d  |
       `size` / L, of the equations  the law's  the command   commands that wait, the oldest
       of motion                     states     that acts     first

`held` is there if the delay is no whole number of intervals, so that a command acts into the next one; d is the number
of whole intervals of the delay. In machine code a row whose M needs the recursion, or that is not finite, is marked and
left to the caller; the result of a row does not depend on the others. By NumPy all rows are computed at once.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from ..basics.spatial import Array
from .array_loops import fill, put
from .frozen_steps import Adjoint, Function, Holding, Kept, Schedule, advance, pull_back
from .loops import by_loops, inline


class RowGroup(NamedTuple):
    """L rows as lanes: entry i L + k of an array is column i of row k."""

    rates: Function
    law: Function
    schedule: Schedule
    holding: Holding
    room: tuple[Any, ...]  # of `advance`
    kept: Kept
    state: Array
    waiting: Array  # `pending` of `holding` as a vector
    size: int  # of the state of the equations, times L
    held: int  # of the command that lasts, times L
    u: Array  # commands that are given
    own: Array  # what else differs from row to row: times, and numbers
    ends: Array  # (2, n L), of the first coordinates' ranges; (2, 0) if they do not stop at them
    velocities: int  # of the first coordinates, place in the state
    met: Array  # (n L,), at which end they are, -1 or 1, twice that if a velocity was lost there


class RowSlopes(NamedTuple):
    """Derivatives of a scalar by other inputs that differ between rows; those by the rows are in the group's state."""

    gradient: Function
    law: Function
    adjoint: Adjoint
    waiting: Array
    others: Array  # of commands that are given, numbers, bounds and pieces, which the adjoint has views of


def _take(rows: Any, first: Any, last: Any, lanes: Any, out: Any) -> None:
    for k in range(lanes):
        row = min(first + k, last - 1, len(rows) - 1)
        for i in range(rows.shape[1]):
            out[i * lanes + k] = rows[row, i]


@by_loops(_take)
def take(rows: Any, first: Any, last: Any, lanes: Any, out: Any) -> None:
    """Load a range of rows into lanes, repeating the last one to fill them; a single row is common to all."""
    out.reshape(-1, lanes)[:] = rows[np.minimum(np.arange(first, first + lanes), min(last, len(rows)) - 1)].T


def _give(state: Any, first: Any, last: Any, lanes: Any, rows: Any) -> None:
    for k in range(min(lanes, last - first)):
        for i in range(rows.shape[1]):
            rows[first + k, i] = state[i * lanes + k]


@by_loops(_give)
def give(state: Any, first: Any, last: Any, lanes: Any, rows: Any) -> None:
    """Store lanes back into rows."""
    rows[first:last] = state.reshape(-1, lanes)[: rows.shape[1], : last - first].T


def _is_finite(x: Any) -> bool:
    total = 0.0
    for e in range(len(x)):
        total += x[e] - x[e]
    return total == 0.0


@by_loops(_is_finite)
def is_finite(x: Any) -> bool:
    """False in machine code if an entry is not finite; NumPy leaves that to the caller."""
    return True


@inline
def spread(state: Any, states: Any, held: Any, waiting: Any) -> None:
    """Split the part of a row after the state of the equations, z, held and waiting, into separate arrays."""
    put(state, states)
    put(state[len(states) :], held)
    put(state[len(states) + len(held) :], waiting)


@inline
def collect(states: Any, held: Any, waiting: Any, state: Any) -> None:
    """Collect z, held and waiting back into rows."""
    first, last = len(states), len(states) + len(held)
    put(states, state[:first])
    put(held, state[first:last])
    put(waiting, state[last:])


def _end_at(ends: Any, first: Any, x: Any, met: Any) -> None:
    for e in range(len(met)):
        lower, upper, q = ends[0, e], ends[1, e], x[e]
        met[e] = 1.0 if q > upper else -1.0 if q < lower else 0.0
        x[e] = min(max(q, lower), upper)
        if x[first + e] * met[e] > 0.0:
            x[first + e], met[e] = 0.0, 2.0 * met[e]


@by_loops(_end_at)
def end_at(ends: Any, first: Any, x: Any, met: Any) -> None:
    """End an interval inelastically: clip coordinates to their ranges and stop velocities that lead out of them."""
    q, qd = x[: len(met)], x[first : first + len(met)]
    met[:] = (q > ends[1]) * 1.0 - (q < ends[0])
    q[:] = np.clip(q, ends[0], ends[1])
    met[met * qd > 0] *= 2
    qd[np.abs(met) > 1] = 0.0


@inline
def interval(group: Any, rows: Any, u: Any, own: Any, first: Any, last: Any) -> bool:
    """Integrate one interval of some rows; True if they are valid and finite."""
    lanes, holding, state = len(group.rates.begins), group.holding, group.state
    take(rows, first, last, lanes, state)
    take(u, first, last, lanes, group.u)
    take(own, first, last, lanes, group.own)
    if not (is_finite(state) and is_finite(group.u)):
        return False
    x, waiting, held = state[: group.size], group.waiting, group.rates.inputs[2][: group.held]
    late = len(waiting) - holding.pending.shape[1]
    spread(state[group.size :], holding.states[1], held, waiting[:late])
    holding.counts[0], holding.counts[1] = len(holding.pending) - 1, 0
    taken = advance(group.rates, group.law, group.schedule, holding, x, group.room, group.kept)
    end_at(group.ends, group.velocities, x, group.met)
    collect(holding.states[1], held, waiting[len(waiting) - late :], state[group.size :])
    return taken == len(group.schedule.lengths) and is_finite(state)


@inline
def pull_back_interval(group: Any, slopes: Any, weights: Any, first: Any, last: Any) -> bool:
    """Pull derivatives of weighted rows back through an interval; True if valid and finite."""
    state, adjoint, lanes = group.state, slopes.adjoint, len(group.rates.begins)
    waiting, x = slopes.waiting, state[: group.size]
    late, held = len(waiting) - adjoint.pending.shape[1], adjoint.held[: group.held]
    take(weights, first, last, lanes, state)
    fill(0.0, slopes.others)
    fill(0.0, waiting)
    spread(state[group.size :], adjoint.states, held, waiting[len(waiting) - late :])
    for e in range(len(group.met)):
        if group.met[e] != 0.0:
            x[e] = 0.0
        if abs(group.met[e]) > 1.0:
            x[group.velocities + e] = 0.0
    failed = pull_back(slopes.gradient, slopes.law, group.schedule, group.holding, group.kept, adjoint)
    collect(adjoint.states, held, waiting[:late], state[group.size :])
    return failed == 0 and is_finite(state)


def step_rows(
    group: Any, slopes: Any, rows: Any, u: Any, own: Any, weights: Any, span: Any, out: Any, others: Any, left: Any
) -> int:
    """Integrate one interval of a span of rows; returns the number of rows, marked, that the caller must compute.

    With `weights` of rows, not an empty vector, derivatives of the weighted rows are pulled back instead: those by the
    rows into `out`, by other inputs into `others`.
    """
    lanes, count, (begin, last), single = len(group.rates.begins), 0, span, 0
    while begin < last:
        end = begin + 1 if single > 0 else min(begin + lanes, last)
        valid = interval(group, rows, u, own, begin, end)
        if weights.ndim == 2:  # known when machine code is made
            valid = valid and pull_back_interval(group, slopes, weights, begin, end)
        if valid:
            give(group.state, begin, end, lanes, out)
            if weights.ndim == 2:
                give(slopes.others, begin, end, lanes, others)
        elif end - begin > 1:
            single = end - begin  # one by one, so that no row depends on its neighbours
            continue
        else:
            left[begin] = 1
            count += 1
        single, begin = single - 1, end
    return count
