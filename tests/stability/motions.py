"""Motions at the edges of simulation: stiff damping, fast tops, chaos, unstable rest, pulses, single precision."""

from __future__ import annotations

from functools import cache
from typing import NamedTuple

import numpy as np

import rne

from ..helpers import Part, assemble
from ..random_robots import straight_chain

X, _, Z = np.eye(3)
Q0 = np.linspace(0.3, 0.8, 6)


class Effort(NamedTuple):
    """What a run took and how wrong its positions are at the end."""

    evaluations: int
    error: float


def stiff_damping(robot, damping, methods, duration=1.0, rtol=1e-6):
    """{method: Effort} of a swing under viscous friction, against Radau at a thousandth of the tolerance."""
    scene = rne.Scene(robot, friction=rne.Friction(viscous=damping))
    end = rne.simulate(
        scene, Q0[: robot.n], np.zeros(robot.n), duration, method="Radau", rtol=1e-3 * rtol, atol=1e-6 * rtol
    ).q[-1]
    found = {}
    for method in methods:
        run = rne.simulate(
            scene, Q0[: robot.n], np.zeros(robot.n), duration, method=method, rtol=rtol, atol=1e-3 * rtol
        )
        found[method] = Effort(run.evaluations, float(np.abs(run.q[-1] - end).max()))
    return found


class Top(NamedTuple):
    """A heavy symmetric top on a gimbal without mass: its inertias about and across its axis, weight times lever."""

    robot: rne.Robot
    across: float
    about: float
    moment: float

    @classmethod
    def of(cls, mass=1.0, lever=0.1, about=2e-3, across=1e-3):
        parts = [Part(link="base")]
        for k, (axis, body) in enumerate(((Z, False), (X, False), (Z, True))):
            solid = {"mass": mass, "com": lever * Z, "inertia": np.diag([across, across, about])} if body else {}
            parts.append(Part(link=f"l{k}", joint=f"j{k}", kind="continuous", parent=k, axis=axis, **solid))
        return cls(rne.Robot(assemble("top", parts)), across + mass * lever**2, about, mass * 9.81 * lever)

    def steady(self, spin, tilt):
        """Rates of the slow regular precession at a tilt: across cos(tilt) w^2 - about spin w + moment = 0."""
        a, b = self.across * np.cos(tilt), self.about * spin
        precession = 2 * self.moment / (b + np.sqrt(b * b - 4 * a * self.moment))
        return np.array([precession, 0.0, spin - precession * np.cos(tilt)])

    def nutation(self, spin):
        """Rate at which a top let go nods [rad/s]."""
        return self.about * spin / self.across


def released_top(spin, rtol=1e-9, duration=1.0, tilt=0.6, **options):
    """A top let go without precession: evaluations, and how far its momentum about the vertical and its energy drift.

    Both are relative: to the spin's own momentum and to the moment of the weight.
    """
    top = Top.of()
    q0, qd0 = [0.0, tilt, 0.0], [0.0, 0.0, spin]
    run = rne.simulate(top.robot, q0, qd0, duration, rtol=rtol, atol=1e-3 * rtol, **options)
    p = np.einsum("tij,tj->ti", top.robot.mass_matrix(run.q), run.qd)
    momentum = np.abs(p[:, 0] - p[0, 0]).max() / (top.about * spin)
    return Effort(run.evaluations, float(momentum)), run.energy_drift / top.moment


class Growing(NamedTuple):
    """Errors over time: as measured and as estimated."""

    t: np.ndarray
    measured: np.ndarray
    estimated_t: np.ndarray
    estimated: np.ndarray
    horizon: float


