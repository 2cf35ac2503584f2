"""Logs with faults that an identification has to survive or to name, and what became of them.

Six robots move along random Fourier series with the friction of harmonic drives, which rises with the load and
saturates with speed, offsets, coloured noise and a delay; the robot given has masses off by up to 30 %. A controller
may feed noise of the positions back (`FEEDBACK`), and clocks may run unevenly (`CLOCKS`).
"""

from __future__ import annotations

import warnings
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from tempfile import NamedTemporaryFile
from typing import Any, NamedTuple

import numpy as np
from scipy.signal import lfilter, lsim
from scipy.stats import chi2

import rne
from rne.identification import Record, regression
from rne.identification.diagnosis.hypotheses import GEARS
from rne.identification.fit.least_squares import least_squares
from rne.model import with_parameters
from rne.model.parameters import parameters_of

from .helpers import first_joints, loaded

RATE, DURATION = 500.0, 20.0
NOISE = 0.01  # of each joint's torque, root mean square
ENCODER = 2 * np.pi / 2**20
CHANCE = 0.999
HIDDEN = 0.4  # of what noise leaves: a residual that no test tells from it
BANDWIDTH = 20.0  # of the coloured part of the noise [Hz]
SMALL, STIFF_GEARS = (
    (1 / 3, 1 / 20),
    3.0,
)  # length and mass of a small arm over those of its kind; friction of its gears
COUPLED = 0.15, 1.0  # turns of a wrist's last motor per turn of the joint before
LOAD = 0.03, 0.08  # friction per load of a harmonic drive
SATURATING = 0.5, 1.5  # of the largest speed, at which viscous friction saturates
LATE = 0.0, 0.008  # delay of the torques [s]
LOOP, FED_BACK = 4.0, 0.3  # bandwidth of the controller [Hz]; accelerations by noise, of those of the motion
DRIFT, JITTER, READ = (
    0.02,
    0.3,
    2.0,
)  # [s] by which samples are late, slowly; periods by which one is; by which it is read
FEEDBACK, CLOCKS = "feedback", ("samples", "reader")  # a clock's stamps are those of the samples, or of the reader
LOGGED = ("", FEEDBACK, *CLOCKS)
SMALL_ARM = "tilted gravity of a small arm"


class Log(NamedTuple):
    """What a logger wrote, before a Record is made of it."""

    t: np.ndarray
    q: np.ndarray
    tau: np.ndarray


class Arm(NamedTuple):
    """A robot as it is, its drives, and the torque of what else acts."""

    robot: rne.Robot
    rotor: np.ndarray
    viscous: np.ndarray
    coulomb: np.ndarray
    offset: np.ndarray
    load: np.ndarray  # Coulomb friction per torque that the gear transmits
    saturating: np.ndarray  # speed at which viscous friction saturates


SCARA = """<robot name="scara"><link name="base"/>
<joint name="a" type="revolute"><parent link="base"/><child link="l1"/><origin xyz="0 0 0.3"/><axis xyz="0 0 1"/>
<limit lower="-2.5" upper="2.5" velocity="4" effort="200"/></joint>
<link name="l1"><inertial><origin xyz="0.15 0.01 0.02"/><mass value="7"/>
<inertia ixx="0.03" iyy="0.08" izz="0.09" ixy="0.001" ixz="0.002" iyz="0"/></inertial></link>
<joint name="b" type="revolute"><parent link="l1"/><child link="l2"/><origin xyz="0.3 0 0"/><axis xyz="0 0 1"/>
<limit lower="-2.4" upper="2.4" velocity="5" effort="100"/></joint>
<link name="l2"><inertial><origin xyz="0.12 -0.01 0.05"/><mass value="5"/>
<inertia ixx="0.02" iyy="0.05" izz="0.06" ixy="0" ixz="0.001" iyz="0"/></inertial></link>
<joint name="c" type="prismatic"><parent link="l2"/><child link="l3"/><origin xyz="0.25 0 0"/><axis xyz="0 0 -1"/>
<limit lower="-0.15" upper="0.15" velocity="1" effort="200"/></joint>
<link name="l3"><inertial><origin xyz="0.01 0 0.05"/><mass value="2"/>
<inertia ixx="0.01" iyy="0.01" izz="0.004" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="d" type="revolute"><parent link="l3"/><child link="l4"/><axis xyz="0 0 -1"/>
<limit lower="-3" upper="3" velocity="6" effort="20"/></joint>
<link name="l4"><inertial><origin xyz="0.03 0.01 0.04"/><mass value="1"/>
<inertia ixx="0.004" iyy="0.004" izz="0.005" ixy="0" ixz="0" iyz="0"/></inertial></link></robot>"""

