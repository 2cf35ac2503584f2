"""Many motions of one scene in chunks, which other threads or processes can take.

A chunk runs side by side, by the rows of NumPy or in the lanes of machine code, or motion by motion as `rne.simulate`.
"""

from __future__ import annotations

import itertools
import pickle
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache, partial, reduce
from math import ceil
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from ..basics.spatial import Array
from ..dynamics.quantity import OK, PrecisionStatus
from ..errors import NotFiniteError, SimulationError
from ..kernels.kernel import Kernel
from ..kernels.row_steps import Course, Tick, by_rows
from ..model.parameters import at_parameters
from ..robot import Robot
from .equations_of_motion import RightHandSide
from .plant import Plant
from .scene import Scene

if TYPE_CHECKING:
    from concurrent.futures import Executor, Future

CHUNK, SHARE = 8192, 250  # most motions side by side, and fewest of a share in NumPy, where few cost as much as many
Progress = Callable[[int, int], Any]


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


def courses(
    method: str,
    times: Array,
    end: float,
    breaks: list[float],
    step: float | None,
    norm: tuple[Any, ...],
    n: int,
    *,
    watched: bool,
) -> tuple[Course, ...]:
    """The parts of the time between breaks; one part of equal steps, those between two times to report."""
    if step is not None:
        edges = np.unique([0.0, *times, end]).tolist()
        counts = [max(1, ceil((b - a) / step * (1 - 1e-12))) for a, b in itertools.pairwise(edges)]
        parts = [np.linspace(a, b, k + 1)[1:] for (a, b), k in zip(itertools.pairwise(edges), counts, strict=True)]
        grid, positions = np.concatenate([[0.0], *parts]), n if method == "semi-implicit-euler" else 0
        return (Course(method, 0.0, end, -np.inf, np.inf, np.array(edges[1:]), grid, norm, positions),)
    inner, found = [b for b in breaks if 0 < b < end], []
    for a, b in itertools.pairwise([0.0, *inner, end]):
        first, last = np.nextafter(a, np.inf) if a in inner else -np.inf, np.nextafter(b, 0.0) if b in inner else np.inf
        asked = np.unique([*times[(times > a) & (times < b)], b])
        found.append(Course(method, a, b, float(first), float(last), asked, np.zeros(0), norm, watched=watched))
    return tuple(found)


