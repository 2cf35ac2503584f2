"""Exciting motions: criteria for the identifiability of a robot's parameters, and the search for the best motion.

Sequential quadratic programming from the best of many random motions, with exact gradients.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from ...basics.arrays import positive_number, vector, whole_number
from ...basics.spatial import Array
from ...basics.text import InNotebooks, counted, listed, short, wrapped
from ...dynamics.base_inertial_parameters import BaseParameters
from ...dynamics.regressors import regressor
from ...files.motion_files import write_columns
from ...model.model import Model
from ...model.standard_parameters import DriveModel, StandardParameters
from ...robot import Robot, robot_argument
from ...trajectories import ReferenceMotion, Samples
from .. import thresholds
from .limits import FourierBasis, Locked, MotionLimits, States, locked_positions, motion_limits

if TYPE_CHECKING:
    from scipy.optimize import OptimizeResult

    from ...simulation.scene import Scene


@dataclass(frozen=True)
class BaseRegressor:
    """Regressor of base parameters, bodies and drives, as a quantity whose kernel computes only these columns."""

    base: BaseParameters

    @property
    def quantity(self) -> Any:
        """Quantity of the regressor, with these columns as its core."""
        return replace(regressor.quantity, core=self.core)

    def core(self, model: Model, q: Array, qd: Array, qdd: Array) -> Array:
        """Columns of the regressor, shape (..., n, number of columns)."""
        return self._kept(regressor.core(model, q, qd, qdd), qd, qdd)

    def evaluate(self, model: Model, *args: Any, **kwargs: Any) -> tuple[Any, Any]:
        """Columns by the function itself, with its verdict on their precision."""
        Y, verdict = regressor.evaluate(model, *args, **kwargs)
        return self._kept(Y, *args[1:]), verdict

    def _kept(self, bodies: Array, qd: Array, qdd: Array) -> Array:
        drives = self.base.standard.drive_columns(qd, qdd)
        return np.asarray(np.concatenate([bodies, drives], axis=-1)[..., list(self.base.independent)])


Criterion = Callable[[Array], tuple[float, Array]]  # of singular values: value, derivatives with respect to logarithms


class SingularValues:
    """Singular values s of W, and right singular vectors as columns of V.

    Where rounding allows they are those of W^T W, unless `exact`: an SVD of W takes many times as long.
    """

    def __init__(self, W: Array, *, exact: bool = False) -> None:
        self.W = W
        squares, self.V = np.linalg.eigh(W.T @ W)
        if not exact and squares[0] * thresholds.GRAM**2 > squares[-1]:
            self.s = np.sqrt(squares)
        else:
            _, self.s, Vt = np.linalg.svd(W, full_matrices=False)
            self.V = Vt.T

    def gradient(self, slopes: Array) -> Array:
        """Derivatives of a function with respect to W's entries, from those with respect to the logarithms of s."""
        return np.asarray(self.W @ (self.V * (slopes / self.s**2) @ self.V.T))  # ds = u^T dW v with u = W v / s

    @property
    def measures(self) -> tuple[float, float]:
        """The condition number and log det(W^T W)."""
        return float(self.s.max() / self.s.min()), float(np.log(self.s**2).sum())


def log_condition(s: Array, p: float = np.inf) -> tuple[float, Array]:
    """log of the condition number of singular values, with derivatives with respect to their logarithms.

    The largest and the smallest singular value have no derivative where two of them meet, as they do at the optimum.
    With Schatten's norm of order p instead of the spectral norm, (sum of s^p)^(1/p) and (sum of s^-p)^(1/p) have one,
    and exceed the condition number by a factor of at most (number of columns)^(2/p).
    """
    order = min(p, 1e6)  # approximates the two extreme values
    large, small = (s / s.max()) ** order, (s.min() / s) ** order
    excess = 0.0 if np.isinf(p) else np.log(large.sum() * small.sum()) / p
    return float(np.log(s.max() / s.min()) + excess), large / large.sum() - small / small.sum()


