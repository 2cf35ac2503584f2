"""Equations Y x = tau of measured motions: from records to rows, and from rows to triangular factors.

A factor R of [Y tau] has |Y x - tau| = |R (x, -1)| for every x. Factors are kept for each block of time and each joint:
weights of joints, fits without some of the blocks and errors on those blocks do not need the rows again.

Instruments Z stand before Y in the factors of [Z Y tau]. Estimates then are those of the part of the equations of all
joints, over their noise, that lies in the space of Z: with orthonormal Q that span it, Q^T Y x = Q^T tau. With as many
instruments as unknowns Z^T Y x = Z^T tau, instrumental variables; with more, two-stage least squares.

Residuals that resemble their neighbours carry less information than independent ones: the effective sample size is the
number of rows over the integrated autocorrelation time, 1 + 2 sum rho_k (Sokal 1997, section 3).
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ...basics.arrays import per_joint_array, vector, whole_number
from ...basics.filters import impulse_response, low_pass, settling
from ...basics.spatial import Array
from ...basics.text import counted, listed
from ...dynamics.base_inertial_parameters import BaseParameters
from ...errors import IdentificationWarning, NotFiniteError
from ...files.log_columns import names_by_number
from ...model.model import Model
from ...model.standard_parameters import DriveModel, StandardParameters
from ...robot import Robot
from .. import thresholds
from ..log.findings import torques_of
from ..log.prepared import Prepared, rows_without, undisturbed
from ..log.record import Record
from ..log.screening import consecutive, runs

MEASURED = DriveModel(rotor=True, friction="viscous+coulomb", offset=True)  # usual drives of real robots
Motion = Callable[[Array], tuple[Array, Array, Array]]  # q, qd and qdd, shape (T, n), at times (T,)
BEYOND = "the motion leaves the robot's limits: in other units, or from another zero?"  # start of a note
EARLY = "torques come before the positions, as where noise is fed back: give `instruments`"  # start of a note
LOCKED = "joints that the records do not have, taken as locked"  # start of a note
MOVING = "joints that the robot has locked, and that move in the records"  # start of a note
NO_TORQUE = "has no torque that can be used"  # in a note
UNUSABLE = ("constant torque", "saturated torque", "torque missing")  # kinds of findings on unusable torques
MOST_TOLD = 3  # number of limits named in a note


@dataclass(frozen=True, eq=False)
class Equations:
    """Equations of blocks of time, by joint, each stored as the triangular factor of [Y tau]."""

    factors: Array  # shape (blocks, n, K + P + 1, K + P + 1); the last column belongs to tau
    rows: Array  # number of equations that each stands for, shape (blocks, n)
    instruments: int = 0  # number K of columns before the columns of Y

    @property
    def joints(self) -> int:
        """Number of joints."""
        return int(self.factors.shape[1])

    @property
    def columns(self) -> Array:
        """The columns of Y and tau, shape (blocks, n, K + P + 1, P + 1)."""
        return self.factors[..., self.instruments :]

    def of_blocks(self, chosen: Array) -> Equations:
        """Equations of some blocks, by a mask or by indices."""
        return replace(self, factors=self.factors[chosen], rows=self.rows[chosen])

    def merged(self) -> Equations:
        """Equations of all blocks in one."""
        by_joint = np.moveaxis(self.factors, 1, 0)
        factors = triangular(by_joint.reshape(self.joints, -1, by_joint.shape[-1]))
        return replace(self, factors=factors[None], rows=self.rows.sum(0, keepdims=True))

    def without_instruments(self) -> Equations:
        """Equations without instruments, for least squares."""
        return Equations(triangular(self.columns), self.rows) if self.instruments else self

    def of_joint(self, j: int) -> Equations:
        """Equations of one joint."""
        return replace(self, factors=self.factors[:, [j]], rows=self.rows[:, [j]])

    def mapped(self, E: Array) -> Equations:
        """Equations Y E z = tau of other unknowns z, where x = E z."""
        Z, Y, tau = np.split(self.factors, [self.instruments, -1], axis=-1)
        return replace(self, factors=triangular(np.concatenate([Z, Y @ E, tau], axis=-1)))

    def scaled(self, gains: Array, known: Array) -> Equations:
        """Equations with torques multiplied by gains, of the joints whose gain is known."""
        factors = self.factors * known[:, None, None]
        factors[..., -1] *= gains[:, None]
        return replace(self, factors=factors, rows=self.rows * known)

    def residuals(self, x: Array) -> Array:
        """|Y x - tau|^2 of each joint, shape (n,)."""
        return np.asarray(((self.columns @ np.append(x, -1.0)) ** 2).sum((0, 2)))

    def torques(self) -> Array:
        """|tau|^2 of each joint, shape (n,)."""
        return np.asarray((self.factors[..., -1] ** 2).sum((0, 2)))

    def shares(self, x: Array) -> Array:
        """|Y x - tau| / |tau| of each joint, shape (n,)."""
        return np.asarray(np.sqrt(self.residuals(x) / np.maximum(self.torques(), thresholds.TINY)))

    def rms_torques(self) -> Array:
        """Root mean square of each joint's torques, shape (n,)."""
        return np.asarray(np.sqrt(self.torques() / np.maximum(self.rows.sum(0), 1)))

    def weighted(self, sigma: Array) -> Array:
        """Triangular factor of the equations of all joints to be solved, of joint j divided by sigma[j]."""
        return in_space_of_instruments(self._stacked(sigma), self.instruments)

    def _stacked(self, sigma: Array) -> Array:
        scaled = self.factors / sigma[:, None, None]
        return triangular(scaled.reshape(-1, scaled.shape[-1]))

    def predicted(self, sigma: Array) -> Array:
        """Y of each joint j over sigma[j], or its projection on the space of the instruments; for a single block."""
        scaled, K = self.factors[0] / sigma[:, None, None], self.instruments
        if not K:
            return np.asarray(scaled[..., :-1])
        factor = self._stacked(sigma)
        G = solve(factor[:, : K + 1]).inverse
        return np.asarray(scaled[..., :K] @ (G @ (G.T @ (factor[:, :K].T @ factor[:, K:-1]))))