@dataclass(frozen=True, eq=False)
class SideBySide:
    """Motions by an explicit method, all at once.

    Attributes
    ----------
    rhs : RightHandSide
        With the energies of the ledger as its last states.
    times : ndarray, shape (S,)
        To report.
    courses : tuple of Course
        The parts of the time between which torques jump.
    with_parameters : bool
        True if each motion has its own inertial parameters.
    otherwise : OneByOne
        For motions that turn out to be stiff.
    """

    rhs: RightHandSide
    times: Array
    courses: tuple[Course, ...]
    with_parameters: bool
    otherwise: OneByOne

    @property
    def kernel(self) -> Kernel:
        """dx/dt, of the chunk's inertial parameters where it has some."""
        return self.rhs.kernel_at_parameters if self.with_parameters else self.rhs.kernel

    @property
    def steps(self) -> Array:
        """Lengths of steps that are not controlled."""
        return np.diff(self.courses[0].grid)

    @property
    def work(self) -> int:
        """Units of progress of one motion: its steps, or itself."""
        return max(len(self.steps), 1)

    def most_shares(self, size: int) -> int:
        """Into how many shares so many motions may be divided."""
        return size if self.kernel.engine == "numba" else max(2, size // SHARE)

    def run(self, chunk: Chunk, tick: Tick) -> Part:
        """The motions of a chunk."""
        x, kernel, evaluations, verdict = chunk.x, self.kernel, 0, OK
        stiff = np.zeros(len(x), dtype=bool)
        kept = [x[None]] if 0.0 in self.times else []
        in_machine_code = kernel.engine == "numba" and kernel.is_unrolled and x.dtype == np.float64
        for course in self.courses:
            told = tick if course is self.courses[-1] else lambda count: None
            X, left = np.empty((len(course.times), *x.shape), x.dtype), np.arange(len(x))
            if in_machine_code:
                from ..kernels.many_motions import EXAMINE, LEAVE, in_lanes

                code, evaluated = in_lanes(course, kernel, chunk.parameters, x, X)
                left, evaluations = np.flatnonzero(code == EXAMINE), evaluations + evaluated
                stiff |= code == LEAVE
                told(self.work * (len(x) - len(left)))
            if len(left):
                some = np.empty((len(course.times), len(left), x.shape[1]), x.dtype)
                rates = by_rows(course, kernel, chunk.parameters[left], chunk.first + left, x[left], some, told)
                X[:, left] = some
                stiff[left] |= rates.stiff
                evaluations, verdict = evaluations + rates.evaluations, verdict.worse(rates.verdict)
            X[:, stiff] = x[stiff]
            x = X[-1]
            kept.append(X[np.isin(course.times, self.times)])
        part = self._part(np.concatenate(kept), evaluations, verdict)
        return self.otherwise.replaced(part, chunk, np.flatnonzero(stiff)) if stiff.any() else part

    def _part(self, x: Array, evaluations: int, verdict: PrecisionStatus) -> Part:
        """States as positions, velocities, torques and energies."""
        n, N, size = self.rhs.robot.n, x.shape[1], self.rhs.size - len(self.rhs.ledger)
        t, states = np.repeat(self.times, N).astype(x.dtype), x[..., :size].reshape(-1, size)
        drives = Plant(self.rhs, None).drives_under(t, states, None)
        q, qd, energies = x[..., :n], x[..., n : 2 * n], x[..., size:]
        tau = np.zeros(q.shape, x.dtype) if drives is None else drives.astype(x.dtype).reshape(q.shape)
        end, method = np.full(N, self.courses[-1].end), (self.courses[0].method,)
        return Part(q, qd, tau, energies, end, np.zeros(N, bool), method, evaluations, verdict)


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

    def most_shares(self, size: int) -> int:
        """Each motion may be one."""
        return size

    def run(self, chunk: Chunk, tick: Tick) -> Part:
        """The motions of a chunk."""
        S, n, k = len(self.times), self.scene.n, len(self.scene.right_hand_side.ledger)
        nobody = (np.zeros((S, 0, width)) for width in (n, n, n, k))
        parts = [Part(*nobody, np.zeros(0), np.zeros(0, bool), (), 0, OK)]  # type: ignore[call-arg, arg-type]
        for k, x in enumerate(chunk.x):
            parts.append(self._motion(x.astype(np.float64), chunk.parameters[k], chunk.first + k))
            tick(1)
        return joined(parts)

    def replaced(self, part: Part, chunk: Chunk, rows: Array) -> Part:
        """Some motions of a part run anew."""
        others = joined([self._motion(chunk.x[k], chunk.parameters[k], chunk.first + k) for k in rows.tolist()])
        for name in ("q", "qd", "tau", "energies"):
            getattr(part, name)[:, rows] = getattr(others, name)
        methods = part.methods if len(rows) < len(chunk.x) else ()
        evaluations = part.evaluations + others.evaluations
        return part._replace(methods=tuple(sorted({*methods, *others.methods})), evaluations=evaluations)

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
        ledger, entries = self.scene.right_hand_side.ledger, {"drives": motion.work, **motion.dissipated}
        columns = np.array([entries[name][rows] for name in ledger]).reshape(len(ledger), len(rows)).T
        q, qd, tau, energies = (
            array[:, None] for array in (motion.q[rows], motion.qd[rows], motion.tau[rows], columns)
        )
        end = np.array([motion.t[-1] if stopped else self.duration])
        return Part(q, qd, tau, energies, end, np.array([stopped]), (motion.method,), motion.evaluations, OK)


def joined(parts: Sequence[Part]) -> Part:
    """The motions of several parts."""
    q, qd, tau, energies = (np.concatenate([part[k] for part in parts], axis=1) for k in range(4))
    end, stopped = (np.concatenate([part[k] for part in parts]) for k in (4, 5))
    methods = tuple(sorted({method for part in parts for method in part.methods}))
    verdict = reduce(PrecisionStatus.worse, [part.verdict for part in parts])
    return Part(q, qd, tau, energies, end, stopped, methods, sum(part.evaluations for part in parts), verdict)


def at_parameters_of(scene: Scene, parameters: Array) -> Scene:
    """The scene at other inertial parameters of its robot with payload."""
    parts = scene.resolved
    robot = Robot(at_parameters(parts.robot.model, parameters), parts.robot.engine)
    contained: dict[str, Any] = dict.fromkeys(("mounting", "gravity", "payload", "locked", "armature"))
    return replace(scene, robot=robot, friction=parts.friction, effort_limit=parts.effort_limit, **contained)


Plan = SideBySide | OneByOne


def run_all(plan: Plan, starts: Chunk, progress: Progress | None, executor: Executor | None) -> Part:
    """All motions, in chunks."""
    size = len(starts.x)
    edges = [*range(0, max(size, 1), CHUNK), size]
    if executor is not None and size:
        parts = max(len(edges) - 1, min(size, 8, plan.most_shares(size)))
        edges = [size * k // parts for k in range(parts + 1)]
    chunks = [starts.part(begin, end) for begin, end in itertools.pairwise(edges)]
    total, done = size * plan.work, 0

    def tick(count: int) -> None:
        nonlocal done
        done += count
        if progress is not None and count:
            progress(done, total)

    if executor is None:
        return joined([plan.run(chunk, tick) for chunk in chunks])
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
    return joined([future.result() for future in futures])


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
