"""Rodas5P, a Rosenbrock method for stiff motions, as a loop over steps that may run in machine code.

Steinebach 2023, Construction of Rosenbrock-Wanner method Rodas5P and numerical benchmarks within the Julia Differential
Equations package, BIT Numerical Mathematics 63: order 5, eight stages, L-stable, stiffly accurate, with an estimate of
order 4 of the error and an interpolant of order 4. In the form of Hairer and Wanner 1996, IV.7 (7.25), a stage is

    (1 / (h gamma) - f_x) u_i = f(t + alpha_i h, x + sum_j a_ij u_j) + sum_j c_ij u_j / h + gamma_i h f_t

The state is x = (q, qd, z, e). K, D, Z, M and R_t: derivatives of the equations of motion R(t, x, qdd) = 0 by q, qd, z,
qdd and t. The rows of qd are multiplied by M, and those of q, u_q c - u_qd = b_q with c = 1 / (h gamma), eliminate
u_qd:

    (c^2 M + c D + K) u_q + Z u_z = M b_qd + (c M + D) b_q,    u_qd = c u_q - b_q

so that M is not inverted and the system has the size of (q, z). The last states e, such as energies, are integrals:
their rates depend on the others, not on e or qdd, and u_e follows from their derivatives without a system.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from ..basics.spatial import Array
from .array_loops import combine, move, put
from .loops import evaluate, inline, put_time
from .step_control import Problem, Storage, error_norm, shortest_step, step_factor, until_break

STAGES = 8
EXPONENT = -0.2  # exponent of the error in the step factor: the estimate is of order 4
GAMMA = 0.21193756319429014
# fmt: off
STAGE = [  # a_ij, below the first stage, where it is the state itself
    [3.0],
    [2.849394379747939, 0.45842242204463923],
    [-6.954028509809101, 2.489845061869568, -10.358996098473584],
    [2.8029986275628964, 0.5072464736228206, -0.3988312541770524, -0.04721187230404641],
    [-7.502846399306121, 2.561846144803919, -11.627539656261098, -0.18268767659942256, 0.030198172008377946],
]  # the last ones and the step's end add one u_j after another to that
COUPLING = [  # c_ij
    [-14.155112264123755],
    [-17.97296035885952, -2.859693295451294],
    [147.12150275711716, -1.41221402718213, 71.68940251302358],
    [165.43517024871676, -0.4592823456491126, 42.90938336958603, -5.961986721573306],
    [24.854864614690072, -3.0009227002832186, 47.4931110020768, 5.5814197821558125, -0.6610691825249471],
    [30.91273214028599, -3.1208243349937974, 77.79954646070892, 34.28646028294783, -19.097331116725623,
     -28.087943162872662],
    [37.80277123390563, -3.2571969029072276, 112.26918849496327, 66.9347231244047, -40.06618937091002,
     -54.66780262877968, -9.48861652309627],
]
INTERPOLANT = np.array([
    [25.948786856663858, -2.5579724845846235, 10.433815404888879, -2.3679251022685204, 0.524948541321073,
     1.1241088310450404, 0.4272876194431874, -0.17202221070155493],
    [-9.91568850695171, -0.9689944594115154, 3.0438037242978453, -24.495224566215796, 20.176138334709044,
     15.98066361424651, -6.789040303419874, -6.710236069923372],
    [11.419903575922262, 2.8879645146136994, 72.92137995996029, 80.12511834622643, -52.072871366152654,
     -59.78993626266729, -0.15582684282751913, 4.883087185713722],
])
# fmt: on


def _tableau() -> tuple[Array, Array, Array, Array]:
    """a_ij, c_ij, alpha_i and gamma_i.

    The last two are sums of the rows of alpha and Gamma, where a = alpha Gamma^-1 and c = 1 / gamma - Gamma^-1.
    """
    A, C = np.zeros((2, STAGES, STAGES))
    for s, row in enumerate(STAGE, start=1):
        A[s, :s] = row
    for s in range(len(STAGE) + 1, STAGES):
        A[s], A[s, s - 1] = A[s - 1], 1.0
    for s, row in enumerate(COUPLING, start=1):
        C[s, :s] = row
    sums = np.linalg.inv(np.eye(STAGES) / GAMMA - C).sum(axis=1)
    return A, C, A @ sums, sums


class RosenbrockTableau(NamedTuple):
    """The coefficients of a method, as its loops take them."""

    A: Array  # (stages, stages), a_ij
    C: Array  # (stages, stages), c_ij
    alpha: Array  # (stages,)
    gamma: Array  # (stages,)
    interpolant: Array  # (3, stages)
    E: Array  # (1, stages), estimates the error


class RosenbrockRoom(NamedTuple):
    """Workspace of `take_steps` for n coordinates, a state of `size` entries and linear systems of `rows` rows."""

    S: Array  # (size - n, size + n + 1), derivatives of the equations of motion by the state, qdd and t
    W: Array  # (rows, ...), the matrix of the linear systems and what is eliminated with it
    G: Array  # (..., rows), the result of the elimination, transposed
    b: Array  # (rows,), the right-hand side
    U: Array  # (stages, size), u_i
    start: Array  # (size,), dx/dt at the begin of the step
    f: Array  # (size,), dx/dt at a stage


A, C, ALPHA, GAMMAS = _tableau()
TABLEAU = RosenbrockTableau(A, C, ALPHA, GAMMAS, INTERPOLANT, np.eye(STAGES)[-1:])  # last stage: error estimate


@inline
def set_up(S: Any, n: Any, size: Any, c: Any, W: Any) -> None:
    """Build [matrix, factors of (b_q, b_qd, b_z) and of gamma_i h f_t] of the linear systems from the derivatives S."""
    rows = len(W)
    for i in range(rows):
        for j in range(n):
            if i < n:
                damped = c * S[i, size + j] + S[i, n + j]
                W[i, j] = c * damped + S[i, j]
                W[i, rows + j] = damped
                W[i, rows + n + j] = S[i, size + j]
            else:
                W[i, j] = -(c * S[i, n + j] + S[i, j])
                W[i, rows + j] = -S[i, n + j]
                W[i, rows + n + j] = 0.0
        for j in range(n, rows):
            W[i, j] = S[i, n + j] if i < n else -S[i, n + j]
            W[i, rows + n + j] = 0.0
        if i >= n:
            W[i, i] += c
            W[i, rows + n + i] = 1.0
        W[i, 2 * rows + n] = -S[i, size + n] if i < n else S[i, size + n]


@inline
def eliminate(W: Any, G: Any) -> bool:
    """Compute G, transposed, from [W, G] by Gauss-Jordan elimination with row pivots; False if W is singular."""
    rows, columns = W.shape
    for k in range(rows):
        best = k
        for i in range(k + 1, rows):
            if abs(W[i, k]) > abs(W[best, k]):
                best = i
        if not abs(W[best, k]) > 0.0:
            return False
        factor = 1.0 / W[best, k]
        for j in range(k, columns):
            moved = W[k, j]
            W[k, j] = factor * W[best, j]
            if best != k:
                W[best, j] = moved
        for i in range(rows):
            factor = W[i, k]
            if i != k:
                for j in range(k + 1, columns):
                    W[i, j] -= factor * W[k, j]
    for i in range(rows):
        for j in range(len(G)):
            G[j, i] = W[i, rows + j]
    return True


@inline
def add(weights: Any, count: Any, factor: Any, U: Any, total: Any) -> None:
    """Add the weighted sum of the first rows of U."""
    for j in range(count):
        move(total, weights[j] * factor, U[j], total)


@inline
def solve_stage(S: Any, G: Any, n: Any, c: Any, by_time: Any, f: Any, b: Any, u: Any) -> None:
    """Solve (I / (h gamma) - J) u = f + gamma_i h f_t for one stage; `by_time` is gamma_i h."""
    rows, size = len(b), len(f)
    counted = n + rows
    for i in range(rows):
        b[i] = by_time * G[counted, i]
    add(f, counted, 1.0, G, b)
    for i in range(n):
        u[i] = b[i]
        u[n + i] = c * b[i] - f[i]
    for i in range(n, rows):
        u[n + i] = b[i]
    for i in range(counted, size):
        total = f[i] + by_time * S[i - n, size + n]
        for j in range(counted):
            total += S[i - n, j] * u[j]
        u[i] = total / c


@inline
def linearise(problem: Any, slopes: Any, steps: Any, t: Any, y: Any) -> bool:
    """Evaluate dx/dt and the derivatives of the equations of motion at the start of a step; True if both are valid."""
    rates, state, interval = problem
    qdd, start = slopes[1][2], steps.work.start
    put_time(state, interval, t)
    put(y, state[1])
    steps.evaluations[0] += 1
    if not evaluate(rates, state, start):
        return False
    put(start[len(qdd) :], qdd)
    steps.evaluations[1] += 1
    return evaluate(slopes[0], slopes[1], steps.work.S)


@inline
def solve_stages(problem: Any, steps: Any, n: Any, t: Any, y: Any, h: Any) -> bool:
    """Solve all stages u_i of a step from y, and the state at its end; False if dx/dt is not valid at one of them."""
    rates, state, interval = problem
    A, C, alpha, gamma, _, _ = interval.tableau
    S, _, G, b, U, start, f = steps.work
    x, c = state[1], 1.0 / (h * GAMMA)
    put(start, f)
    for s in range(STAGES):
        if s > 0:
            put(y, x)
            add(A[s], s, 1.0, U, x)
            put_time(state, interval, t + alpha[s] * h)
            steps.evaluations[0] += 1
            if not evaluate(rates, state, f):
                return False
            add(C[s], s, 1.0 / h, U, f)
        solve_stage(S, G, n, c, gamma[s] * h, f, b, U[s])
    move(x, 1.0, U[STAGES - 1], x)
    return True


@inline
def take_steps(problem: Any, slopes: Any, steps: Any) -> int:
    """Take steps into the storage from T[0] and X[0] on; returns their number.

    `slopes` is the function for the Jacobian of the equations of motion and its arguments t, x, qdd and inputs; it
    shares all but qdd and numbers with the right-hand side. The storage has the vectors P of the interpolants,
    (steps, 3, size), instead of stages; `evaluations[0]` and `[1]` count those of right-hand side and Jacobian, and
    `work` is from `workspace`.
    """
    interval, x, n = problem.interval, problem.arguments[1], len(slopes[1][2])
    T, X, P, H, _, work = steps
    for step in range(len(T) - 1):
        t, y = T[step], X[step]
        smallest = shortest_step(t)
        h = min(max(H[step], smallest), interval.max_step)
        if not linearise(problem, slopes, steps, t, y):
            return step
        rejected = False
        while True:
            if not h >= smallest:
                return step
            tried, reached = h, min(t + h, interval.end)
            h = reached - t
            set_up(work.S, n, len(x), 1.0 / (h * GAMMA), work.W)
            error = math.inf
            if eliminate(work.W, work.G):
                if not solve_stages(problem, steps, n, t, y, h):
                    return step
                error = error_norm(interval.tableau.E, work.U, 1.0, y, x, interval, work.f)
            if error < 1:
                break
            h *= step_factor(error, EXPONENT)
            rejected = True
        longer = h * step_factor(error, EXPONENT)
        H[step + 1] = max(min(h, longer) if rejected else longer, tried if h < tried else 0.0)
        T[step + 1] = reached
        put(x, X[step + 1])
        for k in range(len(P[step])):
            combine(interval.tableau.interpolant[k], STAGES, work.U, P[step, k])
        if reached >= interval.end:
            return step + 1
    return len(T) - 1


def take_segments(problem: Any, slopes: Any, steps: Any) -> int:
    """Take steps from break to break, as far as the end or the arrays allow; returns their number."""
    (T, X, P, H, count, work), step = steps, 0
    while step < len(T) - 1 and T[step] < problem.interval.end:
        part = until_break(problem.interval, T[step])
        room = Storage(T[step:], X[step:], P[step:], H[step:], count, work)
        step += take_steps(Problem(problem.rates, problem.arguments, part), slopes, room)
        if T[step] < part.end:
            return step
    return step


def workspace(n: int, counted: int, size: int) -> RosenbrockRoom:
    """Workspace for n coordinates and a state of this size, whose integrals start at `counted`."""
    rows = counted - n
    systems = (size - n, size + n + 1), (rows, rows + counted + 1), (counted + 1, rows), (rows,)
    return RosenbrockRoom(*(np.zeros(shape) for shape in (*systems, (STAGES, size), (size,), (size,))))


def inside(begin: Array, end: Array, vectors: Array, s: Array) -> Array:
    """States at fractions s of steps, shape (..., 1), from those at the ends and the vectors (..., 3, size)."""
    first, second, third = (vectors[..., k, :] for k in range(3))
    states: Array = (1 - s) * begin + s * (end + (1 - s) * (first + s * (second + s * third)))
    return states
