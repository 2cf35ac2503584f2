"""From records to equations: which of the measurements are fitted, and what is said of the others."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from difflib import get_close_matches

import numpy as np
from numpy.typing import ArrayLike

from ...basics.arrays import vector, whole_number
from ...basics.spatial import Array
from ...basics.text import listed
from ...dynamics.base_inertial_parameters import BaseParameters
from ...model.standard_parameters import StandardParameters
from ...robot import Robot
from .. import thresholds
from ..log.filtering import low_pass, settling
from ..log.prepared import Prepared, rows_without, undisturbed
from ..log.record import Record
from ..log.screening import consecutive, runs
from .equations import Equations, equations, triangular
from .least_squares import correlation_time_of_filtered_noise, correlation_time_of_residuals, solve

ROUNDINGS = 1e3  # of a position, within which it does not change


@dataclass(frozen=True, eq=False)
class RegressionData:
    """The equations Y x = tau of measured motions: the rows of all records one after the other, and their factors."""

    names: tuple[str, ...]  # of the records
    prepared: tuple[Prepared, ...]
    delays: Array  # by which torques were measured later than positions, shape (records, n) [s]
    minimum_velocity: Array  # of equations that are fitted, shape (n,); infinite for a joint that does not move
    notes: tuple[str, ...]
    Y: Array  # shape (rows, n, P)
    tau: Array  # shape (rows, n), as the masks that follow
    valid: Array  # the torque was measured
    used: Array  # valid, and the joint is not about to stop
    sure: Array  # used, and the joint did not rest for a while beside, where friction takes any value
    fitted: Equations  # the used rows in folds of time
    measured: Equations  # the valid rows likewise, to check the fit on

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
        """Measured less predicted torques of standard parameters x, shape (rows, n)."""
        return np.asarray(self.tau - self.Y @ x)

    def in_torques(self, gains: Array) -> RegressionData:
        """The equations of measurements times gains; a joint whose gain is NaN has none."""
        g, known = np.nan_to_num(gains), np.isfinite(gains)
        fitted, measured = (e.scaled(g, known) for e in (self.fitted, self.measured))
        tau, used, sure = self.tau * g, self.used & known, self.sure & known
        return replace(self, tau=tau, used=used, sure=sure, fitted=fitted, measured=measured)

    def at_lower_cutoff(self, base: BaseParameters, noise: Array) -> tuple[Array, Array]:
        """Base parameters and standard errors with half the cut-off, from equations that no joint at rest enters.

        `noise` is the square root of the residuals' spectral density at low frequencies, of which half the cut-off
        leaves the same, shape (n,). NaN for what the equations do not tell.
        """
        rows = [np.zeros((0, base.count + 1))]
        both = np.concatenate([self.Y @ base.back, self.tau[..., None]], axis=-1) / noise[:, None]
        for record, part in self.segments:
            cutoff, rate = record.cutoff / 2, record.sample_rate / record.decimation
            reach = settling(cutoff, rate)
            inner = np.arange(reach, part.stop - part.start - reach)
            if len(inner):
                valid = undisturbed(~self.used[part], inner, reach)
                rows.append(low_pass(both[part], cutoff, rate, inner)[valid])
        found = solve(triangular(np.concatenate(rows)))
        unknown = found.free | (sum(map(len, rows)) <= 2 * base.count)
        errors = np.linalg.norm(found.inverse, axis=1)
        return np.where(unknown, np.nan, found.x), np.where(unknown, np.nan, errors)

    def correlation_time(self, residuals: Array, used: Array | None = None) -> Array:
        """Integrated autocorrelation time of residuals over the rows used, at least that of filtered noise, in rows."""
        of_noise = [correlation_time_of_filtered_noise(p.cutoff, p.sample_rate, p.decimation) for p in self.prepared]
        used, parts = self.used if used is None else used, [part for _, part in self.segments]
        return np.maximum(correlation_time_of_residuals(residuals, used, parts), max(of_noise))


def build_regression(
    robot: Robot,
    records: Record | Sequence[Record],
    base: BaseParameters,
    minimum_velocity: ArrayLike | None,
    cutoff: float | None,
    folds: int,
    delays: Array | float = 0.0,
) -> RegressionData:
    """The equations of the records; arguments as of `rne.identify`."""
    given, standard = checked_records(robot, records), base.standard
    whole_number("folds", folds, least=2)
    late = np.broadcast_to(delays, (len(given), robot.n))
    prepared = tuple(delayed(r.prepare(cutoff), d) for r, d in zip(given, late, strict=True))
    still, slowest = minimum_velocities(standard, given, prepared, minimum_velocity)
    of_records = [rows_of(robot, standard, record, slowest, still) for record in prepared]
    if still.all() and len(still):
        raise ValueError("`records` show no joint that moves: one pose says nothing of inertias and friction")
    Y, tau, valid, used, sure = (np.concatenate(arrays) for arrays in zip(*of_records, strict=True))
    if used.sum() <= base.count:
        raise ValueError(
            f"`records` give {used.sum()} equations for {base.count} base parameters: a longer motion is needed, or a "
            "higher `cutoff`"
        )
    each, shortest = max(-(-folds // len(prepared)), 2), min(len(record.times) for record in prepared)
    if each > shortest:
        most = shortest * len(prepared)
        raise ValueError(f"`folds` must be at most {most}, got {folds}: there are no more equations")
    silent = [f"{robot.joint_names[j]} has no torque that can be used" for j in np.flatnonzero(~valid.any(0))]
    notes = (*still_text(standard, [robot.joint_names[j] for j in np.flatnonzero(still)]), *silent)
    blocks = blocks_of_time(prepared, each)
    measured = fitted = equations(Y, tau, used, blocks)
    if (used != valid).any():
        measured = equations(Y, tau, valid, blocks)
    names = tuple(record.name for record in given)
    return RegressionData(names, prepared, late, slowest, notes, Y, tau, valid, used, sure, fitted, measured)


def blocks_of_time(records: Sequence[Prepared], of_each: int) -> tuple[slice, ...]:
    """The rows of records in blocks of time, so many of each record."""
    return consecutive(b.stop - b.start for record in records for b in record.blocks(of_each))


def rows_of(
    robot: Robot, standard: StandardParameters, record: Prepared, minimum_velocity: Array, still: Array
) -> tuple[Array, ...]:
    """Y, tau, valid, used and sure of a record: slow joints are not used, those that are `still` do not move at all."""
    qd, qdd = record.qd * ~still, record.qdd * ~still
    bodies, first = robot.regressor(record.q, qd, qdd), standard.groups["bodies"].stop
    Y = np.zeros((len(record.times), robot.n, standard.count))
    for j in range(robot.n):  # one by one, to need less memory; most bodies and drives are not felt by a joint
        felt = np.flatnonzero(bodies[:, j].any(axis=0))
        places, drives = standard.drive_columns_of(j, qd, qdd)
        columns = np.concatenate([bodies[:, j, felt], drives], axis=1)
        Y[:, j, np.append(felt, first + places)] = record.reduce(columns)
    used = record.valid & ((record.reduce(np.abs(qd)) > minimum_velocity) | (minimum_velocity == 0))
    sure = used & rows_without(record, resting(record, minimum_velocity))
    return Y, record.reduce(record.tau), record.valid, used, sure


def resting(record: Prepared, minimum_velocity: Array) -> Array:
    """True at samples where a joint rests for a while, and its friction takes any value, shape (T, n)."""
    slow = np.abs(record.qd) < minimum_velocity
    shortest = thresholds.REST_PERIODS * record.sample_rate / record.cutoff
    for flags in slow.T:
        for begin, end in runs(flags):
            if end - begin < shortest:
                flags[begin:end] = False
    return slow


def still_text(standard: StandardParameters, names: Sequence[str]) -> tuple[str, ...]:
    """That joints do not move, and what of them is not found."""
    if not names:
        return ()
    lost = " and ".join(name for name, term in (("rotor", "Ia"), ("friction", "Fv")) if term in standard.terms)
    does, its = ("does", "its") if len(names) == 1 else ("do", "their")
    return (f"{listed(names)} {does} not move" + (f": {its} {lost} cannot be found" if lost else ""),)


def delayed(record: Prepared, delays: Array) -> Prepared:
    """The record with torques measured later than positions taken back to where they belong."""
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
    """The records as a tuple, all of the robot's joints."""
    given = tuple(records) if isinstance(records, Sequence) and not isinstance(records, str) else (records,)
    if not given:
        raise ValueError(f"`{name}` must have at least one record")
    for record in given:
        if not isinstance(record, Record):
            raise TypeError(f"`{name}` must be an rne.identification.Record or several, got {type(record).__name__}")
        check_joints(robot, record, name)
    return given


