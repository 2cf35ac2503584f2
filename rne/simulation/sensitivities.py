"""Derivatives of a motion at given times with respect to its initial state and to numbers of its scene.

Those of explicit methods are discrete sensitivities: derivatives of the steps, whose lengths are constants. With
implicit ones, whose stages need a Jacobian, the variational equations S' = (df/dx) S + df/dp are integrated with the
motion as one system (Hairer, Norsett and Wanner 1993, Solving Ordinary Differential Equations I, section I.14). Both
are by p seeds, entries of the start and of the vectors of numbers; derivatives by names are linear functions of these.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ..basics.arrays import check_function, positive_number, real_numbers
from ..basics.piecewise import numbers_at, rows_of_tables
from ..basics.spatial import Array
from ..basics.text import InNotebooks, counted, short, wrapped
from ..errors import NotFiniteError, SimulationInterrupted
from ..integrators.base import IMPLICIT
from ..integrators.frozen_steps import Directions, Kept, Linear, Schedule, carry, carry_sample, carry_slope, sample
from ..integrators.loops import compiled
from ..integrators.step_control import aligned
from ..integrators.tableaus import EXPLICIT, Tableau, scipy_class, tableau
from ..model.model import Model
from ..robot import Robot
from .frozen_motion import (
    FIXED,
    STARTS,
    FrozenScene,
    SideBySide,
    constant_torques,
    names_of,
    schedule_of,
    steps_taken,
)
from .scene import Scene
from .scene_numbers import BODIES
from .simulator import METHODS, check_times, one_state, scene_argument, tolerances

AT_ONCE = 2**21  # size of the derivatives of dx/dt computed at once, such that a processor's cache holds them [bytes]
SHIFT = "command.delay"  # name of the shift of a reference's pieces [s]
TOLD = 999  # number of parts of a motion after each of which `progress` is called
Made = Mapping[str, list[tuple[slice, Any]]]  # by name: seeds, and matrices (k, some), or None, to be added


class ByNames(Mapping[str, Array]):
    """Derivatives of a quantity by name, (T, n, k), computed on access from those by p seeds."""

    def __init__(self, along: Array, made: Made) -> None:
        self._along, self._made, self._found = along, made, dict[str, Array]()

    def __getitem__(self, name: str) -> Array:
        if name not in self._found:
            parts = [self._along[..., p] if M is None else self._along[..., p] @ M.T for p, M in self._made[name]]
            self._found[name] = np.ascontiguousarray(sum(parts[1:], parts[0]))
            self._found[name].flags.writeable = False
        return self._found[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._made)

    def __len__(self) -> int:
        return len(self._made)


class Columns:
    """Seeds, p directions in which a motion is differentiated, and the combinations of them for each name, `made`.

    `numbers` and `of_law` have a seed, or -1, for each entry of the numbers of the equations and of a sampled law,
    `limits`, (2, n), for bounds of commands; `samples` is the first seed of the samples that a law follows. Further
    `directions` by name are derivatives of the pieces that it follows, (N, width, k); SHIFT is for later pieces.
    """

    def __init__(
        self,
        frozen: FrozenScene,
        wrt: Sequence[str],
        starts: Sequence[Array],
        directions: Mapping[str, Array] = MappingProxyType({}),
    ) -> None:
        dynamics, law, known = frozen.dynamics, frozen.law, frozen.scene.numbers
        self.p, self.made = 0, {name: list[tuple[slice, Any]]() for name in wrt}
        sizes = {name: known[name].size for name in wrt if name not in STARTS}
        sizes |= {name: len(x) for name, x in zip(STARTS, starts, strict=True) if name in wrt}
        places = {name: self._add(name, sizes[name]) for name in STARTS if name in wrt}
        plain: dict[str, dict[str, Any]] = {name: {name: None} for name in sizes if name not in (*BODIES, *STARTS)}
        self.numbers = self._of_vector(dynamics.masks, plain | frozen.of_bodies)
        masks = {} if law is None else {f"controller.{name}": mask for name, mask in law.masks.items()}
        self.of_law = self._of_vector(masks, plain)
        self.limits, self.delay, self.samples = np.full((2, frozen.commanded), -1), -1, -1
        for k, (name, factor) in enumerate((("effort_limit", 1.0), ("torque_rate", frozen.period))):
            if law is not None and name in wrt:
                self.limits[k] = self._add(name, frozen.commanded, factor * np.eye(frozen.commanded))
        if law is not None and "delay" in wrt:
            self.delay = int(self._add("delay", 1)[0])
        for name in filter(frozen.samples_of, wrt):
            self.samples = int(self._add(name, sizes[name])[0])
        self.made |= {name: [] for name in directions}
        places |= {name: self._add(name, array.shape[2]) for name, array in directions.items()}
        self.delay = int(places[SHIFT][0]) if SHIFT in directions and law is None else self.delay
        held = 2 + frozen.given.n  # entries of a piece that is constant, in which its times do not show
        given = [(name, places.pop(name), array) for name, array in directions.items()]
        self.of_pieces = [(seeds, x) for name, seeds, x in given if name != SHIFT or x.shape[1] > held]
        sizes |= {name: array.shape[2] for name, array in directions.items()}
        for name, parts in self.made.items():
            parts += [] if parts else [(slice(0), np.zeros((sizes[name], 0)))]  # nothing depends on it
        self.p, taken, self.places = max(self.p, 1), self.numbers >= 0, places
        self.start, self.scale = self.start_at(frozen, dynamics.vector, starts), np.ones(self.p)
        self.scale[self.numbers[taken]] = np.maximum(1.0, np.abs(dynamics.vector[taken]))  # of numbers above 1

    def start_at(self, frozen: FrozenScene, vector: Array, starts: Sequence[Array]) -> Array:
        """Derivatives of the initial state under numbers of the equations, (size, p)."""
        *by_starts, by_numbers = frozen.start_slopes(vector, *(x[None] for x in starts))
        found, taken = np.zeros((frozen.dynamics.size, self.p)), self.numbers >= 0
        found[:, self.numbers[taken]] = by_numbers[0][:, taken]
        for name, place in self.places.items():
            found[:, place] = by_starts[STARTS.index(name)][0]
        return found

    def _add(self, name: str, count: int, matrix: Array | None = None) -> Array:
        """Add directions for a name; returns their indices."""
        self.made[name].append((slice(self.p, self.p + count), matrix))
        self.p += count
        return np.arange(self.p - count, self.p)

    def _of_vector(self, masks: Mapping[str, Array], own: Mapping[str, Mapping[str, Any]]) -> Array:
        """Directions for the vector entries that names need: `own` has a matrix (k, ...) or None for each number."""
        found = [np.zeros(0, np.int64)]
        for of, mask in masks.items():
            count, users = int(mask.sum()), [name for name, parts in own.items() if of in parts]
            for name in users:
                matrix = np.eye(mask.size) if own[name][of] is None and count < mask.size else own[name][of]
                matrix = matrix if matrix is None else matrix.reshape(-1, mask.size)[:, mask.reshape(-1)]
                self.made[name].append((slice(self.p, self.p + count), matrix))
            found.append(self.p + np.arange(count) if users else np.full(count, -1))
            self.p += count if users else 0
        return np.concatenate(found)


class SensitivityTask(NamedTuple):
    """A motion to be differentiated."""

    frozen: FrozenScene
    columns: Any  # Columns, or None where a motion is not differentiated
    x0: Array
    torque: Array  # (n,), constant, or (0,)
    ends: Array  # of steps, or of parts in between of which laws jump
    times: Array  # to report
    progress: Callable[[float, float], object] | None
    group: SideBySide | None = None  # of other numbers and pieces than the scene's
    reports_torques: bool = True


class Forwards:
    """Motion from its start to its end with derivatives in all directions, at the times to report.

    There `found_x`, (T, size), has the state, `tau`, (T, n), the drives' torques, `along_x` and `along_tau`, (T, ...,
    p), their derivatives.
    """

    def __init__(self, task: SensitivityTask, *, by_machine: bool) -> None:
        self.task, self.frozen, self.columns, self.dynamics = task, task.frozen, task.columns, task.frozen.dynamics
        self.group = group = task.group or SideBySide(self.frozen, {}, 1, by_machine=by_machine)
        self.x, self.command = task.x0.copy(), group.rates.inputs[2][: group.n]
        self.command[:] = task.torque if task.torque.size else 0.0
        self.t, self.reached, self.next, self.limited = aligned(task.times, [task.ends]), 0.0, 0.0, False
        end, (samples, _, breaks) = float(task.ends[-1]), self.frozen.instants(task.ends[-1])
        group.check_within_samples(0.0, end, samples.max(initial=0.0))
        self.sides = np.where(np.isin(self.t, breaks), np.nextafter(self.t, np.inf), self.t)  # after jumps of laws
        T, size, n, p = len(self.t), len(self.x), self.dynamics.joints, self.columns.p
        self.found_x, self.tau = np.zeros((T, size)), np.zeros((T, n))
        self.along_x, self.along_tau = np.zeros((T, size, p)), np.zeros((T, n, p))
        self.holding = group.holding._replace(counts=np.zeros(2, np.int64))  # of derivatives, which are computed later

    def tell(self, t: float) -> None:
        """Record the time reached."""
        self.reached, end, progress = t, float(self.task.ends[-1]), self.task.progress
        if progress is not None and (t >= self.next or t == end):
            self.next = t + end / TOLD
            progress(t, end)

    def given(self, t: Array, x: Array, u: Array, *, of_law: bool = False) -> tuple[Array, ...]:
        """Arguments of a kernel of the equations or of the law at times (..., 1)."""
        group, inputs = self.group, (u,) if self.group.n and not of_law else ()
        tables, numbers = (group.law_tables, group.law_numbers) if of_law else (group.tables, group.numbers)
        return t, x, *inputs, *rows_of_tables(tables, t[..., 0]), numbers

    def value(self, function: Any, t: Array, x: Array, u: Array) -> Array:
        """Value of a function of the equations."""
        return self.frozen.scene.kernels.scene_kernel(function)(*self.given(t, x, u))

    def linear(self, function: Any, t: Array, x: Array, u: Array, *, of_law: bool = False) -> Linear:
        """Derivatives of a function of the equations or of the law."""
        tables = self.group.law_tables if of_law else self.group.tables
        columns, of_pieces = self.columns.of_law if of_law else self.columns.numbers, self.columns.of_pieces
        by_pieces = self.columns.samples >= 0 or len(of_pieces) > 0
        columns, by_pieces = columns if (columns >= 0).any() else columns[:0], by_pieces and len(tables) > 0
        wrt = {"u": self.frozen.law is not None and not of_law, "numbers": len(columns) > 0, "piece": by_pieces}
        kernel = self.frozen.scene.kernels.scene_kernel(function, "x", *(name for name in wrt if wrt[name]))
        J = kernel(*self.given(t, x, u, of_law=of_law))
        if not by_pieces:
            return Linear(J, columns, np.zeros((*J.shape[:-2], 0)))
        (*leading, rows), width, k = J.shape[:-1], tables.shape[2], self.columns.samples
        if of_pieces:
            J, seeds = self._by_pieces(J, numbers_at(tables[0], t[..., 0]), width)
            return Linear(J, np.append(columns, seeds), np.zeros((*leading, 0)))
        C = self.frozen.by_samples[numbers_at(tables[0], t[..., 0])]
        further = np.zeros((*leading, rows, self.columns.p))
        n, K = (width - 2) // C.shape[-2], C.shape[-1]
        along = np.einsum("...rci,...ck->...rki", J[..., 2 - width :].reshape(*leading, rows, C.shape[-2], n), C)
        further[..., k : k + K * n] = along.reshape(*leading, rows, K * n)
        columns = np.append(columns, np.full(width, -1))
        return Linear(J, columns, further.reshape(*leading, rows * self.columns.p))

    def _by_pieces(self, J: Array, row: Array, width: int) -> tuple[Array, Array]:
        """Jacobian J with its last columns, by pieces, replaced by directions of pieces; their seeds."""
        of_pieces, first, at = self.columns.of_pieces, J.shape[-1] - width, 0
        seeds = np.concatenate([seeds for seeds, _ in of_pieces])
        found = np.zeros((*J.shape[:-1], len(seeds)))
        for _, array in of_pieces:
            for i, k in np.argwhere(array.any(axis=0)):
                slopes = array[:, i, k]
                factor = slopes[0] if (slopes == slopes[0]).all() else slopes[row][..., None]
                found[..., at + k] += J[..., i - width] * factor
            at += array.shape[2]
        if at > width:
            return np.concatenate([J[..., :first], found], axis=-1), seeds
        J[..., first : first + at] = found  # no copy of the others
        return J, np.append(seeds, np.full(width - at, -1))

    def jump(self, t: Array, x: Array, old: Array, new: Array) -> Array:
        """Jump of dx/dt as a command begins to act: before minus after."""
        rates = self.dynamics.right_hand_side
        return self.value(rates, t, x, old) - self.value(rates, t, x, new)

    def torques(self, t: Array, x: Array, u: Array) -> Array:
        """Torques of the drives; notes if one is at its limit."""
        tau, limit = self.value(self.dynamics.drive_torques, t, x, u), self.dynamics.effort_limit
        self.limited |= limit is not None and bool((np.abs(tau) >= limit).any())
        return tau

    def directions(self, stages: int) -> Directions:
        """Directions at the start, with workspace."""
        columns, p, rows = self.columns, self.columns.p, len(self.holding.pending)
        size, n, m = self.x.size * p, (self.group.n if self.frozen.law else 0) * p, self.group.m * p
        held = np.zeros(n), np.zeros((rows, n)), np.zeros(m)
        room = np.empty((stages, size)), np.empty((3, max(size, n, m)))
        return Directions(p, columns.start.reshape(-1).copy(), *held, columns.limits, columns.delay, *room)

    def report(self, rows: slice, x: Array, u: Array, along_x: Array, along_u: Array) -> None:
        """Store the motion at the times of some rows, with the torques of the drives."""
        if not len(self.t[rows]):
            return
        self.found_x[rows], self.along_x[rows] = x, along_x
        if not self.task.reports_torques or (self.dynamics.law is None and not self.group.n):
            return
        t, size, width = self.sides[rows, None], x.shape[1], x.shape[1] + along_u.shape[1]
        self.tau[rows] = self.torques(t, x, u)
        J, columns, further = self.linear(self.dynamics.drive_torques, t, x, u)
        along, taken = J[..., :size] @ along_x + J[..., size:width] @ along_u, np.flatnonzero(columns >= 0)
        along[..., columns[taken]] += J[..., width + taken]
        self.along_tau[rows] = along + further.reshape(along.shape) if further.size else along

    def finish(self, d: Directions) -> None:
        """Store the end, if it is to be reported."""
        end = float(self.task.ends[-1])
        along = (array.reshape(1, len(array) // d.p, d.p) for array in (d.x, d.held))
        self.report(slice(int(np.searchsorted(self.t, end)), None), self.x[None], self.command[None], *along)
        self.tell(end)

    def along_steps(self, schedule: Schedule) -> bool:
        """Integrate derivatives along the steps taken; False if a state needs the recursion."""
        d, S, ends = self.directions(len(schedule.tableau.C)), len(schedule.tableau.B), self.task.ends
        width = len(self.x) + self.group.n + len(self.group.numbers) + d.p * (self.columns.samples >= 0)
        most = max(1, AT_ONCE // (8 * S * width * (len(self.x) - self.dynamics.n)))
        for first in range(0, len(schedule.lengths), most):
            part, until = schedule.part(first, first + most), float(ends[first : first + most + 1][-1])
            if not self._take(part, slice(*np.searchsorted(self.t, [part.begins[0], until]).tolist()), d):
                return False
            self.tell(until)
        self.finish(d)
        return True

    def _take(self, part: Schedule, rows: slice, d: Directions) -> bool:
        """Take a range of steps, with the times of some rows among them."""
        dynamics, S = self.dynamics, len(part.tableau.B)
        before, kept = self.command.copy(), self.group.kept(len(part.lengths), S)
        if not self.group.advance(part, self.x, kept):
            return False
        held = np.repeat(kept.held[:, None], len(part.tableau.C), axis=1)
        f = self.linear(dynamics.accelerations, part.times[:, :S, None], kept.stages, held[:, :S])
        of_law, jumps = self._at_samples(part, kept), self._jumps(part, kept, before, delays=d.delay >= 0)
        if self.frozen.law is None and dynamics.effort_limit is not None and self.task.reports_torques:
            self.torques(part.times[:, :1], kept.stages[:, 0], kept.held)
        steps = np.searchsorted(part.begins, self.t[rows], side="right") - 1
        fraction = (self.t[rows] - part.begins[steps]) / part.lengths[steps]
        weights, inside, states = interpolation(part.tableau, fraction), fraction > 0, kept.stages[steps, 0]
        A2, more, counts = np.zeros((0, 0)), f, np.full(len(part.lengths), S)
        if inside.any():
            which, place = np.unique(steps[inside], return_inverse=True)
            A2, more, K = self._stages(part, kept, held, which)
            counts[which] = len(part.tableau.C)
            states[inside] += ((weights[inside] * part.lengths[steps[inside], None])[:, None] @ K[place])[:, 0]
        X, U = np.empty((len(steps), d.x.size)), np.empty((len(steps), d.held.size))
        text = compiled(carry) if self.group.by_machine else carry
        part = part if self.frozen.law else part._replace(acting=self._later(part))
        with np.errstate(over="ignore", invalid="ignore"):
            text(f, more, of_law, part, self.holding, kept, jumps, (steps, weights, A2, counts, X, U), d)
        if not np.isfinite(d.x).all():
            end = float(part.begins[-1] + part.lengths[-1])
            raise NotFiniteError(f"derivatives overflow before t = {end:.6g} s", end)
        along = (array.reshape(len(array), array.shape[1] // d.p, d.p) for array in (X, U))
        self.report(rows, states, kept.held[steps], *along)
        return True

    def _at_samples(self, part: Schedule, kept: Kept) -> Linear:
        """Derivatives of the law at its samples, without rows if there is none; notes commands at a bound."""
        law, at = self.frozen.law, np.flatnonzero(part.sampled)
        if law is None:
            return Linear(np.zeros((0, 0, 0)), self.columns.of_law, np.zeros((0, 0)))
        self.limited |= bool(kept.bounds[at].any())
        states = np.concatenate([kept.stages[at, 0], kept.states[at]], axis=1)
        return self.linear(law.outputs, part.begins[at, None], states, kept.held[at], of_law=True)

    def _jumps(self, part: Schedule, kept: Kept, before: Array, *, delays: bool) -> Array:
        """Jumps of dx/dt where commands begin to act, if the delay is a direction: (acts, size), or without rows."""
        if not delays:
            return np.zeros((0, len(self.x)))
        if self.frozen.law is None:
            at, f = np.flatnonzero(self._later(part)), self.dynamics.right_hand_side
            t, x, u = part.begins[at, None], kept.stages[at, 0], kept.held[at]
            return self.value(f, np.nextafter(t, -np.inf), x, u) - self.value(f, t, x, u)
        at, held = np.flatnonzero(part.acting), np.concatenate([before[None], kept.held])
        return self.jump(part.times[at, :1], kept.stages[at, 0], held[at], kept.held[at])

    def _later(self, part: Schedule) -> Array:
        """Mask of steps that begin with another piece of a reference, which a longer delay moves."""
        begins = self.group.tables[0, 1:, 0] if self.columns.delay >= 0 else np.zeros(0)
        return np.isin(part.begins, begins).astype(np.int64)

    def _stages(self, part: Schedule, kept: Kept, held: Array, which: Array) -> tuple[Array, Linear, Array]:
        """Stages of some steps that only interpolants need: rows of A, derivatives, and dx/dt at all stages."""
        table, x, h, S = part.tableau, kept.stages[which, 0], part.lengths[which, None], len(part.tableau.B)
        A2 = np.zeros((len(table.C) - S, len(table.C)))
        A2[0, :S], A2[1:, : table.A2.shape[1]] = table.B, table.A2
        Y = np.concatenate([kept.stages[which], np.empty((len(which), len(A2), x.shape[1]))], axis=1)
        K, t, u = np.zeros(Y.shape), part.times[which, :, None], held[which]
        for s in range(len(table.C)):
            if s >= S:
                Y[:, s] = x + h * np.tensordot(K, A2[s - S], (1, 0))
            K[:, s] = self.value(self.dynamics.right_hand_side, t[:, s], Y[:, s], u[:, s])
        return A2, self.linear(self.dynamics.accelerations, t[:, S:], Y[:, S:], u[:, S:]), K

    def along_equations(self, parts: Schedule, how: Variational) -> None:
        """Integrate the variational equations from each sample, start of a command or jump of a law to the next."""
        d = self.directions(0)
        for k, end in enumerate(self.task.ends[1:].tolist()):
            self._switch(parts, k, d)
            self._integrate(parts.times[k, [0, -1]], float(parts.begins[k]), end, d, how)
        self.finish(d)

    def _switch(self, parts: Schedule, k: int, d: Directions) -> None:
        """Sample the law, and let a command act, where due."""
        group, law, t = self.group, self.frozen.law, parts.begins[k : k + 1]
        if law is not None and parts.sampled[k]:
            command, bounds, states = np.empty(group.n), np.empty(group.n), np.empty(group.m)
            sample(group.sampled_law, group.holding, t[0], self.x, command, bounds, states)
            slopes = self.linear(law.outputs, t[None], np.append(self.x, states)[None], command, of_law=True)
            carry_sample(slopes, 0, self.holding, bounds, d)
            self.limited |= bool(bounds.any())
        if parts.acting[k]:
            old, row = self.command.copy(), int(self.holding.counts[1]) % len(self.holding.pending)
            self.command[:], d.held[:] = group.holding.pending[row], d.pending[row]
            self.holding.counts[1] += 1
            if d.delay >= 0:
                d.x[d.delay :: d.p] += self.jump(t, self.x, old, self.command)

    def _integrate(self, span: Array, begin: float, end: float, d: Directions, how: Variational) -> None:
        """Integrate the state and its derivatives, column by column, to the end of a part."""
        dynamics, size, n, u = self.dynamics, len(self.x), self.dynamics.n, self.command

        def rates(t: float, y: Array) -> Array:
            time, out = np.clip([t], *span), np.empty(d.x.size)
            J, columns, further = self.linear(dynamics.accelerations, time, y[:size], u)
            carry_slope(J, further, columns, d.held, d.p, turned(y[size:], d.p), out)
            return np.append(self.value(dynamics.right_hand_side, time, y[:size], u), turned(out, size))

        def jacobian(t: float, y: Array) -> Any:
            J = self.linear(dynamics.accelerations, np.clip([t], *span), y[:size], u).slopes
            return how.blocks(np.concatenate([np.eye(n, size, n), J[:, :size]]), d.p + 1)

        solver = how.solver(rates, begin, np.append(self.x, turned(d.x, size)), end, jacobian)
        while solver.status == "running":
            message = solver.step()
            if solver.status == "failed":
                raise NotFiniteError(f"{how.method} gave up on the variational equations: {message}", float(solver.t))
            rows = slice(*np.searchsorted(self.t, [solver.t_old, solver.t]).tolist())
            if count := len(self.t[rows]):
                found = solver.dense_output()(self.t[rows]).T
                along_x = found[:, size:].reshape(count, d.p, size).swapaxes(1, 2)
                along_u = d.held.reshape(1, len(d.held) // d.p, d.p)
                held, along_u = (np.repeat(array, count, axis=0) for array in (u[None], along_u))
                self.report(rows, found[:, :size], held, along_x, along_u)
            self.tell(float(solver.t))
        self.x[:], d.x[:] = solver.y[:size], turned(solver.y[size:], d.p)


class Variational(NamedTuple):
    """Integrator of the variational equations: one of SciPy's methods, with a Jacobian of equal blocks."""

    method: str
    rtol: float
    atol: Array  # (1 + p, size), of the state and of each column

    def solver(self, rates: Any, begin: float, y: Array, end: float, jacobian: Any) -> Any:
        """Solver of SciPy."""
        band = self.atol.shape[1] - 1
        how = {"lband": band, "uband": band} if self.method == "LSODA" else {}
        tolerated = {"rtol": self.rtol, "atol": self.atol.reshape(-1)}
        return scipy_class(self.method)(rates, begin, y, end, jac=jacobian, **tolerated, **how)

    def blocks(self, A: Array, count: int) -> Any:
        """Block-diagonal matrix of copies of A, in the method's format; the change of A is neglected."""
        if self.method != "LSODA":
            from scipy.sparse import block_diag

            return block_diag([A] * count, format="csc")
        packed = np.zeros((2 * len(A) - 1, len(A)))  # by bands
        for j, column in enumerate(A.T):
            packed[len(A) - 1 - j : 2 * len(A) - 1 - j, j] = column
        return np.tile(packed, count)


