"""Many initial states of one scene simulated at once, in chunks that other threads or processes can take.

A chunk is computed side by side, in rows by NumPy or in lanes by machine code, or motion by motion by `rne.simulate`.
"""

from __future__ import annotations

import itertools
import pickle
import threading
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import lru_cache, partial, reduce
from math import ceil
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ..basics.arrays import check_function, positive_number, real_array, real_numbers, whole_number
from ..basics.inertia import PARAMETERS
from ..basics.numbers import part_of
from ..basics.piecewise import NO_TABLES, rows_of_tables
from ..basics.spatial import Array
from ..basics.text import InNotebooks, counted, short
from ..control.law_numbers import law_breaks
from ..control.traced_law import one_at_a_time
from ..dynamics.quantity import OK, PrecisionStatus
from ..errors import NotFiniteError, SimulationError, SimulationInterrupted
from ..integrators.base import IMPLICIT, RODAS
from ..integrators.lanes import Hold, run_batch, run_lanes
from ..integrators.rows import SLOW, BatchResult, Progress
from ..integrators.step_control import NEARLY, Interval, aligned, equal_steps
from ..integrators.tableaus import FIXED, tableau
from ..kernels.kernel import Kernel
from ..model.model import Model
from ..robot import Robot
from .plant import Plant, with_own_law
from .scene import Scene
from .scene_dynamics import SceneDynamics
from .scene_numbers import SceneNumbers, checked, friction_of_all, numbers_of_dynamics, scene_of_all
from .simulator import METHODS, check_times, scene_argument, simulate, tolerances
from .zero_order_hold import held_side_by_side

if TYPE_CHECKING:
    from concurrent.futures import Executor, Future

QUANTITIES = ("q", "qd", "tau")  # outputs of each motion
CHUNK, SHARE = 8192, 250  # most motions side by side; fewest per share in NumPy
SAMPLED_STEPS = 50  # mean steps between samples below which stiffness does not matter
UserProgress = Callable[[int, int], Any]
PATIENCE = 0.5  # time that Ctrl-C waits for other threads and processes [s]


