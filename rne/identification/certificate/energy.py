"""The work of measured torques against the energy of a model: what goes in is stored or lost.

W = T + U - (T + U at the start) + losses, with W the integral of tau . qd. Energies come from their own regressors, so
that the balance does not use the torques that the model predicts (Gautier and Khalil 1988 identify with it).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ...basics.spatial import Array
from ...dynamics.regressors import kinetic_energy_regressor, potential_energy_regressor
from ...model.parameters import PARAMETERS
from ...model.standard_parameters import StandardParameters
from ..measurements.prepared import Prepared

PIECES = 10  # of each segment, over which work and energy are compared


class EnergyBalance(NamedTuple):
    """Shares of the work that drives and brakes do, of `Consistency.energy`.

    Attributes
    ----------
    missing : float
        Root mean square of the energy that is neither stored nor lost in the model, in pieces of the motion, as a part
        of the work done there, forwards and backwards.
    lost : ndarray, shape (n,)
        Mean power of the residual torque of each joint as a part of that of its torque: above zero, the model loses
        less than the robot.
    power : ndarray, shape (n,)
        Root mean square of that power, as the same part.

    Examples
    --------
    >>> import numpy as np, rne
    >>> robot, t = rne.load("irb140"), np.arange(0, 10, 0.002)
    >>> q = np.sin(np.outer(t, 2 * np.pi * np.array([0.3, 0.4, 0.5, 0.6, 0.7, 0.8])))
    >>> spline = rne.trajectories.spline(t, q)
    >>> tau = robot.inverse_dynamics(*spline(t))
    >>> energy = rne.consistency(robot, rne.identification.Record(t, q, tau)).energy
    >>> bool(energy.missing < 0.01)
    True
    """

    missing: float
    lost: Array
    power: Array


def energy_balance(
    standard: StandardParameters, records: Sequence[Prepared], x: Array, residuals: Sequence[Array]
) -> EnergyBalance:
    """The balance of measured motions.

    Parameters
    ----------
    standard : StandardParameters
    records : sequence of Prepared
    x : ndarray, shape (P,)
        Standard parameters.
    residuals : sequence of ndarray, shape (R, n)
        Measured less predicted torques of each record's reduced rows.

    Returns
    -------
    EnergyBalance
    """
    pieces = np.concatenate([_pieces(standard, record, x) for record in records])
    sums = np.zeros((4, standard.model.n))
    for record, residual in zip(records, residuals, strict=True):
        rate, torque = record.reduce(record.qd), record.reduce(record.tau)
        power, total = residual * rate * record.valid, torque * rate * record.valid
        sums += [power.sum(0), np.abs(total).sum(0), (power**2).sum(0), (total**2).sum(0)]
    tiny = np.finfo(float).tiny
    work = max(float(np.sqrt((pieces[:, 1] ** 2).sum())), tiny)
    return EnergyBalance(
        float(np.sqrt((pieces[:, 0] ** 2).sum())) / work,
        sums[0] / np.maximum(sums[1], tiny),
        np.sqrt(sums[2] / np.maximum(sums[3], tiny)),
    )


def _pieces(standard: StandardParameters, record: Prepared, x: Array) -> Array:
    """Energy that is missing, and work done, in each piece; shape (pieces, 2) [J]."""
    model, bodies = standard.model, PARAMETERS * standard.model.nb
    found = []
    for part in record.segments:
        q, qd, qdd, tau = (y[part] for y in (record.q, record.qd, record.qdd, record.tau))
        ends = np.unique(np.linspace(0, len(q) - 1, PIECES + 1).astype(int))
        stored = kinetic_energy_regressor(model, q[ends], qd[ends]) + potential_energy_regressor(model, q[ends])
        drives = (qd * (standard.drive_columns(qd, qdd) @ x[bodies:])).sum(-1)  # rotors and losses
        power = (tau * qd).sum(-1)
        left = integral(power - drives, record.sample_rate)[ends]
        done = integral(np.abs(tau * qd).sum(-1), record.sample_rate)[ends]
        found.append(np.stack([np.diff(left - stored @ x[:bodies]), np.diff(done)], axis=1))
    return np.concatenate(found)


def integral(power: Array, rate: float) -> Array:
    """Integral from the first sample, by trapezoids."""
    steps = (power[1:] + power[:-1]) / (2 * rate)
    return np.concatenate([[0.0], np.cumsum(steps)])
