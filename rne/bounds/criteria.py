"""Constants of stability theorems as convex functions of polynomial arrays: values attained, and tests with slack."""

from __future__ import annotations

import itertools
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, ClassVar

import numpy as np

from ..basics.spatial import Array
from .polynomials import Polynomial

# Of the terms added: what recursions (20 eps), coefficients and pivots of matrices up to order 36 may err by.
ROUNDING = 2000 * float(np.finfo(float).eps)

AT_ONCE = 500  # arrays of which the norm is found
SWEEPS = 2  # over the rates, in search of a largest torque
TINY = 1e-300
ELSEWHERE = 0.1  # importance of directions other than that of the extreme eigenvalue


def positive_definite(A: Array) -> Array:
    """True where all pivots are positive, of matrices (N, n, n)."""
    a = np.array(np.moveaxis(A, 0, -1), order="C")  # a copy, of one matrix too
    sound = np.ones(len(A), dtype=bool)
    with np.errstate(all="ignore"):
        for k in range(len(a)):
            sound &= a[k, k] > 0
            for i in range(k + 1, len(a)):
                a[i, k + 1 : i + 1] -= a[i, k] / a[k, k] * a[k + 1 : i + 1, k]
    return sound


@dataclass
class Criterion:
    """The largest value of a convex function phi of a polynomial array A(q)."""

    polynomial: Polynomial
    ratios: dict[tuple[int, int], float] = field(default_factory=dict, init=False)  # known, of groups and coordinates
    has_ratios: ClassVar[bool] = True
    time_model: ClassVar[tuple[float, float]] = (0.3, 2.5)  # least next gap / gap; work is about gap^-exponent
    of_value: ClassVar[int] = 0  # operations of `values` beside those of `holds`, for each position

    def values(self, q: Array) -> Array:
        """Values attained at positions, shape (N,)."""
        raise NotImplementedError

    def counted(self, q: Array, clock: Any) -> Array:
        """Values, as work of a clock."""
        clock.count(len(q) * (self.operations + self.of_value))
        return self.values(q)

    @cached_property
    def operations(self) -> float:
        """Of `holds`, for each position."""
        return self.polynomial.operations + self.of_test(self.polynomial.coefficients.shape[-1])

    def of_test(self, n: int) -> float:
        """Operations of a test beside those of the array, whose last axis is n."""
        return n

    def holds(self, q: Array, target: float, slack: Any) -> Array:
        """True where phi(A + E) is certainly at most `target` for every E that the slack bounds, shape (N,)."""
        return np.asarray(self.values(q) <= target - slack)

    @cached_property
    def modes(self) -> Array:
        """What bounds the real part of a mode times any phase: phi of its modulus, shape (modes,)."""
        return self.moduli(self.polynomial.coefficients)

    def moduli(self, arrays: Array) -> Array:
        """A bound of phi of the real part of each array times any phase, shape (N,)."""
        raise NotImplementedError

    @cached_property
    def grid_coefficients(self) -> Array:
        """Coefficients of the arrays that are formed on grids, for `ratio`."""
        return self.polynomial.coefficients

    def ratio(self, arrays: Array, on: Array, weights: Array, known: float) -> float:
        """The largest phi of arrays over the weighted sum of modes `on`; `known` is that of arrays before."""
        return max(known, float(self.moduli(arrays).max() / (weights @ self.modes[on])))

    def slack(self, weights: Array) -> Any:
        """A bound of the sum of modes, each times a number of modulus at most its weight (modes,)."""
        return float(weights @ self.modes) + self.error

    def importance(self, q: Array) -> Array:
        """Share of each mode in the slack at a maximum, for the choice of the next coordinate, shape (modes,)."""
        return self.modes

    @cached_property
    def size(self) -> float:
        """A bound of phi at every position."""
        return float(self.modes.sum())

    @cached_property
    def error(self) -> float:
        """A bound of the rounding of phi(A)."""
        return ROUNDING * float(np.linalg.norm(self.polynomial.terms))

    def rounding(self, value: float) -> float:
        """A bound of the error of a computed value."""
        return ROUNDING * self.size + self.error


class Modulus(Criterion):
    """The Euclidean norm of a vector or the modulus of a number, A of shape (N, m)."""

    def values(self, q: Array) -> Array:
        return np.asarray(np.linalg.norm(self.polynomial.evaluate(q), axis=1))

    def moduli(self, arrays: Array) -> Array:
        return np.asarray(np.linalg.norm(arrays, axis=1))


