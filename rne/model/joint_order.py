"""The order in which other libraries number the joints of a robot."""

from __future__ import annotations

import numpy as np

from ..basics.spatial import Array
from .model import Model


def pinocchio_order(model: Model) -> Array:
    """Indices of the coordinates in the order of Pinocchio: depth first, siblings by the names of their joints.

    `q[..., pinocchio_order(model)]` holds the positions of the independent joints in Pinocchio's order, shape (n,).
    """
    children: dict[int, list[int]] = {}
    parents = _attached_to_bodies(model) if model.link_parent is None else model.link_parent
    for k, parent in enumerate(parents):
        children.setdefault(parent, []).append(k)
    joints, stack = [], [0]
    while stack:
        k = stack.pop()
        joints.append(model.link_joints[k])
        stack += sorted(children.get(k, []), key=lambda child: model.link_joints[child], reverse=True)
    return np.array([model.joint_names.index(joint) for joint in joints if joint in model.joint_names], dtype=int)


def _attached_to_bodies(model: Model) -> list[int]:
    """The parent of each link, links on fixed joints being attached to the link of their body on a moving joint."""
    place = {joint: k for k, joint in enumerate(model.link_joints)}
    carrier = {i: place[joint] for i, joint in enumerate(model.moving_joints)} | {-1: 0}
    above = {place[joint]: carrier[model.parent[i]] for i, joint in enumerate(model.moving_joints)}
    return [-1 if k == 0 else above.get(k, carrier[body]) for k, body in enumerate(model.link_body)]
