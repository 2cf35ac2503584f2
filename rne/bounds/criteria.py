"""Criteria: convex functions of polynomial arrays, whose largest values are the constants of stability theorems."""

from __future__ import annotations

import itertools
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, ClassVar

import numpy as np

from ..basics.spatial import Array
from .polynomials import Polynomial

# Relative to the sum of the terms: errors of recursions (20 eps), coefficients and pivots of matrices up to order 36.
ROUNDING = 2000 * float(np.finfo(float).eps)

AT_ONCE = 500  # arrays whose norm is computed at once
SWEEPS = 2  # sweeps over the rates in the search for a largest torque
TINY = 1e-300
ELSEWHERE = 0.1  # importance of other directions than the extreme eigenvalue's


def positive_definite(A: Array) -> Array:
    """True for each matrix (N, n, n) whose pivots are all positive."""
    a = np.array(np.moveaxis(A, 0, -1), order="C")  # a copy, of one matrix too
    valid = np.ones(len(A), dtype=bool)
    with np.errstate(all="ignore"):
        for k in range(len(a)):
            valid &= a[k, k] > 0
            for i in range(k + 1, len(a)):
                a[i, k + 1 : i + 1] -= a[i, k] / a[k, k] * a[k + 1 : i + 1, k]
    return valid


def half_of_corners(n: int) -> Array:
    """Signs of rates at half of the corners of their box, shape (2^(n - 1), n); the others are opposite."""
    return np.array(list(itertools.product([1.0], *[[1.0, -1.0]] * (n - 1))))


@dataclass
class Criterion:
    """Convex function phi of a polynomial array A(q), a sum of modes, to be maximised.

    Subclasses define it by methods of the same meaning:

    - `values`: phi(A(q)) at positions, and whatever the array leaves free chosen by search.
    - `modes`: for each mode a bound of phi of its real part times any phase: a number, or of `Norm` a matrix.
    - `slack`: a bound of phi of a weighted sum of modes, by which A may change within a cell.
    - `holds`: True where phi(A + E) is at most a target for every E that a slack bounds, rounding included.
    - `importance`: share of each mode in the slack near a maximum, which selects the coordinate to halve next.
    """

    polynomial: Polynomial
    ratios: dict[tuple[int, int], float] = field(default_factory=dict, init=False)  # known, of groups and coordinates
    has_ratios: ClassVar[bool] = True
    time_model: ClassVar[tuple[float, float]] = (0.3, 2.5)  # least next gap / gap; work is about gap^-exponent
    of_value: ClassVar[int] = 0  # operations of `values` in addition to those of `holds`, for each position

    def values(self, q: Array) -> Array:
        """Values phi(A(q)) at positions, shape (N,); by default from the moduli."""
        return self.moduli(self.polynomial.evaluate(q))

    def counted(self, q: Array, clock: Any) -> Array:
        """Values with their operations counted by a clock."""
        clock.count(len(q) * (self.operations + self.of_value))
        return self.values(q)

    @cached_property
    def operations(self) -> float:
        """Number of operations of `holds` for each position."""
        return self.polynomial.operations + self.of_test(self.polynomial.coefficients.shape[-1])

    def of_test(self, n: int) -> float:
        """Number of operations of `holds` without the evaluation of A, whose last axis has length n."""
        return n

    def holds(self, q: Array, target: float, slack: Any) -> Array:
        """True where phi(A + E) <= target for every E that the slack bounds, shape (N,)."""
        return np.asarray(self.values(q) <= target - slack)

    @cached_property
    def modes(self) -> Array:
        """Bounds of phi of each mode, shape (modes,)."""
        return self.moduli(self.polynomial.coefficients)

    def moduli(self, arrays: Array) -> Array:
        """Bounds of phi of the real part of complex arrays times any phase, shape (N,)."""
        raise NotImplementedError

    @cached_property
    def grid_coefficients(self) -> Array:
        """Coefficients of the arrays whose `ratio` is found on grids."""
        return self.polynomial.coefficients

    def ratio(self, arrays: Array, on: Array, weights: Array, known: float) -> float:
        """Largest phi of arrays over the weighted sum of the modes `on`, or `known`, the ratio of earlier arrays."""
        return max(known, float(self.moduli(arrays).max() / (weights @ self.modes[on])))

    def slack(self, weights: Array) -> Any:
        """Bound of the sum of modes, each times a number of modulus at most its weight (modes,)."""
        return float(weights @ self.modes) + self.error

    def importance(self, q: Array) -> Array:
        """Share of each mode in the slack near a maximum, shape (modes,)."""
        return self.modes

    @cached_property
    def size(self) -> float:
        """Bound of phi over all positions."""
        return float(self.modes.sum())

    @cached_property
    def error(self) -> float:
        """Bound of the rounding error of phi(A)."""
        return ROUNDING * float(np.linalg.norm(self.polynomial.terms))

    def rounding(self, value: float) -> float:
        """Bound of the rounding error of a computed value."""
        return ROUNDING * self.size + self.error


