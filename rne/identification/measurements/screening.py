"""Faults of measurements: found, named, and taken out where that is possible."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ...basics.spatial import Array
from .findings import Findings, RecordFinding, runs
from .grid import Segment, sample_period, split
from .outliers import encoder_step, jumps, repeated, usual_deviation, wild_values
from .stamps import Stamps, check_order, check_regularity

FEWEST = 20  # samples from which anything can be said
SLOWEST = 2.0  # samples per second, below which times are hardly in seconds: 1 kHz in milliseconds gives 1
MOVED = 8.0  # steps of the encoder, in which a robot moves
PLATEAU = 5  # samples at a torque's extreme, in a motion, that are a plateau
LONGER = 3  # times the usual runs of equal torques, for a plateau
RATES = 0.05  # deviation of measured rates from those of the positions that is named
RESTING = 0.01  # motion as a part of the fastest, of a joint whose rates are not compared
SPAN = 0.1  # seconds over which these are compared
ONE_STEP = 1.5  # steps of the encoder, below which a position that flickers between two values stays
TURNS = 20 * np.pi  # range of a position [rad] from which degrees are likely
NEAR = 4  # samples on either side of a value that is interpolated


class Measured(NamedTuple):
    """What was measured, in SI units; qd may be missing."""

    t: Array
    q: Array
    tau: Array
    qd: Array | None


@dataclass(frozen=True)
class Screened:
    """Measurements without the values that cannot be used.

    Attributes
    ----------
    t : ndarray, shape (T,)
        Times, as measured or equally spaced [s].
    q, tau : ndarray, shape (T, n)
        With single wild or missing values interpolated.
    usable : ndarray, shape (T, n)
        False where a torque is not to be used.
    segments : tuple of Segment
        The parts between gaps.
    period : float
        Time from one sample to the next [s].
    encoder_step : ndarray, shape (n,)
        Smallest step of the positions; zero where there is none.
    findings : tuple of RecordFinding
        What was found.
    """

    t: Array
    q: Array
    tau: Array
    usable: Array
    segments: tuple[Segment, ...]
    period: float
    encoder_step: Array
    findings: tuple[RecordFinding, ...]


def screen(name: str, joint_names: tuple[str, ...], measured: Measured, bridge: int, stamps: Stamps) -> Screened:
    """Find what is wrong, and take out or cut what can be."""
    t, q, tau, qd = measured
    found = Findings(name, joint_names, t)
    columns = [q, tau] if qd is None else [q, tau, qd]
    kept = check_order(found, t, np.hstack(columns)) & _numbers(found, columns)
    steps = np.array([encoder_step(x[np.isfinite(x)]) for x in q.T])
    usable = np.ones(q.shape, dtype=bool)
    if found.has_errors or kept.sum() < FEWEST:
        if not found.has_errors:
            found.error(None, "too few samples:", f"{int(kept.sum())} are usable", f"at least {FEWEST} are needed")
        return Screened(t, q, tau, usable, (), float("nan"), steps, tuple(found.found))
    found.rows = np.flatnonzero(kept)
    t, q, tau = t[kept], q[kept], tau[kept]
    period = sample_period(t, bridge)
    if 1 / period < SLOWEST:
        found.error(None, "sample rate", f"of {1 / period:.4g} samples per second", "are the times in seconds?")
    times = check_regularity(found, t, q, period, bridge, stamps)
    missing, cuts = _outliers(found, t, q, tau, steps, bridge)
    long_runs = np.zeros(len(t), dtype=bool)
    for values, flags in zip((q, tau), missing, strict=True):
        long_runs |= _interpolate(times, values, flags, bridge)
    usable = _usable_torques(found, q, tau, steps)
    _check_motion(found, q, steps)
    _check_range(found, q)
    if qd is not None:
        _check_rates(found, t, q, qd[kept], period)
    segments = () if found.has_errors else split(times, ~long_runs, period, bridge, cuts)
    return Screened(times, q, tau, usable, tuple(segments), period, steps, tuple(found.found))


def _numbers(found: Findings, columns: list[Array]) -> Array:
    """True at samples of which all values are finite."""
    for name, values in zip(("position", "torque", "rate"), columns, strict=False):
        for j, x in enumerate(values.T):
            bad = np.flatnonzero(~np.isfinite(x))
            if len(bad):
                found.warning(j, f"no finite {name}", found.at(bad), "taken as missing samples", bad)
    finite: Array = np.isfinite(np.hstack(columns)).all(axis=1)
    return finite


def _outliers(
    found: Findings, t: Array, q: Array, tau: Array, steps: Array, bridge: int
) -> tuple[tuple[Array, Array], Array]:
    """Where positions and torques are not to be believed, and the samples after which the positions jump."""
    quantum = [encoder_step(x) for x in tau.T]
    usual = np.column_stack([usual_deviation(x, s) for x, s in zip(q.T, steps, strict=True)])
    stuck = np.column_stack([repeated(x, s) for x, s in zip(q.T, steps, strict=True)])
    missing = stuck, np.zeros(tau.shape, dtype=bool)
    for j, flags in enumerate(missing[0].T):
        _name(found, j, "repeated position", flags, bridge)
    after_gap = np.flatnonzero(np.diff(t) > 1.5 * np.median(np.diff(t)))
    cuts: set[int] = set()
    for j, x in enumerate(q.T):
        wild = wild_values(x, usual[:, j]) & ~missing[0][:, j]
        _name(found, j, "wild position", wild, bridge)
        jumped = jumps(x, usual[:, j])
        jumped = jumped[~missing[0][jumped, j] & ~missing[0][jumped + 1, j] & ~wild[jumped] & ~wild[jumped + 1]]
        jumped = np.setdiff1d(jumped, after_gap)
        if len(jumped):
            size = np.abs(x[jumped + 1] - x[jumped]).max()
            where = f"after {found.at(jumped).removeprefix('at ')}, by up to {size:.4g}"
            found.warning(j, "jump of the position", where, "the record is cut there", jumped)
            cuts.update(jumped.tolist())
        missing[0][:, j] |= wild
    for j, x in enumerate(tau.T):
        wild = wild_values(x, usual_deviation(x, quantum[j]))
        _name(found, j, "wild torque", wild, bridge)
        missing[1][:, j] |= wild
    return missing, np.array(sorted(cuts), dtype=int)


def _name(found: Findings, joint: int, kind: str, flags: Array, bridge: int) -> None:
    """One warning on samples that are not to be believed."""
    samples = np.flatnonzero(flags)
    if not len(samples):
        return
    lengths = [b - a for a, b in runs(flags)]
    cut = sum(length > bridge for length in lengths)
    cure = "interpolated" if not cut else f"interpolated up to {bridge} in a row, cut out at {cut} longer runs"
    found.warning(joint, kind, found.at(samples), cure if bridge else "cut out", samples)


def _interpolate(t: Array, values: Array, flags: Array, bridge: int) -> Array:
    """Replace short runs of flagged values by cubics through their neighbours; True at samples of the longer runs."""
    from scipy.interpolate import CubicSpline

    long_runs = np.zeros(len(t), dtype=bool)
    for j, x in enumerate(values.T):
        for a, b in runs(flags[:, j]):
            near = np.arange(max(a - NEAR, 0), min(b + NEAR, len(t)))
            near = near[~flags[near, j]]
            if b - a > bridge or len(near) < 4:
                long_runs[a:b] = True
            else:
                x[a:b] = CubicSpline(t[near], x[near])(t[a:b])
    return long_runs


def _usable_torques(found: Findings, q: Array, tau: Array, steps: Array) -> Array:
    """False where a torque does not follow the motion: constant channels and plateaus at the extremes."""
    usable = np.ones(tau.shape, dtype=bool)
    for j, x in enumerate(tau.T):
        if np.ptp(x) == 0:
            found.warning(j, "constant torque", f"of {x[0]:.6g} in all samples", "no row of this joint is used")
            usable[:, j] = False
            continue
        plateau = _plateau(x, q, steps)
        if plateau.any():
            usable[plateau, j] = False
            samples = np.flatnonzero(plateau)
            text = f"of {x[samples[0]]:.6g} {found.at(samples)}"
            found.warning(j, "saturated torque", text, "rows of this joint near it are not used", samples)
    return usable


def _plateau(x: Array, q: Array, steps: Array) -> Array:
    """Runs of a torque's largest or smallest value while the robot moves."""
    plateau = np.zeros(len(x), dtype=bool)
    same = runs(np.concatenate([np.diff(x) == 0, [False]]))  # the last sample of a run is not in it
    extreme = [(a, b + 1) for a, b in same if x[a] in (x.min(), x.max())]
    others = [b + 1 - a for a, b in same if x[a] not in (x.min(), x.max())]
    least = max(PLATEAU, LONGER * float(np.percentile(others, 99)) if others else 0.0)
    for a, b in extreme:
        moved = np.abs(q[b - 1] - q[a]) > MOVED * steps
        if b - a >= least and moved.any():
            plateau[a:b] = True
    return plateau


