"""Sizes and densities of the bodies of a URDF, as far as its numbers and primitive shapes say."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from ..basics.spatial import Array, rotation_from_rpy
from .grammar import NUMBER, describe
from .tree import ENTRIES, link_of

POINT = 1e-6  # m: smaller bodies are point masses, whose inertia is rounding error
FLATTEST = 0.1  # axes of the ellipsoid, relative to its longest: rods and plates are often idealised as having no width


class Shapes(NamedTuple):
    """The boxes, cylinders and spheres of a link."""

    largest_volume: float  # of one of them; of visuals or collisions, where it is smaller [m^3]
    surrounding_volume: float  # of the box around all; of visuals or collisions, where it is larger [m^3]
    radius: float  # half the diagonal of that box [m]


class Body(NamedTuple):
    """The inertial numbers of a link."""

    element: Any
    owner: str
    link: str
    mass: float
    com: float  # its distance from the link's origin [m]
    radius_of_gyration: float  # the largest [m]
    density: float  # of the solid ellipsoid with the same mass and inertia; 0 for a point mass [kg/m^3]
    reach: float  # of its shapes from the link's origin [m]
    shapes: Shapes | None  # None if there are none, or others too


def bodies(root: Any) -> list[Body]:
    """The bodies of all links with <inertial>."""
    found = []
    for link in root.findall("link"):
        inertial = link.find("inertial")
        if inertial is None:
            continue
        mass, inertia = float(inertial.find("mass").get("value")), inertial.find("inertia")
        xx, xy, xz, yy, yz, zz = (float(inertia.get(entry)) for entry in ENTRIES)
        moments = np.linalg.eigvalsh(np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]))
        gyration = math.sqrt(max(float(moments[-1]), 0.0) / mass) if mass > 0 else 0.0
        com = float(np.linalg.norm(_vector(inertial.find("origin"), "xyz", "0 0 0")))
        reach, shapes = _shapes(link)
        density = _density(mass, moments)
        found.append(Body(inertial, describe(link), link.get("name"), mass, com, gyration, density, reach, shapes))
    return found


def robot_size(root: Any, found: list[Body], *, with_coms: bool = False) -> float:
    """How far the robot reaches from its root: joint origins, strokes of sliding joints and primitive shapes [m]."""
    above = {link_of(joint, "child"): joint for joint in root.findall("joint")}
    depths: dict[str | None, float] = {}

    def depth(link: str | None) -> float:
        chain = []
        while link in above and link not in depths:
            chain.append(link)
            link = link_of(above[link], "parent")
        total = depths.get(link, 0.0)
        for name in reversed(chain):
            total += _length(above[name])
            depths[name] = total
        return total

    sizes = [depth(link.get("name")) for link in root.findall("link")]
    sizes += [depth(body.link) + max(body.reach, body.com if with_coms else 0.0) for body in found]
    return max(sizes, default=0.0)


def _length(joint: Any) -> float:
    """Distance between two joints' origins, or the longest that a sliding joint makes it."""
    length = float(np.linalg.norm(_vector(joint.find("origin"), "xyz", "0 0 0")))
    limit = joint.find("limit")
    if joint.get("type") != "prismatic" or limit is None:
        return length
    return length + max(abs(float(limit.get(bound, "0"))) for bound in ("lower", "upper"))


def _density(mass: float, moments: Array) -> float:
    """Density of the solid ellipsoid with these principal moments, thickened to `FLATTEST`.

    Among bodies of one mass and one largest density, the ellipsoid has the smallest product of second moments. So any
    body with this mass and these moments is at least as dense somewhere.
    """
    squares = 5 * (moments.sum() / 2 - moments) / mass if mass > 0 else np.zeros(3)  # of the semi-axes
    longest = float(squares.max())
    if not longest > POINT**2:
        return 0.0
    axes = np.sqrt(np.maximum(squares, FLATTEST**2 * longest))
    return float(mass / (4 / 3 * np.pi * axes.prod()))


def _shapes(link: Any) -> tuple[float, Shapes | None]:
    """How far the primitive shapes reach, and what is known of their volume."""
    groups = [[_extent(shape) for shape in link.findall(kind)] for kind in ("visual", "collision")]
    known = [[extent for extent in group if extent is not None] for group in groups]
    reach = max((float(np.linalg.norm(np.abs(c) + h)) for group in known for c, h, _ in group), default=0.0)
    if not any(groups) or any(len(a) != len(b) for a, b in zip(groups, known, strict=True)):
        return reach, None
    boxes = []
    for group in filter(None, known):
        low, high = (np.array([c + sign * h for c, h, _ in group]) for sign in (-1, 1))
        boxes.append(high.max(axis=0) - low.min(axis=0))
    largest = min(max(volume for _, _, volume in group) for group in known if group)
    box = max(boxes, key=lambda sides: float(sides.prod()))
    if not (largest > 0 and np.isfinite(box).all()):
        return reach, None
    return reach, Shapes(largest, float(box.prod()), float(np.linalg.norm(box)) / 2)


def _extent(shape: Any) -> tuple[Array, Array, float] | None:
    """Centre and half sides of the box around a visual or collision, in the link's axes, and its volume."""
    geometry, origin = shape.find("geometry"), shape.find("origin")
    solid = None if geometry is None or not len(geometry) else geometry[0]
    numbers = {"box": ["size"], "sphere": ["radius"], "cylinder": ["radius", "length"]}
    if solid is None or solid.tag not in numbers:
        return None
    sizes = [_vector(solid, attribute, "") for attribute in numbers[solid.tag]]
    if [len(size) for size in sizes] != ([3] if solid.tag == "box" else [1] * len(sizes)):
        return None
    centre, rpy = _vector(origin, "xyz", "0 0 0"), _vector(origin, "rpy", "0 0 0")
    if len(centre) != 3 or len(rpy) != 3:
        return None
    if solid.tag == "box":
        half, volume = sizes[0] / 2, float(sizes[0].prod())
    elif solid.tag == "sphere":
        (radius,) = sizes[0]
        half, volume = np.full(3, radius), 4 / 3 * np.pi * radius**3
    else:
        (radius,), (length,) = sizes
        half, volume = np.array([radius, radius, length / 2]), np.pi * radius**2 * length
    return centre, np.abs(rotation_from_rpy(rpy)) @ np.abs(half), float(volume)


def _vector(element: Any | None, attribute: str, default: str) -> Array:
    """The numbers of an attribute; none if it is something else."""
    tokens = (default if element is None else element.get(attribute, default)).split()
    return np.array([float(token) for token in tokens if NUMBER.fullmatch(token)])