@dataclass
class Norm(Criterion):
    """The largest modulus of the eigenvalues of a symmetric matrix. Slacks are matrices.

    For a complex symmetric c and any phase, the real part of exp(i phase) v^T c v is at most v^T Re (c^* c)^1/2 v, by
    Takagi's factorisation. Of a matrix known to be `positive` definite only the largest eigenvalue is looked at.
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
        """L of the matrix L L^T relative to which modes are bounded."""
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
        """The eigenvalue that is judged."""
        return int(abs(values).argmax())

    @cached_property
    def size(self) -> float:
        return float(np.linalg.eigvalsh(self.modes.sum(axis=0))[-1])


@dataclass
class LargestOfInverse(Norm):
    """The largest w^T M^-1 w of unit vectors w that a projection P keeps: 1 / the least eigenvalue of M for P = 1.

    It is at most t where M - P / t is positive definite. Slacks are relative to the harmonic mean of M(samples): small
    where M is.
    """

    samples: Array
    projection: Array
    size = np.inf

    def rounding(self, value: float) -> float:
        return value**2 * (ROUNDING * float(np.linalg.eigvalsh(self.modes.sum(axis=0))[-1]) + self.error)

    def values(self, q: Array) -> Array:
        """Infinite where M is singular but for rounding."""
        M = self.polynomial.evaluate(q)
        sound = positive_definite(M)
        inverse = np.linalg.inv(np.where(sound[:, None, None], M, np.eye(M.shape[-1])))
        return np.where(sound, np.linalg.eigvalsh(self.projection @ inverse @ self.projection)[:, -1], np.inf)

    def holds(self, q: Array, target: float, slack: Array) -> Array:
        return positive_definite(self.polynomial.evaluate(q) - (slack + self.projection / target))

    def scale(self) -> Array:
        inverse = np.linalg.inv(self.polynomial.evaluate(self.samples)).mean(axis=0)
        return np.asarray(np.linalg.cholesky(np.linalg.inv(inverse)))

    def extreme(self, values: Array) -> int:
        return 0


class Coriolis(Criterion):
    """The largest |C(q, v) w| of unit vectors v and w, A = c_ijk of shape (N, n, n, n), torques last.

    It is attained at v = w, because for each u the form u^T C(q, v) w of v and w is symmetric. The square of
    |C(q, v) v| is a form of degree 4 in v, which the largest eigenvalue of its symmetric tensor, as a matrix, bounds.
    """

    of_value = 60_000  # of a dozen eigenvectors

    @cached_property
    def _pairs(self) -> tuple[Array, Array, Array]:
        i, j = np.triu_indices(self.polynomial.coefficients.shape[-1])
        return i, j, np.where(i == j, 1.0, np.sqrt(2))

    def values(self, q: Array) -> Array:
        """The larger of two searches: the first direction of c may be a saddle, where a search makes no step."""
        c = self.polynomial.evaluate(q)
        sizes, directions = np.linalg.eigh(np.einsum("nijk,nljk->nil", c, c))
        every = (directions @ np.sqrt(np.maximum(sizes, 0))[..., None]).squeeze(-1)
        every /= np.maximum(np.linalg.norm(every, axis=1), np.finfo(float).tiny)[:, None]
        return np.maximum(self._searched(c, directions[:, :, -1]), self._searched(c, every))

    def _searched(self, c: Array, v: Array) -> Array:
        """By turns u = C(q, v) v / |C(q, v) v| and v, the eigenvector of u^T C(q, v) v: the value does not decrease."""
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
        """c_ijk of i <= j, with weights: its largest singular value is that for all matrices, not v w^T only."""
        i, j, weight = self._pairs
        return np.asarray(c[:, i, j] * weight[:, None])

    def _form(self, c: Array) -> Array:
        """The symmetric matrix of |c_ijk v_i v_j|^2 on the products v_i v_j, i <= j, with weights: of unit length."""
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
        """Of the largest singular values of rows; the Frobenius norm, which is larger, says where to look."""
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
    """The largest torque of a joint under bounds of rates and accelerations.

    A = (gravity, M_k, C_k): gravity's torque at q, for `values` only, and a, b, c of g = a + b cos q_1 + c sin q_1
    where nothing else depends on q_1, otherwise g, 0, 0; row k of M; the factors of v_i v_j, i <= j. Over a full turn b
    cos q_1 + c sin q_1 is at most (b^2 + c^2)^1/2. M qdd is largest at +-accelerations. The quadratic form of the rates
    is convex in each rate where its diagonal is not negative: with the negative part left out it is largest at +-rates.
    """

    rates: Array
    accelerations: Array
    of_value = 20_000

    @cached_property
    def error(self) -> float:
        """A bound of the rounding of the torque."""
        g, fixed, c = self._parts(self.polynomial.terms[None])
        return ROUNDING * float(g[0, 0] + fixed[0] + c.sum() * self.rates.max(initial=0.0) ** 2)

    @cached_property
    def _signs(self) -> Array:
        """Of the rates at half of the corners of their box, shape (2^(n - 1), n)."""
        return np.array(list(itertools.product([1.0], *[[1.0, -1.0]] * (len(self.rates) - 1))))

    @cached_property
    def _products(self) -> Array:
        """Products of the rates i <= j at these corners, shape (n (n + 1) / 2, 2^(n - 1))."""
        i, j = np.triu_indices(len(self.rates))
        corners = self._signs * self.rates
        return np.asarray((corners[:, i] * corners[:, j]).T)

    def of_test(self, n: int) -> float:
        return 2.0 * self._products.size

    def _parts(self, A: Array) -> tuple[Array, Array, Array]:
        """a, what is added whatever the rates are, and C_k."""
        inertial, c = A[:, 4 : len(self.rates) + 4], A[:, len(self.rates) + 4 :]
        return A[:, 1:2], np.linalg.norm(A[:, 2:4], axis=1) + abs(inertial) @ self.accelerations, c

    def values(self, q: Array) -> Array:
        A = self.polynomial.evaluate(q)
        _, inertial, c = self._parts(A * (np.arange(A.shape[1]) > 3))
        high, low = np.split(self._largest_form(np.concatenate([c, -c])), 2)
        return np.asarray(inertial + np.maximum(high + A[:, 0], low - A[:, 0]))

    def _largest_form(self, c: Array) -> Array:
        """Of the rates: from the best corner each rate in turn goes to its best value, inside of its range too."""
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
        """Gravity and products of different rates at the corners, and the terms of squared rates."""
        i, j = np.triu_indices(len(self.rates))
        squares = c[:, i == j] * self.rates**2
        return g + c @ self._products - squares.sum(axis=1)[:, None], squares

    def moduli(self, arrays: Array) -> Array:
        g, fixed, c = self._parts(arrays)
        rest, squares = self._rest(g, c)
        return np.asarray(fixed + abs(rest).max(axis=1) + abs(squares).sum(axis=1))
