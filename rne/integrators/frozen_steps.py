"""Discrete adjoint and discrete sensitivities of explicit Runge-Kutta methods with frozen step sizes, of a batch.

Frozen: lengths of steps do not depend on the state, so that a motion is a chain of smooth maps, whose derivative is
exactly that of what was computed. `advance` takes the steps, `pull_back` is their reverse mode (the discrete adjoint:
from derivatives of a number by the state at the end to those by the start, numbers, bounds and pieces), `carry` their
forward mode (discrete sensitivities, of p columns; Griewank and Walther 2008, chapter 3; Sandu 2006, On the properties
of Runge-Kutta discrete adjoints, equation 4). With K_s = f(x + h sum_r a_sr K_r) and x+ = x + h sum_s b_s K_s the
adjoint is

    K_s' = h (b_s x+' + sum_r a_rs y_r'),  y_s' = (df/dy)^T K_s',  x' = x+' + sum_s y_s',  p' = sum_s (df/dp)^T K_s'

At the begin of a step a law may be sampled, and a command begin to act, as in `runge_kutta.take_samples`. Arrays of
motions side by side are flat: entry i L + k is component i of motion k of L. The loops run in machine code with
addresses of kernels, and in Python with functions of NumPy arrays.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from ..basics.spatial import Array
from .array_loops import add, add_columns, add_product, combine, fill, move, put
from .loops import StateUpdate, by_loops, evaluate, inline, put_piece, row_at


class Schedule(NamedTuple):
    """K steps of S stages, common to motions computed side by side."""

    tableau: Any
    positions: int  # of the first entries, which a semi-implicit step moves with the rates at its end
    times: Array  # (K, S), of stages, each on its own side of jumps [s]
    begins: Array  # (K,)
    lengths: Array  # (K,)
    sampled: Array  # (K,) of int64, 1 where the law is sampled at the begin
    acting: Array  # (K,) of int64, 1 where a command begins to act

    def part(self, first: int, end: int) -> Schedule:
        """Steps of a part of the schedule."""
        return Schedule(*self[:2], *(array[first:end] for array in self[2:]))


class Function(NamedTuple):
    """Kernel for loops: an address or a function, arrays for its arguments and its result, tables of pieces."""

    call: Any
    inputs: tuple[Array, ...]  # t, x, perhaps u, perhaps a piece, coefficients of numbers, perhaps weights
    out: Array
    tables: Array  # (1, N, width), or one for each motion; (0, 0, 0) if the kernel takes no piece
    piece: int  # number of the argument that is one
    begins: Array  # (L,), times at which motions begin, to which those of a schedule are added


class Holding(NamedTuple):
    """State of a sampled law between its samples."""

    update: StateUpdate  # of the law's states
    limits: Array  # (2, n L), of commands and of their change from one to the next
    pending: Array  # (p, n L), commands, that of sample k in row k % p
    states: Array  # (2, m L), of the law, at the last sample and at the next
    counts: Array  # (2,) of int64, samples and commands that have acted


class Kept(NamedTuple):
    """Values stored in each step for derivatives; arrays without rows where nothing is stored."""

    stages: Array  # (K, S, size L), states
    held: Array  # (K, n L), commands that act
    states: Array  # (K, m L), of the law at its sample
    bounds: Array  # (K, n L), of commands: 0 where free, 1 at the limit, 2 at that of the change, negative below 0

    def part(self, first: int, end: int) -> Kept:
        """Values of a range of steps."""
        return Kept(*(array[first:end] for array in self))


class Adjoint(NamedTuple):
    """Derivatives of a scalar with respect to the quantities of a motion, summed by `pull_back`, and its workspace."""

    x: Array  # (size L,), the state
    held: Array  # (n L,), the command that acts
    pending: Array  # (p, n L)
    states: Array  # (m L,), of the law
    numbers: Array  # (k L,), of the equations
    of_law: Array  # (k L,), numbers of the law
    limits: Array  # (2, n L)
    table: Array  # (N, width L), of pieces that the equations take
    law_table: Array  # (N, width L)
    arrivals: Array  # (K, size L), derivatives by the state where a command begins to act; of no rows if not asked for
    slopes: Array  # (S, size L), stage derivatives


@inline
def put_time(function: Any, t: Any) -> Any:
    """Write a time since the start, and the pieces that hold then, into the arguments; returns the first one's row.

    Outside of the tables pieces are NaN, where no result is valid.
    """
    tables, piece, times = function.tables, function.inputs[function.piece], function.inputs[0]
    fill(t, times)
    add(function.begins, times)
    if len(tables) == 0:
        return -1
    for k in range(len(times)):
        put_piece(tables[k if len(tables) > 1 else 0], times[k], piece, k, len(times))
    return row_at(tables[0], times[0])


def _bound(u: Any, before: Any, limits: Any, is_first: Any, command: Any, bounds: Any) -> None:
    for e in range(len(u)):
        limit, found, code = limits[0, e], u[e], 0.0
        if abs(found) > limit:
            code = 1.0 if found > 0 else -1.0
            found = limit * code
        if not is_first and abs(found - before[e]) > limits[1, e]:
            code = 2.0 if found > before[e] else -2.0
            found = before[e] + limits[1, e] * code / 2
        bounds[e], command[e] = code, found


@by_loops(_bound)
def bound(u: Any, before: Any, limits: Any, is_first: Any, command: Any, bounds: Any) -> None:
    """Command within the limits of its size and of its change, and the code of the limit it is at."""
    over = np.abs(u) > limits[0]
    found = np.where(over, np.copysign(limits[0], u), u)
    code = np.where(over, np.sign(u), 0.0)
    if not is_first:
        change = found - before
        over = np.abs(change) > limits[1]
        found = np.where(over, before + np.copysign(limits[1], change), found)
        code = np.where(over, np.copysign(2.0, change), code)
    bounds[:], command[:] = code, found


@inline
def update_states(update: Any, returned: Any, z: Any) -> None:
    """A law's states at a sample become those at the next, as by `next_state`; or derivatives of the states do."""
    if update.keep == 0.0:
        fill(0.0, z)
    move(z, update.gain, returned, z)


