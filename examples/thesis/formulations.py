"""Chapter 7: the same motions by the Euler-Lagrange formulation, of an arm whose q3 counts the other way."""

import time
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

import rne
from rne.model.abb_irb140 import CLOSED_LOOPS, KD, KP, irb140_mirrored

PI = np.pi
REST = np.zeros(6)
MIRROR = np.array([1, 1, -1, 1, 1, 1])  # between the two arms' joint coordinates
STARTS = {"7.1-1": (0, PI, -PI / 2, 0, 0, 0), "7.1-2": (0, PI, PI / 2, 0, 0, 0)}
RUNS = (*STARTS, "6.5-1", "6.5-2", "6.5-3")
FREE, CONTROLLED = 10.0, 2.3  # [s]; the thesis's Euler-Lagrange simulations of the closed loops end at 2.3 s
THESIS: dict[str, Any] = {"method": "RK45", "rtol": 1e-6, "atol": 1e-6}  # its ode45
CONTROL: dict[str, Any] = {"method": "LSODA", "rtol": 1e-8, "atol": 1e-10}

# Table 7.1: computing times of the thesis [s], and the time simulated [s], by Newton-Euler and by Euler-Lagrange.
TABLE = {
    "7.1-2": ((6.0, 10.0), (7 * 60.0, 10.0)),
    "6.5-1": ((28 * 60.0, 5.0), (18 * 3600.0, 2.3)),
    "6.5-2": ((32 * 60.0, 5.0), (18 * 3600.0, 2.3)),
    "6.5-3": ((27 * 60.0, 5.0), (18 * 3600.0, 2.3)),
}


class Motion(NamedTuple):
    """Joint positions over time, the evaluations of the right-hand side and the wall time of a simulation."""

    t: np.ndarray  # (T,) [s]
    q: np.ndarray  # (T, 6), in the coordinates of `rne.irb140` [rad]
    evaluations: int
    seconds: float


class Pair(NamedTuple):
    """A run by both formulations."""

    newton: Motion
    lagrange: Motion


def slower(run: str) -> float:
    """How many times longer Euler-Lagrange takes per simulated second by Table 7.1."""
    (newton, simulated), (lagrange, shorter) = TABLE[run]
    return (lagrange / shorter) / (newton / simulated)


def closed_by_open() -> float:
    """How many times longer the closed loop 6.5-1 takes than the open one by Newton-Euler in Table 7.1."""
    return TABLE["6.5-1"][0][0] / TABLE["7.1-2"][0][0]


def newton_euler(start: ArrayLike, duration: float, t: np.ndarray, reference: ArrayLike | None, **how: Any) -> Motion:
    """A run by Newton-Euler, from rest, under the thesis's controller if there is a reference."""
    return _simulated(rne.load("irb140"), "newton-euler", start, duration, t, reference, **how)


def euler_lagrange(start: ArrayLike, duration: float, t: np.ndarray, reference: ArrayLike | None, **how: Any) -> Motion:
    """A run by Euler-Lagrange, of the mirrored arm; positions are mirrored back."""
    mirrored = None if reference is None else MIRROR * np.asarray(reference)
    start = MIRROR * np.asarray(start, dtype=float)
    motion = _simulated(rne.Robot(irb140_mirrored()), "euler-lagrange", start, duration, t, mirrored, **how)
    return motion._replace(q=motion.q * MIRROR)


def _simulated(
    robot: rne.Robot,
    formulation: str,
    start: ArrayLike,
    duration: float,
    t: np.ndarray,
    reference: ArrayLike | None,
    **how: Any,
) -> Motion:
    law = None if reference is None else rne.control.pd_gravity(robot, KP, KD, reference)
    scene = rne.Scene(robot, controller=law, formulation=formulation)
    rne.simulate(scene, start, REST, 0.0)  # traces the kernels
    begun = time.perf_counter()
    motion = rne.simulate(scene, start, REST, duration, t_eval=t, **how)
    return Motion(motion.t, motion.q, motion.evaluations, time.perf_counter() - begun)


def both(run: str) -> Pair:
    """A run of chapter 7 by both formulations: 7.1-1, 7.1-2, or 6.5-1 to 6.5-3."""
    arguments: tuple[Any, ...]
    if run in STARTS:
        arguments = (STARTS[run], FREE, np.linspace(0, FREE, 2001), None)
        how = THESIS
    else:
        loop = CLOSED_LOOPS[int(run[-1]) - 1]
        duration = min(CONTROLLED, loop.duration)
        arguments = (loop.start, duration, np.linspace(0, duration, 1151), loop.reference)
        how = CONTROL
    return Pair(newton_euler(*arguments, **how), euler_lagrange(*arguments, **how))


class Cost(NamedTuple):
    """A way to evaluate the inverse dynamics: its operations (0 if not counted) and time per call [µs]."""

    name: str
    operations: int
    microseconds: float


def costs() -> list[Cost]:
    """Operations and time per evaluation of each formulation, for Table 7.1."""
    robot = rne.load("irb140")
    q = np.linspace(0.1, 0.6, 6)
    newton, lagrange = rne.dynamics.inverse_dynamics, rne.dynamics.lagrange_inverse_dynamics
    rows: list[tuple[str, int, Callable[[], Any]]] = [
        ("Euler-Lagrange as written", 0, lambda: lagrange(robot.model, q, q, q)),
        ("Newton-Euler as written", 0, lambda: newton(robot.model, q, q, q)),
    ]
    for name, function in (
        ("Euler-Lagrange expanded", rne.dynamics.lagrange_inverse_dynamics),
        ("Newton-Euler", rne.dynamics.inverse_dynamics),
    ):
        kernel = robot.kernel(function)
        rows.append((f"{name}, kernel", sum(kernel.operations.values()), lambda k=kernel: k(q, q, q)))  # type: ignore[misc]
    seconds: dict[str, list[float]] = {name: [] for name, _, _ in rows}
    for _ in range(9):
        for name, _, call in rows:
            begun = time.perf_counter()
            for _ in range(20):
                call()
            seconds[name].append((time.perf_counter() - begun) / 20)
    return [Cost(name, count, float(np.median(seconds[name])) * 1e6) for name, count, _ in rows]


def torque_difference(states: int = 1000) -> float:
    """Largest difference of the torques of both formulations at random states, relative to the largest torque."""
    robot = rne.load("irb140")
    q, qd, qdd = np.random.default_rng(0).normal(size=(3, states, 6))
    newton = robot.inverse_dynamics(q, qd, qdd)
    lagrange = robot.kernel(rne.dynamics.lagrange_inverse_dynamics)(q, qd, qdd)
    return float(np.abs(newton - lagrange).max() / np.abs(newton).max())
