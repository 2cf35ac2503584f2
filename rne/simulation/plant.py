"""The equations of motion as a solver calls them: f(t, x) and its Jacobian, with calls counted and laws checked.

Between two samples the torques of a sampled controller are held. Under dry friction every joint slips forwards, slips
backwards or sticks, and events lead from one to another: a sticking joint is held at rest by any torque up to its
static friction; a slipping joint is resisted by its Coulomb friction, and sticks or reverses when its rate passes
through zero.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from math import isfinite
from typing import Any, NamedTuple

import numpy as np

from ..basics.arrays import real_array
from ..basics.spatial import Array
from ..control.gains import check_gains
from ..dynamics.quantity import OK, PrecisionStatus
from ..errors import NotFiniteError, SingularMassMatrixError
from ..kernels.program import NeedsRecursion
from ..robot import Robot
from .equations_of_motion import RightHandSide, call_law
from .events import Event
from .friction import Friction
from .scene import Scene

MAX_EVALUATIONS = 20_000  # of the right-hand side between two samples, some hundred times what a stable loop takes
MAX_MODE_CHANGES, MAX_AT_ONE_TIME = 1000, 20
AT_REST = 1e-12  # of the largest rate so far: rates below it count as zero
# Steps of a robot all of whose joints stick; with the points at which events are examined inside a step, loads of a
# duration above 1/1000 of the run's are found.
STUCK_STEPS = 100
SAME_INSTANT = 1e-12  # of the time: events closer than this are simultaneous
ROUNDING = 1e-9  # of the largest load or acceleration: closer to the limit a load is held, closer to 0 there is no sign


class System:
    """Equations of motion that a solver integrates, and what may switch in them: nothing by itself.

    `Plant` is that of a scene, `DryPlant` of one with friction that sticks.
    """

    events: Sequence[Event] = ()  # what ends a segment, beside samples, breaks and stops
    at_rest: Array | None = None  # entries of the state that are held at zero
    has_changed = False  # at the beginning of the segment, so that the solver starts anew
    note = ""  # for the message of a run
    span = (-np.inf, np.inf)  # times at which torques are evaluated: inside the segment, on this side of its breaks

    def within(self, t: float) -> float:
        """The time of `span` closest to t."""
        first, last = self.span
        return first if t < first else last if t > last else t

    def begin(self, t: float, x: Array, span: tuple[float, float]) -> None:
        """Prepare for a segment that begins at t; torques are evaluated within `span`."""

    def after(self, event: Event, x: Array) -> Array:
        """The state with which motion goes on after one of `events`."""
        return x

    def longest_step(self, duration: float) -> float:
        """Longest step that the solver may take in a run of this duration [s]."""
        return float("inf")

    def reported(self, x: Array) -> Array:
        """The state to report of a solver's state."""
        return x

    def accelerations_at(self, t: Array, X: Array, same: float) -> Array | None:
        """Accelerations to report, (T, n), at times (T,), where they do not follow from time, state and torques.

        Times up to a relative rounding `same` before a sample count as being there.
        """
        return None


