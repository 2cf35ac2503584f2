"""Robust tracking: a nominal torque and a bounded term that dominates the error of the controller's model."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from ..basics.arrays import cached_array, positive_number
from ..basics.spatial import Array
from ..basics.text import summary
from ..elementwise import maximum
from ..robot import Robot
from .impulses import largest
from .laws import Reference, check_reference, checked_vectors, composite_error, model_torques, of_robot
from .uncertainty import Cases, checked_cases

SMALLEST = 1e-20  # [W^2], added below a square root, which has no derivative at zero


def saturated_direction(v: Array, width: float) -> Array:
    """v / max(|v|, width): a unit vector outside of the boundary layer, continuous within."""
    square = (v * v).sum(-1, keepdims=True)
    return np.asarray(v / np.sqrt(maximum(square, width * width)))


@dataclass(frozen=True, eq=False, repr=False)
class RobustLaw:
    """Base of robust laws: tracking by the composite error s = e' + bandwidth e with e = q - q_ref."""

    robot: Robot
    bandwidth: Array
    reference: Reference
    traceable = True

    def __repr__(self) -> str:
        return summary(self, cases=None)

    @cached_array
    def error_bound(self) -> Array:
        """Bound of each joint's tracking error, shape (n,) [rad or m]; derived where the law is made."""
        return self._bound_of_s() / self.bandwidth

    def __call__(self, t: float, q: Array, qd: Array) -> Array:
        """Torques [N m or N] at time t [s] for positions and velocities q, qd, shape (..., n)."""
        return self._torques(q, qd, *composite_error(self.robot, self.reference, self.bandwidth, t, q, qd))

    def _torques(self, q: Array, qd: Array, s: Array, qdr: Array, qddr: Array) -> Array:
        raise NotImplementedError

    def _bound_of_s(self) -> Array:
        raise NotImplementedError


@dataclass(frozen=True, eq=False, repr=False)
class Robust(RobustLaw):
    """Computed torque with Lyapunov redesign, made by `robust`; attributes are its arguments."""

    boundary: Array
    rho: float

    def _torques(self, q: Array, qd: Array, s: Array, qdr: Array, qddr: Array) -> Array:
        y = qddr - self.bandwidth * s  # qdd_ref - Kd e' - Kp e: Siciliano et al. 2009, (8.59)
        w = -self.rho * saturated_direction(s / self.boundary, 1.0) / self.boundary  # (8.74), (8.78)
        return self.robot.inverse_dynamics(q, qd, y) + w

    def _bound_of_s(self) -> Array:
        return self.boundary


@of_robot
def robust(robot: Robot, bandwidth: ArrayLike, boundary: ArrayLike, reference: Reference, rho: float) -> Robust:
    """Computed torque with Lyapunov redesign: u = M y + C qd + g - rho D^-1 z / max(|z|, 1), with z = D^-1 s.

    Parameters
    ----------
    robot : Robot
        The controller's model.
    bandwidth : float or array_like, shape (n,)
        The gains are Kp = bandwidth^2 and Kd = 2 bandwidth: without an error of the model s = e' + bandwidth e and e
        decay like exp(-bandwidth t) [1/s].
    boundary : float or array_like, shape (n,)
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
        The law f(t, q, qd) -> torques, with its `error_bound`: boundary / bandwidth.

    Raises
    ------
    ValueError
        If an array has the wrong shape or sign or is not finite.

    Notes
    -----
    Siciliano et al. 2009, section 8.5.4, with Q such that z = D^T Q xi is s in scaled coordinates, and with one change:
    there w is multiplied by the model's M, which requires |1 - M^-1 M_hat| < 1. A payload that outweighs the wrist
    breaks this for every mass that a model can have in between. Here w is a torque. M^-1 is positive definite, so that
    rho >= lambda_max(D M D) |(D M D)^-1 D f| suffices, f being the error of the model's torque. Then a motion from a
    start with |z| <= 1 and |e_i| <= boundary_i / bandwidth_i keeps both. The second condition is needed because the
    layer bounds only s: a larger e decays towards this bound, if rho holds there too. This assumes drives that are not
    saturated, a law that is not sampled, and that rho also bounds what is not modelled, such as friction.

    Examples
    --------
    >>> import rne
    >>> robot, path = rne.load("irb140"), rne.trajectories.quintic([0] * 6, [1] * 6, 2.0)
    >>> law = rne.control.robust(robot, 10, 0.1, path, rho=5.0)
    >>> rne.Scene(robot, controller=law).cost()["law"]
    'traced'
    """
    decay, D = checked_vectors(robot, sign="positive", bandwidth=bandwidth, boundary=boundary)
    check_reference(robot, reference)
    return Robust(robot, decay, reference, D, positive_number("rho", rho))


