"""Numbers of planted motions found without torques, and how sure: python -m benchmarks.motion_fit

A pendulum and an SO-101 under the law of a hobby servo, an IRB 140 with its wrist locked and a UR5 under PD, follow
commands of 50 to 500 Hz after a delay; encoders of 14 or 17 bits round the positions. Friction is one of five laws.
Gains or bodies are known, the other numbers start 50 % off. `--runs` is how many, `--first` the first of them, `--kind`
whether something is left out of the model; `--quick` means 8 and writes no file.
Writes benchmarks/results/motion_fit.json and the tables of docs/benchmarks/motion_fit.md.
"""

from __future__ import annotations

import argparse
import json
import tempfile
import time
import warnings
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from scipy.stats import chi2

import rne
from benchmarks.measure import RESULTS, write
from benchmarks.pages import DOCS, rewrite, table
from rne.identification import MotionFit, Record
from rne.identification.motion.unknowns import regrouped, rotors
from rne.trajectories import sampled

PAGE = DOCS / "benchmarks" / "motion_fit.md"
FRICTIONS = "viscous", "Coulomb", "Stribeck", "load", "by direction"
SMOOTHING = 0.05  # [rad/s]
PENDULUM = """<robot name="pendulum"><link name="base"/><link name="arm"><inertial><origin xyz="0.01 0 -0.1"/>
<mass value="0.3"/><inertia ixx="4e-4" iyy="5e-4" izz="2e-4" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="joint_1" type="revolute"><parent link="base"/><child link="arm"/><axis xyz="0 1 0"/>
<limit lower="-3" upper="3" effort="3" velocity="6"/></joint></robot>"""


class Arm(NamedTuple):
    """A robot under its controller, and the size of its friction."""

    scene: rne.Scene
    torque: np.ndarray  # of each joint, of which friction is a part [N m]
    rotors: bool


def servos(robot: rne.Robot, kp: float, stall: float) -> Any:
    return rne.control.servo(robot, kp, 0.02 * kp, 0.0, stall_torque=stall, no_load_speed=6.0)


def arm_named(name: str, engine: str) -> Arm:
    """One of the four."""
    if name == "pendulum":
        with tempfile.TemporaryDirectory() as folder:
            (Path(folder) / "pendulum.urdf").write_text(PENDULUM)
            robot = rne.load(Path(folder) / "pendulum.urdf", engine=engine)
        return Arm(rne.Scene(robot, controller=servos(robot, 6.0, 1.8), armature=0.006), np.array([0.4]), False)
    if name == "SO-101":
        robot = rne.load("so101", engine=engine)
        locked = {robot.joint_names[-1]: 0.0}
        inner = rne.Scene(robot, locked=locked).resolved.robot
        scene = rne.Scene(robot, locked=locked, controller=servos(inner, 18.0, 1.9), armature=0.028)
        return Arm(scene, np.array([0.3, 0.8, 0.6, 0.3, 0.2]), False)
    if name == "IRB 140":
        robot, locked = rne.load("irb140", engine=engine), {"joint_4": 0.0, "joint_5": 0.0, "joint_6": 0.0}
        inner = rne.Scene(robot, locked=locked).resolved.robot
        law = rne.control.pd(inner, [2000, 2500, 1000], [150, 180, 60], 0)
        scene = rne.Scene(robot, locked=locked, controller=law, armature=[1.5, 1.2, 0.6])
        return Arm(scene, np.array([60.0, 120.0, 50.0]), True)
    robot = rne.load("ur5", engine=engine)
    law = rne.control.pd(robot, [3000, 3000, 2000, 500, 400, 300], [250, 250, 150, 30, 25, 15], 0)
    scene = rne.Scene(robot, controller=law, armature=[1, 1, 0.7, 0.2, 0.2, 0.2])
    return Arm(scene, np.array([40, 60, 30, 8, 6, 3.0]), True)


ARMS = "pendulum", "IRB 140", "SO-101", "UR5"


