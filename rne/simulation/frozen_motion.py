"""A scene for discrete adjoints and sensitivities: equations of motion, a sampled law, a schedule of frozen steps.

A motion is computed from flat arrays: the state, numbers of the equations and of the law as their kernels take them,
bounds of commands, pieces of a reference through samples. These are linear functions of the numbers of the scene.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise
from math import ceil, factorial
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..basics.arrays import real_numbers
from ..basics.numbers import part_of
from ..basics.piecewise import NO_TABLES, numbers_at, rows_of_tables
from ..basics.spatial import Array
from ..control.law_numbers import law_breaks, models_of
from ..control.sampled_loop import in_periods
from ..control.traced_law import TracedLaw
from ..errors import NotFiniteError, SingularMassMatrixError
from ..integrators.frozen_steps import Adjoint, Function, Holding, Kept, Schedule, advance, pull_back
from ..integrators.loops import StateUpdate, compiled
from ..integrators.step_control import NEARLY, aligned, equal_steps
from ..integrators.tableaus import EXPLICIT, Tableau, scipy_class, tableau
from ..kernels.kernel import Kernel
from .run import RunResult
from .scene import Scene
from .scene_dynamics import SceneDynamics, UserFunction
from .scene_numbers import BODIES, bodies_as_numbers, numbers_of_dynamics, unknown, with_inputs
from .simulator import simulate

STARTS = ("q0", "qd0")
FIXED = "rk4"  # method of equal steps
STICKS = "dry `friction` sticks and slips by events: give it a `smoothing` above 0"
EXAMINED, LOOSE = 8, 3.0  # number of the longest steps examined; largest step length relative to the modes' need
SHORTER = 0.95 ** np.arange(100)  # fractions of a step that are tried
GROWTH = 1.02  # largest growth of derivatives per step
MOST_AT_ONCE = 20_000  # most steps times motions per call of machine code, between which Ctrl-C is handled
Own = Mapping[str, Array]


@dataclass(frozen=True, eq=False)
class FrozenScene:
    """Scene for steps whose lengths do not depend on its state; the last state is the cost, if there is one.

    `names` are numbers that differ between motions, or with respect to which these are differentiated.
    """

    given: Scene
    names: tuple[str, ...] = ()
    cost: Callable[..., Any] | None = None
    is_driven: bool = False  # True if torques are given instead of a law
    damped_over: float = 0.0
    follows_limits: bool = False  # True if control of errors follows laws whose drives are at a limit

    @cached_property
    def numbers(self) -> dict[str, Array]:
        """Numbers of the scene."""
        return dict(self.given.numbers)

    @cached_property
    def scene(self) -> Scene:
        """Scene whose kernels have the names as inputs."""
        asked = [name for name in self.names if name not in STARTS]
        models = models_of(self.given.controller, [name.removeprefix("controller.") for name in asked])
        known = {**self.numbers, **{f"controller.{name}": x for name, x in models.items()}}
        for name in asked:
            if name.endswith(".breaks"):
                raise ValueError(f"steps end at {name!r}: it can be neither in `wrt` nor differ from motion to motion")
            if name not in known:
                raise ValueError(f"`wrt`: in addition to 'q0' and 'qd0' {unknown(name, known)}")
        found: Scene = with_inputs(self.given, asked)
        return found

    @cached_property
    def law(self) -> TracedLaw | None:
        """Sampled control law."""
        return None if self.given.sample_time is None else self.scene.traced_law()

    @cached_property
    def _as_given(self) -> SceneDynamics:
        """Equations of the scene; traces a user's law at each call."""
        return self.scene.dynamics

    @cached_property
    def refused(self) -> str:
        """Reason why steps depend on more than the state, and what to do about it; empty if they do not."""
        scene, friction = self.scene, self.given.resolved.friction
        if scene.stops:
            return "`stops` end a run: set `stops` to False"
        if friction is not None and friction.sticks:
            return STICKS
        if scene.controller is not None and self.law is None and self._as_given.law is None:
            cure = "" if getattr(scene.controller, "traceable", False) else ": mark it by rne.traceable"
            return f"`controller` is called, as {scene.why_called}{cure}"
        return ""

    @cached_property
    def dynamics(self) -> SceneDynamics:
        """Equations without energies; a ValueError for what has no derivative."""
        if self.refused:
            raise ValueError(f"the motion cannot be differentiated: {self.refused}")
        found = self.scene.dynamics_under("held") if self.is_driven else self._as_given
        cost = None if self.cost is None else UserFunction("cost", self.cost, (0, *[self.given.n] * 3))
        found = replace(found, has_energies=False, cost=cost, damped_over=self.damped_over)
        found = found if self.follows_limits else replace(found, inertia=None)
        return found if self.law is None else replace(found, effort_limit=None)  # sampled within it

    @property
    def commanded(self) -> int:
        """Number of held commands."""
        return self.given.n if self.dynamics.inputs == "held" else 0

    @cached_property
    def period(self) -> float:
        """Sample time; 0 without a sampled law."""
        return float(self.given.sample_time or 0.0)

    @property
    def update(self) -> StateUpdate:
        """Update rule of a sampled law's states from sample to sample."""
        return StateUpdate.of(self.period, discrete=self.law is not None and self.law.discrete)

    @cached_property
    def delay(self) -> tuple[float, float]:
        """Delay of commands after their samples: whole periods, and the remainder."""
        return self.late(float(self.given.delay or 0.0))

    def late(self, delay: float) -> tuple[float, float]:
        """Delay other than the scene's, in whole periods and a remainder."""
        return in_periods(delay, self.period) if self.period else (0.0, 0.0)

    def instants(self, end: float, delay: float | None = None) -> tuple[Array, Array, Array]:
        """Times of samples before the end, of commands that begin to act, and of jumps of laws."""
        if self.law is None:
            return np.zeros(0), np.zeros(0), self._breaks
        late, rest = self.delay if delay is None else self.late(delay)
        count = np.arange(ceil(end / self.period * NEARLY))
        return count * self.period, (count + late) * self.period + rest, np.zeros(0)

    @cached_property
    def _breaks(self) -> Array:
        return np.array(law_breaks(self.given.controller))

    @cached_property
    def kernel(self) -> Kernel:
        """dx/dt."""
        return self.scene.kernels.scene_kernel(self.dynamics.right_hand_side)

    @property
    def by_machine(self) -> bool:
        """True if steps run in machine code."""
        return self.kernel.is_unrolled and self.kernel.engine == "numba"

    @cached_property
    def gradient(self) -> Kernel:
        """Gradient of dx/dt with respect to the state, commands, and pieces and numbers if asked for."""
        return self.scene.kernels.scene_kernel(self.dynamics.right_hand_side, *self._wrt(self.kernel), order="gradient")

    def _wrt(self, kernel: Kernel) -> tuple[str, ...]:
        asked = {"piece": any(map(self.samples_of, self.names)), "numbers": bool({*self.names} - {*STARTS})}
        return tuple(name for name in kernel.names[1:] if asked.get(name, True))

    @cached_property
    def law_kernel(self) -> Kernel | None:
        """Kernel of the sampled law."""
        return None if self.law is None else self.scene.kernels.scene_kernel(self.law.outputs)

    @cached_property
    def law_gradient(self) -> Kernel | None:
        """Gradient of the sampled law with respect to the state, and pieces and numbers if asked for."""
        if self.law is None or self.law_kernel is None:
            return None
        return self.scene.kernels.scene_kernel(self.law.outputs, *self._wrt(self.law_kernel), order="gradient")

    @cached_property
    def of_bodies(self) -> dict[str, dict[str, Array]]:
        """Derivatives of numbers of the equations by those of bodies, rotors and gravity, (k, entries) each."""
        found: dict[str, dict[str, Array]] = {}
        for name in {*BODIES} & {*self.names}:
            unit = np.eye(self.numbers[name].size)
            at_zero = bodies_as_numbers(self.scene, {name: 0 * unit[:1]})
            found[name] = {k: x - at_zero[k] for k, x in bodies_as_numbers(self.scene, {name: unit}).items()}
        return found

    def equal_steps(self, end: float, step: float, *instants: Array) -> Array:
        """Ends of equal steps that include samples, starts of commands, breaks and further instants."""
        events = self.instants(end)
        return equal_steps(end, step, *events, *(aligned(given, [*events, np.array([end])]) for given in instants))

    def start(self, numbers: Array, q0: Array, qd0: Array) -> Array:
        """Initial states (L, size), under numbers of the equations, (p,) or (L, p)."""
        dynamics = self.dynamics
        q, qd = dynamics.start(self.scene.resolved.robot, q0, qd0)
        if q0.shape[1] < q.shape[1]:
            motors = self.scene.kernels.scene_kernel(dynamics.start_of_motors)(q0, numbers)
            q = np.concatenate([q0, motors], axis=1)
        return np.concatenate([q, qd, np.zeros((len(q), dynamics.size - 2 * dynamics.n))], axis=1)

    def start_slopes(self, numbers: Array, q0: Array, qd0: Array) -> tuple[Array, Array, Array]:
        """Derivatives of the start by q0, (L, size, k), by qd0, and by the numbers of the equations, (L, size, p).

        Where only links are given, the start of the motors of elastic joints, which hold them at rest, depends on them.
        """
        dynamics, L, n = self.dynamics, len(q0), self.dynamics.n
        found = [np.zeros((L, dynamics.size, k)) for k in (q0.shape[1], qd0.shape[1], len(dynamics.vector))]
        for slopes, first in zip(found, (0, n), strict=False):
            k = slopes.shape[2]
            slopes[:, first : first + k] = np.eye(k)
            if k < n:
                slopes[:, first + k : first + 2 * k] = np.eye(k)
        if (k := q0.shape[1]) < n:
            of_motors = self.scene.kernels.scene_kernel(dynamics.start_of_motors, "q", "numbers")(q0, numbers)
            found[0][:, k:n], found[2][:, k:n] = of_motors[..., :k], of_motors[..., k:]
        return found[0], found[1], found[2]

    @cached_property
    def _motion(self) -> tuple[str, Any]:
        """Name of the number that holds the samples of a motion followed by a law, and the motion; or no name."""
        law = self.law or self.dynamics.law
        return ("", None) if law is None or law.motion is None else (f"controller.{law.motion[0]}", law.motion[1])

    def samples_of(self, name: str) -> bool:
        """True for the number that holds the samples of a motion followed by a law."""
        return name == self._motion[0]

    @cached_property
    def by_samples(self) -> Array:
        """Derivatives of the pieces of a motion that a law follows by the samples of one joint, (pieces, k, K)."""
        motion = self._motion[1]
        K = len(motion.samples)
        pieces = motion.with_samples(np.eye(K)).table[:, 2:]
        return np.asarray(pieces.reshape(len(pieces), -1, K))

    def by_names(
        self, wrt: Sequence[str], group: SideBySide, adjoint: Adjoint, starts: tuple[Array, Array]
    ) -> dict[str, Array]:
        """Derivatives by numbers of the scene and by starts, (L, ...) each, from those by a motion's vectors."""
        x = adjoint.x.reshape(-1, group.count).T
        *by_starts, at_start = (np.einsum("ls,lsk->lk", x, D) for D in self.start_slopes(group.numbers, *starts))
        numbers = adjoint.numbers + flat(at_start) if len(adjoint.numbers) else adjoint.numbers
        found = self.by_numbers([k for k in wrt if k not in STARTS], group.count, adjoint._replace(numbers=numbers))
        return found | dict(zip(STARTS, by_starts, strict=True))

    def by_numbers(self, names: Sequence[str], L: int, adjoint: Adjoint) -> dict[str, Array]:
        """Derivatives by numbers, (L, ...) each, of L motions whose starts do not depend on them."""
        found, of_numbers = dict[str, Array](), unpacked(self.dynamics.masks, adjoint.numbers, L)
        of_law = {} if self.law is None else unpacked(self.law.masks, adjoint.of_law, L)
        of_law = {f"controller.{name}": array for name, array in of_law.items()}
        for name in names:
            shape = self.numbers[name].shape if name in self.numbers else None
            total = of_numbers.get(name, 0.0) + of_law.get(name, 0.0)
            for of, matrix in self.of_bodies.get(name, {}).items():
                own = of_numbers.get(of, np.zeros((L, *matrix.shape[1:]))).reshape(L, -1)
                total = total * (name != of) + own @ matrix.reshape(len(matrix), -1).T
            if name in ("effort_limit", "torque_rate") and self.commanded:
                k = int(name == "torque_rate")
                total = total + adjoint.limits[k].reshape(-1, L).T * (self.period if k else 1.0)
            if self.samples_of(name):
                pieces = (adjoint.table if self.law is None else adjoint.law_table).reshape(len(self.by_samples), -1, L)
                by_rows = pieces[:, 2:].reshape(*self.by_samples.shape[:2], -1, L)
                total = total + np.einsum("rcil,rck->lki", by_rows, self.by_samples)
            found[name] = np.asarray(total) if shape is None else np.broadcast_to(total, (L, *shape)).copy()
        return found


