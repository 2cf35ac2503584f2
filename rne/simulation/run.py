"""One run of the simulation loop: its task, its result, and the Trajectory made of it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from ..basics.spatial import Array
from ..errors import NotFiniteError, SingularMassMatrixError
from .events import Stop
from .interpolation import between
from .ledger import Ledger
from .plant import SAME, Plant, ZeroOrderHold
from .symplectic import STEP
from .trajectory import Trajectory, trajectory_later

FINER = 100.0  # times smaller tolerances
FINEST, SMALLEST = 2.3e-14, 1e-20  # tolerances that SciPy's solvers take
MARGIN, PARTS = 1.1, 8  # the repetition has an error too; it is compared so often within a step
EPS = float(np.finfo(np.float64).eps)
ROUNDING = 1e-9  # of the largest value of a joint: what differs by less has not jumped


class Task(NamedTuple):
    """The task of a run."""

    x0: Array
    duration: float
    method: str
    rtol: float
    atol: float
    t_eval: Array | None = None
    step: float | None = None
    breaks: Sequence[float] = ()
    stops: Sequence[Stop] = ()
    is_auto: bool = False  # True if the method may be changed while the run goes on


class Failure(NamedTuple):
    """Why a run ended before its time."""

    time: float
    cause: str


class Run(NamedTuple):
    """The result of a run."""

    t: Array
    x: Array
    qdd: Array | None  # accelerations, where they do not follow from time, state and torques
    hold: ZeroOrderHold | None = None  # of a sampled controller
    status: int = 0
    ending: str = ""
    ledger: Ledger | None = None
    failure: Failure | None = None
    method: str = ""
    ends: Run | None = None  # the same just before the ends of segments, where something may jump

    def held(self, same: float = SAME) -> Array | None:
        """The torques that are held, (T, n), where they are; after a sample those that begin there, up to rounding."""
        if self.hold is None:
            return None
        samples = self.hold.samples()
        return samples.u[samples.held(self.t, same)]

    def before_samples(self) -> Run | None:
        """The same just before each sample."""
        if self.hold is None:
            return None
        samples = self.hold.samples()
        within = (samples.t > 0) & (samples.t < self.t[-1])
        return Run(np.nextafter(samples.t[within], 0.0), samples.x[within], None, self.hold)


def repeated_error(repeat: Callable[[Task], Run], n: int, task: Task, run: Run) -> tuple[Array, Array]:
    """Times, eight in each of the solver's steps, and the largest difference of a position from a more accurate run.

    The other run starts one rounding beside, so that what rounding grows to is seen. Where the tolerances are at
    rounding already, they are coarser, and the difference is an upper bound. The steps of "gauss-4" are halved.

    Parameters
    ----------
    repeat : callable
        Runs a task of the same scene.
    n : int
        Number of positions.
    task : Task
    run : Run
        The result of the task.
    """
    task = task._replace(duration=float(run.t[-1]) if len(run.t) else 0.0)  # of a run that failed or was stopped
    steps = run.t if task.t_eval is None else repeat(task._replace(t_eval=None)).t
    times = between(steps, PARTS)
    run = repeat(task._replace(t_eval=times))
    factor = 1 / FINER if task.rtol / FINER >= FINEST else FINER
    again = repeat(
        task._replace(
            x0=task.x0 * (1 + EPS),
            rtol=task.rtol * factor,
            atol=max(task.atol * factor, SMALLEST),
            step=(task.step or STEP) / 2,
            t_eval=times,
            method=run.method,
            is_auto=False,
        )
    )
    count = min(len(run.t), len(again.t))  # a stop may have come earlier
    difference = np.abs(run.x[:count, :n] - again.x[:count, :n]).max(axis=1, initial=0.0)
    return run.t[:count], MARGIN * difference


def build_trajectory(
    plant: Plant, task: Task, run: Run, reason: str, scene: Any, **known: Any
) -> tuple[Trajectory, Failure | None]:
    """The motion; its torques and energies up to the first instant that is not finite.

    Where no law must be called, they are computed when they are asked for.
    """
    rhs, T = plant.rhs, len(run.t)
    later = partial(_derived, plant, task, run, scene)
    failure, derived = run.failure, None
    if failure is not None or plant.law is not None:
        derived = later(may_fail=True)
        found = derived.pop("failure")
        T, failure = len(derived["tau"]), failure or found
    n = rhs.robot.n
    known |= {
        "t": run.t[:T],
        "q": run.x[:T, :n],
        "qd": run.x[:T, n : 2 * n],
        "evaluations": plant.evaluations,
        "method": run.method,
        "status": -1 if failure else run.status,
        "message": failure.cause if failure else f"{reason}; {run.ending}",
        "model": rhs.robot.model,
        "at_steps": task.t_eval is None,
    }
    return (trajectory_later(known, later) if derived is None else Trajectory(**known, **derived)), failure


def _derived(plant: Plant, task: Task, run: Run, scene: Any, *, may_fail: bool = False) -> dict[str, Any]:
    """Torques, accelerations and energies of a motion, and its jumps; the failure where there may be one."""
    robot, n = plant.robot, plant.robot.n
    now = run._replace(t=_just_after(run.t, task.breaks))
    tau, qdd, failure = _torques_and_accelerations(plant, now, run.held())
    if failure is not None and not may_fail:
        raise NotFiniteError(failure.cause, failure.time)
    T = len(tau)
    qdd = qdd if run.qdd is None else run.qdd[:T]
    t, q, qd = run.t[:T], run.x[:T, :n], run.x[:T, n : 2 * n]
    entries, work = {}, np.zeros(T)
    if run.ledger is not None:
        entries = dict(zip(run.ledger.names, run.ledger.at(t).T, strict=True))
        work = entries.pop("drives", work)
    z = run.x[:T, 2 * n : 2 * n + plant.rhs.controller_states]
    if run.hold is not None:
        samples = run.hold.samples()
        held = samples.held(t, SAME)
        z, work = samples.z[held], samples.work(q, held)
    kinetic, potential = robot.kinetic_energy(q, qd), robot.potential_energy(q)
    q0, qd0 = task.x0[:n], task.x0[n : 2 * n]
    start = float(robot.kinetic_energy(q0, qd0) + robot.potential_energy(q0))
    balance = kinetic + potential - start - work + sum(entries.values(), np.zeros(T))
    ends = run.ends if run.qdd is not None or task.t_eval is not None or run.hold is None else run.before_samples()
    jumps, qdd_before, tau_before = _jumps(plant, ends, t, qdd, tau)
    found: dict[str, Any] = {"qdd": qdd, "tau": tau, "kinetic": kinetic, "potential": potential}
    found |= {"energy": kinetic + potential, "controller_state": z, "scene": repr(scene)}
    found |= {"work": work, "dissipated": entries, "energy_start": start}
    found |= {"energy_drift": float(np.abs(balance).max()) if T else 0.0}
    found |= {"jumps": jumps, "qdd_before": qdd_before, "tau_before": tau_before}
    return found | {"failure": failure} if may_fail else found


def _jumps(plant: Plant, ends: Run | None, t: Array, qdd: Array, tau: Array) -> tuple[Array, Array, Array]:
    """Times at which accelerations or torques jump, and both just before."""
    if ends is None or not len(ends.t) or not len(t):
        return np.zeros(0), np.zeros((0, plant.robot.n)), np.zeros((0, plant.robot.n))
    tau_before, qdd_before, _ = _torques_and_accelerations(plant, ends, ends.held(0.0))
    if ends.qdd is not None:
        qdd_before = ends.qdd[: len(tau_before)]
    place = np.searchsorted(t, ends.t[: len(tau_before)], side="right")
    reported = place < len(t)
    place, tau_before, qdd_before = place[reported], tau_before[reported], qdd_before[reported]
    jumps = _differs(tau, tau_before, place) | _differs(qdd, qdd_before, place)
    return t[place[jumps]], qdd_before[jumps], tau_before[jumps]


def _differs(values: Array, before: Array, place: Array) -> Array:
    """Whether any joint's value before differs from the one after, shape (K,)."""
    after, largest = values[place], np.abs(values).max(axis=0, initial=0.0)
    differs: Array = (np.abs(after - before) > ROUNDING * largest).any(axis=-1)
    return differs


