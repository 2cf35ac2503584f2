"""Many motions by an explicit method, LANES of them side by side in vector registers, as loops in machine code.

Each motion has its own time and its own steps, and its result does not depend on its neighbours. Where one has ended,
the next takes its lane. A motion with a state that needs the recursion is marked and left to the caller. Arrays of the
lanes are flat, component by component: entry i LANES + k is component i of lane k.

Torques may be held, given ones or those of a sampled law, as in `runge_kutta.take_samples`: a step ends where the next
sample is due, or where a command begins to act.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from ..basics.piecewise import NO_TABLES, rows_of_tables
from ..basics.spatial import Array
from ..dynamics.quantity import OK
from ..kernels.kernel import Kernel
from .array_loops import combine, put
from .base import SAME
from .loops import LANES, NO_PIECES, StateUpdate, compiled, evaluate, inline, next_state, put_piece
from .rows import EARLY, FAST_DECAY, LOOK, NEEDS_RECURSION, SLOW, STIFF, BatchResult, Progress, run_rows
from .step_control import MOST_STEPS, NEARLY, Interval, first_lengths, shortest_step, step_factor
from .tableaus import Tableau

EMPTY = -1  # number that marks a lane without a motion
OPERATIONS = 3 * 10**7  # most operations of one call on LANES states: less than a tenth of a second
# Rows of `lane`: the motion, its next time to report, its steps, whether the last was accepted, whether it needs Q, its
# samples, its commands that act or have acted, its steps before the last of these; of `step`: begin, length and end of
# the step, its errors, the length to try next, the time of the next sample or command.
MOTION, TIME, STEPS, TAKEN, WANTS, SAMPLES, ACTED, SINCE, LANE_ROWS = 0, 1, 2, 3, 4, 5, 6, 7, 8
NOW, LENGTH, END, FIFTH, THIRD, NEXT, SWITCH, STEP_ROWS = 0, 1, 2, 3, 4, 5, 6, 7
# Rows of the last of `own`: the delay in whole periods and a remainder, work before the torques that act, bounds of
# torques, then those of their change between samples.
LATE, REST, WORK, BOUNDS = 0, 1, 2, 3


class Hold(NamedTuple):
    """Torques of n drives in the lanes, the argument of dx/dt after the state, each held until the next one acts."""

    period: float  # between two samples; 0 if no torques are held
    update: StateUpdate  # of the law's states
    driven: int  # number of the first coordinate that they act on
    most_steps: int  # between two samples; a motion that needs more is left to the caller
    law: Any  # function, arguments, workspace for those that differ between lanes, and the result
    sources: tuple[Array, ...]  # a row per motion of what its lane has in `own`
    own: tuple[Array, ...]  # arguments of the law; delay, work and bounds
    pending: Array  # (p, n LANES), commands, that of sample k in row k % p
    start: Array  # (n LANES,), positions where the torques began to act
    table: Array  # (N, K, n), given torques; empty with a law
    pieces: Array  # of the motion that the law follows, as `Interval.table` of batches


class Room(NamedTuple):
    """Workspace of `run_all`; vectors have the entries of a state, (size LANES,)."""

    inputs: tuple[Array, ...]  # arguments of the kernel, the state as the second
    saved: tuple[Array, ...]  # copies of those that differ between lanes
    y: Array  # the state at the begin of the step
    new: Array  # that at its end
    total: Array  # sums of stage derivatives
    h: Array  # the length of the step
    before: Array  # the state at the last stage before the end
    K: Array  # (stages, size LANES), stage derivatives
    Q: Array  # (rows of D, size LANES), of the interpolant
    lane: Array  # (LANE_ROWS, LANES) of int64
    step: Array  # (STEP_ROWS, LANES)
    hold: Hold


def hold_of(
    timing: tuple[float, StateUpdate],
    law: Kernel | None,
    given: tuple[Array, Array],
    table: Array,
    rows: Array,
    driven: int,
    most: int,
) -> Hold:
    """Torques for `run_lanes`, of a law or from a table.

    The timing is the sample time and the update of the law's states. In addition to t and x the law is `given` pieces
    of a motion that it follows, as `Interval.table` of batches, and coefficients, (k,) or (N, k). Rows of delays, work
    and bounds have shape (N, 3 + 2 n).
    """
    (pieces, numbers), (count, _, n), entries, widths = given, table.shape, 0, [1, 0]
    common, more = ((numbers,), ()) if numbers.ndim == 1 else ((), (numbers,))
    if law is not None:
        widths, entries, table = [*law.traced.widths[:2]], law.traced.entries, table[:0]
    sources = *(np.zeros((count, width)) for width in widths), *no_pieces(pieces, count), *more, rows
    own, saved = (tuple(np.zeros(part.shape[1] * LANES) for part in sources) for _ in range(2))
    start, out = (np.zeros(size * LANES) for size in (n, entries))
    pending = np.zeros((int(rows[:, LATE].max(initial=0)) + 1, n * LANES))
    function = 0 if law is None else law.address(LANES, common=not more)
    of_law = function, own[:-1] + common, saved[:-1], out
    pieces = pieces if len(pieces) else NO_PIECES
    return Hold(*timing, driven, most, of_law, sources, own, pending, start, table, pieces)


def no_pieces(table: Array, count: int) -> tuple[Array, ...]:
    """Empty rows for the argument of a piece, one per table."""
    return (np.full((count, table.shape[2]), np.nan),) if len(table) else ()


UNTIMED = 0.0, StateUpdate(1.0, 0.0)
NONE = hold_of(UNTIMED, None, (NO_TABLES, np.zeros(0)), np.zeros((0, 0, 0)), np.zeros((0, BOUNDS)), 0, 2**62)


def workspace(widths: tuple[int, ...], tableau: Tableau, hold: Hold, common: tuple[Array, ...]) -> Room:
    """Arrays for `run_all`: kernel arguments that differ between lanes, by their widths, and common ones.

    The second argument is the state; the common ones come last.
    """
    inputs, saved = (tuple(np.zeros(width * LANES) for width in widths) for _ in range(2))
    inputs += common
    entries, rows = widths[1] * LANES, max(len(tableau.B) + 1, tableau.D.shape[1])
    slopes = np.zeros((rows, entries)), np.zeros((max(1, len(tableau.D)), entries))
    numbers = np.zeros((LANE_ROWS, LANES), np.int64), np.zeros((STEP_ROWS, LANES))
    return Room._make([inputs, saved, *np.zeros((5, entries)), *slopes, *numbers, hold])


@inline
def put_pieces(tables: Any, inputs: Any, lane: Any) -> None:
    """Write the pieces that hold at the lanes' times, inputs[0], into inputs[2], if there are tables."""
    if tables.ndim == 1:  # known when machine code is made
        return
    for k in range(LANES):
        table = tables[max(lane[MOTION, k], 0) if len(tables) > 1 else 0]
        put_piece(table, inputs[0][k], inputs[2], k, LANES)


