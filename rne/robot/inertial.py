"""The inertial parameters, and the torques as linear functions of them, as methods."""

from __future__ import annotations

from dataclasses import replace

from numpy.typing import ArrayLike

from ..basics.spatial import Array
from ..dynamics.base_inertial_parameters import TOLERANCE, BaseParameters, base_parameters
from ..dynamics.regressors import control_regressor, regressor
from ..model.parameters import parameters_of
from .base import RobotBase


class Inertial(RobotBase):
    """Inertial parameters and regressors."""

    @property
    def parameters(self) -> Array:
        """Inertial parameters of the moving bodies, ten each, shape (10 nb,).

        In the order of `model.moving_joints`: m [kg], m cx, m cy, m cz [kg m], Ixx, Ixy, Iyy, Ixz, Iyz, Izz [kg m^2],
        about the origin of the body's joint frame in the URDF and in its axes. The order is Pinocchio's.
        """
        return parameters_of(self._model)

    def regressor(self, q: ArrayLike, qd: ArrayLike, qdd: ArrayLike) -> Array:
        """The matrix Y of tau = Y pi: joint torques per unit of each inertial parameter of each body.

        Parameters
        ----------
        q, qd, qdd : array_like, shape (..., n)
            Joint positions, rates and accelerations [rad or m; rad/s or m/s; rad/s^2 or m/s^2].

        Returns
        -------
        ndarray, shape (..., n, 10 nb)
            Columns in the order of `parameters`. The torque of `armature` is not among them.

        Raises
        ------
        ValueError
            If an array has the wrong shape or is not finite, or an entry overflows.

        Notes
        -----
        Høifødt 2011, (3.2); Siciliano et al. 2009, section 7.2.2.

        Examples
        --------
        >>> import numpy as np, rne
        >>> robot = rne.load("irb140")
        >>> q, qd, qdd = np.random.default_rng(0).normal(size=(3, 100, 6))
        >>> tau = robot.regressor(q, qd, qdd) @ robot.parameters
        >>> np.allclose(tau, robot.inverse_dynamics(q, qd, qdd))
        True
        """
        return self.kernels.value(regressor, q, qd, qdd)

    def control_regressor(self, q: ArrayLike, qd: ArrayLike, qdr: ArrayLike, qddr: ArrayLike) -> Array:
        """The matrix Y of M qddr + C qdr + g = Y pi, with dM/dt - 2 C skew: what adaptive control needs.

        Parameters
        ----------
        q, qd : array_like, shape (..., n)
            Joint positions and rates [rad or m; rad/s or m/s].
        qdr, qddr : array_like, shape (..., n)
            Rates and accelerations of the reference [rad/s or m/s; rad/s^2 or m/s^2].

        Returns
        -------
        ndarray, shape (..., n, 10 nb)
            Columns in the order of `parameters`. C is the matrix of the Christoffel symbols, as `coriolis_matrix`.

        Raises
        ------
        ValueError
            If an array has the wrong shape or is not finite, or an entry overflows.

        Notes
        -----
        Slotine and Li 1987; body by body as in Echeandia and Wensing 2021.

        Examples
        --------
        >>> import numpy as np, rne
        >>> robot = rne.load("irb140")
        >>> q, qd, qdr, qddr = np.random.default_rng(0).normal(size=(4, 6))
        >>> torques = robot.control_regressor(q, qd, qdr, qddr) @ robot.parameters
        >>> M, C, g = robot.mass_matrix(q), robot.coriolis_matrix(q, qd), robot.gravity_torque(q)
        >>> np.allclose(torques, M @ qddr + C @ qdr + g)
        True
        """
        return self.kernels.value(control_regressor, q, qd, qdr, qddr)

    def base_parameters(
        self,
        *,
        rotor: bool = False,
        friction: str | None = None,
        offset: bool = False,
        shafts: ArrayLike | None = None,
        smoothing: float = 0.0,
        tolerance: float = TOLERANCE,
    ) -> BaseParameters:
        """The fewest combinations of inertial and drive parameters that joint torques depend on, by rules.

        Parameters
        ----------
        rotor : bool
            True for the inertia Ia of each drive's rotor, reflected to its joint.
        friction : {None, "viscous", "coulomb", "viscous+coulomb"}
            Fv, Fc or both of each drive.
        offset : bool
            True for a constant torque tau0 of each drive.
        shafts : array_like, shape (s, n), optional
            Rows a of further shafts, which turn at a^T qd, with rotor and friction if the joints have them.
        smoothing : float
            Coulomb friction is Fc tanh(qd / smoothing); 0 for Fc sign(qd) [rad/s or m/s].
        tolerance : float
            Angles [rad] and distances, divided by the longest one between two joints, that differ by less are taken as
            the same.

        Returns
        -------
        BaseParameters
            Their names, formulas, and the matrices to and from the standard parameters.

        Raises
        ------
        ValueError
            If an option has a wrong value or shape.

        Notes
        -----
        Gautier and Khalil 1990; see `rne.dynamics.base_parameters`.

        Examples
        --------
        >>> import rne
        >>> base = rne.load("irb140").base_parameters(rotor=True, friction="viscous+coulomb")
        >>> base.count, base.standard.count, base.names[-1]
        (52, 78, 'Fc_6')
        """
        found = base_parameters(
            self._model,
            rotor=rotor,
            friction=friction,
            offset=offset,
            shafts=shafts,
            smoothing=smoothing,
            tolerance=tolerance,
        )
        return replace(found, body_regressor=self.regressor)
