"""Conventions of joints and torques that a log or another model may use: order, signs, zeros and units.

The joints of the robot are at q' = a (s q)[order] + b, with rates and accelerations scaled by a', and have the torques
tau' = (t tau)[torque_order]. `rne.compare_models` tries all of them on torques of another model; the search for causes
of an identification's residuals tries changes of single joints and of pairs on a log.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from functools import partial
from itertools import combinations, permutations, product
from math import comb, factorial
from typing import Any, NamedTuple

import numpy as np

from ...basics.spatial import Array
from ...basics.text import listed
from ...errors import NotFiniteError
from ...robot import Robot
from .. import thresholds

DEGREE = np.pi / 180
MISTAKEN = {DEGREE: "in radians as degrees", 1 / DEGREE: "in degrees as radians"}
QUARTERS = (np.pi / 2, np.pi, -np.pi / 2)
KINDS = ("joint order", "torque order", "axis flipped", "torque sign", "joint zero", "angle unit")


class Convention(NamedTuple):
    """Order, signs, zeros and units of joints and torques that differ from the robot's."""

    kind: str
    alternatives: float  # number of conventions it was chosen from
    text: Callable[[], str]
    order: Sequence[int]
    sign: Sequence[float]
    zero: Sequence[float]  # [rad or m]
    unit: tuple[float, float]  # of angles; of their rates and accelerations
    torque_order: Sequence[int]
    torque_sign: Sequence[float]

    def matrices(self, turns: Array) -> tuple[Array, Array]:
        """Matrices J and T of q' = J q and tau' = T tau, for the robot's own zeros, shape (n, n) each."""
        J = np.where(turns, self.unit[0], 1.0)[:, None] * np.diag(self.sign)[list(self.order)]
        return J, np.diag(self.torque_sign)[list(self.torque_order)]


def zeros_text(names: Sequence[str], zero: Sequence[float] | Array) -> str:
    """Text of zero positions."""
    places = [f"{name} = {x:.6g}" for name, x in zip(names, zero, strict=True) if x]
    return f"zero positions differ: its zero is at {listed(places)} [rad or m] of this robot"


def turning(robot: Robot) -> Array:
    """True for revolute joints, shape (n,)."""
    return np.asarray(robot.model.is_revolute[list(robot.model.independent_joints)])


def conventions(robot: Robot, kinds: Iterable[str] = KINDS, *, single: bool = False) -> Iterator[Convention]:
    """Conventions of some kinds, with the fewest changes of a kind first; with `single`, of one joint or two only."""
    n, names, slides = robot.n, robot.joint_names, ~turning(robot)
    numbers, most = tuple(range(n)), 1 if single else n
    own = Convention("", 1.0, str, numbers, (1.0,) * n, (0.0,) * n, (1.0, 1.0), numbers, (1.0,) * n)

    def order_text(what: str, order: Sequence[int]) -> str:
        return f"its {what} are in the order {listed([names[k] for k in order])}"

    def sign_text(text: str, sign: Sequence[float]) -> str:
        return text.format(listed([name for name, x in zip(names, sign, strict=True) if x < 0]))

    def unit_text(unit: tuple[float, float]) -> str:
        what = "positions" if unit[1] == 1 else "positions, rates and accelerations"
        return f"it takes {what} {MISTAKEN[unit[0]]}"

    signs = partial(variants, n, 1.0, (-1.0,), most)
    zeros = ((x, k) for x, k in variants(n, 0.0, QUARTERS, most) if not np.any(x, where=slides))
    units = [(DEGREE, DEGREE)] if single else [(a, b) for a in MISTAKEN for b in (1.0, a)]
    table: dict[str, tuple[Iterable[tuple[Any, float]], tuple[str, ...], Callable[[Any], str]]] = {
        "joint order": (orders(n, single), ("order", "torque_order"), partial(order_text, "joints")),
        "torque order": (orders(n, True), ("torque_order",), partial(order_text, "torques")),
        "axis flipped": (signs(), ("sign", "torque_sign"), partial(sign_text, "the axis of {} points the other way")),
        "torque sign": (signs(), ("torque_sign",), partial(sign_text, "torques have the opposite sign in {}")),
        "joint zero": (zeros, ("zero",), partial(zeros_text, names)),
        "angle unit": (((x, 4.0) for x in units), ("unit",), unit_text),
    }
    for kind in kinds:
        values, fields, text = table[kind]
        for x, alternatives in values:
            changed: dict[str, Any] = dict.fromkeys(fields, x)
            yield own._replace(kind=kind, alternatives=alternatives, text=partial(text, x), **changed)


def orders(n: int, pairs: bool) -> Iterator[tuple[tuple[int, ...], float]]:
    """Orders of the joints, each with its number of alternatives; of more than eight joints only exchanges of two."""
    if pairs or factorial(n) > thresholds.CONVENTIONS:
        for i, j in combinations(range(n), 2):
            yield tuple({i: j, j: i}.get(k, k) for k in range(n)), 2 * comb(n, 2)
        return
    for p in permutations(range(n)):
        moved = sum(k != i for i, k in enumerate(p))
        if moved:
            yield p, comb(n, moved) * factorial(moved)


def variants(n: int, own: float, others: Sequence[float], most: int) -> Iterator[tuple[tuple[float, ...], float]]:
    """Values of n joints of which a limited number differ, fewest first, if not too many; alternatives of each."""
    total = 0
    for k in range(1, most + 1):
        alike = comb(n, k) * len(others) ** k
        total += alike
        if total > thresholds.CONVENTIONS:
            return
        for chosen, values in product(combinations(range(n), k), product(others, repeat=k)):
            changed = dict(zip(chosen, values, strict=True))
            yield tuple(changed.get(j, own) for j in range(n)), alike


def torques_of(robot: Robot, conventions: Sequence[Convention], states: Sequence[Array]) -> Array:
    """Torques of another model under each convention, shape (A, N, n)."""
    columns = list(zip(*conventions, strict=True))[3:]
    order, sign, zero, unit, torque_order, torque_sign = (np.array(x)[:, None] for x in columns)
    scales = np.where(turning(robot), np.moveaxis(unit, -1, 0)[..., None], 1.0)  # of positions; of rates
    order, torque_order = (np.broadcast_to(x, (len(x), *states[0].shape)) for x in (order, torque_order))
    q, qd, qdd = (np.take_along_axis(sign * x, order, -1) for x in states)
    try:
        found = robot.inverse_dynamics(scales[0] * q + zero, scales[1] * qd, scales[1] * qdd)
    except NotFiniteError:  # where joints that follow others have no position: none
        each = (torques_of(robot, [x], states) for x in conventions)
        return np.concatenate([*each]) if len(conventions) > 1 else np.zeros((1, *states[0].shape))
    torques = np.empty_like(found)
    np.put_along_axis(torques, torque_order, found, -1)
    signed: Array = torques * torque_sign
    return signed
