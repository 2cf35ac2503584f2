"""Stability of a scene's closed loop near a target: linearised there, in continuous time or with torques held."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import replace
from typing import Any

import numpy as np
from scipy.linalg import expm

from ..basics.spatial import Array
from ..control.gains import LinearisedLoop
from ..control.traced_law import LawInputs, call_law
from ..kernels.trace import AGREEMENT
from .plant import Plant, with_own_law

AT_REST = 1e-6  # accelerations at the target that are no motion, of those that the torques alone give
SLOWEST, FASTEST = 1e2, 1e-2  # sample times examined, over the times of the slowest and of the fastest mode
STEP = 1.03  # from one to the next
NEAR, LATER = 1e-2, 1e-3  # of the target, rad or m and per s, and s: where and when a law is called for its memory
CALLS = 64  # that fill a memory, such as that of a delay
BESIDE, JUMP = 1e-6, 1e-3  # of the target, rad or m and per s; relative change of the slopes there that is a kink
MARGIN = 1e-9  # of a spectral radius beyond 1, or a pole beyond 0 over the fastest: less is rounding


def linearised_loop(scene: Any, q: Array) -> LinearisedLoop:
    """The loop of a scene with a controller, at rest in q with the controller's states zero."""
    n, sample_time = scene.n, scene.sample_time
    free = with_own_law(replace(scene, sample_time=None, torque_rate=None))
    if free.dynamics.law is None:
        refuse_memory(free.controller, q, sample_time or LATER)
    refuse_jump(free.controller, q)
    closed, _, rates = _slopes(free, q)
    sides = [closed, *(_slopes(free, q, beside=by)[0] for by in (BESIDE, -BESIDE))]
    jumps = [np.abs(side - closed).max(initial=0.0) > JUMP * np.abs(closed).max(initial=0.0) for side in sides]
    if any(jumps):  # a kink at the target: what holds is the least stable side
        closed = max(sides, key=lambda side: np.linalg.eigvals(side).real.max())
    torque = _torques(free.controller, 0.0, q, 0 * q)
    alone = scene.resolved.robot.forward_dynamics(q, 0 * q, np.abs(torque))
    size = np.abs(alone).max(initial=0.0) + 1.0
    is_rest = bool(np.abs(rates[n : 2 * n]).max(initial=0.0) <= AT_REST * size)
    read = _read(closed, 2 * n)
    closed = closed[np.ix_(read, read)]
    poles = np.linalg.eigvals(closed)
    fastest = float(np.abs(poles).max(initial=1e-300))
    limit, stable = 0.0, bool((poles.real < -MARGIN * fastest).all())
    opened = np.zeros_like(closed)  # states of a sampled law are held too: they follow by Euler's rule
    held = replace(free, controller=lambda t, q, qd: torque)
    opened[: 2 * n, : 2 * n] = _slopes(held, q)[0]
    if stable:
        first, last = FASTEST / fastest, SLOWEST / float(np.abs(poles).min())
        times = np.geomspace(first, last, int(np.ceil(np.log(last / first) / np.log(STEP))))
        own = [] if sample_time is None else [sample_time]
        limit = first_unstable_sample_time(opened, closed - opened, np.sort([*times, *own]))
    if sample_time is not None:
        stable = stable and spectral_radius(opened, closed - opened, sample_time) < 1 - MARGIN
    friction = scene.resolved.friction
    is_smoothed = friction is not None and bool(np.any(friction.coulomb) or np.any(friction.load))
    is_of_link = getattr(scene.controller, "posture", True) is None
    return LinearisedLoop(poles, limit, sample_time, stable, is_rest, is_smoothed, is_of_link)


def _torques(law: Any, t: float, q: Array, qd: Array) -> Array:
    """The torques of a law, with its states zero."""
    x = np.concatenate([q, qd, np.zeros(int(getattr(law, "states", 0)))])
    return np.asarray(call_law(law, t, x, LawInputs(0, len(q), len(q)))[0], dtype=float)


def refuse_memory(law: Any, q: Array, period: float) -> None:
    """Raise a ValueError if the torques of a law at one time and state depend on the call before."""
    found: list[Array] = []
    for near in (NEAR, -NEAR):
        with suppress(Exception):  # of a law that knows the target or a span of time alone, such as its reference's
            _torques(law, 0.0, q, 0 * q)  # where a law with memory begins anew
            for k in range(1, CALLS):
                _torques(law, k * period, q + near, near + 0 * q)
            found.append(_torques(law, CALLS * period, q, 0 * q))
    difference = np.abs(found[-1] - found[0]).max(initial=0.0) if found else 0.0
    if difference > AGREEMENT * max(1.0, np.abs(found).max(initial=0.0)):
        raise ValueError(
            f"`controller` has memory or noise: its torques in one state differ by {difference:.3g} N m or N after "
            "different calls, so that it has no poles. Give it `states` for its memory: torques that act one sample "
            "late are a state z with the rate (u - z) / sample_time; or simulate a small step at the target instead"
        )


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
    """A step in each of some states, by another distance."""
    return step * np.linspace(1.0, 2.0, states)


def _read(closed: Array, moving: int) -> Array:
    """Numbers of the states that others depend on, behind those of the motion; of an integral without gain none do."""
    read, before = np.arange(len(closed)), -1
    while len(read) != before:  # the slopes of what is not read are 0, not nearly 0
        before, read = len(read), read[(read < moving) | closed[np.ix_(read, read)].any(axis=0)]
    return read


def _slopes(scene: Any, q: Array, beside: float = 0.0) -> tuple[Array, Array, Array]:
    """The slopes of the state's rates without energies and impulses, at rest in q, that state, and its rates.

    Or `beside` that state, in each of its entries by another distance.
    """
    dynamics = scene.dynamics
    plant = Plant(dynamics, scene.resolved.robot, scene.controller if dynamics.inputs == "called" else None)
    x = np.zeros(dynamics.size)
    x[: scene.n], moving = q, 2 * scene.n + dynamics.states
    x[:moving] += _beside(beside, moving)
    return plant.jacobian(0.0, x)[:moving, :moving], x, plant(0.0, x)


def spectral_radius(opened: Array, feedback: Array, T: float) -> float:
    """Of the map from sample to sample of x' = opened x + feedback x_k (Åström and Wittenmark 1997, section 2.3)."""
    n = len(opened)
    both = expm(T * np.block([[opened, feedback], [np.zeros((n, 2 * n))]]))
    return float(np.abs(np.linalg.eigvals(both[:n, :n] + both[:n, n:])).max())


def first_unstable_sample_time(opened: Array, feedback: Array, times: Array) -> float:
    """The smallest sample time at which the loop with held torques is not stable, by ascending times examined [s]."""
    k = next((k for k, T in enumerate(times) if spectral_radius(opened, feedback, T) > 1 + MARGIN), None)
    if k is None:
        return float("inf")
    start, end = float(times[k - 1]) if k else 0.0, float(times[k])
    while end - start > 1e-6 * end:
        middle = (start + end) / 2
        start, end = (start, middle) if spectral_radius(opened, feedback, middle) > 1 + MARGIN else (middle, end)
    return float(end)
