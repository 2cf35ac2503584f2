"""What least squares left of measured torques, and what additional columns of the equations would take away of it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cached_property
from typing import NamedTuple

import numpy as np

from ..basics.spatial import Array
from ..dynamics.base_inertial_parameters import BaseParameters
from ..model.parameters import PARAMETERS
from ..robot import Robot
from .equations import RecordEquations
from .filtering import low_pass
from .prepared import Prepared
from .screening import consecutive

THINNED = 10.0  # samples per period of the cut-off, at which columns of causes are evaluated
FEWEST = 3  # equations per parameter, from which those beside a rest are left out
LEAST = 1e-3  # residuals below this part of the torques are none
INDEPENDENT = 1e-6  # of a column's length, below which nothing of it is independent of the others
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

    def rate_of_change(self, values: Array) -> Array:
        """Derivative by time, segment by segment."""
        found = np.empty_like(values)
        for segment in self.segments:
            found[segment] = np.gradient(values[segment], self.t[segment], axis=0)
        return found


class Residuals:
    """What least squares left of the equations Y x = tau of records, over each joint's noise sigma.

    `beta` are base parameters, `rows` equations of standard parameters, `correlation_time` is that of the residuals.
    """

    def __init__(
        self,
        robot: Robot,
        base: BaseParameters,
        records: Sequence[Prepared],
        rows: Sequence[RecordEquations],
        beta: Array,
        sigma: Array,
        correlation_time: Array,
    ) -> None:
        self.robot, self.base, self.standard, self.records = robot, base, base.standard, records
        self.x, self.sigma, self.correlation_time = base.back @ beta, sigma, correlation_time
        self.tau, self.Y = np.concatenate([r.tau for r in rows]), np.concatenate([r.Y for r in rows])
        self.record = np.repeat(np.arange(len(rows)), [len(r.tau) for r in rows])  # number of each row's record
        sure = np.concatenate([r.sure for r in rows])
        self.used = sure if sure.sum() > FEWEST * base.count else np.concatenate([r.used for r in rows])
        self.joint = np.nonzero(self.used)[1]
        self.A = self.weighted(self.Y @ base.back)
        self.Q = np.linalg.qr(self.A)[0]
        b = self.weighted(self.tau)
        self.left = b - self.Q @ (self.Q.T @ b)
        self.squares = self.by_joint(self.left)
        self.counts = np.bincount(self.joint, minlength=robot.n) / correlation_time
        self.torques = np.maximum(self.by_joint(b), TINY)

    def weighted(self, columns: Array) -> Array:
        """Values of the equations that are fitted, shape (rows, n, ...), over the noise of their joint."""
        scale = self.sigma.reshape(-1, *(1 for _ in columns.shape[2:]))
        found: Array = (columns / scale)[self.used]
        return found

    def by_joint(self, r: Array) -> Array:
        """Sums of squares of each joint's equations."""
        return np.bincount(self.joint, r**2, minlength=self.robot.n)

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

    def with_columns(self, columns: Array) -> tuple[Array, float, Array]:
        """Coefficients of additional columns, shape (rows, n, k), the first's standard error, and the squares left."""
        X = self.weighted(columns)
        left = X - self.Q @ (self.Q.T @ X)
        lengths = np.linalg.norm(left, axis=0)
        known = lengths > INDEPENDENT * np.maximum(np.linalg.norm(X, axis=0), TINY)
        c = np.zeros(X.shape[1])
        c[known] = np.linalg.lstsq(left[:, known] / lengths[known], self.left, rcond=1e-8)[0] / lengths[known]
        error = float(np.sqrt(self.correlation_time.max(initial=1)) / lengths[0]) if known[0] else float("inf")
        return c, error, self.by_joint(self.left - left @ c)

    def squares_of(self, Q: Array, tau: Array) -> Array:
        """What a fit by orthonormal columns leaves of torques."""
        b = self.weighted(tau)
        return self.by_joint(b - Q @ (Q.T @ b))

    def moved(self, J: Array) -> Array:
        """Orthonormal columns of the equations of other joints, of positions J q."""

        def columns(g: Grid) -> Array:
            q, qd, qdd = (x @ J.T for x in (g.q, g.qd, g.qdd))
            drives = self.standard.drive_columns(qd, qdd)
            return np.concatenate([self.robot.regressor(q, qd, qdd), drives], axis=-1) @ self.base.back

        return np.linalg.qr(self.weighted(self.columns(columns)))[0]

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

    def columns_of_torques(self, function: Callable[[Grid, Array], Array]) -> Array:
        """A function of the predicted torques on the grids, filtered, at the equations' times."""
        pairs = zip(self.grids, self.torques_on_grids, strict=True)
        return np.concatenate([grid.reduced(function(grid, torques)) for grid, torques in pairs])

    def column_of(self, j: int, torque: Callable[[Array, Array, Array], Array]) -> Array:
        """The torque of one joint, a function of its (q, qd, qdd), as a column, shape (rows, n, 1)."""
        states = [(record.q[:, j], record.qd[:, j], record.qdd[:, j]) for record in self.records]
        found = np.concatenate([r.reduce(torque(*x)) for r, x in zip(self.records, states, strict=True)])
        return np.asarray((found[:, None] * np.eye(self.robot.n)[j])[..., None])

    @cached_property
    def torques_on_grids(self) -> list[Array]:
        """Torques of the parameters found."""
        return [self.predicted(g.q, g.qd, g.qdd) for g in self.grids]

    def predicted(self, q: Array, qd: Array, qdd: Array) -> Array:
        """Torques of the parameters found."""
        bodies = PARAMETERS * self.standard.model.nb
        drives = self.standard.drive_torques(qd, qdd, self.x[bodies:])
        torques: Array = self.robot.inverse_dynamics(q, qd, qdd, parameters=self.x[:bodies]) + drives
        return torques
