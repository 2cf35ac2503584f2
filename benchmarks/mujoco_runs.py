"""MuJoCo's own integrators with equal steps, from the same start and on the same grid of times."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

import rne
from benchmarks.peers import PEERS
from benchmarks.peers.mujoco import MuJoCo
from benchmarks.runs import Motion

INTEGRATORS = {
    "Euler": "mjINT_EULER",
    "implicit": "mjINT_IMPLICIT",
    "implicitfast": "mjINT_IMPLICITFAST",
    "RK4": "mjINT_RK4",
}


def stepper(robot: rne.Robot, x0: np.ndarray, grid: np.ndarray) -> Callable[[str, float], Motion] | str:
    """A call (integrator, step) for the motion on the grid, or the reason why there is none.

    Without damping and constraints Euler is the semi-implicit one: rates first, positions with the new rates.
    """
    if reason := PEERS["MuJoCo"].missing():
        return reason
    try:
        theirs = MuJoCo(robot.model)
    except ValueError as error:
        return str(error)
    mj, model, n = theirs.mujoco, theirs.model, robot.n

    def run(integrator: str, step: float) -> Motion:
        model.opt.integrator = int(getattr(mj.mjtIntegrator, INTEGRATORS[integrator]))
        model.opt.timestep = step
        data = mj.MjData(model)
        data.qpos[:], data.qvel[:] = x0[:n], x0[n:]
        steps = np.round(grid / step).astype(int)
        if np.abs(steps * step - grid).max() > 1e-9 * grid[-1]:
            raise ValueError(f"steps of {step:g} s do not meet the grid")
        x = np.tile(x0, (len(grid), 1))
        for k, count in enumerate(np.diff(steps), start=1):
            mj.mj_step(model, data, nstep=int(count))
            x[k, :n], x[k, n:] = data.qpos, data.qvel
        return x[:, :n], x[:, n:]

    return run
