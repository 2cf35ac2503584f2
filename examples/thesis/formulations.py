"""Chapter 7: the same motions by the Euler-Lagrange formulation, of an arm whose q3 counts the other way."""

import time
from collections.abc import Callable
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy.integrate import solve_ivp

import rne
from rne.commands.pages import settling_time
from rne.model.abb_irb140 import CLOSED_LOOPS, KD, KP

PI = np.pi
REST = np.zeros(6)
MIRROR = np.array([1, 1, -1, 1, 1, 1])  # between the two arms' joint coordinates
STARTS = {"7.1-1": (0, PI, -PI / 2, 0, 0, 0), "7.1-2": (0, PI, PI / 2, 0, 0, 0)}
RUNS = (*STARTS, "6.5-1", "6.5-2", "6.5-3")
# Durations [s]: 10 s is the thesis's for figure 7.2 and ours for 7.1; its Euler-Lagrange closed loops end at 2.3 s.
FREE, CONTROLLED = 10.0, 2.3
THESIS: dict[str, Any] = {"method": "RK45", "rtol": 1e-6, "atol": 1e-6}  # its ode45
CONTROL: dict[str, Any] = {"method": "LSODA", "rtol": 1e-8, "atol": 1e-10}

# Table 7.1: computing times of the thesis [s], and the time simulated [s], by Newton-Euler and by Euler-Lagrange.
TABLE = {
    "7.1-2": ((6.0, 10.0), (7 * 60.0, 10.0)),
    "6.5-1": ((28 * 60.0, 5.0), (18 * 3600.0, 2.3)),
    "6.5-2": ((32 * 60.0, 5.0), (18 * 3600.0, 2.3)),
    "6.5-3": ((27 * 60.0, 5.0), (18 * 3600.0, 2.3)),
}


def irb140_mirrored() -> rne.Model:
    """The arm with positive q3 in the opposite direction, as in the thesis's Euler-Lagrange model, chapter 7.

    The axis of joint_3 is reversed: its pose at q is that of `irb140` at (q1, q2, -q3, q4, q5, q6).
    """
    arm = rne.irb140()
    return replace(
        arm,
        name="irb140_mirrored",
        axis=arm.axis * MIRROR[:, None] + 0.0,  # no negative zeros
        lower=np.minimum(MIRROR * arm.lower, MIRROR * arm.upper),
        upper=np.maximum(MIRROR * arm.lower, MIRROR * arm.upper),
        notes=dict(arm.notes) | {"joint_3": f"The axis is reversed: positive q3 the other way. {arm.notes['joint_3']}"},
    )


class Motion(NamedTuple):
    """Joint positions over time, the evaluations of the right-hand side and the wall time of a simulation."""

    t: np.ndarray  # (T,) [s]
    q: np.ndarray  # (T, 6), in the model's own coordinates [rad]
    evaluations: int
    seconds: float


class Pair(NamedTuple):
    """One motion by both formulations, each in its model's own coordinates."""

    newton: Motion
    lagrange: Motion

    @property
    def difference(self) -> np.ndarray:
        """Differences of the joints, with q3 turned back, shape (T, 6) [rad]."""
        return self.newton.q - MIRROR * self.lagrange.q


def slower(run: str) -> float:
    """Ratio of the times of Euler-Lagrange to those of Newton-Euler per simulated second by Table 7.1."""
    (newton, simulated), (lagrange, shorter) = TABLE[run]
    return (lagrange / shorter) / (newton / simulated)


def closed_by_open() -> float:
    """Ratio of the time of the closed loop 6.5-1 to that of the open one by Newton-Euler in Table 7.1."""
    return TABLE["6.5-1"][0][0] / TABLE["7.1-2"][0][0]


def newton_euler(start: ArrayLike, t: np.ndarray, reference: ArrayLike | None, **how: Any) -> Motion:
    """Simulate by Newton-Euler, from rest, under the thesis's controller if there is a reference."""
    return simulated(rne.load("irb140"), rne.dynamics.forward_dynamics, start, REST, t, reference, **how)


