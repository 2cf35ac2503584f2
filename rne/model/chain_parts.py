"""What chains given by arrays have in common: the arrays are checked here, link by link, and become a Model."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ..basics.arrays import convert_numbers, real_array
from ..basics.spatial import Array
from .builder import Extended, Part, Pose, assemble, pose
from .model import Model
from .validation import JOINT_TYPES, inertia_error, symmetric_up_to_rounding

FLANGE = "flange"  # the fixed joint in front of the last frame


class Given(NamedTuple):
    """Arguments of `chain` and `dh_chain` that describe links and joints, as the user gave them."""

    masses: ArrayLike | None
    centres: ArrayLike | None
    inertias: ArrayLike | None
    types: str | Sequence[str]
    lower: ArrayLike | None
    upper: ArrayLike | None
    velocity: ArrayLike | None
    effort: ArrayLike | None
    gravity: ArrayLike
    name: str
    joint_names: Sequence[str] | None
    link_names: Sequence[str] | None
    base: str
    tip: str


class Names(NamedTuple):
    """Of the joints, and of all links: the base, those behind the joints, the last frame."""

    joints: tuple[str, ...]
    links: tuple[str, ...]


class Geometry(NamedTuple):
    """Placement of each joint's frame in the one before it, its axis, where centres count from, and the last frame."""

    placements: Sequence[Pose]
    axes: Sequence[Array]
    offsets: Sequence[Array]
    tip: Array


def rows(name: str, value: ArrayLike, shape: tuple[int, ...]) -> Array:
    """An array of finite real numbers of a certain shape, in long double."""
    text = str(shape).replace("-1", "n")
    array = real_array(name, value, text)
    if array.ndim != len(shape) or any(k not in (-1, got) for k, got in zip(shape, array.shape, strict=True)):
        raise ValueError(f"`{name}` must have shape {text}, got {array.shape}")
    return array.astype(Extended)


def checked_names(given: Given, n: int) -> Names:
    """All names, none of them empty or given twice."""
    joints = _names("joint_names", given.joint_names, [f"joint_{i}" for i in range(1, n + 1)])
    links = _names("link_names", given.link_names, [f"link_{i}" for i in range(1, n + 1)])
    whole = {"name": given.name, "base": given.base, "tip": given.tip}
    for argument, value in whole.items():
        if not isinstance(value, str) or not value:
            raise ValueError(f"`{argument}` must be a name, got {value!r}")
    names = Names(joints, (given.base, *links, given.tip))
    for argument, all_names in (("joint_names", (*names.joints, FLANGE)), ("link_names", names.links)):
        for k, name in enumerate(all_names):
            if name in all_names[:k]:
                kind = argument.removesuffix("_names")
                raise ValueError(f"`{argument}` must differ, got the {kind} {name!r} twice")
    return names


def checked_types(given: Given, joints: tuple[str, ...]) -> list[str]:
    """The type of every joint; one string is the type of all."""
    types = [given.types] * len(joints) if isinstance(given.types, str) else list(given.types)
    if len(types) != len(joints):
        raise ValueError(f"`types` must be one type or {len(joints)} of them, got {len(types)}")
    for i, kind in enumerate(types):
        if kind not in JOINT_TYPES:
            raise ValueError(f"`types[{i}]` of joint {joints[i]!r} must be one of {list(JOINT_TYPES)}, got {kind!r}")
    return types


