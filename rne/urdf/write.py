"""Writing a Model as URDF text."""

from __future__ import annotations

import logging
from typing import Any, Literal

import numpy as np

from ..basics.spatial import rpy_from_rotation
from ..model.builder import Part, at_links, disassemble
from ..model.model import Model, model_argument
from ..model.solids import Box
from ..model.topology import refuse_couplings
from .document import DRAKE, GEAR, LARGEST, ROTOR, SIMPLE, Element

LOGGER = logging.getLogger("rne")


def to_urdf(model: Model, *, couplings: Literal["raise", "drop"] = "raise") -> str:
    """Write a robot as URDF text; reading it back gives the same Model but for gravity.

    Parameters
    ----------
    model : Model
        The robot's parameters.
    couplings : {"raise", "drop"}
        For joints that follow others by couplings, which URDF does not support: raise an error, or write independent
        joints, each with a comment and a warning on the logger "rne".

    Returns
    -------
    str
        Numbers have all their digits. Merged links are written as fixed joints, their inertia on the body's first
        link. Rotors are written for Drake: `armature` as `<drake:rotor_inertia>` with a `<drake:gear_ratio>` of 1. URDF
        has no element for gravity: if it is not (0, 0, -9.81), it is written as a comment, which readers ignore.

    Raises
    ------
    ModelError
        If joints follow others by couplings.
    ValueError
        If a name has control characters, which XML does not allow.

    Notes
    -----
    A rotation other than by right angles may change in its last digit, since a URDF holds angles. A limit that does
    not exist is written as the largest double, which is read back as no limit. Joints whose far origins were moved when
    the robot was read are written where their file had them, rounded to doubles there.

    Examples
    --------
    >>> import rne
    >>> rne.to_urdf(rne.irb140()).count("<joint ")  # six that move, and the flange
    7
    """
    from lxml import etree

    if couplings not in ("raise", "drop"):
        raise ValueError(f'`couplings` must be "raise" or "drop", got {couplings!r}')
    if couplings == "raise":
        what = "a URDF can only say that a joint follows one other in a constant ratio and takes"
        cure = '; rne.to_urdf(model, couplings="drop") writes it as a joint that moves freely'
        refuse_couplings(model_argument(model), what, cure)
    dropped = {c.joint: f"joint {c.joint} follows {', '.join(c.drivers)} by a coupling" for c in model.couplings}
    for name in (model_argument(model).name, *model.link_names, *model.joint_names):
        if not all(c in "\t\n\r" or c >= " " for c in name) or any("\ud800" <= c <= "\udfff" for c in name):
            raise ValueError(f"{name!r} cannot be written to XML, which has no control characters; rename it")
    root = etree.Element("robot", name=model.name, nsmap={"drake": DRAKE[1:-1]} if model.armature.any() else None)

    def comment(text: str | None) -> None:
        if text:
            root.append(etree.Comment(f" {text.replace('--', '- -')} "))

    comment(model.notes.get("robot"))
    if model.gravity.tolist() != [0.0, 0.0, -9.81]:
        comment(f"gravity is {_text(model.gravity)} m/s^2 in the axes of the root link")
    parts = at_links(disassemble(model))
    for part in parts:
        comment(model.notes.get(part.link))
        _add_link(root, model, part)
        if part.joint:
            comment(model.notes.get(part.joint))
            if part.joint in dropped:
                comment(dropped[part.joint])
                LOGGER.warning("%s, which its URDF leaves out", dropped[part.joint])
            _add_joint(root, parts, part)
        if part.armature:
            _add_rotor(root, part)
    etree.indent(root)
    text: str = etree.tostring(root, encoding="unicode", pretty_print=True)
    return '<?xml version="1.0"?>\n' + text


def _add(parent: Element, tag: str, **attributes: Any) -> Element:
    """Add a child to an element; numbers and vectors are written with all their digits."""
    child = parent.makeelement(tag, {name: x if isinstance(x, str) else _text(x) for name, x in attributes.items()})
    parent.append(child)
    return child


def _text(numbers: Any) -> str:
    values = np.clip(np.asarray(numbers, dtype=np.float64), -LARGEST, LARGEST).ravel() + 0.0  # no negative zeros
    return " ".join(repr(x).removesuffix(".0") for x in values.tolist())


def _add_link(root: Element, model: Model, part: Part) -> None:
    link = _add(root, "link", name=part.link)
    if part.mass or np.any(part.inertia):
        inertial = _add(link, "inertial")
        _add(inertial, "origin", xyz=part.com, rpy=np.zeros(3))
        _add(inertial, "mass", value=part.mass)
        entries = {f"i{'xyz'[i]}{'xyz'[j]}": part.inertia[i, j] for i in range(3) for j in range(i, 3)}
        _add(inertial, "inertia", **entries)
    for shape in model.shapes:
        if shape.link == part.link:
            visual = _add(link, "visual")
            _add(visual, "origin", xyz=shape.position, rpy=shape.rpy)
            geometry = _add(visual, "geometry")
            if isinstance(shape, Box):
                _add(geometry, "box", size=shape.size)
            else:
                _add(geometry, "cylinder", radius=shape.radius, length=shape.length)


def _add_joint(root: Element, parts: list[Part], part: Part) -> None:
    joint = _add(root, "joint", name=part.joint, type=part.kind)
    R, p = part.placement
    _add(joint, "origin", xyz=p, rpy=rpy_from_rotation(R.astype(np.float64)))
    _add(joint, "parent", link=parts[part.parent].link)
    _add(joint, "child", link=part.link)
    if part.kind == "fixed":
        return
    _add(joint, "axis", xyz=part.axis)
    limits = {"lower": part.lower, "upper": part.upper} if part.kind != "continuous" else {}
    limits |= {"effort": part.effort, "velocity": part.velocity}
    limits |= {name: x for name in ("acceleration", "deceleration", "jerk") if np.isfinite(x := getattr(part, name))}
    _add(joint, "limit", **limits)
    if part.damping or part.friction:
        _add(joint, "dynamics", damping=part.damping, friction=part.friction)
    if part.mimic:
        independent, multiplier, offset = part.mimic
        _add(joint, "mimic", joint=parts[independent].joint, multiplier=multiplier, offset=offset)


def _add_rotor(root: Element, part: Part) -> None:
    transmission = _add(root, "transmission", name=f"{part.joint}_transmission")
    _add(transmission, "type").text = f"transmission_interface/{SIMPLE}"
    _add(transmission, "joint", name=part.joint)
    actuator = _add(transmission, "actuator", name=f"{part.joint}_motor")
    _add(actuator, ROTOR, value=part.armature)
    _add(actuator, GEAR, value=1)