def triangular(rows: Array) -> Array:
    """Triangular factor of one or several matrices, shape (..., P, P), with zero rows where there are few."""
    *shape, count, width = rows.shape
    if count < width:
        rows = np.concatenate([rows, np.zeros((*shape, width - count, width))], axis=-2)
    return np.asarray(np.linalg.qr(rows, mode="r"))


def in_space_of_instruments(factor: Array, instruments: int) -> Array:
    """Projection of triangular equations [Z Y tau] on the space of Z, as a factor of [Y tau]."""
    if not instruments:
        return factor
    Q = factor[:, :instruments] @ solve(factor[:, : instruments + 1]).inverse
    return triangular(Q.T @ factor[:, instruments:])


def equations(Y: Array, tau: Array, used: Array, blocks: Sequence[slice], Z: Array | None = None) -> Equations:
    """Equations of the used rows of motions: Y (N, n, P), tau and `used` (N, n), instruments Z (N, n, K)."""
    Y = Y if Z is None else np.concatenate([Z, Y], axis=-1)
    n, P = Y.shape[1:]
    factors, rows = np.zeros((len(blocks), n, P + 1, P + 1)), np.zeros((len(blocks), n), int)
    for k, block in enumerate(blocks):
        for j in range(n):
            chosen = used[block, j]
            rows[k, j] = chosen.sum()
            factors[k, j] = triangular(np.column_stack([Y[block, j][chosen], tau[block, j][chosen]]))
    if not (np.abs(factors).max(initial=0) < thresholds.LARGEST):
        raise NotFiniteError("the equations overflow: torques or velocities of the measurements are too large")
    return Equations(factors, rows, 0 if Z is None else Z.shape[-1])


def joined(parts: Sequence[Equations]) -> Equations:
    """Blocks of several measurements joined."""
    return Equations(np.concatenate([p.factors for p in parts]), np.concatenate([p.rows for p in parts]))


def with_prior(factor: Array, first: int, weights: Array, values: Array | float = 0.0) -> Array:
    """Triangular equations extended by w x = w v for the unknowns from `first` on, with weights w and values v."""
    known = np.zeros((len(weights), factor.shape[1]))
    known[:, first : first + len(weights)], known[:, -1] = np.diag(weights), weights * values
    return triangular(np.concatenate([factor, known]))


class Solution(NamedTuple):
    """Solution x of A x = b with the smallest residual and, among those, the smallest length per column."""

    x: Array
    inverse: Array  # G of shape (P, rank): its covariance is G G^T, and A G has orthonormal columns
    unit: Array  # A with columns of unit length
    free: Array  # true for unknowns that the equations do not determine

    @property
    def singular(self) -> Array:
        """Singular values of A with columns of unit length."""
        return np.linalg.svd(self.unit, compute_uv=False)

    def spent(self, equations: Equations, sigma: Array) -> Array:
        """Number of unknowns determined by each joint in a weighted fit with noise sigma."""
        return np.asarray(((equations.columns[..., :-1] @ self.inverse) ** 2).sum((0, 2, 3)) / sigma**2)


