"""An ensemble of the IRB 140 by RK4: both engines, beside their right-hand sides alone, Pinocchio, and two threads."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import Executor, ThreadPoolExecutor
from typing import Any

import numpy as np
import pinocchio as pin

import rne
from benchmarks.cases import load
from benchmarks.measure import interleaved, ratio
from benchmarks.peers.pinocchio import Pinocchio

STEP = 1e-3  # [s]
State = tuple[np.ndarray, np.ndarray]


def pinocchio_rk4(model: Any, q: np.ndarray, qd: np.ndarray, steps: int) -> State:
    """The same method on columns of states, its accelerations by abaInParallel on one thread."""
    pool = pin.ModelPool(model, 1)
    x = np.asfortranarray(np.concatenate([q.T, qd.T]))
    n = model.nv
    tau, qdd = np.asfortranarray(np.zeros((n, len(q)))), np.asfortranarray(np.zeros((n, len(q))))

    def slope(x: np.ndarray) -> np.ndarray:
        pin.abaInParallel(1, pool, np.asfortranarray(x[:n]), np.asfortranarray(x[n:]), tau, qdd)
        return np.concatenate([x[n:], qdd])

    for _ in range(steps):
        k1 = slope(x)
        k2 = slope(x + STEP / 2 * k1)
        k3 = slope(x + STEP / 2 * k2)
        k4 = slope(x + STEP * k3)
        x = x + STEP / 6 * (k1 + 2 * (k2 + k3) + k4)
    return x[:n].T, x[n:].T


def run(engines: Sequence[str], count: int, steps: int, pieces: int) -> dict[str, Any]:
    """Every engine and Pinocchio from the same starts, piece by piece in turn."""
    arms = {engine: load("irb140", engine) for engine in engines}
    q0 = np.random.default_rng(0).uniform(-1, 1, (count, 6))
    theirs = Pinocchio(arms["numpy"].model, [q0[:1]] * 3).model
    at: dict[str, State] = {}
    with ThreadPoolExecutor(2) as pool:
        calls = {"pinocchio": moved(at, "pinocchio", lambda q, qd: pinocchio_rk4(theirs, q, qd, steps))}
        for engine, robot in arms.items():
            scene = rne.Scene(robot)
            calls[engine] = moved(at, engine, our_motion(scene, steps, None))
            calls[f"{engine} two threads"] = moved(at, f"{engine} two threads", our_motion(scene, steps, pool))
            calls[f"{engine} rates alone"] = rates_alone(scene, q0, steps)
        start = q0, 0 * q0
        at |= dict.fromkeys(calls, start)
        seconds = interleaved(calls, pieces)
    figures = {"starts": count, "steps": steps * pieces, "pinocchio_seconds": sum(seconds["pinocchio"])}
    return figures | {engine: of_engine(engine, seconds, at) for engine in arms}


def of_engine(engine: str, seconds: dict[str, list[float]], at: dict[str, State]) -> dict[str, Any]:
    """The figures of one engine."""
    return {
        "seconds": sum(seconds[engine]),
        "times_its_right_hand_sides": ratio(seconds, engine, f"{engine} rates alone"),
        "times_faster_than_pinocchio": ratio(seconds, "pinocchio", engine),
        "two_threads_times_faster": ratio(seconds, engine, f"{engine} two threads"),
        "difference": float(np.abs(at[engine][0] - at["pinocchio"][0]).max()),
    }


def our_motion(scene: rne.Scene, steps: int, executor: Executor | None) -> Callable[[np.ndarray, np.ndarray], State]:
    """A run of rne.ensemble."""

    def motion(q: np.ndarray, qd: np.ndarray) -> State:
        runs = rne.ensemble(scene, q, qd, STEP * steps, step=STEP, executor=executor)
        return runs.q[-1], runs.qd[-1]

    return motion


def moved(at: dict[str, State], who: str, motion: Callable[[np.ndarray, np.ndarray], State]) -> Callable[[], None]:
    """A call that continues a motion from where it is."""

    def call() -> None:
        at[who] = motion(*at[who])

    return call


def rates_alone(scene: rne.Scene, q0: np.ndarray, steps: int) -> Callable[[], None]:
    """The right-hand sides that the steps evaluate, in calls of all states."""
    x, t = np.concatenate([q0, 0 * q0], axis=1), np.zeros((len(q0), 1))
    out = scene.kernel(t, x)

    def call() -> None:
        for _ in range(4 * steps):
            scene.kernel(t, x, out=out)

    return call
