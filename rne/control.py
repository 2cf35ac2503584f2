"""Control laws: functions of (t, q, qd) that give joint torques."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike

from .arguments import joint_array
from .robot import Robot
from .spatial import Array

Law = Callable[[float, Array, Array], Array]


def pd_gravity(robot: Robot, kp: ArrayLike, kd: ArrayLike, reference: ArrayLike) -> Law:
    """PD control with gravity compensation: u = g(q) - Kp (q - reference) - Kd qd.

    Parameters
    ----------
    robot : Robot
        Whose g(q) is compensated.
    kp, kd : array_like, shape (n,)
        Gains of each joint [N m/rad, N m s/rad].
    reference : array_like, shape (n,)
        [rad or m]

    Returns
    -------
    callable
        f(t, q, qd) -> torques, shape (..., n).

    Raises
    ------
    ValueError
        If an array has the wrong shape or is not finite.

    Notes
    -----
    Høifødt 2011, (6.46) with the sign that (6.50)-(6.56) need: the error is q - reference.

    Examples
    --------
    >>> import rne
    >>> from rne.control import pd_gravity
    >>> law = pd_gravity(rne.load("irb140"), [50] * 6, [20] * 6, [0] * 6)
    """
    p, d, q_ref = (
        joint_array(name, value, robot.model) for name, value in (("kp", kp), ("kd", kd), ("reference", reference))
    )

    def law(t: float, q: Array, qd: Array) -> Array:
        u: Array = robot.gravity_torque(q) - p * (np.asarray(q) - q_ref) - d * np.asarray(qd)
        return u

    return law
