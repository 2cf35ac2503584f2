"""Faults of measurements: found, named, and taken out where that is possible.

Times that are not in order, samples that those beside them contradict, torques that do not follow the motion.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np

from ..basics.spatial import Array
from ..basics.text import counted, summary

NAMED = 3  # samples that a text names


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
        What was found, such as "wild position" or "gap".
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

    def error(self, joint: int | None, kind: str, text: str, cure: str, samples: Iterable[int] = ()) -> None:
        """Add an error; `joint` is None for all joints."""
        self._add("error", joint, kind, text, cure, samples)

    def warning(self, joint: int | None, kind: str, text: str, cure: str, samples: Iterable[int] = ()) -> None:
        """Add a warning; `joint` is None for all joints."""
        self._add("warning", joint, kind, text, cure, samples)

    def _add(
        self,
        severity: Literal["error", "warning"],
        joint: int | None,
        kind: str,
        text: str,
        cure: str,
        samples: Iterable[int],
    ) -> None:
        name = "" if joint is None else self.joint_names[joint]
        indices = tuple(int(self.rows[k]) for k in samples)
        self.found.append(RecordFinding(severity, self.record, name, kind, text, cure, indices))

    @property
    def has_errors(self) -> bool:
        """True if an error is among them."""
        return any(finding.severity == "error" for finding in self.found)

    def at(self, samples: Array) -> str:
        """Where these samples are, the first ones with their times."""
        named = ", ".join(f"{k} (t = {self.t[k]:.6g} s)" for k in self.rows[samples[:NAMED]])
        if len(samples) == 1:
            return f"at sample {named}"
        more = f" and {len(samples) - NAMED} more" if len(samples) > NAMED else ""
        return f"at {counted(len(samples), 'sample')}: {named}{more}"


def runs(flags: Array) -> list[tuple[int, int]]:
    """Start and end (exclusive) of each run of True in a vector."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], flags, [False]]).astype(np.int8)))
    return [(int(a), int(b)) for a, b in edges.reshape(-1, 2)]


Stamps = Literal["sampled", "regular"]
SCATTER = 0.25  # standard deviation of the stamps, as a part of the period, from which no samples can be counted
SMOOTHER = 0.5  # roughness over equal steps, as a part of that over the stamps, that speaks for equal steps


def check_order(found: Findings, t: Array, rows: Array) -> Array:
    """True at samples to keep: times must ascend, and samples that are there twice are kept once.

    `rows` holds all that was measured, by which samples with the same time are told apart.
    """
    kept = np.ones(len(t), dtype=bool)
    steps = np.diff(t)
    same = np.flatnonzero(steps == 0) + 1
    back = np.flatnonzero(steps < 0) + 1
    if len(back):
        text = f"{found.at(back)}: {t[back[0]]:.10g} s after {t[back[0] - 1]:.10g} s"
        found.error(None, "time that goes back", text, "sort the samples, or pass each motion as a record", back)
    twice = np.array([np.array_equal(rows[k], rows[k - 1], equal_nan=True) for k in same], dtype=bool)
    if twice.any():
        found.warning(None, "sample twice", found.at(same[twice]), "the second is left out", same[twice])
        kept[same[twice]] = False
    if not twice.all():
        different = same[~twice]
        found.error(
            None,
            "one time for different samples",
            found.at(different),
            "give times with more digits, or the index divided by the sample rate",
            different,
        )
    return kept


def check_regularity(found: Findings, t: Array, q: Array, period: float, bridge: int, stamps: Stamps) -> Array:
    """The times to use: the stamps, or equal steps between gaps where `stamps` is "regular"."""
    steps = np.diff(t)
    gap = steps > (bridge + 1.5) * period
    counts = np.where(gap, 0, np.rint(steps / period)) if stamps == "sampled" else (~gap).astype(float)
    _check_gaps(found, t, steps, period, gap, counts)
    group = np.concatenate([[0], np.cumsum(gap)])
    equal = np.concatenate([[0.0], np.cumsum(counts)]) * period
    offset = np.bincount(group, t - equal) / np.bincount(group)
    equal += offset[group]
    deviation = t - equal
    if np.abs(deviation).max() <= REGULAR * period:
        return t
    spread = float(np.std(deviation))
    size = f"by {1e3 * spread:.3g} ms (standard deviation; period {1e3 * period:.4g} ms)"
    if stamps == "regular":
        found.warning(None, "jittered stamps", size, "replaced by equal steps, as `stamps` says")
        return equal
    if spread > SCATTER * period:
        cure = 'pass stamps="regular" if the samples are equally spaced and none is missing, or log the drives\' times'
        found.error(None, "jittered stamps", size, cure)
    elif _roughness(q, group) < SMOOTHER * _roughness(
        q - np.gradient(q, axis=0) * (deviation / period)[:, None], group
    ):
        cure = 'the positions are smoother over equal steps: pass stamps="regular" if the samples are equally spaced'
        found.warning(None, "jittered stamps", size, f"resampled by a cubic spline through the stamps; {cure}")
    else:
        found.warning(None, "jittered stamps", size, "resampled by a cubic spline through the stamps")
    return t


