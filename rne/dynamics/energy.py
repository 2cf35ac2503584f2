"""Energies and momentum from velocities and positions only: independent of the recursions that they test."""

from __future__ import annotations

import numpy as np

from ..basics.spatial import Array, cross, dot, rotate, rotate_back, zeros
from ..model.model import Model
from .kinematics import (
    BASE,
    body_poses,
    coordinate_map_rate,
    joint_transforms,
    joint_velocities,
    on_coordinates,
    velocities,
)
from .quantity import quantity
from .rnea import gravity_torque


@quantity(moments=True)
def link_kinetic_energies(model: Model, q: Array, qd: Array) -> Array:
    """Kinetic energy of every moving body: (m v_c.v_c + omega.I omega) / 2.

    Høifødt 2011, (6.30). Parameters and errors are those of `rne.Robot.kinetic_energy`, with the model first.

    Returns
    -------
    ndarray, shape (..., nb)
        In the order of `model.moving_joints`, without that of the drives (`armature`) [J].

    Examples
    --------
    >>> import rne
    >>> rne.dynamics.link_kinetic_energies(rne.irb140(), [0] * 6, [0] * 6).tolist()
    [0.0, 0.0, 0.0, 0.0, 0.0, 0.0]
    """
    omega, v = velocities(model, *joint_transforms(model, q), joint_velocities(model, q, qd))
    T = zeros((*q.shape[:-1], model.nb), like=q)
    for i in range(model.nb):
        T[..., i] = body_kinetic_energy(model, i, omega[i], v[i])
    return T


def body_kinetic_energy(model: Model, i: int, omega: Array, v: Array) -> Array:
    """(m v_c.v_c + omega.I omega) / 2, Høifødt 2011, (6.30), of a body whose frame's origin moves with v."""
    if model.given_moments is not None:  # bodies without mass have no centre
        m, h, I = model.body_moments(i)
        twice = dot(v, m * v + 2 * cross(omega, h)) + dot(omega, rotate(I, omega))
    else:
        v_c = v + cross(omega, model.com[i])
        twice = model.mass[i] * dot(v_c, v_c) + dot(omega, rotate(model.inertia[i], omega))
    return twice / 2


@quantity(moments=True)
def kinetic_energy(model: Model, q: Array, qd: Array) -> Array:
    """Kinetic energy of the robot, drives (`armature`) included; equal to qd^T M qd / 2.

    Høifødt 2011, (6.31), by (6.30) summed over the bodies. Parameters, result and errors are those of
    `rne.Robot.kinetic_energy`, with the model first.
    """
    of_bodies, qd = link_kinetic_energies.core(model, q, qd), joint_velocities(model, q, qd)
    T: Array = of_bodies.sum(-1) + (model.armature * qd * qd).sum(-1) / 2
    return T


@quantity(moments=True)
def potential_energy(model: Model, q: Array) -> Array:
    """Potential energy of the moving bodies in gravity, zero at the height of the root link's origin.

    Høifødt 2011, (6.32), with the heights from the kinematics. Parameters, result and errors are those of
    `rne.Robot.potential_energy`, with the model first.
    """
    R0, p0 = body_poses(model, q)
    U = zeros(q.shape[:-1], like=q)
    for i in range(model.nb):
        m, h, _ = model.body_moments(i)
        U = U - dot(model.gravity, m * p0[i] + rotate(R0[i], h))
    return U


@quantity(moments=True)
def momentum(model: Model, q: Array, qd: Array) -> Array:
    """Momentum of the moving bodies about the root link's origin.

    Featherstone 2008, (2.61), summed over the bodies. Parameters, result and errors are those of
    `rne.Robot.momentum`, with the model first.
    """
    omega, v = velocities(model, *joint_transforms(model, q), joint_velocities(model, q, qd))
    R0, p0 = body_poses(model, q)
    total = zeros((*q.shape[:-1], 6), like=q)
    for i in range(model.nb):
        linear, angular = (rotate(R0[i], part) for part in body_momentum(model, i, omega[i], v[i]))
        total[..., 3:] = total[..., 3:] + linear
        total[..., :3] = total[..., :3] + angular + cross(p0[i], linear)
    return total


@quantity(base_parameters=True)
def lagrangian_derivatives(model: Model, q: Array, qd: Array) -> Array:
    """Derivatives of L = T - U: dL/dqd = M qd, and dL/dq = C^T qd - g; shape (..., 2 n).

    The momentum P of the bodies that joint i carries is summed inwards. Its component along the axis is (M qd)_i, and
    since joint i changes their velocities by -S_i x V_i per unit, dT/dq_i = -P . (S_i x V_i): spatial vectors of
    Featherstone 2008, section 2.9.
    """
    R, p = joint_transforms(model, q)
    s, t, rates = model.angular_axis, model.linear_axis, joint_velocities(model, q, qd)
    omega, v = velocities(model, R, p, rates)
    carried = {i: body_momentum(model, i, omega[i], v[i]) for i in range(model.nb)}
    momenta, forces = (zeros(rates.shape, like=rates) for _ in range(2))
    for i in reversed(range(model.nb)):
        f, n = carried[i]
        momenta[..., i] = dot(n, s[i]) + dot(f, t[i]) + model.armature[i] * rates[..., i]
        forces[..., i] = dot(n, cross(omega[i], s[i])) + dot(f, cross(v[i], s[i]) + cross(omega[i], t[i]))
        if (parent := model.parent[i]) != BASE:
            f = rotate(R[i], f)
            carried[parent] = carried[parent][0] + f, carried[parent][1] + rotate(R[i], n) + cross(p[i], f)
    by_positions = on_coordinates(model, q, forces) - gravity_torque.core(model, q)
    if model.couplings:  # G of the joints' velocities G qd changes with q
        by_positions = by_positions + rotate_back(coordinate_map_rate(model, q, qd), momenta)
    return np.concatenate([on_coordinates(model, q, momenta), by_positions], axis=-1)


def body_momentum(model: Model, i: int, omega: Array, v: Array) -> tuple[Array, Array]:
    """Linear momentum of a body, and angular momentum about its frame's origin, which moves with v."""
    if model.given_moments is not None:  # bodies without mass have no centre
        m, h, I = model.body_moments(i)
        return m * v + cross(omega, h), rotate(I, omega) + cross(h, v)
    c = model.com[i]
    linear = model.mass[i] * (v + cross(omega, c))
    return linear, rotate(model.inertia[i], omega) + cross(c, linear)
