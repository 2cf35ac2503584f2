"""Conditions that a Model must satisfy; each failure names the joint, body or link at fault."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from types import SimpleNamespace
from typing import Any

import numpy as np

from ..basics.spatial import Array, symmetric
from ..errors import ModelError

JOINT_TYPES = ("revolute", "continuous", "prismatic")
DRIVES = ("effort", "velocity", "acceleration", "deceleration", "jerk")  # names of limits of drives
LIMITS = tuple(f"{name}_limit" for name in DRIVES)
# The smallest values of a joint's numbers, in files, arguments and scenes; ranges have none.
LEAST = dict.fromkeys((*DRIVES, *LIMITS, "torque_rate", "damping", "friction", "armature"), 0.0)
LEAST |= {"lower": -np.inf, "upper": -np.inf}
UNIT_TOLERANCE = 1e-12  # largest deviation of an axis or rotation from unit length or orthogonality
RANGE_IN_DEGREES = (12.6, 720.0)  # ends of a range in degrees: wheels turn 1e3 rad or more, ranges two turns
SYMMETRY = 1e-12  # asymmetry of an inertia due to rounding, relative to the largest entry
INERTIA_TOLERANCE = 1e-12  # negative inertia due to rounding of a file's decimals, relative to trace + m |c|^2


def check_model(values: Mapping[str, Any]) -> None:
    """Raise ModelError for the first contradiction among the fields of a Model, given by name."""
    model = SimpleNamespace(**values)
    _check_shapes(model)
    _check_names(model)
    _check_tree(model)
    _check_mimics(model)
    _check_finite(model)
    for i, joint in enumerate(model.moving_joints):
        length = float(np.linalg.norm(model.axis[i]))
        if abs(length - 1) > UNIT_TOLERANCE:
            raise ModelError(f"joint {joint!r}: `axis` must be a unit vector, got length {length:.17g}")
        _check_rotation(f"joint {joint!r}: `rotation`", model.rotation[i])
        error = inertia_error(float(model.mass[i]), model.com[i], model.inertia[i])
        if error:
            raise ModelError(f"body of joint {joint!r}: {error}")
    for link, R in zip(model.link_names, model.link_rotation, strict=True):
        _check_rotation(f"link {link!r}: `link_rotation`", R)
    error = inertia_error(float(model.base_mass), model.base_com, model.base_inertia, is_moved=False)
    if error:
        raise ModelError(f"base: {error}")


def domain_error(name: str, value: float) -> str | None:
    """Reason why a number cannot be a joint's limit, range, damping or friction; infinity means no limit."""
    if np.isnan(value):
        return "must be a number"
    return "must not be negative" if value < LEAST[name] else None


def inertia_error(mass: float, com: Array, inertia: Array, *, is_moved: bool = True) -> str | None:
    """Reason why a rigid body is impossible, or None if it is possible.

    The mass in kg, the centre of mass (3,) in the body's frame in m, the inertia (3, 3) about it in kg m^2; the
    eigenvalues of one that is not moved are not examined, as they have no effect.
    """
    if mass < 0:
        return f"the mass must be 0 or positive, got {mass!r}"
    if not np.array_equal(inertia, inertia.T):
        return "the inertia must be symmetric"
    smallest = float(np.linalg.eigvalsh(inertia)[0])
    scale = float(np.trace(inertia) + mass * (com @ com))
    if is_moved and smallest < -INERTIA_TOLERANCE * scale:
        return f"the inertia must have no negative eigenvalue, got {smallest:.6g} kg m^2"
    return None


def looks_like_degrees(*bounds: float) -> bool:
    """True if the range of a revolute joint ends where a range in radians hardly does."""
    smallest, largest = RANGE_IN_DEGREES
    return any(smallest < abs(bound) <= largest for bound in bounds)


def symmetric_up_to_rounding(inertia: Array) -> Array:
    """Symmetric part of an inertia that differs from it by rounding only, such as R I R^T; others unchanged."""
    half = symmetric(inertia)
    return half if 2 * np.abs(inertia - half).max() <= SYMMETRY * np.abs(inertia).max() else inertia


def is_rotation(R: Array) -> bool:
    """True for an orthogonal matrix with determinant +1."""
    return bool(np.abs(R @ R.T - np.eye(3)).max() <= UNIT_TOLERANCE and np.linalg.det(R) > 0)


def triangle_excess(inertia: Array) -> float:
    """Excess of the largest principal moment over the sum of the others, relative to the trace."""
    small, middle, large = np.linalg.eigvalsh(inertia)
    trace = small + middle + large
    return float((large - small - middle) / trace) if trace > 0 else 0.0