def names_of(wrt: Any) -> tuple[str, ...]:
    """Names in `wrt`, checked to be strings."""
    names = (wrt,) if isinstance(wrt, str) or not isinstance(wrt, Iterable) else tuple(wrt)
    if wrong := [name for name in names if not isinstance(name, str)]:
        raise TypeError(f"`wrt` must be names of numbers, got {wrong[0]!r}")
    return names


def constant_torques(scene: Scene, torque: ArrayLike | None, count: int) -> Array:
    """Constant torques, (N, n), or (N, 0) without any."""
    if torque is None:
        return np.zeros((count, 0))
    if scene.controller is not None:
        raise ValueError("`torque` cannot be given for a scene that has a controller")
    if callable(torque):
        raise ValueError(
            "`torque` must be constant here: a law is the `controller` of a scene, marked by rne.traceable"
        )
    given = real_numbers("torque", torque, f"({scene.n},) or ({count}, {scene.n})").astype(float)
    if given.shape not in ((scene.n,), (count, scene.n)):
        raise ValueError(f"`torque` must have shape ({scene.n},) or ({count}, {scene.n}), got {given.shape}")
    return np.broadcast_to(given, (count, scene.n))


def by_numpy(kernel: Kernel, at: int, count: int, is_common: bool) -> Callable[..., bool]:
    """Kernel as a function of flat arrays, for loops run by NumPy; argument `at` is the numbers."""

    def call(*arrays: Array) -> bool:
        given = [a if k == at and is_common else a.reshape(-1, count).T for k, a in enumerate(arrays[:-1])]
        given = [a.reshape(-1) for a in given] if count == 1 else given
        try:
            found, status = kernel.evaluate(*given)
            status.raise_or_warn(stacklevel=2)
        except (NotFiniteError, SingularMassMatrixError) as error:
            t, place = float(arrays[0][0]), f"motion {error.state[0]} " if error.state and count > 1 else ""
            text = f"{place}at t = {t:.6g} s: {error.args[0]}"
            if isinstance(error, SingularMassMatrixError):
                raise SingularMassMatrixError(text, error.cause, error.joints) from None
            raise NotFiniteError(text, t) from None
        arrays[-1].reshape(-1, count)[:] = found.reshape(count, -1).T
        return True

    return call


