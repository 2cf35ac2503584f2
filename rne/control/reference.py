"""Reference motions of control laws, and the torques of a model that follows them."""

from __future__ import annotations

from typing import Any, Protocol

import numpy as np

from ..basics.arrays import check_function
from ..basics.spatial import Array
from ..robot import Robot


class Reference(Protocol):
    """A reference motion: any function of time that gives positions, velocities and accelerations.

    The motions of `rne.trajectories` are references, and so is a `Trajectory`.

    Examples
    --------
    >>> import numpy as np, rne
    >>> def sway(t):
    ...     return np.sin([t] * 6), np.cos([t] * 6), -np.sin([t] * 6)
    >>> law = rne.control.computed_torque(rne.load("irb140"), 100, 20, sway)
    """

    def __call__(self, t: float, /) -> tuple[Array, Array, Array]:
        """Positions, velocities and accelerations of all joints at time t, shape (n,) each."""


def check_reference(robot: Robot, reference: Any) -> None:
    """Raise a ValueError if this is no reference motion of the robot."""
    if not callable(reference):
        raise ValueError(f"`reference` must be a function of time, got {type(reference).__name__}")
    check_function("reference", reference, "(t)")
    reference_values(robot, reference(0.0))


def reference_values(robot: Robot, given: Any) -> tuple[Any, Any, Any]:
    """The values that a reference gave, as (q, qd, qdd)."""
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


def composite_error(
    robot: Robot, reference: Reference, bandwidth: Array, t: Any, q: Any, qd: Any
) -> tuple[Array, Array, Array]:
    """s = qd - qdr with qdr = qd_ref - bandwidth e, e = q - q_ref (Slotine and Li 1987); returns s, qdr, qddr."""
    q_ref, qd_ref, qdd_ref = reference_values(robot, reference(t))
    qdr = qd_ref - bandwidth * (np.asarray(q) - q_ref)
    qddr = qdd_ref - bandwidth * (np.asarray(qd) - qd_ref)
    return qd - qdr, qdr, qddr


def model_torques(robot: Robot, Y: Array, parameters: Array, qddr: Array) -> Array:
    """M qddr + C qdr + g: Y pi of the parameters, and the torque of the rotors, which are known."""
    model = robot.model
    rotors = model.coordinate_map.T @ (model.armature[:, None] * model.coordinate_map)
    torques: Array = (Y @ parameters[..., None])[..., 0] + qddr @ rotors
    return torques
