"""One run of the simulation loop: its task, its result, and the Trajectory made of it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from ..basics.spatial import Array
from ..errors import NotFiniteError, SingularMassMatrixError
from .events import Stop
from .plant import Plant
from .trajectory import Trajectory

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
    status: int
    ending: str
    u: Array | None  # torques that were held, where they were
    qdd: Array | None  # accelerations, where they do not follow from time, state and torques
    controller_state: Array | None  # states of a sampled controller
    energies: Mapping[str, Array]  # of the ledger, (T,) each
    failure: Failure | None
    method: str
    ends: Run | None = None  # the same just before the ends of segments, where something may jump


def build_trajectory(plant: Plant, task: Task, run: Run, reason: str) -> tuple[Trajectory, Failure | None]:
    """The motion with its torques and energies, up to the first instant that is not finite."""
    rhs = plant.rhs
    n = rhs.robot.n
    tau, qdd, failure = _torques_and_accelerations(plant, run._replace(t=_just_after(run.t, task.breaks)))
    failure = run.failure or failure
    T = len(tau)
    if run.qdd is not None:
        qdd = run.qdd[:T]
    t, x = run.t[:T], run.x[:T]
    q, qd, z = x[:, :n], x[:, n : 2 * n], x[:, 2 * n : 2 * n + rhs.controller_states]
    entries = {name: energy[:T] for name, energy in run.energies.items()}
    work = entries.pop("drives", np.zeros(T))
    kinetic, potential = rhs.robot.kinetic_energy(q, qd), rhs.robot.potential_energy(q)
    energy = kinetic + potential
    taken = sum(entries.values(), np.zeros(T))
    start = float(rhs.robot.kinetic_energy(*np.split(task.x0[: 2 * n], 2)) + rhs.robot.potential_energy(task.x0[:n]))
    drift = float(np.abs(energy - start - work + taken).max()) if T else 0.0
    jumps, qdd_before, tau_before = _jumps(plant, run.ends, t, qdd, tau)
    motion = Trajectory(
        t,
        q,
        qd,
        qdd,
        tau,
        kinetic,
        potential,
        energy,
        work,
        drift,
        plant.evaluations,
        run.method,
        -1 if failure else run.status,
        failure.cause if failure else f"{reason}; {run.ending}",
        entries,
        z if run.controller_state is None else run.controller_state[:T],
        start,
        model=rhs.robot.model,
        jumps=jumps,
        qdd_before=qdd_before,
        tau_before=tau_before,
        at_steps=task.t_eval is None,
    )
    return motion, failure


def _jumps(plant: Plant, ends: Run | None, t: Array, qdd: Array, tau: Array) -> tuple[Array, Array, Array]:
    """Times at which accelerations or torques jump, and both just before."""
    if ends is None or not len(ends.t) or not len(t):
        return np.zeros(0), np.zeros((0, plant.robot.n)), np.zeros((0, plant.robot.n))
    tau_before, qdd_before, _ = _torques_and_accelerations(plant, ends)
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


def _torques_and_accelerations(plant: Plant, run: Run) -> tuple[Array, Array, Failure | None]:
    """Torques and accelerations of every instant up to the first that is not finite or where M is singular."""
    n = plant.robot.n
    try:
        u = run.u
        if u is None and plant.law is not None:
            u = plant.torques_at(run.t, run.x)
        rates = plant.all_rates(run.t, run.x, u)
        drives = plant.drives_under(run.t, run.x, u)
        tau = np.zeros((len(run.t), n)) if drives is None else drives
        return tau, rates[:, n : 2 * n], None
    except (NotFiniteError, SingularMassMatrixError, ValueError):  # found by looking at each
        return _one_by_one(plant, run)


def _one_by_one(plant: Plant, run: Run) -> tuple[Array, Array, Failure | None]:
    n = plant.robot.n
    tau, qdd = np.zeros((len(run.t), n)), np.zeros((len(run.t), n))
    for k, (time, x) in enumerate(zip(run.t.tolist(), run.x, strict=True)):
        try:
            u = plant.torque(time, x) if run.u is None else run.u[k]
            drives, _ = plant.rhs.drives(np.array([time]), x, u)
            tau[k] = 0.0 if drives is None else drives
            qdd[k] = plant.rates(time, x, u)[n : 2 * n]
        except (NotFiniteError, SingularMassMatrixError) as error:
            return tau[:k], qdd[:k], Failure(time, str(error))
    return tau, qdd, None
