"""Sample times at which a PD loop is stable in one configuration: in closed form, or proven for coupled modes.

M e'' = -G (e - e_k) - Kp e_k - Kd v_k holds from sample k to the next: e is the deviation from the reference, v its
rate, G = dg/dq, and torques are held, including gravity compensation. In the modes of gravity without gains, e = V x
with V^T M V = 1 and V^T G V = diag(w), this is x'' = -w x + (w - P) x_k - D v_k, P = V^T Kp V, D = V^T Kd V. Hence

    (x, v)_k+1 = Phi(T) (x, v)_k,  Phi(T) = 1 + integral_0^T exp(F t) dt A,  F = [0 1; -w 0],  A = [0 1; -P -D]
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..basics.spatial import Array

NARROWEST = 1e-10  # smallest relative width of an interval that is subdivided
PARTS, INTERVALS = 4, 4000  # parts into which an undecided interval is divided; most intervals examined
REDUCED = 0.3  # largest coupling that is transformed away, relative to the eigenvalue gap
CLOSE = 0.1  # relative distance of eigenvalues below which their eigenvectors are made orthonormal
LARGEST_GROWTH = 100.0  # largest exponent of an unstable mode over one sample; longer sample times are undecided
SUM_ROUNDING = 16 * float(np.finfo(float).eps)  # rounding of sums of a few products, relative to the largest term
NONE = np.empty((0, 2))  # no windows
WHOLE = 1e-12  # relative rounding tolerance of delays that are a whole number of sample times


class Window(NamedTuple):
    """Sample times [s] with one verdict, "stable", "undecided" or "unstable"; single marginal ones are unstable."""

    start: float
    end: float
    verdict: str


def first_unstable_time(w: Array, P: Array, D: Array) -> Array:
    """The smallest sample time [s] at which x'' = -w x + (w - P) x_k - D v_k is not stable, for arrays of modes.

    With omega = sqrt(w) and y = omega T / 2 it is stable exactly if sin y (D omega cos y - (P - w) sin y) > 0 and
    cos y (omega cos y - D sin y) > 0, or, inverted, tanh |y| < D |omega| / (P - w) and tanh |y| < |omega| / D: Jury's
    criterion (Åström and Wittenmark 1997, section 3.2), which also requires P > 0.
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
    """Loop of one configuration; `horizon` is of the order of the first unstable sample time, or longer."""

    def __init__(self, w: Array, P: Array, D: Array) -> None:
        self.w, self.P, self.D = w, P, D
        rates = np.sqrt(np.abs(w).max()) / np.pi, np.linalg.eigvalsh(D)[-1] / 2, 1e-6 * np.sqrt(np.trace(P))
        self.horizon = float(1 / max(rates))

    def windows(self, upto: float) -> list[Window]:
        """Stability windows of all sample times up to `upto`."""
        coupled = np.eye(len(self.w))
        for X in (self.P, self.D):
            coupled += np.abs(X) > SUM_ROUNDING * np.sqrt(np.outer(np.diagonal(X), np.diagonal(X)))
        reach = np.linalg.matrix_power(coupled, len(self.w)) > 0
        found = []
        for k in (np.flatnonzero(row) for row in np.unique(reach, axis=0)):
            w, P, D = self.w[k], self.P[np.ix_(k, k)], self.D[np.ix_(k, k)]
            found.append(unstable_windows(w, P, D, upto) if len(k) == 1 else CoupledModes(w, P, D).examine(upto))
        unstable, undecided = (np.concatenate(windows) for windows in zip(*found, strict=True))
        edges = np.unique(np.clip(np.concatenate([[0, upto], unstable.ravel(), undecided.ravel()]), 0, upto))
        T = np.sort(np.concatenate([edges, (edges[1:] + edges[:-1]) / 2]))
        verdict = np.full(len(T), "stable", dtype="U9")
        for windows, name in ((undecided, "undecided"), (unstable, "unstable")):
            begun, ended = np.sort(windows, axis=0).T
            verdict[np.searchsorted(begun, T, side="right") > np.searchsorted(ended, T, side="left")] = name
        first = np.flatnonzero(np.append(True, verdict[1:] != verdict[:-1]))
        rows = edges[first // 2], edges[np.append(first[1:], len(T)) // 2], verdict[first]
        return [Window(*row) for row in zip(*(x.tolist() for x in rows), strict=True)]

    def first_unstable(self, upto: float) -> float:
        """Largest sample time up to `upto` below which all are proven stable."""
        first = self.windows(upto)[0]
        return first.end if first.verdict == "stable" else 0.0


class CoupledModes:
    """Modes that gains couple: proofs that the number of unstable eigenvalues is constant over intervals of T.

    As dPhi/dT = exp(F T) A, Taylor's series about the middle of an interval has known terms and a known remainder; and
    diag(z) + R has no eigenvalue on the unit circle if |R_ij| / g_j, with g_j at most the distance of z_j from it, has
    a spectral radius below 1 (Horn and Johnson 2013, section 6.1). Eigenvectors are followed to first order.
    """

    def __init__(self, w: Array, P: Array, D: Array) -> None:
        self.w, self.P, self.D, self.one = w, P, D, np.eye(2 * len(w))
        self.F = np.block([[0 * P, np.eye(len(w))], [-np.diag(w), 0 * P]])
        self.A = np.block([[0 * P, np.eye(len(w))], [-P, -D]])

    def rest(self, h: Array | float) -> Array:
        """Bound on the sum of h^k |F|^k / (k + 1)! from k = 2, where h |F| <= 1."""
        size = np.abs(self.F)
        return np.asarray(size @ size @ (1.06 * self.one + 0.26 * h * size) * (h**2 / 6))

    def followed(self, T: Array, h: Array) -> tuple[Array, Array, Array, Array]:
        """Eigenvalues z of Phi - 1 in the middle T of each interval, and how they and their eigenvectors change.

        Returns z and dz/dT, (..., 2 m), the matrix X of the eigenvectors V (1 + X t), and a bound on the entries of
        what z and X leave of V^-1 (Phi - 1) V for |t| <= h.
        """
        change, slope = step_matrix(self.w, self.P, self.D, T)
        V = _basis(change)
        inverse, Y = np.linalg.inv(V), slope @ V
        K0, K1, K2 = inverse @ change @ V, inverse @ Y, inverse @ self.F @ Y / 2  # of V^-1 (Phi - 1) V in t = T' - T
        rounding = SUM_ROUNDING * len(self.A) * (np.abs(change) + T[:, None, None] * np.abs(slope)) @ np.abs(V)
        rest = np.abs(inverse) @ (h * self.rest(h) @ np.abs(Y) + rounding)
        z, rate = (np.diagonal(K, axis1=-2, axis2=-1)[:, None, :] for K in (K0, K1))
        gap = z - z.swapaxes(-1, -2)
        small = (np.abs(K1) * h < REDUCED * np.abs(gap)) & (self.one == 0)
        X = np.where(small, K1 / np.where(small, gap, 1), 0)
        # (K0 + K1 t + ...) (1 + X t) - (1 + X t) (z + rate t) is small, term by term
        residual = np.abs(K0 - z * self.one) + h * np.abs(K1 - rate * self.one + K0 @ X - X * z)
        residual += h**2 * np.abs(K2 + K1 @ X - X * rate) + h**3 * np.abs(K2 @ X) + rest @ (self.one + h * np.abs(X))
        return z[:, 0], rate[:, 0], X, residual

    def verdicts(self, T: Array, half: Array) -> Array:
        """Verdicts "stable", "unstable" or "undecided" for each interval from T - half to T + half."""
        h = half[:, None, None]
        z, rate, X, residual = self.followed(T, h)
        step = rate * half[:, None]
        least, largest = outside_circle(z, step)
        constant = _dominant(h * np.abs(X), residual, np.where(largest < 0, -largest, least))
        k = least.argmax(axis=-1)[:, None]  # the least stable eigenvalue may stay in a separate circle, outside
        own, apart = np.arange(len(self.one)) == k, [np.abs(x - np.take_along_axis(x, k, axis=-1)) for x in (z, step)]
        distance = np.where(own, np.inf, apart[0] - apart[1])
        radius = np.minimum(least.max(axis=-1), distance.min(axis=-1) / 2)[:, None]
        alone = _dominant(h * np.abs(X), residual, np.where(own, radius, distance - radius))
        constant, alone = (known & (half**2 * np.abs(self.w).max() <= 1) for known in (constant, alone))
        return np.select([constant & (least > 0).any(axis=-1) | alone, constant], ["unstable", "stable"], "undecided")

    def proven_start(self, upto: float) -> float:
        """Time up to which all are proven stable, by (Phi - 1) / T = A + F A T / 2 + F^2 A T^2 / 6 + ...; or 0."""
        V, T = _basis(self.A[None])[0], upto * 0.5 ** np.arange(60)
        inverse, Y, h = np.linalg.inv(V), self.A @ V, T[:, None, None]
        start, size, z = inverse @ Y, np.abs(inverse), np.diagonal(inverse @ Y)
        residual = np.abs(start - np.diag(z)) + SUM_ROUNDING * len(z) * size @ np.abs(self.A) @ np.abs(V)
        residual = residual + h / 2 * np.abs(inverse @ self.F @ Y) + size @ self.rest(h) @ np.abs(Y)
        distance = -(2 * z.real + T[:, None] * np.abs(z) ** 2) / (1 + np.abs(1 + T[:, None] * z))  # from |1 + T z| = 1
        proven = _dominant(0 * residual, residual, distance) & (T**2 * np.abs(self.w).max() <= 1)
        return float(T[proven].max(initial=0.0))

    def examine(self, upto: float) -> tuple[Array, Array]:
        """Windows of unstable and of undecided sample times up to `upto`, each of shape (windows, 2)."""
        if not self.D.any():
            # |s^2 + t (W - P) t s + t P t| = 0 with z = (1 + s) / (1 - s) and t = tan(omega T / 2) / omega of each mode
            definite = np.linalg.eigvalsh(np.diag(self.w) - self.P)
            if definite[0] > 0:  # stable, but marginal at zeros and poles of t
                times = [np.arange(1, upto * omega / np.pi + 1) * np.pi / omega for omega in np.sqrt(self.w)]
                return np.repeat(np.concatenate(times)[:, None], 2, axis=1), NONE
            if definite[-1] < 0:
                return np.array([[0, upto]]), NONE
        reach = min(upto, LARGEST_GROWTH / np.sqrt(max(-self.w.min(), 1e-300)))
        start = self.proven_start(reach)
        edges = reach * 0.5 ** np.arange(40)[::-1] if start == 0 else start * 2.0 ** np.arange(60)
        edges = np.append(edges[edges < reach], reach)
        found = [NONE], [np.array([[0, edges[0]], [reach, upto]])[[start == 0, reach < upto]]]
        a, b, count = edges[:-1], edges[1:], 0
        while len(a):
            verdict = self.verdicts((a + b) / 2, (b - a) / 2)
            count += len(a)
            given_up = (verdict == "undecided") & ((b - a < NARROWEST * b) | (count > INTERVALS))
            for windows, which in zip(found, (verdict == "unstable", given_up), strict=True):
                windows.append(np.stack([a[which], b[which]], axis=1))
            left = (verdict == "undecided") & ~given_up
            cuts = np.linspace(a[left], b[left], PARTS + 1)
            a, b = cuts[:-1].ravel(), cuts[1:].ravel()
        return np.concatenate(found[0]), np.concatenate(found[1])


def outside_circle(z: Array, step: Array) -> tuple[Array, Array]:
    """Minimum and maximum of |1 + z + step x| - 1 over -1 <= x <= 1."""
    linear, square = 2 * ((1 + z).conj() * step).real, np.abs(step) ** 2
    x = np.clip(-linear / np.where(square == 0, 1, 2 * square), -1, 1)
    excess = 2 * z.real + np.abs(z) ** 2 + np.stack([linear * x + square * x**2, np.abs(linear) + square])
    least, largest = excess / (1 + np.sqrt(np.maximum(1 + excess, 0)))
    return least, largest


def _basis(K: Array) -> Array:
    """Eigenvectors as columns, shape (..., 2 m, 2 m); for close eigenvalues they are orthonormal."""
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


def _dominant(constant: Array, residual: Array, distance: Array) -> Array:
    """True where all distances are positive and constant + residual / distance has a spectral radius below 1."""
    clear = (distance > 0).all(axis=-1)
    A = constant + residual / np.where(distance > 0, distance, 1)[..., None, :]
    with np.errstate(over="ignore", invalid="ignore"):
        d, power = np.ones((*distance.shape, 1)), A
        for _ in range(5):  # d = (1 + A + ... + A^31) 1
            d, power = d + power @ d, power @ power
        return np.asarray(clear & (A @ d < d * (1 - 1e-12)).all(axis=(-2, -1)))


def in_periods(delay: float, period: float) -> tuple[float, float]:
    """Delay as a whole number of periods and a remainder [s], 0 where it is only rounding."""
    whole, rest = float(round(delay / period)), 0.0
    if abs(delay - whole * period) > WHOLE * max(delay, period):
        whole = float(np.floor(delay / period))
        rest = delay - whole * period
    return whole, rest
