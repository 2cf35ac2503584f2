"""Simulation of a robot or a scene over time."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from typing import Any
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import ArrayLike

from ..basics.arrays import check_function, positive_number, real_array
from ..basics.spatial import Array
from ..errors import NotFiniteError, SimulationError, SimulationInterrupted, SingularMassMatrixError
from ..integrators.base import IMPLICIT, RODAS, SAME
from ..integrators.tableaus import EXPLICIT
from ..model.model import joint_array
from ..robot import Robot
from .equations_of_motion import RightHandSide, check_law
from .events import check_within_stops, stops
from .friction import creep
from .loop import Failure, Loop, Run, Task
from .plant import Plant, ZeroOrderHold
from .scene import Scene, scene_of_robot
from .trajectory import Trajectory, between, trajectory_later
from .watch import choose_method, has_rodas5p

TorqueLaw = Callable[[float, Array, Array], ArrayLike]

METHODS = (*EXPLICIT, *IMPLICIT, RODAS)
LEAST = (2.3e-14, 1e-20)  # tolerances: 100 roundings in float64, as SciPy's solvers demand, and far below any state
# Of the run that is compared with another one: times smaller tolerances; the other has an error too; comparisons a step
FINER, MARGIN, COMPARED = 100.0, 1.1, 8
EPS = float(np.finfo(np.float64).eps)
ROUNDING = 1e-9  # of the largest value of a joint: what differs by less has not jumped


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
    breaks: Sequence[float] = (),
    progress: Callable[[float, float], object] | None = None,
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
        "auto", one of SciPy's (RK45, RK23, DOP853, Radau, BDF, LSODA), or "Rodas5P" for stiff motions in machine
        code (engine "numba", a law that is traced or sampled). "auto" begins with an implicit method, Rodas5P or else
        LSODA, if the fastest decay of the loop, linearised at the start, times the duration exceeds 1000 (a stiff loop;
        100 000 where joints stick in machine code), and with DOP853 otherwise; with a sampled controller the sample
        time counts, up to 30, or 150 where a traced law is sampled in machine code, and RK45 replaces DOP853. For this
        a called law is evaluated some times before the run.
    rtol, atol : float
        Relative and absolute tolerance of the state, per step, for SciPy's methods; at least 2.3e-14 and 1e-20.
    t_eval : array_like, shape (T,), optional
        Times to report, ascending within [0, duration] [s].
    breaks : sequence of float
        Instants at which the torques jump, which the solver steps onto exactly; the `breaks` attribute of the
        controller or its reference adds to them [s].
    progress : callable, optional
        A function progress(t, duration), called after steps, a thousand at most, with the time that they reached [s].

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
    SimulationInterrupted
        On Ctrl-C, a KeyboardInterrupt that has them too.

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
    >>> swing.q[-1].round(3)[[2, 4]].tolist()  # joints 3 and 5 fell [rad]
    [0.103, 0.035]
    """
    scene = _scene(scene_or_robot, torque)
    if method != "auto" and method not in METHODS:
        raise ValueError(f"`method` must be 'auto' or one of {list(METHODS)}, got {method!r}")
    robot = scene.resolved.robot
    rhs = _right_hand_side(scene_or_robot, scene)
    if progress is not None:
        check_function("progress", progress, "(t, duration)")
    x0 = np.concatenate([_start("q0", q0, robot), _start("qd0", qd0, robot), np.zeros(rhs.size - 2 * robot.n)])
    end = positive_number("duration", duration, zero_allowed=True)
    times = None if t_eval is None else check_times(t_eval, end)
    relative_and_absolute = tolerances(rtol, atol)
    name = "controller" if torque is None else "torque"
    plant, hold = _plant(scene, rhs, name)
    chosen, reason = (method, f"{method} as requested") if method != "auto" else choose_method(plant, x0, end, hold)
    if chosen == RODAS and not has_rodas5p(plant):
        raise ValueError(
            f"`method` {RODAS!r} runs in machine code: it needs a robot of engine 'numba', a controller that is traced "
            "(rne.traceable) or sampled, and friction that does not stick; 'LSODA' and 'Radau' need none of these"
        )
    ends = stops(robot.model) if scene.stops else []
    check_within_stops(ends, x0)
    breaks = law_breaks(scene.controller, real_array("breaks", breaks, "(k,)").tolist())
    task = Task(x0, end, chosen, *relative_and_absolute, times, breaks, ends, method == "auto", progress)
    run = Loop(plant, task, hold).run()
    repeat = partial(_repeat, scene, rhs, name)
    error = partial(repeated_error, repeat, robot.n, task._replace(progress=None), run)
    motion, failure = build_trajectory(plant, task, run, reason, scene, error_estimate=error)
    if failure is not None:
        message = f"simulation stopped at t = {failure.time:.6g} s of {end:g} s: {failure.cause}"
        raise (SimulationInterrupted if failure.is_interrupt else SimulationError)(message, failure.time, motion)
    plant.verdict.raise_or_warn(stacklevel=2)
    return motion


