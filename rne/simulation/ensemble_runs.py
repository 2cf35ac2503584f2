"""Many motions of one scene in chunks, which other threads or processes can take.

A chunk runs side by side, by the rows of NumPy or in the lanes of machine code, or motion by motion as `rne.simulate`.
"""

from __future__ import annotations

import itertools
import pickle
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import lru_cache, partial
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from ..basics.spatial import Array
from ..dynamics.quantity import OK, PrecisionStatus
from ..errors import NotFiniteError, SimulationError
from ..kernels.explicit_methods import method_named
from ..kernels.kernel import Kernel
from ..model.parameters import at_parameters
from ..robot import Robot
from .equations_of_motion import RightHandSide
from .plant import Plant
from .row_steps import ControlledSteps, Rates, equal_steps, first_steps
from .scene import Scene

if TYPE_CHECKING:
    from concurrent.futures import Executor, Future

CHUNK = 1024  # motions side by side, so that their states stay in the cache
Progress = Callable[[int, int], Any]
Tick = Callable[[int], Any]


class Chunk(NamedTuple):
    """Initial states, their inertial parameters (of no columns where all have the robot's), and the first's number."""

    x: Array
    parameters: Array
    first: int = 0

    def part(self, begin: int, end: int) -> Chunk:
        """Some of them."""
        return Chunk(self.x[begin:end], self.parameters[begin:end], self.first + begin)


class Part(NamedTuple):
    """Motions of a chunk at the times to report, and how they went."""

    q: Array  # (S, N, n), as `qd` and `tau`
    qd: Array
    tau: Array
    energies: Array  # (S, N, k)
    end: Array  # (N,), times of their ends
    stopped: Array  # (N,), whether an event did
    methods: tuple[str, ...]
    evaluations: int
    verdict: PrecisionStatus


class Span(NamedTuple):
    """A part of the time within which torques do not jump."""

    begin: float
    end: float
    first: float  # and last: times at which torques are evaluated
    last: float


def spans_between(breaks: list[float], duration: float) -> tuple[Span, ...]:
    """The parts of the time between breaks."""
    inner = [b for b in breaks if 0 < b < duration]
    ends = itertools.pairwise([0.0, *inner, duration])
    after = {b: float(np.nextafter(b, np.inf)) for b in inner}
    before = {b: float(np.nextafter(b, 0.0)) for b in inner}
    return tuple(Span(a, b, after.get(a, -np.inf), before.get(b, np.inf)) for a, b in ends)


@dataclass(frozen=True, eq=False)
class SideBySide:
    """Motions by an explicit method, all at once.

    Attributes
    ----------
    rhs : RightHandSide
        With the energies of the ledger as its last states.
    method : str
    times : ndarray, shape (S,)
        To report.
    spans : tuple of Span
    grid : ndarray
        The ends of steps that are not controlled, the start included; empty for those that are.
    rtol, atol : float
    with_parameters : bool
        True if each motion has its own inertial parameters.
    """

    rhs: RightHandSide
    method: str
    times: Array
    spans: tuple[Span, ...]
    grid: Array
    rtol: float
    atol: float
    with_parameters: bool

    @property
    def kernel(self) -> Kernel:
        """dx/dt, of the chunk's inertial parameters where it has some."""
        return self.rhs.kernel_at_parameters if self.with_parameters else self.rhs.kernel

    @property
    def counted(self) -> int:
        """Components of the state whose errors count: energies are integrated along."""
        return self.rhs.size - len(self.rhs.ledger)

    @property
    def positions(self) -> int:
        """Components that move with the rates at the end of the step."""
        return self.rhs.robot.n if self.method == "semi-implicit-euler" else 0

    @property
    def work(self) -> int:
        """Units of progress of one motion: its steps, or itself."""
        return max(len(self.grid) - 1, 1)

    def run(self, chunk: Chunk, tick: Tick) -> Part:
        """The motions of a chunk."""
        x, verdict, evaluations = chunk.x, OK, 0
        kept = [x[None]] if 0.0 in self.times else []
        in_lanes = self.kernel.engine == "numba" and self.kernel.is_unrolled and x.dtype == np.float64
        for span in self.spans:
            inner = self.times[(self.times > span.begin) & (self.times <= span.end)]
            times = inner if len(inner) and inner[-1] == span.end else np.append(inner, span.end)
            X = np.empty((len(times), *x.shape), x.dtype)
            left = np.arange(len(x))
            last = span is self.spans[-1]
            if in_lanes:
                left, count = Lanes(self, chunk, span).run(x, times, X)
                evaluations += count
                tick(self.work * (len(x) - len(left)) * last)
            if len(left):
                some = X if len(left) == len(x) else np.empty((len(times), len(left), x.shape[1]), x.dtype)
                rates = self._by_rows(chunk, left, span, x[left], times, some, tick if last else lambda count: None)
                X[:, left] = some
                evaluations, verdict = evaluations + rates.evaluations, verdict.worse(rates.verdict)
            x = X[-1]
            kept.append(X[: len(inner)])
        return self._part(np.concatenate(kept), evaluations, verdict)

    def _by_rows(self, chunk: Chunk, left: Array, span: Span, x: Array, times: Array, X: Array, tick: Tick) -> Rates:
        is_fixed, step = len(self.grid) > 0, np.diff(self.grid[:2]).sum()
        cure = f"; steps of {step:g} s may be too long for the fastest decay: try shorter ones" if is_fixed else ""
        rates = Rates(self.kernel, chunk.parameters[left], chunk.first + left, (span.first, span.last), cure)
        method = method_named(self.method)
        if is_fixed:
            equal_steps(rates, method, self.positions, self.grid, x, times, X, tick)
        else:
            controls = (self.counted, self.rtol, self.atol)
            ControlledSteps(rates, method, controls, (span.begin, span.end), times, X).run(x, tick)
        return rates

    def _part(self, x: Array, evaluations: int, verdict: PrecisionStatus) -> Part:
        """States as positions, velocities, torques and energies."""
        n, N = self.rhs.robot.n, x.shape[1]
        t, states = np.repeat(self.times, N), x[..., : self.counted].reshape(-1, self.counted)
        drives = Plant(self.rhs, None).drives_under(t.astype(x.dtype), states, None)
        q, qd, energies = x[..., :n], x[..., n : 2 * n], x[..., self.counted :]
        tau = np.zeros(q.shape, x.dtype) if drives is None else drives.astype(x.dtype).reshape(q.shape)
        end = np.full(N, self.spans[-1].end)
        return Part(q, qd, tau, energies, end, np.zeros(N, bool), (self.method,), evaluations, verdict)