class Modulus(Criterion):
    """Euclidean norm of a vector, or modulus of a number; A has shape (N, m)."""

    def moduli(self, arrays: Array) -> Array:
        return np.asarray(np.linalg.norm(arrays, axis=1))


class LargestModulus(Criterion):
    """Largest Euclidean norm of some vectors; A has shape (N, vectors, m)."""

    def of_test(self, n: int) -> float:
        return 12.0 * self.polynomial.terms.size  # vectors are made of a Jacobian

    def moduli(self, arrays: Array) -> Array:
        return np.asarray(np.linalg.norm(arrays, axis=2).max(axis=1))


@dataclass
class Norm(Criterion):
    """Largest modulus of the eigenvalues of a symmetric matrix; slacks are symmetric matrices.

    For a complex symmetric c and any phase, the real part of exp(i phase) v^T c v is at most v^T Re (c^* c)^1/2 v, by
    Takagi's factorisation. Where A is known to be `positive` definite, only its largest eigenvalue is tested.
    """

    positive: bool = field(default=False, kw_only=True)
    has_ratios: ClassVar[bool] = False  # sums of matrices are close to what grids show
    time_model: ClassVar[tuple[float, float]] = (0.14, 1.75)
    of_value = 5_000  # of eigenvalues

    def values(self, q: Array) -> Array:
        return np.asarray(abs(np.linalg.eigvalsh(self.polynomial.evaluate(q))[:, [0, -1]]).max(axis=1))

    def of_test(self, n: int) -> float:
        return 3.0 * n**3

    def holds(self, q: Array, target: float, slack: Array) -> Array:
        A, room = self.polynomial.evaluate(q), target * np.eye(len(slack)) - slack
        return positive_definite(room - A) & (self.positive or positive_definite(room + A))

    @cached_property
    def modes(self) -> Array:
        L = self.scale()
        inverse = np.linalg.inv(L)
        _, s, vh = np.linalg.svd(inverse @ self.polynomial.coefficients @ inverse.T)
        return np.asarray(L @ np.einsum("mki,mk,mkj->mij", vh.conj(), s, vh).real @ L.T)

    def scale(self) -> Array:
        """Factor L of the matrix L L^T to which bounds of modes are relative."""
        return np.eye(self.polynomial.coefficients.shape[-1])

    def slack(self, weights: Array) -> Array:
        return np.asarray(np.tensordot(weights, self.modes, 1) + self.error * np.eye(self.modes.shape[-1]))

    def importance(self, q: Array) -> Array:
        value, vectors = np.linalg.eigh(self.polynomial.evaluate(q[None])[0])
        v, L = vectors[:, self.extreme(value)], self.scale()
        inverse = np.linalg.inv(L)
        whole = np.trace(inverse @ self.modes @ inverse.T, axis1=1, axis2=2) * ((L.T @ v) ** 2).mean()
        return np.asarray(v @ self.modes @ v + ELSEWHERE * whole)

    def extreme(self, values: Array) -> int:
        """Index of the eigenvalue that phi is."""
        return int(abs(values).argmax())

    @cached_property
    def size(self) -> float:
        return float(np.linalg.eigvalsh(self.modes.sum(axis=0))[-1])


@dataclass
class LargestOfInverse(Norm):
    """Largest w^T M^-1 w over unit vectors w in the range of a projection P; for P = 1, 1 / least eigenvalue of M.

    It is at most t where M - P / t is positive definite. Slacks are relative to the harmonic mean of M over `samples`,
    so that they are small in directions in which M is.
    """

    samples: Array
    projection: Array
    size = np.inf

    def rounding(self, value: float) -> float:
        return value**2 * (ROUNDING * float(np.linalg.eigvalsh(self.modes.sum(axis=0))[-1]) + self.error)

    def values(self, q: Array) -> Array:
        """Values at positions, infinite where M is singular to working precision."""
        M = self.polynomial.evaluate(q)
        valid = positive_definite(M)
        inverse = np.linalg.inv(np.where(valid[:, None, None], M, np.eye(M.shape[-1])))
        return np.where(valid, np.linalg.eigvalsh(self.projection @ inverse @ self.projection)[:, -1], np.inf)

    def holds(self, q: Array, target: float, slack: Array) -> Array:
        return positive_definite(self.polynomial.evaluate(q) - (slack + self.projection / target))

    def scale(self) -> Array:
        inverse = np.linalg.inv(self.polynomial.evaluate(self.samples)).mean(axis=0)
        return np.asarray(np.linalg.cholesky(np.linalg.inv(inverse)))

    def extreme(self, values: Array) -> int:
        return 0


