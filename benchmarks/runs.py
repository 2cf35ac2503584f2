"""Simulations timed beside their errors: rne.simulate by both engines, and Pinocchio in SciPy's solvers."""

from __future__ import annotations

import statistics
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
import pinocchio as pin
from scipy.integrate import solve_ivp

import rne
from benchmarks.measure import interleaved, many, ratio, within
from benchmarks.peers.pinocchio import Pinocchio
from rne.integrators.base import IMPLICIT

WAYS = {
    "numba": "rne, machine code",
    "numpy": "rne, NumPy",
    "pinocchio": "Pinocchio in Python loops",
    "mujoco": "MuJoCo's own steps",
}
TURN = 0.02  # [s] that short calls fill
Arms = Mapping[str, rne.Robot]  # one robot by the name of its engine
Rates = Callable[[float, np.ndarray], np.ndarray]
Side = tuple[Rates, Rates | None]  # dx/dt and its exact Jacobian, if it is given
Motion = tuple[np.ndarray, np.ndarray]  # q and qd, shapes (T, n)
Row = dict[str, Any]


def start(n: int) -> np.ndarray:
    """The state that every swing starts from, at rest."""
    return np.concatenate([np.linspace(0.3, 0.8, n), np.zeros(n)])


def tolerance(method: str, rtol: float) -> dict[str, Any]:
    """Options of a SciPy method; the absolute tolerance is a thousandth of the relative one."""
    return {"method": method, "rtol": rtol, "atol": rtol * 1e-3}


def in_solve_ivp(side: Side, x0: np.ndarray, duration: float, options: dict[str, Any], **more: Any) -> Motion:
    """A run of SciPy's own solver."""
    rates, jacobian = side
    exact = {"jac": jacobian} if jacobian is not None and options["method"] in IMPLICIT else {}
    y = solve_ivp(rates, (0.0, duration), x0, **options, **exact, **more).y.T
    n = len(x0) // 2
    return y[:, :n], y[:, n:]


def simulated(scene: rne.Scene | rne.Robot, x0: np.ndarray, duration: float, **options: Any) -> Motion:
    """A run of rne.simulate, with all that it reports."""
    n = len(x0) // 2
    motion = rne.simulate(scene, x0[:n], x0[n:], duration, **options)
    return motion.q, motion.qd


def their_arm(robot: rne.Robot) -> tuple[Any, Any]:
    """Pinocchio's model and data with our numbers, if its coordinates are ours."""
    theirs = Pinocchio(robot.model, [np.zeros((1, robot.n))] * 3)
    if theirs.model.nq != robot.n or theirs.oracle.v.tolist() != list(range(robot.n)):
        raise ValueError(f"Pinocchio's coordinates of {robot.model.name!r} are not ours")
    return theirs.model, theirs.data


def their_side(robot: rne.Robot) -> Side:
    """A bare arm by Pinocchio's ABA."""
    n, still = robot.n, np.zeros(robot.n)
    model, data = their_arm(robot)

    def rates(_t: float, x: np.ndarray) -> np.ndarray:
        return np.concatenate([x[n:], pin.aba(model, data, x[:n], x[n:], still)])

    def jacobian(_t: float, x: np.ndarray) -> np.ndarray:
        dq, dqd, _ = pin.computeABADerivatives(model, data, x[:n], x[n:], still)
        return by_state(dq, dqd)

    return rates, jacobian


def by_state(dq: np.ndarray, dqd: np.ndarray) -> np.ndarray:
    """df/dx for x = (q, qd) from the derivatives of the accelerations."""
    n = len(dq)
    J = np.zeros((2 * n, 2 * n))
    J[:n, n:] = np.eye(n)
    J[n:, :n], J[n:, n:] = dq, dqd
    return J


def measured(
    method: str,
    setting: str,
    calls: Mapping[str, Callable[[], Motion]],
    error: Callable[[Motion], float],
    repeats: int,
    warm_ups: int = 1,
    pairs: Sequence[tuple[str, str]] = (),
    turn: float = 0.0,
) -> Row:
    """One method at one setting in each of the given ways: median seconds, errors, and times Pinocchio's time.

    For each of the `pairs` of ways also the time of the first over that of the second. Short calls fill their `turn` of
    so many seconds: alone, they would find the caches as the long ones leave them.
    """
    found: dict[str, Motion] = {}

    def kept(who: str, call: Callable[[], Motion]) -> Callable[[], None]:
        def run() -> None:
            found[who] = call()

        return run

    kept_calls = {who: kept(who, call) for who, call in calls.items()}
    counts = {who: within(call, turn) if turn else 1 for who, call in kept_calls.items()}
    turns = {who: many(call, counts[who]) for who, call in kept_calls.items()}
    seconds = interleaved(turns, repeats, warm_ups)
    seconds = {who: [s / counts[who] for s in runs] for who, runs in seconds.items()}
    others = [who for who in calls if who != "pinocchio" and "pinocchio" in calls]
    return {
        "method": method,
        "setting": setting,
        "seconds": {who: statistics.median(runs) for who, runs in seconds.items()},
        "errors": {who: error(motion) for who, motion in found.items()},
        "times_slower": {who: ratio(seconds, who, "pinocchio") for who in others},
        **({"times_second": {a: ratio(seconds, a, b) for a, b in pairs}} if pairs else {}),
    }
