"""The torques of another model beside a robot's, and a hypothesis on the difference, judged by what it leaves."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from ..basics.spatial import Array
from ..model.model import joint_array
from ..model.standard_parameters import MEASURED, StandardParameters
from ..robot import Robot

STATES = 120  # at which two models are compared
FEW = 12
RATE, ACCELERATION = 1.5, 5.0  # standard deviations [rad/s or m/s; rad/s^2 or m/s^2]
TURNING, SLIDING = np.pi, 0.3  # largest positions where a joint has no limits [rad; m]
RANK = 1e-9  # of the largest singular value, of columns of unit length
SMALLEST = 1e-6  # of the largest torque of a robot: a joint with smaller torques is judged as if it had this

Other = Robot | Callable[[Array, Array, Array], Any] | Sequence[Any]


@dataclass(frozen=True, eq=False)
class Candidate:
    """A possible cause of the difference between two models, one of `ModelComparison.candidates`.

    Attributes
    ----------
    causes : tuple of str
        One cause, or two that act together.
    text : str
        What it says of the other model.
    numbers : int
        Free numbers that were fitted.
    alternatives : float
        How many hypotheses it was chosen from.
    residual : ndarray, shape (N, n)
        Torques that it does not explain [N m or N].
    score : float
        Smaller is better.
    explains : bool
        True if no joint's residual is above rounding.

    Examples
    --------
    >>> import rne
    >>> robot = rne.load("irb140")
    >>> best = rne.compare_models(robot, robot.with_payload(3.0)).candidates[0]
    >>> best.causes, best.numbers, best.explains
    (('payload',), 4, True)
    """

    causes: tuple[str, ...]
    text: str
    numbers: int
    alternatives: float
    residual: Array
    score: float
    explains: bool


@dataclass(frozen=True, eq=False)
class TorqueDifference:
    """States, and the torques that another model has there.

    Attributes
    ----------
    robot : Robot
        What the torques are compared with.
    q, qd, qdd, tau : ndarray, shape (N, n)
        States, and torques of the other model [N m or N].
    tolerance : float
        Differences below this part of the torques of a joint are rounding.
    """

    robot: Robot
    q: Array
    qd: Array
    qdd: Array
    tau: Array
    tolerance: float

    @cached_property
    def expected(self) -> Array:
        """The robot's own torques, shape (N, n); joint friction is not among them."""
        return self.robot.inverse_dynamics(self.q, self.qd, self.qdd)

    @cached_property
    def difference(self) -> Array:
        """tau less the robot's own torques, shape (N, n)."""
        return self.tau - self.expected

    @cached_property
    def rounding(self) -> Array:
        """Rounding that is allowed, shape (n,) [N m or N]."""
        size = np.sqrt((self.tau**2).mean(0)) + np.sqrt((self.expected**2).mean(0))
        least = max(SMALLEST * size.max(initial=0), np.finfo(float).tiny)
        rounding: Array = self.tolerance * np.maximum(size, least)
        return rounding

    @cached_property
    def standard(self) -> StandardParameters:
        """Bodies, rotors, friction and offsets: names and places of the P columns."""
        return all_parameters(self.robot)

    @cached_property
    def columns(self) -> Array:
        """Torques per unit of each standard parameter, shape (N, n, P)."""
        bodies = self.robot.regressor(self.q, self.qd, self.qdd)
        return np.concatenate([bodies, self.standard.drive_columns(self.qd, self.qdd)], axis=-1)

    @cached_property
    def few(self) -> Array:
        """A few of the states, enough to choose among many hypotheses."""
        return np.unique(np.linspace(0, len(self.q) - 1, FEW).round().astype(int))

    def weighted(self, torques: Array, states: Any = slice(None)) -> Array:
        """Torques, or columns of them, in units of the rounding, of all states or some, shape (N n, ...)."""
        weight = (1 / self.rounding).reshape(-1, *[1] * (torques.ndim - 2))
        weighted: Array = torques[states] * weight
        return weighted.reshape(-1, *torques.shape[2:])

    def fit(self, columns: Array, torques: Array, states: Any = slice(None)) -> tuple[Array, int]:
        """Coefficients of columns, shape (N, n, k), by least squares, and their rank."""
        A = self.weighted(columns, states)
        lengths = np.linalg.norm(A, axis=0)
        lengths[lengths == 0] = 1
        scaled, _, rank, _ = np.linalg.lstsq(A / lengths, self.weighted(torques, states), rcond=RANK)
        return scaled / lengths, int(rank)

    def relative(self, torques: Array) -> Array:
        """|torques| / |tau| of each joint, shape (n,)."""
        size = np.linalg.norm(self.tau, axis=0)
        least = max(SMALLEST * size.max(initial=0), np.finfo(float).tiny)
        relative: Array = np.linalg.norm(torques, axis=0) / np.maximum(size, least)
        return relative

    def explains(self, residual: Array) -> bool:
        """True if no joint's residual, by its root mean square, is above rounding."""
        return bool(((residual**2).mean(0) <= self.rounding**2).all())

    def candidate(
        self, cause: str, text: str, numbers: int, alternatives: float, residual: Array, before: Candidate | None = None
    ) -> Candidate:
        """A hypothesis, on top of another, and its Bayesian information criterion (Schwarz 1978).

        N log(chi^2 / N) + k log N + 2 log A, for k free numbers and a choice among A alternatives; residuals below
        rounding are equally good.
        """
        causes: tuple[str, ...] = (cause,)
        if before:
            causes, text = (*before.causes, cause), f"{before.text}; {text}"
            numbers, alternatives = before.numbers + numbers, before.alternatives * alternatives
        N = residual.size
        mean = max(float((self.weighted(residual) ** 2).mean()), 1.0)
        score = float(N * np.log(mean) + numbers * np.log(N) + 2 * np.log(alternatives))
        return Candidate(causes, text, numbers, alternatives, residual, score, self.explains(residual))


