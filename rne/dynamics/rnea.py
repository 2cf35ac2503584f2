"""Inverse dynamics by the recursive Newton-Euler algorithm: outwards along the tree, then back inwards.

Every vector of the recursion is in the axes of its own link's frame i, whose origin lies on joint i.

| quantity                              | code       | record  | thesis      | Featherstone    | Siciliano   |
|---------------------------------------|------------|---------|-------------|-----------------|-------------|
| rotation, frame i to its parent       | R[i]       |         | R_i^{i-1}   | E^T of iX_l(i)  | R_i^{i-1}   |
| origin of frame i in its parent frame | p[i]       |         | r_{i-2,i-1} | r of iX_l(i)    | r_{i-2,i-1} |
| axis of a rotating joint, else 0      | s[i]       |         | b_i         | S_i, angular    | z_{i-1}     |
| axis of a sliding joint, else 0       | t[i]       |         |             | S_i, linear     | z_{i-1}     |
| angular velocity                      | omega[i]   | omega   | omega_i     | v_i, angular    | omega_i     |
| the parent's, in frame i              | omega_p    |         |             |                 |             |
| angular acceleration                  | alpha[i]   | alpha   | alpha_i     | a_i, angular    | omega'_i    |
| acceleration of the frame's origin, -g | a[i]      | a_o - g | a_e,i-1 - g | a_i + omega x v | p''_{i-1} - g |
| U r = alpha x r + omega x (omega x r) | U[i]       |         |             |                 |             |
| mass; mass times centre; inertia about the frame's origin | m, h, I | | m_i, m_i r_{i-1,ci} | m, m c, I_O | m_i |
| force, moment of the joint on body i  | f[i], n[i] | f, tau  | f_i, tau_i  | f_i             | f_i, mu_i   |
| joint torque (or force)               | tau        | u       | u           | tau             | tau         |

"Record" is rne.dynamics.Recursion. Frame i has its origin on joint i; Siciliano's frame i, and the thesis's, at the far
end of link i. Numbers at the ends of lines are equations of Høifødt 2011, with two differences: the base is accelerated
by -g, where (3.24) adds each link's weight, and moments are taken about the joint, where (3.25)-(3.27) take them about
the centre of mass; forces and torques are the same. Terms of sliding joints are those of Siciliano et al. 2009,
section 7.5. A point of a body at r has the acceleration a + U r. Summed over the body, force and moment about its
frame's origin are m a + U h, which is m a_c, and h x a + I alpha + omega x I omega, with h = m r_c and I about that
origin.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from ..basics.spatial import Array, cross, dot, rotate, rotate_back, spin_matrix, zeros
from ..model.model import Model
from .kinematics import BASE, joint_accelerations, joint_transforms, joint_velocities, on_coordinates
from .quantity import quantity

External = Mapping[str, Array]


class NewtonEuler(NamedTuple):
    """Results of the recursion: vectors of the base (key BASE) and of every body by its index, and joint torques."""

    omega: dict[int, Array]
    alpha: dict[int, Array]
    a: dict[int, Array]
    U: dict[int, Array]
    f: dict[int, Array]
    n: dict[int, Array]
    tau: Array
    of_joints: Array  # torque of each moving joint, shape (..., nb), whose sums on the coordinates are tau


def newton_euler(
    model: Model, q: Array, qd: Array, qdd: Array, gravity: Array, external: External | None = None
) -> NewtonEuler:
    """The recursion. Accelerating the base by -gravity accounts for the weight of all bodies (Luh et al. 1980)."""
    R, p = joint_transforms(model, q)
    qd, qdd = joint_velocities(model, q, qd), joint_accelerations(model, q, qd, qdd)
    s, t = model.angular_axis, model.linear_axis
    zero = zeros((*qd.shape[:-1], 3), like=qd)
    omega, alpha, a, U = {BASE: zero}, {BASE: zero}, {BASE: zero - gravity}, {BASE: spin_matrix(zero, zero)}
    f, n = {BASE: zero}, {BASE: zero}

    # outwards: velocities, accelerations, and the force and moment that accelerate each body
    for i, parent in enumerate(model.parent):
        m, h, I = model.body_moments(i)
        qd_i, qdd_i = qd[..., i, None], qdd[..., i, None]
        omega_p = rotate_back(R[i], omega[parent])
        a_p = rotate_back(R[i], a[parent] + rotate(U[parent], p[i]))  # (3.38)
        omega[i] = omega_p + s[i] * qd_i  # (3.29)
        alpha[i] = rotate_back(R[i], alpha[parent]) + s[i] * qdd_i + cross(omega_p, s[i] * qd_i)  # (3.33)
        a[i] = a_p + t[i] * qdd_i + 2 * cross(omega_p, t[i] * qd_i)  # Siciliano, section 7.5
        U[i] = spin_matrix(omega[i], alpha[i])
        f[i] = m * a[i] + rotate(U[i], h)  # m_i a_c,i of (3.24)
        n[i] = cross(h, a[i]) + rotate(I, alpha[i]) + cross(omega[i], rotate(I, omega[i]))  # the body's part of (3.27)
    for i, (moment, force) in applied_wrenches(model, external).items():
        f[i], n[i] = f[i] - force, n[i] - moment

    # inwards: force and moment in each joint, and their component along its axis
    tau = zeros(qdd.shape, like=qdd)
    for i in reversed(range(model.nb)):
        parent, f_p = model.parent[i], rotate(R[i], f[i])
        tau[..., i] = dot(n[i], s[i]) + dot(f[i], t[i]) + model.armature[i] * qdd[..., i]  # section 5.3
        f[parent] = f[parent] + f_p  # (3.24)
        n[parent] = n[parent] + rotate(R[i], n[i]) + cross(p[i], f_p)  # (3.27)
    return NewtonEuler(omega, alpha, a, U, f, n, on_coordinates(model, q, tau), tau)


def applied_wrenches(model: Model, external: External | None) -> dict[int, tuple[Array, Array]]:
    """Moments and forces of external wrenches by body, moved to the origins of the bodies' frames."""
    applied: dict[int, tuple[Array, Array]] = {}
    for link, wrench in (external or {}).items():
        index = model.link_index(link)
        body, R, p = model.link_body[index], model.link_rotation[index], model.link_translation[index]
        force = rotate(R, wrench[..., 3:])
        moment = rotate(R, wrench[..., :3]) + cross(p, force)
        before = applied.get(body, (0, 0))
        applied[body] = (before[0] + moment, before[1] + force)
    return applied


