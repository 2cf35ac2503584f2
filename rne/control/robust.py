"""Robust control by Lyapunov redesign: computed torque with a further term against a bounded error of its model."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from ..basics.arrays import positive_number, vector
from ..basics.spatial import Array
from ..basics.text import summary
from ..elementwise import maximum
from ..robot import Robot
from .laws import checked_vectors
from .reference import Reference, check_reference, composite


def saturated_direction(v: Array, width: float) -> Array:
    """v / max(|v|, width): a unit vector outside of the boundary layer, continuous within."""
    square = (v * v).sum(-1, keepdims=True)
    return np.asarray(v / np.sqrt(maximum(square, width * width)))


@dataclass(frozen=True, eq=False)
class Robust:
    """Computed torque with Lyapunov redesign, made by `robust`.

    Attributes
    ----------
    robot : Robot
        The controller's model.
    bandwidth : ndarray, shape (n,)
        Decay of the tracking error [1/s].
    boundary : ndarray, shape (n,)
        Half-axes of the boundary layer of s = e' + bandwidth e [rad/s or m/s].
    reference : callable
        f(t) -> (q, qd, qdd) [rad or m; rad/s or m/s; rad/s^2 or m/s^2].
    rho : float
        Bound on the error of the model [W].

    Examples
    --------
    >>> import numpy as np, rne
    >>> robot, path = rne.load("irb140"), rne.trajectories.quintic([0] * 6, [1] * 6, 2.0)
    >>> law = rne.control.robust(robot, [10] * 6, [0.1] * 6, path, rho=5.0)
    >>> np.allclose(law(0.0, np.zeros(6), np.zeros(6)), robot.gravity_torque([0] * 6)), law.error_bound[0].item()
    (True, 0.01)
    """

    robot: Robot
    bandwidth: Array
    boundary: Array
    reference: Reference
    rho: float
    traceable = True

    __repr__ = summary

    @property
    def error_bound(self) -> Array:
        """Largest tracking error of each joint, boundary / bandwidth, shape (n,) [rad or m].

        From a start with |z| <= 1, z = s / boundary, and |e_i| <= boundary_i / bandwidth_i: the layer bounds s alone.
        """
        return self.boundary / self.bandwidth

    def __call__(self, t: float, q: Array, qd: Array) -> Array:
        """Torques in one state, or in many.

        Parameters
        ----------
        t : float
            Time [s].
        q, qd : array_like, shape (..., n)
            Joint positions and rates [rad or m; rad/s or m/s].

        Returns
        -------
        ndarray, shape (..., n)
            Torques of the drives [N m or N].
        """
        s, _, qddr, _ = composite(self.robot, self.reference, self.bandwidth, t, q, qd)
        y = qddr - self.bandwidth * s  # qdd_ref - Kd e' - Kp e: Siciliano et al. 2009, (8.59)
        w = -self.rho * saturated_direction(s / self.boundary, 1.0) / self.boundary  # (8.74), (8.78)
        torques: Array = self.robot.inverse_dynamics(q, qd, y) + w
        return torques


def robust(robot: Robot, bandwidth: ArrayLike, boundary: ArrayLike, reference: Reference, rho: float) -> Robust:
    """Computed torque with Lyapunov redesign: u = M y + C qd + g - rho D^-1 z / max(|z|, 1), with z = D^-1 s.

    Parameters
    ----------
    robot : Robot
        The controller's model.
    bandwidth : array_like, shape (n,)
        The gains are Kp = bandwidth^2 and Kd = 2 bandwidth: without an error of the model s = e' + bandwidth e and e
        decay at this rate [1/s].
    boundary : array_like, shape (n,)
        D: half-axes of the boundary layer |z| <= 1 in s. A good choice is in proportion to the inverse root of the
        joints' inertias [rad/s or m/s].
    reference : callable
        A function f(t) -> (q, qd, qdd).
    rho : float
        Bound on the error of the model where |z| <= 1 and |e_i| <= boundary_i / bandwidth_i, such as from
        `rne.control.uncertainty_bound` [W].

    Returns
    -------
    Robust
        The law f(t, q, qd) -> torques, with its `error_bound`.

    Raises
    ------
    ValueError
        If an array has the wrong shape or sign or is not finite.

    Notes
    -----
    Siciliano et al. 2009, section 8.5.4, with Q such that z = D^T Q xi is s in scaled coordinates, and with one change:
    there w is multiplied by the model's M, which requires |1 - M^-1 M_hat| < 1. A payload that outweighs the wrist
    breaks this for every mass that a model can have in between. Here w is a torque. M^-1 is positive definite, so that
    rho >= lambda_max(D M D) |(D M D)^-1 D f| suffices, f being the torque that the model is short of. Then a motion
    from a start with |z| <= 1 and |e_i| <= boundary_i / bandwidth_i keeps both. The second condition is needed because
    the layer bounds s alone: a larger e decays towards this bound, if rho holds there too. This assumes drives that are
    not saturated, a law that is not sampled, and that rho bounds what is not modelled as well, such as friction.

    Examples
    --------
    >>> import rne
    >>> robot, path = rne.load("irb140"), rne.trajectories.quintic([0] * 6, [1] * 6, 2.0)
    >>> law = rne.control.robust(robot, [10] * 6, [0.1] * 6, path, rho=5.0)
    >>> rne.Scene(robot, controller=law).cost()["law"]
    'traced'
    """
    rate, D = checked_vectors(robot, bandwidth=bandwidth, boundary=boundary)
    for name, value in (("bandwidth", rate), ("boundary", D)):
        vector(name, value, robot.n, sign="positive")
    check_reference(robot, reference)
    return Robust(robot, rate, D, reference, positive_number("rho", rho))
