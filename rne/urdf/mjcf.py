"""Reading of MJCF files: MuJoCo compiles the parts relevant to dynamics, and its tree becomes a Model."""

from __future__ import annotations

import math
import os
import re
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import replace
from operator import attrgetter
from pathlib import Path
from typing import Any

import numpy as np

from ..basics.spatial import Array, cross_matrix, rotation_about, snap, transpose, unit_vector
from ..basics.text import cut
from ..errors import ModelError
from ..model.builder import Extended, Mimic, Part, Pose, assemble, composed, pose
from ..model.model import Model
from .angles import read_angles
from .document import MAX_BYTES, Element, attribute_numbers, below, describe, parse, read_bytes
from .findings import ECHO, FindingsReport, echo, some

MAX_INCLUDES = 100  # most included files
MAX_ELEMENTS = 20_000  # most compiled elements: the time of some grows quadratically
MAX_MESHES = 2**27  # largest size of all mesh files [bytes]
MAX_MADE, LEAST_MADE = 300_000, 2_500  # most vertices of all meshes that MuJoCo generates; vertices of a sphere
SECTIONS = ("compiler", "option", "default", "asset", "worldbody", "equality", "actuator")  # sections that are compiled
OTHERS = ("contact", "custom", "deformable", "extension", "keyframe", "sensor", "size", "statistic", "tendon", "visual")
EQUALITIES = ("connect", "weld", "joint", "tendon", "flex", "flexvert", "flexstrain")
UNUSED = ("visual", "statistic", "size", "custom", "texture", "hfield", "skin", "model", "layer", "lengthrange")
MAKERS = ("attach", "composite", "flexcomp", "replicate")  # elements that create bodies when compiled
NOT_COMPILED = ["meshdir", "texturedir", "assetdir", "strippath", "fusestatic", "discardvisual"]  # attributes
NOT_COMPILED += ["texture", "user", "actdim", "nsample", "interp", "delay"]  # and sizes of what nothing reads
NAN = re.compile(r"(?:.*\s)?[+-]?nan(?:\s.*)?", re.IGNORECASE | re.DOTALL)
COMPILER = re.compile(r"(?:XML )?(?:Error: )?(.*?)(?:\nElement.* line (\d+))?\s*", re.DOTALL)  # its errors
TENDONS = {"stiffness": "spring", "damping": "damper", "frictionloss": "source of friction", "armature": "rotor"}
OFF = {  # arrays of a compiled model that a flag of <option> takes out of MuJoCo's equations
    "mjDSBL_EQUALITY": "eq_active0",
    "mjDSBL_FRICTIONLOSS": "dof_frictionloss",
    "mjDSBL_SPRING": "jnt_stiffness",
    "mjDSBL_DAMPER": "dof_damping",
    "mjDSBL_GRAVITY": "opt.gravity",
}
LEFT = {  # numbers of compiled joints and bodies that are not read
    "jnt_stiffnesspoly": ("joint", "the polynomial of its spring is not read", "torques of it are missing"),
    "dof_dampingpoly": ("joint", "the polynomial of its damping is not read", "torques of it are missing"),
    "body_gravcomp": ("body", "'gravcomp' is not read", "gravity acts on it in full"),
}


def mjcf_model(root: Element, report: FindingsReport, *, round_angles: bool = False) -> Model | None:
    """Model of a <mujoco>, with the file's gravity, or None with an error in the report."""
    name = root.get("model") or Path(report.file).stem
    root = _for_dynamics(included(root, report), report)
    if _settings(root).get("angle") == "radian":  # decimal degrees have their multiples of 15 exactly
        read_angles(_turned(root), "euler", report, rounded=round_angles)
    m = _compiled(root, report)
    if m is None:
        return None
    for flag, array in OFF.items():
        if m.opt.disableflags & int(getattr(_mujoco().mjtDisableBit, flag, 0)):
            attrgetter(array)(m)[:] = 0
    _report_left(m, report)
    try:
        with np.errstate(all="ignore"):  # the Model reports what overflows
            parts = [] if report.errors else _parts(m, report)
        source = os.path.abspath(report.file)
        return None if report.errors else assemble(name, parts, gravity=m.opt.gravity, source=source)
    except ModelError as error:
        report.error(None, "robot", str(error), "fix the file")
    return None


