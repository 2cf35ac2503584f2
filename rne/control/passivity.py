"""Robust laws on the parameters: the uncertainty is a set of robots, and no bound on accelerations is needed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from ..basics.arrays import positive_number, vector
from ..basics.spatial import Array
from ..basics.text import summary
from ..elementwise import maximum
from ..robot import Robot
from .reference import Reference, check_reference, composite, model_torques
from .robust import saturated_direction
from .uncertainty import Cases, checked_cases

SMALLEST = 1e-20  # [W^2]: a root has no derivative at zero


@dataclass(frozen=True, eq=False)
class RobustPassive:
    """Robust tracking after Spong, made by `robust_passive`.

    Attributes
    ----------
    robot : Robot
        The controller's model: the middle of the cases.
    kd : ndarray, shape (n,)
        Gains of s = e' + bandwidth e [N m s/rad or N s/m].
    bandwidth : ndarray, shape (n,)
        Decay of the tracking error once s is zero [1/s].
    reference : callable
        f(t) -> (q, qd, qdd) [rad or m; rad/s or m/s; rad/s^2 or m/s^2].
    boundary : float
        Width of the boundary layer [W].
    cases : Cases
        The robots between which the one that moves lies.

    Examples
    --------
    >>> import rne
    >>> arm, path = rne.load("irb140"), rne.trajectories.quintic([0] * 6, [1] * 6, 2.0)
    >>> law = rne.control.robust_passive([arm, arm.with_payload(3.0)], [20] * 6, [10] * 6, path, boundary=0.1)
    >>> law.rms_bound.round(4)[0].item()
    0.0035
    """

    robot: Robot
    kd: Array
    bandwidth: Array
    reference: Reference
    boundary: float
    cases: Cases
    traceable = True

    def __repr__(self) -> str:
        return summary(self, cases=None)

    @property
    def rms_bound(self) -> Array:
        """Bound on the root mean square of each joint's tracking error over a long time, shape (n,) [rad or m].

        sqrt(boundary / (4 kd)) / bandwidth: exact, without samples. Over a time T from a start on the reference with
        s = 0 it holds from the beginning.
        """
        return np.asarray(np.sqrt(self.boundary / (4 * self.kd)) / self.bandwidth)

    @cached_property
    def error_bound(self) -> Array:
        """Ultimate bound on each joint's tracking error, shape (n,) [rad or m].

        With V = s^T M s / 2 and m the largest eigenvalue of Kd^-1/2 M Kd^-1/2, V' <= -2 V / m + boundary / 4; hence
        s_i^2 <= m boundary / 4 (M^-1)_ii. m and M^-1 are sampled over the joints' ranges, with a margin of 10 % each.
        """
        largest, inverse = self.cases.inertia_bounds(1 / np.sqrt(self.kd))
        return np.asarray(np.sqrt(largest * self.boundary / 4 * inverse) / self.bandwidth)

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
        s, qdr, qddr, _ = composite(self.robot, self.reference, self.bandwidth, t, q, qd)
        Y = self.robot.control_regressor(q, qd, qdr, qddr)
        torques: Array = model_torques(self.robot, Y, self.robot.parameters, qddr) - self.kd * s
        if not self.cases.ball.size:  # equal cases
            return torques
        YW = Y @ self.cases.ball
        power = (s[..., None, :] @ YW)[..., 0, :]
        shift = -saturated_direction(power, self.boundary)  # u_p = W shift: Spong 1992, (16)
        return np.asarray(torques + (YW @ shift[..., None])[..., 0])


@dataclass(frozen=True, eq=False)
class SlidingMode:
    """Sliding-mode tracking with a boundary layer, made by `sliding_mode`.

    Attributes
    ----------
    robot : Robot
        The controller's model: the middle of the cases.
    bandwidth : ndarray, shape (n,)
        Decay of the tracking error on the sliding surface [1/s].
    boundary : ndarray, shape (n,)
        Half-axes of the boundary layer of s = e' + bandwidth e [rad/s or m/s].
    reference : callable
        f(t) -> (q, qd, qdd) [rad or m; rad/s or m/s; rad/s^2 or m/s^2].
    reaching : float
        Power by which s is driven beyond what the uncertainty needs [W].
    cases : Cases
        The robots between which the one that moves lies.

    Examples
    --------
    >>> import rne
    >>> arm, path = rne.load("irb140"), rne.trajectories.quintic([0] * 6, [1] * 6, 2.0)
    >>> law = rne.control.sliding_mode([arm, arm.with_payload(3.0)], [10] * 6, [0.1] * 6, path)
    >>> law.robot.model.mass[-1].item()  # 1 kg of the link, and half of the payload
    2.5
    """

    robot: Robot
    bandwidth: Array
    boundary: Array
    reference: Reference
    reaching: float
    cases: Cases
    traceable = True

    def __repr__(self) -> str:
        return summary(self, cases=None)

    @cached_property
    def error_bound(self) -> Array:
        """Ultimate bound on each joint's tracking error, shape (n,) [rad or m].

        s^T M s falls outside the layer |z| <= 1, z = D^-1 s, hence s^T M s <= m, the largest eigenvalue of D M D, and
        s_i^2 <= m (M^-1)_ii. m and M^-1 are sampled over the joints' ranges, with a margin of 10 % each.
        """
        largest, inverse = self.cases.inertia_bounds(self.boundary)
        return np.asarray(np.sqrt(largest * inverse) / self.bandwidth)

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
        s, qdr, qddr, _ = composite(self.robot, self.reference, self.bandwidth, t, q, qd)
        Y = self.robot.control_regressor(q, qd, qdr, qddr)
        missing = self.boundary[:, None] * (Y @ self.cases.deviations)  # D Y (pi_k - pi_0) of each case
        squares = (missing * missing).sum(-2)
        largest: Array = np.asarray(SMALLEST)
        for case in range(squares.shape[-1]):
            largest = maximum(largest, squares[..., case : case + 1])
        # k >= |D Y (pi - pi_0)| of every mixture, for norms are convex; Slotine and Li 1991, section 9.1
        k = np.sqrt(largest) + self.reaching
        u = model_torques(self.robot, Y, self.robot.parameters, qddr)
        return np.asarray(u - k * saturated_direction(s / self.boundary, 1.0) / self.boundary)


def robust_passive(
    cases: Sequence[Robot], kd: ArrayLike, bandwidth: ArrayLike, reference: Reference, *, boundary: float
) -> RobustPassive:
    """Robust tracking on the parameters: u = Y (pi_0 + u_p) - Kd s, with u_p against Y^T s on the parameters' ball.

    Parameters
    ----------
    cases : sequence of Robot
        The robot that moves has a mixture of their parameters, such as of the arm without and with its largest payload.
        The controller's model is their mean.
    kd : array_like, shape (n,)
        Gains of s = e' + bandwidth e [N m s/rad or N s/m].
    bandwidth : array_like, shape (n,)
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
    bound tight. V = s^T M s / 2 obeys V' <= -s^T Kd s + boundary / 4. This assumes that nothing but these parameters is
    unknown, that the drives are not saturated and that the law is not sampled.

    Examples
    --------
    >>> import rne
    >>> arm, path = rne.load("irb140"), rne.trajectories.quintic([0] * 6, [1] * 6, 1.0)
    >>> law = rne.control.robust_passive([arm, arm.with_payload(3.0)], [20] * 6, [10] * 6, path, boundary=0.1)
    >>> bool((law.rms_bound < law.error_bound).all())
    True
    """
    hull = checked_cases(cases)
    n = hull.centre.n
    gains, rate = (vector(k, x, n, sign="positive") for k, x in (("kd", kd), ("bandwidth", bandwidth)))
    check_reference(hull.centre, reference)
    return RobustPassive(hull.centre, gains, rate, reference, positive_number("boundary", boundary), hull)


def sliding_mode(
    cases: Sequence[Robot],
    bandwidth: ArrayLike,
    boundary: ArrayLike,
    reference: Reference,
    *,
    reaching: float = 1.0,
) -> SlidingMode:
    """Sliding-mode tracking: u = Y pi_0 - k D^-1 z / max(|z|, 1), with z = D^-1 s and k from the cases in every state.

    Parameters
    ----------
    cases : sequence of Robot
        The robot that moves has a mixture of their parameters, such as of the arm without and with its largest payload.
        The controller's model is their mean.
    bandwidth : array_like, shape (n,)
        Decay of the tracking error on the surface s = e' + bandwidth e = 0 [1/s].
    boundary : array_like, shape (n,)
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
    cases k bounds every mixture of them exactly. This assumes that nothing but these parameters is unknown, that the
    drives are not saturated and that the law is not sampled.

    Examples
    --------
    >>> import rne
    >>> arm, path = rne.load("irb140"), rne.trajectories.quintic([0] * 6, [1] * 6, 1.0)
    >>> law = rne.control.sliding_mode([arm, arm.with_payload(3.0)], [10] * 6, [0.1] * 6, path)
    >>> bool((law.error_bound > law.boundary / law.bandwidth).all())
    True
    """
    hull = checked_cases(cases)
    n = hull.centre.n
    rate, D = (vector(k, x, n, sign="positive") for k, x in (("bandwidth", bandwidth), ("boundary", boundary)))
    check_reference(hull.centre, reference)
    return SlidingMode(hull.centre, rate, D, reference, positive_number("reaching", reaching), hull)
