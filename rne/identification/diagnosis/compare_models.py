"""Likely cause of a difference between two models, by hypotheses as for the residuals of an identification.

The residuals are torques of the other model minus the robot's, at states without noise. Hypotheses have columns and few
free numbers or none. One that is not linear in its numbers has the column of the change that fits best.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from math import comb
from typing import Any

import numpy as np

from ...basics.arrays import positive_number, real_array
from ...basics.inertia import COLUMNS, PARAMETERS, ROWS
from ...basics.spatial import Array, point_mass_inertia
from ...basics.text import InNotebooks, column, listed, six_digits, table, wrapped
from ...errors import NotFiniteError
from ...model.model import Model
from ...model.standard_parameters import StandardParameters
from ...robot import Robot, robot_argument
from .. import thresholds
from ..fit.equations import MEASURED
from .conventions import conventions, torques_of, turning, zeros_text
from .hypotheses import (
    OF_JOINTS,
    SIZE,
    Cause,
    Hypothesis,
    columns_of,
    factors,
    gravity_columns,
    hypotheses_argument,
    judged,
    of_joints,
    one_by_one,
    text_of,
    zero_columns,
)
from .residuals import Discrepancy, Torques, orthonormal

SEVERAL_BODIES = "several bodies"  # kind that explains any difference of bodies
OTHER_BODIES = {"one body", "payload"}  # kinds of which two together are several bodies
OF_FEW_JOINTS = {  # kind: noun, and the kinds of single joints with their symbols
    "armature": ("inertia of rotors (armature)", {"rotor": ""}),
    "viscous friction": ("viscous friction", {"viscous friction": ""}),
    "Coulomb friction": ("Coulomb friction", {"Coulomb friction": ""}),
    "friction": ("viscous and Coulomb friction", {"viscous friction": " Fv", "Coulomb friction": " Fc"}),
    "torque offset": ("constant torque", {"offset": ""}),
    "spring": ("torque of springs", {"spring": ""}),
    "friction by direction": ("viscous friction in one direction", {"friction by direction": ""}),
}
PLACES = ("axis", "translation", "rotation")  # fields in which joints of one name may differ, in addition to their type
SHOWN = 5  # number of candidates in a report

Other = Robot | Callable[[Array, Array, Array], Any] | Sequence[Any]
Explanation = tuple[tuple[Cause, ...], Array]  # causes that act together; residual, shape (R,)


class TorqueDifference(Discrepancy):
    """Difference of torques between another model and the robot at some states, in units of the allowed rounding.

    The robot's torques are without joint friction. Columns that are `known`, shape (R, k), are fitted with any others.
    """

    resolution = thresholds.ROUNDED_PART, thresholds.ROUNDED_PART

    def __init__(
        self, robot: Robot, states: Sequence[Array], tau: Array, rounding: Array, known: Array | None = None
    ) -> None:
        super().__init__(robot, rounding, np.ones(tau.shape, bool))
        self.states, self.tau, self.expected = states, tau, robot.inverse_dynamics(*states)
        self.bodies, left = robot.parameters, self.weighted(tau - self.expected)
        self.Q = np.zeros((tau.size, 0)) if known is None else orthonormal(known)
        self.left = left - self.Q @ (self.Q.T @ left)
        self.floor = self.counts = np.full(robot.n, float(len(tau)))

    def sampled(self, torques: Torques) -> Array:
        """Values of a function of the motion at the states."""
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
        """Few of the states, enough to select among many hypotheses, with the same rounding."""
        states = [x[self.chosen] for x in self.states]
        return TorqueDifference(self.robot, states, self.tau[self.chosen], self.sigma)

    def given(self, known: Array | None, torques: Array | float = 0.0) -> TorqueDifference:
        """Difference minus some torques, with known columns, shape (R, k)."""
        return TorqueDifference(self.robot, self.states, self.tau - torques, self.sigma, known)

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

    def explains(self, left: Array) -> bool:
        """True if the root mean square of every joint's residual is within rounding."""
        return bool((self.by_joint(left) <= self.floor).all())

    def sizes(self, X: Array) -> Array:
        """Root mean square of columns in units of the rounding, shape (k,)."""
        return np.asarray(np.linalg.norm(X, axis=0) / np.sqrt(len(self.tau)))

    def with_numbers(self, X: Array, numbers: str) -> tuple[Array, Array, Array, int]:
        """Fit of all numbers, only nonzero ones, or 0 or 1 each; results as of `with_columns`."""
        if numbers == "switches":
            left, one = X - self.Q @ (self.Q.T @ X), np.ones(X.shape[1])
            return one, 0 * one, self.left - left @ one, 0
        c, error, left, rank = self.with_columns(X)
        if numbers == "few":
            needed = np.abs(c) * self.sizes(X) > 1
            c, error = np.zeros(len(c)), np.full(len(c), np.inf)
            c[needed], error[needed], left, rank = self.with_columns(X[:, needed])
        return c, error, left, rank