class Lanes:
    """A chunk in machine code, over a span of time."""

    def __init__(self, plan: SideBySide, chunk: Chunk, span: Span) -> None:
        from ..kernels.loops import LANES
        from ..kernels.many_motions import workspace

        self.plan, self.span, self.kernel, self.method = plan, span, plan.kernel, method_named(plan.method)
        self.parameters = (np.ascontiguousarray(chunk.parameters),) if plan.with_parameters else ()
        self.address = self.kernel.address(LANES)
        self.work = workspace(self.kernel.widths, self.method)
        self.code = np.zeros(len(chunk.x), dtype=np.int64)  # other than 0 of motions to be examined

    def run(self, x: Array, times: Array, X: Array) -> tuple[Array, int]:
        """Motions from states x into X; the rows of those that are left, because a state must be examined."""
        plan, span = self.plan, self.span
        x, count = np.ascontiguousarray(x), np.zeros(len(x), dtype=np.int64)
        begin, F, H = np.full((len(x), 1), span.begin), np.zeros_like(x), np.zeros(len(x))
        norm = plan.counted, plan.rtol, plan.atol, self.method.power
        if not len(plan.grid):
            self._rates(np.clip(begin, span.first, span.last), x, F)
            H = first_steps(self._trial, span.begin, x.T, F.T, span.end - span.begin, norm)
            count += 2
        compiled_loop("run_all")(
            self.address,
            self.method.tables,
            (span.first, span.last, span.end),
            (plan.positions, *norm),
            plan.grid,
            times,
            (begin, x, *self.parameters),
            F,
            H,
            self.code,
            count,
            X,
            self.work,
        )
        return np.flatnonzero(self.code), int(count.sum())

    def _trial(self, t: Array, x: Array) -> Array:
        F = np.zeros(x.T.shape)
        self._rates(np.clip(t, self.span.first, self.span.last)[:, None], np.ascontiguousarray(x.T), F)
        return F.T

    def _rates(self, t: Array, x: Array, F: Array) -> None:
        compiled_loop("rates_of_all")(self.address, (t, x, *self.parameters), F, self.code, self.work)


@lru_cache
def compiled_loop(name: str) -> Callable[..., Any]:
    """A loop of `kernels.many_motions` in machine code."""
    from ..kernels import many_motions
    from ..kernels.loops import compiled

    return compiled(getattr(many_motions, name))


