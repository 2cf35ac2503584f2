"""Joint transforms, poses and velocities.

R[i] takes coordinates of frame i to its parent body's frame, p[i] is the origin of frame i seen from there
(the thesis's R_i^{i-1} and r_{i-2,i-1}). The initial values of a recursion are stored under the key BASE, the parent
of the first bodies.
"""

from __future__ import annotations

from ..basics.spatial import IDENTITY, Array, cross, rotate, rotate_back, rotation_about, zeros
from ..model.model import Model
from .quantity import quantity

BASE = -1


def joint_positions(model: Model, q: Array) -> Array:
    """Positions of the moving joints, mimics included, shape (..., nb)."""
    if not model.has_mimics:
        return q
    return q[..., model.coordinate] * model.multiplier + model.offset


def joint_rates(model: Model, qd: Array) -> Array:
    """Rates (or accelerations) of the moving joints, mimics included, shape (..., nb)."""
    if not model.has_mimics:
        return qd
    return qd[..., model.coordinate] * model.multiplier


def joint_transforms(model: Model, q: Array) -> tuple[list[Array], list[Array]]:
    """R[i] and p[i] of every body, from the coordinates q."""
    position = joint_positions(model, q)
    # a sliding joint does not rotate; int8 keeps the dtype of the positions
    R = model.rotation @ rotation_about(model.axis, position * model.is_revolute.astype("int8"))
    p = model.translation + rotate(model.rotation, model.linear_axis) * position[..., None]
    return [R[..., i, :, :] for i in range(model.nb)], [p[..., i, :] for i in range(model.nb)]


def body_poses(model: Model, q: Array) -> tuple[dict[int, Array], dict[int, Array]]:
    """Rotation and origin of every body's frame, seen from the root link."""
    R, p = joint_transforms(model, q)
    R0: dict[int, Array] = {BASE: IDENTITY}
    p0: dict[int, Array] = {BASE: zeros((3,), like=q)}
    for i, parent in enumerate(model.parent):
        R0[i] = R0[parent] @ R[i]
        p0[i] = p0[parent] + rotate(R0[parent], p[i])
    return R0, p0


@quantity()
def link_poses(model: Model, q: Array) -> Array:
    """Pose of every link, as homogeneous matrices.

    Parameters
    ----------
    model : Model
        The robot's parameters.
    q : ndarray, shape (..., n)
        Joint positions [rad or m].

    Returns
    -------
    ndarray, shape (..., n_links, 4, 4)
        Takes coordinates of a link's frame to those of the root link; links in `link_names` order [1, m].

    Raises
    ------
    ValueError
        If `q` has the wrong shape or is not finite.

    Notes
    -----
    Siciliano et al. 2009, (2.50): products of the joints' transforms.

    Examples
    --------
    >>> import rne
    >>> rne.dynamics.link_poses(rne.irb140(), [0, 0, 0, 0, 0, 0])[2, :3, 3].tolist()
    [0.07, 0.0, 0.352]
    """
    R0, p0 = body_poses(model, q)
    T = zeros((*q.shape[:-1], len(model.link_names), 4, 4), like=q)
    for k, body in enumerate(model.link_body):
        R, p = model.link_rotation[k], model.link_translation[k]
        T[..., k, :3, :3] = R0[body] @ R
        T[..., k, :3, 3] = p0[body] + rotate(R0[body], p)
        T[..., k, 3, 3] = 1
    return T


def velocities(model: Model, R: list[Array], p: list[Array], qd: Array) -> tuple[dict[int, Array], dict[int, Array]]:
    """Angular velocity of every body and velocity of its frame's origin, in its own axes."""
    rates = joint_rates(model, qd)
    zero = zeros((*rates.shape[:-1], 3), like=qd)
    omega, v = {BASE: zero}, {BASE: zero}
    for i, parent in enumerate(model.parent):
        omega[i] = rotate_back(R[i], omega[parent]) + model.angular_axis[i] * rates[..., i, None]
        v_p = v[parent] + cross(omega[parent], p[i])
        v[i] = rotate_back(R[i], v_p) + model.linear_axis[i] * rates[..., i, None]
    return omega, v
