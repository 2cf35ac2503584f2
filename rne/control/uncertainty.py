"""Uncertain parameters of robust laws: a set of robots, and the bounds that follow from it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from ..basics.arrays import cached_array, is_equal, positive_number, whole_number
from ..basics.spatial import Array
from ..robot import Robot
from .gains import workspace
from .laws import Reference, check_reference, checked_vectors, of_robot, reference_values

MARGIN = 1.1  # factor on the largest values found
BUDGET = 3.0  # effort of proofs as in `rne.Robot.bounds`: a few seconds
SHARED = (  # fields of a Model that must be equal in all cases
    *("moving_joints", "joint_types", "parent", "axis", "rotation", "translation", "joint_origin"),
    *("gravity", "armature", "coordinate", "multiplier", "offset", "couplings"),
)
MIXTURES = 16  # number of random mixtures for the bound of an uncertainty


@dataclass(frozen=True, eq=False)
class Cases:
    """Robots and all their mixtures, which a robust law takes as possible (`RobustPassive.cases`, `SlidingMode.cases`).

    Attributes
    ----------
    robots : tuple of Robot
        They differ only in the masses of their bodies.

    Examples
    --------
    >>> import rne
    >>> arm, path = rne.load("irb140"), rne.trajectories.quintic([0] * 6, [1] * 6, 2.0)
    >>> law = rne.control.robust_passive([arm, arm.with_payload(3.0)], 20, 10, path, boundary=0.1)
    >>> len(law.cases.robots), law.cases.ball.shape
    (2, (60, 1))
    """

    robots: tuple[Robot, ...]

    @cached_property
    def centre(self) -> Robot:
        """The robot with the mean of the parameters."""
        return self.robots[0].with_parameters(np.mean([robot.parameters for robot in self.robots], axis=0))

    @cached_array
    def deviations(self) -> Array:
        """Parameters of the robots minus the centre's, shape (10 nb, robots)."""
        return np.stack([robot.parameters - self.centre.parameters for robot in self.robots], axis=1)

    @cached_array
    def ball(self) -> Array:
        """Matrix W of a ball that holds all mixtures: parameters pi_0 + W z with |z| <= 1, shape (10 nb, k)."""
        size = np.abs(self.deviations).max(axis=1)
        size = np.where(size == 0, 1.0, size)[:, None]
        U, singular, V = np.linalg.svd(self.deviations / size, full_matrices=False)
        k = np.linalg.matrix_rank(self.deviations / size)
        radius = np.sqrt((V[:k] ** 2).sum(axis=0).max(initial=0.0))
        return np.asarray(size * U[:, :k] * singular[:k] * radius)

    def inertia_bounds(self, scale: Array) -> tuple[float, Array]:
        """Bounds of the eigenvalues of D M D, D = diag(scale), and of the diagonal entries of M^-1, over the workspace.

        Proven where `BUDGET` suffices to come within `MARGIN` of the values attained; otherwise what a search
        attains, times `MARGIN`, which is an assumption. The same on every machine, fast or slow.
        """
        from ..bounds.bounds import inertia_extremes

        models, positions = [robot.model for robot in self.robots], workspace(self.centre)
        found = inertia_extremes(models, positions, self.centre.engine, scale, MARGIN - 1, BUDGET)
        bounds = np.minimum(found.upper, MARGIN * found.attained)
        return float(bounds[0]), bounds[1:]


def checked_cases(cases: Sequence[Robot]) -> Cases:
    """Robots that differ only in their bodies' parameters; raises otherwise."""
    robots = tuple(cases) if isinstance(cases, Sequence) else ()
    if len(robots) < 2 or not all(isinstance(robot, Robot) for robot in robots):
        raise ValueError("`cases` must be a sequence of at least two Robots, between which the robot that moves lies")
    for robot in robots[1:]:
        check_shared("`cases` must differ", robots[0], robot)
    return Cases(robots)


def check_shared(what: str, first: Robot, robot: Robot) -> None:
    """Raise a ValueError if two robots differ in more than their bodies."""
    for name in SHARED:
        if not is_equal(getattr(first.model, name), getattr(robot.model, name)):
            raise ValueError(f"{what} only in masses, centres of mass and inertias, not in {name}")


