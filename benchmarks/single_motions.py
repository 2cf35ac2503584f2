"""Single motions by both engines and Pinocchio: swings, control sampled at 1 kHz, and the thesis's stiff loop.

Of every engine `rne.simulate` alone, and with all read that a trajectory offers. Pinocchio's functions are driven by
SciPy's solvers, in the sampled loop by one step of RK4 per sample. Errors are the largest of the joint positions, at
the end or at the times of `t_eval`, against runs with tight tolerances.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

import rne
from benchmarks.cases import load
from benchmarks.closed_loop import LOOP, their_loop
from benchmarks.hard_scenes import read
from benchmarks.runs import TURN, Motion, Row, in_solve_ivp, measured, start, their_side, tolerance
from benchmarks.sampled_loop import SAMPLE_TIME, SampledArm, sampled_scene
from rne.model.abb_irb140 import KD as LOOP_KD
from rne.model.abb_irb140 import KP as LOOP_KP

TOLERANCES = (1e-5, 1e-8, 1e-11)
STIFF_TOLERANCES = (1e-6, 1e-10)
SAMPLES = 500  # times of t_eval
ALL = "{}, all read"
EXACT = "pinocchio, exact Jacobian"
Engines = tuple[str, ...]


def run(engines: Engines, few: Engines, quick: bool) -> dict[str, Any]:
    """Every motion; a quick run uses all engines for the UR5's swing alone."""
    repeats, swing = (1, 0.2) if quick else (15, None)
    return {
        "swing of the ur5": swings("ur5", engines, swing or 10.0, repeats, quick),
        "swing of the irb140": swings("irb140", few, swing or 4.0, repeats, quick),
        "PD at 1 kHz": sampled(few, 0.01 if quick else 5.0, 1 if quick else 5),
        "closed loop 6.5-1": stiff_loop(few, 0.02 if quick else 5.0, repeats, quick),
    }


def swings(name: str, engines: Engines, duration: float, repeats: int, quick: bool) -> dict[str, Any]:
    """Free swings of one robot by DOP853, at the solver's steps and at times that are asked for."""
    scenes = {engine: rne.Scene(load(name, engine)) for engine in engines}
    arm = scenes["numpy"].resolved.robot
    x0, theirs = start(arm.n), their_side(arm)
    grid = np.linspace(0.0, duration, SAMPLES)
    exact = _motion(scenes["numpy"], x0, duration, {"t_eval": grid, **tolerance("DOP853", 1e-13)})[0]
    runs: list[Row] = []
    first = {engine: first_run(scene, x0, duration) for engine, scene in scenes.items()}
    for times in (None, grid):
        for rtol in TOLERANCES[1:2] if quick else TOLERANCES:
            o = tolerance("DOP853", rtol) | {"t_eval": times}
            calls = {"pinocchio": lambda o=o: in_solve_ivp(theirs, x0, duration, o)} | ours(scenes, x0, duration, o)
            setting = f"{rtol:g}" if times is None else f"{rtol:g}, {SAMPLES} times"
            runs.append(measured("DOP853", setting, calls, _error(exact, times), repeats, turn=TURN))
    return {"duration": duration, "first_run_s": first, "runs": runs}


def stiff_loop(engines: Engines, duration: float, repeats: int, quick: bool) -> dict[str, Any]:
    """The IRB 140 in the closed loop 6.5-1; Pinocchio's side computes gravity, PD law and ABA in Python."""
    scenes = {engine: controlled(load("irb140", engine)) for engine in engines}
    x0 = np.concatenate([LOOP.start, np.zeros(6)])
    rates, jacobian = their_loop(scenes["numpy"].resolved.robot)
    grid = np.linspace(0.0, duration, SAMPLES)
    exact = _motion(scenes["numpy"], x0, duration, {"t_eval": grid, **tolerance("Radau", 1e-6 if quick else 1e-12)})[0]
    first = {engine: first_run(scene, x0, duration) for engine, scene in scenes.items()}
    runs: list[Row] = []
    for rtol in STIFF_TOLERANCES[:1] if quick else STIFF_TOLERANCES:
        o = tolerance("LSODA", rtol) | {"t_eval": grid}
        calls: dict[str, Callable[[], Motion]] = {
            "pinocchio": lambda o=o: in_solve_ivp((rates, None), x0, duration, o),
            EXACT: lambda o=o: in_solve_ivp((rates, jacobian), x0, duration, o),
        }
        calls |= ours(scenes, x0, duration, o | {"method": "auto"})
        theirs = _error(exact, grid)(calls["pinocchio"]())
        for engine, scene in scenes.items():
            loose = _at_error(scene, x0, duration, o | {"method": "auto"}, exact, theirs)
            calls[f"{engine}, rtol {loose['rtol']:g}"] = lambda s=scene, o=loose: _motion(s, x0, duration, o)
        pairs = [(who, EXACT) for who in calls if "pinocchio" not in who]
        runs.append(
            measured(
                "LSODA, rne auto",
                f"{rtol:g}, {SAMPLES} times",
                calls,
                _error(exact, grid),
                repeats,
                pairs=pairs,
                turn=TURN,
            )
        )
    chosen = {engine: rne.simulate(s, x0[:6], x0[6:], duration, t_eval=grid).message for engine, s in scenes.items()}
    return {"duration": duration, "first_run_s": first, "chosen": chosen, "runs": runs}


