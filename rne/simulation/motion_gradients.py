"""Gradients of a cost of motions: the discrete adjoint of their steps."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from math import ceil
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ..basics.arrays import positive_number, real_numbers
from ..basics.spatial import Array
from ..control.laws import traceable
from ..integrators.frozen_steps import Adjoint, Kept, Schedule
from ..integrators.loops import LANES
from ..integrators.tableaus import tableau
from ..kernels.kernel import Kernel
from ..robot import Robot
from .frozen_motion import MOST_AT_ONCE, FrozenScene, SideBySide, equal_steps, flat, schedule_of
from .scene import Scene
from .scene_numbers import checked
from .simulator import law_breaks, scene_argument

Progress = Callable[[float, float], object]


class MotionGradient(NamedTuple):
    """A cost of motions, and its derivatives by name; of N motions with an axis of N in front."""

    value: Any
    gradient: dict[str, Array]


class Segment(NamedTuple):
    """Steps that are kept at once, and what begins them: the state, the command, and what is held, as copies."""

    first: int
    end: int
    x: Array
    command: Array
    held: tuple[Array, ...]


class _Backwards:
    """The adjoint of motions side by side over a schedule, with checkpoints where not all steps can be kept."""

    def __init__(self, group: SideBySide, schedule: Schedule, memory: int, tell: Callable[[int], None]) -> None:
        self.group, self.schedule, self.tell = group, schedule, tell
        steps, stages = len(schedule.lengths), len(schedule.tableau.B)
        each = 8 * group.count * (stages * group.size + 2 * group.n + group.m)
        self.most = max(1, min(memory // each, steps))
        self.kept = group.kept(self.most, stages)
        self.segments: list[Segment] = []

    def forwards(self, x: Array) -> bool:
        """From the flat state x to the end, with the last segment kept; False if a state needs the recursion."""
        nothing, steps = self.group.kept(0, 0), len(self.schedule.lengths)
        for first in range(0, steps, self.most):
            end = min(first + self.most, steps)
            self.segments.append(Segment(first, end, x.copy(), self._command.copy(), self._held()))
            if not self._advance(x, self.segments[-1], self.kept if end == steps else nothing):
                return False
        return True

    @property
    def _command(self) -> Array:
        return self.group.rates.inputs[2][: self.group.n * self.group.count]

    def _held(self) -> tuple[Array, ...]:
        holding = self.group.holding
        return holding.pending.copy(), holding.states.copy(), holding.counts.copy()

    def _advance(self, x: Array, segment: Segment, kept: Kept) -> bool:
        for first, end in self._parts(segment):
            here = Kept(*(array[first - segment.first : end - segment.first] for array in kept))
            if not self.group.advance(self.schedule.part(first, end), x, here):
                return False
            self.tell(end - first)
        return True

    def _parts(self, segment: Segment) -> list[tuple[int, int]]:
        most = max(1, MOST_AT_ONCE // self.group.count)
        return [(k, min(k + most, segment.end)) for k in range(segment.first, segment.end, most)]

    def backwards(self, adjoint: Adjoint, *, by_delay: bool) -> Array | None:
        """Add up derivatives from the end to the start; those by the delay, or None if a state needs the recursion."""
        total = np.zeros(self.group.count)
        for segment in reversed(self.segments):
            if segment is not self.segments[-1]:
                self._command[:] = segment.command
                for now, then in zip(self.group.holding[2:], segment.held, strict=True):
                    now[:] = then
                if not self._advance(segment.x.copy(), segment, self.kept):
                    return None
            for first, end in reversed(self._parts(segment)):
                kept = Kept(*(array[first - segment.first : end - segment.first] for array in self.kept))
                part = self.schedule.part(first, end)
                arrivals = np.empty((end - first if by_delay else 0, len(adjoint.x)))
                if not self.group.pull_back(part, kept, adjoint._replace(arrivals=arrivals)):
                    return None
                if by_delay:
                    before = segment.command if first == segment.first else self.kept.held[first - segment.first - 1]
                    total += self._by_delay(part, kept, arrivals, before)
                self.tell(end - first)
        return total

    def _by_delay(self, part: Schedule, kept: Kept, arrivals: Array, before: Array) -> Array:
        """Derivatives by the delay: a command that acts later leaves the one before it for longer."""
        group, L = self.group, self.group.count
        k = np.flatnonzero(part.acting)
        held = np.concatenate([before[None], kept.held])
        rows = [a.reshape(len(k), -1, L).transpose(0, 2, 1) for a in (kept.stages[k, 0], held[k], held[k + 1])]
        x, old, new = rows
        t = np.broadcast_to(part.times[k, 0][:, None, None], (len(k), L, 1))
        rates = [group.frozen.kernel(t, x, u, group.numbers) for u in (old, new)]
        slopes = arrivals[k].reshape(len(k), -1, L).transpose(0, 2, 1)
        return np.asarray((slopes * (rates[0] - rates[1])).sum(axis=(0, 2)))


def motion_gradient(
    scene_or_robot: Scene | Robot,
    q0: ArrayLike,
    qd0: ArrayLike,
    duration: float,
    cost: Callable[..., Any] | None = None,
    final: Callable[..., Any] | None = None,
    *,
    wrt: str | Sequence[str],
    torque: ArrayLike | None = None,
    numbers: Mapping[str, ArrayLike] | None = None,
    method: str = "auto",
    step: float | None = None,
    rtol: float = 1e-6,
    atol: float = 1e-9,
    memory: int = 2**28,
    progress: Progress | None = None,
) -> MotionGradient:
    """Derivatives of a cost of a motion."""
    scene = scene_argument(scene_or_robot)
    names = (wrt,) if isinstance(wrt, str) else tuple(wrt)
    own = dict(numbers or {})
    frozen = FrozenScene(scene, tuple(dict.fromkeys((*names, *own))), cost, torque is not None)
    q, qd = (real_numbers(name, x, f"({scene.n},) or (N, {scene.n})") for name, x in (("q0", q0), ("qd0", qd0)))
    is_one = q.ndim == 1
    count = 1 if is_one else len(q)
    given = checked(scene, {k: np.asarray(v)[None] if is_one else v for k, v in own.items()}, count)
    x0 = frozen.start(given, np.atleast_2d(q), np.atleast_2d(qd))
    end = positive_number("duration", duration)
    u = np.zeros((count, 0)) if torque is None else np.broadcast_to(torque, (count, scene.n))
    by_machine = frozen.kernel.is_unrolled and frozen.kernel.engine == "numba"
    schedule = fixed_schedule(frozen, "rk4", end, step)
    L = (LANES if count > 1 else 1) if by_machine else count
    values, gradients = [], {name: [] for name in names}
    for first in range(0, count, L):
        rows = np.minimum(np.arange(first, first + L), count - 1)
        mine = {name: array[rows] for name, array in given.items()}
        value, found = _of_group(frozen, mine, x0[rows], u[rows], schedule, final, names, memory, by_machine)
        taken = min(L, count - first)
        values.append(value[:taken])
        for name in names:
            gradients[name].append(found[name][:taken])
    value, gradient = np.concatenate(values), {k: np.concatenate(v) for k, v in gradients.items()}
    return MotionGradient(value[0] if is_one else value, {k: v[0] if is_one else v for k, v in gradient.items()})


def fixed_schedule(frozen: FrozenScene, method: str, end: float, step: float, *instants: Array) -> Schedule:
    """Equal steps that end at samples, arrivals of commands, breaks and further instants."""
    samples = arrivals = breaks = np.zeros(0)
    if frozen.law is not None:
        late, rest = frozen.delay
        samples = np.arange(ceil(end / frozen.period * (1 - 1e-12))) * frozen.period
        arrivals = (np.arange(len(samples)) + late) * frozen.period + rest
    else:
        breaks = np.array(law_breaks(frozen.given.controller))
    ends = equal_steps(end, step, samples, arrivals, breaks[(breaks > 0) & (breaks < end)], *instants)
    ends = aligned(ends, np.concatenate([samples, arrivals, breaks]))
    return schedule_of(tableau(method), 0, ends, breaks, samples, arrivals)


def aligned(times: Array, others: Array) -> Array:
    """Times, in place of which others stand that are equal up to rounding."""
    if not len(others):
        return times
    others = np.unique(others)
    nearest = others[np.clip(np.searchsorted((others[1:] + others[:-1]) / 2, times), 0, len(others) - 1)]
    return np.asarray(np.where(np.abs(nearest - times) <= 1e-12 * times, nearest, times))


def _of_group(frozen, own, x0, u, schedule, final, names, memory, by_machine):
    group = SideBySide(frozen, own, len(x0), by_machine=by_machine)
    group.rates.inputs[2][: u.size] = flat(u) if u.size else 0
    run = _Backwards(group, schedule, memory, lambda _: None)
    x = flat(x0)
    if not run.forwards(x):
        raise RuntimeError
    L, n = len(x0), frozen.dynamics.n
    rows = x.reshape(-1, L).T
    value = rows[:, -1].copy() if frozen.cost is not None else np.zeros(L)
    slopes = np.zeros_like(rows)
    if frozen.cost is not None:
        slopes[:, -1] = 1.0
    if final is not None:
        joints = frozen.dynamics.joints
        made = traceable(lambda q, qd: final(q, qd))
        kernels = [
            Kernel(made, frozen.scene.resolved.robot.model, {}),
            Kernel(made, frozen.scene.resolved.robot.model, {}, ("q", "qd"), "numpy", "gradient"),
        ]
        q, qd = rows[:, :joints], rows[:, n : n + joints]
        value += kernels[0](q, qd)
        g = kernels[1](q, qd, np.ones((L, 1)))
        slopes[:, :joints] += g[:, :joints]
        slopes[:, n : n + joints] += g[:, joints:]
    adjoint = group.adjoint(flat(slopes), 0, len(schedule.tableau.B))
    delay = run.backwards(adjoint, by_delay="delay" in names)
    found = frozen.by_names(names, group, adjoint)
    if "delay" in names:
        found["delay"] = delay
    return value, found