def unpacked(masks: Mapping[str, Array], vector: Array, count: int) -> dict[str, Array]:
    """Derivatives by whole numbers, (L, ...), from those by the entries that are inputs; zero for the others."""
    if not len(vector):  # they were not asked for
        return {}
    rows, first, found = vector.reshape(-1, count).T, 0, dict[str, Array]()
    for name, mask in masks.items():
        own = int(mask.sum())
        found[name] = np.zeros((count, *mask.shape))
        found[name][:, mask], first = rows[:, first : first + own], first + own
    return found


class SideBySide:
    """Motions of a frozen scene side by side, as the functions of `frozen_steps` take them.

    Parameters
    ----------
    frozen : FrozenScene
    own : mapping of str to ndarray, shape (L, ...)
        Numbers of the scene that differ between motions.
    count : int
        L.
    by_machine : bool
        True for machine code, of 1 or LANES motions.
    """

    def __init__(self, frozen: FrozenScene, own: Own, count: int, *, by_machine: bool) -> None:
        self.frozen, self.own, self.count, self.by_machine = frozen, own, count, by_machine
        dynamics, law = frozen.dynamics, frozen.law
        of_law = part_of(own, "controller.")
        self.numbers = dynamics.vectors(numbers_of_dynamics(frozen.scene, own))
        self.tables = NO_TABLES if dynamics.law is None else dynamics.law.tables(of_law)
        self.law_numbers, self.law_tables = np.zeros(0), NO_TABLES
        if law is not None:
            self.law_numbers, self.law_tables = law.vectors(of_law), law.tables(of_law)
        self.size, self.n, self.m = dynamics.size, frozen.commanded, 0 if law is None else law.states
        self.limits = np.full((2, self.n * count), np.inf)
        for k, (name, factor) in enumerate((("effort_limit", 1.0), ("torque_rate", frozen.period))):
            limit = own.get(name, frozen.numbers.get(name))
            if limit is not None and law is not None:
                self.limits[k] = flat(np.broadcast_to(limit * factor, (count, self.n)))
        pending, states = np.zeros((int(frozen.delay[0]) + 1, self.n * count)), np.zeros((2, self.m * count))
        self.holding = Holding(frozen.update, self.limits, pending, states, np.zeros(2, np.int64))

    def function(self, kernel: Kernel | None, *, of_law: bool = False) -> Function:
        """Kernel of the equations or of the law, under common numbers (p,) or those of each motion (L, p)."""
        if kernel is None:
            return Function(0, (np.zeros(0),) * 4, np.zeros(0), NO_TABLES, 0, np.zeros(0))
        L, numbers, tables = self.count, self.numbers, self.tables
        if of_law:
            numbers, tables = self.law_numbers, self.law_tables
        entries = self.n + self.m if of_law else self.size
        if kernel.wrt:
            entries = sum(kernel.widths[kernel.names.index(name)] for name in kernel.wrt)
        at, is_common = kernel.names.index("numbers"), numbers.ndim == 1
        inputs = [np.zeros(width * L) for width in kernel.widths]
        given = kernel.coefficients(numbers) if self.by_machine else numbers
        inputs[at] = np.array(given.T, order="C").reshape(-1)  # not read-only: it may be in the place of no commands
        call: Any = kernel.address(L, common=is_common) if self.by_machine else by_numpy(kernel, at, L, is_common)
        tables = np.ascontiguousarray(tables)
        return Function(call, tuple(inputs), np.zeros(entries * L), tables, at - 1, np.zeros(L))

    def check_within_samples(self, first: float, last: float, sampled: float) -> None:
        """Raise a ValueError if times of the equations or of a sampled law are outside of its motion's samples."""
        for tables, end in ((self.tables, last), (self.law_tables, sampled)):
            if len(tables):
                numbers_at(tables[0], np.array([first, end]))

    def kept(self, steps: int, stages: int) -> Kept:
        """Storage for a number of steps."""
        size, n, m = (k * self.count for k in (self.size, self.n, self.m))
        return Kept(np.empty((steps, stages, size)), np.empty((steps, n)), np.zeros((steps, m)), np.zeros((steps, n)))

    @cached_property
    def rates(self) -> Function:
        """Kernel of dx/dt, whose command is held between calls."""
        return self.function(self.frozen.kernel)

    @cached_property
    def sampled_law(self) -> Function:
        """Sampled control law."""
        return self.function(self.frozen.law_kernel, of_law=True)

    @cached_property
    def gradients(self) -> tuple[Function, Function]:
        """Gradients of the equations and of the law."""
        return self.function(self.frozen.gradient), self.function(self.frozen.law_gradient, of_law=True)

    def advance(self, schedule: Schedule, x: Array, kept: Kept) -> bool:
        """Integrate the flat state x in place; False if a state needs the recursion."""
        n, stages = self.n * self.count, len(schedule.tableau.B)
        room = np.empty((stages, len(x))), np.empty(len(x)), np.empty(n), np.empty(n)
        text = compiled(advance) if self.by_machine else advance
        taken = text(self.rates, self.sampled_law, schedule, self.holding, x, room, kept)
        return int(taken) == len(schedule.lengths)

    def adjoint(self, x: Array, stages: int) -> Adjoint:
        """Adjoint with derivatives by the flat state at the end, all others zero."""
        L, (gradient, law) = self.count, self.gradients
        n, m, rows = self.n * L, self.m * L, len(self.holding.pending)
        of, tables = (self.frozen.gradient, self.frozen.law_gradient), (self.tables, self.law_tables)
        by_pieces = [kernel is not None and "piece" in kernel.wrt for kernel in of]
        pieces = [(a.shape[1], a.shape[2] * L * is_asked) for a, is_asked in zip(tables, by_pieces, strict=True)]
        k = len(gradient.out) - len(x) - n - pieces[0][1]
        of_law = len(law.out) - len(law.inputs[1]) - pieces[1][1] if len(law.out) else 0
        pending, numbers, limits = np.zeros((rows, n)), (np.zeros(k), np.zeros(of_law)), np.zeros((2, n))
        room = np.empty((0, len(x))), np.empty((stages, len(x)))
        table, law_table = map(np.zeros, pieces)
        return Adjoint(x, np.zeros(n), pending, np.zeros(m), *numbers, limits, table, law_table, *room)

    def pull_back(self, schedule: Schedule, kept: Kept, adjoint: Adjoint) -> bool:
        """Integrate the adjoint backwards through steps; False if a state needs the recursion."""
        text = compiled(pull_back) if self.by_machine else pull_back
        return not text(*self.gradients, schedule, self.holding, kept, adjoint)


