"""The terms of the equations of motion beside M qdd, as methods."""

from __future__ import annotations

from numpy.typing import ArrayLike

from ..basics.spatial import Array
from ..dynamics.coriolis import coriolis_matrix
from ..dynamics.rnea import External, bias_torque, coriolis_torque, gravity_torque
from .base import RobotBase


class BiasTerms(RobotBase):
    """Coriolis and gravity terms: C qd + g of M qdd + C qd + g = tau."""

    def bias_torque(
        self,
        q: ArrayLike,
        qd: ArrayLike,
        *,
        external: External | None = None,
        parameters: ArrayLike | None = None,
    ) -> Array:
        """Joint torques at zero acceleration: C qd + g, less the torques that external wrenches supply.

        Parameters
        ----------
        q, qd : array_like, shape (..., n)
            Joint positions and rates [rad or m; rad/s or m/s].
        external : mapping of str to array_like, shape (..., 6), optional
            Wrenches [moment; force] acting on the robot at the named link's origin, in its axes [N m, N].
        parameters : array_like, shape (..., 10 nb), optional
            Inertial parameters in place of the robot's own; see `inverse_dynamics`.

        Returns
        -------
        ndarray, shape (..., n)
            Torques [N m or N].

        Raises
        ------
        ValueError
            If an array has the wrong shape or is not finite, there is no such link, or the torque overflows.

        Examples
        --------
        >>> import rne
        >>> rne.load("irb140").bias_torque([0] * 6, [1, 0, 0, 0, 0, 0]).shape
        (6,)
        """
        if external is None and parameters is None:
            return self.kernels.value(bias_torque, q, qd)
        return self.kernels.value_with(bias_torque, q, qd, external=external, parameters=parameters)

    def gravity_torque(self, q: ArrayLike, *, parameters: ArrayLike | None = None) -> Array:
        """Joint torques g(q) that balance gravity at rest.

        Parameters
        ----------
        q : array_like, shape (..., n)
            Joint positions [rad or m].
        parameters : array_like, shape (..., 10 nb), optional
            Inertial parameters in place of the robot's own; see `inverse_dynamics`.

        Returns
        -------
        ndarray, shape (..., n)
            Torques [N m or N]; the gradient of the potential energy.

        Raises
        ------
        ValueError
            If `q` has the wrong shape or is not finite.

        Examples
        --------
        >>> import math, rne
        >>> rne.load("irb140").gravity_torque([0, math.pi / 2, -math.pi / 2, 0, 0, 0]).round(3)[[1, 2, 4]].tolist()
        [-158.834, -23.632, -0.284]
        """
        if parameters is None:
            return self.kernels.value(gravity_torque, q)
        return self.kernels.value_with(gravity_torque, q, parameters=parameters)

    def coriolis_torque(self, q: ArrayLike, qd: ArrayLike, *, parameters: ArrayLike | None = None) -> Array:
        """Centrifugal and Coriolis joint torques C(q, qd) qd.

        Parameters
        ----------
        q, qd : array_like, shape (..., n)
            Joint positions and rates [rad or m; rad/s or m/s].
        parameters : array_like, shape (..., 10 nb), optional
            Inertial parameters in place of the robot's own; see `inverse_dynamics`.

        Returns
        -------
        ndarray, shape (..., n)
            Torques [N m or N]; quadratic in the rates.

        Raises
        ------
        ValueError
            If an array has the wrong shape or is not finite, or the torque overflows.

        Examples
        --------
        >>> import numpy as np, rne
        >>> robot, q, qd = rne.load("irb140"), np.full(6, 0.3), np.full(6, 0.5)
        >>> np.allclose(robot.coriolis_torque(q, 2 * qd), 4 * robot.coriolis_torque(q, qd))
        True
        """
        if parameters is None:
            return self.kernels.value(coriolis_torque, q, qd)
        return self.kernels.value_with(coriolis_torque, q, qd, parameters=parameters)

    def coriolis_matrix(self, q: ArrayLike, qd: ArrayLike, *, parameters: ArrayLike | None = None) -> Array:
        """The matrix C(q, qd) of the Christoffel symbols: C qd is the Coriolis torque and dM/dt = C + C^T.

        Parameters
        ----------
        q, qd : array_like, shape (..., n)
            Joint positions and rates [rad or m; rad/s or m/s].
        parameters : array_like, shape (..., 10 nb), optional
            Inertial parameters in place of the robot's own; see `inverse_dynamics`.

        Returns
        -------
        ndarray, shape (..., n, n)
            Torque i per rate j [N m s/rad, N s or N s/m].

        Raises
        ------
        ValueError
            If an array has the wrong shape or is not finite, or C overflows.

        Examples
        --------
        >>> import numpy as np, rne
        >>> robot, q, qd = rne.load("irb140"), np.full(6, 0.3), np.full(6, 0.5)
        >>> np.allclose(robot.coriolis_matrix(q, qd) @ qd, robot.coriolis_torque(q, qd))
        True
        """
        if parameters is None:
            return self.kernels.value(coriolis_matrix, q, qd)
        return self.kernels.value_with(coriolis_matrix, q, qd, parameters=parameters)
