"""Reading a robot from an MJCF file: MuJoCo compiles what bears on dynamics, and its tree becomes a Model."""

from __future__ import annotations

import os
import re
from collections import Counter
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from ..basics.spatial import Array, cross_matrix, rotation_about, snap, transpose, unit_vector
from ..basics.text import cut
from ..model.builder import Extended, Mimic, Part, Pose, assemble, pose
from ..model.model import Model
from .document import Element, describe, parse, read_bytes
from .findings import ECHO, FindingsReport, echo, near_path

INSTALL = "pip install 'rne[mjcf]'"
MAX_INCLUDES = 100  # files
MAKERS = ("attach", "composite", "flexcomp", "replicate")  # elements that make bodies when they are compiled
SECTIONS = ("compiler", "option", "default", "asset", "worldbody", "equality", "actuator")  # that are compiled
FILES = ("texture", "hfield", "skin", "model")  # assets that no dynamics and no picture here needs
FORCEFUL = ("tendon", "deformable", "extension", "plugin", "contact")  # what is not read, but may act on bodies
QUIET = ("site", "camera", "light", "sensor", "keyframe")  # what is not read and moves nothing
NOT_COMPILED = ("meshdir", "texturedir", "assetdir", "strippath", "fusestatic", "discardvisual", "texture")  # attributes
NAN = re.compile(r"(?:.*\s)?[+-]?nan(?:\s.*)?", re.IGNORECASE | re.DOTALL)
COMPILER = re.compile(r"(?:XML )?(?:Error: )?(.*?)(?:\nElement.* line (\d+))?\s*", re.DOTALL)  # its errors
LEFT = {  # numbers of a compiled joint that are not read
    "jnt_stiffness": "its spring ('stiffness') is not read",
    "jnt_stiffnesspoly": "the polynomial of its spring is not read",
    "dof_dampingpoly": "the polynomial of its damping is not read",
}


def mujoco_module() -> Any:
    """The package mujoco, or an ImportError with the command that installs it."""
    try:
        import mujoco
    except ImportError as error:
        raise ImportError(f"MJCF files are compiled by MuJoCo, which is not installed: {INSTALL}") from error
    return mujoco


def mjcf_model(root: Element, report: FindingsReport) -> Model | None:
    """The Model of a <mujoco>, with the file's gravity, or None with an error in the report."""
    mujoco = mujoco_module()
    name = root.get("model") or Path(report.file).stem
    m = _compiled(_for_dynamics(included(root, report), report), report)
    if m is None:
        return None
    links, joints = body_names(m), _names(m, "joint")
    for joint, kind in zip(joints, m.jnt_type, strict=True):
        if kind not in (int(mujoco.mjtJoint.mjJNT_HINGE), int(mujoco.mjtJoint.mjJNT_SLIDE)):
            message, cure = "is a free or ball joint, which is not covered", "fix the body, or write hinges and slides"
            report.error(None, f"joint {echo(joint)}", message, cure)
    if report.errors:
        return None
    _report_left(m, links, joints, report)
    gravity = m.opt.gravity * (not m.opt.disableflags & int(mujoco.mjtDisableBit.mjDSBL_GRAVITY))
    with np.errstate(all="ignore"):  # the Model reports what overflows
        parts = _parts(m, links, joints, report)
    if report.errors:
        return None
    return assemble(name, parts, gravity=gravity, source=os.path.abspath(report.file))


def included(root: Element, report: FindingsReport) -> Element:
    """The <mujoco> with the elements of all files that it includes; they are below its folder, each included once."""
    file = Path(report.file).resolve()
    folders, seen = {root: file.parent}, {file}
    while (include := root.find(".//include")) is not None:
        near = next(folders[x] for x in (include, *include.iterancestors()) if x in folders)
        places = (_below(file.parent, folder, include.get("file", "")) for folder in (near, file.parent))
        found = next(filter(None, places), None)
        if found is None or found in seen or len(seen) > MAX_INCLUDES:
            what = f"is no file below {near_path(str(file.parent))!r}" if found is None else "is included twice"
            cure = f"include files of this folder, each once, at most {MAX_INCLUDES}"
            report.error(include, "<include>", f"{echo(include.get('file', ''))} {what}", cure)
            break
        seen.add(found)
        inner = FindingsReport(str(found))
        data = read_bytes(found, inner)
        other = None if data is None else parse(data, inner)
        if other is None:
            report.findings += inner.findings
            break
        for element in other.iter():
            element.sourceline = include.sourceline
        folders |= dict.fromkeys(other, found.parent)
        for child in reversed(other):
            include.addnext(child)
        _drop(include)
    return root


