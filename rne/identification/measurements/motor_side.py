"""Measurements at the motors brought to the joints."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ...basics.arrays import real_array, vector
from ...basics.spatial import Array

SINGULAR = 1e-10  # smallest singular value as a part of the largest, with each motor's row scaled to one


class MotorSide(NamedTuple):
    """Gears between motors and joints.

    Attributes
    ----------
    K : ndarray, shape (n, n)
        Motor positions per joint positions: motor_q = K (q - offsets), and tau = K^T motor_tau.
    drive_gains : ndarray, shape (n,)
        Motor torque per unit of what was measured [N m/A for currents].
    offsets : ndarray, shape (n,)
        Joint positions where the motors read zero [rad].
    """

    K: Array
    drive_gains: Array
    offsets: Array

    def positions(self, motor_q: Array) -> Array:
        """Joint positions, q = K^-1 motor_q + offsets."""
        return self.rates(motor_q) + self.offsets

    def rates(self, motor_qd: Array) -> Array:
        """Joint rates, qd = K^-1 motor_qd."""
        return np.linalg.solve(self.K, motor_qd.T).T

    def torques(self, measured: Array) -> Array:
        """Joint torques, tau = K^T (drive_gains measured): the power tau . qd is that of the motors."""
        joint: Array = (self.drive_gains * measured) @ self.K
        return joint


def motor_side(
    n: int, ratios: ArrayLike, coupling: ArrayLike | None, drive_gains: ArrayLike | None, offsets: ArrayLike | None
) -> MotorSide:
    """Check the gears of n motors."""
    gears = vector("ratios", ratios, n)
    if (gears == 0).any():
        raise ValueError(f"`ratios` must not be zero, got zero for joint {int(np.argmin(np.abs(gears))) + 1}")
    mixed = np.eye(n) if coupling is None else np.array(real_array("coupling", coupling, f"({n}, {n})"), np.float64)
    rows = np.linalg.norm(mixed, axis=1)
    if (rows == 0).any() or np.linalg.cond(mixed / rows[:, None]) > 1 / SINGULAR:
        raise ValueError(
            "`coupling` must be invertible: joint positions do not follow from the motors' through a singular matrix"
        )
    gains = np.ones(n) if drive_gains is None else vector("drive_gains", drive_gains, n)
    if (gains == 0).any():
        raise ValueError(f"`drive_gains` must not be zero, got zero for joint {int(np.argmin(np.abs(gains))) + 1}")
    return MotorSide(gears[:, None] * mixed, gains, np.zeros(n) if offsets is None else vector("offsets", offsets, n))
