"""Stability of a scene's closed loop near a target by linearisation, in continuous time or with held torques."""

from __future__ import annotations

import warnings
from contextlib import suppress
from dataclasses import replace
from typing import Any

import numpy as np

from ..basics.spatial import Array
from ..control.feedback_loop import FeedbackLoop, LinearisedLoop, end_of_stability
from ..control.traced_law import LawInputs, call_law, is_discrete
from ..kernels.trace import AGREEMENT
from ..robot import Robot
from .plant import Plant, own_copy, with_own_law
from .scene_dynamics import SceneDynamics

AT_REST = 1e-6  # negligible accelerations at the target, relative to those by only the torques
NEAR, LATER = 1e-2, 1e-3  # distances from the target and time [s] for tests of a law's memory
CALLS = 64  # calls after which the memory of a law, such as a delay, is filled
BESIDE, JUMP = 1e-6, 1e-3  # distance from the target; relative change of derivatives that is a kink


class WithRates:
    """Discrete law that returns rates of its states, from which Euler's rule over a sample gives its next states."""

    def __init__(self, law: Any, period: float) -> None:
        self.law, self.period, self.states = law, period, int(law.states)
        self.traceable = getattr(law, "traceable", False)

    def __call__(self, t: Any, q: Array, qd: Array, z: Array) -> tuple[Any, Any]:
        """(torques, dz/dt)."""
        n = q.shape[-1]
        torques, following = call_law(self.law, t, np.concatenate([q, qd, z], axis=-1), LawInputs(0, n, n))
        return torques, (np.asarray(following) - z) / self.period


def linearised_loop(scene: Any, q: Array) -> LinearisedLoop:
    """Loop of a scene with a controller, at rest in q with the controller's states zero."""
    law = WithRates(scene.controller, scene.sample_time) if is_discrete(scene.controller) else scene.controller
    free = with_own_law(replace(scene, controller=law, sample_time=None, torque_rate=None, delay=None))
    dynamics, (first, last, n) = free.dynamics, free.dynamics.law_inputs
    seen = _at_rest(dynamics, free.resolved.robot, q)[first:last]
    if dynamics.law is None:
        law = without_memory(free.controller, seen, scene.sample_time or LATER)
        free = free if law is free.controller else replace(free, controller=law)
    refuse_jump(free.controller, seen)
    closed, rates = _stability_matrix(free, q)
    torque = _torques(free.controller, 0.0, seen, 0 * seen)
    alone = scene.resolved.robot.forward_dynamics(q, 0 * q, np.abs(torque))
    is_rest = bool(np.abs(rates[n : 2 * n]).max(initial=0.0) <= AT_REST * (np.abs(alone).max(initial=0.0) + 1.0))
    opened, _ = _slopes(replace(free, controller=lambda t, q, qd: torque), q)
    used, driven = _read(closed, 2 * n), np.arange(2 * n)[n:][dynamics.driven]
    closed = closed[:, used]
    A, B = opened[: 2 * n, : 2 * n], np.eye(2 * n)[:, driven]
    F = closed[driven]
    F[:, : 2 * n] -= A[driven]
    loop = FeedbackLoop(A, B, F, closed[used[2 * n :]], scene.sample_time, scene.delay or 0.0)
    windows, friction = loop.windows, scene.resolved.friction
    is_smoothed = friction is not None and bool(np.any(friction.coulomb) or np.any(friction.load))
    is_of_link = getattr(scene.controller, "posture", True) is None
    return LinearisedLoop(
        loop, windows, end_of_stability(windows), scene.sample_time, loop.is_stable, is_rest, is_smoothed, is_of_link,
        is_discrete=len(loop.R) > 0 and is_discrete(scene.controller),
    )  # fmt: skip


def _stability_matrix(scene: Any, q: Array) -> tuple[Array, Array]:
    """Derivatives of the state's rates at rest in q, of the least stable side of a kink, and the rates."""
    closed, rates = _slopes(scene, q)
    sides = [closed, *(_slopes(scene, q, beside=by)[0] for by in (BESIDE, -BESIDE))]
    jumps = [np.abs(side - closed).max(initial=0.0) > JUMP * np.abs(closed).max(initial=0.0) for side in sides]
    if any(jumps):
        closed = max(sides, key=lambda side: np.linalg.eigvals(side).real.max())
    return closed, rates


