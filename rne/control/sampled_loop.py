"""Sample times at which a PD loop is stable in one configuration: in closed form, or proven for coupled modes.

M e'' = -G (e - e_k) - Kp e_k - Kd v_k holds from sample k to the next: e is the deviation from the reference, v its
rate, G = dg/dq, and torques are held, those that compensate gravity included. In the modes of gravity alone, e = V x
with V^T M V = 1 and V^T G V = diag(w), this is x'' = -w x + (w - P) x_k - D v_k, P = V^T Kp V, D = V^T Kd V. Hence

    (x, v)_k+1 = Phi(T) (x, v)_k,  Phi(T) = 1 + integral_0^T exp(F t) dt A,  F = [0 1; -w 0],  A = [0 1; -P -D]
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..basics.spatial import Array

NARROWEST = 1e-10  # of an end of an interval: narrower ones stay undecided
PARTS, INTERVALS = 4, 4000  # an undecided interval is cut in so many; so many are examined before others are given up
REDUCED = 0.3  # of a gap between eigenvalues: larger couplings are not transformed away
CLOSE = (
    0.1  # of their size: closer eigenvalues share an orthonormal basis, for their eigenvectors may be nearly parallel
)
LARGEST_GROWTH = 100.0  # of an inverted pendulum over one sample, exp(100): longer sample times are undecided
ROUNDING = 16 * float(np.finfo(float).eps)
STABLE, UNDECIDED, UNSTABLE = 0, 1, 2
NONE = np.empty((0, 2))  # no windows
VERDICTS = ("stable", "undecided", "unstable")


class Window(NamedTuple):
    """Sample times from `start` to `end` [s] with one verdict: "stable", "undecided" or "unstable".

    Stable windows are open, the others closed: a single time at which the loop is marginal is an unstable window
    without width.
    """

    start: float
    end: float
    verdict: str


def first_unstable_time(w: Array, P: Array, D: Array) -> Array:
    """The smallest sample time [s] at which x'' = -w x + (w - P) x_k - D v_k is not stable, for arrays of modes.

    By Jury's criterion (Åström and Wittenmark 1997, section 3.2) with omega = sqrt(w) and y = omega T / 2 it is stable
    exactly if P > 0, sin y (D omega cos y - (P - w) sin y) > 0 and cos y (omega cos y - D sin y) > 0; for w < 0, an
    inverted pendulum, these are tanh |y| < D |omega| / (P - w) and tanh |y| < |omega| / D.
    """
    omega = np.sqrt(np.abs(w))
    with np.errstate(divide="ignore", invalid="ignore"):
        hanging = 2 * np.minimum(np.arctan2(D * omega, P - w), np.arctan2(omega, D)) / omega
        inverted = 2 * np.arctanh(np.minimum(D * omega / (P - w), omega / D)) / omega
        return np.where(w > 0, hanging, np.where(w < 0, inverted, 2 * np.minimum(1 / D, D / P)))


def unstable_windows(w: Array, P: Array, D: Array, upto: float) -> tuple[Array, Array]:
    """All windows of unstable sample times of one mode, shape (windows, 2), in closed form; none is undecided."""
    first, omega = first_unstable_time(w, P[0], D[0])[0], np.sqrt(np.abs(w[0]))
    if w[0] <= 0:
        return np.array([[first, np.inf]]), NONE
    damped, period = 2 * np.arctan2(D[0, 0] * omega, P[0, 0] - w[0]) / omega, 2 * np.pi / omega
    one = [[first, period / 2], [damped, period]] if damped > period / 2 else [[first, period]]
    return np.reshape(period * np.arange(int(upto / period) + 1)[:, None, None] + one, (-1, 2)), NONE


def gravity_modes(M: Array, G: Array, kp: Array, kd: Array) -> tuple[Array, Array, Array]:
    """w, P and D for mass matrices M and stiffnesses G of gravity, shapes (..., n), (..., n, n), (..., n, n)."""
    inverse = np.linalg.inv(np.linalg.cholesky(M))
    w, Q = np.linalg.eigh(inverse @ (G + G.swapaxes(-1, -2)) @ inverse.swapaxes(-1, -2) / 2)
    V = inverse.swapaxes(-1, -2) @ Q
    return w, V.swapaxes(-1, -2) @ (kp[:, None] * V), V.swapaxes(-1, -2) @ (kd[:, None] * V)


def step_matrix(w: Array, P: Array, D: Array, T: Array) -> tuple[Array, Array]:
    """Phi - 1 and dPhi/dT, shape (..., 2 m, 2 m), for modes of shapes (..., m) and (..., m, m), and times T."""
    T, w, one = T[..., None, None], w[..., None], np.eye(w.shape[-1])
    x = np.emath.sqrt(w.astype(complex)) * T
    c, s, f = np.cos(x).real, T * np.sinc(x / np.pi).real, (T * np.sinc(x / (2 * np.pi)).real) ** 2 / 2
    change = [[-f * P, s * one - f * D], [-s * P, -w * f * one - s * D]]  # no digits are lost for short T
    slope = [[-s * P, c * one - s * D], [-c * P, -w * s * one - c * D]]
    return np.block(change), np.block(slope)


class LinearLoop:
    """The loop of one configuration: modes w, P, D, in groups that the gains couple.

    `horizon` is a sample time that is of the order of the first unstable one, or longer.
    """

    def __init__(self, w: Array, P: Array, D: Array) -> None:
        self.w, self.P, self.D = w, P, D
        with np.errstate(divide="ignore"):
            fastest = np.min(np.pi / np.sqrt(np.abs(w)))
            self.horizon = float(min(fastest, 2 / np.linalg.eigvalsh(D)[-1], 1e6 / np.sqrt(np.trace(P))))

    def windows(self, upto: float, *, first_only: bool = False) -> list[Window]:
        """Windows of all sample times up to `upto`; if only the first is asked for, others may be called stable."""
        size = [np.sqrt(np.diagonal(X)) for X in (self.P, self.D)]
        coupled = sum(np.abs(X) > ROUNDING * np.outer(s, s) for X, s in zip((self.P, self.D), size, strict=True))
        reach = np.linalg.matrix_power(np.eye(len(self.w)) + coupled, len(self.w)) > 0
        found = []
        for k in (np.flatnonzero(row) for row in np.unique(reach, axis=0)):
            w, P, D = self.w[k], self.P[np.ix_(k, k)], self.D[np.ix_(k, k)]
            single = len(k) == 1
            found.append(unstable_windows(w, P, D, upto) if single else CoupledModes(w, P, D).examine(upto, first_only))
        unstable, undecided = (np.concatenate(windows) for windows in zip(*found, strict=True))
        edges = np.unique(np.clip(np.concatenate([[0, upto], unstable.ravel(), undecided.ravel()]), 0, upto))
        T = np.sort(np.concatenate([edges, (edges[1:] + edges[:-1]) / 2]))
        verdict = np.where(_within(unstable, T), UNSTABLE, np.where(_within(undecided, T), UNDECIDED, STABLE))
        first = np.flatnonzero(np.append(True, np.diff(verdict) != 0))
        last = np.append(first[1:] - 1, len(T) - 1)
        ends = zip(edges[first // 2].tolist(), edges[(last + 1) // 2].tolist(), verdict[first], strict=True)
        return [Window(start, end, VERDICTS[k]) for start, end, k in ends]

    def first_unstable(self, upto: float) -> float:
        """The largest sample time up to `upto` below which all are proven stable."""
        first = self.windows(upto, first_only=True)[0]
        return first.end if first.verdict == "stable" else 0.0


def _within(windows: Array, T: Array) -> Array:
    """True where a time is in one of the closed windows: more have begun than have ended before it."""
    begun, ended = (np.sort(windows[:, k]) for k in (0, 1))
    return np.searchsorted(begun, T, side="right") > np.searchsorted(ended, T, side="left")


class CoupledModes:
    """Modes that gains couple: proofs that the number of unstable eigenvalues is constant over intervals of T.

    Two facts: with F and A above, dPhi/dT = exp(F T) A, so that Taylor's series about the middle of an interval has
    known terms and a known remainder; and diag(z) + R has no eigenvalue on the unit circle if |R_ij| / g_j, with g_j at
    most the distance of z_j from the circle, is a matrix of spectral radius below 1 (diagonal dominance; Horn and
    Johnson 2013, section 6.1). R is made small by following the eigenvectors from the middle to second order.
    """

    def __init__(self, w: Array, P: Array, D: Array) -> None:
        self.w, self.P, self.D, self.m = w, P, D, len(w)
        self.A = np.block([[np.zeros_like(P), np.eye(self.m)], [-P, -D]])
        self.absolute = np.block([[np.zeros_like(P), np.eye(self.m)], [np.diag(np.abs(w)), np.zeros_like(P)]])  # |F|

    def rotated(self, Y: Array) -> Array:
        """F Y."""
        return np.concatenate([Y[..., self.m :, :], -self.w[:, None] * Y[..., : self.m, :]], axis=-2)

    def series(self, T: Array, h: Array) -> tuple[list[Array], Array]:
        """Taylor's coefficients of V^-1 (Phi - 1) V about T up to the third, and a bound on the rest within h."""
        change, slope = step_matrix(self.w, self.P, self.D, T)
        V = _basis(change)
        inverse, Y = np.linalg.inv(V), slope @ V
        FY, F2 = self.rotated(Y), self.absolute @ self.absolute
        series = [inverse @ change @ V, inverse @ Y, inverse @ FY / 2, inverse @ self.rotated(FY) / 6]
        # sum of h^k |F|^(k-1) / k! from k = 4, where h |F| <= 1
        tail = np.abs(inverse) @ (F2 @ (1.05 * self.absolute + 0.21 * h * F2) * h**4 / 24) @ np.abs(Y)
        size = np.abs(change) + T[:, None, None] * np.abs(slope)
        return series, tail + ROUNDING * self.m * np.abs(inverse) @ size @ np.abs(V)

    def verdicts(self, T: Array, half: Array) -> Array:
        """STABLE, UNSTABLE or UNDECIDED for each interval from T - half to T + half."""
        h, one = half[:, None, None], np.eye(2 * self.m)
        (K0, K1, K2, K3), rest = self.series(T, h)
        z, rate = (np.diagonal(K, axis1=-2, axis2=-1)[:, None, :] for K in (K0, K1))
        gap = np.abs(z - z.swapaxes(-1, -2))
        # (K0 + K1 t + ...) S - S (z + rate t + curve t^2) with S = 1 + X t + Y t^2 is small, term by term
        X = _reduction(K1, z, np.abs(K1) * h < REDUCED * gap)
        second = K2 + K1 @ X - X * rate
        curve = np.diagonal(second, axis1=-2, axis2=-1)[:, None, :]
        Y = _reduction(second, z, np.abs(second) * h**2 < REDUCED * gap)
        residual = (
            np.abs(K0 - z * one)
            + h * np.abs(K1 - rate * one + K0 @ X - X * z)
            + h**2 * np.abs(second - curve * one + K0 @ Y - Y * z)
            + h**3 * np.abs(K3 + K2 @ X + K1 @ Y - Y * rate - X * curve)
            + h**4 * np.abs(K3 @ X + K2 @ Y - Y * curve)
            + h**5 * np.abs(K3 @ Y)
        )
        change = h * np.abs(X) + h**2 * np.abs(Y)
        residual += rest @ (one + change)
        path = np.stack([z[:, 0], rate[:, 0] * half[:, None], curve[:, 0] * half[:, None] ** 2])
        excess = (2 * z.real + np.abs(z) ** 2)[:, 0] + _change_of_square(path + [[[1]], [[0]], [[0]]])
        least, largest = excess / (1 + np.sqrt(np.maximum(1 + excess, 0)))  # |1 + z| - 1
        constant = _dominant(change, residual, np.where(largest < 0, -largest, least))
        unstable = constant & (least > 0).any(axis=-1) | self.one_outside(change, residual, path, least)
        known = half**2 * np.abs(self.w).max() <= 1
        return np.where(known & unstable, UNSTABLE, np.where(known & constant, STABLE, UNDECIDED))

    def one_outside(self, change: Array, residual: Array, path: Array, least: Array) -> Array:
        """True where the least stable eigenvalue stays in a circle of its own, outside the unit circle."""
        k = least.argmax(axis=-1)[:, None]
        apart = path - np.take_along_axis(path, k[None], axis=-1)
        distance = np.sqrt(np.maximum(np.abs(apart[0]) ** 2 + _change_of_square(apart)[0], 0))
        np.put_along_axis(distance, k, np.inf, axis=-1)
        radius = np.minimum(np.take_along_axis(least, k, axis=-1), distance.min(axis=-1, keepdims=True) / 2)
        distance -= radius
        np.put_along_axis(distance, k, radius, axis=-1)
        return _dominant(change, residual, distance)

    def proven_start(self, upto: float) -> float:
        """A time up to which all are proven stable, by (Phi - 1) / T = A + F A T / 2 + F^2 A T^2 / 6 + ...; or 0."""
        V, F2 = _basis(self.A[None])[0], self.absolute @ self.absolute
        inverse, Y = np.linalg.inv(V), self.A @ V
        start, size = inverse @ Y, np.abs(inverse)
        z = np.diagonal(start)
        fixed = np.abs(start - np.diag(z)) + ROUNDING * self.m * size @ np.abs(self.A) @ np.abs(V)
        first = np.abs(inverse @ self.rotated(Y)) / 2
        for T in upto * 0.5 ** np.arange(60):
            distance = -(2 * z.real + T * np.abs(z) ** 2) / (1 + np.abs(1 + T * z))  # from the circle of |1 + T z| = 1
            rest = F2 / 6 + T * F2 @ (1.05 * self.absolute + 0.21 * T * F2) / 24  # where T |F| <= 1
            residual = fixed + T * first + T**2 * size @ rest @ np.abs(Y)
            if T**2 * np.abs(self.w).max() <= 1 and _dominant(0 * residual, residual, distance):
                return float(T)
        return 0.0

    def examine(self, upto: float, first_only: bool) -> tuple[Array, Array]:
        """Windows of unstable and of undecided sample times up to `upto`, or the first of them only."""
        if not self.D.any():
            # s^2 + t (W - P) t s + t P t = 0 with z = (1 + s) / (1 - s), t = tan(omega T / 2) / omega for each mode
            definite = np.linalg.eigvalsh(np.diag(self.w) - self.P)
            if definite[0] > 0:  # damped by the compensation that is held, marginal at the zeros and poles of t
                times = [np.arange(1, upto * omega / np.pi + 1) * np.pi / omega for omega in np.sqrt(self.w)]
                return np.repeat(np.concatenate(times)[:, None], 2, axis=1), NONE
            if definite[-1] < 0:
                return np.array([[0, upto]]), NONE
        reach = min(upto, LARGEST_GROWTH / np.sqrt(max(-self.w.min(), 1e-300)))
        start = self.proven_start(reach)
        edges = reach * 0.5 ** np.arange(40)[::-1] if start == 0 else start * 2.0 ** np.arange(60)
        edges = np.append(edges[edges < reach], reach)
        found = [NONE], [np.array([[0, edges[0]], [reach, upto]])[[start == 0, reach < upto]]]
        a, b, count, first = edges[:-1], edges[1:], 0, 0.0 if start == 0 else np.inf
        while len(a):
            verdict = self.verdicts((a + b) / 2, (b - a) / 2)
            count += len(a)
            given_up = (verdict == UNDECIDED) & ((b - a < NARROWEST * b) | (count > INTERVALS))
            for windows, which in zip(found, (verdict == UNSTABLE, given_up), strict=True):
                windows.append(np.stack([a[which], b[which]], axis=1))
                first = min(first, a[which].min(initial=np.inf))
            left = (verdict == UNDECIDED) & ~given_up & ((a < first) | (not first_only))
            cuts = np.linspace(a[left], b[left], PARTS + 1)
            a, b = cuts[:-1].ravel(), cuts[1:].ravel()
        return np.concatenate(found[0]), np.concatenate(found[1])