# Hypotheses with free numbers that are linear, and switches


def hypotheses_of_models(data: TorqueDifference) -> Iterator[Hypothesis]:
    """Hypotheses with linear columns, the simplest first."""
    yield from other_gravity(data)
    yield from other_torques(data)
    singles = {h.kind: h for h in of_joints(data, OF_JOINTS)}
    for kind, (noun, symbols) in OF_FEW_JOINTS.items():
        columns = np.concatenate([columns_of(data, singles[single]) for single in symbols], axis=-1)
        labels = [name + symbol for symbol in symbols.values() for name in data.names]

        def text(c: Array, noun: str = noun, labels: list[str] = labels) -> str:
            parts = [f"{label} {six_digits(x)}" for label, x in zip(labels, c, strict=True) if x]
            return f"it has more {noun}: {listed(parts)}"

        yield Hypothesis(kind, columns, text, numbers="few")
    yield from other_inertias(data)
    yield from other_bodies(data)


def switch(kind: str, torques: Array, text: str, alternatives: float = 1.0) -> Hypothesis:
    """Hypothesis of a change that is present or absent."""
    return Hypothesis(kind, torques[..., None], lambda c: text, alternatives=alternatives, numbers="switches")


def vector_text(x: Array) -> str:
    """Text of three numbers with four digits."""
    return "(" + ", ".join(f"{round(float(v), 9) + 0.0:.4g}" for v in x) + ")"


def other_gravity(data: TorqueDifference) -> Iterator[Hypothesis]:
    """Hypotheses on sign, magnitude and direction of gravity."""
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
    """Hypotheses on the unit of torques, of all joints and of single ones."""

    def factor_text(c: Array) -> str:
        return "torques are " + listed([f"{1 + x:.6g} times in {data.names[j]}" for j, x in enumerate(c) if x])

    yield switch("torque unit", (1e3 - 1) * data.expected, "torques are in N mm", 3)
    yield switch("torque unit", (1e-3 - 1) * data.expected, "torques are in kN m", 3)
    yield Hypothesis(
        "torque unit", data.expected[..., None], lambda c: f"torques are {1 + c[0]:.6g} times this robot's"
    )
    yield replace(factors(data, data.expected), text=factor_text, numbers="few")


def inertia_change(I: Array) -> Array:
    """Parameters of bodies changed only by their inertias, shape (..., 10)."""
    return np.concatenate([np.zeros((*I.shape[:-2], 4)), I[..., ROWS, COLUMNS]], axis=-1)


def other_inertias(data: TorqueDifference) -> Iterator[Hypothesis]:
    """Hypotheses on inertias about another point, or with other products: a switch for each body."""
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
    """Hypotheses on other parameters of one body, or of all."""
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
    """Last bodies of the branches."""
    return [i for i in range(robot.model.nb) if i not in robot.model.parent]


