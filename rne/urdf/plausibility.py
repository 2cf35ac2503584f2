"""Warnings of likely mistakes in files that load: degrees for radians, drives without torque, impossible bodies.

Such files load as written; `rne.check` warns. The bounds are wide: what exceeds them is a mistake or a placeholder.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from ..basics.arrays import FULL_TURN
from ..basics.spatial import Array, rotation_from_rpy
from ..dynamics import gravity_torque, mass_matrix
from ..model.builder import Part
from ..model.checks import DRIVES, looks_like_degrees
from ..model.model import Model
from ..model.modify import FAR
from .document import Element, attribute_numbers, describe
from .findings import FindingsReport, echo
from .read import parts_of
from .strict import MOVING, fixed_links

POINT = 1e-6  # size below which a body is a point mass, whose inertia is rounding error [m]
FLATTEST = 0.1  # shortest axis of the ellipsoid over its longest: rods and plates may be given without width
LARGE = 2  # largest radius of gyration of a body relative to the robot's size
DENSEST = 23e3  # largest density, a little above osmium [kg/m^3]
AIR = 1.2  # density of air [kg/m^3]
SOLIDS = {"box": ("size",), "sphere": ("radius",), "cylinder": ("radius", "length")}  # with attributes of size
THINNEST = 1.0  # smallest density, less than air [kg/m^3]
SLENDEREST = 0.01  # smallest axes of an ellipsoid relative to its longest: rods and frames are thin
LONGEST = 20.0  # longest link [m]: longer ones are those of cranes, or in millimetres
OVERLOAD = 10  # implausible torque by weight relative to an effort limit
POSES = 64  # random positions at which weight and inertia are computed
NO_INERTIA = 1e-15  # inertia about a joint's axis that is rounding error, relative to the robot's largest
UNITS, RADIANS = "is the file in millimetres? give metres", "give radians: degrees times pi/180"
PLACEHOLDER = 1e-3  # mass of a link that may only carry a frame, with any shape and inertia [kg]


def check_elements(root: Element, report: FindingsReport) -> None:
    """Warn of angles that look like degrees, and of drives that can do nothing."""
    for element in root:
        if element.tag not in ("link", "joint"):
            continue
        for origin in element.iter("origin"):
            angles = attribute_numbers(origin, "rpy")
            if any(abs(angle) > FULL_TURN for angle in angles):
                message, detail = "attribute 'rpy' of <origin> looks like degrees", echo(origin.get("rpy"))
                report.warning(origin, describe(element), message, RADIANS, detail=detail)
        limit = element.find("limit")
        if element.tag == "joint" and limit is not None:
            _check_limit(element, limit, report)


def _check_limit(joint: Element, limit: Element, report: FindingsReport) -> None:
    kind, owner = joint.get("type"), describe(joint)
    bounds = attribute_numbers(limit, "lower") + attribute_numbers(limit, "upper")
    if kind == "revolute" and looks_like_degrees(*bounds):
        detail = f"{limit.get('lower', '0')} to {limit.get('upper', '0')}"
        report.warning(limit, owner, "the range of <limit> looks like degrees", RADIANS, detail=detail)
    if kind not in MOVING or joint.find("mimic") is not None:
        return
    zero = [repr(name) for name in DRIVES if attribute_numbers(limit, name) == [0.0]]
    many = len(zero) > 1
    if zero:
        what = f"attribute{'s' * many} {' and '.join(zero)} of <limit> {'are' if many else 'is'} 0"
        report.warning(limit, owner, what, "give what the drive can do; as written it can do nothing")


def check_bodies(root: Element, model: Model, report: FindingsReport) -> None:
    """Warn of masses, centres, inertias and lengths that no body of this robot has; the file has no errors."""
    parts = parts_of(root)
    with np.errstate(all="ignore"):  # numbers near the largest double overflow; comparisons with NaN are false
        _check_inertia(root, model, report)
        _check_lengths_and_weight(root, parts, model, report)
        found = bodies(root, parts)
        size, with_coms = robot_size(parts, found), robot_size(parts, found, with_coms=True)
        for body in found:
            for message, cure, detail in _faults(body, size, with_coms) if body.mass > 0 else ():
                report.warning(body.element, body.owner, message, cure, detail=detail)


def _check_inertia(root: Element, model: Model, report: FindingsReport) -> None:
    """Warn of joints that move no inertia, or only point masses on their axes: M exists, forward dynamics do not."""
    M = mass_matrix.core(model, _poses(model))
    largest = np.diagonal(M, axis1=1, axis2=2).max(axis=0, initial=0.0)
    rounding = NO_INERTIA * largest.max(initial=0.0)
    still = {name for name, m in zip(model.joint_names, largest, strict=True) if m <= rounding}
    for joint in root.findall("joint"):
        if joint.get("name") in still:
            message = "moves no inertia: forward dynamics raises SingularMassMatrixError, or its digits are rounding"
            cure = "give its links inertia about its axis, its rotor in Python (`with_armature`), or make it fixed"
            report.warning(joint, describe(joint), message, cure)


def _poses(model: Model) -> Array:
    """Random positions within the ranges of the joints, (POSES, n)."""
    limits = model.coordinate_limits()
    turn = np.pi * model.is_revolute[list(model.independent_joints)]
    low, high = (np.where(np.isfinite(limits[x]), limits[x], y) for x, y in (("lower", -turn), ("upper", turn)))
    return np.asarray(low + (high - low) * np.random.default_rng(0).random((POSES, model.n)))


def _check_lengths_and_weight(root: Element, parts: list[Part], model: Model, report: FindingsReport) -> None:
    """Warn of links that are too long from their joint to the next, and of drives far too weak for the weight."""
    joints = {joint.get("name"): joint for joint in root.findall("joint")}
    fixed = fixed_links(root.findall("link"), root.findall("joint"))
    for part in parts[1:]:
        length = float(np.linalg.norm(part.placement.p))
        if length > LONGEST and parts[part.parent].link not in fixed:  # the first joint may be anywhere in the world
            message = f"the <origin> makes a link longer than {LONGEST:g} m"
            report.warning(joints[part.joint], describe(joints[part.joint]), message, UNITS, detail=f"{length:.3g} m")
    loads = np.abs(gravity_torque.core(model, _poses(model))).max(axis=0)
    efforts = model.coordinate_limits()["effort_limit"]
    for name, load, effort in zip(model.joint_names, loads, efforts, strict=True):
        if load > OVERLOAD * effort > 0:
            message, cure = "the drive cannot carry the robot's weight", "check masses, lengths and 'effort' of <limit>"
            detail = f"{load:.4g} N m or N of {effort:.4g}"
            report.warning(joints[name], describe(joints[name]), message, cure, detail=detail)


def _faults(body: LinkBody, size: float, with_coms: float) -> Iterator[tuple[str, str, str]]:
    """Faults of a body in a robot of this size, without and with centres of mass: texts, remedies and numbers."""
    measure = max(size, body.radius_of_gyration)
    radius, largest = body.radius_of_gyration, max(size, with_coms)
    if math.isfinite(body.com) and body.com > FAR * measure > 0:
        detail = f"{body.com:.3g} m from the link's origin, the robot measures {measure:.3g} m"
        yield "the centre of mass is far outside the robot", "check <origin> of <inertial>: metres", detail
    if body.mass <= PLACEHOLDER:
        return
    if radius > LARGE * largest > 0:
        what, cure = "larger than the robot", "check ixx ... izz: kg m^2 about the centre of mass"
        detail = f"radius of gyration {radius:.3g} m, the robot measures {largest:.3g} m"
        yield f"mass and inertia are those of a body {what}", cure, detail
    elif body.least_density < THINNEST:
        cure = f"check ixx ... izz: kg m^2{f'; {UNITS}' if radius > 1 else ''}"
        yield "mass and inertia are those of a body lighter than air", cure, f"{body.least_density:.2g} kg/m^3"
    if body.density > DENSEST:
        cure = "check the units of <mass> and <inertia>: kg and kg m^2"
        yield "mass and inertia are those of a body denser than any metal", cure, f"{body.density:.2g} kg/m^3"
    if body.shapes is None:
        return
    heaviest, lightest = body.mass / body.shapes.largest_volume, body.mass / body.shapes.surrounding_volume
    cure = "check the units of <mass> and of the shapes: kg and m"
    if lightest > DENSEST >= body.density and radius <= body.shapes.radius:
        yield "the mass makes its shapes denser than any metal", cure, f"{lightest:.2g} kg/m^3"
    elif heaviest < AIR:
        yield "the mass makes its shapes lighter than air", cure, f"{heaviest:.2g} kg/m^3"


class Shapes(NamedTuple):
    """Boxes, cylinders and spheres of a link."""

    largest_volume: float  # of one of them; of visuals or collisions, where it is smaller [m^3]
    surrounding_volume: float  # of the box around all; of visuals or collisions, where it is larger [m^3]
    radius: float  # half the diagonal of that box [m]


class LinkBody(NamedTuple):
    """Inertial numbers of a link."""

    element: Element
    owner: str
    part: int  # its place in tree order
    mass: float
    com: float  # its distance from the link's origin [m]
    radius_of_gyration: float  # the largest [m]
    density: float  # of the solid ellipsoid with the same mass and inertia; 0 for a point mass [kg/m^3]
    least_density: float  # of one as slender as rods and frames; infinite for a point mass [kg/m^3]
    reach: float  # of its shapes from the link's origin [m]
    shapes: Shapes | None  # None if there are none, or others too


def bodies(root: Element, parts: list[Part]) -> list[LinkBody]:
    """Bodies of all links with <inertial>."""
    links = {link.get("name"): link for link in root.findall("link")}
    found = []
    for k, part in enumerate(parts):
        link, mass = links[part.link], float(part.mass)
        if link.find("inertial") is not None:
            moments = np.linalg.eigvalsh(np.asarray(part.inertia, dtype=float))
            gyration = math.sqrt(max(float(moments[-1]), 0.0) / mass) if mass > 0 else 0.0
            densities = _density(mass, moments, FLATTEST), _density(mass, moments, SLENDEREST) or math.inf
            numbers = (mass, float(np.linalg.norm(part.com)), gyration, *densities)
            found.append(LinkBody(link.find("inertial"), describe(link), k, *numbers, *_shapes(link)))
    return found


def robot_size(parts: list[Part], found: list[LinkBody], *, with_coms: bool = False) -> float:
    """Reach of the robot from its root: joint origins, strokes of sliding joints and primitive shapes [m]."""
    depths = [0.0]
    for part in parts[1:]:
        strokes = [abs(x) for x in (part.lower, part.upper) if part.kind == "prismatic" and math.isfinite(x)]
        depths.append(depths[part.parent] + float(np.linalg.norm(part.placement.p)) + max(strokes, default=0.0))
    sizes = [depths[body.part] + max(body.reach, body.com if with_coms else 0.0) for body in found]
    return max(depths + sizes)


def _density(mass: float, moments: Array, flattest: float) -> float:
    """Density of the solid ellipsoid with these principal moments, thickened to a part of its longest axis.

    Among bodies with the same mass and largest density, the ellipsoid has the smallest product of second moments. So
    any body with this mass and these moments is at least as dense somewhere.
    """
    squares = 5 * (moments.sum() / 2 - moments) / mass if mass > 0 else np.zeros(3)  # of the semi-axes
    longest = float(squares.max())
    if not longest > POINT**2:
        return 0.0
    axes = np.sqrt(np.maximum(squares, flattest**2 * longest))
    return float(mass / (4 / 3 * np.pi * axes.prod()))


def _shapes(link: Element) -> tuple[float, Shapes | None]:
    """Reach of the primitive shapes, and their volumes if all are known."""
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


def _extent(shape: Element) -> tuple[Array, Array, float] | None:
    """Centre and half sides of the box around a visual or collision, in the link's axes, and its volume."""
    solid, origin = shape.find("geometry/*"), shape.find("origin")
    attributes = SOLIDS.get(solid.tag, ()) if solid is not None else ()
    sizes = [np.array(attribute_numbers(solid, attribute)) for attribute in attributes]
    centre, rpy = (np.array(attribute_numbers(origin, name, "0 0 0")) for name in ("xyz", "rpy"))
    if not sizes or any(len(x) != (3 if solid.tag == "box" else 1) for x in sizes) or not len(centre) == len(rpy) == 3:
        return None
    if solid.tag == "box":
        half, volume = sizes[0] / 2, sizes[0].prod()
    elif solid.tag == "sphere":
        ((radius,),) = sizes
        half, volume = np.full(3, radius), 4 / 3 * np.pi * radius**3
    else:
        (radius,), (length,) = sizes
        half, volume = np.array([radius, radius, length / 2]), np.pi * radius**2 * length
    return centre, np.abs(rotation_from_rpy(rpy)) @ np.abs(half), float(volume)