def _basis(K: Array) -> Array:
    """Eigenvectors as columns, shape (..., 2 m, 2 m), those of close eigenvalues orthonormal."""
    z, V = np.linalg.eig(K)
    z, V, size = z.astype(complex), V.astype(complex), np.abs(z)
    for j in range(z.shape[-1]):
        for i in range(j):
            close = np.abs(z[:, i] - z[:, j]) < CLOSE * np.maximum(size[:, i], size[:, j])
            along = (V[:, :, i].conj() * V[:, :, j]).sum(axis=-1) * close
            V[:, :, j] -= along[:, None] * V[:, :, i]
        V[:, :, j] /= np.linalg.norm(V[:, :, j], axis=-1, keepdims=True)
    sound = np.isfinite(V).all(axis=(-2, -1)) & (np.abs(np.linalg.det(V)) > 0)
    return np.where(sound[:, None, None], V, np.eye(z.shape[-1]))


def _reduction(K: Array, z: Array, small: Array) -> Array:
    """X with X diag(z) - diag(z) X = K where that is small, and zero elsewhere and on the diagonal."""
    small &= ~np.eye(K.shape[-1], dtype=bool)
    return np.where(small, K / np.where(small, z - z.swapaxes(-1, -2), 1), 0)


def _change_of_square(path: Array) -> Array:
    """Lowest and highest change of |z|^2 along z = path[0] + path[1] x + path[2] x^2 for -1 <= x <= 1, or beyond."""
    z, rate, curve = path
    slope, bend = 2 * (z.conj() * rate).real, np.abs(rate) ** 2 + 2 * (z.conj() * curve).real
    x = np.clip(-slope / np.where(bend == 0, 1, 2 * bend), -1, 1)
    values = np.stack([bend - slope, bend + slope, slope * x + bend * x**2])  # to second order
    rest = 2 * np.abs((rate.conj() * curve).real) + np.abs(curve) ** 2
    return np.stack([values.min(axis=0) - rest, values.max(axis=0) + rest])


def _dominant(constant: Array, residual: Array, distance: Array) -> Array:
    """True where all distances are positive and constant + residual / distance has a spectral radius below 1."""
    clear = (distance > 0).all(axis=-1)
    A = constant + residual / np.where(distance > 0, distance, 1)[..., None, :]
    with np.errstate(over="ignore", invalid="ignore"):
        d, power = np.ones((*distance.shape, 1)), A
        for _ in range(5):  # d = (1 + A + ... + A^31) 1
            d, power = d + power @ d, power @ power
        return np.asarray(clear & (A @ d < d * (1 - 1e-12)).all(axis=(-2, -1)))
