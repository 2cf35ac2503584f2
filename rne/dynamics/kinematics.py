"""Joint transforms, poses, velocities and Jacobians.

R[i] takes coordinates of frame i to its parent body's frame, p[i] is the origin of frame i seen from there
(the thesis's R_i^{i-1} and r_{i-2,i-1}). The initial values of a recursion are stored under the key BASE, the parent
of the first bodies. A Jacobian is stored as rows: row j is the velocity per unit velocity of joint j.
"""

from __future__ import annotations

import numpy as np

from ..basics.spatial import IDENTITY, Array, cross, rotate, rotate_back, rotation_about, transpose, zeros
from ..model.model import Model
from .quantity import quantity

BASE = -1
ORIGIN = (0.0, 0.0, 0.0)
Point = tuple[float, ...]  # of a link, in its frame [m]
Bodies = dict[int, Array]  # an array of each body, and of the base under BASE


def joint_positions(model: Model, q: Array) -> Array:
    """Positions phi(q) of the moving joints, those that follow others included, shape (..., nb)."""
    if not model.has_mimics:
        return q
    positions = q[..., model.coordinate] * model.multiplier + model.offset
    for i, drivers, coupling in model.coupled_joints:
        positions[..., i] = coupling.position(q[..., drivers])
    return positions


def joint_velocities(model: Model, q: Array, qd: Array) -> Array:
    """Velocities G qd of the moving joints, shape (..., nb)."""
    if not model.has_mimics:
        return qd
    if not model.couplings:
        return qd[..., model.coordinate] * model.multiplier
    return rotate(coordinate_map(model, q), qd)


def joint_accelerations(model: Model, q: Array, qd: Array, qdd: Array, qdr: Array | None = None) -> Array:
    """Accelerations G qdd + dG/dt qd of the moving joints; with `qdr` the derivative G qdd + dG/dt qdr of G qdr."""
    accelerations = joint_velocities(model, q, qdd)
    if not model.couplings:
        return accelerations
    return accelerations + rotate(coordinate_map_rate(model, q, qd), qd if qdr is None else qdr)


def coordinate_map(model: Model, q: Array) -> Array:
    """G = d phi/dq of the positions phi of the moving joints, shape (nb, n); with couplings (..., nb, n)."""
    if not model.couplings:
        return model.coordinate_map
    G = zeros((*q.shape[:-1], model.nb, model.n), like=q) + model.mimic_map
    for i, drivers, coupling in model.coupled_joints:
        G[..., i, drivers] = coupling.derivatives(q[..., drivers])[0]
    return G


def coordinate_map_derivatives(model: Model, q: Array) -> Array:
    """Second derivatives d^2 phi/dq^2 of the joints' positions, zero without couplings, shape (..., nb, n, n)."""
    dG = zeros((*q.shape[:-1], model.nb, model.n, model.n), like=q)
    for i, drivers, coupling in model.coupled_joints:
        dG[..., i, np.array(drivers)[:, None], drivers] = coupling.derivatives(q[..., drivers])[1]
    return dG


def coordinate_map_rate(model: Model, q: Array, qd: Array) -> Array:
    """dG/dt along the motion (q, qd), shape (..., nb, n)."""
    return rotate(coordinate_map_derivatives(model, q), qd[..., None, :])


def on_coordinates(model: Model, q: Array, tau: Array) -> Array:
    """G^T tau: torques of the moving joints on the coordinates, to which joints that follow others add theirs."""
    if not model.has_mimics:
        return tau
    return rotate_back(coordinate_map(model, q), tau) if model.couplings else tau @ model.coordinate_map


def joint_transforms(model: Model, q: Array) -> tuple[list[Array], list[Array]]:
    """R[i] and p[i] of every body, from the coordinates q."""
    position = joint_positions(model, q)
    # a sliding joint does not rotate; int8 keeps the dtype of the positions
    R = model.rotation @ rotation_about(model.axis, position * model.is_revolute.astype("int8"))
    p = model.translation + rotate(model.rotation, model.linear_axis) * position[..., None]
    return [R[..., i, :, :] for i in range(model.nb)], [p[..., i, :] for i in range(model.nb)]


