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
from .stops import Stop

ErrorEstimate = Callable[[float], tuple[Array, Array]]


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
    error_estimates : tuple of callable
        f(bound) -> times and estimated errors of the positions until they exceed the bound; see `trusted_horizon`.
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
    error_estimates: tuple[ErrorEstimate, ...] = field(default=(), repr=False)
    model: Model | None = field(default=None, repr=False)

    def __getstate__(self) -> dict[str, Any]:
        return {**self.__dict__, "error_estimates": ()}  # they may hold laws that do not pickle

    def __copy__(self) -> Trajectory:
        return replace(self)

    def trusted_horizon(self, accuracy: float = 1e-3) -> float:
        """The time up to which the solver's tolerances, or its step, keep every joint within `accuracy` [s].

        Each step's error is followed by the variational equation of the motion, in which chaos and unstable
        equilibria make it grow; beyond this time the trajectory is no longer that of the given initial state. Where
        something may switch (a law that is called or compares, sampled control, friction that sticks), the run is
        repeated with a hundredth of the tolerances as well, and the shorter of the two horizons holds.

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
            If `accuracy` is not positive, or after pickling, which forgets the scene.

        Notes
        -----
        See `rne.simulation.error_growth` and `rne.simulation.repetition`. A pulse that the solver stepped over, because
        `breaks` does not name it, may not be seen here either. A law with memory must begin anew when it is called
        with t = 0.

        Examples
        --------
        >>> import rne
        >>> rne.simulate(rne.load("irb140"), [0] * 6, [0] * 6, 0.1).trusted_horizon()
        0.1
        """
        bound = positive_number("accuracy", accuracy)
        if not self.error_estimates:
            raise ValueError("this trajectory was pickled, and has forgotten its scene: repeat the simulation")
        return min(_horizon(bound, *estimate(bound)) for estimate in self.error_estimates)

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


def _horizon(bound: float, t: Array, error: Array) -> float:
    """When an error first exceeds a bound; between two times it is an exponential."""
    beyond = np.flatnonzero(~(error <= bound))
    if not len(beyond):
        return float(t[-1])
    k = int(beyond[0])
    if k == 0:
        return float(t[0])
    if not (np.isfinite(error[k]) and error[k - 1] > 0):
        return float(t[k - 1])
    part = np.log(bound / error[k - 1]) / np.log(error[k] / error[k - 1])
    return float(t[k - 1] + part * (t[k] - t[k - 1]))


class Task(NamedTuple):
    """The task of a run."""

    x0: Array
    duration: float
    method: str
    rtol: float
    atol: float
    t_eval: Array | None = None
    step: float | None = None
    breaks: Sequence[float] = ()
    stops: Sequence[Stop] = ()
    is_auto: bool = False  # True if the method may be changed while the run goes on


class Failure(NamedTuple):
    """Why a run ended before its time."""

    time: float
    cause: str


class Run(NamedTuple):
    """The result of a run."""

    t: Array
    x: Array
    status: int
    ending: str
    u: Array | None  # torques that were held, where they were
    qdd: Array | None  # accelerations, where they do not follow from time, state and torques
    controller_state: Array | None  # states of a sampled controller
    energies: Mapping[str, Array]  # of the ledger, (T,) each
    failure: Failure | None
    method: str


def build_trajectory(plant: Plant, task: Task, run: Run, reason: str) -> tuple[Trajectory, Failure | None]:
    """The motion with its torques and energies, up to the first instant that is not finite."""
    rhs = plant.rhs
    n = rhs.robot.n
    tau, qdd, failure = _torques_and_accelerations(plant, run)
    failure = run.failure or failure
    T = len(tau)
    if run.qdd is not None:
        qdd = run.qdd[:T]
    t, x = run.t[:T], run.x[:T]
    q, qd, z = x[:, :n], x[:, n : 2 * n], x[:, 2 * n : 2 * n + rhs.controller_states]
    entries = {name: energy[:T] for name, energy in run.energies.items()}
    work = entries.pop("drives", np.zeros(T))
    kinetic, potential = rhs.robot.kinetic_energy(q, qd), rhs.robot.potential_energy(q)
    energy = kinetic + potential
    taken = sum(entries.values(), np.zeros(T))
    start = float(rhs.robot.kinetic_energy(*np.split(task.x0[: 2 * n], 2)) + rhs.robot.potential_energy(task.x0[:n]))
    drift = float(np.abs(energy - start - work + taken).max()) if T else 0.0
    motion = Trajectory(
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
        run.method,
        -1 if failure else run.status,
        failure.cause if failure else f"{reason}; {run.ending}",
        entries,
        z if run.controller_state is None else run.controller_state[:T],
        start,
        model=rhs.robot.model,
    )
    return motion, failure


def _torques_and_accelerations(plant: Plant, run: Run) -> tuple[Array, Array, Failure | None]:
    """Torques and accelerations of every instant up to the first that is not finite or where M is singular."""
    n = plant.robot.n
    try:
        u = run.u
        if u is None and plant.law is not None:
            u = plant.torques_at(run.t, run.x)
        rates = plant.all_rates(run.t, run.x, u)
        drives = plant.drives_under(run.t, run.x, u)
        tau = np.zeros((len(run.t), n)) if drives is None else drives
        return tau, rates[:, n : 2 * n], None
    except (NotFiniteError, SingularMassMatrixError, ValueError):  # found by looking at each
        return _one_by_one(plant, run)


def _one_by_one(plant: Plant, run: Run) -> tuple[Array, Array, Failure | None]:
    n = plant.robot.n
    tau, qdd = np.zeros((len(run.t), n)), np.zeros((len(run.t), n))
    for k, (time, x) in enumerate(zip(run.t.tolist(), run.x, strict=True)):
        try:
            u = plant.torque(time, x) if run.u is None else run.u[k]
            drives, _ = plant.rhs.drives(np.array([time]), x, u)
            tau[k] = 0.0 if drives is None else drives
            qdd[k] = plant.rates(time, x, u)[n : 2 * n]
        except (NotFiniteError, SingularMassMatrixError) as error:
            return tau[:k], qdd[:k], Failure(time, str(error))
    return tau, qdd, None
