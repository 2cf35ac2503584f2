"""SciPy's explicit Runge-Kutta methods as loops in machine code, which take many steps per call.

Coefficients, norms and the control of steps are those of `scipy.integrate`: Hairer, Norsett and Wanner 1993, II.4 and
II.5. Of a state x at time t the right-hand side takes `arguments`: arrays for t and x, and what else it depends on.
What a loop cannot decide, an evaluation to be examined or a step that becomes too small, is left to the caller.
"""

from __future__ import annotations

import functools
from typing import Any, NamedTuple

import numpy as np

from ..basics.spatial import Array
from .loops import evaluate, inline

SAFETY, SMALLEST, LARGEST = 0.9, 0.2, 10.0  # factors between steps, as SciPy's
FIXED, CONTROLLED = ("rk4", "semi-implicit-euler"), ("RK45", "DOP853")
GO_ON, AFTER_A_JUMP, ANEW = 0, 1, 2  # how the first step begins: with slope and length, with its length, with neither


class Limits(NamedTuple):
    """Of the steps of a block."""

    end: float
    longest: float  # step
    rtol: float
    atol: float
    power: float  # of the error, in the factor between two steps
    first: float  # times within which the right-hand side is evaluated
    last: float


@inline
def stage(
    rates: Any, arguments: Any, limits: Any, t: Any, x: Any, h: Any, row: Any, K: Any, s: Any, ahead: Any
) -> bool:
    """The slope K[s] at t + ahead and x + h row K; True if it is sound."""
    y = arguments[1]
    arguments[0][0] = min(max(t + ahead, limits.first), limits.last)
    for i in range(len(x)):
        y[i] = 0.0
    for j in range(s):
        if row[j] != 0.0:
            for i in range(len(x)):
                y[i] += row[j] * K[j, i]
    for i in range(len(x)):
        y[i] = x[i] + h * y[i]
    return evaluate(rates, arguments, K[s])


@inline
def error_norm(E: Any, K: Any, h: Any, x: Any, y: Any, rtol: Any, atol: Any, work: Any) -> float:
    """The estimated error of a step from x to y, in units of the tolerance: of two estimates, or of one, as E has."""
    n, sums = len(x), (0.0, 0.0)
    for e in range(len(E)):
        for i in range(n):
            work[i] = E[e, 0] * K[0, i]
        for j in range(1, len(K)):
            for i in range(n):
                work[i] += E[e, j] * K[j, i]
        total = 0.0
        for i in range(n):
            total += (work[i] / (atol + rtol * max(abs(x[i]), abs(y[i])))) ** 2
        sums = (total, sums[0])
    if len(E) == 1:
        return float(h * (sums[0] / n) ** 0.5)
    third, fifth = sums
    return float(h * fifth / ((fifth + 0.01 * third) * n) ** 0.5) if fifth > 0 else 0.0


@inline
def first_length(rates: Any, arguments: Any, limits: Any, t: Any, x: Any, K: Any) -> float:
    """Length of the first step: Hairer, Norsett and Wanner 1993, II.4, as in SciPy; 0 if a slope is not sound."""
    end, rtol, atol = limits.end, limits.rtol, limits.atol
    d0, d1, d2, y = 0.0, 0.0, 0.0, arguments[1]
    for i in range(len(x)):
        scale = atol + rtol * abs(x[i])
        d0 += (x[i] / scale) ** 2
        d1 += (K[0, i] / scale) ** 2
    d0, d1 = (d0 / len(x)) ** 0.5, (d1 / len(x)) ** 0.5
    h = min(1e-6 if d0 < 1e-5 or d1 < 1e-5 else 0.01 * d0 / d1, end - t)
    arguments[0][0] = min(max(t + h, limits.first), limits.last)
    for i in range(len(x)):
        y[i] = x[i] + h * K[0, i]
    if not evaluate(rates, arguments, K[1]):
        return 0.0
    for i in range(len(x)):
        d2 += ((K[1, i] - K[0, i]) / (atol + rtol * abs(x[i]))) ** 2
    d2 = (d2 / len(x)) ** 0.5 / h
    step = max(1e-6, h * 1e-3) if max(d1, d2) <= 1e-15 else (0.01 / max(d1, d2)) ** -limits.power
    return float(min(100 * h, step, end - t, limits.longest))


