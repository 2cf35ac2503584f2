"""What a URDF may say and probably does not mean: degrees for radians, drives without torque, impossible bodies.

All of it loads as written; `rne.check` warns. The bounds are wide: what they report is a mistake, or a placeholder.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from .bodies import Body, bodies, robot_size
from .findings import Report, echo
from .grammar import NUMBER, describe
from .tree import MOVING

FULL_TURN = 6.3  # rad: no angle of an origin needs more
LIMITS_IN_DEGREES = (12.6, 720.0)  # joints that turn 1e3 rad or more are wheels; real ranges end at two turns
FAR = 5  # times the robot's size: a centre of mass farther out is outside any plausible place
LARGE = 2  # times the robot's size: no body of the robot has a larger radius of gyration
DENSEST = 23e3  # kg/m^3, a little above osmium
AIR = 1.2  # kg/m^3
PLACEHOLDER = 1e-3  # kg: lighter links are often there for their frame alone, with any shape and inertia


def check_elements(root: Any, report: Report) -> None:
    """Warn of angles that look like degrees, and of drives that can do nothing."""
    for element in root:
        if element.tag not in ("link", "joint"):
            continue
        for origin in element.iter("origin"):
            angles = plain_numbers(origin, "rpy")
            if any(abs(angle) > FULL_TURN for angle in angles):
                message = "attribute 'rpy' of <origin> looks like degrees"
                cure = "give radians: degrees times pi/180"
                report.warning(origin, describe(element), message, cure, detail=echo(origin.get("rpy")))
        limit = element.find("limit")
        if element.tag == "joint" and limit is not None:
            _check_limit(element, limit, report)


def plain_numbers(element: Any, attribute: str) -> list[float]:
    """The numbers of an attribute, none if it is missing or something else; its errors are reported elsewhere."""
    tokens = element.get(attribute, "").split()
    return [float(token) for token in tokens] if all(NUMBER.fullmatch(token) for token in tokens) else []


def _check_limit(joint: Any, limit: Any, report: Report) -> None:
    kind, owner = joint.get("type"), describe(joint)
    bounds = plain_numbers(limit, "lower") + plain_numbers(limit, "upper")
    smallest, largest = LIMITS_IN_DEGREES
    if kind == "revolute" and any(smallest < abs(bound) <= largest for bound in bounds):
        detail = f"{limit.get('lower', '0')} to {limit.get('upper', '0')}"
        cure = "give radians: degrees times pi/180"
        report.warning(limit, owner, "the range of <limit> looks like degrees", cure, detail=detail)
    if kind not in MOVING or joint.find("mimic") is not None:
        return
    zero = [repr(name) for name in ("effort", "velocity") if plain_numbers(limit, name) == [0.0]]
    if zero:
        what = f"attributes {' and '.join(zero)} of <limit> are 0"
        what = what if zero[1:] else f"attribute {zero[0]} of <limit> is 0"
        report.warning(limit, owner, what, "give what the drive can do; as written it can do nothing")


def check_bodies(root: Any, report: Report) -> None:
    """Warn of masses, centres and inertias that no body of this robot has; the file has no errors."""
    with np.errstate(all="ignore"):  # numbers near the largest double overflow; comparisons with NaN are false
        found = bodies(root)
        size = robot_size(root, found)
        total = sum(body.mass for body in found)
        for body in found:
            if body.mass > 0:
                _check_centre(body, size, report)
                _check_inertia(body, max(size, robot_size(root, found, with_coms=True)), total, report)
                _check_shapes(body, report)


def _check_centre(body: Body, size: float, report: Report) -> None:
    measure = max(size, body.radius_of_gyration)
    if math.isfinite(body.com) and body.com > FAR * measure > 0:
        detail = f"{body.com:.3g} m from the link's origin, the robot measures {measure:.3g} m"
        cure = "check <origin> of <inertial>: metres"
        report.warning(body.element, body.owner, "the centre of mass is far outside the robot", cure, detail=detail)


def _check_inertia(body: Body, size: float, total: float, report: Report) -> None:
    radius = body.radius_of_gyration
    if radius > LARGE * size > 0 and body.mass > PLACEHOLDER:
        detail = f"radius of gyration {radius:.3g} m, the robot measures {size:.3g} m"
        cure = "check ixx ... izz: kg m^2 about the centre of mass"
        message = "mass and inertia are those of a body larger than the robot"
        report.warning(body.element, body.owner, message, cure, detail=detail)
    if body.density > DENSEST and body.mass > PLACEHOLDER:
        message = "mass and inertia are those of a body denser than any metal"
        cure = "check the units of <mass> and <inertia>: kg and kg m^2"
        report.warning(body.element, body.owner, message, cure, detail=f"{body.density:.2g} kg/m^3")


def _check_shapes(body: Body, report: Report) -> None:
    if body.mass <= PLACEHOLDER or body.shapes is None:
        return
    heaviest, lightest = body.mass / body.shapes.largest_volume, body.mass / body.shapes.surrounding_volume
    cure = "check the units of <mass> and of the shapes: kg and m"
    if lightest > DENSEST and body.radius_of_gyration <= body.shapes.radius and body.density <= DENSEST:
        message = "the mass makes its shapes denser than any metal"
        report.warning(body.element, body.owner, message, cure, detail=f"{lightest:.2g} kg/m^3")
    elif heaviest < AIR:
        message = "the mass makes its shapes lighter than air"
        report.warning(body.element, body.owner, message, cure, detail=f"{heaviest:.2g} kg/m^3")
