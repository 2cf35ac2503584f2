"""Dry friction: every joint slips forwards, slips backwards or sticks, and events lead from one to another.

A sticking joint is held at rest by any torque up to its static friction; a slipping joint is resisted by its Coulomb
friction, and sticks or reverses when its rate passes through zero.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import ArrayLike

from ..basics.spatial import Array
from ..errors import NotFiniteError, SingularMassMatrixError
from .events import Event
from .friction import Friction
from .plant import Plant, System
from .sampled import Samples

MAX_MODE_CHANGES, MAX_AT_ONE_TIME = 1000, 20
AT_REST = 1e-12  # of the largest rate so far: rates below it count as zero
# Steps of a robot all of whose joints stick; with the points at which events are examined inside a step, loads of a
# duration above 1/1000 of the run's are found.
STUCK_STEPS = 100
SAME_INSTANT = 1e-12  # of the time: events closer than this are simultaneous
ROUNDING = 1e-9  # of the largest load or acceleration: closer to the limit a load is held, closer to 0 there is no sign


class Rest:
    """A slipping joint comes to rest."""

    def __init__(self, joint: int, place: int, sign: float, scale: float) -> None:
        self.joint, self.place, self.sign = joint, place, sign
        self.offset = AT_REST * scale  # a joint that just started from rest has not come to rest

    def __call__(self, t: Array, X: Array, u: Array | None) -> Array:
        return -self.sign * X[:, self.place] - self.offset


class Overload:
    """The load of a sticking joint exceeds its static friction."""

    def __init__(self, dry: DryPlant, joint: int) -> None:
        self.dry, self.joint = dry, joint

    def __call__(self, t: Array, X: Array, u: Array | None) -> Array:
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
        self.forward, self.back = _per_joint(friction.coulomb, n), _per_joint(friction.coulomb_back, n)
        held = friction.static
        self.statics = (self.forward, self.back) if held is None else (_per_joint(held, n),) * 2
        self.mode, self.has_changed = np.full(n, -2), True  # no modes yet
        self.modes: dict[bytes, Array] = {}  # as the equations take them
        self.frictionless = np.maximum(*self.statics) == 0  # without friction, never sticks
        self.span = (-np.inf, np.inf)
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
    def held(self) -> Array:
        """What the equations take beside time and state: torques that are held, and the modes."""
        modes = self.modes.get(key := self.mode.tobytes())
        if modes is None:
            slips = self.mode != 0
            self.modes[key] = modes = np.concatenate([slips, np.where(self.mode > 0, self.forward, -self.back) * slips])
        return modes if self.plant.held is None else np.concatenate([self.plant.held, modes])

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
        moving = [i for i in range(self.n) if not self.frictionless[i]]
        self.events = [self._event(i) for i in moving]

    def _event(self, i: int) -> Event:
        return Rest(i, self.n + i, float(self.mode[i]), self.fastest) if self.mode[i] else Overload(self, i)

    def after(self, event: Event, x: Array) -> Array:
        """The state after an event: a rate that passes through zero is zero."""
        x = self.reported(x)
        if isinstance(event, Rest | Overload):
            self.changes += 1
            x[self.n + event.joint] = 0.0
            self.overloaded = [event.joint] if isinstance(event, Overload) else []
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
        if self.samples is None:
            return self.loads_at(t, X)[0]
        samples = self.samples()
        return self.loads_at(t, X, samples.u[samples.held(t, same)])[0]

    def inputs(self, t: float, x: Array) -> Array:
        """`held`, or the torques that a law returns and the modes."""
        u = None if self.plant.law is None else self.plant.torque(t, self.reported(x))
        return self.held if u is None else np.concatenate([u, self.held])

    def loads(self, t: float, x: Array, u: Array | None = None) -> tuple[Array, ...]:
        """Accelerations, dry friction or the loads of sticking joints, net torques without dry friction.

        Under the torques that are held, or others.
        """
        t = min(max(t, self.span[0]), self.span[1])
        inputs = self.inputs(t, x) if u is None else np.concatenate([u, self.held[self.n :]])
        return self._parts(self.loaded.rates(t, x, inputs))

    def loads_at(self, t: Array, X: Array, u: Array | None = None) -> tuple[Array, ...]:
        """The same in many states, shape (T, n) each."""
        if self.plant.law is None and len(t) > 1:
            held = self.held
            if u is not None:
                held = np.concatenate([u, np.broadcast_to(held[self.n :], (len(u), 2 * self.n))], axis=1)
            try:
                return self._parts(self.loaded.all_rates(np.clip(t, *self.span), X, held))
            except (NotFiniteError, SingularMassMatrixError):
                pass  # found by looking at each
        each = [None] * len(t) if u is None else u
        found = [np.concatenate(self.loads(*state)) for state in zip(t.tolist(), X, each, strict=True)]
        return self._parts(np.array(found))

    def _parts(self, found: Array) -> tuple[Array, ...]:
        n = self.n
        return found[..., :n], found[..., n : 2 * n], found[..., 2 * n :]

    def static(self, direction: Array) -> Array:
        """Static friction of each joint against a load in the given direction."""
        return np.where(direction > 0, *self.statics)

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
        wrong: Array = breaks | turns
        return wrong

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
        margin: Array = self.static(loads) * (1 + ROUNDING) + ROUNDING * largest - np.abs(loads)
        return margin

    def __call__(self, t: float, x: Array) -> Array:
        """dx/dt, with the rates of sticking joints at zero."""
        self.evaluations += 1
        t = min(max(t, self.span[0]), self.span[1])
        return self.rates(t, x, self.inputs(t, x))

    def rates(self, t: float, x: Array, u: Array) -> Array:
        """dx/dt under given torques and modes."""
        return self.smooth.rates(t, x, u)


def _per_joint(size: ArrayLike | None, n: int) -> Array:
    return np.broadcast_to(np.asarray(size, dtype=float), (n,))
