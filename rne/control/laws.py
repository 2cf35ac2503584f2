"""Control laws: functions of (t, q, qd) that give joint torques, plain or traced."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, TypeVar

import numpy as np
from numpy.typing import ArrayLike

from ..basics.arrays import UNBOUNDED, convert_numbers, vector
from ..basics.spatial import Array
from ..basics.text import summary
from ..elementwise import clip
from ..robot import Robot
from .reference import Reference, check_reference, reference_values

F = TypeVar("F", bound=Callable[..., Any])


def traceable(law: F) -> F:
    """Mark a control law as a plain formula of (t, q, qd), to be traced into the kernel of its scene.

    Parameters
    ----------
    law : callable
        A function f(t, q, qd) -> torques, for one state: t a number, arrays of shape (n,). It may call methods of a
        Robot. What has memory, noise, tables or branches on values (use `rne.elementwise.where`) cannot be traced: it
        is called all the same, and a line on the logger "rne" says why. A law that is not marked is called.

    Returns
    -------
    callable
        The same law.

    Examples
    --------
    >>> import rne
    >>> damper = rne.traceable(lambda t, q, qd: -5.0 * qd)
    >>> rne.Scene(rne.load("irb140"), controller=damper).cost()["law"]
    'traced'
    """
    law.traceable = True  # type: ignore[attr-defined]
    return law


@dataclass(frozen=True, eq=False)
class PD:
    """Proportional and derivative feedback, with or without gravity compensation, made by `pd` and `pd_gravity`.

    Attributes
    ----------
    robot : Robot
        The controller's model.
    kp, kd : ndarray, shape (n,)
        Gains of each joint [N m/rad, N m s/rad].
    reference : ndarray, shape (n,), or callable
        Positions to hold [rad or m], or a motion to follow, f(t) -> (q, qd, qdd).
    gravity : bool
        True if gravity is compensated by the model.

    Examples
    --------
    >>> import rne
    >>> law = rne.control.pd(rne.load("irb140"), [50] * 6, [20] * 6, [1] * 6)
    >>> law(0.0, [0] * 6, [0] * 6).tolist()
    [50.0, 50.0, 50.0, 50.0, 50.0, 50.0]
    """

    robot: Robot
    kp: Array
    kd: Array
    reference: Array | Reference
    gravity: bool
    traceable = True

    __repr__ = summary

    def __call__(self, t: float, q: Array, qd: Array) -> Array:
        """Torques in one state, or in many.

        Parameters
        ----------
        t : float
            Time, which only a moving reference uses [s].
        q, qd : array_like, shape (..., n)
            Joint positions and rates [rad or m; rad/s or m/s].

        Returns
        -------
        ndarray, shape (..., n)
            Torques of the drives [N m or N].
        """
        q_ref, qd_ref = self.reference, np.zeros(self.robot.n)
        if callable(self.reference):
            q_ref, qd_ref, _ = reference_values(self.robot, self.reference(t))
        feedback = -self.kp * (q - q_ref) - self.kd * (qd - qd_ref)
        torques: Array = self.robot.gravity_torque(q) + feedback if self.gravity else feedback
        return torques


def pd(robot: Robot, kp: ArrayLike, kd: ArrayLike, reference: ArrayLike | Reference) -> PD:
    """PD control without a model: u = -Kp (q - q_ref) - Kd (qd - qd_ref).

    Parameters
    ----------
    robot : Robot
        The robot, for the number of its joints.
    kp, kd : array_like, shape (n,)
        Gains of each joint [N m/rad, N m s/rad].
    reference : array_like, shape (n,), or callable
        Positions to hold [rad or m], or a function f(t) -> (q, qd, qdd).

    Returns
    -------
    PD
        The law f(t, q, qd) -> torques, shape (..., n). Gravity causes a steady-state error; see `rne.check_gains`.

    Raises
    ------
    ValueError
        If an array has the wrong shape or is not finite.

    Examples
    --------
    >>> import rne
    >>> rne.control.pd(rne.load("irb140"), [50] * 6, [20] * 6, [1] * 6)(0.0, [0] * 6, [0] * 6)[0].item()
    50.0
    """
    return _pd(robot, kp, kd, reference, gravity=False)


def pd_gravity(robot: Robot, kp: ArrayLike, kd: ArrayLike, reference: ArrayLike | Reference) -> PD:
    """PD control with gravity compensation: u = g(q) - Kp (q - q_ref) - Kd (qd - qd_ref).

    Parameters
    ----------
    robot : Robot
        The controller's model, whose gravity torque is compensated; it need not be the robot that is simulated.
    kp, kd : array_like, shape (n,)
        Gains of each joint [N m/rad, N m s/rad].
    reference : array_like, shape (n,), or callable
        Positions to hold [rad or m], or a function f(t) -> (q, qd, qdd).

    Returns
    -------
    PD
        The law f(t, q, qd) -> torques, shape (..., n).

    Raises
    ------
    ValueError
        If an array has the wrong shape or is not finite.

    Notes
    -----
    Høifødt 2011, (6.46) with the sign that (6.50)-(6.56) need: the error is q - reference.

    Examples
    --------
    >>> import numpy as np, rne
    >>> robot = rne.load("irb140")
    >>> law = rne.control.pd_gravity(robot, [50] * 6, [20] * 6, [0] * 6)
    >>> np.allclose(law(0.0, [0] * 6, [0] * 6), robot.gravity_torque([0] * 6))
    True
    """
    return _pd(robot, kp, kd, reference, gravity=True)


def _pd(robot: Robot, kp: ArrayLike, kd: ArrayLike, reference: Any, *, gravity: bool) -> PD:
    p, d = checked_vectors(robot, kp=kp, kd=kd)
    if callable(reference):
        check_reference(robot, reference)
        return PD(robot, p, d, reference, gravity)
    return PD(robot, p, d, vector("reference", reference, robot.n), gravity)


@dataclass(frozen=True, eq=False)
class PID:
    """PD with the integral of the error as a state of the controller, made by `pid`.

    Attributes
    ----------
    robot : Robot
        The controller's model.
    kp, ki, kd : ndarray, shape (n,)
        Gains of each joint [N m/rad, N m/(rad s), N m s/rad].
    reference : ndarray, shape (n,)
        Positions to hold [rad or m].
    gravity : bool
        True if gravity is compensated by the model.
    windup : ndarray, shape (n,)
        Largest torque of the integral part [N m or N].

    Examples
    --------
    >>> import numpy as np, rne
    >>> law = rne.control.pid(rne.load("irb140"), [50] * 6, [10] * 6, [20] * 6, [0] * 6)
    >>> torques, rates = law(0.0, np.full(6, 0.1), np.zeros(6), np.zeros(6))
    >>> torques[0].item(), rates[0].item()
    (-5.0, 0.1)
    """

    robot: Robot
    kp: Array
    ki: Array
    kd: Array
    reference: Array
    gravity: bool
    windup: Array
    traceable = True

    def __repr__(self) -> str:
        return summary(self, windup=self.windup if (self.windup < UNBOUNDED).any() else None)

    @property
    def states(self) -> int:
        """Number of states of the controller: the integral of each joint's error."""
        return self.robot.n

    def __call__(self, t: float, q: Array, qd: Array, z: Array) -> tuple[Array, Array]:
        """Torques in one state, and the rates of the integrals.

        Parameters
        ----------
        t : float
            Time, which this law does not use [s].
        q, qd, z : array_like, shape (n,)
            Joint positions and rates, and the integrals of the errors [rad or m; rad/s or m/s; rad s or m s].

        Returns
        -------
        torques : ndarray, shape (n,)
            Of the drives [N m or N].
        rates : ndarray, shape (n,)
            The errors, dz/dt [rad or m].
        """
        error = q - self.reference
        held = self.ki * z if (self.windup == UNBOUNDED).all() else clip(self.ki * z, -self.windup, self.windup)
        feedback = -self.kp * error - held - self.kd * qd
        return self.robot.gravity_torque(q) + feedback if self.gravity else feedback, error


