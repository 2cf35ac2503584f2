"""The equations Y x = tau of measured motions, kept as triangular factors: one for each block of time and each joint.

A factor R of [Y tau] has |Y x - tau| = |R (x, -1)| for every x. Weights of joints, fits without some of the blocks and
errors on those blocks therefore need no row of the measurement again.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ...basics.spatial import Array
from ...errors import NotFiniteError
from ...model.standard_parameters import StandardParameters
from ...robot import Robot
from ..log.prepared import Prepared, rows_without
from ..log.screening import runs

REST = 0.5  # periods of the cut-off, below which a joint turns back without resting
LARGEST = 1e150  # number whose square is still one


@dataclass(frozen=True, eq=False)
class Equations:
    """Triangular factors of the equations of each block and joint."""

    factors: Array  # of [Y tau], shape (blocks, n, P + 1, P + 1); the last column belongs to tau
    rows: Array  # how many equations each has, shape (blocks, n)

    @property
    def joints(self) -> int:
        """Number of joints."""
        return int(self.factors.shape[1])

    def of_blocks(self, chosen: Array) -> Equations:
        """Those of some blocks, by a mask or by indices."""
        return Equations(self.factors[chosen], self.rows[chosen])

    def merged(self) -> Equations:
        """All blocks as one."""
        by_joint = np.moveaxis(self.factors, 1, 0)
        factors = triangular(by_joint.reshape(self.joints, -1, by_joint.shape[-1]))
        return Equations(factors[None], self.rows.sum(0, keepdims=True))

    def of_joint(self, j: int) -> Equations:
        """Those of one joint."""
        return Equations(self.factors[:, [j]], self.rows[:, [j]])

    def mapped(self, E: Array) -> Equations:
        """Those of other unknowns z, of which the present ones are x = E z."""
        factors = np.concatenate([self.factors[..., :-1] @ E, self.factors[..., -1:]], axis=-1)
        return Equations(triangular(factors), self.rows)

    def scaled(self, gains: Array, known: Array) -> Equations:
        """Those of torques times gains, for the joints that are known."""
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


class RecordEquations(NamedTuple):
    """The equations Y x = tau of one record, of its reduced rows."""

    Y: Array  # shape (rows, n, P)
    tau: Array  # shape (rows, n)
    valid: Array  # shape (rows, n): the torque was measured
    used: Array  # shape (rows, n): valid, and the joint is not about to stop
    sure: Array  # shape (rows, n): used, and the joint did not rest for a while beside, where friction takes any value


def resting(record: Prepared, minimum_velocity: Array) -> Array:
    """True at samples where a joint rests for a while, and its friction takes any value, shape (T, n)."""
    slow = np.abs(record.qd) < minimum_velocity
    shortest = REST * record.sample_rate / record.cutoff
    for flags in slow.T:
        for begin, end in runs(flags):
            if end - begin < shortest:
                flags[begin:end] = False
    return slow


def record_equations(
    robot: Robot, standard: StandardParameters, record: Prepared, minimum_velocity: Array, still: Array
) -> RecordEquations:
    """The equations of a record; those of joints slower than their minimum velocity are not used, `still` ones rest."""
    qd, qdd = record.qd * ~still, record.qdd * ~still
    bodies, first = robot.regressor(record.q, qd, qdd), standard.groups["bodies"].stop
    rows = np.zeros((len(record.times), robot.n, standard.count))
    for j in range(robot.n):  # one by one, to need less memory; most bodies and drives are not felt by a joint
        felt = np.flatnonzero(bodies[:, j].any(axis=0))
        places, drives = standard.drive_columns_of(j, qd, qdd)
        columns = np.concatenate([bodies[:, j, felt], drives], axis=1)
        rows[:, j, np.append(felt, first + places)] = record.reduce(columns)
    used = record.valid & ((record.reduce(np.abs(qd)) > minimum_velocity) | (minimum_velocity == 0))
    sure = used & rows_without(record, resting(record, minimum_velocity))
    return RecordEquations(rows, record.reduce(record.tau), record.valid, used, sure)
