"""A thousand swings of the IRB 140 at once: both engines with step control beside a loop of Pinocchio in SciPy.

Also two threads beside one, and steps of equal length beside step control at the same error. Where `rne.ensemble` has
no step control, its RK4 with equal steps stands in.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np

import rne
from benchmarks.cases import load
from benchmarks.measure import interleaved, ratio
from benchmarks.runs import TURN, Arms, Row, Side, in_solve_ivp, measured, their_side

RTOL, ATOL = 1e-6, 1e-9
STEP = 1e-3  # [s] of RK4
PANEL_TOLERANCES = (1e-4, 1e-6, 1e-8, 1e-10)
PANEL_STEPS = (1e-2, 5e-3, 2e-3, 1e-3)  # [s]
HAS_STEP_CONTROL = "rtol" in inspect.signature(rne.ensemble).parameters
CONTROLLED: dict[str, Any] = {"rtol": RTOL, "atol": ATOL} if HAS_STEP_CONTROL else {"step": STEP}
Ends = np.ndarray  # positions at the end, shape (N, n) [rad]


def run(engines: Sequence[str], count: int, duration: float, repeats: int) -> dict[str, Any]:
    """Every engine and Pinocchio from the same starts, in turn."""
    scenes = {engine: rne.Scene(load("irb140", engine)) for engine in engines}
    q0 = np.random.default_rng(0).uniform(-1, 1, (count, 6))
    theirs, ends = their_side(scenes["numpy"].resolved.robot), {}
    exact = their_ends(theirs, q0, duration, 1e-12, 1e-14)

    def kept(who: str, call: Callable[[], Ends]) -> Callable[[], None]:
        return lambda: ends.__setitem__(who, call())

    steps = {engine: equal_step(scene, q0, duration, exact) for engine, scene in scenes.items()}
    with ThreadPoolExecutor(2) as pool:
        calls = {"pinocchio": lambda: their_ends(theirs, q0, duration, RTOL, ATOL)}
        for engine, scene in scenes.items():
            calls[engine] = lambda s=scene: our_ends(s, q0, duration, **CONTROLLED)
            calls[f"{engine}, two threads"] = lambda s=scene: our_ends(s, q0, duration, executor=pool, **CONTROLLED)
            calls[f"{engine}, equal steps"] = lambda s=scene, h=steps[engine]: our_ends(s, q0, duration, step=h)
        seconds = interleaved({who: kept(who, call) for who, call in calls.items()}, repeats)
    errors = {who: np.abs(end - exact).max(axis=1) for who, end in ends.items()}
    found = {
        "starts": count,
        "duration": duration,
        "rtol": RTOL,
        "step_control": HAS_STEP_CONTROL,
        "pinocchio_seconds": float(np.median(seconds["pinocchio"])),
        "errors": {who: [float(np.median(e)), float(e.max())] for who, e in errors.items()},
    }
    return found | {engine: of_engine(engine, seconds, steps[engine]) for engine in engines}


def of_engine(engine: str, seconds: Mapping[str, list[float]], step: float) -> dict[str, Any]:
    """The figures of one engine."""
    return {
        "seconds": float(np.median(seconds[engine])),
        "times_faster_than_pinocchio": ratio(seconds, "pinocchio", engine),
        "two_threads_times_faster": ratio(seconds, engine, f"{engine}, two threads"),
        "equal_step": step,
        "times_faster_than_equal_steps": ratio(seconds, f"{engine}, equal steps", engine),
    }


def their_ends(side: Side, q0: np.ndarray, duration: float, rtol: float, atol: float) -> Ends:
    """A loop of SciPy's DOP853 around Pinocchio's ABA."""
    o = {"method": "DOP853", "rtol": rtol, "atol": atol}
    return np.array([in_solve_ivp(side, np.concatenate([q, 0 * q]), duration, o)[0][-1] for q in q0])


def our_ends(scene: rne.Scene, q0: np.ndarray, duration: float, **options: Any) -> Ends:
    """A run of rne.ensemble."""
    ends: Ends = rne.ensemble(scene, q0, 0 * q0, duration, **options).q[-1]
    return ends


def equal_step(scene: rne.Scene, q0: np.ndarray, duration: float, exact: Ends) -> float:
    """The step of RK4 whose median error is that of step control, by its order of four."""

    def error(**options: Any) -> float:
        return float(np.median(np.abs(our_ends(scene, q0, duration, **options) - exact).max(axis=1)))

    if not HAS_STEP_CONTROL:
        return STEP
    step, wanted = STEP, error(**CONTROLLED)
    for _ in range(3):
        step = min(step * (wanted / error(step=step)) ** 0.25, duration / 10)
    return step


def panel(arms: Arms, quick: bool) -> dict[str, Any]:
    """Wall time against the median error, for chart B."""
    count, duration, repeats = (5, 0.05, 1) if quick else (200, 1.0, 3)
    robot, scenes = arms["numpy"], {engine: rne.Scene(arm) for engine, arm in arms.items()}
    q0, theirs = np.random.default_rng(0).uniform(-1, 1, (count, 6)), their_side(robot)
    exact = their_ends(theirs, q0, duration, 1e-12, 1e-14)

    def error(ends: Any) -> float:
        return float(np.median(np.abs(ends - exact).max(axis=1)))

    def ours(**o: Any) -> dict[str, Callable[[], Any]]:
        return {engine: lambda s=s: our_ends(s, q0, duration, **o) for engine, s in scenes.items()}

    rows: list[Row] = []
    for rtol in PANEL_TOLERANCES[:1] if quick else PANEL_TOLERANCES:
        o = {"rtol": rtol, "atol": 1e-3 * rtol}
        calls: dict[str, Any] = {"pinocchio": lambda o=o: their_ends(theirs, q0, duration, **o)}
        calls |= ours(**o) if HAS_STEP_CONTROL else {}
        rows.append(measured("DOP853", f"{rtol:.0e}", calls, error, repeats, turn=TURN))
    for step in PANEL_STEPS[:1] if quick else PANEL_STEPS:
        rows.append(measured("RK4", f"{step * 1e3:g} ms", ours(step=step), error, repeats, turn=TURN))
    return {"starts": count, "duration": duration, "repeats": repeats, "robots": {robot.model.name: {"runs": rows}}}