def tolerances(rtol: float, atol: float) -> tuple[float, float]:
    """Both tolerances; a ValueError for one that rounding exceeds, so that steps would shrink without end."""
    checked = positive_number("rtol", rtol), positive_number("atol", atol)
    for name, value, least in zip(("rtol", "atol"), checked, LEAST, strict=True):
        if value < least:
            raise ValueError(f"`{name}` must be at least {least:g}, as rounding errors exceed less, got {value:g}")
    return checked


def _plant(scene: Scene, rhs: RightHandSide, name: str) -> tuple[Plant, ZeroOrderHold | None]:
    plant = Plant(rhs, scene.controller if rhs.torque_given else None, name)
    return plant, None if scene.sample_time is None else ZeroOrderHold(scene, plant)


def _repeat(scene: Scene, rhs: RightHandSide, name: str, task: Task) -> Run:
    """Another run of the same scene."""
    plant, hold = _plant(scene, rhs, name)
    return Loop(plant, task, hold).run()


def repeated_error(repeat: Callable[[Task], Run], n: int, task: Task, run: Run) -> tuple[Array, Array]:
    """Times, eight in each of the solver's steps, and the largest difference of a position from a more accurate run.

    The other run starts one rounding beside, so that what rounding grows to is seen. Where the tolerances are at
    rounding already, they are coarser, and the difference is an upper bound.

    Parameters
    ----------
    repeat : callable
        Runs a task of the same scene.
    n : int
        Number of positions.
    task : Task
    run : Run
        The result of the task.
    """
    task = task._replace(duration=float(run.t[-1]) if len(run.t) else 0.0)  # of a run that failed or was stopped
    steps = run.t if task.t_eval is None else repeat(task._replace(t_eval=None)).t
    times = between(steps, COMPARED)
    run = repeat(task._replace(t_eval=times))
    factor = 1 / FINER if task.rtol / FINER >= LEAST[0] else FINER
    again = repeat(
        task._replace(
            x0=task.x0 * (1 + EPS),
            rtol=task.rtol * factor,
            atol=max(task.atol * factor, LEAST[1]),
            t_eval=times,
            method=run.method,
            is_auto=False,
        )
    )
    count = min(len(run.t), len(again.t))  # a stop may have come earlier
    difference = np.abs(run.x[:count, :n] - again.x[:count, :n]).max(axis=1, initial=0.0)
    return run.t[:count], MARGIN * difference


def build_trajectory(
    plant: Plant, task: Task, run: Run, reason: str, scene: Any, **known: Any
) -> tuple[Trajectory, Failure | None]:
    """The motion; its torques and energies up to the first instant that is not finite.

    Where no law must be called, they are computed when they are asked for.
    """
    rhs, T = plant.rhs, len(run.t)
    message = f"{reason}; {run.ending}"
    later = partial(_derived, plant, task, run, scene, message)
    failure, derived = run.failure, None
    if failure is not None or plant.law is not None:
        derived = later(may_fail=True)
        found = derived.pop("failure")
        T, failure = len(derived["tau"]), failure or found
        derived |= {"message": failure.cause} if failure else {}
    n = rhs.robot.n
    known |= {
        "t": run.t[:T],
        "q": run.x[:T, :n],
        "qd": run.x[:T, n : 2 * n],
        "evaluations": plant.evaluations,
        "method": run.method,
        "status": -1 if failure else run.status,
        "model": rhs.robot.model,
        "at_steps": task.t_eval is None,
    }
    if derived is None and rhs.friction is None:
        known["message"] = message  # which does not wait for the torques
    return (trajectory_later(known, later) if derived is None else Trajectory(**known, **derived)), failure


