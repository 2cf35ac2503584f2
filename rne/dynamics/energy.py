"""Energies and momentum from velocities and positions alone: independent of the recursions they test."""

from __future__ import annotations

from ..basics.spatial import Array, cross, dot, rotate, zeros
from ..model.model import Model
from .kinematics import body_poses, joint_transforms, joint_velocities, velocities
from .quantity import quantity


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


def body_momentum(model: Model, i: int, omega: Array, v: Array) -> tuple[Array, Array]:
    """Linear momentum of a body, and angular momentum about its frame's origin, which moves with v."""
    if model.given_moments is not None:  # bodies without mass have no centre
        m, h, I = model.body_moments(i)
        return m * v + cross(omega, h), rotate(I, omega) + cross(h, v)
    c = model.com[i]
    linear = model.mass[i] * (v + cross(omega, c))
    return linear, rotate(model.inertia[i], omega) + cross(c, linear)
