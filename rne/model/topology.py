"""Properties of the tree of joints: ends of chains, groups of joints, couplings, orders of other libraries."""

from __future__ import annotations

from collections.abc import Collection, Sequence

import numpy as np

from ..basics.spatial import Array
from ..basics.text import listed
from ..errors import ModelError, NotFiniteError
from .model import Loop, Model

SAME = 1e-9  # tolerance of equal frames, for rounding in files [m, and entries of rotations]
TOOL = "tool0"  # name of an arm's tool frame by the convention of ROS-Industrial


def end_link(model: Model, *, axes_count: bool = False) -> str:
    """Link at the end of an unbranched chain, such as a fixed frame after the last joint; see `end_links`."""
    return end_links(model, axes_count=axes_count)[0]


def end_links(model: Model, *, axes_count: bool = False) -> list[str]:
    """Link at the end of an unbranched chain, followed by those with the same frame.

    It has no children and moves with the last joint. If several links do, they must have the same origin, and the same
    axes if `axes_count`; then tool0 is the first, or else the last of them in `link_names`. Otherwise, and if moving
    joints branch or one mimics another, a ValueError gives the reason and the links to choose from.
    """
    ends = _ends(model)
    mimics = [joint for i, joint in enumerate(model.moving_joints) if i not in model.independent_joints]
    if not _is_chain(model):
        reason = "its moving joints branch"
    elif mimics:
        follows = "follows others" if any(c.joint == mimics[0] for c in model.couplings) else "mimics another"
        reason = f"its joint {mimics[0]!r} {follows}"
    else:
        return _of_one_frame(model, ends, axes_count=axes_count)
    candidates = [model.link_names[k] for k in _leaves(model) if model.link_body[k] >= 0 or not model.nb]
    choice = f"its leaf links are {candidates}, others are in `link_names`"
    raise ValueError(f"`link` must be given for robot {model.name!r}: {reason}; {choice}")


def _of_one_frame(model: Model, ends: list[int], *, axes_count: bool) -> list[str]:
    """Names of links with one frame, tool0 or the last one first; a ValueError for different frames."""
    names = [model.link_names[k] for k in ends]
    if not _all_same(model.link_translation[ends]):
        reason = "at several points"
    elif axes_count and not _all_same(model.link_rotation[ends]):
        reason = "in links with different axes, in which `com` and `inertia` are given"
    else:
        first = TOOL if TOOL in names else names[-1]
        return [first, *(name for name in names if name != first)]
    both, where = f"{listed(names[:-1])} and {names[-1]}", f"the last body of robot {model.name!r} ends {reason}"
    raise ValueError(f"ambiguous: {both} have different frames, choose one by `link`: {where}")


def tip(model: Model) -> Array | None:
    """End of the last body of an unbranched chain in its frame, the thesis's r_{n-1,n}, shape (3,) [m].

    It is the origin of the frame fixed to the last joint's link; None if there is none, or several at different points,
    or the chain branches.
    """
    ends = _ends(model)
    if not model.nb or not _is_chain(model) or not _all_same(model.link_translation[ends]):
        return None
    if model.link_joints[ends[-1]] == model.moving_joints[-1]:
        return None
    return np.asarray(model.link_translation[ends[-1]])


def _is_chain(model: Model) -> bool:
    return all(parent == i - 1 for i, parent in enumerate(model.parent))


def _leaves(model: Model) -> list[int]:
    """Links without children, by their indices in `link_names`."""
    carrying = set(model.link_parent)
    return [k for k in range(len(model.link_names)) if k not in carrying]


def _ends(model: Model) -> list[int]:
    """Leaves that belong to the last body."""
    return [k for k in _leaves(model) if model.link_body[k] == model.nb - 1]


def _all_same(values: Array) -> bool:
    return bool(np.all(np.abs(values - values[-1]) <= SAME))


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
    """Groups of bodies, in tree order; each group is carried by one body outside of it, or by the base.

    A joint that follows no other and that none follows is a group by itself. Others are grouped with the joints that
    follow them, and with the bodies on the paths between them.
    """
    groups = [{i for i, drivers in drivers_of(model).items() if k in drivers} for k in range(model.n)]
    before: list[set[int]] = []
    while groups != before:
        before, groups = groups, []
        for group in (_with_paths(model, group) for group in before):
            apart = [other for other in groups if not group & other]
            groups = [*apart, group.union(*(other for other in groups if group & other))]
    return sorted(tuple(sorted(group)) for group in groups)


