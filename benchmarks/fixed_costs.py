"""Fixed costs of a call: rne.simulate before anything moves, and a method on few and many states."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

import rne
from benchmarks.cases import load, states
from benchmarks.measure import interleaved, many, nanoseconds, ratio
from benchmarks.peers.pinocchio import Pinocchio
from benchmarks.runs import start
from benchmarks.single_motions import SAMPLES, controlled

MOMENT = 1e-6  # [s]
SIZES = (8, 1000)


def run(engines: tuple[str, ...], repeats: int, times: int) -> dict[str, Any]:
    """Both, each call repeated some times in a row."""
    return {"simulate": simulate(engines, repeats, times), "inverse_dynamics": methods(engines, repeats, times)}


def simulate(engines: tuple[str, ...], repeats: int, times: int) -> dict[str, float]:
    """Milliseconds of a run of a microsecond."""
    x0, grid = start(6), np.linspace(0.0, MOMENT, SAMPLES)
    calls: dict[str, Callable[[], Any]] = {}
    for engine in engines:
        arm = load("irb140", engine)
        for name, scene in (("robot", arm), ("closed loop", controlled(arm))):
            for ending, t_eval in (("", None), (f", {SAMPLES} times", grid)):
                call = _moment(scene, x0, t_eval)
                calls[f"{engine}, {name}{ending}"] = many(call, times)
    return {who: nanoseconds(runs) / times / 1e6 for who, runs in interleaved(calls, repeats).items()}


def _moment(scene: rne.Scene | rne.Robot, x0: np.ndarray, t_eval: np.ndarray | None) -> Callable[[], Any]:
    return lambda: rne.simulate(scene, x0[:6], x0[6:], MOMENT, t_eval=t_eval)


def methods(engines: tuple[str, ...], repeats: int, times: int) -> list[dict[str, Any]]:
    """Times of robot.inverse_dynamics relative to Pinocchio's batch of a thousand."""
    arms = {engine: load("irb140", engine) for engine in engines}
    arrays = states(6, SIZES[-1])
    call, _ = Pinocchio(arms["numpy"].model, arrays).fastest("inverse_dynamics")
    calls: dict[str, Callable[[], Any]] = {"pinocchio": many(call, times)}
    for engine, arm in arms.items():
        for size in SIZES:
            few = [a[:size].copy() for a in arrays]
            calls[f"{engine}, {size}"] = many(lambda a=arm, few=few: a.inverse_dynamics(*few), times)
    seconds = interleaved(calls, repeats)
    return [
        {
            "engine": engine,
            "states": size,
            "us": nanoseconds(seconds[f"{engine}, {size}"]) / times / 1e3,
            "times_faster": ratio(seconds, "pinocchio", f"{engine}, {size}"),
        }
        for engine in engines
        for size in SIZES
    ]
