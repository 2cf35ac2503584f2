"""Simulation of a robot or a scene over time."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import nullcontext
from dataclasses import replace
from functools import partial

import numpy as np
from numpy.typing import ArrayLike

from ..basics.arrays import check_function, positive_number, real_array
from ..basics.spatial import Array
from ..control.law_numbers import law_breaks
from ..control.traced_law import check_law, one_at_a_time
from ..errors import SimulationError, SimulationInterrupted
from ..integrators.base import IMPLICIT, RODAS
from ..integrators.tableaus import EXPLICIT
from ..robot import Robot
from .dry_friction import DryPlant
from .events import check_within_stops, stops
from .method_choice import choose_method, has_rodas5p
from .plant import Plant
from .run import MIN_TOLERANCES, Run, RunResult, Task
from .scene import Scene
from .scene_dynamics import SceneDynamics
from .trajectory import Trajectory
from .zero_order_hold import ZeroOrderHold

TorqueLaw = Callable[[float, Array, Array], ArrayLike]

METHODS = (*EXPLICIT, *IMPLICIT, RODAS)


def simulate(
    scene_or_robot: Scene | Robot,
    q0: ArrayLike,
    qd0: ArrayLike,
    duration: float,
    *,
    torque: ArrayLike | TorqueLaw | None = None,
    numbers: Mapping[str, ArrayLike] | None = None,
    method: str = "auto",
    rtol: float = 1e-6,
    atol: float = 1e-9,
    t_eval: ArrayLike | None = None,
    breaks: Sequence[float] = (),
    progress: Callable[[float, float], object] | None = None,
) -> Trajectory:
    """Simulate a robot or a scene from an initial state.

    Parameters
    ----------
    scene_or_robot : Scene or Robot
        What to simulate.
    q0, qd0 : array_like, shape (n,)
        Initial joint positions and velocities [rad or m; rad/s or m/s]. Motors of elastic joints start with the links'
        velocities, where torsion holds the links at rest, or as given after the links, shape (2 n,).
    duration : float
        Time to simulate [s].
    torque : array_like, shape (n,), or callable f(t, q, qd) -> (n,), optional
        Drive torques, for a robot or a scene without a controller; zero if not given [N m or N].
    numbers : mapping of str to array_like, optional
        Numbers of the scene instead of its own, as `Scene.with_numbers` takes them: gains, friction, limits, bodies.
    method : str
        "auto", one of SciPy's (RK45, RK23, DOP853, Radau, BDF, LSODA), "Tsit5", more accurate than RK45 for the same
        number of evaluations, or "Rodas5P" for stiff motions in machine code (engine "numba", a law that is traced or
        sampled).
        "auto" begins with an implicit method, Rodas5P or else LSODA, if the fastest decay of the loop, linearised at
        the start, times the duration exceeds 1000 (a stiff loop; 100 000 where joints stick in machine code), and with
        DOP853 otherwise. With a sampled controller the sample time counts, up to 30, or 150 where a traced law is
        sampled in machine code, and Tsit5 replaces DOP853. A called law is evaluated a few times for this.
    rtol, atol : float
        Relative and absolute tolerance of the state, per step, for SciPy's methods; at least 2.3e-14 and 1e-20.
    t_eval : array_like, shape (T,), optional
        Times to report, ascending within [0, duration] [s].
    breaks : sequence of float
        Instants at which the torques jump, which the solver steps onto exactly; the `breaks` attribute of the
        controller or its reference adds to them [s].
    progress : callable, optional
        A function progress(t, duration), called after every thousand steps or fewer, with the time reached [s].

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
        If a state or torque is not finite, M becomes singular, the solver fails, a law chatters or raises an
        ArithmeticError, or a sampled loop diverges before the end; has the time and the trajectory so far, and the
        error of a law as its cause. Other errors of your own functions are not changed.
    SimulationInterrupted
        On Ctrl-C, a KeyboardInterrupt with the time and the trajectory so far.

    Notes
    -----
    A Robot is simulated without friction, stops or limits: those are parts of a Scene. The work of the drives and the
    losses by friction are states of the motion, whose errors hardly hold back a step. Runs of "auto" that begin with
    DOP853 or Tsit5 continue with LSODA where stability, not accuracy, limits the steps. In machine code they continue
    with Rodas5P, and return where stiffness ends or the earlier method covered more time per operation. The message
    lists the changes.

    Examples
    --------
    >>> import rne
    >>> swing = rne.simulate(rne.load("irb140"), [0] * 6, [0] * 6, 0.1)
    >>> swing.method, swing.energy_drift < 1e-6
    ('DOP853', True)
    >>> swing.q[-1].round(3)[[2, 4]].tolist()  # joints 3 and 5 fell [rad]
    [0.103, 0.035]
    """
    scene = _with_torque(scene_argument(scene_or_robot), torque)
    scene = scene if numbers is None else scene.with_numbers(numbers)
    if method != "auto" and method not in METHODS:
        raise ValueError(f"`method` must be 'auto' or one of {list(METHODS)}, got {method!r}")
    if progress is not None:
        check_function("progress", progress, "(t, duration)")
    robot, dynamics = scene.resolved.robot, scene.dynamics
    end, further = positive_number("duration", duration, zero_allowed=True), real_array("breaks", breaks, "(k,)")
    times = None if t_eval is None else check_times(t_eval, end)
    q, qd = dynamics.start(robot, q0, qd0)
    x0 = np.concatenate([one_state("q0", q), one_state("qd0", qd), np.zeros(dynamics.size - 2 * dynamics.n)])
    breaks, ends = law_breaks(scene.controller, further.tolist()), stops(robot.model) if scene.stops else []
    task = Task(x0, end, method, *tolerances(rtol, atol), times, breaks, ends, method == "auto", progress)
    called = scene.controller.law if isinstance(scene.controller, CalledLaw) else scene.controller
    with one_at_a_time(called) if dynamics.law is None else nullcontext():
        run = _run(scene, dynamics, "controller" if torque is None else "torque", task)
        motion, failure = run.trajectory()
    if failure is not None:
        message = f"simulation stopped at t = {failure.time:.6g} s of {end:g} s: {failure.cause}"
        kind = SimulationInterrupted if failure.is_interrupt else SimulationError
        raise kind(message, failure.time, motion) from failure.error
    run.plant.status.raise_or_warn(stacklevel=2)
    return motion


def _run(scene: Scene, dynamics: SceneDynamics, law_name: str, task: Task) -> RunResult:
    """One run of a scene, by the method that suits it where that is "auto"."""
    robot, law = scene.resolved.robot, scene.controller if dynamics.inputs == "called" else None
    plant = (DryPlant if dynamics.sticks else Plant)(dynamics, robot, law, law_name, scene.kernels)
    hold = None if scene.sample_time is None else ZeroOrderHold(scene, plant, task.duration)
    method, reason = task.method, f"{task.method} as requested"
    if method == "auto":
        method, reason = choose_method(plant, task.x0, task.duration, hold)
    if method == RODAS and not has_rodas5p(plant):
        raise ValueError(
            f"`method` {RODAS!r} runs in machine code: it needs a robot of engine 'numba', a controller that is traced "
            "(rne.traceable) or sampled, and friction that does not stick; 'LSODA' and 'Radau' need none of these"
        )
    check_within_stops(task.stops, task.x0)
    result = Run(plant, task._replace(method=method), hold).result()
    result.ending, result.scene = f"{reason}; {result.ending}", scene
    result.repeat = partial(_run, scene, dynamics, law_name)
    return result


def tolerances(rtol: float, atol: float) -> tuple[float, float]:
    """Both tolerances; a ValueError for one below rounding, for which steps would shrink without end."""
    checked = positive_number("rtol", rtol), positive_number("atol", atol)
    for name, value, least in zip(("rtol", "atol"), checked, MIN_TOLERANCES, strict=True):
        if value < least:
            raise ValueError(f"`{name}` must be at least {least:g}, as rounding errors exceed less, got {value:g}")
    return checked


def scene_argument(scene_or_robot: Scene | Robot, name: str = "scene_or_robot") -> Scene:
    """Scene given, or a scene of only a robot."""
    if not isinstance(scene_or_robot, Scene | Robot):
        raise TypeError(f"`{name}` must be an rne.Scene or rne.Robot, got {type(scene_or_robot).__name__}")
    return Scene(scene_or_robot) if isinstance(scene_or_robot, Robot) else scene_or_robot


class CalledLaw:
    """Wrapper that prevents tracing; keeps the law's breaks."""

    def __init__(self, law: TorqueLaw) -> None:
        self.law = law
        self.breaks = law_breaks(law)

    def __call__(self, t: float, q: Array, qd: Array) -> ArrayLike:
        return self.law(t, q, qd)


