"""Energies and momentum from velocities and positions alone: independent of the recursions they test."""

from __future__ import annotations

from ..basics.spatial import Array, cross, dot, rotate, zeros
from ..model.model import Model
from .kinematics import body_poses, joint_transforms, velocities
from .quantity import quantity


@quantity(moments=True)
def link_kinetic_energies(model: Model, q: Array, qd: Array) -> Array:
    """Kinetic energy of every moving body: (m v.v + 2 v.(omega x h) + omega.I omega) / 2.

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
    Høifødt 2011, (6.30), with the velocity v of the frame's origin, the first moment h and the inertia I about it.

    Examples
    --------
    >>> import rne
    >>> rne.link_kinetic_energies(rne.irb140(), [0] * 6, [0] * 6).tolist()
    [0.0, 0.0, 0.0, 0.0, 0.0, 0.0]
    """
    omega, v = velocities(model, *joint_transforms(model, q), qd)
    T = zeros((*q.shape[:-1], model.nb), like=q)
    for i in range(model.nb):
        m, h, I = model.body_moments(i)
        linear = m * v[i] + 2 * cross(omega[i], h)
        T[..., i] = (dot(v[i], linear) + dot(omega[i], rotate(I, omega[i]))) / 2
    return T


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
    >>> rne.kinetic_energy(rne.irb140(), [0] * 6, [0, 0, 0, 0, 0, 2]).round(6).item()  # 1.458e-3 kg m^2 at 2 rad/s
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
    >>> rne.potential_energy(rne.irb140(), [0] * 6).round(5).item()
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
    >>> rne.momentum(rne.irb140(), [0] * 6, [0] * 6).tolist()
    [0.0, 0.0, 0.0, 0.0, 0.0, 0.0]
    """
    omega, v = velocities(model, *joint_transforms(model, q), qd)
    R0, p0 = body_poses(model, q)
    total = zeros((*q.shape[:-1], 6), like=q)
    for i in range(model.nb):
        m, h, I = model.body_moments(i)
        linear = rotate(R0[i], m * v[i] + cross(omega[i], h))
        angular = rotate(R0[i], rotate(I, omega[i]) + cross(h, v[i]))
        total[..., 3:] = total[..., 3:] + linear
        total[..., :3] = total[..., :3] + angular + cross(p0[i], linear)
    return total
