"""Fourier series of joint positions: the linear maps from coefficients to positions, rates and accelerations."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ..basics.spatial import Array

States = tuple[Array, Array, Array]  # q, qd and qdd, or the matrices that give them


@dataclass(frozen=True)
class FourierBasis:
    """q(t) = q0 + sum over k of a_k / (k w) sin(k w t) - b_k / (k w) cos(k w t), with w = 2 pi / duration.

    Swevers et al. 1997, (4). A coefficient vector is (q0, a_1 ... a_H, b_1 ... b_H): 2 H + 1 numbers per joint.

    Attributes
    ----------
    duration : float
        The period [s].
    harmonics : int
        The number H of harmonics.
    """

    duration: float
    harmonics: int

    @property
    def frequencies(self) -> Array:
        """k w of each harmonic, shape (H,) [rad/s]."""
        return 2 * np.pi / self.duration * np.arange(1, self.harmonics + 1)

    def states(self, t: Array, coefficients: Array) -> States:
        """q, qd and qdd of n series, coefficients of shape (n, 2 H + 1), at times of shape (..., 1)."""
        w = self.frequencies
        q0, a, b = coefficients[:, 0], coefficients[:, 1 : self.harmonics + 1], coefficients[:, self.harmonics + 1 :]
        s, c = np.sin(t * w), np.cos(t * w)
        return q0 + s @ (a / w).T - c @ (b / w).T, c @ a.T + s @ b.T, c @ (b * w).T - s @ (a * w).T

    def grid(self, count: int) -> States:
        """Matrices, shape (count, 2 H + 1), from coefficients to q, qd and qdd at equal intervals of one period."""
        t = np.arange(count) * (self.duration / count)
        return self.states(t[:, None], np.eye(2 * self.harmonics + 1))

    def grid_share(self, count: int) -> float:
        """What part of its maximum over all times a series reaches at least on a grid of so many times.

        cos(pi H / count): next to a maximum a trigonometric polynomial of degree H falls no faster than the cosine of
        its highest harmonic (Bernstein and Szego; Ehlich and Zeller 1964).
        """
        return float(np.cos(np.pi * self.harmonics / count))

    @cached_property
    def from_rest(self) -> Array:
        """Orthonormal coefficient vectors with qd(0) = qdd(0) = 0, shape (2 H + 1, 2 H - 1).

        The rates are zero if the a_k add up to zero, the accelerations if the k b_k do.
        """
        _, qd, qdd = self.grid(1)
        _, _, rows = np.linalg.svd(np.vstack([qd, qdd / self.frequencies[-1]]))
        free: Array = rows[2:].T
        return free