@inline
def sample(law: Any, holding: Any, t: Any, x: Any, command: Any, bounds: Any, states: Any) -> bool:
    """Sample the law: append its command to the pending ones and update its states; True if valid."""
    call, inputs, out = law.call, law.inputs, law.out
    count, pending, z = holding.counts[0], holding.pending, holding.states
    moving, last = len(inputs[1]) - z.shape[1], count % len(pending)
    put(z[1], z[0])
    put(z[0], states)
    put(x, inputs[1][:moving])
    put(z[0], inputs[1][moving:])
    put_time(law, t)
    if not evaluate(call, inputs, out):
        return False
    before = pending[(count - 1) % len(pending)]
    bound(out[: len(command)], before, holding.limits, count == 0, command, bounds)
    put(command, pending[last])
    update_states(holding.update, out[len(command) :], z[1])
    holding.counts[0] = count + 1
    return True


@inline
def advance(rates: Any, law: Any, schedule: Any, holding: Any, x: Any, room: Any, kept: Any) -> int:
    """Integrate from the state x, (size L,), in place; returns the steps taken, fewer if a state needs the recursion.

    `room` has stage derivatives, (S, size L), a vector of these and two of commands.
    """
    A, B = schedule.tableau.A, schedule.tableau.B
    K, total, command, bounds = room
    call, inputs = rates.call, rates.inputs
    keeps, positions = len(kept.stages) > 0, schedule.positions
    for k in range(len(schedule.lengths)):
        h = schedule.lengths[k]
        if schedule.sampled[k]:
            z = kept.states[k] if keeps else holding.states[0]
            if not sample(law, holding, schedule.begins[k], x, command, kept.bounds[k] if keeps else bounds, z):
                return k
        if schedule.acting[k]:
            put(holding.pending[holding.counts[1] % len(holding.pending)], inputs[2])
            holding.counts[1] += 1
        if keeps:
            put(inputs[2], kept.held[k])
        for s in range(len(B)):
            combine(A[s], s, K, total)
            move(x, h, total, inputs[1])
            if keeps:
                put(inputs[1], kept.stages[k, s])
            put_time(rates, schedule.times[k, s])
            if not evaluate(call, inputs, K[s]):
                return k
        combine(B, len(B), K, total)
        if positions > 0:  # which move with the rates at the end
            move(x[positions:], h, total[positions:], total[:positions])
        move(x, h, total, x)
    return len(schedule.lengths)


