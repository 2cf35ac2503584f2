"""Causes in the bodies that torques are not linear in: an inertia in other axes, a point mass at an unknown place."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from itertools import permutations, product

import numpy as np

from ...basics.spatial import Array, cross_matrix
from ...model.parameters import COLUMNS, PARAMETERS, ROWS
from ..estimation.equations import triangular
from .candidate import Candidate
from .evidence import Evidence

STEPS = 40
STEP = 1e-6
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
        for _ in range(STEPS):
            steps = STEP * np.eye(len(x))
            J = np.stack([self.A @ (change(x + e) - change(x - e)) for e in steps], axis=1) / (2 * STEP)
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