def _check_gaps(found: Findings, t: Array, steps: Array, period: float, gap: Array, counts: Array) -> None:
    after = np.flatnonzero(gap)
    if len(after):
        longest = after[np.argmax(steps[after])]
        text = f"{found.at(after)}; the longest lasts {steps[longest]:.4g} s"
        found.warning(None, "gap after", text.removeprefix("at "), "the record is cut there", after)
    made_up = np.concatenate([counts[1:] == 0, [False]]) | np.concatenate([[False], counts[:-1] == 0])
    lost = np.flatnonzero((counts > 1) & ~(made_up & ~gap))  # a long step beside a short one is jitter
    if len(lost):
        missing = int((counts[lost] - 1).sum())
        text = f"after {found.at(lost).removeprefix('at ')}: {missing} in all"
        found.warning(None, "missing samples", text, "interpolated by a cubic spline", lost)


def _roughness(q: Array, group: Array) -> float:
    """Size of the fourth differences within segments, each joint as a part of its own rates."""
    whole = group[4:] == group[:-4]
    rough = np.diff(q, 4, axis=0)[whole]
    moved = np.sqrt(np.mean(np.diff(q, axis=0) ** 2, axis=0))
    moving = moved > 0
    return float(np.sqrt(np.mean((rough[:, moving] / moved[moving]) ** 2))) if whole.any() and moving.any() else 0.0


BOUND = 10.0  # times the usual deviation from neighbours, above which a value is wild
LONGEST = 3  # wild values in a row that are found
WINDOW = 101  # samples from which the usual deviation is taken
NORMAL = 1.4826  # standard deviation of normal noise, per median of its magnitude
EXCEEDED = 95  # per cent of a record's deviations that are below twice the least usual one
LATTICE = 0.15  # scatter of differences about multiples of a step, as a part of it; 0.29 without a step
MULTIPLES = 5  # of the step, up to which differences are compared with it
REFINED = 5  # times that a step is fitted
NEGLIGIBLE = 1e-5  # step as a part of the median difference, that is rounding of numbers
FEWEST_DIFFERENCES = 40  # differences from which a step is told
BESIDE = 6  # samples on either side of a repetition, through which a parabola is laid
CATCH_UP = 1.5  # step after a repetition, in steps beside
STUCK = 8.0  # deviation of repeated samples from the parabola, in deviations of the samples beside


class Neighbours(NamedTuple):
    """What the two samples before and the two after `length` samples say of these."""

    deviation: Array  # smallest magnitude among the samples, from the cubic through the four neighbours
    disagreement: Array  # between the lines through the two before and the two after, at the middle
    step: Array  # the larger of the steps before and after


def encoder_step(x: Array) -> float:
    """The step of which all differences of neighbours are multiples; zero if there is none."""
    steps = np.abs(np.diff(x))
    steps = np.sort(steps[steps > 0])
    if len(steps) < FEWEST_DIFFERENCES:
        return 0.0
    step = float(np.median(steps[:FEWEST_DIFFERENCES]))
    for _ in range(REFINED):
        small = steps[steps < MULTIPLES * step]
        multiples = np.rint(small / step)
        if not multiples.any():
            return 0.0
        step = float(small @ multiples / (multiples @ multiples))
    scatter = np.sqrt(np.mean((small / step - multiples) ** 2))
    return step if scatter < LATTICE and step > NEGLIGIBLE * np.median(steps) else 0.0


def neighbours(x: Array, length: int) -> Neighbours:
    """For every start k from 2 to len(x) - length - 2 of `length` samples."""
    count = len(x) - length - 3
    a, b, c, d = (x[k : k + count] for k in (0, 1, 2 + length, 3 + length))
    ends = np.array([-2.0, -1.0, length, length + 1.0])
    deviation = np.full(count, np.inf)
    for k in range(length):
        weights = [np.prod([(k - o) / (e - o) for o in ends if o != e]) for e in ends]  # Lagrange's polynomials
        expected = weights[0] * a + weights[1] * b + weights[2] * c + weights[3] * d
        deviation = np.minimum(deviation, np.abs(x[2 + k : 2 + k + count] - expected))
    middle = (length + 1) / 2
    disagreement = np.abs((b + middle * (b - a)) - (c - middle * (d - c)))
    return Neighbours(deviation, disagreement, np.maximum(np.abs(b - a), np.abs(d - c)))