def chaos(robot, tolerances, duration=8.0, points=801, accuracy=1e-3):
    """{rtol: Growing} of a free swing, against one that is far more accurate."""
    t = np.linspace(0, duration, points)
    exact = rne.simulate(
        robot, Q0[: robot.n], np.zeros(robot.n), duration, method="DOP853", rtol=1e-13, atol=1e-15, t_eval=t
    ).q
    found = {}
    for rtol in tolerances:
        run = rne.simulate(
            robot, Q0[: robot.n], np.zeros(robot.n), duration, method="DOP853", rtol=rtol, atol=1e-3 * rtol, t_eval=t
        )
        times, estimated = run.error_estimate()
        few = slice(None, None, -(-len(times) // points))
        found[rtol] = Growing(
            t, np.abs(run.q - exact).max(axis=1), times[few], estimated[few], run.trusted_horizon(accuracy)
        )  # fmt: skip
    return found


class Falling(NamedTuple):
    """Departure from an unstable rest, for each size of the push, and the fastest rate of the linearised motion."""

    t: np.ndarray
    departure: dict[float, np.ndarray]
    rate: float


def unstable_rest(pushes, duration=3.0, points=301):
    """Two links standing upright, pushed along the fastest growing mode; a push of 0 leaves rounding alone."""
    robot = rne.Robot(straight_chain(2))
    upright = max(([np.pi / 2 * k, 0.0] for k in range(4)), key=lambda q: float(robot.potential_energy(q)))
    A, _ = robot.linearize(upright, [0, 0], [0, 0])
    values, vectors = np.linalg.eig(A)
    k = int(np.argmax(values.real))
    mode = vectors[:, k].real / np.abs(vectors[:2, k].real).max()
    t = np.linspace(0, duration, points)
    departure = {}
    for push in pushes:
        x0 = np.concatenate([upright, [0, 0]]) + push * mode
        run = rne.simulate(robot, x0[:2], x0[2:], duration, method="DOP853", rtol=1e-12, atol=1e-18, t_eval=t)
        departure[push] = np.abs(run.q - upright).max(axis=1)
    return Falling(t, departure, float(values[k].real))


def pulse_missed(robot, width, method, named, impulse=1.0, rtol=1e-6):
    """Relative error of the rates after a short pulse of torque on an arm at rest without gravity.

    With `named` the pulse's edges are given as `breaks`.
    """
    got = after_pulse(robot, width, named, impulse, method=method, rtol=rtol, atol=1e-3 * rtol)
    exact = after_pulse(robot, width, True, impulse, method="DOP853", rtol=1e-11, atol=1e-13)
    return float(np.abs(got - exact).max() / np.abs(exact).max())


@cache
def after_pulse(robot, width, named, impulse, **options):
    """The rates at 1 s of an arm at rest without gravity that was pushed at 0.5 s."""
    begin = 0.5

    def pulse(t, q, qd):
        return np.where(begin <= t < begin + width, impulse / width, 0.0) * np.ones(robot.n)

    scene = rne.Scene(robot, gravity=[0, 0, 0])
    breaks = [begin, begin + width] if named else []
    return rne.simulate(scene, Q0[: robot.n], np.zeros(robot.n), 1.0, torque=pulse, breaks=breaks, **options).qd[-1]


def equal_steps(robot, steps, dtype, duration=0.5, starts=32, finest=1e-4):
    """{step: largest error of a position at the end} of swings by rk4 in a dtype, against finer steps."""
    q0 = equal_starts(robot, starts).astype(dtype)
    exact = finest_swings(robot, duration, starts, finest)
    return {step: float(np.abs(swings(robot, q0, duration, step) - exact).max()) for step in steps}


def equal_starts(robot, starts):
    """The same in single and in double precision."""
    return np.random.default_rng(0).uniform(-1, 1, (starts, robot.n)).astype(np.float32)


@cache
def finest_swings(robot, duration, starts, step):
    return swings(robot, equal_starts(robot, starts).astype(float), duration, step)


def swings(robot, q0, duration, step):
    """Positions at the end of free swings by rk4."""
    return rne.ensemble(robot, q0, 0 * q0, duration, step=step).q[-1]
