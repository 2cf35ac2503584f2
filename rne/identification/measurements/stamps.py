"""Checks of the times of a record."""

from __future__ import annotations

from typing import Literal

import numpy as np

from ...basics.spatial import Array
from .findings import Findings
from .grid import REGULAR

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