def _check_motion(found: Findings, q: Array, steps: Array) -> None:
    """Joints must move by more than one step of their encoders."""
    resting = [
        j for j, x in enumerate(q.T) if np.ptp(x) <= ONE_STEP * steps[j] or bool(np.isin(x, (x.min(), x.max())).all())
    ]
    if len(resting) == q.shape[1]:
        cure = "nothing can be found from one pose: measure while the joints move"
        found.error(None, "no motion", "of any joint", cure)
        return
    for j in resting:
        found.warning(j, "no motion", "at any time", "its friction and rotor cannot be found from this record")


def _check_range(found: Findings, q: Array) -> None:
    for j, x in enumerate(q.T):
        if np.ptp(x) > TURNS:
            text = f"of {np.ptp(x):.4g} rad, {np.ptp(x) / (2 * np.pi):.3g} turns"
            cure = 'pass unit="deg" if these are degrees, and use `Record.from_motors` if they are the motors\''
            found.warning(j, "range of the positions", text, cure)


def _check_rates(found: Findings, t: Array, q: Array, qd: Array, period: float) -> None:
    """Measured rates must be those of the positions: their integrals over short spans, least squares."""
    width = max(1, int(SPAN / period))
    area = np.concatenate([np.zeros((1, q.shape[1])), np.cumsum((qd[1:] + qd[:-1]) / 2 * np.diff(t)[:, None], axis=0)])
    moved, integral = (x[width:] - x[:-width] for x in (q, area))
    for j in range(q.shape[1]):
        size = float(moved[:, j] @ moved[:, j])
        if size <= (RESTING * np.abs(moved).max()) ** 2 * len(moved):
            continue
        factor = float(moved[:, j] @ integral[:, j]) / size
        if abs(factor - 1) > RATES:
            cure = "the rates are not used; check their unit, sign and joint"
            found.warning(j, "measured rates", f"are {factor:.4g} times those of the positions", cure)
