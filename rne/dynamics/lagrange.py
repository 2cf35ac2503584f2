"""Inverse dynamics by the Euler-Lagrange formulation, from the energies of the whole robot.

d/dt dT/dqd - dT/dq + dU/dq = tau with T = qd^T M(q) qd / 2 becomes M qdd + C qd + g = tau, where M, its derivatives
and g are sums over the bodies of products of Jacobians (Siciliano et al. 2009, section 7.1; Spong, Hutchinson and
Vidyasagar 2006, sections 7.2 and 7.3). It shares only the kinematics with the Newton-Euler recursions, which it tests.

| quantity                               | code          | Siciliano           | Spong        |
|----------------------------------------|---------------|---------------------|--------------|
| Jacobian of body i's centre of mass    | Jc            | J_P^(l_i)           | J_vci        |
| Jacobian of its angular velocity       | Jw            | J_O^(l_i)           | J_wi         |
| inertia matrix                         | M             | B                   | D            |
| Christoffel symbols of the first kind  | c[i, j, k]    | c_kij               | c_ijk        |
| gravity's torque                       | g             | g                   | g            |

`coriolis_matrix` sums the same products of Jacobians without derivatives of M.

A Jacobian is stored as rows, one per joint, in the axes of its own body, where the body's inertia is constant.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..basics.spatial import Array, christoffel, cross, cross_matrix, rotate, rotate_back, transpose, zeros
from ..model.model import Model
from .crba import solve_with_pivots
from .kinematics import (
    BASE,
    body_jacobian_derivatives,
    body_jacobians,
    coordinate_map,
    coordinate_map_derivatives,
    coordinate_map_rate,
    joint_accelerations,
    joint_transforms,
    joint_velocities,
    on_coordinates,
)
from .precision import check_accelerations
from .quantity import Solved, checked_quantity, quantity


class Body(NamedTuple):
    """Terms of one body: Jacobians of centre of mass and rotation, mass, inertia and gravity, in its own axes."""

    Jc: Array
    Jw: Array
    mass: Array
    inertia: Array
    gravity: Array


def bodies(model: Model, q: Array) -> list[Body]:
    """Terms of all bodies at q."""
    R, p = joint_transforms(model, q)
    Jw, Jv = body_jacobians(model, R, p)
    gravity = {BASE: model.gravity}
    for i, parent in enumerate(model.parent):
        gravity[i] = rotate_back(R[i], gravity[parent])
    return [
        Body(Jv[i] + cross(Jw[i], model.com[i]), Jw[i], model.mass[i], model.inertia[i], gravity[i])
        for i in range(model.nb)
    ]


def jacobian_derivatives(body: Body) -> tuple[Array, Array]:
    """dJc[k, j], dJw[k, j], shape (..., nb, nb, 3): derivatives of row j by q_k, in closed form.

    Joint k rotates everything distal to it: d Jc_j / dq_k = z_k x Jc_j for k proximal to j. Second derivatives commute,
    so for k distal to j it is z_j x Jc_k. A sliding joint rotates nothing: its row of Jw is zero. The angular rows are
    components in the body's axes; z_j changes in these only if joint k is distal to j, by -z_k x z_j. Derived for
    chains by Bruyninckx and De Schutter 1996, Mech. Mach. Theory 31.
    """
    nb = body.Jw.shape[-2]
    k, j = np.indices((nb, nb))
    inner, outer = np.minimum(k, j), np.maximum(k, j)  # parents come first; off the path to the body rows are zero
    dJc = cross(body.Jw[..., inner, :], body.Jc[..., outer, :])
    dJw: Array = cross(body.Jw[..., j, :], body.Jw[..., k, :]) * np.greater(k, j)[..., None]
    return dJc, dJw


def inertia_matrix(model: Model, terms: list[Body], like: Array) -> Array:
    """M = sum of m Jc^T Jc + Jw^T I Jw, with the drives' inertia on the diagonal, shape (..., nb, nb)."""
    M: Array = zeros((*like.shape[:-1], model.nb, model.nb), like=like) + np.diag(model.armature)
    for b in terms:
        M = M + b.mass * (b.Jc @ transpose(b.Jc)) + b.Jw @ b.inertia @ transpose(b.Jw)
    return M


