"""Gradients of a cost of motions by the discrete adjoint of their steps (reverse mode)."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ..basics.arrays import check_function, positive_number, real_numbers, whole_number
from ..basics.spatial import Array
from ..control.laws import traceable
from ..errors import NotFiniteError
from ..integrators.frozen_steps import Adjoint, Kept, Schedule
from ..integrators.loops import LANES
from ..integrators.tableaus import EXPLICIT, tableau
from ..kernels.kernel import Kernel
from ..model.model import Model
from ..robot import Robot
from .frozen_motion import (
    FIXED,
    MOST_AT_ONCE,
    STARTS,
    STICKS,
    FrozenScene,
    Own,
    SideBySide,
    constant_torques,
    flat,
    names_of,
    schedule_of,
    steps_taken,
)
from .scene import Scene
from .scene_dynamics import UserFunction
from .scene_numbers import common_and_own
from .simulator import METHODS, scene_argument, tolerances


class MotionGradient(NamedTuple):
    """The cost of a motion and its gradient by name; of a batch of N motions with a leading axis of N.

    Attributes
    ----------
    value : float or ndarray, shape (N,)
        The integral of `cost` over time plus `final` at the end.
    gradient : dict of str to ndarray
        Its derivatives by each name of `wrt`, of the shape of that number, or (N, ...).
    """

    value: Any
    gradient: dict[str, Array]


class Segment(NamedTuple):
    """Range of steps whose values are stored together, and copies of the state, command and holding at its start."""

    first: int
    end: int
    x: Array
    command: Array
    held: tuple[Array, ...]


class _Backwards:
    """Adjoint of motions side by side over a schedule, with checkpoints where not all steps can be stored."""

    def __init__(self, group: SideBySide, schedule: Schedule, memory: int, tell: Callable[[int], None]) -> None:
        self.group, self.schedule, self.tell = group, schedule, tell
        steps, stages = len(schedule.lengths), len(schedule.tableau.B)
        each = 8 * group.count * (stages * group.size + 2 * group.n + group.m)
        self.most = max(1, min(memory // each, steps))
        self.kept = group.kept(self.most, stages)
        self.segments: list[Segment] = []

    def forwards(self, x: Array) -> bool:
        """Integrate from the flat state x to the end, store the last segment; False if a state needs the recursion."""
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
            here = kept.part(first - segment.first, end - segment.first)
            if not self.group.advance(self.schedule.part(first, end), x, here):
                return False
            self.tell(end - first)
        return True

    def _parts(self, segment: Segment) -> list[tuple[int, int]]:
        most = max(1, MOST_AT_ONCE // self.group.count)
        return [(k, min(k + most, segment.end)) for k in range(segment.first, segment.end, most)]

    def backwards(self, adjoint: Adjoint, *, by_delay: bool) -> Array | None:
        """Adjoint integrated from end to start; derivatives by the delay, None if a state needs the recursion."""
        total = np.zeros(self.group.count)
        for segment in reversed(self.segments):
            if segment is not self.segments[-1]:
                self._command[:] = segment.command
                for now, then in zip(self.group.holding[2:], segment.held, strict=True):
                    now[:] = then
                if not self._advance(segment.x.copy(), segment, self.kept):
                    return None
            for first, end in reversed(self._parts(segment)):
                kept, part = self.kept.part(first - segment.first, end - segment.first), self.schedule.part(first, end)
                arrivals = np.empty((end - first if by_delay else 0, len(adjoint.x)))
                if not self.group.pull_back(part, kept, adjoint._replace(arrivals=arrivals)):
                    return None
                if by_delay:
                    before = segment.command if first == segment.first else self.kept.held[first - segment.first - 1]
                    total += self._by_delay(part, kept, arrivals, before)
                self.tell(end - first)
        return total

    def _by_delay(self, part: Schedule, kept: Kept, arrivals: Array, before: Array) -> Array:
        """Derivatives by the delay: a later command lets the one before it act for longer."""
        group, L = self.group, self.group.count
        k, held = np.flatnonzero(part.acting), np.concatenate([before[None], kept.held])
        if not len(k):
            return np.zeros(L)
        given = kept.stages[k, 0], held[k], held[k + 1], arrivals[k]
        x, old, new, slopes = (a.reshape(len(k), -1, L).transpose(0, 2, 1) for a in given)
        t = np.broadcast_to(part.times[k, 0][:, None, None], (len(k), L, 1))
        rates = [group.frozen.kernel(t, x, u, group.numbers) for u in (old, new)]
        return np.asarray((slopes * (rates[0] - rates[1])).sum(axis=(0, 2)))


class _Batch(NamedTuple):
    """Motions to be differentiated, and the options of their steps."""

    starts: tuple[Array, Array]  # positions and velocities, (N, n) each
    own: Own
    torques: Array  # (N, n), constant, or without entries
    end: float  # [s]
    step: float | None  # the longest of equal steps [s]
    method: str
    tolerances: tuple[float, float]  # relative and absolute, where steps are not equal

    def rows(self, rows: Array) -> _Batch:
        """Slice of the motions."""
        q, qd = self.starts
        own = {name: array[rows] for name, array in self.own.items()}
        return self._replace(starts=(q[rows], qd[rows]), own=own, torques=self.torques[rows])

    def schedule(self, frozen: FrozenScene) -> Schedule:
        """Schedule of motions side by side: equal steps, or those that step control chose for a single motion."""
        if self.step is not None:
            ends = frozen.equal_steps(self.end, self.step)
        else:
            scene, torque = frozen.scene, self.torques[0] if self.torques.size else None
            if self.own:
                scene = scene.naming({name: x[0] for name, x in self.own.items()}, (), scene.varying)
            how = {"rtol": self.tolerances[0], "atol": self.tolerances[1], "method": self.method, "torque": torque}
            start = [x[0] for x in self.starts]
            *_, ends = steps_taken(frozen, scene, self.own, start, self.end, if_growing=True, **how)
        return schedule_of(tableau(self.method), ends, *frozen.instants(self.end))


class _Progress:
    """Progress of the steps of all motions, forwards and backwards, reported to `progress`."""

    def __init__(self, progress: Callable[[int, int], object] | None) -> None:
        self.progress, self.done, self.total, self.count = progress, 0, 0, 0

    def begin(self, total: int, count: int) -> None:
        """Begin a group of `count` motions; all motions have at least `total` steps."""
        self.total, self.count = max(self.total, total), count

    def tell(self, steps: int) -> None:
        """Report a number of steps of each motion."""
        self.done += steps * self.count
        if self.progress is not None:
            self.progress(min(self.done, self.total), self.total)


@dataclass(frozen=True)
class _Task:
    """Cost to be differentiated, names to differentiate by, and memory."""

    frozen: FrozenScene
    final: UserFunction | None
    names: tuple[str, ...]
    memory: int
    progress: _Progress

    def of_all(self, batch: _Batch) -> tuple[Array, dict[str, Array]]:
        """Costs of all motions, (N,), and their derivatives, side by side where they have the same steps."""
        frozen, count = self.frozen, len(batch.starts[0])
        L = 1 if batch.step is None else count if not frozen.by_machine else LANES if count > 1 else 1
        value, gradient = np.zeros(count), dict[str, Array]()
        for at, places in _side_by_side(frozen, batch.own, count, batch.end, L):
            idle = L - len(places) if frozen.by_machine else 0
            part = batch.rows(np.append(places, np.full(idle, places[-1])))  # the last motion fills the lanes
            schedule = part.schedule(at)
            self.progress.begin(2 * len(schedule.lengths) * count, len(places))
            values, found = replace(self, frozen=at).of_group(part, schedule, by_machine=frozen.by_machine)
            value[places] = values[: len(places)]
            for name, array in found.items():
                gradient.setdefault(name, np.zeros((count, *array.shape[1:])))[places] = array[: len(places)]
        if not count:
            n = frozen.scene.n
            shapes = {name: x.shape for name, x in frozen.scene.numbers.items()} | dict.fromkeys(STARTS, (n,))
            gradient = {name: np.zeros((0, *shapes[name])) for name in self.names}
        return value, gradient

    def of_group(self, part: _Batch, schedule: Schedule, *, by_machine: bool) -> tuple[Array, dict[str, Array]]:
        """Costs of motions side by side, (L,), and derivatives; by NumPy where a state needs the recursion."""
        group = SideBySide(self.frozen, part.own, len(part.starts[0]), by_machine=by_machine)
        try:
            found = self._of(group, part.starts, part.torques, schedule)
        except NotFiniteError as error:
            if error.time is None:  # of `final`
                raise
            longest = f"; steps of {schedule.lengths.max():.3g} s may be too long for the fastest decay"
            raise NotFiniteError(error.args[0] + longest, error.time) from None
        if found is None:
            return self.of_group(part, schedule, by_machine=False)
        return found

    def _of(
        self, group: SideBySide, starts: tuple[Array, Array], torque: Array, schedule: Schedule
    ) -> tuple[Array, dict[str, Array]] | None:
        run, L = _Backwards(group, schedule, self.memory, self.progress.tell), group.count
        end, samples = schedule.begins[-1] + schedule.lengths[-1], schedule.begins[schedule.sampled > 0]
        group.check_within_samples(0.0, end, samples.max(initial=0.0))
        x = flat(self.frozen.start(group.numbers, *starts))
        if torque.size:
            group.rates.inputs[2][:] = flat(torque)
        if not run.forwards(x):
            return None
        value, slopes = self._at_end(x.reshape(-1, L).T)
        adjoint = group.adjoint(flat(slopes), len(schedule.tableau.B))
        by_delay = run.backwards(adjoint, by_delay="delay" in self.names)
        if by_delay is None:
            return None
        found = self.frozen.by_names(self.names, group, adjoint, starts)
        return value, found | ({"delay": by_delay} if "delay" in self.names else {})

    def _at_end(self, x: Array) -> tuple[Array, Array]:
        """Costs of final states, (L, size), and their gradients."""
        dynamics, value, slopes = self.frozen.dynamics, np.zeros(len(x)), np.zeros_like(x)
        if dynamics.cost is not None:
            value, slopes[:, -1] = x[:, -1].copy(), 1.0
        if self.final is None:
            return value, slopes
        places = [slice(first, first + dynamics.joints) for first in (0, dynamics.n)]
        kernel, gradients = _kernels_at_end(self.final, self.frozen.scene.resolved.robot.model)
        joints = [x[:, place] for place in places]
        at_end = kernel(*joints)
        for place, part in zip(places, np.split(gradients(*joints, np.ones((len(x), 1))), 2, axis=1), strict=True):
            slopes[:, place] += part
        return value + at_end, slopes


@lru_cache(maxsize=64)
def _kernels_at_end(final: UserFunction, model: Model) -> tuple[Kernel, Kernel]:
    """Kernels of a function of the end and of its gradient."""
    traced: Any = traceable(lambda q, qd: final.value(q, qd))
    traced.__name__ = final.name  # in errors
    return Kernel(traced, model, {}), Kernel(traced, model, {}, ("q", "qd"), order="gradient")


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
    progress: Callable[[int, int], object] | None = None,
) -> MotionGradient:
    """The gradient of a cost of a motion, integrated over time and of its end, by the discrete adjoint.

    J = integral of cost(t, q, qd, tau) dt + final(q, qd), with respect to the start and to numbers of the scene. The
    gradient is exact for J as it was computed, up to rounding: step sizes are constants, and the states of all stages
    are kept. It takes the time of 3 to 6 motions, however many numbers there are.

    Parameters
    ----------
    scene_or_robot : Scene or Robot
        What moves, without `stops` and friction that sticks; a controller must be traceable.
    q0, qd0 : array_like, shape (n,) or (N, n)
        Initial positions and velocities, as `rne.simulate` takes them, of one motion or of a batch of N [rad or m;
        rad/s or m/s].
    duration : float
        Time to simulate [s].
    cost : callable, optional
        A function cost(t, q, qd, tau) -> number of one state, arrays of shape (n,), integrated over the motion, that
        can be traced: of arithmetic and the functions of `rne.elementwise`, without branches on values. `tau` are the
        drives' torques within their limits. A function with other operations is traced anew.
    final : callable, optional
        A function final(q, qd) -> number of the state at the end, likewise.
    wrt : str or sequence of str
        Names of `scene.numbers`, "q0" and "qd0".
    torque : array_like, shape (n,) or (N, n), optional
        Constant torques of the drives, for a robot or a scene without a controller [N m or N].
    numbers : mapping of str to array_like, optional
        Numbers of the scene instead of its own; of N motions each has its own, shape (N, ...), or all the same ones.
    method : str
        "rk4" with `step`; without it Tsit5, RK45, RK23 or DOP853 with step control. "auto" is rk4, Tsit5 between
        samples and DOP853. Stiff motions take many steps; an `armature` or a larger `smoothing` of friction makes
        these longer, and `rne.sensitivities` takes implicit methods.
    step : float, optional
        The longest of equal steps, which end at samples and where commands begin to act [s].
    rtol, atol : float
        Relative and absolute tolerance of steps that are controlled.
    memory : int
        Bytes for the states of stages. Where these need more, checkpoints are stored and the motion is computed twice.
    progress : callable, optional
        A function progress(done, total), called with numbers of steps, forwards and backwards, of all motions.

    Returns
    -------
    MotionGradient
        A tuple of value, a number or (N,), and gradient: arrays by name, of the numbers' shapes, or (N, ...).

    Raises
    ------
    ValueError, KeyError
        If a name is not one of the scene's numbers, the motion has no derivative, as with `stops`, dry friction and
        laws that are called, or an argument has the wrong shape or range.
    TypeError
        If `cost` or `final` branch on values or are no functions of these arguments, or an argument is of another type.
    NotFiniteError, SingularMassMatrixError
        If a state overflows or M becomes singular; says which motion, and when.
    SimulationError
        The same of steps that are controlled.

    Notes
    -----
    Engine "numba" takes 50 to 300 times less time than NumPy; the first call on a machine compiles for some seconds.
    Where torques reach a limit, and of kinks of friction and laws, derivatives are those of the side on which a stage
    is. With respect to "delay" it is the jump of dx/dt where a command begins to act, for delays that grow.
    Derivatives by infinite numbers are 0. Step control does not see the effect of numbers that are 0, such as friction
    that is not there: for derivatives by them give `step`.
    Sandu 2006, On the properties of Runge-Kutta discrete adjoints, equation 4; Griewank and Walther 2008, chapter 3.

    Examples
    --------
    >>> import rne
    >>> scene = rne.Scene(rne.load("irb140"), friction=rne.Friction(viscous=5.0), armature=0.5)
    >>> value, gradient = rne.motion_gradient(
    ...     scene, [0] * 6, [0] * 6, 0.1, final=lambda q, qd: q[1] ** 2, wrt="friction.viscous", step=0.01
    ... )
    >>> gradient["friction.viscous"].shape, bool(gradient["friction.viscous"][1] < 0)  # more friction, smaller angle
    ((6,), True)
    """
    scene, names = scene_argument(scene_or_robot), names_of(wrt)
    _check_functions(cost, final, progress)
    starts, is_one = _starts(scene, q0, qd0)
    count, end = len(starts[0]), positive_number("duration", duration)
    what = f"the motion cannot be differentiated: {STICKS}"
    scene, own = common_and_own(scene, numbers or {}, count, what, is_one=is_one)
    torques = constant_torques(scene, torque, count)
    frozen = FrozenScene(scene, tuple(dict.fromkeys((*names, *own))), cost, torques.size > 0)
    chosen = _method(frozen, method, step)
    at_end = None if final is None else UserFunction("final", final, (scene.n,) * 2)
    task = _Task(frozen, at_end, names, whole_number("memory", memory, least=1), _Progress(progress))
    longest = None if step is None else positive_number("step", step)
    value, gradient = task.of_all(_Batch(starts, own, torques, end, longest, chosen, tolerances(rtol, atol)))
    part = 0 if is_one else slice(None)
    return MotionGradient(value[part], {name: gradient[name][part] for name in names})


def _check_functions(cost: Any, final: Any, progress: Any) -> None:
    """Raise an error if one of them is no function, or there is nothing to differentiate."""
    functions = {
        "cost": (cost, "(t, q, qd, tau)"),
        "final": (final, "(q, qd)"),
        "progress": (progress, "(done, total)"),
    }
    for name, (function, arguments) in functions.items():
        if function is not None:
            check_function(name, function, arguments)
    if cost is None and final is None:
        raise ValueError("`cost` or `final` must be given: without both there is nothing to differentiate")


def _side_by_side(
    frozen: FrozenScene, own: Own, count: int, end: float, most: int
) -> Iterator[tuple[FrozenScene, Array]]:
    """Groups of motions whose samples act at the same times, with a largest size, and the scene with their delay."""
    delay = float(frozen.given.delay or 0.0)
    late = np.minimum(own.get("delay", np.full(count, delay)), end + 2 * frozen.period)  # later ones do not act at all
    for same in np.unique(late).tolist():
        at = frozen if same == delay else replace(frozen, given=frozen.given.naming({"delay": np.array(same)}, ()))
        places = np.flatnonzero(late == same)
        for first in range(0, len(places), most):
            yield at, places[first : first + most]


def _starts(scene: Scene, q0: ArrayLike, qd0: ArrayLike) -> tuple[tuple[Array, Array], bool]:
    """Initial positions and velocities, (N, n) each, and True if they are those of one motion."""
    n = scene.n
    q, qd = (real_numbers(name, x, f"({n},) or (N, {n})").astype(float) for name, x in (("q0", q0), ("qd0", qd0)))
    if q.ndim != qd.ndim or q.ndim not in (1, 2) or q.shape[:-1] != qd.shape[:-1]:
        raise ValueError(f"`q0` and `qd0` must both have shape ({n},) or (N, {n}), got {q.shape} and {qd.shape}")
    scene.dynamics_without_law.start(scene.resolved.robot, q, qd)  # raises the errors of the arrays
    return (np.atleast_2d(q), np.atleast_2d(qd)), q.ndim == 1


def _method(frozen: FrozenScene, method: str, step: float | None) -> str:
    """The method, checked."""
    known = (FIXED,) if step is not None else EXPLICIT
    if method not in ("auto", *known):
        others = "leave `step` out for others" if method in EXPLICIT else "rne.sensitivities takes implicit ones"
        cure = "; rk4 needs `step`" if method == FIXED else f"; {others}" if method in METHODS else ""
        raise ValueError(f"`method` must be 'auto' or one of {list(known)}, got {method!r}{cure}")
    auto = FIXED if step is not None else "DOP853" if frozen.law is None else "Tsit5"
    return auto if method == "auto" else method