@inline
def put_motion(sources: Any, motion: Any, inputs: Any, k: Any) -> None:
    """Load a motion's rows into a lane."""
    for a in range(len(sources)):
        for i in range(sources[a].shape[1]):
            inputs[a][i * LANES + k] = sources[a][motion, i]


@inline
def copy_lane(array: Any, source: Any, k: Any) -> None:
    """Copy one lane into another."""
    for i in range(0, len(array), LANES):
        array[i + k] = array[i + source]


@inline
def mark_invalid(function: Any, inputs: Any, saved: Any, out: Any, lane: Any, code: Any, asks: Any) -> None:
    """Evaluate lanes one by one and mark motions that need the recursion; if it `asks`, only those in WANTS."""
    for a in range(len(saved)):
        put(inputs[a], saved[a])
    for k in range(LANES):
        if lane[MOTION, k] >= 0 and (not asks or lane[WANTS, k]):
            for a in range(len(saved)):
                for e in range(len(inputs[a])):
                    inputs[a][e] = saved[a][e - e % LANES + k]
            if not evaluate(function, inputs, out):
                code[lane[MOTION, k]] = NEEDS_RECURSION
                lane[MOTION, k] = EMPTY
    for a in range(len(saved)):
        put(saved[a], inputs[a])


def rates_of_all(function: Any, sources: Any, F: Any, code: Any, room: Any) -> None:
    """Write dx/dt of every motion into F, from rows of times, states and other arguments; mark invalid ones."""
    inputs, saved, lane, out, count = room.inputs, room.saved, room.lane, room.y, len(F)
    for begin in range(0, count, LANES):
        for k in range(LANES):
            lane[MOTION, k] = min(begin + k, count - 1)
            put_motion(sources, lane[MOTION, k], inputs, k)
        is_valid = evaluate(function, inputs, out)
        for k in range(min(LANES, count - begin)):
            for i in range(F.shape[1]):
                F[begin + k, i] = out[i * LANES + k]
        if not is_valid:
            mark_invalid(function, inputs, saved, out, lane, code, False)


