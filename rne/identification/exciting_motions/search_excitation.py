"""The public search for a motion that excites the parameters of a robot."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import ArrayLike

from ...basics.arrays import positive_number, vector, whole_number
from ...basics.spatial import Array
from ...robot import Robot, robot_argument
from .criteria import Condition, Determinant, Observation
from .excitation_result import Excitation
from .fourier import FourierBasis
from .motion_limits import motion_limits
from .random_motions import random_series
from .search import Found, Progress, Search
from .series_limits import SeriesLimits

CRITERIA = ("condition", "d-optimal")
ORDERS = (8.0, 64.0)  # of the Schatten norms in place of the spectral norm, one stage each
SAMPLES = 20  # per period of the highest harmonic
SMOOTHING = 0.05  # of the smallest rate limit: where Coulomb friction changes its sign
EXCITED = 1e8  # condition number, columns of unit norm, of a motion that leaves parameters unexcited


def excitation(
    robot: Robot,
    duration: float,
    harmonics: int = 5,
    criterion: str = "condition",
    *,
    limits: Mapping[str, ArrayLike] | None = None,
    rotor: bool = False,
    friction: str | None = None,
    offset: bool = False,
    shafts: ArrayLike | None = None,
    smoothing: float | None = None,
    noise: ArrayLike | None = None,
    scaled: bool = False,
    rest: bool = True,
    samples: int | None = None,
    random_motions: int = 100,
    starts: int = 3,
    iterations: int = 150,
    seed: int = 0,
    progress: Progress | None = None,
) -> Excitation:
    """A periodic motion from which the base parameters of a robot can be identified well.

    Parameters
    ----------
    robot : Robot
        The robot, as far as it is known: its geometry, and for limits of torques its parameters.
    duration : float
        The period [s].
    harmonics : int
        Number H of harmonics of each joint's Fourier series.
    criterion : {"condition", "d-optimal"}
        What is minimised: the condition number of W, whose rows are the torques of the samples and whose columns are
        the base parameters; or -log det(W^T W), the volume of the parameters' confidence ellipsoid.
    limits : mapping of str to array_like, shape (n,), optional
        Replaces limits of the robot: "lower", "upper", "velocity_limit" and "effort_limit"; accelerations are not
        limited unless "acceleration_limit" is given. Efforts may be infinite [rad or m; rad/s or m/s; N m or N; rad/s^2
        or m/s^2].
    rotor : bool
        True if inertias of the drives' rotors are parameters to be identified too.
    friction : {None, "viscous", "coulomb", "viscous+coulomb"}
        Friction that is to be identified too.
    offset : bool
        True if constant torques of the drives are to be identified too.
    shafts : array_like, shape (s, n), optional
        Rows of further shafts with rotor and friction, each turning at that row times qd.
    smoothing : float, optional
        Coulomb friction is taken as tanh(qd / smoothing), so that it has a derivative; by default 5 % of the smallest
        rate limit. With 0 it is sign(qd), whose derivative is zero except at rest [rad/s or m/s].
    noise : array_like, shape (n,), optional
        Standard deviations of the torques, or their relative sizes, by which the rows of W are divided; by default the
        same for all joints [N m or N].
    scaled : bool
        True for the condition number of W with each column divided by its norm, which does not depend on the units of
        the parameters, but does not ask for large motions either.
    rest : bool
        True for a motion that starts and ends with rates and accelerations zero.
    samples : int, optional
        Times of one period at which W is taken; by default 20 per harmonic.
    random_motions : int
        Number of random motions within the limits that the result is compared with.
    starts : int
        How many of these, the best, are starts of the optimiser.
    iterations : int
        The most of each run of the optimiser.
    seed : int
        Of the random motions; the same seed gives the same motion.
    progress : callable, optional
        A function progress(start, iteration, value), called after each iteration with the condition number, or
        log det(W^T W). Each run's end is a line on the logger "rne".

    Returns
    -------
    Excitation
        The motion, a reference f(t) -> (q, qd, qdd), with the criterion reached and the limits used.

    Raises
    ------
    TypeError
        If `robot` or `limits` is of another type.
    ValueError
        If an argument is out of range, a joint has no range or no rate limit, the harmonics or samples cannot excite
        all base parameters, or no motion within the limits is found.

    Notes
    -----
    Only the limits of the joints are kept: collisions of the robot with itself, the table or anything else are not
    considered. Look at the motion with `rne.view` before it runs on the robot.

    Fourier series as in Swevers et al. 1997; SciPy's SLSQP with exact gradients from the traced regressor. The
    condition number has no derivative where singular values meet, as they do at the optimum; it is approximated by
    Schatten norms of orders 8 and 64. Positions, rates and accelerations keep their limits at all times, by the
    inequality of Bernstein and Szego: a grid of 16 times per period of the highest harmonic misses at most 1.9 % of a
    maximum. Torques are those of `robot`, with its damping and friction; they are limited at 64 times per period of the
    highest harmonic, with the parabola through three of them in between.

    Examples
    --------
    >>> import rne
    >>> robot = rne.load("irb140").locked({"joint_4": 0, "joint_5": 0, "joint_6": 0})
    >>> motion = rne.excitation(robot, 4.0, 3, limits={"acceleration_limit": [10.0] * 3}, friction="viscous")
    >>> motion.converged, bool(motion.condition < motion.random.min())
    (True, True)
    """
    within = _within(robot, duration, harmonics, limits, rest)
    slow = SMOOTHING * float(within.limits.velocity_limit.min(initial=np.inf)) if smoothing is None else smoothing
    numeric = within.robot
    base = numeric.base_parameters(rotor=rotor, friction=friction, offset=offset, shafts=shafts, smoothing=slow)
    sizes = np.ones(robot.n) if noise is None else vector("noise", noise, robot.n, sign="positive")
    rng = np.random.default_rng(seed)
    observation = Observation(numeric, base, sizes)
    exact, stages = _criteria(criterion, scaled)
    count = SAMPLES * harmonics if samples is None else whole_number("samples", samples)
    search = Search(within, observation, count, exact, stages, whole_number("iterations", iterations), progress)
    x = random_series(within, whole_number("random_motions", random_motions), rng)
    values = _excited(search, x)
    best = x[np.argsort(values)[: whole_number("starts", starts)]]
    return _result(robot, search, search.run(best), criterion, x)


def _within(
    robot: Robot, duration: float, harmonics: int, limits: Mapping[str, ArrayLike] | None, rest: bool
) -> SeriesLimits:
    robot_argument(robot)
    if not robot.n:
        raise ValueError("`robot` must have at least one joint, got none")
    least = 2 if rest else 1
    if whole_number("harmonics", harmonics) < least:
        raise ValueError("`harmonics` must be at least 2 for a motion that starts at rest, got 1")
    basis = FourierBasis(positive_number("duration", duration), harmonics)
    # Numba takes minutes to compile the derivatives of a regressor.
    numeric = robot if robot.engine == "numpy" else Robot(robot.model, "numpy")
    return SeriesLimits(numeric, motion_limits(robot, limits), basis, rest)


def _criteria(criterion: str, scaled: bool) -> tuple[Condition | Determinant, tuple[Condition | Determinant, ...]]:
    if criterion not in CRITERIA:
        raise ValueError(f"`criterion` must be one of {list(CRITERIA)}, got {criterion!r}")
    if criterion == "condition":
        return Condition(scaled=scaled), tuple(Condition(p, scaled) for p in ORDERS)
    if scaled:
        raise ValueError(
            "`scaled` must be False for criterion 'd-optimal', which does not depend on the columns' units"
        )
    return Determinant(), (Determinant(),)


def _excited(search: Search, x: Array) -> list[float]:
    """The criterion of random motions, or an error if they leave parameters unexcited."""
    parameters, n = search.observation.base.count, search.within.robot.n
    if search.samples * n < parameters:
        raise ValueError(
            f"`samples` must be at least {-(-parameters // n)} for {parameters} base parameters of {n} joints, "
            f"got {search.samples}"
        )
    matrices = [search.matrix(series) for series in x]
    usual = Condition(scaled=True)
    with np.errstate(all="ignore"):
        if not min(usual.value(W) for W in matrices) < np.log(EXCITED):
            rank = max(int(np.linalg.matrix_rank(W / np.linalg.norm(W, axis=0), 1 / EXCITED)) for W in matrices)
            raise ValueError(
                f"{len(x)} random motions of {search.within.basis.harmonics} harmonics within the limits excite at "
                f"most {rank} of {parameters} base parameters; give more harmonics or wider limits"
            )
    return [search.exact.value(W) for W in matrices]


def _result(robot: Robot, search: Search, found: Found, criterion: str, x: Array) -> Excitation:
    within, H = search.within, search.within.basis.harmonics
    coefficients = within.coefficients(found.x)
    condition = Condition(scaled=isinstance(search.exact, Condition) and search.exact.scaled)

    def measured(series: Array) -> tuple[float, float]:
        W = search.matrix(series)
        return condition.measure(W), Determinant().measure(W)

    best, random = measured(found.x), np.array([measured(series) for series in x])
    return Excitation(
        robot=robot,
        duration=within.basis.duration,
        q0=coefficients[:, 0],
        a=coefficients[:, 1 : H + 1],
        b=coefficients[:, H + 1 :],
        criterion=criterion,
        condition=best[0],
        log_det=best[1],
        random=random[:, CRITERIA.index(criterion)],
        limit_use=within.use(found.x),
        converged=found.converged,
        message=found.message,
    )
