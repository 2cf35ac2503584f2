"""The simulation loop: segments between the instants at which something switches.

At the start of a segment the controller is sampled, if it is due, and the modes of dry friction are settled. A solver
then steps to the next sample or break, unless an event happens inside a step: there the segment ends, and the next one
begins, or the run ends at a stop. Times to report and the energies of the ledger come from the steps' interpolants.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np

from ..basics.spatial import Array
from ..errors import NotFiniteError
from ..integrators.base import FAILURES, RODAS, SAME, IntegrationOptions, Solver, Steps
from ..integrators.compiled_methods import CompiledSolver, RosenbrockSolver, SampledSolver
from ..integrators.scipy_methods import Keeps, SciPySolver
from ..integrators.tableaus import EXPLICIT
from .events import Event, Stop, first_crossing
from .ledger import Ledger
from .plant import MAX_EVALUATIONS, DryPlant, Plant, ZeroOrderHold
from .watch import Watch, fastest_joint

FEWEST = 8  # steps taken at first, where an event may throw them away or someone wants to know how far the run is
LONGEST = 1000  # steps taken at once


class Task(NamedTuple):
    """The task of a run."""

    x0: Array
    duration: float
    method: str
    rtol: float
    atol: float
    t_eval: Array | None = None
    breaks: Sequence[float] = ()
    stops: Sequence[Stop] = ()
    is_auto: bool = False  # True if the method may be changed while the run goes on
    progress: Callable[[float, float], object] | None = None  # is told the time and the duration


class Failure(NamedTuple):
    """Why a run ended before its time."""

    time: float
    cause: str
    is_interrupt: bool = False  # by the user


class Run(NamedTuple):
    """The result of a run."""

    t: Array
    x: Array
    qdd: Array | None  # accelerations, where they do not follow from time, state and torques
    hold: ZeroOrderHold | None = None  # of a sampled controller
    status: int = 0
    ending: str = ""
    ledger: Ledger | None = None
    failure: Failure | None = None
    method: str = ""
    ends: Run | None = None  # the same just before what ends a segment, where that is not a sample alone

    def held(self, same: float = SAME) -> Array | None:
        """The torques that are held, (T, n), where they are; after a sample those that begin there, up to rounding."""
        if self.hold is None:
            return None
        samples = self.hold.samples()
        return samples.u[samples.held(self.t, same)]

    def before_samples(self) -> Run:
        """The same just before each sample."""
        assert self.hold is not None
        samples = self.hold.samples()
        within = (samples.t > 0) & (samples.t < self.t.max(initial=0.0))
        return Run(np.nextafter(samples.t[within], 0.0), samples.x[within], None, self.hold)


class Loop:
    """One run.

    Parameters
    ----------
    plant : Plant
    task : Task
    hold : ZeroOrderHold, optional
        For a sampled controller.
    """

    def __init__(self, plant: Plant, task: Task, hold: ZeroOrderHold | None = None) -> None:
        self.plant, self.task, self.hold = plant, task, hold
        self.system, self.solver = _system_and_solver(plant, task, hold)
        self.t, self.x = 0.0, task.x0.copy()
        self.stop: Stop | None = None
        self.most = FEWEST  # steps taken at once
        self.watch = Watch(plant, hold, task.method, task.duration, may_change=task.is_auto)
        self.ledger = Ledger(plant.powers, plant.integrated) if plant.integrated else None
        self.record = Record(task.t_eval, len(task.x0))
        known = task.t_eval is not None or (hold is not None and self.system is plant)  # of samples
        self.ends = None if known else Record(None, len(task.x0), same=0.0)  # of segments, before what may jump there
        self.breaks = sorted({b for b in task.breaks if 0 < b < task.duration}) if hold is None else []

    def run(self) -> Run:
        """From the start to the end, a stop or a failure."""
        failure = None
        try:
            if self.task.duration == 0 or self.plant.robot.n == 0:  # nothing moves; SciPy's solvers divide by both
                self._begin_segment()
                if self.hold is not None and not self.hold.count:  # the solver would have taken the first sample
                    self.hold.sample(self.t, self.x)
                self.t = self.task.duration
            else:
                while self.t < self.task.duration and self.stop is None:
                    self._segment()
                    self._leave()
                if self.hold is not None:
                    self.hold.finish(self.t, self.x)
            self.record.finish(self.t, self.x, self.system, stopped=self.stop is not None)
        except FAILURES as error:
            failure = self._failure(error)
        except KeyboardInterrupt:
            failure = Failure(self.t, "interrupted", is_interrupt=True)
        self.plant.span = (-np.inf, np.inf)
        if self.ledger is not None and (failure or self.plant.law is not None):
            try:
                self.ledger.integrate()
            except FAILURES as error:
                failure = failure or self._failure(error)
                self.record.cut(self.ledger.end)
        return self._result(failure)

    def _failure(self, error: Exception) -> Failure:
        return Failure(float(getattr(error, "time", None) or self.t), str(error))

    def _segment(self) -> None:
        """To the next sample, break, event or the end."""
        end, resumes = self._begin_segment()
        if resumes:
            self.solver.resume(self.system, self.t, self.x, end)
        else:
            self.solver.start(self.system, self.t, self.x, end, self.system.longest_step(self.task.duration))
        events: list[Event] = [*self.system.events, *self.task.stops]
        modes_may_change = self.solver.takes_samples and self.system is not self.plant  # at any sample
        if not resumes:
            self.most = FEWEST if events or self.task.progress else LONGEST
        solver = self.solver  # of this segment: another one may take over at its end
        while solver.is_running:
            steps = solver.steps(min(self.most, LONGEST if self.solver.takes_samples else self.watch.steps_to_look))
            self.most = 2 * self.most
            crossing = first_crossing(events, steps)
            count = len(steps.T) - 1 if crossing is None else crossing.step + 1
            self.t, self.x = (float(steps.T[-1]), steps.X[-1]) if crossing is None else (crossing.t, crossing.x)
            self.record.take(steps, count, self.t, self.x, self.system)
            if self.task.progress is not None:
                self.task.progress(self.t, self.task.duration)
            if self.ledger is not None:
                self.ledger.add(steps, count, self.t, self.system.at_rest)
            if modes_may_change:
                self._leave_samples(steps, count)
            if crossing is not None and self.hold is not None:
                self.hold.rewind(self.t)
            if crossing is not None and crossing.event is not None:
                return self._happen(events[crossing.event])
            sample_is_due = modes_may_change and self.hold is not None and self.t >= self.hold.next
            if crossing is not None or (self._looks_further(steps) and self.t < end) or sample_is_due:
                break
        self.x = self.system.reported(self.x)
        return None

    def _leave(self) -> None:
        """Note the values just before the end of a segment, whose instant reports those after it."""
        before = float(np.nextafter(self.t, 0.0))  # of several segments that end at this time the first
        if self.ends is not None and self.t < self.task.duration and self.ends.last < before:
            self.ends.add(np.array([before]), self.x[None], self.system)

    def _leave_samples(self, steps: Steps, count: int) -> None:
        """The same before the samples within so many steps."""
        rows = np.flatnonzero(steps.jumps[1:count]) + 1
        if self.ends is not None and len(rows):
            self.ends.add(np.nextafter(steps.T[rows], 0.0), steps.X[rows], self.system)

    def _begin_segment(self) -> tuple[float, bool]:
        """Sample the controller if it is due, settle what sticks; the segment's end, and whether the solver goes on."""
        t, hold = self.t, self.hold
        is_sample = (
            hold is not None and t >= hold.next and not (self.solver.takes_samples and self.system is self.plant)
        )
        if hold is not None and is_sample:
            hold.sample(t, self.x)
        if self.ledger is not None:
            self.ledger.close()
        end = self._next_switch()
        begin = float(np.nextafter(t, np.inf)) if t in self.breaks else t
        self.system.begin(t, self.x, (begin, float(np.nextafter(end, 0.0))))
        self.record.begin(t, self.x, self.system)
        return end, is_sample and not self.system.has_changed

    def _next_switch(self) -> float:
        """The next sample, the next break or the end."""
        duration, hold = self.task.duration, self.hold
        if hold is not None and not self.solver.takes_samples:
            return hold.next if hold.next < duration * (1 - 1e-12) else duration
        return next((b for b in self.breaks if b > self.t), duration)

    def _happen(self, event: Any) -> None:
        """Go on from an event, or end at a stop."""
        self.x = self.system.after(event, self.x)
        if isinstance(event, Stop):
            self.stop = event
        else:
            self.watch.change(self.t)

    def _looks_further(self, steps: Steps) -> bool:
        """Watch the run; True if it goes on with another method."""
        if self.hold is not None and self.plant.evaluations - self.hold.evaluations_before > MAX_EVALUATIONS:
            raise self._diverged(self.hold)
        if not self.watch.changes_method(steps):
            return False
        self.solver = _solver(self.system, self.plant, self.task, self.watch.method, self.hold)
        return True

    def _diverged(self, hold: ZeroOrderHold) -> NotFiniteError:
        """The error of a sampled loop that diverges, whose steps become ever shorter."""
        where = fastest_joint(self.plant.robot, self.x)
        return NotFiniteError(
            f"more than {MAX_EVALUATIONS} evaluations within one sample at t = {self.t:.6g} s, {where}: the sampled "
            f"loop is unstable; {hold.stability()}",
            self.t,
        )

    def _result(self, failure: Failure | None) -> Run:
        before, (t, x, qdd) = None, self.record.arrays()
        if self.ends is not None:
            times, states, accelerations = self.ends.arrays()
            before = Run(times, states, accelerations, self.hold)
        status = 0 if self.stop is None else 1
        return Run(t, x, qdd, self.hold, status, self._ending(), self.ledger, failure, self.watch.method, before)

    def _ending(self) -> str:
        """How the run went, for the message."""
        parts = [self.watch.note, self.system.note]
        if self.hold is not None:
            count = self.hold.count
            parts.append(f"the controller was sampled {count} times, every {self.hold.period:g} s")
        went = "; ".join(part for part in parts if part) or "the end was reached"
        words = [self.solver.note, went if self.stop is None else self.stop.message(self.t)]
        return "; ".join(word for word in words if word)


