"""Zero-phase low-pass filters, derivatives of equally spaced samples, and the choice of the cut-off.

Measured torques and the columns of a regressor pass the same filter, after which the linear relation between them holds
as before: the parallel filter of Gautier, Janot and Vandanjon 2013, IEEE Trans. Control Systems Technology 21(2). Its
cut-off lies well above the bandwidth of the motion, so that the filter does not change it. The bandwidth is that of the
rates, whose spectrum tells motion from the noise of encoders where that of accelerations, in which noise grows with the
fourth power of the frequency, does not.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ..basics.spatial import Array

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


WINDOW = 4.0  # seconds of one spectrum; several are averaged
POWER = 0.99  # share of the rates' power that makes up the motion's bandwidth
FACTOR = 5.0  # times the motion's bandwidth, for the cut-off
FEWEST = 8  # samples of a spectrum
LEAST = 2.0  # times the motion's bandwidth, where noise asks for a lower cut-off
NOISE = 1e-3  # power of the accelerations' noise below the cut-off, as a part of that of the accelerations
SIGNIFICANT = 10.0  # times the noise, above which a part of a spectrum is motion
MOVING = 0.05  # rate as a part of the fastest joint's, above which a joint has a say
FASTEST = 0.2  # largest cut-off, as a part of the sample rate


class Bandwidth(NamedTuple):
    """What the spectrum says of one joint."""

    rate: float  # root mean square [rad/s or m/s]
    motion: float  # frequency below which `POWER` of the rates' power lies [Hz]
    noise: float  # frequency below which accelerations have the share `NOISE` of noise [Hz]


def choose_cutoff(segments: Sequence[Array], sample_rate: float) -> tuple[float, str]:
    """A cut-off [Hz] for the positions of these segments, shape (T, n) each, and the reason in words."""
    found = bandwidths(segments, sample_rate)
    fastest = max(joint.rate for joint in found)
    if fastest == 0:
        raise ValueError("the positions show no motion above their noise")
    moving = [joint for joint in found if joint.rate >= MOVING * fastest]
    motion, noise = max(joint.motion for joint in moving), min(joint.noise for joint in moving)
    cutoff, reason = FACTOR * motion, f"{FACTOR:g} times the motion's bandwidth of {motion:.3g} Hz"
    if noise < cutoff:
        cutoff = max(noise, LEAST * motion)
        reason = f"the motion's bandwidth is {motion:.3g} Hz, noise disturbs the accelerations from {noise:.3g} Hz on"
    if cutoff > FASTEST * sample_rate:
        cutoff, reason = FASTEST * sample_rate, f"{FASTEST:g} times the sample rate of {sample_rate:.6g} Hz"
    return cutoff, f"cut-off {cutoff:.3g} Hz, chosen from the spectrum of the positions: {reason}"


def bandwidths(segments: Sequence[Array], sample_rate: float) -> list[Bandwidth]:
    """The bandwidth of each joint's motion and measurement, averaged over the segments that are long enough.

    Noise of the positions that is equal at all frequencies, as that of quantisation, has in differences the spectrum
    N (2 sin(pi f / f_s))^2; N is the median over the upper half of the frequencies.
    """
    from scipy.signal import welch

    length = min(int(WINDOW * sample_rate), max((len(q) for q in segments), default=0) - 1)
    if length < FEWEST:
        raise ValueError("the segments are too short for a spectrum of the positions")
    long_enough = [q for q in segments if len(q) > length]
    spectra = [
        welch(np.diff(q, axis=0) * sample_rate, sample_rate, "hann", length, detrend="constant", axis=0)
        for q in long_enough
    ]
    f = spectra[0][0][1:]
    rates = np.average([spectrum[1:] for _, spectrum in spectra], axis=0, weights=[len(q) for q in long_enough])
    shape = (2 * np.sin(np.pi * f / sample_rate)) ** 2
    upper = f > sample_rate / 4
    level = np.median(rates[upper] / shape[upper, None], axis=0)
    return [_bandwidth(f, rate, N * shape) for rate, N in zip(rates.T, level, strict=True)]


def _bandwidth(f: Array, rate: Array, noise: Array) -> Bandwidth:
    power = np.cumsum(np.where(rate > SIGNIFICANT * noise, rate - noise, 0.0))
    if power[-1] == 0:
        return Bandwidth(0.0, 0.0, 0.0)
    motion = np.searchsorted(power, POWER * power[-1])
    omega2 = (2 * np.pi * f) ** 2
    disturbed = np.cumsum(omega2 * noise) > NOISE * (omega2 * rate)[: motion + 1].sum()
    beyond = np.argmax(disturbed) if disturbed.any() else -1
    return Bandwidth(float(np.sqrt(power[-1] * f[0])), float(f[motion]), float(f[beyond]))
