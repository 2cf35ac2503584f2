"""Simulation of a robot or a scene over time."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from typing import Any
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import ArrayLike

from ..basics.arrays import positive_number, real_array
from ..basics.spatial import Array
from ..errors import SimulationError
from ..model.model import joint_array
from ..robot import Robot
from .compiled import has_rodas5p
from .equations_of_motion import RightHandSide
from .events import check_within_stops, stops
from .law import check_law
from .loop import Loop
from .plant import Plant
from .run import Run, Task, build_trajectory, repeated_error
from .sampled import ZeroOrderHold
from .scene import Scene, scene_of_robot
from .solver import EXPLICIT, GAUSS, IMPLICIT, RODAS
from .trajectory import Trajectory
from .watch import STIFF, fastest_decay, sample_bound, stiff_bound, stiff_method

TorqueLaw = Callable[[float, Array, Array], ArrayLike]

METHODS = (*EXPLICIT, *IMPLICIT, RODAS)
LEAST = (2.3e-14, 1e-20)  # tolerances: 100 roundings in float64, as SciPy's solvers demand, and far below any state


def simulate(
    scene_or_robot: Scene | Robot,
    q0: ArrayLike,
    qd0: ArrayLike,
    duration: float,
    *,
    torque: ArrayLike | TorqueLaw | None = None,
    method: str = "auto",
    rtol: float = 1e-6,
    atol: float = 1e-9,
    t_eval: ArrayLike | None = None,
    step: float | None = None,
    breaks: Sequence[float] = (),
) -> Trajectory:
    """Simulate a robot or a scene from an initial state.

    Parameters
    ----------
    scene_or_robot : Scene or Robot
        What moves.
    q0, qd0 : array_like, shape (n,)
        Initial joint positions and velocities [rad or m; rad/s or m/s].
    duration : float
        Time to simulate [s].
    torque : array_like, shape (n,), or callable f(t, q, qd) -> (n,), optional
        Drive torques, for a robot or a scene without a controller; zero if not given [N m or N].
    method : str
        "auto", one of SciPy's (RK45, RK23, DOP853, Radau, BDF, LSODA), "Rodas5P" for stiff motions in machine code
        (engine "numba", a law that is traced or sampled), or for long motions without drives and friction "gauss-4",
        whose energy error stays bounded. "auto" begins with an implicit method, Rodas5P or else LSODA, if the fastest
        decay of the loop, linearised at the start, times the duration exceeds 1000 (a stiff loop; 100 000 where joints
        stick in machine code), and with DOP853 otherwise; with a sampled controller the sample time counts, up to 30,
        or 150 where a traced law is sampled in machine code, and RK45 replaces DOP853. For this a called law is
        evaluated some times before the run.
    rtol, atol : float
        Relative and absolute tolerance of the state, per step, for SciPy's methods; at least 2.3e-14 and 1e-20.
    t_eval : array_like, shape (T,), optional
        Times to report, ascending within [0, duration] [s].
    step : float, optional
        Longest step of "gauss-4", whose steps are equal [s].
    breaks : sequence of float
        Instants at which the torques jump, which the solver steps onto exactly; the `breaks` attribute of the
        controller or its reference adds to them [s].

    Returns
    -------
    Trajectory
        The motion at the solver's steps, or at `t_eval`.

    Raises
    ------
    ValueError
        If an argument has the wrong shape, is not finite or is out of range.
    TypeError
        If `scene_or_robot` is neither, or `torque` takes other arguments.
    SimulationError
        If a state or torque is not finite, M becomes singular, the solver fails, a law chatters, or a sampled loop
        diverges before the end; has the time and the trajectory so far.

    Notes
    -----
    A Robot is simulated without friction, stops or limits: those are parts of a Scene. The energies of the ledger are
    the integrals of the powers along the motion that is returned. Runs of "auto" that begin with DOP853 or RK45 go on
    with LSODA from where stability, not accuracy, limits the steps; in machine code they go on with Rodas5P, back where
    that ends, and with the method before where that covered more time per operation. The message says so.

    Examples
    --------
    >>> import rne
    >>> swing = rne.simulate(rne.load("irb140"), [0] * 6, [0] * 6, 0.1)
    >>> swing.method, swing.energy_drift < 1e-6
    ('DOP853', True)
    """
    scene = _scene(scene_or_robot, torque)
    known = (*METHODS, GAUSS)
    if method != "auto" and method not in known:
        raise ValueError(f"`method` must be 'auto' or one of {list(known)}, got {method!r}")
    robot = scene.resolved.robot
    rhs = _right_hand_side(scene_or_robot, scene)
    x0 = np.concatenate([_start("q0", q0, robot), _start("qd0", qd0, robot), np.zeros(rhs.size - 2 * robot.n)])
    end = positive_number("duration", duration, zero_allowed=True)
    times = None if t_eval is None else check_times(t_eval, end)
    relative, absolute = tolerances(rtol, atol)
    longest_step = None if step is None else positive_number("step", step)
    name = "controller" if torque is None else "torque"
    plant, hold = _plant(scene, rhs, name)
    chosen, reason = (method, f"{method} as requested") if method != "auto" else choose_method(plant, x0, end, hold)
    _check_method(chosen, step, scene, plant)
    ends = stops(robot.model) if scene.stops else []
    check_within_stops(ends, x0)
    task = Task(
        x0, end, chosen, relative, absolute, times, longest_step, _breaks(scene, breaks), ends, method == "auto"
    )
    motion = _run(plant, task, hold, reason, scene, lambda other: _repeat(scene, rhs, name, other))
    plant.verdict.raise_or_warn(stacklevel=2)
    return motion


def tolerances(rtol: float, atol: float) -> tuple[float, float]:
    """Both tolerances; a ValueError for one that rounding exceeds, so that steps would shrink without end."""
    checked = positive_number("rtol", rtol), positive_number("atol", atol)
    for name, value, least in zip(("rtol", "atol"), checked, LEAST, strict=True):
        if value < least:
            raise ValueError(f"`{name}` must be at least {least:g}, as rounding errors exceed less, got {value:g}")
    return checked


def _check_method(method: str, step: float | None, scene: Scene, plant: Plant) -> None:
    if method == RODAS and not has_rodas5p(plant):
        raise ValueError(
            f"`method` {RODAS!r} runs in machine code: it needs a robot of engine 'numba', a controller that is traced "
            "(rne.traceable) or sampled, and friction that does not stick; 'LSODA' and 'Radau' need none of these"
        )
    if method == GAUSS:
        _check_free(scene, method)
    elif step is not None:
        raise ValueError(f"`step` is for the equal steps of {GAUSS!r}; {method!r} chooses its own")


def choose_method(plant: Plant, x0: Array, duration: float, hold: ZeroOrderHold | None) -> tuple[str, str]:
    """The solver to begin with, and why: the fastest decaying mode of the motion linearised at the start decides."""
    if plant.is_conservative:
        return "DOP853", "DOP853: not stiff, nothing damps the motion"
    decay = fastest_decay(plant, 0.0, x0)
    explicit = "DOP853" if hold is None else "RK45"
    if not np.isfinite(decay):
        return explicit, f"{explicit}: the motion cannot be linearised at the start"
    if hold is None:
        times, bound, over = decay * duration, stiff_bound(plant), "times over the run"
    else:
        times, bound, over = decay * hold.period, sample_bound(plant, hold), "times between two samples"
    if times > bound:
        method = stiff_method(plant)
        if method == "LSODA" and hold is not None and times > STIFF:
            method = "Radau"  # LSODA, which begins anew at each sample with short steps, needs more
        why = f"stiff, the fastest mode at the start decays at {decay:.4g} 1/s, {times:.3g} {over} (> {bound:g})"
        return method, f"{method}: {why}"
    why = f"not stiff, no mode at the start decays faster than {decay:.4g} 1/s, {times:.3g} {over} (<= {bound:g})"
    return explicit, f"{explicit}: {why}"


def _plant(scene: Scene, rhs: RightHandSide, name: str) -> tuple[Plant, ZeroOrderHold | None]:
    plant = Plant(rhs, scene.controller if rhs.torque_given else None, name)
    return plant, None if scene.sample_time is None else ZeroOrderHold(scene, plant)


def _repeat(scene: Scene, rhs: RightHandSide, name: str, task: Task) -> Run:
    """Another run of the same scene."""
    plant, hold = _plant(scene, rhs, name)
    return Loop(plant, task, hold).run()


def _run(
    plant: Plant, task: Task, hold: ZeroOrderHold | None, reason: str, scene: Scene, repeat: Callable[[Task], Run]
) -> Trajectory:
    run = Loop(plant, task, hold).run()
    error = partial(repeated_error, repeat, plant.robot.n, task, run)
    motion, failure = build_trajectory(plant, task, run, reason, scene, error_estimate=error)
    if failure is None:
        return motion
    raise SimulationError(
        f"simulation stopped at t = {failure.time:.6g} s of {task.duration:g} s: {failure.cause}", failure.time, motion
    )


def _scene(scene_or_robot: Scene | Robot, torque: ArrayLike | TorqueLaw | None) -> Scene:
    if isinstance(scene_or_robot, Scene):
        if torque is None:
            return scene_or_robot
        if scene_or_robot.controller is not None:
            raise ValueError("`torque` cannot be given for a scene that has a controller")
        return _with_law(scene_or_robot, torque)
    if not isinstance(scene_or_robot, Robot):
        raise TypeError(f"`scene_or_robot` must be an rne.Scene or rne.Robot, got {type(scene_or_robot).__name__}")
    scene = scene_of_robot(scene_or_robot)
    return scene if torque is None else _with_law(scene, torque)


class CalledLaw:
    """Wrapper that prevents tracing; keeps the law's breaks."""

    def __init__(self, law: TorqueLaw) -> None:
        self.law = law
        self.breaks = (*getattr(law, "breaks", ()), *getattr(getattr(law, "reference", None), "breaks", ()))

    def __call__(self, t: float, q: Array, qd: Array) -> ArrayLike:
        return self.law(t, q, qd)


