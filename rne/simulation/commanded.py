"""Motions of a scene whose law follows recorded commands: positions at the times of samples, and their derivatives.

For least squares: the scene is traced once, and each motion is evaluated for many values of its numbers. Steps of the
Runge-Kutta method of order 4 have equal lengths and end at samples and where a command begins to act. So the
derivatives of the computed motion are exact; those with respect to the delay of commands are jumps of dx/dt.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from copy import copy
from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar, NamedTuple, Self, cast

import numpy as np

from ..basics.spatial import Array
from ..control.traced_law import TracedLaw
from ..errors import NotFiniteError, SingularMassMatrixError
from ..integrators.frozen_steps import Schedule
from ..integrators.step_control import aligned, equal_steps
from ..integrators.tableaus import tableau
from .frozen_motion import FIXED, STARTS, FrozenScene, SideBySide, schedule_of
from .scene import Scene
from .sensitivities import SHIFT, Columns, Forwards, SensitivityTask

SCALE, OFFSET = "command.scale", "command.offset"
OF_COMMANDS = SHIFT, SCALE, OFFSET
TABLE = tableau(FIXED)._replace(C=np.concatenate([tableau(FIXED).C, [1.0], tableau(FIXED).C2]))
Command = tuple[float, Array, Array]  # a law follows scale * command + offset (n,), after a delay [s]
NEAR = 1e-6  # tolerance of times relative to a sample time
FOREVER = 1e6  # duration for which the first and the last command hold [s]


class Vectors(NamedTuple):
    """Numbers of a motion as the kernels of the equations and of a law take them; limits and delay of its commands."""

    numbers: Array
    law_numbers: Array
    limits: Array  # (2, n), of commands and of their change, or (2, 0)
    delay: float  # of a sampled law [s]


@dataclass(frozen=True, eq=False)
class CommandedMotion:
    """One motion from a start at time 0, with times (T,) of samples, under the commands of a scene's reference.

    `taken` has, for each number of the scene or its commands with respect to which the motion is differentiated, a
    matrix (entries, k) of k directions.
    """

    NAMES: ClassVar = OF_COMMANDS

    frozen: FrozenScene
    begin: float  # on the time axis of the commands [s]
    times: Array  # of the samples, from the start on [s]
    taken: Mapping[str, Array]
    step: float

    @classmethod
    def of(cls, scene: Scene, names: Sequence[str], begin: float, times: Array, taken: Any, step: float) -> Self:
        """Motion of a scene with some numbers replaced by name."""
        return cls(FrozenScene(scene, tuple(names)), begin, times, taken, step)

    def fastest_rate(self, vectors: Vectors, q: Array) -> float:
        """The largest modulus of an eigenvalue of the equations at rest at positions (N, n) [1/s]."""
        frozen, law, numbers = self.frozen, self.frozen.dynamics.law, vectors.numbers
        x = frozen.start(numbers, q, np.zeros_like(q))
        kernel = frozen.scene.kernels.scene_kernel(frozen.dynamics.right_hand_side, "x")
        held = (np.zeros((len(x), frozen.commanded)),) if frozen.commanded else ()
        piece = () if law is None or not len(law.table) else (np.repeat(law.table[:1], len(x), axis=0),)
        J = kernel(np.zeros((len(x), 1)), x, *held, *piece, numbers)
        return float(np.abs(np.linalg.eigvals(J)).max(initial=0.0))

    @cached_property
    def _table(self) -> Array:
        """Pieces of the reference since the start, with constant ones before the first and after the last."""
        rows, n = cast(TracedLaw, self.frozen.law or self.frozen.dynamics.law).table, self.frozen.given.n
        ends = np.zeros((2, rows.shape[1]))
        ends[:, :2] = (rows[0, 0] - FOREVER, rows[0, 0]), (rows[-1, 1], rows[-1, 1] + FOREVER)
        ends[:, 2 : 2 + n] = self.frozen.given.controller.reference.samples[[0, -1]]
        found = np.concatenate([ends[:1], rows[rows[:, 1] > rows[:, 0]], ends[1:]])
        found[:, :2] -= self.begin
        return found

    def vectors(self, own: Mapping[str, Array]) -> Vectors:
        """Vectors of the kernels for numbers by name."""
        group = SideBySide(self.frozen, {k: x[None] for k, x in own.items()}, 1, by_machine=self.frozen.by_machine)
        delay = float(own.get("delay", self.frozen.given.delay or 0.0))
        return Vectors(group.numbers.reshape(-1), group.law_numbers.reshape(-1), group.limits, delay)

    def _group(self, vectors: Vectors, command: Command) -> SideBySide:
        """Motion, as a group of one, under its own numbers and commands."""
        delay, scale, offset = command
        group = SideBySide(self.frozen, {}, 1, by_machine=self.frozen.by_machine)
        group.numbers, group.law_numbers = vectors.numbers, vectors.law_numbers
        rows = int(self.frozen.late(vectors.delay)[0]) + 1
        group.holding = group.holding._replace(limits=vectors.limits, pending=np.zeros((rows, group.n)))
        table, n = self._table.copy(), self.frozen.given.n
        table[:, :2] += delay
        table[:, 2:] *= np.resize(scale, table.shape[1] - 2)
        table[:, 2 : 2 + n] += offset
        if self.frozen.law is None:
            group.tables = table[None]
        else:
            period = self.frozen.period  # a command that comes with a sample, but for rounding, is read by it
            whole = np.round(table[:, :2] / period) * period
            is_near = np.abs(table[:, :2] - whole) < NEAR * period
            table[:, :2] = np.where(is_near, whole, table[:, :2])
            group.law_tables = table[None]
        return group

    def _directions(self) -> dict[str, Array]:
        """Derivatives of the pieces with respect to the numbers of commands in `taken`."""
        rows, n = self._table, self.frozen.given.n
        found = {}
        if SHIFT in self.taken:
            found[SHIFT] = np.zeros((*rows.shape, 1))
            found[SHIFT][:, :2] = 1.0
        for name in {SCALE, OFFSET} & self.taken.keys():
            found[name] = np.zeros((*rows.shape, n))
            for j in range(n):
                at = slice(2 + j, None, n) if name == SCALE else 2 + j
                found[name][:, at, j] = rows[:, at] if name == SCALE else 1.0
        return found

    @cached_property
    def columns(self) -> tuple[Columns, Array]:
        """Seeds in which the motion is differentiated, and the matrix (p, k) from them to the derivatives asked for."""
        starts = (np.zeros(self.frozen.given.n),) * 2
        names = [name for name in self.taken if name not in OF_COMMANDS]
        columns = Columns(self.frozen, [*names, *STARTS], starts, self._directions())
        parts = dict(self.taken) | dict.fromkeys(STARTS, np.eye(self.frozen.given.n))
        W = np.zeros((columns.p, sum(A.shape[1] for A in parts.values())))
        first = 0
        for name, A in parts.items():
            for seeds, M in columns.made[name]:
                W[seeds, first : first + A.shape[1]] += A if M is None else M.T @ A
            first += A.shape[1]
        return columns, W

    def _task(
        self, vectors: Vectors, command: Command, start: Array, columns: Columns | None = None
    ) -> tuple[SensitivityTask, Schedule]:
        """Motion and its steps."""
        group, end = self._group(vectors, command), float(self.times[-1])
        (samples, acting, _), tables = self.frozen.instants(end, vectors.delay), group.tables
        breaks = tables[0, 1:, 0] if len(tables) else np.zeros(0)
        ends = equal_steps(end, self.step, samples, acting, breaks, aligned(self.times, [samples, acting, breaks]))
        q0, qd0 = start
        x0 = self.frozen.start(group.numbers, q0[None], qd0[None])[0]
        task = SensitivityTask(self.frozen, columns, x0, np.zeros(0), ends, self.times, None, group, False)
        return task, schedule_of(TABLE, ends, samples, acting, breaks)

    def positions(self, vectors: Vectors, command: Command, start: Array) -> Array | None:
        """Positions at the times, (T, n); None where the motion cannot be computed."""
        task, schedule = self._task(vectors, command, start)
        assert task.group is not None
        x, kept = task.x0.copy(), task.group.kept(len(schedule.lengths), len(schedule.tableau.B))
        try:
            with np.errstate(all="ignore"):
                done = task.group.advance(schedule, x, kept)
        except (NotFiniteError, SingularMassMatrixError):
            return None
        if not done or not np.isfinite(x).all():
            return None
        n, times = self.frozen.given.n, aligned(self.times, [task.ends])
        found: Array = np.append(kept.stages[:, 0, :n], x[None, :n], axis=0)[np.searchsorted(task.ends, times)]
        return found

    def derivatives(self, vectors: Vectors, command: Command, start: Array) -> tuple[Array, Array]:
        """Positions (T, n), and their derivatives (T, n, k) with respect to the numbers in `taken` and the start."""
        columns, W = self.columns
        if self.frozen.given.elastic is not None:  # motors start where they hold their links
            columns = copy(columns)
            columns.start = columns.start_at(self.frozen, vectors.numbers, tuple(start))
        task, schedule = self._task(vectors, command, start, columns)
        run = Forwards(task, by_machine=self.frozen.by_machine)
        if not run.along_steps(schedule):
            raise NotFiniteError("the motion cannot be computed")
        n = self.frozen.given.n
        return run.found_x[:, :n], run.along_x[:, :n] @ W