class Coriolis(Criterion):
    """Largest |C(q, v) w| over unit vectors v and w; A = c_ijk has shape (N, n, n, n), the torque's index last.

    It is attained at v = w, because u^T C(q, v) w is symmetric in v and w for each u. The square of |C(q, v) v| is a
    form of degree 4 in v, bounded by the largest eigenvalue of its symmetric tensor, written as a matrix.
    """

    of_value = 60_000  # of a dozen eigenvectors

    @cached_property
    def _pairs(self) -> tuple[Array, Array, Array]:
        i, j = np.triu_indices(self.polynomial.coefficients.shape[-1])
        return i, j, np.where(i == j, 1.0, np.sqrt(2))

    def values(self, q: Array) -> Array:
        """Larger result of two searches: the first direction of c may be a saddle, where a search makes no step."""
        c = self.polynomial.evaluate(q)
        sizes, directions = np.linalg.eigh(np.einsum("nijk,nljk->nil", c, c))
        every = (directions @ np.sqrt(np.maximum(sizes, 0))[..., None]).squeeze(-1)
        every /= np.maximum(np.linalg.norm(every, axis=1), np.finfo(float).tiny)[:, None]
        return np.maximum(self._searched(c, directions[:, :, -1]), self._searched(c, every))

    def _searched(self, c: Array, v: Array) -> Array:
        """Alternating, monotone search: u = C(q, v) v / |C(q, v) v|, then v the eigenvector of u^T C(q, v) v."""
        for _ in range(5):
            u = self._torque(c, v)
            u /= np.maximum(np.linalg.norm(u, axis=1), np.finfo(float).tiny)[:, None]
            value, vectors = np.linalg.eigh((c @ u[:, None, :, None]).squeeze(-1))
            v = vectors[range(len(v)), :, abs(value).argmax(axis=1)]
        return np.asarray(np.linalg.norm(self._torque(c, v), axis=1))

    @staticmethod
    def _torque(c: Array, v: Array) -> Array:
        return np.asarray(np.einsum("nj,njk->nk", v, (v[:, None, None] @ c).squeeze(2)))

    def of_test(self, n: int) -> float:
        return 2.0 * n**5 + (n * (n + 1) / 2) ** 3 / 3

    def holds(self, q: Array, target: float, slack: float) -> Array:
        if slack >= target:
            return np.zeros(len(q), dtype=bool)
        c, room = self.polynomial.evaluate(q), (target - slack) ** 2
        rows, (i, _, _) = self._rows(c), self._pairs
        holds = positive_definite(room * np.eye(c.shape[-1]) - np.swapaxes(rows, 1, 2) @ rows)
        holds[~holds] = positive_definite(room * np.eye(len(i)) - self._form(c[~holds]))
        return holds

    def _rows(self, c: Array) -> Array:
        """Weighted c_ijk, i <= j, whose largest singular value is over all symmetric matrices, not only v v^T."""
        i, j, weight = self._pairs
        return np.asarray(c[:, i, j] * weight[:, None])

    def _form(self, c: Array) -> Array:
        """Symmetric matrix of |c_ijk v_i v_j|^2 in the weighted products v_i v_j, i <= j, a vector of unit length."""
        n, (i, j, weight) = c.shape[-1], self._pairs
        c = c.reshape(-1, n * n, n)
        T = (c @ np.swapaxes(c.conj(), 1, 2)).real.reshape(len(c), n**4)
        I, J = i[:, None], j[:, None]
        places = [np.ravel_multi_index(p, (n,) * 4) for p in ((I, J, i, j), (I, i, J, j), (I, j, J, i))]
        return np.asarray((T[:, places[0]] + T[:, places[1]] + T[:, places[2]]) * (np.outer(weight, weight) / 3))

    def moduli(self, arrays: Array) -> Array:
        parts = np.array_split(arrays, 1 + len(arrays) // 1000)
        squares = [np.linalg.eigvalsh(self._form(part))[:, -1] for part in parts]
        return np.asarray(np.sqrt(np.maximum(np.concatenate(squares), 0)))

    @cached_property
    def grid_coefficients(self) -> Array:
        return self._rows(self.polynomial.coefficients)

    def ratio(self, arrays: Array, on: Array, weights: Array, known: float) -> float:
        """Ratio by the largest singular values of `_rows`, found only where the Frobenius norm, a bound, is large."""
        size = float(weights @ self.modes[on])
        frobenius = np.linalg.norm(arrays, axis=(1, 2)) / size
        order = np.argsort(-frobenius)
        for part in np.array_split(order, 1 + len(order) // AT_ONCE):
            if frobenius[part[0]] <= known:
                break
            squares = np.linalg.eigvalsh(arrays[part].swapaxes(1, 2) @ arrays[part])[:, -1]
            known = max(known, float(np.sqrt(squares.max())) / size)
        return known


@dataclass
class Torque(Criterion):
    """Largest torque of joint k within bounds of rates and accelerations.

    A holds, side by side: the gravity torque g(q), for `values` only; a, b and c of g = a + b cos q_1 + c sin q_1 if
    nothing else depends on q_1, otherwise g, 0, 0; row k of M; the factors of v_i v_j, i <= j. Over a full turn
    b cos q_1 + c sin q_1 is at most (b^2 + c^2)^1/2. M qdd is largest at +-accelerations. The quadratic form of the
    rates is convex in each rate whose diagonal factor is not negative; without negative ones it is largest at +-rates.
    """

    rates: Array
    accelerations: Array
    of_value = 20_000

    @cached_property
    def error(self) -> float:
        """Bound of the rounding error of the torque."""
        g, fixed, c = self._parts(self.polynomial.terms[None])
        return ROUNDING * float(g[0, 0] + fixed[0] + c.sum() * self.rates.max() ** 2)

    @cached_property
    def _signs(self) -> Array:
        return half_of_corners(len(self.rates))

    @cached_property
    def _products(self) -> Array:
        """Products of two rates, i <= j, at these corners, shape (n (n + 1) / 2, 2^(n - 1))."""
        i, j = np.triu_indices(len(self.rates))
        corners = self._signs * self.rates
        return np.asarray((corners[:, i] * corners[:, j]).T)

    def of_test(self, n: int) -> float:
        return 2.0 * self._products.size

    def _parts(self, A: Array) -> tuple[Array, Array, Array]:
        """Gravity's a, the bound of terms that do not depend on the rates, and the factors C_k."""
        inertial, c = A[:, 4 : len(self.rates) + 4], A[:, len(self.rates) + 4 :]
        return A[:, 1:2], np.linalg.norm(A[:, 2:4], axis=1) + abs(inertial) @ self.accelerations, c

    def values(self, q: Array) -> Array:
        A = self.polynomial.evaluate(q)
        _, inertial, c = self._parts(A * (np.arange(A.shape[1]) > 3))
        high, low = np.split(self._largest_form(np.concatenate([c, -c])), 2)
        return np.asarray(inertial + np.maximum(high + A[:, 0], low - A[:, 0]))

    def _largest_form(self, c: Array) -> Array:
        """Largest quadratic form found: from the best corner, each rate in turn goes to its best value in its range."""
        i, j = np.triu_indices(len(self.rates))
        v = self._signs[(c @ self._products).argmax(axis=1)]  # rates over their largest values
        c = c * self._products[:, 0]
        mixed = np.zeros((len(c), len(self.rates), len(self.rates)))
        mixed[:, i, j] = mixed[:, j, i] = np.where(i == j, 0.0, c)
        bend = np.maximum(-2 * c[:, i == j], TINY)
        for k in [*range(len(self.rates))] * SWEEPS:
            slope = np.einsum("ij,ij->i", mixed[:, k], v)
            v[:, k] = np.clip((slope + np.copysign(np.sqrt(TINY), slope)) / bend[:, k], -1, 1)
        return np.asarray((c * v[:, i] * v[:, j]).sum(axis=1))

    def holds(self, q: Array, target: float, slack: float) -> Array:
        g, fixed, c = self._parts(self.polynomial.evaluate(q))
        room = target - slack - fixed
        holds = abs(g[:, 0]) + abs(c) @ abs(self._products[:, 0]) <= room  # without cancellation
        rest, squares = self._rest(g[~holds], c[~holds])
        high = rest.max(axis=1) + np.maximum(squares, 0).sum(axis=1)
        low = rest.min(axis=1) + np.minimum(squares, 0).sum(axis=1)
        holds[~holds] = np.maximum(high, -low) <= room[~holds]
        return np.asarray(holds)

    def _rest(self, g: Array, c: Array) -> tuple[Array, Array]:
        """Gravity and mixed terms of the form at the corners, and its terms of squared rates."""
        i, j = np.triu_indices(len(self.rates))
        squares = c[:, i == j] * self.rates**2
        return g + c @ self._products - squares.sum(axis=1)[:, None], squares

    def moduli(self, arrays: Array) -> Array:
        g, fixed, c = self._parts(arrays)
        rest, squares = self._rest(g, c)
        return np.asarray(fixed + abs(rest).max(axis=1) + abs(squares).sum(axis=1))
