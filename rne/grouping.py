"""Mass moved inwards as far as it may go: more zeros, the same torques and the same M.

A mass on the axis of a turning joint moves alike with the bodies on both sides of it, so it may be counted with either;
and a body's second moments about its origin only ask how it turns, which across a sliding joint is the same on both
sides. Of its ten moments a body keeps seven behind a turning joint and four behind a sliding one; what reaches the
base is dropped. These are the base inertial parameters of Gautier and Khalil (IEEE Trans. Robotics Autom. 6, 1990).
"""

from __future__ import annotations

from .model import Model, Moments
from .spatial import Array, outer, transpose


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
    mass, first, second = (array.copy() for array in model.moments)
    for i in reversed(range(model.nb)):
        R, p, b = model.rotation[i], model.translation[i], model.axis[i]
        if model.is_revolute(i):
            on_axis = mass[i], first[i] @ b, b @ second[i] @ b
            mass[i], first[i], second[i] = 0, first[i] - on_axis[1] * b, second[i] - on_axis[2] * outer(b, b)
            moved = _rod(*on_axis, p, R @ b)
        else:
            moved = Moments(0 * mass[i], 0 * first[i], R @ second[i] @ transpose(R))
            second[i] = 0
        if model.parent[i] >= 0:
            k = model.parent[i]
            mass[k], first[k], second[k] = mass[k] + moved.mass, first[k] + moved.first, second[k] + moved.second
    return model.with_moments(Moments(mass, first, second))


def _rod(mass: Array, first: Array, second: Array, p: Array, u: Array) -> Moments:
    """Moments of masses on a line through p along u, from their moments along it about p."""
    cross_terms = first * (outer(p, u) + outer(u, p))
    return Moments(mass, mass * p + first * u, mass * outer(p, p) + cross_terms + second * outer(u, u))
