"""Forward dynamics by articulated bodies, in link frames."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..errors import ModelError
from ..model import Model
from ..spatial import (
    IDENTITY,
    Array,
    cross,
    cross_matrix,
    dot,
    outer,
    rotate,
    rotate_back,
    transpose,
    zeros,
)
from .checks import judged
from .composite import composite_inertias, mass_diagonal
from .forward import judge_accelerations
from .kinematics import joint_transforms, velocities
from .newton_euler import External, applied_wrenches


class Inertia(NamedTuple):
    """Six-by-six inertia in blocks: moment = I alpha + H a, force = H^T alpha + M a."""

    I: Array
    H: Array
    M: Array


class Force(NamedTuple):
    """Moment about the frame's origin, and force."""

    moment: Array
    force: Array


class Hinge(NamedTuple):
    """What pass 3 needs of joint i: U = I^A S in two parts, d = S^T U, u = tau - S^T p^A, and the bias c.

    d and u have shape (..., 1).
    """

    U_moment: Array
    U_force: Array
    d: Array
    u: Array
    c_angular: Array
    c_linear: Array


def rigid_body(model: Model, i: int, omega: Array, v: Array) -> tuple[Inertia, Force]:
    """Inertia of body i about its frame's origin, and its bias force v x* I v (Featherstone 2008, (2.63), (7.13)).

    With v x m v = 0 left out, whose rounding would drown a small inertia, and Jacobi's identity for the terms in h.
    """
    m, h, I_o = model.moments.mass[i], model.moments.first[i], model.moments.inertia[i]
    carried = cross(omega, v)
    moment = cross(omega, rotate(I_o, omega)) + cross(h, carried)
    bias = Force(moment, m * carried + cross(omega, cross(omega, h)))
    return Inertia(I_o, cross_matrix(h), m * IDENTITY), bias


def seen_from_parent(inertia: Inertia, force: Force, R: Array, p: Array) -> tuple[Inertia, Force]:
    """Turn by R, then move the reference point by p."""
    I, H, M = (R @ block @ transpose(R) for block in inertia)
    P = cross_matrix(p)
    H_p = H + P @ M
    f = rotate(R, force.force)
    return Inertia(I - H @ P + P @ transpose(H_p), H_p, M), Force(rotate(R, force.moment) + cross(p, f), f)


def eliminate_joint(inertia: Inertia, bias: Force, hinge: Hinge) -> tuple[Inertia, Force]:
    """What the parent feels of the body behind a free joint: I^a and p^a of Featherstone 2008, (7.25) and (7.24)."""
    n, f, d = hinge.U_moment, hinge.U_force, hinge.d[..., None]
    I = inertia.I - outer(n, n) / d
    H = inertia.H - outer(n, f) / d
    M = inertia.M - outer(f, f) / d
    share = hinge.u / hinge.d
    moment = bias.moment + rotate(I, hinge.c_angular) + rotate(H, hinge.c_linear) + n * share
    force = bias.force + rotate(transpose(H), hinge.c_angular) + rotate(M, hinge.c_linear) + f * share
    return Inertia(I, H, M), Force(moment, force)


def hinge_of(
    model: Model, i: int, inertia: Inertia, bias: Force, omega: Array, v: Array, qd: Array, tau: Array
) -> Hinge:
    """U, d, u and c of joint i (Featherstone 2008, (7.43)-(7.45))."""
    b = model.axis[i]
    b_qd = b * qd[..., i, None]
    if model.is_revolute(i):
        n, f = rotate(inertia.I, b), rotate(transpose(inertia.H), b)
        d, pull = dot(b, n), dot(b, bias.moment)
        c_angular, c_linear = cross(omega, b_qd), cross(v, b_qd)
    else:
        n, f = rotate(inertia.H, b), rotate(inertia.M, b)
        d, pull = dot(b, f), dot(b, bias.force)
        c_angular, c_linear = np.zeros_like(b_qd), cross(omega, b_qd)
    d, u = d[..., None] + model.armature[i], tau[..., i, None] - pull[..., None]
    return Hinge(n, f, d, u, c_angular, c_linear)