def turned(matrix: Array, rows: int) -> Array:
    """Transpose of a matrix given as a vector with this number of rows."""
    return matrix.reshape(rows, -1).T.reshape(-1)


def interpolation(table: Tableau, fraction: Array) -> Array:
    """Weights of the stages, (R, stages), of the interpolant at fractions of a step."""
    u, total = fraction[:, None], np.zeros((len(fraction), table.D.shape[1]))
    for k in range(len(table.D) - 1, -1, -1):  # u (d_0 + (1 - u) (d_1 + u (d_2 + ...)))
        total = (table.D[k] + total) * (1 - u if k % 2 else u)
    return total


@dataclass(frozen=True, eq=False)
class Sensitivities(InNotebooks):
    """A motion and its derivatives by its start and by numbers of its scene.

    Attributes
    ----------
    t : ndarray, shape (T,)
        [s]; exactly `t_eval` if it was given, otherwise the ends of steps.
    q, qd, tau : ndarray, shape (T, n)
        Positions, velocities and torques of the drives within their limits, where they jump those after it [rad or m;
        rad/s or m/s; N m or N].
    dq, dqd, dtau : mapping of str to ndarray, shape (T, n, k)
        Their derivatives with respect to each name of `wrt`, whose k entries are in C order; read-only, in units of the
        quantity over those of the number.
    method : str
        The method that ran.
    message : str
        Why this method; whether derivatives are discrete sensitivities of its steps or by the variational equations;
        and whether torques reached limits, where derivatives are one-sided.
    model : Model
        The robot that moved.

    Examples
    --------
    >>> import rne
    >>> scene = rne.Scene(rne.load("irb140"), friction=rne.Friction(viscous=5.0), armature=0.5)
    >>> found = rne.sensitivities(scene, [0] * 6, [0] * 6, 0.1, wrt=["q0", "friction.viscous"], t_eval=[0, 0.1])
    >>> {name: derivatives.shape for name, derivatives in found.dq.items()}
    {'q0': (2, 6, 6), 'friction.viscous': (2, 6, 6)}
    """

    t: Array
    q: Array
    qd: Array
    tau: Array
    dq: Mapping[str, Array]
    dqd: Mapping[str, Array]
    dtau: Mapping[str, Array]
    method: str
    message: str
    model: Model

    def plot(self, name: str | None = None, of: str = "q", **options: Any) -> Any:
        """Draw derivatives by one number over time, one panel for each joint.

        Parameters
        ----------
        name : str, optional
            The number; by default the first of `wrt`.
        of : {"q", "qd", "tau"}
            Of positions, velocities or torques.
        **options
            `joints` and `axes` of `rne.plotting.sensitivity_plot`.

        Returns
        -------
        matplotlib.figure.Figure
            With one curve for each entry of the number.

        Raises
        ------
        ValueError
            If the motion was not differentiated by this number, or `of` or a joint is unknown.
        ImportError
            If matplotlib is not installed.

        Examples
        --------
        >>> import rne
        >>> found = rne.sensitivities(rne.load("irb140"), [0] * 6, [0] * 6, 0.1, wrt="gravity")
        >>> [ax.get_ylabel().splitlines() for ax in found.plot(joints=["joint_2"]).axes]
        [['position [rad]', 'by gravity']]
        """
        return self._plotted(name, of, **options)

    def __repr__(self) -> str:
        names = ", ".join(f"{name} ({x.shape[2]})" for name, x in self.dq.items())
        span = f", {self.t[0]:.6g} to {self.t[-1]:.6g} s" if len(self.t) else ""
        title = f"Sensitivities of '{short(self.model.name)}'{span}, {counted(len(self.t), 'sample')}, by {names}"
        return wrapped(f"{title}\n  {self.message}")


