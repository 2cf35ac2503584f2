"""Positions that are measured from another zero, by any angle."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from ...basics.spatial import Array
from ...basics.text import listed
from .candidate import Candidate
from .conventions import Convention, Screen, identity
from .evidence import Evidence

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
