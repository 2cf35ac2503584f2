"""A fit without torques beside differences of MuJoCo's rollouts: python -m benchmarks.motion_fit_peers [--quick]

An IRB 140 with its wrist locked under PD, 10 s, 100 commands and samples of 14-bit encoders a second. Both fit the same
numbers and starts to the same log from 50 % off: rne.identify_motion, and MuJoCo by `mujoco.rollout`, forward
differences of p + 1 motions, as mujoco.sysid takes them, and scipy.optimize.least_squares. MuJoCo has no smooth Coulomb
friction, and delays between its steps only; the log has neither. One core, CPU times of calls that take turns. Then one
Jacobian of 17 numbers, and a whole fit in a fresh process. Writes benchmarks/results/motion_fit_peers.json and tables
of docs/benchmarks/motion_fit_peers.md.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import replace
from statistics import median
from typing import Any

import numpy as np
from scipy.optimize import least_squares

import rne
from benchmarks.measure import QUICK_NOTE, interleaved, is_quick, ratio, write
from benchmarks.pages import DOCS, rewrite, table
from rne.identification import Record
from rne.simulation.commanded import CommandedMotion
from rne.trajectories import sampled

PAGE = DOCS / "benchmarks" / "motion_fit_peers.md"
RATE, STEP, BITS = 100, 2.5e-3, 14  # [1/s], [s]
KP, KD = np.array([2000.0, 2500.0, 1200.0]), np.array([120.0, 150.0, 70.0])
VISCOUS, COULOMB, ROTORS = np.array([8.0, 9.0, 5.0]), np.array([9.0, 10.0, 6.0]), np.array([6.0, 5.0, 3.0])
WRT = ("controller.kp", "friction.viscous", "armature", "command.offset")
OF_JACOBIAN = ("controller.kp", "controller.kd", "friction.viscous", "friction.coulomb", "armature")
DIFFERENCE = 1e-6  # of logarithms, and of positions: forward, for times
CENTRAL = 1e-5  # central, of the solution to which both are compared
Results = dict[str, Any]


def arm(engine: str, coulomb: Any = 0.0, factor: float = 1.0) -> rne.Scene:
    """The scene, with numbers times a factor."""
    whole = rne.load("irb140", engine=engine)
    robot = rne.Scene(whole, locked=dict.fromkeys(whole.joint_names[3:], 0.0)).resolved.robot
    robot = robot.with_armature((factor * ROTORS).tolist())
    law = rne.control.pd(robot, factor * KP, KD, np.zeros(3))
    friction = rne.Friction(viscous=factor * VISCOUS, coulomb=coulomb, smoothing=0.05)
    return rne.Scene(robot, controller=law, friction=friction)


def commands(t: np.ndarray) -> np.ndarray:
    """Sines of three frequencies."""
    a, b, c = 0.6 * np.sin(1.7 * t + np.sin(t)), 0.4 * np.sin(1.3 * t + 1) - 0.3, 0.2 + 0.5 * np.sin(2.1 * t)
    return np.column_stack([a, b, c])


def planted(scene: rne.Scene, end: float) -> Record:
    """A motion by rne.simulate, rounded by encoders."""
    t = np.arange(round(end * RATE) + 1) / RATE
    command = commands(t)
    law = replace(scene.controller, reference=sampled(t, command, "hold"))
    q = rne.simulate(replace(scene, controller=law), command[0], [0.0] * 3, end, t_eval=t, rtol=1e-10, atol=1e-12).q
    size = 2 * np.pi / 2**BITS
    return Record(t, np.round(q / size) * size, command=command)


class ByMuJoCo:
    """Residuals of rne's problem at a step, by rollouts in MuJoCo."""

    def __init__(self, problem: Any, integrator: str, step: float) -> None:
        import mujoco
        from mujoco import rollout

        self.problem, self.mujoco, self.rollout, scene = problem, mujoco, rollout.rollout, problem.unknowns.scene
        robot, self.shot = scene.resolved.robot, problem.shots[0]
        self.command = problem.records[0].command
        spec = mujoco.MjSpec.from_string(rne.to_urdf(robot.model))
        for name in robot.model.moving_joints:
            drive = spec.add_actuator()
            drive.name = drive.target = name
            drive.trntype, drive.biastype = mujoco.mjtTrn.mjTRN_JOINT, mujoco.mjtBias.mjBIAS_AFFINE
        self.model = spec.compile()
        self.model.opt.gravity[:] = robot.model.gravity
        self.model.dof_frictionloss[:], self.model.jnt_actfrclimited[:] = 0.0, 0
        self.model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONSTRAINT)
        self.model.opt.integrator = int(getattr(mujoco.mjtIntegrator, f"mjINT_{integrator.upper()}"))
        self.model.opt.timestep, self.size = step, mujoco.mj_stateSize(self.model, mujoco.mjtState.mjSTATE_FULLPHYSICS)
        mujoco.set_mju_user_warning(lambda _: None)  # of trials that a step refuses
        self.data, self.each = mujoco.MjData(self.model), round(1 / RATE / step)

    def positions(self, rows: np.ndarray) -> np.ndarray:
        """Positions for several z, (N, T, 3)."""
        P, models, starts, controls = len(self.problem.unknowns.labels), [], [], []
        for z in rows:
            numbers = self.problem.unknowns.numbers(z[:P])
            model = self.mujoco.MjModel.__copy__(self.model)
            kp = numbers["controller.kp"]
            model.actuator_gainprm[:, 0], model.dof_damping[:] = kp, numbers["friction.viscous"]
            model.actuator_biasprm[:, 1], model.actuator_biasprm[:, 2] = -kp, -KD
            model.dof_armature[:] = numbers["armature"]
            models.append(model)
            starts.append(np.concatenate([[0.0], z[P:], np.zeros(self.size - 1 - len(z[P:]))]))
            controls.append(np.repeat(self.command[:-1] + numbers["command.offset"], self.each, axis=0))
        found = self.rollout(models, self.data, np.array(starts), np.array(controls))[0]
        return np.concatenate([rows[:, None, P : P + 3], found[:, self.each - 1 :: self.each, 1:4]], axis=1)

    def residuals(self, rows: np.ndarray) -> np.ndarray:
        """Residuals for several z, (N, rows), weighted as by rne."""
        left = (self.positions(rows) - self.shot.q) / self.problem.sigma
        return np.concatenate([left.reshape(len(rows), -1), (rows - self.problem.first) / self.problem.spread], axis=1)

    def jacobian(self, z: np.ndarray) -> np.ndarray:
        """Forward differences: p + 1 rollouts."""
        found = self.residuals(np.vstack([z, z + DIFFERENCE * np.eye(len(z))]))
        return np.asarray((found[1:] - found[0]).T / DIFFERENCE)

    def central(self, z: np.ndarray) -> np.ndarray:
        """Central differences."""
        h = CENTRAL * np.eye(len(z))
        high, low = self.residuals(z + h), self.residuals(z - h)
        return np.asarray((high - low).T / (2 * CENTRAL))

    def fit(self, z: np.ndarray, jacobian: Callable[[np.ndarray], np.ndarray]) -> Any:
        """By scipy.optimize.least_squares."""
        how: dict[str, Any] = {"x_scale": self.problem.spread, "ftol": 1e-11, "xtol": 1e-10, "gtol": 1e-12}
        return least_squares(lambda z: self.residuals(z[None])[0], z, jacobian, max_nfev=60, **how)


