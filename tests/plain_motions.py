"""Motions of scenes once more, step by step, and their derivatives by complex steps.

The recursion gives M, C qd + g and poses of links; friction, springs, elastic joints, bounds, samples and delays are
written out here. What decides, such as |x|, goes by real parts, so that a complex step is a derivative to the last digit.
"""

from __future__ import annotations

from dataclasses import is_dataclass, replace
from itertools import pairwise

import numpy as np

import rne
from rne.basics.spatial import rotation_from_rpy
from rne.control.law_numbers import law_at
from rne.dynamics.kinematics import coordinate_map, joint_accelerations, joint_positions
from rne.dynamics.rnea import newton_euler
from rne.integrators import tableaus
from rne.model.parameters import at_parameters, parameters_of
from rne.model.topology import end_link

from .helpers import cross_matrix

STEP = 1e-30
BROADCAST = rne.control.laws.PD, rne.control.laws.PID, rne.control.laws.ComputedTorque  # over leading axes of numbers


def sign(x):
    return np.sign(x.real)


class Arm:
    """A robot for laws, at parameters of any numbers."""

    def __init__(self, robot, parameters=None):
        self.n, self.model, self.robot = robot.n, robot.model, robot
        self.bodies = self.model if parameters is None else at_parameters(self.model, parameters)

    def __getattr__(self, name):
        return getattr(self.robot, name)

    def inverse_dynamics(self, q, qd, qdd):
        return newton_euler(self.bodies, q, qd, qdd, self.model.gravity).tau

    def gravity_torque(self, q):
        return self.inverse_dynamics(q, 0 * q, 0 * q)


class Samples:
    """A motion through samples of any numbers: linear in them, as its polynomials are."""

    def __init__(self, motion, samples):
        self.samples, self.each = samples, motion.with_samples(np.eye(len(motion.samples)))

    def __call__(self, t):
        return tuple(np.einsum("k,...kn->...n", x, self.samples) for x in self.each(t))


class EachAlone:
    """A law that is written for one state, at numbers (P, ...) of which each state of (P, ...) has its own."""

    def __init__(self, law, numbers):
        count = len(next(iter(numbers.values())))
        self.laws = [law_at(law, {name: x[k] for name, x in numbers.items()}) for k in range(count)]

    def __call__(self, t, *x):
        found = [law(t, *row) for law, *row in zip(self.laws, *x, strict=True)]
        is_pair = isinstance(found[0], tuple)
        return tuple(map(np.array, zip(*found, strict=True))) if is_pair else np.array(found)


