"""URDF files with joint origins slid along their axes, and the robot of exactly the files' numbers."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from dataclasses import replace

import mpmath
import numpy as np

import rne
from rne.basics.spatial import combine_bodies
from rne.model.builder import disassemble

from ..helpers import assemble
from .structured import ARRAYS, in_mpmath


def far_text(model, distance, seed=0):
    """The robot as URDF, every revolute joint's origin up to `distance` away along its axis."""
    rng = np.random.default_rng(seed)
    parts, shifts = disassemble(model), []
    for k, part in enumerate(parts):
        turns = part.kind in ("revolute", "continuous")
        shift = np.asarray(part.axis, dtype=np.longdouble) * (distance * rng.uniform(-1, 1) if turns else 0)
        shifts.append(shift)
        if k:
            R, p = part.placement
            place = part.placement._replace(p=p + R @ shift - shifts[part.parent])
            parts[k] = replace(part, placement=place, com=part.com - shift)
    return rne.to_urdf(assemble(model.name, parts, gravity=model.gravity))


def mp(text):
    """The doubles of an attribute, not rounded further."""
    return in_mpmath(np.array([float(x) for x in text.split()]))


def mp_pose(origin):
    """Rotation and origin of an <origin>, nothing rounded or snapped."""
    if origin is None:
        return in_mpmath(np.eye(3)), mp("0 0 0")
    (cr, sr), (cp, sp), (cy, sy) = ((mpmath.cos(x), mpmath.sin(x)) for x in mp(origin.get("rpy", "0 0 0")))
    yaw = np.array([[cy, -sy, 0], [sy, cy, 0], [0, 0, 1]], dtype=object)
    pitch = np.array([[cp, 0, sp], [0, 1, 0], [-sp, 0, cp]], dtype=object)
    roll = np.array([[1, 0, 0], [0, cr, -sr], [0, sr, cr]], dtype=object)
    return yaw @ pitch @ roll, mp(origin.get("xyz", "0 0 0"))


def exact_model(text, like):
    """The Model of exactly the file's doubles, its frames where the file has them, in mpmath's precision.

    Only names and topology are taken from `like`, the file as the package loads it.
    """
    root = ET.fromstring(text.encode())
    joints = {j.get("name"): j for j in root.findall("joint")}
    links = {link.get("name"): link for link in root.findall("link")}
    rebuild, (values,) = like.__reduce__()  # as pickle does, without checks
    for name in ARRAYS & values.keys():
        if values[name] is not None and np.isfinite(values[name]).all():
            values[name] = in_mpmath(values[name])
    frames, bodies = {}, [[] for _ in range(like.nb)]
    rotation, translation, axis = [], [], []
    for k, (link, joint) in enumerate(zip(like.link_names, like.link_joints, strict=True)):
        R, p = in_mpmath(np.eye(3)), mp("0 0 0")
        if joint:
            host = frames[joints[joint].find("parent").get("link")]
            R, p = mp_pose(joints[joint].find("origin"))
            R, p = host[0] @ R, host[1] + host[0] @ p
        if joint in like.moving_joints:
            b = mp(joints[joint].find("axis").get("xyz"))
            rotation.append(R)
            translation.append(p)
            axis.append(b / mpmath.sqrt((b * b).sum()))
            R, p = in_mpmath(np.eye(3)), mp("0 0 0")
        frames[link] = R, p
        values["link_rotation"][k], values["link_translation"][k] = R, p
        inertial = links[link].find("inertial")
        if inertial is not None and like.link_body[k] >= 0:
            bodies[like.link_body[k]].append(mp_body(inertial, R, p))
    merged = [combine_bodies(b) if b else (mpmath.mpf(0), mp("0 0 0"), 0 * frames[link][0]) for b in bodies]
    values |= {"rotation": np.array(rotation), "translation": np.array(translation), "axis": np.array(axis)}
    values |= {"mass": np.array([b[0] for b in merged]), "com": np.array([b[1] for b in merged])}
    return rebuild(values | {"inertia": np.array([b[2] for b in merged])})


def mp_body(inertial, R, p):
    """Mass, centre and inertia of an <inertial> in the frame that has the link at (R, p)."""
    turn, com = mp_pose(inertial.find("origin"))
    I = {name: mp(x)[0] for name, x in inertial.find("inertia").attrib.items()}
    inertia = np.array([[I["i" + "".join(sorted(a + b))] for a in "xyz"] for b in "xyz"])
    return mp(inertial.find("mass").get("value"))[0], p + R @ com, R @ turn @ inertia @ turn.T @ R.T