def friction(kind: str, torque: np.ndarray) -> dict[str, Any]:
    """Sizes of one of the laws."""
    found: dict[str, Any] = {"viscous": 0.1 * torque, "smoothing": SMOOTHING}
    if kind != "viscous":
        found["coulomb"] = 0.15 * torque
    if kind == "Stribeck":
        found |= {"stribeck_rise": 0.08 * torque, "stribeck": 0.15}
    if kind == "load":
        found["load"] = 0.1
    if kind == "by direction":
        found |= {"coulomb_back": 0.22 * torque, "viscous_back": 0.15 * torque}
    return found


class Planted(NamedTuple):
    """A log, the scene that made it, and the one from which a fit starts."""

    record: Record
    truth: rne.Scene
    start: rne.Scene
    wrt: tuple[str, ...]
    delay: float
    step: float


def commands(rng: np.random.Generator, t: np.ndarray, n: int) -> np.ndarray:
    """Sums of sines that start at rest, with steps that are held for half a second in the second half."""
    q = np.zeros((len(t), n))
    for _ in range(4):
        f, size, phase = rng.uniform(0.1, 1.2, n), rng.uniform(0.05, 0.3, n), rng.uniform(0, 2 * np.pi, n)
        q += size * (np.sin(2 * np.pi * f * t[:, None] + phase) - np.sin(phase))
    steps = rng.uniform(-0.3, 0.3, (int(t[-1] / 0.5) + 2, n))
    steps[: len(steps) // 2] = 0.0
    return q + steps[(t / 0.5).astype(int)]


def planted(
    name: str, seed: int, engine: str = "numba", bits: int = 0, rate: float = 0.0, lacking: str = ""
) -> Planted:
    """A log of ten seconds, and a scene from which something may be left out."""
    rng = np.random.default_rng([seed, ARMS.index(name)])
    arm = arm_named(name, engine)
    n, kind = arm.scene.n, FRICTIONS[seed % len(FRICTIONS)]
    rate = rate or float(rng.choice([50.0, 100.0, 200.0, 500.0]))
    step = 2 * np.pi / 2 ** (bits or int(rng.choice([14, 17])))
    t = np.arange(0, 10, 1 / rate)
    command, delay = commands(rng, t, n), float(rng.uniform(0, 1.5) / rate)
    truth = replace(arm.scene, friction=rne.Friction(**friction(kind, arm.torque)))
    reference = sampled(np.concatenate([[-1.0], t + delay]), np.concatenate([command[:1], command]), "hold")
    moving = replace(truth, controller=replace(truth.controller, reference=reference))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        motion = rne.simulate(moving, command[0], np.zeros(n), t[-1], t_eval=t, rtol=1e-10, atol=1e-12)
    record = Record(t, np.round(motion.q / step) * step, command=command, name=f"{name} {seed}")
    names = [x for x in truth.numbers if x.startswith(("friction.", "controller."))]
    constant = "smoothing", "dead_band", "reference", "stribeck"
    names = [x for x in names if not x.endswith(constant) and truth.numbers[x].any()]
    names += ["armature"] * arm.rotors
    known = seed % 2 == 0  # bodies, or gains
    if not known:
        names = [x for x in names if not x.startswith("controller.")] + ["parameters"]
        if arm.rotors:
            names.remove("armature")
    factor = {x: 1 + 0.5 * rng.choice([-1.0, 1.0], truth.numbers[x].shape) for x in names}
    if "parameters" in factor:
        factor["parameters"] = np.repeat(1 + 0.5 * rng.choice([-1.0, 1.0], len(truth.numbers["parameters"]) // 10), 10)
    if "friction.load" in factor:
        factor["friction.load"][:] = 0.5
    modelled = truth
    if lacking:
        names = [x for x in names if lacking not in x]
        sizes = {name: x for name, x in friction(kind, arm.torque).items() if lacking not in name}
        modelled = replace(truth, friction=rne.Friction(**sizes))
    start = modelled.with_numbers({x: truth.numbers[x] * factor[x] for x in names})
    wrt = tuple(names) if lacking == "delay" else (*names, "command.delay")
    return Planted(record, truth, start, wrt, delay, step)


def judged(case: Planted, found: MotionFit) -> dict[str, Any]:
    """Deviations in standard errors, of determined numbers, and whether all together are likely."""
    unknowns = found.problem.unknowns
    x = []
    for part in unknowns.parts:
        if part.name == "command.delay":
            x.append([case.delay])
        elif part.name == "parameters":
            robot = case.truth.resolved.robot
            _, matrix = regrouped(robot)
            x.append(matrix @ np.append(robot.parameters, rotors(robot)))
        else:
            own = part.directions.T @ case.truth.numbers[part.name].reshape(-1)
            x.append(np.where(part.is_log, np.log(np.where(part.is_log, own, 1.0)), own))
    d = found.z[: found.certainty.count] - np.concatenate(x)
    own = found.determined
    C = found.certainty.covariance[np.ix_(own, own)]
    size = np.sqrt(np.diag(C))
    w, V = np.linalg.eigh(C / size[:, None] / size)
    kept = w > 1e-10 * w.max(initial=1)
    square = float((((V.T @ (d[own] / size)) ** 2)[kept] / w[kept]).sum())
    return {
        "numbers": int(own.sum()),
        "beyond": int((np.abs(d[own]) > 3 * size).sum()),
        "worst": round(float(np.abs(d[own] / size).max(initial=0.0)), 3),
        "undetermined": int((~own).sum()),
        "together": bool(square < chi2.ppf(0.95, max(kept.sum(), 1))),
        "explained": bool(found.explained.all()),
        "causes": [cause.kind for cause in found.causes],
        "residual": round(float((found.rms / case.step).max()), 3),
    }


def run(name: str, seed: int, **how: Any) -> dict[str, Any]:
    """One fit."""
    case = planted(name, seed, **how)
    began = time.process_time()
    found = rne.identify_motion(case.start, case.record, case.wrt)
    spent = time.process_time() - began
    return judged(case, found) | {
        "robot": name,
        "seed": seed,
        "seconds": round(spent, 2),
        "friction": FRICTIONS[seed % 5],
        **how,
    }


KINDS: dict[str, dict[str, Any]] = {
    "complete": {},
    "12 bits at 500 Hz": {"bits": 12, "rate": 500.0},
    "without Coulomb friction": {"lacking": "coulomb"},
    "without the delay": {"lacking": "delay"},
}


def tables(found: dict[str, Any]) -> dict[str, str]:
    """Tables of the page."""
    rows = []
    for kind in KINDS:
        for name in (*ARMS, "all"):
            own = [r for r in found.get(kind, []) if name in (r["robot"], "all")]
            if not own:
                continue
            numbers, beyond = sum(r["numbers"] for r in own), sum(r["beyond"] for r in own)
            likely = 100 * np.mean([r["together"] for r in own])
            said = sum(bool(r["causes"]) or not r["explained"] for r in own)
            cells = [str(numbers), str(sum(r["undetermined"] for r in own)), f"{100 * (1 - beyond / numbers):.1f}"]
            spent = np.median([r["seconds"] for r in own])
            rows.append([kind, name, str(len(own)), *cells, f"{likely:.0f}", str(said), f"{spent:.1f}"])
    head = [
        "model",
        "robot",
        "logs",
        "numbers",
        "not determined",
        "within 3 s.e. [%]",
        "together [%]",
        "said",
        "CPU [s]",
    ]
    return {"planted": table(head, rows)}


def keep(**changed: list[dict[str, Any]]) -> None:
    """Write the results, those that were not measured again as they were, and the page's tables."""
    path = RESULTS / "motion_fit.json"
    last = json.loads(path.read_text(encoding="utf-8")) if path.exists() else {}
    kept = {kind: last.get(kind, []) for kind in KINDS} | changed
    write(path.name, kept)
    rewrite(tables(kept), PAGE)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--runs", type=int, default=200)
    parser.add_argument("--kind", choices=tuple(KINDS), default="complete")
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--quick", action="store_true")
    given = parser.parse_args()
    rows = []
    for k in range(given.first, given.first + (8 if given.quick else given.runs)):
        rows.append(run(ARMS[k % len(ARMS)], k // len(ARMS), **KINDS[given.kind]))
        print(rows[-1], flush=True)
        if not given.quick and len(rows) % 8 == 0:
            keep(**{given.kind: rows})
    if not given.quick:
        keep(**{given.kind: rows})


if __name__ == "__main__":
    main()
