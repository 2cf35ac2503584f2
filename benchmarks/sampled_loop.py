"""PD control with gravity compensation, sampled at 1 kHz: wall time against the largest error at the samples.

The IRB 140 with viscous friction, from rest at zero. Pinocchio's side is a Python loop of its gravity torques and of
steps of RK4 with its ABA.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pinocchio as pin

import rne
from benchmarks.hard_scenes import KD, KP, TARGET
from benchmarks.runs import TURN, Arms, Motion, Row, in_solve_ivp, measured, simulated, their_arm, tolerance

SAMPLE_TIME = 1e-3  # [s]
DURATION = 1.0  # [s]
TOLERANCES: dict[str, tuple[float, ...]] = {"RK45": (1e-4, 1e-6, 1e-8, 1e-10), "DOP853": (1e-6, 1e-10)}
STEPS = (1, 2, 4)  # of RK4 per sample


class SampledArm:
    """The sampled loop by Pinocchio."""

    def __init__(self, robot: rne.Robot) -> None:
        self.model, self.data = their_arm(robot)
        self.kp, self.kd, self.target = (np.array(x, dtype=float) for x in (KP, KD, TARGET))

    def motion(self, duration: float, step: Callable[[np.ndarray, np.ndarray], np.ndarray]) -> Motion:
        """The motion at the samples."""
        X = np.zeros((round(duration / SAMPLE_TIME) + 1, 12))
        for k in range(len(X) - 1):
            q, qd = X[k, :6], X[k, 6:]
            gravity = pin.computeGeneralizedGravity(self.model, self.data, q)
            X[k + 1] = step(X[k], gravity - self.kp * (q - self.target) - self.kd * qd)
        return X[:, :6], X[:, 6:]

    def rates(self, x: np.ndarray, u: np.ndarray) -> np.ndarray:
        """dx/dt under held torques and friction."""
        qd = x[6:]
        return np.concatenate([qd, pin.aba(self.model, self.data, x[:6], qd, u - qd)])

    def rk4_steps(self, x: np.ndarray, u: np.ndarray, count: int = 1) -> np.ndarray:
        """Steps of RK4 from one sample to the next."""
        h, f = SAMPLE_TIME / count, self.rates
        for _ in range(count):
            k1 = f(x, u)
            k2 = f(x + h / 2 * k1, u)
            k3 = f(x + h / 2 * k2, u)
            k4 = f(x + h * k3, u)
            x = x + h / 6 * (k1 + 2 * (k2 + k3) + k4)
        return x

    def solver_steps(self, x: np.ndarray, u: np.ndarray) -> np.ndarray:
        """Steps over the same span by DOP853 with tight tolerances, for the reference."""
        side: Any = (lambda _t, x: self.rates(x, u), None)
        q, qd = in_solve_ivp(side, x, SAMPLE_TIME, tolerance("DOP853", 1e-12))
        return np.concatenate([q[-1], qd[-1]])


def sampled_scene(robot: rne.Robot) -> rne.Scene:
    """Loop as a scene of rne."""
    law = rne.control.pd_gravity(robot, KP, KD, TARGET)
    return rne.Scene(robot, controller=law, sample_time=SAMPLE_TIME, friction=rne.Friction(viscous=1.0))


def run(arms: Arms, quick: bool) -> dict[str, Any]:
    """Every method and tolerance of rne, and Pinocchio's steps."""
    duration, repeats = (0.01, 1) if quick else (DURATION, 3)
    robot, x0 = arms["numpy"], np.zeros(12)
    theirs, scenes = SampledArm(robot), {engine: sampled_scene(arm) for engine, arm in arms.items()}
    exact, _ = theirs.motion(duration, theirs.solver_steps)
    times = SAMPLE_TIME * np.arange(len(exact))

    def error(motion: Motion) -> float:
        return float(np.abs(motion[0] - exact).max())

    rows: list[Row] = []
    for count in STEPS[:1] if quick else STEPS:
        call = {"pinocchio": lambda k=count: theirs.motion(duration, lambda x, u: theirs.rk4_steps(x, u, k))}
        rows.append(measured("RK4", f"{SAMPLE_TIME / count * 1e3:g} ms", call, error, repeats))
    for method, levels in TOLERANCES.items():
        for o in (tolerance(method, rtol) for rtol in (levels[:1] if quick else levels)):
            calls = {e: lambda o=o, s=s: simulated(s, x0, duration, t_eval=times, **o) for e, s in scenes.items()}
            rows.append(measured(method, f"{o['rtol']:.0e}", calls, error, repeats, turn=TURN))
    return {"duration": duration, "repeats": repeats, "robots": {robot.model.name: {"runs": rows}}}
