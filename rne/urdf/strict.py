"""Validation of a URDF: every link and joint, element by element, then the tree that they form."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping
from typing import Any

import numpy as np

from ..model.checks import domain_error, inertia_error, triangle_excess
from .document import NO_LIMIT, XACRO, Element, check_expanded, check_grammar, checked_numbers, describe
from .findings import Finding, FindingsReport, echo, listed, some
from .rotors import name_rotors, rotors_of

MOVING = ("revolute", "continuous", "prismatic")
TYPES = (*MOVING, "fixed")
NO_LOOPS = "loops are not supported; remove one of the joints"
TRIANGLE_TOLERANCE = 1e-6  # tolerance of the triangle inequality relative to the trace: files give about six decimals


def validate(root: Element, report: FindingsReport) -> bool:
    """Report everything wrong with the robot; False if it is none, or if xacro must expand it first.

    Elements that are neither an error nor said to be ignored are safe to read.
    """
    if not (_is_robot(root, report) and check_expanded(name_rotors(root), report)):
        return False
    check_grammar(root, report)
    if not root.get("name", "").strip():
        report.warning(root, "robot", "attribute 'name' is missing", "give the robot a name; other readers require it")
    links, joints = root.findall("link"), root.findall("joint")
    if not links:
        cure = "a robot needs at least its root link"
        if any(XACRO.fullmatch(child.tag) for child in root):
            cure = "give the expanded file of a robot that calls these macros"
        report.error(root, "robot", "there is no <link>", cure)
    _add_world(root, links, joints, report)
    fixed = fixed_links(links, joints)
    for link in links:
        _check_link(link, report, is_moved=link.get("name") not in fixed)
    for joint in joints:
        _check_joint(joint, report)
    _check_duplicates(links, report)
    _check_duplicates(joints, report)
    _check_types(joints, report)
    _check_tree(root, links, joints, report)
    _check_mimics(joints, report)
    rotors_of(root, report)
    return True


def _add_world(root: Element, links: list[Element], joints: list[Element], report: FindingsReport) -> None:
    """Add the link "world" where it is the parent of a joint and has no <link>, as in files for Drake."""
    welded = [joint for joint in joints if link_of(joint, "parent") == "world"]
    if links and welded and all(link.get("name") != "world" for link in links):
        links.insert(0, root.makeelement("link", name="world"))
        root.insert(0, links[0])
        where, cure = welded[0].find("parent"), 'it is the fixed root; add <link name="world"/>'
        report.warning(where, describe(welded[0]), "<parent> names 'world', which has no <link>", cure)


def _is_robot(root: Element, report: FindingsReport) -> bool:
    """True for a <robot>, also in a default namespace, which has no meaning in URDF and is removed."""
    from lxml import etree

    tag = root.tag
    if tag.startswith("{") and tag.endswith("}robot"):
        namespace = tag.removesuffix("robot")
        for element in root.iter():
            element.tag = element.tag.removeprefix(namespace)
        etree.cleanup_namespaces(root)
        report.warning(root, "robot", f"default namespace {echo(namespace[1:-1])} is ignored", "remove xmlns")
    if root.tag != "robot":
        cure = "write <robot>" if tag.lower().endswith("robot") else "give a URDF file"
        report.error(root, "file", f"the root element must be <robot>, got {echo(tag)}", cure)
    return bool(root.tag == "robot")


def _check_name(element: Element, report: FindingsReport) -> str:
    if not element.get("name", "").strip():
        report.error(element, f"<{element.tag}>", "attribute 'name' is missing", "give every link and joint a name")
        return f"<{element.tag}>"
    return describe(element)


def fixed_links(links: list[Element], joints: list[Element]) -> set[Any]:
    """Names of the links that no joint moves: the roots, and what is fixed to them."""
    children, below = {link_of(joint, "child") for joint in joints}, defaultdict(list)
    for joint in joints:
        if joint.get("type") == "fixed":
            below[link_of(joint, "parent")].append(link_of(joint, "child"))
    found = [link.get("name") for link in links if link.get("name") not in children]
    for name in found:
        found += below.pop(name, [])
    return set(found)


def _check_link(link: Element, report: FindingsReport, *, is_moved: bool) -> None:
    owner = _check_name(link, report)
    inertial = link.find("inertial")
    if inertial is not None:
        _check_inertial(inertial, owner, report, is_moved=is_moved)
    for visual in link.findall("visual"):
        for finding in shape_errors(visual):
            report.warning(finding.line, owner, f"visual ignored: {finding.message}", finding.cure)


def shape_errors(visual: Element) -> list[Finding]:
    """Errors that keep a visual's cylinder or box from being drawn: nothing else of a visual is read."""
    trial = FindingsReport("")
    for kind in ("cylinder", "box"):
        if visual.find(f"geometry/{kind}") is not None:
            checked_numbers(visual.find("geometry"), kind, "", trial)
            checked_numbers(visual, "origin", "", trial)
    return trial.errors


