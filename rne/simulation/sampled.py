"""Sampled control: the torques are computed at the samples and held in between."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..basics.spatial import Array
from ..control.gains import check_gains
from .law import torques_and_rates
from .plant import Plant
from .scene import Scene

SAME = 8 * float(np.finfo(np.float64).eps)  # relative: times that are equal up to rounding


class Samples(NamedTuple):
    """Samples of a controller: times (k,), states (k, 2 n), torques (k, n), and the controller's states (k, m)."""

    t: Array
    x: Array
    u: Array
    z: Array

    def held(self, t: Array, same: float = 0.0) -> Array:
        """Numbers of the samples whose torques are held at times, or a relative rounding of them later."""
        return np.searchsorted(self.t, t * (1 + same), side="right") - 1

    def work(self, q: Array, k: Array) -> Array:
        """Work of the drives since the start up to positions reached under the torques of samples k [J]."""
        start = self.x[:, : q.shape[1]]
        done = np.append(0.0, np.cumsum((self.u[:-1] * np.diff(start, axis=0)).sum(axis=1)))
        work: Array = done[k] + ((q - start[k]) * self.u[k]).sum(axis=1)
        return work


MAX_EVALUATIONS = 20_000  # of the right-hand side between two samples, some hundred times what a stable loop takes


class ZeroOrderHold:
    """A controller that is sampled: the torques held since the last sample, and the controller's states.

    The states are integrated by Euler's rule from sample to sample.

    Attributes
    ----------
    state : ndarray
        The controller's states at the last sample.
    traced : AppliedTorques or None
        The law, where it is traced.
    """

    def __init__(self, scene: Scene, plant: Plant) -> None:
        self.scene, self.plant = scene, plant
        self.period = float(scene.sample_time or 0.0)
        self.state = self.next_state = np.zeros(int(getattr(scene.controller, "states", 0)))
        self.traced = scene.traced_samples
        self.table: list[Samples] = []
        self.count, self.evaluations_before = 0, 0  # samples, and evaluations before the last one
        self._caller = Plant(plant.rhs, self._law, plant.law_name)
        plant.law, plant.held = None, np.zeros(scene.n)  # the solver sees torques that are held

    def sample(self, t: float, x: Array) -> None:
        """Renew the torques that the plant holds, within the limits of torque and torque rate."""
        parts, held = self.scene.resolved, np.asarray(self.plant.held)
        self.state = self.next_state
        u = np.asarray(self._caller.torque(t, x))
        if parts.effort_limit is not None:
            u = np.clip(u, -parts.effort_limit, parts.effort_limit)
        if parts.torque_rate is not None and self.count:
            step = parts.torque_rate * self.period
            u = np.clip(u, held - step, held + step)
        self.plant.held = u
        self._append(Samples(np.array([t]), x[None, : 2 * len(u)], u[None], self.state[None]))
        self.evaluations_before = self.plant.evaluations

    def bounds(self) -> Array:
        """Bounds of the torques, and of their change from one sample to the next, shape (2, n)."""
        parts = self.scene.resolved
        limit, rate = (np.inf if bound is None else bound for bound in (parts.effort_limit, parts.torque_rate))
        return np.array([np.broadcast_to(bound, self.scene.n) for bound in (limit, rate * self.period)])

    def note(self, samples: Samples, states: Array, evaluations: int) -> None:
        """Samples were taken in machine code: with the controller's states at the last and the next one."""
        self._append(samples)
        self.state, self.next_state = states
        self.plant.held, self.evaluations_before = samples.u[-1], evaluations

    def _append(self, samples: Samples) -> None:
        self.table.append(samples)
        self.count += len(samples.t)

    @property
    def next(self) -> float:
        """Time of the next sample."""
        return self.count * self.period

    def rewind(self, t: float) -> None:
        """What was sampled behind t is void."""
        if self.table and t < self.table[-1].t[-1]:
            samples = self.samples()
            k = self.count = int(np.searchsorted(samples.t, t, side="right"))
            self.next_state, self.state, self.plant.held = samples.z[k], samples.z[k - 1], samples.u[k - 1]
            self.table = [Samples(*(part[:k] for part in samples))]

    def finish(self, t: float, x: Array) -> None:
        """The run ends at t: what was sampled behind it is void, and what follows a sample there counts."""
        self.rewind(t)
        if t >= self.next:
            u = np.asarray(self.plant.held)
            self.table.append(Samples(np.array([t]), x[None], u[None], self.next_state[None]))

    def samples(self) -> Samples:
        """All samples so far."""
        if len(self.table) == 1:
            return self.table[0]
        n, m = self.scene.n, len(self.state)
        none = Samples(np.zeros(0), np.zeros((0, 2 * n)), np.zeros((0, n)), np.zeros((0, m)))
        self.table = [Samples(*(np.concatenate(parts) for parts in zip(none, *self.table, strict=True)))]
        return self.table[0]

    def _law(self, t: float, q: Array, qd: Array) -> Array:
        if not self.state.size:
            return np.asarray(self.scene.controller(t, q, qd))
        u, rates = torques_and_rates(self.scene.controller(t, q, qd, self.state))
        self.next_state = self.state + self.period * np.asarray(rates)
        return np.asarray(u)

    def stability(self) -> str:
        """What check_gains says of the controller, for the error of a loop that diverges."""
        gains = [getattr(self.scene.controller, name, None) for name in ("kp", "kd")]
        try:
            limit = check_gains(self.scene.resolved.robot, *gains).sample_time_limit  # type: ignore[arg-type]
        except (ValueError, TypeError):
            return "see rne.check_gains for the sample time that its gains need"
        return f"by rne.check_gains it is stable up to {limit:.4g} s everywhere, and sampled every {self.period:g} s"