def sensitivities(
    scene_or_robot: Scene | Robot,
    q0: ArrayLike,
    qd0: ArrayLike,
    duration: float,
    *,
    wrt: str | Sequence[str],
    torque: ArrayLike | None = None,
    method: str = "auto",
    step: float | None = None,
    rtol: float = 1e-6,
    atol: float = 1e-9,
    t_eval: ArrayLike | None = None,
    progress: Callable[[float, float], object] | None = None,
) -> Sensitivities:
    """Simulate a robot or a scene with forward sensitivities: derivatives by the start and by numbers of the scene.

    dq/dp, dqd/dp and dtau/dp at many times, as columns that are integrated along with the motion.

    Parameters
    ----------
    scene_or_robot : Scene or Robot
        What moves, without `stops` and friction that sticks; a controller must be traceable.
    q0, qd0 : array_like, shape (n,)
        Initial positions and velocities, as `rne.simulate` takes them [rad or m; rad/s or m/s].
    duration : float
        Time to simulate [s].
    wrt : str or sequence of str
        Names of `scene.numbers`, "delay" among them, "q0" and "qd0".
    torque : array_like, shape (n,), optional
        Constant torques of the drives, for a robot or a scene without a controller [N m or N].
    method : str
        As for `rne.simulate`; with `step` "rk4", which "auto" takes. With explicit methods derivatives are discrete
        sensitivities, exact for the steps that were taken. With LSODA, BDF and Radau the variational equations are
        integrated at the same tolerances; Radau replaces Rodas5P, and a method that "auto" has changed.
    step : float, optional
        The longest of equal steps, which end at samples, where commands begin to act and at `t_eval` [s].
    rtol, atol : float
        Relative and absolute tolerance of steps that are controlled. In the variational equations the absolute one is
        divided by numbers that are larger than 1.
    t_eval : array_like, shape (T,), optional
        Times to report, ascending within [0, duration] [s].
    progress : callable, optional
        A function progress(t, duration), called at most a thousand times with the time that derivatives reached [s].

    Returns
    -------
    Sensitivities
        The motion and its derivatives at the ends of steps, or at `t_eval`.

    Raises
    ------
    ValueError, KeyError
        If a name is not one of the scene's numbers, the motion has no derivative, as with `stops`, dry friction and
        laws that are called, or an argument has the wrong shape or range.
    NotFiniteError, SingularMassMatrixError
        If a state overflows or M becomes singular; says when.
    SimulationError
        The same of steps that are controlled.
    SimulationInterrupted
        On Ctrl-C, a KeyboardInterrupt. Its `trajectory` are the Sensitivities so far.

    Notes
    -----
    Lengths of steps that were controlled are constants in the derivative: it is exactly that of what was computed, and
    differs from that of the motion by as much as the tolerances allow. For a cost of the motion and many numbers
    `rne.motion_gradient` takes less time; its notes on limits, kinks, delays, and infinite and zero numbers hold here
    too. Engine "numba" takes about 50 times less time than NumPy; the first call on a machine compiles for some
    seconds. The variational equations are S' = (df/dx) S + df/dp (Hairer, Norsett and Wanner 1993, section I.14).

    Examples
    --------
    >>> import rne
    >>> scene = rne.Scene(rne.load("irb140"), friction=rne.Friction(viscous=5.0), armature=0.5)
    >>> found = rne.sensitivities(scene, [0] * 6, [0] * 6, 0.1, wrt="friction.viscous")
    >>> bool(found.dq["friction.viscous"][-1, 2, 2] < 0)  # with more friction joint 3 falls less
    True
    """
    scene, names = scene_argument(scene_or_robot), tuple(dict.fromkeys(names_of(wrt)))
    if progress is not None:
        check_function("progress", progress, "(t, duration)")
    known = METHODS if step is None else (FIXED,)
    if method not in ("auto", *known):
        cure = "; rk4 needs `step`" if method == FIXED else ""
        raise ValueError(f"`method` must be 'auto' or one of {list(known)}, got {method!r}{cure}")
    end, held = positive_number("duration", duration), constant_torques(scene, torque, 1)[0]
    times, (rtol, atol) = None if t_eval is None else check_times(t_eval, end), tolerances(rtol, atol)
    frozen, given = FrozenScene(scene, names, None, held.size > 0), zip(STARTS, (q0, qd0), strict=True)
    starts = [real_numbers(name, x, f"({scene.n},)").astype(float) for name, x in given]
    for name, array in zip(STARTS, frozen.dynamics.start(scene.resolved.robot, *starts), strict=True):
        one_state(name, array)
    if step is not None:
        longest, reported = positive_number("step", step), () if times is None else (times,)
        ends = frozen.equal_steps(end, longest, *reported)
        chosen, why = FIXED, f"{FIXED} with steps of at most {longest:.6g} s"
    else:
        how: dict[str, Any] = {"torque": torque, "method": method, "rtol": rtol, "atol": atol}
        run, taken, ends = steps_taken(frozen, scene, {}, starts, end, if_growing=False, **how)
        chosen, why = run.method, run.ending
        if run.changed or chosen not in EXPLICIT:
            chosen = chosen if chosen in IMPLICIT else "Radau"
        if ends is not taken:
            why = f"{why}; its steps are of at most {np.diff(ends).max():.3g} s here, for the fastest mode"
    times = ends if times is None else times
    if chosen in IMPLICIT:
        frozen = replace(frozen, follows_limits=True)
        ends = frozen.equal_steps(end, np.inf)
    x0 = frozen.start(frozen.dynamics.vector, starts[0][None], starts[1][None])[0]
    task = SensitivityTask(frozen, Columns(frozen, names, starts), x0, held, ends, times, progress)
    return _differentiated(task, chosen, why, (rtol, atol))


