"""The likely cause of a difference between two models: each hypothesis alone, then two at a time.

Hypotheses that are linear in their numbers are columns, as causes of residuals are, and some of these numbers may be 0
or 1 alone.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from itertools import combinations
from math import comb, log, prod
from typing import Any

import numpy as np

from ...basics.arrays import positive_number
from ...basics.spatial import Array, point_mass_inertia
from ...basics.text import InNotebooks, Row, aligned, listed, short, six_digits, wrapped
from ...model.model import joint_array
from ...model.parameters import COLUMNS, PARAMETERS, ROWS
from ...model.standard_parameters import MEASURED, StandardParameters
from ...robot import Robot, robot_argument
from .. import thresholds
from .conventions import Convention, conventions, torques_of, zeros_text
from .hypotheses import (
    OF_JOINTS,
    SIZE,
    Hypothesis,
    columns_of,
    factors,
    gravity_columns,
    hypotheses_argument,
    of_joints,
    text_of,
    zero_columns,
)
from .residuals import Discrepancy, Torques, orthonormal

SEVERAL_BODIES = "several bodies"  # explains whatever other bodies do
OTHER_BODIES = {"one body", "payload"}  # two of them are several bodies
OF_FEW_JOINTS = {  # kind: a noun, and the kinds of single joints with a symbol
    "armature": ("inertia of rotors (armature)", {"rotor": ""}),
    "viscous friction": ("viscous friction", {"viscous friction": ""}),
    "Coulomb friction": ("Coulomb friction", {"Coulomb friction": ""}),
    "friction": ("viscous and Coulomb friction", {"viscous friction": " Fv", "Coulomb friction": " Fc"}),
    "torque offset": ("constant torque", {"offset": ""}),
    "spring": ("torque of springs", {"spring": ""}),
    "friction by direction": ("viscous friction in one direction", {"friction by direction": ""}),
}
SHOWN = 5  # candidates in a report

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


class TorqueDifference(Discrepancy):
    """Torques of another model less the robot's own at states, in units of the rounding that is allowed.

    Joint friction is not among the robot's torques.
    """

    resolution = thresholds.ROUNDED_PART, thresholds.ROUNDED_PART

    def __init__(self, robot: Robot, states: Sequence[Array], tau: Array, tolerance: float) -> None:
        self.q, self.qd, self.qdd = states
        self.states, self.tau, self.expected = states, tau, robot.inverse_dynamics(*states)
        size = np.sqrt((tau**2).mean(0)) + np.sqrt((self.expected**2).mean(0))
        rounding = tolerance * np.maximum(size, max(thresholds.SMALLEST * size.max(initial=0), thresholds.TINY))
        super().__init__(robot, rounding, np.ones(tau.shape, bool))
        self.difference, self.bodies = tau - self.expected, robot.parameters
        self.left, self.Q = self.weighted(self.difference), np.zeros((tau.size, 0))
        self.floor = self.counts = np.full(robot.n, float(len(tau)))

    def sampled(self, torques: Torques) -> Array:
        """A function of the motion at the states."""
        return torques(*self.states)

    def load(self, q: Array, qd: Array, qdd: Array) -> Array:
        """Torques of the robot."""
        return self.robot.inverse_dynamics(q, qd, qdd)

    @cached_property
    def chosen(self) -> Array:
        """Indices of the few states."""
        return np.unique(np.linspace(0, len(self.tau) - 1, thresholds.FEW).round().astype(int))

    @cached_property
    def few(self) -> TorqueDifference:
        """A few of the states, enough to choose among many hypotheses, with the same rounding."""
        found = TorqueDifference(self.robot, [x[self.chosen] for x in self.states], self.tau[self.chosen], 1.0)
        found.sigma = self.sigma
        found.left = found.weighted(found.difference)
        return found

    @cached_property
    def body_columns(self) -> Array:
        """Torques per unit of each parameter of each body, shape (N, n, nb, 10)."""
        return self.robot.regressor(*self.states).reshape(*self.tau.shape, -1, PARAMETERS)

    def relative(self, torques: Array) -> Array:
        """|torques| / |tau| of each joint, shape (n,)."""
        size = np.linalg.norm(self.tau, axis=0)
        least = max(thresholds.SMALLEST * size.max(initial=0), thresholds.TINY)
        with np.errstate(over="ignore"):  # infinite, where the other's torques are zero
            return np.asarray(np.linalg.norm(torques, axis=0) / np.maximum(size, least))

    def explains(self, residual: Array) -> bool:
        """True if no joint's residual, by its root mean square, is above rounding."""
        return bool(((residual**2).mean(0) <= self.sigma**2).all())

    def candidate(
        self,
        causes: Sequence[str],
        texts: Sequence[str],
        numbers: int,
        alternatives: float,
        residual: Array,
        before: Candidate | None = None,
    ) -> Candidate:
        """A hypothesis, on top of another, judged by what it leaves as causes of residuals are."""
        if before is not None:
            causes, texts = [*before.causes, *causes], [before.text, *texts]
            numbers, alternatives = before.numbers + numbers, before.alternatives * alternatives
        gain = self.gain(self.by_joint(self.weighted(residual)))
        score = 2 * (self.penalty(numbers) + log(alternatives) - gain)
        explains = self.explains(residual)
        return Candidate(tuple(causes), "; ".join(texts), numbers, alternatives, residual, score, explains)

    def fit(self, *parts: Hypothesis, before: Candidate | None = None) -> Candidate | None:
        """Hypotheses that act together, on top of another; None where one of them has no part in it."""
        torques = self.difference if before is None else before.residual
        columns = [columns_of(self, h) for h in parts]
        X, ends = np.concatenate(columns, axis=-1), np.cumsum([x.shape[-1] for x in columns])[:-1]
        c, *_ = self.with_columns(X, self.weighted(torques))
        sizes = np.linalg.norm(self.weighted(X), axis=0) / np.sqrt(len(self.tau))
        chosen = [chosen_numbers(h, *x) for h, *x in zip(parts, np.split(c, ends), np.split(sizes, ends), strict=True)]
        if not all(x.any() for x in chosen):
            return None
        fixed = np.concatenate([np.full(len(x), h.numbers == "switches") for h, x in zip(parts, chosen, strict=True)])
        on = np.concatenate(chosen)
        c, free, numbers = (on & fixed).astype(float), on & ~fixed, 0
        torques = torques - X @ c
        if free.any():
            c[free], _, left, numbers = self.with_columns(X[..., free], self.weighted(torques))
            torques = left.reshape(torques.shape) * self.sigma
        alternatives = prod(h.alternatives * comb(len(x), int(x.sum())) for h, x in zip(parts, chosen, strict=True))
        texts = [text_of(h, x) for h, x in zip(parts, np.split(c, ends), strict=True)]
        return self.candidate([h.kind for h in parts], texts, numbers, alternatives, torques, before)


