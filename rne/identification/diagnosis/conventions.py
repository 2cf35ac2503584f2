"""Conventions of joints by which another model may differ: order, signs, zeros and units.

A convention is q' = a (s q)[order] + b, with rates and accelerations scaled by a': the other model has the torques of
the robot at q', in its own order and with its signs, tau[order] = s tau'(q', a' qd', a' qdd').
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from functools import partial
from itertools import combinations, permutations, product
from math import comb, factorial
from typing import NamedTuple

import numpy as np

from ...basics.spatial import Array
from ...basics.text import listed
from ...robot import Robot
from .. import thresholds

DEGREE = np.pi / 180
QUARTERS = (np.pi / 2, np.pi, -np.pi / 2)


class Convention(NamedTuple):
    """Order, signs, zeros and units of the joints, where they are not the robot's own."""

    kind: str
    alternatives: float  # among how many it was chosen
    text: Callable[[], str]
    order: Sequence[int]
    sign: Sequence[float] | Array
    zero: Sequence[float] | Array  # [rad or m]
    unit: tuple[float, float] = (1.0, 1.0)  # of positions; of rates and accelerations


def zeros_text(names: Sequence[str], zero: Sequence[float] | Array) -> str:
    """Where joints are zero, in words."""
    places = [f"{name} at {x:.6g}" for name, x in zip(names, zero, strict=True) if x]
    return f"zero positions differ: its zero is {listed(places)} [rad or m] of this robot"


def conventions(robot: Robot) -> Iterator[Convention]:
    """Conventions that are tried, the fewest changes of a kind first."""
    n, model, names = robot.n, robot.model, robot.joint_names

    own = Convention("", 1.0, str, range(n), np.ones(n), np.zeros(n))

    def order_text(order: Sequence[int]) -> str:
        return f"its joints are in the order {listed([names[k] for k in order])}"

    def sign_text(sign: Sequence[float]) -> str:
        return f"the axis of {listed([x for x, s in zip(names, sign, strict=True) if s < 0])} points the other way"

    for x, k in orders(n):
        yield own._replace(kind="joint order", alternatives=k, text=partial(order_text, x), order=x)
    for sign, k in variants(n, 1.0, (-1.0,)):
        yield own._replace(kind="axis flipped", alternatives=k, text=partial(sign_text, sign), sign=sign)
    sliding = [j for j, i in enumerate(model.independent_joints) if model.joint_types[i] == "prismatic"]
    for zero, k in variants(n, 0.0, QUARTERS):
        if not any(zero[j] for j in sliding):
            yield own._replace(kind="joint zero", alternatives=k, text=partial(zeros_text, names, zero), zero=zero)
    for a, mistaken in ((DEGREE, "degrees that are radians"), (1 / DEGREE, "radians that are degrees")):
        for b, what in ((1.0, "positions"), (a, "positions, rates and accelerations")):
            text = partial("it takes {} as {}".format, what, mistaken)
            yield own._replace(kind="angle unit", alternatives=4, text=text, unit=(a, b))


def orders(n: int) -> Iterator[tuple[tuple[int, ...], int]]:
    """Orders of the joints, of more than eight only exchanges of two; each with how many are like it."""
    swaps = (tuple({i: j, j: i}.get(k, k) for k in range(n)) for i, j in combinations(range(n), 2))
    for p in permutations(range(n)) if factorial(n) <= thresholds.CONVENTIONS else swaps:
        moved = sum(k != i for i, k in enumerate(p))
        if moved:
            yield p, comb(n, moved) * factorial(moved)


def variants(n: int, own: float, others: tuple[float, ...]) -> Iterator[tuple[tuple[float, ...], int]]:
    """Values of n joints of which some differ, the fewest first, unless too many; each with how many are like it."""
    total = 0
    for k in range(1, n + 1):
        alike = comb(n, k) * len(others) ** k
        total += alike
        if total > thresholds.CONVENTIONS:
            return
        for chosen, values in product(combinations(range(n), k), product(others, repeat=k)):
            changed = dict(zip(chosen, values, strict=True))
            yield tuple(changed.get(j, own) for j in range(n)), alike


def torques_of(robot: Robot, conventions: Sequence[Convention], states: Sequence[Array]) -> Array:
    """Torques of another model with each convention, shape (A, N, n)."""
    order, sign, zero, unit = (np.array(x)[:, None] for x in list(zip(*conventions, strict=True))[3:])
    order, (a, b) = np.broadcast_to(order, (len(order), *states[0].shape)), np.moveaxis(unit, -1, 0)[..., None]
    q, qd, qdd = (np.take_along_axis(sign * x, order, -1) for x in states)
    found = robot.inverse_dynamics(a * q + zero, b * qd, b * qdd)
    torques = np.empty_like(found)
    np.put_along_axis(torques, order, found, -1)
    signed: Array = torques * sign
    return signed
