"""A motion between its samples.

Positions are polynomials of fifth degree through the positions, velocities and accelerations of both samples of a step,
so that velocities and accelerations are their derivatives. Torques are monotone cubic polynomials, which show no peak
that the samples do not have. Neither reaches across a jump.
"""

from __future__ import annotations

from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np

from ..basics.arrays import real_numbers
from ..basics.spatial import Array

PARTS, MOST = 16, 100_000  # of a step, and of a motion: of many samples, fewer between them
OUTSIDE = 1e-12  # of the last time: by rounding, a solver's last step ends so far beyond it


def between(t: Array, most: int = PARTS) -> Array:
    """The times of samples and further ones between them, each step in up to 16 parts, or `most`."""
    if len(t) < 2:
        return t
    parts = int(np.clip(MOST // len(t), 1, most))
    inside = t[:-1, None] + np.diff(t)[:, None] * (np.arange(parts) / parts)
    return np.append(inside.reshape(-1), t[-1])


class Knots(NamedTuple):
    """What a Trajectory holds under the same names."""

    t: Array
    q: Array
    qd: Array
    qdd: Array
    tau: Array
    jumps: Array
    qdd_before: Array
    tau_before: Array


class Interpolant:
    """Positions, their derivatives and torques of a motion as functions of time.

    Parameters
    ----------
    motion : Knots
        At least one.
    """

    def __init__(self, motion: Knots) -> None:
        keep = np.append(True, np.diff(motion.t) > 0)
        self.motion, self.t = motion, motion.t[keep]
        self.q, self.qd, self.qdd, self.tau = (x[keep] for x in (motion.q, motion.qd, motion.qdd, motion.tau))
        self.jumps = np.searchsorted(self.t, motion.jumps)
        if len(self.t) > 1:
            self.positions = self._quintic()
            self.rates = self.positions.derivative()
            self.accelerations = self.rates.derivative()
            self.torque = self._monotone()

    def state(self, t: Array) -> tuple[Array, Array, Array]:
        """Positions, velocities and accelerations at times of shape (T,), each of shape (T, n)."""
        if len(self.t) == 1:
            return tuple(np.repeat(x, len(t), axis=0) for x in (self.q, self.qd, self.qdd))  # type: ignore[return-value]
        return self.positions(t), self.rates(t), self.accelerations(t)

    def torques(self, t: Array) -> Array:
        """Torques at times of shape (T,), shape (T, n)."""
        found: Array = np.repeat(self.tau, len(t), axis=0) if len(self.t) == 1 else self.torque(t)
        return found

    def times(self, t: Any) -> Array:
        """Times within the motion; a ValueError for others."""
        times = real_numbers("t", t, "(T,)").astype(np.float64)
        first, last = float(self.t[0]), float(self.t[-1])
        margin = OUTSIDE * abs(last)
        outside = (times < first - margin) | (times > last + margin)
        if outside.any():
            raise ValueError(
                f"`t` must be within the motion, from {first:g} to {last:g} s, got {float(times[outside].flat[0]):g}"
            )
        return np.clip(times, first, last)

    def _ends(self, after: Array, before: Array) -> tuple[Array, Array]:
        """Values at the begin and at the end of each step, the latter those before a jump."""
        ends = after[1:].copy()
        if len(self.jumps):
            ends[self.jumps - 1] = before
        return after[:-1], ends

    def _quintic(self) -> Any:
        from scipy.interpolate import BPoly

        h = np.diff(self.t)[:, None]
        a0, a1 = self._ends(self.qdd, self.motion.qdd_before)
        (q0, q1), (v0, v1) = ((x[:-1], x[1:]) for x in (self.q, self.qd))
        begin = [q0, q0 + h * v0 / 5, q0 + 2 * h * v0 / 5 + h * h * a0 / 20]
        end = [q1 - 2 * h * v1 / 5 + h * h * a1 / 20, q1 - h * v1 / 5, q1]
        return BPoly(np.array([*begin, *end]), self.t)

    def _monotone(self) -> Any:
        from scipy.interpolate import PchipInterpolator, PPoly

        begin, end = self._ends(self.tau, self.motion.tau_before)
        h = np.diff(self.t)
        c = np.stack([0 * begin, 0 * begin, (end - begin) / h[:, None], begin])  # straight lines
        borders = np.unique([0, *self.jumps, len(h)])
        for first, last in pairwise(borders):
            if last - first > 1:
                piece = np.concatenate([begin[first:last], end[last - 1 : last]])
                c[:, first:last] = PchipInterpolator(self.t[first : last + 1], piece).c
        return PPoly(c, self.t)
