"""A validated URDF -> Model. The only file that imports yourdfpy."""

from __future__ import annotations

import heapq
import os
import sys
from io import BytesIO
from typing import Any, TextIO

import numpy as np
from numpy.typing import ArrayLike

from ..basics.spatial import Array, rotation_from_rpy, snap, transpose
from ..errors import ModelError, UrdfError
from ..model.builder import Exact, Mimic, Part, Pose, assemble, identity
from ..model.model import STANDARD_GRAVITY, Cylinder, Model
from .document import parse, read_bytes
from .far_origins import Written, slid
from .findings import Finding, Report
from .strict import validate

LARGEST = float(np.finfo(np.float64).max)  # how the writer writes "no limit"


def read_urdf(path: str | os.PathLike[str], *, gravity: ArrayLike = STANDARD_GRAVITY) -> Model:
    """Read a robot from a URDF file.

    Parameters
    ----------
    path : path-like
    gravity : array_like, shape (3,)
        In the axes of the root link [m/s^2].

    Returns
    -------
    Model

    Raises
    ------
    UrdfError
        For the first mistake in the file, naming file, element and attribute.
    FileNotFoundError
        If there is no such file.

    Notes
    -----
    If a revolute joint's origin stands more than ten times the robot's size away along its axis, far origins are moved
    back along their axes, with 80 digits, so that no digit of the dynamics is lost to the levers. Links keep the file's
    frames; a joint's own frame, in which `rne.recursion` reports, is then parallel to its link's and near the robot.

    Examples
    --------
    >>> import rne
    >>> rne.read_urdf("robots/irb140.urdf") == rne.irb140()
    True
    """
    report = Report(os.fspath(path))
    root = _validated(read_bytes(path, report), report)
    report.raise_first_error()
    try:
        return _model(root, gravity)
    except UrdfError:
        raise
    except ModelError as error:
        raise UrdfError(f"{report.file}: {error}") from error


def check(path: str | os.PathLike[str], *, out: TextIO | None = None) -> list[Finding]:
    """Print everything that is wrong or odd in a URDF file, and return it.

    Parameters
    ----------
    path : path-like
    out : text stream, optional
        Where to print; standard output if not given.

    Returns
    -------
    list of Finding
        Errors keep the robot from loading; with warnings alone it loads unchanged.

    Raises
    ------
    FileNotFoundError
        If there is no such file.

    Examples
    --------
    >>> import rne
    >>> rne.check("robots/irb140.urdf")
    robots/irb140.urdf: no findings
    []
    """
    report = Report(os.fspath(path))
    root = _validated(read_bytes(path, report), report)
    if root is not None and not report.errors:
        try:
            _model(root, STANDARD_GRAVITY)
        except ModelError as error:
            report.error(None, "robot", str(error), "mend the file")
    stream = sys.stdout if out is None else out
    lines = [str(finding) for finding in report.findings] or [f"{report.file}: no findings"]
    stream.write("\n".join(lines) + "\n")
    return report.findings


def _validated(data: bytes | None, report: Report) -> Any | None:
    root = None if data is None else parse(data, report)
    if root is not None:
        validate(root, report)
    return root


def _model(root: Any, gravity: ArrayLike) -> Model:
    from lxml import etree
    from yourdfpy import URDF

    robot = URDF.load(BytesIO(etree.tostring(root)), build_scene_graph=False, load_meshes=False).robot
    links = {link.name: link for link in robot.links}
    joints = _in_tree_order(links, robot.joints)
    origins = {element.get("name"): _pose(element.find("origin")) for element in root.findall("joint")}
    elements = {element.get("name"): element for element in root.findall("link")}
    centres = {name: _pose(element.find("inertial/origin")) for name, element in elements.items()}
    root_link = _root(links, robot.joints)
    part_of_link = {root_link: 0} | {joint.child: k for k, joint in enumerate(joints, 1)}
    part_of_joint = {joint.name: k for k, joint in enumerate(joints, 1)}
    by_name = {joint.name: joint for joint in joints}
    parts = [Part(link=root_link, **_inertial(links[root_link], centres[root_link]))]
    parts += [
        Part(
            link=joint.child,
            joint=joint.name,
            kind=joint.type,
            parent=part_of_link[joint.parent],
            placement=origins[joint.name],
            axis=_unit(joint.axis),
            mimic=_mimic(joint, by_name, part_of_joint),
            **_limits(joint),
            **_inertial(links[joint.child], centres[joint.child]),
        )
        for joint in joints
    ]
    rpys = {element.get("name"): _angles(element.find("origin")) for element in root.findall("joint")}
    written = [Written((0, 0, 0), (1, 0, 0))]
    written += [Written(rpys[joint.name], (1, 0, 0) if joint.axis is None else joint.axis) for joint in joints]
    parts = slid(parts, written)
    shapes = [shape for part in parts for shape in _cylinders(links[part.link], elements[part.link])]
    return assemble(robot.name or "", parts, gravity=gravity, shapes=shapes)