def chosen_numbers(h: Hypothesis, c: Array, sizes: Array) -> Array:
    """True for numbers that a hypothesis needs, of those fitted to columns of these root mean squares."""
    if h.numbers == "all":
        return np.ones(len(c), bool)
    if h.numbers == "few":
        return np.asarray(np.abs(c) * sizes > 1)  # above rounding
    return np.asarray(np.abs(c - 1) < thresholds.NEAR)


# Hypotheses that are linear in their numbers


def linear_hypotheses(data: TorqueDifference) -> Iterator[Hypothesis]:
    """All of them, the plainest first."""
    yield from other_gravity(data)
    yield from other_torques(data)
    singles = list(of_joints(data, OF_JOINTS))
    for kind, (noun, symbols) in OF_FEW_JOINTS.items():
        chosen = [h for h in singles if h.kind in symbols]
        columns = np.concatenate([columns_of(data, h) for h in chosen], axis=-1)
        labels = [h.joints[0] + symbols[h.kind] for h in chosen]

        def text(c: Array, noun: str = noun, labels: list[str] = labels) -> str:
            parts = [f"{label} {six_digits(x)}" for label, x in zip(labels, c, strict=True) if x]
            return f"it has more {noun}: {listed(parts)}"

        yield Hypothesis(kind, columns, text, numbers="few")
    together = {single for _, symbols in OF_FEW_JOINTS.values() for single in symbols}
    yield from (h for h in singles if h.kind not in together)
    yield from other_inertias(data)
    yield from other_bodies(data)


def switch(kind: str, torques: Array, text: str, alternatives: float = 1.0) -> Hypothesis:
    """A change that is there or not."""
    return Hypothesis(kind, torques[..., None], text, alternatives=alternatives, numbers="switches")


