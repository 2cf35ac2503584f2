"""The Coriolis matrix of the Christoffel symbols, from Jacobians."""

from __future__ import annotations

from ..basics.spatial import Array, cross, cross_matrix, rotate, transpose, zeros
from ..model.model import Model
from ..model.parameters import ModelWithMoments
from .jacobians import body_jacobian_rates, body_jacobians
from .kinematics import joint_rates, joint_transforms
from .quantity import quantity


@quantity(moments=True)
def coriolis_matrix(model: Model, q: Array, qd: Array) -> Array:
    """The matrix C(q, qd) of the Christoffel symbols: C qd is the Coriolis torque and dM/dt = C + C^T.

    Parameters
    ----------
    model : Model
        The robot's parameters.
    q, qd : ndarray, shape (..., n)
        Joint positions and rates [rad or m; rad/s or m/s].

    Returns
    -------
    ndarray, shape (..., n, n)
        Torque i per rate j [N m s/rad, N s or N s/m].

    Raises
    ------
    ValueError
        If an array has the wrong shape or is not finite, or C overflows.

    Notes
    -----
    A rigid body is a sum of point masses, and for a point mass C = m J^T dJ/dt gives the Christoffel symbols. Summed
    over the body, with rates of components in its own axes:
    C = m Jc^T (dJc + [omega]x Jc) + Jw^T (I dJw + (tr(I)/2 [omega]x - [I omega]x) Jw).
    dM/dt - 2C is skew: Siciliano et al. 2009, (7.49).

    Examples
    --------
    >>> import rne
    >>> rne.dynamics.coriolis_matrix(rne.irb140(), [0] * 6, [0] * 6).any().item()
    False
    """
    R, p = joint_transforms(model, q)
    rates = joint_rates(model, qd)
    all_Jw, all_Jv = body_jacobians(model, R, p)
    all_dJw, all_dJv = body_jacobian_rates(model, R, p, rates, all_Jw, all_Jv)
    C = zeros((*q.shape[:-1], model.nb, model.nb), like=q)
    for i in range(model.nb):
        omega = (all_Jw[i] * rates[..., :, None]).sum(-2)
        C = C + body_coriolis_matrix(model, i, omega, all_Jw[i], all_Jv[i], all_dJw[i], all_dJv[i])
    if model.has_mimics:
        C = model.coordinate_map.T @ C @ model.coordinate_map
    return C


def body_coriolis_matrix(model: Model, i: int, omega: Array, Jw: Array, Jv: Array, dJw: Array, dJv: Array) -> Array:
    """Share of a body in C, from Jacobians of its frame's origin; rows are joints: J^T of the docstring."""
    if isinstance(model, ModelWithMoments):  # bodies without mass have no centre
        m, h, I = model.body_moments(i)
        m, h = m[..., None], h[..., None, :]
        a = dJv + cross(omega[..., None, :], Jv)
        f = m * a + cross(dJw, h) + cross(omega[..., None, :], cross(Jw, h))
        by_moments: Array = Jv @ transpose(f) + Jw @ transpose(cross(h, a) + angular_part(I, omega, Jw, dJw))
        return by_moments
    m, c, I = model.mass[i], model.com[i], model.inertia[i]
    Jc, dJc = Jv + cross(Jw, c), dJv + cross(dJw, c)
    f = m * (dJc + cross(omega[..., None, :], Jc))
    C: Array = Jc @ transpose(f) + Jw @ transpose(angular_part(I, omega, Jw, dJw))
    return C


def angular_part(I: Array, omega: Array, Jw: Array, dJw: Array) -> Array:
    """I dJw + (tr(I)/2 [omega]x - [I omega]x) Jw, rows are joints."""
    trace = I[..., :1, :1] + I[..., 1:2, 1:2] + I[..., 2:, 2:]
    spin = trace / 2 * cross_matrix(omega) - cross_matrix(rotate(I, omega))
    n: Array = dJw @ I + Jw @ transpose(spin)
    return n
