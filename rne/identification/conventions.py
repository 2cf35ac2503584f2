"""Hypotheses that torques are not linear in: conventions and zeros of joints, inertias in other axes, a point mass.

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

from ..basics.spatial import Array, cross_matrix
from ..basics.text import listed
from ..model.parameters import COLUMNS, PARAMETERS, ROWS
from ..robot import Robot
from .equations import triangular
from .evidence import Evidence
from .hypotheses import Candidate

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


GRID = 72  # angles of a first look at each joint
STEP = 1e-5  # of central differences [rad or m]
STEPS = 20
SMALL = 1e-12  # step at which the iteration ends [rad or m]


def shifted_zeros(evidence: Evidence) -> Iterator[Candidate]:
    """Another zero of one joint, and of all joints at once."""
    n = evidence.robot.n
    grid = np.linspace(-np.pi, np.pi, GRID, endpoint=False)
    places = [(j, angle) for j in range(n) for angle in grid]
    family = [_convention(evidence, angle * np.eye(n)[j]) for j, angle in places]
    for start in Screen(evidence, family).finalists():
        j = int(np.flatnonzero(start.offset)[0]) if any(start.offset) else 0
        yield _candidate(evidence, refined(evidence, np.array(start.offset), np.array([j])), n)
    offset = refined(evidence, np.zeros(n), np.arange(n))
    for kept in _nested(evidence, offset):
        yield _candidate(evidence, refined(evidence, np.where(np.isin(np.arange(n), kept), offset, 0), kept), 2**n)


def _nested(evidence: Evidence, offset: Array) -> Iterator[Array]:
    """All joints, then only those whose zero differs."""
    n = len(offset)
    yield np.arange(n)
    clearly = np.flatnonzero(np.abs(offset) > 1e-3 * np.abs(offset).max(initial=0))
    if 0 < len(clearly) < n:
        yield clearly


def refined(evidence: Evidence, offset: Array, free: Array) -> Array:
    """Gauss-Newton from a start, for the free entries."""
    b = evidence.weighted(evidence.tau - _torques(evidence, offset))
    for _ in range(STEPS):
        columns = []
        for j in free:
            e = STEP * np.eye(len(offset))[j]
            columns.append(evidence.weighted(_torques(evidence, offset + e) - _torques(evidence, offset - e)))
        J = np.stack(columns, axis=1) / (2 * STEP)
        step = np.zeros(len(offset))
        step[free] = np.linalg.lstsq(J, b, rcond=1e-9)[0]
        step = step / max(1.0, float(np.abs(step).max()))
        trial = evidence.weighted(evidence.tau - _torques(evidence, offset + step))
        if (trial**2).sum() >= (b**2).sum():
            break
        offset, b = offset + step, trial
        if np.abs(step).max() < SMALL:
            break
    return offset


def _torques(evidence: Evidence, offset: Array) -> Array:
    torques: Array = evidence.robot.inverse_dynamics(evidence.q + offset, evidence.qd, evidence.qdd)
    return torques


def _convention(evidence: Evidence, offset: Array) -> Convention:
    return identity(evidence.robot.n)._replace(offset=tuple(float(x) for x in offset))


def _candidate(evidence: Evidence, offset: Array, alternatives: float) -> Candidate:
    convention = _convention(evidence, offset)
    robot = evidence.robot
    residual = evidence.tau - evidence.predict(lambda q, qd, qdd: convention.torques(robot, q, qd, qdd))
    places = [f"{name} at {x:.6g}" for name, x in zip(robot.joint_names, offset, strict=True) if x]
    text = f"zero positions differ: its zero is {listed(places) or 'the same'} [rad or m] of this robot"
    return Candidate.of(evidence, ("joint zero",), text, int(np.count_nonzero(offset)), alternatives, residual)


ITERATIONS = 40
DIFFERENCE = 1e-6
DAMPING = 1e-4
LARGEST = 1e12  # damping
STARTS = 6  # of the rotation
SETTLED = 1e-12  # relative decrease of the squares at which the iteration ends


def cube() -> Array:
    """The 24 rotations that take axes to axes, the identity first."""
    found = []
    for p in permutations(range(3)):
        for signs in product((1.0, -1.0), repeat=3):
            R = np.diag(signs)[:, list(p)]
            if np.linalg.det(R) > 0:
                found.append(R)
    return np.array(found)


def rotation(w: Array) -> Array:
    """The rotation by a vector of angle and axis (Rodrigues)."""
    angle = float(np.linalg.norm(w))
    if angle == 0:
        return np.eye(3)
    K = cross_matrix(w / angle)
    R: Array = np.eye(3) + np.sin(angle) * K + (1 - np.cos(angle)) * K @ K
    return R


class Reduced:
    """Least squares of ten columns of a body, as a triangular factor: |A x - b|^2 of few rows."""

    def __init__(self, evidence: Evidence, i: int) -> None:
        A = evidence.weighted(evidence.columns[..., PARAMETERS * i : PARAMETERS * (i + 1)])
        b = evidence.weighted(evidence.difference)
        factor = triangular(np.concatenate([A, b[:, None]], axis=1))
        self.A, self.b = factor[:, :-1], factor[:, -1]
        self.most = evidence.count * evidence.limit**2

    def explains(self) -> bool:
        """True if some parameters of the body explain the difference; without it, no change of the body does."""
        found = np.linalg.lstsq(self.A, self.b, rcond=None)[0]
        return self.error(found) <= self.most

    def error(self, change: Array) -> float:
        """|A x - b|^2 of a change of the body's parameters."""
        return float(((self.A @ change - self.b) ** 2).sum())

    def minimum(self, change: Callable[[Array], Array], x: Array) -> tuple[float, Array]:
        """Levenberg-Marquardt for a change of the parameters that depends on x."""
        damping, r = DAMPING, self.A @ change(x) - self.b
        for _ in range(ITERATIONS):
            steps = DIFFERENCE * np.eye(len(x))
            J = np.stack([self.A @ (change(x + e) - change(x - e)) for e in steps], axis=1) / (2 * DIFFERENCE)
            H = J.T @ J
            step = -np.linalg.lstsq(H + damping * np.diag(np.diag(H)), J.T @ r, rcond=1e-14)[0]
            trial = self.A @ change(x + step) - self.b
            if not (trial @ trial < r @ r):
                damping *= 10
                if damping > LARGEST:
                    break
                continue
            settled = r @ r - trial @ trial <= SETTLED * (r @ r)
            x, r, damping = x + step, trial, damping / 10
            if settled:
                break
        return float(r @ r), x