def solve(factor: Array) -> Solution:
    """Solution of triangular equations [A b]."""
    A, b = factor[:, :-1], factor[:, -1]
    lengths = np.linalg.norm(A, axis=0)
    nothing = lengths <= thresholds.NOTHING * lengths.max(initial=0)
    A, lengths, P = np.where(nothing, 0.0, A), np.where(nothing, 1.0, lengths), len(lengths)
    unit, regular = A / lengths, np.sqrt(thresholds.DEPENDENT)
    if len(A) == P + 1 and np.abs(np.diag(unit)).min(initial=1) > regular:
        inverse = np.linalg.inv(unit[:P])  # a fifth of the time of singular values
        if np.linalg.norm(inverse) * np.linalg.norm(unit) * regular < 1:
            inverse = inverse / lengths[:, None]
            return Solution(inverse @ b[:P], inverse, unit, nothing)
    U, S, V = np.linalg.svd(unit, full_matrices=False)
    kept = thresholds.DEPENDENT * S.max(initial=0) < S
    inverse = (V[kept].T / S[kept]) / lengths[:, None]
    free = np.linalg.norm(V[~kept], axis=0) > thresholds.UNDETERMINED
    return Solution(inverse @ (U.T[kept] @ b), inverse, unit, free)


@dataclass(frozen=True, eq=False)
class RegressionData:
    """The equations Y x = tau of measured motions, of `regression`: rows of all records, and their factors.

    Attributes
    ----------
    names : tuple of str
        Names of the records.
    prepared : tuple of Prepared
        The records after the filter.
    delays : ndarray, shape (records, n)
        Delays of the measured torques after the positions [s].
    minimum_velocity : ndarray, shape (n,)
        Smallest velocity of fitted equations; infinite for a joint that does not move [rad/s or m/s].
    notes : tuple of str
        On joints that do not move, or leave their limits, or have no torque.
    Y : ndarray, shape (rows, n, P)
        Torques per unit of each standard parameter, filtered.
    tau : ndarray, shape (rows, n)
        Measured torques, filtered [N m or N].
    valid, used, sure : ndarray of bool, shape (rows, n)
        True where the torque was measured; where, in addition, the joint is not slow; and where it has not rested
        nearby for long either, when friction takes any value.
    fitted, measured : Equations
        The used and the valid rows in folds of time, as triangular factors.
    Z : ndarray, shape (rows, n, K), or None
        Instruments: base columns of Y at a motion without noise.

    Examples
    --------
    >>> data.residuals(found.parameters).std(0)  # doctest: +SKIP
    """

    names: tuple[str, ...]
    prepared: tuple[Prepared, ...]
    delays: Array
    minimum_velocity: Array
    notes: tuple[str, ...]
    Y: Array
    tau: Array
    valid: Array
    used: Array
    sure: Array
    fitted: Equations
    measured: Equations
    Z: Array | None = None

    @property
    def parts(self) -> tuple[slice, ...]:
        """The rows of each record."""
        return consecutive(len(record.times) for record in self.prepared)

    @property
    def segments(self) -> list[tuple[Prepared, slice]]:
        """The rows of each segment without gaps, with its record."""
        of_segments = [(record, length) for record in self.prepared for length in record.segment_lengths]
        return list(zip([r for r, _ in of_segments], consecutive(length for _, length in of_segments), strict=True))

    def residuals(self, x: Array) -> Array:
        """Measured less predicted torques.

        Parameters
        ----------
        x : ndarray, shape (P,)
            Standard parameters.

        Returns
        -------
        ndarray, shape (rows, n)
            Of the filtered torques [N m or N].
        """
        return np.asarray(self.tau - self.Y @ x)

    def in_torques(self, gains: Array) -> RegressionData:
        """Equations in torques by gains, shape (n,), from measurements; a joint whose gain is NaN has none."""
        g, known = np.nan_to_num(gains), np.isfinite(gains)
        fitted, measured = (e.scaled(g, known) for e in (self.fitted, self.measured))
        tau, used, sure = self.tau * g, self.used & known, self.sure & known
        return replace(self, tau=tau, used=used, sure=sure, fitted=fitted, measured=measured)

    def at_lower_cutoff(self, base: BaseParameters, noise: Array) -> tuple[Array, Array]:
        """Base parameters and standard errors with half the cut-off, from moving joints; NaN where undetermined.

        `noise` is the square root of the residuals' spectral density at low frequencies, which half the cut-off does
        not change, shape (n,).
        """
        Z = self.Y[..., :0] if self.Z is None else self.Z
        all_columns = np.concatenate([Z, self.Y @ base.back, self.tau[..., None]], axis=-1) / noise[:, None]
        rows = [np.zeros((0, all_columns.shape[-1]))]
        for record, part in self.segments:
            cutoff, rate = record.cutoff / 2, record.sample_rate / record.decimation
            reach = settling(cutoff, rate)
            inner = np.arange(reach, part.stop - part.start - reach)
            if len(inner):
                valid = undisturbed(~self.used[part], inner, reach)
                rows.append(low_pass(all_columns[part], cutoff, rate, inner)[valid])
        found = solve(in_space_of_instruments(triangular(np.concatenate(rows)), Z.shape[-1]))
        unknown = found.free | (sum(map(len, rows)) <= 2 * base.count)
        errors = np.linalg.norm(found.inverse, axis=1)
        return np.where(unknown, np.nan, found.x), np.where(unknown, np.nan, errors)

    def correlation_time(self, residuals: Array, used: Array | None = None) -> Array:
        """Integrated autocorrelation time of the `used` residuals, at least that of filtered noise, in rows, (n,)."""
        of_noise = [correlation_time_of_filtered_noise(p.cutoff, p.sample_rate, p.decimation) for p in self.prepared]
        used, parts = self.used if used is None else used, [part for _, part in self.segments]
        return np.maximum(correlation_time_of_residuals(residuals, used, parts), max(of_noise))


