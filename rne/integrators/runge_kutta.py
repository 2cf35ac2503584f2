"""Explicit Runge-Kutta methods as loops in machine code, which take many steps per call.

What a loop cannot decide, an evaluation that needs the recursion or a step that becomes too small, is left to the
caller. Stage derivatives K[k] are those of step k, K[0, 0] that at T[0].
"""

from __future__ import annotations

from typing import Any, NamedTuple

from ..basics.spatial import Array
from .loops import combine, copy, evaluate, inline, next_state, put_piece, put_time
from .step_control import NEARLY, Problem, Storage, error_norm, first_length, shortest_step, step_factor, until_break

CONTINUE, KEEP_LENGTH, RESTART = 0, 1, 2  # start of a run: derivative and length are known; only the length; neither


@inline
def stage(problem: Any, t: Any, x: Any, h: Any, row: Any, K: Any, s: Any, c: Any) -> bool:
    """Evaluate the stage derivative K[s] at t + c and x + h row K; True if it is valid."""
    rates, arguments, interval = problem
    y = arguments[1]
    put_time(arguments, interval, t + c)
    combine(row, s, K, y)
    for i in range(len(x)):
        y[i] = x[i] + h * y[i]
    return evaluate(rates, arguments, K[s])


@inline
def begin(problem: Any, how: Any, steps: Any) -> bool:
    """Compute the first derivative and the first step's length, as far as `how` asks for them; True if valid."""
    if how == CONTINUE:
        return True
    t, x, K = steps.T[0], steps.X[0], steps.K[0]
    steps.evaluations[0] += 1
    if not stage(problem, t, x, 0.0, problem.interval.tableau.B, K, 0, 0.0):
        return False
    if how == RESTART:
        steps.evaluations[0] += 1
        steps.H[0] = first_length(problem, t, x, K)
    return bool(steps.H[0] > 0)


@inline
def take_stages(problem: Any, t: Any, x: Any, h: Any, K: Any, evaluations: Any) -> bool:
    """Compute the stage derivatives K of a step behind the first, and of its end; True if they are valid."""
    A, B, C = problem.interval.tableau.A, problem.interval.tableau.B, problem.interval.tableau.C
    for s in range(1, len(B) + 1):
        row, c = (A[s], C[s] * h) if s < len(B) else (B, h)
        evaluations[0] += 1
        if not stage(problem, t, x, h, row, K, s, c):
            return False
    return True


@inline
def take_steps(problem: Any, end: Any, how: Any, steps: Any) -> int:
    """Take steps into the storage from T[0] and X[0] on, as far as `end` or the arrays allow; returns their number."""
    interval, y = problem.interval, problem.arguments[1]
    T, X, K, H, count, work = steps
    stages, exponent = len(interval.tableau.B), interval.tableau.exponent
    if not begin(problem, how, steps):
        return 0
    for step in range(len(T) - 1):
        t, x, k = T[step], X[step], K[step]
        smallest = shortest_step(t)
        h = min(max(H[step], smallest), interval.max_step)
        rejected = False
        while True:
            if not h >= smallest:
                return step
            reached = min(t + h, end)
            h = reached - t
            if not take_stages(problem, t, x, h, k, count[step:]):
                return step
            error = error_norm(interval.tableau.E, k[: stages + 1], h, x, y, interval, work)
            factor = step_factor(error, exponent)
            if error < 1:
                break
            h *= factor
            rejected = True
        T[step + 1] = reached
        copy(y, X[step + 1])
        H[step + 1] = h * (min(1.0, factor) if rejected else factor)
        if reached >= end:
            return step + 1
        if step + 2 < len(T):
            copy(k[stages], K[step + 1, 0])
    return len(T) - 1


def take_segments(problem: Any, how: Any, steps: Any) -> int:
    """Take steps from break to break, as far as the end or the arrays allow; returns their number."""
    (T, X, K, H, count, work), step = steps, 0
    while step < len(T) - 1 and T[step] < problem.interval.end:
        part = until_break(problem.interval, T[step])
        room = Storage(T[step:], X[step:], K[step:], H[step:], count[step:], work)
        step += take_steps(Problem(problem.rates, problem.arguments, part), part.end, how, room)
        if T[step] < part.end:
            return step
        how = RESTART
    return step


def add_stages(problem: Any, T: Any, X: Any, K: Any, U: Any) -> bool:
    """Compute the stages that only interpolants need, in the last rows of K; False if one of them is not valid.

    The first entries of arguments[2] are the row of U that was held in each step, if U has columns.
    """
    A, C, valid = problem.interval.tableau.A2, problem.interval.tableau.C2, True
    for step in range(len(K)):
        h, k = T[step + 1] - T[step], K[step]
        for i in range(U.shape[1]):
            problem.arguments[2][i] = U[step, i]
        for extra in range(len(C)):
            s = len(k) - len(C) + extra
            valid &= stage(problem, T[step], X[step], h, A[extra], k, s, C[extra] * h)
    return valid


