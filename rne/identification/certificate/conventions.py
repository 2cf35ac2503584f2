"""Other conventions of joints: their order, the signs of their axes, where they are zero, and the unit of angles.

With q' = (s q)[order] a + b, the other model has the torques of the robot at q', in its own order and with its signs:
tau[order] = s tau'(q', a' qd', a' qdd').
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
from .evidence import Evidence

MOST = 50_000  # alternatives that are tried
STATES = 150_000  # of all alternatives together, in the first selection
FEWEST, LARGEST_SAMPLE = 12, 64  # states of each: torques without noise need few
FINALISTS = 3
DEGREE = np.pi / 180


class Convention(NamedTuple):
    """One alternative and what it is called."""

    describe: Callable[[], str]
    order: tuple[int, ...]
    sign: tuple[int, ...]
    offset: tuple[float, ...]
    unit: tuple[float, float]  # of positions; of rates and accelerations
    alternatives: float  # among how many it was chosen
    numbers: int = 0

    def torques(self, robot: Robot, q: Array, qd: Array, qdd: Array) -> Array:
        """Torques in the order and with the signs of the given arrays, shape (..., n)."""
        order, sign = list(self.order), np.array(self.sign, float)
        q, qd, qdd = ((sign * x)[..., order] for x in (q, qd, qdd))
        a, b = self.unit
        found = robot.inverse_dynamics(a * q + np.array(self.offset), b * qd, b * qdd)
        torques = np.empty_like(found)
        torques[..., order] = found
        scaled: Array = torques * sign
        return scaled


def identity(n: int) -> Convention:
    """The robot's own conventions."""
    return Convention(lambda: "", tuple(range(n)), (1,) * n, (0.0,) * n, (1.0, 1.0), 1)


def families(robot: Robot) -> dict[str, list[Convention]]:
    """Lists of alternatives by cause."""
    return {
        "joint order": list(orders(robot)),
        "axis flipped": list(flips(robot)),
        "joint zero": list(quarter_turns(robot)),
        "angle unit": list(units(robot)),
    }


def orders(robot: Robot) -> Iterator[Convention]:
    """Joints in another order; of many joints only exchanges of two, rotations and the reversed order."""
    n, own = robot.n, identity(robot.n)
    if factorial(n) <= MOST:
        candidates = [p for p in permutations(range(n)) if p != own.order]
    else:
        swaps = [tuple({i: j, j: i}.get(k, k) for k in range(n)) for i, j in combinations(range(n), 2)]
        candidates = [*swaps, *(own.order[k:] + own.order[:k] for k in range(1, n)), own.order[::-1]]
    for p in candidates:
        moved = sum(k != i for i, k in enumerate(p))
        yield own._replace(
            describe=partial(_order_text, robot, p),
            order=p,
            alternatives=comb(n, moved) * factorial(moved),
        )


def flips(robot: Robot) -> Iterator[Convention]:
    """Axes of the opposite direction: positions, rates and torques of a joint change their signs."""
    own = identity(robot.n)
    for chosen in subsets(robot.n):
        sign = tuple(-1 if j in chosen else 1 for j in range(robot.n))
        text = partial(_flip_text, robot, chosen)
        yield own._replace(describe=text, sign=sign, alternatives=comb(robot.n, len(chosen)))


def quarter_turns(robot: Robot) -> Iterator[Convention]:
    """Joints that are zero where the robot's are at 90, 180 or 270 degrees."""
    own = identity(robot.n)
    turning = [j for j in range(robot.n) if robot.model.joint_types[robot.model.independent_joints[j]] != "prismatic"]
    for chosen in subsets(len(turning), base=4):
        for turns in product((1, 2, -1), repeat=len(chosen)):
            by_joint = dict(zip((turning[k] for k in chosen), turns, strict=True))
            yield own._replace(
                describe=partial(_turn_text, robot, by_joint),
                offset=tuple(by_joint.get(j, 0) * np.pi / 2 for j in range(robot.n)),
                alternatives=comb(len(turning), len(chosen)) * 3 ** len(chosen),
            )


