"""The closed loops of section 6.5: settling, the Lyapunov function, and what the proof leaves out (6.5.3)."""

from typing import Any, NamedTuple

import numpy as np

import rne
from rne.commands.pages import settling_time
from rne.model.abb_irb140 import CLOSED_LOOPS, KD, KP

from .loop_plots import fine_grid

REST = np.zeros(6)
SAMPLE_TIME = 1e-4  # of the controller whose torques are limited in rate [s]
RATE_DURATION = 4.0  # simulated with such a controller [s]
DIVERGING = 0.05  # simulated where the loop diverges, which takes ever smaller steps [s]


def loop_scene(k: int, **parts: Any) -> rne.Scene:
    """The arm with the thesis's controller of 6.5-(k+1)."""
    robot = rne.load("irb140")
    return rne.Scene(robot, controller=rne.control.pd_gravity(robot, KP, KD, CLOSED_LOOPS[k].reference), **parts)


def lyapunov(motion: rne.Trajectory, k: int) -> tuple[np.ndarray, np.ndarray]:
    """V of (6.50) and its derivative of (6.55) along a closed loop [J, W]."""
    error = motion.q - CLOSED_LOOPS[k].reference
    V = motion.kinetic + (np.array(KP) * error**2).sum(-1) / 2
    return V, -(np.array(KD) * motion.qd**2).sum(-1)


def lyapunov_deviation(motion: rne.Trajectory, k: int) -> float:
    """Largest difference of dV/dt by the simulated accelerations from (6.55), relative to the powers in it."""
    robot = rne.load("irb140")
    M, C = robot.mass_matrix(motion.q), robot.coriolis_matrix(motion.q, motion.qd)
    inertial = ((M @ motion.qdd[..., None] + C @ motion.qd[..., None])[..., 0] * motion.qd).sum(-1)
    spring = (np.array(KP) * (motion.q - CLOSED_LOOPS[k].reference) * motion.qd).sum(-1)
    _, rate = lyapunov(motion, k)
    size = np.abs(motion.tau * motion.qd).sum(-1) + np.abs(rate) + 1e-12  # [W]; at rest all of them vanish
    return float((np.abs(inertial + spring - rate) / size).max())


class Variation(NamedTuple):
    """A closed loop with something that 6.5.3 mentions and the simulations of the thesis leave out."""

    name: str
    parts: dict[str, Any]


IDEAL = Variation("none", {})
VARIATIONS = (
    IDEAL,
    Variation("viscous friction 5 N m s", {"friction": rne.Friction(viscous=5)}),
    Variation("viscous friction 20 N m s", {"friction": rne.Friction(viscous=20)}),
    Variation("Coulomb friction 5 N m", {"friction": rne.Friction(coulomb=5)}),
    Variation("torque limit 100 N m", {"effort_limit": (100,) * 6}),
    Variation("torque limit 60 N m", {"effort_limit": (60,) * 6}),
    Variation("rate limit 1e5 N m/s", {"torque_rate": (1e5,) * 6, "sample_time": SAMPLE_TIME}),
    Variation("rate limit 3e3 N m/s", {"torque_rate": (3e3,) * 6, "sample_time": SAMPLE_TIME}),
)


class Outcome(NamedTuple):
    """A closed loop with a variation: settling time, error at the end, largest rate, saturation, largest increase of V.

    `saturated` is the longest time that the torque of a joint is at its limit, `joint` the number of that joint from 1.
    """

    duration: float  # [s]
    settling: float  # [s]
    error: float  # [rad]
    rate: float  # [rad/s]
    saturated: float  # [s]
    joint: int
    increase: float  # [J]


def vary(k: int, variation: Variation) -> Outcome:
    """6.5-(k+1) with a variation."""
    run, is_sampled = CLOSED_LOOPS[k], "torque_rate" in variation.parts
    scene = loop_scene(k, **variation.parts)
    duration = run.duration
    if is_sampled:
        diverges = variation.parts["torque_rate"][0] < 1e4
        duration = min(duration, DIVERGING if diverges else RATE_DURATION)
    how: dict[str, Any] = {"method": "RK23"} if is_sampled else {"t_eval": fine_grid(duration)}
    try:
        motion = rne.simulate(scene, run.start, REST, duration, **how)
    except rne.SimulationError as error:
        motion = error.trajectory
    return outcome(motion, k, scene)


def outcome(motion: rne.Trajectory, k: int, scene: rne.Scene) -> Outcome:
    """The figures of a motion of 6.5-(k+1)."""
    reference = np.array(CLOSED_LOOPS[k].reference)
    limit = scene.resolved.effort_limit
    at_limit = np.zeros(6)
    if limit is not None:
        full = np.abs(motion.tau) >= limit * (1 - 1e-9)
        at_limit = (full[:-1] * np.diff(motion.t)[:, None]).sum(axis=0)
    V, _ = lyapunov(motion, k)
    return Outcome(
        float(motion.t[-1]),
        settling_time(motion, reference),
        float(np.abs(motion.q[-1] - reference).max()),
        float(np.abs(motion.qd).max()),
        float(at_limit.max()),
        1 + int(at_limit.argmax()),
        float((V - np.minimum.accumulate(V)).max()),
    )


def variations(k: int) -> dict[str, Outcome]:
    """6.5-(k+1) with each of the variations."""
    return {variation.name: vary(k, variation) for variation in VARIATIONS}


def gravity_on_the_way(motion: rne.Trajectory) -> np.ndarray:
    """The largest gravity torque of each joint along a motion, shape (6,) [N m]."""
    worst: np.ndarray = np.abs(rne.load("irb140").gravity_torque(motion.q)).max(axis=0)
    return worst
