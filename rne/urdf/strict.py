"""Validation of every link and joint of a URDF, element by element."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..model.validation import inertia_error, triangle_excess
from .findings import Report, echo
from .grammar import check_grammar, describe, number, numbers, prune
from .tree import ENTRIES, TYPES, check_tree
from .xacro import check_expanded

TRIANGLE_TOLERANCE = 1e-6  # of the trace: files give about six decimals


def validate(root: Any, report: Report) -> bool:
    """Report everything wrong with the robot; afterwards `root` holds only validated elements and attributes.

    False if it is no robot, or one that xacro has still to make.
    """
    if not (_is_robot(root, report) and check_expanded(root, report)):
        return False
    check_grammar(root, report)
    if not root.get("name", "").strip():
        report.warning(root, "robot", "attribute 'name' is missing", "give the robot a name; other readers require it")
    if root.find("link") is None:
        report.error(root, "robot", "there is no <link>", "a robot needs at least its root link")
    for link in root.findall("link"):
        _check_link(link, report)
    for joint in root.findall("joint"):
        _check_joint(joint, report)
    check_tree(root, report)
    prune(root)
    return True


def _is_robot(root: Any, report: Report) -> bool:
    tag = root.tag
    namespace = remove_default_namespace(root)
    if namespace:
        report.warning(root, "robot", f"default namespace {echo(namespace)} is ignored", "remove xmlns")
    if root.tag != "robot":
        report.error(root, "file", f"the root element must be <robot>, got {echo(tag)}", "give a URDF file")
    return bool(root.tag == "robot")


def remove_default_namespace(root: Any) -> str:
    """The default namespace of a <robot>, which has no meaning in URDF and is removed; empty if there is none."""
    from lxml import etree

    tag = root.tag
    if not (tag.startswith("{") and tag.endswith("}robot")):
        return ""
    namespace = str(tag[: tag.index("}") + 1])
    for element in root.iter():
        element.tag = element.tag.removeprefix(namespace)
    etree.cleanup_namespaces(root)
    return namespace[1:-1]


def _check_name(element: Any, report: Report) -> str:
    if not element.get("name", "").strip():
        report.error(element, f"<{element.tag}>", "attribute 'name' is missing", "give every link and joint a name")
        return f"<{element.tag}>"
    return describe(element)


def _check_link(link: Any, report: Report) -> None:
    owner = _check_name(link, report)
    inertial = link.find("inertial")
    if inertial is not None:
        _check_inertial(inertial, owner, report)
    for visual in link.findall("visual"):
        _check_visual(visual, owner, report)


def _check_origin(parent: Any, owner: str, report: Report) -> tuple[float, ...] | None:
    """xyz of an element's <origin>, or None with a finding."""
    origin = parent.find("origin")
    if origin is None:
        return (0.0, 0.0, 0.0)
    numbers(origin, "rpy", owner, report, count=3, default="0 0 0")
    return numbers(origin, "xyz", owner, report, count=3, default="0 0 0")


def _check_inertial(inertial: Any, owner: str, report: Report) -> None:
    com = _check_origin(inertial, owner, report)
    mass_element, inertia_element = inertial.find("mass"), inertial.find("inertia")
    if mass_element is None:
        report.error(inertial, owner, "<mass> is missing in <inertial>", "give it, or remove <inertial>")
    if inertia_element is None:
        report.error(inertial, owner, "<inertia> is missing in <inertial>", "give it, or remove <inertial>")
    mass = None if mass_element is None else number(mass_element, "value", owner, report)
    if mass is not None and mass < 0:
        message = f"attribute 'value' of <mass> must be 0 or positive, got {echo(mass_element.get('value'))}"
        report.error(mass_element, owner, message, "fix the mass")
        mass = None
    if inertia_element is None:
        return
    entries = [number(inertia_element, entry, owner, report) for entry in ENTRIES]
    if mass is None or com is None or any(entry is None for entry in entries):
        return
    xx, xy, xz, yy, yz, zz = entries
    inertia = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]], dtype=float)
    error = inertia_error(mass, np.array(com), inertia)
    if error:
        report.error(inertia_element, owner, f"<inertia>: {error}", "check signs and units of ixx ... izz")
    elif triangle_excess(inertia) > TRIANGLE_TOLERANCE:
        message = "<inertia>: the largest principal moment exceeds the sum of the two others, which no rigid body has"
        report.warning(inertia_element, owner, message, "check ixx ... izz; torques are computed as written")