GANTRY = """<robot name="gantry"><link name="base"/>
<joint name="x" type="prismatic"><parent link="base"/><child link="l1"/><axis xyz="1 0 0"/>
<limit lower="-1" upper="1" velocity="1.5" effort="900"/></joint>
<link name="l1"><inertial><mass value="30"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="y" type="prismatic"><parent link="l1"/><child link="l2"/><axis xyz="0 1 0"/>
<limit lower="-1" upper="1" velocity="1.5" effort="600"/></joint>
<link name="l2"><inertial><mass value="18"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="z" type="prismatic"><parent link="l2"/><child link="l3"/><axis xyz="0 0 1"/>
<limit lower="-0.6" upper="0.6" velocity="1" effort="400"/></joint>
<link name="l3"><inertial><mass value="9"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="w" type="revolute"><parent link="l3"/><child link="l4"/><axis xyz="1 0 0"/>
<limit lower="-2" upper="2" velocity="3" effort="60"/></joint>
<link name="l4"><inertial><origin xyz="0.02 0.12 -0.05"/><mass value="4"/>
<inertia ixx="0.06" iyy="0.02" izz="0.05" ixy="0" ixz="0" iyz="0"/></inertial></link></robot>"""


def from_text(text: str) -> rne.Robot:
    with NamedTemporaryFile("w", suffix=".urdf") as file:
        file.write(text)
        file.flush()
        return rne.load(file.name)


def mimicking() -> rne.Robot:
    """Three axes of the IRB 140, the third of which follows the second as a parallelogram's does."""
    text = rne.to_urdf(first_joints().model)
    return from_text(
        text.replace(
            '<joint name="joint_3" type="revolute">',
            '<joint name="joint_3" type="revolute"><mimic joint="joint_2" multiplier="-0.6"/>',
        )
    )


@cache
def robots() -> dict[str, rne.Robot]:
    """The six, fingers locked."""
    panda = loaded("panda_description/panda")
    return {
        "IRB 140": loaded("irb140"),
        "UR5": loaded("ur_description/ur5_robot"),
        "Panda": panda.locked({"panda_finger_joint1": 0.0}),
        "SCARA": from_text(SCARA),
        "gantry": from_text(GANTRY),
        "mimic": mimicking(),
    }


def drives_of(
    robot: rne.Robot, rng: np.random.Generator, gears: np.random.Generator, tau: np.ndarray, qd: np.ndarray
) -> Arm:
    """Rotors and friction of about a fifth of the torques, and harmonic drives."""
    n, size = robot.n, np.sqrt((tau**2).mean(0)) + 0.05 * np.sqrt((tau**2).mean())
    return Arm(
        robot,
        rng.uniform(0.2, 0.6, n) * np.diag(robot.mass_matrix(np.zeros(n))).clip(0.02),
        rng.uniform(0.05, 0.15, n) * size,
        rng.uniform(0.1, 0.25, n) * size,
        rng.uniform(-0.05, 0.05, n) * size,
        gears.uniform(*LOAD, n),
        gears.uniform(*SATURATING, n) * np.abs(qd).max(0),
    )


def given_robot(robot: rne.Robot, rng: np.random.Generator) -> rne.Robot:
    """The robot with masses off by up to 30 %."""
    bodies = parameters_of(robot.model).reshape(-1, 10) * rng.uniform(0.7, 1.3, (robot.model.nb, 1))
    return rne.Robot(with_parameters(robot.model, bodies.ravel()))


