"""Laws of joint friction, each per unit of its coefficient: the same in fits to measurements and in simulations.

Stribeck effect: Armstrong-Hélouvry, Dupont and Canudas de Wit 1994, section 2.1. Friction under load: Hamon, Gautier
and Garrec 2010.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..basics.spatial import Array
from ..elementwise import exp, less, sign, tanh, where


def direction(qd: Array, smoothing: float) -> Array:
    """The direction of motion: tanh(qd / smoothing), or with 0 the sign of qd, which is 0 at rest."""
    return tanh(qd * (1 / smoothing)) if smoothing else sign(qd)


def saturating(qd: Array, velocity: ArrayLike | None) -> Array:
    """Viscous friction, qd, or velocity tanh(qd / velocity), which saturates, where the velocity is not 0."""
    if velocity is None:
        return qd
    given = np.asarray(velocity, np.float64)
    saturated: Array = where(given > 0, given * tanh(qd / np.where(given > 0, given, 1.0)), qd)
    return saturated


def stribeck_effect(qd: Array, velocity: ArrayLike, smoothing: float) -> Array:
    """The direction of motion times exp(-|qd| / velocity), 0 where the velocity is 0."""
    given = np.asarray(velocity, np.float64)
    falling = exp(-magnitude(qd) / np.where(given > 0, given, 1.0))
    effect: Array = (given > 0) * (direction(qd, smoothing) * falling)
    return effect


def magnitude(x: Any) -> Array:
    """|x|."""
    return where(less(x, 0), -x, x)
