"""Screening of measurements: faults are found, named, and removed where possible.

Times that are not in order, samples far from their neighbours, torques that do not follow the motion.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from itertools import pairwise

import numpy as np

from ...basics.spatial import Array
from ...basics.text import counted
from ...files.time_units import guessed_unit
from .. import thresholds
from .commands import Commands, check_commands, known_commands
from .findings import CleanRecord, Screened, Severity, seconds


def runs(flags: Array) -> list[tuple[int, int]]:
    """Start and end (exclusive) of each run of True in a vector."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], flags, [False]]).astype(np.int8)))
    return [(int(a), int(b)) for a, b in edges.reshape(-1, 2)]


def consecutive(lengths: Iterable[int]) -> tuple[slice, ...]:
    """Slices of these lengths, one after the other."""
    ends = np.cumsum([0, *lengths]).tolist()
    return tuple(slice(a, b) for a, b in pairwise(ends))


# Times

STAMPS = ("auto", "sampled", "regular")  # kinds of time stamps, see `Record`


def is_gap(t: Array, period: float, bridge: int) -> Array:
    """True for steps over more missing samples than are interpolated."""
    return np.asarray(np.diff(t) > (bridge + thresholds.LONG_STEP) * period)


def check_order(found: Screened, t: Array, rows: Array) -> Array:
    """True at samples to keep: times must ascend, and duplicate `rows` are kept once."""
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
    elif len(same) and (found.kind_of_stamps == "sampled" or _pauses(t, 0)[0] == 0):
        _refuse_same(found, same[~twice])
    return kept


def _refuse_same(found: Screened, same: Array) -> None:
    cure = "give times with more digits, or the index divided by the sample rate"
    found.error("one time for different samples", found.at(same), cure, same)


def check_stamps(found: Screened, t: Array, q: Array, qd: Array | None) -> tuple[Array, float]:
    """Times to use, and their period: the stamps, or equal steps where the reader of the log made them."""
    steps = np.diff(t)
    usual = np.abs(steps - np.median(steps)) <= np.median(steps) / 2
    period = float(steps[usual].mean())
    counted_period, gap = _pauses(t, found.bridge)
    by_count = equal_steps(t, gap, counted_period)
    whole = np.maximum(np.rint(steps / period), 1) if period else steps
    regular = thresholds.REGULAR * period
    lost = max(thresholds.LOST * len(steps), thresholds.FEW_PAUSES)
    is_grid = (whole > 1).sum() <= lost and (np.abs(steps - whole * period) <= regular).all()
    reason = ""
    if found.kind_of_stamps == "regular":
        reason = "as `stamps` says"
    elif found.kind_of_stamps == "auto" and not (period and (is_grid or np.abs(t - by_count).max() <= regular)):
        reason = _made_by_reader(found, t, q, qd, by_count, gap, counted_period)
    if reason:
        off, usual = 1e3 * float(np.std(t - by_count)), 1e3 * counted_period
        text = f"differ from equal steps by {off:.3g} ms (standard deviation; period {usual:.4g} ms)"
        cure = f"samples are counted, {reason}"
        found.warning(None, "stamps that are not the samples'", text, cure)
        t, period = by_count, counted_period
    elif (same := np.flatnonzero(steps == 0) + 1).size:
        _refuse_same(found, same)
    else:
        gap = is_gap(t, period, found.bridge)
    _check_gaps(found, t, period, gap)
    return t, period


