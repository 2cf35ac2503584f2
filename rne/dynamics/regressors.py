"""Regressors: joint torques and energies as linear functions of the bodies' inertial parameters.

The ten parameters of a body are its mass, first moment and inertia about the origin of its joint's frame in the URDF,
in Pinocchio's order: m, m cx, m cy, m cz, Ixx, Ixy, Iyy, Ixz, Iyz, Izz. Spatial vectors are pairs (angular, linear), or
(moment, force), about that origin and in the body's axes.
"""

from __future__ import annotations

from typing import NamedTuple

from ..basics.inertia import BASIS, PARAMETERS
from ..basics.spatial import Array, cross, cross_matrix, dot, rotate, rotate_back, transpose, zeros
from ..model.model import Model
from .kinematics import (
    BASE,
    body_poses,
    coordinate_map,
    joint_accelerations,
    joint_transforms,
    joint_velocities,
    velocities,
)
from .quantity import quantity


class MotionVector(NamedTuple):
    """Spatial velocity or acceleration."""

    angular: Array
    linear: Array


class Wrenches(NamedTuple):
    """Moments and forces per unit of each parameter, shape (..., 3, 10) each."""

    moment: Array
    force: Array


def momentum_matrix(w: MotionVector) -> Wrenches:
    """Spatial momentum of a body that moves with w, per unit of its parameters: I w = H(w) pi."""
    like = w.angular * w.linear
    moment, force = (zeros((*like.shape, PARAMETERS), like=like) for _ in range(2))
    force[..., 0] = w.linear  # m v
    moment[..., 1:4] = -cross_matrix(w.linear)  # h x v
    force[..., 1:4] = cross_matrix(w.angular)  # omega x h
    for k, E in enumerate(BASIS):
        moment[..., 4 + k] = rotate(E, w.angular)  # I omega
    return Wrenches(moment, force)


def cross_motion(v: MotionVector, w: MotionVector) -> MotionVector:
    """Product v x w, Featherstone 2008, (2.31)."""
    return MotionVector(cross(v.angular, w.angular), cross(v.angular, w.linear) + cross(v.linear, w.angular))


def cross_force(v: MotionVector, f: Wrenches) -> Wrenches:
    """Product v x* f, Featherstone 2008, (2.32)."""
    turn = cross_matrix(v.angular)
    return Wrenches(turn @ f.moment + cross_matrix(v.linear) @ f.force, turn @ f.force)


def coriolis_force(v: MotionVector, u: MotionVector) -> Wrenches:
    """Force B(v, I) u of a body per unit of its parameters, with dI/dt - 2 B skew: C = sum of J^T (I dJ/dt + B J).

    B u = (v x* I u + u x* I v - I (v x u)) / 2; Echeandia and Wensing 2021, (21). For u = v it is v x* I v.
    """
    a, b = cross_force(v, momentum_matrix(u)), cross_force(u, momentum_matrix(v))
    c = momentum_matrix(cross_motion(v, u))
    return Wrenches((a.moment + b.moment - c.moment) / 2, (a.force + b.force - c.force) / 2)


def joint_motions(
    model: Model, R: list[Array], p: list[Array], qd: Array, qdr: Array, qddr: Array
) -> dict[int, tuple[MotionVector, MotionVector, MotionVector]]:
    """Acceleration of the reference, velocity, and velocity of the reference of each body.

    The reference has joint velocities qdr at the positions of the motion; its acceleration is the derivative of its
    velocity along the motion, minus gravity. qd, qdr and qddr are those of the moving joints, (..., nb).
    """
    qd, qdr, qddr = (x[..., None] for x in (qd, qdr, qddr))
    zero = zeros((*qd.shape[:-2], 3), like=qd)
    rest = MotionVector(zero, zero)
    found = {BASE: (MotionVector(zero, zero - model.gravity), rest, rest)}
    for i, parent in enumerate(model.parent):
        a, v, u = (seen_from_body(w, R[i], p[i]) for w in found[parent])
        v, u = (along_axis(model, i, x[..., i, :], w) for x, w in ((qd, v), (qdr, u)))
        turning = cross_motion(v, along_axis(model, i, qdr[..., i, :], rest))
        a = along_axis(model, i, qddr[..., i, :], MotionVector(a.angular + turning.angular, a.linear + turning.linear))
        found[i] = a, v, u
    return found


def seen_from_body(w: MotionVector, R: Array, p: Array) -> MotionVector:
    """Motion of the parent body at the origin of the body's frame, in its axes."""
    return MotionVector(rotate_back(R, w.angular), rotate_back(R, w.linear + cross(w.angular, p)))


def along_axis(model: Model, i: int, x: Array, w: MotionVector) -> MotionVector:
    """Sum of a motion and one of joint i, w + S_i x."""
    return MotionVector(w.angular + model.angular_axis[i] * x, w.linear + model.linear_axis[i] * x)


def body_wrenches(a: MotionVector, v: MotionVector, u: MotionVector, o: Array) -> Wrenches:
    """Wrenches I a + B(v) u of a body, its parameters about the point o, at the frame's origin."""
    a, v, u = (MotionVector(w.angular, w.linear + cross(w.angular, o)) for w in (a, v, u))
    inertial, centrifugal = momentum_matrix(a), coriolis_force(v, u)
    force = inertial.force + centrifugal.force
    return Wrenches(inertial.moment + centrifugal.moment + cross_matrix(o) @ force, force)


