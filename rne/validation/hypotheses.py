"""Causes of a difference between two models: those that torques are linear in, conventions of joints, single bodies.

A convention is q' = a (s q)[order] + b, with rates and accelerations scaled by a': the other model has the torques of
the robot at q', in its own order and with its signs, tau[order] = s tau'(q', a' qd', a' qdd').
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import combinations, permutations, product
from math import comb, factorial
from typing import Any, Literal, NamedTuple

import numpy as np

from ..basics.spatial import Array, point_mass_inertia
from ..basics.text import listed, six_digits
from ..dynamics.rnea import gravity_torque
from ..model.parameters import COLUMNS, PARAMETERS, ROWS, parameters_of
from ..robot import Robot
from .torque_difference import Candidate, TorqueDifference

NONE = 1e-9  # a coefficient that is rounding
SEVERAL_BODIES = "several bodies"  # explains whatever other bodies do
GRID = 72  # zeros of each joint that are tried
STEPS = 100  # of a fit that is not linear
STEP = 1e-5  # of central differences [rad or m]
MOST = 50_000  # alternatives of a convention that are tried
STARTS = 6  # of a change of a body, the likeliest
DEGREE = np.pi / 180
QUARTERS = (np.pi / 2, np.pi, -np.pi / 2)


class LinearCause(NamedTuple):
    """A cause that torques are linear in: a sum of columns, shape (N, n, k), with coefficients.

    Coefficients are fitted, all of them ("all") or as few as suffice ("few"), or they are 0 or 1 ("switches").
    """

    name: str
    columns: Array
    text: Callable[[Array], str]  # of the coefficients
    coefficients: Literal["all", "few", "switches"] = "all"
    alternatives: float = 1.0


def linear_causes(data: TorqueDifference) -> list[LinearCause]:
    """All of them, the plainest first."""
    return [*gravity(data), *gains(data), *drives(data), *inertias(data), *bodies(data)]


def switch(name: str, torques: Array, text: str, alternatives: float = 1.0) -> LinearCause:
    """One change, which is there or not."""
    return LinearCause(name, torques[..., None], partial(constant, text), "switches", alternatives)


def vector_text(x: Array) -> str:
    """Three numbers to four digits."""
    return "(" + ", ".join(f"{round(float(v), 9) + 0.0:.4g}" for v in x) + ")"


def gravity(data: TorqueDifference) -> Iterator[LinearCause]:
    """Sign, magnitude and direction."""
    g = data.robot.model.gravity
    columns = np.stack([gravity_torque(replace(data.robot.model, gravity=e, notes={}), data.q) for e in np.eye(3)], -1)
    own = columns @ g
    if g.any():
        yield switch("gravity sign", -2 * own, "gravity has the opposite sign")
        yield switch("gravity missing", -own, "it has no gravity")
        yield LinearCause(
            "gravity magnitude", own[..., None], lambda c: f"gravity is {1 + c[0]:.6g} times this robot's"
        )
    text = f"gravity is %s m/s^2 in the axes of the base, {vector_text(g)} m/s^2 in this robot"
    yield LinearCause("base turned", columns, lambda c: text % vector_text(g + c))


def gains(data: TorqueDifference) -> Iterator[LinearCause]:
    """Torques in another unit or of the opposite sign, of all joints and of single ones."""
    names, own = data.robot.joint_names, data.expected
    single = np.eye(data.robot.n) * own[..., None]

    def sign_text(c: Array) -> str:
        if c.all():
            return "torques of all joints have the opposite sign"
        return f"torques have the opposite sign in {listed([names[j] for j in np.flatnonzero(c)])}"

    def factor_text(c: Array) -> str:
        return "torques are " + listed([f"{1 + x:.6g} times in {names[j]}" for j, x in enumerate(c) if abs(x) > NONE])

    yield LinearCause("torque sign", -2 * single, sign_text, "switches")
    yield switch("torque unit", (1e3 - 1) * own, "torques are in N mm", 3)
    yield switch("torque unit", (1e-3 - 1) * own, "torques are in kN m", 3)
    yield LinearCause("torque unit", own[..., None], lambda c: f"torques are {1 + c[0]:.6g} times this robot's")
    yield LinearCause("torque factor", single, factor_text, "few")


def drives(data: TorqueDifference) -> Iterator[LinearCause]:
    """Rotors, friction and offsets."""
    places, names = data.standard.groups, data.robot.joint_names
    for name, what, symbols in (
        ("armature", "inertia of rotors (armature)", ["Ia"]),
        ("viscous friction", "viscous friction", ["Fv"]),
        ("Coulomb friction", "Coulomb friction", ["Fc"]),
        ("torque offset", "constant torque", ["tau0"]),
        ("friction", "viscous and Coulomb friction", ["Fv", "Fc"]),
    ):
        labels = [f"{joint} {symbol}" if len(symbols) > 1 else joint for symbol in symbols for joint in names]

        def text(c: Array, what: str = what, labels: list[str] = labels) -> str:
            parts = [f"{label} {six_digits(x)}" for label, x in zip(labels, c, strict=True) if abs(x) > NONE]
            return f"it has more {what}: {listed(parts)}"

        columns = np.concatenate([data.columns[..., places[symbol]] for symbol in symbols], axis=-1)
        yield LinearCause(name, columns, text, "few")


def body_columns(data: TorqueDifference, i: int) -> Array:
    """Torques per unit of each parameter of a body, shape (N, n, 10)."""
    return data.columns[..., PARAMETERS * i : PARAMETERS * (i + 1)]


def inertia_change(I: Array) -> Array:
    """Parameters of bodies that change by inertias alone, shape (..., 10)."""
    return np.concatenate([np.zeros((*I.shape[:-2], 4)), I[..., ROWS, COLUMNS]], axis=-1)


def inertias(data: TorqueDifference) -> Iterator[LinearCause]:
    """Inertias about another point, or with other products: a switch for each body."""
    model, names = data.robot.model, data.robot.model.moving_joints
    pi = parameters_of(model).reshape(-1, PARAMETERS)
    mass = pi[:, 0, None]
    steiner = inertia_change(point_mass_inertia(mass[..., None], pi[:, 1:4] / np.where(mass == 0, 1.0, mass)))
    off_diagonal = np.isin(np.arange(PARAMETERS), [5, 7, 8])
    products, about_joint = (pi - steiner) * off_diagonal, pi * off_diagonal
    for name, change, what in (
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

        columns = np.stack([body_columns(data, i) @ change[i] for i in range(model.nb)], axis=-1)
        yield LinearCause(name, columns, text, "switches", 6)


def bodies(data: TorqueDifference) -> Iterator[LinearCause]:
    """Other parameters of one body, or of all."""
    model, last = data.robot.model, tips(data.robot)
    for i, name in enumerate(model.moving_joints):
        if i in last:
            yield LinearCause("payload", body_columns(data, i), partial(tip_text, name), "all", len(last))
        else:
            text = f"the body of {name} has other inertial parameters"
            yield LinearCause("one body", body_columns(data, i), partial(constant, text), "all", model.nb)
    text = "several bodies have other inertial parameters; joints and their places are the same"
    yield LinearCause(SEVERAL_BODIES, data.columns[..., : PARAMETERS * model.nb], partial(constant, text))


def tips(robot: Robot) -> list[int]:
    """The last bodies of the branches."""
    return [i for i in range(robot.model.nb) if i not in robot.model.parent]


def constant(text: str, c: Array) -> str:
    """The text, whatever the coefficients."""
    return text


def tip_text(name: str, c: Array) -> str:
    """Parameters that a last body has more, as a payload."""
    if not c[0]:
        return f"the last body, of {name}, has other inertial parameters"
    return f"the last body, of {name}, {payload_text(c[0], c[1:4] / c[0])} m of the joint's frame"


def payload_text(mass: float, centre: Array) -> str:
    """A mass and where it is."""
    return f"{'carries' if mass > 0 else 'lacks'} a payload of {abs(mass):.4g} kg at {vector_text(centre)}"


@dataclass(frozen=True)
class Convention:
    """Order, signs, zeros and units of the joints, where they are not the robot's own."""

    robot: Robot
    alternatives: float  # among how many it was chosen
    order: Sequence[int] = ()
    sign: Sequence[float] = ()
    zero: Sequence[float] = ()  # [rad or m]
    unit: tuple[float, float] = (1.0, 1.0)  # of positions; of rates and accelerations

    def text(self) -> str:
        """What it says of the other model, in words."""
        names, (a, b) = self.robot.joint_names, self.unit
        if self.order:
            return f"its joints are in the order {listed([names[k] for k in self.order])}"
        if self.sign:
            flipped = [name for name, s in zip(names, self.sign, strict=True) if s < 0]
            return f"the axis of {listed(flipped)} points the other way"
        if self.zero:
            return zeros_text(names, self.zero)
        what = "positions" if b == 1 else "positions, rates and accelerations"
        return f"it takes {what} as {'degrees that are radians' if a < 1 else 'radians that are degrees'}"