def _with_law(scene: Scene, torque: ArrayLike | TorqueLaw) -> Scene:
    """The scene with a torque law that is called, not traced, as it may change between runs."""
    if callable(torque):
        if hasattr(torque, "states"):
            raise ValueError("`torque` with states needs a scene: rne.Scene(robot, controller=...)")
        check_law("torque", torque)
        return replace(scene, controller=CalledLaw(torque))
    n = scene.n
    constant = real_array("torque", torque, f"({n},)")
    return replace(scene, controller=lambda t, q, qd: constant)


_DRIVEN: WeakKeyDictionary[Robot, RightHandSide] = WeakKeyDictionary()


def _right_hand_side(given: Scene | Robot, scene: Scene) -> RightHandSide:
    """The scene's right-hand side; for a robot one for all torque laws, kept as long as the robot."""
    if isinstance(given, Scene) or scene.controller is None:
        return scene.current_right_hand_side()
    return _DRIVEN.setdefault(given, scene.right_hand_side)


def _check_free(scene: Scene, method: str) -> None:
    named = [name for name in ("controller", "friction") if getattr(scene, name) is not None]
    if scene.formulation != "newton-euler":
        raise ValueError(f"`method` {method!r} is for the formulation 'newton-euler', got {scene.formulation!r}")
    if named or scene.stops:
        there = ", ".join(named) or "stops"
        raise ValueError(f"`method` {method!r} is for motions without drives, friction and stops; there is {there}")


