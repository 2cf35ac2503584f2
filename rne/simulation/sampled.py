"""Sampled control: the torques are computed at the samples and held in between, each sample met exactly."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..basics.spatial import Array
from ..errors import NotFiniteError
from .continuous import IMPLICIT, stop_message, tolerances
from .equations_of_motion import torques_and_rates
from .events import first_crossing
from .plant import Plant
from .scene import Scene
from .scipy_solvers import FAILURES, guarded_solver
from .trajectory import Run, Task

MAX_EVALUATIONS = 50_000  # of the right-hand side between two samples, some hundred times what a stable loop takes


class ZeroOrderHold:
    """A controller that is sampled: the torques held since the last sample, and the controller's states."""

    def __init__(self, scene: Scene, plant: Plant) -> None:
        self.scene, self.plant = scene, plant
        self.period = float(scene.sample_time or 0.0)
        self.controller_state = np.zeros(int(getattr(scene.controller, "states", 0)))
        self.held = np.zeros(scene.n)
        self.first = True

    def sample(self, t: float, x: Array) -> Array:
        """The torques to hold until the next sample, within the limits of torque and torque rate."""
        u = np.asarray(self.plant.torque(t, x))
        if self.scene.resolved.torque_limit is not None:
            u = np.clip(u, -self.scene.resolved.torque_limit, self.scene.resolved.torque_limit)
        if self.scene.resolved.torque_rate is not None and not self.first:
            step = self.scene.resolved.torque_rate * self.period
            u = np.clip(u, self.held - step, self.held + step)
        self.held, self.first = u, False
        return u

    def law(self, t: float, q: Array, qd: Array) -> Array:
        """The controller; its states are integrated by Euler's rule from sample to sample."""
        if not self.controller_state.size:
            return np.asarray(self.scene.controller(t, q, qd))
        u, rates = torques_and_rates(self.scene.controller(t, q, qd, self.controller_state))
        self.controller_state = self.controller_state + self.period * np.asarray(rates)
        return np.asarray(u)


@dataclass
class _Record:
    """The samples to report: at `t_eval`, or those of the controller."""

    t_eval: Array | None
    t: list[float]
    x: list[Array]
    u: list[Array]
    controller_state: list[Array]

    def step(self, solver: Any, end: float, u: Array, z: Array) -> None:
        """Add the values at `t_eval` within the solver's last step, up to `end`."""
        if self.t_eval is None:
            return
        k, stop = len(self.t), int(np.searchsorted(self.t_eval, end, side="right"))
        if stop > k:
            dense = solver.dense_output()
            for time in self.t_eval[k:stop]:
                self.add(float(time), np.array(solver.y if time == solver.t else dense(time)), u, z)

    def add(self, t: float, x: Array, u: Array, z: Array) -> None:
        self.t.append(t)
        self.x.append(x)
        self.u.append(u)
        self.controller_state.append(z)


def sampled_run(scene: Scene, plant: Plant, task: Task, failures: list[tuple[float, str]]) -> Run:
    """Run from sample to sample with one explicit solver, whose stored derivative is renewed at each sample."""
    if task.method in IMPLICIT:
        raise ValueError(f"`method` of a sampled scene must be an explicit one, got {task.method!r}")
    if scene.resolved.friction is not None and scene.resolved.friction.sticks:
        raise ValueError("a sampled scene cannot have friction that sticks; give the friction a `smoothing`")
    holder = ZeroOrderHold(scene, plant)
    plant.law = holder.law
    record, x0 = _Record(task.t_eval, [], [], [], []), task.x0
    count = int(np.ceil(task.duration / holder.period * (1 - 1e-12)))
    stop = None
    try:
        stop = _samples(holder, plant, task, count, record, failures)
    except FAILURES as error:
        failures.append((getattr(error, "time", None) or 0.0, str(error)))
    shape = (len(record.t), len(x0))
    u = np.array(record.u).reshape(len(record.t), scene.n)
    ending = stop or f"the controller was sampled {count} times, every {holder.period:g} s"
    states = np.array(record.controller_state).reshape(len(record.t), len(holder.controller_state))
    return Run(np.array(record.t), np.array(record.x).reshape(shape), int(stop is not None), ending, u, None, states)


def _samples(
    holder: ZeroOrderHold, plant: Plant, task: Task, count: int, record: _Record, failures: list[tuple[float, str]]
) -> str | None:
    """Integrate over all samples; returns the message of the event that stopped the run, or None."""
    rtol, atol = tolerances(plant, task)
    solver, x, duration = None, task.x0, task.duration
    for k in range(count):
        begin, end = k * holder.period, (k + 1) * holder.period if k + 1 < count else duration
        z = holder.controller_state
        u = holder.sample(begin, x)
        asked = record.t_eval is None or (k == 0 and len(record.t_eval) and record.t_eval[0] == 0)
        if asked:
            record.add(begin, x, u, z)
        if solver is None:
            solver = guarded_solver(task.method, failures, [x])(
                lambda t, y: _held(plant, t, y, holder), begin, x, end, rtol=rtol, atol=atol, first_step=end - begin
            )
        else:  # the same solver goes on: its stored slope, end and status (RungeKutta's) are renewed
            solver.t_bound, solver.status = end, "running"
            solver.f = solver.fun(begin, x)
        begun = plant.evaluations
        while solver.status == "running":
            solver.step()
            _check_work(plant, solver, begun)
            if solver.status == "failed":
                return None
            hit = first_stop(task.events, solver) if task.events else None
            record.step(solver, solver.t if hit is None else hit[0], u, z)
            if hit is not None:
                if not record.t or record.t[-1] < hit[0]:
                    record.add(hit[0], hit[1], u, z)
                return hit[2]
        x = np.array(solver.y)
    if record.t_eval is None and count:
        record.add(duration, x, holder.held, holder.controller_state)
    return None


def _check_work(plant: Plant, solver: Any, begun: int) -> None:
    """Stop a diverging loop, whose steps become ever shorter, after bounded work."""
    if plant.evaluations - begun <= MAX_EVALUATIONS:
        return
    n = plant.robot.n
    rates = np.abs(solver.y[n : 2 * n])
    k = int(np.argmax(rates))
    raise NotFiniteError(
        f"more than {MAX_EVALUATIONS} evaluations within one sample at t = {solver.t:.6g} s, where "
        f"{plant.robot.joint_names[k]!r} moves at {rates[k]:.3g} rad/s or m/s: the sampled loop is unstable, see "
        "rne.check_gains",
        float(solver.t),
    )


def first_stop(events: Sequence[Any], solver: Any) -> tuple[float, Array, str] | None:
    """Time, state and message of the first stop that the solver's last step has passed."""
    from scipy.optimize import brentq

    dense = solver.dense_output()
    crossing = first_crossing(events, dense, solver.t_old, solver.t)
    if crossing is None:
        return None
    event = events[crossing.event]
    when = float(brentq(lambda t: event(t, dense(t)), crossing.before, crossing.after, xtol=1e-14))
    return when, np.asarray(dense(when)), stop_message(event, when)


def first_torques(scene: Scene, plant: Plant, x0: Array) -> Array:
    """The controller's torques at the start."""
    holder = ZeroOrderHold(scene, plant)
    plant.law = holder.law
    return holder.sample(0.0, x0)


def _held(plant: Plant, t: float, x: Array, holder: ZeroOrderHold) -> Array:
    plant.evaluations += 1
    return plant.rates(t, x, holder.held)