def vector_text(x: Array) -> str:
    """Three numbers to four digits."""
    return "(" + ", ".join(f"{round(float(v), 9) + 0.0:.4g}" for v in x) + ")"


def other_gravity(data: TorqueDifference) -> Iterator[Hypothesis]:
    """Sign, magnitude and direction of gravity."""
    g = data.robot.model.gravity
    columns = gravity_columns(data, data.bodies)[..., 0]
    own = columns @ g
    if g.any():
        yield switch("gravity sign", -2 * own, "gravity has the opposite sign")
        yield switch("gravity missing", -own, "it has no gravity")
        yield Hypothesis(SIZE, own[..., None], lambda c: f"gravity is {1 + c[0]:.6g} times this robot's")
    text = f"gravity is %s m/s^2 in the axes of the base, {vector_text(g)} m/s^2 in this robot"
    yield Hypothesis("base turned", columns, lambda c: text % vector_text(g + c))


def other_torques(data: TorqueDifference) -> Iterator[Hypothesis]:
    """Torques in another unit or of the opposite sign, of all joints and of single ones."""
    names, own = data.names, data.expected
    single = np.concatenate([columns_of(data, h) for h in factors(data, own)], axis=-1)

    def sign_text(c: Array) -> str:
        if c.all():
            return "torques of all joints have the opposite sign"
        return f"torques have the opposite sign in {listed([names[j] for j in np.flatnonzero(c)])}"

    def factor_text(c: Array) -> str:
        return "torques are " + listed([f"{1 + x:.6g} times in {names[j]}" for j, x in enumerate(c) if x])

    yield Hypothesis("torque sign", -2 * single, sign_text, numbers="switches")
    yield switch("torque unit", (1e3 - 1) * own, "torques are in N mm", 3)
    yield switch("torque unit", (1e-3 - 1) * own, "torques are in kN m", 3)
    yield Hypothesis("torque unit", own[..., None], lambda c: f"torques are {1 + c[0]:.6g} times this robot's")
    yield Hypothesis("torque factor", single, factor_text, numbers="few")


def inertia_change(I: Array) -> Array:
    """Parameters of bodies that change by inertias alone, shape (..., 10)."""
    return np.concatenate([np.zeros((*I.shape[:-2], 4)), I[..., ROWS, COLUMNS]], axis=-1)


def other_inertias(data: TorqueDifference) -> Iterator[Hypothesis]:
    """Inertias about another point, or with other products: a switch for each body."""
    names, pi = data.robot.model.moving_joints, data.bodies.reshape(-1, PARAMETERS)
    mass = pi[:, 0, None]
    steiner = inertia_change(point_mass_inertia(mass[..., None], pi[:, 1:4] / np.where(mass == 0, 1.0, mass)))
    off_diagonal = np.isin(np.arange(PARAMETERS), [5, 7, 8])
    products, about_joint = (pi - steiner) * off_diagonal, pi * off_diagonal
    for kind, change, what in (
        ("inertia point", steiner, "the inertia about the joint is taken as one about the centre of mass"),
        ("inertia point", -steiner, "the inertia about the centre of mass is taken as one about the joint"),
        ("inertia point", -2 * steiner, "the parallel-axis term has the wrong sign"),
        ("products of inertia", -2 * products, "products of inertia about the centre of mass have the opposite sign"),
        ("products of inertia", -products, "products of inertia about the centre of mass are missing"),
        ("products of inertia", -2 * about_joint, "products of inertia about the joint have the opposite sign"),
    ):

        def text(c: Array, what: str = what) -> str:
            chosen = "all bodies" if c.all() else f"body of {listed([names[i] for i in np.flatnonzero(c)])}"
            return f"{what}, {chosen}"

        columns = (data.body_columns * change).sum(-1)
        yield Hypothesis(kind, columns, text, alternatives=6, numbers="switches")


def other_bodies(data: TorqueDifference) -> Iterator[Hypothesis]:
    """Other parameters of one body, or of all."""
    names, last = data.robot.model.moving_joints, tips(data.robot)
    for i, name in enumerate(names):
        columns = data.body_columns[:, :, i]
        if i in last:
            yield Hypothesis("payload", columns, partial(tip_text, name), alternatives=len(last))
        else:
            one = partial("the body of {} has other inertial parameters".format, name)
            yield Hypothesis("one body", columns, one, alternatives=len(names))
    text = "several bodies have other inertial parameters; joints and their places are the same"
    yield Hypothesis(SEVERAL_BODIES, data.body_columns.reshape(*data.tau.shape, -1), text)


