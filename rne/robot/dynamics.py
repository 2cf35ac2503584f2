"""Torques, accelerations, the mass matrix and the recursion's record, as methods."""

from __future__ import annotations

from numpy.typing import ArrayLike, DTypeLike

from ..basics.spatial import Array
from ..dynamics.crba import mass_matrix
from ..dynamics.diagnosis import Diagnosis, diagnose
from ..dynamics.record import Recursion, recursion
from ..dynamics.rnea import External, inverse_dynamics
from .base import RobotBase


class Dynamics(RobotBase):
    """Relations between motion and torques: M qdd + C qd + g = tau."""

    def inverse_dynamics(
        self,
        q: ArrayLike,
        qd: ArrayLike,
        qdd: ArrayLike,
        *,
        external: External | None = None,
        parameters: ArrayLike | None = None,
    ) -> Array:
        """Joint torques for given accelerations: tau = M qdd + C qd + g.

        Parameters
        ----------
        q, qd, qdd : array_like, shape (..., n)
            Joint positions, rates and accelerations [rad or m; rad/s or m/s; rad/s^2 or m/s^2].
        external : mapping of str to array_like, shape (..., 6), optional
            Wrenches [moment; force] acting on the robot at the named link's origin, in its axes [N m, N]. The torques
            are less by what the wrenches supply.
        parameters : array_like, shape (..., 10 nb), optional
            Inertial parameters in place of the robot's own, in the order of `Robot.parameters`. They broadcast against
            the states: many variants of the robot are one batch. Any finite numbers will do, possible bodies or not.

        Returns
        -------
        ndarray, shape (..., n)
            Torques of revolute joints, forces of prismatic ones [N m or N].

        Raises
        ------
        ValueError
            If an array has the wrong shape or is not finite, there is no such link, or the torque overflows.

        Examples
        --------
        >>> import numpy as np, rne
        >>> robot = rne.load("irb140")
        >>> robot.inverse_dynamics([0] * 6, [0] * 6, [0, 0, 1, 0, 0, 0]).round(3)[2].item()
        -22.499
        >>> pull = {"link_6": [0, 0, 0, 0, 0, -10.0]}  # 10 N along -z of link 6
        >>> robot.inverse_dynamics([0] * 6, [0] * 6, [0] * 6, external=pull).shape
        (6,)
        >>> scales = np.random.default_rng(0).uniform(0.9, 1.1, (5000, 1))  # all masses up to 10 % off
        >>> robot.inverse_dynamics([0] * 6, [0] * 6, [0] * 6, parameters=scales * robot.parameters).shape
        (5000, 6)
        """
        if external is None and parameters is None:
            return self.kernels.value(inverse_dynamics, q, qd, qdd)
        return self.kernels.value_with(inverse_dynamics, q, qd, qdd, external=external, parameters=parameters)

    def forward_dynamics(
        self,
        q: ArrayLike,
        qd: ArrayLike,
        tau: ArrayLike,
        *,
        external: External | None = None,
        parameters: ArrayLike | None = None,
    ) -> Array:
        """Joint accelerations that the torques tau give: qdd = M^-1 (tau - C qd - g).

        Parameters
        ----------
        q, qd, tau : array_like, shape (..., n)
            Joint positions, rates and torques [rad or m; rad/s or m/s; N m or N].
        external : mapping of str to array_like, shape (..., 6), optional
            Wrenches [moment; force] acting on the robot at the named link's origin, in its axes [N m, N].
        parameters : array_like, shape (..., 10 nb), optional
            Inertial parameters in place of the robot's own; see `inverse_dynamics`. Of bodies that are not possible,
            those are refused that make M singular or not positive definite.

        Returns
        -------
        ndarray, shape (..., n)
            Accelerations [rad/s^2 or m/s^2].

        Raises
        ------
        ValueError
            If an array has the wrong shape or is not finite, there is no such link, or the acceleration overflows.
        SingularMassMatrixError
            If M is singular to working precision; names the joints whose combination moves no inertia.

        Warns
        -----
        PrecisionWarning
            If fewer than 3 digits are left, M nearly singular or the torques cancelled by great rates.

        Examples
        --------
        >>> import rne
        >>> robot = rne.load("irb140")
        >>> tau = robot.inverse_dynamics([0.1] * 6, [0] * 6, [1] * 6)
        >>> robot.forward_dynamics([0.1] * 6, [0] * 6, tau).round(9).tolist()
        [1.0, 1.0, 1.0, 1.0, 1.0, 1.0]
        """
        qdd, verdict = self.kernels.accelerations(q, qd, tau, external, parameters)
        verdict.raise_or_warn(stacklevel=2)
        return qdd

    def mass_matrix(self, q: ArrayLike, *, parameters: ArrayLike | None = None) -> Array:
        """Joint-space inertia matrix M(q): column j is the torques for a unit acceleration of joint j.

        Parameters
        ----------
        q : array_like, shape (..., n)
            Joint positions [rad or m].
        parameters : array_like, shape (..., 10 nb), optional
            Inertial parameters in place of the robot's own; see `inverse_dynamics`.

        Returns
        -------
        ndarray, shape (..., n, n)
            Full and exactly symmetric, the rotors' `armature` included [kg m^2, kg m or kg].

        Raises
        ------
        ValueError
            If `q` has the wrong shape or is not finite, or M overflows.

        Examples
        --------
        >>> import rne
        >>> rne.load("irb140").mass_matrix([0] * 6)[5, 5].round(6).item()
        0.001458
        """
        if parameters is None:
            return self.kernels.value(mass_matrix, q)
        return self.kernels.value_with(mass_matrix, q, parameters=parameters)

    def recursion(self, q: ArrayLike, qd: ArrayLike, qdd: ArrayLike, *, external: External | None = None) -> Recursion:
        """Inverse dynamics with all intermediate vectors of every link.

        Parameters
        ----------
        q, qd, qdd : array_like, shape (..., n)
            Joint positions, rates and accelerations [rad or m; rad/s or m/s; rad/s^2 or m/s^2].
        external : mapping of str to array_like, shape (..., 6), optional
            Wrenches [moment; force] acting on the robot at the named link's origin, in its axes [N m, N].

        Returns
        -------
        Recursion
            Angular velocities and accelerations, accelerations, forces and moments of every link, in its own axes;
            for one state, `print` shows them as a table with units and the thesis's equation numbers.

        Raises
        ------
        ValueError
            If an array has the wrong shape or is not finite, there is no such link, or a result overflows.

        Examples
        --------
        >>> import rne
        >>> rne.load("irb140").recursion([0] * 6, [1, 0, 0, 0, 0, 0], [0] * 6).omega[0].tolist()
        [0.0, -1.0, 0.0]
        """
        record: Recursion = recursion.evaluate(self._model, q, qd, qdd, external=external)[0]
        return record

    def diagnose(
        self,
        q: ArrayLike,
        qd: ArrayLike | None = None,
        tau: ArrayLike | None = None,
        *,
        dtype: DTypeLike | None = None,
    ) -> Diagnosis:
        """Digits that forward dynamics keep in given states, and the motion that limits them.

        Parameters
        ----------
        q : array_like, shape (..., n)
            Joint positions [rad or m].
        qd, tau : array_like, shape (..., n), optional
            Joint rates and torques, both or neither [rad/s or m/s; N m or N].
        dtype : real floating data type, optional
            The arithmetic to diagnose for; by default that of `q`.

        Returns
        -------
        Diagnosis
            Condition of M scaled to unit diagonal, digits left, and the joints whose motion limits them.

        Raises
        ------
        ValueError
            If an array has the wrong shape or is not finite and real, `dtype` is not real floating point, or only one
            of `qd` and `tau` is given.

        Examples
        --------
        >>> import rne
        >>> print(rne.load("irb140").diagnose([0] * 6).digits.round())
        15.0
        """
        return diagnose(self._model, q, qd, tau, dtype=dtype)
