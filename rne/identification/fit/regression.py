"""From records to equations: which of the measurements are fitted, and what is said of the others."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from difflib import get_close_matches
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ...basics.arrays import vector, whole_number
from ...basics.spatial import Array
from ...basics.text import listed
from ...dynamics.base_inertial_parameters import BaseParameters
from ...model.standard_parameters import StandardParameters
from ...robot import Robot
from ...simulation.motion_files import numbered_joints
from ..log.filtering import low_pass, settling
from ..log.prepared import Prepared, undisturbed
from ..log.record import Record
from ..log.screening import consecutive
from .equations import Equations, RecordEquations, equations, joined, record_equations, triangular
from .least_squares import correlation_time_of_filtered_noise, correlation_time_of_residuals, solve

FOLDS = 10  # of the cross-validation, contiguous in time
SLOWEST = 0.02  # of a joint's largest velocity: below it, Coulomb friction has no known direction
STEPS_AT_REST = 2.0  # of the encoder, within which a joint at rest stays of its mean position
ROUNDINGS = 1e3  # of a position, within which it does not change


class RegressionData(NamedTuple):
    """The equations of several records."""

    names: tuple[str, ...]  # of the records
    prepared: tuple[Prepared, ...]
    minimum_velocity: Array  # of equations that are fitted, shape (n,); infinite for a joint that does not move
    rows: list[RecordEquations]
    fitted: Equations  # in folds of time
    measured: Equations  # to check the fit on, likewise
    delays: Array  # by which torques were measured later than positions, shape (records, n) [s]
    notes: tuple[str, ...]

    def residuals(self, x: Array) -> list[Array]:
        """Measured less predicted torques of each record, of standard parameters x."""
        return [row.tau - row.Y @ x for row in self.rows]

    def at_lower_cutoff(self, base: BaseParameters, noise: Array) -> tuple[Array, Array]:
        """Base parameters and standard errors with half the cut-off, from equations that no joint at rest enters.

        `noise` is the square root of the residuals' spectral density at low frequencies, of which half the cut-off
        leaves the same, shape (n,). NaN for what the equations do not tell.
        """
        parts = []
        for record, row in zip(self.prepared, self.rows, strict=True):
            cutoff, rate = record.cutoff / 2, record.sample_rate / record.decimation
            reach = settling(cutoff, rate)
            both = np.concatenate([row.Y @ base.back, row.tau[..., None]], axis=-1) / noise[:, None]
            for part in consecutive(record.segment_lengths):
                inner = np.arange(reach, part.stop - part.start - reach)
                if len(inner):
                    sound = undisturbed(~row.used[part], inner, reach)
                    parts.append(low_pass(both[part], cutoff, rate, inner)[sound])
        rows = np.concatenate(parts) if parts else np.zeros((0, base.count + 1))
        found = solve(triangular(rows))
        unknown = found.free | (len(rows) <= 2 * base.count)
        errors = np.linalg.norm(found.inverse, axis=1)
        return np.where(unknown, np.nan, found.x), np.where(unknown, np.nan, errors)

    def correlation_time(self, x: Array) -> Array:
        """Integrated autocorrelation time of the residuals of parameters x, in rows, shape (n,)."""
        return self.correlation_time_of(np.concatenate(self.residuals(x)), np.concatenate([r.used for r in self.rows]))

    def correlation_time_of(self, residuals: Array, used: Array) -> Array:
        """That of some residuals over the rows that are used, at least that of filtered noise."""
        parts = consecutive(length for record in self.prepared for length in record.segment_lengths)
        of_noise = [correlation_time_of_filtered_noise(p.cutoff, p.sample_rate, p.decimation) for p in self.prepared]
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
    rows = [record_equations(robot, standard, record, slowest, still) for record in prepared]
    if still.all() and len(still):
        raise ValueError("`records` show no joint that moves: one pose says nothing of inertias and friction")
    count = sum(int(r.used.sum()) for r in rows)
    if count <= base.count:
        raise ValueError(
            f"`records` give {count} equations for {base.count} base parameters: a longer motion is needed, or a "
            "higher `cutoff`"
        )
    each, shortest = max(-(-folds // len(prepared)), 2), min(len(r.tau) for r in rows)
    if each > shortest:
        raise ValueError(f"`folds` must be at most {shortest * len(rows)}, got {folds}: there are no more equations")
    parts = [(r, record.blocks(each)) for r, record in zip(rows, prepared, strict=True)]
    measured = fitted = joined([equations(r.Y, r.tau, r.used, blocks) for r, blocks in parts])
    if any((r.used != r.valid).any() for r in rows):
        measured = joined([equations(r.Y, r.tau, r.valid, blocks) for r, blocks in parts])
    names = listed([robot.joint_names[j] for j in np.flatnonzero(still)])
    lost = " and ".join(name for name, term in (("rotor", "Ia"), ("friction", "Fv")) if term in standard.terms)
    silent = [robot.joint_names[j] for j in np.flatnonzero(measured.rows.sum(0) == 0)]
    does, its = ("does", "its") if still.sum() == 1 else ("do", "their")
    notes: tuple[str, ...] = (
        (f"{names} {does} not move" + (f": {its} {lost} cannot be found" if lost else ""),) if names else ()
    )
    notes += tuple(f"{name} has no torque that can be used" for name in silent)
    names_of_records = tuple(record.name for record in given)
    return RegressionData(names_of_records, prepared, slowest, rows, fitted, measured, late, notes)


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
    named = [r for r in given if isinstance(r, Record) and r.joint_names != numbered_joints(r.n)]
    known = set(robot.joint_names).intersection(*(record.joint_names for record in named))
    if not named or len(named) < len(given) or not known:
        return robot, given, ()
    model, notes = robot.model, []
    missing = {name: 0.0 for name in robot.joint_names if name not in known}
    others = sorted({name for record in named for name in record.joint_names} - set(robot.joint_names))
    for j, name in zip(model.independent_joints, robot.joint_names, strict=True):
        if name in missing:
            if alike := get_close_matches(name, others, cutoff=0.8):
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
    if record.joint_names not in (robot.joint_names, numbered_joints(robot.n)):
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
    still = reach <= np.maximum(STEPS_AT_REST * step, ROUNDINGS * np.finfo(float).eps * np.abs(middle))
    largest = np.max([np.abs(p.qd).max(0) for p in prepared], axis=0)
    floor = 2 * np.pi * max(p.cutoff for p in prepared) * step  # velocities that one step makes at the cut-off
    if given is not None:
        return still, vector("minimum_velocity", given, standard.model.n, sign="not negative")
    if "Fc" not in standard.terms or standard.smoothing:
        return still, np.zeros(standard.model.n)
    return still, np.where(still, np.inf, np.maximum(SLOWEST * largest, floor))