class PlainScene:
    """The equations of motion of a scene at numbers by name, (P, ...) each, and its law."""

    def __init__(self, scene, numbers):
        self.scene, self.parts = scene, scene.resolved
        self.known = dict(scene.numbers)
        self.numbers = self.known | numbers
        self.robot = self.parts.robot
        self.n, self.side = self.robot.n, self.parts.motor_side
        self.model = replace(self.robot.model, armature=np.zeros(self.robot.model.nb))
        if {"parameters", "payload"} & {*numbers}:
            self.model = at_parameters(self.model, self.bodies(numbers))
        turn = np.zeros(3) if scene.mounting is None else np.array(scene.mounting, float)
        self.gravity = self.numbers["gravity"] @ rotation_from_rpy(turn)
        self.rotors = self.numbers.get("armature", np.zeros(self.model.nb))
        self.law = None if scene.controller is None else self.law_with(scene.controller, numbers)
        self.states = int(getattr(scene.controller, "states", 0))

    def of(self, name, default=0.0):
        """A number, with an axis for joints; single ones have one of length 1."""
        found = np.asarray(self.numbers.get(name, default))
        return found if name in self.known and self.known[name].shape else found[..., None]

    def bodies(self, numbers):
        """Parameters of the bodies, those of the payload added."""
        if "parameters" in numbers:
            return numbers["parameters"]
        without, pi = replace(self.scene, payload=None).resolved.robot.model, numbers["payload"]
        link = self.scene.payload.link or end_link(without)
        k = without.link_index(link)
        body, R, p = without.link_body[k], without.link_rotation[k], without.link_translation[k]
        p = p - without.joint_origin[body]
        i, j = np.array([[0, 0], [0, 1], [1, 1], [0, 2], [1, 2], [2, 2]]).T
        own = np.zeros((*pi.shape[:-1], 3, 3), pi.dtype)
        own[..., i, j] = own[..., j, i] = pi[..., 4:]
        m, h, own = pi[..., 0], pi[..., 1:4] @ R.T, R @ own @ R.T
        S, H = cross_matrix(p), cross_matrix(h)
        own = own - S @ H - H @ S - m[..., None, None] * (S @ S)  # by Steiner's theorem about another point
        found = np.zeros((*pi.shape[:-1], without.nb, 10), pi.dtype)
        found[..., body, :] = np.concatenate([m[..., None], h + m[..., None] * p, own[..., i, j]], axis=-1)
        return parameters_of(without) + found.reshape(*pi.shape[:-1], -1)

    def law_with(self, law, numbers):
        """The controller with numbers of this scene: for all states at once, or with parts of its own one by one."""
        own, kept = {k.removeprefix("controller."): x for k, x in numbers.items() if k.startswith("controller.")}, {}
        parameters = own.pop("robot.parameters", None)
        for name in [name for name in own if hasattr(getattr(law, name, None), "with_samples")]:
            kept[name] = Samples(getattr(law, name), own.pop(name))
        if own and (any("." in name for name in own) or not isinstance(law, BROADCAST)):
            return EachAlone(law, own)
        if not is_dataclass(law):
            return law
        own = {name: x[..., None] if np.ndim(getattr(law, name)) == 0 else x for name, x in own.items()}
        if isinstance(getattr(law, "robot", None), rne.Robot):
            kept["robot"] = Arm(law.robot, parameters)
        return replace(law, **own, **kept)

    def friction(self, net, qd):
        """What is left of torques of the drives, and of those that friction under load passes on."""
        friction = self.parts.friction
        if friction is None:
            return net
        back = qd.real < 0
        one = {
            name: self.of(f"friction.{name}") for name in ("viscous", "coulomb", "stribeck_rise", "stribeck", "load")
        }
        opposite = {name: self.of(f"friction.{name}_back", one[name]) for name in ("viscous", "coulomb")}
        opposite = {name: x if f"friction.{name}_back" in self.numbers else one[name] for name, x in opposite.items()}
        v, saturation = qd, self.of("friction.saturation")
        if saturation.any():
            safe = np.where(saturation.real > 0, saturation, 1.0)
            v = np.where(saturation.real > 0, safe * np.tanh(qd / safe), qd)
        way = np.tanh(qd / self.of("friction.smoothing"))
        net = net - np.where(back, opposite["viscous"], one["viscous"]) * v
        net = net - np.where(back, opposite["coulomb"], one["coulomb"]) * way - self.of("friction.offset")
        slow = np.where(one["stribeck"].real > 0, one["stribeck"], 1.0)
        effect = one["stribeck_rise"] * way * np.exp(-sign(qd) * qd / slow)
        net = net - np.where(one["stribeck"].real > 0, effect, 0.0)
        return net / (1 + one["load"] * sign(net) * way)

    def springs(self, q, qd):
        """Torques that springs take."""
        total, springs = 0 * q, self.parts.springs
        for k, spring in () if springs is None else zip(springs.places, springs.each, strict=True):
            number = {
                name: self.of(f"springs[{k}].{name}")
                for name in ("stiffness", "damping", "length", "force", "rest")
                if hasattr(spring, name)
            }
            if hasattr(spring, "joint"):
                i = self.robot.model.moving_joints.index(spring.joint)
                slope = coordinate_map(self.robot.model, q)[..., i, :] + 0 * q
                l = joint_positions(self.robot.model, q)[..., i, None]
                tension = number["stiffness"] * (l - number["rest"])
            else:
                d, J = spring._offset(self.robot.model, q)
                l = np.sqrt((d * d).sum(-1, keepdims=True))
                slope = (J @ (d / l)[..., None])[..., 0]
                tension = number["stiffness"] * (l - number["length"]) - number["force"]
            rate = (slope * qd).sum(-1, keepdims=True)
            total = total + slope * (tension + number["damping"] * rate)
        return total

    def torques(self, t, x, z=None):
        """The law's torques, and the rates of its states."""
        n, reads = self.n, self.side and self.side.reads
        q, qd = np.split(x, 2, axis=-1)
        if reads in ("motor", "link"):
            q, qd = (part[..., n:] if reads == "motor" else part[..., :n] for part in (q, qd))
        u = self.law(t, q, qd) if z is None else self.law(t, q, qd, z)
        u, rates = (u, None) if z is None else u
        return np.asarray(u) + 0 * x[..., :n], rates

    def accelerations(self, x, u):
        """Those of the links, behind elastic joints of the motors too."""
        n, side = self.n, self.side
        q, qd = x[..., : self.n], x[..., x.shape[-1] // 2 :][..., :n]
        if side is None:
            acting = self.friction(u, qd) - self.springs(q, qd)
            return self.solved(q, qd, acting)
        motor_q, motor_qd = x[..., n : 2 * n], x[..., 3 * n : 4 * n]
        torsion = self.of("elastic.stiffness") * (motor_q - q) + self.of("elastic.damping") * (motor_qd - qd)
        links = self.solved(q, qd, torsion - self.springs(q, qd))
        motors = (self.friction(u, motor_qd) - torsion) / self.of("elastic.rotor")
        return np.concatenate([links, motors], axis=-1)

    def solved(self, q, qd, acting):
        """M^-1 (acting - C qd - g)."""
        bias = newton_euler(self.model, q, qd, 0 * q, self.gravity).tau
        M, G = rne.dynamics.mass_matrix.core(self.model, q), coordinate_map(self.robot.model, q)
        M = M + np.swapaxes(G, -1, -2) @ (self.rotors[..., :, None] * G)
        moved = self.rotors * joint_accelerations(self.robot.model, q, qd, 0 * q)
        bias = bias + (np.swapaxes(G, -1, -2) @ moved[..., None])[..., 0]
        return np.linalg.solve(M, (acting - bias)[..., None])[..., 0]


def instants(scene, duration):
    """Times at which steps end, and whether a law is sampled there, and a command acts."""
    found = {duration: set()}

    def note(t, what):
        if t < duration * (1 - 1e-12) or what == "break":
            near = next((s for s in found if abs(s - t) <= 1e-12 * max(s, t)), t)
            found.setdefault(near, set()).add(what)

    if scene.sample_time is None:
        for owner in (scene.controller, getattr(scene.controller, "reference", None)):
            for t in getattr(owner, "breaks", ()):
                if 0 < t <= duration:
                    note(t, "break")
        found.setdefault(0.0, set())
        return sorted(found.items())
    T, k = scene.sample_time, 0
    while k * T < duration * (1 - 1e-12):
        note(k * T, "sample")
        note(k * T + (scene.delay or 0.0), "act")
        k += 1
    return sorted(found.items())


def equal_ends(scene, duration, step):
    """The ends of steps of at most a length, equal from instant to instant."""
    ends = [0.0]
    for (a, _), (b, _) in pairwise(instants(scene, duration)):
        count = max(1, int(np.ceil((b - a) / step * (1 - 1e-9))))
        ends += [a + (b - a) * (k + 1) / count for k in range(count - 1)] + [b]
    return np.array(ends)


def plain_motion(plain, x, z, ends, duration, method="rk4", cost=None, torque=None):
    """The state at the end, and the integral of the cost, along steps with these ends; states of all ends."""
    scene, n, T = plain.scene, plain.n, plain.scene.sample_time
    coefficients = tableaus.tableau(method)
    A, B, C = coefficients.A, coefficients.B, coefficients.C
    happens = dict(instants(scene, duration))
    jumps = sorted(t for t, what in happens.items() if "break" in what)
    limit = plain.of("effort_limit", np.inf) * np.ones(n)
    change = plain.of("torque_rate", np.inf) * np.ones(n)
    total, states, command, waiting, acting = 0.0, [x], None, [], 0 * x[..., :n]

    def bounded(u, bound, middle=0.0):
        finite = np.where(np.isfinite(bound), bound, 0.0)
        return np.where(abs(u.real - np.real(middle)) > bound.real, middle + sign(u - middle) * finite, u)

    def rates(t, x, z):
        t = np.nextafter(begin, end) if t <= begin and begin in jumps else t  # on its own side of a jump
        t = np.nextafter(end, begin) if t >= end and end in jumps else t
        u, more = acting, None
        if torque is not None:
            u = torque + 0 * x[..., :n]
        elif plain.law is not None and T is None:
            u, more = plain.torques(t, x, z if plain.states else None)
        u = bounded(u, limit)
        both = x.shape[-1] // 2
        own = 0.0 if cost is None else cost(t, x[..., :n], x[..., both : both + n], u)
        return np.concatenate([x[..., both:], plain.accelerations(x, u)], axis=-1), more, own

    for begin, end in pairwise(ends):
        h = end - begin
        what = next((w for s, w in happens.items() if abs(s - begin) <= 1e-12 * max(s, begin)), ())
        if T is not None and "sample" in what:
            u, more = plain.torques(begin, x, z if plain.states else None)
            u = bounded(u, limit)
            command = u if command is None else bounded(u, change * T, command)
            waiting.append(command)
            z = z if more is None else z + T * more
        if "act" in what:
            acting = waiting.pop(0)
        K = []
        for c, row in zip(C, A, strict=True):
            moved = x + h * sum((a * k[0] for a, k in zip(row, K, strict=False) if a), 0 * x)
            inner = (
                z
                if T is not None or not plain.states
                else z + h * sum((a * k[1] for a, k in zip(row, K, strict=False)), 0 * z)
            )
            K.append(rates(begin + c * h, moved, inner))
        x = x + h * sum(b * k[0] for b, k in zip(B, K, strict=False))
        if T is None and plain.states:
            z = z + h * sum(b * k[1] for b, k in zip(B, K, strict=False))
        total = total + h * sum(b * k[2] for b, k in zip(B, K, strict=False))
        states.append(x)
    return x, total, states


class Derived(dict):
    """Derivatives by name, with the `value`, the state at the `end`, its derivatives `of_end` by name, (size, entries).

    `growth` is the largest d(state)/d(start), at least 1.
    """

    value: float
    end: np.ndarray
    of_end: dict[str, np.ndarray]
    growth: float


def by_complex_steps(scene, q0, qd0, duration, *, step=None, wrt, cost=None, final=None, ends=None, **how):
    """A cost of a motion and its derivatives by numbers of the scene and by the start."""
    start, own = {"q0": np.asarray(q0, float), "qd0": np.asarray(qd0, float)}, how.pop("numbers", {})
    models = {
        f"controller.{x}.parameters": getattr(scene.controller, x).parameters
        for x in ("robot",)
        if f"controller.{x}.parameters" in wrt
    }
    known = {**scene.numbers, **models, **{k: np.asarray(x, float) for k, x in own.items()}, **start}
    names = [*dict.fromkeys((*start, *(name for name in wrt if name != "delay")))]
    P, first, given = 1 + sum(known[name].size for name in names), 1, {}
    for name in names:
        value = np.repeat(known[name].astype(complex)[None], P, axis=0).reshape(P, -1)
        value[np.arange(first, first + known[name].size), np.arange(known[name].size)] += STEP * 1j
        given[name] = value.reshape(P, *known[name].shape)
        first += known[name].size
    numbers = {k: x for k, x in {**{k: known[k] for k in own}, **given}.items() if k not in start}
    plain, method = PlainScene(scene, numbers), how.pop("method", "rk4")
    q, qd = given["q0"], given["qd0"]
    if plain.side is not None and q.shape[-1] == plain.n:
        held = newton_euler(plain.model, q, 0 * q, 0 * q, plain.gravity).tau + plain.springs(q, 0 * q)
        q = np.concatenate([q, q + held / plain.of("elastic.stiffness")], axis=-1)
    if plain.side is not None and qd.shape[-1] == plain.n:
        qd = np.concatenate([qd, qd], axis=-1)
    x, z = np.concatenate([q, qd], axis=-1), np.zeros((P, plain.states), complex)
    ends = equal_ends(scene, duration, step) if ends is None else ends
    x, total, states = plain_motion(plain, x, z, ends, duration, method, cost, **how)
    if final is not None:
        both = x.shape[-1] // 2
        total = total + final(x[..., : plain.n], x[..., both : both + plain.n])
    found, first = Derived(), 1
    found.of_end = {}
    for name in names:
        size = known[name].size
        found[name] = (total[first : first + size].imag / STEP).reshape(known[name].shape)
        found.of_end[name] = x[first : first + size].imag.T / STEP
        first += size
    found.value, found.end = total[0].real, x[0].real
    columns = 1 + known["q0"].size + known["qd0"].size
    found.growth = max(1.0, *(abs(s[1:columns].imag).max() / STEP for s in states))
    return found
