"""The equations Y x = tau of measured motions, kept as triangular factors: one for each block of time and each joint.

A factor R of [Y tau] has |Y x - tau| = |R (x, -1)| for every x. Weights of joints, fits without some of the blocks and
errors on those blocks therefore need no row of the measurement again.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ...basics.spatial import Array
from ...errors import NotFiniteError

LARGEST = 1e150  # number whose square is still one


@dataclass(frozen=True, eq=False)
class Equations:
    """The equations of blocks of time, by joint, each kept as the triangular factor of [Y tau]."""

    factors: Array  # shape (blocks, n, P + 1, P + 1); the last column belongs to tau
    rows: Array  # number of equations that each stands for, shape (blocks, n)

    @property
    def joints(self) -> int:
        """Number of joints."""
        return int(self.factors.shape[1])

    def of_blocks(self, chosen: Array) -> Equations:
        """The equations of some blocks, by a mask or by indices."""
        return Equations(self.factors[chosen], self.rows[chosen])

    def merged(self) -> Equations:
        """The equations of all blocks in one."""
        by_joint = np.moveaxis(self.factors, 1, 0)
        factors = triangular(by_joint.reshape(self.joints, -1, by_joint.shape[-1]))
        return Equations(factors[None], self.rows.sum(0, keepdims=True))

    def of_joint(self, j: int) -> Equations:
        """The equations of one joint."""
        return Equations(self.factors[:, [j]], self.rows[:, [j]])

    def mapped(self, E: Array) -> Equations:
        """The equations Y E z = tau of other unknowns z, where x = E z."""
        factors = np.concatenate([self.factors[..., :-1] @ E, self.factors[..., -1:]], axis=-1)
        return Equations(triangular(factors), self.rows)

    def scaled(self, gains: Array, known: Array) -> Equations:
        """The equations of torques times gains, of the joints whose gain is known."""
        factors = self.factors * known[:, None, None]
        factors[..., -1] *= gains[:, None]
        return Equations(factors, self.rows * known)

    def residuals(self, x: Array) -> Array:
        """|Y x - tau|^2 of each joint, shape (n,)."""
        return np.asarray(((self.factors @ np.append(x, -1.0)) ** 2).sum((0, 2)))

    def torques(self) -> Array:
        """|tau|^2 of each joint, shape (n,)."""
        return np.asarray((self.factors[..., -1] ** 2).sum((0, 2)))

    def shares(self, x: Array) -> Array:
        """|Y x - tau| / |tau| of each joint, shape (n,)."""
        return np.asarray(np.sqrt(self.residuals(x) / np.maximum(self.torques(), np.finfo(float).tiny)))

    def rms_torques(self) -> Array:
        """Root mean square of each joint's torques, shape (n,)."""
        return np.asarray(np.sqrt(self.torques() / np.maximum(self.rows.sum(0), 1)))

    def weighted(self, sigma: Array) -> Array:
        """One triangular factor of the equations of all joints, those of joint j divided by sigma[j]."""
        scaled = self.factors / sigma[:, None, None]
        return triangular(scaled.reshape(-1, scaled.shape[-1]))


def triangular(rows: Array) -> Array:
    """The triangular factor of a matrix or of several, shape (..., P, P): zero rows where there are few."""
    width = rows.shape[-1]
    missing = max(width - rows.shape[-2], 0)
    padding = [(0, 0)] * (rows.ndim - 2) + [(0, missing), (0, 0)]
    return np.asarray(np.linalg.qr(np.pad(rows, padding), mode="r"))


def equations(Y: Array, tau: Array, used: Array, blocks: Sequence[slice]) -> Equations:
    """The used rows of measured motions, compressed: Y of shape (N, n, P), torques and `used` of shape (N, n)."""
    n, P = Y.shape[1:]
    factors, rows = np.zeros((len(blocks), n, P + 1, P + 1)), np.zeros((len(blocks), n), int)
    for k, block in enumerate(blocks):
        for j in range(n):
            chosen = used[block, j]
            rows[k, j] = chosen.sum()
            augmented = np.concatenate([Y[block, j][chosen], tau[block, j][chosen, None]], axis=1)
            factors[k, j] = triangular(augmented)
    if not (np.abs(factors).max(initial=0) < LARGEST):
        raise NotFiniteError("the equations overflow: torques or velocities of the measurements are too large")
    return Equations(factors, rows)


def joined(parts: Sequence[Equations]) -> Equations:
    """The blocks of several measurements as one."""
    return Equations(np.concatenate([p.factors for p in parts]), np.concatenate([p.rows for p in parts]))


def with_prior(factor: Array, first: int, weights: Array, values: Array | float = 0.0) -> Array:
    """Triangular equations, and w x = w v of the unknowns from the first one on, of weights w and values v."""
    known = np.zeros((len(weights), factor.shape[1]))
    known[:, first : first + len(weights)], known[:, -1] = np.diag(weights), weights * values
    return triangular(np.concatenate([factor, known]))