@dataclass(frozen=True, eq=False)
class Ensemble(InNotebooks):
    """Motions from many initial states.

    Attributes
    ----------
    t : ndarray, shape (S,)
        Stored times [s].
    q, qd : ndarray, shape (S, N, n)
        Positions and velocities of each motion at these times [rad or m; rad/s or m/s].
    tau : ndarray, shape (S, N, n)
        Torques of the drives at these times, at a break those after it, zero without a controller [N m or N].
    energies : ndarray, shape (S, N, k)
        Work of the drives and losses by friction and in springs since the start, in the order of `ledger` [J].
    ledger : tuple of str, length k
        Names of the energies: work of the "drives", and those of `Trajectory.dissipated`, as far as the scene
        has them.
    method : str
        The method that ran; several are joined by commas.
    step : float or None
        Length of the longest step, where these are fixed [s].
    evaluations : int
        Evaluations of the right-hand side, counted per state.
    end : ndarray, shape (N,)
        Time at which each motion ended: the duration, that of its stop, or the last that it reported [s].
    status : ndarray of int, shape (N,)
        0 of motions that reached the duration, 1 of those that ended at a stop, whose values later than that are those
        at the stop, -1 of those that Ctrl-C ended, with NaN at times that they did not reach.
    model : Model
        The robot that moved.
    parameters : ndarray, shape (N, 10 nb), or None
        Inertial parameters of the robot of each motion; None if all had the robot's own.
    numbers : mapping of str to ndarray, shape (N, ...)
        Numbers of the scene that differed between motions, by name.

    Examples
    --------
    >>> import numpy as np, rne
    >>> starts = np.random.default_rng(0).uniform(-1, 1, (10, 6))
    >>> motions = rne.ensemble(rne.load("irb140"), starts, 0 * starts, 0.1, t_eval=[0, 0.05, 0.1])
    >>> motions.t.tolist(), motions.q.shape
    ([0.0, 0.05, 0.1], (3, 10, 6))
    >>> motions.q[-1, :3, 1].round(2).tolist()  # joint 2 of the first three motions at the end [rad]
    [-0.54, 0.53, -1.05]
    """

    t: Array
    q: Array
    qd: Array
    tau: Array
    energies: Array
    ledger: tuple[str, ...]
    method: str
    step: float | None
    evaluations: int
    end: Array
    status: Array
    model: Model
    parameters: Array | None = None
    numbers: Mapping[str, Array] = field(default_factory=dict)

    def quantiles(self, probabilities: ArrayLike = (0.05, 0.5, 0.95), of: str = "q") -> Array:
        """Quantiles over the motions at each stored time, without those that Ctrl-C ended.

        Parameters
        ----------
        probabilities : float or array_like, shape (P,)
            From 0 to 1.
        of : {"q", "qd", "tau"}
            Positions, velocities or torques.

        Returns
        -------
        ndarray, shape (P, S, n), or (S, n) for one probability
            In the units of the quantity; `rne.plotting.quantile_plot` draws them.

        Raises
        ------
        ValueError
            If `of` is another name, a probability is not between 0 and 1, or there are no motions.

        Examples
        --------
        >>> import numpy as np, rne
        >>> starts = np.random.default_rng(0).uniform(-1, 1, (100, 6))
        >>> swings = rne.ensemble(rne.load("irb140"), starts, 0 * starts, 0.1, keep=5)
        >>> swings.quantiles([0.05, 0.5, 0.95])[:, -1, 1].round(2).tolist()  # joint 2 at the end [rad]
        [-0.94, 0.13, 1.03]
        """
        if of not in QUANTITIES:
            raise ValueError(f"`of` must be one of {list(QUANTITIES)}, got {of!r}")
        finished = self.status >= 0
        if not finished.any():
            raise ValueError("there are no motions to take quantiles of")
        levels = real_numbers("probabilities", probabilities, "(P,)")
        if ((levels < 0) | (levels > 1)).any():
            raise ValueError(f"`probabilities` must be between 0 and 1, got {levels.tolist()}")
        found: Array = np.quantile(getattr(self, of)[:, finished], levels, axis=1)
        return found

    def __repr__(self) -> str:
        count, n = self.q.shape[1:]
        step = "" if self.step is None else f", step {self.step:.6g} s"
        ended = {"stopped": self.status == 1, "interrupted": self.status < 0}
        stopped = "".join(f", {counted(int(k.sum()), 'motion')} {word}" for word, k in ended.items() if k.any())
        negative = 0 if self.parameters is None else int((self.parameters[:, ::PARAMETERS] < 0).any(axis=1).sum())
        unphysical = f"\n  robots with a negative mass: {negative}, which no bodies have" if negative else ""
        times = f"{self.t[0]:.6g} to {self.t[-1]:.6g} s, " if len(self.t) else ""
        return (
            f"Ensemble of '{short(self.model.name)}': {counted(count, 'motion')} of {counted(n, 'joint')}, "
            f"{times}{len(self.t)} stored times{stopped}\n"
            f"  {self.method}{step}, {counted(self.evaluations, 'evaluation')}, "
            f"{'energies of ' + ', '.join(self.ledger) if self.ledger else 'no energies recorded'}{unphysical}"
        )