def tip_text(name: str, c: Array) -> str:
    """Text of additional parameters of a last body, as a payload."""
    what = f"{payload_text(c[0], c[1:4] / c[0])} m of the joint's frame" if c[0] else "has other inertial parameters"
    return f"the last body, of {name}, {what}"


def payload_text(mass: float, centre: Array) -> str:
    """Text of a mass and its position."""
    return f"{'carries' if mass > 0 else 'lacks'} a payload of {abs(mass):.4g} kg at {vector_text(centre)}"


# Changes without free numbers


class Changes:
    """Conventions, and switches of all, one or several bodies, with their torques at few states, shape (A, R)."""

    def __init__(self, data: TorqueDifference, switches: Sequence[Hypothesis]) -> None:
        self.data, self.conventions, few = data, list(conventions(data.robot)), data.few
        self.switches = [single for h in switches for single in single_switches(data, h)]
        torques = [*(torques_of(data.robot, self.conventions, few.states) - few.expected)]
        torques += [columns_of(data, h)[data.chosen, :, 0] for h in self.switches]
        self.values = (np.array(torques) / data.sigma).reshape(len(torques), -1)
        changes: list[Any] = [*self.conventions, *self.switches]
        self.alternatives = [change.alternatives for change in changes]

    def scores(self, few: TorqueDifference) -> Array:
        """Scores of the changes, in the sense of `judged`."""
        left = few.left - self.values + self.values @ few.Q @ few.Q.T
        squares = (left**2).reshape(len(left), -1, few.robot.n).sum(1)
        gains = 0.5 * few.counts * np.log((few.squares + few.floor) / (squares + few.floor))
        return np.asarray(gains.sum(1) - np.log(self.alternatives))

    def nearest(self, few: TorqueDifference, number: int) -> list[Hypothesis]:
        """Best changes at few states, evaluated at all states."""
        return [self.hypothesis(k) for k in np.argsort(-self.scores(few), kind="stable")[:number].tolist()]

    def hypothesis(self, k: int) -> Hypothesis:
        """Hypothesis of a change, evaluated at all states."""
        data = self.data
        if k < len(self.conventions):
            x = self.conventions[k]
            torques = torques_of(data.robot, [x], data.states)[0] - data.expected
            return switch(x.kind, torques, x.text(), x.alternatives)
        return self.switches[k - len(self.conventions)]


def single_switches(data: TorqueDifference, h: Hypothesis) -> Iterator[Hypothesis]:
    """Changes by all switches of a hypothesis, by each, and by those that a fit finds to be on."""
    columns = columns_of(data, h)
    k, near = columns.shape[-1], data.with_columns(columns)[0] - 1
    masks = [np.ones(k), *np.eye(k), (np.abs(near) < thresholds.NEAR).astype(float)]
    for on in np.unique([on for on in masks if on.any()], axis=0):
        yield switch(h.kind, columns @ on, text_of(h, on), float(h.alternatives) * comb(k, int(on.sum())))


# Changes that are not linear in their numbers


def minimum(residual: Callable[[Array], Array], starts: Sequence[Any]) -> Array:
    """Least squares minimum, to rounding, from the likeliest of several starts (Levenberg-Marquardt)."""
    from scipy.optimize import least_squares

    options: dict[str, Any] = dict.fromkeys(("xtol", "ftol", "gtol"), thresholds.LAST_STEP)
    options |= {"method": "lm", "jac": "3-point", "max_nfev": thresholds.EVALUATIONS}
    likely = sorted(map(np.array, starts), key=lambda x: float(np.linalg.norm(residual(x))))
    fits = [least_squares(residual, x, **options) for x in likely[: thresholds.STARTS]]
    best: Array = min(fits, key=lambda fit: fit.cost).x
    return best


