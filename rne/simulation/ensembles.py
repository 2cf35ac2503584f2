"""Many initial states of one scene simulated at once, by equal steps of the batch kernel."""

from __future__ import annotations

from dataclasses import dataclass, field
from math import ceil
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from ..basics.arrays import positive_number, real_array, real_numbers
from ..basics.spatial import Array
from ..basics.text import counted, short
from ..model.model import Model, joint_array
from ..model.parameters import PARAMETERS
from ..robot import Robot
from .equal_steps import STEPPERS, Chunk, Plan, Progress, run_all
from .equations_of_motion import RightHandSide
from .plant import Plant
from .scene import Scene, scene_of_robot

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
        The method that ran.
    step : float
        Length of the steps [s].
    evaluations : int
        Evaluations of the right-hand side, counted per state.
    model : Model
        The robot that moved.
    parameters : ndarray, shape (N, 10 nb), or None
        Inertial parameters of the robot of each motion; None if all had the robot's own.

    Examples
    --------
    >>> import numpy as np, rne
    >>> starts = np.random.default_rng(0).uniform(-1, 1, (10, 6))
    >>> motions = rne.ensemble(rne.load("irb140"), starts, 0 * starts, 0.1, step=1e-3, keep=3)
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
    step: float
    evaluations: int
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
        >>> swings = rne.ensemble(rne.load("irb140"), starts, 0 * starts, 0.1, step=1e-3, keep=5)
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
        return (
            f"Ensemble of '{short(self.model.name)}': {counted(count, 'motion')} of {counted(n, 'joint')}, "
            f"0 to {self.t[-1]:.6g} s, {len(self.t)} stored times\n"
            f"  {self.method}, step {self.step:.6g} s, {counted(self.evaluations, 'evaluation')}, "
            f"energies: {', '.join(self.ledger) or 'none'}"
        )


def ensemble(
    scene_or_robot: Scene | Robot,
    q0: ArrayLike,
    qd0: ArrayLike,
    duration: float,
    *,
    step: float,
    parameters: ArrayLike | None = None,
    method: str = "rk4",
    keep: int = 2,
    progress: Progress | None = None,
    executor: Executor | None = None,
) -> Ensemble:
    """Simulate many initial states of one scene at once by equal steps.

    Parameters
    ----------
    scene_or_robot : Scene or Robot
        Its controller, if any, must be traceable and not sampled; stops and sticking friction are refused.
    q0, qd0 : array_like, shape (N, n)
        Initial positions and velocities [rad or m; rad/s or m/s]. If both are float32, so is the computation; see
        docs/stability.md.
    duration, step : float
        Time to simulate, and the longest step; steps are equal [s].
    parameters : array_like, shape (N, 10 nb), optional
        Inertial parameters in each motion, in the order of `Robot.parameters`. They replace those of the robot that
        carries the payload of the scene, so that the payload must be contained in them: start from
        `scene.resolved.robot.parameters`. With the parameters of the robot alone, its own `robot.parameters`, the
        payload is left out without a warning. Controllers keep the parameters that they were made with. The bodies
        need not be possible ones, but M must be positive definite.
    method : {"rk4", "semi-implicit-euler"}
        Of order 4 and 1, where torques do not jump. The step is not controlled: halve it and compare.
    keep : int
        Number of equally spaced times to store, the first and the last included.
    progress : callable, optional
        A function progress(done, total), called with numbers of steps over all initial states.
    executor : concurrent.futures.Executor, optional
        Runs chunks of initial states in parallel: a process pool, a Dask cluster's `client.get_executor()`, or with
        engine "numba" a thread pool. Each process traces and compiles the right-hand side once.

    Returns
    -------
    Ensemble
        The motions at `keep` times.

    Raises
    ------
    ValueError
        If an argument has the wrong shape, is not finite or out of range, the scene cannot run in blocks, or its
        controller cannot be sent to the processes of `executor`.
    NotFiniteError, SingularMassMatrixError
        If a state overflows or M becomes singular; names the initial state by its number, and the time.

    Examples
    --------
    >>> import numpy as np, rne
    >>> starts = np.random.default_rng(0).uniform(-1, 1, (100, 6))
    >>> rne.ensemble(rne.load("irb140"), starts, 0 * starts, 0.1, step=1e-3).q.shape
    (2, 100, 6)
    """
    scene = scene_of_robot(scene_or_robot) if isinstance(scene_or_robot, Robot) else scene_or_robot
    if not isinstance(scene, Scene):
        raise TypeError(f"`scene_or_robot` must be an rne.Scene or rne.Robot, got {type(scene).__name__}")
    rhs = _blocks(scene)
    n = scene.n
    q, qd = (
        joint_array(name, real_numbers(name, x, f"(N, {n})"), scene.resolved.robot.model)
        for name, x in (("q0", q0), ("qd0", qd0))
    )
    if q.ndim != 2 or q.shape != qd.shape:
        raise ValueError(f"`q0` and `qd0` must have the same shape (N, {n}), got {q.shape} and {qd.shape}")
    if method not in STEPPERS:
        raise ValueError(f"`method` must be one of {list(STEPPERS)}, got {method!r}")
    end, near = positive_number("duration", duration), positive_number("step", step)
    if not isinstance(keep, int | np.integer) or keep < 2:
        raise ValueError(f"`keep` must be a whole number, at least 2, got {keep!r}")
    spans = keep - 1
    steps = max(1, ceil(end / near / spans * (1 - 1e-12))) * spans
    pi = None if parameters is None else _parameters(parameters, scene, len(q))
    plan = Plan(rhs, method, end / steps, steps, spans, pi is not None)
    x0 = np.concatenate([q, qd, np.zeros((len(q), rhs.size - 2 * n), q.dtype)], axis=1)
    starts = Chunk(x0, np.zeros((len(q), 0), q.dtype) if pi is None else pi.astype(q.dtype))
    kept = run_all(plan, starts, progress, executor)
    t = np.linspace(0.0, end, keep)
    count = {"rk4": 4, "semi-implicit-euler": 1}[method] * steps * len(q)
    for _, verdict in kept:
        verdict.raise_or_warn(stacklevel=2)
    x = np.concatenate([part[0] for part in kept], axis=1) if kept else np.zeros((keep, 0, rhs.size), q.dtype)
    energies = x[..., 2 * n + rhs.controller_states :]
    tau = _drive_torques(rhs, t, x)
    q, qd = x[..., :n], x[..., n : 2 * n]
    return Ensemble(t, q, qd, tau, energies, rhs.ledger, method, end / steps, count, rhs.robot.model, pi)


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


def _drive_torques(rhs: RightHandSide, t: Array, x: Array) -> Array:
    """Torques of the drives at stored times, shape (S, N, n)."""
    shape = (*x.shape[:2], rhs.robot.n)
    times = np.repeat(t, x.shape[1]).astype(x.dtype)
    size = 2 * rhs.robot.n + rhs.controller_states
    states = x[..., :size].reshape(len(times), size)
    drives = Plant(rhs, None).drives_under(times, states, None)
    return np.zeros(shape, x.dtype) if drives is None else drives.astype(x.dtype).reshape(shape)


def _blocks(scene: Scene) -> RightHandSide:
    if (
        scene.sample_time is not None
        or scene.stops
        or (scene.resolved.friction is not None and scene.resolved.friction.sticks)
    ):
        raise ValueError(
            "an ensemble has no events: its scene must have no `sample_time`, `stops` or sticking friction"
        )
    rhs = scene.right_hand_side_with_energies
    if rhs.torque_given:
        raise ValueError("the controller of an ensemble must be traceable (mark it with rne.traceable)")
    return rhs