def drawn(file: str) -> tuple[Any, list[str]]:
    """Compiled model of a file with its geoms, and the missing meshes."""
    report = FindingsReport(file)
    root: Any = parse(read_bytes(file, report) or b"", report)
    report.raise_first_error()
    included(root, report)
    lost = [mesh.get("name") for mesh in _without_files(root, report)]
    for geom in [x for x in root.iter("geom") if x.get("mesh") in lost]:
        geom.getparent().remove(geom)
    m = _compiled(root, report)
    report.raise_first_error()
    return m, lost


def _settings(root: Element) -> dict[str, str]:
    """Attributes of all <compiler> elements, of which the last counts."""
    return {name: text for x in root.findall("compiler") for name, text in x.attrib.items()}


def _turned(root: Element) -> Iterator[tuple[str, Element]]:
    """Elements turned by Euler angles, each with the body that it is or belongs to as text."""
    for element in root.iterfind(".//*[@euler]"):
        name = element.xpath("string(ancestor-or-self::body[1]/@name)")
        yield f"link {echo(name)}" if name else describe(element), element


def _mujoco() -> Any:
    try:
        import mujoco
    except ImportError as error:
        message = "MJCF files are compiled by MuJoCo, which is not installed: pip install 'rne[mjcf]'"
        raise ImportError(message, name="mujoco") from error
    return mujoco


def included(root: Element, report: FindingsReport) -> Element:
    """Element <mujoco> with the elements of all included files, which are below its folder, each included once."""
    file = Path(report.file).resolve()
    folders, seen, size = {root: file.parent}, {file}, 0
    while (include := root.find(".//include")) is not None:
        near = next(folders[x] for x in (include, *include.iterancestors()) if x in folders)
        places = (below(folder / include.get("file", ""), file.parent) for folder in (file.parent, near))
        found = next(filter(None, places), None)
        if found is None or found in seen or len(seen) > MAX_INCLUDES:
            what = "is no file below that of the MJCF file" if found is None else "is included twice"
            cure = f"include files of its folder, each once, at most {MAX_INCLUDES}"
            report.error(include, "<include>", f"{echo(include.get('file', ''))} {what}", cure)
            break
        seen.add(found)
        inner = FindingsReport(str(found))
        data = read_bytes(found, inner) or b""
        other, size = parse(data, inner), size + len(data)
        if size > MAX_BYTES:
            inner.error(None, "file", f"makes the files included larger than {MAX_BYTES} bytes", "include less")
        if inner.errors or other is None:
            report.findings += inner.findings
            break
        for element in other.iter():
            element.sourceline = include.sourceline
        folders |= dict.fromkeys(other, found.parent)
        for child in reversed(other):
            include.addnext(child)
        include.getparent().remove(include)
    _check_elements(root, report)
    return root


def _check_elements(root: Element, report: FindingsReport) -> None:
    """Report unknown names, namespaces (which would hide elements from the checks), generators of bodies, and NaN."""
    for element in (*root.xpath("*"), *root.xpath("equality/*")):  # the compiler does not get all of these
        if element.tag not in (EQUALITIES if element.getparent() is not root else SECTIONS + OTHERS):
            what = f"<{cut(element.tag, ECHO)}> is no element of MJCF in <{element.getparent().tag}>"
            report.error(element, describe(element), what, "correct its name")
    for element in root.iter():
        if spaced := [name for name in (element.tag, *element.attrib) if "{" in name or ":" in name]:
            cure = "MJCF has no namespaces: remove xmlns and prefixes"
            report.error(element, describe(element), f"the name {echo(spaced[0])} has a namespace", cure)
        if element.tag in MAKERS:
            cure = "load what mujoco.mj_saveLastXML writes of the compiled file"
            report.error(element, describe(element), f"<{element.tag}> makes bodies when it is compiled", cure)
        for attribute, text in element.attrib.items():
            if NAN.fullmatch(text):
                message = f"attribute {attribute!r} must be finite, got {echo(text)}"
                report.error(element, describe(element), message, "fix the attribute")


def _for_dynamics(root: Element, report: FindingsReport) -> Element:
    """Element <mujoco> without what does not affect the tree's dynamics, so that unneeded files may be missing."""
    _report_missing(root, report)
    by_geoms = any(x.get("inertiafromgeom") == "true" for x in root.findall("compiler"))
    weighed = set() if by_geoms else {x.getparent() for x in root.iter("inertial")}
    for geom in list(root.iterfind("worldbody//geom")):
        geom.attrib.update({"contype": "0", "conaffinity": "0"})  # no convex hulls, which only contacts need
        body = next(geom.iterancestors("body", "worldbody"), root)  # in another geom that is removed: none
        if body.tag == "worldbody" or body in weighed:
            geom.getparent().remove(geom)
    for mesh in _without_files(root, report):
        message = f"{echo(mesh.get('file'))} is no file below that of the MJCF file, and a body's inertia is of it"
        report.error(mesh, describe(mesh), message, "put it there, or give the body an <inertial>")
    return root


