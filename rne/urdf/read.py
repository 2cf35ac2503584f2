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
from .document import LARGEST, NO_LIMIT, Element, parse, read_bytes
from .findings import FindingsReport
from .rotors import rotors_of
from .strict import link_of, mimics_of, shape_errors, validate

# Origins stay where they are unless one is farther out along its axis than this many times the robot's size; then all
# are slid that are farther out than the robot is large. In example-robot-data the farthest is 1.04 sizes out.
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
        For the first error in the file, naming file, element and attribute, and how many more there are.
    FileNotFoundError
        If there is no such file.

    Notes
    -----
    If the origin of a revolute joint is farther out along its axis than ten times the robot's size, far origins are
    moved back along their axes in long double, because a long lever arm costs digits of the dynamics. For a robot of
    about a metre, this costs no more than a few roundings up to 1e4 m, while at 1e6 m inverse dynamics and M have a
    relative accuracy of 1.5e-13. Links keep the file's frames; a joint's own frame, in which `rne.dynamics.recursion`
    reports, is then parallel to its link's and near the robot.

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
    unrounded = [(_origin(element, "rpy"), _axis(element)) for element in (root, *joints)]
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
        part_of_joint[name]: Mimic(part_of_joint[x.get("joint")], _number(x, "multiplier", 1), _number(x, "offset", 0))
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


def _vector(text: str) -> Array:
    return np.array([float(token) for token in text.split()], dtype=Extended)


def _number(element: Element | None, attribute: str, default: float) -> float:
    return default if element is None else float(element.get(attribute, default))


def _origin(element: Element, attribute: str) -> Array:
    """Vector xyz or rpy of the element's <origin>."""
    origin = element.find("origin")
    return _vector("0 0 0" if origin is None else origin.get(attribute, "0 0 0"))


def _pose(element: Element) -> Pose:
    return Pose(rotation_from_rpy(_origin(element, "rpy")), _origin(element, "xyz"))


def _axis(joint: Element) -> Array:
    """Unit vector of a joint's axis in long double."""
    axis = None if joint.get("type") == "fixed" else joint.find("axis")
    return unit_vector(_vector("1 0 0" if axis is None else axis.get("xyz")))


def _inertial(link: Element) -> dict[str, Any]:
    """Mass, centre of mass, and inertia about it in the axes of the link."""
    inertial = link.find("inertial")
    if inertial is None:
        return {}
    centre, entries = _pose(inertial), inertial.find("inertia")
    written = _vector(" ".join(entries.get(f"i{min(a, b)}{max(a, b)}") for a in "xyz" for b in "xyz")).reshape(3, 3)
    inertia = centre.R @ written @ transpose(centre.R)
    mass = float(inertial.find("mass").get("value"))
    return {"mass": mass, "com": centre.p, "inertia": (inertia + inertia.T) / 2}


def _limits_and_friction(joint: Element) -> dict[str, Any]:
    """Limits, damping and friction of a joint: infinite without <limit>; missing lower or upper is 0, as in URDF."""
    limit, friction = joint.find("limit"), {x: _number(joint.find("dynamics"), x, 0.0) for x in ("damping", "friction")}
    if limit is None:
        return friction
    drives = {x: _number(limit, x, np.inf) for x in DRIVES}
    values = {name: np.inf if x == NO_LIMIT else x for name, x in drives.items()}
    if joint.get("type") in ("revolute", "prismatic"):
        values |= {name: _number(limit, name, 0.0) for name in ("lower", "upper")}
    return friction | {name: float(np.copysign(np.inf, x)) if abs(x) == LARGEST else x for name, x in values.items()}


def _shapes(link: Element) -> list[Cylinder | Box]:
    """Cylinders and boxes of a link's visuals."""
    shapes: list[Cylinder | Box] = []
    for visual in link.findall("visual"):
        cylinder, box = visual.find("geometry/cylinder"), visual.find("geometry/box")
        if (cylinder is None and box is None) or shape_errors(visual):
            continue
        xyz, rpy = (tuple(_origin(visual, name).astype(float).tolist()) for name in ("xyz", "rpy"))
        if cylinder is not None:
            radius, length = (float(cylinder.get(name)) for name in ("radius", "length"))
            shapes.append(Cylinder(link.get("name"), radius, length, xyz, rpy))
        else:
            shapes.append(Box(link.get("name"), tuple(_vector(box.get("size")).astype(float).tolist()), xyz, rpy))
    return shapes


def slide_far_origins(parts: list[Part], unrounded: Sequence[tuple[Array, Array]]) -> list[Part]:
    """Parts with joint origins that are far out along the joint's axis moved back to the robot.

    A revolute joint's frame may have its origin anywhere on the joint's axis: the robot is the same. But a lever of
    1e6 m costs six digits in M and twelve in articulated-body dynamics. Such origins are slid in long double and from
    the file's own numbers: `unrounded` has each part's roll, pitch and yaw [rad] and unit axis, nothing snapped. Links
    keep the frames they have in the file (`Part.link_origin`). If no origin is far, `parts` is returned itself.

    A joint is moved off its axis by about one rounding of long double, 1e-19 of the distance slid. Measured on robots
    of about a metre against 50 digits, errors stay at a few roundings of double for distances up to 1e4 m; at 1e6 m
    inverse dynamics and M are accurate to 1.5e-13, and forward dynamics to 4e-12, the same error times the condition of
    M. Where long double is no wider than double, an origin slid by 1e6 m is accurate to about 1e-10 m, as the file is.
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
    for k, part in enumerate(parts[1:], 1):
        rpy, axis = unrounded[k]
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
