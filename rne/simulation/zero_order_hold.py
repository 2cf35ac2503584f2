"""Sampled controller, with its torques held from one sample to the next, perhaps with a delay.

The command of a sample acts a delay after it, until the next one does; before the first one no torque acts. If the
delay is a whole number of sample times, up to rounding, commands act exactly at the instants of samples.
"""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from ..basics.numbers import part_of
from ..basics.piecewise import NO_TABLE, NO_TABLES
from ..basics.spatial import Array
from ..control.gains import check_gains
from ..control.sampled_loop import in_periods
from ..control.traced_law import TracedLaw, is_discrete
from ..integrators.lanes import Hold, hold_of
from ..integrators.loops import StateUpdate, next_state
from .plant import Plant, checked_of_states, checked_torques
from .scene import Scene

MAX_EVALUATIONS = 20_000  # most evaluations between two samples, about a hundred times those of a stable loop
MAX_STEPS = MAX_EVALUATIONS // 10  # most steps of a motion side by side with others, which is then run separately


class ControlSamples(NamedTuple):
    """Samples of a controller: times (k,), states (k, 2 N), torques (k, n), and the controller's states (k, m)."""

    t: Array
    x: Array
    u: Array
    z: Array

    def held(self, t: Array, same: float = 0.0) -> Array:
        """Indices of the samples whose torques are held at times, or a relative rounding of them later."""
        return np.searchsorted(self.t, t * (1 + same), side="right") - 1

    def work(self, q: Array, k: Array, driven: slice) -> Array:
        """Work of the drives since the start up to positions reached under the torques of samples k [J]."""
        start = self.x[:, driven]
        done = np.append(0.0, np.cumsum((self.u[:-1] * np.diff(start, axis=0)).sum(axis=1)))
        work: Array = done[k] + ((q - start[k]) * self.u[k]).sum(axis=1)
        return work

    def first(self, count: int) -> ControlSamples:
        """First samples."""
        return ControlSamples(*(part[:count] for part in self))