def turned_inertias(evidence: Evidence) -> Iterator[Candidate]:
    """The inertia about the centre of mass of one body in other axes, by 90 degrees or by any rotation."""
    model = evidence.robot.model
    for i, name in enumerate(model.moving_joints):
        I = model.inertia[i]
        if np.ptp(np.linalg.eigvalsh(I)) <= 1e-9 * np.trace(I):
            continue  # equal in all axes
        reduced = Reduced(evidence, i)
        if not reduced.explains():
            continue
        quarter = min(cube()[1:], key=lambda R: reduced.error(_turned(I, R)))
        yield _of_body(evidence, i, _turned(I, quarter), f"of {name} is in axes turned by 90 or 180 deg", 0, 23)
        V = np.linalg.eigh(I)[1]
        starts = [R @ V.T for R in cube()] + list(cube())
        starts.sort(key=lambda R: reduced.error(_turned(I, R)))
        fits = [(reduced.minimum(_from(I, R), np.zeros(3)), R) for R in starts[:STARTS]]
        (_, w), R = min(fits, key=lambda found: found[0][0])
        Q = rotation(w) @ R
        yield _of_body(evidence, i, _turned(I, Q), f"of {name} is in other axes, turned by a rotation", 3, 1)


def _from(I: Array, R: Array) -> Callable[[Array], Array]:
    return lambda w: _turned(I, rotation(w) @ R)


def _turned(I: Array, R: Array) -> Array:
    change = np.zeros(PARAMETERS)
    change[4:] = (R @ I @ R.T - I)[ROWS, COLUMNS]
    return change


def _of_body(evidence: Evidence, i: int, change: Array, what: str, numbers: int, alternatives: float) -> Candidate:
    residual = evidence.difference - evidence.columns[..., PARAMETERS * i : PARAMETERS * (i + 1)] @ change
    nb = evidence.robot.model.nb
    text = f"the inertia of the body {what}"
    return Candidate.of(evidence, ("inertia axes",), text, numbers, alternatives * nb, residual)


def payloads(evidence: Evidence) -> Iterator[Candidate]:
    """A point mass on the last body of each branch, or one that is missing there."""
    model = evidence.robot.model
    tips = [i for i in range(model.nb) if i not in model.parent]
    for i in tips:
        reduced = Reduced(evidence, i)
        if not reduced.explains():
            continue
        linear = np.linalg.lstsq(reduced.A, reduced.b, rcond=1e-9)[0]
        centre = linear[1:4] / (linear[0] or 1.0)
        starts = [[linear[0], *centre], [1.0, 0, 0, 0], [-1.0, 0, 0, 0]]
        fits = [reduced.minimum(point_mass, np.array(start)) for start in starts]
        _, x = min(fits, key=lambda found: found[0])
        yield _payload(evidence, i, x, len(tips))


def point_mass(x: Array) -> Array:
    """Parameters of a point of mass x[0] at x[1:]."""
    m, c = x[0], x[1:]
    change = np.zeros(PARAMETERS)
    change[0], change[1:4] = m, m * c
    change[4:] = m * (float(c @ c) * np.eye(3) - np.outer(c, c))[ROWS, COLUMNS]
    return change


def _payload(evidence: Evidence, i: int, x: Array, tips: int) -> Candidate:
    change, m, centre = point_mass(x), float(x[0]), x[1:]
    residual = evidence.difference - evidence.columns[..., PARAMETERS * i : PARAMETERS * (i + 1)] @ change
    name, place = evidence.robot.model.moving_joints[i], ", ".join(f"{round(float(c), 9) + 0.0:.4g}" for c in centre)
    what = "carries a payload of" if m > 0 else "lacks a payload of"
    text = f"it {what} {abs(m):.4g} kg at ({place}) m of the frame of {name}"
    return Candidate.of(evidence, ("payload",), text, 4, tips, residual)
