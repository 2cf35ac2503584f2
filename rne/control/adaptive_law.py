"""Adaptive control: tracking by a law that estimates the inertial parameters of its model during the motion."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from ..basics.arrays import positive_number
from ..basics.docstrings import describe_parameters
from ..basics.inertia import PARAMETERS, dual_of_gradient, parameters_of_pseudo_inertia, pseudo_inertia
from ..basics.spatial import Array, transpose, zeros
from ..basics.text import summary
from ..elementwise import clip, tanh
from ..model.friction_laws import SMOOTHING
from ..robot import Robot
from .impulses import largest
from .laws import STATES, Reference, check_reference, checked_vectors, composite_error, model_torques, of_robot

FADING = 0.1  # width of the margin below a torque limit in which adaptation slows down, relative to the limit
SMALLEST = 1e-12  # smallest eigenvalue of a positive definite pseudo-inertia, relative to the largest
ROWS, COLUMNS = np.triu_indices(4)


@describe_parameters(STATES)
@dataclass(frozen=True, eq=False)
class Adaptive:
    """Adaptive tracking control after Slotine and Li, made by `adaptive`; attributes are its arguments.

    A body is estimated by its pseudo-inertia P = L (1 + Z) L^T, where P0 = L L^T is the model's; the states are the
    upper triangles of Z, then the relative changes of the friction coefficients.

    Examples
    --------
    >>> import numpy as np, rne
    >>> robot, path = rne.load("irb140"), rne.trajectories.quintic([0] * 6, [1] * 6, 2.0)
    >>> law = rne.control.adaptive(robot, 20, 10, path, bodies=["joint_6"], viscous=2)
    >>> start = np.zeros(law.states)  # the states of the robot's own parameters
    >>> np.array_equal(law.parameters(start), robot.parameters), bool(abs(law.distance(start, robot)) < 1e-12)
    (True, True)
    >>> law.friction(start)[0].tolist()
    [2.0, 2.0, 2.0, 2.0, 2.0, 2.0]
    """

    robot: Robot
    kd: Array
    bandwidth: Array
    reference: Reference
    gain: float
    bodies: tuple[str, ...]
    consistent: bool
    viscous: Array | None
    coulomb: Array | None
    smoothing: float
    effort_limit: Array | None
    traceable = True

    __repr__ = summary

    @property
    def states(self) -> int:
        """Number of states: ten per body that is adapted, and one per friction coefficient; they start at zero."""
        return PARAMETERS * len(self.bodies) + self.robot.n * len(self._frictions)

    @property
    def _frictions(self) -> list[Array]:
        return [f for f in (self.viscous, self.coulomb) if f is not None]

    @cached_property
    def _columns(self) -> Array:
        """Column indices of the adapted parameters among the parameters of all bodies."""
        places = np.array([self.robot.model.moving_joints.index(name) for name in self.bodies], dtype=int)
        return (PARAMETERS * places[:, None] + np.arange(PARAMETERS)).ravel()

    @cached_property
    def _L(self) -> Array:
        return np.linalg.cholesky(pseudo_inertia(self.robot.parameters[self._columns]))

    def _Z(self, z: Array) -> Array:
        """Changes of the pseudo-inertias relative to the start, shape (..., bodies, 4, 4)."""
        rows = z[..., : len(self._columns)].reshape(*z.shape[:-1], -1, PARAMETERS)
        Z = zeros((*rows.shape[:-1], 4, 4), like=z)
        Z[..., ROWS, COLUMNS] = rows
        Z[..., COLUMNS, ROWS] = rows
        return Z

    def __call__(self, t: float, q: Array, qd: Array, z: Array) -> tuple[Array, Array]:
        """Torques [N m or N], shape (..., n), and dz/dt [1/s], shape (..., states), for the law's states z."""
        s, qdr, qddr = composite_error(self.robot, self.reference, self.bandwidth, t, q, qd)
        Y = self.robot.control_regressor(q, qd, qdr, qddr)
        z = np.asarray(z)
        # u = Y pi - Kd s: Slotine and Li 1987, (8); rotors are known
        u = model_torques(self.robot, Y, self.parameters(z), qddr) - self.kd * s
        derivative = [self._body_derivative(z, (s[..., None, :] @ Y)[..., 0, :])]
        # friction at the velocities of the reference, which do not chatter
        factors = [f for c, f in ((self.viscous, qdr), (self.coulomb, tanh(qdr / self.smoothing))) if c is not None]
        for start, factor, estimate in zip(self._frictions, factors, self.friction(z), strict=True):
            u = u + estimate * factor
            ratio = estimate / start if self.consistent else 1.0
            derivative.append(-self.gain * start * ratio * ratio * factor * s)
        return u, np.concatenate(derivative, axis=-1) * self._share(u)

    def _body_derivative(self, z: Array, slope: Array) -> Array:
        """Z' = -gain L^T S L, with S dual to Y^T s; consistent: -gain (1 + Z) L^T S L (1 + Z)."""
        S = dual_of_gradient(slope[..., self._columns])
        Z_dot = -self.gain * (transpose(self._L) @ S @ self._L)
        if self.consistent:  # P' = -gain P S P, Lee, Kwon and Park 2018
            metric = np.eye(4) + self._Z(z)
            Z_dot = metric @ Z_dot @ metric
        return np.asarray(Z_dot[..., ROWS, COLUMNS].reshape(*z.shape[:-1], -1))

    def _share(self, u: Array) -> Array | float:
        """Adaptation rate factor: 1 while all torques are below their limits by a margin, falling to 0 at a limit."""
        if self.effort_limit is None:
            return 1.0
        return clip((1.0 - largest(u / self.effort_limit, -1)) / FADING, 0.0, 1.0)

    def parameters(self, z: Array) -> Array:
        """Estimated inertial parameters of all bodies.

        Returns
        -------
        ndarray, shape (..., 10 nb)
            In the order of `Robot.parameters`.
        """
        z = np.asarray(z)
        change = self._L @ self._Z(z) @ transpose(self._L)
        pi = zeros((*z.shape[:-1], len(self.robot.parameters)), like=z) + self.robot.parameters
        pi[..., self._columns] = pi[..., self._columns] + parameters_of_pseudo_inertia(change)
        return pi

    def friction(self, z: Array) -> list[Array]:
        """Estimated friction coefficients: viscous, then Coulomb, as far as they are adapted.

        Returns
        -------
        list of ndarray, shape (..., n)
            [N m s/rad or N s/m; N m or N].
        """
        first, n = PARAMETERS * len(self.bodies), self.robot.n
        places = (np.asarray(z)[..., first + k * n : first + (k + 1) * n] for k in range(len(self._frictions)))
        return [start * (1.0 + deviation) for start, deviation in zip(self._frictions, places, strict=True)]

    def distance(self, z: Array, robot: Robot) -> Array:
        """Distance of the adapted bodies' estimates from a robot's parameters, as it enters the Lyapunov function.

        V = s^T M s / 2 + distance / gain does not grow while that robot moves, its other bodies are the model's, there
        is no friction and none is adapted, and no torque is above 90 % of its limit.

        Parameters
        ----------
        robot : Robot
            The robot that moves, with the joints of the law's model.

        Returns
        -------
        ndarray, shape (...)
            For consistent estimates the log-det divergence of the pseudo-inertias, log det(P_hat P^-1) + tr(P_hat^-1 P)
            - 4 summed over the bodies; otherwise half the squared norm of their differences, relative to the start.

        Raises
        ------
        ValueError
            If `robot` has other joints.
        """
        joints = self.robot.model.moving_joints
        if robot.model.moving_joints != joints:
            raise ValueError(f"`robot` must have the joints {list(joints)}, got {list(robot.model.moving_joints)}")
        inverse = np.linalg.inv(self._L)
        relative = inverse @ pseudo_inertia(robot.parameters[self._columns]) @ transpose(inverse)
        estimate = np.eye(4) + self._Z(np.asarray(z))
        if not self.consistent:
            return np.asarray(((estimate - relative) ** 2).sum((-1, -2, -3)) / 2)
        ratio = np.linalg.solve(estimate, np.broadcast_to(relative, estimate.shape))
        _, logarithm = np.linalg.slogdet(ratio)
        return np.asarray((np.trace(ratio, axis1=-2, axis2=-1) - logarithm - 4).sum(-1))


