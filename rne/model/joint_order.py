"""The order in which other libraries number the joints of a robot."""

from __future__ import annotations

import numpy as np

from ..basics.spatial import Array
from .builder import disassemble
from .model import Model


def pinocchio_order(model: Model) -> Array:
    """Indices of the coordinates in the order of Pinocchio: depth first, siblings by the names of their joints.

    `q[..., pinocchio_order(model)]` holds the positions of the independent joints in Pinocchio's order, shape (n,).
    """
    parts = disassemble(model)
    children: dict[int, list[int]] = {}
    for k, part in enumerate(parts[1:], 1):
        children.setdefault(part.parent, []).append(k)
    names, stack = [], [0]
    while stack:
        k = stack.pop()
        names.append(parts[k].joint)
        stack += sorted(children.get(k, []), key=lambda child: parts[child].joint, reverse=True)
    return np.array([model.joint_names.index(name) for name in names if name in model.joint_names], dtype=int)
