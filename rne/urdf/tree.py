"""Validation of the kinematic tree: unique names, one root, no loop, and mimics that follow an independent joint."""

from __future__ import annotations

from typing import Any

from .findings import Report, listed
from .grammar import describe

ENTRIES = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")  # of <inertia>
MOVING = ("revolute", "continuous", "prismatic")
TYPES = (*MOVING, "fixed")


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