def moved_load(data: TorqueDifference, q: Array, qd: Array, qdd: Array) -> Array:
    """Torques at other positions; far from all others where following joints have no position."""
    try:
        return data.load(q, qd, qdd)
    except NotFiniteError:
        return np.full(q.shape, thresholds.NOWHERE * np.abs(data.tau).max(initial=1))


def shifted_zeros(data: TorqueDifference, changes: Changes) -> Iterator[tuple[Hypothesis, int]]:
    """Zero offsets of each joint, of all joints, and of those found to differ, starting at the nearest convention."""
    few, n = data.few, data.robot.n
    felt = np.flatnonzero(few.sizes(few.weighted(zero_columns(few))) > 1)
    scores = [0.0, *changes.scores(few)[: len(changes.conventions)]]
    given = (x.zero if x.kind == "joint zero" else np.full(n, np.nan) for x in changes.conventions)
    zeros = np.array([np.zeros(n), *given])

    def fitted(free: Array, alternatives: int) -> tuple[Array, tuple[Hypothesis, int]]:
        allowed = (zeros[:, np.setdiff1d(np.arange(n), free)] == 0).all(1) & np.isfinite(zeros).all(1)
        start = zeros[np.argmax(np.where(allowed, scores, -np.inf))]
        places, (q, qd, qdd) = np.eye(n)[free], few.states

        def left(x: Array) -> Array:
            return few.weighted(few.tau - moved_load(few, q + x @ places, qd, qdd))

        zero = minimum(left, [start[free]]) @ places
        torques = moved_load(data, data.states[0] + zero, *data.states[1:]) - data.expected
        return zero, (switch("joint zero", torques, zeros_text(data.names, zero), alternatives), len(free))

    for j in felt:
        yield fitted(np.array([j]), n)[1]
    if len(felt) > 1:
        zero, change = fitted(felt, 2**n)
        yield change
        clearly = np.flatnonzero(np.abs(zero) > thresholds.CLEARLY * np.abs(zero).max(initial=0))
        if 1 < len(clearly) < len(felt):
            yield fitted(clearly, 2**n)[1]


def turned(I: Array, w: Array) -> Array:
    """Change of a body's parameters when its inertia I is turned by a rotation vector w."""
    from scipy.spatial.transform import Rotation

    R = Rotation.from_rotvec(w).as_matrix()
    return inertia_change(R @ I @ R.T - I)


def point_mass(x: Array) -> Array:
    """Parameters of a point mass x[0] at x[1:]."""
    return np.concatenate([[x[0]], x[0] * x[1:], inertia_change(point_mass_inertia(x[0], x[1:]))[4:]])


def changes_of_body(data: TorqueDifference, i: int) -> Iterator[tuple[Hypothesis, int]]:
    """Hypotheses on one body: inertia in other axes, and a point mass added to or missing at the end of a branch."""
    from scipy.spatial.transform import Rotation

    model, columns, last = data.robot.model, data.body_columns[:, :, i], tips(data.robot)
    name, I, A = model.moving_joints[i], model.inertia[i], data.weighted(columns)
    c, _, left, _ = data.with_columns(columns)
    if not data.explains(left):  # no change of this body explains the difference
        return
    if np.ptp(np.linalg.eigvalsh(I)) > thresholds.NONE * np.trace(I):
        x = minimum(lambda w: data.left - A @ turned(I, w), Rotation.create_group("O").as_rotvec())
        text = f"the inertia of the body of {name} is in other axes, turned by a rotation"
        yield switch("inertia axes", columns @ turned(I, x), text, model.nb), len(x)
    if i in last:
        starts = [[c[0], *c[1:4] / (c[0] or 1.0)], [1.0, 0, 0, 0], [-1.0, 0, 0, 0]]
        x = minimum(lambda x: data.left - A @ point_mass(x), starts)
        text = f"it {payload_text(x[0], x[1:])} m of the frame of {name}"
        yield switch("payload", columns @ point_mass(x), text, len(last)), len(x)


# The search


