"""Least eigenvalue of M of a serial chain: pivots of M - P / t by articulated inertias over boxes of positions.

From the tip to the base, each pivot depends only on the joints distal to it (Featherstone 2008, 7.3). The inertia that
a joint passes on is concave and monotone in the inertia distal to it, and of degree 2 in the joint's angle. Over a
range of the angle it is thus a mean of five control points (Farin 2002, ch. 13), with which the recursion continues.
No slack is needed.
"""

from __future__ import annotations

import itertools
from typing import Any

import numpy as np

from ..basics.spatial import Array, cross_matrix
from ..dynamics.kinematics import joint_transforms
from .criteria import ROUNDING, LargestOfInverse
from .polynomials import PositionBox

I, J = np.triu_indices(6)
UNITS = np.zeros((21, 6, 6))  # basis of symmetric matrices
UNITS[range(21), I, J] = UNITS[range(21), J, I] = 1
DIAGONAL = I == J
NODES = np.linspace(-1, 1, 5)
WIDEST = 2 * np.pi / 3  # largest range of an angle [rad]
PARTS = 8  # parts of the second joint's range
HALVINGS = 20  # most halvings of each part
LEAVES = 15_000  # leaves computed at once
OF_LEAF = 1200  # operations per leaf
NARROWEST = 1e-7  # half width in x of the narrowest box, where a failure counts as a value
FINE = 1000  # steps of the second joint in the narrowest box
SHARE = 0.5  # share of P / t subtracted from M to judge its curvature


def bernstein(x: Array) -> Array:
    """Polynomials of degree 4 that are not negative from -1 to 1 and add up to 1, shape (N, 5)."""
    k = np.arange(5)
    return np.asarray([1, 4, 6, 4, 1] * ((1 + x[:, None]) / 2) ** k * ((1 - x[:, None]) / 2) ** (4 - k))


FROM_NODES = np.linalg.inv(bernstein(NODES))
HALVES = np.stack([FROM_NODES @ bernstein((NODES + side) / 2) for side in (-1, 1)])


def functions(x: Array, turns: bool) -> Array:
    """Basis functions of a joint, shape (..., 5): 1, cos x, sin x, cos 2 x, sin 2 x of an angle, otherwise powers."""
    harmonics = [np.cos(x), np.sin(x), np.cos(2 * x), np.sin(2 * x)] if turns else [x, x**2, x**3, x**4]
    return np.stack([np.ones_like(x), *harmonics], axis=-1)


def control_points(lower: Array, upper: Array, turns: bool) -> tuple[Array, Array]:
    """Control points of the basis functions over ranges, times their positive weights (..., 5, 5), and these (..., 5).

    With x = middle + 2 atan(y tan(half / 2)), -1 <= y <= 1, the functions times (1 + y^2 tan(half / 2)^2)^2 are
    polynomials of degree 4 in y.
    """
    half = ((upper - lower) / 2)[..., None]
    slope = NODES * np.tan(half / 2) if turns else 0 * NODES * half
    x = (lower + half[..., 0])[..., None] + (2 * np.arctan(slope) if turns else NODES * half)
    weight = (1 + slope**2) ** 2
    return FROM_NODES @ (functions(x, turns) * weight[..., None]), weight @ FROM_NODES.T


