"""Mass moved inwards as far as it may go: more zeros, the same torques and the same M.

A mass on the axis of a turning joint moves alike with the bodies on both sides of it, so it may be counted with either;
and a body's inertia about its origin only asks how it turns, which across a sliding joint is the same on both sides. Of
its ten parameters a body keeps seven behind a turning joint and four behind a sliding one; what reaches the base is
dropped. These are the base inertial parameters of Gautier and Khalil (IEEE Trans. Robotics Autom. 6, 1990).
"""

from __future__ import annotations

import numpy as np

from .model import Model, Moments
from .spatial import IDENTITY, Array, outer, point_mass_inertia, transpose


def grouped(model: Model) -> Model:
    """The robot with every mass moved inwards that may move.

    Parameters
    ----------
    model : Model

    Returns
    -------
    Model
        With the same torques, M and accelerations in every state. Energies and joint wrenches are not those of the
        robot: a mass is not always where it is felt.

    Examples
    --------
    >>> import rne
    >>> from rne.grouping import grouped
    >>> grouped(rne.irb140()).moments.mass.tolist()
    [0.0, 0.0, 0.0, 0.0, 0.0, 0.0]
    """
    mass, first, inertia = (array.copy() for array in model.moments)
    for i in reversed(range(model.nb)):
        R, p, b = model.rotation[i], model.translation[i], model.axis[i]
        if model.is_revolute(i):
            e = across(b)
            on_axis = mass[i], first[i] @ b, e @ inertia[i] @ e
            moved = Moments(*_rod(*on_axis, p, R @ b))
            mass[i], first[i] = 0, first[i] - on_axis[1] * b
            inertia[i] = inertia[i] - on_axis[2] * (IDENTITY - outer(b, b))
        else:
            moved = Moments(0 * mass[i], 0 * first[i], R @ inertia[i] @ transpose(R))
            inertia[i] = 0
        if model.parent[i] >= 0:
            k = model.parent[i]
            mass[k], first[k], inertia[k] = mass[k] + moved.mass, first[k] + moved.first, inertia[k] + moved.inertia
    return model.with_moments(Moments(mass, first, inertia))


def across(b: Array) -> Array:
    """A unit vector square to b: along a frame axis if b is."""
    k = int(np.argmin(np.abs(b)))
    e = np.eye(3)[k] - b[k] * b
    unit: Array = e / np.sqrt(e @ e)
    return unit


def _rod(mass: Array, first: Array, second: Array, p: Array, u: Array) -> tuple[Array, Array, Array]:
    """Moments of masses on a line through p along u, from their moments along it about p."""
    cross_terms = 2 * (p @ u) * IDENTITY - outer(p, u) - outer(u, p)
    inertia = point_mass_inertia(mass, p) + first * cross_terms + second * (IDENTITY - outer(u, u))
    return mass, mass * p + first * u, inertia
