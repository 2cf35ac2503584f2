"""The simulations of Høifødt 2011, as independent jobs that run in parallel processes."""

import os
import time
from collections.abc import Callable, Mapping
from concurrent.futures import Future, ProcessPoolExecutor, as_completed
from multiprocessing import get_context
from typing import Any, NamedTuple

import numpy as np

import rne
from rne.commands.pages import STRETCHED_OUT
from rne.model.abb_irb140 import CLOSED_LOOPS

from .closed_loop import REST, loop_scene, variations
from .formulations import RUNS, STARTS, THESIS, Motion, both, costs, same_numbers, simulated
from .loop_plots import fine_grid

PI = np.pi
HANGING = np.array([0, PI, -PI / 2, 0, 0, 0])
OFF = STRETCHED_OUT + [0, 0.05, 0, 0, 0, 0]
# Starts of 6.3-1 to 6.3-4, (6.22) to (6.29), with our durations [s]; starts of 6.4-1 and 6.4-2, (6.40) to (6.45).
HELD = ((REST, 2.0), (HANGING, 2.0), (STRETCHED_OUT, 10.0), (OFF, 6.0))
FREE = ((0, 0, 0, 0, 0, 0), (0, 1e-6, 0, 0, 0, 0))
TIGHT: dict[str, Any] = {"rtol": 1e-9, "atol": 1e-12}
SOLVERS = ("RK45", "LSODA", "Radau", "BDF")
SAMPLE_TIMES = (1.30e-4, 1.35e-4)  # just below and just above the stability limit [s]
SAMPLED = (2.0, 0.031)  # duration simulated with each [s]
LONG = 1000.0  # [s]
LONG_RTOL = {"DOP853": 1e-12, "RK45": 1e-4}
LEVELS = 20  # parts of a long run, each with its level


class Timed(NamedTuple):
    """A motion and the wall time of its simulation [s]."""

    motion: rne.Trajectory
    seconds: float


def timed(*arguments: Any, **how: Any) -> Timed:
    """Simulate and measure the wall time; if the simulation fails, return the motion up to the failure."""
    start = time.perf_counter()
    try:
        motion = rne.simulate(*arguments, **how)
    except rne.SimulationError as error:
        motion = error.trajectory
    return Timed(motion, time.perf_counter() - start)


def holding() -> list[rne.Trajectory]:
    """6.3-1 to 6.3-4: motions under the constant torque of (6.21)."""
    robot = rne.load("irb140")
    torque = robot.gravity_torque(STRETCHED_OUT)
    return [
        rne.simulate(robot, start, REST, end, torque=torque, t_eval=np.linspace(0, end, 6001), **TIGHT)
        for start, end in HELD
    ]


def swings() -> list[rne.Trajectory]:
    """Free motions 6.4-1 and 6.4-2 with tight tolerances, and then both with the thesis's."""
    robot, tight = rne.load("irb140"), {"t_eval": np.linspace(0, 10, 4001), **TIGHT}
    return [rne.simulate(robot, start, REST, 10.0, **how) for how in (tight, THESIS) for start in FREE]


def closed_loop(k: int) -> dict[str, Timed]:
    """6.5-(k+1) by every solver, by "auto", and by "auto" sampled finely at first and then every millisecond."""
    scene = loop_scene(k)
    run = CLOSED_LOOPS[k]
    rne.simulate(scene, run.start, REST, 1e-3)  # traces the kernels before time is measured
    found = {method: timed(scene, run.start, REST, run.duration, method=method) for method in SOLVERS}
    found["auto"] = timed(scene, run.start, REST, run.duration)
    found["grid"] = timed(scene, run.start, REST, run.duration, t_eval=fine_grid(run.duration))
    return found


def sampled(k: int) -> list[Timed]:
    """6.5-(k+1) with torques held between samples, just below and just above the stability limit."""
    return [
        timed(loop_scene(k, sample_time=T), CLOSED_LOOPS[k].start, REST, end, method="RK23")
        for T, end in zip(SAMPLE_TIMES, SAMPLED, strict=True)
    ]


class Tipping(NamedTuple):
    """7.1-2 from 1e-6 rad along its unstable mode."""

    motion: Motion
    distance: np.ndarray  # of the joints from the equilibrium, (T,) [rad]
    rate: float  # of the linearised equations [1/s]

    @property
    def measured(self) -> float:
        """Rate at which the distance grows while it is below 1e-3 rad [1/s]."""
        small = self.distance < 1e-3
        return float(np.polyfit(self.motion.t[small], np.log(self.distance[small]), 1)[0])