def all_parameters(robot: Robot) -> StandardParameters:
    """Bodies, rotors, friction and offsets."""
    return StandardParameters(robot.model, MEASURED)


def torque_difference(robot: Robot, other: Other, tolerance: float, seed: int) -> TorqueDifference:
    """The torques of another robot or function at random states, or those given."""
    if isinstance(other, Robot) and other.n != robot.n:
        raise ValueError(f"`other` must have {robot.n} joints, as the robot, got {other.n}")
    torques = other.inverse_dynamics if isinstance(other, Robot) else other
    if callable(torques):
        q, qd, qdd = states_in_range(robot, seed)
        tau = np.asarray(torques(q, qd, qdd), dtype=np.float64)
        if tau.shape != q.shape:
            raise ValueError(f"`other` must return torques of shape {q.shape}, got {tau.shape}")
    elif isinstance(other, Sequence) and len(other) == 4:
        q, qd, qdd, tau = given_torques(robot, other)
    else:
        raise TypeError(
            "`other` must be an rne.Robot, a function of (q, qd, qdd) or arrays (q, qd, qdd, tau), got "
            f"{type(other).__name__}; for measured motions use `rne.identify(robot, record)`, whose report names "
            "likely causes"
        )
    if not np.isfinite(tau).all():
        raise ValueError("`other`: the torques must be finite")
    return TorqueDifference(robot, q, qd, qdd, tau, tolerance)


def given_torques(robot: Robot, other: Sequence[Any]) -> list[Array]:
    """The arrays q, qd, qdd and tau, checked: at least as many torques as standard parameters."""
    n, names = robot.n, ("q", "qd", "qdd", "tau")
    arrays = [np.asarray(joint_array(name, x, robot.model), np.float64) for name, x in zip(names, other, strict=True)]
    if arrays[0].ndim != 2 or len({x.shape for x in arrays}) > 1:
        raise ValueError(f"`other` must be four arrays of shape (N, {n}), got {[np.shape(x) for x in other]}")
    fewest = -(-all_parameters(robot).count // max(n, 1))
    if len(arrays[0]) < fewest:
        raise ValueError(f"`other` must have at least {fewest} states for {n} joints, got {len(arrays[0])}")
    return arrays


def states_in_range(robot: Robot, seed: int) -> tuple[Array, Array, Array]:
    """States all over the ranges of the joints."""
    rng = np.random.default_rng(seed)
    reach = np.where(robot.model.is_revolute[list(robot.model.independent_joints)], TURNING, SLIDING)
    lower, upper = (np.clip(x, -reach, reach) for x in (robot.lower, robot.upper))
    q = rng.uniform(np.minimum(lower, upper), np.maximum(lower, upper), (STATES, robot.n))
    scale = np.where(reach == SLIDING, SLIDING, 1.0)
    qd = RATE * scale * rng.standard_normal(q.shape)
    qdd = ACCELERATION * scale * rng.standard_normal(q.shape)
    return q, qd, qdd
