"""The simulation loop: segments between the instants at which something switches.

At the start of a segment the controller is sampled and a late command begins to act, where they are due, and the modes
of dry friction are settled. A solver then steps to the next of these or a break, unless an event happens inside a step:
there the segment ends, and the next one begins, or the run ends at a stop. States at times to report come from the
steps' interpolants.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from ..basics.spatial import Array
from ..errors import NotFiniteError, SingularMassMatrixError
from ..integrators.base import FAILURES, RODAS, SAME, GaveUpError, IntegrationOptions, Solver, Steps
from ..integrators.compiled_methods import CompiledSolver, RosenbrockSolver, SampledSolver
from ..integrators.scipy_methods import Keeps, SciPySolver
from ..integrators.step_control import NEARLY
from ..integrators.tableaus import EXPLICIT
from .events import Event, Stop, first_crossing
from .friction import creep
from .method_choice import MethodMonitor, fastest_joint
from .plant import Plant, with_modes
from .trajectory import Trajectory, between
from .zero_order_hold import MAX_EVALUATIONS, ControlSamples, ZeroOrderHold

# Steps per call of the solver: first ones, where an event may discard them or progress is reported; most
FIRST_STEPS, MAX_STEPS = 8, 1000
MIN_TOLERANCES = 2.3e-14, 1e-20  # smallest tolerances: 100 roundings of float64 as in SciPy; far below any state
# Reference run for the error estimate: tolerance divisor, safety factor for its own error, comparison points per step
FINER, MARGIN, COMPARED = 100.0, 1.1, 8
EPS = float(np.finfo(np.float64).eps)
FEW = 500  # number of states up to which calls for one state are faster than loading the batch function
ROUNDING = 1e-9  # smallest jump relative to the largest value of a joint


class Task(NamedTuple):
    """Task of a run: initial state, duration, method and options."""

    x0: Array
    duration: float
    method: str
    rtol: float
    atol: float
    t_eval: Array | None = None
    breaks: Sequence[float] = ()
    stops: Sequence[Stop] = ()
    is_auto: bool = False  # True if the method may be changed while the run goes on
    progress: Callable[[float, float], object] | None = None  # called with the time and the duration


class Failure(NamedTuple):
    """Reason why a run ended early."""

    time: float
    cause: str
    is_interrupt: bool = False  # True if the user interrupted it
    error: BaseException | None = None  # exception of the user's law that ended it


class Instants(NamedTuple):
    """Times (T,) and states (T, size) of a run, with the modes (T, 2 n) of friction that sticks."""

    t: Array
    x: Array
    modes: Array | None = None

    def first(self, count: int) -> Instants:
        """First instants of the record."""
        return Instants(self.t[:count], self.x[:count], None if self.modes is None else self.modes[:count])


@dataclass(eq=False)
class RunResult:
    """Record of a run, which the loop extends and the Trajectory reads.

    Laws of its arrays, and of what `derived` computes from them:

    1. Times ascend, and none occurs twice: 0 and the ends of the solver's steps, samples, breaks and events among
       them; or, with `t_eval`, its times as far as the run came, and the time of a stop.
    2. Values at a time are those from it on: after a sample, a break or an event at this time. Where `tau` or `qdd`
       jump there, by more than 1e-9 of a joint's largest value, the time is one of `jumps`, and `tau_before` and
       `qdd_before` have the values before it. With `t_eval` no jumps are known.
    3. Torques of a sampled controller are held: from a sample's time and the scene's `delay` on until the next one's
       `tau` is that of the sample; before the first it is 0.
    4. While a joint sticks its velocity and acceleration are exactly 0, and `tau` is the torque of its drive, not what
       friction holds.
    5. `work` and each of `dissipated` count from t = 0, whatever `t_eval` leaves out; `energy_drift` is the largest
       magnitude of energy - energy_start - work + dissipated at these times.
    6. Of a run that fails all arrays end before the first time at which a torque or an acceleration is not finite;
       where only energies overflow, which also ends a run, these are NaN.
    """

    plant: Plant
    task: Task
    scene: Any = None
    repeat: Callable[[Task], RunResult] | None = None  # runs another task of the scene
    samples: ControlSamples | None = None  # of a controller that is sampled
    acting: ControlSamples | None = None  # from when on which of its torques acted
    status: int = 0
    ending: str = ""
    failure: Failure | None = None
    method: str = ""
    changed: bool = False  # True if there was another method before
    parts: list[Instants] = field(default_factory=list)  # of what is reported
    ends: list[Instants] = field(default_factory=list)  # just before what ends a segment
    asked: int = 0  # times of `t_eval` that were reported

    def begin(self, t: float, x: Array) -> None:
        """Start a segment."""
        if self.task.t_eval is None:
            self._add(self.parts, np.array([t]), x[None])

    def take(self, steps: Steps, count: int, end: float, x: Array) -> None:
        """Record a number of steps, the last one as far as `end`, with state x there."""
        times, before = self.task.t_eval, slice(1, count)
        if times is None:
            T, X = np.append(steps.T[before], end), np.concatenate([steps.X[before], x[None]])
            return self._add(self.parts, T, X)
        first, self.asked = self.asked, int(np.searchsorted(times, end * (1 - SAME), side="left"))
        times = times[first : self.asked]
        if len(times):
            self._add(self.parts, times, steps.states(times, np.searchsorted(steps.T[before], times)))
        return None

    def leave(self, t: Array, x: Array) -> None:
        """Record the states just before times t at which values may jump; only the first at equal times."""
        before, from_samples = np.nextafter(t, 0.0), self.plant.sampled is not None and not self.plant.sticks
        if self.task.t_eval is None and not from_samples and (not self.ends or self.ends[-1].t[-1] < before[0]):
            self._add(self.ends, before, x)

    def finish(self, t: float, x: Array, *, stopped: bool) -> None:
        """Record the last instant if it is to be reported or a stop."""
        times = np.array([t]) if self.task.t_eval is None else self.task.t_eval[self.asked :]
        times = times[times <= t * (1 + SAME)]
        if len(times):
            self._add(self.parts, times, np.repeat(x[None], len(times), axis=0))
        if stopped and not (self.parts and self.parts[-1].t[-1] >= t):
            self._add(self.parts, np.array([t]), x[None])

    def _add(self, parts: list[Instants], t: Array, x: Array) -> None:
        """Append instants; the last one before is replaced if it is not earlier."""
        while parts and parts[-1].t[-1] >= t[0]:
            before = parts.pop()
            if len(before.t) > 1:
                parts.append(before.first(-1))
        modes = None if self.plant.modes is None else np.repeat(self.plant.modes[None], len(t), axis=0)
        parts.append(Instants(t, self.plant.reported(x), modes))

    def _joined(self, parts: list[Instants]) -> Instants:
        if not parts:
            return Instants(np.zeros(0), np.zeros((0, len(self.task.x0))))
        t, x, modes = zip(*parts, strict=True)
        found = Instants(np.concatenate(t), np.concatenate(x), None if modes[0] is None else np.concatenate(modes))
        for array in found[:2]:  # so that the motion's arrays need no copies
            array.flags.writeable = False
        return found

    @cached_property
    def reported(self) -> Instants:
        """Instants to report, after the end of the run."""
        return self._joined(self.parts)

    def trajectory(self) -> tuple[Trajectory, Failure | None]:
        """Trajectory up to the first non-finite value, and the failure; torques and energies are computed later."""
        n, N, (t, x, _), given = self.plant.robot.n, self.plant.dynamics.n, self.reported, dict[str, Any]()
        if self.failure is not None or self.plant.law is not None:
            found, self.failure = self._quantities
            t, x, _ = self.reported.first(len(found["tau"]))
        if self.failure is not None or self.plant.dynamics.friction is None:  # which does not wait for the torques
            given["message"] = self.failure.cause if self.failure else self.ending
        motion = Trajectory(
            t,
            x[:, :n],
            x[:, N : N + n],
            self.plant.evaluations,
            self.method,
            -1 if self.failure else self.status,
            **given,
            error_estimate=self.position_errors,
            model=self.plant.robot.model,
            at_steps=self.task.t_eval is None,
            run=self,
        )
        return motion, self.failure

    def position_errors(self) -> tuple[Array, Array]:
        """Largest position difference from a finer run, with its times, eight per step of the solver.

        The other run starts from a state changed by one rounding, so that the growth of rounding is seen. Where the
        tolerances are already at rounding, its tolerances are larger, and the difference is an upper bound.
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
        """Fields of a Trajectory derived from times and states; NotFiniteError where they are not finite."""
        found, failure = self._quantities
        if failure is not None and failure is not self.failure:
            raise NotFiniteError(failure.cause, failure.time)
        return found

    @cached_property
    def _quantities(self) -> tuple[dict[str, Any], Failure | None]:
        """Torques, accelerations, energies and jumps of the motion as far as they are finite; the failure."""
        plant, dynamics, N = self.plant, self.plant.dynamics, self.plant.dynamics.n
        t = self.reported.t
        after = self.reported._replace(t=np.where(np.isin(t, self.task.breaks), np.nextafter(t, np.inf), t))
        tau, rates, failure = _torques_and_accelerations(plant, after, self._held(t))  # at breaks just after them
        t, x, _ = self.reported.first(len(tau))
        qdd, driven = rates[:, : plant.robot.n], dynamics.driven
        moved = x[:, :N][:, driven], x[:, N : 2 * N][:, driven], rates[:, driven]  # by the drives
        energies = dict(zip(dynamics.energies, x[:, dynamics.counted :].T, strict=True))
        work, z = energies.pop("drives", np.zeros(len(t))), x[:, 2 * N : 2 * N + dynamics.states]
        if self.samples is not None and self.acting is not None:
            z = self.samples.z[self.samples.held(t, SAME)]
            work = self.acting.work(moved[0], self.acting.held(t, SAME), driven)
        try:
            kinetic, potential = dynamics.energies_of(plant.robot, np.concatenate([self.task.x0[None], x]))
        except NotFiniteError as error:  # with torques that are finite: squares of velocities overflow
            kinetic, potential = np.full((2, len(x) + 1), np.nan)
            failure = failure or Failure(float(t[0]) if len(t) else 0.0, str(error))
        energy = kinetic + potential
        balance = energy[1:] - energy[0] - work + sum(energies.values(), np.zeros(len(t)))
        jumps, qdd_before, tau_before = self._jumps(t, qdd, tau)
        found: dict[str, Any] = {"qdd": qdd, "tau": tau, "kinetic": kinetic[1:], "potential": potential[1:]}
        found |= {"energy": energy[1:], "work": work, "dissipated": energies, "energy_start": float(energy[0])}
        found |= {"energy_drift": float(np.abs(balance).max(initial=0.0)), "controller_state": z}
        of_motors = moved if dynamics.motor_side else 2 * (np.zeros((0, 0)),)
        found |= dict(zip(("motor_q", "motor_qd"), of_motors, strict=False))
        found |= {"jumps": jumps, "qdd_before": qdd_before, "tau_before": tau_before, "scene": repr(self.scene)}
        return found | {"message": self._message(moved)}, self.failure or failure

    def _message(self, moved: tuple[Array, ...]) -> str:
        """Message of the run: its end, and joints that crept while meant to rest, from the drives' path `moved`."""
        dynamics, x0, N = self.plant.dynamics, self.task.x0, self.plant.dynamics.n
        if dynamics.friction is None:
            return self.ending
        side = dynamics.motor_side
        rest = None if side or "drives" in dynamics.ledger or x0[N : 2 * N].any() else x0[:N]
        how = rest, dynamics.springs, side.rotor if side else None
        crept = creep(dynamics.friction, self.plant.robot, moved, *how)
        return f"{crept}; {self.ending}" if crept else self.ending

    def _held(self, t: Array, same: float = SAME) -> Array | None:
        """Held torques, (T, n), if any; at a change those that begin there, up to rounding."""
        return None if self.acting is None else self.acting.u[self.acting.held(t, same)]

    def _before_jumps(self) -> Instants:
        """Instants just before possible jumps of accelerations or torques."""
        if self.acting is None or self.plant.sticks or self.task.t_eval is not None:
            return self._joined(self.ends)
        t = self.acting.t
        within = (t > 0) & (t < self.reported.t.max(initial=0.0))
        x = np.pad(self.acting.x[within], ((0, 0), (0, self.plant.dynamics.size - self.acting.x.shape[1])))
        return Instants(np.nextafter(t[within], 0.0), x)

    def _jumps(self, t: Array, qdd: Array, tau: Array) -> tuple[Array, Array, Array]:
        """Times at which accelerations or torques jump, and both just before."""
        before, none = self._before_jumps(), np.zeros((0, self.plant.robot.n))
        if not len(before.t) or not len(t):
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
    """Torques and accelerations up to the first instant that is not finite or where M is singular."""
    (t, x, modes), n = instants, plant.dynamics.n
    if not len(t):
        return np.zeros((0, plant.robot.n)), np.zeros((0, n)), None
    try:
        u = plant.torques_at(t, x) if u is None else u
        few = 1 if "blocks" in vars(plant.kernel) else FEW
        qdd = plant.all_outputs(t, x, with_modes(u, modes), few)[:, n : 2 * n]
        qdd = qdd if modes is None else np.where(modes[:, :n], qdd, 0.0)
        return plant.drive_torques(t, x, u), qdd, None
    except (NotFiniteError, SingularMassMatrixError) as error:
        k = error.state[0] if error.state else int(np.searchsorted(t, getattr(error, "time", None) or 0.0))
        tau, qdd, _ = _torques_and_accelerations(plant, instants.first(k), None if u is None else u[:k])
        try:
            time = float(t[k])
            held = plant.torque(time, x[k]) if u is None else u[k]
            plant.rates(time, x[k], with_modes(held, None if modes is None else modes[k]))
        except (NotFiniteError, SingularMassMatrixError) as same:  # reported with its time
            error = same
        return tau, qdd, Failure(float(t[k]), str(error))


