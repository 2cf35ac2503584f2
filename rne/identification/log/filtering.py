"""Derivatives of equally spaced samples, and the choice of a low-pass filter's cut-off.

Measured torques and the columns of a regressor pass the same filter, after which the linear relation between them holds
as before: the parallel filter of Gautier, Janot and Vandanjon 2013, IEEE Trans. Control Systems Technology 21(2). Its
cut-off lies well above the bandwidth of the motion, so that the filter does not change it. The bandwidth is that of the
velocities, whose spectrum separates motion from the noise of encoders where that of accelerations, in which noise grows
with the fourth power of the frequency, does not.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ...basics.filters import low_pass
from ...basics.spatial import Array
from .. import thresholds

# Central differences of eighth order (Fornberg 1988, table 1), for offsets 1 to 4: at a tenth of the sample rate their
# gain is 1 within 5e-5, where half the difference of both neighbours has 0.94.
FIRST = (4 / 5, -1 / 5, 4 / 105, -1 / 280)
SECOND = (8 / 5, -1 / 5, 8 / 315, -1 / 560)
MARGIN = len(FIRST)  # samples at either end that have no central difference


def derivatives(x: Array, sample_rate: float) -> tuple[Array, Array]:
    """First and second derivatives along the first axis, `MARGIN` samples shorter at either end."""
    inner = slice(MARGIN, len(x) - MARGIN)
    first, second = np.zeros((2, *x[inner].shape))
    for k, (a, b) in enumerate(zip(FIRST, SECOND, strict=True), start=1):
        after, before = x[MARGIN + k : len(x) - MARGIN + k], x[MARGIN - k : len(x) - MARGIN - k]
        first += a * (after - before)
        second += b * ((after - x[inner]) + (before - x[inner]))
    return first * sample_rate, second * sample_rate**2


def motion_spectrum(
    q: Sequence[Array], sample_rate: float, integrals: Sequence[Array] = (), used: Array | None = None
) -> tuple[Array, Array, Array, Array]:
    """Power spectrum of the joint velocities, from positions or measured velocities, whichever are less noisy.

    Frequencies, shape (F,) [Hz], the power of the velocities and of their noise, shape (F, n), and the crossovers below
    which positions measure better, shape (n,) [Hz], infinite where measured velocities are not used. Averaged over the
    segments that are long enough, shape (T, n) each; `integrals` are those of measured velocities.

    Noise of the positions that is equal at all frequencies, as that of quantisation, has in differences the spectrum
    N (2 sin(pi f / f_s))^2; N is the median over the upper half of the frequencies, and the noise of the velocities the
    median of theirs. Velocities that a drive has filtered have little noise but come late: their noise is also what
    they differ by from the positions', if these have a bandwidth and their noise does not account for it.
    """
    f, power = _power(q, q, sample_rate)
    velocities = power.real
    shape = ((2 * np.sin(np.pi * f / sample_rate)) ** 2)[:, None]
    upper = f > sample_rate / 4
    level = np.median(velocities[upper] / shape[upper], axis=0)
    noise, crossover = level * shape, np.full(velocities.shape[1], np.inf)
    if used is None or not used.any():
        return f, velocities, noise, crossover
    off = [x - y for x, y in zip(q, integrals, strict=True)]
    measured, difference = (_power(x, x, sample_rate)[1].real for x in (integrals, off))
    bandwidth = _bandwidths(f, velocities, noise)[1].max()
    is_bounded = thresholds.ABOVE_MOTION * bandwidth < thresholds.HIGHEST_CUTOFF * sample_rate
    if not is_bounded:  # repeated positions have noise at single frequencies
        level = np.mean(velocities[upper] / shape[upper], axis=0)
    unexplained = (difference > thresholds.SIGNIFICANT * noise) & is_bounded
    late = np.where(unexplained, difference, 0.0).sum(0) / np.maximum(unexplained.sum(0), 1)
    measured_noise = np.maximum(np.median(measured[upper], axis=0), late)
    equal = sample_rate / (2 * np.pi) * np.sqrt(measured_noise / np.maximum(level, thresholds.TINY))
    better = used & (equal < thresholds.HIGHEST_CROSSOVER * sample_rate)
    crossover[better] = np.maximum(equal[better], thresholds.CROSSOVER_PERIODS * sample_rate / max(len(x) for x in q))
    above = f[:, None] > crossover
    return f, np.where(above, measured, velocities), np.where(above, measured_noise, noise), crossover


def _power(x: Sequence[Array], y: Sequence[Array], sample_rate: float) -> tuple[Array, Array]:
    """Frequencies, and the mean cross spectrum of the derivatives of x and y over the segments."""
    from scipy.signal import csd

    length = _window(x, sample_rate)
    spectra, weights = [], []
    for a, b in zip(x, y, strict=True):
        if len(a) > length:
            first = np.diff(a, axis=0) * sample_rate
            second = first if b is a else np.diff(b, axis=0) * sample_rate
            spectra.append(csd(first, second, sample_rate, "hann", length, detrend="constant", axis=0))
            weights.append(len(a))
    return spectra[0][0][1:], np.average([power[1:] for _, power in spectra], axis=0, weights=weights)


def _window(x: Sequence[Array], sample_rate: float) -> int:
    """Number of samples of one spectrum, for which enough segments are long enough."""
    lengths = np.sort([len(part) for part in x] or [0])
    shortest = int(lengths[np.searchsorted(np.cumsum(lengths), (1 - thresholds.LONG_ENOUGH) * lengths.sum())])
    length = min(int(thresholds.SPECTRUM_SECONDS * sample_rate), shortest - 1)
    if length < thresholds.SPECTRUM_SAMPLES:
        raise ValueError("the segments are too short for a spectrum of the positions")
    return length


def integral(velocities: Array, sample_rate: float) -> Array:
    """Integral of a cubic spline through samples along the first axis, zero at the first."""
    from scipy.interpolate import CubicSpline

    t = np.arange(len(velocities)) / sample_rate
    return np.asarray(CubicSpline(t, velocities, axis=0).antiderivative()(t))


def complementary_filter(q: Array, integrals: Array, crossover: Array, sample_rate: float) -> Array:
    """Positions, low frequencies as measured, those above each joint's crossover from integrated velocities."""
    fused = q.copy()
    for j in np.flatnonzero(np.isfinite(crossover)):
        slow = low_pass(q[:, j] - integrals[:, j], crossover[j], sample_rate)
        fused[:, j] = integrals[:, j] + slow
    return fused


