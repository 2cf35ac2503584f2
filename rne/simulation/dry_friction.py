"""Dry friction: every joint slips forwards, slips backwards or sticks, and events lead from one to another.

A sticking joint is held at rest by any torque up to its static friction; a slipping joint is resisted by its Coulomb
friction, and sticks or reverses when its rate passes through zero.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable
from typing import Any

import numpy as np

from ..basics.spatial import Array
from ..errors import NotFiniteError
from ..robot import Robot
from .events import Event
from .plant import Plant, with_modes
from .scene_dynamics import SceneDynamics

MAX_MODE_CHANGES, MAX_AT_ONE_TIME = 1000, 20
AT_REST = 1e-12  # rate that counts as zero, relative to the largest so far
# Steps of a robot all of whose joints stick; with the points at which events are examined inside a step, loads of a
# duration above 1/1000 of the run's are found.
STUCK_STEPS = 100
SAME_INSTANT = 1e-12  # relative time difference below which events are simultaneous
ROUNDING = 1e-9  # rounding of loads and accelerations, relative to the largest


class ModeChange:
    """Event: a slipping joint comes to rest, or the load of a sticking one exceeds its static friction."""

    def __init__(self, dry: DryPlant, joint: int) -> None:
        self.dry, self.joint, self.mode = dry, joint, float(dry.mode[joint])
        self.offset = AT_REST * dry.fastest  # a joint that just started from rest has not come to rest

    def __call__(self, t: Array, X: Array, u: Array | None) -> Array:
        if self.mode:
            return -self.mode * X[:, self.dry.n + self.joint] - self.offset
        return -self.dry.margins(t, X, u)[:, self.joint]


class DryPlant(Plant):
    """The equations of motion for given modes of the joints: +1 and -1 slip, 0 sticks.

    A sticking joint stays at rest; `SceneDynamics.right_hand_side_under_modes_core` says what its entry of the state
    holds instead. The modes follow the torques in the inputs of the equations.
    """

    def __init__(
        self, dynamics: SceneDynamics, robot: Robot, law: Callable[..., Any] | None = None, *more: Any
    ) -> None:
        super().__init__(dynamics, robot, law, *more)
        assert dynamics.friction is not None
        self.friction = friction = dynamics.friction
        self.n = n = dynamics.n
        self._parts = dynamics.size, dynamics.size + n  # of what the kernel gives: rates, loads and net torques
        self.width = dynamics.size + 2 * n
        self.coulomb = self._of_drives(friction.coulomb), self._of_drives(friction.coulomb_back)
        self.statics = self.coulomb if friction.static is None else (self._of_drives(friction.static),) * 2
        self.mode, self.has_changed = np.full(n, -2), True  # no modes yet
        self.known_modes: dict[bytes, Array] = {}  # by the bytes of `mode`
        self.frictionless = np.maximum(*self.statics) == 0  # without friction, never sticks
        self.fastest = 0.0  # largest rate so far [rad/s or m/s]
        self.changes, self.begun, self.at_once = 0, -np.inf, 0
        self.overloaded: list[int] = []  # joints that broke away in the event that just happened
        self.asked, self.last_margins = np.zeros((0, n)), np.zeros((0, n))

    def _of_drives(self, values: Any) -> Array:
        """Values of the drives as an array over all coordinates, zero for the others."""
        found = np.zeros(self.n)
        found[self.dynamics.driven] = values
        return found

    @property
    def _function(self) -> Any:
        return self.dynamics.right_hand_side_under_modes

    def jacobian(self, t: float, x: Array) -> Array:
        """df/dx in the present modes, by finite differences."""
        return super().linearised(t, x)

    def linearised(self, t: float, x: Array) -> Array:
        """df/dx with all joints slipping, for the choice of a method."""
        before, self.mode = self.mode, np.ones_like(self.mode)
        try:
            return super().linearised(t, x)
        finally:
            self.mode = before

    @property
    def modes(self) -> Array:  # type: ignore[override]
        """Inputs of the equations: 1 for each joint that slips, and its dry friction torque."""
        modes = self.known_modes.get(key := self.mode.tobytes())
        if modes is None:
            slips, (forward, back) = self.mode != 0, self.coulomb
            self.known_modes[key] = modes = np.concatenate([slips, np.where(self.mode > 0, forward, -back) * slips])
        return modes

    def begin(self, t: float, x: Array, span: tuple[float, float]) -> None:
        """Settle the modes just after t; later if the torques jump here without a declared break."""
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
        self.note = f"{self.changes} changes between sticking and slipping"
        self.events = [ModeChange(self, i) for i in np.flatnonzero(~self.frictionless).tolist()]

    def apply_event(self, event: Event, x: Array) -> Array:
        """State after an event: a rate that passes through zero is set to zero."""
        x = self.reported(x)
        if isinstance(event, ModeChange):
            self.changes += 1
            x[self.n + event.joint] = 0.0
            self.overloaded = [] if event.mode else [event.joint]
        return x

    def longest_step(self, duration: float) -> float:
        """Longest step: short enough to detect varying loads while no joint moves."""
        return np.inf if self.mode[self.dynamics.driven].any() else duration / STUCK_STEPS

    def reported(self, x: Array) -> Array:
        """State with the rates of sticking joints set to zero."""
        x = np.array(x)
        x[..., self.n : 2 * self.n][..., self.mode == 0] = 0.0
        return x

    def loads(self, t: float, x: Array) -> tuple[Array, Array, Array]:
        """Accelerations, dry friction or the loads of sticking joints, and net torques without dry friction, (n,) each.

        Under the torques that are held or returned by a law.
        """
        t = self.within(t)
        found, loads, net = np.split(self.outputs(t, x, self.inputs(t, x)), self._parts)
        return np.where(self.mode == 0, 0.0, found[self.n : 2 * self.n]), loads, net

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
            self._release_fewest(t, x, rests, order)
        if not rests.any():
            return
        for _ in range(MAX_MODE_CHANGES):
            wrong = np.flatnonzero(self._wrong(t, x, rests))
            if not len(wrong):
                return
            k = int(wrong[0])
            self.mode[k] = 0 if self.mode[k] else int(np.sign(self.loads(t, x)[1][k]))
        raise NotFiniteError(f"no modes of sticking and slipping fit the loads at t = {t:.6g} s", t)

    def _wrong(self, t: float, x: Array, rests: Array) -> Array:
        """Joints at rest whose mode is wrong: they stick under too great a load, or slip against their acceleration."""
        qdd, needed, net = self.loads(t, x)
        breaks = rests & (self.mode == 0) & (self._margin(needed, net) < 0)
        turns = rests & (qdd * self.mode < -ROUNDING * np.abs(qdd).max(initial=0.0))
        return np.asarray(breaks | turns)

    def _release_fewest(self, t: float, x: Array, rests: Array, order: list[int]) -> None:
        """Release joints in the order given, one, then two, ..., until all modes are consistent."""
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
                return
        self.mode = before

    def margins(self, t: Array, X: Array, u: Array | None) -> Array:
        """Static friction of each joint minus its load, in many states; those last asked for are kept."""
        if X is not self.asked:
            t = np.clip(t, *self.span)
            if u is None:
                u = self.torques_at(t, self.reported(X)) if self.law is not None else self.sampled
            u = None if u is None else np.broadcast_to(u, (len(t), u.shape[-1]))
            inputs = with_modes(u, np.repeat(self.modes[None], len(t), axis=0))
            _, loads, net = np.split(self.all_outputs(t, X, inputs), self._parts, axis=-1)
            self.asked, self.last_margins = X, self._margin(loads, net)
        return self.last_margins

    def _margin(self, loads: Array, net: Array) -> Array:
        """Static friction of each joint minus its load; a load equal to the static friction is still held."""
        largest = np.abs(net).max(axis=-1, keepdims=True, initial=0.0)
        statics = np.where(loads > 0, *self.statics)
        margin: Array = statics * (1 + ROUNDING) + ROUNDING * largest - np.abs(loads)
        return margin
