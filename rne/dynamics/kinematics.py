"""Joint transforms, poses and velocities.

R[i] takes coordinates of frame i to its parent body's frame, p[i] is the origin of frame i seen from there
(the thesis's R_i^{i-1} and r_{i-2,i-1}).
"""

from __future__ import annotations

from ..model import Model
from ..spatial import Array, cross, rotate, rotate_back, rotation_about, zeros
from .checks import checked


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
    turned = model.rotation @ rotation_about(model.axis, position * model.turns)
    R = [turned[..., i, :, :] for i in range(model.nb)]
    p = [
        model.translation[i]
        if model.is_revolute(i)
        else model.translation[i] + rotate(model.rotation[i], model.axis[i]) * position[..., i, None]
        for i in range(model.nb)
    ]
    return R, p


def body_poses(model: Model, q: Array) -> tuple[list[Array], list[Array]]:
    """Rotation and origin of every body's frame, seen from the root link."""
    R, p = joint_transforms(model, q)
    R0: list[Array] = []
    p0: list[Array] = []
    for i, parent in enumerate(model.parent):
        R0.append(R[i] if parent < 0 else R0[parent] @ R[i])
        p0.append(p[i] if parent < 0 else p0[parent] + rotate(R0[parent], p[i]))
    return R0, p0


@checked
def link_poses(model: Model, q: Array) -> Array:
    """Pose of every link, as homogeneous matrices.

    Parameters
    ----------
    model : Model
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
    >>> rne.link_poses(rne.irb140(), [0, 0, 0, 0, 0, 0])[2, :3, 3].tolist()
    [0.07, 0.0, 0.352]
    """
    R0, p0 = body_poses(model, q)
    T = zeros((*q.shape[:-1], len(model.link_names), 4, 4), like=q)
    for k, body in enumerate(model.link_body):
        R, p = model.link_rotation[k], model.link_translation[k]
        T[..., k, :3, :3] = R if body < 0 else R0[body] @ R
        T[..., k, :3, 3] = p if body < 0 else p0[body] + rotate(R0[body], p)
        T[..., k, 3, 3] = 1
    return T


def velocities(model: Model, R: list[Array], p: list[Array], qd: Array) -> tuple[list[Array], list[Array]]:
    """Angular velocity of every body and velocity of its frame's origin, in its own axes."""
    rates = joint_rates(model, qd)
    omega: list[Array] = []
    v: list[Array] = []
    for i, parent in enumerate(model.parent):
        b_qd = model.axis[i] * rates[..., i, None]
        still = zeros(b_qd.shape, like=qd)
        omega_i = still if parent < 0 else rotate_back(R[i], omega[parent])
        v_i = still if parent < 0 else rotate_back(R[i], v[parent] + cross(omega[parent], p[i]))
        omega.append(omega_i + b_qd if model.is_revolute(i) else omega_i)
        v.append(v_i if model.is_revolute(i) else v_i + b_qd)
    return omega, v