@dataclass(frozen=True, eq=False, repr=False)
class RobustPassive(RobustLaw):
    """Robust tracking after Spong, made by `robust_passive`.

    Its attributes are the arguments, and `robot`: the controller's model, in the middle of the cases.
    """

    kd: Array
    boundary: float
    cases: Cases

    @property
    def rms_bound(self) -> Array:
        """Bound on the root mean square of each joint's tracking error over a long time, shape (n,) [rad or m].

        sqrt(boundary / (4 kd)) / bandwidth: exact, without samples. Over a time T from a start on the reference with
        s = 0 it holds from the beginning.
        """
        return np.asarray(np.sqrt(self.boundary / (4 * self.kd)) / self.bandwidth)

    def _torques(self, q: Array, qd: Array, s: Array, qdr: Array, qddr: Array) -> Array:
        Y = self.robot.control_regressor(q, qd, qdr, qddr)
        torques: Array = model_torques(self.robot, Y, self.robot.parameters, qddr) - self.kd * s
        if not self.cases.ball.size:  # equal cases
            return torques
        YW = Y @ self.cases.ball
        power = (s[..., None, :] @ YW)[..., 0, :]
        shift = -saturated_direction(power, self.boundary)  # u_p = W shift: Spong 1992, (16)
        return np.asarray(torques + (YW @ shift[..., None])[..., 0])

    def _bound_of_s(self) -> Array:
        largest, inverse = self.cases.inertia_bounds(1 / np.sqrt(self.kd))
        return np.asarray(np.sqrt(largest * self.boundary / 4 * inverse))


def robust_passive(
    cases: Sequence[Robot], kd: ArrayLike, bandwidth: ArrayLike, reference: Reference, *, boundary: float
) -> RobustPassive:
    """Robust tracking on the parameters: u = Y (pi_0 + u_p) - Kd s, with u_p against Y^T s on the parameters' ball.

    Parameters
    ----------
    cases : sequence of Robot
        The robot that moves has a mixture of their parameters, such as of the arm without and with its largest payload.
        The controller's model is their mean.
    kd : float or array_like, shape (n,)
        Gains of s = e' + bandwidth e [N m s/rad or N s/m].
    bandwidth : float or array_like, shape (n,)
        Decay of the tracking error e = q - q_ref once s is zero [1/s].
    reference : callable
        A function f(t) -> (q, qd, qdd).
    boundary : float
        Width of the boundary layer in the power W^T Y^T s: errors grow with its root, a small one makes the loop stiff
        [W].

    Returns
    -------
    RobustPassive
        The law f(t, q, qd) -> torques, with its `rms_bound` and `error_bound`.

    Raises
    ------
    ValueError
        If an array has the wrong shape or sign or is not finite, or the cases differ in more than masses.

    Notes
    -----
    Spong 1992. pi = pi_0 + W z with |z| <= 1 holds every mixture of the cases; for two cases W is one column and the
    bound tight. V = s^T M s / 2 obeys V' <= -s^T Kd s + boundary / 4 <= -2 V / m + boundary / 4, m being the largest
    eigenvalue of Kd^-1/2 M Kd^-1/2; hence in the end s_i^2 <= m boundary / 4 (M^-1)_ii, from which `error_bound`
    follows. m and M^-1 are bounded over the joints' ranges with proof (`rne.Robot.bounds`) where that succeeds within
    10 % and 3 units of work; otherwise the bounds are assumed to be 10 % above the values found by a search. It is also
    assumed that only these parameters are unknown, that the drives are not saturated and that the law is not sampled.

    Examples
    --------
    >>> import rne
    >>> arm, path = rne.load("irb140"), rne.trajectories.quintic([0] * 6, [1] * 6, 1.0)
    >>> law = rne.control.robust_passive([arm, arm.with_payload(3.0)], 20, 10, path, boundary=0.1)
    >>> law.rms_bound.round(4).tolist()  # of each joint's error [rad]
    [0.0035, 0.0035, 0.0035, 0.0035, 0.0035, 0.0035]
    """
    hull = checked_cases(cases)
    d, decay = checked_vectors(hull.centre, sign="positive", kd=kd, bandwidth=bandwidth)
    check_reference(hull.centre, reference)
    return RobustPassive(hull.centre, decay, reference, d, positive_number("boundary", boundary), hull)


