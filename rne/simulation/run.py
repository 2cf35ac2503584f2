"""The simulation loop: segments between the instants at which something switches.

At the start of a segment the controller is sampled, if it is due, and the modes of dry friction are settled. A solver
then steps to the next sample or break, unless an event happens inside a step: there the segment ends, and the next one
begins, or the run ends at a stop. States at times to report come from the steps' interpolants.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np

from ..basics.spatial import Array
from ..errors import NotFiniteError, SingularMassMatrixError
from ..integrators.base import FAILURES, RODAS, SAME, GaveUpError, IntegrationOptions, Solver, Steps
from ..integrators.compiled_methods import CompiledSolver, RosenbrockSolver, SampledSolver
from ..integrators.scipy_methods import Keeps, SciPySolver
from ..integrators.tableaus import EXPLICIT
from .events import Event, Stop, first_crossing
from .friction import creep
from .method_choice import MethodMonitor, fastest_joint
from .plant import Plant, with_modes
from .trajectory import Trajectory, between
from .zero_order_hold import MAX_EVALUATIONS, ControlSamples, ZeroOrderHold

# Steps per call of the solver: at first, where an event may throw them away or progress is reported, and at most
FIRST_STEPS, MAX_STEPS = 8, 1000
MIN_TOLERANCES = 2.3e-14, 1e-20  # 100 roundings in float64, as SciPy's solvers demand, and far below any state
# Of the run that is compared with another one: times smaller tolerances; the other has an error too; comparisons a step
FINER, MARGIN, COMPARED = 100.0, 1.1, 8
NEARLY = 1 - 1e-12  # of the duration: later samples are those of its end, up to rounding
EPS = float(np.finfo(np.float64).eps)
ROUNDING = 1e-9  # of the largest value of a joint: what differs by less has not jumped


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
    error: BaseException | None = None  # of the user's law, that ended it


class Instants(NamedTuple):
    """Times (T,) and states (T, size) of a run, with the modes (T, 2 n) of friction that sticks."""

    t: Array
    x: Array
    modes: Array | None = None

    def first(self, count: int) -> Instants:
        """The first of them."""
        return Instants(self.t[:count], self.x[:count], None if self.modes is None else self.modes[:count])


class RunResult(NamedTuple):
    """The result of a run."""

    plant: Plant
    task: Task
    reported: Instants
    before: Instants | None  # just before what ends a segment; None where samples alone do
    samples: ControlSamples | None  # of a controller that is sampled
    status: int
    ending: str
    failure: Failure | None
    method: str
    scene: Any = None
    repeat: Callable[[Task], RunResult] | None = None  # runs another task of the scene

    def trajectory(self) -> tuple[Trajectory, Failure | None]:
        """The motion as far as it is finite, and the failure; torques and energies later, where no law is called."""
        n, N, failure, T = self.plant.robot.n, self.plant.dynamics.n, self.failure, len(self.reported.t)
        found: dict[str, Any] = {}
        if failure is not None or self.plant.law is not None:
            found, failure = self.quantities()
            T = len(found["tau"])
            found |= {"message": failure.cause} if failure else {}
        elif self.plant.dynamics.friction is None:
            found = {"message": self.ending}  # which does not wait for the torques
        t, x, _ = self.reported.first(T)
        motion = Trajectory(
            t,
            x[:, :n],
            x[:, N : N + n],
            self.plant.evaluations,
            self.method,
            -1 if failure else self.status,
            **found,
            error_estimate=self.position_errors,
            model=self.plant.robot.model,
            at_steps=self.task.t_eval is None,
            run=None if "tau" in found else self,
        )
        return motion, failure

    def position_errors(self) -> tuple[Array, Array]:
        """Times, eight in each of the solver's steps, and the largest difference of a position from a finer run.

        The other run starts one rounding beside, so that what rounding grows to is seen. Where the tolerances are at
        rounding already, they are coarser, and the difference is an upper bound.
        """
        assert self.repeat is not None
        self.plant.keep_kernels()
        t, n, task = self.reported.t, self.plant.robot.n, self.task._replace(progress=None)
        task = task._replace(duration=float(t[-1]) if len(t) else 0.0)  # of a run that failed or was stopped
        steps = t if task.t_eval is None else self.repeat(task._replace(t_eval=None)).reported.t
        times = between(steps, COMPARED)
        run = self.repeat(task._replace(t_eval=times))
        factor = 1 / FINER if task.rtol / FINER >= MIN_TOLERANCES[0] else FINER
        finer = task._replace(rtol=task.rtol * factor, atol=max(task.atol * factor, MIN_TOLERANCES[1]), t_eval=times)
        again = self.repeat(finer._replace(x0=task.x0 * (1 + EPS), method=run.method, is_auto=False))
        count = min(len(run.reported.t), len(again.reported.t))  # a stop may have come earlier
        for failure in (run.failure, again.failure):
            if failure is not None and not count:
                text = f"the simulation, repeated, stopped at t = {failure.time:.6g} s: {failure.cause}"
                raise NotFiniteError(text, failure.time) from failure.error
        difference = np.abs(run.reported.x[:count, :n] - again.reported.x[:count, :n]).max(axis=1, initial=0.0)
        return run.reported.t[:count], MARGIN * difference

    def derived(self) -> dict[str, Any]:
        """What a Trajectory has beside times and states; NotFiniteError where it is not finite."""
        found, failure = self.quantities()
        if failure is not None and self.failure is None:
            raise NotFiniteError(failure.cause, failure.time)
        return found

    def quantities(self) -> tuple[dict[str, Any], Failure | None]:
        """Torques, accelerations and energies of the motion, and its jumps, as far as they are finite; the failure."""
        plant, dynamics, n, N = self.plant, self.plant.dynamics, self.plant.robot.n, self.plant.dynamics.n
        tau, rates, failure = _torques_and_accelerations(plant, self._after_breaks(), self._held(self.reported.t))
        instants, qdd = self.reported.first(len(tau)), rates[:, :n]
        t, x, driven = instants.t, instants.x, dynamics.driven
        moved = x[:, :N][:, driven], x[:, N : 2 * N][:, driven], rates[:, driven]  # by the drives
        energies = dict(zip(dynamics.energies, x[:, dynamics.counted :].T, strict=True))
        work, z = energies.pop("drives", np.zeros(len(t))), x[:, 2 * N : 2 * N + dynamics.states]
        if self.samples is not None:
            number = self.samples.held(t, SAME)
            z, work = self.samples.z[number], self.samples.work(moved[0], number, driven)
        robot, x0, side = plant.robot, self.task.x0, dynamics.motor_side
        kinetic, potential = dynamics.energies_of(robot, x)
        start = float(sum(dynamics.energies_of(robot, x0)))
        balance = kinetic + potential - start - work + sum(energies.values(), np.zeros(len(t)))
        jumps, qdd_before, tau_before = self._jumps(t, qdd, tau)
        found: dict[str, Any] = {"qdd": qdd, "tau": tau, "kinetic": kinetic, "potential": potential}
        found |= {"energy": kinetic + potential, "work": work, "dissipated": energies, "energy_start": start}
        found |= {"energy_drift": float(np.abs(balance).max(initial=0.0)), "controller_state": z}
        found |= dict(zip(("motor_q", "motor_qd"), moved if side else 2 * (np.zeros((0, 0)),), strict=False))
        found |= {"jumps": jumps, "qdd_before": qdd_before, "tau_before": tau_before, "scene": repr(self.scene)}
        rest = None if side or "drives" in dynamics.ledger or x0[N : 2 * N].any() else x0[:N]
        how = rest, dynamics.springs, side.rotor if side else None
        crept = "" if dynamics.friction is None else creep(dynamics.friction, robot, moved, *how)
        return found | {"message": f"{crept}; {self.ending}" if crept else self.ending}, self.failure or failure

    def _after_breaks(self) -> Instants:
        """The instants to report, those of breaks just after them."""
        t = self.reported.t
        return self.reported._replace(t=np.where(np.isin(t, self.task.breaks), np.nextafter(t, np.inf), t))

    def _held(self, t: Array, same: float = SAME) -> Array | None:
        """The torques that are held, (T, n), where they are; after a sample those that begin there, up to rounding."""
        return None if self.samples is None else self.samples.u[self.samples.held(t, same)]

    def _before_jumps(self) -> Instants | None:
        """The instants just before those at which accelerations or torques may jump."""
        if self.samples is None or self.before is not None or self.task.t_eval is not None:
            return self.before
        t = self.samples.t
        within = (t > 0) & (t < self.reported.t.max(initial=0.0))
        x = np.pad(self.samples.x[within], ((0, 0), (0, self.plant.dynamics.size - self.samples.x.shape[1])))
        return Instants(np.nextafter(t[within], 0.0), x)

    def _jumps(self, t: Array, qdd: Array, tau: Array) -> tuple[Array, Array, Array]:
        """Times at which accelerations or torques jump, and both just before."""
        before, none = self._before_jumps(), np.zeros((0, self.plant.robot.n))
        if before is None or not len(before.t) or not len(t):
            return np.zeros(0), none, none
        tau_before, qdd_before, _ = _torques_and_accelerations(self.plant, before, self._held(before.t, 0.0))
        qdd_before = qdd_before[:, : qdd.shape[1]]
        place = np.searchsorted(t, before.t[: len(tau_before)], side="right")
        is_reported = place < len(t)
        place, tau_before, qdd_before = place[is_reported], tau_before[is_reported], qdd_before[is_reported]
        jumps = np.zeros(len(place), dtype=bool)
        for values, earlier in ((tau, tau_before), (qdd, qdd_before)):
            jumps |= (np.abs(values[place] - earlier) > ROUNDING * np.abs(values).max(axis=0)).any(axis=-1)
        return t[place[jumps]], qdd_before[jumps], tau_before[jumps]


def _torques_and_accelerations(
    plant: Plant, instants: Instants, u: Array | None
) -> tuple[Array, Array, Failure | None]:
    """Torques and accelerations of every instant up to the first that is not finite or where M is singular."""
    (t, x, modes), n = instants, plant.dynamics.n
    if not len(t):
        return np.zeros((0, plant.robot.n)), np.zeros((0, n)), None
    try:
        u = plant.torques_at(t, x) if u is None else u
        qdd = plant.all_rates(t, x, with_modes(u, modes))[:, n : 2 * n]
        qdd = qdd if modes is None else np.where(modes[:, :n], qdd, 0.0)
        return plant.drive_torques(t, x, u), qdd, None
    except (NotFiniteError, SingularMassMatrixError) as error:
        k = error.state[0] if error.state else int(np.searchsorted(t, getattr(error, "time", None) or 0.0))
        tau, qdd, _ = _torques_and_accelerations(plant, instants.first(k), None if u is None else u[:k])
        try:
            time = float(t[k])
            held = plant.torque(time, x[k]) if u is None else u[k]
            plant.rates(time, x[k], with_modes(held, None if modes is None else modes[k]))
        except (NotFiniteError, SingularMassMatrixError) as same:  # told with its time
            error = same
        return tau, qdd, Failure(float(t[k]), str(error))


class Run:
    """From an initial state to the end, a stop or a failure, in segments; with a hold for a sampled controller."""

    def __init__(self, plant: Plant, task: Task, hold: ZeroOrderHold | None = None) -> None:
        self.plant, self.task, self.hold = plant, task, hold
        self.solver = _solver(plant, task, task.method, hold)
        self.t, self.x = 0.0, task.x0.copy()
        self.stop: Stop | None = None
        self.reports = False  # True while `progress` is called
        self.most = FIRST_STEPS  # steps taken at once
        self.monitor = MethodMonitor(plant, hold, task.method, task.duration, may_change=task.is_auto)
        self.record = Recorder(task.t_eval, len(task.x0))
        known = task.t_eval is not None or (hold is not None and not plant.sticks)  # from the samples
        self.ends = None if known else Recorder(None, len(task.x0))  # of segments, before what may jump there
        self.breaks = sorted({b for b in task.breaks if 0 < b < task.duration}) if hold is None else []

    def result(self) -> RunResult:
        """From the start to the end, a stop or a failure."""
        failure = None
        try:
            if self.task.duration == 0 or not self.plant.counted:  # nothing moves; SciPy's solvers divide by both
                self._begin_segment()
                while self.hold is not None and (not self.hold.count or self.hold.next < self.task.duration * NEARLY):
                    self.hold.sample(self.hold.next, self.x)  # which a solver would have taken
                self.t = self.task.duration
            else:
                while self.t < self.task.duration and self.stop is None:
                    self._segment()
                    self._leave()
            if self.hold is not None:
                self.hold.finish(self.t, self.x)
            self.record.finish(self.t, self.x, self.plant, stopped=self.stop is not None)
        except FAILURES as error:
            if self.reports:  # an error of the user's `progress`
                raise
            failure = self._failure(error)
        except KeyboardInterrupt:
            failure = Failure(self.t, "interrupted", is_interrupt=True)
        self.plant.span = (-np.inf, np.inf)
        return self._result(failure)

    def _failure(self, error: Exception) -> Failure:
        if isinstance(error, GaveUpError) and self.plant.sampled is None:
            try:
                self.monitor.check_chatter()
            except NotFiniteError as cause:
                error = cause
        time = float(getattr(error, "time", None) or self.t)
        return Failure(time, str(error), error=error.__cause__)

    def _segment(self) -> None:
        """To the next sample, break, event or the end."""
        end, resumes = self._begin_segment()
        if resumes:
            self.solver.resume(self.plant, self.t, self.x, end)
        else:
            self.solver.start(self.plant, self.t, self.x, end, self.plant.longest_step(self.task.duration))
        events: list[Event] = [*self.plant.events, *self.task.stops]
        if not resumes:
            self.most = FIRST_STEPS if events or self.task.progress else MAX_STEPS
        solver = self.solver  # of this segment: another one may take over at its end
        while solver.is_running:
            steps = solver.steps(min(self.most, MAX_STEPS if self.solver.takes_samples else self.monitor.steps_to_look))
            self.most = 2 * self.most
            crossing = first_crossing(events, steps)
            count = len(steps.T) - 1 if crossing is None else crossing.step + 1
            self.t, self.x = (float(steps.T[-1]), steps.X[-1]) if crossing is None else (crossing.t, crossing.x)
            self.record.take(steps, count, self.t, self.x, self.plant)
            if self.task.progress is not None:
                self.reports = True
                self.task.progress(self.t, self.task.duration)
                self.reports = False
            if self.plant.sticks:
                self._leave_samples(steps, count)
            if crossing is not None and self.hold is not None:
                self.hold.rewind(self.t)
            if crossing is not None and crossing.event is not None:
                return self._happen(events[crossing.event])
            sample_is_due = self.plant.sticks and self.hold is not None and self.t >= self.hold.next
            if crossing is not None or (self._looks_further(steps) and self.t < end) or sample_is_due:
                break
        self.x = self.plant.reported(self.x)
        return None

    def _leave(self) -> None:
        """Note the values just before the end of a segment, whose instant reports those after it."""
        before = float(np.nextafter(self.t, 0.0))  # of several segments that end at this time the first
        if self.ends is not None and self.t < self.task.duration and self.ends.last < before:
            self.ends.add(np.array([before]), self.x[None], self.plant)

    def _leave_samples(self, steps: Steps, count: int) -> None:
        """The same before the samples within so many steps."""
        rows = np.flatnonzero(steps.jumps[1:count]) + 1
        if self.ends is not None and len(rows):
            self.ends.add(np.nextafter(steps.T[rows], 0.0), steps.X[rows], self.plant)

    def _begin_segment(self) -> tuple[float, bool]:
        """Sample the controller if it is due, settle what sticks; the segment's end, and whether the solver goes on."""
        t, hold = self.t, self.hold
        is_sample = hold is not None and t >= hold.next and not (self.solver.takes_samples and not self.plant.sticks)
        if hold is not None and is_sample:
            hold.sample(t, self.x)
        end = self._next_switch()
        begin = float(np.nextafter(t, np.inf)) if t in self.breaks else t
        self.plant.begin(t, self.x, (begin, float(np.nextafter(end, 0.0))))
        self.record.begin(t, self.x, self.plant)
        return end, is_sample and not self.plant.has_changed

    def _next_switch(self) -> float:
        """The next sample, the next break or the end."""
        duration, hold = self.task.duration, self.hold
        if hold is not None and not self.solver.takes_samples:
            return hold.next if hold.next < duration * NEARLY else duration
        return next((b for b in self.breaks if b > self.t), duration)

    def _happen(self, event: Any) -> None:
        """Go on from an event, or end at a stop."""
        self.x = self.plant.apply_event(event, self.x)
        if isinstance(event, Stop):
            self.stop = event
        else:
            self.monitor.change(self.t)

    def _looks_further(self, steps: Steps) -> bool:
        """Watch the run; True if it goes on with another method."""
        if self.hold is not None and self.plant.evaluations - self.hold.evaluations_before > MAX_EVALUATIONS:
            raise self._diverged(self.hold)
        if not self.monitor.changes_method(steps):
            return False
        self.solver = _solver(self.plant, self.task, self.monitor.method, self.hold)
        return True

    def _diverged(self, hold: ZeroOrderHold) -> NotFiniteError:
        """The error of a sampled loop that diverges, whose steps become ever shorter."""
        where = fastest_joint(self.plant, self.x)
        return NotFiniteError(
            f"more than {MAX_EVALUATIONS} evaluations within one sample at t = {self.t:.6g} s, {where}: the sampled "
            f"loop is unstable; {hold.stability()}",
            self.t,
        )

    def _result(self, failure: Failure | None) -> RunResult:
        before = None if self.ends is None else self.ends.instants()
        samples = None if self.hold is None else self.hold.samples()
        status, reported = 0 if self.stop is None else 1, self.record.instants()
        ending, method = self._ending(), self.monitor.method
        return RunResult(self.plant, self.task, reported, before, samples, status, ending, failure, method)

    def _ending(self) -> str:
        """How the run went, for the message."""
        parts = [self.monitor.note, self.plant.note]
        if self.hold is not None:
            count = self.hold.count
            parts.append(f"the controller was sampled {count} times, every {self.hold.period:g} s")
        went = "; ".join(part for part in parts if part) or "the end was reached"
        words = [self.solver.note, went if self.stop is None else self.stop.message(self.t)]
        return "; ".join(word for word in words if word)