def beside(quick: bool) -> Results:
    """Both on the same log."""
    end = 1.0 if quick else 10.0
    scene = arm("numba")
    record, off = planted(scene, end), arm("numba", factor=1.5)
    options: dict[str, Any] = {"starts": 1, "step": STEP}
    fit = rne.identify_motion(off, record, WRT, **options)
    problem, repeats = fit.problem, 1 if quick else 3
    calls: dict[str, Callable[[], Any]] = {"rne": lambda: problem.slopes(fit.z)}
    whole: dict[str, Callable[[], Any]] = {"rne": lambda: rne.identify_motion(off, record, WRT, **options)}
    found: Results = {"columns": len(fit.z), "end": end, "step": STEP, "deviations": {}}
    for integrator in ("RK4", "implicitfast"):
        theirs = ByMuJoCo(problem, integrator, STEP)
        calls[integrator] = lambda theirs=theirs: theirs.jacobian(fit.z)  # type: ignore[misc]
        whole[integrator] = lambda theirs=theirs: theirs.fit(problem.first, theirs.jacobian)  # type: ignore[misc]
    ours, exact = fit, ByMuJoCo(problem, "RK4", STEP)
    reached = exact.fit(ours.z, exact.central).x
    deviation = np.abs(reached - ours.z)[: len(ours.names)] / ours.certainty.std
    found["deviations"]["RK4"] = float(deviation.max())
    theirs = ByMuJoCo(problem, "implicitfast", STEP)
    deviation = np.abs(theirs.fit(ours.z, theirs.central).x - ours.z)[: len(ours.names)] / ours.certainty.std
    found["deviations"]["implicitfast"] = float(deviation.max())
    for title, both in (("jacobian", calls), ("fit", whole)):
        seconds = interleaved(both, repeats, clock=time.process_time)
        found[title] = {name: median(runs) for name, runs in seconds.items()}
        found[f"{title}, times"] = {name: ratio(seconds, name, "rne") for name in both if name != "rne"}
    return found


