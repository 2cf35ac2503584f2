"""Exact derivatives of the dynamics, as methods."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from ..basics.spatial import Array
from .base import RobotBase


class Derivatives(RobotBase):
    """Derivatives by the states and torques, of the traced program: exact to rounding, without differences."""

    def inverse_dynamics_derivatives(self, q: ArrayLike, qd: ArrayLike, qdd: ArrayLike) -> tuple[Array, Array, Array]:
        """Exact derivatives of the inverse dynamics.

        Parameters
        ----------
        q, qd, qdd : array_like, shape (..., n)
            Joint positions, rates and accelerations [rad or m; rad/s or m/s; rad/s^2 or m/s^2].

        Returns
        -------
        dtau_dq : ndarray, shape (..., n, n)
            Row i is of torque i, column j by position j.
        dtau_dqd : ndarray, shape (..., n, n)
            By the rates.
        M : ndarray, shape (..., n, n)
            By the accelerations: the mass matrix.

        Raises
        ------
        ValueError
            If an array has the wrong shape or is not finite, or a derivative overflows.

        Examples
        --------
        >>> import numpy as np, rne
        >>> robot, q, zero = rne.load("irb140"), np.full(6, 0.3), np.zeros(6)
        >>> dtau_dq, dtau_dqd, M = robot.inverse_dynamics_derivatives(q, zero, zero)
        >>> bool(dtau_dqd.any()), np.allclose(M, robot.mass_matrix(q))  # at rest, no torque depends on the rates
        (False, True)
        """
        return self.kernels.inverse_derivatives(q, qd, qdd)

    def forward_dynamics_derivatives(self, q: ArrayLike, qd: ArrayLike, tau: ArrayLike) -> tuple[Array, Array, Array]:
        """Exact derivatives of the forward dynamics.

        Parameters
        ----------
        q, qd, tau : array_like, shape (..., n)
            Joint positions, rates and torques [rad or m; rad/s or m/s; N m or N].

        Returns
        -------
        dqdd_dq : ndarray, shape (..., n, n)
            Row i is of acceleration i, column j by position j.
        dqdd_dqd : ndarray, shape (..., n, n)
            By the rates.
        dqdd_dtau : ndarray, shape (..., n, n)
            By the torques: the inverse of M.

        Raises
        ------
        ValueError
            If an array has the wrong shape or is not finite, or a derivative overflows.
        SingularMassMatrixError
            If M is singular to working precision.

        Warns
        -----
        PrecisionWarning
            If fewer than 3 digits are left.

        Notes
        -----
        From M qdd + h = tau: M dqdd = -d(M qdd + h) at constant qdd. Carpentier and Mansard 2018.

        Examples
        --------
        >>> import numpy as np, rne
        >>> robot, q = rne.load("irb140"), np.full(6, 0.3)
        >>> _, _, dqdd_dtau = robot.forward_dynamics_derivatives(q, np.zeros(6), np.zeros(6))
        >>> np.allclose(dqdd_dtau @ robot.mass_matrix(q), np.eye(6))
        True
        """
        slopes, verdict = self.kernels.forward_derivatives(q, qd, tau)
        verdict.raise_or_warn(stacklevel=2)
        n = self.n
        return slopes[..., :n], slopes[..., n : 2 * n], slopes[..., 2 * n :]

    def linearize(self, q: ArrayLike, qd: ArrayLike, tau: ArrayLike) -> tuple[Array, Array]:
        """The linearisation at a state: the derivative of (q, qd) changes by A d(q, qd) + B dtau.

        Parameters
        ----------
        q, qd, tau : array_like, shape (..., n)
            Joint positions, rates and torques [rad or m; rad/s or m/s; N m or N].

        Returns
        -------
        A : ndarray, shape (..., 2 n, 2 n)
            Rows: derivatives of the rates and of the accelerations; columns: by positions and rates.
        B : ndarray, shape (..., 2 n, n)
            By the torques: zero, and the inverse of M.

        Raises
        ------
        ValueError
            If an array has the wrong shape or is not finite, or a derivative overflows.
        SingularMassMatrixError
            If M is singular to working precision.

        Warns
        -----
        PrecisionWarning
            If fewer than 3 digits are left.

        Examples
        --------
        About an equilibrium, accelerations do not depend on the rates.

        >>> import numpy as np, rne
        >>> robot, q = rne.load("irb140"), np.array([0, np.pi, 0, 0, 0, 0])
        >>> A, B = robot.linearize(q, np.zeros(6), robot.gravity_torque(q))
        >>> A.shape, B.shape, bool(A[6:, 6:].any())
        ((12, 12), (12, 6), False)
        """
        slopes, verdict = self.kernels.forward_derivatives(q, qd, tau)
        verdict.raise_or_warn(stacklevel=2)
        n = self.n
        system = np.zeros((*slopes.shape[:-2], 2 * n, 3 * n), dtype=slopes.dtype)
        system[..., :n, n : 2 * n] = np.eye(n)
        system[..., n:, :] = slopes
        return system[..., : 2 * n], system[..., 2 * n :]
