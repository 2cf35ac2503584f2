"""Rotors in URDF as Drake reads them: armature = rotor_inertia gear_ratio^2, in the <actuator> of a <transmission>."""

from __future__ import annotations

import re
from typing import Any

from .document import DRAKE, GEAR, ROTOR, SIMPLE, Element, checked_numbers, describe
from .findings import FindingsReport, echo, listed


def name_rotors(root: Element) -> Element:
    """Robot with Drake's namespace on elements of actuators that have its prefix, declared or not."""
    for child in root.iterfind("transmission/actuator/*"):
        if child.prefix == "drake" or child.tag.startswith("drake:"):
            child.tag = DRAKE + re.split("[}:]", child.tag)[-1]
    return root


def rotors_of(root: Element, report: FindingsReport) -> dict[Any, float]:
    """Armature of the joints that have rotors, by name, with findings; Drake too takes 1 for a gear ratio."""
    kinds, found = {joint.get("name"): joint.get("type") for joint in root.findall("joint")}, dict[Any, float]()
    for transmission in root.iterfind("transmission"):
        kind = transmission.findtext("type", transmission.get("type", "")).strip()
        actuators, names = transmission.findall("actuator"), [x.get("name") for x in transmission.findall("joint")]
        own, got = "actuator, gear ratio and joint of the robot", f"got {echo(kind)} of {listed(map(str, names))}"
        is_simple = SIMPLE in kind and len(names) == len(actuators) == 1 >= len(actuators[0].findall(GEAR))
        for rotor in transmission.iterfind(f"actuator/{ROTOR}"):
            if not is_simple or names[0] not in kinds or names[0] in found:
                message = f"a rotor must have a separate {SIMPLE}, with one {own}, {got}"
                report.error(rotor, describe(transmission), message, "write it so, for each joint once")
            elif kinds[names[0]] == "fixed":
                report.warning(rotor, f"joint {echo(names[0])}", "the rotor of a fixed joint is ignored", "remove it")
            else:
                found[names[0]] = _armature(actuators[0], f"joint {echo(names[0])}", report)
    return found


def _armature(actuator: Element, owner: str, report: FindingsReport) -> float:
    J, ratio = (checked_numbers(actuator, tag, owner, report).get("value", 1.0) for tag in (ROTOR, GEAR))
    for tag, is_wrong, need in ((ROTOR, J < 0, "must not be negative"), (GEAR, ratio == 0, "must not be 0")):
        if is_wrong:
            got = f"{need}, got {echo(actuator.find(tag).get('value'))}"
            message = f"attribute 'value' of <{tag.replace(DRAKE, 'drake:')}> {got}"
            report.error(actuator.find(tag), owner, message, "fix the attribute")
    if actuator.find(GEAR) is None:
        report.warning(actuator, owner, "<drake:gear_ratio> is missing, taken as 1", "give it")
    armature, cure = float(J * ratio * ratio), "give Pinocchio and MuJoCo this armature, as they read no rotors"
    report.warning(actuator, owner, "<drake:rotor_inertia> is read, and adds to M", cure, detail=f"{armature:.6g}")
    return armature
