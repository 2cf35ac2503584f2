"""Masses redistributed between bodies so that dynamics have the fewest terms: more zeros, the same torques and M.

A mass on the axis of a rotating joint moves alike with the bodies on both sides of it, so it may be counted with
either; and a body's inertia about its origin depends only on its rotation, which is the same on both sides of a sliding
joint. Of its ten inertial parameters a body keeps seven behind a rotating joint and four behind a sliding one; what
reaches the base is dropped. This is the regrouping of Gautier and Khalil (IEEE Trans. Robotics Autom. 6, 1990), joint
by joint; which combinations torques depend on, with what a first axis along gravity hides besides, is said by
`rne.dynamics.base_parameters`.
"""

from __future__ import annotations

import numpy as np

from ..basics.spatial import IDENTITY, Array, outer, point_mass_inertia, transpose
from .model import Model
from .parameters import with_moments
from .solids import Moments


def with_fewest_terms(model: Model) -> Model:
    """The robot with every inertial parameter moved towards the base that may be.

    It has the same torques, M and accelerations in every state. Energies and joint wrenches are not those of the robot,
    because masses are redistributed between bodies.
    """
    mass, first_moment, inertia = (array.copy() for array in model.moments)
    for i in reversed(range(model.nb)):
        R, p, b = model.rotation[i], model.translation[i], model.axis[i]
        if model.is_revolute[i]:
            e = perpendicular(b)
            on_axis = mass[i], first_moment[i] @ b, e @ inertia[i] @ e
            moved = _moments_of_rod(*on_axis, p, R @ b)
            mass[i], first_moment[i] = 0, first_moment[i] - on_axis[1] * b
            inertia[i] = inertia[i] - on_axis[2] * (IDENTITY - outer(b, b))
        else:
            moved = Moments(0 * mass[i], 0 * first_moment[i], R @ inertia[i] @ transpose(R))
            inertia[i] = 0
        if model.parent[i] >= 0:
            k = model.parent[i]
            mass[k] = mass[k] + moved.mass
            first_moment[k] = first_moment[k] + moved.first_moment
            inertia[k] = inertia[k] + moved.inertia
    return with_moments(model, Moments(mass, first_moment, inertia))


def perpendicular(b: Array) -> Array:
    """A unit vector perpendicular to b: along a frame axis if b is."""
    k = int(np.argmin(np.abs(b)))
    e = np.eye(3)[k] - b[k] * b
    unit: Array = e / np.sqrt(e @ e)
    return unit


def _moments_of_rod(mass: Array, first: Array, second: Array, p: Array, u: Array) -> Moments:
    """Moments of masses on a line through p along u, from their moments along it about p."""
    cross_terms = 2 * (p @ u) * IDENTITY - outer(p, u) - outer(u, p)
    inertia = point_mass_inertia(mass, p) + first * cross_terms + second * (IDENTITY - outer(u, u))
    return Moments(mass, mass * p + first * u, inertia)