def _check_inertial(inertial: Element, owner: str, report: FindingsReport, *, is_moved: bool) -> None:
    for tag in ("mass", "inertia"):
        if inertial.find(tag) is None:
            report.error(inertial, owner, f"<{tag}> is missing in <inertial>", "give it, or remove <inertial>")
    com, mass, entries = (checked_numbers(inertial, tag, owner, report) for tag in ("origin", "mass", "inertia"))
    if mass.get("value", 0) < 0:
        element = inertial.find("mass")
        message = f"attribute 'value' of <mass> must be 0 or positive, got {echo(element.get('value'))}"
        report.error(element, owner, message, "fix the mass")
    elif mass and "xyz" in com and len(entries) == 6:
        rows = [[entries[f"i{min(a, b)}{max(a, b)}"] for b in "xyz"] for a in "xyz"]
        error = inertia_error(mass["value"], np.array(com["xyz"]), np.array(rows))
        if error:
            by_rows = "give ixx ixy ixz iyy iyz izz; these look like ixx ixy ixz iyx iyy iyz"
            cure = by_rows if rows[0][1] == rows[1][1] != 0 else "check signs and units of ixx ... izz"
            tell, effect = (report.error, "") if is_moved else (report.warning, ", without effect as no joint moves it")
            tell(inertial.find("inertia"), owner, f"<inertia>: {error}{effect}", cure)
        elif triangle_excess(np.array(rows)) > TRIANGLE_TOLERANCE:
            message = "the largest principal moment exceeds the sum of the two others, which no rigid body has"
            cure = "check ixx ... izz; torques are computed as written"
            report.warning(inertial.find("inertia"), owner, f"<inertia>: {message}", cure)


def _check_joint(joint: Element, report: FindingsReport) -> None:
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
    checked_numbers(joint, "origin", owner, report)
    axis, mimic = joint.find("axis"), joint.find("mimic")
    if axis is not None and kind == "fixed":
        report.warning(axis, owner, "<axis> of a fixed joint is ignored", "remove it")
    elif not any(checked_numbers(joint, "axis", owner, report).get("xyz", [1])):
        report.error(axis, owner, "attribute 'xyz' of <axis> is zero", "give the direction of the joint's axis")
    _check_limit(joint, kind, owner, report)
    for attribute, value in checked_numbers(joint, "dynamics", owner, report).items():
        if domain_error(attribute, value):
            message = f"attribute {attribute!r} of <dynamics> is negative: it would add energy"
            report.warning(joint.find("dynamics"), owner, message, "check its sign")
    checked_numbers(joint, "mimic", owner, report)
    if mimic is not None and not mimic.get("joint"):
        report.error(mimic, owner, "attribute 'joint' of <mimic> is missing", "give the joint that it follows")


def _check_limit(joint: Element, kind: str | None, owner: str, report: FindingsReport) -> None:
    limit = joint.find("limit")
    if limit is None:
        if kind in ("revolute", "prismatic"):
            report.warning(joint, owner, f"a {kind} joint without <limit>", "give it, or make the joint continuous")
        return
    bounds = checked_numbers(joint, "limit", owner, report)
    for attribute, value in bounds.items():
        error, what = domain_error(attribute, value), f"attribute {attribute!r} of <limit>"
        if error and kind != "fixed" and value == NO_LIMIT:
            report.warning(limit, owner, f"{what} is -1, taken as no limit", "leave it out, or write the limit")
        elif error and kind != "fixed":
            report.error(limit, owner, f"{what} {error}, got {echo(limit.get(attribute))}", "leave it out for no limit")
    for attribute in ("effort", "velocity"):
        if limit.get(attribute) is None:
            report.warning(limit, owner, f"attribute {attribute!r} of <limit> is missing", "give it; none is assumed")
    if kind not in ("revolute", "prismatic") or not {"lower", "upper"} <= bounds.keys():
        return
    lower, upper = bounds["lower"], bounds["upper"]
    if lower > upper:
        missing = [x for x in ("lower", "upper") if limit.get(x) is None]
        cure = f"give {missing[0]!r}, which is 0 if left out" if missing else "exchange them"
        report.warning(limit, owner, f"<limit>: lower {lower:g} is above upper {upper:g}", cure)
    elif lower == upper:
        report.warning(limit, owner, f"<limit>: lower and upper are both {lower:g}, a range of zero", "give the range")