@inline
def pull_back_bounds(holding: Any, bounds: Any, adjoint: Any, raw: Any) -> None:
    """Pull derivatives by the last command back to the law's output, the bounds and the command before."""
    count, pending = holding.counts[0], adjoint.pending
    own, before = count % len(pending), (count - 1) % len(pending)
    for e in range(len(raw)):
        slope, code = pending[own, e], bounds[e]
        pending[own, e] = 0.0
        raw[e] = slope if code == 0.0 else 0.0
        if abs(code) == 1.0:
            adjoint.limits[0, e] += slope * code
        elif abs(code) == 2.0:
            adjoint.limits[1, e] += slope * code / 2
            pending[before, e] += slope


@inline
def pull_back_sample(law: Any, holding: Any, t: Any, x: Any, states: Any, bounds: Any, adjoint: Any) -> bool:
    """Pull derivatives back through `sample`, by the gradient of the law; True if valid."""
    call, inputs, out = law.call, law.inputs, law.out
    weights, m = inputs[len(inputs) - 1], len(adjoint.states)
    moving, n = len(inputs[1]) - m, len(adjoint.held)
    holding.counts[0] -= 1
    pull_back_bounds(holding, bounds, adjoint, weights[:n])
    for e in range(m):
        weights[n + e] = holding.update.gain * adjoint.states[e]
    if holding.update.keep == 0.0:
        fill(0.0, adjoint.states)
    put(x, inputs[1][:moving])
    put(states, inputs[1][moving:])
    row, end = put_time(law, t), len(inputs[1])
    if not evaluate(call, inputs, out):
        return False
    add(out[:moving], adjoint.x[:moving])
    add(out[moving:], adjoint.states)
    if row >= 0:
        add(out[end:], adjoint.law_table[row])
        end += adjoint.law_table.shape[1]
    add(out[end:], adjoint.of_law)
    return True


@inline
def pull_back(gradient: Any, law: Any, schedule: Any, holding: Any, kept: Any, adjoint: Any) -> int:
    """Integrate the adjoint backwards through the steps; returns the number of the step that failed plus 1, or 0.

    The kernels are gradients: of the equations by x, u, the piece and numbers, of the law likewise.
    """
    A, B, positions = schedule.tableau.A, schedule.tableau.B, schedule.positions
    call, inputs, out = gradient.call, gradient.inputs, gradient.out
    x, Y, size, held = adjoint.x, adjoint.slopes, len(adjoint.x), len(adjoint.held)
    weights = inputs[len(inputs) - 1]
    for k in range(len(schedule.lengths) - 1, -1, -1):
        h = schedule.lengths[k]
        put(kept.held[k], inputs[2][:held])
        if positions > 0:
            move(x[positions:], h, x, x[positions : 2 * positions])
        for s in range(len(B) - 1, -1, -1):
            for e in range(size):
                weights[e] = h * B[s] * x[e]
            for r in range(s + 1, len(B)):
                if A[r, s] != 0.0:
                    move(weights, h * A[r, s], Y[r], weights[:size])
            if positions > 0:
                fill(0.0, weights[:positions])
            put(kept.stages[k, s], inputs[1])
            row, end = put_time(gradient, schedule.times[k, s]), size + held
            if not evaluate(call, inputs, out):
                return k + 1
            put(out, Y[s])
            add(out[size:end], adjoint.held)
            if row >= 0:
                add(out[end:], adjoint.table[row])
                end += adjoint.table.shape[1]
            add(out[end:], adjoint.numbers)
        for s in range(len(B)):
            add(Y[s], x)
        if schedule.acting[k]:
            holding.counts[1] -= 1
            add(adjoint.held, adjoint.pending[holding.counts[1] % len(holding.pending)])
            fill(0.0, adjoint.held)
            if len(adjoint.arrivals):
                put(x, adjoint.arrivals[k])
        if schedule.sampled[k]:
            given = kept.stages[k, 0], kept.states[k], kept.bounds[k], adjoint
            if not pull_back_sample(law, holding, schedule.begins[k], *given):
                return k + 1
    return 0


class Linear(NamedTuple):
    """Derivatives of a kernel's results at some states: by the state and a command, by numbers, and by pieces."""

    slopes: Array  # (..., rows, width)
    columns: Array  # (k,) of int64: seeds of the last columns of `slopes`, those of numbers, or -1
    further: Array  # (..., rows p), by the seeds through pieces; of no entries if there are none


class Directions(NamedTuple):
    """Tangents: derivatives of a motion's state by p seeds, matrices of p columns as vectors, and room."""

    p: int
    x: Array  # (size p,)
    held: Array  # (n p,)
    pending: Array  # (rows, n p)
    states: Array  # (m p,), of the law at the next sample
    limits: Array  # (2, n) of int64: seeds of the bounds of commands, or -1
    delay: int  # seed of the delay, or -1
    slopes: Array  # (S, size p), stage derivatives
    room: Array  # (3, size p, n p or m p, whichever is the longest)


