"""Forward dynamics by the articulated-body algorithm (ABA), in link frames.

| quantity                                     | code            | Featherstone 2008, table 7.1 |
|----------------------------------------------|-----------------|------------------------------|
| velocity, angular and linear                 | omega[i], v[i]  | v_i                          |
| articulated inertia, in 3x3 blocks           | IA[i]: I, H, M  | I^A_i = [I H; H^T M]         |
| articulated bias force                       | pA[i]: n, f     | p^A_i                        |
| axes of a rotating and of a sliding joint    | s[i], t[i]      | S_i                          |
| velocity-product acceleration                | c: angular, linear | c_i                       |
| I^A S; S^T I^A S; tau - S^T p^A              | U: n, f; d; u   | U_i, D_i, u_i                |

Vectors and blocks instead of 6-vectors: the tracer then finds more zeros.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from ..basics.spatial import (
    IDENTITY,
    Array,
    cross,
    cross_matrix,
    dot,
    note_solution,
    outer,
    rotate,
    rotate_back,
    transpose,
    zeros,
)
from ..errors import ModelError
from ..model.model import Model, with_unchecked
from .crba import composite_inertias, mass_diagonal
from .kinematics import BASE, joint_transforms, velocities
from .precision import check_accelerations
from .quantity import Solved, checked_quantity
from .rnea import External, applied_wrenches, inertia_torque, inverse_dynamics


class Inertia(NamedTuple):
    """Blocks of a 6x6 inertia about the frame's origin: moment = I alpha + H a, force = H^T alpha + M a."""

    I: Array
    H: Array
    M: Array

    def plus(self, other: Inertia) -> Inertia:
        """Sum of two inertias in the same frame."""
        return Inertia(self.I + other.I, self.H + other.H, self.M + other.M)

    def times(self, angular: Array, linear: Array) -> Force:
        """Moment and force for an angular and a linear acceleration."""
        n = rotate(self.I, angular) + rotate(self.H, linear)
        return Force(n, rotate(transpose(self.H), angular) + rotate(self.M, linear))


class Force(NamedTuple):
    """Moment about the frame's origin, and force, each of shape (..., 3)."""

    n: Array
    f: Array

    def plus(self, other: Force) -> Force:
        """Sum of two forces in the same frame."""
        return Force(self.n + other.n, self.f + other.f)


class JointTerms(NamedTuple):
    """Terms of one joint that pass 3 needs, in its frame: U, c of shape (..., 3) each, d and u of shape (..., 1)."""

    U: Force
    d: Array
    u: Array
    c_angular: Array
    c_linear: Array


def rigid_body(model: Model, i: int, omega: Array, v: Array) -> tuple[Inertia, Force]:
    """Inertia of body i about its frame's origin, and its bias force v x* I v (Featherstone 2008, (2.63), (7.13)).

    The term v x m v = 0 is left out, whose rounding error would exceed a small inertia; the terms in h follow from it
    by Jacobi's identity.
    """
    m, h, I = model.body_moments(i)
    omega_v = cross(omega, v)
    n = cross(omega, rotate(I, omega)) + cross(h, omega_v)
    f = m * omega_v + cross(omega, cross(omega, h))
    return Inertia(I, cross_matrix(h), m[..., None] * IDENTITY), Force(n, f)


def across_joint(IA: Inertia, pA: Force, joint: JointTerms) -> tuple[Inertia, Force]:
    """I^a and p^a that the parent feels across the free joint (Featherstone 2008, (7.25) and (7.24))."""
    U, d = joint.U, joint.d[..., None]
    Ia = Inertia(IA.I - outer(U.n, U.n) / d, IA.H - outer(U.n, U.f) / d, IA.M - outer(U.f, U.f) / d)
    u_over_d = joint.u / joint.d
    driven = Force(U.n * u_over_d, U.f * u_over_d)
    return Ia, pA.plus(Ia.times(joint.c_angular, joint.c_linear)).plus(driven)


def move_to_parent(inertia: Inertia, force: Force, R: Array, p: Array) -> tuple[Inertia, Force]:
    """Inertia and force in the parent's frame: rotated by R, then the reference point moved by p."""
    I, H, M = (R @ block @ transpose(R) for block in inertia)
    P = cross_matrix(p)
    H_p = H + P @ M
    f = rotate(R, force.f)
    return Inertia(I - H @ P + P @ transpose(H_p), H_p, M), Force(rotate(R, force.n) + cross(p, f), f)


