"""The simulation loop: segments between the instants at which something switches.

At the start of a segment the controller is sampled, if it is due, and the modes of dry friction are settled. A solver
then steps to the next sample or break, unless an event happens inside a step: there the segment ends, and the next one
begins, or the run ends at a stop. Times to report and the energies of the ledger come from each step's interpolant.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from ..basics.spatial import Array
from ..errors import NotFiniteError, SingularMassMatrixError
from .events import Event, Stop, first_crossing
from .ledger import Ledger, Span
from .plant import Plant
from .record import Instant, Record
from .run import Failure, Run, Task
from .sampled import MAX_EVALUATIONS, ZeroOrderHold
from .solver import AdaptiveSolver, Step
from .stick_slip import DryPlant
from .symplectic import METHOD as GAUSS
from .symplectic import GaussSolver, Hamilton
from .system import Stepper, System
from .watch import Watch

FEWEST = 8  # steps taken at first, where an event may throw them away
COMPILED = ("RK45", "DOP853")  # the methods with a loop in machine code
FAILURES = (NotFiniteError, SingularMassMatrixError, ArithmeticError)


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
        self.system, self.solver = _system_and_solver(plant, task)
        self.t, self.x = 0.0, task.x0.copy()
        self.stop: Stop | None = None
        self.watch = Watch(plant, task)
        self.ledger = Ledger(plant.powers, len(plant.integrated)) if plant.integrated else None
        self.work_before, self.begun = 0.0, self.x  # work of held torques before the segment, and its first state
        self.record = Record(task.t_eval, every_step=hold is None)
        self.ends = Record(None, every_step=False)  # of segments, just before what may jump there
        self.samples, self.evaluations_before = 0, 0
        self.breaks = sorted({b for b in task.breaks if 0 < b < task.duration}) if hold is None else []

    def run(self) -> Run:
        """From the start to the end, a stop or a failure."""
        failure = None
        try:
            if self.task.duration == 0 or self.plant.robot.n == 0:  # nothing moves; SciPy's solvers divide by both
                self._rest()
            else:
                self.x = self.system.start(self.x)
                while self.t < self.task.duration and self.stop is None:
                    self._segment()
                    self._leave()
                if self.hold is not None and self.t >= self.samples * self.hold.period:
                    self.hold.state = self.hold.next_state  # as of the sample that would follow
                self.record.finish(self.t, self.x, self, stopped=self.stop is not None)
        except FAILURES as error:
            failure = self._failure(error)
        self.plant.span = (-np.inf, np.inf)
        try:
            energies = self._energies()
        except FAILURES as error:
            failure = failure or self._failure(error)
            self.record.cut(self.ledger.end if self.ledger is not None else 0.0)
            energies = self._energies()
        return self._result(energies, failure)

    def _failure(self, error: Exception) -> Failure:
        return Failure(float(getattr(error, "time", None) or self.t), str(error))

    def _rest(self) -> None:
        """The initial state at every time."""
        self._begin_segment()
        end = self.task.duration
        self.record.finish(end, self.x, self, stopped=False)

    def _segment(self) -> None:
        """To the next sample, break, event or the end."""
        end, resumes = self._begin_segment()
        if resumes:
            self.solver.resume(self.system, self.t, self.x, end)
        else:
            self.solver.start(self.system, self.t, self.x, end, self.system.longest_step(self.task.duration))
        events: list[Event] = [*self.system.events, *self.task.stops]
        if not events and self.ledger is None and self.system is self.plant and self.record.takes_steps:
            return self._free_steps(end)
        solver, most = self.solver, FEWEST if events else self.watch.steps_to_look
        while solver.is_running:
            steps = solver.steps(min(most, self.watch.steps_to_look))
            most = 2 * most
            crossing = first_crossing(events, steps)
            if crossing is not None:
                steps = steps[: crossing.step + 1]
            t, x = (steps[-1].end, steps[-1].x) if crossing is None else (crossing.t, crossing.x)
            self.record.take(steps, t, x, self)
            self._integrate(steps, t, is_last=crossing is not None or not solver.is_running)
            if crossing is not None:
                return self._happen(events[crossing.event], t, x)
            self.t, self.x = t, x
            if self._looks_further(steps) and t < end:
                break
        self.x = self.system.reported(self.x)
        return None

    def _leave(self) -> None:
        """Note the values just before the end of a segment, whose instant reports those after it."""
        before, ends = float(np.nextafter(self.t, 0.0)), self.ends
        is_first = not ends.instants or ends.instants[-1].t < before  # of several segments that end at this time
        if self.task.t_eval is None and self.t < self.task.duration and is_first:
            ends.begin(before, self.x, self)

    def _free_steps(self, end: float) -> None:
        """The same where nothing is looked for inside steps: a loop as short as the solver's own."""
        solver, add = self.solver, self.record.instants.append
        while solver.is_running:
            steps = solver.steps(self.watch.steps_to_look)
            for step in steps:
                add(Instant(step.end, step.x, None, 0.0, None, None))
            self.t, self.x = step.end, step.x
            if self._looks_further(steps) and self.t < end:
                break

    def _begin_segment(self) -> tuple[float, bool]:
        """Sample the controller if it is due, settle what sticks; the segment's end, and whether the solver goes on."""
        t, hold = self.t, self.hold
        self.work_before, self.begun = self.work(self.x), self.x
        is_sample = hold is not None and t >= self.samples * hold.period
        if hold is not None and is_sample:
            hold.sample(t, self.x)
            self.samples += 1
            self.evaluations_before = self.plant.evaluations
        end = self._next_switch()
        begin = float(np.nextafter(t, np.inf)) if t in self.breaks else t
        self.system.begin(t, self.x, (begin, float(np.nextafter(end, 0.0))))
        self.record.begin(t, self.x, self)
        return end, is_sample and not self.system.has_changed

    def _next_switch(self) -> float:
        """The next sample, the next break or the end."""
        duration = self.task.duration
        if self.hold is not None:
            sample = self.samples * self.hold.period
            return sample if sample < duration * (1 - 1e-12) else duration
        return next((b for b in self.breaks if b > self.t), duration)

    def _integrate(self, steps: Sequence[Step], end: float, *, is_last: bool) -> None:
        """Integrate the powers of steps, the last as far as `end`."""
        if self.ledger is None:
            return
        for step in steps:
            here = step is steps[-1]
            span = Span(step.begin, end if here else step.end, step.interpolant)
            self.ledger.add(span, self.plant.held, self.system.at_rest, is_last=is_last and here)

    def _happen(self, event: Any, t: float, x: Array) -> None:
        """Go on from an event, or end at a stop."""
        self.t, self.x = t, self.system.after(event, x)
        if isinstance(event, Stop):
            self.stop = event
        else:
            self.watch.change(t)

    def _looks_further(self, steps: Sequence[Step]) -> bool:
        """Watch the run; True if it goes on with another method."""
        if self.hold is not None and self.plant.evaluations - self.evaluations_before > MAX_EVALUATIONS:
            raise _diverged(self)
        if self.task.method == GAUSS:
            return False
        if not self.watch.changes_method(steps):
            return False
        self.solver = AdaptiveSolver(self.watch.method, self.task.rtol, self.task.atol)
        return True

    def work(self, x: Array) -> float:
        """Work of the torques that are held, up to a state x of the segment."""
        if self.plant.held is None:
            return 0.0
        n = self.plant.robot.n
        return self.work_before + float(self.plant.held @ (x[:n] - self.begun[:n]))

    def _energies(self) -> dict[str, Array]:
        """Energies of the ledger at the reported instants."""
        times = self.record.t
        found = {}
        if self.hold is not None:
            found["drives"] = np.array([instant.work for instant in self.record.instants])
        if self.ledger is not None:
            found |= dict(zip(self.plant.integrated, self.ledger.at(times).T, strict=True))
        return found

    def _result(self, energies: dict[str, Array], failure: Failure | None) -> Run:
        ends = self._run_of(self.ends, {}, None)
        return self._run_of(self.record, energies, failure)._replace(ends=ends)

    def _run_of(self, record: Record, energies: dict[str, Array], failure: Failure | None) -> Run:
        instants = record.instants
        n, size = self.plant.robot.n, len(self.task.x0)
        x = self.system.states(np.array([i.x for i in instants]).reshape(len(instants), size))

        def column(values: list[Array | None], width: int) -> Array | None:
            return None if not values or values[0] is None else np.array(values).reshape(len(values), width)

        return Run(
            record.t,
            x,
            0 if self.stop is None else 1,
            self._ending(),
            column([i.held for i in instants], n),
            column([i.qdd for i in instants], n),
            column([i.controller_state for i in instants], 0 if self.hold is None else len(self.hold.state)),
            energies,
            failure,
            self.watch.method,
        )

    def _ending(self) -> str:
        """How the run went, for the message."""
        if self.stop is not None:
            return self.stop.message(self.t)
        parts = [self.watch.note, self.system.note]
        if isinstance(self.solver, GaussSolver):
            parts.append(f"{self.solver.count} steps of {self.solver.h:.6g} s")
        if self.hold is not None:
            parts.append(f"the controller was sampled {self.samples} times, every {self.hold.period:g} s")
        return "; ".join(part for part in parts if part) or "the end was reached"


