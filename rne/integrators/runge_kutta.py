"""Explicit Runge-Kutta methods as loops in machine code, which take many steps per call.

An evaluation that needs the recursion, or a step that becomes too short, is left to the caller. K[k] has the stage
derivatives of step k, K[0, 0] that at T[0].
"""

from __future__ import annotations

from typing import Any, NamedTuple

from ..basics.spatial import Array
from .array_loops import combine, move, put
from .frozen_steps import sample
from .loops import evaluate, inline, put_time
from .step_control import NEARLY, Problem, Storage, error_norm, first_length, shortest_step, step_factor, until_break

CONTINUE, KEEP_LENGTH, RESTART = 0, 1, 2  # start of a run: derivative and length are known; only the length; neither


@inline
def stage(problem: Any, t: Any, x: Any, h: Any, row: Any, K: Any, s: Any, c: Any) -> bool:
    """Evaluate the stage derivative K[s] at t + c and x + h row K; True if it is valid."""
    rates, arguments, interval = problem
    y = arguments[1]
    put_time(arguments, interval, t + c)
    combine(row, s, K, y)
    move(x, h, y, y)
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
    """Compute the stage derivatives K of a step after the first, and of its end; True if they are valid."""
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
        put(y, X[step + 1])
        H[step + 1] = h * (min(1.0, factor) if rejected else factor)
        if reached >= end:
            return step + 1
        if step + 2 < len(T):
            put(k[stages], K[step + 1, 0])
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
    """Record of a law's samples and of the commands held in between: n drives, m states of the law."""

    number: Array  # (2,) of int64, samples in this call, and commands that began to act
    begun: Array  # (steps,) of int64, steps that began with a sample
    came: Array  # (steps,) of int64, steps that began with another command
    U: Array  # (steps, n), the commands in each step
    W: Array  # (steps, n), the command of each sample
    Z: Array  # (steps, m), the law's states at each sample
    bounds: Array  # (n,), workspace


@inline
def next_changes(timing: Any, counts: Any) -> Any:
    """Times of the next sample and of the next command's start [s]."""
    period, late, rest = timing
    return counts[0] * period, (counts[1] + late) * period + rest


@inline
def change_command(law: Any, holding: Any, timing: Any, u: Any, steps: Any, step: Any, held: Any) -> bool:
    """Take the sample, and have the command act, that are due at the start of a step; True if the law is valid."""
    counts, number, t = holding.counts, held.number, steps.T[step]
    sample_time, arrival = next_changes(timing, counts)
    if t >= sample_time:
        here = number[0]
        held.begun[here] = step
        if counts[0] == 0:
            steps.H[step] = timing[0]  # the first step is tried as far as the next sample
        if not sample(law, holding, t, steps.X[step], held.W[here], held.bounds, held.Z[here]):
            return False
        number[0] += 1
    if t >= arrival:
        put(holding.pending[counts[1] % len(holding.pending)], u[: len(held.bounds)])
        put(u, held.U[step])
        held.came[number[1]] = step
        counts[1] += 1
        number[1] += 1
    return True


def take_samples(law: Any, holding: Any, problem: Any, timing: Any, how: Any, steps: Any, held: Any) -> int:
    """Take steps with a sampled law, whose commands, the first of arguments[2], are held between samples.

    `law` is a `Function` of t, (x, z), perhaps the piece of a motion, and numbers. `timing` has the period and the
    delay with which a command acts after its sample: a whole number of periods and the rest of it.
    """
    T, X, K, H, count, work = steps
    u, n, step, end = problem.arguments[2], len(held.bounds), 0, problem.interval.end
    coordinates = (len(law.inputs[1]) - holding.states.shape[1]) // 2
    held.number[:] = 0
    while step < len(T) - 1 and T[step] < end:
        if T[step] >= min(next_changes(timing, holding.counts)):
            for i in range(len(u) - n - coordinates):  # after the commands, 0 for a rate that is held at zero
                X[step, coordinates + i] *= u[n + i]
            if not change_command(law, holding, timing, u, steps, step, held):
                return step
            how = KEEP_LENGTH if H[step] > 0 else RESTART
        switch = min(next_changes(timing, holding.counts))
        until = switch if switch < end * NEARLY else end
        taken = take_steps(problem, until, how, Storage(T[step:], X[step:], K[step:], H[step:], count[step:], work))
        for k in range(step, step + taken):
            put(u, held.U[k])
        step += taken
        if T[step] < until:
            return step
    return step
