"""Gauss's collocation method of order 4 on (q, p), which rne.simulate's DOP853 is compared with over long free swings.

It is symplectic, so that its energy error stays bounded; in (q, qd) it would not be. With p = M qd, dq/dt = M^-1 p and
dp/dt = d(T - V)/dq at constant qd: Hairer, Lubich, Wanner 2006, Geometric Numerical Integration, II.1.3 and VIII.6.
"""

from __future__ import annotations

from collections.abc import Callable
from math import sqrt

import numpy as np

import rne
from rne.dynamics.energy import kinetic_energy, potential_energy
from rne.dynamics.forward import solve_mass_matrix
from rne.dynamics.quantity import quantity

WEIGHTS = np.array([[0.25, 0.25 - sqrt(3) / 6], [0.25 + sqrt(3) / 6, 0.25]])  # of the stages; 1/2 each in the sum
# A cubic through the stages of two steps gives the guess of the next ones.
NODES = np.array([0.5 - sqrt(3) / 6, 0.5 + sqrt(3) / 6])
GUESS = np.linalg.solve(np.vander(np.append(NODES - 1, NODES), increasing=True).T, np.vander(NODES + 1, 4, True).T).T
ROUNDS, CONVERGED = 60, 1e-13  # relative to the largest entry: the bound of the energy error needs this


@quantity()
def lagrangian(model: rne.Model, q: np.ndarray, qd: np.ndarray) -> np.ndarray:
    """Kinetic minus potential energy [J]."""
    difference: np.ndarray = kinetic_energy.core(model, q, qd) - potential_energy.core(model, q)
    return difference


def swing(robot: rne.Robot, x0: np.ndarray, grid: np.ndarray, h: float) -> tuple[np.ndarray, np.ndarray]:
    """Positions and velocities at the times of an even grid, each shape (T, n), by equal steps of at most h."""
    n, p, rates = robot.n, robot.mass_matrix(x0[: robot.n]) @ x0[robot.n :], robot.kernel(solve_mass_matrix)
    slopes = hamilton(robot)
    many = max(1, int(np.ceil((grid[1] - grid[0]) / h * (1 - 1e-12))))
    h, x, K, X = (grid[1] - grid[0]) / many, np.append(x0[:n], p), None, []
    lost, before = np.zeros(2 * n), None  # rounding that is added back (Kahan's sum); stages of the last step
    for k in range(many * (len(grid) - 1) + 1):
        if k % many == 0:
            X.append(x)
        guess = np.tile(slopes(x[None]), (2, 1)) if K is None else K if before is None else GUESS @ [*before, *K]
        before, K = K, stages(slopes, x, h, guess)
        move = h * K.mean(axis=0) + lost
        lost, x = move - ((x + move) - x), x + move
    q, p = np.split(np.array(X), 2, axis=1)
    return q, rates(q, p)


def hamilton(robot: rne.Robot) -> Callable[[np.ndarray], np.ndarray]:
    """Hamilton's equations for states (q, p), shape (k, 2 n), one by one as a solver asks."""
    n, rates, slopes = robot.n, robot.kernel(solve_mass_matrix), robot.kernel(lagrangian, "q")

    def derivative(x: np.ndarray) -> np.ndarray:
        qd = rates.state_function(x[:n], x[n:])
        return np.concatenate([qd, slopes.state_function(x[:n], qd)])

    return lambda X: np.array([derivative(x) for x in X])


def stages(slopes: Callable[[np.ndarray], np.ndarray], x: np.ndarray, h: float, guess: np.ndarray) -> np.ndarray:
    """The slopes K_i = f(x + h sum a_ij K_j), by iteration from a guess until nothing changes but rounding."""
    K, last, small = guess, np.inf, CONVERGED * float(np.abs(x).max(initial=1.0))
    for _ in range(ROUNDS):
        new = slopes(x + h * WEIGHTS @ K)
        change, K = h * float(np.abs(new - K).max()), new
        if change <= small or (change >= last and change < 10 * small):
            return K
        last = min(last, change)
    raise ArithmeticError(f"the stages do not converge in steps of {h:g} s (last change {last:.1e})")