@inline
def begin(
    rates: Any, arguments: Any, limits: Any, how: Any, row: Any, T: Any, X: Any, K: Any, H: Any, count: Any
) -> bool:
    """The slope at T[0], X[0] and the first step's length, as far as `how` asks for them; True if they are sound."""
    if how == GO_ON:
        return True
    count[0] += 1
    if not stage(rates, arguments, limits, T[0], X[0], 0.0, row, K[0], 0, 0.0):
        return False
    if how == ANEW:
        count[0] += 1
        H[0] = first_length(rates, arguments, limits, T[0], X[0], K[0])
    return bool(H[0] > 0)


@inline
def take_steps(
    rates: Any, arguments: Any, limits: Any, how: Any, tableau: Any, T: Any, X: Any, K: Any, H: Any, count: Any
) -> int:
    """Steps into T, X and K from T[0] and X[0] on, as far as `limits` or the arrays allow; how many.

    K has the slopes of each step's stages, K[0, 0] that at T[0] unless `how` asks for it; H[k] is the length with which
    step k is tried first, `count` has the evaluations of each step.
    """
    end, power = limits.end, limits.power
    A, B, C, E, _, _, _, work = tableau
    stages, y = len(B), arguments[1]
    if not begin(rates, arguments, limits, how, B, T, X, K, H, count):
        return 0
    for step in range(len(T) - 1):
        t, x, k = T[step], X[step], K[step]
        smallest = 10 * abs(np.nextafter(t, np.inf) - t)
        h = min(max(H[step], smallest), limits.longest)
        rejected = False
        while True:
            if not h >= smallest:
                return step
            reached = min(t + h, end)
            h = reached - t
            for s in range(1, stages + 1):
                row, ahead = (A[s], C[s] * h) if s < stages else (B, h)
                count[step] += 1
                if not stage(rates, arguments, limits, t, x, h, row, k, s, ahead):
                    return step
            error = error_norm(E, k[: stages + 1], h, x, y, limits.rtol, limits.atol, work)
            if error < 1:
                factor = LARGEST if error == 0 else min(LARGEST, SAFETY * error**power)
                T[step + 1] = reached
                for i in range(len(x)):
                    X[step + 1, i] = y[i]
                h *= min(1.0, factor) if rejected else factor
                break
            h *= max(SMALLEST, SAFETY * error**power)
            rejected = True
        H[step + 1] = h
        if T[step + 1] >= end:
            return step + 1
        if step + 2 < len(T):
            for i in range(len(x)):
                K[step + 1, 0, i] = k[stages, i]
    return len(T) - 1


@inline
def add_stages(rates: Any, arguments: Any, limits: Any, A: Any, C: Any, T: Any, X: Any, K: Any) -> bool:
    """The stages that only interpolants need, in the last rows of K; False if one of them is not sound."""
    sound = True
    for step in range(len(K)):
        h, k = T[step + 1] - T[step], K[step]
        for extra in range(len(C)):
            s = len(k) - len(C) + extra
            sound &= stage(rates, arguments, limits, T[step], X[step], h, A[extra], k, s, C[extra] * h)
    return sound


class Tableau(NamedTuple):
    """A method's coefficients, one or two estimates of its error, and its interpolant.

    Within a step x(t + u h) is x plus h u (d_0 + (1 - u) (d_1 + u (d_2 + ...))), d = D k, with stages `A2`, `C2` that
    only this needs.
    """

    A: Array
    B: Array
    C: Array
    E: Array
    A2: Array
    C2: Array
    D: Array