def _order_text(robot: Robot, p: tuple[int, ...]) -> str:
    return f"its joints are in the order {listed([robot.joint_names[k] for k in p])}"


def _flip_text(robot: Robot, chosen: tuple[int, ...]) -> str:
    return f"the axis of {listed([robot.joint_names[j] for j in chosen])} points the other way"


def _turn_text(robot: Robot, by_joint: dict[int, int]) -> str:
    places = [f"{robot.joint_names[j]} at {90 * k} deg" for j, k in by_joint.items()]
    return f"zero positions differ: its zero is {listed(places)} of this robot"


def subsets(n: int, base: int = 2) -> Iterator[tuple[int, ...]]:
    """Subsets of n joints, the small ones first, as long as there are not too many: base - 1 for each joint chosen."""
    total = 0
    for k in range(1, n + 1):
        total += comb(n, k) * (base - 1) ** k
        if total > MOST:
            return
        yield from combinations(range(n), k)


def units(robot: Robot) -> Iterator[Convention]:
    """Degrees where the robot has radians, and the other way round."""
    own = identity(robot.n)
    for name, of_rates in {"positions": 0, "positions, rates and accelerations": 1}.items():
        for words, a in {"degrees that are radians": DEGREE, "radians that are degrees": 1 / DEGREE}.items():
            text = partial(str, f"it takes {name} as {words}")
            yield own._replace(describe=text, unit=(a, a**of_rates), alternatives=4)


class Screen:
    """The torques of all alternatives of a family in a few states, to choose those worth a closer look."""

    def __init__(self, evidence: Evidence, family: Sequence[Convention]) -> None:
        self.evidence, self.family = evidence, family
        size = FEWEST if evidence.exact else int(np.clip(STATES // max(len(family), 1), FEWEST, LARGEST_SAMPLE))
        rows = len(evidence.q)
        self.rows = np.unique(np.linspace(0, rows - 1, min(size, rows)).round().astype(int))
        states = [x[self.rows] for x in (evidence.q, evidence.qd, evidence.qdd)]
        torques = all_torques(evidence.robot, family, *states)
        weight = evidence.valid[self.rows] / evidence.sigma
        self.residual = ((evidence.tau[self.rows] - torques) * weight).reshape(len(family), -1)
        self.weight = weight

    def finalists(self, columns: Array | None = None) -> list[Convention]:
        """Those with the smallest residuals, after a fit of columns, shape (R, n, k)."""
        residual = self.residual
        if columns is not None:
            chosen = (columns[self.rows] * self.weight[..., None]).reshape(residual.shape[1], -1)
            chosen = chosen / np.maximum(np.linalg.norm(chosen, axis=0), np.finfo(float).tiny)
            Q = np.linalg.qr(chosen)[0]
            residual = residual - (residual @ Q) @ Q.T
        best = np.argsort((residual**2).sum(1), kind="stable")[:FINALISTS]
        return [self.family[k] for k in best]


def all_torques(robot: Robot, family: Sequence[Convention], q: Array, qd: Array, qdd: Array) -> Array:
    """Torques of every alternative, shape (A, S, n)."""
    order = np.array([c.order for c in family])[:, None, :]
    sign = np.array([c.sign for c in family], float)[:, None, :]
    offset = np.array([c.offset for c in family])[:, None, :]
    unit = np.array([c.unit for c in family])[:, :, None, None]
    turned = [np.take_along_axis(sign * x, np.broadcast_to(order, (len(family), *x.shape)), -1) for x in (q, qd, qdd)]
    found = robot.inverse_dynamics(unit[:, 0] * turned[0] + offset, unit[:, 1] * turned[1], unit[:, 1] * turned[2])
    torques = np.empty_like(found)
    np.put_along_axis(torques, np.broadcast_to(order, found.shape), found, -1)
    scaled: Array = torques * sign
    return scaled
