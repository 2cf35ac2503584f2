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
    for k, parent in enumerate(model.link_tree):
        children.setdefault(parent, []).append(k)
    joints, stack = [], [0]
    while stack:
        k = stack.pop()
        joints.append(model.link_joints[k])
        stack += sorted(children.get(k, []), key=lambda child: model.link_joints[child], reverse=True)
    return np.array([model.joint_names.index(joint) for joint in joints if joint in model.joint_names], dtype=int)
