"""Long free swings: wall time against energy drift, the largest |E(t) - E(0)| on a grid of times.

The grid and the energy function are the same for all. Between its steps a SciPy method interpolates; equal steps meet
the grid. gauss-4 is a symplectic method for comparison, in benchmarks/gauss.py.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from benchmarks.gauss import swing
from benchmarks.mujoco_runs import INTEGRATORS, stepper
from benchmarks.runs import TURN, Arms, Motion, Row, in_solve_ivp, measured, simulated, start, their_side, tolerance


class Plan(NamedTuple):
    """A duration and the settings of each method."""

    duration: float  # [s]
    samples: int  # of the energy, beside that at the start
    repeats: int
    tolerances: Mapping[str, tuple[float, ...]]  # of SciPy's methods
    steps: Mapping[str, tuple[float, ...]]  # of Gauss's method [s]
    mujoco: Mapping[str, tuple[float, ...]]  # of MuJoCo's integrators [s]


PLANS = {
    "10 s": Plan(
        10.0,
        1000,
        2,
        {"RK45": (1e-4, 1e-6, 1e-8), "DOP853": (1e-5, 1e-8, 1e-10), "LSODA": (1e-6, 1e-8), "Radau": (1e-3, 1e-4)},
        {"gauss-4": (1e-2, 5e-3)},
        dict.fromkeys(INTEGRATORS, (1e-2, 2e-3, 5e-4)),
    ),
    "100 s": Plan(
        100.0,
        1000,
        1,
        {"RK45": (1e-5, 1e-8), "DOP853": (1e-6, 1e-8)},
        {"gauss-4": (1e-2, 5e-3)},
        dict.fromkeys(("Euler", "implicit", "RK4"), (2e-3, 5e-4)),
    ),
}


def shortened(plan: Plan) -> Plan:
    """A quarter of a second, one setting per method."""
    first = [{name: values[:1] for name, values in settings.items()} for settings in plan[3:]]
    return Plan(0.25, 25, 1, *first)


def compare(arms: Arms, plan: Plan) -> dict[str, Any]:
    """Every method and setting, without warm-up: a short run compiles the kernels first."""
    robot = arms["numpy"]
    x0, duration = start(robot.n), plan.duration
    grid = np.linspace(0.0, duration, plan.samples + 1)
    theirs = their_side(robot)
    for arm in arms.values():
        for method in plan.tolerances:
            simulated(arm, x0, 0.05, method=method, t_eval=[0.05])
        swing(arm, x0, grid[:2], 0.01)

    def drift(motion: Motion) -> float:
        energy = robot.kinetic_energy(*motion) + robot.potential_energy(motion[0])
        return float(np.abs(energy - energy[0]).max())

    def timed(method: str, setting: str, calls: dict[str, Any]) -> Row:
        return measured(method, setting, calls, drift, plan.repeats, warm_ups=0, turn=TURN)

    def ours(**o: Any) -> dict[str, Any]:
        return {name: lambda arm=arm: simulated(arm, x0, duration, t_eval=grid, **o) for name, arm in arms.items()}

    rows = []
    for method, levels in plan.tolerances.items():
        for o in (tolerance(method, rtol) for rtol in levels):
            calls = {"pinocchio": lambda o=o: in_solve_ivp(theirs, x0, duration, o, t_eval=grid)}
            rows.append(timed(method, f"{o['rtol']:.0e}", calls | ours(**o)))
    for method, steps in plan.steps.items():
        for h in steps:
            calls = {name: lambda arm=arm, h=h: swing(arm, x0, grid, h) for name, arm in arms.items()}
            rows.append(timed(method, f"{h * 1e3:g} ms", calls))
    peer = stepper(robot, x0, grid)
    if isinstance(peer, str):
        return {"runs": rows, "refused": {"MuJoCo": peer}}
    for method, steps in plan.mujoco.items():
        rows += [timed(method, f"{h * 1e3:g} ms", {"mujoco": lambda m=method, h=h: peer(m, h)}) for h in steps]
    return {"runs": rows, "refused": {}}


def run(found: Mapping[str, Arms], length: str, quick: bool) -> dict[str, Any]:
    """On each robot."""
    plan = shortened(PLANS[length]) if quick else PLANS[length]
    rows = {name: compare(arms, plan) for name, arms in found.items()}
    return {"duration": plan.duration, "repeats": plan.repeats, "robots": rows}
