"""Reading of URDF files: strictly validated, then every number from the file's own decimals."""

from __future__ import annotations

import heapq
import os
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..basics.spatial import Array, dot, rotate, rotate_back, rotation_from_rpy, snap, transpose, unit_vector
from ..errors import ModelError, UrdfError
from ..model.builder import Extended, Mimic, Part, Pose, assemble, composed
from ..model.checks import DRIVES
from ..model.model import REVOLUTE_TYPES, STANDARD_GRAVITY, Model
from ..model.solids import Box, Cylinder
from .document import LARGEST, NO_LIMIT, Element, checked_numbers, parse, read_bytes
from .findings import FindingsReport
from .rotors import rotors_of
from .strict import link_of, mimics_of, shape_errors, validate

# Joint origins are moved only if one is farther out along its axis than this many times the robot's size; then all that
# are farther out than the size. In example-robot-data the farthest is 1.04 sizes out.
FAR = 10


def read_urdf(path: str | os.PathLike[str], *, gravity: ArrayLike = STANDARD_GRAVITY) -> Model:
    """Read a robot from a URDF file.

    Parameters
    ----------
    path : path-like
        The file.
    gravity : array_like, shape (3,)
        In the axes of the root link [m/s^2].

    Returns
    -------
    Model
        For `rne.Robot` and the functions of a model.

    Raises
    ------
    UrdfError
        For the first error in the file, with its element and attribute, and the number of other errors.
    FileNotFoundError
        If there is no such file.

    Notes
    -----
    If the origin of a revolute joint is farther out along its axis than ten times the robot's size, far origins are
    moved back along their axes in long double, because a long lever arm costs digits of the dynamics. For a robot of
    about a metre, errors stay at a few roundings up to 1e4 m; at 1e6 m inverse dynamics and M have a relative accuracy
    of 1.5e-13. Links keep the file's frames; a joint's own frame, used by `rne.dynamics.recursion`, is then parallel to
    its link's and near the robot.

    Examples
    --------
    >>> import rne
    >>> rne.read_urdf("robots/irb140.urdf") == rne.irb140()
    True
    """
    report = FindingsReport(os.fspath(path))
    root = validated(read_bytes(path, report), report)
    return loaded(root, report, gravity, os.path.abspath(path))


def loaded(root: Element | None, report: FindingsReport, gravity: ArrayLike, source: str) -> Model:
    """Model of a <robot>, or the UrdfError of the report's first error or of impossible numbers."""
    report.raise_first_error()
    try:
        return model_of(root, gravity, source)
    except ModelError as error:
        raise UrdfError(f"{report.file}: {error}") from error


def validated(data: bytes | None, report: FindingsReport) -> Element | None:
    """Element <robot> of a file's bytes, or None with a finding."""
    root = None if data is None else parse(data, report)
    return root if root is not None and validate(root, report) else None


def model_of(root: Element, gravity: ArrayLike, source: str | None = None) -> Model:
    """Model of a validated <robot>."""
    links, joints = _in_tree_order(root)
    unrounded = [(_vector(_numbers(joint, "origin")["rpy"]), _axis(joint)) for joint in joints]
    shapes = [shape for link in links.values() for shape in _shapes(link)]
    parts = slide_far_origins(parts_of(root), unrounded)
    return assemble(root.get("name", ""), parts, gravity=gravity, shapes=shapes, source=source)


def parts_of(root: Element) -> list[Part]:
    """Links of a validated <robot> in tree order, each with its joint, as the file places them."""
    links, joints = _in_tree_order(root)
    root_link = next(iter(links))
    part_of_link = {root_link: 0} | {link_of(joint, "child"): k for k, joint in enumerate(joints, 1)}
    part_of_joint = {joint.get("name"): k for k, joint in enumerate(joints, 1)}
    written = {
        part_of_joint[name]: Mimic(part_of_joint[x.get("joint")], **_numbers(x.getparent(), "mimic"))
        for name, x in mimics_of(joints).items()
    }
    mimics = composed(written)
    rotors = rotors_of(root, FindingsReport(""))
    parts = [Part(link=root_link, **_inertial(links[root_link]))]
    for joint in joints:
        child = str(link_of(joint, "child"))
        part = Part(
            link=child,
            joint=joint.get("name"),
            kind=joint.get("type"),
            parent=part_of_link[link_of(joint, "parent")],
            placement=_pose(joint),
            axis=snap(_axis(joint).astype(np.float64)),
            mimic=mimics.get(len(parts)),
            armature=rotors.get(joint.get("name"), 0.0),
            **_limits_and_friction(joint),
            **_inertial(links[child]),
        )
        parts.append(part)
    return parts