def flat(rows: Array) -> Array:
    """Rows of motions side by side, (L, k), flattened."""
    return np.ascontiguousarray(rows.T).reshape(-1)


def schedule_of(method: Tableau, ends: Array, samples: Array, arrivals: Array, breaks: Array) -> Schedule:
    """Schedule of steps between times, (K + 1,), each on its own side of breaks, samples and commands."""
    begins, lengths = ends[:-1], np.diff(ends)
    first = np.where(np.isin(begins, breaks), np.nextafter(begins, np.inf), -np.inf)
    last = np.where(np.isin(ends[1:], breaks), np.nextafter(ends[1:], -np.inf), np.inf)
    times = np.clip(begins[:, None] + method.C * lengths[:, None], first[:, None], last[:, None])
    sampled, acting = (np.isin(begins, instants).astype(np.int64) for instants in (samples, arrivals))
    return Schedule(method, 0, times, begins.copy(), lengths, sampled, acting)


def steps_taken(
    frozen: FrozenScene, scene: Scene, own: Own, starts: Sequence[Array], end: float, *, if_growing: bool, **how: Any
) -> tuple[RunResult, Array, Array]:
    """Run by a method with step control; ends of its steps, for explicit methods those of `divided_steps`."""
    q0, qd0 = starts
    run = simulate(scene, q0, qd0, end, **how).run
    ends = aligned(run.reported.t, frozen.instants(end))
    if run.changed or run.method not in EXPLICIT:
        return run, ends, ends
    return run, ends, divided_steps(frozen, own, run, ends, if_growing=if_growing)