class ZeroOrderHold:
    """Hold of a sampled controller: the torques held since the last sample, and the controller's states.

    The states are integrated by Euler's rule from sample to sample, those of a discrete law are given by it.
    """

    def __init__(self, scene: Scene, plant: Plant, duration: float) -> None:
        self.scene, self.plant = scene, plant
        self.period, self.is_discrete = float(scene.sample_time or 0.0), is_discrete(scene.controller)
        self.update = StateUpdate.of(self.period, discrete=self.is_discrete)
        self.delay = in_periods(min(float(scene.delay or 0.0), duration + 2 * self.period), self.period)
        self.pending = np.zeros((int(self.delay[0]) + 1, scene.n))  # the last commands, that of sample k in row k % p
        self.state = self.next_state = np.zeros(int(getattr(scene.controller, "states", 0)))  # at the last sample
        law = scene.traced_samples
        self.traced = None if law is None else plant.kernels.scene_kernel(law.outputs)  # where it is traced
        self.numbers = None if law is None else law.vector
        self.law_table = NO_TABLE if law is None else law.table
        self.moving = 2 * plant.dynamics.n  # entries of the state that samples keep
        none = np.zeros(0), np.zeros((0, self.moving)), np.zeros((0, scene.n)), np.zeros((0, len(self.state)))
        self.table = [ControlSamples(*none)]
        self.acting = [ControlSamples(*none)] if any(self.delay) else self.table  # when commands begin to act
        self.count, self.arrived = 0, 0  # samples, and commands that act or have acted
        self.evaluations_before = 0  # evaluations before the last of both
        self.limit, self.change = self.bounds()
        plant.law, plant.sampled = None, np.zeros(scene.n)  # the solver sees torques that are held

    def renew(self, t: float, x: Array) -> None:
        """Take the sample, and have the command act, that are due."""
        moved = x[: self.moving]
        if t >= self.count * self.period:
            self._sample(t, moved)
        if t >= self._arrival:
            self._act(np.array([t]), moved[None], self.pending[[self.arrived % len(self.pending)]])
        self.evaluations_before = self.plant.evaluations

    def _sample(self, t: float, moved: Array) -> None:
        """Command of the controller, within the limits of torque and torque rate."""
        held = self.pending[(self.count - 1) % len(self.pending)]
        self.state = self.next_state
        returned, of_states = self.plant.called(self.scene.controller, t, np.concatenate([moved, self.state]))
        if of_states is not None:
            checked = checked_of_states(of_states, len(self.state), t, discrete=self.is_discrete)
            self.next_state = next_state(self.update, self.state, checked)
        u = np.clip(checked_torques(self.plant.law_name, returned, self.plant.robot, t), -self.limit, self.limit)
        if self.count:
            u = np.clip(u, held - self.change, held + self.change)
        self.pending[self.count % len(self.pending)] = u
        if callable(getattr(self.scene.controller, "delivered", None)):
            self.scene.controller.delivered(u.copy())
        self._append(np.array([t]), moved[None], u[None], self.state[None])

    def bounds(self) -> Array:
        """Bounds of the torques, and of their change from one sample to the next, shape (2, n)."""
        parts = self.scene.resolved
        limit, rate = (np.inf if bound is None else bound for bound in (parts.effort_limit, parts.torque_rate))
        return np.array([np.broadcast_to(bound, self.scene.n) for bound in (limit, rate * self.period)])

    def note(self, samples: tuple[Array, ...], acting: tuple[Array, ...], states: Array, evaluations: int) -> None:
        """Record samples taken and commands begun in machine code, with the controller's states after them."""
        self._append(*samples)
        self._act(*acting)
        (self.state, self.next_state), self.evaluations_before = states, evaluations

    def _append(self, t: Array, x: Array, u: Array, z: Array) -> None:
        """Store samples; none acts before the first command."""
        if self.acting is not self.table and not self.count:
            self.acting.append(ControlSamples(t[:1], x[:1, : self.moving], np.zeros_like(u[:1]), z[:1]))
        if len(t):
            self.table.append(ControlSamples(t, x[:, : self.moving], u, z))
        self.count += len(t)

    def _act(self, t: Array, x: Array, u: Array) -> None:
        """Store commands that act from these times on."""
        if not len(t):
            return
        self.plant.sampled, self.arrived = u[-1], self.arrived + len(t)
        if self.acting is not self.table:
            self.acting.append(ControlSamples(t, x, u, np.zeros((len(t), len(self.state)))))

    @property
    def _arrival(self) -> float:
        """Time at which the next command acts."""
        late, rest = self.delay
        return (self.arrived + late) * self.period + rest

    @property
    def next(self) -> float:
        """Time of the next sample or the next command, whichever is first."""
        return min(self.count * self.period, self._arrival)

    def rewind(self, t: float) -> None:
        """Drop the samples, and the commands that began to act, after t."""
        if not self.count or t >= max(self.table[-1].t[-1], self.acting[-1].t[-1]):
            return
        samples, acting, rows = self.samples(), self.commands(), len(self.pending)
        k, self.arrived = (int(np.searchsorted(found.t, t, side="right")) for found in (samples, acting))
        self.count, self.state, self.plant.sampled = k, samples.z[k - 1], acting.u[self.arrived - 1]
        self.next_state = samples.z[k] if k < len(samples.t) else self.next_state
        last = np.arange(max(k - rows, 0), k)
        self.pending[last % rows] = samples.u[last]
        self.table[:], self.acting[:] = [samples.first(k)], [acting.first(self.arrived)]
        self.arrived -= self.acting is not self.table

    def finish(self, t: float, x: Array) -> None:
        """End the run at t: later samples are dropped, and the first value after a sample there counts."""
        self.rewind(t)
        if t >= self.count * self.period:
            u = self.pending[(self.count - 1) % len(self.pending)]
            self.table.append(ControlSamples(np.array([t]), x[None, : self.moving], u[None], self.next_state[None]))

    def samples(self) -> ControlSamples:
        """All samples so far."""
        return _joined(self.table)

    def commands(self) -> ControlSamples:
        """Torques that have acted so far: start times, states then, and the torques."""
        return _joined(self.acting)

    def stability(self) -> str:
        """Text of check_gains on the loop, in the workspace or at its start, for the error of a diverging one."""
        scene, gains = self.scene, [getattr(self.scene.controller, name, None) for name in ("kp", "kd")]
        is_rigid = scene.elastic is None and scene.resolved.springs is None and not (scene.delay or self.is_discrete)
        try:
            if is_rigid and all(gain is not None for gain in gains):
                name, robot = "rne.check_gains", scene.resolved.robot
                limit = check_gains(robot, *gains).sample_time_limit  # type: ignore[arg-type]
            else:
                with warnings.catch_warnings():  # of a law with memory: this is the text of an error
                    warnings.simplefilter("ignore")
                    found = scene.check_gains(self.samples().x[0, : scene.n])
                name, limit = "scene.check_gains", found.sample_time_limit
        except Exception:  # whatever a law raises
            return "see scene.check_gains for the sample time that it needs"
        until = f"stable up to {limit:.4g} s" if limit else "not stable at the shortest sample times"
        until = until if np.isfinite(limit) else "stable at all sample times examined"
        if self.is_discrete and 0 < limit < np.inf:
            until += ", if its states then change in proportion to the sample time"
        late = f" with its delay of {scene.delay:g} s" if scene.delay else ""
        return f"by {name} it is {until}{late}, and sampled every {self.period:g} s"


def _joined(parts: list[ControlSamples]) -> ControlSamples:
    """All rows of a table, whose parts become one."""
    if len(parts) > 1:
        parts[:] = [ControlSamples(*(np.concatenate(columns) for columns in zip(*parts, strict=True)))]
    return parts[0]


def held_side_by_side(
    scene: Scene, law: TracedLaw | None, driven: int, period: float, end: float, own: Mapping[str, Array], table: Array
) -> Hold:
    """Hold of torques of many motions, of a sampled law or of a table (N, K, n), up to an end.

    Numbers of the scene that motions have of their `own` have shapes (N, ...).
    """
    known, kernel, given, (count, _, n) = scene.numbers, None, (NO_TABLES, np.zeros(0)), table.shape
    if law is not None:
        kernel = scene.kernels.scene_kernel(law.outputs)
        mine = part_of(own, "controller.")
        numbers = law.vectors(mine) if mine else np.tile(law.vector, (count, 1)) if own else law.vector
        given = law.tables(mine), np.ascontiguousarray(kernel.coefficients(numbers))
    limit, rate = (own.get(name, known.get(name, np.inf)) for name in ("effort_limit", "torque_rate"))
    late = np.minimum(own.get("delay", known.get("delay", 0.0)), end + 2 * period)
    delays, which = np.unique(late, return_inverse=True)
    each = np.array([in_periods(delay, period) for delay in delays.tolist()])[np.broadcast_to(which, count)]
    bounds = (np.broadcast_to(bound, (count, n)) for bound in (limit, rate * period))
    rows = np.concatenate([each, np.zeros((count, 1)), *bounds], axis=1)
    timing = period, StateUpdate.of(period, discrete=law is not None and law.discrete)
    return hold_of(timing, kernel, given, table, rows, driven, MAX_STEPS if law else 2**62)