class Plant(System):
    """f(t, x) for a solver, counting its calls; an untraced law is called for the drives' torques.

    Nothing in it switches by itself; see `DryPlant` for what does.

    Parameters
    ----------
    rhs : RightHandSide
    law : callable or None
        f(t, q, qd) for the torques where `rhs.torque_given` and the controller is not sampled.
    law_name : {"controller", "torque"}
        The argument that the user gave the law as, for error messages.
    """

    def __init__(self, rhs: RightHandSide, law: Callable[..., Any] | None, law_name: str = "controller") -> None:
        self.rhs, self.robot, self.kernel = rhs, rhs.robot, rhs.kernel
        self.law, self.law_name = law, law_name
        self.held: Array | None = None  # torques (n,) of a sampled controller since its last sample
        self.evaluations, self.verdict = 0, OK  # the verdict on the worst state so far
        self._time = np.zeros(1)  # t as an argument of the kernel
        self._state_function = self.kernel.state_function_unguarded if self.kernel.is_unrolled else None

    @property
    def counted(self) -> int:
        """Number of the states whose errors count: all."""
        return self.rhs.size

    @property
    def is_compiled(self) -> bool:
        """True if no law is called and the kernel is machine code."""
        return self.law is None and self.kernel.is_unrolled and self.robot.engine == "numba"

    @property
    def is_conservative(self) -> bool:
        """True without drives and friction: nothing damps the motion."""
        return self.rhs.friction is None and self.rhs.law is None and not self.rhs.torque_given

    def begin(self, t: float, x: Array, span: tuple[float, float]) -> None:
        """Evaluate torques within the segment that begins here."""
        self.span = span

    def note_loss(self, verdict: PrecisionStatus) -> None:
        """Raise an error; keep a loss if it is the worst so far."""
        if verdict.error is not None:
            raise verdict.error
        self.verdict = self.verdict.worse(verdict.with_state(lambda state: ()))

    def torque(self, t: float, x: Array) -> Array | None:
        """Torques that the law returns, and the rates of its states; a NaN or a wrong shape is named with its time."""
        if self.law is None:
            return self.held
        u, rates = call_law(self.law, t, x, self.robot.n)
        if rates is None:
            return checked_torques(self.law_name, u, self.robot, t)
        slopes = real_array("rates of the controller's states", rates, f"({self.rhs.controller_states},)")
        return np.concatenate([checked_torques(self.law_name, u, self.robot, t), slopes])

    def __call__(self, t: float, x: Array) -> Array:
        """dx/dt."""
        self.evaluations += 1
        t = self.within(t)
        if self.law is not None:
            self._check_state(t, x)
        return self.rates(t, x, self.torque(t, x))

    def rates(self, t: float, x: Array, u: Array | None) -> Array:
        """dx/dt under given torques."""
        if self._state_function is not None:
            try:
                self._time[0] = t
                if u is None:
                    return self._state_function(self._time, x)
                return self._state_function(self._time, x, u)
            except NeedsRecursion:
                pass  # examined below, by the recursion
        self._check_state(t, x)
        try:
            rates, verdict = self.rhs.evaluate(self.robot.model, np.array([t]), x, u)
        except NotFiniteError as error:
            drives = None if self.rhs.law is None else self.rhs.drives(np.array([t]), x, None)[0]
            of_law = None if drives is None else _not_finite(np.asarray(drives, dtype=float), self.robot, t)
            raise of_law or NotFiniteError(f"{error} at t = {t:.6g} s", t) from None
        self.note_loss(verdict)
        return rates

    def all_rates(self, t: Array, X: Array, u: Array | None = None) -> Array:
        """dx/dt at many times, shapes (T,) and (T, size), for laws that are traced or torques that are given."""
        rates, verdict = self.kernel.evaluate(t[:, None], X, *(() if u is None else (u,)))
        self.note_loss(verdict)
        return rates

    @property
    def integrated(self) -> tuple[str, ...]:
        """The energies to integrate: the work of torques that are held is exact without."""
        return tuple(name for name in self.rhs.ledger if name != "drives" or self.held is None)

    def powers(self, t: Array, X: Array) -> Array:
        """Powers of the `integrated` at many times, shapes (T,) and (T, size); held torques have none among them."""
        u = None if self.held is None else np.zeros((len(t), self.robot.n))
        u = u if self.law is None else self.torques_at(t, X)
        try:
            found, _ = self.rhs.torques.kernel.evaluate(t[:, None], X, *(() if u is None else (u,)))
        except NotFiniteError as error:
            time = float(t[error.state])
            raise NotFiniteError(f"{error.args[0]} at t = {time:.6g} s", time) from None
        return found[:, -len(self.integrated) :]

    def drive_torques(self, t: Array, X: Array) -> Array | None:
        """Torques of the drives at many times, shape (T, n); None without drives."""
        return self.drives_under(t, X, None if self.law is None else self.torques_at(t, X))

    def drives_under(self, t: Array, X: Array, u: Array | None) -> Array | None:
        """Torques of the drives, within their limits, of a traced law or of torques `u`; None without drives."""
        if self.rhs.law is not None and self.rhs.friction is None:  # the kernel's net torques are the drives' then
            return self.rhs.torques.kernel(t[:, None], X)[:, : self.robot.n]
        drives, _ = self.rhs.drives(t[:, None], X, u)
        return None if drives is None else np.asarray(drives, dtype=np.float64)

    def torques_at(self, t: Array, X: Array) -> Array:
        """Torques of a called law at many times, and the rates of its states, shape (T, n + m)."""
        found = [self.torque(float(time), x) for time, x in zip(t, X, strict=True)]
        return np.array(found).reshape(len(t), -1)

    def _check_state(self, t: float, x: Array) -> None:
        if not isfinite(sum(x.tolist())) and not np.isfinite(x[: 2 * self.robot.n]).all():
            raise NotFiniteError(f"state is not finite at t = {t:.6g} s", t)

    def jacobian(self, t: float, x: Array) -> Array:
        """df/dx: dynamics, friction and traced laws exactly, called laws by forward differences.

        From M qdd + h - torques = 0: M dqdd = -d(M qdd + h - torques) at constant qdd. Counted as one evaluation per
        component of the state, the cost of differences.
        """
        self._check_state(t, x)
        self.evaluations += len(x)
        t, n, size = self.within(t), self.robot.n, len(x)
        u = self.torque(t, x)
        qdd = self.rates(t, x, u)[n : 2 * n]
        kernel = self.rhs.residual.slopes_in_time if self.is_compiled else self.rhs.residual.slopes
        slopes = kernel(np.array([t]), x, qdd, *(() if u is None else (u,)))
        by_x, M = slopes[:, :size], slopes[:n, size : size + n]
        if self.law is not None and u is not None:
            by_x = by_x + slopes[:, size + n :] @ self._law_slopes(t, x, u)
        accelerations = np.linalg.solve(M, -by_x[:n])
        return np.concatenate([np.eye(n, size, n), accelerations, by_x[n:]])

    def _law_slopes(self, t: float, x: Array, u: Array) -> Array:
        """Derivatives of a called law's torques and of the rates of its states, shape (n + m, size)."""
        slopes = np.zeros((len(u), len(x)))
        for j in range(len(x)):
            moved = x.copy()
            moved[j] += np.sqrt(np.finfo(float).eps) * max(abs(x[j]), 1.0)
            slopes[:, j] = (np.asarray(self.torque(t, moved)) - u) / (moved[j] - x[j])
        return slopes


