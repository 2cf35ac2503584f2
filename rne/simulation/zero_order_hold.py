"""A controller that is sampled, with its torques held from one sample to the next."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..basics.spatial import Array
from ..control.gains import check_gains
from .plant import Plant, checked_state_rates, checked_torques
from .scene import Scene

MAX_EVALUATIONS = 20_000  # of the right-hand side between two samples, some hundred times what a stable loop takes


class ControlSamples(NamedTuple):
    """Samples of a controller: times (k,), states (k, 2 N), torques (k, n), and the controller's states (k, m)."""

    t: Array
    x: Array
    u: Array
    z: Array

    def held(self, t: Array, same: float = 0.0) -> Array:
        """Numbers of the samples whose torques are held at times, or a relative rounding of them later."""
        return np.searchsorted(self.t, t * (1 + same), side="right") - 1

    def work(self, q: Array, k: Array, driven: slice) -> Array:
        """Work of the drives since the start up to positions reached under the torques of samples k [J]."""
        start = self.x[:, driven]
        done = np.append(0.0, np.cumsum((self.u[:-1] * np.diff(start, axis=0)).sum(axis=1)))
        work: Array = done[k] + ((q - start[k]) * self.u[k]).sum(axis=1)
        return work


class ZeroOrderHold:
    """A controller that is sampled: the torques held since the last sample, and the controller's states.

    The states are integrated by Euler's rule from sample to sample.
    """

    def __init__(self, scene: Scene, plant: Plant) -> None:
        self.scene, self.plant = scene, plant
        self.period = float(scene.sample_time or 0.0)
        self.state = self.next_state = np.zeros(int(getattr(scene.controller, "states", 0)))  # at the last sample
        law = scene.traced_samples
        self.traced = None if law is None else plant.robot._kernels.scene_kernel(law.outputs)  # where it is traced
        self.moving = 2 * plant.dynamics.n  # entries of the state that samples keep
        none = np.zeros(0), np.zeros((0, self.moving)), np.zeros((0, scene.n)), np.zeros((0, len(self.state)))
        self.table = [ControlSamples(*none)]
        self.count, self.evaluations_before = 0, 0  # samples, and evaluations before the last one
        self.limit, self.change = self.bounds()
        plant.law, plant.sampled = None, np.zeros(scene.n)  # the solver sees torques that are held

    def sample(self, t: float, x: Array) -> None:
        """Renew the torques that the plant holds, within the limits of torque and torque rate."""
        held, moved = np.asarray(self.plant.sampled), x[: self.moving]
        self.state = self.next_state
        returned, rates = self.plant.called(self.scene.controller, t, np.concatenate([moved, self.state]))
        if rates is not None:
            self.next_state = self.state + self.period * checked_state_rates(rates, len(self.state), t)
        u = np.clip(checked_torques(self.plant.law_name, returned, self.plant.robot, t), -self.limit, self.limit)
        if self.count:
            u = np.clip(u, held - self.change, held + self.change)
        self.plant.sampled = u
        if callable(getattr(self.scene.controller, "delivered", None)):
            self.scene.controller.delivered(u.copy())
        self._append(ControlSamples(np.array([t]), moved[None], u[None], self.state[None]))
        self.evaluations_before = self.plant.evaluations

    def bounds(self) -> Array:
        """Bounds of the torques, and of their change from one sample to the next, shape (2, n)."""
        parts = self.scene.resolved
        limit, rate = (np.inf if bound is None else bound for bound in (parts.effort_limit, parts.torque_rate))
        return np.array([np.broadcast_to(bound, self.scene.n) for bound in (limit, rate * self.period)])

    def note(self, samples: tuple[Array, ...], states: Array, evaluations: int) -> None:
        """Samples were taken in machine code: with the controller's states at the last and the next one."""
        t, x, u, z = samples
        self._append(ControlSamples(t, x[:, : self.moving], u, z))
        self.state, self.next_state = states
        self.plant.sampled, self.evaluations_before = samples[2][-1], evaluations

    def _append(self, samples: ControlSamples) -> None:
        self.table.append(samples)
        self.count += len(samples.t)

    @property
    def next(self) -> float:
        """Time of the next sample."""
        return self.count * self.period

    def rewind(self, t: float) -> None:
        """Drop the samples after t."""
        if self.count and t < self.table[-1].t[-1]:
            samples = self.samples()
            k = self.count = int(np.searchsorted(samples.t, t, side="right"))
            self.next_state, self.state, self.plant.sampled = samples.z[k], samples.z[k - 1], samples.u[k - 1]
            self.table = [ControlSamples(*(part[:k] for part in samples))]

    def finish(self, t: float, x: Array) -> None:
        """The run ends at t: what was sampled behind it is void, and what follows a sample there counts."""
        self.rewind(t)
        if t >= self.next:
            u = np.asarray(self.plant.sampled)
            self.table.append(ControlSamples(np.array([t]), x[None, : self.moving], u[None], self.next_state[None]))

    def samples(self) -> ControlSamples:
        """All samples so far."""
        if len(self.table) > 1:
            self.table = [ControlSamples(*(np.concatenate(parts) for parts in zip(*self.table, strict=True)))]
        return self.table[0]

    def stability(self) -> str:
        """What check_gains says of the controller, for the error of a loop that diverges."""
        if self.scene.elastic is not None:
            return "rne.check_gains tells only what rigid joints need"
        gains = [getattr(self.scene.controller, name, None) for name in ("kp", "kd")]
        if self.scene.resolved.springs is not None:
            return "springs, which rne.check_gains does not know, may need shorter sample times"
        try:
            limit = check_gains(self.scene.resolved.robot, *gains).sample_time_limit  # type: ignore[arg-type]
        except (ValueError, TypeError):
            return "see rne.check_gains for the sample time that its gains need"
        return f"by rne.check_gains it is stable up to {limit:.4g} s, and sampled every {self.period:g} s"
