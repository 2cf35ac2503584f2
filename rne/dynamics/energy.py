"""Energies and momentum from velocities and positions alone: independent of the recursions they test."""

from __future__ import annotations

from ..basics.spatial import Array, cross, dot, rotate, zeros
from ..model.model import Model
from ..model.parameters import ModelWithMoments
from .kinematics import body_poses, joint_transforms, velocities
from .quantity import quantity


@quantity(moments=True)
def link_kinetic_energies(model: Model, q: Array, qd: Array) -> Array:
    """Kinetic energy of every moving body: (m v_c.v_c + omega.I omega) / 2.

    Parameters
    ----------
    model : Model
        The robot's parameters.
    q, qd : ndarray, shape (..., n)
        Joint positions and rates [rad or m; rad/s or m/s].

    Returns
    -------
    ndarray, shape (..., nb)
        In the order of `model.moving_joints`, without that of the drives (`armature`) [J].

    Raises
    ------
    ValueError
        If an array has the wrong shape or is not finite, or the energy overflows.

    Notes
    -----
    Høifødt 2011, (6.30).

    Examples
    --------
    >>> import rne
    >>> rne.dynamics.link_kinetic_energies(rne.irb140(), [0] * 6, [0] * 6).tolist()
    [0.0, 0.0, 0.0, 0.0, 0.0, 0.0]
    """
    omega, v = velocities(model, *joint_transforms(model, q), qd)
    T = zeros((*q.shape[:-1], model.nb), like=q)
    for i in range(model.nb):
        T[..., i] = body_kinetic_energy(model, i, omega[i], v[i])
    return T


def body_kinetic_energy(model: Model, i: int, omega: Array, v: Array) -> Array:
    """(m v_c.v_c + omega.I omega) / 2, Høifødt 2011, (6.30), of a body whose frame's origin moves with v."""
    if isinstance(model, ModelWithMoments):  # bodies without mass have no centre
        m, h, I = model.body_moments(i)
        twice = dot(v, m * v + 2 * cross(omega, h)) + dot(omega, rotate(I, omega))
    else:
        v_c = v + cross(omega, model.com[i])
        twice = model.mass[i] * dot(v_c, v_c) + dot(omega, rotate(model.inertia[i], omega))
    return twice / 2


@quantity(moments=True)
def kinetic_energy(model: Model, q: Array, qd: Array) -> Array:
    """Kinetic energy of the robot, drives (`armature`) included; equal to qd^T M qd / 2.

    Parameters
    ----------
    model : Model
        The robot's parameters.
    q, qd : ndarray, shape (..., n)
        Joint positions and rates [rad or m; rad/s or m/s].

    Returns
    -------
    ndarray, shape (...)
        The energy [J].

    Raises
    ------
    ValueError
        If an array has the wrong shape or is not finite, or the energy overflows.

    Notes
    -----
    Høifødt 2011, (6.30), summed over the bodies.

    Examples
    --------
    >>> import rne
    >>> rne.dynamics.kinetic_energy(rne.irb140(), [0] * 6, [0, 0, 0, 0, 0, 2]).round(6).item()  # 1.458e-3 kg m^2
    0.002916
    """
    rates = qd[..., model.coordinate] * model.multiplier if model.has_mimics else qd
    T: Array = link_kinetic_energies.core(model, q, qd).sum(-1) + (model.armature * rates * rates).sum(-1) / 2
    return T


@quantity(moments=True)
def potential_energy(model: Model, q: Array) -> Array:
    """Potential energy of the moving bodies in gravity, zero at the height of the root link's origin.

    Parameters
    ----------
    model : Model
        The robot's parameters.
    q : ndarray, shape (..., n)
        Joint positions [rad or m].

    Returns
    -------
    ndarray, shape (...)
        The sum of -m g.c [J].

    Raises
    ------
    ValueError
        If `q` has the wrong shape or is not finite.

    Notes
    -----
    Høifødt 2011, (6.32), with the heights from the kinematics.

    Examples
    --------
    >>> import rne
    >>> rne.dynamics.potential_energy(rne.irb140(), [0] * 6).round(5).item()
    370.87686
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

    Parameters
    ----------
    model : Model
        The robot's parameters.
    q, qd : ndarray, shape (..., n)
        Joint positions and rates [rad or m; rad/s or m/s].

    Returns
    -------
    ndarray, shape (..., 6)
        [angular; linear] in the axes of the root link [kg m^2/s, kg m/s].

    Raises
    ------
    ValueError
        If an array has the wrong shape or is not finite, or the momentum overflows.

    Notes
    -----
    Featherstone 2008, (2.61), summed over the bodies. Its rate is the sum of the wrenches of
    base, gravity and environment.

    Examples
    --------
    >>> import rne
    >>> rne.dynamics.momentum(rne.irb140(), [0] * 6, [0] * 6).tolist()
    [0.0, 0.0, 0.0, 0.0, 0.0, 0.0]
    """
    omega, v = velocities(model, *joint_transforms(model, q), qd)
    R0, p0 = body_poses(model, q)
    total = zeros((*q.shape[:-1], 6), like=q)
    for i in range(model.nb):
        linear, angular = (rotate(R0[i], part) for part in body_momentum(model, i, omega[i], v[i]))
        total[..., 3:] = total[..., 3:] + linear
        total[..., :3] = total[..., :3] + angular + cross(p0[i], linear)
    return total


def body_momentum(model: Model, i: int, omega: Array, v: Array) -> tuple[Array, Array]:
    """Linear momentum of a body, and angular momentum about its frame's origin, which moves with v."""
    if isinstance(model, ModelWithMoments):  # bodies without mass have no centre
        m, h, I = model.body_moments(i)
        return m * v + cross(omega, h), rotate(I, omega) + cross(h, v)
    c = model.com[i]
    linear = model.mass[i] * (v + cross(omega, c))
    return linear, rotate(model.inertia[i], omega) + cross(c, linear)
