"""Stability of PD gains without simulation: fastest mode, largest stable sample time, stiffness of gravity."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from ..basics.arrays import per_joint_array, positive_number
from ..basics.spatial import Array
from ..basics.text import listed, summary
from ..dynamics.forward import solve_mass_matrix
from ..dynamics.rnea import gravity_torque
from ..robot import Robot
from .feedback_loop import FeedbackLoop, LinearisedLoop
from .laws import of_robot
from .sampled_loop import LinearLoop, Window, first_unstable_time, gravity_modes, step_matrix

if TYPE_CHECKING:
    from ..bounds.bounds import Bounds

SAMPLES, REFINED = 2048, 4  # number of random configurations; number of the worst ones that are refined
SWEPT = np.append(np.arange(1, 16) / 16, 1 - 0.5 ** np.arange(5, 13))  # sample times examined, relative to the limit
LONGEST, ROUNDS = 1.25, 40  # longest sample time examined relative to a loop's horizon; most iterations
BOTH = "beats_gravity", "sample_time_limit"  # names of the results that bounds can prove
FREE = np.pi  # half range of a coordinate without limits [rad or m]


@dataclass(frozen=True, eq=False, kw_only=True)
class Gains(LinearisedLoop):
    """Stability of PD gains, found by `rne.check_gains`: a `rne.control.LinearisedLoop` in the worst configuration.

    Attributes
    ----------
    largest_mode : float
        Largest eigenvalue of M^-1 Kd over the workspace: the fastest decay of the closed loop, up to Kp [1/s].
    worst_q : ndarray, shape (n,)
        Configuration with the largest mode [rad or m].
    fastest_pole : float
        Fastest decay of the loop in that configuration, Kp included [1/s].
    sample_time_limit : float
        Sample time up to which the loop with held torques is stable, in every configuration that was examined [s].
    sample_time_q : ndarray, shape (n,)
        Configuration that is the first not to be stable [rad or m].
    windows : tuple of Window
        All sample times in that configuration: tuples (start, end, verdict), "stable", "unstable" or "undecided" [s].
    gravity_stiffness : float
        Largest norm of dg/dq over the workspace: without gravity compensation every Kp must exceed it [N m/rad].
    beats_gravity : bool
        True if the smallest Kp exceeds it.
    proven : tuple of str
        Which of "beats_gravity" and "sample_time_limit" hold for the whole workspace by proof; others by a search.
    sample_time : float or None
        The given sample time [s].
    stable : bool or None
        True if the sample time is below the limit; None if none was given.
    loop : FeedbackLoop
        The loop in the configuration `sample_time_q`, of which poles and margins are, with gravity compensated; the
        margins multiply and delay this compensation as well.
    is_rest, has_smoothed_friction, is_of_link, is_discrete : bool
        Fields of all linearised loops; here True, False, False, False.
    """

    largest_mode: float
    worst_q: Array
    fastest_pole: float
    sample_time_q: Array
    gravity_stiffness: float
    beats_gravity: bool
    proven: tuple[str, ...]

    __repr__ = summary

    def __str__(self) -> str:
        verdict = "" if self.stable is None else f" {self.sample_time:g} s is {'' if self.stable else 'NOT '}stable."
        found = ["proven" if name in self.proven else "searched" for name in BOTH]
        exceed = (
            "exceed it, so there is one equilibrium without compensation" if self.beats_gravity else "do NOT exceed it"
        )
        return (
            f"fastest mode M^-1 Kd {self.largest_mode:.6g} 1/s, fastest pole {self.fastest_pole:.6g} 1/s\n"
            f"largest stable sample time {self.sample_time_limit:.4g} s ({found[1]}).{verdict}\n"
            f"largest gravity gradient {self.gravity_stiffness:.4g} N m/rad ({found[0]}): the gains {exceed}"
        )


@of_robot
def check_gains(
    robot: Robot,
    kp: ArrayLike,
    kd: ArrayLike,
    sample_time: float | None = None,
    *,
    q: ArrayLike | None = None,
    max_sample_time: float | None = None,
    bounds: Bounds | None = None,
) -> Gains:
    """Stability of PD gains over a robot's workspace, continuous or sampled.

    Parameters
    ----------
    robot : Robot
        The robot.
    kp, kd : float or array_like, shape (n,)
        Gains of each joint [N m/rad, N m s/rad]: kp positive, kd not negative.
    sample_time : float, optional
        Time between samples, over which torques are held [s].
    q : array_like, shape (n,), optional
        The only configuration to examine, instead of the workspace [rad or m].
    max_sample_time : float, optional
        End of the `windows` [s]; by default somewhat beyond the limit.
    bounds : Bounds, optional
        Result of `Robot.bounds` for this robot, payload and gravity included, with its `gravity_stiffness` and, for one
        joint, its `mass_eigenvalues`.

    Returns
    -------
    Gains
        Fastest modes, the limit of the sample time, where they are reached, and the margins of gain and delay there.

    Raises
    ------
    ValueError
        If a gain or a sample time is not finite, has the wrong sign or shape.
    SingularMassMatrixError
        If M is singular somewhere in the workspace; the error lists the joints.

    Notes
    -----
    With gravity compensated, M qdd = -Kp e - Kd qd near a reference, e = q - q_ref. Evaluated continuously this loop is
    stable for all positive gains; for Kd = 0 its energy is conserved, which is marginal, not stable. Evaluated every T
    and held, gravity's compensation too, it is a linear map of (e, qd), exact but for terms of second order. For Kd = 0
    it is unstable where Kp - dg/dq is positive definite, and stable except at isolated T where dg/dq - Kp is.

    For one configuration verdicts are certain, to rounding: in closed form for one joint and where gains do not couple
    modes; otherwise intervals of T are proven stable or unstable, and what is neither, mostly 1e-10 of T at a boundary,
    is undecided and not called stable. The limit of several joints is at most 1.25 times the smaller of 2 over the
    largest mode and half of gravity's shortest period. Over the workspace it is a search: random configurations within
    the joints' limits (seeded), the worst of them refined by L-BFGS-B. `bounds` prove the comparison with gravity's
    stiffness and, for one joint, the limit. Åström and Wittenmark 1997, Computer-Controlled Systems, sections 2.3, 3.2.

    Examples
    --------
    >>> import rne
    >>> gains = rne.check_gains(rne.load("irb140"), [50] * 5 + [60], [20] * 5 + [22], 1.3e-4)
    >>> round(gains.sample_time_limit * 1e4, 3), gains.stable
    (1.308, True)
    """
    n = robot.n
    p, d = per_joint_array("kp", kp, n, sign="positive"), per_joint_array("kd", kd, n, sign="not negative")
    positive_number("sample_time", 1.0 if sample_time is None else sample_time)
    positive_number("max_sample_time", 1.0 if max_sample_time is None else max_sample_time)
    if n == 0:
        stable = None if sample_time is None else True
        none, always = np.zeros(0), (Window(0.0, np.inf, "stable"),)
        return Gains(
            FeedbackLoop(none, none, none, sample_time=sample_time), always, np.inf, sample_time, stable,
            largest_mode=0.0, worst_q=none, fastest_pole=0.0, sample_time_q=none,
            gravity_stiffness=0.0, beats_gravity=True, proven=BOTH,
        )  # fmt: skip
    space = workspace(robot) if q is None else (per_joint_array("q", q, n),) * 2
    loop, half = SampledLoop(robot, p, d), np.sqrt(d)

    largest, worst = largest_over(lambda q: np.linalg.eigvalsh(half[:, None] * loop.inverse(q) * half)[..., -1], *space)
    stiffness, _ = largest_over(lambda q: np.linalg.norm(loop.slope(q), 2, axis=(-2, -1)), *space)
    limit, limit_q = loop.limit(worst, *space)
    proven = BOTH[: 0 if q is None else 2]
    if bounds is not None and not hasattr(bounds, "joint_names"):
        raise TypeError(f"`bounds` must be a result of robot.bounds(), got {type(bounds).__name__}")
    if bounds is not None and q is None:
        stiffness, limit, proven = bounded(robot, p, d, bounds, limit)
    there, pole = LinearLoop(*loop.modes(limit_q)), float(-loop.feedback(worst).poles.real.min())
    windows = tuple(there.windows(max_sample_time or LONGEST * max(there.horizon, limit)))
    beats, stable = bool(p.min() > stiffness), None if sample_time is None else bool(sample_time < limit)
    return Gains(
        loop.feedback(limit_q, sample_time), windows, limit, sample_time, stable,
        largest_mode=largest, worst_q=worst, fastest_pole=pole, sample_time_q=limit_q,
        gravity_stiffness=stiffness, beats_gravity=beats, proven=proven,
    )  # fmt: skip


def bounded(robot: Robot, kp: Array, kd: Array, bounds: Bounds, limit: float) -> tuple[float, float, tuple[str, ...]]:
    """Gravity's stiffness, sample-time limit and what bounds prove of both; without one, nothing is stable."""
    if bounds.joint_names != robot.joint_names:
        own, theirs = listed(robot.joint_names), listed(bounds.joint_names)
        raise ValueError(f"`bounds` must be of the robot, with the joints {own}, got bounds of one with {theirs}")
    if robot.model not in bounds.models:
        raise ValueError(
            "`bounds` must be of this very robot, with its masses, gravity and limits, or have it at an end of their "
            "ranges of masses, got bounds of another model: call robot.bounds again"
        )
    gravity, inertia, (lower, upper) = bounds.gravity_stiffness, bounds.mass_eigenvalues, workspace(robot)
    if gravity is None or not (bounds.circle | (bounds.lower <= lower) & (upper <= bounds.upper)).all():
        raise ValueError("`bounds` must have the gravity_stiffness, and for all positions of the workspace")
    if robot.n > 1 or inertia is None:
        return float(gravity.upper), limit, BOTH[:1]
    with np.errstate(divide="ignore", invalid="ignore"):  # concave in stiffness, monotone in inertia: corners are worst
        m = np.array([[inertia.lower[0]], [inertia.upper[1]]])
        first = first_unstable_time(gravity.upper * np.array([-1, 0, 1]) / m, kp / m, kd / m)
    return float(gravity.upper), float(np.minimum(limit, np.nan_to_num(first).min())), BOTH