def checked_torques(name: str, returned: Any, robot: Robot, t: float) -> Array:
    """What a law returned as an array of torques."""
    n = robot.n
    if type(returned) is np.ndarray and returned.dtype == np.float64 and returned.shape == (n,):
        tau = returned.copy()
        if isfinite(sum(tau.tolist())):
            return tau
    try:
        tau = np.asarray(returned)
    except ValueError:
        raise ValueError(f"`{name}` must return shape ({n},), got rows of unequal length at t = {t:.6g} s") from None
    if tau.dtype.kind not in "fiu":
        raise ValueError(f"`{name}` must return real numbers, got dtype {tau.dtype} at t = {t:.6g} s")
    if tau.shape != (n,):
        raise ValueError(f"`{name}` must return shape ({n},), got {tau.shape} at t = {t:.6g} s")
    error = _not_finite(tau, robot, t)
    if error is not None:
        raise error
    return tau.astype(np.float64)


def _not_finite(tau: Array, robot: Robot, t: float) -> NotFiniteError | None:
    """The error of torques that are not finite; None of those that are."""
    finite = np.isfinite(tau)
    if finite.all():
        return None
    i = int(np.argmin(finite))
    return NotFiniteError(f"torque of {robot.joint_names[i]!r} is {tau[i]} at t = {t:.6g} s", t)


