"""Newton's method for the physically consistent fit, from a point near its minimum.

A cone programme is solved to a small gap of its objective, which log det leaves flat: bodies then have half of their
digits. The minimum is smooth inside the cone, and a few Newton steps find the others.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ...basics.spatial import Array

STEPS = 30
CONVERGED = 1e-16  # of the decrement, half of which is the gap of the objective to its minimum
ATTEMPTS = 40  # halvings of a step


class Barrier(NamedTuple):
    """1/2 |R y - b|^2 + w sum (tr X - log det X) of y = (entries of the matrices X, drives).

    Attributes
    ----------
    R, b : ndarray, shapes (rows, count) and (rows,)
    weight : float
        w.
    units : ndarray, shape (10, 4, 4)
        Symmetric matrices that the entries of each X multiply.
    nb : int
        Number of matrices.
    """

    R: Array
    b: Array
    weight: float
    units: Array
    nb: int

    def bodies(self, y: Array) -> Array:
        """The matrices X, shape (nb, 4, 4)."""
        X: Array = np.tensordot(y[: len(self.units) * self.nb].reshape(self.nb, -1), self.units, 1)
        return X

    def value(self, y: Array) -> float:
        """The objective; infinite outside the cone."""
        X = self.bodies(y)
        if np.linalg.eigvalsh(X).min(initial=np.inf) <= 0:
            return float("inf")
        barrier = np.trace(X, axis1=1, axis2=2).sum() - np.linalg.slogdet(X)[1].sum()
        return float(0.5 * ((self.R @ y - self.b) ** 2).sum() + self.weight * barrier)

    def slopes(self, y: Array) -> tuple[Array, Array]:
        """Gradient and Hessian."""
        gradient, hessian = self.R.T @ (self.R @ y - self.b), self.R.T @ self.R
        width = len(self.units)
        for k, inverse in enumerate(np.linalg.inv(self.bodies(y))):
            own = slice(width * k, width * (k + 1))
            turned = inverse @ self.units
            gradient[own] += self.weight * np.trace(self.units - turned, axis1=1, axis2=2)
            hessian[own, own] += self.weight * np.einsum("kab,lba->kl", turned, turned)
        return gradient, hessian


def refined(problem: Barrier, start: Array, free: Array) -> tuple[Array, Array, float]:
    """The minimum over the free entries of y; the others stay as they are.

    Parameters
    ----------
    problem : Barrier
    start : ndarray, shape (count,)
        Inside the cone.
    free : ndarray of bool, shape (count,)

    Returns
    -------
    y : ndarray, shape (count,)
    gradient : ndarray, shape (count,)
        Of the objective there; zero to rounding in the free entries.
    decrement : float
        Twice the estimated gap to the minimum.
    """
    y, decrement = start.copy(), np.inf
    for _ in range(STEPS):
        gradient, hessian = problem.slopes(y)
        step = np.zeros(len(y))
        step[free] = -np.linalg.lstsq(hessian[np.ix_(free, free)], gradient[free], rcond=None)[0]
        decrement = float(-gradient @ step)
        lengths = 0.5 ** np.arange(ATTEMPTS)
        value = problem.value(y)
        length = next((a for a in lengths if problem.value(y + a * step) <= value - 1e-4 * a * decrement), 0.0)
        y = y + length * step
        if decrement <= CONVERGED or length == 0:
            break
    return y, problem.slopes(y)[0], decrement
