"""Construction of a Model from links and joints; the only place where fixed joints are merged.

Placements are composed in long double and rounded once, so that a thousand fixed joints in a row, or none, give
the same digits where long double is wider than double.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

import numpy as np

from ..basics.spatial import Array, combine_bodies, rotate, snap, symmetric, transpose
from .checks import DRIVES
from .model import STANDARD_GRAVITY, Model
from .solids import Box, Cylinder

# Fields of a Model by the corresponding field of a Part.
LIMITS_AND_DRIVES = {name: f"{name}_limit" for name in DRIVES}
LIMITS_AND_DRIVES |= {name: name for name in ("lower", "upper", "damping", "friction", "armature")}
Extended = np.longdouble  # no wider than double on some platforms


class Pose(NamedTuple):
    """Rotation and origin of a frame, seen from another, in long double."""

    R: Array
    p: Array

    def then(self, inner: Pose) -> Pose:
        """Pose of a frame that is placed at `inner` in this frame."""
        return Pose(snap(self.R @ inner.R), self.p + rotate(self.R, inner.p))


def pose(R: Any, p: Any) -> Pose:
    """Pose of any real arrays."""
    return Pose(np.array(R, dtype=Extended), np.array(p, dtype=Extended))


NO_MOTION = pose(np.eye(3), np.zeros(3))


class Mimic(NamedTuple):
    """Mimic joint: its position is `multiplier` times that of part `independent`'s joint, plus `offset`."""

    independent: int
    multiplier: Any
    offset: Any


def composed(written: Mapping[int, Mimic]) -> dict[int, Mimic]:
    """Mimics with mimics of mimics replaced by mimics of independent parts; those in a cycle follow a part of it."""
    found: dict[int, Mimic] = {}
    for k in written:
        chain = dict[int, None]()
        while k in written and k not in found and k not in chain:
            chain[k], k = None, written[k].independent
        for mimic in reversed(chain):
            (_, factor, offset), followed = written[mimic], found.get(k, Mimic(k, Extended(1), Extended(0)))
            found[mimic] = Mimic(followed.independent, factor * followed.multiplier, factor * followed.offset + offset)
            k = mimic
    return {k: Mimic(x, float(factor), float(offset)) for k, (x, factor, offset) in found.items()}


@dataclass(frozen=True, kw_only=True)
class Part:
    """Link with the joint that carries it; the root has no joint. Quantities as in Model.

    `link_origin` is the origin of the link's frame in the joint's frame, zero unless the joint's origin was moved along
    its axis. All other quantities, placements of other parts included, are seen from the joint's frame.
    """

    link: str
    joint: str = ""
    kind: str = "fixed"
    parent: int = -1
    placement: Pose = NO_MOTION
    axis: Array = field(default_factory=lambda: np.array([1.0, 0.0, 0.0]))
    link_origin: Array = field(default_factory=lambda: np.zeros(3))
    mass: Any = 0.0
    com: Array = field(default_factory=lambda: np.zeros(3))
    inertia: Array = field(default_factory=lambda: np.zeros((3, 3)))
    lower: float = -np.inf
    upper: float = np.inf
    velocity: float = np.inf
    effort: float = np.inf
    acceleration: float = np.inf
    deceleration: float = np.inf
    jerk: float = np.inf
    damping: float = 0.0
    friction: float = 0.0
    armature: float = 0.0
    mimic: Mimic | None = None