class Record:
    """Times and states in ascending order; where something jumps, those after the jump.

    Parameters
    ----------
    t_eval : ndarray, shape (T,), or None
        Times to report; None for the beginnings of segments and the ends of steps.
    size : int
        Length of the state.
    same : float
        Relative: times that far before a sample are there.
    """

    def __init__(self, t_eval: Array | None, size: int, same: float = SAME) -> None:
        self.t_eval, self.size, self.same = t_eval, size, same
        self.parts: list[tuple[Array, Array, Array | None]] = []  # times, states, accelerations where they are given
        self.asked = 0  # times of `t_eval` that were reported

    @property
    def last(self) -> float:
        """The last time so far."""
        return float(self.parts[-1][0][-1]) if self.parts else -np.inf

    def arrays(self) -> tuple[Array, Array, Array | None]:
        """Times (T,), states (T, size) and, where they are given, accelerations (T, n)."""
        if not self.parts:
            return np.zeros(0), np.zeros((0, self.size)), None
        t, x, qdd = zip(*self.parts, strict=True)
        return np.concatenate(t), np.concatenate(x), None if qdd[0] is None else np.concatenate(qdd)

    def begin(self, t: float, x: Array, system: Any) -> None:
        """A segment begins."""
        if self.t_eval is None:
            self.add(np.array([t]), x[None], system)

    def take(self, steps: Steps, count: int, end: float, x: Array, system: Any) -> None:
        """So many steps were taken, the last as far as `end`, where the state is x."""
        if self.t_eval is None:
            if count == 1:
                return self.add(np.array([end]), x[None], system)
            before = slice(1, count)
            return self.add(np.append(steps.T[before], end), np.concatenate([steps.X[before], x[None]]), system)
        first, self.asked = self.asked, int(np.searchsorted(self.t_eval, end * (1 - SAME), side="left"))
        times = self.t_eval[first : self.asked]
        if len(times):
            self.add(times, steps.states(times, np.searchsorted(steps.T[1:count], times)), system)
        return None

    def finish(self, t: float, x: Array, system: Any, *, stopped: bool) -> None:
        """The run ends: the last instant, if it is asked for or a stop."""
        times = np.array([t]) if self.t_eval is None else self.t_eval[self.asked :]
        if self.t_eval is not None:
            times = times[times <= t * (1 + SAME)]
        if len(times):
            self.add(times, np.repeat(x[None], len(times), axis=0), system)
        if stopped and not self.last >= t:
            self.add(np.array([t]), x[None], system)

    def cut(self, end: float) -> None:
        """Forget what follows."""
        t, x, qdd = self.arrays()
        here = t <= end
        self.parts = [(t[here], x[here], None if qdd is None else qdd[here])] if here.any() else []

    def add(self, t: Array, x: Array, system: Any) -> None:
        """Instants that follow those before, of which the last gives way if it is not earlier."""
        while self.parts and self.last >= t[0]:
            before, states, qdd = self.parts.pop()
            if len(before) > 1:
                self.parts.append((before[:-1], states[:-1], None if qdd is None else qdd[:-1]))
        if system.at_rest is not None:
            x = x.copy()
            x[:, system.at_rest] = 0.0
        self.parts.append((t, x, system.accelerations_at(t, x, self.same)))