def ensemble(
    scene_or_robot: Scene | Robot,
    q0: ArrayLike,
    qd0: ArrayLike,
    duration: float,
    *,
    rtol: float = 1e-6,
    atol: float = 1e-9,
    t_eval: ArrayLike | None = None,
    parameters: ArrayLike | None = None,
    numbers: Mapping[str, ArrayLike] | None = None,
    torque: ArrayLike | None = None,
    sample_time: float | None = None,
    method: str = "auto",
    step: float | None = None,
    keep: int | None = None,
    progress: UserProgress | None = None,
    executor: Executor | Any = None,
) -> Ensemble:
    """Simulate many initial states of one scene at once, each with its own steps.

    Parameters
    ----------
    scene_or_robot : Scene or Robot
        What moves. Without stops, friction that sticks and called controllers all motions run side by side; with them
        one after another, as `rne.simulate` runs them. Controllers that are sampled, and
        `torque`, run side by side with engine "numba", one after another otherwise.
    q0, qd0 : array_like, shape (N, n)
        Initial positions and velocities, of elastic joints as `rne.simulate` takes them [rad or m; rad/s or m/s]. If
        both are float32 and `step` is given, so is the computation, if no torques are held; see docs/stability.md.
    duration : float
        Time to simulate [s].
    rtol, atol : float
        Relative and absolute tolerance of each motion's state, per step.
    t_eval : array_like, shape (S,), optional
        Times to report, ascending within [0, duration]; the start and the end if not given [s].
    parameters : array_like, shape (N, 10 nb), optional
        Inertial parameters in each motion, in the order of `Robot.parameters`, as numbers={"parameters": ...}. They
        include the payload of the scene: start from `scene.numbers["parameters"]`, not from those of the robot.
        Controllers keep the parameters that they were made with. Bodies need not be physically possible: identified
        base parameters give the same motion even with negative masses, as long as M is positive definite;
        `Robot.with_parameters` raises an error for those of impossible bodies.
    numbers : mapping of str to array_like, shape (N, ...), optional
        Numbers of the scene that differ between motions, by the names of `Scene.numbers`, with one axis more than
        there: {"friction.viscous": (N, n), "controller.kp": (N, n)}.
    torque : array_like, shape (N, n) or (N, K, n), optional
        Torques of the drives of each motion, for a robot or a scene without a controller: constant ones, or K of them,
        each held for `sample_time`. The effort limits of the scene bound them [N m or N].
    sample_time : float, optional
        Time for which each of the K torques is held; K `sample_time` must be the duration [s].
    method : str
        "auto" is DOP853, or Tsit5 between samples, or what `rne.simulate` chooses for motions that run one after
        another and for those that turn out to be stiff. Other explicit methods run side by side as well, implicit ones
        one after another. With `step`: "rk4", of order 4 where torques do not jump, which "auto" takes, or
        "semi-implicit-euler", of order 1. Steps end at samples and where a torque begins to act.
    step : float, optional
        The longest step, for equal steps whose error is not controlled: halve it and compare. Friction that changes
        its sign within some steps, smoothed or not, makes errors that shorter ones hardly reduce [s].
    keep : int, optional
        Number of equally spaced times to report, the start and the end included, instead of `t_eval`.
    progress : callable, optional
        A function progress(done, total), called with numbers of motions, or with `step` of steps over all motions.
    executor : concurrent.futures.Executor or distributed.Client, optional
        Runs chunks of initial states in parallel: a process pool, a Dask client, or with engine "numba" a thread pool.
        Each process traces and compiles the right-hand side once. In threads motions with a law that is called run one
        after another, as only one at a time may run Python.

    Returns
    -------
    Ensemble
        The motions at the times to report. The result of a motion does not depend on the others, nor on the executor:
        each runs with a deep copy of a law that is called. A function, or a law that cannot be copied, must reset its
        memory, if it has any, when it is called with t = 0.

    Raises
    ------
    ValueError
        If an argument has the wrong shape, is not finite or out of range, the scene cannot run by equal steps, has a
        controller in addition to `torque`, or one that cannot be sent to the processes of `executor`.
    NotFiniteError, SingularMassMatrixError
        If a state overflows, steps become too short or M singular; says which initial state, by number, and when.
    SimulationError
        The same of motions that run one after another.
    SimulationInterrupted
        On Ctrl-C, a KeyboardInterrupt. Its `trajectory` is the Ensemble so far, in which the others' `status` is -1.

    Notes
    -----
    The energies are integrated along with the states, and do not count in the control of the error.

    Examples
    --------
    >>> import numpy as np, rne
    >>> starts = np.random.default_rng(0).uniform(-1, 1, (100, 6))
    >>> motions = rne.ensemble(rne.load("irb140"), starts, 0 * starts, 0.1)
    >>> motions.q.shape, motions.q[-1, :, 1].mean().round(2).item()  # joint 2 at the end [rad]
    ((2, 100, 6), 0.09)
    """
    scene = scene_argument(scene_or_robot)
    if progress is not None:
        check_function("progress", progress, "(done, total)")
    given = real_numbers("q0", q0, f"(N, {scene.n})")
    scene, own = _numbers(scene, numbers, parameters, len(given)) if given.ndim == 2 else (scene, {})
    q, qd = _starts(scene, own, q0, qd0, is_fixed=step is not None)
    end = positive_number("duration", duration, zero_allowed=True)
    times, (given, period) = _times(t_eval, keep, end), _given_torques(scene, torque, sample_time, len(q), end)
    plan = _plan(scene, method, step, times, end, tolerances(rtol, atol), period, own)
    further = plan.dynamics.size - 2 * plan.dynamics.n if isinstance(plan, BatchRun) else 0
    dtype = np.float64 if isinstance(plan, BatchRun) and plan.held else q.dtype
    x0 = np.concatenate([q, qd, np.zeros((len(q), further))], axis=1, dtype=dtype)
    part = run_all(plan, Chunk(x0, own, given), progress, executor)
    if not part.interrupted:
        part.verdict.raise_or_warn(stacklevel=2)
    longest = float(plan.steps.max()) if isinstance(plan, BatchRun) and len(plan.steps) else None
    ran = plan.dynamics.ledger, ", ".join(part.methods), longest, part.evaluations, part.end, part.status
    of = scene.resolved.robot.model, own.get("parameters"), SceneNumbers(own)
    motions = Ensemble(times, part.q, part.qd, part.tau, part.energies, *ran, *of)
    if part.interrupted:
        text = f"ensemble interrupted: {(part.status >= 0).sum()} of {counted(len(q), 'motion')} finished"
        raise SimulationInterrupted(text, float(part.end.min()), motions)
    return motions


