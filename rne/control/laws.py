"""Control laws: functions of (t, q, qd) that give joint torques. Reference motions; PD, PID and computed torque."""

from __future__ import annotations

import functools
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Literal, Protocol, TypeVar, cast

import numpy as np
from numpy.typing import ArrayLike

from ..basics.arrays import UNBOUNDED, check_function, convert_numbers, per_joint_array, positive_number
from ..basics.spatial import Array
from ..basics.text import summary
from ..elementwise import clip, less
from ..graph.scalar import is_present
from ..model.model import Model
from ..model.topology import refuse_couplings
from ..robot import Robot, robot_argument

F = TypeVar("F", bound=Callable[..., Any])
# Argument of methods that read the states of a law, for their docstrings.
STATES = """
z : array_like, shape (..., states)
    States of the law, such as `Trajectory.controller_state`.
"""


def traceable(law: F) -> F:
    """Mark a function as a plain formula, to be traced: a control law of a scene, or a function of joint arrays.

    Parameters
    ----------
    law : callable
        A function f(t, q, qd) -> torques, for one state: t a number, arrays of shape (n,). With an attribute `states`,
        f(t, q, qd, z) -> (torques, dz/dt), or, where `discrete` is True too, (torques, z at the next sample). It
        may call methods of a Robot. A law with memory, noise, tables or branches on values (use
        `rne.elementwise.where`) cannot be traced: it is called all the same, and a line on the logger "rne" says why.
        A law that is not marked is called. Or a function of some of q, qd, qdd, qdr, qddr and tau, for
        `rne.Robot.kernel`, `rne.kernels.gradient` and others: a cost, or the torques of a scene.

    Returns
    -------
    callable
        The function itself.

    Examples
    --------
    >>> import numpy as np
    >>> import rne
    >>> damper = rne.traceable(lambda t, q, qd: -5.0 * qd)
    >>> rne.Scene(rne.load("irb140"), controller=damper).cost()["law"]
    'traced'
    >>> robot = rne.load("irb140")
    >>> scene = rne.Scene(robot, friction=rne.Friction(viscous=2.0))
    >>> torques = rne.traceable(lambda q, qd, qdd: scene.inverse_dynamics(q, qd, qdd))
    >>> robot.kernel(torques)(np.zeros(6), np.ones(6), np.zeros(6)).shape
    (6,)
    """
    if not callable(law):
        raise TypeError(f"`law` must be a function, got {type(law).__name__}")
    marked: Any = getattr(law, "__func__", law)  # a method has it by its function
    try:
        marked.traceable = True
    except AttributeError:
        raise TypeError(f"`law` cannot be marked: set `traceable = True` in the class {type(law).__name__}") from None
    return law


def of_robot(make: F) -> F:
    """Decorator that checks that the first argument is a Robot, for a clear error where a call omits it."""

    @functools.wraps(make)
    def checked(*arguments: Any, **options: Any) -> Any:
        if arguments or "robot" in options:
            robot_argument(arguments[0] if arguments else options["robot"])
        return make(*arguments, **options)

    return cast(F, checked)


def checked_vectors(
    robot: Robot, *, sign: Literal["any", "not negative", "positive"] = "any", **values: ArrayLike
) -> list[Array]:
    """Read-only arrays with one number per joint, or an error that names the argument."""
    return [per_joint_array(name, value, robot.n, sign=sign) for name, value in values.items()]


class HasTorque(Protocol):
    """Object with torques as a function of joint velocities, such as an rne.Friction."""

    def torque(self, model: Model, qd: ArrayLike, /) -> Array:
        """Torques, shape (..., n)."""


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


def held_or_moving(robot: Robot, reference: Any) -> Array | Reference:
    """Positions to hold as an array, or a reference motion."""
    if not callable(reference):
        return per_joint_array("reference", reference, robot.n)
    check_reference(robot, reference)
    return cast(Reference, reference)


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
    """M qddr + C qdr + g: Y pi of the parameters, and the torque of the rotors, which are not estimated."""
    model = robot.model
    if model.couplings and model.armature.any():
        refuse_couplings(model, "adaptive and robust laws of robots with armature take")
    rotors = model.mimic_map.T @ (model.armature[:, None] * model.mimic_map)
    torques: Array = (Y @ parameters[..., None])[..., 0] + qddr @ rotors
    return torques


