"""Uncertainty of a fit of motions: standard errors under correlated residuals, and unidentifiable combinations."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ...basics.arrays import ReadOnlyArrays
from ...basics.spatial import Array
from .. import thresholds

DRIVE = "kp", "kd", "ki", "stall_torque", "effort_limit", "rotor"
FRICTION = "viscous", "coulomb", "viscous_back", "coulomb_back", "stribeck_rise"
TORQUE_LIKE = *DRIVE, *FRICTION, "armature", "parameters", "stiffness", "damping"  # all grow as torques do


@dataclass(frozen=True, eq=False)
class Certainty(ReadOnlyArrays):
    """Information on Z unknowns from residuals r and their derivatives J: P entries of x, then starts of shots."""

    information: Array  # J^T J of weighted residuals, (Z, Z)
    score: Array  # covariance of J^T r, residuals being correlated in time, (Z, Z)
    spread: Array  # standard deviations that the fit allows for, (Z,)
    count: int  # P
    given: Array  # True where the spread is known beforehand, (Z,)

    @cached_property
    def covariance(self) -> Array:
        """Covariance of x, (P, P): the sandwich of the correlated score, at least the one of white residuals."""
        return self._covariance(1.0)

    def _covariance(self, looser: float) -> Array:
        prior = np.diag(1 / (np.where(self.given, 1.0, looser) * self.spread) ** 2)
        scale = 1 / np.sqrt(np.diag(self.information + prior))
        H = scale[:, None] * (self.information + prior) * scale
        w, V = np.linalg.eigh(H)
        half = V / np.sqrt(np.maximum(w, w.max(initial=1.0) * thresholds.SMALLEST_INFORMATION))
        inner = half.T @ (scale[:, None] * (self.score + prior) * scale) @ half
        v, U = np.linalg.eigh(inner)
        half = scale[:, None] * (half @ U) * np.sqrt(np.maximum(v, 1.0))
        return np.asarray((half @ half.T)[: self.count, : self.count])

    @cached_property
    def std(self) -> Array:
        """Standard errors of x, (P,)."""
        return np.asarray(np.sqrt(np.diag(self.covariance)))

    @cached_property
    def looser(self) -> Array:
        """Covariance under ten times the allowed spread."""
        return self._covariance(10.0)

    @cached_property
    def determined(self) -> Array:
        """True for entries determined by the log: their errors do not grow with the allowed spread."""
        return np.asarray(np.sqrt(np.diag(self.looser)) < thresholds.BY_SPREAD * self.std)

    def alike(self) -> list[tuple[list[int], int]]:
        """Groups of undetermined entries with the same effect, and the number of free directions of each.

        An entry that the log would not determine even if all others were known is a group by itself, with none.
        """
        C, undetermined = self.looser, np.flatnonzero(~self.determined)
        size, seen = np.sqrt(np.diag(C)), np.diag(self.information) * self.spread**2 > thresholds.SEEN_OF_MOTIONS
        R = np.abs(C / size[:, None] / size)
        groups, left = [], set(undetermined.tolist())
        while left:
            group, fresh = set(), {min(left)}
            left -= fresh
            while fresh:
                group |= fresh
                near = {j for i in fresh for j in left if seen[i] and seen[j] and R[i, j] > thresholds.ALIKE_OF_MOTIONS}
                left, fresh = left - near, near
            here, spread = sorted(group), self.spread[sorted(group)]
            free = np.linalg.eigvalsh(C[np.ix_(here, here)] / spread[:, None] / spread) > 1.0
            groups.append((here, int(free.sum()) if seen[here[0]] else 0))
        return groups

    def scale(self, values: Array, names: Sequence[str], is_log: Array) -> Array | None:
        """Direction of x that scales all torques together, (P,), or None if motions change along it."""
        like = np.array([x.rpartition(".")[2] in TORQUE_LIKE or x == "friction.offset" for x in names], bool)
        v = np.where(like, np.where(is_log, 1.0, values), 0.0)
        P, spread = self.count, self.spread[: self.count]
        own = self.information[:P, :P] + np.diag(self.given[:P] / spread**2)
        spread = np.where(self.given[:P], np.inf, spread)
        if not v.any() or float(v @ own @ v) >= thresholds.SCALED_OF_MOTIONS * float(np.sum((v / spread) ** 2)):
            return None
        return np.asarray(v)

    def given_scale(self, v: Array) -> Certainty:
        """Certainty if the entry were known that determines the common scale of torques, direction v, best."""
        sizes = np.divide(self._given(v).std, np.abs(v), out=np.full(len(v), np.inf), where=v != 0)
        return self._given(np.eye(len(v))[np.argmin(sizes)])

    def _given(self, direction: Array) -> Certainty:
        """Certainty if the component of x along a direction, (P,), were known."""
        v = np.zeros(len(self.spread))
        v[: self.count] = direction / self.spread[: self.count] ** 2
        added = np.outer(v, v) * 1e6 / max(float(v @ (self.spread**2 * v)), 1e-300)
        return Certainty(self.information + added, self.score + added, self.spread, self.count, self.given)


def certainty(parts: Sequence[tuple[Array, Array]], spread: Array, count: int, given: Array) -> Certainty:
    """Certainty from weighted residuals (T, n) of shots, NaN where not measured, and their derivatives (T, n, Z).

    Residuals of a joint are taken as stationary: S = sum of J_t^T c(t - s) J_s, c being their autocovariance, which is
    tapered beyond where it is significant (Newey and West 1987; flat-top window of Politis and Romano 1995).
    """
    n, Z = parts[0][0].shape[1], len(spread)
    information, score, prior = np.zeros((Z, Z)), np.zeros((Z, Z)), np.diag(1 / spread**2)
    for j in range(n):
        rows = [(np.nan_to_num(r[:, j]), np.where(np.isfinite(r[:, j])[:, None], J[:, j], 0.0)) for r, J in parts]
        own = np.sum([J.T @ J for _, J in rows], axis=0)
        measured = sum(int(np.isfinite(r[:, j]).sum()) for r, _ in parts)
        free = float(np.trace(np.linalg.solve(own + prior, own))) if measured else 0.0
        c = autocovariance([r for r, _ in rows]) * measured / max(measured - free, 1.0)
        information += own
        for _, J in rows:
            T = len(J)
            kernel = c[: min(len(c), T)]
            spectrum = np.fft.rfft(np.concatenate([kernel, np.zeros(2 * T - 2 * len(kernel) + 1), kernel[:0:-1]]))
            KJ = np.fft.irfft(spectrum[:, None] * np.fft.rfft(J, 2 * T, axis=0), 2 * T, axis=0)[:T]
            score += J.T @ KJ
    return Certainty(information, (score + score.T) / 2, spread, count, given)


def autocovariance(series: Sequence[Array]) -> Array:
    """Autocovariance of residuals, tapered, at lags from 0 to where it is no longer significant, shape (L + 1,)."""
    longest, total = max(len(r) for r in series), sum(len(r) for r in series)
    size = 2 * longest
    each = [np.fft.irfft(np.abs(np.fft.rfft(r, size)) ** 2, size)[:longest] for r in series]
    c = np.sum(each, axis=0) / max(total, 1)
    if c[0] <= 0:
        return np.zeros(1)
    noise = 2.0 * np.sqrt(np.log10(max(total, 10)) / total) * c[0]
    run = max(5, int(np.ceil(np.sqrt(np.log10(max(total, 10))))))
    small = np.abs(c) < noise
    last = next((k for k in range(1, longest - run) if small[k : k + run].all()), max(1, longest // 3))
    lags = np.arange(min(2 * last + 1, longest))
    return np.asarray(c[lags] * np.clip(2 - lags / last, 0.0, 1.0))