@judged(judge_accelerations)
def articulated_forward_dynamics(
    model: Model, q: Array, qd: Array, tau: Array, *, external: External | None = None
) -> tuple[Array, Array, Array]:
    """Joint accelerations that the torques tau give, without forming M.

    Parameters
    ----------
    model : Model
        Without mimic joints.
    q, qd, tau : ndarray, shape (..., n)
        Joint positions, rates and torques [rad or m, /s, N m or N].
    external : mapping of str to ndarray, shape (..., 6), optional
        Wrenches [moment; force] acting on the robot at the named link's origin, in its axes [N m, N].

    Returns
    -------
    ndarray, shape (..., n)
        [rad/s^2 or m/s^2]

    Raises
    ------
    ValueError
        If an array has the wrong shape or is not finite, or the acceleration overflows.
    ModelError
        If a joint mimics another: its articulated inertia is not that of one joint. Use `forward_dynamics`.
    SingularMassMatrixError
        If M is singular to working precision; names the joints whose combination moves no inertia.

    Warns
    -----
    PrecisionWarning
        If fewer than 3 digits are left, M nearly singular or the torques cancelled by great rates.

    Notes
    -----
    Featherstone 2008, table 7.1, in blocks of three. O(n). `articulated_forward_dynamics.core` returns
    (qdd, pivots, diagonal of M).

    Examples
    --------
    >>> import rne
    >>> rne.articulated_forward_dynamics(rne.irb140(), [0] * 6, [0] * 6, [0] * 6).shape
    (6,)
    """
    if model.has_mimics:
        raise ModelError(f"robot {model.name!r} has mimic joints; use forward_dynamics, which reduces M to q")
    R, p = joint_transforms(model, q)
    omega, v = velocities(model, R, p, qd)
    bodies = [rigid_body(model, i, omega[i], v[i]) for i in range(model.nb)]
    inertia, bias = [body[0] for body in bodies], [body[1] for body in bodies]
    for i, wrench in enumerate(applied_wrenches(model, external)):
        if wrench is not None:
            bias[i] = Force(bias[i].moment - wrench[0], bias[i].force - wrench[1])

    # pass 2, inwards: what each body and all it carries feel like to its joint
    hinges: dict[int, Hinge] = {}
    for i in reversed(range(model.nb)):
        hinges[i] = hinge_of(model, i, inertia[i], bias[i], omega[i], v[i], qd, tau)
        parent = model.parent[i]
        if parent >= 0:
            felt = seen_from_parent(*eliminate_joint(inertia[i], bias[i], hinges[i]), R[i], p[i])
            inertia[parent] = Inertia(*(a + b for a, b in zip(inertia[parent], felt[0], strict=True)))
            bias[parent] = Force(*(a + b for a, b in zip(bias[parent], felt[1], strict=True)))

    # pass 3, outwards: accelerations
    qdd, pivots = zeros(q.shape, like=q), zeros(q.shape, like=q)
    alpha: list[Array] = []
    a: list[Array] = []
    for i, parent in enumerate(model.parent):
        alpha_p, a_p = (alpha[parent], a[parent]) if parent >= 0 else (zeros((3,), like=q), -model.gravity)
        h = hinges[i]
        alpha_i = rotate_back(R[i], alpha_p) + h.c_angular
        a_i = rotate_back(R[i], a_p + cross(alpha_p, p[i])) + h.c_linear
        qdd_i = (h.u - dot(h.U_moment, alpha_i)[..., None] - dot(h.U_force, a_i)[..., None]) / h.d
        b_qdd = model.axis[i] * qdd_i
        alpha.append(alpha_i + b_qdd if model.is_revolute(i) else alpha_i)
        a.append(a_i if model.is_revolute(i) else a_i + b_qdd)
        qdd[..., i], pivots[..., i] = qdd_i[..., 0], h.d[..., 0]
    return qdd, pivots, mass_diagonal(model, composite_inertias(model, R, p), like=q)
