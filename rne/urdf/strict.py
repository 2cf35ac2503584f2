"""Validation of a URDF: every link and joint, element by element, then the tree that they form."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..model.checks import inertia_error, triangle_excess
from .document import check_expanded, check_grammar, describe, number, numbers, prune
from .findings import Report, echo, listed

ENTRIES = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")  # of <inertia>
MOVING = ("revolute", "continuous", "prismatic")
TYPES = (*MOVING, "fixed")
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
    for attribute in ("acceleration", "jerk"):  # of URDF 1.2
        number(limit, attribute, owner, report, default="0")
    lower, upper = bounds
    if kind not in ("revolute", "prismatic") or lower is None or upper is None:
        return
    if lower > upper:
        report.warning(limit, owner, f"<limit>: lower {lower:g} is above upper {upper:g}", "exchange them")
    elif lower == upper:
        report.warning(limit, owner, f"<limit>: lower and upper are both {lower:g}, a range of zero", "give the range")


def check_tree(root: Any, report: Report) -> None:
    """Report everything that prevents the robot from being one tree of supported joints."""
    links, joints = root.findall("link"), root.findall("joint")
    _check_duplicates(links, report)
    _check_duplicates(joints, report)
    _check_types(joints, report)
    if _check_references(links, joints, report):
        _check_one_root(root, links, joints, report)
    _check_mimics(joints, report)
    if not report.errors:
        _warn_of_empty_subtrees(links, joints, report)


def link_of(joint: Any, end: str) -> str | None:
    """The name of a joint's parent or child link."""
    element = joint.find(end)
    name: str | None = None if element is None else element.get("link")
    return name


def _check_duplicates(elements: list[Any], report: Report) -> None:
    first: dict[str, Any] = {}
    for element in elements:
        name = element.get("name")
        if name in first:
            message = f"the name is duplicated, first used in line {first[name].sourceline}"
            report.error(element, describe(element), message, f"rename one {element.tag}")
        elif name:
            first[name] = element


def _check_types(joints: list[Any], report: Report) -> None:
    wrong = [j for j in joints if j.get("type") is not None and j.get("type") not in TYPES]
    if wrong:
        names = ", ".join(f"{describe(j)} of type {listed([j.get('type')])}" for j in wrong)
        cure = f"supported are {', '.join(TYPES)}"
        report.error(wrong[0], describe(wrong[0]), f"unsupported joints: {names}", cure)


def _check_references(links: list[Any], joints: list[Any], report: Report) -> bool:
    """True if every joint connects two known links and no link has two parents."""
    names = {link.get("name") for link in links}
    joint_above: dict[str, Any] = {}
    valid = True
    for joint in joints:
        for end in ("parent", "child"):
            link = link_of(joint, end)
            if link and link not in names:
                message = f"<{end}> names the unknown link {listed([link])}"
                report.error(joint.find(end), describe(joint), message, "correct the name or add the link")
            valid = valid and link in names
        child = link_of(joint, "child")
        if child in joint_above:
            message = f"two parents, through {describe(joint_above[child])} and {describe(joint)}"
            report.error(joint, f"link {listed([child])}", message, "loops are not supported; remove one of the joints")
            valid = False
        elif child:
            joint_above[child] = joint
    return valid


def _check_one_root(root: Any, links: list[Any], joints: list[Any], report: Report) -> None:
    joint_above = {link_of(joint, "child"): joint for joint in joints}
    roots = [link.get("name") for link in links if link.get("name") not in joint_above]
    loops = _loops(joint_above)
    if loops:
        message = f"joints form a loop: {listed(j.get('name') for j in loops)}"
        report.error(loops[0], describe(loops[0]), message, "loops are not supported; remove one of the joints")
    if len(roots) > 1:
        report.error(root, "robot", f"several roots: links {listed(roots)}", "connect them, or remove all but one")


def _loops(joint_above: dict[str | None, Any]) -> list[Any]:
    """The joints that are part of a loop, in order."""
    state: dict[str | None, int] = {}  # 1 on the current walk, 2 done
    loops: list[Any] = []
    for start in joint_above:
        walk = []
        link: str | None = start
        while link in joint_above and link not in state:
            state[link] = 1
            walk.append(link)
            link = link_of(joint_above[link], "parent")
        if state.get(link) == 1:
            loops += [joint_above[name] for name in walk[walk.index(link) :]]
        state.update(dict.fromkeys(walk, 2))
    return loops


def _check_mimics(joints: list[Any], report: Report) -> None:
    by_name = {joint.get("name"): joint for joint in joints}
    done: set[str] = set()
    for joint in joints:
        mimic = joint.find("mimic")
        if mimic is None:
            continue
        if joint.get("type") == "fixed":
            report.warning(mimic, describe(joint), "<mimic> of a fixed joint is ignored", "remove it")
            joint.remove(mimic)
            continue
        followed = mimic.get("joint")
        target = by_name.get(followed)
        if followed and target is None:
            message = f"<mimic> names the unknown joint {listed([followed])}"
            report.error(mimic, describe(joint), message, "correct the name or add the joint")
        elif target is not None and target.get("type") == "fixed":
            message = f"<mimic> names the fixed joint {listed([followed])}"
            report.error(mimic, describe(joint), message, "name a moving joint, or make this one fixed")
        elif target is not None:
            _check_mimic_ends(joint, by_name, done, report)


def _check_mimic_ends(joint: Any, by_name: dict[str, Any], done: set[str], report: Report) -> None:
    chain: dict[str, None] = {}  # a set in order
    name = joint.get("name")
    while name in by_name and by_name[name].find("mimic") is not None and name not in done:
        if name in chain:
            circle = list(chain)
            message = f"joints mimic each other in a circle: {listed(circle[circle.index(name) :])}"
            report.error(joint, describe(joint), message, "make one of them independent")
            break
        chain[name] = None
        name = by_name[name].find("mimic").get("joint")
    done.update(chain)


def _warn_of_empty_subtrees(links: list[Any], joints: list[Any], report: Report) -> None:
    """Warn of joints that move no inertia: inverse dynamics and M exist, but forward dynamics does not."""
    parent_of = {link_of(joint, "child"): link_of(joint, "parent") for joint in joints}
    heavy: set[str | None] = set()
    for link in links:
        name = link.get("name")
        if not _has_inertia(link):
            continue
        while name is not None and name not in heavy:
            heavy.add(name)
            name = parent_of.get(name)
    for joint in joints:
        if joint.get("type") in MOVING and link_of(joint, "child") not in heavy and joint.find("mimic") is None:
            message = "moves no inertia: forward dynamics will raise SingularMassMatrixError"
            report.warning(joint, describe(joint), message, "give its links mass, or make the joint fixed")


def _has_inertia(link: Any) -> bool:
    inertial = link.find("inertial")
    if inertial is None:
        return False
    inertia = inertial.find("inertia")
    return any(float(text) for text in (inertial.find("mass").get("value"), *(inertia.get(ij) for ij in ENTRIES)))
