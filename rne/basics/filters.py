"""Low-pass filter of measurements: Butterworth, of fourth order, forwards and backwards, without shift in time."""

from __future__ import annotations

import math
from functools import cache

import numpy as np

from .spatial import Array

ORDER = 4  # order of the Butterworth filter, which runs forwards and backwards
SETTLING = 1.25  # periods of the cut-off from a step until less than 1 % of it remains
BLOCK = 4_000_000  # most numbers filtered at a time


def low_pass(x: Array, cutoff: float, sample_rate: float, kept: Array | None = None, *, ends: bool = False) -> Array:
    """Low-pass along the first axis without shift in time; only the rows `kept` of the result, if given.

    A Butterworth filter forwards and backwards, with the gain 1 / (1 + (f / cutoff)^8) up to the bilinear transform. x
    is continued beyond its ends by point symmetry as far as the filter settles, twice as far with `ends`.
    """
    from scipy.signal import sosfiltfilt

    sections, padding = _butterworth(cutoff / sample_rate), (1 + ends) * settling(cutoff, sample_rate)
    padding = min(padding, len(x) - 1)
    rows: Array = np.arange(len(x)) if kept is None else kept
    columns = x.reshape(len(x), -1)
    filtered = np.empty((len(rows), columns.shape[1]))
    width = max(1, BLOCK // len(x))
    for k in range(0, columns.shape[1], width):
        y = sosfiltfilt(sections, columns[:, k : k + width], axis=0, padlen=padding)
        filtered[:, k : k + width] = y[rows]
    return filtered.reshape(len(rows), *x.shape[1:])


def impulse_response(cutoff: float, sample_rate: float, reach: int) -> Array:
    """Response of the filter to a unit impulse, from `reach` samples before it to as many after it."""
    impulse = np.zeros(4 * reach + 1)  # long enough for the ends to have no effect
    impulse[2 * reach] = 1
    return low_pass(impulse, cutoff, sample_rate, np.arange(reach, 3 * reach + 1))


@cache
def _butterworth(cutoff: float) -> Array:
    """Second-order sections for a cut-off relative to the sample rate; cached, as the design takes long."""
    from scipy.signal import butter

    return np.asarray(butter(ORDER, 2 * cutoff, output="sos"))


def settling(cutoff: float, sample_rate: float) -> int:
    """Samples after a step, and before it, in which the filter's output is more than 1 % of the step away from it."""
    return math.ceil(SETTLING * sample_rate / cutoff) + 2  # a fast digital filter differs from the analogue one
