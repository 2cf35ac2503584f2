"""What least squares left of measured torques, and what additional columns of the equations would take away of it."""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property
from typing import NamedTuple

import numpy as np

from ...basics.spatial import Array
from ...dynamics.base_inertial_parameters import BaseParameters
from ...model.parameters import PARAMETERS
from ...robot import Robot
from ..fit.equations import RegressionData
from ..log.filtering import low_pass
from ..log.prepared import Prepared
from ..log.screening import consecutive

THINNED = 10.0  # samples per period of the cut-off, at which columns of causes are evaluated
FEWEST = 3  # equations per parameter, from which those beside a rest are left out
LEAST = 1e-3  # residuals below this part of the torques are none
APART = 5e-3  # of a joint's part of a column, which its values on a grid may be off by
INDEPENDENT = 1e-6  # of a column's length, below which nothing of it is independent of the others
SLOW = 0.1  # of a joint's largest speed, up to which friction may rise or fall towards rest
TINY = float(np.finfo(np.float64).tiny)


class Grid(NamedTuple):
    """Fewer samples of a record, for columns that need no more than a few digits."""

    record: Prepared
    step: int
    t: Array
    q: Array
    qd: Array
    qdd: Array
    segments: tuple[slice, ...]

    @classmethod
    def of(cls, record: Prepared) -> Grid:
        """Every so many samples of each segment."""
        step = max(1, int(record.sample_rate / (THINNED * record.cutoff)))
        rows = [np.arange(s.start, s.stop, step) for s in record.segments]
        every, segments = np.concatenate(rows), consecutive(len(r) for r in rows)
        return cls(record, step, record.t[every], record.q[every], record.qd[every], record.qdd[every], segments)

    def reduced(self, values: Array) -> Array:
        """Values on the grid, filtered as torques are, at the times of the record's equations."""
        from scipy.interpolate import CubicSpline

        rate, parts = self.record.sample_rate / self.step, []
        for segment, rows in zip(self.segments, consecutive(self.record.segment_lengths), strict=True):
            smooth = low_pass(values[segment], self.record.cutoff, rate)
            parts.append(CubicSpline(self.t[segment], smooth, axis=0)(self.record.times[rows]))
        return np.concatenate(parts)

    def at_samples(self, values: Array) -> Array:
        """Values on the grid at all samples of the record."""
        from scipy.interpolate import CubicSpline

        pairs = zip(self.segments, self.record.segments, strict=True)
        return np.concatenate([CubicSpline(self.t[a], values[a], axis=0)(self.record.t[b]) for a, b in pairs])

    def rate_of_change(self, values: Array) -> Array:
        """Derivative by time of values at all samples, filtered as torques are."""
        parts = [np.gradient(values[part], self.record.t[part], axis=0) for part in self.record.segments]
        return self.record.reduce(np.concatenate(parts))


