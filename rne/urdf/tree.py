"""How links and joints hang together: names, one root, no loop, mimics that end at a joint of their own."""

from __future__ import annotations

from collections import Counter
from typing import Any

from .findings import Report, listed
from .grammar import describe

MOVING = ("revolute", "continuous", "prismatic")


def check_tree(root: Any, report: Report) -> None:
    """Report what keeps the robot from being one tree of supported joints."""
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
    """The link a joint names as its parent or child."""
    element = joint.find(end)
    name: str | None = None if element is None else element.get("link")
    return name


def _check_duplicates(elements: list[Any], report: Report) -> None:
    first: dict[str, Any] = {}
    for element in elements:
        name = element.get("name")
        if name in first:
            message = f"the name stands twice, first in line {first[name].sourceline}"
            report.error(element, describe(element), message, f"rename one {element.tag}")
        elif name:
            first[name] = element


def _check_types(joints: list[Any], report: Report) -> None:
    wrong = [j for j in joints if j.get("type") is not None and j.get("type") not in (*MOVING, "fixed")]
    if wrong:
        names = ", ".join(f"{describe(j)} of type {listed([j.get('type')])}" for j in wrong)
        cure = f"supported are {', '.join(MOVING)}, fixed"
        report.error(wrong[0], describe(wrong[0]), f"unsupported joints: {names}", cure)


def _check_references(links: list[Any], joints: list[Any], report: Report) -> bool:
    """True if every joint joins two known links and no link hangs on two joints."""
    names = {link.get("name") for link in links}
    carried: dict[str, Any] = {}
    sound = True
    for joint in joints:
        for end in ("parent", "child"):
            link = link_of(joint, end)
            if link and link not in names:
                message = f"<{end}> names the unknown link {listed([link])}"
                report.error(joint.find(end), describe(joint), message, "correct the name or add the link")
            sound = sound and link in names
        child = link_of(joint, "child")
        if child in carried:
            message = f"two parents, by {describe(carried[child])} and {describe(joint)}"
            report.error(joint, f"link {listed([child])}", message, "a loop cannot be modelled; cut one joint")
            sound = False
        elif child:
            carried[child] = joint
    return sound


def _check_one_root(root: Any, links: list[Any], joints: list[Any], report: Report) -> None:
    joint_above = {link_of(joint, "child"): joint for joint in joints}
    roots = [link.get("name") for link in links if link.get("name") not in joint_above]
    loops = _loops(joint_above)
    if loops:
        report.error(
            loops[0],
            describe(loops[0]),
            f"joints in a loop: {listed(j.get('name') for j in loops)}",
            "cut it",
        )
    if len(roots) > 1:
        report.error(root, "robot", f"several roots: links {listed(roots)}", "join them, or remove all but one")


def _loops(joint_above: dict[str | None, Any]) -> list[Any]:
    """The joints that lie on loops, in order."""
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
            report.warning(mimic, describe(joint), "a fixed joint mimics nothing; <mimic> is ignored", "remove it")
            joint.remove(mimic)
            continue
        followed = mimic.get("joint")
        target = by_name.get(followed)
        if followed and target is None:
            message = f"<mimic> names the unknown joint {listed([followed])}"
            report.error(mimic, describe(joint), message, "correct the name or add the joint")
        elif target is not None and target.get("type") == "fixed":
            message = f"<mimic> names the fixed joint {listed([followed])}"
            report.error(mimic, describe(joint), message, "name a joint that moves, or make this one fixed too")
        elif target is not None:
            _check_mimic_ends(joint, by_name, done, report)


def _check_mimic_ends(joint: Any, by_name: dict[str, Any], done: set[str], report: Report) -> None:
    chain: list[str] = []
    name = joint.get("name")
    while name in by_name and by_name[name].find("mimic") is not None and name not in done:
        if name in chain:
            circle = chain[chain.index(name) :]
            report.error(
                joint,
                describe(joint),
                f"<mimic> in a circle: {listed(circle)}",
                "let one of them move freely",
            )
            break
        chain.append(name)
        name = by_name[name].find("mimic").get("joint")
    done.update(chain)


def _warn_of_empty_subtrees(links: list[Any], joints: list[Any], report: Report) -> None:
    """A joint that moves no inertia: inverse dynamics and M are fine, forward dynamics has no answer."""
    parent_of = {link_of(joint, "child"): link_of(joint, "parent") for joint in joints}
    heavy: set[str | None] = set()
    for link in links:
        name = link.get("name")
        if not _has_inertia(link):
            continue
        while name is not None and name not in heavy:
            heavy.add(name)
            name = parent_of.get(name)
    counts = Counter(link_of(joint, "child") in heavy for joint in joints if joint.get("type") in MOVING)
    for joint in joints if counts[False] else []:
        if joint.get("type") in MOVING and link_of(joint, "child") not in heavy and joint.find("mimic") is None:
            message = "moves no inertia: forward dynamics will raise SingularMassMatrixError"
            report.warning(joint, describe(joint), message, "give its links mass, or make the joint fixed")


def _has_inertia(link: Any) -> bool:
    inertial = link.find("inertial")
    if inertial is None:
        return False
    inertia = inertial.find("inertia")
    return any(float(text) for text in (inertial.find("mass").get("value"), *inertia.attrib.values()))
