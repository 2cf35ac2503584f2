"""Control laws that follow a reference motion."""

from __future__ import annotations

from dataclasses import dataclass

from numpy.typing import ArrayLike

from ..basics.spatial import Array
from ..basics.text import summary
from ..robot import Robot
from .laws import checked_vectors
from .reference import Reference, check_reference, reference_values


@dataclass(frozen=True, eq=False)
class ComputedTorque:
    """Inverse dynamics of the commanded acceleration, made by `computed_torque`.

    Attributes
    ----------
    robot : Robot
        The controller's model.
    kp, kd : ndarray, shape (n,)
        Gains of the error [1/s^2, 1/s].
    reference : callable
        f(t) -> (q, qd, qdd) [rad or m; rad/s or m/s; rad/s^2 or m/s^2].

    Examples
    --------
    >>> import numpy as np, rne
    >>> robot, path = rne.load("irb140"), rne.trajectories.quintic([0] * 6, [1] * 6, 2.0)
    >>> law = rne.control.computed_torque(robot, [100] * 6, [20] * 6, path)
    >>> np.allclose(law(0.0, np.zeros(6), np.zeros(6)), robot.gravity_torque([0] * 6))
    True
    """

    robot: Robot
    kp: Array
    kd: Array
    reference: Reference
    traceable = True

    __repr__ = summary

    def __call__(self, t: float, q: Array, qd: Array) -> Array:
        """Torques in one state.

        Parameters
        ----------
        t : float
            Time [s].
        q, qd : array_like, shape (n,)
            Joint positions and rates [rad or m; rad/s or m/s].

        Returns
        -------
        ndarray, shape (n,)
            Torques of the drives [N m or N].
        """
        q_ref, qd_ref, qdd_ref = reference_values(self.robot, self.reference(t))
        commanded = qdd_ref - self.kd * (qd - qd_ref) - self.kp * (q - q_ref)
        return self.robot.inverse_dynamics(q, qd, commanded)


def computed_torque(robot: Robot, kp: ArrayLike, kd: ArrayLike, reference: Reference) -> ComputedTorque:
    """Tracking by inverse dynamics: u = M (qdd_ref - Kd (qd - qd_ref) - Kp (q - q_ref)) + C qd + g.

    Parameters
    ----------
    robot : Robot
        The controller's model.
    kp, kd : array_like, shape (n,)
        Gains of the error, which then obeys e'' + Kd e' + Kp e = 0 [1/s^2, 1/s].
    reference : callable
        A function f(t) -> (q, qd, qdd); `rne.trajectories` has motions from rest to rest, and
        splines through samples.

    Returns
    -------
    ComputedTorque
        The law f(t, q, qd) -> torques, shape (..., n).

    Raises
    ------
    ValueError
        If an array has the wrong shape or is not finite.

    Notes
    -----
    Siciliano et al. 2009, (8.57)-(8.60); what Høifødt 2011 recommends for tracking.

    Examples
    --------
    >>> import rne
    >>> arm = rne.load("irb140")
    >>> path = rne.trajectories.quintic([0] * 6, [1] * 6, 2.0)
    >>> law = rne.control.computed_torque(arm, [100] * 6, [20] * 6, path)
    >>> motion = rne.simulate(rne.Scene(arm, controller=law), [0] * 6, [0] * 6, 2.0)
    >>> motion.q[-1].round(6).tolist()
    [1.0, 1.0, 1.0, 1.0, 1.0, 1.0]
    """
    p, d = checked_vectors(robot, kp=kp, kd=kd)
    check_reference(robot, reference)
    return ComputedTorque(robot, p, d, reference)