@inline
def fill_lanes(waiting: Any, sources: Any, F: Any, H: Any, code: Any, room: Any) -> Any:
    """Load waiting motions into free lanes, or copies of other lanes; returns the next to wait, EMPTY at the end."""
    inputs, y, K, lane, step, hold = room.inputs, room.y, room.K, room.lane, room.step, room.hold
    source = EMPTY
    for k in range(LANES):
        while lane[MOTION, k] == EMPTY and waiting < len(F):
            if not code[waiting]:
                put_motion(sources, waiting, inputs, k)
                step[SWITCH, k] = float("inf")
                if hold.period > 0:
                    put_motion(hold.sources, waiting, hold.own, k)
                    step[SWITCH, k] = sources[0][waiting, 0]
                for i in range(F.shape[1]):
                    y[i * LANES + k], K[0, i * LANES + k] = sources[1][waiting, i], F[waiting, i]
                step[NOW, k], step[NEXT, k] = sources[0][waiting, 0], H[waiting]
                for row in range(LANE_ROWS):
                    lane[row, k] = 0
                lane[MOTION, k], lane[TAKEN, k] = waiting, 1
            waiting += 1
        if lane[MOTION, k] >= 0:
            source = k
    for k in range(LANES):
        if lane[MOTION, k] == EMPTY and source >= 0:
            for a in range(len(sources)):
                copy_lane(inputs[a], source, k)
            for a in range(len(hold.own)):
                copy_lane(hold.own[a], source, k)
            copy_lane(y, source, k)
            copy_lane(K[0], source, k)
            step[NOW, k] = step[NOW, source]
    return waiting if source >= 0 else EMPTY