def _system_and_solver(plant: Plant, task: Task) -> tuple[System, Stepper]:
    """What is integrated, and by what."""
    if task.method == GAUSS:
        hamilton = Hamilton(plant)
        return hamilton, GaussSolver(hamilton, task.duration, task.step)
    friction = plant.rhs.friction
    if friction is not None and friction.sticks:
        return DryPlant(plant, friction), AdaptiveSolver(task.method, task.rtol, task.atol)
    if plant.is_compiled and task.method in COMPILED:
        from .runge_kutta import CompiledSolver

        return plant, CompiledSolver(task.method, task.rtol, task.atol, plant.kernel)
    return plant, AdaptiveSolver(task.method, task.rtol, task.atol)


def _diverged(loop: Loop) -> NotFiniteError:
    """The error of a sampled loop that diverges, whose steps become ever shorter."""
    assert loop.hold is not None
    n = loop.plant.robot.n
    rates = np.abs(loop.x[n : 2 * n])
    k = int(np.argmax(rates))
    return NotFiniteError(
        f"more than {MAX_EVALUATIONS} evaluations within one sample at t = {loop.t:.6g} s, where "
        f"{loop.plant.robot.joint_names[k]!r} moves at {rates[k]:.3g} rad/s or m/s: the sampled loop is unstable; "
        f"{loop.hold.stability()}",
        loop.t,
    )