def zeros_text(names: Sequence[str], zero: Sequence[float] | Array) -> str:
    """Where joints are zero, in words."""
    places = [f"{name} at {x:.6g}" for name, x in zip(names, zero, strict=True) if x]
    return f"zero positions differ: its zero is {listed(places)} [rad or m] of this robot"


def torques_of(conventions: Sequence[Convention], q: Array, qd: Array, qdd: Array) -> Array:
    """Torques of every convention, shape (A, N, n)."""
    robot = conventions[0].robot
    order = np.array([c.order or range(robot.n) for c in conventions])[:, None, :]
    sign = np.array([c.sign or np.ones(robot.n) for c in conventions])[:, None, :]
    zero = np.array([c.zero or np.zeros(robot.n) for c in conventions])[:, None, :]
    a, b = np.array([c.unit for c in conventions]).T[:, :, None, None]
    order = np.broadcast_to(order, (len(conventions), *q.shape))
    q, qd, qdd = (np.take_along_axis(sign * x, order, -1) for x in (q, qd, qdd))
    found = robot.inverse_dynamics(a * q + zero, b * qd, b * qdd)
    torques = np.empty_like(found)
    np.put_along_axis(torques, order, found, -1)
    signed: Array = torques * sign
    return signed


def conventions(robot: Robot) -> dict[str, list[Convention]]:
    """Lists of alternatives by cause."""
    n, model = robot.n, robot.model
    sliding = [j for j, i in enumerate(model.independent_joints) if model.joint_types[i] == "prismatic"]
    turned = ((zero, alike) for zero, alike in variants(n, 0.0, QUARTERS) if not any(zero[j] for j in sliding))
    return {
        "joint order": [Convention(robot, order=order, alternatives=alike) for order, alike in orders(n)],
        "axis flipped": [Convention(robot, sign=sign, alternatives=alike) for sign, alike in variants(n, 1.0, (-1.0,))],
        "joint zero": [Convention(robot, zero=zero, alternatives=alike) for zero, alike in turned],
        "angle unit": [Convention(robot, unit=(a, b), alternatives=4) for a in (DEGREE, 1 / DEGREE) for b in (1.0, a)],
    }


