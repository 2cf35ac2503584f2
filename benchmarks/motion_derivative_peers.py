"""Gradients of a motion by other means: differences, CasADi, JAX around our machine code, rollouts in MuJoCo.

Each function gives a call that returns derivatives of the cost of the pose's scene by name. All take equal steps of
Runge-Kutta's method of order 4 but where their names say more.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

import rne
from benchmarks.motion_derivative_cases import (
    GOAL,
    KD,
    KP,
    OF_POSE,
    POSE,
    ROTORS,
    START,
    VISCOUS,
    by_names,
    differences,
    final,
    rates,
    values,
)
from benchmarks.peers.registry import import_failure

Array = np.ndarray
Slopes = dict[str, Array]
ONE_CORE = "--xla_cpu_multi_thread_eigen=false intra_op_parallelism_threads=1"


def by_ensemble(scene: rne.Scene, end: float, step: float, share: float) -> Callable[[], Slopes]:
    """Differences of `rne.ensemble`, all motions side by side."""

    def costs(cases: list[Slopes]) -> Array:
        together = {name: np.array([case[name] for case in cases]) for name in OF_POSE}
        starts = together.pop("q0"), together.pop("qd0")
        motions = rne.ensemble(scene, *starts, end, step=step, numbers=together, keep=2)
        return np.asarray(final(motions.q[-1], motions.qd[-1]))

    return lambda: differences(costs, values(scene, OF_POSE), share)


def by_simulate(scene: rne.Scene, end: float, share: float) -> Callable[[], Slopes]:
    """Differences of `rne.simulate` with its own step control, one motion after another."""

    def cost(case: Slopes) -> float:
        own = {name: x for name, x in case.items() if name not in ("q0", "qd0")}
        motion = rne.simulate(scene, case["q0"], case["qd0"], end, numbers=own)
        return float(final(motion.q[-1], motion.qd[-1]))

    return lambda: differences(lambda cases: np.array([cost(case) for case in cases]), values(scene, OF_POSE), share)


def by_casadi(scene: rne.Scene, end: float, step: float) -> dict[str, Callable[[], Slopes]]:
    """CasADi's reverse mode of our equations, of steps that it maps one after another, by its machine and in C."""
    import casadi as ca

    kernel, places, vector = rates(scene, OF_POSE)
    f, count = kernel.to_casadi(), round(end / step)
    x, p = (ca.MX.sym(name, width) for name, width in zip("xp", kernel.widths[1:], strict=True))
    k1 = f(0.0, x, p)
    k2 = f(0.0, x + step / 2 * k1, p)
    k3 = f(0.0, x + step / 2 * k2, p)
    k4 = f(0.0, x + step * k3, p)
    one = ca.Function("one", [x, p], [x + step / 6 * (k1 + 2 * k2 + 2 * k3 + k4)])
    reached = one.fold(count)(x, ca.repmat(p, 1, count))
    cost = ca.sumsqr(reached[: len(START[0])] - GOAL) + ca.sumsqr(reached[len(START[0]) :])
    gradient = ca.Function("gradient", [x, p], [cost, ca.gradient(cost, x), ca.gradient(cost, p)])
    made = {"CasADi": gradient}
    if shutil.which("cc"):
        made["CasADi in C"] = in_c(gradient)

    def call(function: Any) -> Slopes:
        _, by_start, by_numbers = function(np.concatenate(START), vector)
        return by_names(np.asarray(by_start).ravel(), np.asarray(by_numbers).ravel(), places)

    return {name: lambda function=function: call(function) for name, function in made.items()}


def in_c(function: Any) -> Any:
    """A CasADi function by the C that it writes, compiled."""
    import casadi as ca

    folder = Path(tempfile.mkdtemp())
    before = Path.cwd()
    os.chdir(folder)  # CasADi writes where it stands
    try:
        function.generate("gradient.c")
        options = "-O3", "-march=native", "-shared", "-fPIC"
        subprocess.run(["cc", *options, "gradient.c", "-o", "gradient.so"], check=True)
    finally:
        os.chdir(before)
    return ca.external(function.name(), str(folder / "gradient.so"))


