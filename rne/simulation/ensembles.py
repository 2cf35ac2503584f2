"""Many initial states of one scene simulated at once."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from ..basics.arrays import positive_number, real_array, real_numbers
from ..basics.spatial import Array
from ..basics.text import counted, short
from ..kernels.runge_kutta import CONTROLLED, FIXED, power
from ..model.model import Model, joint_array
from ..model.parameters import PARAMETERS
from ..robot import Robot
from .ensemble_runs import Chunk, OneByOne, Plan, Progress, SideBySide, courses, run_all
from .scene import Scene, scene_of_robot
from .simulator import METHODS, check_times, law_breaks, tolerances

if TYPE_CHECKING:
    from concurrent.futures import Executor

QUANTITIES = ("q", "qd", "tau")  # of each motion


@dataclass(frozen=True, eq=False)
class Ensemble:
    """Motions from many initial states.

    Attributes
    ----------
    t : ndarray, shape (S,)
        Stored times [s].
    q, qd : ndarray, shape (S, N, n)
        Positions and velocities of each motion at these times [rad or m; rad/s or m/s].
    tau : ndarray, shape (S, N, n)
        Torques of the drives at these times, zero without a controller [N m or N].
    energies : ndarray, shape (S, N, k)
        Energies of the ledger [J].
    ledger : tuple of str, length k
        "drives", "viscous", "coulomb": those that the scene has.
    method : str
        The method that ran; several are joined by commas.
    step : float or None
        Length of the longest step, where these are fixed [s].
    evaluations : int
        Evaluations of the right-hand side, counted per state.
    end : ndarray, shape (N,)
        Time at which each motion ended: the duration, or that of its stop [s].
    status : ndarray of int, shape (N,)
        0 of motions that reached the duration, 1 of those that ended at a stop, whose values later than that are those
        at the stop.
    model : Model
        The robot that moved.
    parameters : ndarray, shape (N, 10 nb), or None
        Inertial parameters of the robot of each motion; None if all had the robot's own.

    Examples
    --------
    >>> import numpy as np, rne
    >>> starts = np.random.default_rng(0).uniform(-1, 1, (10, 6))
    >>> motions = rne.ensemble(rne.load("irb140"), starts, 0 * starts, 0.1, t_eval=[0, 0.05, 0.1])
    >>> motions.t.tolist(), motions.q.shape
    ([0.0, 0.05, 0.1], (3, 10, 6))
    """

    t: Array
    q: Array
    qd: Array
    tau: Array
    energies: Array
    ledger: tuple[str, ...]
    method: str
    step: float | None
    evaluations: int
    end: Array
    status: Array
    model: Model = field(repr=False)
    parameters: Array | None = field(repr=False, default=None)

    def quantiles(self, probabilities: ArrayLike = (0.05, 0.5, 0.95), of: str = "q") -> Array:
        """Quantiles over the motions at each stored time.

        Parameters
        ----------
        probabilities : float or array_like, shape (P,)
            From 0 to 1.
        of : {"q", "qd", "tau"}
            Positions, velocities or torques.

        Returns
        -------
        ndarray, shape (P, S, n), or (S, n) for one probability
            In the units of the quantity; `rne.plotting.fan` draws them.

        Raises
        ------
        ValueError
            If `of` is another name, a probability is not between 0 and 1, or there are no motions.

        Examples
        --------
        >>> import numpy as np, rne
        >>> starts = np.random.default_rng(0).uniform(-1, 1, (100, 6))
        >>> swings = rne.ensemble(rne.load("irb140"), starts, 0 * starts, 0.1, keep=5)
        >>> swings.quantiles([0.05, 0.5, 0.95]).shape
        (3, 5, 6)
        """
        if of not in QUANTITIES:
            raise ValueError(f"`of` must be one of {list(QUANTITIES)}, got {of!r}")
        if not self.q.shape[1]:
            raise ValueError("there are no motions to take quantiles of")
        levels = real_numbers("probabilities", probabilities, "(P,)")
        if ((levels < 0) | (levels > 1)).any():
            raise ValueError(f"`probabilities` must be between 0 and 1, got {levels.tolist()}")
        found: Array = np.quantile(getattr(self, of), levels, axis=1)
        return found

    def __repr__(self) -> str:
        count, n = self.q.shape[1:]
        step = "" if self.step is None else f", step {self.step:.6g} s"
        stopped = f", {counted(int(self.status.sum()), 'motion')} stopped" if self.status.any() else ""
        times = f"{self.t[0]:.6g} to {self.t[-1]:.6g} s, " if len(self.t) else ""
        return (
            f"Ensemble of '{short(self.model.name)}': {counted(count, 'motion')} of {counted(n, 'joint')}, "
            f"{times}{len(self.t)} stored times{stopped}\n"
            f"  {self.method}{step}, {counted(self.evaluations, 'evaluation')}, "
            f"energies: {', '.join(self.ledger) or 'none'}"
        )


def ensemble(
    scene_or_robot: Scene | Robot,
    q0: ArrayLike,
    qd0: ArrayLike,
    duration: float,
    *,
    rtol: float = 1e-6,
    atol: float = 1e-9,
    t_eval: ArrayLike | None = None,
    parameters: ArrayLike | None = None,
    method: str = "auto",
    step: float | None = None,
    keep: int | None = None,
    progress: Progress | None = None,
    executor: Executor | Any = None,
) -> Ensemble:
    """Simulate many initial states of one scene at once, each with its own steps.

    Parameters
    ----------
    scene_or_robot : Scene or Robot
        What moves. Without stops, friction that sticks, samples and called controllers all motions run side by side;
        with them one after another, as `rne.simulate` runs them.
    q0, qd0 : array_like, shape (N, n)
        Initial positions and velocities [rad or m; rad/s or m/s]. If both are float32 and `step` is given, so is the
        computation; see docs/stability.md.
    duration : float
        Time to simulate [s].
    rtol, atol : float
        Relative and absolute tolerance of each motion's state, per step.
    t_eval : array_like, shape (S,), optional
        Times to report, ascending within [0, duration]; the start and the end if not given [s].
    parameters : array_like, shape (N, 10 nb), optional
        Inertial parameters in each motion, in the order of `Robot.parameters`. They replace those of the robot that
        carries the payload of the scene, so that the payload must be contained in them: start from
        `scene.resolved.robot.parameters`. With the parameters of the robot alone, its own `robot.parameters`, the
        payload is left out without a warning. Controllers keep the parameters that they were made with. The bodies
        need not be possible ones, but M must be positive definite.
    method : str
        "auto" is DOP853, or what `rne.simulate` chooses for motions that run one after another and for those that turn
        out to be stiff. RK45 runs side by side
        as well, another method of `rne.simulate` one after another. With `step`: "rk4", of order 4 where torques do not
        jump, which "auto" takes, or "semi-implicit-euler", of order 1.
    step : float, optional
        The longest step, for equal steps whose error is not controlled: halve it and compare. Friction that changes
        its sign within some steps, smoothed or not, makes errors that shorter ones hardly reduce [s].
    keep : int, optional
        Number of equally spaced times to report, the start and the end included, instead of `t_eval`.
    progress : callable, optional
        A function progress(done, total), called with numbers of motions, or with `step` of steps over all motions.
    executor : concurrent.futures.Executor or distributed.Client, optional
        Runs chunks of initial states in parallel: a process pool, a Dask client, or with engine "numba" a thread pool.
        Each process traces and compiles the right-hand side once.

    Returns
    -------
    Ensemble
        The motions at the times to report. The result of a motion does not depend on the others, nor on the executor.

    Raises
    ------
    ValueError
        If an argument has the wrong shape, is not finite or out of range, the scene cannot run by equal steps, or its
        controller cannot be sent to the processes of `executor`.
    NotFiniteError, SingularMassMatrixError
        If a state overflows, steps become too short or M singular; names the initial state by its number, and the time.
    SimulationError
        The same of motions that run one after another.

    Notes
    -----
    Side by side the energies of the ledger are integrated along with the states, outside of the control of the error.

    Examples
    --------
    >>> import numpy as np, rne
    >>> starts = np.random.default_rng(0).uniform(-1, 1, (100, 6))
    >>> rne.ensemble(rne.load("irb140"), starts, 0 * starts, 0.1).q.shape
    (2, 100, 6)
    """
    scene = scene_of_robot(scene_or_robot) if isinstance(scene_or_robot, Robot) else scene_or_robot
    if not isinstance(scene, Scene):
        raise TypeError(f"`scene_or_robot` must be an rne.Scene or rne.Robot, got {type(scene).__name__}")
    q, qd = _starts(scene, q0, qd0, is_fixed=step is not None)
    end = positive_number("duration", duration)
    times = _times(t_eval, keep, end)
    pi = None if parameters is None else _parameters(parameters, scene, len(q))
    plan = _plan(scene, method, step, times, end, tolerances(rtol, atol), with_parameters=pi is not None)
    further = plan.rhs.size - 2 * scene.n if isinstance(plan, SideBySide) else 0
    x0 = np.concatenate([q, qd, np.zeros((len(q), further), q.dtype)], axis=1)
    starts = Chunk(x0, np.zeros((len(q), 0), q.dtype) if pi is None else pi.astype(q.dtype))
    part = run_all(plan, starts, progress, executor)
    part.verdict.raise_or_warn(stacklevel=2)
    return Ensemble(
        times,
        part.q,
        part.qd,
        part.tau,
        part.energies,
        scene.right_hand_side.ledger,
        ", ".join(part.methods),
        float(plan.steps.max()) if isinstance(plan, SideBySide) and len(plan.steps) else None,
        part.evaluations,
        part.end,
        part.stopped.astype(int),
        scene.resolved.robot.model,
        pi,
    )


def _starts(scene: Scene, q0: ArrayLike, qd0: ArrayLike, *, is_fixed: bool) -> tuple[Array, Array]:
    """Initial positions and velocities, float32 only for fixed steps."""
    model, n = scene.resolved.robot.model, scene.n
    q, qd = (joint_array(name, real_numbers(name, x, f"(N, {n})"), model) for name, x in (("q0", q0), ("qd0", qd0)))
    if q.ndim != 2 or q.shape != qd.shape:
        raise ValueError(f"`q0` and `qd0` must have the same shape (N, {n}), got {q.shape} and {qd.shape}")
    dtype = np.result_type(q, qd) if is_fixed else np.float64
    return q.astype(dtype), qd.astype(dtype)


def _times(t_eval: ArrayLike | None, keep: int | None, end: float) -> Array:
    """Times to report."""
    if t_eval is not None:
        if keep is not None:
            raise ValueError("`keep` and `t_eval` both say which times to report: give one of them")
        return check_times(t_eval, end)
    count = 2 if keep is None else keep
    if not isinstance(count, int | np.integer) or count < 2:
        raise ValueError(f"`keep` must be a whole number, at least 2, got {keep!r}")
    return np.linspace(0.0, end, count)


def _plan(
    scene: Scene,
    method: str,
    step: float | None,
    times: Array,
    end: float,
    tolerated: tuple[float, float],
    *,
    with_parameters: bool,
) -> Plan:
    """How the motions of a scene are run."""
    friction = scene.resolved.friction
    has_events = scene.sample_time is not None or scene.stops or (friction is not None and friction.sticks)
    is_called = scene.current_right_hand_side().torque_given
    rtol, atol = tolerated
    otherwise = OneByOne(scene, end, times, {"method": method, "rtol": rtol, "atol": atol})
    if step is None:
        if method not in ("auto", *METHODS):
            needs = "; equal steps need `step`" if method in FIXED else ""
            raise ValueError(f"`method` must be 'auto' or one of {list(METHODS)}, got {method!r}{needs}")
        if has_events or is_called or method not in ("auto", *CONTROLLED) or not scene.n:
            return otherwise
        chosen, longest = "DOP853" if method == "auto" else method, None
    else:
        if method not in ("auto", *FIXED):
            raise ValueError(f"`method` must be one of {list(FIXED)}, got {method!r}")
        if has_events:
            raise ValueError("`step` is not for scenes with `sample_time`, `stops` or sticking friction: leave it out")
        if is_called:
            raise ValueError("the controller of an ensemble with `step` must be traceable (mark it with rne.traceable)")
        chosen, longest = "rk4" if method == "auto" else method, positive_number("step", step)
    rhs, breaks = scene.right_hand_side_with_energies, law_breaks(scene.controller)
    norm = rhs.size - len(rhs.ledger), rtol, atol, power(chosen) if longest is None else 0.0
    parts = courses(chosen, times, end, breaks, longest, norm, scene.n, watched=method == "auto")
    return SideBySide(rhs, times, parts, with_parameters, otherwise)


def _parameters(parameters: ArrayLike, scene: Scene, count: int) -> Array:
    """Inertial parameters of each motion."""
    if scene.formulation != "newton-euler":
        raise ValueError(
            f"`parameters` need the formulation 'newton-euler', that of the scene is {scene.formulation!r}"
        )
    robot = scene.resolved.robot
    shape = (count, PARAMETERS * robot.model.nb)
    pi = real_array("parameters", parameters, f"{shape}, ten per body for each initial state")
    return np.asarray(pi, np.float64)
