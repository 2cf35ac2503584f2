"""Gauss's collocation method of order 4 on (q, p): symplectic, so that the energy error of a free motion stays bounded.

In (q, qd) it would not be symplectic: with p = M qd, dq/dt = M^-1 p and dp/dt = d(T - V)/dq at constant qd are
Hamilton's equations. Hairer, Lubich, Wanner 2006, Geometric Numerical Integration, II.1.3 and VIII.6.
"""

from __future__ import annotations

from math import sqrt

import numpy as np

from ..basics.spatial import Array
from ..dynamics.energy import kinetic_energy, potential_energy
from ..dynamics.forward import solve_mass_matrix
from ..dynamics.quantity import quantity
from ..errors import NotFiniteError, SingularMassMatrixError
from ..kernels.python_backend import Refused
from ..model.model import Model
from ..robot import Robot
from .plant import Plant
from .trajectory import Run, Task

METHOD = "gauss-4"
NODES = np.array([0.5 - sqrt(3) / 6, 0.5 + sqrt(3) / 6])  # the weights b are 1/2 and 1/2
WEIGHTS = np.array([[0.25, 0.25 - sqrt(3) / 6], [0.25 + sqrt(3) / 6, 0.25]])
STEP = 5e-3  # [s], if none is given
ITERATIONS = 60
HISTORY = 2  # past steps whose slopes are extrapolated to guess those of the next
CONVERGED = 1e-13  # of the largest entry: the bound of the energy error needs the stages nearly to rounding


@quantity()
def lagrangian(model: Model, q: Array, qd: Array) -> Array:
    """Kinetic minus potential energy [J]."""
    difference: Array = kinetic_energy.core(model, q, qd) - potential_energy.core(model, q)
    return difference


class Hamilton:
    """dx/dt of x = (q, p) for a robot without drives and friction."""

    def __init__(self, robot: Robot) -> None:
        self.robot, self.n = robot, robot.n
        self.rates = robot.kernel(solve_mass_matrix)
        self.slopes = robot.kernel(lagrangian, "q")
        self.evaluations = 0

    def __call__(self, X: Array) -> Array:
        """Hamilton's equations for a few states, shape (k, 2 n)."""
        self.evaluations += len(X)
        n = self.n
        if self.rates.is_unrolled and self.slopes.is_unrolled:
            try:
                parts = []
                for x in X.tolist():
                    q = x[:n]
                    qd = self.rates.state_function(q, x[n:])
                    parts += [qd, self.slopes.state_function(q, qd.tolist())]
                return np.array(parts).reshape(X.shape)
            except Refused:
                pass  # named below
        rates = self.rates(X[:, :n], X[:, n:])
        return np.concatenate([rates, self.slopes(X[:, :n], rates)], axis=1)


def symplectic_run(plant: Plant, task: Task, failures: list[tuple[float, str]]) -> Run:
    """Equal steps, at most `step` long; values between their ends are those of the collocation polynomial."""
    n = plant.robot.n
    system = Hamilton(plant.robot)
    near = STEP if task.step is None else task.step
    count = max(1, int(np.ceil(task.duration / near * (1 - 1e-12))))
    h = task.duration / count
    grid = np.linspace(0.0, task.duration, count + 1) if task.t_eval is None else task.t_eval
    found = np.zeros((len(grid), 2 * n))
    x0 = task.x0
    x = np.concatenate([x0[:n], plant.robot.mass_matrix(x0[:n]) @ x0[n : 2 * n]])
    weights = [_continuation(NODES, k) for k in range(1, HISTORY + 1)]
    lost = np.zeros_like(x)  # rounding error of x, added back at the next step (Kahan's compensated sum)
    done, k = 0, 0
    try:
        history = [np.tile(system(x[None]), (len(NODES), 1))]
        for k in range(count):
            while done < len(grid) and grid[done] <= k * h * (1 + 1e-15):
                found[done] = x
                done += 1
            guess = weights[len(history) - 1] @ np.concatenate(history) if k else history[0]
            stages = solve_stages(system, x, h, WEIGHTS, guess)
            history = [*history[k == 0 or len(history) == HISTORY :], stages]
            while done < len(grid) and grid[done] < (k + 1) * h * (1 - 1e-12):
                found[done] = x + h * _weights(NODES, grid[done] / h - k) @ stages
                done += 1
            move = h * stages.mean(axis=0) + lost
            lost = move - ((x + move) - x)
            x = x + move
    except (NotFiniteError, SingularMassMatrixError, ArithmeticError) as error:
        failures.append((k * h, str(error)))
        grid = grid[:done]
    found = found[: len(grid)]
    found[done:] = x
    plant.evaluations += system.evaluations
    return Run(grid, _states(plant.robot, found, system), 0, f"{count} steps of {h:.6g} s")


def solve_stages(system: Hamilton, x: Array, h: float, a: Array, guess: Array) -> Array:
    """The slopes K_i = f(x + h sum a_ij K_j), by iteration from a guess until nothing changes but rounding."""
    K, ha, last = guess, h * a, np.inf
    small = CONVERGED * float(np.abs(x).max(initial=1.0))
    for _ in range(ITERATIONS):
        new = system(x + ha @ K)
        change = h * float(np.abs(new - K).max())
        K = new
        if change <= small or (change >= last and change < 10 * small):
            return K
        if change > 1e3 * last:
            break
        last = min(last, change)
    raise NotFiniteError(f"the stages do not converge (last change {change:.1e}); take a smaller `step` than {h:g} s")


def _continuation(c: Array, steps: int) -> Array:
    """Weights that continue the slopes of the last steps into the next one, by a polynomial through all of them."""
    nodes = np.concatenate([c + k - steps for k in range(steps)])
    factors = [[[(x - b) / (a - b) for b in nodes if b != a] for a in nodes] for x in c]
    weights: Array = np.prod(factors, axis=-1)
    return weights


def _weights(c: Array, s: float) -> Array:
    """Integrals from 0 to s of the Lagrange polynomials on the nodes c."""
    width = c[1] - c[0]
    return np.array([(c[1] * s - s * s / 2) / width, (s * s / 2 - c[0] * s) / width])


def _states(robot: Robot, found: Array, system: Hamilton) -> Array:
    n = robot.n
    q, p = found[:, :n], found[:, n:]
    qd = system.rates(q, p) if len(q) else p
    return np.concatenate([q, qd], axis=1)
