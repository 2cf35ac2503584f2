"""The noise of measured torques, from their spectrum above the filter's cut-off."""

from __future__ import annotations

import numpy as np

from ...basics.spatial import Array
from ..measurements.filtering import ORDER
from ..measurements.prepared import Prepared

ABOVE = 2.0  # times the cut-off: no motion is left there
LOWEST, HIGHEST = 0.25, 0.45  # of the sample rate, between which noise is looked for
WINDOW = 8.0  # periods of the cut-off in one spectrum, at least
POINTS = 64  # of a spectrum, at least


def torque_noise(record: Prepared) -> Array:
    """Standard deviation that noise gives the torques after the filter, shape (n,) [N m or N].

    Noise that is equal at all frequencies has the spectral density S. It is the mean from a quarter of the sample rate
    to 0.45 of it, above twice the cut-off, where no motion is left. The filter leaves S times the integral of its
    squared gain.
    """
    from scipy.signal import welch

    rate = record.sample_rate
    longest = max(part.stop - part.start for part in record.segments)
    length = min(longest, max(POINTS, int(WINDOW * rate / record.cutoff)))
    parts = [part for part in record.segments if part.stop - part.start >= length]
    spectra = [welch(record.tau[part], rate, "hann", length, detrend="linear", axis=0) for part in parts]
    f = spectra[0][0]
    density = np.average([s for _, s in spectra], axis=0, weights=[part.stop - part.start for part in parts])
    above = (f >= max(ABOVE * record.cutoff, LOWEST * rate)) & (f <= HIGHEST * rate)
    noise: Array = np.sqrt(density[above].mean(0) * bandwidth(record.cutoff))
    return noise


def bandwidth(cutoff: float) -> float:
    """Integral of the squared gain of the filter forwards and backwards, 1 / (1 + (f / cutoff)^(2 m))^2 [Hz]."""
    x = 1 / (2 * ORDER)
    return float(cutoff * (1 - x) * np.pi * x / np.sin(np.pi * x))
