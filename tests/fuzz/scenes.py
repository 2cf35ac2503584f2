"""Random scenes. All numbers are rounded as they are drawn, so that a printed case is the case."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from .case import Case, Joint
from .plant import Plant, coordinates

SHORTEST, LONGEST = 0.5, 3.0  # [s]
COORDINATES = [0.25, 0.35, 0.25, 0.15]  # how often there are 1, 2, ...
SAMPLES = 200  # about the largest number of samples of a run
METHODS = {"auto": 0.6, "DOP853": 0.1, "RK45": 0.14, "LSODA": 0.1, "Radau": 0.03, "BDF": 0.03}
LAWS = ("constant", "sines", "pd", "saturating", "switch", "traced")
LIBRARY = ("control.pd", "control.pd_gravity", "control.pid", "control.computed_torque")


def draw(seed, *, small=False):
    """The case of a seed; small: of one or two coordinates and at most a second."""
    rng = np.random.default_rng(seed)
    case = _robot(rng, seed, [0.5, 0.5, 0.0, 0.0] if small else COORDINATES)
    case = _surroundings(rng, case)
    n = coordinates(case)[0].shape[1]
    still = rng.random() < 0.3
    case = replace(
        case,
        q0=_round(rng.uniform(-1.2, 1.2, n)),
        qd0=_round(np.zeros(n) if still else rng.uniform(-1.5, 1.5, n)),
        duration=_round(rng.uniform(SHORTEST, 1.0 if small else LONGEST), 2),
        method=str(rng.choice(list(METHODS), p=list(METHODS.values()))),
    )
    case = _ranges(rng, case)
    scale = _Scale(case)
    return _drives(rng, _friction(rng, case, scale), scale)


class _Scale:
    """Inertia of each coordinate while the others are free, and gravity's torque, at the start."""

    def __init__(self, case):
        plant = Plant(case)
        self.inertia = 1 / np.diag(np.linalg.inv(plant.mass_matrix(np.array(case.q0))))
        self.gravity = np.abs(plant.gravity_torque(np.array(case.q0)))

    def torque(self, rng, low, high, held=0.3):
        """Torques that accelerate by low to high, and hold a part of gravity."""
        return self.inertia * rng.uniform(low, high, len(self.inertia)) + held * rng.random() * self.gravity


def _round(x, digits=3):
    """Floats of some decimals; of an array, a list."""
    rounded = np.round(x, digits) + 0.0
    return rounded.tolist()


def _significant(x):
    """Three significant digits."""
    return np.array([float(f"{v:.3g}") for v in np.atleast_1d(x)]).tolist()


def _robot(rng, seed, numbers):
    """A chain or a tree, sometimes with a joint that follows one before it."""
    n = int(rng.choice(len(numbers), p=numbers)) + 1
    follower = int(rng.integers(1, n + 1)) if rng.random() < 0.2 else None
    branching, prismatic = rng.choice([0, 0.5]), rng.choice([0.0, 0.3, 1.0], p=[0.4, 0.5, 0.1])
    crooked = rng.random() < 0.6
    joints = []
    for k in range(n if follower is None else n + 1):
        parent = int(rng.integers(-1, k)) if k and rng.random() < branching else k - 1
        kind = "prismatic" if rng.random() < prismatic else str(rng.choice(["revolute", "continuous"]))
        place = {"xyz": _round(rng.uniform(-0.4, 0.4, 3)), "rpy": [0.0, 0.0, 0.0]}
        axis = (np.eye(3)[rng.integers(3)] * rng.choice([-1, 1]) + 0.0).tolist()
        if crooked:
            place["rpy"], axis = _round(rng.uniform(-3, 3, 3)), _round(rng.normal(size=3) + 0.1)
        joints.append(
            Joint(kind, parent, **place, axis=axis, mimic=_mimic(rng, k) if k == follower else None, **_body(rng))
        )
    down = np.array([0, 0, -1.0]) if rng.random() < 0.5 else _direction(rng)
    return Case(seed, joints, _round(rng.choice([0.0, 9.81, 3.0], p=[0.2, 0.5, 0.3]) * down))


def _mimic(rng, k):
    """Driver among the joints before, multiplier and offset."""
    return int(rng.integers(k)), _round(rng.choice([-1, 1]) * rng.uniform(0.3, 2)), _round(rng.normal() / 2)


def _direction(rng):
    v = rng.normal(size=3)
    return v / np.linalg.norm(v)


def _body(rng):
    """Four point masses and a small ball."""
    points, masses = rng.uniform(-0.25, 0.25, (4, 3)), rng.uniform(0.1, 1.0, 4)
    com = masses @ points / masses.sum()
    d = points - com
    inertia = 2e-3 * np.eye(3) + sum(m * (v @ v * np.eye(3) - np.outer(v, v)) for m, v in zip(masses, d, strict=True))
    return {"mass": _round(masses.sum()), "com": _round(com), "inertia": _round(inertia, 4)}


def _surroundings(rng, case):
    """Gravity, mounting, payload, locked joints and drives' inertia."""
    names = [k for k, joint in enumerate(case.joints) if joint.mimic is None]
    parts = {}
    if rng.random() < 0.2:
        parts["scene_gravity"] = _round(rng.normal(size=3) * 5)
    if rng.random() < 0.25:
        parts["mounting"] = _round(rng.uniform(-3, 3, 3))
    if rng.random() < 0.3:
        ball = [[_round(0.01 * (i == j), 4) for j in range(3)] for i in range(3)] if rng.random() < 0.5 else None
        com = _round(rng.uniform(-0.2, 0.2, 3))
        parts["payload"] = (_round(rng.uniform(0.1, 2)), com, ball, int(rng.integers(len(case.joints))))
    if len(names) > 1 and rng.random() < 0.2:
        parts["locked"] = {int(rng.choice(names)): _round(rng.uniform(-1, 1))}
    case = replace(case, **parts)
    if rng.random() < 0.4:
        n = coordinates(case)[0].shape[1]
        if n < len(case.joints) - len(case.locked):  # rne wants the drives' inertia of mimics joint by joint
            joints = [replace(joint, armature=_round(rng.uniform(0, 0.3))) for joint in case.joints]
            return replace(case, joints=joints)
        return replace(case, armature=_round(rng.uniform(0, 0.5, n)))
    return case


