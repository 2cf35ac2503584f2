"""Reference motions of control laws, and the torques of a model that follows them."""

from __future__ import annotations

from typing import Any, NamedTuple, Protocol

import numpy as np

from ..basics.spatial import Array
from ..robot import Robot


class Reference(Protocol):
    """A reference motion: any function of time that gives positions, rates and accelerations.

    Those of `rne.trajectories` are references, and so is a `Trajectory`.

    Examples
    --------
    >>> import numpy as np, rne
    >>> def sway(t):
    ...     return np.sin([t] * 6), np.cos([t] * 6), -np.sin([t] * 6)
    >>> law = rne.control.computed_torque(rne.load("irb140"), [100] * 6, [20] * 6, sway)
    """

    def __call__(self, t: float, /) -> tuple[Array, Array, Array]:
        """Positions, rates and accelerations at a time.

        Parameters
        ----------
        t : float
            Time [s].

        Returns
        -------
        q, qd, qdd : array_like, shape (n,)
            Of all joints [rad or m; rad/s or m/s; rad/s^2 or m/s^2].
        """


def check_reference(robot: Robot, reference: Any) -> None:
    """Raise a ValueError if this is no reference motion of the robot."""
    if not callable(reference):
        raise ValueError(f"`reference` must be a function of time, got {type(reference).__name__}")
    reference_values(robot, reference(0.0))


def reference_values(robot: Robot, given: Any) -> tuple[Any, Any, Any]:
    """What a reference gave, as (q, qd, qdd)."""
    try:
        shapes = [np.shape(part) for part in given]
    except TypeError:
        shapes = []
    if len(shapes) != 3 or any(shape[-1:] != (robot.n,) for shape in shapes):
        raise ValueError(
            f"`reference` must give (q, qd, qdd) of shape ({robot.n},) each, got {shapes or 'something else'}"
        )
    q, qd, qdd = given
    return q, qd, qdd


class Composite(NamedTuple):
    """Error of a law after Slotine and Li, and the motion that its model is to follow, shape (..., n) each.

    Attributes
    ----------
    s : ndarray
        qd - qdr; the tracking error e = q - q_ref obeys de/dt + bandwidth e = s [rad/s or m/s].
    qdr, qddr : ndarray
        Rates and accelerations qd_ref - bandwidth e and its derivative [rad/s or m/s; rad/s^2 or m/s^2].
    e : ndarray
        The tracking error [rad or m].
    """

    s: Array
    qdr: Array
    qddr: Array
    e: Array


def composite(robot: Robot, reference: Reference, bandwidth: Array, t: Any, q: Any, qd: Any) -> Composite:
    """The composite error in one state, or in many."""
    q_ref, qd_ref, qdd_ref = reference_values(robot, reference(t))
    e = np.asarray(q) - q_ref
    qdr = qd_ref - bandwidth * e
    qddr = qdd_ref - bandwidth * (np.asarray(qd) - qd_ref)
    return Composite(qd - qdr, qdr, qddr, e)


def model_torques(robot: Robot, Y: Array, parameters: Array, qddr: Array) -> Array:
    """M qddr + C qdr + g: Y pi of the parameters, and the torque of the rotors, which are known."""
    model = robot.model
    rotors = model.coordinate_map.T @ (model.armature[:, None] * model.coordinate_map)
    torques: Array = (Y @ parameters[..., None])[..., 0] + qddr @ rotors
    return torques
