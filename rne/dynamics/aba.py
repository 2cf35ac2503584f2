"""Forward dynamics by articulated bodies, in link frames."""

from __future__ import annotations

from typing import NamedTuple

from ..basics.spatial import IDENTITY, Array, cross, cross_matrix, dot, outer, rotate, rotate_back, transpose, zeros
from ..errors import ModelError
from ..model.model import Model
from .conditioning import judge_accelerations
from .crba import composite_inertias, mass_diagonal
from .kinematics import BASE, joint_transforms, velocities
from .quantity import judged_quantity
from .rnea import External, applied_wrenches


class Inertia(NamedTuple):
    """Six-by-six inertia in blocks: moment = I alpha + H a, force = H^T alpha + M a."""

    I: Array
    H: Array
    M: Array


class Force(NamedTuple):
    """Moment about the frame's origin, and force."""

    n: Array
    f: Array


class Hinge(NamedTuple):
    """Of joint i: U = I^A S in two parts, d = S^T U and u = tau - S^T p^A of shape (..., 1), and the bias c."""

    U_n: Array
    U_f: Array
    d: Array
    u: Array
    c_angular: Array
    c_linear: Array


def rigid_body(model: Model, i: int, omega: Array, v: Array) -> tuple[Inertia, Force]:
    """Inertia of body i about its frame's origin, and its bias force v x* I v (Featherstone 2008, (2.63), (7.13)).

    The term v x m v = 0 is left out, whose rounding error would exceed a small inertia; the terms in h follow from it
    by Jacobi's identity.
    """
    m, h, I = (moment[i] for moment in model.moments)
    omega_v = cross(omega, v)
    n = cross(omega, rotate(I, omega)) + cross(h, omega_v)
    f = m * omega_v + cross(omega, cross(omega, h))
    return Inertia(I, cross_matrix(h), m * IDENTITY), Force(n, f)


def hinge_of(
    body: Inertia, bias: Force, s: Array, t: Array, omega: Array, v: Array, rate: Array, tau: Array, armature: Array
) -> Hinge:
    """U, d, u and c of a joint with axes s and t (Featherstone 2008, (7.43)-(7.45)); rate and tau (..., 1)."""
    U_n = rotate(body.I, s) + rotate(body.H, t)
    U_f = rotate(transpose(body.H), s) + rotate(body.M, t)
    d = dot(s, U_n)[..., None] + dot(t, U_f)[..., None] + armature
    u = tau - dot(s, bias.n)[..., None] - dot(t, bias.f)[..., None]
    return Hinge(U_n, U_f, d, u, cross(omega, s * rate), cross(v, s * rate) + cross(omega, t * rate))


def release_joint(body: Inertia, bias: Force, hinge: Hinge) -> tuple[Inertia, Force]:
    """Inertia and bias force across the free joint: I^a and p^a of Featherstone 2008, (7.25) and (7.24)."""
    U_n, U_f, d = hinge.U_n, hinge.U_f, hinge.d[..., None]
    I = body.I - outer(U_n, U_n) / d
    H = body.H - outer(U_n, U_f) / d
    M = body.M - outer(U_f, U_f) / d
    share = hinge.u / hinge.d
    n = bias.n + rotate(I, hinge.c_angular) + rotate(H, hinge.c_linear) + U_n * share
    f = bias.f + rotate(transpose(H), hinge.c_angular) + rotate(M, hinge.c_linear) + U_f * share
    return Inertia(I, H, M), Force(n, f)


def move_to_parent(body: Inertia, bias: Force, R: Array, p: Array) -> tuple[Inertia, Force]:
    """The same seen from the parent's frame: rotated by R, then the reference point moved by p."""
    I, H, M = (R @ block @ transpose(R) for block in body)
    P = cross_matrix(p)
    H_p = H + P @ M
    f = rotate(R, bias.f)
    return Inertia(I - H @ P + P @ transpose(H_p), H_p, M), Force(rotate(R, bias.n) + cross(p, f), f)


@judged_quantity(judge_accelerations)
def articulated_forward_dynamics(
    model: Model, q: Array, qd: Array, tau: Array, *, external: External | None = None
) -> tuple[Array, Array, Array]:
    """Joint accelerations that the torques tau give, without forming M.

    Parameters
    ----------
    model : Model
        Without mimic joints.
    q, qd, tau : ndarray, shape (..., n)
        Joint positions, rates and torques [rad or m; rad/s or m/s; N m or N].
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
    s, t = model.angular_axis, model.linear_axis
    omega, v = velocities(model, R, p, qd)
    inertia: dict[int, Inertia] = {}
    bias: dict[int, Force] = {}
    for i in range(model.nb):
        inertia[i], bias[i] = rigid_body(model, i, omega[i], v[i])
    for i, (moment, force) in applied_wrenches(model, external).items():
        if i != BASE:
            bias[i] = Force(bias[i].n - moment, bias[i].f - force)

    # inwards: articulated inertia and bias force of each body
    hinge: dict[int, Hinge] = {}
    for i in reversed(range(model.nb)):
        rate, torque = qd[..., i, None], tau[..., i, None]
        hinge[i] = hinge_of(inertia[i], bias[i], s[i], t[i], omega[i], v[i], rate, torque, model.armature[i])
        parent = model.parent[i]
        if parent != BASE:
            free = release_joint(inertia[i], bias[i], hinge[i])
            I, b = move_to_parent(*free, R[i], p[i])
            inertia[parent] = Inertia(*(x + y for x, y in zip(inertia[parent], I, strict=True)))
            bias[parent] = Force(*(x + y for x, y in zip(bias[parent], b, strict=True)))

    # outwards: accelerations
    qdd, pivots = zeros(q.shape, like=q), zeros(q.shape, like=q)
    alpha, a = {BASE: zeros((3,), like=q)}, {BASE: zeros((3,), like=q) - model.gravity}
    for i, parent in enumerate(model.parent):
        c = hinge[i]
        alpha_i = rotate_back(R[i], alpha[parent]) + c.c_angular
        a_i = rotate_back(R[i], a[parent] + cross(alpha[parent], p[i])) + c.c_linear
        qdd_i = (c.u - dot(c.U_n, alpha_i)[..., None] - dot(c.U_f, a_i)[..., None]) / c.d
        alpha[i], a[i] = alpha_i + s[i] * qdd_i, a_i + t[i] * qdd_i
        qdd[..., i], pivots[..., i] = qdd_i[..., 0], c.d[..., 0]
    return qdd, pivots, mass_diagonal(model, composite_inertias(model, R, p), like=q)
