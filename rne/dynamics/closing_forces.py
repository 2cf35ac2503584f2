"""Forces in the pivots that close linkages, from the torques of the open tree's joints that have no drives."""

from __future__ import annotations

from collections.abc import Collection
from typing import Any

import numpy as np

from ..basics.spatial import Array, cross, dot, rotate, rotate_back
from ..errors import NotFiniteError
from ..model.model import Loop, Model
from ..model.topology import loop_joints
from .kinematics import Bodies, body_poses
from .rnea import External

DEAD = 1e-9  # largest sine of the angle between the pivot's motions by the two coupled joints at a dead point


def closing_forces(
    model: Model, q: Array, tau: Array, not_known: Collection[str], external: External | None
) -> tuple[list[Array], dict[str, Array]]:
    """Force of each loop's pivot on its first link, in the link's axes; these and `external` as wrenches on links.

    `tau` (..., nb) are the torques that the joints of the open tree would need. The pivot supplies those of the two
    joints that follow: c_i F = tau_i, where c_i is the velocity of its first link relative to the second per unit
    velocity of joint i. F is in the plane of the linkage. Forces of loops that are `not_known` are NaN.
    """
    found, wrenches = dict[Loop, Array](), dict(external or {})
    poses, tau = body_poses(model, q), tau.copy()
    for loop in in_order(model):
        if loop.name in not_known:
            found[loop] = np.full(3, np.nan)
            continue
        sides, c = pivot_of(model, loop, *poses)
        F = plane_force(model, loop, c, tau, poses[0])
        for i, way in c.items():
            tau[..., i] = tau[..., i] - dot(way, F)
        for sign, (link, point, R) in zip((1, -1), sides, strict=True):
            force = sign * rotate_back(R, F)
            found.setdefault(loop, force)
            wrenches[link] = wrenches.get(link, 0) + np.concatenate([cross(point, force), force], axis=-1)
    return [found[loop] for loop in model.loops], wrenches


def in_order(model: Model) -> list[Loop]:
    """Loops in order of computation: each before those whose joints its force loads."""
    pending, order = [*model.loops], list[Loop]()
    joints = {loop: {model.moving_joints[i] for i in set.union(*loop_joints(model, loop))} for loop in pending}
    while pending:
        ready = (x for x in pending if not any(joints[y].intersection(x.followers) for y in pending if y != x))
        order.append(next(ready, pending[0]))
        pending.remove(order[-1])
    return order


def pivot_of(model: Model, loop: Loop, R0: Bodies, p0: Bodies) -> tuple[list[tuple[str, Array, Array]], Bodies]:
    """Links, points and rotations of a loop's ends, and each joint's motion of the first end relative to the second."""
    sides, c, pivot = list[tuple[str, Array, Array]](), dict[int, Array](), None
    for sign, (link, point), joints in zip((1, -1), loop.ends, loop_joints(model, loop), strict=True):
        k = model.link_index(link)
        here, at = model.link_body[k], np.asarray(point)
        sides.append((link, at, R0[here] @ model.link_rotation[k]))
        if pivot is None:
            at = model.link_translation[k] + rotate(model.link_rotation[k], at)
            pivot = p0[here] + rotate(R0[here], at)
        for i in joints:
            s, t = rotate(R0[i], model.angular_axis[i]), rotate(R0[i], model.linear_axis[i])
            c[i] = sign * (cross(s, pivot - p0[i]) + t)
    return sides, c


def plane_force(model: Model, loop: Loop, c: Bodies, tau: Array, R0: Bodies) -> Any:
    """Force F in the plane of a loop that does the work of both torques: c_i F = tau_i."""
    i, j = (model.moving_joints.index(joint) for joint in loop.followers)
    turning = i if model.is_revolute[i] else j
    normal = rotate(R0[turning], model.axis[turning])
    area = dot(cross(c[i], c[j]), normal)
    size = abs(dot(c[i], c[i]) * dot(c[j], c[j])) ** 0.5
    if (dead := np.asarray(abs(area) <= DEAD * size)).any():
        what = f"the force in the pivot {loop.name} is not determined at a dead point, where its links are in line"
        raise NotFiniteError(what, state=tuple(np.argwhere(dead)[0].tolist()))
    shares = tau[..., i, None] * cross(c[j], normal) - tau[..., j, None] * cross(c[i], normal)
    return shares / area[..., None]
