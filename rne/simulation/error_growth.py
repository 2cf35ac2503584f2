"""Growth of a simulation's error: each step's local error, propagated by the variational equation.

A small deviation d of the state follows dd/dt = J(t) d, with J the Jacobian of the right-hand side along the motion.
Over a step it is multiplied by Phi = exp(Omega), with Omega from Magnus's expansion of order 4 (J at both ends and in
the middle): Hairer, Lubich, Wanner 2006, Geometric Numerical Integration, IV.7. The step's local error is the
difference of its end from an extrapolation of order 16. Errors of unknown sign are propagated as a covariance:
rounding, and the tolerance where the extrapolation does not converge, in steps over many time constants of a stiff
motion.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress

import numpy as np

from ..basics.spatial import Array
from ..errors import RneError
from .plant import Plant
from .run import Run, Task

BLOCK = 256  # steps evaluated together
LEVELS = 8  # of the extrapolation
EPS = float(np.finfo(np.float64).eps)


def error_growth(
    repeat: Callable[[Task], Run], plant: Plant, task: Task, run: Run, bound: float = np.inf
) -> tuple[Array, Array]:
    """Times of the steps and the estimated error of the worst position there, until it exceeds `bound`.

    Parameters
    ----------
    repeat : callable
        Runs a task of the same scene.
    plant : Plant
    task : Task
    run : Run
        The result of the task. With `t_eval` it lacks the solver's steps, and the task is run once more.
    bound : float
        [rad or m]
    """
    if task.t_eval is not None:
        run = repeat(task._replace(t_eval=None))
    n, size = plant.robot.n, 2 * plant.robot.n + plant.rhs.controller_states
    if n == 0:
        return run.t, np.zeros(len(run.t))
    deviation, unsigned, errors = np.zeros(size), np.zeros((size, size)), [0.0]
    for begin in range(0, len(run.t) - 1, BLOCK):
        t, X = run.t[begin : begin + BLOCK + 1], run.x[begin : begin + BLOCK + 1]
        for k, (Phi, wrong, unsure) in enumerate(zip(*_steps(plant, task, t, X, size), strict=True), start=begin + 1):
            deviation = Phi @ deviation + wrong
            unsigned = Phi @ unsigned @ Phi.T + np.diag(unsure**2)
            errors.append(float((np.abs(deviation) + np.sqrt(np.diagonal(unsigned)))[:n].max()))
            if not errors[-1] <= bound:
                return run.t[: k + 1], np.array(errors)
    return run.t, np.array(errors)


def _steps(plant: Plant, task: Task, t: Array, X: Array, size: int) -> tuple[Array, Array, Array]:
    """Phi of each step, (steps, size, size), its local error, and the error of unknown sign, (steps, size)."""
    from scipy.linalg import expm

    h = np.diff(t)
    first, last = np.nextafter(t[:-1], np.inf), np.nextafter(t[1:], 0.0)

    def rates(s: Array, x: Array) -> Array:  # at a break, evaluated inside the step
        return _rates(plant, np.clip(s, first, last), x)

    bend = rates(first, X[:-1]) - rates(last, X[1:])
    middle = (X[:-1] + X[1:]) / 2 + h[:, None] / 8 * bend  # Hermite's cubic
    times = np.concatenate([first, (first + last) / 2, last])
    J = plant.jacobians(times, np.concatenate([X[:-1], middle, X[1:]]))[:, :size, :size]
    begin, half, end = np.split(J, 3)
    length = h[:, None, None]
    Phi = expm(length / 6 * (begin + 4 * half + end) + length**2 / 12 * (end @ begin - begin @ end))
    with np.errstate(all="ignore"):  # steps over many time constants overflow
        right, unsure = (x[:, :size] for x in extrapolated(rates, first, X[:-1], h))
    wrong, allowed = X[1:, :size] - right, task.atol + task.rtol * np.abs(X[1:, :size])
    converged = (unsure <= allowed / 2).all(axis=1, keepdims=True)
    rounding = EPS * np.abs(X[1:, :size])
    return Phi, np.where(converged, wrong, 0.0), np.where(converged, rounding, allowed)


def extrapolated(
    rates: Callable[[Array, Array], Array], t: Array, x: Array, h: Array, levels: int = LEVELS
) -> tuple[Array, Array]:
    """The states one step later, and how much the last level of extrapolation changed them.

    The modified midpoint rule with 2, 4, 6, ... substeps, extrapolated to step size 0.
    Gragg, Bulirsch and Stoer; Hairer, Norsett, Wanner 1993, Solving Ordinary Differential Equations I, II.9.

    Parameters
    ----------
    rates : callable
        f(t, x), shapes (...) and (..., size).
    t, h : ndarray, shape (...)
        Start and length of each step [s].
    x : ndarray, shape (..., size)
        The states at the start.
    levels : int
        The order is twice this.
    """
    ends = []
    start = rates(t, x)
    for level in range(1, levels + 1):
        part = h / (2 * level)
        before, now = x, x + part[..., None] * start
        for k in range(1, 2 * level):
            before, now = now, before + 2 * part[..., None] * rates(t + k * part, now)
        ends.append((before + now + part[..., None] * rates(t + h, now)) / 2)
    coarser = without_steps(ends[:-1])
    finest = without_steps(ends)
    return finest, np.abs(finest - coarser)


def without_steps(ends: list[Array]) -> Array:
    """The limit of results with steps h/2, h/4, h/6, ...: Neville's scheme in their squares."""
    ends = list(ends)
    for k in range(1, len(ends)):
        for level in range(len(ends) - 1, k - 1, -1):
            squared = (np.ones((), dtype=ends[0].dtype) * (level + 1) / (level + 1 - k)) ** 2
            ends[level] = ends[level] + (ends[level] - ends[level - 1]) / (squared - 1)
    return ends[-1]


def _rates(plant: Plant, t: Array, X: Array) -> Array:
    """dx/dt in many states; NaN where it cannot be computed."""
    if plant.law is None:
        try:
            return plant.all_rates(t, X)
        except (RneError, ValueError):
            pass  # in some states
    found = np.full(X.shape, np.nan)
    for k, (time, x) in enumerate(zip(t, X, strict=True)):
        with suppress(RneError, ValueError, ArithmeticError):
            found[k] = plant.rates(float(time), x, plant.torque(float(time), x))
    return found