def _report_missing(root: Element, report: FindingsReport) -> None:
    """Report constraints of bodies; report and remove tendons that exert forces, also by defaults of their class."""
    for held in root.xpath("equality/*[self::connect or self::weld or self::tendon][not(@active='false')]"):
        cure = "close a loop by rne.model.four_bar, slider_crank, cylinder or coupled, or lock joints"
        report.warning(held, describe(held), "its constraint is missing, the bodies move freely", cure)
    classes: dict[str | None, Element] = {x.get("class"): x for x in reversed([*root.iter("default")])}
    classes[None] = root.find("default")
    for tendon in root.xpath("tendon/*"):
        default, stated = classes.get(tendon.get("class")), [tendon.attrib]
        while default is not None and default.tag == "default":
            stated += [x.attrib for x in default.findall("tendon")]
            default = default.getparent()
        found = [(name, what, next((x[name] for x in stated if name in x), "")) for name, what in TENDONS.items()]
        if acts := [f"{what} ({name} {echo(value)})" for name, what, value in found if value.strip("0. ")]:
            message = f"is a {' and '.join(acts)} that is missing from all torques"
            cure = "add rne.Spring, or a law with its torques, to a scene"
            report.warning(tendon, f"tendon {echo(tendon.get('name', ''))}", message, cure)
            tendon.getparent().remove(tendon)
    for section in root.xpath("tendon[not(*)]"):
        root.remove(section)


def _without_files(root: Element, report: FindingsReport) -> list[Element]:
    """Remove what is not compiled, and give meshes of geoms the paths of their files; returns the missing ones."""
    others = [x for x in root if x.tag not in SECTIONS]
    acting = [*root.iterfind("equality/*"), *root.iterfind("actuator/*")]
    others += [x for x in acting if x.tag != "joint" and not {"joint", "jointinparent"} & {*x.attrib}]
    others += root.iter("site", "camera", "light", "plugin", *UNUSED)
    left = Counter[str]()
    for element in dict.fromkeys(others):
        left[element.tag] += (len(element) or 1) * (element.tag not in UNUSED)
        element.getparent().remove(element)
    if left := +left:
        names = some(f"<{cut(tag, ECHO)}> ({count})" for tag, count in left.items())
        report.warning(None, "robot", f"not read: {names}", "none of them acts on the robot here")
    compiler = _settings(root)
    folder, main = compiler.get("meshdir", compiler.get("assetdir", "")), Path(report.file).resolve().parent
    used, lost, size, made = {geom.get("mesh") for geom in root.iter("geom")}, [], 0, 0.0
    for mesh in root.findall("asset/mesh"):
        place, found = mesh.get("file"), None
        if place is not None:
            place = re.split(r"[/\\]", place)[-1] if compiler.get("strippath") == "true" else place
            mesh.set("name", mesh.get("name") or Path(place).stem)
            found = below(main / folder / place, main)
        if mesh.get("name") not in used or (place is not None and found is None):
            lost += [mesh] * (mesh.get("name") in used)
            mesh.getparent().remove(mesh)
        elif found is not None:
            size += found.stat().st_size
            mesh.set("file", str(found))
        elif mesh.get("builtin") is not None:
            made += LEAST_MADE + max(attribute_numbers(mesh, "params") or [math.inf]) ** 2
    if size > MAX_MESHES or made > MAX_MADE:
        most = f"{MAX_MESHES} bytes of mesh files and {MAX_MADE} vertices of built-in meshes are compiled"
        report.error(None, "file", f"at most {most}, got {size} and {made:g}", "make meshes smaller")
    for element in root.iter():
        for attribute in NOT_COMPILED:
            element.attrib.pop(attribute, None)
    return lost