@quantity(base_parameters=True)
def inverse_dynamics(model: Model, q: Array, qd: Array, qdd: Array, *, external: External | None = None) -> Array:
    """Joint torques for given accelerations: tau = M qdd + C qd + g.

    Recursive Newton-Euler, Høifødt 2011, (3.24)-(3.38); Featherstone 2008, table 5.1. O(n). Parameters, result and
    errors are those of `rne.Robot.inverse_dynamics`, with the model first.
    """
    return newton_euler(model, q, qd, qdd, model.gravity, external).tau


@quantity(base_parameters=True)
def bias_torque(model: Model, q: Array, qd: Array, *, external: External | None = None) -> Array:
    """Joint torques at zero acceleration: C qd + g, minus the torques of external wrenches.

    Inverse dynamics at qdd = 0, Høifødt 2011, appendix B; Featherstone 2008, (6.2). Parameters, result and errors
    are those of `rne.Robot.bias_torque`, with the model first.
    """
    return newton_euler(model, q, qd, np.zeros_like(qd), model.gravity, external).tau


@quantity(base_parameters=True)
def gravity_torque(model: Model, q: Array) -> Array:
    """Joint torques g(q) that balance gravity at rest.

    Inverse dynamics at qd = qdd = 0, Høifødt 2011, (3.1) and appendix B. Parameters, result and errors are those of
    `rne.Robot.gravity_torque`, with the model first.
    """
    still = np.zeros_like(q)
    return newton_euler(model, q, still, still, model.gravity).tau


@quantity(base_parameters=True)
def coriolis_torque(model: Model, q: Array, qd: Array) -> Array:
    """Centrifugal and Coriolis joint torques C(q, qd) qd.

    Inverse dynamics at qdd = 0 without gravity, Høifødt 2011, (3.1) and appendix B. Parameters, result and errors
    are those of `rne.Robot.coriolis_torque`, with the model first.
    """
    return newton_euler(model, q, qd, np.zeros_like(qd), np.zeros_like(model.gravity)).tau


def inertia_torque(model: Model, q: Array, qdd: Array) -> Array:
    """Product M qdd by the recursion: inverse dynamics at rest, without gravity."""
    return newton_euler(model, q, np.zeros_like(qdd), qdd, np.zeros_like(model.gravity)).tau