def _just_after(t: Array, breaks: Sequence[float]) -> Array:
    """The times, those at which torques jump moved on by rounding, where their values are the ones after the jump."""
    return np.where(np.isin(t, breaks), np.nextafter(t, np.inf), t)


def _torques_and_accelerations(plant: Plant, run: Run, u: Array | None) -> tuple[Array, Array, Failure | None]:
    """Torques and accelerations of every instant up to the first that is not finite or where M is singular."""
    n = plant.robot.n
    try:
        given = plant.torques_at(run.t, run.x) if u is None and plant.law is not None else u
        rates = plant.all_rates(run.t, run.x, given)
        drives = plant.drives_under(run.t, run.x, given)
        tau = np.zeros((len(run.t), n)) if drives is None else drives
        return tau, rates[:, n : 2 * n], None
    except (NotFiniteError, SingularMassMatrixError, ValueError):  # found by looking at each
        return _one_by_one(plant, run, u)


def _one_by_one(plant: Plant, run: Run, held: Array | None) -> tuple[Array, Array, Failure | None]:
    n = plant.robot.n
    tau, qdd = np.zeros((len(run.t), n)), np.zeros((len(run.t), n))
    for k, (time, x) in enumerate(zip(run.t.tolist(), run.x, strict=True)):
        try:
            u = plant.torque(time, x) if held is None else held[k]
            drives, _ = plant.rhs.drives(np.array([time]), x, u)
            tau[k] = 0.0 if drives is None else drives
            qdd[k] = plant.rates(time, x, u)[n : 2 * n]
        except (NotFiniteError, SingularMassMatrixError) as error:
            return tau[:k], qdd[:k], Failure(time, str(error))
    return tau, qdd, None
