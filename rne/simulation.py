"""Motion of an arm over time: SciPy's solvers on x = (q, qd), with an energy account."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from .arguments import joint_array, positive_number, real_array
from .errors import NotFiniteError, RneError, SimulationError, SingularMassMatrixError
from .plant import Plant
from .robot import Robot
from .spatial import Array

TorqueLaw = Callable[[float, Array, Array], ArrayLike]

METHODS = ("RK45", "RK23", "DOP853", "Radau", "BDF", "LSODA")
IMPLICIT = ("Radau", "BDF", "LSODA")
# Fastest decay times duration above which an explicit method is held to tiny steps by stability alone:
# DOP853 reaches about 6 time constants a step, so this is some 200 steps that accuracy does not ask for.
STIFF = 1000.0
NO_SAY = 1e100  # absolute tolerance of the work, which is a result and not part of the state


@dataclass(frozen=True)
class Trajectory:
    """A simulated motion.

    Attributes
    ----------
    t : ndarray, shape (T,)
        [s]; `t_eval` exactly if it was given, otherwise the solver's own steps.
    q, qd, qdd, tau : ndarray, shape (T, n)
        Joint positions, rates, accelerations and drive torques [rad or m, /s, /s^2, N m or N].
    kinetic, potential, energy, work : ndarray, shape (T,)
        Energies, their sum, and the work the drives have done since the start [J].
    energy_drift : float
        Largest |energy - energy at the start - work| [J]: what the solver's errors have created or lost.
    evaluations : int
        Calls of the right-hand side, those for Jacobians included.
    method : str
        The solver that ran.
    status : int
        0 if the end was reached, 1 if an event of the scene stopped the run, -1 if it failed.
    message : str
        Why this method, and how the run ended.
    """

    t: Array
    q: Array
    qd: Array
    qdd: Array
    tau: Array
    kinetic: Array
    potential: Array
    energy: Array
    work: Array
    energy_drift: float
    evaluations: int
    method: str
    status: int
    message: str


def simulate(
    scene_or_robot: Robot,
    q0: ArrayLike,
    qd0: ArrayLike,
    duration: float,
    *,
    torque: ArrayLike | TorqueLaw | None = None,
    method: str = "auto",
    rtol: float = 1e-6,
    atol: float = 1e-9,
    t_eval: ArrayLike | None = None,
) -> Trajectory:
    """Simulate an arm from a start, under given torques.

    Parameters
    ----------
    scene_or_robot : Robot
    q0, qd0 : array_like, shape (n,)
        Joint positions and rates at the start [rad or m, /s].
    duration : float
        [s]
    torque : array_like, shape (n,), or callable f(t, q, qd) -> (n,), optional
        Drive torques [N m or N]; none if not given.
    method : str
        "auto", or one of SciPy's: RK45, RK23, DOP853, Radau, BDF, LSODA. "auto" takes LSODA if the loop, linearised
        at the start, decays so fast that an explicit method would be held to tiny steps, and DOP853 otherwise.
    rtol, atol : float
        Relative and absolute tolerance of the state, per step.
    t_eval : array_like, shape (T,), optional
        Times to report, ascending within [0, duration] [s].

    Returns
    -------
    Trajectory

    Raises
    ------
    ValueError
        If an argument has the wrong shape, is not finite or is out of range.
    SimulationError
        If a state or torque is not finite, M becomes singular, or the solver gives up before the end; has the time
        and the trajectory so far.

    Notes
    -----
    Joint limits, friction and drives' limits are not modelled. The drives' work rides along as one more state that
    has no say in the step size.

    Examples
    --------
    >>> import rne
    >>> swing = rne.simulate(rne.load("irb140"), [0] * 6, [0] * 6, 0.1)
    >>> swing.method, swing.energy_drift < 1e-6
    ('DOP853', True)
    """
    robot = scene_or_robot
    if not isinstance(robot, Robot):
        raise TypeError(f"`scene_or_robot` must be an rne.Robot, got {type(robot).__name__}")
    if method != "auto" and method not in METHODS:
        raise ValueError(f"`method` must be 'auto' or one of {list(METHODS)}, got {method!r}")
    x0 = np.concatenate([_start("q0", q0, robot), _start("qd0", qd0, robot), np.zeros(0 if torque is None else 1)])
    end = positive_number("duration", duration, zero_allowed=True)
    times = None if t_eval is None else _check_times(t_eval, end)
    tolerances = positive_number("rtol", rtol), positive_number("atol", atol)
    plant = Plant(robot, _torque_law(robot, torque), works=torque is not None)
    chosen, reason = (method, f"{method} as asked") if method != "auto" else choose_method(plant, x0, end)
    return _run(plant, x0, end, chosen, reason, tolerances, times)


def choose_method(plant: Plant, x0: Array, duration: float) -> tuple[str, str]:
    """The solver for this run, and why: the fastest decaying mode of the loop linearised at the start decides."""
    try:
        A = plant.jacobian(0.0, x0)[: 2 * plant.robot.n, : 2 * plant.robot.n]
    except RneError:
        return "DOP853", "DOP853: the loop cannot be linearised at the start"
    if not A.size or not np.isfinite(A).all():
        return "DOP853", "DOP853: nothing to linearise at the start"
    decay = float(max(-np.linalg.eigvals(A).real.min(), 0.0))
    if decay * duration > STIFF:
        return "LSODA", (
            f"LSODA: stiff, the fastest mode at the start decays at {decay:.4g} 1/s, "
            f"{decay * duration:.3g} times over the run (more than {STIFF:g})"
        )
    return "DOP853", (
        f"DOP853: not stiff, the fastest mode at the start decays at {decay:.4g} 1/s, "
        f"{decay * duration:.3g} times over the run (at most {STIFF:g})"
    )


def _run(
    plant: Plant,
    x0: Array,
    duration: float,
    method: str,
    reason: str,
    tolerances: tuple[float, float],
    t_eval: Array | None,
) -> Trajectory:
    failures: list[tuple[float, str]] = []
    if duration == 0 or plant.robot.n == 0:  # nothing moves, and SciPy's solvers divide by either
        t = np.unique([0.0, duration]) if t_eval is None else t_eval
        y, ending = np.tile(x0, (len(t), 1)), "nothing to integrate"
    else:
        t, y, ending = _solve(plant, x0, duration, method, tolerances, t_eval, failures)
    trajectory = _trajectory(plant, t, y, method, f"{reason}; {ending}", failures)
    if not failures:
        return trajectory
    time, cause = failures[0]
    raise SimulationError(f"simulation stopped at t = {time:.6g} s of {duration:g} s: {cause}", time, trajectory)


def _solve(
    plant: Plant,
    x0: Array,
    duration: float,
    method: str,
    tolerances: tuple[float, float],
    t_eval: Array | None,
    failures: list[tuple[float, str]],
) -> tuple[Array, Array, str]:
    """Times, states and SciPy's last word; what goes wrong is added to `failures`."""
    from scipy.integrate import solve_ivp

    from .solvers import FAILURES, watched

    rtol, atol = tolerances
    atols = np.full(len(x0), atol)
    if plant.works:
        atols[-1] = NO_SAY
        # All methods but LSODA take the mean square error of the components: one that is always 0 must not dilute it.
        undiluted = 1.0 if method == "LSODA" else float(np.sqrt(1 - 1 / len(x0)))
        rtol, atols = rtol * undiluted, atols * undiluted
    options: dict[str, Any] = {"jac": plant.jacobian} if method in IMPLICIT else {}
    solver = watched(method, failures)
    try:
        solution = solve_ivp(plant, (0.0, duration), x0, method=solver, rtol=rtol, atol=atols, t_eval=t_eval, **options)
    except FAILURES as error:  # at the very start, before a first step
        failures.append((0.0, str(error)))
        return np.zeros(0), np.zeros((0, len(x0))), ""
    t = np.asarray(solution.t, dtype=float)
    return t, np.asarray(solution.y, dtype=float).T.reshape(len(t), len(x0)), str(solution.message)


