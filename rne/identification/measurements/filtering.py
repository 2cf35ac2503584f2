"""Zero-phase low-pass filters and derivatives of equally spaced samples.

Measured torques and the columns of a regressor pass the same filter, after which the linear relation between them holds
as before: the parallel filter of Gautier, Janot and Vandanjon 2013, IEEE Trans. Control Systems Technology 21(2).
"""

from __future__ import annotations

import math

import numpy as np

from ...basics.spatial import Array

ORDER = 4  # of the Butterworth filter, which runs forwards and backwards
SETTLING = 1.25  # periods of the cut-off from a step to where less than 1 % of it is left
BLOCK = 4_000_000  # numbers that are filtered at a time
# Central differences of eighth order (Fornberg 1988, table 1), for offsets 1 to 4: at a tenth of the sample rate their
# gain is 1 within 5e-5, where half the difference of both neighbours has 0.94.
FIRST = (4 / 5, -1 / 5, 4 / 105, -1 / 280)
SECOND = (8 / 5, -1 / 5, 8 / 315, -1 / 560)
MARGIN = len(FIRST)  # samples at either end that have no central difference


def low_pass(x: Array, cutoff: float, sample_rate: float, kept: Array | None = None) -> Array:
    """Low-pass along the first axis without shift in time; of the result only the rows `kept`, if given.

    A Butterworth filter of fourth order forwards and backwards: the gain is 1 / (1 + (f / cutoff)^8) up to the warping
    of the bilinear transform, and 1/2 at the cut-off.
    """
    from scipy.signal import butter, sosfiltfilt

    sections = butter(ORDER, cutoff, output="sos", fs=sample_rate)
    padding = min(settling(cutoff, sample_rate), len(x) - 1)
    rows: Array = np.arange(len(x)) if kept is None else kept
    columns = x.reshape(len(x), -1)
    filtered = np.empty((len(rows), columns.shape[1]))
    width = max(1, BLOCK // len(x))
    for k in range(0, columns.shape[1], width):
        part = slice(k, k + width)
        filtered[:, part] = sosfiltfilt(sections, columns[:, part], axis=0, padlen=padding)[rows]
    return filtered.reshape(len(rows), *x.shape[1:])


def settling(cutoff: float, sample_rate: float) -> int:
    """Samples after a step, and before it, in which the filter's output is more than 1 % of the step away from it."""
    return math.ceil(SETTLING * sample_rate / cutoff) + 2  # by which a fast filter differs from an analogue one


def derivatives(x: Array, sample_rate: float) -> tuple[Array, Array]:
    """First and second derivatives along the first axis, `MARGIN` samples less at either end."""
    inner = slice(MARGIN, len(x) - MARGIN)
    first, second = np.zeros((2, *x[inner].shape))
    for k, (a, b) in enumerate(zip(FIRST, SECOND, strict=True), start=1):
        after, before = x[MARGIN + k : len(x) - MARGIN + k], x[MARGIN - k : len(x) - MARGIN - k]
        first += a * (after - before)
        second += b * ((after - x[inner]) + (before - x[inner]))
    return first * sample_rate, second * sample_rate**2