def divided_steps(frozen: FrozenScene, own: Own, run: RunResult, ends: Array, *, if_growing: bool) -> Array:
    """Ends of a run's steps, with those too long for the fastest mode divided.

    Where nothing moves, the control of errors allows any step, but derivatives do not. A step h resolves a mode of
    rate r if the remainder of Taylor's series, (h r)^(p + 1) / (p + 1)!, is at most the relative tolerance. With
    `if_growing` only steps for which the method is unstable, so that derivatives grow from step to step, are divided.
    The motion's `own` numbers have shapes (1, ...).
    """
    t, x, dynamics, order = run.reported.t, run.reported.x, frozen.dynamics, int(scipy_class(run.method).order)
    k, group = np.argsort(np.diff(t))[-EXAMINED:], SideBySide(frozen, own, 1, by_machine=False)
    known = dynamics.size - (dynamics.cost is not None)
    states = np.pad(x[k, :known], ((0, 0), (0, dynamics.size - known)))
    held = (np.zeros((len(k), group.n)),) if group.n else ()
    kernel = frozen.scene.kernels.scene_kernel(dynamics.right_hand_side, "x")
    numbers = group.numbers.reshape(-1)
    modes = np.linalg.eigvals(kernel(t[k, None], states, *held, *rows_of_tables(group.tables, t[k]), numbers))
    h, rates = np.diff(t)[k], np.abs(modes).max(axis=1, initial=1e-300)
    longest = (run.task.rtol * factorial(order + 1)) ** (1 / (order + 1)) / float(rates.max(initial=1e-300))
    if h.max(initial=0.0) <= LOOSE * longest:
        return ends
    if if_growing:
        part = stable_part(tableau(run.method), h[:, None] * modes)
        longest = float((part * h)[part < 1].min(initial=np.inf))
    are_long = np.diff(ends) > longest
    inside = np.concatenate([[False], are_long[1:] & are_long[:-1], [False]])  # between two long steps
    kept = ends[~inside | np.isin(ends, np.concatenate(frozen.instants(float(ends[-1]))))]
    counts = np.maximum(1, np.ceil(np.diff(kept) / longest * NEARLY)).astype(int)
    parts = [np.linspace(a, b, count + 1)[1:] for (a, b), count in zip(pairwise(kept.tolist()), counts, strict=True)]
    return np.concatenate([kept[:1], *parts])


def stable_part(method: Tableau, z: Array) -> Array:
    """Fraction of steps, (K,), at which modes z = h lambda, (K, size), grow no more than they should.

    By the method's stability function, R(z) = 1 + z b^T (I - z A)^-1 1 (Hairer and Wanner 1996, equation IV.3.2).
    """
    powers, z = [np.ones(len(method.B))], SHORTER[:, None, None] * z
    for _ in method.B[1:]:
        powers.append(method.A @ powers[-1][: method.A.shape[1]])
    R = np.polyval(np.append((np.array(powers) @ method.B)[::-1], 1.0), z)
    grows = (np.abs(R) > np.maximum(1.0, np.exp(z.real)) * GROWTH).any(axis=2)
    last = len(SHORTER) - 1 - np.argmax(grows[::-1], axis=0)  # the shortest part that grows
    return np.asarray(np.where(grows.any(axis=0), SHORTER[np.minimum(last + 1, len(SHORTER) - 1)], 1.0))