def workspace(robot: Robot) -> tuple[Array, Array]:
    """Bounds of every coordinate: its limits, or -pi to pi where it has none."""
    lower, upper = robot.lower, robot.upper
    return np.where(np.isfinite(lower), lower, -FREE), np.where(np.isfinite(upper), upper, FREE)


def random_configurations(lower: Array, upper: Array) -> Array:
    """Configurations between two corners of the workspace, the one nearest to zero first, shape (SAMPLES + 1, n)."""
    drawn = np.random.default_rng(0).uniform(np.minimum(lower, upper), np.maximum(lower, upper), (SAMPLES, len(lower)))
    return np.concatenate([np.clip(np.zeros((1, len(lower))), lower, upper), drawn])


def largest_over(
    value: Callable[[Array], Array], lower: Array, upper: Array, drawn: Array | None = None
) -> tuple[float, Array]:
    """Largest value found in a box of the workspace and its configuration; the best random samples are refined."""
    from scipy.optimize import Bounds, minimize

    drawn, bounds = random_configurations(lower, upper) if drawn is None else drawn, Bounds(lower, upper)
    found = [
        minimize(lambda q: -float(value(q)), start, method="L-BFGS-B", jac="3-point", bounds=bounds)
        for start in drawn[np.argsort(value(drawn))[-REFINED:]]
    ]
    best = min(found, key=lambda result: result.fun)
    return -float(best.fun), np.asarray(best.x)