def log_volume(s: Array) -> tuple[float, Array]:
    """-log det(W^T W) / number of columns, with its derivatives: log of the confidence ellipsoid per parameter."""
    return float(-2 * np.log(s).mean()), np.full(len(s), -2 / len(s))


def random_series(within: MotionLimits, count: int, rng: np.random.Generator) -> Array:
    """Random series x that reach some limit of each joint, scaled down where torques are limited, (count, size)."""
    n = within.robot.n
    anchor = rest_pose(within, rng)
    x = rng.normal(size=(count, n, within.size // n))
    largest = np.max(list(within.linear_use(x.reshape(count, -1)).values()), axis=0)
    x = (x / (1 + 1e-12) / largest[..., None]).reshape(count, -1)
    too_large = within.torque_use(x).max(-1) > 1
    while too_large.any():
        x[too_large] = anchor + thresholds.SHRINK * (x[too_large] - anchor)
        too_large[too_large] = within.torque_use(x[too_large]).max(-1) > 1
    return np.asarray(x)


def rest_pose(within: MotionLimits, rng: np.random.Generator) -> Array:
    """Series resting in mid-range, or in a random pose if the drives cannot hold that one."""
    robot = within.robot
    poses = within.centre + (within.upper - within.centre) * rng.uniform(-0.9, 0.9, (thresholds.POSES, robot.n))
    poses[0] = within.centre
    use = np.abs(within.torques((poses, np.zeros_like(poses), np.zeros_like(poses)))) + within.coulomb
    k = 0 if use[0].max() <= thresholds.HELD_EFFORT else int(use.max(-1).argmin())
    if use[k].max() > thresholds.HELD_EFFORT:
        j = int(use[k].argmax())
        raise ValueError(
            f"`limits`: no pose is held with {thresholds.HELD_EFFORT:.0%} of the efforts; the best of {len(poses)} "
            f"takes {use[k, j]:.1e} times effort_limit of joint {robot.joint_names[j]!r}"
        )
    coefficients = np.zeros((robot.n, within.free.shape[0]))
    coefficients[:, 0] = (poses[k] - within.centre) / within.velocity_limit
    return np.asarray((coefficients @ within.free).ravel())


LOGGER = logging.getLogger("rne")
ENDS = (0, 9)  # of SLSQP: converged, and as many iterations as allowed
NOT_BETTER = "no run found a better motion than the best random ones"

Progress = Callable[[int, int], Any]  # (done, total)


@dataclass(frozen=True, eq=False)
class MotionSearch:
    """Search for the series x of least criterion within limits.

    Criteria are those of W: its rows are torques of a motion's samples over their noise, its columns base parameters.
    Results are those of `scipy.optimize`: a series `x` that keeps its limits, `fun`, the exact criterion, and `success`
    and `message` of the run that found it.
    """

    within: MotionLimits
    regressor: BaseRegressor
    noise: Array  # of each joint's torques, shape (n,)
    samples: int  # times of one period at which W is taken
    exact: Criterion  # that is to be minimised
    stages: tuple[Criterion, ...]  # smooth criteria that are minimised one after the other
    iterations: int  # of each run, at most
    progress: Progress | None
    _last: dict[bytes, tuple[States, SingularValues]] = field(default_factory=dict, init=False)

    @cached_property
    def _grid(self) -> States:
        return self.within.basis.grid(self.samples)

    def matrix(self, x: Array) -> Array:
        """W of a series, shape (K n, number of base parameters)."""
        return self._matrix(self.within.states(x, self._grid))

    def _matrix(self, states: States) -> Array:
        Y = self.within.robot.kernel(self.regressor)(*states) / self.noise[:, None]
        return np.asarray(Y.reshape(-1, Y.shape[-1]))

    def _observed(self, x: Array) -> tuple[States, SingularValues]:
        """States of a series and singular values of its W, kept for the gradient that is asked for next."""
        key = x.tobytes()
        if key not in self._last:
            states = self.within.states(x, self._grid)
            self._last.clear()
            self._last[key] = states, SingularValues(self._matrix(states))
        return self._last[key]

    def value(self, criterion: Criterion, x: Array) -> float:
        """A criterion of a series."""
        return criterion(self._observed(x)[1].s)[0]

    def gradient(self, criterion: Criterion, x: Array) -> Array:
        """Exact derivatives of a criterion with respect to x, by those of W with respect to q, qd and qdd."""
        states, singular = self._observed(x)
        K, n = states[0].shape
        by_entries = singular.gradient(criterion(singular.s)[1]).reshape(K, n, -1) / self.noise[:, None]
        kernel = self.within.robot.kernel(self.regressor, order="gradient")
        slopes = np.split(kernel(*states, by_entries.reshape(K, -1)), 3, axis=-1)
        by_coefficients = sum(h.T @ m for h, m in zip(slopes, self._grid, strict=True))
        return self.within.gradient(np.asarray(by_coefficients))

    def run(self, starts: Array) -> OptimizeResult:
        """Best of several starts: each through the first stage, the best of them through the further ones."""
        from scipy.optimize import OptimizeResult

        first, *further = self.stages
        total, runs = len(starts) + len(further), []
        for k, x in enumerate(starts):
            start = OptimizeResult(x=x, fun=self.value(self.exact, x), success=False, message=NOT_BETTER)
            runs.append(self._minimise(first, start, k, (k, total)))
        best = min(range(len(runs)), key=lambda k: runs[k].fun)
        found = runs[best]
        for k, criterion in enumerate(further, start=len(runs)):
            found = self._minimise(criterion, found, best, (k, total))
        return found

    def _minimise(self, criterion: Criterion, start: OptimizeResult, k: int, runs: tuple[int, int]) -> OptimizeResult:
        """Run of SLSQP, the k-th of all; returns its start if there is no improvement.

        Where rounding leaves its quadratic subproblem without a solution, it begins again at the best of its iterates.
        """
        from scipy.optimize import minimize

        done, end, total = (self.iterations * run for run in (runs[0], runs[0] + 1, runs[1]))
        A, within, grid = self.within.rows, self.within, self._grid
        limits: list[dict[str, Any]] = [{"fun": lambda x: 1 - A @ x, "jac": lambda x: -A}]
        if len(within.driven):
            slack, slopes = within.torque_slack, within.torque_slack_slopes
            limits.append({"fun": lambda x: slack(x, grid), "jac": lambda x: slopes(x, grid)})

        path = [start.x]

        def tick(x: Array) -> None:
            nonlocal done
            path.append(np.array(x))
            done = min(done + 1, end)
            if self.progress is not None:
                self.progress(done, total)

        last = thresholds.LAST_CHANGE if criterion is self.stages[-1] else thresholds.COARSE_CHANGE
        for _ in range(thresholds.BEGINNINGS):
            run = minimize(
                lambda x: self.value(criterion, x),
                path[-1],
                jac=lambda x: self.gradient(criterion, x),
                constraints=[{"type": "ineq"} | limit for limit in limits],
                method="SLSQP",
                callback=tick,
                options={"maxiter": self.iterations, "ftol": last},
            )
            if run.status in ENDS:
                break
            kept = [self._held(start.x, x) for x in path]
            path.append(min(kept, key=lambda x: self.value(criterion, x)))
        if done < end:  # steps saved by an early end count as done
            done = end - 1
            tick(run.x)
        LOGGER.info("excitation, start %d: %s after %d iterations", k, run.message, run.nit)
        run.x = self._held(start.x, run.x)
        run.fun = self.value(self.exact, run.x)
        return start if run.x is start.x or not run.fun <= start.fun else run

    def _held(self, start: Array, end: Array) -> Array:
        """Farthest admissible series on the line from an admissible start to the optimiser's end."""
        if not np.isfinite(end).all():
            return start
        if self.within.holds(end):
            return end
        kept, broken = 0.0, 1.0
        for _ in range(thresholds.BISECTIONS):
            middle = (kept + broken) / 2
            kept, broken = (middle, broken) if self.within.holds(start + middle * (end - start)) else (kept, middle)
        return np.asarray(start + kept * (end - start)) if kept else start


@dataclass(frozen=True, eq=False)
class Excitation(ReferenceMotion, InNotebooks):
    """A periodic motion for the identification of a robot, found by `rne.excitation`.

    q(t) = q0 + sum over k of a_k / (k w) sin(k w t) - b_k / (k w) cos(k w t), with w = 2 pi / duration. It is a
    reference f(t) -> (q, qd, qdd), and repeats itself after `duration`.

    Attributes
    ----------
    robot : Robot
        The robot it is made for.
    duration : float
        The period [s].
    q0 : ndarray, shape (n,)
        Mean positions [rad or m].
    a, b : ndarray, shape (n, H)
        Amplitudes of the velocities' cosines and sines [rad/s or m/s].
    criterion : {"condition", "d-optimal"}
        The measure that was minimised.
    condition : float
        Condition number of W, whose rows are the torques of the samples and whose columns are the base parameters.
    log_det : float
        log det(W^T W), which grows as the confidence ellipsoid of the parameters shrinks.
    random : ndarray
        The criterion, `condition` or `log_det`, of random motions within the same limits.
    limit_use : mapping of str to ndarray, shape (n,)
        The largest share of the limits of "position", "velocity", "acceleration" and "torque" that the motion uses.
    converged : bool
        False if the optimiser stopped early or found nothing better than a random motion; the motion keeps its limits
        all the same.
    message : str
        The optimiser's message when it found the motion.
    locked : mapping of str to float
        Positions of joints that stay where they are. Their torques are not among the rows of W, parameters that only
        they excite not among its columns, and their shares of limits are zero [rad or m].
    notes : tuple of str
        What the motion does not take into account, in words.
    """

    robot: Robot
    duration: float
    q0: Array
    a: Array
    b: Array
    criterion: str
    condition: float
    log_det: float
    random: Array
    limit_use: Mapping[str, Array]
    converged: bool
    message: str
    locked: Mapping[str, float] = field(default_factory=dict)
    notes: tuple[str, ...] = ()

    @property
    def harmonics(self) -> int:
        """The number H of harmonics."""
        return int(self.a.shape[1])

    @property
    def active(self) -> tuple[str, ...]:
        """Limits that the motion uses to 97 % or more, such as "velocity of joint_2"."""
        used = [(kind, k) for kind, use in self.limit_use.items() for k in np.flatnonzero(use > thresholds.ACTIVE)]
        return tuple(f"{kind} of {self.robot.joint_names[k]}" for kind, k in used)

    def _at(self, t: Array) -> tuple[Array, Array, Array]:
        series = np.column_stack([self.q0, self.a, self.b])
        return FourierBasis(self.duration, self.harmonics).states(t, series)

    def sample(self, sample_rate: float, periods: int = 1) -> Samples:
        """Samples of the motion at equal intervals, for a robot's controller.

        Parameters
        ----------
        sample_rate : float
            Samples per second [Hz].
        periods : int
            How often the motion is repeated.

        Returns
        -------
        Samples
            Times from 0 to the last at or before the end, q, qd and qdd; tau is None. It has no names of joints:
            ``rne.plotting.plot(samples, motion.robot)`` shows those of the robot.

        Raises
        ------
        ValueError
            If an argument is not positive.
        """
        step = 1 / positive_number("sample_rate", sample_rate)
        count = int(whole_number("periods", periods) * self.duration / step * (1 + 1e-12)) + 1
        t = np.arange(count) * step
        return Samples(t, *self(t))

    def to_csv(self, path: str | PathLike[str], sample_rate: float, periods: int = 1) -> Path:
        """Write the motion at equal intervals as comma-separated values.

        Parameters
        ----------
        path : str or path-like
            In an existing folder.
        sample_rate : float
            Samples per second [Hz].
        periods : int
            How often the motion is repeated.

        Returns
        -------
        pathlib.Path
            The file written: a heading `t`, `q.<joint>`, `qd.<joint>`, `qdd.<joint>`, then one row per sample in SI
            units, with all digits. `rne.trajectories.read_csv` reads it.

        Raises
        ------
        FileNotFoundError
            If its folder does not exist.
        """
        samples, names = self.sample(sample_rate, periods), self.robot.joint_names
        parts = {"q": samples.q, "qd": samples.qd, "qdd": samples.qdd}
        columns = {f"{part}.{name}": np.asarray(x)[:, k] for part, x in parts.items() for k, name in enumerate(names)}
        return write_columns(path, samples.t, columns)

    def __repr__(self) -> str:
        kind, value, best = "condition number", self.condition, self.random.min()
        if self.criterion != "condition":
            kind, value, best = "log det", self.log_det, self.random.max()
        text = (
            f"Excitation of '{short(self.robot.model.name)}': {self.duration:g} s, "
            f"{counted(self.harmonics, 'harmonic')}, {kind} {value:.4g}; of {len(self.random)} random motions "
            f"{np.median(self.random):.4g} in the median, {best:.4g} at best"
        )
        text += f"; active limits: {', '.join(self.active)}" if self.active else ""
        text += "" if self.converged else f"; not converged: {self.message}"
        return wrapped("\n  ".join([text, *self.notes]))


CRITERIA = ("condition", "d-optimal")  # default criteria: from torques; from positions
MEASURED = ("torques", "positions")
ORDERS = (8.0, 64.0)  # orders of the Schatten norms that replace the spectral norm, one stage each


def excitation(
    robot: Robot | Scene,
    duration: float,
    harmonics: int = 5,
    criterion: str | None = None,
    *,
    measured: str = "torques",
    wrt: str | Sequence[str] | None = None,
    limits: Mapping[str, ArrayLike] | None = None,
    drives: DriveModel | None = None,
    locked: Locked | None = None,
    noise: ArrayLike | None = None,
    rest: bool = True,
    random_motions: int | None = None,
    starts: int = 3,
    iterations: int = 150,
    progress: Progress | None = None,
) -> Excitation:
    """A periodic motion from which the base parameters of a robot can be identified well.

    Parameters
    ----------
    robot : Robot or Scene
        The robot, as far as it is known: its geometry, and for limits of torques its parameters. For `measured`
        "positions" the scene, whose controller follows the motion.
    duration : float
        The period [s].
    harmonics : int
        Number H of harmonics of each joint's Fourier series.
    criterion : {"condition", "d-optimal"}
        The measure that is minimised: the condition number of W, whose rows are the torques of the samples and whose
        columns are the base parameters; or -log det(W^T W), the volume of the parameters' confidence ellipsoid. By
        default "condition" for torques, "d-optimal" for positions.
    measured : {"torques", "positions"}
        What the log will have. Of positions and commands without torques, rows of W are positions of the samples, its
        columns their derivatives with respect to the numbers `wrt`.
    wrt : str or sequence of str, optional
        Names of `scene.numbers` that are to be found from positions.
    limits : mapping of str to array_like, shape (n,), optional
        Replaces limits of the robot: "lower", "upper", "velocity_limit", "acceleration_limit" and "effort_limit"; the
        last two may be infinite [rad or m; rad/s or m/s; rad/s^2 or m/s^2; N m or N].
    drives : DriveModel, optional
        Rotors, friction and offsets of the drives that are to be identified too; by default none. Coulomb friction is
        taken as tanh(qd / smoothing), so that it has a derivative, by default with 5 % of the smallest velocity limit;
        with smoothing 0 it is sign(qd), whose derivative is zero except at rest.
    locked : mapping of str to float, or sequence of str or int, optional
        Joints that stay where they are, such as the fingers of a gripper, by name or index: with their positions, or in
        the middle of their ranges. Parameters that only they excite are not counted [rad or m].
    noise : array_like, shape (n,), optional
        Standard deviations of the torques, or their relative sizes, by which the rows of W are divided; by default the
        same for all joints; `estimate.sigma` of a first identification weighs them as a fit does [N m or N]. Of
        positions theirs [rad or m].
    rest : bool
        True for a motion that starts and ends with velocities and accelerations zero.
    random_motions : int
        Number of random motions within the limits that the result is compared with; by default 100 for torques, 30
        for positions.
    starts : int
        Number of starts of the optimiser, the best of the random motions.
    iterations : int
        Largest number of iterations of each run of the optimiser.
    progress : callable, optional
        A function progress(done, total), called with iterations of the optimiser, of which a run that ends early has
        done all. Each run's end is a line on the logger "rne". For positions, with random motions.

    Returns
    -------
    Excitation
        The motion, a reference f(t) -> (q, qd, qdd), with the criterion reached and the limits used.

    Raises
    ------
    TypeError
        If `robot`, `limits` or `locked` is of another type.
    KeyError
        If a name in `wrt` is not one of the scene's numbers.
    ValueError
        If an argument is out of range, a joint has no range or no velocity limit, the harmonics cannot excite all
        base parameters, or no motion within the limits is found.

    Notes
    -----
    Only the limits of the joints are kept: collisions of the robot with itself, the table or anything else are not
    considered. Look at the motion with `rne.view` before it runs on the robot.

    Fourier series as in Swevers et al. 1997; SciPy's SLSQP with exact gradients from the traced regressor, of Schatten
    norms of orders 8 and 64 instead of the condition number. Positions, velocities and accelerations keep their limits
    at all times, by the inequality of Bernstein and Szego. Torques are those of `robot`, with its damping and friction;
    they are limited at 64 times per period of the highest harmonic, with the parabola through three of them in between.

    From positions without torques the result is the best of the random motions: each is simulated with
    `rne.sensitivities` for two periods, of which the second counts, and no optimiser follows. Columns of W are divided
    by their norms over all motions. What no motion determines, such as a velocity gain in addition to viscous friction,
    is left out, and listed in `notes`. Smooth motions hardly depend on a dead band, and on a stall torque only where
    they reach it: for these add steps.

    Examples
    --------
    >>> import rne
    >>> robot = rne.load("irb140").locked({"joint_4": 0, "joint_5": 0, "joint_6": 0})
    >>> motion = rne.excitation(robot, 4.0, 3, limits={"acceleration_limit": [10.0] * 3})
    >>> motion.converged, bool(motion.condition < motion.random.min())
    (True, True)
    >>> motion.sample(100.0).q.shape
    (401, 3)
    >>> file = motion.to_csv("motion.csv", 250.0)  # doctest: +SKIP

    A 7-joint arm takes tens of seconds; `progress` shows them:

    >>> def progress(done, total):
    ...     print(f"\\r{done / total:.0%}", end="", flush=True)
    >>> panda = rne.load("panda")  # doctest: +SKIP
    >>> rne.excitation(panda, 10.0, locked=["panda_finger_joint1"], progress=progress)  # doctest: +SKIP
    """
    if measured not in MEASURED:
        raise ValueError(f"`measured` must be one of {list(MEASURED)}, got {measured!r}")
    by_positions = measured == "positions"
    criterion = CRITERIA[by_positions] if criterion is None else criterion
    if criterion not in CRITERIA:
        raise ValueError(f"`criterion` must be one of {list(CRITERIA)}, got {criterion!r}")
    if by_positions:
        if wrong := [name for name, x in (("drives", drives), ("locked", locked)) if x is not None]:
            raise ValueError(f"`{wrong[0]}` is for `measured` 'torques'; for 'positions' both are given by the scene")
        count = 30 if random_motions is None else random_motions
        return _by_positions(robot, wrt, (duration, harmonics, rest), criterion, limits, noise, count, progress)
    if wrt is not None:
        raise ValueError("`wrt` is for `measured` 'positions'; from torques base parameters are found")
    arm = numeric = robot_argument(robot)
    basis = _basis(arm, duration, harmonics, rest)
    if numeric.engine != "numpy":  # Numba takes minutes to compile the derivatives of a regressor
        numeric = Robot(numeric.model, "numpy")
    values = motion_limits(numeric, limits)
    positions = locked_positions(numeric, locked, values)
    moving = [k for k in range(arm.n) if k not in positions]
    if positions:
        numeric = numeric.locked({arm.joint_names[k]: position for k, position in positions.items()})
    within = MotionLimits(numeric, basis, rest, **{name: limit[moving] for name, limit in values.items()})
    base = numeric.base_parameters(drives=_drives(arm, drives, moving, within.velocity_limit))
    sizes = np.ones(arm.n) if noise is None else vector("noise", noise, arm.n, sign="positive")
    exact: Criterion = log_condition if criterion == "condition" else log_volume
    stages = tuple(partial(log_condition, p=p) for p in ORDERS) if criterion == "condition" else (log_volume,)
    count, most = thresholds.OBSERVED * harmonics, whole_number("iterations", iterations)
    search = MotionSearch(within, BaseRegressor(base), sizes[moving], count, exact, stages, most, progress)
    number = whole_number("random_motions", 100 if random_motions is None else random_motions)
    x = random_series(within, number, np.random.default_rng(0))
    measures = _excited(search, x)
    values_of_random = measures[:, CRITERIA.index(criterion)]
    order = np.argsort(values_of_random if criterion == "condition" else -values_of_random)
    found = search.run(x[order[: whole_number("starts", starts)]])
    return _result(arm, search, found, criterion, values_of_random, positions)


def _basis(robot: Robot, duration: float, harmonics: int, rest: bool) -> FourierBasis:
    """Series of a motion; an error for anything else."""
    if not robot.n:
        raise ValueError("`robot` must have at least one joint, got none")
    if whole_number("harmonics", harmonics) < (2 if rest else 1):
        raise ValueError("`harmonics` must be at least 2 for a motion that starts at rest, got 1")
    return FourierBasis(positive_number("duration", duration), harmonics)


def _by_positions(
    scene: Any,
    wrt: str | Sequence[str] | None,
    series: tuple[float, int, bool],
    criterion: str,
    limits: Mapping[str, ArrayLike] | None,
    noise: ArrayLike | None,
    random_motions: int,
    progress: Progress | None,
) -> Excitation:
    """Best of random motions for numbers of a scene to be identified from positions."""
    from .positions import position_argument, position_matrices

    names = position_argument(scene, wrt)
    robot = scene.resolved.robot
    basis = _basis(robot, *series)
    numeric = robot if robot.engine == "numpy" else Robot(robot.model, "numpy")
    within = MotionLimits(numeric, basis, series[2], **motion_limits(robot, limits))
    sizes = np.ones(robot.n) if noise is None else vector("noise", noise, robot.n, sign="positive")
    x = random_series(within, whole_number("random_motions", random_motions), np.random.default_rng(0))
    matrices, untold = position_matrices(scene, names, within, x, sizes, progress)
    measures = np.array([SingularValues(W, exact=True).measures for W in matrices])
    best = int(measures[:, 0].argmin() if criterion == "condition" else measures[:, 1].argmax())
    q0, a, b = np.split(within.coefficients(x[best]), [1, 1 + basis.harmonics], axis=1)
    message = f"the best of {counted(len(x), 'random motion')}, which no optimiser follows"
    ended: Any = within.use(x[best]), False, message, {}, (*untold, *_notes(within, {}))
    (condition, log_det), random = measures[best].tolist(), measures[:, CRITERIA.index(criterion)]
    return Excitation(robot, basis.duration, q0[:, 0], a, b, criterion, condition, log_det, random, *ended)


def _drives(robot: Robot, given: DriveModel | None, moving: list[int], velocity_limit: Array) -> DriveModel:
    """Drives of the joints that move, with smooth Coulomb friction."""
    drives = DriveModel() if given is None else given
    standard = StandardParameters(robot.model, drives)
    if "Fl" in standard.terms:
        raise ValueError('`drives`: friction under "load" depends on what is to be found; leave it out here')
    friction, names = drives.friction, [robot.joint_names[k] for k in moving]
    if isinstance(friction, Mapping):
        friction = {name: words for name, words in friction.items() if name in names}
    stribeck, saturation = (None if x is None else np.asarray(x)[moving] for x in (drives.stribeck, drives.saturation))
    slow = thresholds.SMOOTHING_SPEED * float(velocity_limit.min()) if drives.smoothing is None else drives.smoothing
    motors = standard.motors[:, moving]
    drives = replace(drives, coupled_motors=motors[motors.any(1)], friction=friction, smoothing=slow)
    return replace(drives, stribeck=stribeck, saturation=saturation)


def _excited(search: MotionSearch, x: Array) -> Array:
    """Both measures of random motions, or an error if they leave parameters unexcited."""
    matrices = [search.matrix(series) for series in x]
    with np.errstate(all="ignore"):
        scaled = [W / np.linalg.norm(W, axis=0) for W in matrices]
        if not any(SingularValues(W).measures[0] < thresholds.EXCITED for W in scaled):
            rank = max(int(np.linalg.matrix_rank(W, 1 / thresholds.EXCITED)) for W in scaled)
            raise ValueError(
                f"{len(x)} random motions of {search.within.basis.harmonics} harmonics within the limits excite at "
                f"most {rank} of {search.regressor.base.count} base parameters; give more harmonics or wider limits"
            )
    return np.array([SingularValues(W).measures for W in matrices])


def _result(
    robot: Robot,
    search: MotionSearch,
    found: OptimizeResult,
    criterion: str,
    random: Array,
    positions: Mapping[int, float],
) -> Excitation:
    within, n = search.within, robot.n
    moving = [k for k in range(n) if k not in positions]

    def placed(part: Array) -> Array:
        """Matrix that places rows of the joints that move among those of all."""
        rows = np.zeros((n, *part.shape[1:]))
        rows[moving] = part
        return rows

    coefficients = placed(within.coefficients(found.x))
    coefficients[list(positions), 0] = list(positions.values())
    q0, a, b = np.split(coefficients, [1, 1 + within.basis.harmonics], axis=1)
    condition, log_det = SingularValues(search.matrix(found.x), exact=True).measures
    use = {kind: placed(share) for kind, share in within.use(found.x).items()}
    locked = {robot.joint_names[k]: position for k, position in positions.items()}
    ended = bool(found.success), str(found.message), locked, _notes(within, locked)
    series = within.basis.duration, q0[:, 0], a, b
    return Excitation(robot, *series, criterion, condition, log_det, random, use, *ended)


def _notes(within: MotionLimits, locked: Mapping[str, float]) -> tuple[str, ...]:
    """Notes on effects that the motion does not take into account."""
    notes = ["collisions of the arm with itself and its surroundings are not considered"]
    free = [name for k, name in enumerate(within.robot.joint_names) if k not in within.driven]
    if free:
        notes.insert(0, f"torque is not bounded: the model has no effort limits of {listed(free)}")
    if within.robot.model.couplings:
        followers = listed([coupling.joint for coupling in within.robot.model.couplings])
        notes.insert(0, f"ranges and speeds of joints that follow others are not considered: {followers}")
    if locked:
        places = listed([f"{name} at {position:.4g}" for name, position in locked.items()])
        notes.insert(0, f"locked: {places}; parameters that only these joints excite are not counted")
    return tuple(notes)
