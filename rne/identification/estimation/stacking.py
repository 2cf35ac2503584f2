"""From prepared measurements to equations: the regressor along a motion, filtered as the torques are."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ...basics.spatial import Array
from ...model.standard_parameters import StandardParameters
from ...robot import Robot
from ..measurements.prepared import Prepared
from .equations import Equations, equations


class Stacked(NamedTuple):
    """The equations Y x = tau of one record, of its reduced rows."""

    Y: Array  # shape (rows, n, P)
    tau: Array  # shape (rows, n)
    valid: Array  # shape (rows, n): the torque was measured
    used: Array  # shape (rows, n): valid, and the joint is not about to stop

    def compressed(self, blocks: tuple[slice, ...]) -> tuple[Equations, Equations]:
        """Equations to fit, and equations to check the fit on."""
        fitted = equations(self.Y, self.tau, self.used, blocks)
        return fitted, fitted if (self.used == self.valid).all() else equations(self.Y, self.tau, self.valid, blocks)


def stacked(
    robot: Robot, standard: StandardParameters, record: Prepared, minimum_rate: Array, still: Array | None = None
) -> Stacked:
    """The equations of a record.

    Parameters
    ----------
    robot : Robot
    standard : StandardParameters
        The unknowns.
    record : Prepared
    minimum_rate : ndarray, shape (n,)
        Equations of a joint that is slower on average are not used: Coulomb friction then has no known direction
        [rad/s or m/s].
    still : ndarray of bool, shape (n,), optional
        Joints whose rates are but noise, and are taken as zero.

    Returns
    -------
    Stacked
    """
    moves = np.ones(robot.n) if still is None else ~still
    qd, qdd = record.qd * moves, record.qdd * moves
    bodies, drives = robot.regressor(record.q, qd, qdd), standard.drive_columns(qd, qdd)
    rows = [
        record.reduce(np.concatenate([bodies[:, j], drives[:, j]], axis=1)) for j in range(robot.n)
    ]  # joint by joint, to need less memory
    moving = record.reduce(np.abs(qd)) > minimum_rate
    moving |= minimum_rate == 0
    return Stacked(np.stack(rows, axis=1), record.reduce(record.tau), record.valid, record.valid & moving)