def jacobians(quick: bool) -> Results:
    """One of 17 numbers, and of the start, RK4 of 2.5 ms."""
    found: Results = {}
    taken = {name: np.eye(3) for name in OF_JACOBIAN}
    taken |= {"friction.smoothing": np.eye(1), "command.delay": np.eye(1)}
    t = np.arange((100 if quick else 1000) + 1) / RATE
    start, command = np.array([commands(t)[0], np.zeros(3)]), (0.004, np.ones(3), np.zeros(3))
    for engine in ("numba", "numpy"):
        scene = arm(engine, COULOMB)
        scene = replace(scene, controller=replace(scene.controller, reference=sampled(t, commands(t), "hold")))
        motion = CommandedMotion.of(scene, tuple(taken)[:-1], 0.0, t, taken, STEP)
        vectors = motion.vectors({})
        calls = {
            "derivatives": lambda motion=motion, vectors=vectors: motion.derivatives(vectors, command, start),
            "positions": lambda motion=motion, vectors=vectors: motion.positions(vectors, command, start),
        }
        seconds = interleaved(calls, 1 if quick or engine == "numpy" else 15, clock=time.process_time)
        found[engine] = {name: median(runs) for name, runs in seconds.items()}
    return found


FRESH = """
import time
from benchmarks.motion_fit_peers import COULOMB, arm, planted
import rne
begin = time.process_time()
record = planted(arm("numba", COULOMB), 10.0)
middle = time.process_time()
names = ["controller.kp", "friction.viscous", "friction.coulomb", "armature", "command.delay"]
rne.identify_motion(arm("numba", 1.5 * COULOMB, 1.5), record, names)
print(middle - begin, time.process_time() - middle)
"""


def fresh() -> Results:
    """CPU time of a whole fit in a new process whose cache on disk is empty, then full."""
    found: Results = {}
    with tempfile.TemporaryDirectory() as folder:
        own = os.environ | {"RNE_CACHE": folder, "NUMBA_CACHE_DIR": folder}
        for name in ("cold", "warm"):
            run = subprocess.run([sys.executable, "-c", FRESH], capture_output=True, text=True, check=True, env=own)
            found[name] = float(run.stdout.split()[1])
    return found


def tables(found: Results) -> dict[str, str]:
    """Tables of the page."""
    own, rows = found["beside"], []
    for name in ("rne", "RK4", "implicitfast"):
        title = "rne.identify_motion" if name == "rne" else f"MuJoCo, {name}"
        times = [own[key][name] for key in ("jacobian", "fit")]
        cells = ["-"] * 3
        if name != "rne":
            cells = ["{:.0f} ({:.0f} to {:.0f})".format(*own[f"{key}, times"][name]) for key in ("jacobian", "fit")]
            cells.append(f"{own['deviations'][name]:.1e}")
        rows.append([title, f"{1e3 * times[0]:.1f}", cells[0], f"{times[1]:.2f}", cells[1], cells[2]])
    heads = ["10 s, 12 numbers and the start", "Jacobian [ms]", "times rne", "fit [s]", "times rne", "off by"]
    costs = [
        [e, *(f"{1e3 * found['jacobians'][e][k]:.1f}" for k in ("positions", "derivatives"))]
        for e in found["jacobians"]
    ]
    new = [[name, f"{seconds:.1f}"] for name, seconds in found["fresh"].items()]
    return {
        "peers": table(heads, rows),
        "jacobian": table(["engine", "motion [ms]", "with derivatives by 17 numbers and the start [ms]"], costs),
        "fresh": table(["cache on disk", "CPU time [s]"], new),
    }


def main() -> None:
    quick = is_quick(__doc__)
    found = {"beside": beside(quick), "jacobians": jacobians(quick)}
    if quick:
        print(*tables(found | {"fresh": {}}).values(), QUICK_NOTE, sep="\n")
        return
    found["fresh"] = fresh()
    print(found)
    write("motion_fit_peers.json", found)
    rewrite(tables(found), PAGE)


if __name__ == "__main__":
    main()