def _compiled(root: Element, report: FindingsReport) -> Any | None:
    """Compiled model, or None with an error."""
    from lxml import etree

    etree.SubElement(etree.SubElement(root, "compiler"), "lengthrange", mode="none")  # else found by simulation
    elements = list(root.iter())
    if len(elements) > MAX_ELEMENTS:
        cure = "split the robot, or remove what is not it"
        report.error(None, "file", f"has {len(elements)} elements to compile, more than {MAX_ELEMENTS}", cure)
    for element in elements:  # each begins a line, whose number in MuJoCo's errors identifies it
        element.text = "\n" if len(element) else None
        element.tail = "\n" if element.getnext() is not None else None
    try:
        return None if report.errors else _mujoco().MjModel.from_xml_string(etree.tostring(root, encoding="unicode"))
    except (ValueError, RuntimeError, MemoryError) as error:
        found = COMPILER.fullmatch(str(error))
        text, line = found.groups() if found else (str(error), None)
        element = elements[int(line) - 1] if line else None
        where = "file" if element is None else describe(element)
        report.error(element, where, f"MuJoCo's compiler says: {cut(' '.join(text.split()), ECHO)}", "fix the file")
    return None


def names_of(m: Any, kind: str) -> list[str]:
    """Names of a compiled model's bodies or joints; those without have their number."""
    names = [getattr(m, kind)(k).name for k in range(m.nbody if kind == "body" else m.njnt)]
    return [name or unused(f"{kind}_{k}", names) for k, name in enumerate(names)]


def unused(name: str, names: Sequence[str]) -> str:
    """The name followed by as many "_" as it needs to differ from all names of a file."""
    while name in names:
        name += "_"
    return name


def rotation_of(quaternion: Array) -> Array:
    """Rotation matrix of a quaternion w, x, y, z of any length, in long double."""
    w, v = np.split(unit_vector(quaternion.astype(Extended)), [1])
    V = cross_matrix(v)
    return np.asarray(np.eye(3) + 2 * (w * V + V @ V))


def _parts(m: Any, report: FindingsReport) -> list[Part]:
    """Bodies in MuJoCo's order, each with a part for every joint of it, all but the last massless.

    A joint's frame has its origin where the joint's axis is nearest to the body's origin. If these differ, the body is
    a separate part, fixed to the joint's.
    """
    links, joints = names_of(m, "body"), names_of(m, "joint")
    parts, part_of, part_of_joint = [Part(link=links[0])], [0], list[int]()
    for b in range(1, m.nbody):
        parent, place = part_of[m.body_parentid[b]], pose(rotation_of(m.body_quat[b]), m.body_pos[b])
        R = snap(rotation_of(m.body_iquat[b]))
        inertia = R @ np.diag(m.body_inertia[b].astype(Extended)) @ transpose(R)
        body = {"link": links[b], "mass": float(m.body_mass[b]), "com": m.body_ipos[b].astype(Extended)}
        body["inertia"] = (inertia + inertia.T) / 2
        own = range(m.body_jntadr[b], m.body_jntadr[b] + m.body_jntnum[b])
        carried = False
        for j in own:
            foot, zero, joint = _joint(m, j, joints[j], report)
            carried = j == own[-1] and not foot.any()
            joint |= body if carried else {"link": unused(f"{links[b]}/{joints[j]}", links)}
            part_of_joint.append(len(parts))
            parts.append(Part(parent=parent, placement=place.then(Pose(zero.R, foot + zero.p)), **joint))
            parent, place = len(parts) - 1, pose(np.eye(3), -foot)
        if not carried:
            parts.append(Part(parent=parent, placement=place, joint=unused(f"{links[b]}_fixed", joints), **body))
        part_of.append(len(parts) - 1)
    for j, mimic in _mimics(m, joints, report).items():
        k, independent = part_of_joint[j], part_of_joint[mimic.independent]
        parts[k] = replace(parts[k], mimic=mimic._replace(independent=independent))
    return parts


def _joint(m: Any, j: int, name: str, report: FindingsReport) -> tuple[Array, Pose, dict[str, Any]]:
    """Axis origin, pose at q = 0 relative to q = `ref`, and Part fields of a hinge or slide joint."""
    axis, ref = unit_vector(m.jnt_axis[j].astype(Extended)), m.qpos0[j].astype(Extended)
    lower, upper = m.jnt_range[j].tolist() if m.jnt_limited[j] else (-np.inf, np.inf)
    drives = np.flatnonzero(m.actuator_trnid[:, 0] == j).tolist()
    joint = {"joint": name, "axis": snap(axis.astype(np.float64)), "lower": lower, "upper": upper}
    joint |= {"friction": float(m.dof_frictionloss[j]), "effort": _effort(m, j, drives, name, report)}
    for x in ("armature", "damping"):  # MuJoCo 4 has them for actuators too
        of_drives = [m.actuator_gear[a, 0] ** 2 * getattr(m, f"actuator_{x}", {a: 0.0})[a] for a in drives]
        joint[x] = float(getattr(m, f"dof_{x}")[j] + sum(of_drives))
    if m.jnt_type[j] == int(_mujoco().mjtJoint.mjJNT_SLIDE):
        return np.zeros(3), pose(np.eye(3), -ref * axis), joint | {"kind": "prismatic"}
    origin, kind = m.jnt_pos[j].astype(Extended), "revolute" if m.jnt_limited[j] else "continuous"
    return snap(origin - axis * (axis @ origin)), pose(rotation_about(axis, -ref), np.zeros(3)), joint | {"kind": kind}