def build_regression(
    robot: Robot,
    records: Sequence[Record],
    base: BaseParameters,
    minimum_velocity: ArrayLike | None,
    cutoff: float | Sequence[float] | None,
    folds: int,
    delays: Array | float = 0.0,
    loaded: Array | None = None,
    instruments: Sequence[Motion] = (),
) -> RegressionData:
    """Equations of checked records, as of `rne.identify`; cut-offs, delays and `instruments` may differ by record.

    Friction under load is that of the loads with standard parameters `loaded`, by default those of the model.
    """
    standard, Z = base.standard, None
    whole_number("folds", folds, least=2)
    late = np.broadcast_to(delays, (len(records), robot.n))
    cutoffs = cutoff if isinstance(cutoff, Sequence) else [cutoff] * len(records)
    prepared = tuple(delayed(r.prepare(c), d) for r, c, d in zip(records, cutoffs, late, strict=True))
    still, slowest = minimum_velocities(standard, records, prepared, minimum_velocity)
    loads = standard.values if loaded is None else loaded
    Y, tau, valid, used, sure = rows_of_all(robot, standard, prepared, slowest, still, loads)
    if still.all() and len(still):
        raise ValueError("`records` show no joint that moves: one pose says nothing of inertias and friction")
    if instruments:
        moved = [along(r, motion) for r, motion in zip(prepared, instruments, strict=True)]
        along_motion, _, _, both, _ = rows_of_all(robot, standard, moved, slowest, still, loads)
        Z, used, sure = along_motion @ base.back, used & both, sure & both  # friction's direction is known
    silent = [no_torque_text(records, j, robot.joint_names[j]) for j in np.flatnonzero(~valid.any(0)).tolist()]
    check_enough(int(used.sum()), base.count, silent, robot.n)
    resting_text = still_text(standard, [robot.joint_names[j] for j in np.flatnonzero(still)])
    notes = (*beyond_limits(robot, prepared), *followers_text(standard), *resting_text, *silent)
    blocks = blocks_of_time(prepared, blocks_of_each(prepared, folds))
    measured = fitted = equations(Y, tau, used, blocks, Z)
    if (used != valid).any():
        measured = equations(Y, tau, valid, blocks, Z)
    names = tuple(r.name for r in records)
    return RegressionData(names, prepared, late, slowest, notes, Y, tau, valid, used, sure, fitted, measured, Z)


