"""Commanded positions of a record: their faults, and their values on the grid of the measurements."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ...basics.spatial import Array
from ...basics.text import counted
from .. import thresholds
from .findings import Screened, Severity

UNITS = {180 / np.pi: "degrees, positions in rad", np.pi / 180: "rad, positions in degrees"}
UNITS |= {1e3: "mm, positions in m", 1e-3: "m, positions in mm"}  # by size of the command's numbers
TURN = 2 * np.pi


class Commands(NamedTuple):
    """Commanded positions, and velocities if any, at the samples of a record, shape (T, n); NaN where missing."""

    q: Array
    rate: Array | None
    hold: bool  # until the next sample; otherwise linear in between
    filled: Array | None = None  # True where a position was missing

    def at(self, times: Array, grid: Array, rounding: float) -> tuple[Array, Array | None]:
        """Commands of samples at ascending `times`, at the times of a grid: (q, rate)."""
        if self.hold:
            last = np.clip(np.searchsorted(times, grid + rounding, side="right") - 1, 0, None)
            return self.q[last], None if self.rate is None else self.rate[last]

        def linear(values: Array) -> Array:
            return np.column_stack([np.interp(grid, times, x) for x in values.T])

        return linear(self.q), None if self.rate is None else linear(self.rate)


def known_commands(found: Screened, given: Commands) -> tuple[Commands, Array]:
    """Commands without missing values, and True at samples from which on all joints have one."""
    rows, started = np.arange(len(given.q)), np.ones(len(given.q), bool)
    filled = []
    for what, values in (("command", given.q), ("commanded velocity", given.rate)):
        columns = []
        for j, x in enumerate(() if values is None else values.T):
            known = np.flatnonzero(np.isfinite(x))
            if not len(known):
                severity: Severity = "error" if found.tau is None else "warning"  # torques need no commands
                cure = "give one for each joint" if severity == "error" else "not used"
                found.warning(j, f"no {what}", "in any sample", cure, severity=severity)
                columns.append(np.zeros(len(x)))
                continue
            if missing := np.flatnonzero(~np.isfinite(x[known[0] :])).tolist():
                cure = "the last one holds" if given.hold else "interpolated"
                samples = known[0] + np.array(missing)
                found.warning(j, f"no finite {what}", found.at(samples), cure, samples)
            if known[0]:
                text = f"before sample {known[0]} (t = {found.stamps[known[0]] - found.stamps[0]:.4g} s)"
                cure = "the record begins there" if found.tau is None else "the first one"
                found.warning(j, f"no {what}", text, cure)
            started &= rows >= known[0]
            last = np.clip(np.searchsorted(known, rows, side="right") - 1, 0, None)
            columns.append(x[known[last]] if given.hold else np.interp(rows, known, x[known]))
        filled.append(np.stack(columns, axis=1) if columns else None)
    q, rate = filled
    assert q is not None  # there are positions
    return Commands(q, rate, given.hold, ~np.isfinite(given.q)), started


def check_commands(found: Screened, commands: Commands, q: Array) -> None:
    """Report commands that are constant, in another unit than the positions, a turn off, stale, or late."""
    assert commands.filled is not None
    for j, (command, position) in enumerate(zip(commands.q[found.rows].T, q.T, strict=True)):
        if np.ptp(command) == 0:  # of a step, after which the position comes to rest, or of another motion
            if np.ptp(position[len(position) // 2 :]) > thresholds.KEEPS_MOVING * np.ptp(position):
                text = f"of {command[0]:.6g} in all samples, while the position keeps moving"
                found.warning(j, "constant command", text, "right if the drive is off or too weak")
            continue
        if units := _unit_of(command, position):
            cure = "give both in one unit, or no number of the controller is right"
            found.warning(j, "unit of the command:", units, cure)
            continue
        wraps, ahead = _wraps(command, position), float(np.median(command - position))
        turns = int(np.rint(ahead / TURN))
        if turns and abs(ahead - turns * TURN) < thresholds.NEAR_TURN and not len(wraps):
            cure = f"subtract {TURN * turns:.4g} rad from the command"
            found.warning(j, "command", f"is {counted(abs(turns), 'turn')} from the position", cure)
        if len(wraps):
            text = f"{found.after(wraps)}, by a turn that the position does not make"
            found.warning(j, "jump of the command", text, "unwrap it by numpy.unwrap(command, axis=0)", wraps)
        stale = _stale(command)
        stale = stale[~commands.filled[found.rows[stale], j]]
        if len(stale):
            cure = "taken as sent; if the log lost commands, the motion after them is not theirs"
            found.warning(j, "repeated command", found.at(stale), cure, stale)
        if late := _late(command, position, int(thresholds.LATE_OVER / found.period)):
            text, cure = f"by about {1e3 * late * found.period:.3g} ms", "are columns exchanged, or clocks different?"
            found.warning(j, "command after the position", text, cure)


def _unit_of(command: Array, q: Array) -> str:
    """Units of command and position if their ends agree in other units than the given ones."""
    ends = np.percentile(q, thresholds.ENDS)
    asked, size = np.percentile(command, thresholds.ENDS), max(float(np.ptp(ends)), thresholds.TINY)
    if np.abs(asked - ends).max() < thresholds.FAR_COMMAND * size:
        return ""
    near = {text: float(np.abs(asked / factor - ends).max()) / size for factor, text in UNITS.items()}
    best = min(near, key=lambda text: near[text])
    return best if near[best] < thresholds.NEAR_COMMAND else ""


def _wraps(command: Array, q: Array) -> Array:
    """Samples after which the command jumps by whole turns while the position does not."""
    steps, moved = np.diff(command), np.abs(np.diff(q))
    turns = np.rint(steps / TURN)
    neighbours = np.maximum(np.abs(np.roll(steps, 1)), np.abs(np.roll(steps, -1)))
    is_wrap = (turns != 0) & (np.abs(steps - turns * TURN) <= neighbours + thresholds.NEAR_TURN / 2)
    return np.flatnonzero(is_wrap & (neighbours < TURN / 2) & (moved < TURN / 2))


def _stale(command: Array) -> Array:
    """Samples at which an otherwise steadily changing command repeats itself and then catches up."""
    steps = np.diff(command)
    still = steps == 0
    if still.mean() > thresholds.CHANGING:
        return np.zeros(0, int)
    digit = float(np.abs(steps[~still]).min())
    edges = np.flatnonzero(np.diff(np.concatenate([[False], still, [False]]).astype(np.int8))).reshape(-1, 2)
    found = [np.zeros(0, int)]
    for a, b in edges[(edges[:, 0] > 0) & (edges[:, 1] + 1 < len(steps))]:
        before, jump, after = steps[a - 1], steps[b], steps[b + 1]
        slope = (before + after) / 2
        if before * after > 0 and jump / slope > thresholds.MADE_UP * (b - a + 1) + digit / abs(slope):
            found.append(np.arange(a + 1, b + 1))
    return np.concatenate(found)


def _late(command: Array, q: Array, most: int) -> int:
    """Number of samples, up to `most`, by which the position leads its command; 0 if it does not."""
    most = min(most, len(q) // 4)
    asked, moved = (x - x.mean() for x in (np.diff(command), np.diff(q)))
    lag, (a, m) = np.arange(-most, most + 1), (np.append(0, np.cumsum(x**2)) for x in (asked, moved))
    first, last = np.maximum(-lag, 0), len(asked) - np.maximum(lag, 0)  # samples of the command that have a position
    size = np.sqrt((a[last] - a[first]) * (m[last + lag] - m[first + lag]))
    alike = np.correlate(np.pad(moved, most), asked, "valid") / np.maximum(size, thresholds.TINY)
    best = int(alike.argmax())
    causal = float(alike[most:].max())
    is_late = best < most and alike[best] > thresholds.ALIKE_CHANGES and 1 - alike[best] < (1 - causal) / 2
    return most - best if is_late else 0