class Recorder:
    """Times and states in ascending order; where something jumps, those after the jump.

    They are those of `t_eval`, or if it is None the beginnings of segments and the ends of steps.
    """

    def __init__(self, t_eval: Array | None, size: int) -> None:
        self.t_eval, self.size = t_eval, size
        self.parts: list[Instants] = []
        self.asked = 0  # times of `t_eval` that were reported

    @property
    def last(self) -> float:
        """The last time so far."""
        return float(self.parts[-1][0][-1]) if self.parts else -np.inf

    def instants(self) -> Instants:
        """All of them."""
        if not self.parts:
            return Instants(np.zeros(0), np.zeros((0, self.size)))
        t, x, modes = zip(*self.parts, strict=True)
        return Instants(np.concatenate(t), np.concatenate(x), None if modes[0] is None else np.concatenate(modes))

    def begin(self, t: float, x: Array, plant: Plant) -> None:
        """A segment begins."""
        if self.t_eval is None:
            self.add(np.array([t]), x[None], plant)

    def take(self, steps: Steps, count: int, end: float, x: Array, plant: Plant) -> None:
        """So many steps were taken, the last as far as `end`, where the state is x."""
        if self.t_eval is None:
            if count == 1:
                return self.add(np.array([end]), x[None], plant)
            before = slice(1, count)
            return self.add(np.append(steps.T[before], end), np.concatenate([steps.X[before], x[None]]), plant)
        first, self.asked = self.asked, int(np.searchsorted(self.t_eval, end * (1 - SAME), side="left"))
        times = self.t_eval[first : self.asked]
        if len(times):
            self.add(times, steps.states(times, np.searchsorted(steps.T[1:count], times)), plant)
        return None

    def finish(self, t: float, x: Array, plant: Plant, *, stopped: bool) -> None:
        """The run ends: the last instant, if it is asked for or a stop."""
        times = np.array([t]) if self.t_eval is None else self.t_eval[self.asked :]
        if self.t_eval is not None:
            times = times[times <= t * (1 + SAME)]
        if len(times):
            self.add(times, np.repeat(x[None], len(times), axis=0), plant)
        if stopped and not self.last >= t:
            self.add(np.array([t]), x[None], plant)

    def add(self, t: Array, x: Array, plant: Plant) -> None:
        """Instants that follow those before, of which the last gives way if it is not earlier."""
        while self.parts and self.last >= t[0]:
            before = self.parts.pop()
            if len(before.t) > 1:
                self.parts.append(before.first(-1))
        modes = None if plant.modes is None else np.repeat(plant.modes[None], len(t), axis=0)
        self.parts.append(Instants(t, plant.reported(x), modes))


def _solver(plant: Plant, task: Task, method: str, hold: ZeroOrderHold | None) -> Solver:
    """A method's loop in machine code where there is one, or SciPy's solver."""
    options = IntegrationOptions(method, task.rtol, task.atol, task.t_eval)
    if method == RODAS:
        return RosenbrockSolver(options, plant, plant.slopes, plant.dynamics.n)
    if method not in EXPLICIT or not plant.is_compiled:
        keeps: Keeps = () if task.t_eval is None else task.t_eval.tolist()
        if plant.sticks or task.stops or plant.law is not None:  # that looks inside each step
            keeps = None
        solver = SciPySolver(options, keeps)
        if method in EXPLICIT and plant.robot.engine == "numba":
            why = "the law is called" if plant.law is not None else "the equations are too large to be written out"
            solver.note = f"by SciPy, as {why}"
        return solver
    if hold is None or hold.traced is None:
        return CompiledSolver(options, plant.kernel)
    return SampledSolver(options, plant.kernel, hold)