def tips(robot: Robot) -> list[int]:
    """The last bodies of the branches."""
    return [i for i in range(robot.model.nb) if i not in robot.model.parent]


def tip_text(name: str, c: Array) -> str:
    """Parameters that a last body has more, as a payload."""
    what = f"{payload_text(c[0], c[1:4] / c[0])} m of the joint's frame" if c[0] else "has other inertial parameters"
    return f"the last body, of {name}, {what}"


def payload_text(mass: float, centre: Array) -> str:
    """A mass and where it is."""
    return f"{'carries' if mass > 0 else 'lacks'} a payload of {abs(mass):.4g} kg at {vector_text(centre)}"


# Hypotheses that are not linear


def minimum(residual: Callable[[Array], Array], starts: Sequence[Any], jacobian: Any = "3-point") -> Array:
    """The least squares, to rounding, that the likeliest of several starts lead to (Levenberg-Marquardt)."""
    from scipy.optimize import least_squares

    options: dict[str, Any] = {"method": "lm", "jac": jacobian, "max_nfev": thresholds.EVALUATIONS}
    precise = {"xtol": 1e-15, "ftol": 1e-15, "gtol": 1e-15}
    likely = sorted(map(np.array, starts), key=lambda x: float(np.linalg.norm(residual(x))))
    fits = [least_squares(residual, x, **options, **precise) for x in likely[: thresholds.STARTS]]
    best: Array = min(fits, key=lambda fit: fit.cost).x
    return best


def shifted_zeros(data: TorqueDifference) -> Iterator[Candidate]:
    """Another zero of each joint, from the best of a grid; of all joints; of those whose zero then differs."""
    few, n = data.few, data.robot.n
    grid = np.linspace(-np.pi, np.pi, thresholds.ZEROS, endpoint=False)[:, None, None]

    def fitted(start: Array, free: Array, alternatives: int) -> tuple[Array, Candidate]:
        places = np.eye(n)[free]

        def left(x: Array) -> Array:
            return few.weighted(few.tau - few.load(few.q + x @ places, few.qd, few.qdd))

        zero = minimum(left, [start[free]], lambda x: -few.weighted(zero_columns(few, x @ places)[..., free])) @ places
        rest = data.tau - data.load(data.q + zero, data.qd, data.qdd)
        text = zeros_text(data.names, zero)
        return zero, data.candidate(["joint zero"], [text], len(free), alternatives, rest)

    for e in np.eye(n):
        states = [np.broadcast_to(x, (len(grid), *x.shape)) for x in few.states[1:]]
        left = (few.tau - few.load(few.q + grid * e, *states)) / few.sigma
        yield fitted(grid[np.argmin((left**2).sum((1, 2))), 0] * e, np.flatnonzero(e), n)[1]
    zero, candidate = fitted(np.zeros(n), np.arange(n), 2**n)
    yield candidate
    clearly = np.flatnonzero(np.abs(zero) > 1e-3 * np.abs(zero).max(initial=0))
    if 0 < len(clearly) < n:
        yield fitted(zero, clearly, 2**n)[1]


def turned(I: Array, w: Array) -> Array:
    """Parameters of a body with inertia I that a rotation vector w of its axes adds."""
    from scipy.spatial.transform import Rotation

    R = Rotation.from_rotvec(w).as_matrix()
    return inertia_change(R @ I @ R.T - I)


def point_mass(x: Array) -> Array:
    """Parameters of a point of mass x[0] at x[1:]."""
    return np.concatenate([[x[0]], x[0] * x[1:], inertia_change(point_mass_inertia(x[0], x[1:]))[4:]])


def left_by_change(data: TorqueDifference, A: Array, change: Callable[[Array], Array], x: Array) -> Array:
    """Values that a change of one body's parameters leaves."""
    left: Array = data.left - A @ change(x)
    return left


