"""Gauss's collocation method of order 4 on (q, p): symplectic, so that the energy error of a free motion stays bounded.

In (q, qd) it would not be symplectic: with p = M qd, dq/dt = M^-1 p and dp/dt = d(T - V)/dq at constant qd are
Hamilton's equations. Hairer, Lubich, Wanner 2006, Geometric Numerical Integration, II.1.3 and VIII.6.
"""

from __future__ import annotations

from math import sqrt
from typing import Any

import numpy as np

from ..basics.spatial import Array
from ..dynamics.energy import kinetic_energy, potential_energy
from ..dynamics.forward import solve_mass_matrix
from ..dynamics.quantity import quantity
from ..errors import NotFiniteError
from ..kernels.program import NeedsRecursion
from ..model.model import Model
from .plant import Plant, System
from .solver import Steps

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


class Hamilton(System):
    """dx/dt of x = (q, p) for a robot without drives and friction, in which nothing switches."""

    def __init__(self, plant: Plant) -> None:
        self.robot, self.n, self.plant = plant.robot, plant.robot.n, plant
        self.rates = self.robot.kernel(solve_mass_matrix)
        self.slopes = self.robot.kernel(lagrangian, "q")

    def __call__(self, X: Array) -> Array:
        """Hamilton's equations for a few states, shape (k, 2 n)."""
        self.plant.evaluations += len(X)
        n = self.n
        if self.rates.is_unrolled and self.slopes.is_unrolled:
            try:
                parts = []
                for x in X:
                    q = x[:n]
                    qd = self.rates.state_function(q, x[n:])
                    parts += [qd, self.slopes.state_function(q, qd)]
                return np.array(parts).reshape(X.shape)
            except NeedsRecursion:
                pass  # named below
        rates = self.rates(X[:, :n], X[:, n:])
        return np.concatenate([rates, self.slopes(X[:, :n], rates)], axis=1)

    def start(self, x: Array) -> Array:
        """(q, p) of a state (q, qd)."""
        n = self.n
        return np.concatenate([x[:n], self.robot.mass_matrix(x[:n]) @ x[n : 2 * n]])

    def states(self, X: Array) -> Array:
        """States (T, 2 n) as (q, qd)."""
        q, p = X[:, : self.n], X[:, self.n :]
        return np.concatenate([q, self.rates(q, p)], axis=1) if len(X) else X


class GaussSolver:
    """Equal steps of Gauss's method on (q, p); inside a step, the collocation polynomial.

    Parameters
    ----------
    system : Hamilton
    duration : float
        [s]
    longest : float or None
        Steps are at most this long [s].
    """

    def __init__(self, system: Hamilton, duration: float, longest: float | None) -> None:
        self.system, self.duration = system, duration
        self.count = max(1, int(np.ceil(duration / (longest or STEP) * (1 - 1e-12))))
        self.h = duration / self.count
        self.k = 0
        self.weights = [_continuation(NODES, k) for k in range(1, HISTORY + 1)]

    def start(self, system: Any, t: float, x: Array, end: float, longest: float) -> None:
        """Begin the run."""
        self.x = x
        self.lost = np.zeros_like(x)  # rounding error of x, added back at the next step (Kahan's compensated sum)
        self.history = [np.tile(system(x[None]), (len(NODES), 1))]

    def resume(self, system: Any, t: float, x: Array, end: float) -> None:
        """Nothing jumps in a free motion."""

    @property
    def is_running(self) -> bool:
        """False when the end was reached."""
        return self.k < self.count

    def steps(self, most: int) -> GaussStep:
        """The next steps, at most so many: one."""
        k, h, x = self.k, self.h, self.x
        guess = self.weights[len(self.history) - 1] @ np.concatenate(self.history) if k else self.history[0]
        stages = solve_stages(self.system, x, h, WEIGHTS, guess)
        self.history = [*self.history[k == 0 or len(self.history) == HISTORY :], stages]
        move = h * stages.mean(axis=0) + self.lost
        self.lost = move - ((x + move) - x)
        self.x, self.k = x + move, k + 1
        end = self.duration if self.k == self.count else self.k * h
        return GaussStep(np.array([k * h, end]), np.stack([x, self.x]), h, stages)


class GaussStep(Steps):
    """One step, with what its interpolant needs."""

    def __init__(self, T: Array, X: Array, h: float, stages: Array) -> None:
        super().__init__(T, X)
        self.h, self.stages = h, stages

    def states(self, times: Array, k: Array) -> Array:
        """States at times within the step."""
        found: Array = self.X[0] + self.h * (_weights(NODES, (times - self.T[0]) / self.h).T @ self.stages)
        return found


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


def _weights(c: Array, s: Array) -> Array:
    """Integrals from 0 to s of the Lagrange polynomials on the nodes c, shape (2, m)."""
    width = c[1] - c[0]
    return np.array([(c[1] * s - s * s / 2) / width, (s * s / 2 - c[0] * s) / width])
