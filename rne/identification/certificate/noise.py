"""The noise of measured torques, from their spectrum above the filter's cut-off."""

from __future__ import annotations

from math import gamma

import numpy as np

from ...basics.spatial import Array
from ..measurements.filtering import ORDER
from ..measurements.prepared import Prepared

ABOVE = 2.0  # times the cut-off: no motion is left there
LOWEST, HIGHEST = 0.25, 0.45  # of the sample rate, between which noise is looked for
PASSED = 0.7  # of the cut-off of the positions' filter, up to which their noise passes
WINDOW = 8.0  # periods of the cut-off in one spectrum, at least
POINTS = 64  # of a spectrum, at least


def torque_noise(record: Prepared) -> Array:
    """Standard deviation that noise gives the torques after the filter, shape (n,) [N m or N].

    Noise that is equal at all frequencies has the spectral density S. It is the mean from a quarter of the sample rate
    to 0.45 of it, above twice the cut-off, where no motion is left. The filter leaves S times the integral of its
    squared gain.
    """
    rate = record.sample_rate
    f, density = spectrum(record, record.tau)
    above = (f >= max(ABOVE * record.cutoff, LOWEST * rate)) & (f <= HIGHEST * rate)
    noise: Array = np.sqrt(density[above].mean(0) * bandwidth(record.cutoff))
    return noise


def torque_noise_of_positions(record: Prepared, torques: Array) -> Array:
    """Standard deviation that noise of the positions gives predicted torques after the filter, shape (n,) [N m or N].

    White noise of positions makes accelerations, and torques predicted from them, of density A f^4. A is found between
    twice the cut-off and 0.7 of that of the positions' filter; the filter leaves A times the integral of f^4 times its
    squared gain.

    Parameters
    ----------
    record : Prepared
    torques : ndarray, shape (T, n)
        Predicted on the grid, not filtered [N m or N].

    Returns
    -------
    ndarray, shape (n,)
    """
    f, density = spectrum(record, torques)
    between = (f >= ABOVE * record.cutoff) & (f <= PASSED * record.position_cutoff)
    if not between.any():
        return np.zeros(torques.shape[1])
    A = (density[between] / f[between, None] ** 4).mean(0)
    k = 5 / (2 * ORDER)  # the integral of x^4 / (1 + x^(2 m))^2 is Gamma(k) Gamma(2 - k) / (2 m), with k = 5 / (2 m)
    noise: Array = np.sqrt(A * record.cutoff**5 * gamma(k) * gamma(2 - k) / (2 * ORDER))
    return noise


def spectrum(record: Prepared, x: Array) -> tuple[Array, Array]:
    """Frequencies and power spectral density of columns on the grid, averaged over the long segments."""
    from scipy.signal import welch

    rate = record.sample_rate
    longest = max(part.stop - part.start for part in record.segments)
    length = min(longest, max(POINTS, int(WINDOW * rate / record.cutoff)))
    parts = [part for part in record.segments if part.stop - part.start >= length]
    spectra = [welch(x[part], rate, "hann", length, detrend="linear", axis=0) for part in parts]
    return spectra[0][0], np.average([s for _, s in spectra], axis=0, weights=[p.stop - p.start for p in parts])


def bandwidth(cutoff: float) -> float:
    """Integral of the squared gain of the filter forwards and backwards, 1 / (1 + (f / cutoff)^(2 m))^2 [Hz]."""
    x = 1 / (2 * ORDER)
    return float(cutoff * (1 - x) * np.pi * x / np.sin(np.pi * x))