def _effort(m: Any, j: int, drives: list[int], name: str, report: FindingsReport) -> float:
    """Largest torque or force of a joint's drive where the file gives one, otherwise infinite."""
    ranges = [m.jnt_actfrcrange[j]] if m.jnt_actfrclimited[j] else []
    for a in drives if len(drives) == 1 else ():
        gear, is_motor = m.actuator_gear[a, 0], not (m.actuator_gaintype[a] or m.actuator_biastype[a])  # fixed, none
        if m.actuator_forcelimited[a]:
            ranges.append(gear * m.actuator_forcerange[a])
        if is_motor and not m.actuator_dyntype[a] and m.actuator_ctrllimited[a]:
            ranges.append(gear * m.actuator_gainprm[a, 0] * m.actuator_ctrlrange[a])
    if any(low != -high for low, high in ranges) or (drives[1:] and not m.jnt_actfrclimited[j]):
        message = "limits of its drives that are not one number for both directions are not read"
        report.warning(None, f"joint {echo(name)}", message, "give `effort` to rne.load")
        return np.inf
    return float(min((abs(high) for _, high in ranges), default=np.inf))


def _mimics(m: Any, joints: list[str], report: FindingsReport) -> dict[int, Mimic]:
    """Mimics of independent joints by the indices of dependent joints.

    MuJoCo's constraint is y - y0 = a0 + a1 (x - x0) + ... with y0 and x0 the joints' `ref`.
    """
    written: dict[int, Mimic] = {}
    for y, x, a, active in zip(m.eq_obj1id.tolist(), m.eq_obj2id.tolist(), m.eq_data[:, :5], m.eq_active0, strict=True):
        if active and x >= 0 and not a[2:].any() and y not in written:
            a0, a1 = a[:2].astype(Extended)
            written[y] = Mimic(x, a1, m.qpos0[y] + a0 - a1 * m.qpos0[x])
        else:
            message = "an <equality> that is no active straight line of one other joint is not read"
            report.warning(None, f"joint {echo(joints[y])}", message, "the joint moves freely")
    found = composed(written)
    for y in written:
        if found[y].independent in written:
            report.error(None, f"joint {echo(joints[y])}", "<equality> couples joints in a circle", "remove one")
    return found


def _report_left(m: Any, report: FindingsReport) -> None:
    """Report properties of the compiled model that a robot cannot have, or that are ignored."""
    own = {"joint": names_of(m, "joint"), "body": names_of(m, "body")}
    kinds = _mujoco().mjtJoint
    for joint, kind in zip(own["joint"], m.jnt_type, strict=True):
        if kind not in (int(kinds.mjJNT_HINGE), int(kinds.mjJNT_SLIDE)):
            message, cure = "is a free or ball joint, which is not covered", "fix the body, or write hinges and slides"
            report.error(None, f"joint {echo(joint)}", message, cure)
    if report.errors:  # numbers of joints are then not those of positions
        return
    for array, (kind, message, cure) in LEFT.items():
        for name, values in zip(own[kind], getattr(m, array, ()), strict=False):
            if np.any(values):
                report.warning(None, f"{kind.replace('body', 'link')} {echo(name)}", message, cure)
    for j in np.flatnonzero(m.jnt_stiffness).tolist():
        spring = f"rne.Spring.at_joint({own['joint'][j]!r}, {m.jnt_stiffness[j].item()}, {m.qpos_spring[j].item()})"
        report.warning(None, f"joint {echo(own['joint'][j])}", "its spring is not read", f"add {spring} to a scene")
    for j in sorted({*m.actuator_trnid[:, 0].tolist()}):
        message = "gear, gains and dynamics of its actuator are not read"
        report.warning(None, f"joint {echo(own['joint'][j])}", message, "torques are those of the joint")
    if m.opt.density or m.opt.viscosity:
        report.warning(None, "robot", "density and viscosity of the medium are not read", "forces of it are missing")
    if m.nmocap:
        report.warning(None, "robot", "bodies that motion capture would move are fixed", "remove them")