def _numbers(
    scene: Scene, numbers: Mapping[str, ArrayLike] | None, parameters: ArrayLike | None, count: int
) -> tuple[Scene, dict[str, Array]]:
    """Scene whose kernels take the numbers that differ between motions, and their values, (N, ...) each."""
    if parameters is not None and numbers is not None and "parameters" in numbers:
        raise ValueError("`parameters` and `numbers['parameters']` are the same: give one of them")
    given = dict(numbers or {})
    if parameters is not None:
        shape = (count, PARAMETERS * scene.resolved.robot.model.nb)
        given["parameters"] = real_array("parameters", parameters, f"{shape}, ten per body for each initial state")
    own = checked(scene, given, count)
    return scene_of_all(scene, own), own


def _starts(
    scene: Scene, own: Mapping[str, Array], q0: ArrayLike, qd0: ArrayLike, *, is_fixed: bool
) -> tuple[Array, Array]:
    """Initial positions and velocities, float32 only for fixed steps."""
    n = scene.n
    given = [real_numbers(name, x, f"(N, {n})") for name, x in (("q0", q0), ("qd0", qd0))]
    q, qd = scene.dynamics.start(scene.resolved.robot, given[0], given[1])
    if q.ndim != 2 or q.shape != qd.shape:
        raise ValueError(f"`q0` and `qd0` must have the same shape (N, {n}), got {q.shape} and {qd.shape}")
    if scene.elastic is not None and own and given[0].shape[-1] == n:  # torsion holds the links, by each one's numbers
        each = [scene.with_numbers({k: x[i] for k, x in own.items()}) for i in range(len(q))]
        starts = [s.dynamics.start(s.resolved.robot, a, b) for s, a, b in zip(each, *given, strict=True)]
        q, qd = (np.array(part).reshape(q.shape) for part in zip(*starts, strict=True)) if len(q) else (q, qd)
    dtype = np.result_type(*given) if is_fixed else np.float64
    return q.astype(dtype), qd.astype(dtype)


def _times(t_eval: ArrayLike | None, keep: int | None, end: float) -> Array:
    """Times to report."""
    if t_eval is not None:
        if keep is not None:
            raise ValueError("`keep` and `t_eval` are two ways to give the times to report: give one of them")
        return check_times(t_eval, end)
    count = 2 if keep is None else whole_number("keep", keep, least=2)
    return np.linspace(0.0, end, count if end else 1)


def _given_torques(
    scene: Scene, torque: ArrayLike | None, sample_time: float | None, count: int, end: float
) -> tuple[Array, float | None]:
    """Torques of motions, (N, K, n), and the time for which each of the K is held; K = 0 and None without torques."""
    if torque is None:
        if sample_time is not None:
            raise ValueError("`sample_time` is for `torque`, which is not given; a controller has that of its scene")
        return np.zeros((count, 0, scene.n)), None
    if scene.controller is not None:
        raise ValueError("`torque` cannot be given for a scene that has a controller")
    shapes = f"({count}, {scene.n}), or (N, K, n) with `sample_time`", f"({count}, K, {scene.n})"
    found = real_array("torque", torque, shapes[sample_time is not None]).astype(np.float64)
    if sample_time is None:
        return found[:, None], end
    period, K = positive_number("sample_time", sample_time), found.shape[1]
    if abs(K * period - end) > (1 - NEARLY) * end:
        raise ValueError(f"`torque` of {K} samples every {period:g} s lasts {K * period:g} s, the motion {end:g} s")
    return found, period