def euler_lagrange(start: ArrayLike, t: np.ndarray, reference: ArrayLike | None, **how: Any) -> Motion:
    """Simulate by Euler-Lagrange the arm whose q3 counts the other way; all in the coordinates of that arm."""
    mirrored = rne.Robot(irb140_mirrored())
    return simulated(mirrored, rne.dynamics.lagrange_forward_dynamics, start, REST, t, reference, **how)


def simulated(
    robot: rne.Robot,
    dynamics: Any,
    q0: ArrayLike,
    qd0: ArrayLike,
    t: np.ndarray,
    reference: ArrayLike | None = None,
    **how: Any,
) -> Motion:
    """Simulate by SciPy and the traced kernel of either forward dynamics, to the last of the times t."""
    law = None if reference is None else rne.control.pd_gravity(robot, KP, KD, reference)
    accelerations = robot.kernel(dynamics)

    def rates(t: float, x: np.ndarray) -> np.ndarray:
        q, qd = x[:6], x[6:]
        return np.concatenate([qd, accelerations(q, qd, REST if law is None else law(t, q, qd))])

    x0 = np.concatenate([q0, qd0])
    rates(0.0, x0)  # traces the kernels
    begun = time.perf_counter()
    found = solve_ivp(rates, (0.0, float(t[-1])), x0, t_eval=t, **how)
    return Motion(t, found.y[:6].T, found.nfev, time.perf_counter() - begun)


def both(run: str) -> Pair:
    """One motion by both formulations: 7.1-1, 7.1-2, or 6.5-1 to 6.5-3 until the thesis's Euler-Lagrange runs end."""
    if run in STARTS:
        start, reference, duration, samples, how = STARTS[run], None, FREE, 2001, THESIS
    else:
        loop = CLOSED_LOOPS[int(run[-1]) - 1]
        start, reference, duration, samples = loop.start, loop.reference, min(CONTROLLED, loop.duration), 1151
        how = CONTROL
    t = np.linspace(0, duration, samples)
    turned = None if reference is None else MIRROR * reference
    return Pair(newton_euler(start, t, reference, **how), euler_lagrange(MIRROR * start, t, turned, **how))


class SameNumbers(NamedTuple):
    """A closed loop by Newton-Euler, and by Euler-Lagrange with the same numbers: another motion, as q3 is turned."""

    newton: Motion
    lagrange: Motion
    reference: np.ndarray  # (6,), the same numbers for both [rad]

    @property
    def shown(self) -> int:
        """Samples until the thesis's Euler-Lagrange runs end."""
        return int(np.searchsorted(self.newton.t, CONTROLLED + 1e-9))

    @property
    def distance(self) -> np.ndarray:
        """Differences of the numbers until the thesis's Euler-Lagrange runs end, shape (T, 6) [rad]."""
        return (self.lagrange.q - self.newton.q)[: self.shown]

    @property
    def settled(self) -> float:
        """Time from which on every joint of the Euler-Lagrange model stays near its reference [s]."""
        return settling_time(self.lagrange, self.reference)

    @property
    def left(self) -> float:
        """Largest error of a joint when the thesis's Euler-Lagrange run ends [rad]."""
        return float(np.abs(self.lagrange.q[self.shown - 1] - self.reference).max())


def same_numbers(k: int) -> SameNumbers:
    """Figures 7.3 to 7.5: start and reference of 6.5-(k+1), each formulation in its own coordinates."""
    loop = CLOSED_LOOPS[k]
    t = np.linspace(0, loop.duration, 1 + round(1000 * loop.duration))
    newton, lagrange = (
        simulate(loop.start, t, loop.reference, **CONTROL) for simulate in (newton_euler, euler_lagrange)
    )
    return SameNumbers(newton, lagrange, np.array(loop.reference))


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