def of_named_joints(
    robot: Robot, records: Record | Sequence[Record]
) -> tuple[Robot, tuple[Record, ...], tuple[str, ...]]:
    """The robot with joints locked that a record of named joints lacks, records of its joints in order, and notes."""
    given = tuple(records) if isinstance(records, Sequence) else (records,)
    named = [r for r in given if isinstance(r, Record) and r._has_names]
    known = set(robot.joint_names).intersection(*(record.joint_names for record in named))
    if not named or len(named) < len(given) or not known:
        return robot, given, ()
    model, notes = robot.model, []
    missing = {name: 0.0 for name in robot.joint_names if name not in known}
    others = sorted({name for record in named for name in record.joint_names} - set(robot.joint_names))
    for j, name in zip(model.independent_joints, robot.joint_names, strict=True):
        if name in missing:
            if alike := get_close_matches(name, others, cutoff=thresholds.LIKE_NAMES):
                raise ValueError(f"`joint_names` {alike[0]!r} of the records is not a joint of the robot: {name!r}?")
            missing[name] = float(np.clip(0.0, model.lower[j], model.upper[j]))
            notes.append(f"{name} is not in every record: locked at {missing[name]:.4g}")
    robot = robot.locked(missing) if missing else robot
    notes += [f"{name} of the records is not a joint of the robot, or locked: left out" for name in others]
    if any(record.joint_names != robot.joint_names for record in named):
        given = tuple(record._part(slice(None), robot.joint_names) for record in named)
    return robot, given, tuple(notes)