class Samples(NamedTuple):
    """Samples of a controller: times (k,), states (k, 2 n), torques (k, n), and the controller's states (k, m)."""

    t: Array
    x: Array
    u: Array
    z: Array

    def held(self, t: Array, same: float = 0.0) -> Array:
        """Numbers of the samples whose torques are held at times, or a relative rounding of them later."""
        return np.searchsorted(self.t, t * (1 + same), side="right") - 1

    def work(self, q: Array, k: Array) -> Array:
        """Work of the drives since the start up to positions reached under the torques of samples k [J]."""
        start = self.x[:, : q.shape[1]]
        done = np.append(0.0, np.cumsum((self.u[:-1] * np.diff(start, axis=0)).sum(axis=1)))
        work: Array = done[k] + ((q - start[k]) * self.u[k]).sum(axis=1)
        return work


class ZeroOrderHold:
    """A controller that is sampled: the torques held since the last sample, and the controller's states.

    The states are integrated by Euler's rule from sample to sample.
    """

    def __init__(self, scene: Scene, plant: Plant) -> None:
        self.scene, self.plant = scene, plant
        self.period = float(scene.sample_time or 0.0)
        self.state = self.next_state = np.zeros(int(getattr(scene.controller, "states", 0)))  # at the last sample
        self.traced = scene.traced_samples  # the law, where it is traced
        none = np.zeros(0), np.zeros((0, 2 * scene.n)), np.zeros((0, scene.n)), np.zeros((0, len(self.state)))
        self.table = [Samples(*none)]
        self.count, self.evaluations_before = 0, 0  # samples, and evaluations before the last one
        self.limit, self.change = self.bounds()
        plant.law, plant.held = None, np.zeros(scene.n)  # the solver sees torques that are held

    def sample(self, t: float, x: Array) -> None:
        """Renew the torques that the plant holds, within the limits of torque and torque rate."""
        held, n = np.asarray(self.plant.held), self.scene.n
        self.state = self.next_state
        returned, rates = call_law(self.scene.controller, t, np.concatenate([x[: 2 * n], self.state]), n)
        if rates is not None:
            slopes = real_array("rates of the controller's states", rates, f"({len(self.state)},)")
            self.next_state = self.state + self.period * slopes
        u = np.clip(checked_torques(self.plant.law_name, returned, self.plant.robot, t), -self.limit, self.limit)
        if self.count:
            u = np.clip(u, held - self.change, held + self.change)
        self.plant.held = u
        if callable(getattr(self.scene.controller, "delivered", None)):
            self.scene.controller.delivered(u.copy())
        self._append(Samples(np.array([t]), x[None, : 2 * n], u[None], self.state[None]))
        self.evaluations_before = self.plant.evaluations

    def bounds(self) -> Array:
        """Bounds of the torques, and of their change from one sample to the next, shape (2, n)."""
        parts = self.scene.resolved
        limit, rate = (np.inf if bound is None else bound for bound in (parts.effort_limit, parts.torque_rate))
        return np.array([np.broadcast_to(bound, self.scene.n) for bound in (limit, rate * self.period)])

    def note(self, samples: tuple[Array, ...], states: Array, evaluations: int) -> None:
        """Samples were taken in machine code: with the controller's states at the last and the next one."""
        self._append(Samples(*samples))
        self.state, self.next_state = states
        self.plant.held, self.evaluations_before = samples[2][-1], evaluations

    def _append(self, samples: Samples) -> None:
        self.table.append(samples)
        self.count += len(samples.t)

    @property
    def next(self) -> float:
        """Time of the next sample."""
        return self.count * self.period

    def rewind(self, t: float) -> None:
        """What was sampled behind t is void."""
        if self.count and t < self.table[-1].t[-1]:
            samples = self.samples()
            k = self.count = int(np.searchsorted(samples.t, t, side="right"))
            self.next_state, self.state, self.plant.held = samples.z[k], samples.z[k - 1], samples.u[k - 1]
            self.table = [Samples(*(part[:k] for part in samples))]

    def finish(self, t: float, x: Array) -> None:
        """The run ends at t: what was sampled behind it is void, and what follows a sample there counts."""
        self.rewind(t)
        if t >= self.next:
            u = np.asarray(self.plant.held)
            self.table.append(Samples(np.array([t]), x[None], u[None], self.next_state[None]))

    def samples(self) -> Samples:
        """All samples so far."""
        if len(self.table) > 1:
            self.table = [Samples(*(np.concatenate(parts) for parts in zip(*self.table, strict=True)))]
        return self.table[0]

    def stability(self) -> str:
        """What check_gains says of the controller, for the error of a loop that diverges."""
        gains = [getattr(self.scene.controller, name, None) for name in ("kp", "kd")]
        try:
            limit = check_gains(self.scene.resolved.robot, *gains).sample_time_limit  # type: ignore[arg-type]
        except (ValueError, TypeError):
            return "see rne.check_gains for the sample time that its gains need"
        return f"by rne.check_gains it is stable up to {limit:.4g} s, and sampled every {self.period:g} s"