def check_enough(count: int, unknowns: int, silent: Sequence[str], n: int) -> None:
    """Raise a ValueError for records with too few equations, with the joints without torque."""
    if len(silent) == n:
        raise ValueError(f"`records` give no equations: {silent[0]}{' and so on' * (n > 1)}: record torques in motion")
    if count <= unknowns:
        cure = "a longer motion is needed, or a higher `cutoff`"
        raise ValueError(f"`records` give {count} equations for {unknowns} base parameters: {cure}")


def along(record: Prepared, motion: Motion) -> Prepared:
    """Record with its positions, velocities and accelerations replaced by those of a motion."""
    if len(motion(record.t[0])) != 3:
        raise ValueError(f"`instruments` must return q, qd and qdd, got {len(motion(record.t[0]))} results")
    try:
        q, qd, qdd = (np.asarray(x, np.float64) for x in motion(record.t))
    except (TypeError, ValueError):
        q = qd = qdd = np.zeros(0)
    if q.shape != record.q.shape:  # a function of one time
        q, qd, qdd = (np.array(x, np.float64) for x in zip(*map(motion, record.t), strict=True))
    if not q.shape == qd.shape == qdd.shape == record.q.shape or not np.isfinite(q + qd + qdd).all():
        shapes = f"{q.shape}, {qd.shape}, {qdd.shape}"
        raise ValueError(f"`instruments` must give finite q, qd and qdd of shape {record.q.shape}, got {shapes}")
    off, moved = (q - record.q).std(0), record.q.std(0)
    unlike = np.flatnonzero(off > thresholds.RESEMBLES * moved)
    if len(unlike):
        j = int(unlike[0])
        raise ValueError(
            f"`instruments` must resemble the measured motion: of joint {j + 1} they differ by {off[j]:.3g} (standard "
            f"deviation), while it moves by {moved[j]:.3g}: check units, joints and times"
        )
    return replace(record, q=q, qd=qd, qdd=qdd)


def blocks_of_time(records: Sequence[Prepared], of_each: int) -> tuple[slice, ...]:
    """Rows of records in blocks of time, given the number of blocks of each record."""
    return consecutive(b.stop - b.start for record in records for b in record.blocks(of_each))