def motion(robot: rne.Robot, rng: np.random.Generator, t: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A random Fourier series of five harmonics of 0.1 Hz within nine tenths of the joints' ranges."""
    w = 2 * np.pi * 0.1 * np.arange(1, 6)
    a, b = rng.normal(size=(2, robot.n, 5))
    S, C = np.sin(np.outer(t, w)), np.cos(np.outer(t, w))
    q, qd, qdd = S @ a.T + C @ b.T, (C * w) @ a.T - (S * w) @ b.T, -(S * w**2) @ a.T - (C * w**2) @ b.T
    model = robot.model
    joints = list(model.independent_joints)
    low, high = np.maximum(model.lower[joints], -3.0), np.minimum(model.upper[joints], 3.0)
    scale = np.minimum(
        0.45 * (high - low) / np.abs(q).max(0), 0.9 * np.minimum(model.velocity_limit[joints], 3.0) / np.abs(qd).max(0)
    )
    return q * scale + (low + high) / 2, qd * scale, qdd * scale


def friction(arm: Arm, qd: np.ndarray, qdd: np.ndarray, body: np.ndarray) -> np.ndarray:
    """Torques of the drives, whose gears transmit those of the bodies."""
    coulomb = arm.coulomb + arm.load * np.abs(body)
    viscous = arm.viscous * arm.saturating * np.tanh(qd / arm.saturating)
    return arm.rotor * qdd + viscous + coulomb * np.sign(qd) + arm.offset


def coloured(rng: np.random.Generator, shape: tuple[int, ...]) -> np.ndarray:
    """Unit noise, half of its power below BANDWIDTH."""
    a = np.exp(-2 * np.pi * BANDWIDTH / RATE)
    slow = lfilter([np.sqrt(1 - a * a)], [1, -a], rng.normal(size=shape), axis=0)
    return (rng.normal(size=shape) + slow) / np.sqrt(2)


class Case(NamedTuple):
    """Truth, motion and torques without noise."""

    arm: Arm
    rng: np.random.Generator
    t: np.ndarray
    states: tuple[np.ndarray, np.ndarray, np.ndarray]
    tau: np.ndarray
    size: np.ndarray
    joint: int
    late: float  # delay of the torques [s]
    noise: np.ndarray  # of the positions


def uneven(t: np.ndarray, seed: int) -> np.ndarray:
    """Times that differ from equal steps by a slow wave and jitter."""
    rng = np.random.default_rng([seed, 2])
    slow = DRIFT * np.sin(2 * np.pi * rng.uniform(0.05, 0.2) * t + rng.uniform(0, 2 * np.pi))
    return np.sort(t + slow + JITTER / RATE * rng.uniform(-0.5, 0.5, len(t)))


def fed_back(states: tuple[np.ndarray, ...], t: np.ndarray, seed: int) -> tuple[tuple[np.ndarray, ...], np.ndarray]:
    """The motion with what a controller of each joint makes of noise of its position, and that noise."""
    rng, w = np.random.default_rng([seed, 3]), 2 * np.pi * LOOP
    A, B = np.array([[0, 1], [-w * w, -1.4 * w]]), np.array([[0.0], [-w * w]])
    noise, moved = rng.normal(size=states[0].shape), np.zeros((3, *states[0].shape))
    for j, e in enumerate(noise.T):  # qdd = -1.4 w qd - w^2 (q + e)
        x = lsim((A, B, np.eye(2), np.zeros((2, 1))), e, t)[1]
        change = np.array([*x.T, x @ A[1] - w * w * e])
        size = FED_BACK * np.sqrt((states[2][:, j] ** 2).mean()) / change[2].std()
        moved[..., j], noise[:, j] = size * change, size * e
    return tuple(x + y for x, y in zip(states, moved, strict=True)), noise


def small(robot: rne.Robot) -> rne.Robot:
    """The robot at a third of its size, and a twentieth of its masses."""
    model, (length, mass) = robot.model, SMALL
    places = {name: length * getattr(model, name) for name in ("translation", "com", "link_translation")}
    ends = {name: np.where(model.is_revolute, 1, length) * getattr(model, name) for name in ("lower", "upper")}
    return rne.Robot(replace(model, mass=mass * model.mass, inertia=mass * length**2 * model.inertia, **places, **ends))


def case(name: str, seed: int, linear: bool = False, logged: str = "", is_small: bool = False) -> Case:
    """A robot, its motion and torques; `linear` friction is that of the fit, and without a delay."""
    robot, rng, gears = robots()[name], np.random.default_rng(seed), np.random.default_rng([seed, 1])
    robot = small(robot) if is_small else robot
    t = np.arange(int(DURATION * RATE)) / RATE
    if logged == "samples":
        t = uneven(t, seed)
    states = motion(robot, rng, t)
    noise = np.zeros_like(states[0])
    if logged == FEEDBACK:
        states, noise = fed_back(states, t, seed)
    body = robot.inverse_dynamics(*states)
    arm, late = drives_of(robot, rng, gears, body, states[1]), float(gears.uniform(*LATE))
    if is_small:  # whose gears take more
        arm = arm._replace(viscous=STIFF_GEARS * arm.viscous, coulomb=STIFF_GEARS * arm.coulomb)
    if linear:
        arm, late = arm._replace(load=0 * arm.load, saturating=1e6 * arm.saturating), 0.0
    tau = body + friction(arm, *states[1:], body)
    return Case(arm, rng, t, states, tau, np.sqrt((tau**2).mean(0)), int(rng.integers(robot.n)), late, noise)


def log(c: Case, tau: np.ndarray, q: np.ndarray | None = None) -> Log:
    """With a delay, noise and an encoder's steps."""
    noisy = later(c.t, tau, c.late) + NOISE * c.size * coloured(c.rng, tau.shape)
    positions = (c.states[0] if q is None else q) + c.noise
    return Log(c.t.copy(), ENCODER * np.rint(positions / ENCODER), noisy)


def later(t: np.ndarray, tau: np.ndarray, delay: float) -> np.ndarray:
    return np.array([np.interp(t - delay, t, x) for x in tau.T]).T


def clean(c: Case) -> Log:
    return log(c, c.tau)


def delayed(ms: float) -> Callable[[Case], Log]:
    def fault(c: Case) -> Log:
        return log(c, later(c.t, c.tau, ms / 1000))

    return fault


def gear(c: Case) -> Log:
    k = np.ones(len(c.size))
    k[c.joint] = 1.1
    found = log(c, c.tau)
    return found._replace(q=found.q / k, tau=found.tau * k)


def payload(c: Case) -> Log:
    loaded = c.arm.robot.with_payload(c.rng.uniform(1, 3), c.rng.uniform(-0.05, 0.1, 3), link=tip(c.arm.robot))
    more = loaded.inverse_dynamics(*c.states) - c.arm.robot.inverse_dynamics(*c.states)
    return log(c, c.tau + more * (c.t > c.rng.uniform(0.4, 0.6) * DURATION)[:, None])


def tip(robot: rne.Robot) -> str:
    """A link of the last body."""
    model = robot.model
    return [name for name, body in zip(model.link_names, model.link_body, strict=True) if body == model.nb - 1][-1]


def contact(c: Case) -> Log:
    """A force of 20 to 60 N on the last link for one to three seconds."""
    force = c.rng.normal(size=3)
    force *= c.rng.uniform(20, 60) / np.linalg.norm(force)
    start, length = c.rng.uniform(0.2, 0.7) * DURATION, c.rng.uniform(1, 3)
    on = ((c.t > start) & (c.t < start + length))[:, None]
    J = c.arm.robot.jacobian(c.states[0], tip(c.arm.robot))[:, 3:]
    return log(c, c.tau + on * (force @ J))


def clipping(c: Case) -> Log:
    """A drive that reports no more than 70 % of its joint's largest torque."""
    found = log(c, c.tau)
    level = 0.7 * np.abs(found.tau[:, c.joint]).max()
    found.tau[:, c.joint] = found.tau[:, c.joint].clip(-level, level)
    return found


def slip(c: Case) -> Log:
    """The encoder loses 0.05 rad or 10 mm within half a second."""
    q = c.states[0].copy()
    step = 0.05 if c.arm.robot.model.is_revolute[c.arm.robot.model.independent_joints[c.joint]] else 0.01
    q[:, c.joint] += step * np.clip((c.t - c.rng.uniform(0.3, 0.7) * DURATION) / 0.5, 0, 1)
    return log(c, c.tau, q)


def drift(c: Case) -> Log:
    """Friction of all joints falls to 60 % as the gears warm up."""
    share = np.exp(-c.t / (DURATION / 2)) / (1 - np.exp(-2.0)) - np.exp(-2.0) / (1 - np.exp(-2.0))
    arm, qd = c.arm, c.states[1]
    return log(c, c.tau - 0.4 * (1 - share)[:, None] * (arm.viscous * qd + arm.coulomb * np.sign(qd)))


def degrees(c: Case) -> Log:
    found = log(c, c.tau)
    return found._replace(q=np.rad2deg(found.q))


def scaled_torques(factor: float) -> Callable[[Case], Log]:
    def fault(c: Case) -> Log:
        found = log(c, c.tau)
        return found._replace(tau=factor * found.tau)

    return fault


def milliseconds(c: Case) -> Log:
    found = log(c, c.tau)
    return found._replace(t=1000 * found.t)


def sign(c: Case) -> Log:
    found = log(c, c.tau)
    found.tau[:, c.joint] *= -1
    return found


def _swapped(x: np.ndarray, c: Case) -> np.ndarray:
    other = (c.joint + 1) % len(c.size)
    order = np.arange(len(c.size))
    order[[c.joint, other]] = order[[other, c.joint]]
    return x[:, order]


def swapped_joints(c: Case) -> Log:
    found = log(c, c.tau)
    return found._replace(q=_swapped(found.q, c), tau=_swapped(found.tau, c))


def swapped_torques(c: Case) -> Log:
    found = log(c, c.tau)
    return found._replace(tau=_swapped(found.tau, c))


def zero(c: Case) -> Log:
    found = log(c, c.tau)
    found.q[:, c.joint] += 0.1
    return found


def missing(c: Case) -> Log:
    """A twentieth of the samples lost, alone and in bursts."""
    found, lost = log(c, c.tau), c.rng.random(len(c.t)) < 0.03
    for start in c.rng.integers(0, len(c.t) - 60, 10):
        lost[start : start + int(c.rng.integers(5, 40))] = True
    return Log(*(x[~lost] for x in found))


def repeated(c: Case) -> Log:
    """One sample in twenty is sent as the one before, positions and torques."""
    found, late = log(c, c.tau), np.flatnonzero(c.rng.random(len(c.t)) < 0.05)
    late = late[late > 0]
    for x in (found.q, found.tau):
        x[late] = x[late - 1]
    return found


def gravity(c: Case) -> Log:
    """The base stands tilted by 20 to 90 degrees."""
    robot = c.arm.robot
    angle, turn = c.rng.uniform(np.deg2rad(20), np.pi / 2), c.rng.uniform(0, 2 * np.pi)
    tilted = 9.81 * np.array([np.sin(angle) * np.cos(turn), np.sin(angle) * np.sin(turn), -np.cos(angle)])
    other = rne.Robot(replace(robot.model, gravity=tilted))
    return log(c, c.tau + other.gravity_torque(c.states[0]) - robot.gravity_torque(c.states[0]))


def coupled(c: Case) -> Log:
    """Positions of the last joint are those of its motor, behind a gear that the joint before turns too."""
    q = c.states[0].copy()
    q[:, -1] += c.rng.choice([-1, 1]) * c.rng.uniform(*COUPLED) * q[:, -2]
    return log(c, c.tau, q)


def rotor(c: Case) -> Log:
    """The drives have rotors of 20 to 60 % of a joint's inertia, the robot given has none."""
    return log(c, c.tau)


def stribeck(c: Case) -> Log:
    """Friction that rises by half of Coulomb's at low speed."""
    qd = c.states[1]
    vs = c.rng.uniform(0.03, 0.1) * np.abs(qd).max(0)
    return log(c, c.tau + 0.5 * c.arm.coulomb * np.sign(qd) * np.exp(-np.abs(qd) / vs))


# fault, and the causes that name it
FAULTS: dict[str, tuple[Callable[[Case], Log], tuple[str, ...]]] = {
    "delay 1 ms": (delayed(1), ("delay",)),
    "delay 2 ms": (delayed(2), ("delay",)),
    "delay 5 ms": (delayed(5), ("delay",)),
    "gear +10 %": (gear, ("gear ratio",)),
    "payload half-way": (payload, ("payload changed",)),
    "contact": (contact, ("contact",)),
    "clipping": (clipping, ("saturated torque",)),
    "slip": (slip, ("encoder slip",)),
    "drift of friction": (drift, ("friction changed",)),
    "degrees": (degrees, ("degrees", "range of the positions")),
    "N mm": (scaled_torques(1000.0), ("torque unit",)),
    "mA": (scaled_torques(1000 / 15), ("torque unit",)),
    "ms": (milliseconds, ("time unit", "sample rate")),
    "sign": (sign, ("torque sign",)),
    "swapped joints": (swapped_joints, ("joint order",)),
    "swapped torques": (swapped_torques, ("torque order",)),
    "zero 0.1 rad": (zero, ("joint zero",)),
    "missing samples": (missing, ("missing samples", "gap")),
    "repeated samples": (repeated, ("repeated position",)),
    "gravity's direction": (gravity, ("gravity direction",)),
    "unmodelled rotor": (rotor, ("rotor",)),
    "Stribeck": (stribeck, ("Stribeck friction",)),
    "coupled wrist": (coupled, ("coupling",)),
    SMALL_ARM: (gravity, ("gravity direction",)),
}


class Outcome(NamedTuple):
    """What an identification made of a log."""

    fault: str
    robot: str
    seed: int
    chi_square: float  # of the parameters' error over its 99.9 % point
    warned: bool
    causes: tuple[str, ...]
    named: bool
    hidden: bool  # no log without noise would tell it: other parameters give the same torques
    error: str
    blamed: bool = False  # on more than friction of sound gears

    @property
    def wrong(self) -> bool:
        return not self.chi_square <= 1


def run(fault: str, name: str, seed: int, logged: str = "") -> Outcome:
    """A log with a fault, identified."""
    is_small = fault == SMALL_ARM
    c, (make, names) = case(name, seed, logged=logged, is_small=is_small), FAULTS.get(fault, (clean, ()))
    data, known = make(c), given_robot(c.arm.robot, c.rng)
    qd = np.gradient(data.q, data.t, axis=0) if logged in CLOCKS else None
    read = READ / RATE * np.random.default_rng([seed, 4]).uniform(-0.5, 0.5, len(data.t))
    t = np.sort(data.t + read) if logged == "reader" else data.t
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        try:
            record = Record(t, data.q, data.tau, qd, joint_names=known.joint_names)
            found = rne.identify(known, record, consistent=False)
        except (ValueError, rne.RneError) as error:
            named = any(_says(str(error), kind) for kind in names)
            return Outcome(fault, name, seed, np.inf, True, (), named, False, str(error))
    told = [str(w.message) for w in said if issubclass(w.category, rne.IdentificationWarning)]
    kinds, causes = tuple(f.kind for f in record.findings), tuple(cause.kind for cause in found.causes)
    again = case(name, seed, logged=logged, is_small=is_small)
    gap = found.estimate.values - values_without(again, found, stribeck=fault == "Stribeck")
    weight = np.linalg.pinv(found.estimate.covariance, rcond=1e-12, hermitian=True)
    chi_square = float(gap @ weight @ gap) / chi2.ppf(CHANCE, found.base.count)
    named = any(kind in (*causes[:2], *kinds) for kind in names)
    hidden = fault != "clean" and chi_square > 1 and not named and is_hidden(make, name, seed, is_small)
    warned = bool(told or record.findings)
    blamed, said = any(kind not in GEARS for kind in causes), " | ".join(told)
    return Outcome(fault, name, seed, chi_square, warned, causes + kinds, named, hidden, said, blamed)


def is_hidden(make: Callable[[Case], Log], name: str, seed: int, is_small: bool = False) -> bool:
    """True if the fault leaves hardly anything beside noise: other parameters give the same torques."""
    quiet, same = (case(name, seed, linear=True, is_small=is_small) for _ in range(2))
    logs = make(quiet._replace(size=0 * quiet.size)), clean(same)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        robot = given_robot(quiet.arm.robot, quiet.rng)
        left, noise = (rne.identify(robot, Record(*log), consistent=False).unexplained.in_motion for log in logs)
    return bool((left < HIDDEN * noise).all())


def _says(message: str, kind: str) -> bool:
    return all(word in message for word in kind.split())


def values_without(c: Case, found: Any, stribeck: bool) -> np.ndarray:
    """The same base parameters from the same motion without fault, noise and delay."""
    bare = c._replace(size=0 * c.size, late=0.0, noise=0 * c.noise)
    data = FAULTS["Stribeck"][0](bare) if stribeck else clean(bare)
    of_fit = found.records[0]
    record = Record(data.t, data.q, data.tau)
    equations = regression(found.initial, record, found.base, cutoff=of_fit.cutoff, folds=2).fitted
    return least_squares(equations.mapped(found.base.back), found.estimate.sigma).values
