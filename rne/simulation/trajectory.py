"""A simulated motion with its torques and its energy account."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

import numpy as np

from ..basics.arrays import positive_number
from ..basics.spatial import Array
from ..errors import NotFiniteError, SingularMassMatrixError
from ..model.model import Model
from .limits import Violation, limit_violations
from .plant import Plant


@dataclass(frozen=True, eq=False)
class Trajectory:
    """A simulated motion.

    Attributes
    ----------
    t : ndarray, shape (T,)
        [s]; exactly `t_eval` if it was given, otherwise the solver's steps.
    q, qd, qdd, tau : ndarray, shape (T, n)
        Joint positions, rates, accelerations and drive torques [rad or m; rad/s or m/s; rad/s^2 or m/s^2; N m or N].
    kinetic, potential, energy, work : ndarray, shape (T,)
        Energies, their sum, and the work the drives have done since the start [J].
    energy_drift : float
        Largest |energy - energy at the start - work + dissipated| [J]: energy created or lost by the solver's errors.
    evaluations : int
        Calls of the right-hand side, those for Jacobians included.
    method : str
        The solver that ran.
    status : int
        0 if the end was reached, 1 if an event of the scene stopped the run, -1 if it failed.
    message : str
        Why this method, and how the run ended.
    dissipated : mapping of str to ndarray, shape (T,)
        Energy dissipated since the start by "viscous" and "coulomb" friction, where the scene has it [J].
    controller_state : ndarray, shape (T, m)
        States of the controller, such as the integral of a PID.
    energy_start : float
        Energy at t = 0, which `t_eval` may leave out [J].
    model : Model or None
        The robot that moved, of a scene with payload and without locked joints; for `check_limits`.
    growth : callable or None
        growth(bound) -> times and estimated errors of the positions until they exceed the bound; see
        `trusted_horizon`.
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
    dissipated: Mapping[str, Array] = field(default_factory=dict)
    controller_state: Array = field(default_factory=lambda: np.zeros((0, 0)))
    energy_start: float = 0.0
    growth: Callable[[float], tuple[Array, Array]] | None = field(default=None, repr=False)
    model: Model | None = field(default=None, repr=False)

    def __getstate__(self) -> dict[str, Any]:
        return {**self.__dict__, "growth": None}  # it may hold laws that do not pickle

    def __copy__(self) -> Trajectory:
        return replace(self)

    def trusted_horizon(self, accuracy: float = 1e-3) -> float:
        """The time up to which the solver's tolerances, or its step, keep every joint within `accuracy` [s].

        Each step's error is followed by the variational equation of the motion, in which chaos and unstable
        equilibria make it grow; beyond this time the trajectory is no longer that of the given initial state.

        Parameters
        ----------
        accuracy : float
            Largest error of a joint's position [rad or m].

        Returns
        -------
        float
            An estimate, accurate to some percent where errors grow; the end of the motion if the error stays below.

        Raises
        ------
        ValueError
            If `accuracy` is not positive, or the motion has no variational equation: under sampled control, under dry
            friction that sticks, or after pickling, which forgets the scene.

        Notes
        -----
        See `rne.simulation.error_growth`. A pulse that the solver stepped over, because `breaks` does not name it, is
        not seen here either.

        Examples
        --------
        >>> import rne
        >>> rne.simulate(rne.load("irb140"), [0] * 6, [0] * 6, 0.1).trusted_horizon()
        0.1
        """
        if self.growth is None:
            raise ValueError(
                "this motion has no variational equation (sampled control, sticking friction, or a pickled "
                "trajectory): repeat it with a tenth of the tolerance and compare"
            )
        bound = positive_number("accuracy", accuracy)
        t, error = self.growth(bound)
        beyond = np.flatnonzero(~(error <= bound))
        if not len(beyond):
            return float(t[-1])
        k = int(beyond[0])
        if not (np.isfinite(error[k]) and error[k - 1] > 0):
            return float(t[k - 1])
        part = np.log(bound / error[k - 1]) / np.log(error[k] / error[k - 1])
        return float(t[k - 1] + part * (t[k] - t[k - 1]))

    def check_limits(self) -> list[Violation]:
        """Where the motion exceeds the ranges, speeds and efforts of its robot; see `rne.simulation.limits`.

        Returns
        -------
        list of Violation
            One for each limit exceeded at any sample, in the order of the joints; `print(*violations, sep="\\n")`
            shows them. Joints that mimic others are examined too, except for their torques, which are not known.

        Raises
        ------
        ValueError
            If the trajectory was made without a model.

        Examples
        --------
        >>> import rne
        >>> swing = rne.simulate(rne.load("irb140"), [0] * 6, [0] * 6, 2.0)
        >>> [v.joint for v in swing.check_limits() if v.quantity == "rate"][:2]
        ['joint_2', 'joint_3']
        """
        if self.model is None:
            raise ValueError("this trajectory has no model: give it one by dataclasses.replace(trajectory, model=...)")
        return limit_violations(self.model, self.t, self.q, self.qd, self.tau)

    @property
    def balance(self) -> Array:
        """Energy error over time, energy - initial energy - work + dissipated: the solver's error, shape (T,) [J]."""
        taken = sum(self.dissipated.values(), np.zeros(len(self.t)))
        return self.energy - self.energy_start - self.work + taken