def _plan(
    scene: Scene,
    method: str,
    step: float | None,
    times: Array,
    end: float,
    tolerated: tuple[float, float],
    given: float | None,
    own: Mapping[str, Array],
) -> Plan:
    """Plan of the computation of a scene's motions, with torques held for the time `given`, if there are any."""
    friction, law = friction_of_all(scene, own), scene.traced_samples
    period = scene.sample_time if given is None else given
    dynamics = scene.dynamics if given is None else scene.dynamics_under("held")
    known, (rtol, atol) = METHODS if step is None else FIXED, tolerated
    if method not in ("auto", *known):
        needs = "; equal steps need `step`" if method in FIXED else ""
        raise ValueError(f"`method` must be 'auto' or one of {list(known)}, got {method!r}{needs}")
    options = {"method": method if step is None else "auto", "rtol": rtol, "atol": atol}
    fallback = SequentialRun(scene, dynamics, end, times, options, given)
    has_events = scene.stops or (friction is not None and friction.sticks)
    has_events |= any(name.endswith(".breaks") for name in own)  # of a law, where steps end
    is_called = dynamics.inputs == "called"
    if period is not None:  # only in lanes
        in_lanes = fallback.kernel.is_unrolled and fallback.kernel.engine == "numba"
        is_called = not in_lanes or (law is None and given is None)
    if step is not None and has_events:
        raise ValueError("`step` is not for scenes with `stops` or sticking friction: leave it out")
    if step is not None and is_called:
        if period is not None and scene.kernels.engine != "numba":
            raise ValueError("`step` with torques that are held needs a robot of engine 'numba'")
        raise ValueError("the controller of an ensemble with `step` must be traceable (mark it with rne.traceable)")
    longest = None if step is None else positive_number("step", step)
    if has_events or is_called or method in (*IMPLICIT, RODAS) or not scene.n or not end:
        return fallback
    explicit = "rk4" if longest else "DOP853" if period in (None, end) else "Tsit5"
    chosen = explicit if method == "auto" else method
    samples = np.arange(0 if period is None else ceil(end / period * NEARLY)) * (period or 0.0)
    watched = max(1, SAMPLED_STEPS * len(samples) // SLOW) if method == "auto" else 0
    whole = Interval(tableau(chosen), 0.0, end, -np.inf, np.inf, rtol, atol, dynamics.counted, watched=watched)
    if longest:
        positions = dynamics.n if chosen == "semi-implicit-euler" else 0
        breaks = law_breaks(scene.controller) if period is None else []
        intervals = _in_equal_steps(whole._replace(positions=positions), times, longest, samples, breaks)
    elif period is None:
        intervals = _between_breaks(whole, times, law_breaks(scene.controller))
    else:
        intervals = [whole._replace(t_eval=np.append(times[times < end], end))]
    held_by = None if period is None else partial(held_side_by_side, scene, law, dynamics.driven.start, period, end)
    return BatchRun(chosen, dynamics, times, intervals, fallback, held_by)


class Chunk(NamedTuple):
    """Part of an ensemble: initial states, numbers by name, (N, ...) each, given torques, and the first index."""

    x: Array
    numbers: Mapping[str, Array]
    torque: Array  # (N, K, n), K = 0 where none are given
    first: int = 0

    def part(self, begin: int, end: int) -> Chunk:
        """Slice of the chunk."""
        own = {name: array[begin:end] for name, array in self.numbers.items()}
        return Chunk(self.x[begin:end], own, self.torque[begin:end], self.first + begin)


class Motions(NamedTuple):
    """Motions of a chunk at the times to report, with their statuses."""

    q: Array  # (S, N, n), as `qd` and `tau`
    qd: Array
    tau: Array
    energies: Array  # (S, N, k)
    end: Array  # (N,), times of their ends
    status: Array  # (N,), as of Ensemble
    methods: tuple[str, ...]
    evaluations: int
    verdict: PrecisionStatus
    interrupted: bool = False


def _in_equal_steps(whole: Interval, times: Array, step: float, samples: Array, breaks: list[float]) -> list[Interval]:
    """Equal steps between neighbouring reports or samples; times equal up to rounding are merged."""
    times = aligned(times, [samples])
    grid = equal_steps(whole.end, step, times, samples, np.array(breaks))
    if not breaks:
        return [whole._replace(t_eval=np.append(times[times < whole.end], whole.end), grid=grid, watched=0)]
    parts = _between_breaks(whole, times, breaks)
    return [part._replace(grid=grid[(grid >= part.begin) & (grid <= part.end)], watched=0) for part in parts]


def _between_breaks(whole: Interval, times: Array, breaks: list[float]) -> list[Interval]:
    """Intervals of time between breaks of the torques."""
    inner, found = [b for b in breaks if 0 < b < whole.end], []
    for a, b in itertools.pairwise([whole.begin, *inner, whole.end]):
        first, last = np.nextafter(a, np.inf) if a in inner else -np.inf, np.nextafter(b, 0.0) if b in inner else np.inf
        asked = np.unique([*times[(times > a) & (times < b)], b])
        found.append(whole._replace(begin=a, end=b, first=float(first), last=float(last), t_eval=asked))
    return found


@dataclass(frozen=True, eq=False)
class BatchRun:
    """Computation of all motions at once by an explicit method."""

    method: str
    dynamics: SceneDynamics
    times: Array  # (S,), to report
    intervals: Sequence[Interval]  # parts of the time, between which torques jump
    fallback: SequentialRun  # for motions that turn out to be stiff, and those with held torques that lanes leave
    held: Callable[[Mapping[str, Array], Array], Hold] | None = None  # held torques of a chunk, in lanes

    @property
    def steps(self) -> Array:
        """Lengths of steps that are not controlled."""
        return np.concatenate([np.diff(interval.grid) for interval in self.intervals])

    @property
    def work(self) -> int:
        """Units of progress per motion: its steps, or one."""
        return max(len(self.steps), 1)

    def most_shares(self, size: int) -> int:
        """Largest number of shares for a number of motions."""
        return size if self.fallback.kernel.engine == "numba" else max(2, size // SHARE)

    def run(self, chunk: Chunk, advance: Progress) -> Motions:
        """The motions of a chunk."""
        x, evaluations, verdict, is_done = chunk.x, 0, OK, True
        own, law = self.dynamics.vectors(numbers_of_dynamics(self.fallback.scene, chunk.numbers)), self.dynamics.law
        tables = NO_TABLES if law is None else law.tables(part_of(chunk.numbers, "controller."))
        places, stiff = chunk.first + np.arange(len(x)), np.zeros(len(x), dtype=bool)
        run: Callable[..., BatchResult] = run_batch if self.held is None else run_lanes
        last = places if self.held is None else self.held(chunk.numbers, chunk.torque)
        further = 0 if self.held is None else self.dynamics.joints + 1  # after the states: held torques, their work
        x, size = np.pad(x, [(0, 0), (0, further)]), x.shape[1]
        states = np.full((len(self.times), *x.shape), np.nan, x.dtype)
        reported = int(0.0 in self.times and 0.0 not in self.intervals[0].t_eval)
        states[:reported] = x
        for interval in self.intervals:
            is_last = interval is self.intervals[-1]
            X = np.full((len(interval.t_eval), *x.shape), np.nan, x.dtype)
            how = interval._replace(table=tables), self.fallback.kernel, own, x[:, :size], X
            part = run(*how, advance if is_last or len(interval.grid) else lambda _: advance(0), last)
            stiff |= part.code != 0
            evaluations, verdict, is_done = evaluations + part.evaluations, verdict.worse(part.verdict), part.is_done
            X[:, stiff] = x[stiff] if is_done else np.nan
            x, kept = X[-1], X if interval.end in self.times else X[:-1]
            states[reported : reported + len(kept)], reported = kept, reported + len(kept)
            if not is_done:
                break
        done = np.asarray(np.isfinite(x).all(axis=1)) & is_last
        motions = self._part(states, done, chunk.numbers, tables)
        motions = motions._replace(evaluations=evaluations, verdict=verdict, interrupted=not is_done)
        if not stiff.any() or not is_done:
            return motions
        return self.fallback.replaced(motions, chunk, np.flatnonzero(stiff), advance)

    def _part(self, x: Array, done: Array, own: Mapping[str, Array], tables: Array) -> Motions:
        """States as positions, velocities, torques and energies, with NaN where there are none."""
        n, first, N, size = self.dynamics.joints, self.dynamics.n, x.shape[1], self.dynamics.counted
        x, held = np.split(x, [self.dynamics.size], axis=2)
        times, breaks = self.times.astype(x.dtype), law_breaks(self.fallback.scene.controller)
        times = np.where(np.isin(self.times, breaks), np.nextafter(times, np.inf, dtype=x.dtype), times)  # after them
        t, states = np.repeat(times, N), x[..., :size].reshape(len(times) * N, size)
        known = np.asarray(np.isfinite(states).all(axis=1))
        q, qd, energies = x[..., :n], x[..., first : first + n], np.concatenate([held[..., n:], x[..., size:]], axis=2)
        tau = np.where(known[:, None], 0.0, np.nan).repeat(n, axis=1).astype(x.dtype)
        if self.held is not None:
            tau = held[..., :n].reshape(tau.shape)
        elif "drives" in self.dynamics.ledger:
            plant = Plant(self.dynamics, self.fallback.scene.resolved.robot, kernels=self.fallback.scene.kernels)
            row = np.flatnonzero(known) % N
            mine = {name: array[row] for name, array in own.items() if name in self.dynamics.numbers}
            given = rows_of_tables(tables, t[known], row if len(tables) > 1 else slice(None))
            tau[known] = plant.drive_torques(t[known], x.reshape(len(t), -1)[known], own=mine, pieces=given)
        last = known.reshape(len(self.times), N).sum(axis=0)
        end = np.where(done, self.intervals[-1].end, np.append(0.0, self.times)[last])
        status = np.where(done, 0, -1)
        return Motions(q, qd, tau.reshape(q.shape), energies, end, status, (self.method,), 0, OK)


@dataclass(frozen=True, eq=False)
class SequentialRun:
    """Computation of motions one by one by `rne.simulate`, for scenes with events, samples or called laws."""

    scene: Scene
    dynamics: SceneDynamics
    duration: float
    times: Array  # (S,), to report
    options: dict[str, Any]  # of `rne.simulate`
    given: float | None  # how long each of a chunk's torques is held
    work = 1

    @property
    def kernel(self) -> Kernel:
        """dx/dt."""
        return self.scene.kernels.scene_kernel(self.dynamics.right_hand_side)

    def most_shares(self, size: int) -> int:
        """Largest number of shares: one per motion."""
        return size

    def run(self, chunk: Chunk, advance: Progress, some: Sequence[int] | None = None) -> Motions:
        """The motions of a chunk, or some of them."""
        rows = range(len(chunk.x)) if some is None else some
        parts, interrupted = [self.nothing(0)], False
        try:
            for k in rows:
                parts.append(self._motion(chunk, k, lambda *_: advance(0)))
                if parts[-1].interrupted:
                    break
                advance(1)
        except KeyboardInterrupt:
            interrupted = True
        found = joined([*parts, self.nothing(len(rows) + 1 - len(parts))])
        return found._replace(interrupted=found.interrupted or interrupted)

    def nothing(self, count: int, dtype: Any = np.float64) -> Motions:
        """Placeholder for motions that were not started."""
        S, n, energies = len(self.times), self.scene.n, len(self.dynamics.ledger)
        q, qd, tau, ledger = (np.full((S, count, k), np.nan, dtype) for k in (n, n, n, energies))
        return Motions(q, qd, tau, ledger, np.zeros(count), np.full(count, -1), (), 0, OK)

    def replaced(self, part: Motions, chunk: Chunk, rows: Array, advance: Progress) -> Motions:
        """Copy of a part with some motions computed again."""
        others = self.run(chunk, lambda _: advance(0), rows.tolist())
        for name in ("q", "qd", "tau", "energies"):
            getattr(part, name)[:, rows] = getattr(others, name)
        part.end[rows], part.status[rows] = others.end, others.status
        methods = {*others.methods, *(part.methods if len(rows) < len(chunk.x) else ())}
        found = part._replace(methods=tuple(sorted(methods)), evaluations=part.evaluations + others.evaluations)
        return found._replace(interrupted=others.interrupted)

    def _motion(self, chunk: Chunk, k: int, progress: Callable[..., Any]) -> Motions:
        x, number = chunk.x[k].astype(np.float64), chunk.first + k
        own = {name: array[k] for name, array in chunk.numbers.items()}
        shared = self.scene.naming(own, (), self.scene.varying) if own else self.scene
        scene, n = shared if self.dynamics.law is not None else with_own_law(shared), self.dynamics.n
        how = self.options | {"t_eval": self.times, "progress": progress} | self._torque(chunk.torque[k])
        try:
            with one_at_a_time(None if scene is shared else self.scene.controller):
                motion = simulate(scene, x[:n], x[n : 2 * n], self.duration, **how)
        except SimulationInterrupted as interrupt:
            motion = interrupt.trajectory
        except SimulationError as error:
            raise SimulationError(f"start {number}: {error}", error.time, error.trajectory) from error.__cause__
        except (ValueError, NotFiniteError) as error:
            raise ValueError(f"start {number}: {error}") from error
        status, count, T = motion.status, len(self.times), len(motion.t)  # -1 if it was interrupted
        rows = np.minimum(np.arange(count if status >= 0 else T), T - 1)  # after a stop the state in which it ended
        ledger, entries = self.dynamics.ledger, {"drives": motion.work, **motion.dissipated}
        found = [entries.get(name, 0 * motion.work)[rows] for name in ledger]
        columns = np.array(found).reshape(len(ledger), len(rows)).T
        part = self.nothing(1)
        for array, values in zip(part[:4], (motion.q[rows], motion.qd[rows], motion.tau[rows], columns), strict=True):
            array[: len(rows), 0] = values
        part.end[:], part.status[:] = motion.t[-1] if status and T else self.duration if not status else 0.0, status
        return part._replace(methods=(motion.method,), evaluations=motion.evaluations, interrupted=status < 0)

    def _torque(self, given: Array) -> dict[str, Any]:
        """Torques of one motion, (K, n), in the form of `rne.simulate`."""
        if len(given) <= 1:
            return {"torque": given[0]} if len(given) else {}
        begins = aligned(np.arange(len(given)) * (self.given or 0.0), [self.times])
        law = lambda t, q, qd: given[np.searchsorted(begins, t, side="right") - 1]  # noqa: E731
        return {"torque": law, "breaks": begins[1:].tolist()}


def joined(parts: Sequence[Motions]) -> Motions:
    """Motions of several chunks joined."""
    arrays = (np.concatenate([part[k] for part in parts], axis=int(k < 4)) for k in range(6))  # end and status last
    methods = tuple(sorted({method for part in parts for method in part.methods}))
    verdict = reduce(PrecisionStatus.worse, [part.verdict for part in parts])
    evaluations, interrupted = sum(part.evaluations for part in parts), any(part.interrupted for part in parts)
    return Motions._make([*arrays, methods, evaluations, verdict, interrupted])


Plan = BatchRun | SequentialRun


def run_all(plan: Plan, starts: Chunk, progress: UserProgress | None, executor: Executor | None) -> Motions:
    """Compute all motions, in chunks."""
    size = len(starts.x)
    edges = [*range(0, max(size, 1), CHUNK), size]
    if executor is not None and size:
        parts = max(len(edges) - 1, min(size, 8, plan.most_shares(size)))
        edges = [size * k // parts for k in range(parts + 1)]
    chunks = [starts.part(begin, end) for begin, end in itertools.pairwise(edges)]
    total, done = size * plan.work, 0

    def advance(count: int) -> None:
        nonlocal done
        done += count
        if progress is not None and count:
            progress(done, total)

    blank = partial((plan if isinstance(plan, SequentialRun) else plan.fallback).nothing, dtype=starts.x.dtype)
    if executor is None:
        so_far = blank(0)
        for chunk in chunks:
            so_far = joined([so_far, plan.run(chunk, advance)])
            if so_far.interrupted:
                break
        return joined([so_far, blank(size - len(so_far.end))])
    from concurrent.futures import ThreadPoolExecutor, wait

    executor = executor.get_executor() if hasattr(executor, "get_executor") else executor
    if not hasattr(executor, "submit"):
        raise TypeError(
            "`executor` must be a concurrent.futures.Executor or a distributed.Client, got " + type(executor).__name__
        )
    in_threads, stop = isinstance(executor, ThreadPoolExecutor), threading.Event()
    if in_threads and isinstance(plan, BatchRun):
        _ = plan.fallback.kernel  # traced before several threads ask for it at once
    run = partial(run_elsewhere, plan, stop=stop) if in_threads else partial(run_elsewhere, _pickled(plan))
    futures: list[Future[Motions]] = [executor.submit(run, chunk) for chunk in chunks]
    try:
        for future, chunk in zip(futures, chunks, strict=True):
            wait([future])
            advance(len(chunk.x) * plan.work)
    except KeyboardInterrupt:
        stop.set()
        wait([future for future in futures if not future.cancel()], PATIENCE)
    found = [future.result() if future.done() and not future.cancelled() else None for future in futures]
    together = joined([part or blank(len(chunk.x)) for part, chunk in zip(found, chunks, strict=True)])
    return together._replace(interrupted=together.interrupted or stop.is_set())


def run_elsewhere(plan: Plan | bytes, chunk: Chunk, stop: threading.Event | None = None) -> Motions:
    """Run a plan in another thread or process; a thread stops on request."""

    def advance(count: int) -> None:
        if stop is not None and stop.is_set():
            raise KeyboardInterrupt

    if isinstance(plan, bytes):
        with one_at_a_time(_unpickled):  # threads of one process share the plan, and so its law
            plan = _unpickled(plan)
    return plan.run(chunk, advance)


def _pickled(plan: Plan) -> bytes:
    """Pickled plan for other processes; a ValueError where its controller cannot be pickled."""
    try:
        return pickle.dumps(plan)
    except (AttributeError, TypeError, pickle.PicklingError) as error:
        raise ValueError(
            f"the controller cannot be sent to the processes of `executor`: {error}; define it by `def` or `class` at "
            "the top level of a module, not inside a function and not by `lambda`"
        ) from None


@lru_cache(maxsize=4)
def _unpickled(pickled: bytes) -> Plan:
    """Plan of a process, which traces and compiles its kernel once for all chunks."""
    plan: Plan = pickle.loads(pickled)
    return plan