def check_joints(robot: Robot, record: Record, argument: str) -> None:
    """Refuse a record of other joints, or of these in another order."""
    if record.n != robot.n:
        names = robot.joint_names[min(record.n, robot.n - 1) :]
        cure = "give the names of those measured as `joint_names` of the Record"
        if record.n < robot.n:
            cure += f", or lock the others: `robot.locked({dict.fromkeys(names, 0)})`"
        raise ValueError(f"`{argument}` must be of {robot.n} joints, as the robot, got one of {record.n}: {cure}")
    if record._has_names and record.joint_names != robot.joint_names:
        raise ValueError(
            f"`{argument}` must have the robot's joints in their order, {list(robot.joint_names)}, {record.name} has "
            f"{list(record.joint_names)}"
        )


def minimum_velocities(
    standard: StandardParameters, records: Sequence[Record], prepared: Sequence[Prepared], given: ArrayLike | None
) -> tuple[Array, Array]:
    """Which joints do not move, but for a few steps of their encoders, and velocities below which none is fitted."""
    step = np.max([record.encoder_step for record in records], axis=0)
    middle = np.mean([p.q.mean(0) for p in prepared], axis=0)
    reach = np.max([np.abs(p.q - middle).max(0) for p in prepared], axis=0)
    still = reach <= np.maximum(thresholds.STEPS_AT_REST * step, ROUNDINGS * np.finfo(float).eps * np.abs(middle))
    largest = np.max([np.abs(p.qd).max(0) for p in prepared], axis=0)
    floor = 2 * np.pi * max(p.cutoff for p in prepared) * step  # velocity that one step makes at the cut-off
    if given is not None:
        return still, vector("minimum_velocity", given, standard.model.n, sign="not negative")
    if "Fc" not in standard.terms or standard.smoothing:
        return still, np.zeros(standard.model.n)
    return still, np.where(still, np.inf, np.maximum(thresholds.SLOWEST_FITTED * largest, floor))