def by_jax(scene: rne.Scene, end: float, step: float) -> Callable[[], Slopes]:
    """JAX's reverse mode of a scan over steps, in which XLA calls our machine code and its gradient."""
    os.environ["XLA_FLAGS"] = ONE_CORE
    import jax
    import jax.numpy as jnp

    jax.config.update("jax_enable_x64", True)
    kernel, places, vector = rates(scene, OF_POSE, "numba")
    function = kernel.to_jax()

    def cost(x: Any, p: Any) -> Any:
        def one(x: Any, _: None) -> tuple[Any, None]:
            t = jnp.zeros(1)
            k1 = function(t, x, p)
            k2 = function(t, x + step / 2 * k1, p)
            k3 = function(t, x + step / 2 * k2, p)
            k4 = function(t, x + step * k3, p)
            return x + step / 6 * (k1 + 2 * k2 + 2 * k3 + k4), None

        return final(*jnp.split(jax.lax.scan(one, x, None, length=round(end / step))[0], 2))

    gradient, given = jax.jit(jax.grad(cost, (0, 1))), (jnp.asarray(np.concatenate(START)), jnp.asarray(vector))
    return lambda: by_names(*map(np.asarray, jax.block_until_ready(gradient(*given))), places)


class Rollouts:
    """MuJoCo's `rollout` of the pose's scene, one thread; PD control by its actuators, gravity by its compensation."""

    def __init__(self, robot: rne.Robot, integrator: str, step: float) -> None:
        import mujoco
        from mujoco import rollout

        self.mujoco, self.rollout = mujoco, rollout.rollout
        spec = mujoco.MjSpec.from_string(rne.to_urdf(robot.model))
        for body in spec.bodies:
            body.gravcomp = 1.0
        for name in robot.model.moving_joints:
            drive = spec.add_actuator()
            drive.name = drive.target = name
            drive.trntype, drive.biastype = mujoco.mjtTrn.mjTRN_JOINT, mujoco.mjtBias.mjBIAS_AFFINE
        self.model = spec.compile()
        self.model.opt.gravity[:], self.model.dof_armature[:] = robot.model.gravity, ROTORS
        self.model.dof_frictionloss[:], self.model.jnt_actfrclimited[:] = 0.0, 0
        self.model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONSTRAINT)
        self.model.opt.integrator = int(getattr(mujoco.mjtIntegrator, f"mjINT_{integrator.upper()}"))
        self.model.opt.timestep, self.size = step, mujoco.mj_stateSize(self.model, mujoco.mjtState.mjSTATE_FULLPHYSICS)
        self.data = mujoco.MjData(self.model)

    def at(self, case: Slopes) -> Any:
        """A model with other numbers."""
        found = self.mujoco.MjModel.__copy__(self.model)
        kp, kd = case["controller.kp"], case["controller.kd"]
        found.actuator_gainprm[:, 0], found.dof_damping[:] = kp, case["friction.viscous"]
        found.actuator_biasprm[:, 1], found.actuator_biasprm[:, 2] = -kp, -kd
        return found

    def states(self, cases: list[Slopes], end: float) -> Array:
        """Positions and rates after each step, (N, K, 2 n)."""
        n = self.model.nv
        starts = np.zeros((len(cases), self.size))
        starts[:, 1 : 1 + 2 * n] = [np.concatenate([case["q0"], case["qd0"]]) for case in cases]
        targets = np.array([case["controller.reference"] for case in cases])[:, None]
        count = round(end / self.model.opt.timestep)
        found = self.rollout([self.at(c) for c in cases], self.data, starts, targets, nstep=count)[0]
        return np.asarray(found[:, :, 1 : 1 + 2 * n])

    def costs(self, cases: list[Slopes], end: float) -> Array:
        """The cost of each end."""
        return np.asarray(final(*np.split(self.states(cases, end)[:, -1], 2, axis=1)))


NOMINAL: Slopes = {
    "q0": START[0],
    "qd0": START[1],
    "controller.kp": KP,
    "controller.kd": KD,
    "controller.reference": POSE,
    "friction.viscous": np.full(6, VISCOUS),
}


def by_mujoco(robot: rne.Robot, end: float, step: float, integrator: str, share: float) -> Callable[[], Slopes]:
    """Differences of rollouts in MuJoCo."""
    theirs = Rollouts(robot, integrator, step)
    return lambda: differences(lambda cases: theirs.costs(cases, end), NOMINAL, share)


def missing(name: str) -> str | None:
    """Why a package takes no part, or None."""
    return import_failure(name)