def choose_cutoff(
    spectrum: Sequence[Array], sample_rate: float, q: Sequence[Array], tau: Sequence[Array]
) -> tuple[float, tuple[str, ...]]:
    """Cut-off [Hz] for the motion of these segments, shape (T, n) each, by its spectrum, and the reason."""
    f, velocities, noise, crossover = spectrum
    highest, warned = thresholds.HIGHEST_CUTOFF * sample_rate, []
    cutoff, reason = _cutoff(f, velocities, noise)
    if cutoff > highest:  # noise may be taken for motion: only what torques and positions have in common counts
        common = velocities * _coherence(q, tau, sample_rate)
        warned = [
            f"warning: the spectrum asks for a cut-off above {highest:.6g} Hz, a fifth of the sample rate: positions "
            "that repeat or jump, noise up to half the sample rate, or a sample rate that is too low"
        ]
        if (common > thresholds.SIGNIFICANT * noise).any():
            cutoff, reason = _cutoff(f, common, noise)
            reason = f"of what torques and positions have in common, {reason}"
    if cutoff > highest:
        cutoff, reason = highest, f"{thresholds.HIGHEST_CUTOFF:g} times the sample rate of {sample_rate:.6g} Hz"
    source = "positions" if np.isinf(crossover).all() else "positions and measured velocities"
    return cutoff, (f"cut-off {cutoff:.3g} Hz, chosen from the spectrum of the {source}: {reason}", *warned)


def _cutoff(f: Array, velocities: Array, noise_power: Array) -> tuple[float, str]:
    """Cut-off from the bandwidths of the joints that move, and the reason."""
    speed, motions, noises = _bandwidths(f, velocities, noise_power)
    if not speed.any():
        raise ValueError("the positions show no motion above their noise")
    moving = speed >= thresholds.SLOW_JOINT * speed.max()
    motion, noise, factor = motions[moving].max(), noises[moving].min(), thresholds.ABOVE_MOTION
    if noise < factor * motion:
        reason = f"the motion's bandwidth is {motion:.3g} Hz, noise disturbs the accelerations from {noise:.3g} Hz on"
        return float(max(noise, thresholds.LEAST_ABOVE * motion)), reason
    return float(factor * motion), f"{factor:g} times the motion's bandwidth of {motion:.3g} Hz"


def _coherence(q: Sequence[Array], tau: Sequence[Array], sample_rate: float) -> Array:
    """Squared coherence of positions and torques, shape (F, n); zero above where it may be chance."""
    f, both = _power(q, tau, sample_rate)
    moved, torque = (_power(x, x, sample_rate)[1].real for x in (q, tau))
    squared: Array = np.abs(both) ** 2 / np.maximum(moved * torque, thresholds.TINY)
    window = _window(q, sample_rate)
    averages = max(2.0, thresholds.AVERAGES * sum(len(x) for x in q if len(x) > window) / window)
    chance = squared < 1 - thresholds.COHERENT_BY_CHANCE ** (1 / (averages - 1))
    chance[:-1] &= chance[1:]  # two neighbouring frequencies
    start = np.argmax(squared * moved / f[:, None] ** 2, axis=0)
    ended = np.cumsum(chance & (np.arange(len(f))[:, None] > start), axis=0) > 0
    return np.where(ended, 0.0, squared)


def _bandwidths(f: Array, velocities: Array, noise: Array) -> tuple[Array, Array, Array]:
    """RMS velocities, bandwidths of the motion, and frequencies from which noise disturbs accelerations, (n,) each."""
    power = np.cumsum(np.where(velocities > thresholds.SIGNIFICANT * noise, velocities - noise, 0.0), axis=0)
    motion = (power < thresholds.MOTION_POWER * power[-1]).sum(axis=0)
    omega2 = (2 * np.pi * f[:, None]) ** 2
    moved = (omega2 * velocities * (np.arange(len(f))[:, None] <= motion)).sum(axis=0)
    disturbed = np.cumsum(omega2 * noise, axis=0) > thresholds.NOISE_OF_ACCELERATIONS * moved
    beyond = np.where(disturbed.any(axis=0), np.argmax(disturbed, axis=0), -1)
    return np.sqrt(power[-1] * f[0]), f[motion], f[beyond]