def joint_terms(
    model: Model, i: int, body: tuple[Inertia, Force], velocity: tuple[Array, Array], qd_i: Array, tau_i: Array
) -> JointTerms:
    """Terms of joint i from articulated inertia and bias force of its body, its velocity, qd and tau, (..., 1)."""
    (IA, pA), (omega, v), s, t = body, velocity, model.angular_axis[i], model.linear_axis[i]
    U = IA.times(s, t)
    d = dot(s, U.n)[..., None] + dot(t, U.f)[..., None] + np.asarray(model.armature[i])[..., None]  # (7.44)
    u = tau_i - dot(s, pA.n)[..., None] - dot(t, pA.f)[..., None]  # (7.45)
    c_linear = cross(v, s * qd_i) + cross(omega, t * qd_i)
    return JointTerms(U, d, u, cross(omega, s * qd_i), c_linear)


def accelerations(
    model: Model, R: list[Array], p: list[Array], joints: Mapping[int, JointTerms], like: Array
) -> tuple[Array, Array]:
    """Joint accelerations and the pivots d, of the shape of `like`: pass 3, outwards, the base's being -gravity."""
    s, t = model.angular_axis, model.linear_axis
    qdd, pivots = zeros(like.shape, like=like), zeros(like.shape, like=like)
    alpha, a = {BASE: zeros((3,), like=like)}, {BASE: zeros((3,), like=like) - model.gravity}
    for i, parent in enumerate(model.parent):
        joint = joints[i]
        alpha_i = rotate_back(R[i], alpha[parent]) + joint.c_angular
        a_i = rotate_back(R[i], a[parent] + cross(alpha[parent], p[i])) + joint.c_linear
        qdd_i = (joint.u - dot(joint.U.n, alpha_i)[..., None] - dot(joint.U.f, a_i)[..., None]) / joint.d
        alpha[i], a[i] = alpha_i + s[i] * qdd_i, a_i + t[i] * qdd_i
        qdd[..., i], pivots[..., i] = qdd_i[..., 0], joint.d[..., 0]
    return qdd, pivots


@checked_quantity(check_accelerations)
def articulated_forward_dynamics(
    model: Model, q: Array, qd: Array, tau: Array, *, external: External | None = None
) -> Solved:
    """Joint accelerations that the torques tau give, without forming M.

    Featherstone 2008, table 7.1, in blocks of three. O(n). Joints that follow others are a ModelError: their
    articulated inertia is not that of one joint. `articulated_forward_dynamics.core` returns (qdd, pivots, diagonal of
    M). Parameters, result and errors are those of `rne.Robot.forward_dynamics`, with the model first.
    """
    if model.has_mimics:
        cure = "use forward_dynamics, which reduces M to q"
        raise ModelError(f"robot {model.name!r} has joints that mimic or follow others; {cure}")
    R, p = joint_transforms(model, q)

    # pass 1, outwards: velocities, and inertia and bias force of each body by itself
    omega, v = velocities(model, R, p, qd)
    IA: dict[int, Inertia] = {}
    pA: dict[int, Force] = {}
    for i in range(model.nb):
        IA[i], pA[i] = rigid_body(model, i, omega[i], v[i])
    for i, (moment, force) in applied_wrenches(model, external).items():
        if i != BASE:
            pA[i] = pA[i].plus(Force(-moment, -force))

    # pass 2, inwards: articulated inertia and bias force
    joints: dict[int, JointTerms] = {}
    for i in reversed(range(model.nb)):
        joints[i] = joint_terms(model, i, (IA[i], pA[i]), (omega[i], v[i]), qd[..., i, None], tau[..., i, None])
        parent = model.parent[i]
        if parent != BASE:
            Ia, pa = move_to_parent(*across_joint(IA[i], pA[i], joints[i]), R[i], p[i])
            IA[parent], pA[parent] = IA[parent].plus(Ia), pA[parent].plus(pa)

    qdd, pivots = accelerations(model, R, p, joints, like=q)
    weightless = with_unchecked(model, gravity=np.zeros(3))
    note_solution(
        qdd,
        lambda y: articulated_forward_dynamics.core(weightless, q, np.zeros_like(q), y)[0],
        lambda y: inertia_torque(model, q, y),
        lambda x: inverse_dynamics.core(model, q, qd, x, external=external) - tau,
    )
    diagonal = mass_diagonal(model, composite_inertias(model, R, p), like=q)  # scale of the pivots d
    return qdd, pivots, diagonal