def _pauses(t: Array, bridge: int) -> tuple[float, Array]:
    """Period of counted samples, and the gaps of the log: steps far above the usual pauses."""
    lag = max(1, min(thresholds.COUNTED_OVER, len(t) // 4))
    period, steps = float(np.median(t[lag:] - t[:-lag])) / lag, np.diff(t)
    pauses = steps[steps > thresholds.LONG_STEP * period]
    few = max(thresholds.PAUSES * len(steps), thresholds.FEW_PAUSES)
    usual = float(np.median(pauses)) if len(pauses) > few else 0.0
    return period, is_gap(t, period, bridge) & (steps > thresholds.GAP * usual)


def equal_steps(t: Array, gap: Array, period: float) -> Array:
    """Equal steps between gaps, fitted to the stamps by lines over some seconds each."""
    from scipy.interpolate import make_lsq_spline

    equal = t.copy()
    for part in np.split(np.arange(len(t)), np.flatnonzero(gap) + 1):
        count = int(len(part) / max(thresholds.KNOTS / period, thresholds.KNOT_SAMPLES)) if period > 0 else 1
        if len(part) > 2:
            index = np.arange(len(part), dtype=float)
            knots = np.linspace(0, index[-1], max(count, 1) + 1)
            equal[part] = make_lsq_spline(index, t[part], np.concatenate([knots[:1], knots, knots[-1:]]), k=1)(index)
    return equal


def _made_by_reader(
    found: Screened, t: Array, q: Array, qd: Array | None, equal: Array, gap: Array, period: float
) -> str:
    """Reason why samples are counted, or empty if the stamps are believed.

    What stamps are late by, times the velocity, is in the positions where samples were taken at the stamps, and is not
    where the reader of the log made them: its share in the changes of the positions is 1 or 0. Measured velocities
    give all other changes of the positions; without them, fourth differences remove most of these.
    """
    from scipy.integrate import cumulative_trapezoid
    from scipy.ndimage import uniform_filter1d

    group, lag = np.concatenate([[0], np.cumsum(gap)]), thresholds.STAMPS_OVER
    if qd is not None:
        over_equal, over_stamps = (cumulative_trapezoid(qd, times, axis=0, initial=0) for times in (equal, t))
        late, moved = (x[lag:] - x[:-lag] for x in (over_stamps - over_equal, q - over_equal))
        share, error = _share(late, moved, group[lag:] == group[:-lag], np.sqrt(lag))
        if abs(share - 0.5) > error:
            steps = "equal steps" if share < 0.5 else "the stamps"
            reason = f"for measured velocities integrate to the positions over {steps}"
            found.notes = () if share < 0.5 else (f"stamps are believed, {reason}",)
            return reason if share < 0.5 else ""
    pauses = max(1, int(is_gap(t, period, 0).sum()))
    width = int(np.clip(2 * len(t) / pauses, *thresholds.VELOCITY_WINDOW))  # more than a burst
    velocity = uniform_filter1d(np.gradient(q, axis=0), width, axis=0) / period
    late, moved = (np.diff(x, 4, axis=0) for x in (velocity * (t - equal)[:, None], q))
    share, error = _share(late, moved, group[4:] == group[:-4])
    if share + error < 0.5:
        return "for the positions are smoother over equal steps"
    return "for several have the same time" if (np.diff(t) == 0).any() and share - error < 0.5 else ""


def _share(late: Array, moved: Array, chosen: Array, correlation: float = 1.0) -> tuple[float, float]:
    """Share of `late` in the displacement, and three standard errors, the joints weighted by their displacements."""
    late, moved = late[chosen], moved[chosen]
    scale = np.mean(moved**2, axis=0)
    weight = np.divide(1, scale, out=np.zeros_like(scale), where=scale > 0)
    known = float((weight * late**2).sum())
    share = float((weight * late * moved).sum()) / known if known else 0.0
    return share, 3 * correlation / float(np.sqrt(known)) if known else np.inf


def _check_gaps(found: Screened, t: Array, period: float, gap: Array) -> None:
    """Report gaps and missing samples: steps that are longer than jitter explains."""
    steps = np.diff(t)
    after = np.flatnonzero(gap)
    if len(after):
        text = f"{found.after(after)}; the longest lasts {steps[gap].max():.4g} s"
        found.warning(None, "gap", text, "the record is cut there", after)
    usual = steps[np.abs(steps - period) < period / 2]
    lost = np.flatnonzero((steps > thresholds.LONG_STEP * period + thresholds.JITTER * np.std(usual)) & ~gap)
    if len(lost):
        missing = int((np.rint(steps[lost] / period) - 1).sum())
        text = f"{found.after(lost)}: {missing} in all"
        found.warning(None, "missing samples", text, "interpolated by a cubic spline", lost)


# Values

NO_VELOCITY = "no finite velocity"


def encoder_step(x: Array) -> float:
    """Step of which all differences between neighbours are multiples; zero if there is none."""
    steps = np.abs(np.diff(x))
    steps = steps[steps > 0]
    if len(steps) < thresholds.FEWEST_DIFFERENCES:
        return 0.0
    step = float(np.median(np.partition(steps, thresholds.FEWEST_DIFFERENCES - 1)[: thresholds.FEWEST_DIFFERENCES]))
    longest = thresholds.MULTIPLES * 1.5**thresholds.STEP_ROUNDS * step  # a round makes a step longer by half at most
    near = np.sort(steps[steps < longest])
    for _ in range(thresholds.STEP_ROUNDS):  # by least squares; it settles in a few rounds
        small = near[near < thresholds.MULTIPLES * step]
        multiples = np.rint(small / step)
        if not multiples.any():
            return 0.0
        step = float(small @ multiples / (multiples @ multiples))
    scatter = np.sqrt(np.mean((small / step - multiples) ** 2))
    return step if scatter < thresholds.LATTICE and step > thresholds.NEGLIGIBLE * np.median(steps) else 0.0


def deviations(x: Array, length: int) -> tuple[Array, Array]:
    """Deviations of `length` samples from the cubic through two samples before and two after, and their tolerance.

    For every start from 2 to len(x) - length - 2: the smallest magnitude among the samples, or the largest where all
    repeat the one before; and by how much the lines through the two before and the two after disagree in the middle,
    with half the larger of their steps.
    """
    count = len(x) - length - 3
    a, b, c, d = (x[k : k + count] for k in (0, 1, 2 + length, 3 + length))
    ends = (-2.0, -1.0, length, length + 1.0)
    smallest, largest, repeats = np.full(count, np.inf), np.zeros(count), np.ones(count, dtype=bool)
    for k in range(length):
        weights = [math.prod((k - o) / (e - o) for o in ends if o != e) for e in ends]  # Lagrange's polynomials
        expected = weights[0] * a + weights[1] * b + weights[2] * c + weights[3] * d
        sample = x[2 + k : 2 + k + count]
        off = np.abs(sample - expected)
        smallest, largest = np.minimum(smallest, off), np.maximum(largest, off)
        repeats &= sample == b
    before, after, middle = b - a, d - c, (length + 1) / 2
    disagreement = np.abs((b + middle * before) - (c - middle * after))
    return np.where(repeats, largest, smallest), disagreement + np.maximum(np.abs(before), np.abs(after)) / 2


def usual_deviation(x: Array, step: float) -> Array:
    """Usual deviation of a sample from its neighbours: local, or of the whole record if that is larger.

    The local one is the median near the sample; one deviation in twenty exceeds the record's. At least half a step.
    """
    deviation = np.pad(deviations(x, 1)[0], 2, mode="edge")
    count = max(1, len(x) // thresholds.USUAL_OVER)
    blocks = deviation[: len(x) // count * count].reshape(count, -1)
    middle = slice((blocks.shape[1] - 1) // 2, blocks.shape[1] // 2 + 1)
    median = np.sort(blocks, axis=1)[:, middle].mean(axis=1)  # numpy.median takes five times as long
    local = np.repeat(thresholds.NORMAL * median, blocks.shape[1])
    local = np.pad(local, (0, len(x) - len(local)), mode="edge")
    return np.asarray(np.maximum(local, max(float(np.percentile(deviation, thresholds.EXCEEDED)), step) / 2))


def spikes(x: Array, usual: Array) -> Array:
    """True at samples off the curve through their neighbours, a few in a row (Hampel's identifier)."""
    found = np.zeros(len(x), dtype=bool)
    for length in range(1, thresholds.LONGEST_SPIKE + 1):
        deviation, allowed = deviations(x, length)
        bound = thresholds.SPIKE * usual[2 : 2 + len(allowed)] + allowed + np.abs(x).max() * thresholds.ROUNDED_SPIKE
        for k in np.flatnonzero(deviation > bound) + 2:
            found[k : k + length] = True
    return found


def jumps(x: Array, usual: Array) -> Array:
    """Samples k followed by a jump of the position, while velocities before and after agree."""
    steps = np.diff(x)
    before, at, after = steps[:-2], steps[1:-1], steps[2:]
    level = np.maximum(usual[1:-2], usual[2:-1])
    smooth = np.maximum(np.abs(before), np.abs(after))
    bound = 2 * thresholds.SPIKE * level + thresholds.BEND * np.abs(after - before) + smooth
    return np.asarray(np.flatnonzero(np.abs(at - (before + after) / 2) > bound) + 1)


def clipped(x: Array, step: float, moving: Array, spike: Array) -> Array:
    """True where a torque is saturated: its histogram ends with a peak, of samples in motion."""
    found = np.zeros(len(x), dtype=bool)
    size, changes = np.ptp(x[~spike]), np.abs(np.diff(x))
    widths = sorted(max(part * size, thresholds.ONE_LEVEL * step) for part in thresholds.CLIP_WIDTHS)
    if size > thresholds.LEVELS * step:
        widths.append(thresholds.DIGITS * step)
    for y in (x, -x):
        top = y[~spike].max()
        peak = np.zeros(len(x), dtype=bool)
        for width in sorted(widths, reverse=True):
            near, below = (y >= top - width) & ~spike, (y < top - width) & (y >= top - thresholds.CROWDED_OVER * width)
            count = int((near & moving).sum())
            crowd = thresholds.CROWDED * (1 + (below & moving).sum())
            if count < thresholds.CLIPPED or count <= crowd or count < thresholds.MOST * peak.sum():
                continue
            within, beyond = (near[1:] & near[:-1]), (moving & ~near)[1:]
            if within.any() and beyond.any():
                is_quiet = np.median(changes[within]) < thresholds.QUIET * np.median(changes[beyond])
                if is_quiet or sum(b - a > 1 for a, b in runs(near)) >= thresholds.PLATEAUS:
                    peak = near
        found |= peak
    return found


def screen(found: Screened, commands: Commands | None) -> CleanRecord:
    """Screen measurements: find faults, remove or cut them, and put the rest on equidistant grids."""
    t, q, tau, n = found.t, found.q, found.tau, found.q.shape[1]
    qd = found.qd = _known_velocities(found, found.qd)
    columns = {"position": q}
    if tau is not None:
        columns["torque"] = np.where(np.isfinite(tau).any(0), tau, 0.0)  # a torque that was never read is constant
    if qd is not None:
        columns["velocity"] = qd
    found.columns = {kind: slice(k * n, (k + 1) * n) for k, kind in enumerate(columns)}
    values = np.asfortranarray(np.hstack(list(columns.values())))
    tells = values if commands is None or tau is not None else np.hstack([values, commands.q])  # samples apart
    kept = check_order(found, t, tells) & _numbers(found, columns)
    if commands is not None:
        commands, started = known_commands(found, commands)
        kept &= started | (tau is not None)
    found.steps = np.array([encoder_step(x[np.isfinite(x)]) for x in values.T])
    _check_there(found, tau, kept)
    if found.has_errors:
        return found.cleaned()
    found.rows = np.flatnonzero(kept)
    values = values if kept.all() else np.asfortranarray(values[kept])
    _screen_values(found, t[kept], values, commands)
    return found.cleaned()


def _check_there(found: Screened, tau: Array | None, kept: Array) -> None:
    """Report errors for missing torques, or too few samples."""
    if tau is not None and not np.nan_to_num(tau).any():
        found.error("no torque", "in any sample, all are zero or missing", "did the driver publish efforts?")
    if not found.has_errors and kept.sum() < thresholds.FEWEST_SAMPLES:
        why = "".join(f": {x.joint} has {x.kind} {x.text}" for x in found.findings[:1] if x.joint)
        cure = f"at least {thresholds.FEWEST_SAMPLES} are needed"
        found.error("too few samples:", f"{int(kept.sum())} are usable{why}", cure)


def _screen_values(found: Screened, t: Array, measured: Array, commands: Commands | None) -> None:
    """Screen the values of the samples kept."""
    parts, steps = found.columns, found.steps
    usable = found.usable[found.rows]
    q = measured[:, parts["position"]]  # a view: what is interpolated in `measured` is so in this
    velocities = measured[:, parts["velocity"]] if "velocity" in parts else None
    times, found.period = check_stamps(found, t, q, velocities)
    if found.has_errors:
        return
    _check_unit_of_times(found, times, q, velocities)
    usual = [usual_deviation(x, step) for x, step in zip(measured.T, steps, strict=True)]
    flags = np.column_stack([spikes(x, level) for x, level in zip(measured.T, usual, strict=True)])
    longest = thresholds.LONGEST_SPIKE
    for after in 1 + np.flatnonzero(is_gap(times, found.period, found.bridge)):  # samples at a gap lack neighbours
        flags[max(after - longest, 0) : after + longest] = False
    if torque := parts.get("torque"):
        usable &= _usable_torques(found, q, measured[:, torque], steps[torque], flags[:, torque])
        flags[:, torque] &= usable
    cuts = _check_jumps(found, t, q, usual, flags)
    for kind, part in parts.items():
        _check_spikes(found, kind, measured[:, part], flags[:, part])
    long_runs = _interpolate(times, measured, flags, found.bridge)
    _check_motion(found, q, steps[parts["position"]])
    if velocities is not None and not found.has_errors:
        found.believed = _check_velocities(found, times, q, velocities)
    if commands is not None and not found.has_errors:
        check_commands(found, commands, q)
    if not found.has_errors:
        found.interpolated = flags[:, parts["position"]]
        _put_on_grid(found, times, measured, usable, ~long_runs, cuts)
        if commands is not None:
            every = np.interp(np.arange(len(commands.q)), found.rows, times)
            found.command, found.command_rate = commands.at(every, found.t, thresholds.REGULAR * found.period)


def _numbers(found: Screened, columns: dict[str, Array]) -> Array:
    """True at samples with all values finite."""
    for name, values in columns.items():
        for j, x in enumerate(values.T):
            bad = np.flatnonzero(~np.isfinite(x))
            if len(bad):
                found.warning(j, f"no finite {name}", found.at(bad), "taken as missing samples", bad)
    return np.asarray(np.isfinite(np.hstack(list(columns.values()))).all(axis=1))


def _known_velocities(found: Screened, qd: Array | None) -> Array | None:
    """Velocities without those missing in most samples: zero for some joints, None for all."""
    if qd is None:
        return None
    missing = np.isfinite(qd).mean(axis=0) < thresholds.KNOWN_VELOCITIES
    for j in np.flatnonzero(missing):
        share = f"in {counted(int((~np.isfinite(qd[:, j])).sum()), 'sample')} of {len(qd)}"
        found.warning(int(j), NO_VELOCITY, share, "the velocities are not used")
    return None if missing.all() else np.where(missing, 0.0, qd)


def _check_unit_of_times(found: Screened, t: Array, q: Array, qd: Array | None) -> None:
    """Report times that are unlikely to be in seconds: a too low rate is an error, a likelier unit a warning."""
    rate, unit = 1 / found.period, guessed_unit(t, q, qd)
    is_slow = rate < thresholds.SLOWEST_RATE
    if unit is not None or is_slow:
        cure = "are the times in seconds?" if unit is None else f"`t` {unit.said}; divide it by {unit.divisor}"
        severity: Severity = "error" if is_slow else "warning"
        found.warning(None, "sample rate", f"of {rate:.4g} samples per second", cure, severity=severity)


def _usable_torques(found: Screened, q: Array, tau: Array, steps: Array, spike: Array) -> Array:
    """False where a torque is unusable: constant channels and saturated torques."""
    usable = np.ones(tau.shape, dtype=bool)
    moved, over = np.abs(np.gradient(q, axis=0)), np.ones(thresholds.MOVING_OVER) / thresholds.MOVING_OVER
    for j, x in enumerate(tau.T):
        if np.ptp(x) <= max(thresholds.NOTHING * np.abs(x).max(), thresholds.SILENT):
            never = found.tau is not None and not np.isfinite(found.tau[:, j]).any()
            what = ("torque missing", "") if never else ("constant torque", f"of {x[0]:.6g} ")
            found.warning(j, what[0], f"{what[1]}in all samples", "no row of this joint is used")
            usable[:, j] = False
            continue
        usual = np.sqrt(np.mean(moved[:, j] ** 2))
        moving = np.convolve(moved[:, j], over, "same") > thresholds.IN_MOTION * usual
        samples = np.flatnonzero(clipped(x, steps[j], moving, spike[:, j]))
        if len(samples):
            usable[samples, j] = False
            text = f"of {x[samples[0]]:.6g} {found.at(samples)}"
            found.warning(j, "saturated torque", text, "rows of this joint near it are not used", samples)
    return usable


def _check_jumps(found: Screened, t: Array, q: Array, usual: list[Array], flags: Array) -> Array:
    """Jumps of positions, after which the record is cut; frequent ones are noise."""
    after_gap = np.flatnonzero(is_gap(t, float(np.median(np.diff(t))), 0))
    found_jumps = []
    for j, x in enumerate(q.T):
        jumped, size = jumps(x, usual[j]), np.abs(np.diff(x))
        smallest = float(size[size > 0].min(initial=np.inf))
        step = smallest if smallest < thresholds.RESTS else 0.0  # of an encoder, which is no jump
        jumped = jumped[size[jumped] > thresholds.ONE_STEP * step]
        found_jumps.append(np.setdiff1d(jumped[~flags[jumped, j] & ~flags[jumped + 1, j]], after_gap))
    every, joints = np.unique(np.concatenate(found_jumps), return_counts=True)
    sent = (q[every] != q[every - 1]).sum(axis=1)  # joints that did not repeat a position before
    lost = every[2 * np.minimum(joints, sent) > max(q.shape[1], 2)]
    if len(lost):
        text = f"{found.after(lost)}, where most positions jump at once, although the times show none"
        found.warning(None, "missing samples", text, "the record is cut there", lost)
    is_noise = len(every) - len(lost) > thresholds.FREQUENT * (t[-1] - t[0]) + 1
    for j, jumped in enumerate(found_jumps):
        jumped = np.setdiff1d(jumped, lost)
        if len(jumped):
            size = np.abs(q[jumped + 1, j] - q[jumped, j]).max()
            where = f"{found.after(jumped)}, by up to {size:.4g}"
            cure = "so many are noise of the position" if is_noise else "the record is cut there"
            found.warning(j, "jump of the position", where, cure, jumped)
    return lost if is_noise else every


def _check_spikes(found: Screened, kind: str, values: Array, flags: Array) -> None:
    """Report spikes, and repeated positions during motion; common ones are noise."""
    for j, x in enumerate(values.T):
        samples = np.flatnonzero(flags[:, j])
        if not len(samples):
            continue
        spans, bridge = runs(flags[:, j]), found.bridge
        cut = sum(b - a > bridge for a, b in spans)
        cure = "interpolated" if not cut else f"interpolated up to {bridge} in a row, cut out at {cut} longer runs"
        if len(samples) > thresholds.COMMON * len(x):
            cure, flags[:, j] = "so many are noise", False
        elif not bridge:
            cure = "cut out"
        repeats = np.array([k for a, b in spans if (x[a:b] == x[a - 1]).all() for k in range(a, b)], dtype=int)
        for name, some in ((f"repeated {kind}", repeats), (f"{kind} spike", np.setdiff1d(samples, repeats))):
            if len(some):
                found.warning(j, name, found.at(some), cure, some)


def _interpolate(t: Array, values: Array, flags: Array, bridge: int) -> Array:
    """Replace flagged values by a cubic spline; True at samples of runs longer than `bridge`."""
    from scipy.interpolate import CubicSpline

    long_runs = np.zeros(len(t), dtype=bool)
    for x, flagged in zip(values.T, flags.T, strict=True):
        if flagged.any():
            x[flagged] = CubicSpline(t[~flagged], x[~flagged])(t[flagged])
        for a, b in runs(flagged):
            long_runs[a:b] |= b - a > bridge
    return long_runs


def _check_motion(found: Screened, q: Array, steps: Array) -> None:
    """Report joints that move by less than an encoder step or noise, or by many turns."""
    flickers = [np.isin(x, (x.min(), x.max())).all() for x in q.T]  # between two values
    resting = np.flatnonzero(flickers | (np.ptp(q, axis=0) <= thresholds.ONE_STEP * steps))
    changes, t = np.diff(q, axis=0).std(0) / np.sqrt(2), np.linspace(-1, 1, len(q))
    scatter = np.sqrt(np.maximum(q.var(0) - 3 * np.mean(t[:, None] * (q - q.mean(0)), axis=0) ** 2, 0))
    resting = np.union1d(resting, np.flatnonzero(scatter < thresholds.LIKE_NOISE * changes)).astype(int).tolist()
    if len(resting) == q.shape[1]:
        found.error("no motion", "of any joint", "nothing can be found from one pose: measure while the joints move")
        return
    for j in resting:
        found.warning(j, "no motion", "at any time", "its friction and rotor cannot be found from this record")
    for j, x in enumerate(q.T):
        if np.ptp(x) > thresholds.TURNS:
            text = f"of {np.ptp(x):.4g} rad or m, {np.ptp(x) / (2 * np.pi):.3g} turns of a rotating joint"
            cure = (
                'pass unit="deg" for degrees, divide mm by 1000, and use `Record.from_motors` for positions of motors'
            )
            found.warning(j, "range of the positions", text, cure)


def _check_velocities(found: Screened, t: Array, q: Array, qd: Array) -> Array:
    """True for joints whose measured velocities agree with the positions: their integrals over short spans do."""
    from scipy.integrate import cumulative_trapezoid

    width = max(1, int(thresholds.COMPARED_OVER / found.period))
    moved = np.asfortranarray(q[width:] - q[:-width])
    believed = np.zeros(q.shape[1], dtype=bool)
    missing = {finding.joint for finding in found.findings if finding.kind == NO_VELOCITY}
    for j, (x, velocity) in enumerate(zip(moved.T, qd.T, strict=True)):
        size = float(x @ x)
        if size <= (thresholds.RESTING * np.abs(moved).max(initial=0)) ** 2 * len(x) or found.joint_names[j] in missing:
            continue
        area = cumulative_trapezoid(velocity, t, initial=0)
        factor = float(x @ (area[width:] - area[:-width])) / size
        believed[j] = abs(factor - 1) <= thresholds.VELOCITY_ERROR
        if not believed[j]:
            cure = "the velocities are not used; check their unit, sign and joint"
            found.warning(j, "measured velocities", f"are {factor:.4g} times those of the positions", cure)
    return believed


def _put_on_grid(found: Screened, t: Array, values: Array, usable: Array, kept: Array, cuts: Array) -> None:
    """Put the samples kept on equidistant grids, one between two gaps or cuts."""
    from scipy.interpolate import CubicSpline

    rows, period, made = np.flatnonzero(kept), found.period, found.interpolated
    regular = thresholds.REGULAR * period
    gap = is_gap(t[rows], period, found.bridge)
    gap |= np.searchsorted(cuts, rows[1:]) > np.searchsorted(cuts, rows[:-1])
    parts = [(t[:0], values[:0], usable[:0], made[:0])]
    for part in np.split(rows, np.flatnonzero(gap) + 1):
        stamps = t[part]
        apart = np.diff(stamps, prepend=-np.inf) > thresholds.CLOSE * period
        if apart.sum() < 2 or np.ptp(stamps) < period - regular:
            continue
        grid = period * np.arange(int(np.rint((stamps[-1] - stamps[0]) / period)) + 1)
        centred = grid + (stamps.mean() - grid.mean())
        if len(grid) == len(part) and np.abs(stamps - centred).max() <= regular:
            parts.append((centred, values[part], usable[part], made[part]))
            continue
        resampled = f"resampled by a cubic spline through the stamps, every {1e3 * period:.4g} ms"
        found.notes = tuple(dict.fromkeys((*found.notes, resampled)))
        grid = (grid + stamps[0])[grid <= stamps[-1] - stamps[0] + regular]
        after = np.clip(np.searchsorted(stamps, grid), 1, len(part) - 1)
        on_grid = CubicSpline(stamps[apart], values[part[apart]], axis=0)(grid)
        nearest = np.where(stamps[after] - grid < grid - stamps[after - 1], after, after - 1)
        lost = np.abs(grid - stamps[nearest]) > thresholds.LONG_STEP / 2 * period
        filled = made[part[nearest]] | lost[:, None]
        parts.append((grid, on_grid, usable[part[after]] & usable[part[after - 1]], filled))
    found.segments = consecutive(len(grid) for grid, *_ in parts[1:])
    joined = parts[1] if len(parts) == 2 else [np.concatenate(arrays) for arrays in zip(*parts, strict=True)]
    found.t, measured, found.usable, found.interpolated = joined
    found.q = measured[:, found.columns["position"]]
    found.tau, found.qd = (
        measured[:, found.columns[kind]] if kind in found.columns else None for kind in ("torque", "velocity")
    )
