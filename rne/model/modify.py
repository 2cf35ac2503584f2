"""Robots derived from others: with a payload, with joints locked, mounted. The original is not changed."""

from __future__ import annotations

import logging
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from ..basics.arrays import convert_numbers, real_array, real_numbers, refuse_degrees
from ..basics.spatial import Array, combine_bodies, rotate, rotate_back, rotation_about, rotation_from_rpy, symmetric
from ..basics.text import listed
from .builder import Part, Pose, assemble, disassemble, pose
from .checks import DRIVES, domain_error, inertia_error, symmetric_up_to_rounding, triangle_excess
from .model import Model, of_either
from .topology import check_closure, end_links

LimitValues = ArrayLike | Mapping[str, float] | None
TRIANGLE = 1e-12  # rounding of principal moments relative to the trace
FAR = 5  # farthest plausible centre of mass, relative to the robot's size
LOGGER = logging.getLogger("rne")


@of_either
def with_payload(
    model: Model,
    mass: float,
    com: ArrayLike = (0.0, 0.0, 0.0),
    inertia: ArrayLike | None = None,
    link: str | None = None,
) -> Model:
    """Robot with a further rigid body fixed to one of its links.

    Returns a Robot for a Robot. Parameters and errors are those of `rne.Robot.with_payload`, with the model first.
    """
    if np.ndim(mass):
        cure = "for many masses in one call, parameters=np.stack([robot.with_payload(m).parameters for m in masses])"
        raise ValueError(f"`mass` must be one number, got shape {np.shape(mass)}; {cure}")
    m = real_array("mass", mass, "()")
    c = real_array("com", com, "(3,)")
    I = real_array("inertia", np.zeros((3, 3)) if inertia is None else inertia, "(3, 3)")
    if link is None:
        link, *others = end_links(model, axes_count=bool(c.any() or I.any()))
        if others:
            LOGGER.info("payload on link %r, which is at the same place as %s", link, listed(others))
    index = model.link_index(link)
    I = symmetric_up_to_rounding(I)
    error = inertia_error(float(m), c, I)
    if error is None and triangle_excess(I) > TRIANGLE:
        error = "the largest principal moment of inertia must not exceed the sum of the two others"
    if error:
        raise ValueError(f"payload on link {link!r}: {error}")
    R, p, body = model.link_rotation[index], model.link_translation[index], model.link_body[index]
    strokes = np.where(model.is_revolute, 0.0, model.upper - model.lower)
    size = np.linalg.norm(np.vstack([model.translation, model.com, p]), axis=1).sum() + strokes.sum()
    if m and (distance := np.linalg.norm(c)) > FAR * size > 0:
        text = "the centre of mass is %.4g m from the link's origin, the robot measures %.4g m; check `com`: metres"
        LOGGER.warning("payload on link %r: " + text, link, distance, size)
    payload = (float(m), p + rotate(R, c), R @ I @ R.T)
    if body < 0:
        base = combine_bodies([(model.base_mass, model.base_com, model.base_inertia), payload])
        return replace(model, base_mass=base[0], base_com=base[1], base_inertia=symmetric(base[2]))
    carried = combine_bodies([(float(model.mass[body]), model.com[body], model.inertia[body]), payload])
    masses, coms, inertias = model.mass.copy(), model.com.copy(), model.inertia.copy()
    masses[body], coms[body], inertias[body] = carried[0], carried[1], symmetric(carried[2])
    return replace(model, mass=masses, com=coms, inertia=inertias)


@of_either
def locked(model: Model, positions: Mapping[str, float]) -> Model:
    """Robot with some joints fixed at a position: a smaller robot with fewer coordinates.

    Returns a Robot for a Robot. Parameters and errors are those of `rne.Robot.locked`, with the model first.
    """
    if not isinstance(positions, Mapping):
        example = f"such as {{{model.joint_names[-1] if model.n else 'joint'!r}: 0.0}}"
        raise TypeError(f"`positions` must map joint names to positions, {example}, got {type(positions).__name__}")
    values = {}
    for joint, value in positions.items():
        if joint not in model.joint_names:
            raise ValueError(f"`positions` must name joints of {list(model.joint_names)}, got {joint!r}")
        array = real_numbers(f"positions[{joint!r}]", value, "()")
        if array.ndim:
            raise ValueError(f"`positions[{joint!r}]` must be one number, got shape {array.shape}")
        values[joint] = float(array)
    check_closure(model, np.array([values.get(name, 0.0) for name in model.joint_names]))
    ends = [c for c in model.couplings if {*c.drivers} <= {*values}]  # whose drivers are all locked
    fixed = values | {c.joint: c.position(np.array([values[name] for name in c.drivers])) for c in ends}
    parts = disassemble(model)
    for k, part in enumerate(parts):
        if part.mimic and (independent := parts[part.mimic.independent].joint) in values:
            fixed[part.joint] = part.mimic.multiplier * values[independent] + part.mimic.offset
        if part.joint in fixed:
            parts[k] = replace(part, kind="fixed", mimic=None, placement=_moved(part, float(fixed[part.joint])))
    smaller = assemble(model.name, parts, gravity=model.gravity, shapes=model.shapes, notes=model.notes)
    smaller = replace(smaller, link_parent=model.link_parent, source=model.source)
    if left := {c.joint: c.at(values) for c in model.couplings if c not in ends}:
        from .coupling import coupled  # loaded only if there are couplings

        smaller = coupled(smaller, left)
    return replace(smaller, loops=tuple(x for x in model.loops if {*x.followers} <= {*smaller.moving_joints}))


