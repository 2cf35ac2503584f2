"""Poses, Jacobians, energies and momentum, as methods."""

from __future__ import annotations

from numpy.typing import ArrayLike

from ..basics.spatial import Array
from ..dynamics.energy import kinetic_energy, momentum, potential_energy
from ..dynamics.jacobians import jacobian, jacobian_rate
from ..dynamics.kinematics import link_poses
from .base import RobotBase


class Kinematics(RobotBase):
    """Where the links are and how they move."""

    def link_poses(self, q: ArrayLike) -> Array:
        """Pose of every link, as homogeneous matrices.

        Parameters
        ----------
        q : array_like, shape (..., n)
            Joint positions [rad or m].

        Returns
        -------
        ndarray, shape (..., n_links, 4, 4)
            Takes coordinates of a link's frame to those of the root link; links in `link_names` order [1, m].

        Raises
        ------
        ValueError
            If `q` has the wrong shape or is not finite.

        Examples
        --------
        >>> import rne
        >>> robot = rne.load("irb140")
        >>> robot.link_poses([0] * 6)[robot.link_names.index("link_2"), :3, 3].tolist()
        [0.07, 0.0, 0.352]
        """
        return self.kernels.value(link_poses, q)

    def jacobian(self, q: ArrayLike, link: str) -> Array:
        """Geometric Jacobian of a link: its angular velocity and its origin's velocity per joint rate.

        Parameters
        ----------
        q : array_like, shape (..., n)
            Joint positions [rad or m].
        link : str
            One of `link_names`.

        Returns
        -------
        ndarray, shape (..., 6, n)
            [omega; v] = J qd in the axes of the root link [1, m]. Pinocchio and Corke's toolbox have v first.

        Raises
        ------
        ValueError
            If `q` has the wrong shape or is not finite, or there is no such link.

        Examples
        --------
        >>> import rne
        >>> rne.load("irb140").jacobian([0] * 6, "link_1")[:, 0].round(3).tolist()
        [0.0, 0.0, 1.0, 0.0, 0.0, 0.0]
        """
        self._model.link_index(link)
        return self.kernels.evaluate(jacobian, q, link=link)[0]

    def jacobian_rate(self, q: ArrayLike, qd: ArrayLike, link: str) -> Array:
        """Time derivative of `jacobian` along the motion (q, qd).

        Parameters
        ----------
        q, qd : array_like, shape (..., n)
            Joint positions and rates [rad or m; rad/s or m/s].
        link : str
            One of `link_names`.

        Returns
        -------
        ndarray, shape (..., 6, n)
            The matrix dJ/dt in the axes of the root link [1/s, m/s]: the link's acceleration is J qdd + (dJ/dt) qd.

        Raises
        ------
        ValueError
            If an array has the wrong shape or is not finite, or there is no such link.

        Examples
        --------
        >>> import rne
        >>> rne.load("irb140").jacobian_rate([0] * 6, [0] * 6, "link_6").any().item()
        False
        """
        self._model.link_index(link)
        return self.kernels.evaluate(jacobian_rate, q, qd, link=link)[0]

    def kinetic_energy(self, q: ArrayLike, qd: ArrayLike, *, parameters: ArrayLike | None = None) -> Array:
        """Kinetic energy of the robot, drives (`armature`) included; equal to qd^T M qd / 2.

        Parameters
        ----------
        q, qd : array_like, shape (..., n)
            Joint positions and rates [rad or m; rad/s or m/s].
        parameters : array_like, shape (..., 10 nb), optional
            Inertial parameters in place of the robot's own; see `inverse_dynamics`.

        Returns
        -------
        ndarray, shape (...)
            The energy [J].

        Raises
        ------
        ValueError
            If an array has the wrong shape or is not finite, or the energy overflows.

        Examples
        --------
        >>> import rne
        >>> rne.load("irb140").kinetic_energy([0] * 6, [0, 0, 0, 0, 0, 2]).round(6).item()
        0.002916
        """
        if parameters is None:
            return self.kernels.value(kinetic_energy, q, qd)
        return self.kernels.value_with(kinetic_energy, q, qd, parameters=parameters)

    def potential_energy(self, q: ArrayLike, *, parameters: ArrayLike | None = None) -> Array:
        """Potential energy of the moving bodies in gravity, zero at the height of the root link's origin.

        Parameters
        ----------
        q : array_like, shape (..., n)
            Joint positions [rad or m].
        parameters : array_like, shape (..., 10 nb), optional
            Inertial parameters in place of the robot's own; see `inverse_dynamics`.

        Returns
        -------
        ndarray, shape (...)
            The sum of -m g.c over the bodies [J].

        Raises
        ------
        ValueError
            If `q` has the wrong shape or is not finite.

        Examples
        --------
        >>> import rne
        >>> rne.load("irb140").potential_energy([0] * 6).round(5).item()
        370.87686
        """
        if parameters is None:
            return self.kernels.value(potential_energy, q)
        return self.kernels.value_with(potential_energy, q, parameters=parameters)

    def momentum(self, q: ArrayLike, qd: ArrayLike, *, parameters: ArrayLike | None = None) -> Array:
        """Momentum of the moving bodies about the root link's origin.

        Parameters
        ----------
        q, qd : array_like, shape (..., n)
            Joint positions and rates [rad or m; rad/s or m/s].
        parameters : array_like, shape (..., 10 nb), optional
            Inertial parameters in place of the robot's own; see `inverse_dynamics`.

        Returns
        -------
        ndarray, shape (..., 6)
            [angular; linear] in the axes of the root link [kg m^2/s, kg m/s].

        Raises
        ------
        ValueError
            If an array has the wrong shape or is not finite, or the momentum overflows.

        Examples
        --------
        >>> import rne
        >>> rne.load("irb140").momentum([0] * 6, [0] * 6).tolist()
        [0.0, 0.0, 0.0, 0.0, 0.0, 0.0]
        """
        if parameters is None:
            return self.kernels.value(momentum, q, qd)
        return self.kernels.value_with(momentum, q, qd, parameters=parameters)