def _torques(law: Any, t: float, q: Array, qd: Array) -> Array:
    """Torques of a law with its states zero."""
    x = np.concatenate([q, qd, np.zeros(int(getattr(law, "states", 0)))])
    return np.asarray(call_law(law, t, x, LawInputs(0, len(q), len(q)))[0], dtype=float)


def without_memory(law: Any, q: Array, period: float) -> Any:
    """Law itself if it has no memory; otherwise, with a warning, a law with its torques in steady motion.

    These are what it returns after samples at constant velocity that lead to the state. A ValueError if it has noise.
    """

    def settled(t: float, q: Array, qd: Array, *z: Array) -> Any:
        own = own_copy(law)
        return [own(k * period, q - (CALLS - k) * period * qd, qd, *z) for k in range(CALLS + 1)][-1]

    found, own = list[Array](), own_copy(law)
    for near in (NEAR, -NEAR):
        with suppress(Exception):  # of a law that is defined only at the target or over the time of its reference
            _torques(own, 0.0, q, 0 * q)  # where a law with memory begins anew
            for k in range(1, CALLS):
                _torques(own, k * period, q + near, near + 0 * q)
            found.append(_torques(own, CALLS * period, q, 0 * q))
    if not (memory := _difference(found)):
        return law
    if hasattr(law, "states"):
        settled.states = law.states  # type: ignore[attr-defined]
    if noise := _difference([_torques(settled, 0.0, q, 0 * q) for _ in range(2)]):
        raise ValueError(
            f"`controller` has noise: its torques differ by {noise:.3g} N m or N after equal calls, so that it has no "
            "poles; simulate a small step at the target instead"
        )
    warnings.warn(
        f"`controller` has memory: its torques in one state differ by {memory:.3g} N m or N after different calls. The "
        "loop is judged as if it had none, by its torques at constant velocity: give torques that act late as the "
        "scene's `delay`, other memory as `states` of the law",
        stacklevel=4,
    )
    return settled


def _difference(found: list[Array]) -> float:
    """Largest difference between the first and the last torques, 0 if it is rounding."""
    difference = np.abs(found[-1] - found[0]).max(initial=0.0) if found else 0.0
    return float(difference * (difference > AGREEMENT * max(1.0, np.abs(found).max(initial=0.0))))


def refuse_jump(law: Any, q: Array) -> None:
    """Raise a ValueError if the torques of a law jump at the target, at rest."""

    def at(step: float) -> Array:
        return _torques(law, 0.0, *np.split(np.r_[q, 0 * q] + _beside(step, 2 * len(q)), 2))

    far, near = (np.abs(at(step) - at(-step)) for step in (BESIDE, BESIDE / 100))
    jump = (near * (near > far / 2)).max(initial=0.0)
    if jump > AGREEMENT * max(1.0, np.abs(at(0.0)).max(initial=0.0)):
        raise ValueError(
            f"the torques of `controller` jump by {jump:.3g} N m or N at the target, so that it has no poles there: "
            "write tanh(x / width) for sign(x), or simulate a small step at the target instead"
        )


def _beside(step: float, states: int) -> Array:
    """Displacement of states by a step, times another factor in each entry."""
    return step * np.linspace(1.0, 2.0, states)


def _read(closed: Array, moving: int) -> Array:
    """Indices of the motion's states and of those that it depends on; no integral without gain, no observer's."""
    read, before = np.arange(len(closed)) < moving, -1
    while read.sum() != before:  # derivatives by what is not read are exactly 0
        before, read = read.sum(), read | closed[read].any(axis=0)
    return np.flatnonzero(read)


def _at_rest(dynamics: SceneDynamics, robot: Robot, q: Array) -> Array:
    """State at rest with the links in q; zero after the coordinates."""
    x = np.zeros(dynamics.size)
    x[: dynamics.n], _ = dynamics.start(robot, q, 0 * q)
    return x


def _slopes(scene: Any, q: Array, beside: float = 0.0) -> tuple[Array, Array]:
    """Derivatives of the state's rates without energies and impulses, and its rates, at rest in q.

    With `beside`, at a state displaced by about this much in each entry.
    """
    dynamics, robot = scene.dynamics, scene.resolved.robot
    plant, moving = Plant(dynamics, robot, scene.controller if dynamics.law is None else None), 2 * dynamics.n
    moving += dynamics.states
    x = _at_rest(dynamics, robot, q)
    x[:moving] += _beside(beside, moving)
    return plant.jacobian(0.0, x)[:moving, :moving], plant(0.0, x)
