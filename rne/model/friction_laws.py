"""Laws of joint friction, each per unit of its coefficient, for fits to measurements and for simulations.

Stribeck effect: Armstrong-Hélouvry, Dupont and Canudas de Wit 1994, section 2.1. Friction under load: Hamon, Gautier
and Garrec 2010.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..basics.spatial import Array
from ..elementwise import exp, less, sign, tanh, where
from ..graph.scalar import is_present

SMOOTHING = 0.01  # velocity at which smoothed Coulomb friction reaches tanh(1) = 76 % of its value [rad/s or m/s]


def direction(qd: Array, smoothing: float) -> Array:
    """Direction of motion: tanh(qd / smoothing), or with 0 the sign of qd, which is 0 at rest."""
    return tanh(qd * (1 / smoothing)) if is_present(smoothing) else sign(qd)


def saturating(qd: Array, velocity: ArrayLike | None) -> Array:
    """Viscous friction, qd, or velocity tanh(qd / velocity), which saturates, where the velocity is not 0."""
    if velocity is None:
        return qd
    given, acts = _positive(velocity)
    saturated: Array = where(acts, given * tanh(qd / given), qd)
    return saturated


def saturating_slope(qd: Array, velocity: ArrayLike) -> Array:
    """Derivative of `saturating` with respect to qd."""
    given, acts = _positive(velocity)
    slope: Array = where(acts, 1 - tanh(qd / given) ** 2, 1.0)
    return slope


def stribeck_effect(qd: Array, velocity: ArrayLike, smoothing: float) -> Array:
    """Direction of motion times exp(-|qd| / velocity), 0 where the velocity is 0."""
    given, acts = _positive(velocity)
    effect: Array = acts * (direction(qd, smoothing) * exp(-magnitude(qd) / given))
    return effect


def _positive(velocity: ArrayLike) -> tuple[Array, Array]:
    """Velocities with zeros replaced by 1, and 1.0 where they are not zero."""
    given = np.asarray(velocity)
    acts = less(0, given)
    return where(acts, given, 1.0), 1.0 * acts


def magnitude(x: Any) -> Array:
    """Absolute value |x|."""
    return where(less(x, 0), -x, x)