def assemble(
    name: str,
    parts: Sequence[Part],
    *,
    gravity: Any = STANDARD_GRAVITY,
    shapes: Sequence[Cylinder | Box] = (),
    notes: Mapping[str, str] | None = None,
    source: str | None = None,
) -> Model:
    """Model of a tree of parts, the root first and every parent before its children."""
    moving = [k for k, part in enumerate(parts) if part.kind != "fixed"]
    body_of, parents = list[int](), list[int]()
    frames, placements = list[Pose](), list[Pose]()  # of each link in its body's frame, of each body in its parent's
    for part in parts:
        body, frame = (body_of[part.parent], frames[part.parent]) if part.parent >= 0 else (-1, NO_MOTION)
        frame = frame.then(part.placement)
        if part.kind != "fixed":
            parents.append(body)
            placements.append(frame)
            body, frame = len(placements) - 1, NO_MOTION
        body_of.append(body)
        frames.append(frame)
    members: list[list[tuple[Part, Pose]]] = [[] for _ in range(len(moving) + 1)]  # the base last
    for part, body, frame in zip(parts, body_of, frames, strict=True):
        members[body].append((part, frame))
    bodies = [_merge(body) for body in members]
    independent = [k for k in moving if parts[k].mimic is None]
    joint_at = {k: i for i, k in enumerate(moving)}
    coordinate_at = {k: i for i, k in enumerate(independent)}
    joints = [parts[k] for k in moving]
    numbers: dict[str, Any] = {name: [getattr(x, own) for x in joints] for own, name in LIMITS_AND_DRIVES.items()}
    mimics = [parts[k].mimic or Mimic(k, 1.0, 0.0) for k in moving]
    origins = [x.p + rotate(x.R, part.link_origin) for part, x in zip(parts, frames, strict=True)]
    return Model(
        name=name,
        moving_joints=tuple(joint.joint for joint in joints),
        joint_types=tuple(joint.kind for joint in joints),
        parent=tuple(parents),
        axis=_stacked([joint.axis for joint in joints], (3,)),
        rotation=_stacked([snap(place.R) for place in placements], (3, 3)),
        translation=_stacked([place.p for place in placements], (3,)),
        mass=_stacked([body[0] for body in bodies[:-1]], ()),
        com=_stacked([body[1] for body in bodies[:-1]], (3,)),
        inertia=_stacked([body[2] for body in bodies[:-1]], (3, 3)),
        base_mass=float(bodies[-1][0]),
        base_com=bodies[-1][1],
        base_inertia=bodies[-1][2],
        link_names=tuple(part.link for part in parts),
        link_joints=tuple(part.joint for part in parts),
        link_parent=tuple(part.parent for part in parts),
        link_body=tuple(body_of),
        link_rotation=_stacked([snap(frame.R) for frame in frames], (3, 3)),
        link_translation=_stacked(origins, (3,)),
        **numbers,
        coordinate=tuple(coordinate_at[mimic.independent] for mimic in mimics),
        independent_joints=tuple(joint_at[k] for k in independent),
        multiplier=np.array([mimic.multiplier for mimic in mimics]),
        offset=np.array([mimic.offset for mimic in mimics]),
        gravity=gravity,
        shapes=tuple(shapes),
        notes=notes or {},
        source=source,
    )


def at_links(parts: Sequence[Part]) -> list[Part]:
    """Parts with every quantity seen from the links' own frames."""
    near = [np.asarray(part.link_origin, dtype=Extended) for part in parts]
    if not np.any(near):
        return list(parts)
    moved = []
    for part, own in zip(parts, near, strict=True):
        R, p = part.placement
        place = Pose(R, p + rotate(R, own) - (near[part.parent] if part.parent >= 0 else 0))
        com = (part.com - own).astype(np.float64)
        moved.append(replace(part, placement=place, com=com, link_origin=np.zeros(3)))
    return moved


def disassemble(model: Model) -> list[Part]:
    """Parts of a Model: each body's inertia on the link that its joint carries, all other links massless.

    Joints that follow by couplings are independent here; `assemble` makes a tree without couplings of them.
    """
    part_of_joint = {joint: k for k, joint in enumerate(model.link_joints)}
    carrier = {i: part_of_joint[joint] for i, joint in enumerate(model.moving_joints)} | {-1: 0}
    parts = []
    for k, link in enumerate(model.link_names):
        body = model.link_body[k]
        if carrier[body] != k:
            frame = pose(model.link_rotation[k], model.link_translation[k])
            parts.append(Part(link=link, joint=model.link_joints[k], parent=carrier[body], placement=frame))
        elif body < 0:
            parts.append(Part(link=link, mass=model.base_mass, com=model.base_com, inertia=model.base_inertia))
        else:
            parts.append(_moving_part(model, body, link, carrier))
    return parts


def _moving_part(model: Model, i: int, link: str, carrier: Mapping[int, int]) -> Part:
    independent = model.independent_joints[model.coordinate[i]]
    mimic = Mimic(carrier[independent], float(model.multiplier[i]), float(model.offset[i]))
    return Part(
        link=link,
        joint=model.moving_joints[i],
        kind=model.joint_types[i],
        parent=carrier[model.parent[i]],
        placement=pose(model.rotation[i], model.translation[i]),
        link_origin=model.link_translation[model.link_names.index(link)],
        axis=model.axis[i],
        mass=float(model.mass[i]),
        com=model.com[i],
        inertia=model.inertia[i],
        **{own: float(getattr(model, name)[i]) for own, name in LIMITS_AND_DRIVES.items()},
        mimic=None if independent == i or model.moving_joints[i] in {c.joint for c in model.couplings} else mimic,
    )


def _stacked(rows: list[Any], shape: tuple[int, ...]) -> Array:
    return np.array(rows, dtype=Extended).reshape(len(rows), *shape).astype(np.float64)


def _merge(parts: list[tuple[Part, Pose]]) -> tuple[Any, Array, Array]:
    """Mass, centre of mass and inertia of a body in its own frame, from the parts it is made of."""
    members = []
    for part, frame in parts:
        if part.mass != 0 or np.any(part.inertia):
            I = frame.R @ np.asarray(part.inertia, dtype=Extended) @ transpose(frame.R)
            com = frame.p + rotate(frame.R, np.asarray(part.com, dtype=Extended))
            members.append((Extended(part.mass), com, symmetric(I)))
    if not members:
        return 0.0, np.zeros(3), np.zeros((3, 3))
    mass, com, inertia = members[0] if len(members) == 1 else combine_bodies(members)
    return mass, com.astype(np.float64), inertia.astype(np.float64)