@functools.cache
def tableau(method: str) -> Tableau:
    """Of a method with step control, as SciPy's, or with fixed steps; that of semi-implicit Euler is Euler's."""
    A2, C2 = np.zeros((0, 1)), np.zeros(0)
    if method in FIXED:
        A, B, C = np.zeros((1, 1)), np.ones(1), np.zeros(1)
        if method == "rk4":
            A, B, C = np.diag([0.5, 0.5, 1.0], -1), np.array([1, 2, 2, 1]) / 6, np.array([0, 0.5, 0.5, 1])
        return Tableau(A, B, C, np.zeros((2, 1)), A2, C2, np.zeros((0, len(B) + 1)))
    import scipy.integrate

    solver: Any = getattr(scipy.integrate, method)
    if method == "RK45":
        P = solver.P.T  # of 1, u, u^2, u^3
        E, D = solver.E[None], np.stack([P.sum(0), -P[1:].sum(0), -P[2] - 2 * P[3], P[3]])
    else:
        E, A2, C2 = np.stack([solver.E5, solver.E3]), solver.A_EXTRA, solver.C_EXTRA
        unit, stages = np.eye(solver.D.shape[1]), len(solver.B)
        B, first, last = solver.B @ unit[:stages], unit[0], unit[stages]
        D = np.concatenate([[B, first - B, 2 * B - first - last], solver.D])
    parts = solver.A, solver.B, solver.C, E, A2, C2, D
    return Tableau(*(np.ascontiguousarray(x, dtype=np.float64) for x in parts))


@functools.cache
def power(method: str) -> float:
    """Of the error, in the factor between two steps: minus one by the order of the error's estimate, plus one."""
    import scipy.integrate

    return -1.0 / (float(getattr(scipy.integrate, method).error_estimator_order) + 1.0)


def take_samples(
    law: Any,
    law_arguments: Any,
    found: Any,
    rates: Any,
    arguments: Any,
    limits: Any,
    period: Any,
    how: Any,
    tableau: Any,
    T: Any,
    X: Any,
    K: Any,
    H: Any,
    count: Any,
    samples: Any,
) -> int:
    """`take_steps` with a controller that is sampled, and whose torques arguments[2] are held between two samples.

    The law gives torques and the rates of its states in `found`; the states go on by Euler's rule. `samples` has the
    number of samples so far, how often the law was sampled here, the bounds of torques and of their change, (2, n), the
    states z at the last sample and the next, (2, m), the steps that began with a sample, the torques in each step,
    and z at each sample.
    """
    number, bounds, z, begun, U, Z = samples
    u, n, step, end = arguments[2], len(bounds[0]), 0, limits.end
    number[1] = 0
    while step < len(T) - 1 and T[step] < end:
        if T[step] >= number[0] * period:
            for j in range(len(z[0])):
                z[0, j] = z[1, j]
                law_arguments[1][2 * n + j] = z[0, j]
            for i in range(len(u) - 2 * n):  # behind torques, the modes: 0 for a joint that sticks
                X[step, n + i] *= u[n + i]
            law_arguments[0][0] = T[step]
            for i in range(2 * n):
                law_arguments[1][i] = X[step, i]
            if not evaluate(law, law_arguments, found):
                return step
            for i in range(n):
                torque = min(max(found[i], -bounds[0, i]), bounds[0, i])
                held = min(max(torque, u[i] - bounds[1, i]), u[i] + bounds[1, i])
                u[i] = torque if number[0] == 0 else held
                U[step, i] = u[i]
            for j in range(len(z[0])):
                z[1, j] = z[0, j] + period * found[n + j]
                Z[number[1], j] = z[0, j]
            begun[number[1]] = step
            if number[0] == 0:
                H[step] = period  # the first step is tried as far as the next sample
            how = AFTER_A_JUMP if H[step] > 0 else ANEW
            number[0] += 1
            number[1] += 1
        next_sample = number[0] * period
        until = next_sample if next_sample < end * (1 - 1e-12) else end
        now = Limits(until, limits.longest, limits.rtol, limits.atol, limits.power, limits.first, limits.last)
        rest = T[step:], X[step:], K[step:], H[step:], count[step:]
        taken = take_steps(rates, arguments, now, how, tableau, rest[0], rest[1], rest[2], rest[3], rest[4])
        for k in range(step, step + taken):
            for i in range(n):
                U[k, i] = u[i]
        step += taken
        if T[step] < until:
            return step
    return step


def add_sampled_stages(rates: Any, arguments: Any, limits: Any, A: Any, C: Any, T: Any, X: Any, K: Any, U: Any) -> bool:
    """`add_stages` under the torques U of each step."""
    sound = True
    for step in range(len(K)):
        for i in range(len(U[step])):
            arguments[2][i] = U[step, i]
        one = slice(step, step + 1)
        sound &= add_stages(rates, arguments, limits, A, C, T[step:], X[step:], K[one])
    return sound