def sampled(engines: Engines, duration: float, repeats: int) -> dict[str, Any]:
    """PD with gravity compensation at 1 kHz under viscous friction, from rest at zero."""
    scenes = {engine: sampled_scene(load("irb140", engine)) for engine in engines}
    x0, law = np.zeros(12), SampledArm(scenes["numpy"].resolved.robot)
    exact, _ = law.motion(duration, law.solver_steps)
    first = {engine: first_run(scene, x0, duration) for engine, scene in scenes.items()}
    runs: list[Row] = []
    for times in (None, SAMPLE_TIME * np.arange(len(exact))):
        calls = {"pinocchio": lambda: law.motion(duration, law.rk4_steps)}
        calls |= ours(scenes, x0, duration, {"rtol": 1e-6, "t_eval": times})
        setting = "1e-06" if times is None else f"1e-06, {len(exact)} times"
        runs.append(measured("RK4 per sample", setting, calls, _error(exact, times), repeats, turn=TURN))
    return {"duration": duration, "first_run_s": first, "runs": runs}


def controlled(robot: rne.Robot) -> rne.Scene:
    """The thesis's closed loop 6.5-1."""
    return rne.Scene(robot, controller=rne.control.pd_gravity(robot, LOOP_KP, LOOP_KD, LOOP.reference))


def ours(
    scenes: Mapping[str, rne.Scene], x0: np.ndarray, duration: float, options: dict[str, Any]
) -> dict[str, Callable[[], Motion]]:
    """Every engine, alone and with all read."""
    calls: dict[str, Callable[[], Motion]] = {}
    for engine, scene in scenes.items():
        calls[engine] = lambda s=scene: _motion(s, x0, duration, options)
        calls[ALL.format(engine)] = lambda s=scene: _motion(s, x0, duration, options, all_read=True)
    return calls


def _motion(
    scene: rne.Scene, x0: np.ndarray, duration: float, options: dict[str, Any], all_read: bool = False
) -> Motion:
    n = len(x0) // 2
    motion = rne.simulate(scene, x0[:n], x0[n:], duration, **options)
    if all_read:
        read(motion)
    return motion.q, motion.qd


def _error(exact: np.ndarray, times: np.ndarray | None) -> Callable[[Motion], float]:
    """The largest error of the positions, at the end alone if the times are the solver's own."""
    span = slice(-1, None) if times is None else slice(None)
    return lambda motion: float(np.abs(motion[0][span] - exact[span]).max())


def _at_error(
    scene: rne.Scene, x0: np.ndarray, duration: float, options: dict[str, Any], exact: np.ndarray, bound: float
) -> dict[str, Any]:
    """The options with the loosest tolerances, by powers of two, whose error is within a bound."""
    error, found = _error(exact, options["t_eval"]), options
    for k in range(1, 14):
        looser = options | {"rtol": 2**k * options["rtol"], "atol": 2**k * options["atol"]}
        if error(_motion(scene, x0, duration, looser)) > bound:
            break
        found = looser
    return found


def first_run(scene: rne.Scene, x0: np.ndarray, duration: float) -> float:
    """Seconds of the first rne.simulate of a scene, which traces and compiles what it needs."""
    begun = time.perf_counter()
    _motion(scene, x0, duration, {})
    return time.perf_counter() - begun
