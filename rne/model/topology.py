"""Properties of the tree of joints: where a chain ends, joints that move together, other libraries' joint order."""

from __future__ import annotations

from itertools import product
from math import prod

import numpy as np

from ..basics.spatial import Array
from .model import Model

GRID = 1000  # samples of a group at most on a grid
SEEDED = 400  # samples of a group otherwise
LONGEST = 400  # samples of one coordinate


def end_link(model: Model, *, axes_count: bool = False) -> str:
    """The link at the end of an unbranched chain, a fixed frame behind the last joint included.

    Of the links that no other is attached to, it is the one that moves with the last joint. If several do, they must
    have the same origin, and the same axes if `axes_count`; then it is the last of them in `link_names`. Otherwise, and
    where moving joints branch or one mimics another, a ValueError says why and names the leaf links.
    """
    ends = _ends(model)
    mimics = [joint for i, joint in enumerate(model.moving_joints) if i not in model.independent_joints]
    if not _is_chain(model):
        reason = "its moving joints branch"
    elif mimics:
        reason = f"its joint {mimics[0]!r} mimics another"
    elif not _at_one_point(model, ends):
        reason = "its last body ends at several points"
    elif axes_count and not _of_one_orientation(model, ends):
        reason = "its last body ends in links with different axes, in which `com` and `inertia` are given"
    else:
        return model.link_names[ends[-1]]
    candidates = [model.link_names[k] for k in _leaves(model) if model.link_body[k] >= 0 or not model.nb]
    raise ValueError(
        f"`link` must be given for robot {model.name!r}: {reason}; its leaf links are {candidates}, others are in "
        "`link_names`"
    )


def tip(model: Model) -> Array | None:
    """End of the last body of an unbranched chain in its frame, the thesis's r_{n-1,n}, shape (3,) [m].

    It is the origin of the frame fixed behind the last joint's link; None if there is none, or several at different
    points, or the chain branches.
    """
    ends = _ends(model)
    if not model.nb or not _is_chain(model) or not _at_one_point(model, ends):
        return None
    if model.link_joints[ends[-1]] == model.moving_joints[-1]:
        return None
    end: Array = model.link_translation[ends[-1]]
    return end


def _is_chain(model: Model) -> bool:
    return all(parent == i - 1 for i, parent in enumerate(model.parent))


def _leaves(model: Model) -> list[int]:
    """Links that no other link is attached to, by their places in `link_names`."""
    carrying = set(model.link_parent)
    return [k for k in range(len(model.link_names)) if k not in carrying]


def _ends(model: Model) -> list[int]:
    """The leaves that belong to the last body."""
    return [k for k in _leaves(model) if model.link_body[k] == model.nb - 1]


def _of_one_orientation(model: Model, links: list[int]) -> bool:
    return bool(np.all(model.link_rotation[links] == model.link_rotation[links[-1]]))


def _at_one_point(model: Model, links: list[int]) -> bool:
    return bool(np.all(model.link_translation[links] == model.link_translation[links[-1]]))


def pinocchio_order(model: Model) -> Array:
    """Indices of the coordinates in the order of Pinocchio: depth first, siblings by the names of their joints.

    `q[..., pinocchio_order(model)]` holds the positions of the independent joints in Pinocchio's order, shape (n,).
    """
    children: dict[int, list[int]] = {}
    for k, parent in enumerate(model.link_parent):
        children.setdefault(parent, []).append(k)
    joints, stack = [], [0]
    while stack:
        k = stack.pop()
        joints.append(model.link_joints[k])
        stack += sorted(children.get(k, []), key=lambda child: model.link_joints[child], reverse=True)
    return np.array([model.joint_names.index(joint) for joint in joints if joint in model.joint_names], dtype=int)


def joint_groups(model: Model) -> list[tuple[int, ...]]:
    """Bodies by groups, in tree order; each group is carried by one body outside of it, or by the base.

    A joint that mimics no other and is mimicked by none is a group by itself. Others are joined with those that mimic
    them, and with the bodies on the paths between them.
    """
    carriers: list[set[int]] = []  # of each body, itself included
    for i, parent in enumerate(model.parent):
        carriers.append({i} | (carriers[parent] if parent >= 0 else set()))
    group = list(range(model.nb))
    while True:
        before = list(group)
        for k in range(model.n):
            _join(group, {i for i in range(model.nb) if model.coordinate[i] == k})
        for label in sorted(set(group)):
            bodies = [i for i in range(model.nb) if group[i] == label]
            if len(bodies) > 1:
                outside = set.intersection(*(carriers[i] - {i} for i in bodies))
                _join(group, set.union(*(carriers[i] for i in bodies)) - outside)
        if group == before:
            return [tuple(i for i in range(model.nb) if group[i] == label) for label in sorted(set(group))]


def _join(group: list[int], bodies: set[int]) -> None:
    labels = {group[i] for i in bodies}
    group[:] = [min(labels) if label in labels else label for label in group]


def sample_positions(model: Model, bodies: tuple[int, ...], coordinates: list[int]) -> Array:
    """Positions of a group's coordinates that determine its energies for all others, shape (samples, coordinates).

    Energies are of degree two in the sine and cosine of a rotating joint, and in the position of a sliding one. So five
    angles, or three positions, determine them. For several joints on one coordinate they are sums of exponentials and
    powers, and as many samples determine them. Several coordinates have a grid of these samples. If that is too large,
    positions at random are used: the span of the energies is then the true one except for a set of positions of measure
    zero. The first position is zero.
    """
    samples = [_samples_of_coordinate(model, bodies, k) for k in coordinates]
    if prod(map(len, samples)) <= GRID:
        return np.array(list(product(*samples)))
    largest = [np.abs(x).max() for x in samples]
    positions: Array = np.random.default_rng(0).uniform(-1, 1, (SEEDED, len(coordinates))) * largest
    positions[0] = 0
    return positions


def _samples_of_coordinate(model: Model, bodies: tuple[int, ...], k: int) -> Array:
    driven = [i for i in bodies if model.coordinate[i] == k and model.multiplier[i] != 0]
    factors = [abs(float(model.multiplier[i])) for i in driven if model.is_revolute[i]]
    powers = 1 + 2 * (len(driven) - len(factors))
    frequencies = np.zeros(1)
    for factor in factors:
        sums = (frequencies[:, None] + factor * np.arange(-2, 3)).ravel()
        frequencies = np.unique(sums.round(9))
    if len(driven) == 1 and factors:
        return np.asarray(np.arange(5) * (2 * np.pi / 5 / factors[0]))
    step, count = 1.0 / powers, powers
    if factors:  # shorter than half a period of the fastest, together longer than one of the slowest beat
        step = np.pi / (frequencies.max() + min(factors))
        beat = 2 * np.pi / np.diff(frequencies).min()
        count = min(LONGEST, max(2 * powers * len(frequencies) + 1, int(np.ceil(beat / step))))
    steps = np.arange(count) - count // 2
    return np.asarray(step * steps[np.argsort(np.abs(steps), kind="stable")])
