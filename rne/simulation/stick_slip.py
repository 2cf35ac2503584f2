"""Dry friction: every joint slips forwards, slips backwards or sticks, and events lead from one to another.

A sticking joint is held at rest by any torque up to its static friction; a slipping joint is resisted by its Coulomb
friction, and sticks or reverses when its rate passes through zero.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from typing import Any

import numpy as np

from ..basics.spatial import Array
from ..dynamics.precision import SINGULAR, pivots_below, singular_error
from ..errors import NotFiniteError
from .events import Event
from .friction import Friction
from .plant import Plant
from .system import SmoothSystem

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

    def __call__(self, t: Array, X: Array) -> Array:
        return -self.sign * X[:, self.place] - self.offset


class Overload:
    """The load of a sticking joint exceeds its static friction."""

    def __init__(self, dry: DryPlant, joint: int) -> None:
        self.dry, self.joint = dry, joint

    def __call__(self, t: Array, X: Array) -> Array:
        return -self.dry.margins(t, X)[:, self.joint]


class DryPlant(SmoothSystem):
    """The equations of motion for given modes of the joints: +1 and -1 slip, 0 sticks.

    A sticking joint stays at rest. In its place in the state the solver integrates the rate that its load would give
    it if nothing held it, so that the error control follows loads that change while a joint sticks.
    """

    jacobian = None  # the modes change between two steps

    def __init__(self, plant: Plant, friction: Friction) -> None:
        n = plant.robot.n
        self.plant, self.friction, self.n = plant, friction, n
        self.forward = np.broadcast_to(np.asarray(friction.coulomb, dtype=float), (n,))
        self.back = np.broadcast_to(np.asarray(friction.coulomb_back, dtype=float), (n,))
        self.mode, self.has_changed = np.full(n, -2), True  # no modes yet
        self.frictionless = (
            np.maximum(self.static(np.ones(n)), self.static(-np.ones(n))) == 0
        )  # without friction, never sticks
        self.span = (-np.inf, np.inf)
        self.events: Sequence[Event] = ()
        self.fastest = 0.0  # largest rate so far [rad/s or m/s]
        self.largest_load = 0.0  # of any joint, when loads were last evaluated [N m or N]
        self.changes, self.begun, self.at_once = 0, -np.inf, 0
        self.overloaded: list[int] = []  # joints that broke away in the event that just happened
        self.last_key: Any = None
        self.asked, self.last_margins = np.zeros((0, n)), np.zeros((0, n))
        self.last_accelerations = (np.zeros(n), np.zeros(n), np.zeros(n), np.ones(n))

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

    def accelerations_at(self, t: Array, X: Array) -> Array:
        """Accelerations under the present modes."""
        return np.array([self.accelerations(time, x)[0] for time, x in zip(t.tolist(), X, strict=True)])

    def loads(self, t: float, x: Array) -> tuple[Array, Array, Array]:
        """M, the net torque without dry friction, and the rates of the controller's states, inside the segment."""
        t = min(max(t, self.span[0]), self.span[1])
        n, robot, rhs = self.n, self.plant.robot, self.plant.rhs
        q, qd = x[:n], x[n : 2 * n]
        u, rates = rhs.drives(np.array([t]), x, self.plant.torque(t, x))
        net = -robot.bias_torque(q, qd) - np.asarray(self.friction.viscous_torque(qd))
        if u is not None:
            net = net + np.asarray(u)
        self.largest_load = float(np.abs(net).max(initial=0.0))
        return robot.mass_matrix(q), net, np.zeros(0) if rates is None else np.asarray(rates)

    def accelerations(self, t: float, x: Array) -> tuple[Array, Array, Array, Array]:
        """Accelerations, dry friction torques, rates of the controller's states, diagonal of M; the last is kept."""
        key = t, x.tobytes(), self.mode.tobytes(), self.span
        if key != self.last_key:  # the events of all sticking joints ask for it at the same instant
            self.last_accelerations, self.last_key = self._accelerations(t, self.reported(x)), key
        return self.last_accelerations

    def _accelerations(self, t: float, x: Array) -> tuple[Array, Array, Array, Array]:
        M, net, rates = self.loads(t, x)
        slips = self.mode != 0
        dry = np.where(self.mode > 0, self.forward, -self.back) * slips
        qdd = np.zeros(self.n)
        if slips.any():
            qdd[slips] = self._accelerated(M, net - dry, slips)
        needed = net - M @ qdd
        return qdd, np.where(slips, dry, needed), rates, np.diagonal(M)

    def _accelerated(self, M: Array, torque: Array, slips: Array) -> Array:
        """Accelerations of the slipping joints, the others at rest; an error that names joints if M is singular.

        Cholesky's factors from the tips inwards: the order that loses no digits of a light tip.
        """
        from scipy.linalg.lapack import dpotrf, dpotrs

        part = M[slips][:, slips][::-1, ::-1]
        factor, failed = dpotrf(part, lower=1)
        if failed or pivots_below(SINGULAR, factor.diagonal() ** 2, part.diagonal()).any():
            raise singular_error(self.plant.robot.model, M, ())
        solution: Array = dpotrs(factor, torque[slips][::-1], lower=1)[0][::-1]
        return solution

    def static(self, direction: Array) -> Array:
        """Static friction of each joint against a load in the given direction."""
        if self.friction.static is not None:
            return np.broadcast_to(np.asarray(self.friction.static, dtype=float), (self.n,))
        return np.where(direction > 0, self.forward, self.back)

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
            self.mode[k] = int(np.sign(self.accelerations(t, x)[1][k]))
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
            self.mode[k] = 0 if self.mode[k] else int(np.sign(self.accelerations(t, x)[1][k]))
        raise NotFiniteError(f"no modes of sticking and slipping fit the loads at t = {t:.6g} s", t)

    def _wrong(self, t: float, x: Array, rests: Array) -> Array:
        """The joints at rest that stick under too great a load, or slip against their acceleration."""
        qdd, needed, *_ = self.accelerations(t, x)
        breaks = rests & (self.mode == 0) & (self._margin(needed) < 0)
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

    def margins(self, t: Array, X: Array) -> Array:
        """Static friction of each joint minus its load, in many states; those last asked for are kept."""
        if X is not self.asked:
            found = [self._margin(self.accelerations(time, x)[1]) for time, x in zip(t.tolist(), X, strict=True)]
            self.asked, self.last_margins = X, np.array(found)
        return self.last_margins

    def _margin(self, needed: Array) -> Array:
        """Static friction of each joint minus its load; a load equal to the static friction is still held."""
        margin: Array = self.static(needed) * (1 + ROUNDING) + ROUNDING * self.largest_load - np.abs(needed)
        return margin

    def __call__(self, t: float, x: Array) -> Array:
        """dx/dt, with the rates of sticking joints at zero."""
        self.plant.evaluations += 1
        n = self.n
        qdd, dry, rates, inertia = self.accelerations(t, x)
        sticks = self.mode == 0
        return np.concatenate([x[n : 2 * n] * ~sticks, np.where(sticks, dry / inertia, qdd), rates])