def _ranges(rng, case):
    """Ranges around the start, of followers too; stops are on or off."""
    if rng.random() < 0.5:
        return case
    G, o = coordinates(case)
    start = G @ np.array(case.q0) + o
    width = rng.uniform(0.3, 3)
    joints = [
        joint
        if joint.kind == "continuous" or rng.random() < 0.3
        else replace(
            joint, lower=_round(x - width * rng.uniform(0.1, 1)), upper=_round(x + width * rng.uniform(0.1, 1))
        )
        for joint, x in zip(case.joints, start, strict=True)
    ]
    return replace(case, joints=joints, stops=bool(rng.random() < 0.75))


def _friction(rng, case, scale):
    kind = rng.choice(["none", "viscous", "smoothed", "dry", "static"], p=[0.2, 0.15, 0.2, 0.25, 0.2])
    if kind == "none":
        return case
    n = len(case.q0)
    friction = {}
    if kind == "viscous" or rng.random() < 0.6:
        friction["viscous"] = _significant(scale.inertia * rng.uniform(0, 2, n))
        if rng.random() < 0.4:
            friction["viscous_back"] = _significant(scale.inertia * rng.uniform(0, 2, n))
    if kind != "viscous":
        friction["coulomb"] = _significant(scale.torque(rng, 0.1, 4))
        if rng.random() < 0.2:  # a joint without dry friction
            friction["coulomb"][int(rng.integers(n))] = 0.0
        if rng.random() < 0.35:
            friction["coulomb_back"] = _significant(scale.torque(rng, 0.1, 4))
        friction["smoothing"] = _round(rng.uniform(0.01, 0.1)) if kind == "smoothed" else 0
    if kind == "static":
        largest = np.maximum(friction["coulomb"], friction.get("coulomb_back", friction["coulomb"]))
        friction["static"] = _significant(largest * rng.uniform(1.02, 1.6, n) + 0.0)
    return replace(case, friction=friction)


def _drives(rng, case, scale):
    """A control law, sampled or not, and the limits of the drives."""
    kind = rng.choice(["none", "plain", "library", "filter"], p=[0.12, 0.45, 0.35, 0.08])
    if kind == "none":
        return replace(case, effort_limit=_significant(scale.torque(rng, 1, 9)) if rng.random() < 0.1 else None)
    T = _significant(10 ** rng.uniform(-3, -1.3))[0] if kind == "filter" or rng.random() < 0.4 else None
    name = str(rng.choice(LAWS)) if kind == "plain" else str(rng.choice(LIBRARY)) if kind == "library" else "filter"
    if T is not None:
        case = replace(case, sample_time=T, duration=_round(min(case.duration, max(SHORTEST, SAMPLES * T)), 2))
    law = {"kind": name} | _numbers(rng, name, case, scale, T)
    if rng.random() < 0.3:
        case = replace(case, effort_limit=_significant(scale.torque(rng, 1, 12, 1.0)))
    if T is not None and rng.random() < 0.4:
        case = replace(case, torque_rate=_significant(scale.torque(rng, 2, 20) / rng.uniform(0.05, 0.5)))
    return replace(case, law=law)


def _numbers(rng, kind, case, scale, T):
    """The parameters of a law. Gains suit the inertia, and the sampling."""
    n = len(case.q0)
    omega = rng.uniform(1, 6 if T is None else min(6, 0.25 / T), n)
    damping = rng.uniform(0.3, 1.2, n)
    target = np.array(case.q0) + rng.uniform(-0.7, 0.7, n)
    gains = {
        "kp": _significant(scale.inertia * omega**2),
        "kd": _significant(2 * damping * omega * scale.inertia),
        "ref": _round(target),
    }
    size, bound = _significant(scale.torque(rng, 1, 10)), _significant(scale.torque(rng, 1, 8))
    waves = _round(rng.uniform(1, 12, n))
    if kind == "constant":
        return {"u": _significant(rng.choice([-1, 1], n) * scale.torque(rng, 1, 8))}
    if kind == "sines":
        return {"size": size, "omega": waves, "phase": _round(rng.uniform(0, 6, n))}
    if kind == "switch":
        time = _round(case.duration * rng.uniform(0.1, 0.9))
        return {"before": size, "after": _significant(-np.array(bound)), "time": time}
    if kind == "traced":
        return {"size": size, "omega": waves, "bound": bound} | gains
    if kind == "control.computed_torque":
        path = {"start": case.q0, "end": _round(target), "time": _round(case.duration * rng.uniform(0.4, 1.2))}
        return {"kp": _round(omega**2), "kd": _round(2 * damping * omega)} | path
    if kind == "control.pid":
        more = {"ki": _significant(scale.inertia * omega**3 * 0.2), "gravity": bool(rng.random() < 0.5)}
        return gains | more | {"windup": bound if rng.random() < 0.5 else 1e9}
    if kind == "filter":
        return gains | {"lag": _round(max(3 * T, rng.uniform(0.02, 0.3)), 4), "states": n}
    return gains | ({"bound": bound} if kind == "saturating" else {})