def _control_regressor(model: Model, q: Array, qd: Array, qdr: Array, qddr: Array) -> Array:
    R, p = joint_transforms(model, q)
    s, t = model.angular_axis, model.linear_axis
    Y = zeros((*q.shape[:-1], model.nb, PARAMETERS * model.nb), like=q)
    qd_j, qdr_j = (joint_velocities(model, q, x) for x in (qd, qdr))
    motions = joint_motions(model, R, p, qd_j, qdr_j, joint_accelerations(model, q, qd, qddr, qdr))
    for i in range(model.nb):
        moment, force = body_wrenches(*motions[i], model.joint_origin[i])
        own = slice(PARAMETERS * i, PARAMETERS * (i + 1))
        j = i
        while j != BASE:  # joint i and those that carry it
            Y[..., j, own] = (s[j][:, None] * moment + t[j][:, None] * force).sum(-2)
            force = R[j] @ force
            moment = R[j] @ moment + cross_matrix(p[j]) @ force
            j = model.parent[j]
    return transpose(coordinate_map(model, q)) @ Y if model.has_mimics else Y


@quantity()
def regressor(model: Model, q: Array, qd: Array, qdd: Array) -> Array:
    """Regressor Y of tau = Y pi: joint torques per unit of each inertial parameter of each body.

    Høifødt 2011, (3.2); Siciliano et al. 2009, section 7.2.2. Parameters, result and errors are those of
    `rne.Robot.regressor`, with the model first.
    """
    return _control_regressor(model, q, qd, qd, qdd)


@quantity()
def control_regressor(model: Model, q: Array, qd: Array, qdr: Array, qddr: Array) -> Array:
    """Regressor Y of M qddr + C qdr + g = Y pi, with dM/dt - 2 C skew, for adaptive control.

    Slotine and Li 1987; body by body as in Echeandia and Wensing 2021. Parameters, result and errors are those of
    `rne.Robot.control_regressor`, with the model first.
    """
    return _control_regressor(model, q, qd, qdr, qddr)


def gravity_torques(model: Model, q: Array, bodies: Array) -> Array:
    """Joint torques per unit of each component of gravity, in the root link's axes, shape (..., n, 3, k).

    `bodies` (10 nb, k) are k sets of inertial parameters. The first moment r of the bodies that a joint carries, about
    the joint, gives the torque g . (r x s) about an axis s in gravity g; along an axis t the force is -m g . t.
    """
    R0, p0 = body_poses(model, q)
    own = bodies.reshape(model.nb, PARAMETERS, -1)
    mass, moment = [x[0] for x in own], [R0[i] @ x[1:4] for i, x in enumerate(own)]
    tau = zeros((*q.shape[:-1], model.nb, 3, bodies.shape[1]), like=q)
    for i in reversed(range(model.nb)):
        o = p0[i] + rotate(R0[i], model.joint_origin[i])
        moment[i] = moment[i] + o[..., None] * own[i, 0]
        s, t = (rotate(R0[i], axis[i]) for axis in (model.angular_axis, model.linear_axis))
        about = moment[i] - p0[i][..., None] * mass[i]
        tau[..., i, :, :] = -(cross_matrix(s) @ about) - t[..., None] * mass[i]
        if (j := model.parent[i]) != BASE:
            moment[j], mass[j] = moment[j] + moment[i], mass[j] + mass[i]
    if not model.has_mimics:
        return tau
    G = coordinate_map(model, q)
    return (transpose(G) @ tau.reshape(*tau.shape[:-2], -1)).reshape(*q.shape, *tau.shape[-2:])


@quantity()
def kinetic_energy_regressor(model: Model, q: Array, qd: Array) -> Array:
    """Row y of T = y pi: kinetic energy per unit of each inertial parameter, without `armature`.

    Parameters and errors are those of `rne.Robot.kinetic_energy`, with the model first.

    Returns
    -------
    ndarray, shape (..., 10 nb)
        Columns as of `rne.dynamics.regressor`.

    Examples
    --------
    >>> import numpy as np, rne
    >>> robot = rne.load("irb140")
    >>> q, qd = np.random.default_rng(0).normal(size=(2, 6))
    >>> y = rne.dynamics.kinetic_energy_regressor(robot.model, q, qd)
    >>> np.allclose(y @ robot.parameters, robot.kinetic_energy(q, qd))
    True
    """
    omega, v = velocities(model, *joint_transforms(model, q), joint_velocities(model, q, qd))
    y = zeros((*q.shape[:-1], PARAMETERS * model.nb), like=q)
    for i in range(model.nb):
        v_o = v[i] + cross(omega[i], model.joint_origin[i])
        momentum = momentum_matrix(MotionVector(omega[i], v_o))
        power = omega[i][..., None] * momentum.moment + v_o[..., None] * momentum.force
        y[..., PARAMETERS * i : PARAMETERS * (i + 1)] = power.sum(-2) / 2
    return y


@quantity()
def potential_energy_regressor(model: Model, q: Array) -> Array:
    """Row y of U = y pi: potential energy per unit of each inertial parameter.

    Parameters and errors are those of `rne.Robot.potential_energy`, with the model first.

    Returns
    -------
    ndarray, shape (..., 10 nb)
        Columns as of `rne.dynamics.regressor`; those of inertias are zero. Zero level: the root link's origin.

    Examples
    --------
    >>> import numpy as np, rne
    >>> robot = rne.load("irb140")
    >>> q = np.random.default_rng(0).normal(size=6)
    >>> energies = rne.dynamics.potential_energy_regressor(robot.model, q)
    >>> np.allclose(energies @ robot.parameters, robot.potential_energy(q))
    True
    """
    R0, p0 = body_poses(model, q)
    y = zeros((*q.shape[:-1], PARAMETERS * model.nb), like=q)
    for i in range(model.nb):
        y[..., PARAMETERS * i] = -dot(p0[i] + rotate(R0[i], model.joint_origin[i]), model.gravity)
        y[..., PARAMETERS * i + 1 : PARAMETERS * i + 4] = -rotate_back(R0[i], model.gravity)
    return y