def _in_tree_order(root: Element) -> tuple[dict[str, Element], list[Element]]:
    """Links by name and joints in tree order: repeatedly the first joint whose parent link is already placed."""
    links, joints = {link.get("name"): link for link in root.findall("link")}, root.findall("joint")
    children = {link_of(joint, "child") for joint in joints}
    root_link = next(link for link in links if link not in children)
    below: dict[str | None, list[int]] = {}
    for k, joint in enumerate(joints):
        below.setdefault(link_of(joint, "parent"), []).append(k)
    ready = list(below.get(root_link, []))
    order = []
    while ready:
        k = heapq.heappop(ready)
        order.append(joints[k])
        for later in below.get(link_of(joints[k], "child"), []):
            heapq.heappush(ready, later)
    return {name: links[name] for name in (root_link, *(str(link_of(j, "child")) for j in order))}, order


def _numbers(parent: Element, tag: str) -> dict[str, Any]:
    """Numbers of a validated child by attribute, with defaults where it or an attribute is missing."""
    return checked_numbers(parent, tag, "", FindingsReport(""))


def _vector(numbers: Any) -> Array:
    return np.array(numbers, dtype=Extended)


def _pose(element: Element) -> Pose:
    origin = _numbers(element, "origin")
    return Pose(rotation_from_rpy(_vector(origin["rpy"])), _vector(origin["xyz"]))


def _axis(joint: Element) -> Array:
    """Unit vector of a joint's axis in long double."""
    axis = {} if joint.get("type") == "fixed" else _numbers(joint, "axis")
    return unit_vector(_vector(axis.get("xyz", [1, 0, 0])))


def _inertial(link: Element) -> dict[str, Any]:
    """Mass, centre of mass, and inertia about it in the axes of the link."""
    inertial = link.find("inertial")
    if inertial is None:
        return {}
    centre, entries = _pose(inertial), _numbers(inertial, "inertia")
    written = _vector([[entries[f"i{min(a, b)}{max(a, b)}"] for b in "xyz"] for a in "xyz"])
    inertia = centre.R @ written @ transpose(centre.R)
    mass = _numbers(inertial, "mass")["value"]
    return {"mass": mass, "com": centre.p, "inertia": (inertia + inertia.T) / 2}


def _limits_and_friction(joint: Element) -> dict[str, Any]:
    """Limits, damping and friction of a joint: infinite without <limit>; missing lower or upper is 0, as in URDF."""
    limit, values = joint.find("limit"), _numbers(joint, "dynamics")
    if limit is None:
        return values
    ends = ("lower", "upper") if joint.get("type") in ("revolute", "prismatic") else ()
    for name, x in _numbers(joint, "limit").items():
        if name in ends or (name in DRIVES and name in limit.attrib and x != NO_LIMIT):
            values[name] = float(np.copysign(np.inf, x)) if abs(x) == LARGEST else x
    return values


def _shapes(link: Element) -> list[Cylinder | Box]:
    """Cylinders and boxes of a link's visuals."""
    shapes: list[Cylinder | Box] = []
    for visual in link.findall("visual"):
        cylinder, box = visual.find("geometry/cylinder"), visual.find("geometry/box")
        if (cylinder is None and box is None) or shape_errors(visual):
            continue
        xyz, rpy = (tuple(numbers) for numbers in _numbers(visual, "origin").values())
        geometry = visual.find("geometry")
        if cylinder is not None:
            shapes.append(Cylinder(link.get("name"), **_numbers(geometry, "cylinder"), position=xyz, rpy=rpy))
        else:
            shapes.append(Box(link.get("name"), tuple(_numbers(geometry, "box")["size"]), xyz, rpy))
    return shapes