def link_of(joint: Element, end: str) -> str | None:
    """Name of a joint's parent or child link."""
    element = joint.find(end)
    name: str | None = None if element is None else element.get("link")
    return name


def mimics_of(joints: list[Element]) -> dict[str, Element]:
    """Element <mimic> of each joint that has one, by the joint's name; those of fixed joints are ignored."""
    found = {joint.get("name"): joint.find("mimic") for joint in joints if joint.get("type") != "fixed"}
    return {name: mimic for name, mimic in found.items() if mimic is not None}


def _check_duplicates(elements: list[Element], report: FindingsReport) -> None:
    first: dict[str, Any] = {}
    for element in elements:
        name = element.get("name")
        if name in first:
            message = f"the name is duplicated, first used in line {first[name].sourceline}"
            report.error(element, describe(element), message, f"rename one {element.tag}")
        elif name:
            first[name] = element


def _check_types(joints: list[Element], report: FindingsReport) -> None:
    wrong = [j for j in joints if j.get("type") is not None and j.get("type") not in TYPES]
    if wrong:
        names = some(f"{describe(j)} of type {listed([j.get('type')])}" for j in wrong)
        cure = f"supported are {', '.join(TYPES)}"
        report.error(wrong[0], describe(wrong[0]), f"unsupported joints: {names}", cure)


def _check_tree(root: Element, links: list[Element], joints: list[Element], report: FindingsReport) -> None:
    """Report joints to links that do not exist, links with two parents, loops, and several roots."""
    names = {link.get("name") for link in links}
    above: dict[Any, Any] = {}  # the joint of each child link
    valid = True
    for joint in joints:
        for end in ("parent", "child"):
            link = link_of(joint, end)
            if link and link not in names:
                message = f"<{end}> names the unknown link {listed([link])}"
                report.error(joint.find(end), describe(joint), message, "correct the name or add the link")
            valid = valid and link in names
        child = link_of(joint, "child")
        if child in above:
            message = f"two parents, through {describe(above[child])} and {describe(joint)}"
            report.error(joint, f"link {listed([str(child)])}", message, NO_LOOPS)
            valid = False
        elif child:
            above[child] = joint
    if not valid:
        return
    loops = [above[child] for loop in _cycles({c: link_of(j, "parent") for c, j in above.items()}) for child in loop]
    if loops:
        message = f"joints form a loop: {listed(joint.get('name') for joint in loops)}"
        report.error(loops[0], describe(loops[0]), message, NO_LOOPS)
    roots = [link.get("name") for link in links if link.get("name") not in above]
    if len(roots) > 1:
        report.error(root, "robot", f"several roots: links {listed(roots)}", "connect them, or remove all but one")


def _check_mimics(joints: list[Element], report: FindingsReport) -> None:
    by_name = {joint.get("name"): joint for joint in joints}
    for joint in joints:
        mimic, owner = joint.find("mimic"), describe(joint)
        followed = None if mimic is None else mimic.get("joint")
        if mimic is not None and joint.get("type") == "fixed":
            report.warning(mimic, owner, "<mimic> of a fixed joint is ignored", "remove it")
        elif followed and followed not in by_name:
            message = f"<mimic> names the unknown joint {listed([followed])}"
            report.error(mimic, owner, message, "correct the name or add the joint")
        elif followed and by_name[followed].get("type") == "fixed":
            message = f"<mimic> names the fixed joint {listed([followed])}"
            report.error(mimic, owner, message, "name a moving joint, or make this one fixed")
    for circle in _cycles({name: mimic.get("joint") for name, mimic in mimics_of(joints).items()}):
        message = f"joints mimic each other in a circle: {listed(circle)}"
        report.error(by_name[circle[0]], describe(by_name[circle[0]]), message, "make one of them independent")


def _cycles(following: Mapping[Any, Any]) -> list[list[Any]]:
    """Cycles in a mapping of names, each in its order."""
    done: set[Any] = set()
    cycles = []
    for name in following:
        walk: list[Any] = []
        while name in following and name not in done:
            done.add(name)
            walk.append(name)
            name = following[name]
        if name in walk:
            cycles.append(walk[walk.index(name) :])
    return cycles