def blocks_of_each(records: Sequence[Prepared], folds: int) -> int:
    """Number of blocks of time of each record, at least two, for a total number of folds."""
    each, shortest = max(-(-folds // len(records)), 2), min(len(record.times) for record in records)
    if each > shortest:
        most = shortest * len(records)
        raise ValueError(f"`folds` must be at most {most}, got {folds}: there are no more equations")
    return each


def rows_of_all(
    robot: Robot, standard: StandardParameters, records: Sequence[Prepared], *given: Array
) -> tuple[Array, ...]:
    """Y, tau and masks of the rows of all records, one after the other; see `rows_of`."""
    return tuple(map(np.concatenate, zip(*(rows_of(robot, standard, r, *given) for r in records), strict=True)))


def rows_of(
    robot: Robot, standard: StandardParameters, record: Prepared, minimum_velocity: Array, still: Array, loaded: Array
) -> tuple[Array, ...]:
    """Y and tau at the rows of a record, with masks of valid, used and sure ones; `still` joints do not move at all."""
    qd, qdd = record.qd * ~still, record.qdd * ~still
    bodies, first = robot.regressor(record.q, qd, qdd), standard.groups["bodies"].stop
    load = standard.load(bodies, record.q, qdd, loaded)
    Y = np.zeros((len(record.times), robot.n, standard.count))
    for j in range(robot.n):  # one by one, to need less memory; most bodies and drives are not felt by a joint
        felt = np.flatnonzero(bodies[:, j].any(axis=0))
        places, drives = standard.drive_columns_of(j, qd, qdd, load)
        columns = np.concatenate([bodies[:, j, felt], drives], axis=1)
        Y[:, j, np.append(felt, first + places)] = record.reduce(columns)
    if standard.springs is not None:
        Y[..., standard.groups["springs"]] = record.reduce(standard.spring_columns(record.q))
    used = record.valid & ((record.reduce(np.abs(qd)) > minimum_velocity) | (minimum_velocity == 0))
    sure = used & rows_without(record, resting(record, minimum_velocity))
    return Y, record.reduce(record.tau), record.valid, used, sure


def resting(record: Prepared, minimum_velocity: Array) -> Array:
    """True at samples where a joint rests for so long that its friction is undetermined, shape (T, n)."""
    slow = np.abs(record.qd) < minimum_velocity
    shortest = thresholds.REST_PERIODS * record.sample_rate / record.cutoff
    for flags in slow.T:
        for begin, end in runs(flags):
            if end - begin < shortest:
                flags[begin:end] = False
    return slow


def beyond_limits(robot: Robot, prepared: Sequence[Prepared]) -> tuple[str, ...]:
    """Note on joints that exceed the robot's limits, or none."""
    names, reach = robot.joint_names, thresholds.BEYOND_LIMITS
    low, high = np.min([r.q.min(0) for r in prepared], axis=0), np.max([r.q.max(0) for r in prepared], axis=0)
    speed, limit = np.max([np.abs(r.qd).max(0) for r in prepared], axis=0), robot.velocity_limit
    above, below = high - robot.upper, robot.lower - low
    at, end = np.where(above >= below, (high, robot.upper), (low, robot.lower))
    width = robot.upper - robot.lower  # zero where a URDF leaves the limits out
    outside = (np.maximum(above, below) > reach * width) & (width > 0)
    told = [f"{names[j]} reaches {at[j]:.3g}, its limit is {end[j]:.3g}" for j in np.flatnonzero(outside)]
    fast = np.flatnonzero(speed > (1 + reach) * limit)
    told += [f"{names[j]} reaches {speed[j]:.3g}/s, its limit is {limit[j]:.3g}/s" for j in fast]
    more = f" and {len(told) - MOST_TOLD} more" * (len(told) > MOST_TOLD)
    return (f"{BEYOND} {'; '.join(told[:MOST_TOLD])}{more}",) * bool(told)


def no_torque_text(records: Sequence[Record], j: int, name: str) -> str:
    """Note on a joint whose torques are all unusable, with the records' findings on them."""
    found = [f for record in records for f in record.findings if f.joint == record.joint_names[j]]
    why = [f"{f.kind} {f.text.split(':')[0]}" for f in found if f.kind in UNUSABLE]
    return f"{name} {NO_TORQUE}{f': {why[0]}' if why else ''}"


def still_text(standard: StandardParameters, names: Sequence[str]) -> tuple[str, ...]:
    """Note on joints that do not move, and their parameters that are not found."""
    if not names:
        return ()
    lost = " and ".join(name for name, term in (("rotor", "Ia"), ("friction", "Fv")) if term in standard.terms)
    does, its = ("does", "its") if len(names) == 1 else ("do", "their")
    return (f"{listed(names)} {does} not move" + (f": {its} {lost} cannot be found" if lost else ""),)


def followers_text(standard: StandardParameters) -> tuple[str, ...]:
    """Note on rotors and friction of the model at coupled joints, which are not found."""
    model = standard.model
    has_drive = model.armature + model.damping + model.friction > 0
    names = [model.moving_joints[i] for i, *_ in model.coupled_joints if has_drive[i]]
    why = "these follow others" if names[1:] else "it follows others"
    text = f"rotors and friction at {listed(names)} are not fitted, as {why}; the robot found has none there"
    return (text,) * bool(names and standard.terms)


def delay_argument(delay: ArrayLike | None, n: int) -> Array:
    """Argument `delay`, checked, shape (n,) [s]; zero if not given."""
    delays = np.zeros(n) if delay is None else per_joint_array("delay", delay, n)
    if (far := np.abs(delays).max(initial=0)) > 1:
        raise ValueError(f"`delay` must be at most 1 s, got {far:g}: give seconds, 0.005 for 5 ms")
    return delays


def delayed(record: Prepared, delays: Array) -> Prepared:
    """Record with torques shifted back by their delay after the positions."""
    from scipy.interpolate import CubicSpline

    if not delays.any():
        return record
    tau = record.tau.copy()
    for part in record.segments:
        t = record.t[part]
        for j in np.flatnonzero(delays):
            tau[part, j] = CubicSpline(t, record.tau[part, j])(np.clip(t + delays[j], t[0], t[-1]))
    return replace(record, tau=tau)


def checked_records(robot: Robot, records: Record | Sequence[Record], name: str = "records") -> tuple[Record, ...]:
    """Records as a tuple, checked to have torques of all joints of the robot, each once."""
    given = tuple(records) if isinstance(records, Sequence) and not isinstance(records, str) else (records,)
    if not given:
        raise ValueError(f"`{name}` must have at least one record")
    for record in given:
        if not isinstance(record, Record):
            raise TypeError(f"`{name}` must be an rne.identification.Record or several, got {type(record).__name__}")
        check_joints(robot, record, name)
        torques_of(record.cleaned)
    for one, other in combinations(given, 2):
        if all(np.array_equal(getattr(one, x), getattr(other, x)) for x in ("q", "tau")):
            cure = "one is the wrong file, or to be left out, since blocks of one are predicted by fits to the other"
            raise ValueError(f"`{name}` has the same measurements twice, {one.name!r} and {other.name!r}: {cure}")
    return given


def of_named_joints(
    robot: Robot, records: Record | Sequence[Record]
) -> tuple[Robot, tuple[Record, ...], tuple[str, ...]]:
    """Robot with joints locked that records lack, records of its joints in order, and notes.

    An error is raised for records of different joints, and where the log and the robot may name a joint differently:
    the records lack a joint and have one that the robot does not know, or lack nearly all.
    """
    given = tuple(records) if isinstance(records, Sequence) else (records,)
    given = tuple(by_number(r, robot.joint_names) if isinstance(r, Record) else r for r in given)
    named = [r for r in given if isinstance(r, Record) and r.is_of(robot.joint_names)]
    if not named or len(named) < len(given):
        told = [r for r in given if isinstance(r, Record) and r.given_names]
        notes = [f"joints of {r.name} are taken in the robot's order, as they are numbered" for r in told]
        return robot, given, tuple(notes)
    first, *rest = named
    own = [name for name in robot.joint_names if name in first.joint_names]
    for record in rest:
        if (theirs := [name for name in robot.joint_names if name in record.joint_names]) != own:
            both = f"{first.name} has {own}, {record.name} {theirs}"
            raise ValueError(f"records must be of the same joints, {both}: give `joints` that both have")
    others = sorted({name for r in named for name in r.joint_names} - set(robot.joint_names))
    ends = zip(robot.joint_names, robot.lower, robot.upper, strict=True)
    missing = {name: float(np.clip(0.0, low, high)) for name, low, high in ends if name not in own}
    if missing and (set(others) - set(robot.model.link_joints) or len(own) < thresholds.LEAST_NAMED * robot.n):
        both = f"{first.name} has {list(first.joint_names)} and lacks {list(missing)}"
        cure = f", or lock these where they were, `robot.locked({missing})`" if own else ""
        how = ', as `joints` with columns={"q": ..., "tau": ...} in this order' if first.source else ""
        raise ValueError(f"records must name the robot's joints, {both}: give names as the robot has them{how}{cure}")
    following = set(robot.model.moving_joints).intersection(others)
    why = {name: "follows others" if name in following else "is not a joint of the robot, or locked" for name in others}
    notes = [f"{name} of the records {why[name]}: left out" for name in others]
    positions = [x for r in named for x in zip(r.joint_names, r.q.T, strict=True) if np.isfinite(x[1]).any()]
    ranges = {name: np.ptp(q[np.isfinite(q)]) for name, q in positions}
    moving = [x for x in others if ranges.get(x, 0) > thresholds.RESTS]
    locked = [x for x in robot.model.link_joints if x in moving and x not in following]
    if locked:
        notes = [f"{MOVING}: {listed([f'{x} by {ranges[x]:.3g}' for x in locked])}", *notes]
    check_drivers(robot.model, [x for x in moving if x in following], missing)
    if missing:
        notes = [f"{LOCKED}: {listed([f'{name} at {q:.4g}' for name, q in missing.items()])}", *notes]
        robot = robot.locked(missing)
    if any(record.joint_names != robot.joint_names for record in named):
        given = tuple(record.part(slice(None), robot.joint_names) for record in named)
    return robot, given, tuple(notes)


def check_drivers(model: Model, moving: Sequence[str], missing: Collection[str]) -> None:
    """Raise a ValueError for records with moving coupled joints but without the joints that drive them."""
    places = {i: [k] for i, k in enumerate(model.coordinate)} | {i: own for i, own, _ in model.coupled_joints}
    for joint in moving:
        drivers = [model.joint_names[k] for k in places[model.moving_joints.index(joint)]]
        if not set(drivers).isdisjoint(missing):
            cure = f"give positions and torques of {listed(drivers)}, or a robot in which {joint!r} is driven itself"
            lacking = f"the joints that {joint!r} follows, they lack {listed([*missing])}"
            raise ValueError(f"records must have {lacking}: {cure}")


def by_number(record: Record, names: Sequence[str]) -> Record:
    """Record renamed to the robot's joints where both have numbers only: joint_2 or j2 becomes the robot's arm_j2."""
    own = record.given_names or ()
    called = names_by_number(own, names)
    return record.part(slice(None), own, called) if called else record


def warn_of_locked(notes: Sequence[str]) -> None:
    """Warn of joints missing in the records, or locked and moving, at the caller of a public function."""
    for text in locked_text(notes, "; "):
        warnings.warn(text, IdentificationWarning, stacklevel=3)


def locked_text(notes: Sequence[str], then: str, why: str = "") -> list[str]:
    """Notes on locked joints, each with a remedy."""
    cures = {LOCKED: f"if they stood elsewhere, {why}lock them there by `robot.locked`"}
    cures[MOVING] = f"{why}fit them too, or take a part in which they rest (`Record.between`)"
    return [f"{note}{then}{cure}" for note in notes for start, cure in cures.items() if note.startswith(start)]


def check_joints(robot: Robot, record: Record, argument: str) -> None:
    """Raise a ValueError for a record of other joints, or of these in another order."""
    names = robot.joint_names
    if record.n == robot.n and (not record.is_of(names) or record.joint_names == names):
        return
    lacking: Sequence[str] = names[record.n :]
    came = f"{counted(record.n, 'joint')} without names"
    cure = "give the names of those measured as `joint_names` of the Record"
    if record.is_of(names):
        came, lacking = str(list(record.joint_names)), [name for name in names if name not in record.joint_names]
        cure = "name the joints of all records as the robot does, by `joint_names` of the Record"
    if record.n < robot.n:
        cure += f", or lock the others: `robot.locked({dict.fromkeys(lacking, 0)})`"
    raise ValueError(f"`{argument}` must be of the joints {list(names)}, {record.name!r} has {came}: {cure}")


def minimum_velocities(
    standard: StandardParameters, records: Sequence[Record], prepared: Sequence[Prepared], given: ArrayLike | None
) -> tuple[Array, Array]:
    """True for joints that move by few encoder steps; velocities below which equations are not fitted."""
    step = np.max([record.encoder_step for record in records], axis=0)
    middle = np.mean([p.q.mean(0) for p in prepared], axis=0)
    reach = np.max([np.abs(p.q - middle).max(0) for p in prepared], axis=0)
    rounding = thresholds.ROUNDINGS * np.finfo(float).eps * np.abs(middle)
    still = reach <= np.maximum(thresholds.STEPS_AT_REST * step, rounding)
    largest = np.max([np.abs(p.qd).max(0) for p in prepared], axis=0)
    floor = 2 * np.pi * max(p.cutoff for p in prepared) * step  # velocity that one step makes at the cut-off
    if given is not None:
        return still, vector("minimum_velocity", given, standard.model.n, sign="not negative")
    if "Fc" not in standard.terms or standard.smoothing:
        return still, np.zeros(standard.model.n)
    return still, np.where(still, np.inf, np.maximum(thresholds.SLOWEST_FITTED * largest, floor))


def correlation_time_of_residuals(residuals: Array, used: Array, parts: Sequence[slice]) -> Array:
    """1 + 2 sum rho_k of each joint, at least 1, over the rows that are `used`; `parts` have no gaps."""
    from scipy.signal import correlate

    lags = np.arange(max(part.stop - part.start for part in parts))
    found = []
    for x, flags in zip((residuals * used).T, used.T.astype(float), strict=True):
        products, pairs = np.zeros((2, len(lags)))
        for part in parts:
            count = part.stop - part.start
            products[:count] += correlate(x[part], x[part])[count - 1 :]
            pairs[:count] += correlate(flags[part], flags[part])[count - 1 :]
        covariances = products / np.maximum(np.rint(pairs), 1) * (1 - lags / len(lags))
        sums = 2 * np.cumsum(covariances / (covariances[0] or 1.0)) - 1
        ends = np.flatnonzero(lags >= thresholds.SUM_WINDOW * sums)
        found.append(max(sums[ends[0] if len(ends) else -1], 1.0))
    return np.array(found)


def correlation_time_of_filtered_noise(cutoff: float, sample_rate: float, decimation: int) -> float:
    """1 + 2 sum rho_k of filtered white noise, from the filter's impulse response."""
    reach = decimation * int(np.ceil(thresholds.RESPONSE_PERIODS * sample_rate / (cutoff * decimation)))
    response = impulse_response(cutoff, sample_rate, reach)
    covariances = np.correlate(response, response, "full")[len(response) - 1 :: decimation]
    return float(2 * covariances.sum() / covariances[0] - 1)
