"""Residual torques of a model, and the reduction by further columns.

`Discrepancy` judges columns, whether the torques are residuals of a fit to measurements (`FitResiduals`) or differences
of two models (`compare_models`).
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property
from typing import Any

import numpy as np

from ...basics.filters import impulse_response, settling
from ...basics.inertia import PARAMETERS
from ...basics.spatial import Array
from ...dynamics.base_inertial_parameters import BaseParameters
from ...errors import NotFiniteError
from ...robot import Robot
from .. import thresholds
from ..fit.equations import RegressionData, blocks_of_time

Torques = Callable[[Array, Array, Array], Array]  # a function of q, qd, qdd, each of shape (T, n)


class Discrepancy:
    """Residual torques of a model over the noise `sigma` of their joint, at the rows and joints that are `used`."""

    left: Array  # torques over their noise, shape (R,), orthogonal to Q
    Q: Array  # orthonormal columns fitted in any case, shape (R, k)
    counts: Array  # number of independent equations of each joint, shape (n,)
    floor: Array  # sum of squares of each joint that needs no explanation, shape (n,)
    resolution: tuple[float, float]  # numerical resolution relative to a joint's values; to a column
    correlation = 1.0  # factor of variances for correlated residuals
    bodies: Array  # inertial parameters, shape (10 nb,)

    def __init__(self, robot: Robot, sigma: Array, used: Array) -> None:
        self.robot, self.names, self.sigma, self.used = robot, robot.joint_names, sigma, used
        self.row, self.joint = np.nonzero(used)  # of each value

    def sampled(self, torques: Torques) -> Array:
        """Values of a function of the motion, shape (T, ...), at the rows, shape (rows, ...)."""
        raise NotImplementedError

    def load(self, q: Array, qd: Array, qdd: Array) -> Array:
        """Torques of the bodies, shape (T, n)."""
        torques: Array = self.robot.inverse_dynamics(q, qd, qdd, parameters=self.bodies)
        return torques

    def of_each_joint(self, torques: Torques) -> Array:
        """Torque of each joint as a function of its own q, qd and qdd, as columns, shape (rows, n, n)."""
        return by_joint(self.sampled(torques)[..., None])

    @cached_property
    def of_joint(self) -> Array:
        """Indicator of the values of each joint, shape (n, R)."""
        return np.equal.outer(np.arange(self.robot.n), self.joint).astype(float)

    @cached_property
    def squares(self) -> Array:
        """Sum of squares of each joint's residual, shape (n,)."""
        return self.by_joint(self.left)

    def weighted(self, columns: Array, sigma: Array | None = None) -> Array:
        """Values of the used rows, from shape (rows, n, ...), over the noise of their joint, shape (R, ...)."""
        scale = (self.sigma if sigma is None else sigma).reshape(-1, *(1 for _ in columns.shape[2:]))
        found: Array = (columns / scale)[self.used]
        return found

    def by_joint(self, r: Array, s: Array | None = None) -> Array:
        """Sums of products, or of squares, over each joint's values, shape (n,)."""
        return np.bincount(self.joint, r * (r if s is None else s), minlength=self.robot.n)

    def gain(self, squares: Array, before: Array | None = None) -> float:
        """Gain of log likelihood by a fit with these residual squares."""
        start = self.squares if before is None else before
        return float(0.5 * (self.counts * np.log((start + self.floor) / (squares + self.floor))).sum())

    def penalty(self, numbers: float) -> float:
        """Penalty of the log likelihood for free numbers (Schwarz 1978)."""
        return 0.5 * numbers * float(np.log(max(self.counts.sum(), 2.0)))

    def with_columns(self, X: Array) -> tuple[Array, Array, Array, int]:
        """Fit of columns, shape (rows, n, k): coefficients, standard errors, residuals (R,), and rank.

        Columns may be `weighted` already, shape (R, k).
        """
        X = X if X.ndim == 2 else self.weighted(X)
        left, (of_joint, of_all) = X - self.Q @ (self.Q.T @ X), self.resolution
        parts, given = (self.of_joint @ x**2 for x in (left, X))  # shape (n, k)
        doubt = np.maximum(of_joint**2 * given, of_all**2 * given.sum(0))
        left = left * (parts > np.maximum(doubt, thresholds.TINY))[self.joint]
        lengths = np.linalg.norm(left, axis=0)
        known = lengths > 0
        c, errors, rank = np.zeros(X.shape[1]), np.full(X.shape[1], np.inf), 0
        if known.any():
            U, S, V = np.linalg.svd(left[:, known] / lengths[known], full_matrices=False)
            rank = int((thresholds.RANK * S[0] < S).sum())
            back = V[:rank].T / S[:rank]
            c[known] = back @ (U[:, :rank].T @ self.left) / lengths[known]
            errors[known] = np.linalg.norm(back, axis=1) / lengths[known]
        return c, np.sqrt(self.correlation) * errors, self.left - left @ c, rank

    def with_numbers(self, X: Array, numbers: str) -> tuple[Array, Array, Array, int]:
        """Fit of the numbers of a hypothesis, here all of them; results of `with_columns`."""
        return self.with_columns(X)


