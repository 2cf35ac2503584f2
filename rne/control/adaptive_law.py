"""The law of adaptive control: torques of the estimated parameters, and how the estimates change."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ..basics.spatial import Array
from ..basics.text import summary
from ..elementwise import maximum, minimum, tanh
from ..model.parameters import PARAMETERS
from ..robot import Robot
from .estimates import BodyEstimates
from .reference import Reference, composite, model_torques

SMOOTHING = 0.01  # [rad/s or m/s]: as of rne.Friction
FADING = 0.1  # of its limit: within this of it a torque slows the adaptation


@dataclass(frozen=True, eq=False)
class Adaptive:
    """Adaptive tracking control after Slotine and Li, made by `adaptive`.

    Attributes
    ----------
    robot : Robot
        The controller's model, whose parameters the estimates start from.
    kd : ndarray, shape (n,)
        Gains of the composite error [N m s/rad or N s/m].
    bandwidth : ndarray, shape (n,)
        Decay of the tracking error once the composite error is zero [1/s].
    reference : callable
        f(t) -> (q, qd, qdd) [rad or m; rad/s or m/s; rad/s^2 or m/s^2].
    gain : float
        Rate of adaptation [1/J].
    bodies : tuple of str
        Joints whose bodies are adapted.
    consistent : bool
        True if the estimates stay possible bodies.
    viscous, coulomb : ndarray, shape (n,), or None
        First estimates of friction coefficients that are adapted too [N m s/rad or N s/m; N m or N].
    smoothing : float
        Coulomb friction is modelled as Fc tanh(rate / smoothing) [rad/s or m/s].
    torque_limit : ndarray, shape (n,), or None
        Torques at which the adaptation pauses [N m or N].

    Examples
    --------
    >>> import numpy as np, rne
    >>> robot, path = rne.load("irb140"), rne.trajectories.quintic([0] * 6, [1] * 6, 2.0)
    >>> law = rne.control.adaptive(robot, [20] * 6, [10] * 6, path, bodies=["joint_6"])
    >>> torques, rates = law(0.0, np.zeros(6), np.zeros(6), np.zeros(law.states))
    >>> np.allclose(torques, robot.gravity_torque([0] * 6)), rates.shape
    (True, (10,))
    """

    robot: Robot
    kd: Array
    bandwidth: Array
    reference: Reference
    gain: float
    bodies: tuple[str, ...]
    consistent: bool = False
    viscous: Array | None = None
    coulomb: Array | None = None
    smoothing: float = SMOOTHING
    torque_limit: Array | None = None
    traceable = True

    __repr__ = summary

    @cached_property
    def estimates(self) -> BodyEstimates:
        """How the first states are the parameters of the bodies."""
        places = [self.robot.model.moving_joints.index(name) for name in self.bodies]
        return BodyEstimates(self.robot.parameters, places, self.gain, self.consistent)

    @property
    def states(self) -> int:
        """Number of states: ten per body that is adapted, and one per friction coefficient; they start at zero."""
        frictions = [f for f in (self.viscous, self.coulomb) if f is not None]
        return PARAMETERS * len(self.bodies) + self.robot.n * len(frictions)

    def __call__(self, t: float, q: Array, qd: Array, z: Array) -> tuple[Array, Array]:
        """Torques in one state, or in many, and the rates of the states.

        Parameters
        ----------
        t : float
            Time [s].
        q, qd : array_like, shape (..., n)
            Joint positions and rates [rad or m; rad/s or m/s].
        z : array_like, shape (..., states)
            The estimates' deviations from the start, divided by the start.

        Returns
        -------
        torques : ndarray, shape (..., n)
            Of the drives [N m or N].
        rates : ndarray, shape (..., states)
            dz/dt [1/s].
        """
        s, qdr, qddr, _ = composite(self.robot, self.reference, self.bandwidth, t, q, qd)
        Y = self.robot.control_regressor(q, qd, qdr, qddr)
        z = np.asarray(z)
        # u = Y pi - Kd s: Slotine and Li 1987, (8); rotors are known
        u = model_torques(self.robot, Y, self.parameters(z), qddr) - self.kd * s
        rates = [self.estimates.rates(z, (s[..., None, :] @ Y)[..., 0, :])]
        for start, rate, estimate in zip(self._frictions, self._rates_of(qdr), self.friction(z), strict=True):
            u = u + estimate * rate
            ratio = estimate / start if self.consistent else 1.0
            rates.append(-self.gain * start * ratio * ratio * rate * s)
        return u, np.concatenate(rates, axis=-1) * self._share(u)

    def _share(self, u: Array) -> Array | float:
        """1 as long as every torque is within its limit by the margin, falling to 0 at the limit."""
        if self.torque_limit is None:
            return 1.0
        used = np.abs(u) / self.torque_limit
        share: Array = np.asarray(1.0)
        for joint in range(self.robot.n):
            share = minimum(share, (1.0 - used[..., joint : joint + 1]) / FADING)
        return maximum(share, 0.0)

    @property
    def _frictions(self) -> list[Array]:
        return [f for f in (self.viscous, self.coulomb) if f is not None]

    def _rates_of(self, qdr: Array) -> list[Array]:
        """Factors of the friction coefficients, at the rates of the reference, which do not chatter."""
        wanted = ((self.viscous, qdr), (self.coulomb, tanh(qdr / self.smoothing)))
        return [np.asarray(factor) for coefficients, factor in wanted if coefficients is not None]

    def parameters(self, z: Array) -> Array:
        """Estimated inertial parameters of all bodies.

        Parameters
        ----------
        z : array_like, shape (..., states)
            States of the law, such as `Trajectory.controller_state`.

        Returns
        -------
        ndarray, shape (..., 10 nb)
            In the order of `Robot.parameters`.

        Examples
        --------
        >>> import numpy as np, rne
        >>> robot, path = rne.load("irb140"), rne.trajectories.quintic([0] * 6, [1] * 6, 2.0)
        >>> law = rne.control.adaptive(robot, [20] * 6, [10] * 6, path, bodies=["joint_6"])
        >>> np.array_equal(law.parameters(np.zeros(10)), robot.parameters)
        True
        """
        return self.estimates.parameters(np.asarray(z))

    def friction(self, z: Array) -> list[Array]:
        """Estimated friction coefficients: viscous, then Coulomb, those that are adapted.

        Parameters
        ----------
        z : array_like, shape (..., states)
            States of the law.

        Returns
        -------
        list of ndarray, shape (..., n)
            [N m s/rad or N s/m; N m or N].

        Examples
        --------
        >>> import numpy as np, rne
        >>> robot, path = rne.load("irb140"), rne.trajectories.quintic([0] * 6, [1] * 6, 2.0)
        >>> law = rne.control.adaptive(robot, [20] * 6, [10] * 6, path, viscous=[2] * 6)
        >>> law.friction(np.zeros(law.states))[0].tolist()
        [2.0, 2.0, 2.0, 2.0, 2.0, 2.0]
        """
        first, n = PARAMETERS * len(self.bodies), self.robot.n
        places = (np.asarray(z)[..., first + k * n : first + (k + 1) * n] for k in range(len(self._frictions)))
        return [start * (1.0 + deviation) for start, deviation in zip(self._frictions, places, strict=True)]

    def distance(self, z: Array, robot: Robot) -> Array:
        """Distance of the adapted bodies' estimates from a robot's parameters, as it enters the Lyapunov function.

        V = s^T M s / 2 + distance / gain does not grow while the scene is that robot, its other bodies are those of the
        model, there is no friction and none is adapted, and no torque is above 90 % of its limit.

        Parameters
        ----------
        z : array_like, shape (..., states)
            States of the law.
        robot : Robot
            The robot that moves, with the joints of the law's model.

        Returns
        -------
        ndarray, shape (...)
            Of consistent estimates the log-det divergence of the pseudo-inertias, log det(P_hat P^-1) + tr(P_hat^-1 P)
            - 4 summed over the bodies; otherwise half the squared norm of their differences, relative to the start.

        Raises
        ------
        ValueError
            If `robot` has other joints.

        Examples
        --------
        >>> import numpy as np, rne
        >>> robot, path = rne.load("irb140"), rne.trajectories.quintic([0] * 6, [1] * 6, 2.0)
        >>> law = rne.control.adaptive(robot, [20] * 6, [10] * 6, path, consistent=True)
        >>> bool(abs(law.distance(np.zeros(law.states), robot)) < 1e-12)
        True
        """
        joints = self.robot.model.moving_joints
        if robot.model.moving_joints != joints:
            raise ValueError(f"`robot` must have the joints {list(joints)}, got {list(robot.model.moving_joints)}")
        return self.estimates.distance(np.asarray(z), robot.parameters)