@of_robot
def uncertainty_bound(
    robot: Robot,
    cases: Sequence[Robot],
    bandwidth: ArrayLike,
    boundary: ArrayLike,
    reference: Reference,
    duration: float,
    *,
    samples: int = 4000,
    margin: float = 1.2,
    seed: int = 0,
) -> float:
    """A bound rho for `rne.control.robust` by sampling: states near the reference, times, and mixtures of cases.

    Parameters
    ----------
    robot : Robot
        The controller's model, which differs from the cases only in its bodies' parameters.
    cases : sequence of Robot
        Robots of which the one that moves is a mixture, such as the arm without and with its largest payload.
    bandwidth, boundary : float or array_like, shape (n,)
        Arguments of the law [1/s; rad/s or m/s].
    reference : callable
        A function f(t) -> (q, qd, qdd).
    duration : float
        End of the times of the reference that are drawn, from 0 [s].
    samples : int
        Number of states, at least 16; half of them with one of the cases, half with a random mixture.
    margin : float
        Factor on the largest value found, for what lies between the samples.
    seed : int
        Seed of the random numbers.

    Returns
    -------
    float
        The largest value of lambda_max(D M D) |(D M D)^-1 D f| times margin, with D = diag(boundary) and f the error of
        the model's torques [W].

    Raises
    ------
    ValueError
        If an argument has the wrong shape, sign or type, or the robot or the cases differ in more than masses.

    Notes
    -----
    The states have |z| <= 1, z = s / boundary, and |e_i| <= boundary_i / bandwidth_i; the bound does not hold for
    others. A bound found by sampling is not proven, which the margin allows for. `robust_passive` and `sliding_mode`
    need no such bound.

    Examples
    --------
    >>> import rne
    >>> arm, path = rne.load("irb140"), rne.trajectories.quintic([0] * 6, [1] * 6, 2.0)
    >>> cases, layer = [arm, arm.with_payload(3.0)], [0.1, 0.1, 0.1, 0.5, 0.5, 2.0]
    >>> rho = rne.control.uncertainty_bound(arm.with_payload(1.5), cases, 10, layer, path, 2.0)
    >>> 0 < rho < 100
    True
    """
    hull = checked_cases(cases)
    check_shared("`robot` must differ from `cases`", hull.centre, robot)
    layer = checked_vectors(robot, sign="positive", bandwidth=bandwidth, boundary=boundary)
    check_reference(robot, reference)
    count = whole_number("samples", samples, least=MIXTURES)
    rng = np.random.default_rng(whole_number("seed", seed, least=0))
    times = rng.uniform(0, positive_number("duration", duration, zero_allowed=True), count)
    q, qd, y = _drawn_states(robot, reference, times, layer, rng)
    short, D = np.empty(count), layer[1]
    needed = robot.inverse_dynamics(q, qd, y)
    each = np.eye(len(hull.robots))[np.arange(MIXTURES // 2) % len(hull.robots)]
    mixed = rng.dirichlet(np.ones(len(hull.robots)), MIXTURES - len(each))
    for k, weights in enumerate((*each, *mixed)):
        part = slice(k * count // MIXTURES, (k + 1) * count // MIXTURES)
        moving = hull.centre.with_parameters(hull.centre.parameters + hull.deviations @ weights)
        f = D * (needed[part] - moving.inverse_dynamics(q[part], qd[part], y[part]))
        M = moving.mass_matrix(q[part]) * np.outer(D, D)
        acceleration = np.linalg.solve(M, f[..., None])[..., 0]
        short[part] = np.linalg.eigvalsh(M)[:, -1] * np.linalg.norm(acceleration, axis=-1)
    return positive_number("margin", margin) * float(short.max())


def _drawn_states(
    robot: Robot, reference: Reference, times: Array, layer: Sequence[Array], rng: np.random.Generator
) -> tuple[Array, Array, Array]:
    """States near the reference at some times: q, qd and the commanded accelerations, (samples, n) each."""
    (decay, D), count, n = layer, len(times), robot.n  # bandwidth and boundary
    q_ref, qd_ref, qdd_ref = np.array([reference_values(robot, reference(float(t))) for t in times]).swapaxes(0, 1)
    direction, length = rng.normal(size=(count, n)), rng.uniform(0, 1, (count, 1)) ** (1 / max(n, 1))
    s = D * (direction / np.linalg.norm(direction, axis=1, keepdims=True) * length)  # in the layer, evenly
    e = D / decay * rng.uniform(-1, 1, (count, n))
    q, qd = q_ref + e, qd_ref + s - decay * e
    return q, qd, qdd_ref - decay * (qd - qd_ref) - decay * s