def body_poses(model: Model, q: Array) -> tuple[Bodies, Bodies]:
    """Rotation and origin of every body's frame, seen from the root link."""
    R, p = joint_transforms(model, q)
    R0: Bodies = {BASE: IDENTITY}
    p0: Bodies = {BASE: zeros((3,), like=q)}
    for i, parent in enumerate(model.parent):
        R0[i] = R0[parent] @ R[i]
        p0[i] = p0[parent] + rotate(R0[parent], p[i])
    return R0, p0


@quantity()
def link_poses(model: Model, q: Array) -> Array:
    """Pose of every link, as homogeneous matrices.

    Siciliano et al. 2009, (2.50): products of the joints' transforms. Parameters, result and errors are those of
    `rne.Robot.link_poses`, with the model first.
    """
    R0, p0 = body_poses(model, q)
    T = zeros((*q.shape[:-1], len(model.link_names), 4, 4), like=q)
    for k, body in enumerate(model.link_body):
        R, p = model.link_rotation[k], model.link_translation[k]
        T[..., k, :3, :3] = R0[body] @ R
        T[..., k, :3, 3] = p0[body] + rotate(R0[body], p)
        T[..., k, 3, 3] = 1
    return T


def velocities(model: Model, R: list[Array], p: list[Array], qd: Array) -> tuple[Bodies, Bodies]:
    """Angular velocity of every body and velocity of its frame's origin, in its own axes.

    `qd` (..., nb) are the velocities of the moving joints.
    """
    zero = zeros((*qd.shape[:-1], 3), like=qd)
    omega, v = {BASE: zero}, {BASE: zero}
    for i, parent in enumerate(model.parent):
        omega[i] = rotate_back(R[i], omega[parent]) + model.angular_axis[i] * qd[..., i, None]
        v_p = v[parent] + cross(omega[parent], p[i])
        v[i] = rotate_back(R[i], v_p) + model.linear_axis[i] * qd[..., i, None]
    return omega, v


def body_jacobians(model: Model, R: list[Array], p: list[Array]) -> tuple[Bodies, Bodies]:
    """Jw[i], Jv[i], shape (..., nb, 3): row j is body i's angular velocity, and its origin's velocity, per qd_j.

    Everything in the axes of body i.
    """
    like = np.zeros((), dtype=np.result_type(*R, *p)) if R else np.zeros(())
    leading = np.broadcast_shapes(*(x.shape[:-2] for x in R), *(x.shape[:-1] for x in p))
    zero = zeros((*leading, model.nb, 3), like=like)
    Jw, Jv = {BASE: zero}, {BASE: zero}
    for i, parent in enumerate(model.parent):
        Jw[i] = Jw[parent] @ R[i]  # rows: (R^T w)^T
        Jv[i] = (Jv[parent] + cross(Jw[parent], p[i][..., None, :])) @ R[i]
        Jw[i][..., i, :] = model.angular_axis[i]
        Jv[i][..., i, :] = model.linear_axis[i]
    return Jw, Jv


def body_jacobian_derivatives(
    model: Model, R: list[Array], p: list[Array], qd: Array, Jw: Bodies, Jv: Bodies
) -> tuple[Bodies, Bodies]:
    """Time derivatives of `body_jacobians`' components in the axes of body i, at joint velocities qd, (..., nb)."""
    zero = np.zeros_like(Jw[BASE])
    dJw, dJv = {BASE: zero}, {BASE: zero}
    for i, parent in enumerate(model.parent):
        p_i = p[i][..., None, :]
        Jw_p, Jv_p = Jw[parent] @ R[i], (Jv[parent] + cross(Jw[parent], p_i)) @ R[i]
        dJv_p = (dJv[parent] + cross(dJw[parent], p_i)) @ R[i]
        s_qd, t_qd = ((axis[i] * qd[..., i, None])[..., None, :] for axis in (model.angular_axis, model.linear_axis))
        dJw[i] = dJw[parent] @ R[i] - cross(s_qd, Jw_p)  # d/dt R^T = -[s qd]x R^T
        dJv[i] = dJv_p - cross(s_qd, Jv_p) + cross(Jw_p, t_qd)  # dp/dt = R t qd
    return dJw, dJv


def _columns(model: Model, q: Array, Jw: Array, Jv: Array, R0: Array) -> Array:
    """[angular; linear] parts in the root link's axes, one column per coordinate."""
    J = _in_root_axes(Jw, Jv, R0)
    return J @ coordinate_map(model, q) if model.has_mimics else J


