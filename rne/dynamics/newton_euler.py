"""Inverse dynamics by the recursive Newton-Euler formulation: forward, then backward along the tree.

Every vector of a recursion is in the axes of its own link's frame i, whose origin lies on joint i.

| quantity                              | code       | thesis    | Featherstone    | Siciliano       |
|---------------------------------------|------------|-----------|-----------------|-----------------|
| rotation, frame i to its parent       | R[i]       | R_i^{i-1} | E^T of iX_l(i)  | R_i^{i-1}       |
| origin of frame i in its parent frame | p[i]       | r_{i-2,i-1} | r of iX_l(i)  | r_{i-1,i}       |
| axis of joint i                       | b          | b_i       | S_i             | z_{i-1}         |
| angular velocity                      | omega[i]   | omega_i   | v_i, angular    | omega_i         |
| angular acceleration                  | alpha[i]   | alpha_i   | a_i, angular    | omega'_i        |
| acceleration of the frame's origin    | a_o[i]     | a_e,i-1   | a_i + omega x v | p''_i           |
| U r = alpha x r + omega x (omega x r) | U[i]       |           |                 |                 |
| mass; mass times centre; inertia about the frame's origin | m, h, I | m_i, m_i r_{i-1,ci} | m, m c, I_O | m_i |
| force, torque of the joint on body i  | f[i], n[i] | f_i, tau_i | f_i            | f_i, mu_i       |
| joint torque (or force)               | tau        | u         | tau             | tau             |

Numbers at the ends of lines are equations of Høifødt 2011; a sliding joint's are Siciliano et al. 2009, 7.5.
A point of a body at r has the acceleration a_o + U r. Summed over the body, force and moment about its frame's origin
are m a_o + U h, which is m a_c, and h x a_o + I alpha + omega x I omega, with h = m r_c and I about that origin.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from ..model import Model
from ..spatial import Array, cross, dot, rotate, rotate_back, spin_matrix, zeros
from .checks import checked
from .kinematics import joint_rates, joint_transforms

External = Mapping[str, Array]
Wrench = tuple[Array, Array]  # moment about the frame's origin, force


class Motion(NamedTuple):
    """What the forward recursion finds for every body, in its own axes."""

    omega: list[Array]
    alpha: list[Array]
    a_o: list[Array]
    U: list[Array]


def forward_recursion(model: Model, R: list[Array], p: list[Array], qd: Array, qdd: Array, a_base: Array) -> Motion:
    """Velocities and accelerations of every body, from the base outwards.

    `qd`, `qdd` are rates of the moving joints; `a_base` is the base's acceleration: -gravity, so that every body
    feels its weight as an upward acceleration, or 0 for the true accelerations.
    """
    omega: list[Array] = []
    alpha: list[Array] = []
    a_o: list[Array] = []
    U: list[Array] = []
    still = zeros((*qd.shape[:-1], 3), like=qd)
    for i, parent in enumerate(model.parent):
        omega_p, alpha_p = (omega[parent], alpha[parent]) if parent >= 0 else (still, still)
        a_p = a_o[parent] + rotate(U[parent], p[i]) if parent >= 0 else a_base  # (3.38)
        b = model.axis[i]
        b_qd, b_qdd = b * qd[..., i, None], b * qdd[..., i, None]
        omega_i = rotate_back(R[i], omega_p)
        alpha_i = rotate_back(R[i], alpha_p)
        a_i = rotate_back(R[i], a_p)
        if model.is_revolute(i):
            alpha_i = alpha_i + b_qdd + cross(omega_i, b_qd)  # (3.33)
            omega_i = omega_i + b_qd  # (3.29)
        else:
            a_i = a_i + b_qdd + 2 * cross(omega_i, b_qd)  # Siciliano (7.106)
        omega.append(omega_i)
        alpha.append(alpha_i)
        a_o.append(a_i)
        U.append(spin_matrix(omega_i, alpha_i))
    return Motion(omega, alpha, a_o, U)


def backward_recursion(
    model: Model, R: list[Array], p: list[Array], motion: Motion, applied: list[Wrench | None]
) -> tuple[list[Array], list[Array]]:
    """Force f[i] and torque n[i] of joint i on body i at its frame's origin, from the tips inwards."""
    f: list[Array] = []
    n: list[Array] = []
    for i in range(model.nb):
        m, h, I = model.moments.mass[i], model.moments.first[i], model.moments.inertia[i]
        omega, alpha, a_o, U = motion.omega[i], motion.alpha[i], motion.a_o[i], motion.U[i]
        f_i = m * a_o + rotate(U, h)  # m a_c, the body's own part of (3.24)
        n_i = cross(h, a_o) + rotate(I, alpha) + cross(omega, rotate(I, omega))  # its own part of (3.27)
        wrench = applied[i]
        if wrench is not None:
            n_i, f_i = n_i - wrench[0], f_i - wrench[1]
        f.append(f_i)
        n.append(n_i)
    for i in reversed(range(model.nb)):
        parent = model.parent[i]
        if parent >= 0:
            f_in_parent = rotate(R[i], f[i])
            f[parent] = f[parent] + f_in_parent  # (3.24)
            n[parent] = n[parent] + rotate(R[i], n[i]) + cross(p[i], f_in_parent)  # (3.27)
    return f, n