def changes_of_one_body(data: TorqueDifference) -> Iterator[Candidate]:
    """Inertia of a body in other axes, and a point mass that the last body of a branch has or lacks."""
    from scipy.spatial.transform import Rotation

    model, last, axes = data.robot.model, tips(data.robot), Rotation.create_group("O").as_rotvec()
    for i, name in enumerate(model.moving_joints):
        columns, I = data.body_columns[:, :, i], model.inertia[i]
        A = data.weighted(columns)
        c, _, left, _ = data.with_columns(columns)
        changes: list[tuple[str, Callable[[Array], Array], Any, int]] = []
        if (data.by_joint(left) <= data.floor).all():  # otherwise no change of this body explains the difference
            if np.ptp(np.linalg.eigvalsh(I)) > thresholds.NONE * np.trace(I):
                changes.append(("inertia axes", partial(turned, I), axes, model.nb))
            if i in last:
                starts = [[c[0], *c[1:4] / (c[0] or 1.0)], [1.0, 0, 0, 0], [-1.0, 0, 0, 0]]
                changes.append(("payload", point_mass, starts, len(last)))
        for kind, change, starts, alternatives in changes:
            x = minimum(partial(left_by_change, data, A, change), starts)
            text = f"the inertia of the body of {name} is in other axes, turned by a rotation"
            if kind == "payload":
                text = f"it {payload_text(x[0], x[1:])} m of the frame of {name}"
            yield data.candidate([kind], [text], len(x), alternatives, data.difference - columns @ change(x))


# The search


def candidates(data: TorqueDifference, hypotheses: Sequence[Hypothesis]) -> list[Candidate]:
    """All hypotheses, the best first; two at a time only where none alone explains the difference."""
    linear = [replace(h, columns=columns_of(data, h)) for h in (*linear_hypotheses(data), *hypotheses)]
    linear.sort(key=lambda h: h.numbers != "switches")
    changes, left = without_free_numbers(data, [h for h in linear if h.numbers == "switches"])

    def nearest(number: int, known: Hypothesis | None = None) -> Iterator[Candidate]:
        rest = left
        if known is not None:
            A = data.few.weighted(np.asarray(known.columns)[data.chosen])
            Q = orthonormal(A)
            rest = left - (left @ Q) @ Q.T
        above_rounding = np.maximum((rest**2).mean(1), 1.0)
        for k in np.lexsort(([alternatives for alternatives, _ in changes], above_rounding))[:number]:
            yield changes[k][1]()

    found = [*map(data.fit, linear), *nearest(thresholds.FINALISTS), *shifted_zeros(data), *changes_of_one_body(data)]
    if not any(c and c.explains and c.causes != (SEVERAL_BODIES,) for c in found):
        alone = [h for h in linear if h.kind != SEVERAL_BODIES]
        for h in (h for h in alone if h.numbers != "switches"):
            found += [data.fit(h, before=c) for c in nearest(1, h) if c.causes != (h.kind,)]
        found += pairs(data, alone)
    return sorted(filter(None, found), key=lambda c: (not c.explains, c.score))


def without_free_numbers(
    data: TorqueDifference, switches: Sequence[Hypothesis]
) -> tuple[list[tuple[float, Callable[[], Candidate]]], Array]:
    """Hypotheses without free numbers, conventions and switches: alternatives, candidates, residuals at few states."""

    def judged(x: Convention) -> Candidate:
        return data.candidate(
            [x.kind], [x.text()], 0, x.alternatives, data.tau - torques_of(data.robot, [x], data.states)[0]
        )

    tried = list(conventions(data.robot))
    left = [*(data.few.tau - torques_of(data.robot, tried, data.few.states))]
    changes: list[tuple[float, Callable[[], Candidate]]] = [(x.alternatives, partial(judged, x)) for x in tried]
    for h in switches:
        width = np.asarray(h.columns).shape[-1]
        for mask in np.unique([np.ones(width), *np.eye(width)], axis=0):
            rest, alike = data.difference - h.columns @ mask, h.alternatives * comb(width, int(mask.sum()))
            changes.append((alike, partial(data.candidate, [h.kind], [text_of(h, mask)], 0, alike, rest)))
            left.append(rest[data.chosen])
    return changes, (np.array(left) / data.sigma).reshape(len(left), -1)