class ModeChange:
    """As an event: a slipping joint comes to rest, or the load of a sticking one exceeds its static friction."""

    def __init__(self, dry: DryPlant, joint: int) -> None:
        self.dry, self.joint, self.mode = dry, joint, float(dry.mode[joint])
        self.offset = AT_REST * dry.fastest  # a joint that just started from rest has not come to rest

    def __call__(self, t: Array, X: Array, u: Array | None) -> Array:
        if self.mode:
            return -self.mode * X[:, self.dry.n + self.joint] - self.offset
        return -self.dry.margins(t, X, u)[:, self.joint]


class DryPlant(System):
    """The equations of motion for given modes of the joints: +1 and -1 slip, 0 sticks.

    A sticking joint stays at rest; see `RatesUnderModes` for what stands in its place in the state.
    """

    jacobian = None  # the modes change between two steps

    def __init__(self, plant: Plant, friction: Friction) -> None:
        n = plant.robot.n
        self.plant, self.friction, self.n = plant, friction, n
        self.smooth, self.loaded = Plant(plant.rhs.under_modes, None), Plant(plant.rhs.loads, None)
        self.kernel = self.smooth.kernel
        self.is_compiled = plant.law is None and self.smooth.is_compiled
        self.coulomb = np.full(n, friction.coulomb, dtype=float), np.full(n, friction.coulomb_back, dtype=float)
        self.statics = self.coulomb if friction.static is None else (np.full(n, friction.static, dtype=float),) * 2
        self.mode, self.has_changed = np.full(n, -2), True  # no modes yet
        self.modes: dict[bytes, Array] = {}  # as the equations take them
        self.frictionless = np.maximum(*self.statics) == 0  # without friction, never sticks
        self.events: Sequence[Event] = ()
        self.fastest = 0.0  # largest rate so far [rad/s or m/s]
        self.changes, self.begun, self.at_once = 0, -np.inf, 0
        self.samples: Callable[[], Samples] | None = None  # where they are taken between two steps
        self.overloaded: list[int] = []  # joints that broke away in the event that just happened
        self.asked, self.last_margins = np.zeros((0, n)), np.zeros((0, n))

    @property
    def evaluations(self) -> int:
        """Calls of the right-hand side, which are the plant's."""
        return self.plant.evaluations

    @evaluations.setter
    def evaluations(self, count: int) -> None:
        self.plant.evaluations = count

    @property
    def counted(self) -> int:
        """Number of the states whose errors count."""
        return self.smooth.counted

    @property
    def held(self) -> Array:
        """What the equations take beside time and state: torques that are held, and the modes."""
        return self._with_modes(self.plant.held)

    def _with_modes(self, u: Array | None) -> Array:
        """Torques, if there are any, and the modes behind them."""
        modes = self.modes.get(key := self.mode.tobytes())
        if modes is None:
            slips, (forward, back) = self.mode != 0, self.coulomb
            self.modes[key] = modes = np.concatenate([slips, np.where(self.mode > 0, forward, -back) * slips])
        if u is None:
            return modes
        modes = modes if u.ndim == 1 else np.broadcast_to(modes, (len(u), len(modes)))
        return np.concatenate([u, modes], axis=-1)

    def begin(self, t: float, x: Array, span: tuple[float, float]) -> None:
        """Settle the modes, just after t; further on if the torques jump here without being declared."""
        same = SAME_INSTANT * max(abs(t), abs(span[1] - t))
        self.at_once = self.at_once + 1 if self.changes and t - self.begun <= same else 0
        if self.at_once > MAX_AT_ONE_TIME:
            raise NotFiniteError(f"sticking and slipping alternate without end at t = {t:.6g} s", t)
        self.begun = t
        self.span = (t + self.at_once * same if self.at_once else span[0], span[1])
        before = self.mode
        self.settle(t, x, self.overloaded)
        self.overloaded = []
        self.has_changed = not np.array_equal(before, self.mode)
        self.at_rest = self.n + np.flatnonzero(self.mode == 0)
        self.note = f"{self.changes} changes between sticking and slipping"
        self.events = [ModeChange(self, i) for i in np.flatnonzero(~self.frictionless).tolist()]

    def after(self, event: Event, x: Array) -> Array:
        """The state after an event: a rate that passes through zero is zero."""
        x = self.reported(x)
        if isinstance(event, ModeChange):
            self.changes += 1
            x[self.n + event.joint] = 0.0
            self.overloaded = [] if event.mode else [event.joint]
        return x

    def longest_step(self, duration: float) -> float:
        """While nothing moves, steps short enough to see loads that come and go."""
        return np.inf if self.mode.any() else duration / STUCK_STEPS

    def reported(self, x: Array) -> Array:
        """The state with the rates of sticking joints at zero."""
        x = np.array(x)
        x[self.n : 2 * self.n] *= self.mode != 0
        return x

    def accelerations_at(self, t: Array, X: Array, same: float) -> Array:
        """Accelerations under the present modes."""
        samples = None if self.samples is None else self.samples()
        qdd, _, _ = self.loads_at(t, X, None if samples is None else samples.u[samples.held(t, same)])
        return np.asarray(qdd)

    def inputs(self, t: float, x: Array) -> Array:
        """The torques, held or those that a law returns, and the modes."""
        return self._with_modes(self.plant.torque(t, self.reported(x)))

    def loads(self, t: float, x: Array, u: Array | None = None) -> Array:
        """Accelerations, dry friction or the loads of sticking joints, net torques without dry friction, shape (3, n).

        Under the torques that are held or returned by a law, or others.
        """
        t = self.within(t)
        inputs = self.inputs(t, x) if u is None else self._with_modes(u)
        return np.reshape(self.loaded.rates(t, x, inputs), (3, self.n))

    def loads_at(self, t: Array, X: Array, u: Array | None = None) -> Array:
        """The same in many states, shape (3, T, n)."""
        if self.plant.law is None and len(t) > 1:
            try:
                inputs = self._with_modes(self.plant.held if u is None else u)
                found = self.loaded.all_rates(np.clip(t, *self.span), X, inputs)
                return np.stack(np.split(found, 3, axis=1))
            except (NotFiniteError, SingularMassMatrixError):
                pass  # found by looking at each
        each = [None] * len(t) if u is None else u
        return np.stack([self.loads(*state) for state in zip(t.tolist(), X, each, strict=True)], axis=1)

    def settle(self, t: float, x: Array, overloaded: list[int]) -> None:
        """Set the modes of the joints from their rates, and of those at rest from their loads.

        Every joint at rest either resists its load or starts in the direction in which it is then accelerated. With
        static friction equal to Coulomb friction exactly one such set of modes exists, since M is positive definite;
        repeatedly changing the first inconsistent joint finds it (Murty's rule for linear complementarity problems).
        With more static friction there may be several: as few joints as possible break away, and of those that stuck
        before as few as possible.
        """
        qd = x[self.n : 2 * self.n]
        self.fastest = max(self.fastest, float(np.abs(qd).max(initial=0.0)))
        rests = (np.abs(qd) <= AT_REST * self.fastest) & ~self.frictionless
        stuck = rests & (self.mode == 0)
        self.mode = np.where(rests, 0, np.sign(qd)).astype(int)
        self.mode[self.frictionless] = np.where(qd[self.frictionless] < 0, -1, 1)
        for k in overloaded:  # the event that just occurred, whose margin rounding may place on either side of zero
            self.mode[k] = int(np.sign(self.loads(t, x)[1][k]))
        if self.friction.static is not None and self._wrong(t, x, rests).any():
            held = rests & (self.mode == 0)
            order = [*np.flatnonzero(held & ~stuck).tolist(), *np.flatnonzero(held & stuck).tolist()]
            if self._release_fewest(t, x, rests, order):
                return
        for _ in range(MAX_MODE_CHANGES):
            wrong = np.flatnonzero(self._wrong(t, x, rests))
            if not len(wrong):
                return
            k = int(wrong[0])
            self.mode[k] = 0 if self.mode[k] else int(np.sign(self.loads(t, x)[1][k]))
        raise NotFiniteError(f"no modes of sticking and slipping fit the loads at t = {t:.6g} s", t)

    def _wrong(self, t: float, x: Array, rests: Array) -> Array:
        """The joints at rest that stick under too great a load, or slip against their acceleration."""
        qdd, needed, net = self.loads(t, x)
        breaks = rests & (self.mode == 0) & (self._margin(needed, net) < 0)
        turns = rests & (qdd * self.mode < -ROUNDING * np.abs(qdd).max(initial=0.0))
        return np.asarray(breaks | turns)

    def _release_fewest(self, t: float, x: Array, rests: Array, order: list[int]) -> bool:
        """Let one joint of `order` slip, then two, ... until all fit, those that come first in it before others."""
        before = self.mode.copy()
        trials = (
            (joints, signs)
            for count in range(1, len(order) + 1)
            for joints in itertools.combinations(order, count)
            for signs in itertools.product((1, -1), repeat=count)
        )
        for joints, signs in itertools.islice(trials, MAX_MODE_CHANGES):
            self.mode = before.copy()
            self.mode[list(joints)] = signs
            if not self._wrong(t, x, rests).any():
                return True
        self.mode = before
        return False

    def margins(self, t: Array, X: Array, u: Array | None) -> Array:
        """Static friction of each joint minus its load, in many states; those last asked for are kept."""
        if X is not self.asked:
            _, loads, net = self.loads_at(t, X, u)
            self.asked, self.last_margins = X, self._margin(loads, net)
        return self.last_margins

    def _margin(self, loads: Array, net: Array) -> Array:
        """Static friction of each joint minus its load; a load equal to the static friction is still held."""
        largest = np.abs(net).max(axis=-1, keepdims=True, initial=0.0)
        statics = np.where(loads > 0, *self.statics)
        margin: Array = statics * (1 + ROUNDING) + ROUNDING * largest - np.abs(loads)
        return margin

    def __call__(self, t: float, x: Array) -> Array:
        """dx/dt, with the rates of sticking joints at zero."""
        self.evaluations += 1
        t = self.within(t)
        return self.rates(t, x, self.inputs(t, x))

    def rates(self, t: float, x: Array, u: Array) -> Array:
        """dx/dt under given torques and modes."""
        return self.smooth.rates(t, x, u)
