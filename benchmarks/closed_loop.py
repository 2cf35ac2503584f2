"""The stiff closed loop of the thesis: wall time against the error of the joint positions at the end.

The IRB 140 under PD with gravity compensation. Pinocchio's side is its ABA under the same law, whose gravity torque is
Pinocchio's too, with the exact Jacobian.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pinocchio as pin

import rne
from benchmarks.runs import (
    TURN,
    WAYS,
    Arms,
    Motion,
    Side,
    by_state,
    in_solve_ivp,
    measured,
    simulated,
    their_arm,
    tolerance,
)
from rne.model.abb_irb140 import CLOSED_LOOPS, KD, KP

DURATION = 1.0  # [s]
TOLERANCES: dict[str, tuple[float, ...]] = {
    "LSODA": (1e-4, 1e-6, 1e-8, 1e-10),
    "Rodas5P": (1e-4, 1e-6, 1e-8, 1e-10),
    "Radau": (1e-4, 1e-6, 1e-8),
    "BDF": (1e-4, 1e-6, 1e-8),
    "RK45": (1e-6,),
    "DOP853": (1e-6,),
}
LOOP = CLOSED_LOOPS[0]


def their_loop(robot: rne.Robot) -> Side:
    """Pinocchio's ABA under u = g(q) - Kp (q - q_ref) - Kd qd."""
    n, kp, kd, wanted = robot.n, np.array(KP), np.array(KD), np.array(LOOP.reference)
    model, data = their_arm(robot)

    def law(x: np.ndarray) -> np.ndarray:
        torque: np.ndarray = pin.computeGeneralizedGravity(model, data, x[:n]) - kp * (x[:n] - wanted) - kd * x[n:]
        return torque

    def rates(_t: float, x: np.ndarray) -> np.ndarray:
        return np.concatenate([x[n:], pin.aba(model, data, x[:n], x[n:], law(x))])

    def jacobian(_t: float, x: np.ndarray) -> np.ndarray:
        by_q = pin.computeGeneralizedGravityDerivatives(model, data, x[:n]) - np.diag(kp)
        dq, dqd, dtau = pin.computeABADerivatives(model, data, x[:n], x[n:], law(x))
        return by_state(dq + dtau @ by_q, dqd - dtau * kd)

    return rates, jacobian


def reference(scene: rne.Scene, theirs: Side, x0: np.ndarray, rtol: float) -> tuple[np.ndarray, float]:
    """The joint positions at the end by our Radau, and the largest difference of LSODA and of Pinocchio's Radau."""
    tight = {m: tolerance(m, rtol) for m in ("Radau", "LSODA")}
    end, other = (simulated(scene, x0, DURATION, **o)[0][-1] for o in tight.values())
    third = in_solve_ivp(theirs, x0, DURATION, tight["Radau"])[0][-1]
    return end, float(max(np.abs(other - end).max(), np.abs(third - end).max()))


def run(arms: Arms, quick: bool) -> dict[str, Any]:
    """On the IRB 140; Rodas5P, which is machine code, has no counterpart."""
    robot, scenes = arms["numpy"], {}
    for engine, arm in arms.items():
        scenes[engine] = rne.Scene(arm, controller=rne.control.pd_gravity(arm, KP, KD, LOOP.reference))
    scene = scenes["numpy"]
    x0 = np.concatenate([LOOP.start, np.zeros(robot.n)])
    theirs = their_loop(robot)
    end, uncertain = reference(scene, theirs, x0, 1e-8 if quick else 1e-12)
    tolerances = {"LSODA": TOLERANCES["LSODA"][:2]} if quick else TOLERANCES
    repeats = 1 if quick else 3
    rows = []

    def error(motion: Motion) -> float:
        return float(np.abs(motion[0][-1] - end).max())

    for method, levels in tolerances.items():
        by = {e: s for e, s in scenes.items() if method != "Rodas5P" or e == "numba"}
        for o in (tolerance(method, rtol) for rtol in levels if by):
            calls = {"pinocchio": lambda o=o: in_solve_ivp(theirs, x0, DURATION, o)} if len(by) == len(scenes) else {}
            calls |= {engine: lambda o=o, s=s: simulated(s, x0, DURATION, **o) for engine, s in by.items()}
            rows.append(measured(method, f"{o['rtol']:.0e}", calls, error, repeats, turn=TURN))
    auto = {WAYS[e]: rne.simulate(s, LOOP.start, [0] * robot.n, DURATION).method for e, s in scenes.items()}
    chosen = " and ".join(f"{method} ({way})" for way, method in auto.items())
    found = {robot.model.name: {"reference_uncertainty": uncertain, "runs": rows, "auto": chosen}}
    return {"duration": DURATION, "repeats": repeats, "robots": found}