class Residuals:
    """What least squares left of the equations Y x = tau of records, over each joint's noise sigma.

    `beta` are base parameters, `correlation_time` is that of the residuals; `known` columns, shape (rows, n, k), are
    fitted too, and what they explain needs no cause.
    """

    def __init__(
        self,
        robot: Robot,
        base: BaseParameters,
        data: RegressionData,
        beta: Array,
        sigma: Array,
        correlation_time: Array | None = None,
        known: Array | None = None,
    ) -> None:
        self.data, self.beta, self.known = data, beta, known
        self.robot, self.base, self.standard, self.records = robot, base, base.standard, data.prepared
        self.x, self.sigma = base.back @ beta, sigma
        time = data.correlation_time(data.residuals(self.x)) if correlation_time is None else correlation_time
        self.correlation_time, self.tau, self.Y = time, data.tau, data.Y
        lengths = [len(record.times) for record in data.prepared]
        self.record = np.repeat(np.arange(len(lengths)), lengths)  # number of each row's record
        self.used = data.sure if data.sure.sum() > FEWEST * base.count else data.used
        self.joint = np.nonzero(self.used)[1]
        self.A = self.weighted(self.Y @ base.back)
        self.Q = np.linalg.qr(self.A)[0]
        if known is not None:
            self.Q = extended(self.Q, self.weighted(known))
        b = self.weighted(self.tau)
        self.left = b - self.Q @ (self.Q.T @ b)
        self.squares = self.by_joint(self.left)
        self.counts = np.bincount(self.joint, minlength=robot.n) / self.correlation_time
        self.torques = np.maximum(self.by_joint(b), TINY)

    def beyond(self, known: Array) -> Residuals:
        """The same with these columns known, and the noise that they leave."""
        if len(self.joint) < FEWEST * (self.base.count + known.shape[-1]):
            return self
        first, left = self.with_known(known), np.zeros(self.tau.shape)
        left[self.used] = first.left
        squares = np.maximum(first.squares, LEAST**2 * first.torques) / np.maximum(self.used.sum(0), 1)
        sigma = np.where(squares > 0, self.sigma * np.sqrt(squares), self.sigma)
        time = self.data.correlation_time(left, self.used)
        return Residuals(self.robot, self.base, self.data, self.beta, sigma, time, known)

    def with_known(self, columns: Array) -> Residuals:
        """The same with more columns known."""
        known = columns if self.known is None else np.concatenate([self.known, columns], axis=-1)
        return Residuals(self.robot, self.base, self.data, self.beta, self.sigma, self.correlation_time, known)

    @cached_property
    def beyond_friction(self) -> Residuals:
        """The same with friction known that rises with the load and is curved over speed, as that of real gears."""
        return self.beyond(by_joint(self.curves))

    @cached_property
    def curves(self) -> Array:
        """Friction of each joint that no parameter stands for, at the equations' times, shape (rows, n, 3)."""
        parts = zip(self.grids, self.loads_on_grids, strict=True)
        pairs = [(g.record, self.friction_curves(g.at_samples(load), g.record.qd)) for g, load in parts]
        return np.concatenate([record.reduce(curves) for record, curves in pairs])

    def friction_curves(self, load: Array, qd: Array) -> Array:
        """The same of a motion, from the torques that the gears transmit."""
        sign, speed = np.sign(qd), np.abs(qd)
        slow = np.exp(-speed / np.maximum(SLOW * self.fastest, TINY))
        return np.stack([np.abs(load) * sign, qd * speed, slow * sign], axis=-1)

    @cached_property
    def fastest(self) -> Array:
        """Largest speeds, shape (n,)."""
        return np.asarray(np.max([np.abs(record.qd).max(0) for record in self.records], axis=0))

    def weighted(self, columns: Array) -> Array:
        """Values of the equations that are fitted, shape (rows, n, ...), over the noise of their joint."""
        scale = self.sigma.reshape(-1, *(1 for _ in columns.shape[2:]))
        found: Array = (columns / scale)[self.used]
        return found

    def by_joint(self, r: Array, s: Array | None = None) -> Array:
        """Sums of products, or of squares, over each joint's equations."""
        return np.bincount(self.joint, r * (r if s is None else s), minlength=self.robot.n)

    @property
    def share(self) -> float:
        """The largest unexplained part of a joint's torques."""
        return float(np.sqrt((self.squares / self.torques).max(initial=0)))

    def gain(self, squares: Array, before: Array | None = None) -> tuple[float, Array]:
        """Gain of log likelihood by a fit that leaves these squares, and the part of each joint's that goes."""
        start, floor = self.squares if before is None else before, LEAST**2 * self.torques
        gain = 0.5 * (self.counts * np.log((start + floor) / (squares + floor))).sum()
        return float(gain), np.maximum(1 - squares / np.maximum(start, floor), 0.0)

    def penalty(self, numbers: float) -> float:
        """What free numbers cost (Schwarz 1978)."""
        return 0.5 * numbers * float(np.log(max(self.counts.sum(), 2.0)))

    def with_columns(self, columns: Array) -> tuple[Array, Array, Array]:
        """Coefficients of additional columns, shape (rows, n, k), their standard errors, and the squares left."""
        X = self.weighted(columns)
        left = X - self.Q @ (self.Q.T @ X)
        for column, given in zip(left.T, X.T, strict=True):  # of each joint what is more than errors of the grid
            doubt = np.maximum(APART**2 * self.by_joint(given), INDEPENDENT**2 * (given @ given))
            apart = self.by_joint(column) > np.maximum(doubt, TINY)
            column *= apart[self.joint]
        lengths = np.linalg.norm(left, axis=0)
        known = lengths > 0
        c, errors = np.zeros(X.shape[1]), np.full(X.shape[1], np.inf)
        if known.any():
            inverse = np.linalg.pinv(left[:, known] / lengths[known], rcond=1e-8)
            c[known] = inverse @ self.left / lengths[known]
            errors[known] = np.linalg.norm(inverse, axis=1) / lengths[known]
        return c, np.sqrt(self.correlation_time.max(initial=1)) * errors, self.by_joint(self.left - left @ c)

    def squares_of(self, Q: Array, tau: Array) -> Array:
        """What a fit by orthonormal columns leaves of torques."""
        b = self.weighted(tau)
        return self.by_joint(b - Q @ (Q.T @ b))

    def squares_moved(self, J: Array, tau: Array) -> Array:
        """What a fit leaves of torques where the joints are J q, with friction that is known so too."""
        bodies = self.standard.groups["bodies"].stop
        states = [(g.q @ J.T, g.qd @ J.T, g.qdd @ J.T) for g in self.grids]
        Y = [self.robot.regressor(*x) @ self.base.back[:bodies] for x in states]
        drives = [self.standard.drive_columns(*x[1:]) @ self.base.back[bodies:] for x in states]
        columns = (g.reduced(y + d) for g, y, d in zip(self.grids, Y, drives, strict=True))
        A = self.weighted(np.concatenate(list(columns)))
        Q = np.linalg.qr(A)[0]
        if self.known is not None:
            beta = np.linalg.lstsq(A, self.weighted(tau), rcond=INDEPENDENT)[0]
            curves = [self.friction_curves(y @ beta, x[1]) for y, x in zip(Y, states, strict=True)]
            reduced = [g.reduced(curve) for g, curve in zip(self.grids, curves, strict=True)]
            Q = extended(Q, self.weighted(by_joint(np.concatenate(reduced))))
        return self.squares_of(Q, tau)

    def covariance_of(self, columns: Array) -> Array:
        """Covariance of the base parameters that the coefficients of these columns bring, where they are found too."""
        X = self.weighted(columns)
        along = self.Q.T @ X
        left = X - self.Q @ along
        moved = np.linalg.lstsq(self.Q.T @ self.A, along, rcond=1e-12)[0]
        return np.asarray(self.correlation_time.max() * moved @ np.linalg.pinv(left.T @ left, hermitian=True) @ moved.T)

    @cached_property
    def grids(self) -> list[Grid]:
        """Of each record, the samples at which columns are evaluated."""
        return [Grid.of(record) for record in self.records]

    def columns(self, torques: Callable[[Grid], Array]) -> Array:
        """Torques on the grids, shape (samples, n, ...), filtered, at the equations' times."""
        return np.concatenate([grid.reduced(torques(grid)) for grid in self.grids])

    def column_of(self, j: int, torque: Callable[[Array, Array, Array], Array]) -> Array:
        """The torque of one joint, a function of its (q, qd, qdd), as a column, shape (rows, n, 1)."""
        states = [(record.q[:, j], record.qd[:, j], record.qdd[:, j]) for record in self.records]
        found = np.concatenate([r.reduce(torque(*x)) for r, x in zip(self.records, states, strict=True)])
        return np.asarray((found[:, None] * np.eye(self.robot.n)[j])[..., None])

    @cached_property
    def loads_on_grids(self) -> list[Array]:
        """Torques of the bodies found, which the gears transmit."""
        return [self.load(g.q, g.qd, g.qdd) for g in self.grids]

    def load(self, q: Array, qd: Array, qdd: Array) -> Array:
        """Torques of the bodies found."""
        bodies = self.x[: PARAMETERS * self.standard.model.nb]
        torques: Array = self.robot.inverse_dynamics(q, qd, qdd, parameters=bodies)
        return torques


def extended(Q: Array, X: Array) -> Array:
    """Orthonormal columns that span those of Q and X, without what is rounding."""
    left = X - Q @ (Q.T @ X)
    left -= Q @ (Q.T @ left)
    U, S, _ = np.linalg.svd(left / np.maximum(np.linalg.norm(X, axis=0), TINY), full_matrices=False)
    return np.concatenate([Q, U[:, INDEPENDENT < S]], axis=1)


def by_joint(values: Array) -> Array:
    """Columns of torques of one joint each, shape (rows, n, n k), from values of shape (rows, n, k)."""
    rows, n, k = values.shape
    return np.asarray((values[:, :, None] * np.eye(n)[:, :, None]).reshape(rows, n, n * k))
