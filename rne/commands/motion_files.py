"""Motions from CSV files, for `rne torques` and `rne view`: units, noise, filtering, differentiation.

A file can be read without an error and still be wrong: times in milliseconds, angles in degrees or wrapped, noise that
differentiation amplifies. You are told of each; the numbers change only if an option asks for it.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from .shared import CommandError, in_one_line, note

if TYPE_CHECKING:
    import rne

    from ..basics.spatial import Array

TURN = 2 * np.pi
UNEVEN = 100  # ratio of the longest to the shortest step, above which a warning is given
EVEN = 1e-2  # largest difference of steps that a filter takes as even, relative to their mean
FEW = 30  # samples that an estimate of noise needs
WINDOWS = 20_000  # of a long file, from which noise is estimated
ORDERS = (6, 9)  # of the differences that show noise
STEADY = 0.7  # smallest ratio of the two estimates for noise: those of a smooth motion fall with the order
MEDIAN = 0.6745  # of the size of a standard normal number
RESIDUAL = 1.2  # ratio of what a filter removes to the noise


class SampledMotion(NamedTuple):
    """Samples at times t (K,) of positions and, if they are known, velocities and accelerations (K, n), in SI units."""

    t: Array
    q: Array
    qd: Array | None
    qdd: Array | None


def add_units(parser: argparse.ArgumentParser) -> None:
    """Add the options for the units of a CSV file."""
    parser.add_argument("--degrees", action="store_true", help="q, qd and qdd of rotating joints are in degrees")
    unit = "unit of the column t (default: seconds; times that look like another unit are refused)"
    parser.add_argument("--time-unit", choices=("s", "ms", "us", "ns"), help=unit)


def read_motion(file: Path, robot: rne.Robot, arguments: argparse.Namespace) -> SampledMotion:
    """Read the motion in a CSV file, whose columns the robot's joints name, in the units of `add_units`.

    Times that look like another unit are refused; if the angles do so, a warning is given.
    """
    from ..trajectories.csv_file import FACTOR, SPIKED, MissingColumn, Samples, in_seconds, read_samples, velocity_ratio

    heading = ",".join(["t", *(f"q.{joint}" for joint in robot.joint_names)])
    needed = f"; the first row must be {heading}, with qd. and qdd. of the joints if they are known"
    try:
        samples = read_samples(file, robot.joint_names)
    except ValueError as error:
        raise CommandError(in_one_line(error) + needed * isinstance(error, MissingColumn)) from None
    if samples.q is None:
        raise CommandError(f"{file}: there are no positions{needed}")
    unit = np.where(rotating(robot) & arguments.degrees, np.pi / 180, 1.0)
    q = samples.q * unit
    qd, qdd = (None if x is None else x * unit for x in (samples.qd, samples.qdd))
    try:
        cure = "give --time-unit {}, or s if they are seconds"
        t = in_seconds(file, Samples(samples.t, q, qd), arguments.time_unit, cure, robot.velocity_limit).t
    except ValueError as error:
        raise CommandError(in_one_line(error)) from None
    if qd is not None and len(t) >= SPIKED and not 1 / FACTOR < (ratio := velocity_ratio(t, q, qd) or 1.0) < FACTOR:
        note(f"warning: qd is {ratio:.3g} times the differences of q over those of t; check their units and signs")
    _warn_of_degrees(q, robot)
    return SampledMotion(t, q, qd, qdd)


def rotating(robot: rne.Robot) -> Array:
    """True for each joint that rotates, shape (n,)."""
    return np.asarray(robot.model.is_revolute)[list(robot.model.independent_joints)]


def _warn_of_degrees(q: Array, robot: rne.Robot) -> None:
    """Warn if a joint is more than a turn beyond its range, and all joints are within theirs with q in degrees."""
    beyond = np.where(rotating(robot), np.maximum(robot.lower - q, q - robot.upper).max(axis=0), 0.0)
    radians = np.where(rotating(robot), np.radians(q), 0.0)
    inside = ((robot.lower <= radians) & (radians <= robot.upper)) | ~rotating(robot)
    if (beyond > TURN).any() and inside.all():
        k = int(beyond.argmax())
        note(
            f"warning: q.{robot.joint_names[k]} is up to {np.abs(q[:, k]).max():.4g} rad, more than a turn beyond the "
            "joint's range; if q is in degrees, give --degrees"
        )


def refuse_wrapped_angles(motion: SampledMotion, robot: rne.Robot, file: Path) -> None:
    """Refuse a jump by about a turn between small steps: its derivative would be a huge velocity."""
    if len(motion.t) < 3:
        return
    for k in np.flatnonzero(rotating(robot)):
        step = np.diff(motion.q[:, k])
        beside = np.pad(np.abs(step), 1)
        beside = np.maximum(beside[:-2], beside[2:])
        wrapped = np.flatnonzero((np.abs(np.abs(step) - TURN) < TURN / 4) & (beside < TURN / 4))
        if len(wrapped):
            i = wrapped[0]
            raise CommandError(
                f"{file}: q.{robot.joint_names[k]} jumps by {step[i]:.4g} rad between t = {motion.t[i]:.6g} s and "
                f"{motion.t[i + 1]:.6g} s, as wrapped angles do; unwrap them, for example by numpy.unwrap"
            )


def differentiated(motion: SampledMotion, file: Path) -> tuple[Array, Array, Array, str]:
    """Positions, velocities and accelerations, by splines where the file has none, and a line on their source."""
    import rne

    t, q, qd, qdd = motion
    if qd is not None and qdd is not None:
        return q, qd, qdd, f"q, qd and qdd from {file}"
    try:
        path = rne.trajectories.spline(t, q if qd is None else qd)
    except ValueError as error:
        what = "velocities and accelerations" if qd is None else "accelerations"
        raise CommandError(f"{file}: {what} are missing, and no spline gives them: {in_one_line(error)}") from None
    _, first, second = path(t)
    kind = f"spline of degree {path.degree}"
    if qd is not None:
        return q, qd, first, f"q and qd from {file}; qdd: derivative of a {kind} through qd"
    if qdd is not None:
        return q, first, qdd, f"q and qdd from {file}; qd: derivative of a {kind} through q"
    return q, first, second, f"q from {file}; qd and qdd: derivatives of a {kind} through q"


def noise(t: Array, x: Array) -> Array:
    """Standard deviation of white noise in samples of smooth motions; zero where there is none, or too few samples.

    A divided difference of high order, normalised by the norm of its weights, has the standard deviation of the noise,
    while a smooth motion nearly vanishes in it. The median ignores the corners of a motion.
    """
    if len(t) < FEW:
        return np.zeros(x.shape[1])
    low, high = (_scatter(t, x, order) for order in ORDERS)
    return np.where(high > STEADY * low, np.minimum(low, high), 0.0)


def _scatter(t: Array, x: Array, order: int) -> Array:
    """Standard deviation of normalised divided differences by the median of those that are not zero, as at rest."""
    every = slice(None, None, 1 + len(t) // WINDOWS)
    times = np.lib.stride_tricks.sliding_window_view(t, order + 1)[every]
    times = (times - times[:, :1]) / (times[:, -1:] - times[:, :1])
    weights = 1 / (times[:, :, None] - times[:, None, :] + np.eye(order + 1)).prod(-1)
    weights /= np.linalg.norm(weights, axis=1, keepdims=True)
    windows = np.lib.stride_tricks.sliding_window_view(x, order + 1, axis=0)[every]
    size = np.abs(np.einsum("kp,kjp->kj", weights, windows))
    return np.array([np.median(column[column > 0]) if column.any() else 0.0 for column in size.T]) / MEDIAN


def filtered(motion: SampledMotion, cutoff: float) -> tuple[SampledMotion, str]:
    """The motion after a Butterworth filter of second order, forwards and backwards, and a line on the change of q."""
    t, q, qd, qdd = motion
    step = _even_step(t)
    if step is None:
        raise CommandError("--cutoff: needs times at even steps")
    if not 0 < cutoff < 0.5 / step:
        raise CommandError(f"--cutoff: must be between 0 and {0.5 / step:g} Hz, half the sampling rate; got {cutoff:g}")
    smooth = _low_pass(q, cutoff * step)
    change = np.abs(smooth - q).max(initial=0.0)
    text = f"zero-phase Butterworth filter of {cutoff:g} Hz; it changes q by at most {change:.2g} rad or m"
    qd, qdd = (None if x is None else _low_pass(x, cutoff * step) for x in (qd, qdd))
    return SampledMotion(t, smooth, qd, qdd), text


def _even_step(t: Array) -> float | None:
    """The time between samples, None if it varies."""
    steps = np.diff(t)
    return float(steps.mean()) if len(steps) and np.ptp(steps) <= EVEN * steps.mean() else None


def _low_pass(x: Array, cutoff: float) -> Array:
    """Filter each column, with a cut-off in cycles per sample; beyond the ends it is continued by point symmetry."""
    from scipy.signal import butter, sosfiltfilt

    pad = min(len(x) - 1, max(9, round(1 / cutoff)))
    y: Array = sosfiltfilt(butter(2, cutoff, fs=1.0, output="sos"), x, axis=0, padlen=pad)
    return y


def suggested_cutoff(t: Array, x: Array, sigma: Array) -> float | None:
    """The lowest cut-off at which a filter removes no more than the noise [Hz]; None if steps vary.

    Residual analysis: D. A. Winter, Biomechanics and Motor Control of Human Movement, 4th ed., 2009, chapter 3.
    """
    step = _even_step(t)
    if step is None:
        return None
    for cutoff in np.geomspace(1 / len(t), 0.45, 40):
        residual = np.sqrt(((x - _low_pass(x, cutoff)) ** 2).mean(axis=0))
        if (residual <= RESIDUAL * sigma)[sigma > 0].all():
            return float(cutoff / step)
    return None


def warn_of_uneven_steps(t: Array) -> None:
    """Warn if some samples are much closer than others: derivatives amplify their rounding."""
    shortest, longest = np.diff(t).min(initial=np.inf), np.diff(t).max(initial=0.0)
    if longest > UNEVEN * shortest:
        note(
            f"warning: the times are {shortest:.2g} to {longest:.2g} s apart; where they are close, derivatives "
            "amplify the rounding of the samples: give samples at even times, or velocities and accelerations"
        )
