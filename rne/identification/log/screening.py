"""Faults of measurements: found, named, and taken out where that is possible.

Times that are not in order, samples that those beside them contradict, torques that do not follow the motion.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import partial
from itertools import pairwise
from typing import Literal

import numpy as np

from ...basics.spatial import Array
from ...basics.text import counted, summary
from ...trajectories.csv_file import guessed_unit

NAMED = 3  # samples that a text names


def seconds(t: float) -> str:
    """Seconds from a record's first stamp, to a millisecond."""
    return f"{round(float(t), 3):.12g}"


@dataclass(frozen=True)
class RecordFinding:
    """One error or warning about measurements.

    Attributes
    ----------
    severity : {"error", "warning"}
        A record with errors is not prepared for a fit; of warnings, the cure says what is done.
    record : str
        The record's name.
    joint : str
        The joint; empty if all are concerned.
    kind : str
        What was found, such as "position spike" or "gap".
    text : str
        Where, and by how much.
    cure : str
        What is done about it, or what to do.
    samples : tuple of int
        The samples concerned, as indices of the record's arrays.

    Examples
    --------
    >>> import rne
    >>> finding = rne.identification.RecordFinding("warning", "run 1", "", "gap", "after sample 7", "cut here", (7,))
    >>> print(finding)
    warning: run 1: gap after sample 7; cut here
    """

    severity: Literal["error", "warning"]
    record: str
    joint: str
    kind: str
    text: str
    cure: str
    samples: tuple[int, ...] = ()

    __repr__ = summary

    def __str__(self) -> str:
        return f"{self.severity}: {self.message}"

    @property
    def message(self) -> str:
        """All but the severity."""
        joint = f"{self.joint}: " if self.joint else ""
        return f"{self.record}: {joint}{self.kind} {self.text}; {self.cure}"


class Findings:
    """Collects the findings on one record; `rows` are the record's samples that indices refer to."""

    def __init__(self, record: str, joint_names: tuple[str, ...], t: Array) -> None:
        self.record, self.joint_names, self.t = record, joint_names, t
        self.rows: Array = np.arange(len(t))
        self.found: list[RecordFinding] = []

    def warning(
        self,
        joint: int | None,
        kind: str,
        text: str,
        cure: str,
        samples: Iterable[int] = (),
        severity: Literal["error", "warning"] = "warning",
    ) -> None:
        """Add a finding; `joint` is None for all joints."""
        name = "" if joint is None else self.joint_names[joint]
        indices = tuple(int(self.rows[k]) for k in samples)
        self.found.append(RecordFinding(severity, self.record, name, kind, text, cure, indices))

    def error(self, kind: str, text: str, cure: str, samples: Iterable[int] = ()) -> None:
        """Add an error that concerns all joints."""
        self.warning(None, kind, text, cure, samples, "error")

    @property
    def has_errors(self) -> bool:
        """True if an error is among them."""
        return any(finding.severity == "error" for finding in self.found)

    def at(self, samples: Array) -> str:
        """Where these samples are, the first ones with their times from the first stamp."""
        named = ", ".join(f"{k} (t = {seconds(self.t[k] - self.t[0])} s)" for k in self.rows[samples[:NAMED]])
        if len(samples) == 1:
            return f"at sample {named}"
        more = f" and {len(samples) - NAMED} more" if len(samples) > NAMED else ""
        return f"at {counted(len(samples), 'sample')}: {named}{more}"

    def after(self, samples: Array) -> str:
        """After which samples, the first ones with their times."""
        return "after " + self.at(samples).removeprefix("at ")