def explanations(data: TorqueDifference, given: Sequence[Hypothesis]) -> list[Explanation]:
    """Explanations, the best first; of two causes together only if no single one explains the difference."""
    linear = [*one_by_one(data, (*hypotheses_of_models(data), *given))]
    changes = Changes(data, [h for h in linear if h.numbers == "switches"])
    linear = [h for h in linear if h.numbers != "switches"]
    found = [x for h in linear for x in explanation(data, h)]
    found += [x for h in changes.nearest(data.few, thresholds.FINALISTS) for x in explanation(data, h)]
    of_bodies = (change for i in range(data.robot.model.nb) for change in changes_of_body(data, i))
    for h, numbers in (*shifted_zeros(data, changes), *of_bodies):
        found += explanation(data, h, numbers)
    if not any(data.explains(left) and causes[0].kind != SEVERAL_BODIES for causes, left in found):
        found += two_together(data, [h for h in linear if h.kind != SEVERAL_BODIES], changes)
    return sorted(found, key=lambda x: (not data.explains(x[1]), -sum(cause.score for cause in x[0])))


def explanation(data: TorqueDifference, h: Hypothesis, numbers: int = 0) -> Iterator[Explanation]:
    """Explanation by a hypothesis if it has a share in the difference, given the count of numbers fitted before."""
    for cause, columns, c in judged(data, h, by_rank=True):
        spent = cause.numbers + numbers
        if spent or h.numbers == "switches":
            score = cause.score - data.penalty(numbers)
            yield (cause._replace(score=score, numbers=spent),), data.left - data.weighted(columns @ c)


def two_together(data: TorqueDifference, linear: Sequence[Hypothesis], changes: Changes) -> Iterator[Explanation]:
    """Explanations by two causes: each hypothesis with the best change without numbers, then with the best other."""
    few = [
        replace(h, columns=columns_of(data, h)[data.chosen], masks=None if h.masks is None else h.masks[:, data.chosen])
        for h in linear
    ]
    for i, h in enumerate(linear):
        beyond = data.few.given(data.few.weighted(columns_of(data.few, few[i])))
        later = [
            k for k in range(i + 1, len(few)) if h.kind != few[k].kind and not {h.kind, few[k].kind} <= OTHER_BODIES
        ]
        scores = [next(judged(beyond, few[k], by_rank=True))[0].score for k in later]
        others = [x for x in changes.nearest(beyond, 1) if x.kind != h.kind]
        others += [linear[later[int(np.argmax(scores))]]] if scores else []
        known = data.given(data.weighted(columns_of(data, h)))
        for second, columns, c in (x for other in others for x in judged(known, other, by_rank=True)):
            rest = data.given(None, columns @ c)
            for (first,), left in explanation(rest, h) if c.any() else ():
                gain = data.gain(known.squares) - rest.gain(rest.by_joint(left))  # of the first before the second
                causes = first._replace(score=first.score + gain), second
                yield causes if second.numbers else causes[::-1], left


# The states and the result


def torque_difference(robot: Robot, other: Other, tolerance: float, seed: int) -> TorqueDifference:
    """Torques of another robot or function at random or given states, and their difference from the robot's."""
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
    size = np.sqrt((tau**2).mean(0)) + np.sqrt((robot.inverse_dynamics(q, qd, qdd) ** 2).mean(0))
    rounding = tolerance * np.maximum(size, max(thresholds.SMALLEST * size.max(initial=0), thresholds.TINY))
    return TorqueDifference(robot, (q, qd, qdd), tau, rounding)