class SampledLoop:
    """The linearised loop of a robot under sampled PD control with gravity compensation, in many configurations."""

    def __init__(self, robot: Robot, kp: Array, kd: Array) -> None:
        self.robot, self.kp, self.kd = robot, kp, kd
        self.slope, self.check = robot.kernel(gravity_torque, "q"), robot.kernel(solve_mass_matrix)

    def mass_matrix(self, q: Array) -> Array:
        """M in configurations q, shape (..., n, n); raises SingularMassMatrixError, which names joints."""
        self.check(q, np.zeros(self.robot.n))
        return self.robot.mass_matrix(q)

    def inverse(self, q: Array) -> Array:
        """M^-1 in configurations q, shape (..., n, n)."""
        return np.asarray(np.linalg.inv(self.mass_matrix(q)))

    def modes(self, q: Array) -> tuple[Array, Array, Array]:
        """Modes of gravity and gains in configurations q, shape (..., n)."""
        return gravity_modes(self.mass_matrix(q), self.slope(q), self.kp, self.kd)

    def feedback(self, q: Array, sample_time: float | None = None) -> FeedbackLoop:
        """The loop of (e, qd) in one configuration."""
        inverse, G = self.inverse(q), self.slope(q)
        none = np.zeros_like(G)
        A = np.block([[none, np.eye(len(q))], [-inverse @ G, none]])
        F = np.hstack([G - np.diag(self.kp), -np.diag(self.kd)])
        return FeedbackLoop(A, np.vstack([none, inverse]), F, sample_time=sample_time)

    def radius(self, q: Array, T: float | Array) -> Array:
        """Spectral radius of the map from sample to sample, for configurations q, shape (...)."""
        change, _ = step_matrix(*self.modes(q), np.asarray(T))
        return np.asarray(np.abs(1 + np.linalg.eigvals(change)).max(axis=-1))

    def limit(self, start: Array, lower: Array, upper: Array) -> tuple[float, Array]:
        """The smallest sample time that is not proven stable in `start` or another configuration, and where."""
        loop, where = LinearLoop(*self.modes(start)), start
        T = loop.first_unstable(LONGEST * loop.horizon)
        if self.robot.n == 1:

            def part(q: Array) -> Array:
                return -first_unstable_time(*(X.reshape(q.shape[:-1]) for X in self.modes(q))) / (T or 1.0)

            value, where = largest_over(part, lower, upper)
            return -value * (T or 1.0), where
        drawn = np.concatenate([start[None], random_configurations(lower, upper)])
        for _ in range(ROUNDS):
            found = self.unstable_configuration(drawn, T, lower, upper) if T > 0 else None
            shorter = T if found is None else LinearLoop(*self.modes(found)).first_unstable(T)
            if found is None or shorter == T:
                break
            T, where = shorter, found
        return T, where

    def unstable_configuration(self, drawn: Array, T: float, lower: Array, upper: Array) -> Array | None:
        """A configuration that is unstable for a sample time below T, if one is found."""
        some = drawn[::16]
        unstable = self.radius(some[:, None], T * SWEPT) > 1 + 1e-12  # more than rounding
        if unstable.any():
            return np.asarray(some[np.argwhere(unstable.T)[0, 1]])
        tried = T * (1 - 1e-6)
        radii = self.radius(drawn, tried)
        spread = float(np.ptp(radii)) or 1.0  # lightly damped loops differ in the fifth digit only
        largest, q = largest_over(lambda x: (self.radius(x, tried) - 1) / spread, lower, upper, drawn)
        return None if largest < 0 else q