def orders(n: int) -> Iterator[tuple[tuple[int, ...], int]]:
    """Orders of the joints, of more than eight only exchanges of two; each with how many are like it."""
    swaps = (tuple({i: j, j: i}.get(k, k) for k in range(n)) for i, j in combinations(range(n), 2))
    for p in permutations(range(n)) if factorial(n) <= MOST else swaps:
        moved = sum(k != i for i, k in enumerate(p))
        if moved:
            yield p, comb(n, moved) * factorial(moved)


def variants(n: int, own: float, others: tuple[float, ...]) -> Iterator[tuple[tuple[float, ...], int]]:
    """Values of n joints of which some differ, the fewest first, unless too many; each with how many are like it."""
    total = 0
    for k in range(1, n + 1):
        alike = comb(n, k) * len(others) ** k
        total += alike
        if total > MOST:
            return
        for chosen, values in product(combinations(range(n), k), product(others, repeat=k)):
            changed = dict(zip(chosen, values, strict=True))
            yield tuple(changed.get(j, own) for j in range(n)), alike


def minimum(residual: Callable[[Array], Array], starts: Sequence[Any], jacobian: Any = "3-point") -> Array:
    """The least squares, to rounding, of those that several starts lead to (Levenberg-Marquardt)."""
    from scipy.optimize import least_squares

    options: dict[str, Any] = {"method": "lm", "jac": jacobian, "max_nfev": STEPS}
    precise = {"xtol": 1e-15, "ftol": 1e-15, "gtol": 1e-15}
    fits = [least_squares(residual, x, **options, **precise) for x in starts]
    best: Array = min(fits, key=lambda fit: fit.cost).x
    return best