def usual_deviation(x: Array, step: float) -> Array:
    """Usual deviation of a sample from its neighbours: of the samples about it, or of the record if that is more.

    About a sample the median, of the record the deviation that one in twenty exceeds; at least half a step.
    """
    deviation = np.pad(neighbours(x, 1).deviation, 2, mode="edge")
    blocks = np.array_split(deviation, max(1, len(deviation) // WINDOW))
    local = np.concatenate([np.full(len(block), NORMAL * np.median(block)) for block in blocks])
    usual: Array = np.maximum(local, max(float(np.percentile(deviation, EXCEEDED)) / 2, step / 2))
    return usual


def wild_values(x: Array, usual: Array) -> Array:
    """True at samples off the curve through their neighbours, up to `LONGEST` in a row, where these agree."""
    wild = np.zeros(len(x), dtype=bool)
    size = np.abs(x).max() * 1e-12
    for length in range(1, LONGEST + 1):
        off = neighbours(x, length)
        bound = BOUND * usual[2 : 2 + len(off.step)] + off.disagreement + off.step / 2 + size
        for k in np.flatnonzero(off.deviation > bound) + 2:
            wild[k : k + length] = True
    return wild


def jumps(x: Array, usual: Array) -> Array:
    """Samples k between which and the next one the position jumps, while the rates before and after agree."""
    steps = np.diff(x)
    before, at, after = steps[:-2], steps[1:-1], steps[2:]
    level = np.maximum(usual[1:-2], usual[2:-1])
    excess = np.abs(at - (before + after) / 2)
    smooth = np.maximum(np.abs(before), np.abs(after))
    bound = 2 * BOUND * level + 3 * np.abs(after - before) + smooth
    found: Array = np.flatnonzero(excess > bound) + 1
    return found


def repeated(x: Array, step: float) -> Array:
    """True at samples equal to the one before, off the curve of the motion, which the next sample makes up for.

    Positions rounded to coarse steps repeat too, but on the curve: they are as far from it as the samples beside.
    """
    found = np.zeros(len(x), dtype=bool)
    steps = np.abs(np.diff(x))
    least = max(step / 2, float(np.median(neighbours(x, 1).deviation)))
    for a, b in runs(np.concatenate([[False], steps == 0])):
        if a < BESIDE or b + BESIDE > len(x) or steps[b - 1] < CATCH_UP * max(steps[a - 2], steps[b], step):
            continue
        beside = np.concatenate([np.arange(a - BESIDE, a), np.arange(b, b + BESIDE)])
        curve = np.polynomial.Polynomial.fit(beside, x[beside], 2)
        usual = np.abs(x[beside] - curve(beside)).max()
        found[a:b] = np.abs(x[a:b] - curve(np.arange(a, b))).max() > STUCK * max(float(usual), least)
    return found


REGULAR = 0.02  # deviation of stamps from an equally spaced grid that is none, as a part of the period


class Segment(NamedTuple):
    """Samples without a gap.

    Attributes
    ----------
    rows : ndarray, shape (K,)
        Indices of the samples in the record.
    t : ndarray, shape (T,)
        The grid [s].
    is_regular : bool
        True if the samples lie on the grid as they are.
    """

    rows: Array
    t: Array
    is_regular: bool

    def on_grid(self, stamps: Array, values: Array) -> Array:
        """Values at the record's samples, shape (..., n), on the grid: unchanged, or by a cubic spline."""
        if self.is_regular:
            return values[self.rows]
        from scipy.interpolate import CubicSpline

        resampled: Array = CubicSpline(stamps[self.rows], values[self.rows], axis=0)(self.t)
        return resampled

    def nearest(self, stamps: Array, flags: Array) -> Array:
        """Flags at the record's samples, shape (..., n), on the grid: false where one of the two samples beside is."""
        if self.is_regular:
            return flags[self.rows]
        after = np.clip(np.searchsorted(stamps[self.rows], self.t), 0, len(self.rows) - 1)
        both: Array = flags[self.rows[after]] & flags[self.rows[np.maximum(after - 1, 0)]]
        return both


def sample_period(t: Array, bridge: int) -> float:
    """Time from one sample to the next: the slope of the times over the counted samples, apart for each segment."""
    steps = np.diff(t)
    median = float(np.median(steps))
    gap = steps > (bridge + 1.5) * median
    count = np.concatenate([[0.0], np.cumsum(np.where(gap, 0, np.rint(steps / median)))])
    group = np.concatenate([[0], np.cumsum(gap)])
    size = np.bincount(group)
    count -= (np.bincount(group, count) / size)[group]
    centred = t - (np.bincount(group, t) / size)[group]
    return float(centred @ count / (count @ count)) if count.any() else median


def split(t: Array, kept: Array, period: float, bridge: int, cuts: Array) -> list[Segment]:
    """Segments of at least two samples, between gaps of more than `bridge` missing samples and after each of `cuts`."""
    rows = np.flatnonzero(kept)
    gap = np.diff(t[rows]) > (bridge + 1.5) * period
    gap |= np.searchsorted(cuts, rows[1:]) > np.searchsorted(cuts, rows[:-1])
    gaps = np.flatnonzero(gap) + 1
    return [_segment(part, t[part], period) for part in np.split(rows, gaps) if len(part) > 1]


def _segment(rows: Array, t: Array, period: float) -> Segment:
    count = int(np.rint((t[-1] - t[0]) / period)) + 1
    grid = period * np.arange(count)
    if count == len(rows):
        centred = grid + np.mean(t - grid)
        if np.abs(t - centred).max() <= REGULAR * period:
            return Segment(rows, centred, True)
    grid += t[0]
    return Segment(rows, grid[grid <= t[-1] + REGULAR * period], False)


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