def pid(
    robot: Robot,
    kp: ArrayLike,
    ki: ArrayLike,
    kd: ArrayLike,
    reference: ArrayLike,
    *,
    gravity: bool = False,
    windup: ArrayLike = np.inf,
) -> PID:
    """PID control: u = -Kp e - Ki z - Kd qd with e = q - q_ref and dz/dt = e.

    Parameters
    ----------
    robot : Robot
        The controller's model.
    kp, ki, kd : array_like, shape (n,)
        Gains of each joint [N m/rad, N m/(rad s), N m s/rad].
    reference : array_like, shape (n,)
        Positions to hold [rad or m].
    gravity : bool
        True to compensate gravity by the model as well.
    windup : array_like, shape (n,) or a number
        Largest torque of the integral part [N m or N].

    Returns
    -------
    PID
        For a Scene: f(t, q, qd, z) -> (torques, dz/dt).

    Raises
    ------
    ValueError
        If an array has the wrong shape or is not finite, or `windup` is not positive.

    Examples
    --------
    >>> import rne
    >>> rne.control.pid(rne.load("irb140"), [50] * 6, [10] * 6, [20] * 6, [0] * 6).states
    6
    """
    p, i, d, q_ref = checked_vectors(robot, kp=kp, ki=ki, kd=kd, reference=reference)
    bound = convert_numbers("windup", windup, f"({robot.n},)")
    bounded = np.minimum(bound if bound.ndim else np.full(robot.n, bound), UNBOUNDED)
    return PID(robot, p, i, d, q_ref, gravity, vector("windup", bounded, robot.n, sign="positive"))


def checked_vectors(robot: Robot, **values: ArrayLike) -> list[Array]:
    """Arrays with one number per joint, or an error that names the argument."""
    if not isinstance(robot, Robot):
        raise TypeError(f"`robot` must be an rne.Robot, got {type(robot).__name__}")
    return [vector(name, value, robot.n) for name, value in values.items()]