def slide_far_origins(parts: list[Part], unrounded: Sequence[tuple[Array, Array]]) -> list[Part]:
    """Parts with joint origins that are far out along the joint's axis moved back to the robot.

    A revolute joint's frame may have its origin anywhere on the joint's axis, but a lever of 1e6 m costs six digits in
    M and twelve in articulated-body dynamics. Origins are moved in long double, with roll, pitch and yaw [rad] and unit
    axis of each joint in `unrounded` as the file has them, not snapped: the error is 1e-19 of the distance, or 1e-16
    where long double is no wider than double. Links keep the frames of the file (`Part.link_origin`). `read_urdf` tells
    the accuracy; at 1e6 m forward dynamics are accurate to 4e-12, that of M times its condition. If no origin is far,
    `parts` is returned itself.
    """
    with np.errstate(all="ignore"):  # numbers near the largest double overflow here; the Model reports them
        distances = far_origins(parts)
    return _slid(parts, unrounded, distances) if any(distances) else parts


def far_origins(parts: Sequence[Part]) -> list[float]:
    """Distance to move each joint's origin along its axis; 0 for those that stay, in ordinary robots all [m]."""
    poses: list[Pose] = []  # in the root's frame, all joints at zero
    for part in parts:
        poses.append(poses[part.parent].then(part.placement) if part.parent >= 0 else part.placement)
    origins = [p for _, p in poses]
    axes = [rotate(R, part.axis.astype(Extended)) for part, (R, _) in zip(parts, poses, strict=True)]
    coms = [p + rotate(R, part.com.astype(Extended)) for part, (R, p) in zip(parts, poses, strict=True)]
    masses = [Extended(part.mass) for part in parts]
    firsts = [m * c for m, c in zip(masses, coms, strict=True)]
    sizes = []  # of bodies, squared [m^2]
    slides: list[float] = [0.0] * len(parts)
    centre = sum(firsts[1:], np.zeros(3)) / (sum(masses[1:]) or 1)
    for k in reversed(range(1, len(parts))):
        part, parent = parts[k], parts[k].parent
        if part.mass:
            spread = coms[k] - centre
            sizes += [dot(spread, spread), np.trace(part.inertia) / masses[k]]
        if part.kind in REVOLUTE_TYPES and masses[k] > 0:
            lever = firsts[k] / masses[k] - origins[k]
            slides[k] = float(dot(axes[k], lever))
            across = lever - slides[k] * axes[k]
            sizes.append(dot(across, across))
        masses[parent] = masses[parent] + masses[k]
        firsts[parent] = firsts[parent] + firsts[k]
    reach = np.sqrt(max(sizes, default=Extended(0)))
    if not any(abs(s) > FAR * reach > 0 for s in slides) or not np.isfinite(slides).all():
        return [0.0] * len(parts)
    return [s if abs(s) > reach else 0.0 for s in slides]


def _slid(parts: list[Part], unrounded: Sequence[tuple[Array, Array]], distances: Sequence[float]) -> list[Part]:
    shifts: list[Array] = [np.zeros(3, dtype=Extended) for _ in parts]  # of each part's frame, in its own axes
    moved = [parts[0]]
    for k, (part, (rpy, axis)) in enumerate(zip(parts[1:], unrounded, strict=True), 1):
        R = rotation_from_rpy(rpy, snapped=False)  # 4 eps of a double are 1e-9 m at a million metres
        p, above = part.placement.p, shifts[part.parent]
        if distances[k]:
            shifts[k] = distances[k] * axis
        elif part.kind == "fixed" and any(above):  # a fixed link's frame moves to the near origin of its body
            shifts[k] = rotate_back(R, above - p)
        shift = shifts[k]
        if any(shift) or any(above):
            place = Pose(part.placement.R, p + rotate(R, shift) - above)
            part = replace(part, placement=place, com=part.com - shift, link_origin=-shift)
        moved.append(part)
    return moved