def chain_model(given: Given, names: Names, types: list[str], geometry: Geometry) -> Model:
    """The Model of an unbranched chain; raises ValueError for what `load` would refuse in a file."""
    n = len(names.joints)
    bodies = _bodies(given, names)
    limits = _limits(given, names.joints, types)
    gravity = rows("gravity", given.gravity, (3,)).astype(np.float64)
    parts = [Part(link=names.links[0])]
    for i, joint in enumerate(names.joints):
        mass, centre, inertia = bodies[i]
        parts.append(
            Part(
                link=names.links[i + 1],
                joint=joint,
                kind=types[i],
                parent=i,
                placement=geometry.placements[i],
                axis=geometry.axes[i],
                mass=mass,
                com=centre + geometry.offsets[i],
                inertia=inertia,
                **{field: values[i] for field, values in limits.items()},
            )
        )
    parts.append(Part(link=names.links[-1], joint=FLANGE, parent=n, placement=pose(np.eye(3), geometry.tip)))
    return assemble(given.name, parts, gravity=gravity)


def _names(argument: str, given: Sequence[str] | None, default: list[str]) -> tuple[str, ...]:
    names = tuple(default if given is None else given)
    if isinstance(given, str) or len(names) != len(default):
        raise ValueError(f"`{argument}` must be {len(default)} names, got {given!r}")
    for k, name in enumerate(names):
        if not isinstance(name, str) or not name:
            raise ValueError(f"`{argument}[{k}]` must be a name, got {name!r}")
    return names


def _bodies(given: Given, names: Names) -> list[tuple[Any, Array, Array]]:
    """Mass, centre and inertia of each link; all zero if none is given."""
    n = len(names.joints)
    shapes = {"masses": (n,), "centres": (n, 3), "inertias": (n, 3, 3)}
    missing = [name for name in shapes if getattr(given, name) is None]
    if len(missing) == len(shapes):
        return [(0.0, np.zeros(3), np.zeros((3, 3)))] * n
    if missing:
        raise ValueError(f"`{missing[0]}` must be given too: masses, centres and inertias belong together")
    masses, centres, inertias = (rows(name, getattr(given, name), shape) for name, shape in shapes.items())
    bodies = []
    for i, (mass, centre, inertia) in enumerate(zip(masses, centres, inertias, strict=True)):
        link = names.links[i + 1]
        if mass < 0:
            raise ValueError(f"`masses[{i}]` of link {link!r} must be 0 or positive, got {float(mass)!r}")
        even = symmetric_up_to_rounding(inertia)
        error = inertia_error(float(mass), centre.astype(np.float64), even.astype(np.float64))
        if error:
            raise ValueError(f"`inertias[{i}]` of link {link!r}: {error}")
        bodies.append((mass, centre, even))
    return bodies


def _limits(given: Given, joints: tuple[str, ...], types: list[str]) -> dict[str, Any]:
    """Limits by the names of a Part's fields, infinite where not given."""
    limits: dict[str, Any] = {}
    for name, default in (("lower", -np.inf), ("upper", np.inf), ("velocity", np.inf), ("effort", np.inf)):
        value = getattr(given, name)
        limits[name] = values = np.full(len(joints), default)
        if value is None:
            continue
        values[:] = _limit(name, value, joints)
        for i, joint in enumerate(joints):
            if name in ("lower", "upper") and types[i] == "continuous" and values[i] != default:
                need = f"must be {default}, as a continuous joint has no range, got {float(values[i])!r}"
                raise ValueError(f"`{name}[{i}]` of joint {joint!r} {need}")
            if name in ("velocity", "effort") and values[i] < 0:
                raise ValueError(f"`{name}[{i}]` of joint {joint!r} must not be negative, got {float(values[i])!r}")
    return limits


def _limit(name: str, value: ArrayLike, joints: tuple[str, ...]) -> Array:
    """One number per joint, infinite ones allowed."""
    array = convert_numbers(name, value, f"({len(joints)},)")
    if array.shape != (len(joints),):
        raise ValueError(f"`{name}` must have shape ({len(joints)},), got {array.shape}")
    if array.dtype.kind != "f":
        raise ValueError(f"`{name}` must be real, got dtype {array.dtype}")
    bad = np.isnan(array)
    if bad.any():
        i = int(np.argmax(bad))
        raise ValueError(f"`{name}[{i}]` of joint {joints[i]!r} must be a number, got nan")
    return array