@dataclass(frozen=True, eq=False)
class OneByOne:
    """Motions as `rne.simulate` runs them, for scenes with events, samples or called laws.

    Attributes
    ----------
    scene : Scene
    duration : float
    times : ndarray, shape (S,)
    options : dict
        Of `rne.simulate`.
    """

    scene: Scene
    duration: float
    times: Array
    options: dict[str, Any]
    work = 1

    def run(self, chunk: Chunk, tick: Tick) -> Part:
        """The motions of a chunk."""
        parts = []
        for k, x in enumerate(chunk.x):
            parts.append(self._motion(x.astype(np.float64), chunk.parameters[k], chunk.first + k))
            tick(1)
        joined = (np.concatenate([getattr(part, name) for part in parts], axis=1) for name in Part._fields[:4])
        end, stopped = (np.concatenate([getattr(part, name) for part in parts]) for name in ("end", "stopped"))
        methods = tuple(sorted({part.methods[0] for part in parts}))
        return Part(*joined, end, stopped, methods, sum(part.evaluations for part in parts), OK)

    def _motion(self, x: Array, parameters: Array, number: int) -> Part:
        from .simulator import simulate

        n = self.scene.n
        scene = self.scene if not len(parameters) else at_parameters_of(self.scene, parameters)
        try:
            motion = simulate(scene, x[:n], x[n : 2 * n], self.duration, t_eval=self.times, **self.options)
        except SimulationError as error:
            raise SimulationError(f"start {number}: {error}", error.time, error.trajectory) from None
        except (ValueError, NotFiniteError) as error:
            raise ValueError(f"start {number}: {error}") from None
        stopped = motion.status == 1
        rows = np.minimum(np.arange(len(self.times)), len(motion.t) - 1)  # after a stop the state in which it ended
        energies = {"drives": motion.work, **motion.dissipated}
        ledger = self.scene.right_hand_side.ledger
        columns = np.array([energies[name][rows] for name in ledger]).reshape(len(ledger), len(rows)).T
        arrays = (array[:, None] for array in (motion.q[rows], motion.qd[rows], motion.tau[rows], columns))
        end = np.array([motion.t[-1] if stopped else self.duration])
        return Part(*arrays, end, np.array([stopped]), (motion.method,), motion.evaluations, OK)


def at_parameters_of(scene: Scene, parameters: Array) -> Scene:
    """The scene at other inertial parameters of its robot with payload."""
    parts = scene.resolved
    robot = Robot(at_parameters(parts.robot.model, parameters), parts.robot.engine)
    contained = dict.fromkeys(("mounting", "gravity", "payload", "locked", "armature"))
    return replace(scene, robot=robot, friction=parts.friction, effort_limit=parts.effort_limit, **contained)


Plan = SideBySide | OneByOne


def run_all(plan: Plan, starts: Chunk, progress: Progress | None, executor: Executor | None) -> list[Part]:
    """The results of `plan.run` for chunks of the initial states, in their order."""
    size = len(starts.x)
    edges = [*range(0, size, CHUNK), size]
    if executor is not None and size:
        parts = max(len(edges) - 1, min(size, 8))
        edges = [size * k // parts for k in range(parts + 1)]
    chunks = [starts.part(begin, end) for begin, end in itertools.pairwise(edges)]
    total, done = size * plan.work, 0

    def tick(count: int) -> None:
        nonlocal done
        done += count
        if progress is not None and count:
            progress(done, total)

    if executor is None:
        return [plan.run(chunk, tick) for chunk in chunks]
    from concurrent.futures import ThreadPoolExecutor, wait

    executor = executor.get_executor() if hasattr(executor, "get_executor") else executor
    in_threads = isinstance(executor, ThreadPoolExecutor)
    if in_threads and isinstance(plan, SideBySide):
        _ = plan.kernel  # traced before several threads ask for it at once
    run = partial(run_here, plan) if in_threads else partial(run_pickled, _pickled(plan))
    futures: list[Future[Part]] = [executor.submit(run, chunk) for chunk in chunks]
    for future, chunk in zip(futures, chunks, strict=True):
        wait([future])
        tick(len(chunk.x) * plan.work)
    return [future.result() for future in futures]


def run_here(plan: Plan, chunk: Chunk) -> Part:
    """Plan.run in another thread."""
    return plan.run(chunk, lambda count: None)


def _pickled(plan: Plan) -> bytes:
    """The plan for other processes; a ValueError where its controller cannot be sent to them."""
    try:
        return pickle.dumps(plan)
    except (AttributeError, TypeError, pickle.PicklingError) as error:
        raise ValueError(
            f"the controller cannot be sent to the processes of `executor`: {error}; define it by `def` or `class` at "
            "the top level of a module, not inside a function and not by `lambda`"
        ) from None


@lru_cache(maxsize=4)
def _plan(pickled: bytes) -> Plan:
    """The plan of a process, which traces and compiles its kernel once for all chunks."""
    plan: Plan = pickle.loads(pickled)
    return plan


def run_pickled(pickled: bytes, chunk: Chunk) -> Part:
    """Plan.run in another process."""
    return run_here(_plan(pickled), chunk)