def _derived(plant: Plant, task: Task, run: Run, scene: Any, message: str, *, may_fail: bool = False) -> dict[str, Any]:
    """Torques, accelerations and energies of a motion, its jumps and message; the failure where there may be one."""
    robot, n = plant.robot, plant.robot.n
    just_after = np.where(np.isin(run.t, task.breaks), np.nextafter(run.t, np.inf), run.t)
    tau, qdd, failure = _torques_and_accelerations(plant, run._replace(t=just_after), run.held())
    if failure is not None and not may_fail:
        raise NotFiniteError(failure.cause, failure.time)
    T = len(tau)
    qdd = qdd if run.qdd is None else run.qdd[:T]
    t, q, qd = run.t[:T], run.x[:T, :n], run.x[:T, n : 2 * n]
    entries, work = {}, np.zeros(T)
    if run.ledger is not None:
        entries = dict(zip(run.ledger.names, run.ledger.at(t).T, strict=True))
        work = entries.pop("drives", work)
    z = run.x[:T, 2 * n : 2 * n + plant.rhs.controller_states]
    if run.hold is not None:
        samples = run.hold.samples()
        held = samples.held(t, SAME)
        z, work = samples.z[held], samples.work(q, held)
    kinetic, potential = robot.kinetic_energy(q, qd), robot.potential_energy(q)
    q0, qd0 = task.x0[:n], task.x0[n : 2 * n]
    start = float(robot.kinetic_energy(q0, qd0) + robot.potential_energy(q0))
    balance = kinetic + potential - start - work + sum(entries.values(), np.zeros(T))
    ends = run.before_samples() if run.ends is None and task.t_eval is None else run.ends
    jumps, qdd_before, tau_before = _jumps(plant, ends, t, qdd, tau)
    found: dict[str, Any] = {"qdd": qdd, "tau": tau, "kinetic": kinetic, "potential": potential}
    found |= {"energy": kinetic + potential, "controller_state": z, "scene": repr(scene)}
    found |= {"work": work, "dissipated": entries, "energy_start": start}
    found |= {"energy_drift": float(np.abs(balance).max()) if T else 0.0}
    found |= {"jumps": jumps, "qdd_before": qdd_before, "tau_before": tau_before}
    rest = None if "drives" in plant.rhs.ledger or qd0.any() else q0
    crept = "" if plant.rhs.friction is None else creep(plant.rhs.friction, robot, q, qd, qdd, rest)
    found["message"] = f"{crept}; {message}" if crept else message
    return found | {"failure": failure} if may_fail else found


def _jumps(plant: Plant, ends: Run | None, t: Array, qdd: Array, tau: Array) -> tuple[Array, Array, Array]:
    """Times at which accelerations or torques jump, and both just before."""
    if ends is None or not len(ends.t) or not len(t):
        return np.zeros(0), np.zeros((0, plant.robot.n)), np.zeros((0, plant.robot.n))
    tau_before, qdd_before, _ = _torques_and_accelerations(plant, ends, ends.held(0.0))
    if ends.qdd is not None:
        qdd_before = ends.qdd[: len(tau_before)]
    place = np.searchsorted(t, ends.t[: len(tau_before)], side="right")
    reported = place < len(t)
    place, tau_before, qdd_before = place[reported], tau_before[reported], qdd_before[reported]
    jumps = np.zeros(len(place), dtype=bool)
    for values, before in ((tau, tau_before), (qdd, qdd_before)):
        jumps |= (np.abs(values[place] - before) > ROUNDING * np.abs(values).max(axis=0)).any(axis=-1)
    return t[place[jumps]], qdd_before[jumps], tau_before[jumps]


def _torques_and_accelerations(plant: Plant, run: Run, u: Array | None) -> tuple[Array, Array, Failure | None]:
    """Torques and accelerations of every instant up to the first that is not finite or where M is singular."""
    n = plant.robot.n
    try:
        given = plant.torques_at(run.t, run.x) if u is None and plant.law is not None else u
        rates = plant.all_rates(run.t, run.x, given)
        drives = plant.drives_under(run.t, run.x, given)
        tau = np.zeros((len(run.t), n)) if drives is None else drives
        return tau, rates[:, n : 2 * n], None
    except (NotFiniteError, SingularMassMatrixError, ValueError):  # found by looking at each
        return _one_by_one(plant, run, u)


def _one_by_one(plant: Plant, run: Run, held: Array | None) -> tuple[Array, Array, Failure | None]:
    n = plant.robot.n
    tau, qdd = np.zeros((len(run.t), n)), np.zeros((len(run.t), n))
    for k, (time, x) in enumerate(zip(run.t.tolist(), run.x, strict=True)):
        try:
            u = plant.torque(time, x) if held is None else held[k]
            drives, _ = plant.rhs.drives(np.array([time]), x, u)
            tau[k] = 0.0 if drives is None else drives
            qdd[k] = plant.rates(time, x, u)[n : 2 * n]
        except (NotFiniteError, SingularMassMatrixError) as error:
            return tau[:k], qdd[:k], Failure(time, str(error))
    return tau, qdd, None


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
        self.breaks = law_breaks(law)

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


def law_breaks(law: Any, further: Sequence[float] = ()) -> list[float]:
    """Instants at which a law's torques jump, and others."""
    owners = ("controller", law), ("controller.reference", getattr(law, "reference", None))
    given = [real_array(f"{name}.breaks", getattr(owner, "breaks", ()), "(k,)") for name, owner in owners]
    of_law = np.concatenate(given).tolist()
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