class FitResiduals(Discrepancy):
    """Residuals of the equations Y x = tau of records, fitted by base parameters `beta`.

    The correlation time of the residuals may be given. Columns that are `known`, shape (rows, n, k), are fitted too;
    what they explain needs no cause.
    """

    resolution = thresholds.APART, thresholds.INDEPENDENT

    def __init__(
        self,
        robot: Robot,
        base: BaseParameters,
        data: RegressionData,
        beta: Array,
        sigma: Array,
        correlation_time: Array | None = None,
        known: Array | None = None,
        used: Array | None = None,
    ) -> None:
        enough = data.sure.sum() > thresholds.FEWEST_ROWS * base.count
        bare = robot.with_armature(0.0) if robot.model.armature.any() else robot  # rotors are drives' parameters
        super().__init__(bare, sigma, (data.sure if enough else data.used) if used is None else used)
        self.turned: dict[tuple[bytes, bytes], Array] = {}  # columns where joints are J q at the rows used, by both
        self.data, self.beta, self.known = data, beta, known
        self.base, self.standard, self.records, self.x = base, base.standard, data.prepared, base.back @ beta
        self.bodies = self.x[: PARAMETERS * robot.model.nb]
        time = data.correlation_time(data.residuals(self.x)) if correlation_time is None else correlation_time
        self.correlation_time, self.correlation = time, float(time.max(initial=1))
        self.tau, self.Y, lengths = data.tau, data.Y, [len(record.times) for record in data.prepared]
        self.record = np.repeat(np.arange(len(lengths)), lengths)  # number of each row's record
        self.A = self.weighted(self.Y @ base.back)
        self.Q = orthonormal(self.A)
        if known is not None:
            self.Q = extended(self.Q, self.weighted(known))
        b = self.weighted(self.tau)
        self.left = b - self.Q @ (self.Q.T @ b)
        self.counts = np.bincount(self.joint, minlength=robot.n) / self.correlation_time
        self.torques = np.maximum(self.by_joint(b), thresholds.TINY)
        self.floor = thresholds.LEAST**2 * self.torques

    def load(self, q: Array, qd: Array, qdd: Array, x: Array | None = None) -> Array:
        """Torques of bodies and springs for standard parameters x, by default the fit's, shape (T, n)."""
        x = self.x if x is None else x
        bodies: Array = self.robot.inverse_dynamics(q, qd, qdd, parameters=x[self.standard.groups["bodies"]])
        return bodies + self.standard.spring_torques(q, x)

    def with_known(self, columns: Array) -> FitResiduals:
        """Residuals with more columns fitted in any case."""
        known = columns if self.known is None else np.concatenate([self.known, columns], axis=-1)
        return self._with(self.sigma, self.correlation_time, known, self.used)

    def _with(self, sigma: Array, correlation_time: Array, known: Array | None, used: Array) -> FitResiduals:
        found = FitResiduals(self.robot, self.base, self.data, self.beta, sigma, correlation_time, known, used)
        found.turned = self.turned  # of the same parameters
        return found

    @cached_property
    def beyond_friction(self) -> FitResiduals:
        """Residuals with the friction of real gears fitted, which rises with the load and is curved over speed.

        Noise and correlation time are taken from the residuals of that fit.
        """
        known = by_joint(self.curves)
        if len(self.joint) < thresholds.FEWEST_ROWS * (self.base.count + known.shape[-1]):
            return self
        left = np.zeros(self.tau.shape)
        left[self.used] = values = self.with_columns(known)[2]
        squares = np.maximum(self.by_joint(values), self.floor) / np.maximum(self.used.sum(0), 1)
        sigma = np.where(squares > 0, self.sigma * np.sqrt(squares), self.sigma)
        time = self.data.correlation_time(left, self.used)
        return self._with(sigma, time, known, self.used)

    @cached_property
    def curves(self) -> Array:
        """Friction curves of each joint in addition to the parameters, at the rows, shape (rows, n, 4)."""
        return self.sampled(lambda q, qd, qdd: self.friction_curves(q, qd, qdd, self.x))

    def friction_curves(self, q: Array, qd: Array, qdd: Array, x: Array) -> Array:
        """Friction that rises with the load, with speed squared, and towards rest, shape (T, n, 4).

        The load is that of `StandardParameters`, in the last column without rotors, which act before the gears.
        """
        sign, speed, load = np.sign(qd), np.abs(qd), self.load(q, qd, qdd, x)
        slow = np.exp(-speed / np.maximum(thresholds.SLOW * self.fastest, thresholds.TINY))
        with_rotors = load + self.standard.rotor_torques(qdd, x)
        return np.stack([np.abs(with_rotors) * sign, qd * speed, slow * sign, np.abs(load) * sign], axis=-1)

    @cached_property
    def fastest(self) -> Array:
        """Largest speeds, shape (n,)."""
        return np.asarray(np.max([np.abs(record.qd).max(0) for record in self.records], axis=0))

    @property
    def share(self) -> float:
        """Largest unexplained share of a joint's torques."""
        return float(np.sqrt((self.squares / self.torques).max(initial=0)))

    @cached_property
    def blocks(self) -> Array:
        """Validation block of each row, at least as many as the fit's, shape (rows,)."""
        each = max(len(self.data.fitted.factors), thresholds.FOLDS) // len(self.records)
        each = min(each, *(len(record.times) for record in self.records))
        lengths = [block.stop - block.start for block in blocks_of_time(self.records, each)]
        return np.repeat(np.arange(len(lengths)), lengths)

    @cached_property
    def short_blocks(self) -> Array:
        """Short validation block of each row, in turn, for single events, shape (rows,)."""
        rows = int(np.ceil(thresholds.SHORT_BLOCK * self.correlation_time.max(initial=1)))
        return np.arange(len(self.tau)) // rows % thresholds.FOLDS

    def held_out(self, Q: Array, b: Array, blocks: Array) -> Array:
        """Squared validation errors of each block relative to the joint's |measured|^2, (blocks, n).

        b, shape (R,), is predicted by orthonormal columns Q; measured are the torques of all blocks.
        """
        left, whole, unit = np.zeros(len(b)), Q.T @ b, (1 + thresholds.DEPENDENT) * np.eye(Q.shape[1])
        block, n = blocks[self.row], self.robot.n
        for part in (block == k for k in np.unique(block)):
            left[part] = b[part] - Q[part] @ np.linalg.solve(unit - Q[part].T @ Q[part], whole - Q[part].T @ b[part])
        squares = np.bincount(block * n + self.joint, left**2, minlength=n * (int(blocks.max(initial=0)) + 1))
        return np.asarray(squares.reshape(-1, n) / np.maximum(self.by_joint(b), thresholds.TINY))

    @cached_property
    def errors(self) -> tuple[Array, Array]:
        """Squared validation errors without further columns, for long and for short blocks, shape (blocks, n) each."""
        b = self.weighted(self.tau)
        return self.held_out(self.Q, b, self.blocks), self.held_out(self.Q, b, self.short_blocks)

    def refitted(self, columns: Array, tau: Array) -> tuple[Array, Array, Array]:
        """Fit of columns, shape (rows, n, k): coefficients, noise of each joint, remaining shares of its squares.

        Each joint is weighted by its remaining squares, as noise is unknown under a wrong model; by normal equations.
        """
        X, b, rows = np.swapaxes(columns * self.used[..., None], 0, 1), (tau * self.used).T, self.used.sum(0)
        G, c, squares = np.swapaxes(X, 1, 2) @ X, (b[:, None] @ X)[:, 0], np.maximum((b * b).sum(1), thresholds.TINY)
        left = np.ones(len(b))
        for _ in range(thresholds.REWEIGHTINGS):
            weights = 1 / (squares * np.maximum(left, thresholds.LEAST**2))
            whole = np.tensordot(weights, G, 1)
            unit = np.sqrt(np.maximum(np.diag(whole), thresholds.TINY))
            whole = whole / np.outer(unit, unit) + thresholds.DEPENDENT * np.eye(len(unit))
            x = np.linalg.solve(whole, weights @ c / unit) / unit
            left = np.maximum(squares - 2 * c @ x + G @ x @ x, 0) / squares
        return x, np.sqrt(np.maximum(1 / weights / np.maximum(rows, 1), thresholds.TINY)), left

    @cached_property
    def coarse(self) -> FitResiduals:
        """Residuals at some of the rows, for changes of all columns."""
        step = max(1, int(self.used.sum() / (thresholds.COARSE * self.base.count)))
        used = self.used & (np.arange(len(self.used)) % step == 0)[:, None]
        return self._with(self.sigma, self.correlation_time / step, self.known, used)

    def moved(self, J: Array, tau: Array) -> Array:
        """Columns of a fit to torques where the joints are J q, with known friction, shape (rows, n, k)."""
        if (np.eye(len(J)) == J).all():
            own = self.Y[..., self.base.independent]
            return own if self.known is None else np.concatenate([own, self.known], axis=-1)

        def columns(q: Array, qd: Array, qdd: Array) -> tuple[Array, ...]:
            Y = self.robot.regressor(q, qd, qdd)
            load = self.standard.load(Y, q, qdd, self.x)
            return Y, self.standard.drive_columns(qd, qdd, load), self.standard.spring_columns(q)

        rows = self.used.any(1)
        key, X = (J.tobytes(), rows.tobytes()), np.zeros((*self.tau.shape, self.base.count))
        try:
            if key not in self.turned:
                whole = self.near_rows(lambda *motion: columns(*(x @ J.T for x in motion)))
                self.turned[key] = whole[rows][..., self.base.independent]
        except NotFiniteError:  # where joints that follow others have no position
            return X
        X[rows] = self.turned[key]
        if self.known is None:
            return X
        values = self.base.back @ self.refitted(X, tau)[0]

        def curves(q: Array, qd: Array, qdd: Array) -> Array:
            return self.friction_curves(q @ J.T, qd @ J.T, qdd @ J.T, values)

        known = by_joint(self.near_rows(curves))
        return np.concatenate([X, known], axis=-1)

    def held_out_moved(self, J: Array, tau: Array) -> Array:
        """Squared validation errors of fits with joints J q, weighted as in `refitted`, shape (blocks, n)."""
        columns = self.moved(J, tau)
        sigma = self.refitted(columns, tau)[1]
        return self.held_out(orthonormal(self.weighted(columns, sigma)), self.weighted(tau, sigma), self.blocks)

    @cached_property
    def held_out_as_given(self) -> Array:
        """Squared validation errors of fits with the joints as given, shape (blocks, n)."""
        return self.held_out_moved(np.eye(self.robot.n), self.tau)

    def covariance_of(self, columns: Array) -> Array:
        """Increase of the base parameters' covariance by fitting the coefficients of these columns too."""
        X = self.weighted(columns)
        along = self.Q.T @ X
        left = X - self.Q @ along
        moved = np.linalg.lstsq(self.Q.T @ self.A, along, rcond=thresholds.NOTHING)[0]
        return np.asarray(self.correlation_time.max() * moved @ np.linalg.pinv(left.T @ left, hermitian=True) @ moved.T)

    def sampled(self, torques: Torques) -> Array:
        """Values of a function of the motion, evaluated at all samples, filtered, at the rows."""
        return np.concatenate([record.reduce(torques(record.q, record.qd, record.qdd)) for record in self.records])

    def near_rows(self, torques: Callable[[Array, Array, Array], Array | tuple[Array, ...]]) -> Array:
        """Values of a function evaluated only near the rows used, zero at others; 1 % of a step change is lost.

        Several columns, shape (T, n, k) each, are joined.
        """
        found: list[Array] = []
        for record, (rows, samples, weights) in zip(self.records, self.filters, strict=True):
            values = torques(*(x[samples] for x in (record.q, record.qd, record.qdd)))
            parts = []
            for x in values if isinstance(values, tuple) else (values,):
                flat, part = x.reshape(len(samples), -1), np.zeros((len(record.times), *x.shape[1:]))
                felt = np.flatnonzero(flat.any(axis=0))  # most bodies do not act on a joint
                part.reshape(len(part), -1)[rows[:, None], felt] = weights @ flat[:, felt]
                parts.append(part)
            found.append(np.concatenate(parts, axis=-1) if isinstance(values, tuple) else parts[0])
        return np.concatenate(found)

    @cached_property
    def filters(self) -> list[tuple[Array, Array, Any]]:
        """Used rows of each record, samples around them, and the filter weights of these samples."""
        from scipy.sparse import csr_matrix

        found = []
        for record, part in zip(self.records, self.data.parts, strict=True):
            reach, rows = settling(record.cutoff, record.sample_rate), np.flatnonzero(self.used[part].any(1))
            response = impulse_response(record.cutoff, record.sample_rate, reach)
            step = max(1, int(record.sample_rate / (thresholds.THINNED * record.cutoff)))
            places = record.row_samples[rows][:, None]
            near = places // step * step + step * np.arange(-(reach // step), reach // step + 1)
            weights = np.where(np.abs(near - places) > reach, 0, response[(near - places).clip(-reach, reach) + reach])
            samples, column = np.unique(near.clip(0, len(record.t) - 1), return_inverse=True)
            entries = weights / weights.sum(1, keepdims=True), column.reshape(near.shape)
            begins = near.shape[1] * np.arange(len(rows) + 1)
            filters = csr_matrix((*(x.ravel() for x in entries), begins), shape=(len(rows), len(samples)))
            found.append((rows, samples, filters))
        return found

    @cached_property
    def delay_column(self) -> Array:
        """Derivative of measured torques with respect to their delay after the positions, shape (rows, n, 1)."""
        parts = []
        for record in self.records:
            load, x = self.load(record.q, record.qd, record.qdd), self.x
            with_rotors = load + self.standard.rotor_torques(record.qdd, x)
            values = load + self.standard.drive_torques(record.qd, record.qdd, x[len(self.bodies) :], with_rotors)
            slopes = [np.gradient(values[part], record.t[part], axis=0) for part in record.segments]
            parts.append(record.reduce(np.concatenate(slopes)))
        return -np.concatenate(parts)[..., None]


def extended(Q: Array, X: Array) -> Array:
    """Orthonormal basis of the columns of Q and X, without rounding."""
    left = X - Q @ (Q.T @ X)
    left -= Q @ (Q.T @ left)
    own, R = np.linalg.qr(left / np.maximum(np.linalg.norm(X, axis=0), thresholds.TINY))
    U, S, _ = np.linalg.svd(R, full_matrices=False)
    return np.concatenate([Q, own @ U[:, thresholds.INDEPENDENT < S]], axis=1)


def orthonormal(X: Array) -> Array:
    """Orthonormal basis of the columns of X, without directions due to rounding, which QR would keep."""
    return extended(X[:, :0], X)


def by_joint(values: Array) -> Array:
    """Columns of torques of one joint each, shape (rows, n, n k), from values of shape (rows, n, k)."""
    rows, n, k = values.shape
    return np.asarray((values[:, :, None] * np.eye(n)[:, :, None]).reshape(rows, n, n * k))
