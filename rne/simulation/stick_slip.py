"""Dry friction: every joint slips forwards, slips backwards or sticks, and events lead from one to another.

A sticking joint is held at rest by any torque up to its static friction; a slipping joint is resisted by its Coulomb
friction, and sticks or reverses when its rate passes through zero.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from ..basics.spatial import Array
from ..dynamics.conditioning import pivot_grade, singular_error
from ..dynamics.forward import factorise, solve_factored
from ..errors import NotFiniteError
from .continuous import stop_message, tolerances
from .friction import Friction
from .plant import Plant
from .scipy_solvers import FAILURES, guarded_solver
from .trajectory import Run, Task

MAX_EVENTS, MAX_EVENTS_AT_ONE_TIME, MAX_MODE_CHANGES = 100_000, 20, 1000
AT_REST = 1e-12  # [rad/s or m/s]: rates below it count as zero
# Steps of a robot all of whose joints stick; with the points at which events are examined inside a step, loads of a
# duration above 1/1000 of the run's are found.
STUCK_STEPS = 100
SAME_INSTANT = 1e-12  # of the duration: events closer than this are simultaneous
ROUNDING = 1e-9  # of the largest load or acceleration: closer to the limit a load is held, closer to 0 there is no sign


class DryPlant:
    """The right-hand side for given modes of the joints: +1 and -1 slip, 0 sticks."""

    def __init__(self, plant: Plant, friction: Friction) -> None:
        n = plant.robot.n
        self.plant, self.friction, self.n = plant, friction, n
        self.forward = np.broadcast_to(np.asarray(friction.coulomb, dtype=float), (n,))
        self.back = np.broadcast_to(np.asarray(friction.coulomb_back, dtype=float), (n,))
        self.mode = np.zeros(n, dtype=int)
        self.frictionless = (
            np.maximum(self.static(np.ones(n)), self.static(-np.ones(n))) == 0
        )  # without friction, never sticks
        self.span = (0.0, np.inf)
        self.largest_load = 0.0  # of any joint, when loads were last evaluated [N m or N]
        self.last_key: Any = None
        self.last_accelerations = (np.zeros(n), np.zeros(n), np.zeros(n))

    def loads(self, t: float, x: Array) -> tuple[Array, Array, Array]:
        """M, the net torque without dry friction, and the torque of the drives, evaluated inside the current span."""
        t = min(max(t, self.span[0]), self.span[1])
        n, robot, rhs = self.n, self.plant.robot, self.plant.rhs
        q, qd = x[:n], x[n : 2 * n]
        drives, _ = rhs.drives(np.array([t]), x, self.plant.torque(t, x))
        u = np.zeros(n) if drives is None else np.asarray(drives)
        net = u - robot.bias_torque(q, qd) - np.asarray(self.friction.viscous_torque(qd))
        self.largest_load = float(np.abs(net).max(initial=0.0))
        return robot.mass_matrix(q), net, u

    def accelerations(self, t: float, x: Array) -> tuple[Array, Array, Array]:
        """Accelerations, each joint's dry friction torque, and the drives' torques; the last result is kept."""
        key = t, x.tobytes(), self.mode.tobytes(), self.span
        if key != self.last_key:  # the events of all sticking joints ask for it at the same instant
            self.last_accelerations, self.last_key = self._accelerations(t, x), key
        return self.last_accelerations

    def _accelerations(self, t: float, x: Array) -> tuple[Array, Array, Array]:
        M, net, u = self.loads(t, x)
        slips = self.mode != 0
        dry = np.where(self.mode > 0, self.forward, -self.back) * slips
        qdd = np.zeros(self.n)
        if slips.any():
            qdd[slips] = self._accelerated(M, net - dry, slips)
        needed = net - M @ qdd
        return qdd, np.where(slips, dry, needed), u

    def _accelerated(self, M: Array, torque: Array, slips: Array) -> Array:
        """Accelerations of the slipping joints, the others at rest; an error that names joints if M is singular."""
        part = M[np.ix_(slips, slips)]
        chain = tuple(range(-1, len(part) - 1))
        with np.errstate(all="ignore"):  # a singular part is named below
            L, D = factorise(part, chain)
        if (pivot_grade(D, np.diagonal(part)) == 2).any():
            raise singular_error(self.plant.robot.model, M, ())
        return solve_factored(L, D, chain, torque[slips])

    def static(self, direction: Array) -> Array:
        """Static friction of each joint against a load in the given direction."""
        if self.friction.static is not None:
            return np.broadcast_to(np.asarray(self.friction.static, dtype=float), (self.n,))
        return np.where(direction > 0, self.forward, self.back)

    def settle(self, t: float, x: Array, overloaded: Sequence[int] = ()) -> None:
        """Set the modes of the joints from their rates, and of those at rest from their loads.

        Every joint at rest either resists its load or starts in the direction in which it is then accelerated. Exactly
        one such set of modes exists, since M is positive definite; repeatedly changing the first inconsistent joint
        finds it (Murty's rule for linear complementarity problems).
        """
        qd = x[self.n : 2 * self.n]
        rests = np.abs(qd) <= AT_REST
        self.mode = np.where(rests, 0, np.sign(qd)).astype(int)
        self.mode[self.frictionless] = np.where(qd[self.frictionless] < 0, -1, 1)
        rests = rests & ~self.frictionless
        for k in overloaded:  # the event that just occurred, whose margin rounding may place on either side of zero
            self.mode[k] = int(np.sign(self.accelerations(t, x)[1][k]))
        for _ in range(MAX_MODE_CHANGES):
            qdd, needed, _ = self.accelerations(t, x)
            breaks = rests & (self.mode == 0) & (self._margin(needed) < 0)
            turns = rests & (qdd * self.mode < -ROUNDING * np.abs(qdd).max(initial=0.0))
            wrong = np.nonzero(breaks | turns)[0]
            if not len(wrong):
                return
            k = int(wrong[0])
            self.mode[k] = 0 if turns[k] else int(np.sign(needed[k]))
        raise NotFiniteError(f"no modes of sticking and slipping fit the loads at t = {t:.6g} s", t)

    def _margin(self, needed: Array) -> Array:
        """Static friction of each joint minus its load; a load equal to the static friction is still held."""
        margin: Array = self.static(needed) * (1 + ROUNDING) + ROUNDING * self.largest_load - np.abs(needed)
        return margin

    def __call__(self, t: float, x: Array) -> Array:
        """dx/dt, with the rates of sticking joints at zero."""
        self.plant.evaluations += 1
        n = self.n
        qd = np.where(self.mode != 0, x[n : 2 * n], 0.0)
        qdd, dry, u = self.accelerations(t, np.concatenate([x[:n], qd, x[2 * n :]]))
        powers = {"drives": u @ qd, "viscous": self.friction.viscous_torque(qd) @ qd, "coulomb": dry @ qd}
        own = self.plant.rhs.controller_states
        rates = [qd, qdd]
        if own:
            _, z_rates = self.plant.rhs.drives(np.array([t]), x, None)
            rates.append(np.asarray(z_rates))
        return np.concatenate([*rates, [powers[name] for name in self.plant.rhs.ledger]])

    def events(self) -> list[Callable[[float, Array], float]]:
        """The events that change a mode: a slipping joint comes to rest, a sticking one is overloaded."""
        return [self._rest(i) if self.mode[i] else self._overload(i) for i in range(self.n) if not self.frictionless[i]]

    def _rest(self, i: int) -> Callable[[float, Array], float]:
        sign = float(self.mode[i])

        def rate(t: float, x: Array) -> float:
            return sign * float(x[self.n + i]) + AT_REST  # positive for a joint that just started from rest

        rate.terminal, rate.direction, rate.joint = True, -1.0, i  # type: ignore[attr-defined]
        return rate

    def _overload(self, i: int) -> Callable[[float, Array], float]:
        def margin(t: float, x: Array) -> float:
            return float(self._margin(self.accelerations(t, x)[1])[i])

        margin.terminal, margin.direction, margin.joint = True, -1.0, i  # type: ignore[attr-defined]
        return margin


def stick_slip_run(plant: Plant, task: Task, failures: list[tuple[float, str]]) -> Run:
    """Integrate from event to event until the end, a stop or a failure, which is added to `failures`."""
    if task.method in ("Radau", "BDF"):
        raise ValueError(
            f"`method` of a scene whose joints stick must not need a Jacobian, got {task.method!r}; use LSODA"
        )
    assert plant.rhs.friction is not None
    dry = DryPlant(plant, plant.rhs.friction)
    samples = _Samples(task, dry)
    edges = [*sorted({b for b in task.breaks if 0 < b < task.duration}), task.duration]
    t, x, at_once, stop, ending = 0.0, task.x0.copy(), 0, "", ""
    overloaded: list[int] = []
    try:
        for count in range(MAX_EVENTS):
            end = next(edge for edge in edges if edge > t)
            dry.span = (float(np.nextafter(t, np.inf)) if t in edges else t, float(np.nextafter(end, 0.0)))
            if at_once:  # an undeclared jump of the torques: continue on its other side
                dry.span = (t + at_once * SAME_INSTANT * task.duration, dry.span[1])
            dry.settle(t, x, overloaded)
            solution = _integrate_to_event(dry, task, (t, end), x, failures)
            samples.take(solution, float(solution.t[-1]), dry)
            at_once = at_once + 1 if solution.t[-1] - t <= SAME_INSTANT * task.duration and solution.status == 1 else 0
            if at_once > MAX_EVENTS_AT_ONE_TIME:
                raise NotFiniteError(f"sticking and slipping alternate without end at t = {t:.6g} s", t)
            t, x = float(solution.t[-1]), np.array(solution.y[:, -1])
            stop, overloaded = _come_to_rest(dry, solution, x, task)
            if failures or stop or t >= task.duration:
                ending = stop or f"{count} changes between sticking and slipping"
                break
        else:
            raise NotFiniteError(f"more than {MAX_EVENTS} changes between sticking and slipping", t)
        if not failures:
            samples.last(t, x, dry, ended=t >= task.duration or bool(stop))
    except FAILURES as error:
        failures.append((getattr(error, "time", None) or t, str(error)))
    return samples.run(1 if stop else 0, ending)


def _integrate_to_event(
    dry: DryPlant, task: Task, span: tuple[float, float], x: Array, failures: list[tuple[float, str]]
) -> Any:
    """To the next event or the end of the span."""
    from scipy.integrate import solve_ivp

    rtol, atol = tolerances(dry.plant, task)
    events = [*dry.events(), *task.events]
    solver = guarded_solver(task.method, failures, [x], events)
    options: dict[str, Any] = {"rtol": rtol, "atol": atol, "dense_output": True, "events": events or None}
    if not dry.mode.any():  # nothing moves, so that the step control sees nothing of torques that change with time
        options["max_step"] = task.duration / STUCK_STEPS
    try:
        return solve_ivp(dry, span, x, solver, **options)
    except ValueError as error:  # an event within rounding of a step's end, where SciPy's root finder sees no change
        if "different signs" not in str(error):
            raise
        return solve_ivp(dry, span, x, solver, **options | {"max_step": (span[1] - span[0]) / 97})


def _come_to_rest(dry: DryPlant, solution: Any, x: Array, task: Task) -> tuple[str, list[int]]:
    """At an event the rate that passes through zero is zero. The words of a stop, and the joints that broke away."""
    happened = [k for k, when in enumerate(solution.t_events or ()) if len(when)]
    own = dry.events()
    joints = [own[k].joint for k in happened if k < len(own)]  # type: ignore[attr-defined]
    x[[dry.n + k for k in joints]] = 0.0
    x[dry.n : 2 * dry.n][dry.mode == 0] = 0.0
    stops = [task.events[k - len(own)] for k in happened if k >= len(own)]
    words = stop_message(stops[0], float(solution.t[-1])) if stops else ""
    return words, [k for k in joints if dry.mode[k] == 0]


class _Samples:
    """Times and states to report, with the accelerations under the modes at these times."""

    def __init__(self, task: Task, dry: DryPlant) -> None:
        self.task, self.n = task, dry.n
        self.t: list[float] = []
        self.x: list[Array] = []
        self.qdd: list[Array] = []

    def take(self, solution: Any, until: float, dry: DryPlant) -> None:
        """Add those before the end of a segment."""
        asked = solution.t[:-1] if self.task.t_eval is None else self.task.t_eval
        for time in asked[(asked >= solution.t[0]) & (asked < until)]:
            if not self.t or time > self.t[-1]:
                self.add(float(time), np.asarray(solution.sol(time)), dry)

    def last(self, t: float, x: Array, dry: DryPlant, *, ended: bool) -> None:
        """Add the last instant, if it is asked for or the run ended there."""
        asked = self.task.t_eval
        stopped = ended and t < self.task.duration
        if asked is None or stopped or (len(asked) and asked[-1] == t):
            self.add(t, x, dry)

    def add(self, t: float, x: Array, dry: DryPlant) -> None:
        self.t.append(t)
        self.x.append(x)
        self.qdd.append(dry.accelerations(t, x)[0])

    def run(self, status: int, ending: str) -> Run:
        """All of them."""
        x = np.array(self.x).reshape(len(self.t), len(self.task.x0))
        return Run(np.array(self.t), x, status, ending, None, np.array(self.qdd).reshape(len(self.t), self.n))