def _breaks(scene: Scene, breaks: Sequence[float]) -> list[float]:
    own = real_array("breaks", breaks, "(k,)")
    return law_breaks(scene.controller, own.tolist())


def law_breaks(law: Any, further: Sequence[float] = ()) -> list[float]:
    """Instants at which a law's torques jump, and others."""
    of_law = [*getattr(law, "breaks", ()), *getattr(getattr(law, "reference", None), "breaks", ())]
    found: list[float] = []
    for instant in sorted({*further, *of_law}):
        if not found or instant - found[-1] > 1e-12 * max(1.0, abs(instant)):  # equal up to rounding
            found.append(float(instant))
    return found


def _start(name: str, value: ArrayLike, robot: Robot) -> Array:
    array = joint_array(name, value, robot.model)
    return real_array(name, array, f"({robot.n},), one state").astype(np.float64)


def check_times(t_eval: ArrayLike, duration: float) -> Array:
    """Times to report, ascending within the run."""
    times = real_array("t_eval", t_eval, "(T,)").astype(np.float64)
    if times.size and (times[0] < 0 or times[-1] > duration or (np.diff(times) <= 0).any()):
        raise ValueError(f"`t_eval` must ascend within [0, {duration:g}], got {times.min():g} ... {times.max():g}")
    return times