def _with_torque(scene: Scene, torque: ArrayLike | TorqueLaw | None) -> Scene:
    """Scene with a called torque law, if one is given; not traced, as it may change between runs."""
    if torque is None:
        return scene
    if scene.controller is not None:
        raise ValueError("`torque` cannot be given for a scene that has a controller")
    if callable(torque):
        if hasattr(torque, "states"):
            raise ValueError("`torque` with states needs a scene: rne.Scene(robot, controller=...)")
        check_law("torque", torque)
        return replace(scene, controller=CalledLaw(torque))
    constant = real_array("torque", torque, f"({scene.n},)")
    return replace(scene, controller=lambda t, q, qd: constant)


def one_state(name: str, array: Array) -> Array:
    """Initial array, checked to have the shape of one motion."""
    if array.ndim == 1 and array.dtype == np.float64:
        return array
    return real_array(name, array, f"({array.shape[-1]},), one state").astype(np.float64)


def check_times(t_eval: ArrayLike, duration: float) -> Array:
    """Times to report, ascending within the run."""
    times = real_array("t_eval", t_eval, "(T,)").astype(np.float64)
    if times.size and (times[0] < 0 or times[-1] > duration or (np.diff(times) <= 0).any()):
        raise ValueError(f"`t_eval` must ascend within [0, {duration:g}], got {times.min():g} ... {times.max():g}")
    return times