class HeldCommands(NamedTuple):
    """Record of a law's samples and commands, held in between: n drives, m states of the law."""

    number: Array  # (4,) of int64, samples and commands that have acted so far, and of both in this call
    bounds: Array  # (2, n), of commands and of their change
    z: Array  # (2, m), the law's states at the last sample and at the next
    pending: Array  # (p, n), commands, that of sample k in row k % p
    begun: Array  # (steps,) of int64, steps that began with a sample
    came: Array  # (steps,) of int64, steps that began with another command
    U: Array  # (steps, n), the commands in each step
    W: Array  # (steps, n), the command of each sample
    Z: Array  # (steps, m), the law's states at each sample


@inline
def sample(law: Any, t: Any, x: Any, held: Any) -> bool:
    """Sample a law: append its command, within the bounds, to the pending ones; True if it is valid."""
    function, arguments, found, table, update = law
    number, bounds, z, pending, _, _, _, W, Z = held
    time, states = arguments[0], arguments[1]
    count, here, n, m = number[0], number[2], bounds.shape[1], z.shape[1]
    before, last, moving = (count - 1) % len(pending), count % len(pending), len(states) - m
    for j in range(m):
        z[0, j] = states[moving + j] = z[1, j]
    time[0] = t
    put_piece(table, t, arguments[-2])
    for i in range(moving):
        states[i] = x[i]
    if not evaluate(function, arguments, found):
        return False
    for i in range(n):
        u, previous = min(max(found[i], -bounds[0, i]), bounds[0, i]), pending[before, i]
        if count > 0:
            u = min(max(u, previous - bounds[1, i]), previous + bounds[1, i])
        pending[last, i] = W[here, i] = u
    for j in range(m):
        z[1, j] = next_state(update, z[0, j], found[n + j])
        Z[here, j] = z[0, j]
    number[0] += 1
    number[2] += 1
    return True


@inline
def next_changes(timing: Any, number: Any) -> Any:
    """Times of the next sample and of the next command's start [s]."""
    period, late, rest = timing
    return number[0] * period, (number[1] + late) * period + rest


@inline
def change_command(law: Any, timing: Any, u: Any, steps: Any, step: Any, held: Any) -> bool:
    """Take the sample, and have the command act, that are due at the start of a step; True if the law is valid."""
    number, t = held.number, steps.T[step]
    sample_time, arrival = next_changes(timing, number)
    if t >= sample_time:
        held.begun[number[2]] = step
        if number[0] == 0:
            steps.H[step] = timing[0]  # the first step is tried as far as the next sample
        if not sample(law, t, steps.X[step], held):
            return False
    if t >= arrival:
        for i in range(held.bounds.shape[1]):
            u[i] = held.U[step, i] = held.pending[number[1] % len(held.pending), i]
        held.came[number[3]] = step
        number[1] += 1
        number[3] += 1
    return True


def take_samples(law: Any, problem: Any, timing: Any, how: Any, steps: Any, held: Any) -> int:
    """Take steps with a sampled law, whose commands, the first of arguments[2], are held between samples.

    `law` has its function, its arguments t, (x, z), perhaps the piece of a motion, and numbers, room for its outputs
    and what it returns for its states z, the table of the motion, and the `StateUpdate` of z. `timing` has the period
    and the delay with which a command acts after its sample: a whole number of periods and the rest of it.
    """
    T, X, K, H, count, work = steps
    u, n, step, end = problem.arguments[2], held.bounds.shape[1], 0, problem.interval.end
    coordinates = (len(law[1][1]) - held.z.shape[1]) // 2
    held.number[2] = held.number[3] = 0
    while step < len(T) - 1 and T[step] < end:
        if T[step] >= min(next_changes(timing, held.number)):
            for i in range(len(u) - n - coordinates):  # behind the commands, 0 for a rate that is held at zero
                X[step, coordinates + i] *= u[n + i]
            if not change_command(law, timing, u, steps, step, held):
                return step
            how = KEEP_LENGTH if H[step] > 0 else RESTART
        switch = min(next_changes(timing, held.number))
        until = switch if switch < end * NEARLY else end
        taken = take_steps(problem, until, how, Storage(T[step:], X[step:], K[step:], H[step:], count[step:], work))
        for k in range(step, step + taken):
            for i in range(n):
                held.U[k, i] = u[i]
        step += taken
        if T[step] < until:
            return step
    return step
