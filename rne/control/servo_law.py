"""Hobby servos: a position loop that sets the voltage of a geared DC motor, with its limits."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..basics.arrays import UNBOUNDED, convert_numbers
from ..basics.spatial import Array
from ..basics.text import summary
from ..elementwise import clip, less, where
from ..graph.scalar import is_present
from ..robot import Robot
from .laws import Reference, checked_vectors, held_or_moving, of_robot, reference_values


@dataclass(frozen=True, eq=False)
class Servo:
    """A position loop around a DC motor, made by `servo`; attributes are its arguments, numbers of shape (n,)."""

    robot: Robot
    kp: Array
    kd: Array
    reference: Array | Reference
    dead_band: Array
    stall_torque: Array
    no_load_speed: Array
    traceable = True

    def __post_init__(self) -> None:
        torque, speed = np.asarray(self.stall_torque), np.asarray(self.no_load_speed)
        if torque.dtype != np.float64 or speed.dtype != np.float64:  # traced, or a complex step
            return
        if not (speed > 0).all():
            raise ValueError(f"`no_load_speed` must be positive, got {speed.min()}")
        if ((speed < UNBOUNDED) & (torque >= UNBOUNDED)).any():
            raise ValueError("`no_load_speed` needs a finite `stall_torque`, the torque that has fallen to 0 there")

    def __repr__(self) -> str:
        limits = {name: getattr(self, name) for name in ("stall_torque", "no_load_speed")}
        hidden: dict[str, Any] = {k: x if (x < UNBOUNDED).any() else None for k, x in limits.items()}
        return summary(self, **hidden, dead_band=self.dead_band if self.dead_band.any() else None)

    def __call__(self, t: float, q: Array, qd: Array) -> Array:
        """Torques [N m or N] at time t [s] for positions and velocities q, qd, shape (..., n)."""
        q_ref = self.reference
        if callable(q_ref):
            q_ref, _, _ = reference_values(self.robot, q_ref(t))
        error = q_ref - q
        if is_present(self.dead_band):
            error = error - clip(error, -self.dead_band, self.dead_band)
        torques: Array = self.kp * error - self.kd * qd
        if is_present(less(self.stall_torque, UNBOUNDED)):
            torques = clip(torques, -self.stall_torque, self.stall_torque)
        rotates = less(self.no_load_speed, UNBOUNDED)
        if is_present(rotates):
            back_emf = where(rotates, self.stall_torque, 0.0) / where(rotates, self.no_load_speed, 1.0)
            torques = torques - back_emf * qd
        return torques


@of_robot
def servo(
    robot: Robot,
    kp: ArrayLike,
    kd: ArrayLike = 0.0,
    reference: ArrayLike | Reference = 0.0,
    *,
    dead_band: ArrayLike = 0.0,
    stall_torque: ArrayLike = np.inf,
    no_load_speed: ArrayLike = np.inf,
) -> Servo:
    """Position control by hobby servos: u = clip(Kp e - Kd qd, -stall, stall) - (stall / no-load speed) qd.

    Parameters
    ----------
    robot : Robot
        The robot, for the number of its joints.
    kp, kd : float or array_like, shape (n,)
        Gains of each joint at its output, not negative [N m/rad, N m s/rad].
    reference : float or array_like, shape (n,), or callable
        Positions to hold [rad or m], or a function f(t) -> (q, qd, qdd), of which the positions are taken.
    dead_band : float or array_like, shape (n,)
        Error of the position below which the loop gives no torque [rad or m].
    stall_torque : float or array_like, shape (n,)
        Largest torque, at rest under full voltage; inf for none [N m or N].
    no_load_speed : float or array_like, shape (n,)
        Speed under full voltage at which the torque is 0; inf for a torque that does not depend on speed [rad/s or
        m/s].

    Returns
    -------
    Servo
        The law f(t, q, qd) -> torques, shape (..., n).

    Raises
    ------
    ValueError
        If an array has the wrong shape, a gain or the dead band is negative or not finite, a limit is not positive, or
        a joint has a no-load speed without a stall torque.

    Notes
    -----
    The loop sets the voltage of a DC motor whose inductance is neglected. The voltage gives the torque Kp e - Kd qd
    within the stall torque, which the back EMF reduces in proportion to speed. Under full voltage the torque falls
    linearly to 0 at the no-load speed. A motor that brakes is driven against its voltage: its back EMF adds to the
    voltage, so that the torque is at least that at rest and at most twice that. A limit of the current is the
    `effort_limit` of the scene. A servo whose voltage is limited to a share of the supply has that share of both the
    stall torque and the no-load speed.

    e is the error, from which the dead band is subtracted: no torque within it, kp (|q_ref - q| - dead_band) beyond.
    The velocity of a reference is not used, as a servo is commanded positions; it has no integral, which these servos
    do not use by default.

    In motions the back EMF acts as viscous friction of stall_torque / no_load_speed does. With the `sample_time` of a
    scene the whole torque is held for a period, the back EMF too. The loop inside of a servo is fast: to hold only the
    commands, leave `sample_time` out and give a reference of `rne.trajectories.sampled` of kind "hold". Friction of
    gears, which grows with load, belongs to the scene: `rne.Friction` with `load`.

    Examples
    --------
    >>> import rne
    >>> law = rne.control.servo(rne.load("irb140"), 20, 0, 1, stall_torque=2, no_load_speed=5)
    >>> [law(0.0, [0] * 6, [speed] * 6)[0].item() for speed in (0.0, 5.0, -5.0)]
    [2.0, 0.0, 4.0]
    """
    p, d, band = checked_vectors(robot, sign="not negative", kp=kp, kd=kd, dead_band=dead_band)
    limits = {"stall_torque": stall_torque, "no_load_speed": no_load_speed}
    known = {k: np.minimum(convert_numbers(k, x, f"({robot.n},)"), UNBOUNDED) for k, x in limits.items()}
    torque, speed = checked_vectors(robot, sign="positive", **known)
    return Servo(robot, p, d, held_or_moving(robot, reference), band, torque, speed)