def tipping(dynamics: Any = rne.dynamics.forward_dynamics) -> Tipping:
    """Growth of a small deviation from the unstable equilibrium 7.1-2, by one formulation's forward dynamics."""
    robot = rne.load("irb140")
    start = np.array(STARTS["7.1-2"])
    A, _ = robot.linearize(start, REST, REST)
    squares, modes = np.linalg.eig(A[6:, :6])  # of the whole A, which is defective, LAPACK's modes are wrong
    k = int(np.argmax(squares.real))
    rate = float(np.sqrt(squares[k].real))
    mode = modes[:, k].real * 1e-6 / np.abs(modes[:, k]).max()
    times = np.linspace(0, 1.6, 801)
    how = {"method": "DOP853", "rtol": 1e-12, "atol": 1e-15}
    motion = simulated(robot, dynamics, start + mode, rate * mode, times, **how)
    return Tipping(motion, np.abs(motion.q - start).max(axis=1), rate)


def still() -> float:
    """Largest distance of 7.1-1 from its start in 10 s, with tight tolerances [rad]."""
    motion = rne.simulate(rne.load("irb140"), HANGING, REST, 10.0, t_eval=np.linspace(0, 10, 1001), **TIGHT)
    return float(np.abs(motion.q - HANGING).max())


def long_swing(method: str) -> Timed:
    """6.4-1 for 1000 s."""
    times = np.arange(0, LONG + 0.25, 0.5)
    return timed(rne.load("irb140"), REST, REST, LONG, method=method, rtol=LONG_RTOL[method], t_eval=times)


def levels(motion: rne.Trajectory) -> tuple[np.ndarray, np.ndarray]:
    """Middle times [s] of equal parts of a motion and the median energy error of each [J], unmoved by short bursts."""
    parts = np.array_split(np.arange(len(motion.t)), min(LEVELS, len(motion.t)))
    error = motion.energy - motion.energy[0]
    return np.array([motion.t[k].mean() for k in parts]), np.array([np.median(error[k]) for k in parts])


def wrong_height(swing: rne.Trajectory) -> np.ndarray:
    """The energy with the height of the wrist's 1 kg as in (6.38), which omits q4, shape (T,) [J]."""
    _, q2, q3, q4, q5, _ = swing.q.T
    lost = np.cos(q2 + q3) * np.sin(q5) * (np.cos(q4) - 1)
    energy: np.ndarray = swing.energy + 9.81 * 0.029 * lost
    return energy


def gravity_slope() -> float:
    """Norm of dg/dq in the stretched position of 6.3-3, where it vanishes [N m/rad]."""
    return float(np.linalg.norm(rne.load("irb140").kernel(rne.dynamics.gravity_torque, "q")(STRETCHED_OUT), 2))


JOBS: dict[str, tuple[Callable[..., Any], tuple[Any, ...]]] = {
    **{f"long {method}": (long_swing, (method,)) for method in LONG_RTOL},
    "sampled 0": (sampled, (0,)),
    "sampled 1": (sampled, (1,)),
    "sampled 2": (sampled, (2,)),
    **{f"6.5.3, run {k + 1}": (variations, (k,)) for k in range(3)},
    "loop 0": (closed_loop, (0,)),
    "loop 1": (closed_loop, (1,)),
    "loop 2": (closed_loop, (2,)),
    "holding": (holding, ()),
    "swings": (swings, ()),
    "equilibrium 7.1-1": (still, ()),
    "equilibrium 7.1-2": (tipping, ()),
    "equilibrium 7.1-2, Euler-Lagrange": (tipping, (rne.dynamics.lagrange_forward_dynamics,)),
    **{f"chapter 7, run {run}": (both, (run,)) for run in RUNS},
    **{f"figure 7.{k + 3}": (same_numbers, (k,)) for k in range(3)},
    "formulations": (costs, ()),
}


def run_all(say: Callable[[str], None]) -> dict[str, Any]:
    """Run every job, the longest first, in up to four processes; results by name."""
    with ProcessPoolExecutor(min(4, os.cpu_count() or 1), mp_context=get_context("spawn")) as pool:
        futures = {name: pool.submit(function, *arguments) for name, (function, arguments) in JOBS.items()}
        return results_as_they_finish(futures, say)


def results_as_they_finish(futures: Mapping[str, Future[Any]], say: Callable[[str], None]) -> dict[str, Any]:
    """Results of jobs by name; each job is reported when it finishes, whatever the order of submission."""
    start = time.perf_counter()
    names = {future: name for name, future in futures.items()}
    found = {}
    for future in as_completed(names):
        found[names[future]] = future.result()
        say(f"  {names[future]}: done after {time.perf_counter() - start:.0f} s, {len(found)} of {len(names)}")
    return found