class ArticulatedSearch:
    """Search over boxes of positions of a serial chain, which are halved until the target is proven for all."""

    first, step, exponent, patience = 0.25, 0.2, 0.25, 0.9  # the work hardly depends on the target

    def __init__(self, criterion: LargestOfInverse, box: PositionBox, q: Array, target: float, clock: Any) -> None:
        self.criterion, self.box, self.target, self.clock = criterion, box, target, clock
        self.higher: Array | None = None
        self.began = clock.now()
        model, (self.middle, half) = box.model, box.joint_ranges
        self.turns, n = model.is_revolute, model.nb
        slides = np.where(self.turns, 0, abs(self.middle) + half)
        chain = np.linalg.norm(model.translation, axis=1) + slides + np.linalg.norm(model.com, axis=1)
        length = chain.sum() or 1.0  # the unit of lengths, so that entries are of one size
        self.scale = np.where(self.turns, 1.0, np.where(half > 0, half, length))  # q = middle + scale x
        moments = model.moments
        C, mass = cross_matrix(moments[1] / length), moments[0][:, None, None] * np.eye(3)
        self.bodies = np.block([[moments[2] / length**2, C], [-C, mass]])[:, I, J]
        self.axes = np.hstack([model.angular_axis, model.linear_axis])
        self.columns = [UNITS @ s for s in self.axes]
        rotors = model.armature - np.diag(criterion.projection) / target
        self.rotors: Array = rotors / np.where(self.turns, length, 1.0) ** 2
        nodes = np.where(self.turns, 2 * np.pi / 5 * np.arange(5)[:, None], NODES[:, None])
        R, p = joint_transforms(model, self.middle + self.scale * nodes)
        self.passed = []  # X^T S X of each joint: coefficients, shape (5, 21, 21); of the second joint (5, 21, 1)
        for i in range(n):
            back = R[i].swapaxes(1, 2)
            X = np.block([[back, 0 * back], [-back @ cross_matrix(p[i] / length), back]])[:, None]
            S = X.swapaxes(2, 3) @ UNITS @ X
            values = S[..., I, J] if i != 1 else (S @ self.axes[0] @ self.axes[0])[..., None]
            coefficients = np.linalg.solve(functions(nodes[:, i], self.turns[i]), values.reshape(5, -1))
            self.passed.append(coefficients.reshape(values.shape))
        wide = np.where(self.turns & (np.arange(n) > 1), 2 * half / WIDEST, 1.0)
        parts = [np.linspace(-h, h, 1 + max(int(np.ceil(w)), 1)) for h, w in zip(half / self.scale, wide, strict=True)]
        ranges = [np.stack([edges[:-1], edges[1:]], axis=1) for edges in parts]
        self.cells = np.array(list(itertools.product(*ranges)))  # ranges of x, shape (boxes, n, 2)

    def run(self, deadline: float) -> bool:
        """True if all boxes are proven, False after the deadline, if a position is `higher` or boxes get too small."""
        cells, leaves = self.cells, 5 ** max(len(self.axes) - 2, 0)
        at_once = max(LEAVES // leaves, 1)
        while len(cells):
            if self.clock.now() > deadline:
                return False
            now, cells = cells[-at_once:], cells[:-at_once]
            self.clock.count(len(now) * leaves * OF_LEAF)
            holds, place = self.holds(now)
            failed = ~holds.all(axis=1)
            if failed.any():
                halves = self.halved(now[failed], ~holds[failed], place[failed])
                if self.higher is not None or not len(halves):
                    return False
                cells = np.concatenate([cells, halves])
        return True

    def holds(self, cells: Array) -> tuple[Array, Array]:
        """True for leaves whose pivots are positive, (boxes, leaves), and the second joint's worst positions (boxes,).

        A leaf is one choice of a control point for each joint distal to the second.
        """
        (lower, upper), boxes = np.moveaxis(cells, 2, 0), len(cells)
        S, valid = np.tile(self.bodies[-1][:, None], (boxes, 1, 1)), np.ones((boxes, 1), dtype=bool)
        size = abs(S).max(axis=1)
        for i in reversed(range(1, len(self.axes))):
            u = self.columns[i].T @ S
            pivot = self.axes[i] @ u + self.rotors[i]
            size = abs(S).max(axis=1) + abs(self.rotors[i])
            positive = pivot > ROUNDING * size
            valid, inverse = valid & positive, 1 / np.where(positive, pivot, np.inf)
            size += (u * u).sum(axis=1) * inverse * (1 + size * inverse)
            S = S - (u * inverse[:, None])[:, I] * u[:, J]
            if i > 1:
                points, weights = control_points(lower[:, i], upper[:, i], bool(self.turns[i]))
                points = points / weights[..., None]
                passed = np.einsum("bjm,mxy->byjx", points, self.passed[i]).reshape(boxes, -1, 21)
                S = (passed @ S).reshape(boxes, 21, -1) + self.bodies[i - 1][:, None]
                size = abs(points).max() * abs(self.passed[i]).sum(axis=(0, 1)).max() * size
                S[:, DIAGONAL] -= ROUNDING * np.tile(size, 5)[:, None]
                valid = np.tile(valid, 5)
        first = (self.bodies[0] @ self.columns[0]) @ self.axes[0] + self.rotors[0]
        P, size = np.zeros((boxes, 5, 1)), size + abs(first) + abs(self.rotors[0])
        if len(self.axes) > 1:
            P, size = self.passed[1][..., 0] @ S, size * (1 + abs(self.passed[1]).sum())
        P[:, 0] += first - ROUNDING * size
        k = min(1, len(self.axes) - 1)
        return self.are_positive(P, valid, lower[:, k], upper[:, k], bool(self.turns[k]))

    def are_positive(self, P: Array, valid: Array, lower: Array, upper: Array, turns: bool) -> tuple[Array, Array]:
        """True for polynomials of coefficients P (boxes, 5, leaves) that are positive, until one of a box is not."""
        edges = np.linspace(lower, upper, PARTS + 1, axis=-1)
        points = control_points(edges[:, :-1], edges[:, 1:], turns)[0].swapaxes(1, 2).reshape(len(P), -1, 5)
        v = (points @ P).reshape(len(P), 5, PARTS, -1)
        negative = (v[:, [0, 4]].min(axis=1) <= 0) & valid[:, None]  # the ends of a range are values
        worst, holds = negative.sum(axis=2), valid & ~negative.any(axis=1)
        box, part, leaf = np.nonzero((v.min(axis=1) <= 0) & holds.all(axis=1)[:, None, None])
        v = v[box, :, part, leaf].T
        for _ in range(HALVINGS):
            negative = np.minimum(v[0], v[4]) <= 0
            holds[box[negative], leaf[negative]] = False
            np.add.at(worst, (box[negative], part[negative]), 1)
            left = (v.min(axis=0) <= 0) & holds.all(axis=1)[box]
            box, part, leaf = (np.tile(x[left], 2) for x in (box, part, leaf))
            v = np.hstack(HALVES @ v[:, left])
        holds[box, leaf] = False
        k = worst.argmax(axis=1)
        return holds, (edges[range(len(P)), k] + edges[range(len(P)), k + 1]) / 2

    def halved(self, cells: Array, fails: Array, place: Array) -> Array:
        """Halves of boxes, cut where M is curved most relative to M - P / (2 t), seen from where leaves fail."""
        n = len(self.axes)
        x, radius = cells.mean(axis=2), (cells[..., 1] - cells[..., 0]) / 2
        x[:, min(1, n - 1)] = place
        radius[:, :2] = 0
        fails = fails.reshape(-1, *[5] * max(n - 2, 0))
        for k in range(2, n):
            share = np.moveaxis(fails, k - 1, 1).reshape(len(x), 5, -1).sum(axis=2)
            x[:, k] += radius[:, k] * (share @ NODES) / share.sum(axis=1)
        at = x[:, None] + np.concatenate([np.zeros((1, n)), np.eye(n), -np.eye(n)]) * radius[:, None]
        q = self.middle + self.scale * at
        tried, narrow = q[:, 0], radius.max(axis=1) < NARROWEST
        if narrow.any():  # what fails there is a value, somewhere in the second joint's range
            tried = np.repeat(tried[narrow][:1], FINE, axis=0)
            tried[:, min(1, n - 1)] = np.linspace(self.box.lower, self.box.upper, FINE)[:, min(1, n - 1)]
        values = self.criterion.values(tried)
        if (values > self.target).any():
            self.higher = tried[values.argmax()]
        if self.higher is not None or narrow.any():
            return cells[:0]
        M = self.criterion.polynomial.evaluate(q.reshape(-1, n)).reshape(*q.shape, n)
        inverse = np.linalg.inv(np.linalg.cholesky(M[:, 0] - SHARE / self.target * self.criterion.projection))[:, None]
        bend = (M[:, 1 : n + 1] + M[:, n + 1 :]) / 2 - M[:, :1]
        k = np.linalg.eigvalsh(inverse @ bend @ inverse.swapaxes(2, 3))[:, 2:, -1].argmax(axis=1) + 2
        halves = np.stack([cells, cells])
        rows = np.arange(len(k))
        halves[0, rows, k, 1] = halves[1, rows, k, 0] = cells[rows, k].mean(axis=1)
        return halves.reshape(-1, n, 2)


def applies(criterion: Any, box: PositionBox) -> bool:
    """True for the least eigenvalue of a serial chain: each joint is mounted on the one before and mimics none."""
    least = isinstance(criterion, LargestOfInverse) and np.diag(criterion.projection).all()
    return bool(least and not box.model.has_mimics and box.model.parent == tuple(range(-1, box.model.nb - 1)))