def _check_shapes(model: SimpleNamespace) -> None:
    nb, links = len(model.moving_joints), len(model.link_names)
    bodies = ("mass", "lower", "upper", *LIMITS, "damping", "friction", "armature", "multiplier", "offset")
    shapes: dict[str, tuple[int, ...]] = dict.fromkeys(("axis", "translation", "com"), (nb, 3))
    shapes |= dict.fromkeys(("rotation", "inertia"), (nb, 3, 3)) | dict.fromkeys(bodies, (nb,))
    shapes |= dict.fromkeys(("base_com", "gravity"), (3,)) | {"base_inertia": (3, 3)}
    shapes |= {"link_rotation": (links, 3, 3), "link_translation": (links, 3)}
    for name, shape in shapes.items():
        got = getattr(model, name).shape
        if got != shape:
            raise ModelError(f"`{name}` must have shape {shape}, got {got}")
    lengths = dict.fromkeys(("joint_types", "parent", "coordinate"), nb)
    lengths |= dict.fromkeys(("link_joints", "link_body", "link_parent"), links)
    for name, length in lengths.items():
        value = getattr(model, name)
        if value is not None and len(value) != length:
            raise ModelError(f"`{name}` must have {length} entries, got {len(value)}")


def _check_names(model: SimpleNamespace) -> None:
    for kind, names in (("joint", [j for j in model.link_joints if j]), ("link", model.link_names)):
        for name, count in Counter(names).items():
            if count > 1:
                raise ModelError(f"{kind} {name!r} is duplicated")
    if not model.link_names:
        raise ModelError("a robot needs at least its root link")


def _check_tree(model: SimpleNamespace) -> None:
    nb = len(model.moving_joints)
    for i, joint in enumerate(model.moving_joints):
        if model.joint_types[i] not in JOINT_TYPES:
            raise ModelError(f"joint {joint!r}: type must be one of {list(JOINT_TYPES)}, got {model.joint_types[i]!r}")
        if not -1 <= model.parent[i] < i:
            raise ModelError(f"joint {joint!r}: parent must be one of the {i} bodies before it, got {model.parent[i]}")
    for link, body in zip(model.link_names, model.link_body, strict=True):
        if not -1 <= body < nb:
            raise ModelError(f"link {link!r}: body must be from -1 to {nb - 1}, got {body}")
    carried = {joint: body for joint, body in zip(model.link_joints, model.link_body, strict=True)}
    for i, joint in enumerate(model.moving_joints):
        if carried.get(joint) != i:
            raise ModelError(f"joint {joint!r}: no link of body {i} is carried by it")


def _check_mimics(model: SimpleNamespace) -> None:
    nb, n = len(model.moving_joints), len(model.independent_joints)
    for k, i in enumerate(model.independent_joints):
        if not 0 <= i < nb or model.coordinate[i] != k:
            raise ModelError(f"`independent_joints[{k}]` must be a joint of coordinate {k}, got {i}")
        if model.multiplier[i] != 1 or model.offset[i] != 0:
            raise ModelError(f"joint {model.moving_joints[i]!r}: an independent joint has multiplier 1 and offset 0")
    coordinates = {model.moving_joints[i] for i in model.independent_joints}
    for c in model.couplings:
        if c.joint not in {*model.moving_joints} - coordinates or not {*c.drivers} <= coordinates:
            got = f"got {[*c.drivers]} to {c.joint!r}"
            raise ModelError(f"`couplings` must lead from independent joints to others, {got}")
    for loop in model.loops:
        if not {*loop.followers} <= {*model.moving_joints} - coordinates:
            raise ModelError(f"`loops` must name joints that follow others, got {[*loop.followers]}")
        if not {link for link, _ in loop.ends} <= {*model.link_names}:
            raise ModelError(f"`loops` must end at links of the robot, got {loop.name}")
        if np.array([point for _, point in loop.ends], dtype=np.float64).shape != (2, 3):
            raise ModelError(f"`loops` must end at a point of each of two links, got {loop.ends!r}")
    for i, joint in enumerate(model.moving_joints):
        if not 0 <= model.coordinate[i] < n:
            raise ModelError(f"joint {joint!r}: coordinate must be from 0 to {n - 1}, got {model.coordinate[i]}")


def _check_finite(model: SimpleNamespace) -> None:
    may_be_infinite = {"lower", "upper", *LIMITS}
    for name, value in vars(model).items():
        if isinstance(value, np.ndarray) and value.dtype == np.float64:
            least = LEAST[name] if name in {*LIMITS, "armature"} else -np.inf  # files warn of negative friction
            bad = (np.isnan(value) if name in may_be_infinite else ~np.isfinite(value)) | (value < least)
            if bad.any():
                index = tuple(int(k) for k in np.argwhere(bad)[0])
                need = "must not be negative" if value[index] < least else "must be finite"
                raise ModelError(f"`{name}` {need}, got {value[index]} at index {index}")
    if not np.isfinite(model.base_mass):
        raise ModelError(f"`base_mass` must be finite, got {model.base_mass}")


def _check_rotation(what: str, R: Array) -> None:
    if not is_rotation(R):
        raise ModelError(f"{what} must be a rotation: orthogonal with determinant +1")