@inline
def sample_lane(hold: Any, lane: Any, k: Any) -> None:
    """Append a lane's command, from the table or the law, to its pending ones."""
    motion, count, n, out = lane[MOTION, k], lane[SAMPLES, k], len(hold.start), hold.law[3]
    bounds, states = hold.own[-1][BOUNDS * LANES :], hold.own[1]
    before, last = (count - 1) % len(hold.pending), count % len(hold.pending)
    for e in range(k, n, LANES):
        u = hold.table[motion, count, e // LANES] if len(hold.table) else out[e]
        u = min(max(u, -bounds[e]), bounds[e])
        if count > 0:
            held, change = hold.pending[before, e], bounds[n + e]
            u = min(max(u, held - change), held + change)
        hold.pending[last, e] = u
    for e in range(n + k, len(out), LANES):  # states of the law, the last ones
        own = len(states) - len(out) + e
        states[own] = next_state(hold.update, states[own], out[e])
    lane[SAMPLES, k] += 1


@inline
def act_in_lane(hold: Any, times: Any, y: Any, u: Any, lane: Any, now: Any, k: Any, X: Any) -> None:
    """Let a lane's next command begin to act, also in what was just reported at this time."""
    n, time, row, timing = len(u) // LANES, lane[TIME, k] - 1, lane[ACTED, k] % len(hold.pending), hold.own[-1]
    is_reported = time >= 0 and times[time] >= now * (1 - SAME)
    for e in range(k, len(u), LANES):
        position = y[hold.driven * LANES + e]
        timing[WORK * LANES + k] += u[e] * (position - hold.start[e])
        hold.start[e], u[e] = position, hold.pending[row, e]
        if is_reported:
            X[time, lane[MOTION, k], X.shape[2] - n - 1 + e // LANES] = u[e]
    lane[ACTED, k] += 1


@inline
def call_law(hold: Any, y: Any, lane: Any, step: Any, code: Any) -> None:
    """Evaluate the law in all lanes; mark those that need it where it is not valid."""
    function, inputs, saved, out = hold.law
    for e in range(len(inputs[1]) - len(out) + len(hold.start)):  # before the law's own states
        inputs[1][e] = y[e]
    for k in range(LANES):
        inputs[0][k] = step[NOW, k]
    put_pieces(hold.pieces, inputs, lane)
    if not evaluate(function, inputs, out):
        mark_invalid(function, inputs, saved, out, lane, code, True)
        evaluate(function, inputs, out)


@inline
def renew_torques(interval: Any, code: Any, count: Any, X: Any, room: Any) -> bool:
    """Take the samples, and have the commands act, that are due; True if there are any: derivatives are new."""
    inputs, y, lane, step, hold = room.inputs, room.y, room.lane, room.step, room.hold
    is_due, samples, timing, period = False, False, hold.own[-1], hold.period
    for k in range(LANES):
        lane[WANTS, k] = 0
        if lane[MOTION, k] >= 0 and step[NOW, k] >= step[SWITCH, k]:
            is_due, lane[WANTS, k] = True, step[NOW, k] >= lane[SAMPLES, k] * period
            samples = samples or lane[WANTS, k] == 1
    if samples and not len(hold.table):
        call_law(hold, y, lane, step, code)
    for k in range(LANES):
        if lane[MOTION, k] >= 0 and step[NOW, k] >= step[SWITCH, k]:
            late, rest = timing[LATE * LANES + k], timing[REST * LANES + k]
            if lane[WANTS, k]:
                sample_lane(hold, lane, k)
            if step[NOW, k] >= (lane[ACTED, k] + late) * period + rest:
                act_in_lane(hold, interval.t_eval, y, inputs[2], lane, step[NOW, k], k, X)
            switch = min(lane[SAMPLES, k] * period, (lane[ACTED, k] + late) * period + rest)
            step[SWITCH, k] = switch if switch < interval.end * NEARLY else interval.end
            lane[SINCE, k] = lane[STEPS, k]
            count[lane[MOTION, k]] += 0 if len(interval.grid) else 1
    return is_due


@inline
def is_endless(interval: Any, lane: Any, k: Any, t: Any, most: Any) -> bool:
    """True if the motion would take too many steps, or took `most` steps without a new torque; see `rows.RowSteps`."""
    steps = lane[STEPS, k]
    is_slow = steps * (interval.end - interval.begin) > MOST_STEPS * (t - interval.begin)
    return bool((steps >= EARLY and is_slow) or steps - lane[SINCE, k] > most)


@inline
def choose_lengths(interval: Any, lane: Any, step: Any, h: Any, code: Any, most: Any) -> None:
    """Choose the end of each lane's step, from the grid or by the length to try; mark motions with too short ones.

    A step of the grid within which a torque changes is taken in two.
    """
    for k in range(LANES):
        t, length, motion = step[NOW, k], step[NEXT, k], lane[MOTION, k]
        step[END, k], smallest = t, shortest_step(t)
        if motion >= 0:
            if len(interval.grid):
                step[END, k] = interval.grid[lane[STEPS, k] + 1]
                if step[SWITCH, k] < step[END, k]:
                    step[END, k], lane[STEPS, k] = step[SWITCH, k], lane[STEPS, k] - 1
            elif (not lane[TAKEN, k] and not length >= smallest) or is_endless(interval, lane, k, t, most):
                code[motion], lane[MOTION, k] = NEEDS_RECURSION, EMPTY
            else:
                step[END, k] = min(t + max(length, smallest), interval.end, step[SWITCH, k])
        step[LENGTH, k] = step[END, k] - t
    for i in range(0, len(h), LANES):
        for k in range(LANES):
            h[i + k] = step[LENGTH, k]


@inline
def put_stage(interval: Any, y: Any, total: Any, h: Any, c: Any, inputs: Any, lane: Any, step: Any) -> None:
    """Set times and states of a stage: y + h total, c steps later."""
    times, x = inputs[0], inputs[1]
    for e in range(len(y)):
        x[e] = y[e] + h[e] * total[e]
    for k in range(LANES):
        times[k] = min(max(step[NOW, k] + c * step[LENGTH, k], interval.first), interval.last)
    put_pieces(interval.table, inputs, lane)


@inline
def take_stages(function: Any, interval: Any, code: Any, room: Any, first: Any) -> bool:
    """Compute the stage derivatives K of the lanes from the first one on, and of the ends of their steps.

    False if one of them is not valid in some lane; its motion is marked.
    """
    A, B, C = interval.tableau.A, interval.tableau.B, interval.tableau.C
    inputs, saved, y, new, total, h, before, K, _, lane, step, _ = room
    stages, is_fixed, moved = len(B), len(interval.grid) > 0, interval.positions * LANES
    for s in range(first, stages + 1):
        combine(A[s] if s < stages else B, s, K, total)
        put_stage(interval, y, total, h, C[s] if s < stages else 1.0, inputs, lane, step)
        if s == stages:
            for e in range(moved):
                inputs[1][e] = y[e] + h[e] * inputs[1][moved + e]
            put(inputs[1], new)
        if s == stages - 1:
            put(inputs[1], before)
        if (s < stages or not is_fixed) and not evaluate(function, inputs, K[s]):
            mark_invalid(function, inputs, saved, total, lane, code, False)
            return False
    return True


@inline
def interpolate(function: Any, interval: Any, code: Any, room: Any) -> None:
    """Compute the interpolant Q of the lanes' steps, with the stages that only it needs."""
    A2, C2, D, first = interval.tableau.A2, interval.tableau.C2, interval.tableau.D, len(interval.tableau.B) + 1
    inputs, saved, y, _, total, h, _, K, Q, lane, step, _ = room
    for s in range(len(C2)):
        combine(A2[s], first + s, K, total)
        put_stage(interval, y, total, h, C2[s], inputs, lane, step)
        if not evaluate(function, inputs, K[first + s]):
            mark_invalid(function, inputs, saved, total, lane, code, True)
    for j in range(len(D)):
        combine(D[j], K.shape[0], K, Q[j])


@inline
def estimate_errors(interval: Any, y: Any, new: Any, total: Any, K: Any, step: Any) -> None:
    """Estimate the error of each lane's step."""
    E, count, rtol, atol = interval.tableau.E, interval.counted, interval.rtol, interval.atol
    for k in range(LANES):
        step[THIRD, k] = 0.0
    for estimate in range(E.shape[0]):
        combine(E[estimate], E.shape[1], K, total)
        for e in range(len(y)):
            error = total[e] / (atol + rtol * max(abs(y[e]), abs(new[e])))
            total[e] = error * error
        for k in range(LANES):
            step[FIFTH + estimate, k] = 0.0
        for i in range(count):
            for k in range(LANES):
                step[FIFTH + estimate, k] += total[i * LANES + k]
    for k in range(LANES):
        fifth, third = step[FIFTH, k], step[THIRD, k]  # a product would be fused with the sum, in some lanes only
        step[FIFTH, k] = step[LENGTH, k] * fifth / ((fifth + third / 100) * count) ** 0.5 if fifth > 0 else 0.0


@inline
def accept(interval: Any, lane: Any, step: Any) -> bool:
    """Accept or reject steps and choose the lengths to try next; True if a time to report is inside of one."""
    wants, times, exponent = False, interval.t_eval, interval.tableau.exponent
    for k in range(LANES):
        error, was_taken = step[FIFTH, k], lane[TAKEN, k]
        if len(interval.grid):
            lane[TAKEN, k], lane[WANTS, k] = 1, 0
        elif error < 1:
            factor = step_factor(error, exponent)
            step[NEXT, k] = step[LENGTH, k] * (factor if was_taken else min(1.0, factor))
            lane[TAKEN, k], time = 1, lane[TIME, k]
            lane[WANTS, k] = lane[MOTION, k] >= 0 and time < len(times) and times[time] < step[END, k]
            wants = wants or lane[WANTS, k] == 1
        else:
            step[NEXT, k] = step[LENGTH, k] * step_factor(error, exponent)
            lane[TAKEN, k], lane[WANTS, k] = 0, 0
    return wants


@inline
def report(times: Any, y: Any, new: Any, Q: Any, hold: Any, u: Any, lane: Any, step: Any, k: Any, X: Any) -> None:
    """Write states of a lane at times within its step into X[time, motion], followed by torques and their work."""
    motion, time, size, n = lane[MOTION, k], lane[TIME, k], len(y) // LANES, len(hold.start) // LANES
    while time < len(times) and times[time] <= step[END, k]:
        part = (times[time] - step[NOW, k]) / step[LENGTH, k]
        for i in range(size):
            e = i * LANES + k
            if times[time] == step[END, k]:
                X[time, motion, i] = new[e]
            else:  # Horner's scheme in u and 1 - u by turns
                found = 0.0
                for j in range(Q.shape[0] - 1, -1, -1):
                    found = (found + Q[j, e]) * (part if j % 2 == 0 else 1 - part)
                X[time, motion, i] = y[e] + step[LENGTH, k] * found
        work = hold.own[-1][WORK * LANES + k]
        for e in range(k, len(hold.start), LANES):
            i = e // LANES
            work += u[e] * (X[time, motion, hold.driven + i] - hold.start[e])
            X[time, motion, size + i], X[time, motion, size + n] = u[e], work
        time += 1
    lane[TIME, k] = time


@inline
def is_stiff(interval: Any, slope: Any, other: Any, new: Any, before: Any, lane: Any, step: Any, k: Any) -> bool:
    """True if a motion is stiff, by the derivatives of the last two states at the same time; see `rows.RowSteps`."""
    steps, begin = lane[STEPS, k] + 1, interval.begin
    if steps % LOOK != 0 or not steps * (interval.end - begin) > interval.watched * SLOW * (step[END, k] - begin):
        return False
    slopes, states = 0.0, 0.0
    for i in range(interval.counted):
        e = i * LANES + k
        slopes += (slope[e] - other[e]) ** 2
        states += (new[e] - before[e]) ** 2
    return bool(step[LENGTH, k] ** 2 * slopes > FAST_DECAY**2 * states)


@inline
def move_on(y: Any, new: Any, K: Any, last: Any, extra: Any, end: Any, lane: Any, step: Any, count: Any) -> bool:
    """Move each lane to the end of its step, if that was taken; True if a lane has no motion."""
    taken, vacant = 0, False
    for k in range(LANES):
        if lane[MOTION, k] >= 0:
            count[lane[MOTION, k]] += last + lane[WANTS, k] * extra
        if lane[TAKEN, k]:
            step[NOW, k], lane[STEPS, k], taken = step[END, k], lane[STEPS, k] + 1, taken + 1
            if step[END, k] >= end:
                lane[MOTION, k] = EMPTY
        vacant = vacant or lane[MOTION, k] == EMPTY
    if taken == LANES:
        put(new, y)
        put(K[last], K[0])
    else:
        for k in range(LANES):
            for e in range(k, len(y) if lane[TAKEN, k] else 0, LANES):
                y[e], K[0, e] = new[e], K[last, e]
    return vacant


def run_all(
    function: Any, interval: Any, sources: Any, F: Any, H: Any, code: Any, count: Any, X: Any, room: Any, go_on: Any
) -> int:
    """Integrate every motion from its row of `sources` to the end; states at the times to report into X[time, motion].

    F and H have each motion's first derivative and the length to try first; `count` takes evaluations. `go_on` has the
    first motion that waits for a lane and the evaluations after which to return; returns the next motion that waits,
    or EMPTY at the end.
    """
    _, _, y, new, _, h, before, K, Q, lane, step, hold = room
    stages, is_fixed, (waiting, left) = len(interval.tableau.B), len(interval.grid) > 0, go_on
    if waiting == 0:
        lane[MOTION] = EMPTY
    vacant = True
    while left > 0:
        left -= stages + 1
        if vacant:
            waiting = fill_lanes(waiting, sources, F, H, code, room)
        if waiting == EMPTY:
            break
        is_new = hold.period > 0 and renew_torques(interval, code, count, X, room)
        choose_lengths(interval, lane, step, h, code, hold.most_steps)
        vacant = not take_stages(function, interval, code, room, 0 if is_new or is_fixed else 1)
        if vacant:
            continue
        if not is_fixed:
            estimate_errors(interval, y, new, room.total, K, step)
        if accept(interval, lane, step):
            interpolate(function, interval, code, room)
        for k in range(LANES):
            if lane[MOTION, k] >= 0 and lane[TAKEN, k]:
                report(interval.t_eval, y, new, Q, hold, room.inputs[2], lane, step, k, X)
                if interval.watched and is_stiff(interval, K[stages], K[stages - 1], new, before, lane, step, k):
                    code[lane[MOTION, k]], lane[MOTION, k] = STIFF, EMPTY
        vacant = move_on(y, new, K, stages, len(interval.tableau.C2), interval.end, lane, step, count)
    return int(waiting)


def run_lanes(
    interval: Interval, kernel: Kernel, numbers: Array, x: Array, X: Array, progress: Progress, hold: Hold = NONE
) -> BatchResult:
    """Integrate from states x, shape (N, size), into X[time, motion], which is NaN where nothing is reported.

    Held torques, if any, and their work follow the states in X. Numbers of the run, the kernel's last argument, are
    (p,) for all or (N, p). Machine code returns to Python after about OPERATIONS, so that Ctrl-C works.
    """
    x, N, units = np.ascontiguousarray(x), len(x), max(len(interval.grid) - 1, 1)
    coefficients, widths = np.ascontiguousarray(kernel.coefficients(numbers)), kernel.traced.widths
    common, more = ((coefficients,), ()) if numbers.ndim == 1 else ((), (coefficients,))
    more = (np.zeros((N, widths[2])), *more) if hold.period > 0 else more  # no torque before the first command
    interval = interval._replace(table=np.ascontiguousarray(interval.table) if len(interval.table) else NO_PIECES)
    pieces = no_pieces(interval.table, N)
    room = workspace(widths[: 2 + len(pieces) + len(more)], interval.tableau, hold, common)
    address = kernel.address(LANES, common=numbers.ndim == 1)
    code, count, H, F = np.zeros(N, np.int64), np.zeros(N, np.int64), np.zeros(N), np.zeros_like(x)

    def rates(t: Array, states: Array, F: Array) -> Array:
        times = np.clip(t, interval.first, interval.last)[:, None]
        rows = rows_of_tables(interval.table, times[:, 0])
        compiled(rates_of_all)(address, (times, np.ascontiguousarray(states), *rows, *more), F, code, room)
        return F

    begin = np.full(N, interval.begin)
    if len(hold.law[3]):
        H += hold.period  # the first step is tried as far as the next sample
    elif not len(interval.grid):
        rates(begin, x, F)
        H = first_lengths(lambda t, states: rates(t, states.T, np.zeros_like(x)).T, interval, x.T, F.T)
        count += 2
    most, waiting, done = max(1, OPERATIONS // max(1, sum(kernel.operations.values()))), 0, 0
    given = address, interval, (begin[:, None], x, *pieces, *more), F, H, code, count, X, room
    try:
        while waiting != EMPTY:
            waiting, before = compiled(run_all)(*given, (waiting, most)), done
            done = int(N - np.isnan(X[-1, :, :1]).any(axis=1).sum())
            progress(units * (done - before))
        progress(units * (int((code != NEEDS_RECURSION).sum()) - done))
    except KeyboardInterrupt:
        return BatchResult(code, int(count.sum()), OK, is_done=False)
    return BatchResult(code, int(count.sum()), OK, is_done=True)


def run_batch(
    interval: Interval, kernel: Kernel, numbers: Array, x: Array, X: Array, progress: Progress, places: Array
) -> BatchResult:
    """Integrate in machine code if the kernel has any; by NumPy otherwise and where the recursion is needed."""
    part, left = BatchResult(np.full(len(x), NEEDS_RECURSION), 0, OK, is_done=True), np.arange(len(x))
    if kernel.engine == "numba" and kernel.is_unrolled and x.dtype == np.float64:
        part = run_lanes(interval, kernel, numbers, x, X, progress)
        left = np.flatnonzero(part.code == NEEDS_RECURSION)
    if not len(left) or not part.is_done:
        return part
    some = np.full((len(X), len(left), x.shape[1]), np.nan, x.dtype)
    own = numbers if numbers.ndim == 1 else numbers[left]
    rest = run_rows(interval, kernel, own, places[left], x[left], some, progress)
    X[:, left], part.code[left] = some, rest.code
    return rest._replace(code=part.code, evaluations=part.evaluations + rest.evaluations)