@of_robot
def adaptive(
    robot: Robot,
    kd: ArrayLike,
    bandwidth: ArrayLike,
    reference: Reference,
    *,
    gain: float = 1.0,
    bodies: Sequence[str] | None = None,
    consistent: bool = False,
    viscous: ArrayLike | None = None,
    coulomb: ArrayLike | None = None,
    smoothing: float = SMOOTHING,
    effort_limit: ArrayLike | None = None,
) -> Adaptive:
    """Tracking with parameters that adapt: u = Y pi - Kd s, with s = e' + bandwidth e and d(pi)/dt = -Gamma Y^T s.

    Parameters
    ----------
    robot : Robot
        The controller's model. Its parameters are the first estimates.
    kd : float or array_like, shape (n,)
        Gains of the composite error s [N m s/rad or N s/m].
    bandwidth : float or array_like, shape (n,)
        Decay of the tracking error e = q - q_ref once s is zero [1/s].
    reference : callable
        A function f(t) -> (q, qd, qdd).
    gain : float
        Speed of adaptation [1/J]: work of s against a torque that a body's whole start value causes changes the
        estimate by `gain` times that work, relative to the start.
    bodies : sequence of str, optional
        Joints whose bodies are adapted, such as the last one, which carries the payload. If not given, all whose
        pseudo-inertia is positive definite: bodies without mass, without extent or not possible are left as they are.
    consistent : bool
        True for the natural adaptation law, by which every estimate stays a possible body: a positive definite
        pseudo-inertia.
    viscous, coulomb : float or array_like, shape (n,), optional
        First estimates of friction coefficients, which are adapted too, in proportion to them; friction that is not
        given is not modelled [N m s/rad or N s/m; N m or N].
    smoothing : float
        Coulomb friction is modelled as Fc tanh(qdr / smoothing), qdr = qd_ref - bandwidth e [rad/s or m/s].
    effort_limit : float or array_like, shape (n,), optional
        The drives' limits. The adaptation slows down where a torque comes within 10 % of them, and pauses beyond: a
        torque that the drives do not deliver would pass for an error of the parameters [N m or N].

    Returns
    -------
    Adaptive
        For a Scene: f(t, q, qd, z) -> (torques, dz/dt).

    Raises
    ------
    ValueError
        If an array has the wrong shape or sign or is not finite, a joint of `bodies` does not exist, the body of one
        cannot be adapted, or there is nothing to adapt: no such body, and no friction.

    Notes
    -----
    Slotine and Li 1987, with the metric of the pseudo-inertias P at the start, P0, for the parameters: with S from Y^T
    s, dP/dt = -gain P0 S P0, which is a constant Gamma; the consistent law is dP/dt = -gain P S P, Lee, Kwon and Park
    2018. Both make V = s^T M s / 2 + distance / gain fall, V' = -s^T Kd s, so that the tracking error goes to zero for
    any gains, if the robot that moves differs from the model only in the parameters that are adapted. With
    `effort_limit` this holds while every torque is below 90 % of its limit; beyond, adaptation slows down and V may
    grow. The proof fails with saturated drives, by which the estimates of the consistent law can grow without bound in
    finite time if `effort_limit` is not given; with friction or disturbances that are not modelled, which let estimates
    drift; and with a sampled controller whose sample time is long. The parameters themselves converge if the reference
    excites all of them persistently; combinations that do not act on the torques never do.

    Examples
    --------
    >>> import numpy as np, rne
    >>> robot, path = rne.load("irb140"), rne.trajectories.quintic([0] * 6, [1] * 6, 1.0)
    >>> law = rne.control.adaptive(robot, 20, 10, path, bodies=["joint_6"])
    >>> law.states, law.parameters(np.zeros(10))[50].item()  # the mass of link 6
    (10, 1.0)
    """
    d, decay = checked_vectors(robot, sign="positive", kd=kd, bandwidth=bandwidth)
    check_reference(robot, reference)
    given = {"viscous": viscous, "coulomb": coulomb, "effort_limit": effort_limit}
    options = {
        name: None if value is None else checked_vectors(robot, sign="positive", **{name: value})[0]
        for name, value in given.items()
    }
    return Adaptive(
        robot,
        d,
        decay,
        reference,
        positive_number("gain", gain),
        _adapted_bodies(robot, bodies, required=viscous is None and coulomb is None),
        consistent,
        smoothing=positive_number("smoothing", smoothing),
        **options,
    )


def _adapted_bodies(robot: Robot, bodies: Sequence[str] | None, *, required: bool) -> tuple[str, ...]:
    """Joints whose bodies are adapted, in the order of `model.moving_joints`; raises if others are `required`."""
    eigenvalues = np.linalg.eigvalsh(pseudo_inertia(robot.parameters))
    joints, can_adapt = robot.model.moving_joints, eigenvalues[:, 0] > SMALLEST * eigenvalues[:, -1]
    possible = [joints[i] for i in np.flatnonzero(can_adapt)]
    if bodies is None:
        if required and not possible:
            raise ValueError(
                "`robot` has nothing to adapt: the pseudo-inertia of none of its bodies is positive definite, and "
                "neither `viscous` nor `coulomb` is given"
            )
        return tuple(possible)
    if isinstance(bodies, str):
        raise ValueError(f"`bodies` must be a sequence of names of joints, got the string {bodies!r}")
    for name in bodies:
        if name not in joints:
            raise ValueError(f"`bodies` must name joints of {list(joints)}, got {name!r}")
        if name not in possible:
            raise ValueError(
                f"`bodies`: the body of joint {name!r} cannot be adapted: its pseudo-inertia is not positive definite"
            )
    return tuple(name for name in joints if name in bodies)