def _below(main: Path, folder: Path, name: str) -> Path | None:
    """The file of a name relative to a folder, if it is there and below the main folder, links followed."""
    try:
        found = (folder / name).resolve()
        return found if not os.path.isabs(name) and found.is_relative_to(main) and found.is_file() else None
    except (OSError, ValueError):  # names that no file can have
        return None


def _drop(element: Element) -> None:
    element.getparent().remove(element)


def _for_dynamics(root: Element, report: FindingsReport) -> Element:
    """The <mujoco> without what has no bearing on the tree's dynamics; no file is needed of which it is independent."""
    for element in root.iter():
        for attribute, text in element.attrib.items():
            if NAN.fullmatch(text):
                message = f"attribute {attribute!r} must be finite, got {echo(text)}"
                report.error(element, describe(element), message, "fix the attribute")
    for element in root.iter(*MAKERS):
        cure = "load what mujoco.mj_saveLastXML writes of the compiled file"
        report.error(element, describe(element), f"<{element.tag}> makes bodies when it is compiled", cure)
    for tags, cure in (QUIET, "they are not part of the robot"), (FORCEFUL, "what they do to the bodies is missing"):
        count = {tag: sum(len(x) if x.getparent() is root else 1 for x in root.iter(tag)) for tag in tags}
        if any(count.values()):
            names = ", ".join(f"{number} of <{tag}>" for tag, number in count.items() if number)
            report.warning(None, "robot", f"not read: {names}", cure)
    for element in [*root.iterfind("equality/*"), *root.iterfind("actuator/*")]:
        if element.tag != "joint" and not {"joint", "jointinparent"} & {*element.attrib}:
            what = "constraint" if element.getparent().tag == "equality" else "drive"
            message, cure = f"is not read: the robot moves without this {what}", "leave it out"
            report.warning(element, f"<{element.tag}>", message, cure, detail=echo(element.get("name", "")))
            _drop(element)
    by_geoms = any(x.get("inertiafromgeom") == "true" for x in root.findall("compiler"))
    for geom in list(root.iterfind("worldbody//geom")):
        body = next(geom.iterancestors("body", "worldbody"))
        if body.tag == "worldbody" or (body.find("inertial") is not None and not by_geoms):
            _drop(geom)
    for mesh in _without_files(root, report):
        message = f"{echo(mesh.get('file'))} is no file below the folder of the MJCF file, and a body's inertia is of it"
        report.error(mesh, describe(mesh), message, "put it there, or give the body an <inertial>")
    return root


def _without_files(root: Element, report: FindingsReport) -> list[Element]:
    """Remove all that is not compiled, and give the meshes that geoms use the paths of their files; those not found."""
    for element in [*(x for x in root if x.tag not in SECTIONS), *root.iter(*QUIET[:3], "plugin", *FILES, "layer")]:
        _drop(element)
    compiler = {name: text for x in root.findall("compiler") for name, text in x.attrib.items()}
    folder, main = compiler.get("meshdir", compiler.get("assetdir", "")), Path(report.file).resolve().parent
    used, lost = {geom.get("mesh") for geom in root.iter("geom")}, []
    for mesh in root.findall("asset/mesh[@file]"):
        place = mesh.get("file")
        if compiler.get("strippath") == "true":
            place = re.split(r"[/\\]", place)[-1]
        mesh.set("name", mesh.get("name") or Path(place).stem)
        found = None if os.path.isabs(folder) else _below(main, main, os.path.join(folder, place))
        if mesh.get("name") not in used:
            _drop(mesh)
        elif found is None:
            lost.append(mesh)
        else:
            mesh.set("file", str(found))
    for element in root.iter():
        for attribute in NOT_COMPILED:
            element.attrib.pop(attribute, None)
    return lost


