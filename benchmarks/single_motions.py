"""Single motions by both engines beside Pinocchio's functions, each under the same SciPy method.

Of every engine rne.simulate, with all that it reports, and SciPy's solve_ivp on the same compiled right-hand side: what
the latter saves is what rne.simulate adds around the solver.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

import rne
from benchmarks.cases import load
from benchmarks.closed_loop import LOOP, their_loop
from benchmarks.measure import interleaved, ratio
from benchmarks.runs import Motion, Row, Side, in_solve_ivp, measured, simulated, start, their_side, tolerance
from rne.model.abb_irb140 import CLOSED_LOOPS, KD, KP
from rne.simulation.plant import Plant

METHODS = (("DOP853", 1e-8), ("LSODA", 1e-10))
STIFF_METHODS = (("LSODA", 1e-6), ("LSODA", 1e-10))
TIGHT = {"method": "DOP853", "rtol": 1e-12, "atol": 1e-13}
STIFF_TIGHT = {"method": "LSODA", "rtol": 1e-12, "atol": 1e-14}


def bare_side(scene: rne.Scene) -> Side:
    """The compiled right-hand side of a scene, and its Jacobian, without anything around them."""
    rates, now = scene.kernel.state_function_unguarded, np.zeros(1)

    def slope(t: float, x: np.ndarray) -> np.ndarray:
        now[0] = t
        return rates(now, x)

    return slope, Plant(scene.right_hand_side, None).jacobian


def controlled(robot: rne.Robot) -> rne.Scene:
    """The thesis's closed loop 6.5-1."""
    return rne.Scene(robot, controller=rne.control.pd_gravity(robot, KP, KD, LOOP.reference))


def swings(name: str, engines: tuple[str, ...], duration: float, repeats: int, quick: bool) -> dict[str, Any]:
    """Free swings of one robot by SciPy's methods."""
    scenes = {engine: rne.Scene(load(name, engine)) for engine in engines}
    arm = scenes["numpy"].resolved.robot
    methods = METHODS[:1] if quick else METHODS
    return compared(scenes, their_side(arm), start(arm.n), duration, methods, TIGHT, repeats)


def stiff_loop(engines: tuple[str, ...], duration: float, repeats: int, quick: bool) -> dict[str, Any]:
    """The IRB 140 in the closed loop; Pinocchio's side computes gravity, PD law and ABA in Python."""
    robots = {engine: load("irb140", engine) for engine in engines}
    scenes = {engine: controlled(robot) for engine, robot in robots.items()}
    x0 = np.concatenate([LOOP.start, np.zeros(6)])
    methods = STIFF_METHODS[:1] if quick else STIFF_METHODS
    return compared(scenes, their_loop(robots["numpy"]), x0, duration, methods, STIFF_TIGHT, repeats)


def compared(
    scenes: Mapping[str, rne.Scene],
    theirs: Side,
    x0: np.ndarray,
    duration: float,
    methods: tuple[tuple[str, float], ...],
    tight: dict[str, Any],
    repeats: int,
) -> dict[str, Any]:
    """Every engine in both ways, and Pinocchio; errors are those of the joint positions at the end."""
    first = {engine: first_run(scene, x0, duration) for engine, scene in scenes.items()}
    bare = {engine: bare_side(scene) for engine, scene in scenes.items()}
    exact = simulated(scenes["numpy"], x0, duration, **tight)[0][-1]

    def error(motion: Motion) -> float:
        return float(np.abs(motion[0][-1] - exact).max())

    rows: list[Row] = []
    for method, rtol in methods:
        o = tolerance(method, rtol)
        calls: dict[str, Callable[[], Motion]] = {
            "pinocchio": lambda o=o: in_solve_ivp(theirs, x0, duration, o),
        }
        for engine, scene in scenes.items():
            calls[engine] = lambda o=o, s=scene: simulated(s, x0, duration, **o)
            calls[f"{engine} bare"] = lambda o=o, b=bare[engine]: in_solve_ivp(b, x0, duration, o)
        pairs = [(engine, f"{engine} bare") for engine in scenes]
        rows.append(measured(method, f"{rtol:g}", calls, error, repeats, pairs=pairs))
    return {"duration": duration, "first_run_s": first, "runs": rows}


def first_run(scene: rne.Scene, x0: np.ndarray, duration: float) -> float:
    """Seconds of the first rne.simulate of a scene, which traces and compiles what it needs."""
    begun = time.perf_counter()
    simulated(scene, x0, duration)
    return time.perf_counter() - begun


def automatic(repeats: int, duration: float) -> list[dict[str, Any]]:
    """Method "auto" beside RK45 on the thesis's three closed loops, by NumPy."""
    robot = load("irb140")
    rows = []
    for loop in CLOSED_LOOPS:
        scene = rne.Scene(robot, controller=rne.control.pd_gravity(robot, KP, KD, loop.reference))
        motions: dict[str, rne.Trajectory] = {}

        def run(method: str, s: rne.Scene = scene, q0: Any = loop.start, m: Any = motions) -> Callable[[], None]:
            def go() -> None:
                m[method] = rne.simulate(s, q0, [0] * 6, duration, method=method, t_eval=[0.0, duration])

            return go

        rne.simulate(scene, loop.start, [0] * 6, 1e-3)
        seconds = interleaved({method: run(method) for method in ("auto", "RK45")}, repeats, warm_ups=0)
        rows.append(
            {
                "evaluations": motions["auto"].evaluations,
                "RK45_evaluations": motions["RK45"].evaluations,
                "auto_times_faster": ratio(seconds, "RK45", "auto"),
                "difference": float(np.abs(motions["auto"].q[-1] - motions["RK45"].q[-1]).max()),
            }
        )
    return rows
