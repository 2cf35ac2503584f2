"""Explicit Runge-Kutta methods as loops in machine code, which take many steps per call.

What a loop cannot decide, an evaluation that needs the recursion or a step that becomes too small, is left to the
caller. Slopes K[k] are those of the stages of step k, K[0, 0] that at T[0].
"""

from __future__ import annotations

from typing import Any

from .loops import combine, copy, evaluate, inline
from .step_control import Storage, error_norm, first_length, shortest_step, step_factor

CONTINUE, KEEP_LENGTH, RESTART = 0, 1, 2  # the first step: slope and length are known, the length, neither


@inline
def stage(problem: Any, t: Any, x: Any, h: Any, row: Any, K: Any, s: Any, c: Any) -> bool:
    """The slope K[s] at t + c and x + h row K; True if it is valid."""
    rates, arguments, interval = problem
    y = arguments[1]
    arguments[0][0] = min(max(t + c, interval.first), interval.last)
    combine(row, s, K, y)
    for i in range(len(x)):
        y[i] = x[i] + h * y[i]
    return evaluate(rates, arguments, K[s])


@inline
def begin(problem: Any, how: Any, steps: Any) -> bool:
    """The first slope and the first step's length, as far as `how` asks for them; True if they are valid."""
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
def take_steps(problem: Any, end: Any, how: Any, steps: Any) -> int:
    """Steps into the storage from T[0] and X[0] on, as far as `end` or the arrays allow; how many."""
    interval = problem.interval
    A, B, C, E, _, _, _, exponent = interval.tableau
    T, X, K, H, count, work = steps
    stages, y = len(B), problem.arguments[1]
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
            for s in range(1, stages + 1):
                row, c = (A[s], C[s] * h) if s < stages else (B, h)
                count[step] += 1
                if not stage(problem, t, x, h, row, k, s, c):
                    return step
            error = error_norm(E, k[: stages + 1], h, x, y, interval, work)
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


def add_stages(problem: Any, T: Any, X: Any, K: Any, U: Any) -> bool:
    """The stages that only interpolants need, in the last rows of K; False if one of them is not valid.

    The first entries of the last argument are the row of U that was held in each step.
    """
    A, C, valid = problem.interval.tableau.A2, problem.interval.tableau.C2, True
    for step in range(len(K)):
        h, k = T[step + 1] - T[step], K[step]
        for i in range(U.shape[1]):
            problem.arguments[-1][i] = U[step, i]
        for extra in range(len(C)):
            s = len(k) - len(C) + extra
            valid &= stage(problem, T[step], X[step], h, A[extra], k, s, C[extra] * h)
    return valid


def take_samples(law: Any, problem: Any, period: Any, how: Any, steps: Any, samples: Any) -> int:
    """`take_steps` with a law that is sampled, and whose outputs, the first of arguments[2], are held in between.

    `law` has its function, its arguments t and (x, z), and room for its outputs and the rates of its states z, which go
    on by Euler's rule. `samples` has the number of samples so far, how often the law was sampled here, the bounds of
    outputs and of their change, (2, n), the states z at the last sample and the next, (2, m), the steps that began with
    a sample, the outputs in each step, and z at each sample.
    """
    function, (time, states), found = law
    number, bounds, z, begun, U, Z = samples
    T, X, K, H, count, work = steps
    u, n, step, end = problem.arguments[2], len(bounds[0]), 0, problem.interval.end
    moving = len(states) - len(z[0])  # positions and velocities
    coordinates = moving // 2
    number[1] = 0
    while step < len(T) - 1 and T[step] < end:
        if T[step] >= number[0] * period:
            for j in range(len(z[0])):
                z[0, j] = z[1, j]
                states[moving + j] = z[0, j]
            for i in range(len(u) - n - coordinates):  # behind the outputs, 0 for a rate that is held at zero
                X[step, coordinates + i] *= u[n + i]
            time[0] = T[step]
            for i in range(moving):
                states[i] = X[step, i]
            if not evaluate(function, (time, states), found):
                return step
            for i in range(n):
                output = min(max(found[i], -bounds[0, i]), bounds[0, i])
                held = min(max(output, u[i] - bounds[1, i]), u[i] + bounds[1, i])
                u[i] = output if number[0] == 0 else held
                U[step, i] = u[i]
            for j in range(len(z[0])):
                z[1, j] = z[0, j] + period * found[n + j]
                Z[number[1], j] = z[0, j]
            begun[number[1]] = step
            if number[0] == 0:
                H[step] = period  # the first step is tried as far as the next sample
            how = KEEP_LENGTH if H[step] > 0 else RESTART
            number[0] += 1
            number[1] += 1
        next_sample = number[0] * period
        until = next_sample if next_sample < end * (1 - 1e-12) else end
        rest = Storage(T[step:], X[step:], K[step:], H[step:], count[step:], work)
        taken = take_steps(problem, until, how, rest)
        for k in range(step, step + taken):
            for i in range(n):
                U[k, i] = u[i]
        step += taken
        if T[step] < until:
            return step
    return step