@dataclass(frozen=True, eq=False, repr=False)
class SlidingMode(RobustLaw):
    """Sliding-mode tracking with a boundary layer, made by `sliding_mode`.

    Its attributes are the arguments, and `robot`: the controller's model, in the middle of the cases.
    """

    boundary: Array
    reaching: float
    cases: Cases

    def _torques(self, q: Array, qd: Array, s: Array, qdr: Array, qddr: Array) -> Array:
        Y = self.robot.control_regressor(q, qd, qdr, qddr)
        missing = self.boundary[:, None] * (Y @ self.cases.deviations)  # D Y (pi_k - pi_0) of each case
        squares = (missing * missing).sum(-2)
        # k >= |D Y (pi - pi_0)| of every mixture, for norms are convex; Slotine and Li 1991, section 9.1
        k = np.sqrt(maximum(largest(squares, -1), SMALLEST)) + self.reaching
        u = model_torques(self.robot, Y, self.robot.parameters, qddr)
        return np.asarray(u - k * saturated_direction(s / self.boundary, 1.0) / self.boundary)

    def _bound_of_s(self) -> Array:
        largest, inverse = self.cases.inertia_bounds(self.boundary)
        return np.asarray(np.sqrt(largest * inverse))


def sliding_mode(
    cases: Sequence[Robot], bandwidth: ArrayLike, boundary: ArrayLike, reference: Reference, *, reaching: float = 1.0
) -> SlidingMode:
    """Sliding-mode tracking: u = Y pi_0 - k D^-1 z / max(|z|, 1), with z = D^-1 s and k from the cases in every state.

    Parameters
    ----------
    cases : sequence of Robot
        The robot that moves has a mixture of their parameters, such as of the arm without and with its largest payload.
        The controller's model is their mean.
    bandwidth : float or array_like, shape (n,)
        Decay of the tracking error on the surface s = e' + bandwidth e = 0 [1/s].
    boundary : float or array_like, shape (n,)
        D: half-axes of the boundary layer |z| <= 1 in s; small ones make the loop stiff [rad/s or m/s].
    reference : callable
        A function f(t) -> (q, qd, qdd).
    reaching : float
        Power beyond what the uncertainty needs: outside the layer V = s^T M s / 2 falls at |z| times this [W].

    Returns
    -------
    SlidingMode
        The law f(t, q, qd) -> torques, with its `error_bound`.

    Raises
    ------
    ValueError
        If an array has the wrong shape or sign or is not finite, or the cases differ in more than masses.

    Notes
    -----
    Slotine and Li 1991, section 9.1, with one layer for all joints. k = max |D Y (pi_k - pi_0)| + reaching over the
    cases k bounds every mixture of them exactly. s^T M s falls outside the layer, hence in the end s^T M s <= m, the
    largest eigenvalue of D M D, and s_i^2 <= m (M^-1)_ii, from which `error_bound` follows; bounds of m and M^-1, and
    what is assumed, as for `robust_passive`.

    Examples
    --------
    >>> import rne
    >>> arm, path = rne.load("irb140"), rne.trajectories.quintic([0] * 6, [1] * 6, 1.0)
    >>> law = rne.control.sliding_mode([arm, arm.with_payload(3.0)], 10, 0.1, path)
    >>> rne.Scene(arm, controller=law).cost()["law"]
    'traced'
    """
    hull = checked_cases(cases)
    decay, D = checked_vectors(hull.centre, sign="positive", bandwidth=bandwidth, boundary=boundary)
    check_reference(hull.centre, reference)
    return SlidingMode(hull.centre, decay, reference, D, positive_number("reaching", reaching), hull)