@inline
def carry_results(J: Any, further: Any, columns: Any, x: Any, z: Any, p: Any, out: Any) -> None:
    """Derivatives of a kernel's results from those of its arguments x and z, one after the other."""
    fill(0.0, out)
    add_product(J, 0, x, p, out)
    add_product(J, len(x) // p, z, p, out)
    add_columns(J, (len(x) + len(z)) // p, columns, p, out)
    if len(further):
        add(further, out)


@inline
def carry_slope(J: Any, further: Any, columns: Any, held: Any, p: Any, y: Any, out: Any) -> None:
    """Derivatives of a stage's dx/dt from those of its state, whose velocities are the first rows of dx/dt."""
    first = len(out) - J.shape[0] * p
    put(y[first:], out[:first])
    carry_results(J, further, columns, y, held, p, out[first:])


@inline
def carry_sample(law: Any, k: Any, holding: Any, bounds: Any, d: Any) -> None:
    """Derivatives of the command of sample k, and of the law's states."""
    p, pending, count = d.p, d.pending, holding.counts[0]
    n, end, moving = len(d.held) // p, len(d.held), (law.slopes.shape[2] - len(law.columns)) * p - len(d.states)
    own, before, returned = pending[count % len(pending)], d.room[1, :end], d.room[2, : len(d.states)]
    put(pending[(count - 1) % len(pending)], before)
    further = law.further[k]
    carry_results(law.slopes[k], further[:end], law.columns, d.x[:moving], d.states, p, own)
    carry_results(law.slopes[k, n:], further[end:], law.columns, d.x[:moving], d.states, p, returned)
    for i in range(n):
        code, mine = bounds[i], own[i * p : (i + 1) * p]
        if code != 0.0:
            fill(0.0, mine)
        if abs(code) == 2.0:
            put(before[i * p :], mine)
        column = d.limits[0 if abs(code) == 1.0 else 1, i]
        if code != 0.0 and column >= 0:
            mine[column] += code / abs(code)
    holding.counts[0] = count + 1
    update_states(holding.update, returned, d.states)


def carry(
    f: Any, more: Any, law: Any, schedule: Any, holding: Any, kept: Any, jumps: Any, reports: Any, d: Any
) -> None:
    """Propagate derivatives of a motion along its steps, and report them at some times.

    `f` has the derivatives of dx/dt at the stages, `more` those at stages that only interpolants need, of the steps
    with a time to report, and `law` those of the law at its samples. A longer delay changes the state where a command
    begins to act by `jumps`, (acts, size): the rate before it minus the rate after it. `reports` has the step of each
    time to report, the weights of its stages, (R, stages), the rows of A for the further stages, the number of stages
    of each step, and arrays for the derivatives of states and commands, (R, size p) and (R, n p).
    """
    A, B, p = schedule.tableau.A, schedule.tableau.B, d.p
    steps, weights, further, counts, X, U = reports
    x, K, y, total = d.x, d.slopes, d.room[0, : len(d.x)], d.room[1, : len(d.x)]
    sample_number, act, report, extended = 0, 0, 0, 0
    for k in range(len(schedule.lengths)):
        h = schedule.lengths[k]
        if schedule.sampled[k]:
            carry_sample(law, sample_number, holding, kept.bounds[k], d)
            sample_number += 1
        if schedule.acting[k]:
            put(d.pending[holding.counts[1] % len(holding.pending)], d.held)
            holding.counts[1] += 1
            for i in range(jumps.shape[1] if d.delay >= 0 else 0):
                x[i * p + d.delay] += jumps[act, i]
            act += 1
        for s in range(counts[k]):
            combine(A[s] if s < len(B) else further[s - len(B)], s, K, total)
            move(x, h, total, y)
            g, number, row = (f, k, s) if s < len(B) else (more, extended, s - len(B))
            carry_slope(g.slopes[number, row], g.further[number, row], g.columns, d.held, p, y, K[s])
        if counts[k] > len(B):
            extended += 1
        while report < len(steps) and steps[report] == k:
            combine(weights[report], counts[k], K, total)
            move(x, h, total, X[report])
            put(d.held, U[report])
            report += 1
        combine(B, len(B), K, total)
        move(x, h, total, x)