def _system_and_solver(plant: Plant, task: Task, hold: ZeroOrderHold | None) -> tuple[Any, Solver]:
    """What is integrated, and by what."""
    friction = plant.rhs.friction
    if friction is not None and friction.sticks:
        system: Plant | DryPlant = DryPlant(plant, friction)
    else:
        system = plant
    return system, _solver(system, plant, task, task.method, hold)


def _solver(system: Any, plant: Plant, task: Task, method: str, hold: ZeroOrderHold | None) -> Solver:
    """A method's loop in machine code where there is one, or SciPy's solver."""
    options = IntegrationOptions(method, task.rtol, task.atol, task.t_eval)
    if method == RODAS:
        return RosenbrockSolver(options, system, plant.rhs.residual.slopes_in_time, plant.robot.n)
    if method not in EXPLICIT or not system.is_compiled:
        keeps: Keeps = True if plant.integrated else () if task.t_eval is None else task.t_eval.tolist()
        if system is not plant or task.stops or plant.law is not None:  # that looks inside each step
            keeps = None
        solver = SciPySolver(options, keeps)
        if method in EXPLICIT and plant.robot.engine == "numba":
            why = "the law is called" if plant.law is not None else "the equations are too large to be written out"
            solver.note = f"by SciPy, as {why}"
        return solver
    if hold is None or hold.traced is None:
        return CompiledSolver(options, system.kernel)
    if isinstance(system, DryPlant):
        system.samples = hold.samples
    return SampledSolver(options, system.kernel, hold)
