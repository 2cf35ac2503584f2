"""Residuals that are like those of neighbouring equations carry less information than their number says.

The sum over their autocorrelations, 1 + 2 sum rho_k, is the number of equations that count as one (Sokal 1997, section
3). What a model leaves out is correlated; and noise that was white before the low-pass filter is so after it.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ...basics.spatial import Array
from ..measurements.filtering import low_pass

RESPONSE = 8.0  # periods of the cut-off after which nothing is left of an impulse
WINDOW = 5.0  # the sum ends at this many times itself (Sokal's rule)


def repeats_of_residuals(residuals: Array, used: Array, parts: Sequence[slice]) -> Array:
    """1 + 2 sum rho_k of each joint, at least 1.

    Parameters
    ----------
    residuals : ndarray, shape (rows, n)
    used : ndarray of bool, shape (rows, n)
        Rows that were fitted.
    parts : sequence of slice
        Rows without a gap between them.

    Returns
    -------
    ndarray, shape (n,)
    """
    return np.array([_of_joint(r, u, parts) for r, u in zip(residuals.T, used.T, strict=True)])


def repeats_of_filtered_noise(cutoff: float, sample_rate: float, decimation: int) -> float:
    """The same for noise that was white before the filter, from the filter's response to an impulse."""
    reach = decimation * int(np.ceil(RESPONSE * sample_rate / (cutoff * decimation)))
    impulse = np.zeros((2 * reach + 1, 1))
    impulse[reach] = 1
    response = low_pass(impulse, cutoff, sample_rate)[:, 0]
    covariances = np.correlate(response, response, "full")[len(response) - 1 :: decimation]
    return float(2 * covariances.sum() / covariances[0] - 1)


def _of_joint(residual: Array, used: Array, parts: Sequence[slice]) -> float:
    variance = (residual[used] ** 2).mean() if used.any() else 0.0
    if variance == 0:
        return 1.0
    total, longest = 1.0, max(part.stop - part.start for part in parts)
    for lag in range(1, longest):
        pairs, products = 0, 0.0
        for part in parts:
            both = used[part][lag:] & used[part][:-lag]
            pairs += int(both.sum())
            products += float((residual[part][lag:] * residual[part][:-lag])[both].sum())
        total += 2 * products / (variance * max(pairs, 1)) * (1 - lag / longest)
        if lag >= WINDOW * total:
            break
    return max(total, 1.0)