def given_torques(robot: Robot, other: Sequence[Any]) -> list[Array]:
    """Arrays q, qd, qdd and tau, checked: at least as many torques as standard parameters."""
    n, names = robot.n, ("q", "qd", "qdd", "tau")
    arrays = [
        real_array(f"other: {name}", x, f"(N, {n})").astype(np.float64) for name, x in zip(names, other, strict=True)
    ]
    if {x.shape for x in arrays} != {(len(np.atleast_1d(arrays[0])), n)}:
        raise ValueError(f"`other` must be four arrays of shape (N, {n}), got {[np.shape(x) for x in other]}")
    fewest = -(-StandardParameters(robot.model, MEASURED).count // max(n, 1))
    if len(arrays[0]) < fewest:
        raise ValueError(f"`other` must have at least {fewest} states for {n} joints, got {len(arrays[0])}")
    return arrays


def states_in_range(robot: Robot, seed: int) -> tuple[Array, Array, Array]:
    """Random states within the ranges of the joints."""
    rng = np.random.default_rng(seed)
    reach = np.where(turning(robot), thresholds.TURNING, thresholds.SLIDING)
    lower, upper = (np.clip(x, -reach, reach) for x in (robot.lower, robot.upper))
    q = rng.uniform(np.minimum(lower, upper), np.maximum(lower, upper), (thresholds.STATES, robot.n))
    scale = np.where(reach == thresholds.SLIDING, thresholds.SLIDING, 1.0)
    qd = thresholds.RATE * scale * rng.standard_normal(q.shape)
    qdd = thresholds.ACCELERATION * scale * rng.standard_normal(q.shape)
    return q, qd, qdd


def common_joints(one: Model, other: Model) -> dict[str, tuple[bool, bool]]:
    """Joints that both models have: True if their types are the same, and if their axes and places are."""
    found = {}
    for i, name in enumerate(one.moving_joints):
        if name in other.moving_joints:
            k = other.moving_joints.index(name)
            placed = all(np.allclose(getattr(one, what)[i], getattr(other, what)[k]) for what in PLACES)
            found[name] = one.joint_types[i] == other.joint_types[k], placed
    return found


def different_robots(one: Model, other: Model) -> str:
    """Sentence on the joints that agree, if they are fewer than half of the smaller robot's joints; otherwise empty."""
    same = sum(map(all, common_joints(one, other).values()))
    n = min(len(one.moving_joints), len(other.moving_joints))  # an arm is the same with a hand of many joints
    return f"different robots: {same} of {n} joints have the same name, axis and place" if 2 * same < n else ""


def numbers_of(causes: Sequence[Cause]) -> int:
    """Number of free numbers of causes that act together."""
    return sum(cause.numbers for cause in causes)


def together(causes: Sequence[Cause]) -> str:
    """Kinds of causes that act together, joined by "and"."""
    return " and ".join(cause.kind for cause in causes)


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
        The same for the difference that the cause does not explain.
    accuracy : ndarray, shape (n,)
        Allowed rounding as a part of |tau|.
    candidates : tuple of tuple of Cause
        All hypotheses, the best first: one cause, or two that act together.
    equivalent : tuple of str
        Other causes that explain these torques as well, with as few free numbers.
    shares : tuple of float
        Share of the difference that each of `candidates` does not explain.
    different : str
        A sentence, if no cause is known and fewer than half of the joints are the same in both robots; otherwise empty.

    Examples
    --------
    >>> import rne
    >>> robot = rne.load("irb140")
    >>> upside_down = lambda q, qd, qdd: robot.inverse_dynamics(q, qd, qdd) - 2 * robot.gravity_torque(q)
    >>> print(rne.compare_models(robot, upside_down).report().splitlines()[0])
    cause: gravity sign
    """

    joint_names: tuple[str, ...]
    causes: tuple[str, ...]
    text: str
    difference: Array
    unexplained: Array
    accuracy: Array
    candidates: tuple[tuple[Cause, ...], ...]
    equivalent: tuple[str, ...]
    shares: tuple[float, ...]
    different: str = ""

    @property
    def cause(self) -> str:
        """Kind of the cause; two that act together are joined by "and"."""
        return " and ".join(self.causes)

    def __repr__(self) -> str:
        return wrapped(f"ModelComparison(cause: {self.cause}; {self.text})")

    def report(self) -> str:
        """Text with the cause, a table of the joints, and other candidates; says first if the robots are different.

        Returns
        -------
        str
            Lines of at most 100 characters.
        """
        shares = (column(100 * x, ".3g") for x in (self.difference, self.unexplained, self.accuracy))
        titles = "total", "unexplained", "rounding"
        rows = table("|difference| / |torque| [%]", titles, self.joint_names, *shares, indent="  ")
        lines = [*[self.different] * bool(self.different), f"cause: {self.cause}"]
        lines += [*wrapped(f"  {self.text}").splitlines(), *rows]
        if self.equivalent:
            lines.append("indistinguishable from: " + "; ".join(self.equivalent))
        if self.candidates and not self.different:
            lines.append("hypotheses (unexplained share of the difference [%]; free numbers)")
            for causes, share in zip(self.candidates[:SHOWN], self.shares, strict=False):
                what = f"{numbers_of(causes)}: {together(causes)}: {'; '.join(cause.text for cause in causes)}"
                lines += wrapped(f"  {100 * share:.3g}; {what}").splitlines()
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
    from: the one that needs fewest is named. Two hypotheses act together only if no single one explains it.

    Parameters
    ----------
    robot : Robot
        The reference. Its joint friction is not part of its torques.
    other : Robot, callable, or tuple of arrays
        Another robot with the same number of joints; a function (q, qd, qdd) -> torques of another library, for arrays
        of shape (N, n); or its numbers (q, qd, qdd, tau), shape (N, n) each. Of measured motions, the report of
        `rne.identify` names likely causes.
    tolerance : float
        Differences below this part of the torques of a joint are rounding.
    seed : int
        Seed of the random states at which a robot or function is evaluated.
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
    None of the hypotheses moves a joint. They are gravity of another sign, magnitude or direction, or a turned base;
    joints in another order, with flipped axes, or with another zero; degrees for radians; torques in another unit or of
    another sign; inertia about another point or in other axes, products of inertia of the other sign; rotors, viscous
    or Coulomb friction, offsets; a payload, other parameters of one body or of several. The measure is the Bayesian
    information criterion (Schwarz 1978), with log of the number of alternatives added.

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
    text, residual, different = "the torques agree", data.left, ""
    found = [] if data.explains(residual) else explanations(data, hypotheses_argument(hypotheses))
    explaining = [causes for causes, left in found if data.explains(left)]
    if explaining:
        (causes, residual), *_ = found
        names, text = tuple(cause.kind for cause in causes), "; ".join(cause.text for cause in causes)
    elif found:
        different = different_robots(robot.model, other.model) if isinstance(other, Robot) else ""
        common = common_joints(robot.model, other.model) if isinstance(other, Robot) and not different else {}
        moved = [name for name, (_, is_placed_alike) in common.items() if not is_placed_alike]
        places = f"; {listed(moved)} {'have' if moved[1:] else 'has'} another axis or place" * bool(moved)
        nearest = "" if different else "; the nearest are below"
        names, text = ("unknown",), f"no hypothesis explains the difference{places}{nearest}"
    fitting = [causes for causes in explaining if numbers_of(causes) <= numbers_of(explaining[0])]
    # friction is viscous friction too
    are_named = ([a.kind in b or b in a.kind for a in causes for b in names] for causes in fitting)
    others = [causes for causes, named in zip(fitting, are_named, strict=True) if not any(named)]
    errors = data.tau - data.expected, residual.reshape(data.tau.shape) * data.sigma, data.sigma + 0 * data.tau
    candidates, equivalent = tuple(causes for causes, _ in found), tuple(dict.fromkeys(map(together, others)))
    shares = tuple(float(np.linalg.norm(left) / np.linalg.norm(data.left)) for _, left in found)
    difference, unexplained, accuracy = map(data.relative, errors)
    details = difference, unexplained, accuracy, candidates, equivalent, shares, different
    return ModelComparison(data.names, names, text, *details)
