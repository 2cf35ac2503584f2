"""Fourier series of joint positions: the linear maps from coefficients to positions, rates and accelerations."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ..basics.spatial import Array


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

    def matrices(self, t: Array) -> tuple[Array, Array, Array]:
        """The rows that give q, qd and qdd at times of shape (T,): shape (T, 2 H + 1) each."""
        w = self.frequencies
        s, c = np.sin(t[:, None] * w), np.cos(t[:, None] * w)
        one, zero = np.ones((len(t), 1)), np.zeros((len(t), 1))
        return np.hstack([one, s / w, -c / w]), np.hstack([zero, c, s]), np.hstack([zero, -s * w, c * w])

    def grid(self, count: int) -> tuple[Array, Array, Array]:
        """`matrices` at equally spaced times of one period."""
        return self.matrices(np.arange(count) * (self.duration / count))

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
        _, qd, qdd = self.matrices(np.zeros(1))
        _, _, rows = np.linalg.svd(np.vstack([qd, qdd / self.frequencies[-1]]))
        free: Array = rows[2:].T
        return free