def joint_torques(model: Model, f: list[Array], n: list[Array], qdd: Array) -> Array:
    """The components the drives must give, b^T n or b^T f (5.3), summed over the joints of each coordinate."""
    tau = zeros(qdd.shape, like=qdd)
    for i in range(model.nb):
        tau[..., i] = dot(n[i] if model.is_revolute(i) else f[i], model.axis[i])
        tau[..., i] = tau[..., i] + model.armature[i] * qdd[..., i]
    return tau @ model.coordinate_map if model.has_mimics else tau


def applied_wrenches(model: Model, external: External | None) -> list[Wrench | None]:
    """External wrenches moved to the origins of the bodies they act on; None where there is none."""
    applied: list[Wrench | None] = [None] * model.nb
    for link, wrench in (external or {}).items():
        index = model.link_index(link)
        body, R, p = model.link_body[index], model.link_rotation[index], model.link_translation[index]
        if body >= 0:
            force = rotate(R, wrench[..., 3:])
            moment = rotate(R, wrench[..., :3]) + cross(p, force)
            before = applied[body]
            applied[body] = (moment, force) if before is None else (before[0] + moment, before[1] + force)
    return applied


def _newton_euler(
    model: Model, q: Array, qd: Array, qdd: Array, gravity: Array, external: External | None = None
) -> Array:
    R, p = joint_transforms(model, q)
    qd, qdd = joint_rates(model, qd), joint_rates(model, qdd)
    motion = forward_recursion(model, R, p, qd, qdd, -gravity)
    f, n = backward_recursion(model, R, p, motion, applied_wrenches(model, external))
    return joint_torques(model, f, n, qdd)


@checked
def inverse_dynamics(model: Model, q: Array, qd: Array, qdd: Array, *, external: External | None = None) -> Array:
    """Joint torques that give the arm the accelerations qdd: tau = M qdd + C qd + g.

    Parameters
    ----------
    model : Model
    q, qd, qdd : ndarray, shape (..., n)
        Joint positions, rates and accelerations [rad or m, /s, /s^2].
    external : mapping of str to ndarray, shape (..., 6), optional
        Wrenches [moment; force] acting on the robot at the named link's origin, in its axes [N m, N].

    Returns
    -------
    ndarray, shape (..., n)
        [N m or N]

    Raises
    ------
    ValueError
        If an array has the wrong shape or is not finite, or the torque overflows.

    Notes
    -----
    Recursive Newton-Euler, Høifødt 2011, (3.24)-(3.38); Featherstone 2008, table 5.1. O(n).

    Examples
    --------
    >>> import rne
    >>> rne.inverse_dynamics(rne.irb140(), [0] * 6, [0] * 6, [0, 0, 1, 0, 0, 0]).round(3)[2].item()
    -22.499
    """
    return _newton_euler(model, q, qd, qdd, model.gravity, external)


@checked
def bias_torque(model: Model, q: Array, qd: Array, *, external: External | None = None) -> Array:
    """Joint torques that hold qdd at zero: h = C qd + g, less what external wrenches carry.

    Parameters
    ----------
    model : Model
    q, qd : ndarray, shape (..., n)
        Joint positions and rates [rad or m, /s].
    external : mapping of str to ndarray, shape (..., 6), optional
        Wrenches [moment; force] acting on the robot at the named link's origin, in its axes [N m, N].

    Returns
    -------
    ndarray, shape (..., n)
        [N m or N]

    Raises
    ------
    ValueError
        If an array has the wrong shape or is not finite, or the torque overflows.

    Notes
    -----
    Inverse dynamics at qdd = 0, Høifødt 2011, appendix B; Featherstone 2008, (6.2).

    Examples
    --------
    >>> import rne
    >>> rne.bias_torque(rne.irb140(), [0] * 6, [1, 0, 0, 0, 0, 0]).shape
    (6,)
    """
    return _newton_euler(model, q, qd, np.zeros_like(qd), model.gravity, external)


@checked
def gravity_torque(model: Model, q: Array) -> Array:
    """Joint torques g(q) that carry the arm's weight at rest.

    Parameters
    ----------
    model : Model
    q : ndarray, shape (..., n)
        Joint positions [rad or m].

    Returns
    -------
    ndarray, shape (..., n)
        [N m or N]; the gradient of the potential energy.

    Raises
    ------
    ValueError
        If `q` has the wrong shape or is not finite.

    Notes
    -----
    Inverse dynamics at qd = qdd = 0, Høifødt 2011, (3.1) and appendix B.

    Examples
    --------
    >>> import math, rne
    >>> (rne.gravity_torque(rne.irb140(), [0, math.pi / 2, -math.pi / 2, 0, 0, 0]) / 9.81).round(3)[[1, 2, 4]].tolist()
    [-16.191, -2.409, -0.029]
    """
    still = np.zeros_like(q)
    return _newton_euler(model, q, still, still, model.gravity)


@checked
def coriolis_torque(model: Model, q: Array, qd: Array) -> Array:
    """Joint torques C(q, qd) qd that centrifugal and Coriolis forces ask for.

    Parameters
    ----------
    model : Model
    q, qd : ndarray, shape (..., n)
        Joint positions and rates [rad or m, /s].

    Returns
    -------
    ndarray, shape (..., n)
        [N m or N]

    Raises
    ------
    ValueError
        If an array has the wrong shape or is not finite, or the torque overflows.

    Notes
    -----
    Inverse dynamics at qdd = 0 without gravity, Høifødt 2011, (3.1) and appendix B.

    Examples
    --------
    >>> import rne
    >>> rne.coriolis_torque(rne.irb140(), [0] * 6, [0] * 6).any().item()
    False
    """
    return _newton_euler(model, q, qd, np.zeros_like(qd), np.zeros_like(model.gravity))