class Run:
    """Run of a task in segments, to its end, a stop or a failure; with a hold for a sampled controller."""

    def __init__(self, plant: Plant, task: Task, hold: ZeroOrderHold | None = None) -> None:
        self.plant, self.task, self.hold = plant, task, hold
        self.solver = _solver(plant, task, task.method, hold)
        self.t, self.x = 0.0, task.x0.copy()
        self.stop: Stop | None = None
        self.reports = False  # True while `progress` is called
        self.most = FIRST_STEPS  # steps taken at once
        self.monitor = MethodMonitor(plant, hold, task.method, task.duration, may_change=task.is_auto)
        self.record = RunResult(plant, task)
        self.breaks = [b for b in task.breaks if 0 < b < task.duration] if hold is None else []

    def result(self) -> RunResult:
        """Integrate from the start to the end, a stop or a failure."""
        failure = None
        try:
            if self.task.duration == 0 or not self.plant.counted:  # nothing moves; SciPy's solvers divide by both
                self._begin_segment()
                while self.hold is not None and (not self.hold.count or self.hold.next < self.task.duration * NEARLY):
                    self.hold.renew(self.hold.next, self.x)  # which a solver would have taken
                self.t = self.task.duration
            else:
                while self.t < self.task.duration and self.stop is None:
                    self._segment()
                    if self.t < self.task.duration:
                        self.record.leave(np.array([self.t]), self.x[None])
            if self.hold is not None:
                self.hold.finish(self.t, self.x)
            self.record.finish(self.t, self.x, stopped=self.stop is not None)
        except FAILURES as error:
            if self.reports:  # an error of the user's `progress`
                raise
            failure = self._failure(error)
        except KeyboardInterrupt:
            failure = Failure(self.t, "interrupted", is_interrupt=True)
        self.plant.span = (-np.inf, np.inf)
        record = self.record
        record.failure = failure
        if self.hold is not None:
            record.samples, record.acting = self.hold.samples(), self.hold.commands()
        record.status, record.ending, record.method = int(self.stop is not None), self._ending(), self.monitor.method
        record.changed = bool(self.monitor.notes)
        return record

    def _failure(self, error: Exception) -> Failure:
        if isinstance(error, GaveUpError) and self.plant.sampled is None:
            try:
                self.monitor.check_chatter()
            except NotFiniteError as cause:
                error = cause
        time = float(getattr(error, "time", None) or self.t)
        return Failure(time, str(error), error=error.__cause__)

    def _segment(self) -> None:
        """Integrate to the next sample or command, break, event or the end."""
        end, resumes = self._begin_segment()
        events: list[Event] = [*self.plant.events, *self.task.stops]
        solver = self.solver  # of this segment: another one may take over at its end
        if not resumes:
            self.most = FIRST_STEPS if events or self.task.progress else MAX_STEPS
        most = self._steps_at_once()
        if resumes:
            solver.resume(self.plant, self.t, self.x, end)
        else:
            solver.start(self.plant, self.t, self.x, end, self.plant.longest_step(self.task.duration))
        while solver.is_running:
            steps = solver.steps(most)
            crossing = first_crossing(events, steps)
            count = len(steps.T) - 1 if crossing is None else crossing.step + 1
            self.t, self.x = (float(steps.T[-1]), steps.X[-1]) if crossing is None else (crossing.t, crossing.x)
            self.record.take(steps, count, self.t, self.x)
            if self.task.progress is not None:
                self.reports = True
                self.task.progress(self.t, self.task.duration)
                self.reports = False
            self._leave(steps, count)
            if crossing is not None and self.hold is not None:
                self.hold.rewind(self.t)
            if crossing is not None and crossing.event is not None:
                return self._happen(events[crossing.event])
            sample_is_due = self.plant.sticks and self.hold is not None and self.t >= self.hold.next
            if crossing is not None or (self._looks_further(steps) and self.t < end) or sample_is_due:
                break
            self.most = 2 * self.most
            most = self._steps_at_once()
        self.x = self.plant.reported(self.x)
        return None

    def _steps_at_once(self) -> int:
        return min(self.most, MAX_STEPS if self.solver.takes_samples else self.monitor.steps_to_look)

    def _leave(self, steps: Steps, count: int) -> None:
        """Record the values just before the samples or breaks at which steps ended, as far as the run came."""
        t, x, at_jumps = steps.T[1 : count + 1], steps.X[1 : count + 1], np.zeros(count, dtype=bool)
        if self.plant.sticks:
            at_jumps[:-1] = steps.jumps[1:count]
        elif self._passes_breaks:
            at_jumps = np.isin(t, self.breaks) & (t <= self.t)
        if at_jumps.any():
            self.record.leave(t[at_jumps], x[at_jumps])

    @property
    def _passes_breaks(self) -> bool:
        """True if the solver's steps continue after a break; where joints stick, they may slip from there on."""
        return self.solver.takes_breaks and len(self.breaks) > 0 and not self.plant.sticks

    def _begin_segment(self) -> tuple[float, bool]:
        """Renew held torques if due and settle sticking joints; end of the segment, and True to continue the solver."""
        t, hold = self.t, self.hold
        is_due = hold is not None and t >= hold.next and not (self.solver.takes_samples and not self.plant.sticks)
        if hold is not None and is_due:
            hold.renew(t, self.x)
        end = self._next_switch()
        begin = float(np.nextafter(t, np.inf)) if t in self.breaks else t
        self.plant.begin(t, self.x, (begin, float(np.nextafter(end, 0.0))))
        self.record.begin(t, self.x)
        return end, is_due and not self.plant.has_changed

    def _next_switch(self) -> float:
        """Time of the next sample or command, break or the end."""
        duration, hold = self.task.duration, self.hold
        if hold is not None and not self.solver.takes_samples:
            return hold.next if hold.next < duration * NEARLY else duration
        return duration if self._passes_breaks else next((b for b in self.breaks if b > self.t), duration)

    def _happen(self, event: Any) -> None:
        """Continue after an event, or end at a stop."""
        self.x = self.plant.apply_event(event, self.x)
        if isinstance(event, Stop):
            self.stop = event
        else:
            self.monitor.change(self.t)

    def _looks_further(self, steps: Steps) -> bool:
        """Monitor the run; True if it continues with another method."""
        if self.hold is not None and self.plant.evaluations - self.hold.evaluations_before > MAX_EVALUATIONS:
            raise self._diverged(self.hold)
        if not self.monitor.changes_method(steps):
            return False
        self.solver = _solver(self.plant, self.task, self.monitor.method, self.hold)
        return True

    def _diverged(self, hold: ZeroOrderHold) -> NotFiniteError:
        """Error of a diverging sampled loop, whose steps become ever shorter."""
        where = fastest_joint(self.plant, self.x)
        return NotFiniteError(
            f"more than {MAX_EVALUATIONS} evaluations within one sample at t = {self.t:.6g} s, {where}: the sampled "
            f"loop is unstable; {hold.stability()}",
            self.t,
        )

    def _ending(self) -> str:
        """Text on how the run ended, for its message."""
        parts = [self.monitor.note, self.plant.note]
        if self.hold is not None:
            count = self.hold.count
            late = f", and acted {self.hold.scene.delay:g} s later" if any(self.hold.delay) else ""
            parts.append(f"the controller was sampled {count} times, every {self.hold.period:g} s{late}")
        went = "; ".join(part for part in parts if part) or "completed"
        words = [self.solver.note, went if self.stop is None else self.stop.message(self.t)]
        return "; ".join(word for word in words if word)


def _solver(plant: Plant, task: Task, method: str, hold: ZeroOrderHold | None) -> Solver:
    """Solver of a method: a compiled loop where there is one, otherwise SciPy's."""
    breaks = np.array([b for b in task.breaks if b > 0 and hold is None])  # a law that is held jumps at its samples
    options = IntegrationOptions(method, task.rtol, task.atol, task.t_eval, breaks)
    if method == RODAS:
        return RosenbrockSolver(options, plant)
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