def _trajectory(
    plant: Plant, t: Array, y: Array, method: str, message: str, failures: list[tuple[float, str]]
) -> Trajectory:
    """The motion with its torques and energies; samples from one on that is not finite are left out."""
    n = plant.robot.n
    evaluations = plant.evaluations
    tau, qdd = np.zeros((len(t), n)), np.zeros((len(t), n))
    sound = 0
    for time, x in zip(t, y, strict=True):
        q, qd = x[:n], x[n : 2 * n]
        try:
            tau[sound] = plant.torque(float(time), q, qd)
            qdd[sound] = plant.robot.forward_dynamics(q, qd, tau[sound])
        except (NotFiniteError, SingularMassMatrixError) as error:
            failures.append((float(time), str(error)))
            break
        sound += 1
    t, y, tau, qdd = t[:sound], y[:sound], tau[:sound], qdd[:sound]
    q, qd = y[:, :n], y[:, n : 2 * n]
    work = y[:, 2 * n] if plant.works else np.zeros(len(t))
    kinetic, potential = plant.robot.kinetic_energy(q, qd), plant.robot.potential_energy(q)
    energy = kinetic + potential
    drift = float(np.abs(energy - energy[0] - work).max()) if len(t) else 0.0
    status = -1 if failures else 0
    message = failures[0][1] if failures else message
    return Trajectory(t, q, qd, qdd, tau, kinetic, potential, energy, work, drift, evaluations, method, status, message)


def _torque_law(robot: Robot, torque: ArrayLike | TorqueLaw | None) -> TorqueLaw:
    if callable(torque):
        return torque
    constant = np.zeros(robot.n) if torque is None else joint_array("torque", torque, robot.model)
    real_array("torque", constant, f"({robot.n},)")
    if constant.shape != (robot.n,):
        raise ValueError(f"`torque` must have shape ({robot.n},), got {constant.shape}")
    return lambda t, q, qd: constant


def _start(name: str, value: ArrayLike, robot: Robot) -> Array:
    array = joint_array(name, value, robot.model)
    real_array(name, array, f"({robot.n},)")
    if array.ndim != 1:
        raise ValueError(f"`{name}` must have shape ({robot.n},), one state, got {array.shape}")
    return array.astype(np.float64)


def _check_times(t_eval: ArrayLike, duration: float) -> Array:
    times = real_array("t_eval", t_eval, "(T,)").astype(np.float64)
    if times.ndim != 1:
        raise ValueError(f"`t_eval` must have shape (T,), got {times.shape}")
    if times.size and (times[0] < 0 or times[-1] > duration or (np.diff(times) <= 0).any()):
        raise ValueError(f"`t_eval` must ascend within [0, {duration:g}], got {times.min():g} ... {times.max():g}")
    return times