@dataclass(frozen=True, eq=False)
class PD:
    """Proportional and derivative feedback, made by `pd` and `pd_gravity`.

    Its attributes are their arguments, gains as arrays of shape (n,), and `gravity`: the share of the gravity torques
    that is compensated, 0 or False for none.
    """

    robot: Robot
    kp: Array
    kd: Array
    reference: Array | Reference
    gravity: float
    feedforward: HasTorque | None = None
    traceable = True

    __repr__ = summary

    def __call__(self, t: float, q: Array, qd: Array) -> Array:
        """Torques [N m or N] at time t [s] for positions and velocities q, qd, shape (..., n)."""
        q_ref, qd_ref = self.reference, np.zeros(self.robot.n)
        if callable(self.reference):
            q_ref, qd_ref, _ = reference_values(self.robot, self.reference(t))
        torques: Array = -self.kp * (q - q_ref) - self.kd * (qd - qd_ref)
        if is_present(self.gravity):
            torques = self.gravity * self.robot.gravity_torque(q) + torques
        return torques if self.feedforward is None else torques + supplied(self, qd_ref + 0 * qd, torques)


@of_robot
def pd(robot: Robot, kp: ArrayLike, kd: ArrayLike, reference: ArrayLike | Reference) -> PD:
    """PD control without a model: u = -Kp (q - q_ref) - Kd (qd - qd_ref).

    Parameters
    ----------
    robot : Robot
        The robot, for the number of its joints.
    kp, kd : float or array_like, shape (n,)
        Gains of each joint, not negative [N m/rad, N m s/rad].
    reference : float or array_like, shape (n,), or callable
        Positions to hold [rad or m], or a function f(t) -> (q, qd, qdd).

    Returns
    -------
    PD
        The law f(t, q, qd) -> torques, shape (..., n). Gravity causes a steady-state error; see `rne.check_gains`.

    Raises
    ------
    ValueError
        If an array has the wrong shape or is not finite, or a gain is negative.

    Examples
    --------
    >>> import rne
    >>> rne.control.pd(rne.load("irb140"), 50, 20, [1] * 6)(0.0, [0] * 6, [0] * 6)[0].item()
    50.0
    """
    return pd_gravity(robot, kp, kd, reference, scale=0.0)


@of_robot
def pd_gravity(
    robot: Robot,
    kp: ArrayLike,
    kd: ArrayLike,
    reference: ArrayLike | Reference,
    *,
    scale: float = 1.0,
    feedforward: HasTorque | None = None,
) -> PD:
    """PD control with gravity compensation: u = g(q) - Kp (q - q_ref) - Kd (qd - qd_ref).

    With kp = 0 it only compensates gravity: the arm can be led by hand.

    Parameters
    ----------
    robot : Robot
        The controller's model, whose gravity torque is compensated; it need not be the robot that is simulated.
    kp, kd : float or array_like, shape (n,)
        Gains of each joint, not negative [N m/rad, N m s/rad].
    reference : float or array_like, shape (n,), or callable
        Positions to hold [rad or m], or a function f(t) -> (q, qd, qdd).
    scale : float
        Share of the gravity torques that is supplied; on a real arm begin below 1.
    feedforward : Friction, optional
        Friction whose torques at the reference's velocities are added, such as `Identification.friction`.

    Returns
    -------
    PD
        The law f(t, q, qd) -> torques, shape (..., n).

    Raises
    ------
    ValueError
        If an array has the wrong shape or is not finite, or a gain or the scale is negative.

    Notes
    -----
    Høifødt 2011, (6.48), with the sign that (6.50)-(6.56) need: the error is q - reference. (6.46) is without g(q).

    Examples
    --------
    >>> import numpy as np, rne
    >>> robot = rne.load("irb140")
    >>> law = rne.control.pd_gravity(robot, [50] * 5 + [60], 20, 0)
    >>> np.allclose(law(0.0, [0] * 6, [0] * 6), robot.gravity_torque([0] * 6))
    True
    """
    share = positive_number("scale", scale, zero_allowed=True)
    check_feedforward(robot, feedforward)
    p, d = checked_vectors(robot, sign="not negative", kp=kp, kd=kd)
    return PD(robot, p, d, held_or_moving(robot, reference), share, feedforward)


def check_feedforward(robot: Robot, feedforward: Any) -> None:
    """Raise an error if a feed-forward cannot give torques of this robot's joints."""
    if feedforward is None:
        return
    if not callable(getattr(feedforward, "torque", None)):
        raise TypeError(f"`feedforward` must be an rne.Friction, got {type(feedforward).__name__}")
    feedforward.torque(robot.model, *np.zeros((2 if under_load(feedforward) else 1, robot.n)))


def under_load(feedforward: Any) -> bool:
    """True for friction that depends on the load."""
    return "load" in getattr(feedforward, "losses", ())


def supplied(law: Any, qd: Array, load: Array) -> Array:
    """Feed-forward torques of a law; load-dependent friction uses its other torques as the load."""
    loads = (load,) if under_load(law.feedforward) else ()
    torques: Array = law.feedforward.torque(law.robot.model, qd, *loads)
    return torques