def _differentiated(task: SensitivityTask, method: str, why: str, tolerated: tuple[float, float]) -> Sensitivities:
    """Motion and its derivatives by a method."""
    frozen, ends, (rtol, atol) = task.frozen, task.ends, tolerated
    table = tableau(FIXED if method in IMPLICIT else method)
    table = table._replace(C=np.concatenate([table.C, [1.0], table.C2]))  # of all stages that interpolants need
    schedule = schedule_of(table, ends, *frozen.instants(ends[-1]))
    run = Forwards(task, by_machine=frozen.by_machine and method not in IMPLICIT)
    try:
        if method in IMPLICIT:
            scales = np.append(1.0, task.columns.scale)[:, None]
            run.along_equations(schedule, Variational(method, rtol, atol / scales + 0 * task.x0))
        elif not run.along_steps(schedule):
            run = Forwards(task, by_machine=False)
            run.along_steps(schedule)
    except NotFiniteError as error:
        longest = f"; steps of {np.diff(ends).max():.3g} s may be too long for the fastest decay"
        raise NotFiniteError(error.args[0] + longest * (method == FIXED), error.time) from None
    except KeyboardInterrupt:
        text = f"sensitivities interrupted at t = {run.reached:.6g} s of {ends[-1]:g} s"
        found = _result(run, int(np.searchsorted(run.t, run.reached)), method, "interrupted")
        raise SimulationInterrupted(text, run.reached, found) from None
    how = f"of the {counted(len(ends) - 1, 'step')} as they were taken"
    how = f"by the variational equations, by {method} at rtol {rtol:g}" if method in IMPLICIT else how
    limited = "; torques reached limits, where derivatives are those of one side" if run.limited else ""
    return _result(run, len(run.t), method, f"{why}; derivatives {how}{limited}")


def _result(run: Forwards, count: int, method: str, message: str) -> Sensitivities:
    """Result at the times reported so far."""
    n, N, model = run.dynamics.joints, run.dynamics.n, run.frozen.scene.resolved.robot.model
    places = slice(0, n), slice(N, N + n)
    along = *(run.along_x[:count, place] for place in places), run.along_tau[:count]
    q, qd = (run.found_x[:count, place] for place in places)
    dq, dqd, dtau = (ByNames(array, run.columns.made) for array in along)
    return Sensitivities(run.task.times[:count], q, qd, run.tau[:count], dq, dqd, dtau, method, message, model)