def _moved(part: Part, position: float) -> Pose:
    """Placement of the part with its joint locked at a position."""
    axis = np.asarray(part.axis, dtype=np.longdouble)
    if part.kind == "prismatic":
        return part.placement.then(pose(np.eye(3), axis * position))
    return part.placement.then(Pose(rotation_about(axis, np.asarray(position, dtype=np.longdouble)), np.zeros(3)))


@of_either
def mounted(model: Model, rpy: ArrayLike) -> Model:
    """Robot with its root link rotated in the world: on a wall, under a ceiling, on a slope.

    Returns a Robot for a Robot. Parameters and errors are those of `rne.Robot.mounted`, with the model first.
    """
    angles = real_array("rpy", rpy, "(3,)")
    refuse_degrees("rpy", angles)
    return replace(model, gravity=rotate_back(rotation_from_rpy(angles), model.gravity) + 0.0)


@of_either
def with_limits(
    model: Model,
    *,
    effort: LimitValues = None,
    velocity: LimitValues = None,
    acceleration: LimitValues = None,
    deceleration: LimitValues = None,
    jerk: LimitValues = None,
) -> Model:
    """Robot with other limits of its joints and drives, such as those of a data sheet.

    Returns a Robot for a Robot. Parameters and errors are those of `rne.Robot.with_limits`, with the model first.
    """
    coordinates = list(model.independent_joints)
    changed = {}
    for name, value in zip(DRIVES, (effort, velocity, acceleration, deceleration, jerk), strict=True):
        if value is not None:
            changed[f"{name}_limit"] = array = getattr(model, f"{name}_limit").copy()
            named = isinstance(value, Mapping) and name != "effort"  # joints that follow have no drives
            own = [*range(model.nb)] if named else coordinates
            array[own] = limit_array(name, value, [model.moving_joints[i] for i in own], array[own])
    return replace(model, **changed) if changed else model


@of_either
def with_armature(model: Model, armature: LimitValues) -> Model:
    """Robot with other inertias of its rotors, reflected through the gears to the joints.

    Returns a Robot for a Robot. Parameters and errors are those of `rne.Robot.with_armature`, with the model first.
    """
    rotors = limit_array("armature", armature, model.moving_joints, model.armature)
    return model if armature is None else replace(model, armature=rotors)


def limit_array(name: str, value: LimitValues, joints: Sequence[str], present: Array, argument: str = "") -> Array:
    """One number per joint, possibly infinite, from one for all joints, one for each, or some by name."""
    n, argument = len(joints), argument or name
    if value is None:
        return present
    if isinstance(value, Mapping):
        unknown = [joint for joint in value if joint not in joints]
        if unknown:
            raise ValueError(f"`{argument}` must name joints of {list(joints)}, got {unknown[0]!r}")
        value = [value.get(joint, limit) for joint, limit in zip(joints, present.tolist(), strict=True)]
    array = convert_numbers(argument, value, f"({n},)")
    if array.shape not in ((), (n,)):
        raise ValueError(f"`{argument}` must have shape ({n},), got {array.shape}")
    if array.dtype.kind != "f":
        raise ValueError(f"`{argument}` must be real, got dtype {array.dtype}")
    array = np.full(n, array, dtype=np.float64)
    for i, (joint, limit) in enumerate(zip(joints, array.tolist(), strict=True)):
        if error := domain_error(name, limit):
            raise ValueError(f"`{argument}[{i}]` of joint {joint!r} {error}, got {limit!r}")
    return array