@dataclass(frozen=True, eq=False)
class PID:
    """PD with the integral of the error as a state of the controller, made by `pid`; attributes are its arguments."""

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
        """Torques [N m or N] and dz/dt, the errors [rad or m], for integrals z of the errors, shape (..., n) each."""
        error = q - self.reference
        is_bounded = is_present(less(self.windup, UNBOUNDED))
        held = clip(self.ki * z, -self.windup, self.windup) if is_bounded else self.ki * z
        feedback = -self.kp * error - held - self.kd * qd
        return self.robot.gravity_torque(q) + feedback if self.gravity else feedback, error


@of_robot
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
    kp, ki, kd : float or array_like, shape (n,)
        Gains of each joint, not negative [N m/rad, N m/(rad s), N m s/rad].
    reference : float or array_like, shape (n,)
        Positions to hold [rad or m].
    gravity : bool
        True to compensate gravity by the model as well.
    windup : float or array_like, shape (n,)
        Largest torque of the integral part [N m or N].

    Returns
    -------
    PID
        For a Scene: f(t, q, qd, z) -> (torques, dz/dt).

    Raises
    ------
    ValueError
        If an array has the wrong shape or is not finite, a gain is negative, or `windup` is not positive.

    Examples
    --------
    >>> import rne
    >>> rne.control.pid(rne.load("irb140"), 50, 10, 20, [0] * 6).states
    6
    """
    p, i, d = checked_vectors(robot, sign="not negative", kp=kp, ki=ki, kd=kd)
    bound = np.minimum(convert_numbers("windup", windup, f"({robot.n},)"), UNBOUNDED)
    (windup,) = checked_vectors(robot, sign="positive", windup=bound)
    return PID(robot, p, i, d, per_joint_array("reference", reference, robot.n), gravity, windup)


@dataclass(frozen=True, eq=False)
class ComputedTorque:
    """Inverse dynamics of the commanded acceleration, made by `computed_torque`; attributes are its arguments."""

    robot: Robot
    kp: Array
    kd: Array
    reference: Reference
    feedforward: HasTorque | None = None
    traceable = True

    __repr__ = summary

    def __call__(self, t: float, q: Array, qd: Array) -> Array:
        """Torques [N m or N] at time t [s] for positions and velocities q, qd, shape (..., n)."""
        q_ref, qd_ref, qdd_ref = reference_values(self.robot, self.reference(t))
        commanded = qdd_ref - self.kd * (qd - qd_ref) - self.kp * (q - q_ref)
        torques = self.robot.inverse_dynamics(q, qd, commanded)
        return torques if self.feedforward is None else torques + supplied(self, qd_ref + 0 * qd, torques)


@of_robot
def computed_torque(
    robot: Robot, kp: ArrayLike, kd: ArrayLike, reference: Reference, *, feedforward: HasTorque | None = None
) -> ComputedTorque:
    """Tracking by inverse dynamics: u = M (qdd_ref - Kd (qd - qd_ref) - Kp (q - q_ref)) + C qd + g.

    Parameters
    ----------
    robot : Robot
        The controller's model.
    kp, kd : float or array_like, shape (n,)
        Gains of the error, not negative, which then obeys e'' + Kd e' + Kp e = 0 [1/s^2, 1/s].
    reference : callable
        A function f(t) -> (q, qd, qdd); `rne.trajectories` has motions from rest to rest, and splines through samples.
    feedforward : Friction, optional
        Friction whose torques at the reference's velocities are added, such as `Identification.friction`.

    Returns
    -------
    ComputedTorque
        The law f(t, q, qd) -> torques, shape (..., n).

    Raises
    ------
    ValueError
        If an array has the wrong shape or is not finite, or a gain is negative.

    Notes
    -----
    Siciliano et al. 2009, (8.57)-(8.60); what Høifødt 2011 recommends for tracking.

    Examples
    --------
    >>> import rne
    >>> arm = rne.load("irb140")
    >>> path = rne.trajectories.quintic([0] * 6, [1] * 6, 2.0)
    >>> law = rne.control.computed_torque(arm, 100, 20, path)
    >>> motion = rne.simulate(rne.Scene(arm, controller=law), [0] * 6, [0] * 6, 2.0)
    >>> motion.q[-1].round(6).tolist()
    [1.0, 1.0, 1.0, 1.0, 1.0, 1.0]
    """
    p, d = checked_vectors(robot, sign="not negative", kp=kp, kd=kd)
    check_reference(robot, reference)
    check_feedforward(robot, feedforward)
    return ComputedTorque(robot, p, d, reference, feedforward)