def _compiled(root: Element, report: FindingsReport) -> Any | None:
    """MuJoCo's compiled model, or None with an error."""
    from lxml import etree

    if report.errors:
        return None
    elements = list(root.iter())
    for element in elements:  # each begins a line of its own, by which MuJoCo's errors are traced to the file
        element.text = "\n" if len(element) else None
        element.tail = "\n" if element.getnext() is not None else None
    try:
        return mujoco_module().MjModel.from_xml_string(etree.tostring(root, encoding="unicode"))
    except ValueError as error:
        found = COMPILER.fullmatch(str(error))
        text, line = found.groups() if found else (str(error), None)
        element = elements[int(line) - 1] if line and int(line) <= len(elements) else None
        where = "file" if element is None else describe(element)
        report.error(element, where, f"MuJoCo's compiler says: {cut(' '.join(text.split()), ECHO)}", "fix the file")
    return None


def _names(m: Any, kind: str) -> list[str]:
    """Names of a compiled model's bodies or joints; those without have their number."""
    count, at = (m.nbody, m.name_bodyadr) if kind == "body" else (m.njnt, m.name_jntadr)
    names = [m.names[at[k] :].split(b"\0", 1)[0].decode() for k in range(count)]
    return [name or _unused(f"{kind}_{k}", names) for k, name in enumerate(names)]


def body_names(m: Any) -> list[str]:
    """Names of the links that a compiled model's bodies become."""
    return _names(m, "body")


def _unused(name: str, names: list[str]) -> str:
    while name in names:
        name += "_"
    return name


def _rotation(quaternion: Array) -> Array:
    w, v = np.split(quaternion.astype(Extended) / np.sqrt((quaternion.astype(Extended) ** 2).sum()), [1])
    V = cross_matrix(v)
    return np.eye(3) + 2 * (w * V + V @ V)


def _parts(m: Any, links: list[str], joints: list[str], report: FindingsReport) -> list[Part]:
    """The bodies in MuJoCo's order, each with a part for every joint of it, all but the last massless.

    A joint's frame has its origin on the joint's axis, nearest to the body's. If that is another point than the
    body's origin, the body is a part of its own that is fixed to the joint's.
    """
    parts = [Part(link=links[0])]
    part_of, part_of_joint = [0], list[int]()
    taken, fixed = list(links), list(joints)
    for b in range(1, m.nbody):
        parent, place = part_of[m.body_parentid[b]], Pose(_rotation(m.body_quat[b]), m.body_pos[b].astype(Extended))
        R = _rotation(m.body_iquat[b])
        inertia = R @ np.diag(m.body_inertia[b].astype(Extended)) @ transpose(R)
        body: dict[str, Any] = {"mass": float(m.body_mass[b]), "com": m.body_ipos[b].astype(Extended)}
        body |= {"link": links[b], "inertia": (inertia + inertia.T) / 2}
        own = range(m.body_jntadr[b], m.body_jntadr[b] + m.body_jntnum[b])
        carried = False
        for j in own:
            foot, zero, joint = _joint(m, j, joints[j], report)
            carried = j == own[-1] and not foot.any()
            if not carried:
                taken.append(_unused(joints[j], taken))
            placement = place.then(Pose(zero.R, foot + zero.p))
            part_of_joint.append(len(parts))
            parts.append(Part(parent=parent, placement=placement, **joint, **(body if carried else {"link": taken[-1]})))
            parent, place = len(parts) - 1, pose(np.eye(3), -foot)
        if not carried:
            fixed.append(_unused(f"{links[b]}_fixed", fixed))
            parts.append(Part(parent=parent, placement=place, joint=fixed[-1], **body))
        part_of.append(len(parts) - 1)
    for j, (other, factor, offset) in _mimics(m, joints, report).items():
        k = part_of_joint[j]
        parts[k] = replace(parts[k], mimic=Mimic(part_of_joint[other], factor, offset))
    return parts


def _joint(m: Any, j: int, name: str, report: FindingsReport) -> tuple[Array, Pose, dict[str, Any]]:
    """Of a hinge or slide: the foot of its axis and its pose at q = 0 in the body's frame at q = ref, and the rest."""
    axis, ref = unit_vector(m.jnt_axis[j].astype(Extended)), Extended(m.qpos0[j])
    lower, upper = m.jnt_range[j].tolist() if m.jnt_limited[j] else (-np.inf, np.inf)
    joint = {"joint": name, "axis": snap(axis.astype(np.float64)), "lower": lower, "upper": upper}
    drives = [a for a in range(len(m.actuator_trnid)) if m.actuator_trnid[a, 0] == j]
    of_drives = {  # MuJoCo 4 has these for actuators too
        x: sum(m.actuator_gear[a, 0] ** 2 * getattr(m, f"actuator_{x}", {a: 0.0})[a] for a in drives)
        for x in ("armature", "damping")
    }
    joint |= {x: float(getattr(m, f"dof_{x}")[j] + value) for x, value in of_drives.items()}
    joint |= {"friction": float(m.dof_frictionloss[j]), "effort": _effort(m, j, drives, name, report)}
    if m.jnt_type[j] == int(mujoco_module().mjtJoint.mjJNT_SLIDE):
        return np.zeros(3), Pose(np.eye(3, dtype=Extended), -ref * axis), joint | {"kind": "prismatic"}
    origin = m.jnt_pos[j].astype(Extended)
    foot = snap(origin - axis * (axis @ origin))
    return foot, Pose(rotation_about(axis, -ref), np.zeros(3)), joint | {
        "kind": "revolute" if m.jnt_limited[j] else "continuous"
    }