def runs(flags: Array) -> list[tuple[int, int]]:
    """Start and end (exclusive) of each run of True in a vector."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], flags, [False]]).astype(np.int8)))
    return [(int(a), int(b)) for a, b in edges.reshape(-1, 2)]


def consecutive(lengths: Iterable[int]) -> tuple[slice, ...]:
    """Slices of these lengths, one after the other."""
    ends = np.cumsum([0, *lengths]).tolist()
    return tuple(slice(a, b) for a, b in pairwise(ends))


# Times

Stamps = Literal["auto", "sampled", "regular"]
REGULAR = 0.02  # deviation of stamps from equal steps that is none, as a part of the period
LOST = 0.02  # share of steps that are whole periods, of samples that the log has lost
LAG = 1000  # samples over which the period of counted samples is taken
PAUSES = 0.005  # share of steps from which pauses belong to the stamps, and are no gaps
KNOTS = 10.0  # seconds, and
KNOT_SAMPLES = 1000  # samples, between changes of the step that is fitted to stamps
CLOSE = 0.3  # step as a part of the period, below which one of two samples is enough for a spline


def check_order(found: Findings, t: Array, rows: Array, stamps: Stamps) -> Array:
    """True at samples to keep: times must ascend, and `rows` that are there twice are kept once."""
    kept = np.ones(len(t), dtype=bool)
    steps = np.diff(t)
    same, back = np.flatnonzero(steps == 0) + 1, np.flatnonzero(steps < 0) + 1
    if len(back):
        text = f"{found.at(back)}, after {seconds(t[back[0] - 1] - t[0])} s"
        found.error("time that goes back", text, "sort the samples, or pass each motion as a record", back)
    twice = np.array([np.array_equal(rows[k], rows[k - 1], equal_nan=True) for k in same], dtype=bool)
    if twice.all() and len(same):
        found.warning(None, "sample twice", found.at(same), "the second is left out", same)
        kept[same] = False
    elif len(same) and (stamps == "sampled" or _pauses(t, 0)[0] == 0):
        _refuse_same(found, same[~twice])
    return kept


def _refuse_same(found: Findings, same: Array) -> None:
    cure = "give times with more digits, or the index divided by the sample rate"
    found.error("one time for different samples", found.at(same), cure, same)


def check_stamps(found: Findings, t: Array, q: Array, bridge: int, stamps: Stamps) -> tuple[Array, float]:
    """The times to use, and their period: the stamps, or equal steps where these were made by the reader of the log."""
    steps = np.diff(t)
    usual = np.abs(steps - np.median(steps)) <= np.median(steps) / 2
    period = float(steps[usual].mean())
    counted_period, gap = _pauses(t, bridge)
    by_count = _equal_steps(t, gap, counted_period)
    whole = np.clip(np.rint(steps / period), 1, bridge + 1) if period else steps
    is_grid = (whole > 1).mean() <= LOST and (np.abs(steps - whole * period) <= REGULAR * period).all()
    if stamps == "sampled" or (period and (is_grid or np.abs(t - by_count).max() <= REGULAR * period)):
        reason = ""
    elif stamps == "regular":
        reason = "as `stamps` says"
    else:
        reason = _made_by_reader(t, q, by_count, gap, counted_period)
    if reason:
        off, usual = 1e3 * float(np.std(t - by_count)), 1e3 * counted_period
        text = f"differ from equal steps by {off:.3g} ms (standard deviation; period {usual:.4g} ms)"
        cure = f"samples are counted, {reason}"
        found.warning(None, "stamps that are not the samples'", text, cure)
        t, period = by_count, counted_period
    elif (same := np.flatnonzero(steps == 0) + 1).size:
        _refuse_same(found, same)
    else:
        gap = steps > (bridge + 1.5) * period
    _check_gaps(found, t, period, gap)
    return t, period


def _pauses(t: Array, bridge: int) -> tuple[float, Array]:
    """Period of samples that are counted, and where the log has a gap: a step far above the usual pauses."""
    lag = max(1, min(LAG, len(t) // 4))
    period, steps = float(np.median(t[lag:] - t[:-lag])) / lag, np.diff(t)
    pauses = steps[steps > 1.5 * period]
    usual = float(np.median(pauses)) if len(pauses) > PAUSES * len(steps) else 0.0
    return period, steps > max((bridge + 1.5) * period, 3 * usual)


def _equal_steps(t: Array, gap: Array, period: float) -> Array:
    """Equal steps between gaps, fitted to the stamps by lines of some seconds each."""
    from scipy.interpolate import make_lsq_spline

    equal = t.copy()
    for part in np.split(np.arange(len(t)), np.flatnonzero(gap) + 1):
        count = int(len(part) / max(KNOTS / period, KNOT_SAMPLES)) if period > 0 else 1
        if len(part) > 2:
            index = np.arange(len(part), dtype=float)
            knots = np.linspace(0, index[-1], max(count, 1) + 1)
            equal[part] = make_lsq_spline(index, t[part], np.concatenate([knots[:1], knots, knots[-1:]]), k=1)(index)
    return equal


def _made_by_reader(t: Array, q: Array, equal: Array, gap: Array, period: float) -> str:
    """Why samples are counted, or nothing if the stamps are believed.

    What stamps are late by, times the velocity, is in the positions where samples were taken at the stamps, and is not
    where the reader of the log made them: its share in the fourth differences of the positions is 1 or 0.
    """
    from scipy.ndimage import uniform_filter1d

    pauses = max(1, int((np.diff(t) > 1.5 * period).sum()))
    width = int(np.clip(2 * len(t) / pauses, 9, 101))  # of velocities: more than a burst
    velocity = uniform_filter1d(np.gradient(q, axis=0), width, axis=0) / period
    group = np.concatenate([[0], np.cumsum(gap)])
    whole = group[4:] == group[:-4]
    late = np.diff(velocity * (t - equal)[:, None], 4, axis=0)[whole]
    moved = np.diff(q, 4, axis=0)[whole]
    scale = np.mean(moved**2, axis=0)
    weight = np.divide(1, scale, out=np.zeros_like(scale), where=scale > 0)
    known = float((weight * late**2).sum())
    share = float((weight * late * moved).sum()) / known if known else 0.0
    error = 3 / np.sqrt(known) if known else np.inf  # fourth differences of noise are correlated
    if share + error < 0.5:
        return "for the positions are smoother over equal steps"
    return "for several have the same time" if (np.diff(t) == 0).any() and share - error < 0.5 else ""


def _check_gaps(found: Findings, t: Array, period: float, gap: Array) -> None:
    """Name gaps and missing samples, steps longer than by jitter."""
    steps = np.diff(t)
    after = np.flatnonzero(gap)
    if len(after):
        text = f"{found.after(after)}; the longest lasts {steps[gap].max():.4g} s"
        found.warning(None, "gap", text, "the record is cut there", after)
    usual = steps[np.abs(steps - period) < period / 2]
    lost = np.flatnonzero((steps > 1.5 * period + 3 * np.std(usual)) & ~gap)
    if len(lost):
        missing = int((np.rint(steps[lost] / period) - 1).sum())
        text = f"{found.after(lost)}: {missing} in all"
        found.warning(None, "missing samples", text, "interpolated by a cubic spline", lost)


# Values

BOUND = 10.0  # times the usual deviation from neighbours, above which a value is a spike
LONGEST = 3  # samples of a spike
WINDOW = 101  # samples from which the usual deviation is taken
NORMAL = 1.4826  # standard deviation of normal noise, per median of its magnitude
EXCEEDED = 95  # per cent of a record's deviations that are below twice the least usual one
COMMON = 0.05  # share of samples from which spikes are noise
FREQUENT = 1.0  # jumps per second, above which they are noise
LATTICE = 0.15  # scatter of differences about multiples of a step, as a part of it; 0.29 without a step
NEGLIGIBLE = 1e-5  # step as a part of the median difference, that is rounding of numbers
FEWEST_DIFFERENCES = 40  # differences from which a step is told


def encoder_step(x: Array) -> float:
    """The step of which all differences of neighbours are multiples; zero if there is none."""
    steps = np.abs(np.diff(x))
    steps = np.sort(steps[steps > 0])
    if len(steps) < FEWEST_DIFFERENCES:
        return 0.0
    step = float(np.median(steps[:FEWEST_DIFFERENCES]))
    for _ in range(5):
        small = steps[steps < 5 * step]
        multiples = np.rint(small / step)
        if not multiples.any():
            return 0.0
        step = float(small @ multiples / (multiples @ multiples))
    scatter = np.sqrt(np.mean((small / step - multiples) ** 2))
    return step if scatter < LATTICE and step > NEGLIGIBLE * np.median(steps) else 0.0


def deviations(x: Array, length: int) -> tuple[Array, Array]:
    """Of `length` samples from the cubic through the two before and the two after, and what these allow for.

    For every start from 2 to len(x) - length - 2: the smallest magnitude among the samples, or the largest where all
    repeat the one before; and by how much the lines through the two before and the two after disagree in the middle,
    with half the larger of their steps.
    """
    count = len(x) - length - 3
    a, b, c, d = (x[k : k + count] for k in (0, 1, 2 + length, 3 + length))
    ends = np.array([-2.0, -1.0, length, length + 1.0])
    smallest, largest, repeats = np.full(count, np.inf), np.zeros(count), np.ones(count, dtype=bool)
    for k in range(length):
        weights = [np.prod([(k - o) / (e - o) for o in ends if o != e]) for e in ends]  # Lagrange's polynomials
        expected = weights[0] * a + weights[1] * b + weights[2] * c + weights[3] * d
        sample = x[2 + k : 2 + k + count]
        off = np.abs(sample - expected)
        smallest, largest = np.minimum(smallest, off), np.maximum(largest, off)
        repeats &= sample == b
    before, after, middle = b - a, d - c, (length + 1) / 2
    disagreement = np.abs((b + middle * before) - (c - middle * after))
    return np.where(repeats, largest, smallest), disagreement + np.maximum(np.abs(before), np.abs(after)) / 2


def usual_deviation(x: Array, step: float) -> Array:
    """Usual deviation of a sample from its neighbours: of the samples about it, or of the record if that is more.

    About a sample the median, of the record the deviation that one in twenty exceeds; at least half a step.
    """
    deviation = np.pad(deviations(x, 1)[0], 2, mode="edge")
    count = max(1, len(x) // WINDOW)
    blocks = deviation[: len(x) // count * count].reshape(count, -1)
    local = np.repeat(NORMAL * np.median(blocks, axis=1), blocks.shape[1])
    local = np.pad(local, (0, len(x) - len(local)), mode="edge")
    return np.asarray(np.maximum(local, max(float(np.percentile(deviation, EXCEEDED)), step) / 2))


def spikes(x: Array, usual: Array) -> Array:
    """True at samples off the curve through their neighbours, up to `LONGEST` in a row (Hampel's identifier)."""
    found = np.zeros(len(x), dtype=bool)
    for length in range(1, LONGEST + 1):
        deviation, allowed = deviations(x, length)
        bound = BOUND * usual[2 : 2 + len(allowed)] + allowed + np.abs(x).max() * 1e-12
        for k in np.flatnonzero(deviation > bound) + 2:
            found[k : k + length] = True
    return found


def jumps(x: Array, usual: Array) -> Array:
    """Samples k between which and the next one the position jumps, while the velocities before and after agree."""
    steps = np.diff(x)
    before, at, after = steps[:-2], steps[1:-1], steps[2:]
    level = np.maximum(usual[1:-2], usual[2:-1])
    smooth = np.maximum(np.abs(before), np.abs(after))
    bound = 2 * BOUND * level + 3 * np.abs(after - before) + smooth
    return np.asarray(np.flatnonzero(np.abs(at - (before + after) / 2) > bound) + 1)


CLIPPED = 10  # samples at a torque's limit, from which it is one
CROWDED = 5  # times as many samples as in twice the width below: a smooth peak has 1.4 times as many
WIDTHS = 1e-6, 1e-3  # of the limit, as a part of the torque's range
ONE_LEVEL, DIGITS = 0.75, 2.5  # of the limit, in steps of the torque
MOST = 0.9  # share of the samples at a limit, which the width that is taken has
LEVELS = 50  # of a torque, from which a limit may spread over some
QUIET = 0.3  # change from sample to sample at a limit, as a part of the usual one in motion, or
PLATEAUS = 3  # times that the limit is reached: a drive that accelerates steadily has its torque once
MOVING = 0.05  # velocity as a part of the joint's usual one


def clipped(x: Array, step: float, moving: Array, spike: Array) -> Array:
    """True where a torque is at a limit: its histogram ends with a peak, of samples in motion."""
    found = np.zeros(len(x), dtype=bool)
    size, changes = np.ptp(x[~spike]), np.abs(np.diff(x))
    widths = sorted(max(part * size, ONE_LEVEL * step) for part in WIDTHS)
    if size > LEVELS * step:
        widths.append(DIGITS * step)
    for y in (x, -x):
        top = y[~spike].max()
        peak = np.zeros(len(x), dtype=bool)
        for width in sorted(widths, reverse=True):
            near, below = (y >= top - width) & ~spike, (y < top - width) & (y >= top - 3 * width)
            count = int((near & moving).sum())
            if count < CLIPPED or count <= CROWDED * (1 + (below & moving).sum()) or count < MOST * peak.sum():
                continue
            within, beyond = (near[1:] & near[:-1]), (moving & ~near)[1:]
            if within.any() and beyond.any():
                is_quiet = np.median(changes[within]) < QUIET * np.median(changes[beyond])
                if is_quiet or sum(b - a > 1 for a, b in runs(near)) >= PLATEAUS:
                    peak = near
        found |= peak
    return found


FEWEST = 20  # samples from which anything can be said
SLOWEST = 2.0  # samples per second, below which times are hardly in seconds: 1 kHz in milliseconds gives 1
VELOCITIES = 0.05  # deviation of measured velocities from those of the positions that is named
RESTING = 0.01  # motion as a part of the fastest, of a joint whose velocities are not compared
SPAN = 0.1  # seconds over which these are compared
ONE_STEP = 1.5  # steps of the encoder, below which a position that flickers between two values stays
ALIKE = 1.5  # scatter about a line, over that of neighbours: positions of less are noise
TURNS = 20 * np.pi  # range of a position [rad] from which degrees are likely
NEAR = 4  # samples on either side of a value that is interpolated


@dataclass(frozen=True)
class Screened:
    """Measurements on an equally spaced grid, without the values that cannot be used."""

    t: Array  # the grid, all segments after each other, shape (T,) [s]
    q: Array  # shape (T, n), single spikes and missing values interpolated; torques and velocities likewise
    tau: Array
    qd: Array | None
    usable: Array  # False where a torque is not to be used, shape (T, n)
    believed: Array  # True for joints whose measured velocities are those of the positions, shape (n,)
    segments: tuple[slice, ...]  # the parts of the grid between gaps
    period: float  # from one sample to the next [s]
    encoder_step: Array  # smallest step of the positions, shape (n,); zero where there is none
    findings: tuple[RecordFinding, ...]
    notes: tuple[str, ...] = ()  # what was done though nothing is wrong


def screen(
    name: str,
    joint_names: tuple[str, ...],
    t: Array,
    q: Array,
    tau: Array,
    qd: Array | None,
    bridge: int,
    stamps: Stamps,
) -> Screened:
    """Find what is wrong, take out or cut what can be, and put the rest on a grid of equal steps."""
    found = Findings(name, joint_names, t)
    n = q.shape[1]
    tau = np.where(np.isfinite(tau).any(0), tau, 0.0)  # a torque that was never read is constant
    columns = {"position": q, "torque": tau} | ({} if qd is None else {"velocity": qd})
    measured = np.hstack(list(columns.values()))
    kept = check_order(found, t, measured, stamps) & _numbers(found, columns)
    steps = np.array([encoder_step(x[np.isfinite(x)]) for x in measured.T])
    usable, believed = np.ones(q.shape, dtype=bool), np.zeros(n, dtype=bool)
    if not np.nan_to_num(tau).any():
        found.error("no torque", "in any sample, all are zero or missing", "did the driver publish efforts?")
    if not found.has_errors and kept.sum() < FEWEST:
        why = "".join(f": {x.joint} has {x.kind} {x.text}" for x in found.found[:1] if x.joint)
        found.error("too few samples:", f"{int(kept.sum())} are usable{why}", f"at least {FEWEST} are needed")
    if found.has_errors:
        return Screened(t, q, tau, qd, usable, believed, (), float("nan"), steps[:n], tuple(found.found))
    found.rows = np.flatnonzero(kept)
    t, measured, usable = t[kept], np.asfortranarray(measured[kept]), usable[kept]
    q, tau = measured[:, :n], measured[:, n : 2 * n]  # views: what is interpolated in `measured` is so in these
    times, period = check_stamps(found, t, q, bridge, stamps)
    unit = guessed_unit(times, q, None if qd is None else measured[:, 2 * n :])
    if unit is not None or 1 / period < SLOWEST:
        tell = found.error if 1 / period < SLOWEST else partial(found.warning, None)
        cure = "are the times in seconds?" if unit is None else f"`t` {unit.said}; divide it by {unit.divisor}"
        tell("sample rate", f"of {1 / period:.4g} samples per second", cure)
    usual = [usual_deviation(x, step) for x, step in zip(measured.T, steps, strict=True)]
    flags = np.column_stack([spikes(x, level) for x, level in zip(measured.T, usual, strict=True)])
    for after in 1 + np.flatnonzero(np.diff(times) > (bridge + 1.5) * period):  # samples beside a gap: no neighbours
        flags[max(after - LONGEST, 0) : after + LONGEST] = False
    usable &= _usable_torques(found, q, tau, steps[n:], flags[:, n : 2 * n])
    flags[:, n : 2 * n] &= usable
    cuts = _check_jumps(found, t, q, usual, flags)
    for k, kind in enumerate(columns):
        part = slice(k * n, (k + 1) * n)
        _check_spikes(found, kind, measured[:, part], flags[:, part], bridge)
    long_runs = _interpolate(times, measured, flags, bridge)
    _check_motion(found, q, steps[:n])
    if qd is not None and not found.has_errors:
        believed = _check_rates(found, t, q, measured[:, 2 * n :], period)
    if found.has_errors:
        return Screened(t, q, tau, qd, usable, believed, (), period, steps[:n], tuple(found.found))
    t, measured, usable, segments, resampled = _on_grid(times, measured, usable, ~long_runs, cuts, period, bridge)
    notes = (f"resampled by a cubic spline through the stamps, every {1e3 * period:.4g} ms",) if resampled else ()
    qd = None if qd is None else measured[:, 2 * n :]
    q, tau = measured[:, :n], measured[:, n : 2 * n]
    return Screened(t, q, tau, qd, usable, believed, segments, period, steps[:n], tuple(found.found), notes)


def _numbers(found: Findings, columns: dict[str, Array]) -> Array:
    """True at samples of which all values are finite."""
    for name, values in columns.items():
        for j, x in enumerate(values.T):
            bad = np.flatnonzero(~np.isfinite(x))
            if len(bad):
                found.warning(j, f"no finite {name}", found.at(bad), "taken as missing samples", bad)
    return np.asarray(np.isfinite(np.hstack(list(columns.values()))).all(axis=1))


def _usable_torques(found: Findings, q: Array, tau: Array, steps: Array, spike: Array) -> Array:
    """False where a torque does not follow the motion: constant channels and torques at their limit."""
    usable = np.ones(tau.shape, dtype=bool)
    moved = np.abs(np.gradient(q, axis=0))
    for j, x in enumerate(tau.T):
        if np.ptp(x) == 0:
            found.warning(j, "constant torque", f"of {x[0]:.6g} in all samples", "no row of this joint is used")
            usable[:, j] = False
            continue
        moving = np.convolve(moved[:, j], np.ones(9) / 9, "same") > MOVING * np.sqrt(np.mean(moved[:, j] ** 2))
        samples = np.flatnonzero(clipped(x, steps[j], moving, spike[:, j]))
        if len(samples):
            usable[samples, j] = False
            text = f"of {x[samples[0]]:.6g} {found.at(samples)}"
            found.warning(j, "saturated torque", text, "rows of this joint near it are not used", samples)
    return usable


def _check_jumps(found: Findings, t: Array, q: Array, usual: list[Array], flags: Array) -> Array:
    """Samples after which the positions jump, where the record is cut; frequent ones are noise."""
    after_gap = np.flatnonzero(np.diff(t) > 1.5 * np.median(np.diff(t)))
    found_jumps = []
    for j, x in enumerate(q.T):
        jumped = jumps(x, usual[j])
        found_jumps.append(np.setdiff1d(jumped[~flags[jumped, j] & ~flags[jumped + 1, j]], after_gap))
    every, joints = np.unique(np.concatenate(found_jumps), return_counts=True)
    sent = (q[every] != q[every - 1]).sum(axis=1)  # joints that did not repeat a position before
    lost = every[2 * np.minimum(joints, sent) > max(q.shape[1], 2)]
    if len(lost):
        text = f"{found.after(lost)}, where most positions jump at once, although the times show none"
        found.warning(None, "missing samples", text, "the record is cut there", lost)
    is_noise = len(every) - len(lost) > FREQUENT * (t[-1] - t[0]) + 1
    for j, jumped in enumerate(found_jumps):
        jumped = np.setdiff1d(jumped, lost)
        if len(jumped):
            size = np.abs(q[jumped + 1, j] - q[jumped, j]).max()
            where = f"{found.after(jumped)}, by up to {size:.4g}"
            cure = "so many are noise of the position" if is_noise else "the record is cut there"
            found.warning(j, "jump of the position", where, cure, jumped)
    return lost if is_noise else every


def _check_spikes(found: Findings, kind: str, values: Array, flags: Array, bridge: int) -> None:
    """Name spikes, and positions that repeat the one before in the midst of a motion; common ones are noise."""
    for j, x in enumerate(values.T):
        samples = np.flatnonzero(flags[:, j])
        if not len(samples):
            continue
        spans = runs(flags[:, j])
        cut = sum(b - a > bridge for a, b in spans)
        cure = "interpolated" if not cut else f"interpolated up to {bridge} in a row, cut out at {cut} longer runs"
        if len(samples) > COMMON * len(x):
            cure, flags[:, j] = "so many are noise", False
        elif not bridge:
            cure = "cut out"
        repeats = np.array([k for a, b in spans if (x[a:b] == x[a - 1]).all() for k in range(a, b)], dtype=int)
        for name, some in ((f"repeated {kind}", repeats), (f"{kind} spike", np.setdiff1d(samples, repeats))):
            if len(some):
                found.warning(j, name, found.at(some), cure, some)


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


def _check_motion(found: Findings, q: Array, steps: Array) -> None:
    """Joints must move by more than one step of their encoders and than noise, and by less than some turns."""
    resting = [j for j, x in enumerate(q.T) if np.ptp(x) <= ONE_STEP * steps[j] or np.isin(x, (x.min(), x.max())).all()]
    changes, t = np.diff(q, axis=0).std(0) / np.sqrt(2), np.linspace(-1, 1, len(q))
    scatter = np.sqrt(np.maximum(q.var(0) - 3 * np.mean(t[:, None] * (q - q.mean(0)), axis=0) ** 2, 0))
    resting = np.union1d(resting, np.flatnonzero(scatter < ALIKE * changes)).astype(int).tolist()
    if len(resting) == q.shape[1]:
        found.error("no motion", "of any joint", "nothing can be found from one pose: measure while the joints move")
        return
    for j in resting:
        found.warning(j, "no motion", "at any time", "its friction and rotor cannot be found from this record")
    for j, x in enumerate(q.T):
        if np.ptp(x) > TURNS:
            text = f"of {np.ptp(x):.4g} rad or m, {np.ptp(x) / (2 * np.pi):.3g} turns of a rotating joint"
            cure = (
                'pass unit="deg" for degrees, divide mm by 1000, and use `Record.from_motors` for positions of motors'
            )
            found.warning(j, "range of the positions", text, cure)


def _check_rates(found: Findings, t: Array, q: Array, qd: Array, period: float) -> Array:
    """True for joints whose measured velocities are those of the positions: their integrals over short spans agree."""
    from scipy.integrate import cumulative_trapezoid

    width = max(1, int(SPAN / period))
    moved = np.asfortranarray(q[width:] - q[:-width])
    believed = np.zeros(q.shape[1], dtype=bool)
    for j, (x, velocity) in enumerate(zip(moved.T, qd.T, strict=True)):
        size = float(x @ x)
        if size <= (RESTING * np.abs(moved).max(initial=0)) ** 2 * len(x):
            continue
        area = cumulative_trapezoid(velocity, t, initial=0)
        factor = float(x @ (area[width:] - area[:-width])) / size
        believed[j] = abs(factor - 1) <= VELOCITIES
        if not believed[j]:
            cure = "the velocities are not used; check their unit, sign and joint"
            found.warning(j, "measured velocities", f"are {factor:.4g} times those of the positions", cure)
    return believed


def _on_grid(
    t: Array, values: Array, usable: Array, kept: Array, cuts: Array, period: float, bridge: int
) -> tuple[Array, Array, Array, tuple[slice, ...], bool]:
    """Times, values, where usable and segments on grids of equal steps, one between two gaps; whether resampled."""
    from scipy.interpolate import CubicSpline

    rows = np.flatnonzero(kept)
    gap = np.diff(t[rows]) > (bridge + 1.5) * period
    gap |= np.searchsorted(cuts, rows[1:]) > np.searchsorted(cuts, rows[:-1])
    parts, resampled = [], False
    for part in np.split(rows, np.flatnonzero(gap) + 1):
        stamps = t[part]
        apart = np.diff(stamps, prepend=-np.inf) > CLOSE * period
        if apart.sum() < 2:
            continue
        grid = period * np.arange(int(np.rint((stamps[-1] - stamps[0]) / period)) + 1)
        centred = grid + (stamps.mean() - grid.mean())
        if len(grid) == len(part) and np.abs(stamps - centred).max() <= REGULAR * period:
            parts.append((centred, values[part], usable[part]))
            continue
        resampled = True
        grid = (grid + stamps[0])[grid <= stamps[-1] - stamps[0] + REGULAR * period]
        after = np.clip(np.searchsorted(stamps, grid), 1, len(part) - 1)
        on_grid = CubicSpline(stamps[apart], values[part[apart]], axis=0)(grid)
        parts.append((grid, on_grid, usable[part[after]] & usable[part[after - 1]]))
    if not parts:
        return t[:0], values[:0], usable[:0], (), False
    joined = [parts[0][k] if len(parts) == 1 else np.concatenate([part[k] for part in parts]) for k in range(3)]
    return joined[0], joined[1], joined[2], consecutive(len(grid) for grid, _, _ in parts), resampled