def inertia_derivatives(model: Model, terms: list[Body], like: Array) -> Array:
    """dM[i, j, k] = dM_ij / dq_k by the product rule, shape (..., nb, nb, nb)."""
    half = zeros((*like.shape[:-1], model.nb, model.nb, model.nb), like=like)  # [k, i, j], row i differentiated
    for b in terms:
        dJc, dJw = jacobian_derivatives(b)
        half = half + b.mass * (dJc @ transpose(b.Jc)[..., None, :, :])
        half = half + dJw @ (b.inertia @ transpose(b.Jw))[..., None, :, :]
    return np.asarray(np.moveaxis(half + transpose(half), -3, -1))


def gravity_terms(model: Model, terms: list[Body], like: Array) -> Array:
    """g_k = -sum of m g0^T Jc_k, shape (..., nb)."""
    g = zeros((*like.shape[:-1], model.nb), like=like)
    for b in terms:
        g = g - b.mass * rotate(b.Jc, b.gravity)
    return g


@quantity()
def christoffel_symbols(model: Model, q: Array) -> Array:
    """Christoffel symbols of the first kind of M(q): the Coriolis torque is their sum with qd_i qd_j over i and j.

    Parameters and errors are those of `rne.Robot.mass_matrix`, with the model first.

    Returns
    -------
    ndarray, shape (..., n, n, n)
        Entry [..., i, j, k] is (dM_kj/dq_i + dM_ki/dq_j - dM_ij/dq_k) / 2, symmetric in i and j; k is the joint on
        which the torque acts [kg m^2, kg m or kg].

    Notes
    -----
    Spong, Hutchinson and Vidyasagar 2006, section 7.3; Siciliano et al. 2009, section 7.1, who write c_kij.
    The derivatives of M are closed forms of the Jacobians'. O(n^4).

    Examples
    --------
    >>> import numpy as np, rne
    >>> q, qd = np.arange(6) / 3, np.ones(6)
    >>> C = np.einsum("ijk,i,j", rne.dynamics.christoffel_symbols(rne.irb140(), q), qd, qd)
    >>> np.allclose(C, rne.dynamics.coriolis_torque(rne.irb140(), q, qd))
    True
    """
    terms = bodies(model, q)
    c = christoffel(inertia_derivatives(model, terms, q))
    if model.has_mimics:  # c_ijk G_ia G_jb G_kc, one index after the other
        G = coordinate_map(model, q)[..., None, :, :]
        for index in (-3, -2, -1):
            c = np.swapaxes(np.swapaxes(c, index, -1) @ G, index, -1)
    if model.couplings:  # and d^2 phi_l/dq_a dq_b M_lk G_kc
        MG = inertia_matrix(model, terms, q) @ coordinate_map(model, q)
        c = c + np.moveaxis(coordinate_map_derivatives(model, q), -3, -1) @ MG[..., None, :, :]
    return c


@quantity()
def lagrange_inverse_dynamics(model: Model, q: Array, qd: Array, qdd: Array) -> Array:
    """Joint torques M qdd + C qd + g by the Euler-Lagrange formulation; equal to those of `inverse_dynamics`.

    Siciliano et al. 2009, section 7.1; Spong, Hutchinson and Vidyasagar 2006, sections 7.2 and 7.3. O(n^4), where the
    recursion is O(n). Parameters, result and errors are those of `rne.Robot.inverse_dynamics` without `external`, with
    the model first.
    """
    M, bias = equations(model, q, joint_velocities(model, q, qd))
    return on_coordinates(model, q, rotate(M, joint_accelerations(model, q, qd, qdd)) + bias)


def equations(model: Model, q: Array, qd: Array) -> tuple[Array, Array]:
    """M and C qd + g of the moving joints, at their velocities qd, shapes (..., nb, nb) and (..., nb)."""
    terms = bodies(model, q)
    c = christoffel(inertia_derivatives(model, terms, q))
    C = (c * qd[..., :, None, None]).sum(-3)  # C_jk = sum of c_ijk qd_i: transposed
    return inertia_matrix(model, terms, q), rotate_back(C, qd) + gravity_terms(model, terms, q)