def _check_visual(visual: Any, owner: str, report: Report) -> None:
    """Keep valid cylinders for drawing and remove all other visuals; an invalid cylinder is only a warning."""
    cylinder = visual.find("geometry/cylinder")
    trial = Report(report.file)
    if cylinder is not None:
        number(cylinder, "radius", owner, trial)
        number(cylinder, "length", owner, trial)
        _check_origin(visual, owner, trial)
    for finding in trial.errors:
        report.warning(finding.line, owner, f"visual ignored: {finding.message}", finding.cure)
    if cylinder is None or trial.errors:
        visual.getparent().remove(visual)


def _check_joint(joint: Any, report: Report) -> None:
    owner = _check_name(joint, report)
    kind = joint.get("type")
    if kind is None:
        report.error(joint, owner, "attribute 'type' is missing", f"give one of {', '.join(TYPES)}")
    for tag in ("parent", "child"):
        element = joint.find(tag)
        if element is None:
            report.error(joint, owner, f"<{tag}> is missing", f'give <{tag} link="..."/>')
        elif not element.get("link"):
            report.error(element, owner, f"attribute 'link' of <{tag}> is missing", "give the link")
    _check_origin(joint, owner, report)
    _check_axis(joint, kind, owner, report)
    _check_limit(joint, kind, owner, report)
    dynamics, mimic = joint.find("dynamics"), joint.find("mimic")
    if dynamics is not None:
        for attribute in ("damping", "friction"):
            value = number(dynamics, attribute, owner, report, default="0")
            if value is not None and value < 0:
                message = f"attribute {attribute!r} of <dynamics> is negative: it would add energy"
                report.warning(dynamics, owner, message, "check its sign")
    if mimic is not None:
        number(mimic, "multiplier", owner, report, default="1")
        number(mimic, "offset", owner, report, default="0")
        if not mimic.get("joint"):
            report.error(mimic, owner, "attribute 'joint' of <mimic> is missing", "give the joint that it follows")


def _check_axis(joint: Any, kind: str | None, owner: str, report: Report) -> None:
    axis = joint.find("axis")
    if axis is None:
        return
    if kind == "fixed":
        report.warning(axis, owner, "<axis> of a fixed joint is ignored", "remove it")
        joint.remove(axis)
        return
    xyz = numbers(axis, "xyz", owner, report, count=3)
    if xyz is not None and not any(xyz):
        report.error(axis, owner, "attribute 'xyz' of <axis> is zero", "give the direction of the joint's axis")


def _check_limit(joint: Any, kind: str | None, owner: str, report: Report) -> None:
    limit = joint.find("limit")
    if limit is None:
        if kind in ("revolute", "prismatic"):
            report.warning(joint, owner, f"a {kind} joint without <limit>", "give it, or make the joint continuous")
        return
    bounds = [number(limit, attribute, owner, report, default="0") for attribute in ("lower", "upper")]
    for attribute in ("effort", "velocity"):
        if limit.get(attribute) is None:
            report.warning(limit, owner, f"attribute {attribute!r} of <limit> is missing", "give it; none is assumed")
        else:
            number(limit, attribute, owner, report)
    lower, upper = bounds
    if kind not in ("revolute", "prismatic") or lower is None or upper is None:
        return
    if lower > upper:
        report.warning(limit, owner, f"<limit>: lower {lower:g} is above upper {upper:g}", "exchange them")
    elif lower == upper:
        report.warning(limit, owner, f"<limit>: lower and upper are both {lower:g}, a range of zero", "give the range")