def _effort(m: Any, j: int, drives: list[int], name: str, report: FindingsReport) -> float:
    """The largest torque or force of a joint's drive where the file says one, otherwise infinite."""
    ranges = [m.jnt_actfrcrange[j]] if m.jnt_actfrclimited[j] else []
    for a in drives[:1]:
        gear, is_motor = m.actuator_gear[a, 0], not (m.actuator_gaintype[a] or m.actuator_biastype[a])  # fixed, none
        if m.actuator_forcelimited[a]:
            ranges.append(gear * m.actuator_forcerange[a])
        if is_motor and not m.actuator_dyntype[a] and m.actuator_ctrllimited[a]:
            ranges.append(gear * m.actuator_gainprm[a, 0] * m.actuator_ctrlrange[a])
    if drives[1:] and not m.jnt_actfrclimited[j]:
        ranges = [np.array([-np.inf, 0.0])]
    if any(low != -high for low, high in ranges):
        message = "its drives have other limits than one number for both directions, which are not read"
        report.warning(None, f"joint {echo(name)}", message, "give `effort` to rne.load")
        return np.inf
    return float(min((abs(high) for _, high in ranges), default=np.inf))


def _mimics(m: Any, joints: list[str], report: FindingsReport) -> dict[int, tuple[int, float, float]]:
    """Of each dependent joint: the independent one, multiplier and offset, composed along chains.

    MuJoCo's constraint is y - y0 = a0 + a1 (x - x0) + ... with y0 and x0 the joints' `ref`.
    """
    written: dict[int, tuple[int, Any, Any]] = {}
    for y, x, a, active in zip(m.eq_obj1id, m.eq_obj2id, m.eq_data[:, :5], m.eq_active0, strict=True):
        if active and x >= 0 and not a[2:].any() and y not in written:
            a0, a1 = a[:2].astype(Extended)
            written[int(y)] = int(x), a1, m.qpos0[y] + a0 - a1 * m.qpos0[x]
        else:
            message = "an <equality> that is no active straight line of one other joint is not read"
            report.warning(None, f"joint {echo(joints[y])}", message, "the joint moves freely: rne.model can couple it")
    composed = {}
    for y, (x, factor, offset) in written.items():
        passed = {y}
        while x in written and x not in passed:
            passed.add(x)
            x, inner, constant = written[x]
            factor, offset = factor * inner, factor * constant + offset
        if x in passed:
            report.error(None, f"joint {echo(joints[y])}", "<equality> couples joints in a circle", "remove one of them")
        composed[y] = x, float(factor), float(offset)
    return composed


def _report_left(m: Any, links: list[str], joints: list[str], report: FindingsReport) -> None:
    """Warn of what the compiled model has and the robot has not."""
    for array, message in LEFT.items():
        for j, values in enumerate(getattr(m, array, ())):
            if np.any(values):
                report.warning(None, f"joint {echo(joints[j])}", message, "add it to the scene")
    for j in sorted({*m.actuator_trnid[:, 0].tolist()}):
        message = "gear, gains and dynamics of its actuator are not read"
        report.warning(None, f"joint {echo(joints[j])}", message, "torques are those of the joint")
    for b in np.flatnonzero(m.body_gravcomp).tolist():
        message = "'gravcomp' is not read"
        report.warning(None, f"link {echo(links[b])}", message, "gravity acts on the link in full")
    if m.opt.density or m.opt.viscosity:
        report.warning(None, "robot", "density and viscosity of the medium are not read", "forces of it are missing")
    if m.nmocap:
        report.warning(None, "robot", "bodies that motion capture would move are fixed", "remove them")
