"""Evidence from another robot, a function, arrays of numbers or a measured motion."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ...basics.spatial import Array
from ...model.model import joint_array
from ...robot import Robot
from ..estimation.correlation import repeats_of_filtered_noise
from ..estimation.stacking import stacked
from ..measurements.prepared import Prepared
from ..measurements.record import Record
from .evidence import SMALLEST, Evidence, all_parameters, gravity_columns
from .noise import torque_noise, torque_noise_of_positions

STATES = 120  # at which two models are compared
RATE, ACCELERATION = 1.5, 5.0  # standard deviations [rad/s or m/s; rad/s^2 or m/s^2]
TURNING, SLIDING = np.pi, 0.3  # largest positions where a joint has no limits [rad; m]
TOLERANCE = 1e-8  # of torques: two models that differ by less are the same
NOISE = 1.3  # times the noise: a residual that is explained by it

Other = Robot | Callable[[Array, Array, Array], Any] | Sequence[Any] | Record


def states_of(robot: Robot, other: Other, seed: int) -> tuple[Array, Array, Array, Array]:
    """States and the other's torques."""
    n = robot.n
    if isinstance(other, Robot):
        if other.n != n:
            raise ValueError(f"`other` must have {n} joints, as the robot, got {other.n}")
        q, qd, qdd = random_states(robot, seed)
        return q, qd, qdd, other.inverse_dynamics(q, qd, qdd)
    if callable(other):
        q, qd, qdd = random_states(robot, seed)
        tau = np.asarray(other(q, qd, qdd), dtype=np.float64)
        if tau.shape != q.shape:
            raise ValueError(f"`other` must return torques of shape {q.shape}, got {tau.shape}")
    elif isinstance(other, Sequence) and len(other) == 4:
        q, qd, qdd, tau = (np.asarray(joint_array(name, x, robot.model), np.float64) for name, x in _named(other))
        if q.ndim != 2 or not q.shape == qd.shape == qdd.shape == tau.shape:
            raise ValueError(f"`other` must be four arrays of shape (N, {n}), got {[np.shape(x) for x in other]}")
        fewest = -(-all_parameters(robot).count // max(n, 1))  # as many torques as standard parameters
        if len(q) < fewest:
            raise ValueError(f"`other` must have at least {fewest} states for {n} joints, got {len(q)}")
    else:
        raise TypeError(
            "`other` must be an rne.Robot, a function of (q, qd, qdd), arrays (q, qd, qdd, tau) or an "
            f"rne.identification.Record, got {type(other).__name__}"
        )
    if not np.isfinite(tau).all():
        raise ValueError("`other`: the torques must be finite")
    return q, qd, qdd, tau


def _named(other: Sequence[ArrayLike]) -> list[tuple[str, ArrayLike]]:
    return list(zip(("q", "qd", "qdd", "tau"), other, strict=True))


def random_states(robot: Robot, seed: int) -> tuple[Array, Array, Array]:
    """States all over the ranges of the joints."""
    rng = np.random.default_rng(seed)
    model = robot.model
    drive = list(model.independent_joints)
    reach = np.array([SLIDING if model.joint_types[j] == "prismatic" else TURNING for j in drive])
    lower, upper = (np.clip(x[drive], -reach, reach) for x in (model.lower, model.upper))
    q = rng.uniform(lower, upper, (STATES, robot.n))
    scale = np.where(reach == SLIDING, SLIDING, 1.0)
    qd = RATE * scale * rng.standard_normal(q.shape)
    qdd = ACCELERATION * scale * rng.standard_normal(q.shape)
    return q, qd, qdd


def model_evidence(robot: Robot, q: Array, qd: Array, qdd: Array, tau: Array, tolerance: float) -> Evidence:
    """Torques of another model."""
    standard = all_parameters(robot)
    columns = np.concatenate([robot.regressor(q, qd, qdd), standard.drive_columns(qd, qdd)], axis=-1)
    size = np.sqrt((tau**2).mean(0)) + np.sqrt((robot.inverse_dynamics(q, qd, qdd) ** 2).mean(0))
    sigma = tolerance * np.maximum(np.maximum(size, SMALLEST * size.max()), np.finfo(float).tiny)
    gravity = gravity_columns(robot, q)
    valid = np.ones(tau.shape, bool)

    def predict(torques: Callable[[Array, Array, Array], Array]) -> Array:
        return torques(q, qd, qdd)

    return Evidence(robot, q, qd, qdd, tau, columns, gravity, standard, valid, sigma, 1.0, True, 1.0, predict)


def measured_evidence(robot: Robot, record: Prepared) -> Evidence:
    """Measured torques, filtered."""
    standard = all_parameters(robot)
    rows = stacked(robot, standard, record, np.zeros(robot.n))
    q, qd, qdd = (record.reduce(x) for x in (record.q, record.qd, record.qdd))
    gravity = record.reduce(gravity_columns(robot, record.q))
    by_positions = torque_noise_of_positions(record, robot.inverse_dynamics(record.q, record.qd, record.qdd))
    least = TOLERANCE * np.sqrt((rows.tau**2).mean(0)).max()
    sigma = np.sqrt(torque_noise(record) ** 2 + by_positions**2 + least**2)

    def predict(torques: Callable[[Array, Array, Array], Array]) -> Array:
        return record.reduce(torques(record.q, record.qd, record.qdd))

    repeats = repeats_of_filtered_noise(record.cutoff, record.sample_rate, record.decimation)
    return Evidence(
        robot, q, qd, qdd, rows.tau, rows.Y, gravity, standard, rows.valid, sigma, NOISE, False, repeats, predict
    )