def carriers(parent: Sequence[int], body: int) -> list[int]:
    """Body and all that carry it, towards the base, by the parent of each."""
    found = []
    while body >= 0:
        found.append(body)
        body = parent[body]
    return found


def _with_paths(model: Model, bodies: Collection[int]) -> set[int]:
    """Bodies, and those on the paths between them."""
    above = [set(carriers(model.parent, model.parent[i])) for i in bodies]
    return {*bodies}.union(*above) - above[0].intersection(*above)


def loop_joints(model: Model, loop: Loop) -> tuple[set[int], set[int]]:
    """Joints of a closed linkage on the way to each link of its pivot."""
    first, second = ({*carriers(model.parent, model.link_body[model.link_index(link)])} for link, _ in loop.ends)
    return first - second, second - first


def drivers_of(model: Model) -> dict[int, list[int]]:
    """Coordinates that each moving joint's position depends on."""
    return {i: [k] for i, k in enumerate(model.coordinate)} | {i: own for i, own, _ in model.coupled_joints}


def loads_not_known(model: Model) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Joints and pivots whose loads are unknown, and the cause: joints coupled by parts not in the model.

    Such parts may load all joints between those that move together, and the linkages that contain one of these. Joints
    that carry all of these, or are carried by them, have the same loads with any such parts.
    """
    closed = {joint for loop in model.loops for joint in loop.followers}
    drivers = drivers_of(model)
    unknown, causes = set[int](), list[str]()
    for i, joint in enumerate(model.moving_joints):
        if i not in model.independent_joints and joint not in closed:
            unknown |= _with_paths(model, [i, *(model.independent_joints[k] for k in drivers[i])])
            causes.append(joint)
    loops = {loop.name: set.union(*loop_joints(model, loop)) for loop in model.loops}
    while further := set[int]().union(*(joints for joints in loops.values() if joints & unknown)) - unknown:
        unknown |= further
    pivots = (name for name, joints in loops.items() if joints & unknown)
    return (*(model.moving_joints[i] for i in sorted(unknown)), *pivots), tuple(causes)


def refuse_couplings(model: Model, what: str, cure: str = "") -> None:
    """Raise a ModelError that names the first coupling, if there is one; `what` does not support couplings."""
    if model.couplings:
        joint, drivers = model.couplings[0].joint, listed(model.couplings[0].drivers)
        raise ModelError(f"{what} no couplings, but joint {joint!r} of robot {model.name!r} follows {drivers}{cure}")


def check_closure(model: Model, q: Array) -> None:
    """Raise a NotFiniteError where a coupled joint has no position; names its drivers and their ranges."""
    for i, drivers, coupling in model.coupled_joints:
        given = q[..., drivers].real.astype(np.float64)
        bad = ~np.isfinite(coupling.derivatives(given)[0]).all(-1)
        if bad.any():
            state = tuple(np.argwhere(bad)[0].tolist())
            own = (model.independent_joints[k] for k in drivers)
            pairs = zip(coupling.drivers, given[state].tolist(), own, strict=True)
            at = (f"{name!r} at {x:.6g}, range {model.lower[j]:.6g} ... {model.upper[j]:.6g}" for name, x, j in pairs)
            raise NotFiniteError(f"joint {model.moving_joints[i]!r} cannot follow {', '.join(at)}", state=state)


def where_loops_close(model: Model, q: Array) -> Array:
    """Random coordinates, moved well inside the ranges of a robot with couplings."""
    if not model.couplings:
        return q
    lower, upper = (model.coordinate_limits()[name] for name in ("lower", "upper"))
    low, high = (np.clip(x, -np.pi, np.pi) for x in (lower, upper))
    beyond = low == high  # ranges that begin above pi, or end below -pi
    low = np.where(beyond, np.maximum(lower, upper - 2 * np.pi), low)
    high = np.where(beyond, np.minimum(upper, low + 2 * np.pi), high)
    return np.asarray((low + high) / 2 + 0.4 * (high - low) * np.sin(q))
