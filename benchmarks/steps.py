"""Steps of many arms under torques of their own: python -m benchmarks.steps [--quick]

`rne.Stepper` of a UR5 with rotors and effort limits, one control interval of 20 ms in four steps, in machine code and
by NumPy, beside MuJoCo's `rollout` of the same arm on one thread: with friction, ours smoothed by tanh, MuJoCo's the
damping and frictionloss of its joints, and without. All take turns; seconds are those of the processor. The error is
that of the positions at the end, against intervals of ten times as many steps by the same engine: the median over
states of the largest joint's. Writes benchmarks/results/steps.json.
"""

from __future__ import annotations

import statistics
from collections.abc import Callable
from dataclasses import dataclass
from time import process_time
from typing import Any

import numpy as np

import rne
from benchmarks.cases import engines, load
from benchmarks.measure import QUICK_NOTE, interleaved, is_quick, ratio, write
from benchmarks.mujoco_runs import INTEGRATORS
from benchmarks.peers import PEERS
from benchmarks.peers.mujoco import MuJoCo

STATES, INTERVAL, SUBSTEPS, FINER = 4096, 0.02, 4, 10  # [s]
ROTORS, VISCOUS, COULOMB, SMOOTHING = 0.1, 2.0, 3.0, 0.1  # [kg m^2], [N m s/rad], [N m], [rad/s]
METHODS = {"rk4": "RK4", "semi-implicit-euler": "Euler"}  # MuJoCo's by ours; both Eulers have implicit damping
SCENES = ("friction", "none")
Starts = tuple[np.ndarray, np.ndarray, np.ndarray]


@dataclass(frozen=True)
class Way:
    """A call that takes the steps of all states, how many states these are, and the error of their positions."""

    call: Callable[[], Any]
    states: int
    error: float


def error_of(fine: np.ndarray, found: np.ndarray) -> float:
    """The median over states of the largest joint's error [rad]."""
    return float(np.median(np.abs(found - fine)[:, :6].max(axis=1)))


def scene_of(friction: str, engine: str) -> rne.Scene:
    """The arm."""
    kinds = {"friction": rne.Friction(viscous=VISCOUS, coulomb=COULOMB, smoothing=SMOOTHING), "none": None}
    return rne.Scene(load("ur5", engine), friction=kinds[friction], armature=ROTORS, effort_limit="urdf")


def ours(friction: str, method: str, engine: str, starts: Starts) -> dict[str, Way]:
    """An interval, and the gradient of one."""
    q, qd, u = starts
    stepper, fine = (rne.Stepper(scene_of(friction, engine), INTERVAL, k * SUBSTEPS, method) for k in (1, FINER))
    x, weights = stepper.start(q, qd), np.ones((len(q), stepper.size))
    out = np.empty_like(x)
    error = error_of(fine(x, u), stepper(x, u))
    found = {"step": Way(lambda: stepper.into(x, u, out), len(q), error)}
    if engine == "numba":
        found["gradient"] = Way(lambda: stepper.gradient(x, u, weights), len(q), error)
    return found


def theirs(friction: str, method: str, starts: Starts) -> Way:
    """MuJoCo's rollout over the interval, the torques within the limits held."""
    import mujoco
    from mujoco import rollout

    scene = scene_of(friction, "numpy")
    limit = scene.resolved.effort_limit
    q, qd, u = starts
    model = MuJoCo(scene.robot.model).model
    model.dof_armature[:] = ROTORS
    model.opt.integrator = int(getattr(mujoco.mjtIntegrator, INTEGRATORS[METHODS[method]]))
    if friction == "friction":
        model.dof_damping[:], model.dof_frictionloss[:] = VISCOUS, COULOMB
        model.opt.disableflags &= ~int(mujoco.mjtDisableBit.mjDSBL_CONSTRAINT)
    data, state = mujoco.MjData(model), np.hstack([np.zeros((len(q), 1)), q, qd])
    spec = int(mujoco.mjtState.mjSTATE_QFRC_APPLIED)

    torques = {k: np.repeat(np.clip(u, -limit, limit)[:, None], k, axis=1) for k in (SUBSTEPS, FINER * SUBSTEPS)}

    def run(substeps: int) -> np.ndarray:
        model.opt.timestep = INTERVAL / substeps
        found, _ = rollout.rollout(model, data, state, torques[substeps], control_spec=spec)
        return np.asarray(found[:, -1, 1:])

    return Way(lambda: run(SUBSTEPS), len(q), error_of(run(FINER * SUBSTEPS), run(SUBSTEPS)))


def ways_of(friction: str, method: str, starts: Starts) -> dict[str, Way]:
    """All that take the steps of one scene by one method; NumPy and MuJoCo fewer states."""
    few: Starts = tuple(a[: max(1, len(a) // 8)] for a in starts)  # type: ignore[assignment]
    found = {}
    for engine in engines():
        of_engine = ours(friction, method, engine, starts if engine == "numba" else few)
        found |= {f"{engine}, {what}": way for what, way in of_engine.items()}
    if not PEERS["MuJoCo"].missing():
        found["MuJoCo, step"] = theirs(friction, method, few)
    return found


def measured(friction: str, method: str, starts: Starts, repeats: int) -> dict[str, Any]:
    """Millions of steps a second of one core by each way, errors, and ratios of times per step."""
    ways = ways_of(friction, method, starts)
    seconds = interleaved({name: way.call for name, way in ways.items()}, repeats, clock=process_time)
    each = {name: [s / (way.states * SUBSTEPS) for s in seconds[name]] for name, way in ways.items()}
    found: dict[str, Any] = {"friction": friction, "method": method}
    found["million_steps"] = {name: 1e-6 / statistics.median(s) for name, s in each.items()}
    found["errors"] = {name: way.error for name, way in ways.items()}
    if "numba, step" in each:
        found["gradient_over_step"] = ratio(each, "numba, gradient", "numba, step")
        found |= {"mujoco_over_ours": ratio(each, "MuJoCo, step", "numba, step")} if "MuJoCo, step" in each else {}
    return found


def shown(row: dict[str, Any]) -> list[str]:
    """Lines of the table."""
    lines = []
    for name, speed in row["million_steps"].items():
        beside = {"numba, gradient": "gradient_over_step", "MuJoCo, step": "mujoco_over_ours"}.get(name, "")
        times = "{:.1f} ({:.1f} to {:.1f})".format(*row[beside]) if beside in row else ""
        lines.append(
            f"| {row['friction']} | {row['method']} | {name} | {speed:.3g} | {times} | {row['errors'][name]:.1e} |"
        )
    return lines


def main() -> None:
    quick = is_quick(__doc__)
    rng, states = np.random.default_rng(0), 64 if quick else STATES
    starts = rng.uniform(-1, 1, (states, 6)), rng.uniform(-1, 1, (states, 6)), rng.uniform(-60, 60, (states, 6))
    print("| friction | method | by | million steps a second | times a step of ours | error of positions [rad] |")
    print("|---|---|---|---|---|---|")
    rows = []
    for friction in SCENES:
        for method in METHODS:
            rows.append(measured(friction, method, starts, 1 if quick else 9))
            print("\n".join(shown(rows[-1])), flush=True)
    if quick:
        print(QUICK_NOTE)
        return
    decay = (VISCOUS + COULOMB / SMOOTHING) / ROTORS
    plan = {
        "states": states,
        "interval": INTERVAL,
        "substeps": SUBSTEPS,
        "decay_times_step": decay * INTERVAL / SUBSTEPS,
    }
    write("steps.json", plan | {"rows": rows})


if __name__ == "__main__":
    main()