class Task(NamedTuple):
    """The task of a solver."""

    x0: Array
    duration: float
    method: str
    rtol: float
    atol: float
    t_eval: Array | None
    step: float | None
    breaks: Sequence[float]
    events: Sequence[Any]


class Run(NamedTuple):
    """The result of a solver."""

    t: Array
    x: Array
    status: int
    ending: str
    u: Array | None = None  # torques that were held, where they were
    qdd: Array | None = None  # accelerations, where the right-hand side alone does not give them
    controller_state: Array | None = None  # states of a sampled controller


def build_trajectory(plant: Plant, task: Task, run: Run, reason: str, failures: list[tuple[float, str]]) -> Trajectory:
    """The motion with its torques and energies; samples from one on that is not finite are left out."""
    rhs = plant.rhs
    n = rhs.robot.n
    t, x, tau, qdd = _sound_samples(plant, run, failures)
    if run.qdd is not None:
        qdd = run.qdd[: len(t)]
    q, qd, z = x[:, :n], x[:, n : 2 * n], x[:, 2 * n : 2 * n + rhs.controller_states]
    entries = dict(zip(rhs.ledger, x[:, 2 * n + rhs.controller_states :].T, strict=True))
    work = entries.pop("drives", np.zeros(len(t)))
    kinetic, potential = rhs.robot.kinetic_energy(q, qd), rhs.robot.potential_energy(q)
    energy = kinetic + potential
    taken = sum(entries.values(), np.zeros(len(t)))
    start = float(rhs.robot.kinetic_energy(*np.split(task.x0[: 2 * n], 2)) + rhs.robot.potential_energy(task.x0[:n]))
    drift = float(np.abs(energy - start - work + taken).max()) if len(t) else 0.0
    return Trajectory(
        t,
        q,
        qd,
        qdd,
        tau,
        kinetic,
        potential,
        energy,
        work,
        drift,
        plant.evaluations,
        task.method,
        -1 if failures else run.status,
        failures[0][1] if failures else f"{reason}; {run.ending}",
        entries,
        z if run.controller_state is None else run.controller_state[: len(t)],
        start,
        model=rhs.robot.model,
    )


def _sound_samples(plant: Plant, run: Run, failures: list[tuple[float, str]]) -> tuple[Array, Array, Array, Array]:
    """Times, states, torques and accelerations up to the first sample that is not finite or where M is singular."""
    n = plant.rhs.robot.n
    times = run.t[:, None]
    try:
        u = run.u
        if u is None and plant.law is not None:
            u = np.array([plant.torque(float(t), x) for t, x in zip(run.t, run.x, strict=True)]).reshape(-1, n)
        rates = plant.all_rates(run.t, run.x, u)
        drives, _ = plant.rhs.drives(times, run.x, u)
        tau = np.zeros((len(times), n)) if drives is None else np.asarray(drives, dtype=np.float64)
        return run.t, run.x, tau, rates[:, n : 2 * n]
    except (NotFiniteError, SingularMassMatrixError, ValueError):  # found by looking at each
        return _one_by_one(plant, run, failures)


def _one_by_one(plant: Plant, run: Run, failures: list[tuple[float, str]]) -> tuple[Array, Array, Array, Array]:
    n = plant.rhs.robot.n
    tau, qdd = np.zeros((len(run.t), n)), np.zeros((len(run.t), n))
    sound = 0
    for k, (time, x) in enumerate(zip(run.t, run.x, strict=True)):
        try:
            u = plant.torque(float(time), x) if run.u is None else run.u[k]
            drives, _ = plant.rhs.drives(np.array([time]), x, u)
            tau[k] = 0.0 if drives is None else drives
            qdd[k] = plant.rates(float(time), x, u)[n : 2 * n]
        except (NotFiniteError, SingularMassMatrixError) as error:
            failures.append((float(time), str(error)))
            break
        sound += 1
    return run.t[:sound], run.x[:sound], tau[:sound], qdd[:sound]