def shifted_zeros(data: TorqueDifference) -> Iterator[Candidate]:
    """Another zero of each joint, from the best of a grid; of all joints; of those whose zero then differs."""
    n = data.robot.n
    for e in np.eye(n):
        zeros = np.linspace(-np.pi, np.pi, GRID, endpoint=False)[:, None] * e
        start = zeros[np.argmin((left_by_zeros(data, zeros) ** 2).sum(1))]
        yield with_zeros(data, start, np.flatnonzero(e), n)[1]
    zero, candidate = with_zeros(data, np.zeros(n), np.arange(n), 2**n)
    yield candidate
    clearly = np.flatnonzero(np.abs(zero) > 1e-3 * np.abs(zero).max(initial=0))
    if 0 < len(clearly) < n:
        yield with_zeros(data, zero, clearly, 2**n)[1]


def left_by_zeros(data: TorqueDifference, zeros: Array) -> Array:
    """What other zeros, shape (A, n), leave of the torques of a few states, in units of the rounding, (A, S n)."""
    tried, few = [Convention(data.robot, 1, zero=tuple(zero)) for zero in zeros], data.few
    left: Array = (data.tau[few] - torques_of(tried, data.q[few], data.qd[few], data.qdd[few])) / data.rounding
    return left.reshape(len(zeros), -1)


def with_zeros(data: TorqueDifference, start: Array, free: Array, alternatives: int) -> tuple[Array, Candidate]:
    """Zeros of the joints `free` that fit best, of the others 0, and the hypothesis that they make."""
    places = np.eye(data.robot.n)[free]

    def jacobian(x: Array) -> Array:
        ahead, behind = np.split(left_by_zeros(data, x @ places + STEP * np.concatenate([places, -places])), 2)
        derivative: Array = (ahead - behind).T / (2 * STEP)
        return derivative

    x = minimum(lambda x: left_by_zeros(data, (x @ places)[None])[0], [start[free]], jacobian)
    zero = x @ places
    left = data.tau - data.robot.inverse_dynamics(data.q + zero, data.qd, data.qdd)
    text = zeros_text(data.robot.joint_names, zero)
    return zero, data.candidate("joint zero", text, len(free), alternatives, left)


def turned(I: Array, w: Array) -> Array:
    """Parameters of a body with inertia I that a rotation vector w of its axes adds."""
    from scipy.spatial.transform import Rotation

    R = Rotation.from_rotvec(w).as_matrix()
    return inertia_change(R @ I @ R.T - I)


def point_mass(x: Array) -> Array:
    """Parameters of a point of mass x[0] at x[1:]."""
    return np.concatenate([[x[0]], x[0] * x[1:], inertia_change(point_mass_inertia(x[0], x[1:]))[4:]])


def changes_of_one_body(data: TorqueDifference) -> Iterator[Candidate]:
    """Its inertia in other axes, and a point mass on the last body of each branch or one that is missing there."""
    from scipy.spatial.transform import Rotation

    for i, name in enumerate(data.robot.model.moving_joints):
        columns, I = body_columns(data, i), data.robot.model.inertia[i]
        fitted = data.fit(columns, data.difference)[0]
        if not data.explains(data.difference - columns @ fitted):
            continue  # then no change of this body explains the difference
        if np.ptp(np.linalg.eigvalsh(I)) > 1e-9 * np.trace(I):
            _, left = fitted_change(data, columns, partial(turned, I), Rotation.create_group("O").as_rotvec())
            text = f"the inertia of the body of {name} is in other axes, turned by a rotation"
            yield data.candidate("inertia axes", text, 3, data.robot.model.nb, left)
        if i in (last := tips(data.robot)):
            starts = [[fitted[0], *fitted[1:4] / (fitted[0] or 1.0)], [1.0, 0, 0, 0], [-1.0, 0, 0, 0]]
            x, left = fitted_change(data, columns, point_mass, starts)
            yield data.candidate(
                "payload", f"it {payload_text(x[0], x[1:])} m of the frame of {name}", 4, len(last), left
            )


def fitted_change(
    data: TorqueDifference, columns: Array, change: Callable[[Array], Array], starts: Any
) -> tuple[Array, Array]:
    """The x of the change(x) of a body's parameters that explains most, and what it leaves."""
    A, b = data.weighted(columns), data.weighted(data.difference)
    likely = sorted(starts, key=lambda x: np.linalg.norm(A @ change(np.array(x)) - b))[:STARTS]
    x = minimum(lambda x: A @ change(x) - b, likely)
    return x, data.difference - columns @ change(x)