def _in_root_axes(Jw: Array, Jv: Array, R0: Array) -> Array:
    """[angular; linear] parts in the root link's axes, one column per moving joint."""
    rows = np.concatenate([Jw @ transpose(R0), Jv @ transpose(R0)], axis=-1)
    return np.swapaxes(rows, -1, -2)


@quantity()
def jacobian(model: Model, q: Array, link: str, point: Point = ORIGIN) -> Array:
    """Geometric Jacobian of a point of a link: the link's angular velocity and the point's velocity per joint velocity.

    Siciliano et al. 2009, (3.29), with the angular rows first as in Featherstone 2008. Parameters, result and errors
    are those of `rne.Robot.jacobian` without `axes`, with the model first.
    """
    body, offset = point_of_body(model, link, point)
    if body < 0:
        return zeros((*q.shape[:-1], 6, model.n), like=q)
    Jw, Jv = (J[body] for J in body_jacobians(model, *joint_transforms(model, q)))
    R0, _ = body_poses(model, q)
    return _columns(model, q, Jw, Jv + cross(Jw, offset), R0[body])


def point_of_body(model: Model, link: str, point: Point) -> tuple[int, Array]:
    """Body that a link is part of, and a point of the link in the body's frame."""
    k = model.link_index(link)
    offset: Array = model.link_translation[k]
    return model.link_body[k], offset if point == ORIGIN else offset + model.link_rotation[k] @ np.array(point)


@quantity()
def jacobian_rate(model: Model, q: Array, qd: Array, link: str, point: Point = ORIGIN) -> Array:
    """Time derivative of `jacobian` along the motion (q, qd).

    Featherstone 2008, section 2.10: derivatives in moving coordinates. Parameters, result and errors are those of
    `rne.Robot.jacobian_rate`, with the model first.
    """
    body, offset = point_of_body(model, link, point)
    if body < 0:
        return zeros((*q.shape[:-1], 6, model.n), like=q)
    R, p = joint_transforms(model, q)
    velocity = joint_velocities(model, q, qd)
    all_Jw, all_Jv = body_jacobians(model, R, p)
    all_dJw, all_dJv = body_jacobian_derivatives(model, R, p, velocity, all_Jw, all_Jv)
    Jw, Jv = all_Jw[body], all_Jv[body] + cross(all_Jw[body], offset)
    dJw, dJv = all_dJw[body], all_dJv[body] + cross(all_dJw[body], offset)
    omega = (Jw * velocity[..., :, None]).sum(-2)[..., None, :]
    R0, _ = body_poses(model, q)
    # from the derivative of components in moving axes to that of the vector: + omega x
    dJ = _columns(model, q, dJw + cross(omega, Jw), dJv + cross(omega, Jv), R0[body])
    if model.couplings:
        dJ = dJ + _in_root_axes(Jw, Jv, R0[body]) @ coordinate_map_rate(model, q, qd)
    return dJ


@quantity(moments=True, per_mass=True)
def centre_of_mass(model: Model, q: Array) -> Array:
    """Centre of mass of the moving bodies.

    Siciliano et al. 2009, section 7.1. Parameters, result and errors are those of `rne.Robot.centre_of_mass`, with the
    model first.
    """
    R0, p0 = body_poses(model, q)
    total, moment = zeros((1,), like=q), zeros((*q.shape[:-1], 3), like=q)
    for i in range(model.nb):
        m, h, _ = model.body_moments(i)
        total, moment = total + m, moment + m * p0[i] + rotate(R0[i], h)
    return np.asarray(moment / total)


@quantity(moments=True, per_mass=True)
def centre_of_mass_jacobian(model: Model, q: Array) -> Array:
    """Velocity of the centre of mass per joint velocity, the derivative of `centre_of_mass`.

    Siciliano et al. 2009, (7.16). Parameters, result and errors are those of `rne.Robot.centre_of_mass_jacobian`,
    with the model first.
    """
    R0, _ = body_poses(model, q)
    all_Jw, all_Jv = body_jacobians(model, *joint_transforms(model, q))
    total, rows = zeros((1,), like=q), zeros((*q.shape[:-1], model.nb, 3), like=q)
    for i in range(model.nb):
        m, h, _ = model.body_moments(i)
        total = total + m
        rows = rows + (m[..., None] * all_Jv[i] + cross(all_Jw[i], h[..., None, :])) @ transpose(R0[i])
    J: Array = np.swapaxes(rows / total[..., None], -1, -2)
    return J @ coordinate_map(model, q) if model.has_mimics else J