def pairs(data: TorqueDifference, linear: Sequence[Hypothesis]) -> Iterator[Candidate | None]:
    """Two hypotheses at a time, of which at least one has free numbers: those that explain a few states."""
    few_of = [replace(h, columns=np.asarray(h.columns)[data.chosen]) for h in linear]
    tried = []
    for i, j in combinations(range(len(linear)), 2):
        kinds = {linear[i].kind, linear[j].kind}
        if len(kinds) == 2 and not kinds <= OTHER_BODIES and linear[j].numbers != "switches":
            found = data.few.fit(few_of[i], few_of[j])
            if found:
                tried.append((not found.explains, found.score, i, j))
    for k, (fails, _, i, j) in enumerate(sorted(tried)):
        if not fails or k < thresholds.FINALISTS:
            yield data.fit(linear[i], linear[j])


# The states and the result


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
    return TorqueDifference(robot, (q, qd, qdd), tau, tolerance)


def given_torques(robot: Robot, other: Sequence[Any]) -> list[Array]:
    """The arrays q, qd, qdd and tau, checked: at least as many torques as standard parameters."""
    n, names = robot.n, ("q", "qd", "qdd", "tau")
    arrays = [np.asarray(joint_array(name, x, robot.model), np.float64) for name, x in zip(names, other, strict=True)]
    if arrays[0].ndim != 2 or len({x.shape for x in arrays}) > 1:
        raise ValueError(f"`other` must be four arrays of shape (N, {n}), got {[np.shape(x) for x in other]}")
    fewest = -(-StandardParameters(robot.model, MEASURED).count // max(n, 1))
    if len(arrays[0]) < fewest:
        raise ValueError(f"`other` must have at least {fewest} states for {n} joints, got {len(arrays[0])}")
    return arrays


def states_in_range(robot: Robot, seed: int) -> tuple[Array, Array, Array]:
    """States all over the ranges of the joints."""
    rng = np.random.default_rng(seed)
    reach = np.where(
        robot.model.is_revolute[list(robot.model.independent_joints)], thresholds.TURNING, thresholds.SLIDING
    )
    lower, upper = (np.clip(x, -reach, reach) for x in (robot.lower, robot.upper))
    q = rng.uniform(np.minimum(lower, upper), np.maximum(lower, upper), (thresholds.STATES, robot.n))
    scale = np.where(reach == thresholds.SLIDING, thresholds.SLIDING, 1.0)
    qd = thresholds.RATE * scale * rng.standard_normal(q.shape)
    qdd = thresholds.ACCELERATION * scale * rng.standard_normal(q.shape)
    return q, qd, qdd


@dataclass(frozen=True, eq=False)
class ModelComparison(InNotebooks):
    """The likely cause of a difference of torques, by `rne.compare_models`.

    Attributes
    ----------
    joint_names : tuple of str
    causes : tuple of str
        ("none",) if the torques agree, ("unknown",) if no hypothesis explains the difference; else one cause, or two
        that act together.
    text : str
        The cause in words, with its numbers: what the other model has.
    difference : ndarray, shape (n,)
        |tau - torques of the robot| / |tau| of each joint, tau being the other's.
    unexplained : ndarray, shape (n,)
        The same for what the cause leaves.
    accuracy : ndarray, shape (n,)
        Rounding that is allowed, as a part of |tau|.
    candidates : tuple of Candidate
        All hypotheses, the best first.
    equivalent : tuple of str
        Other causes that explain these torques as well, with as few free numbers.
    shares : tuple of float
        Of the difference, what each of `candidates` leaves.

    Examples
    --------
    >>> import rne
    >>> robot = rne.load("irb140")
    >>> upside_down = lambda q, qd, qdd: robot.inverse_dynamics(q, qd, qdd) - 2 * robot.gravity_torque(q)
    >>> rne.compare_models(robot, upside_down).causes
    ('gravity sign',)
    """

    joint_names: tuple[str, ...]
    causes: tuple[str, ...]
    text: str
    difference: Array
    unexplained: Array
    accuracy: Array
    candidates: tuple[Candidate, ...]
    equivalent: tuple[str, ...]
    shares: tuple[float, ...]

    @property
    def cause(self) -> str:
        """The cause; two that act together are joined by "and"."""
        return " and ".join(self.causes)

    def __repr__(self) -> str:
        return wrapped(f"ModelComparison(cause: {self.cause}; {self.text})")

    def report(self) -> str:
        """The cause, a table of the joints, and what else was tried.

        Returns
        -------
        str
            Lines of at most 100 characters.

        Examples
        --------
        >>> import rne
        >>> robot = rne.load("irb140")
        >>> print(rne.compare_models(robot, robot).report().splitlines()[0])
        cause: none
        """
        rows = [Row("|difference| / |torque| [%]", ("before", "explained so", "rounding"), words=True)]
        for name, *cells in zip(self.joint_names, self.difference, self.unexplained, self.accuracy, strict=True):
            rows.append(Row(f"  {short(name)}", [f"{100 * x:.3g}" for x in cells]))
        lines = [f"cause: {self.cause}", *wrapped(f"  {self.text}").splitlines(), *aligned(rows)]
        if self.equivalent:
            lines.append("cannot be told apart from: " + "; ".join(self.equivalent))
        if self.candidates:
            lines.append("hypotheses (share of the difference that is left [%]; free numbers)")
            for c, share in zip(self.candidates[:SHOWN], self.shares, strict=False):
                lines += wrapped(f"  {100 * share:.3g}; {c.numbers}: {' and '.join(c.causes)}: {c.text}").splitlines()
        return "\n".join(lines)


def compare_models(
    robot: Robot,
    other: Other,
    *,
    tolerance: float = thresholds.TOLERANCE,
    seed: int = 0,
    hypotheses: Sequence[Hypothesis] = (),
) -> ModelComparison:
    """Name the likely cause of a difference between a robot's torques and those of another model.

    Each hypothesis of a list is a change of the robot with few free numbers. Those that explain the difference, in
    every joint, to rounding are compared by their free numbers and the number of alternatives that they were chosen
    from: the one that needs fewest is named. Two hypotheses act together only where none alone explains it.

    Parameters
    ----------
    robot : Robot
        The model that is taken as right. Its joint friction is not part of its torques.
    other : Robot, callable, or tuple of arrays
        Another robot with the same number of joints; a function (q, qd, qdd) -> torques of another library, for arrays
        of shape (N, n); or its numbers (q, qd, qdd, tau), shape (N, n) each. Of measured motions, the report of
        `rne.identify` names likely causes.
    tolerance : float
        Differences below this part of the torques of a joint are rounding.
    seed : int
        Of the random states at which a robot or function is evaluated.
    hypotheses : sequence of Hypothesis
        Further causes that are tried.

    Returns
    -------
    ModelComparison
        The cause, in a word and with its numbers, and what else was tried.

    Raises
    ------
    TypeError
        If `robot` or `other` is none of these.
    ValueError
        If an array has the wrong shape or is not finite, or there are fewer torques than standard
        parameters of the robot.

    Notes
    -----
    Hypotheses: gravity of another sign, magnitude or direction, or a turned base; joints in another order, with flipped
    axes, or with another zero; degrees for radians; torques in another unit or of another sign; inertia about another
    point or in other axes, products of inertia of the other sign; rotors, viscous or Coulomb friction, offsets; a
    payload, other parameters of one body or of several. The measure is the Bayesian information criterion (Schwarz
    1978), with log of the number of alternatives added.

    Examples
    --------
    >>> import rne
    >>> robot = rne.load("irb140")
    >>> other = rne.Robot(rne.model.with_payload(robot.model, 3.0, com=(0, 0, 0.1)))
    >>> print(rne.compare_models(robot, other).text)
    it carries a payload of 3 kg at (0, 0, 0.165) m of the frame of joint_6
    """
    robot_argument(robot)
    positive_number("tolerance", tolerance)
    data = torque_difference(robot, other, tolerance, seed)
    names: tuple[str, ...] = ("none",)
    text, residual = "the torques agree", data.difference
    found = [] if data.explains(residual) else candidates(data, hypotheses_argument(hypotheses))
    if found and found[0].explains:
        names, text, residual = found[0].causes, found[0].text, found[0].residual
    elif found:
        names, text = ("unknown",), "no hypothesis explains the difference; the nearest are below"
    fitting = [c for c in found if c.explains and c.numbers <= found[0].numbers]
    others = [c for c in fitting if not any(a in b or b in a for a in c.causes for b in names)]  # friction: viscous too
    size = float(np.linalg.norm(data.left))
    return ModelComparison(
        data.names,
        names,
        text,
        data.relative(data.difference),
        data.relative(residual),
        data.relative(np.broadcast_to(data.sigma, data.tau.shape)),
        tuple(found),
        tuple(dict.fromkeys(" and ".join(c.causes) for c in others)),
        tuple(float(np.linalg.norm(data.weighted(c.residual))) / size for c in found),
    )