@checked_quantity(check_accelerations, moments=False)
def lagrange_forward_dynamics(model: Model, q: Array, qd: Array, tau: Array) -> Solved:
    """Joint accelerations by the Euler-Lagrange formulation; equal to those of `forward_dynamics`.

    Høifødt 2011, (6.3), with the terms of Siciliano et al. 2009, section 7.1. O(n^4). Parameters, result and errors are
    those of `rne.Robot.forward_dynamics` without `external`, with the model first. `lagrange_forward_dynamics.core`
    returns (qdd, pivots, diagonal of M).
    """
    M, bias = equations(model, q, joint_velocities(model, q, qd))
    if model.has_mimics:
        G, qdd = coordinate_map(model, q), joint_accelerations(model, q, qd, np.zeros_like(qd))  # dG/dt qd
        M, bias = transpose(G) @ M @ G, on_coordinates(model, q, bias + rotate(M, qdd) if model.couplings else bias)
    return solve_with_pivots(M, model.coordinate_parent, tau - bias)


@quantity(moments=True)
def coriolis_matrix(model: Model, q: Array, qd: Array) -> Array:
    """Matrix C(q, qd) of the Christoffel symbols: C qd is the Coriolis torque and dM/dt = C + C^T.

    A rigid body is a sum of point masses, and for a point mass C = m J^T dJ/dt gives the Christoffel symbols. Summed
    over the body, with derivatives of components in its own axes:
    C = m Jc^T (dJc + [omega]x Jc) + Jw^T (I dJw + (tr(I)/2 [omega]x - [I omega]x) Jw).
    dM/dt - 2C is skew: Siciliano et al. 2009, (7.49).
    Parameters, result and errors are those of `rne.Robot.coriolis_matrix`, with the model first.
    """
    R, p = joint_transforms(model, q)
    velocity = joint_velocities(model, q, qd)
    all_Jw, all_Jv = body_jacobians(model, R, p)
    all_dJw, all_dJv = body_jacobian_derivatives(model, R, p, velocity, all_Jw, all_Jv)
    C = zeros((*q.shape[:-1], model.nb, model.nb), like=q)
    MG = zeros((*q.shape[:-1], model.nb, model.n), like=q)
    if model.couplings:
        MG = model.armature[:, None] * (dG := coordinate_map_rate(model, q, qd))
    for i in range(model.nb):
        Jw, Jv, dJw, dJv = (J[i] for J in (all_Jw, all_Jv, all_dJw, all_dJv))
        omega = (Jw * velocity[..., :, None]).sum(-2)
        C = C + body_coriolis_matrix(model, i, omega, Jw, Jv, dJw, dJv)
        if model.couplings:  # of accelerations dG/dt qd: their share in M is that of dJ = J without a rotation
            MG = MG + body_coriolis_matrix(model, i, 0 * omega, Jw, Jv, Jw, Jv) @ dG
    if model.has_mimics:  # the angle of a joint that follows others has the velocity G qd: G^T (C G + M dG/dt)
        G = coordinate_map(model, q)
        C = transpose(G) @ (C @ G + MG) if model.couplings else transpose(G) @ C @ G
    return C


def body_coriolis_matrix(model: Model, i: int, omega: Array, Jw: Array, Jv: Array, dJw: Array, dJv: Array) -> Array:
    """Share of a body in C, from Jacobians of its frame's origin; rows are joints: J^T of the docstring."""
    if model.given_moments is not None:  # bodies without mass have no centre
        m, h, I = model.body_moments(i)
        m, h = m[..., None], h[..., None, :]
        a = dJv + cross(omega[..., None, :], Jv)
        f = m * a + cross(dJw, h) + cross(omega[..., None, :], cross(Jw, h))
        return np.asarray(Jv @ transpose(f) + Jw @ transpose(cross(h, a) + angular_part(I, omega, Jw, dJw)))
    m, c, I = model.mass[i], model.com[i], model.inertia[i]
    Jc, dJc = Jv + cross(Jw, c), dJv + cross(dJw, c)
    f = m * (dJc + cross(omega[..., None, :], Jc))
    return np.asarray(Jc @ transpose(f) + Jw @ transpose(angular_part(I, omega, Jw, dJw)))


def angular_part(I: Array, omega: Array, Jw: Array, dJw: Array) -> Array:
    """I dJw + (tr(I)/2 [omega]x - [I omega]x) Jw, rows are joints."""
    trace = I[..., :1, :1] + I[..., 1:2, 1:2] + I[..., 2:, 2:]
    spin = trace / 2 * cross_matrix(omega) - cross_matrix(rotate(I, omega))
    return np.asarray(dJw @ I + Jw @ transpose(spin))
