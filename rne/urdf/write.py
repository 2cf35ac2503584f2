"""Writing a Model as URDF text."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..basics.spatial import rpy_from_rotation
from ..model.builder import Part, Pose, at_links, disassemble
from ..model.model import Model, model_argument
from .document import LARGEST


def to_urdf(model: Model) -> str:
    """Write a robot as URDF text; reading it back gives the same Model but for gravity and armature.

    Parameters
    ----------
    model : Model
        The robot's parameters.

    Returns
    -------
    str
        Numbers have all their digits. Merged links are written as fixed joints, their inertia on the body's first
        link. URDF has no element for gravity and armature: gravity other than (0, 0, -9.81), and armature other than
        zero, are written as comments, which a reader passes over.

    Raises
    ------
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

    for name in (model_argument(model).name, *model.link_names, *model.joint_names):
        _check_name(name)
    root = etree.Element("robot", name=model.name)
    _comment(root, model.notes.get("robot"))
    if model.gravity.tolist() != [0.0, 0.0, -9.81]:
        _comment(root, f"gravity is {_text(model.gravity)} m/s^2 in the axes of the root link")
    if model.armature.any():
        _comment(root, f"armature of the joints is {_text(model.armature)}")
    parts = at_links(disassemble(model))
    for part in parts:
        _comment(root, model.notes.get(part.link))
        _link(root, model, part)
        if part.joint:
            _comment(root, model.notes.get(part.joint))
            _joint(root, parts, part)
    etree.indent(root)
    text: str = etree.tostring(root, encoding="unicode", pretty_print=True)
    return '<?xml version="1.0"?>\n' + text


def _check_name(name: str) -> None:
    if not all(c in "\t\n\r" or c >= " " for c in name) or any("\ud800" <= c <= "\udfff" for c in name):
        raise ValueError(f"{name!r} cannot be written to XML, which has no control characters; rename it")


def _comment(root: Any, text: str | None) -> None:
    from lxml import etree

    if text:
        root.append(etree.Comment(f" {text.replace('--', '- -')} "))


def _number(x: Any) -> str:
    value = float(np.clip(float(x), -LARGEST, LARGEST)) + 0.0
    return repr(value).removesuffix(".0")


def _text(vector: Any) -> str:
    return " ".join(_number(x) for x in vector)


def _origin(parent: Any, xyz: Any, rpy: Any) -> None:
    from lxml import etree

    etree.SubElement(parent, "origin", xyz=_text(xyz), rpy=_text(rpy))


def _pose(parent: Any, place: Pose) -> None:
    _origin(parent, place.p, rpy_from_rotation(place.R.astype(np.float64)))


def _link(root: Any, model: Model, part: Part) -> None:
    from lxml import etree

    link = etree.SubElement(root, "link", name=part.link)
    if part.mass or np.any(part.inertia):
        inertial = etree.SubElement(link, "inertial")
        _origin(inertial, part.com, np.zeros(3))
        etree.SubElement(inertial, "mass", value=_number(part.mass))
        entries = {
            f"i{a}{b}": part.inertia["xyz".index(a), "xyz".index(b)] for a, b in ("xx", "xy", "xz", "yy", "yz", "zz")
        }
        etree.SubElement(inertial, "inertia", {name: _number(x) for name, x in entries.items()})
    for shape in model.shapes:
        if shape.link == part.link:
            visual = etree.SubElement(link, "visual")
            _origin(visual, shape.position, shape.rpy)
            geometry = etree.SubElement(visual, "geometry")
            etree.SubElement(geometry, "cylinder", radius=_number(shape.radius), length=_number(shape.length))


def _joint(root: Any, parts: list[Part], part: Part) -> None:
    from lxml import etree

    joint = etree.SubElement(root, "joint", name=part.joint, type=part.kind)
    _pose(joint, part.placement)
    etree.SubElement(joint, "parent", link=parts[part.parent].link)
    etree.SubElement(joint, "child", link=part.link)
    if part.kind == "fixed":
        return
    etree.SubElement(joint, "axis", xyz=_text(part.axis))
    bounds = {"lower": part.lower, "upper": part.upper} if part.kind != "continuous" else {}
    limits = bounds | {"effort": part.effort, "velocity": part.velocity}
    limits |= {name: x for name in ("acceleration", "jerk") if np.isfinite(x := getattr(part, name))}
    etree.SubElement(joint, "limit", {name: _number(x) for name, x in limits.items()})
    if part.damping or part.friction:
        etree.SubElement(joint, "dynamics", damping=_number(part.damping), friction=_number(part.friction))
    if part.mimic:
        etree.SubElement(
            joint,
            "mimic",
            joint=parts[part.mimic.independent].joint,
            multiplier=_number(part.mimic.multiplier),
            offset=_number(part.mimic.offset),
        )
