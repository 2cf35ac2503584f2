"""The parts of a scene, and what they are in numbers."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ..basics.arrays import UNBOUNDED, convert_numbers, per_joint_array
from ..basics.spatial import Array
from ..robot import Robot
from .friction import Friction, urdf_friction


class Payload(NamedTuple):
    """A rigid body fixed to a link, for a Scene.

    Parameters
    ----------
    mass : float
        Mass of the body [kg].
    com : array_like, shape (3,)
        Its centre of mass in the link's frame; the link's origin if not given [m].
    inertia : array_like, shape (3, 3), or None
        About its centre of mass, in the link's axes; None for a point mass [kg m^2].
    link : str, optional
        One of the robot's links. If not given, the last link of the chain, a fixed frame such as a flange behind the
        last joint included.

    Examples
    --------
    >>> import rne
    >>> scene = rne.Scene(rne.load("irb140"), payload=rne.Payload(5.0, com=[0, 0, 0.1]))
    >>> scene.resolved.robot.model.mass[-1].item()  # with 1 kg of the last link
    6.0
    """

    mass: float
    com: ArrayLike = (0.0, 0.0, 0.0)
    inertia: ArrayLike | None = None
    link: str | None = None


@dataclass(frozen=True, eq=False)
class ResolvedScene:
    """The parts of a scene in numbers, as the simulation needs them.

    Attributes
    ----------
    robot : Robot
        Mounted, with payload, joints locked, the drives' inertia added.
    friction : Friction or None
    effort_limit : ndarray, shape (n,), or None
        Largest torque of each drive; None if none is limited [N m or N].
    torque_rate : ndarray, shape (n,), or None
        Largest change of a held torque per second [N m/s or N/s].
    """

    robot: Robot
    friction: Friction | None
    effort_limit: Array | None
    torque_rate: Array | None


def resolved_friction(friction: Friction | str | None, robot: Robot) -> Friction | None:
    """A scene's friction, that of the file if it says so."""
    if friction is None:
        return None
    if isinstance(friction, str):
        if friction != "urdf":
            raise ValueError(f"`friction` must be an rne.Friction or 'urdf', got {friction!r}")
        return urdf_friction(robot.model)
    if not isinstance(friction, Friction):
        raise TypeError(f"`friction` must be an rne.Friction or 'urdf', got {type(friction).__name__}")
    friction.check(robot.model)
    return friction


def resolved_limit(limit: ArrayLike | str | None, robot: Robot) -> Array | None:
    """Largest torque of each drive, that of the file if it says so; None if none is limited."""
    if limit is None:
        return None
    if isinstance(limit, str | bool):
        if limit != "urdf":
            raise ValueError(f"`effort_limit` must be an array or 'urdf', got {limit!r}")
        bounds = np.asarray(robot.effort_limit, dtype=float)
    else:
        bounds = bounds_of("effort_limit", limit, robot.n)
    return None if (bounds >= UNBOUNDED).all() else np.minimum(bounds, UNBOUNDED)


def bounds_of(name: str, value: ArrayLike, n: int) -> Array:
    """Largest absolute values, one per joint; an infinite one is no bound."""
    array = convert_numbers(name, value, f"({n},)")
    return per_joint_array(name, np.where(np.isposinf(array), UNBOUNDED, array), n, sign="not negative")