def _root(links: dict[str, Any], joints: list[Any]) -> str:
    children = {joint.child for joint in joints}
    return next(link for link in links if link not in children)


def _in_tree_order(links: dict[str, Any], joints: list[Any]) -> list[Any]:
    """Repeatedly the first joint in the file whose parent link is already placed."""
    below: dict[str, list[int]] = {}
    for k, joint in enumerate(joints):
        below.setdefault(joint.parent, []).append(k)
    ready = list(below.get(_root(links, joints), []))
    order = []
    while ready:
        k = heapq.heappop(ready)
        order.append(joints[k])
        for later in below.get(joints[k].child, []):
            heapq.heappush(ready, later)
    return order


def _vector(text: str) -> Array:
    return np.array([float(token) for token in text.split()], dtype=Exact)


def _pose(origin: Any | None) -> Pose:
    """From the file's own decimals: yourdfpy's matrix is already rounded."""
    if origin is None:
        return identity()
    return Pose(rotation_from_rpy(_vector(origin.get("rpy", "0 0 0"))), _vector(origin.get("xyz", "0 0 0")))


def _angles(origin: Any | None) -> Array:
    return _vector("0 0 0" if origin is None else origin.get("rpy", "0 0 0"))


def _unit(axis: Any) -> Array:
    direction = np.array([1.0, 0.0, 0.0] if axis is None else axis, dtype=Exact)
    direction = direction / np.abs(direction).max()
    return snap((direction / np.sqrt((direction * direction).sum())).astype(np.float64))


def _inertial(link: Any, centre: Pose) -> dict[str, Any]:
    if link.inertial is None:
        return {}
    inertia = centre.R @ np.array(link.inertial.inertia, dtype=Exact) @ transpose(centre.R)
    return {"mass": link.inertial.mass, "com": centre.p, "inertia": (inertia + inertia.T) / 2}


def _limits(joint: Any) -> dict[str, Any]:
    values: dict[str, Any] = {}
    if joint.limit is not None:
        bounded = joint.type in ("revolute", "prismatic")
        values = {
            "lower": (joint.limit.lower or 0.0) if bounded else -np.inf,
            "upper": (joint.limit.upper or 0.0) if bounded else np.inf,
            "effort": np.inf if joint.limit.effort is None else joint.limit.effort,
            "velocity": np.inf if joint.limit.velocity is None else joint.limit.velocity,
        }
        values = {name: float(np.sign(x) * np.inf) if abs(x) == LARGEST else x for name, x in values.items()}
    if joint.dynamics is not None:
        values |= {name: float(getattr(joint.dynamics, name) or 0) for name in ("damping", "friction")}
    return values


def _mimic(joint: Any, by_name: dict[str, Any], part_of_joint: dict[str, int]) -> Mimic | None:
    """The free joint at the end of a chain of mimics, with multipliers and offsets composed."""
    if joint.mimic is None or joint.type == "fixed":
        return None
    multiplier, offset = Exact(1), Exact(0)
    while joint.mimic is not None:
        factor = 1.0 if joint.mimic.multiplier is None else joint.mimic.multiplier
        offset = offset + multiplier * (joint.mimic.offset or 0.0)
        multiplier = multiplier * factor
        joint = by_name[joint.mimic.joint]
    return Mimic(part_of_joint[joint.name], float(multiplier), float(offset))


def _cylinders(link: Any, element: Any) -> list[Cylinder]:
    """The visuals left after validation are all cylinders."""
    shapes = []
    for visual, written in zip(link.visuals, element.findall("visual"), strict=True):
        cylinder, origin = visual.geometry.cylinder, written.find("origin")
        xyz, rpy = (_triple(origin, name) for name in ("xyz", "rpy"))
        shapes.append(Cylinder(link.name, float(cylinder.radius), float(cylinder.length), xyz, rpy))
    return shapes


def _triple(origin: Any | None, attribute: str) -> tuple[float, float, float]:
    text = "0 0 0" if origin is None else origin.get(attribute, "0 0 0")
    x, y, z = (float(token) for token in text.split())
    return x, y, z
