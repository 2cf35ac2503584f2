"""The Robot: a model with each quantity as a method."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, DTypeLike

from .basics.notebook import InNotebooks
from .basics.short_text import counted
from .basics.spatial import Array
from .basics.text_table import short
from .dynamics.coriolis import coriolis_matrix
from .dynamics.crba import mass_matrix
from .dynamics.diagnosis import Diagnosis, diagnose
from .dynamics.energy import kinetic_energy, momentum, potential_energy
from .dynamics.jacobians import jacobian, jacobian_rate
from .dynamics.kinematics import link_poses
from .dynamics.quantity import Declared
from .dynamics.record import Recursion, recursion
from .dynamics.rnea import External, bias_torque, coriolis_torque, gravity_torque, inverse_dynamics
from .kernels.cache import KernelCache
from .kernels.kernel import Kernel
from .model import modify
from .model.joint_order import pinocchio_order
from .model.model import Model

COMPILED = (inverse_dynamics, mass_matrix, bias_torque, gravity_torque)  # by `compile` without arguments


class Robot(InNotebooks):
    """A robot whose quantities are methods.

    Arrays of joint values have shape (..., n): leading axes are independent states. All quantities are in SI units,
    angles in radians; see the functions of the same names for details.

    Parameters
    ----------
    model : Model
    engine : {"numpy", "numba"}
        What runs its kernels; see `rne.compile`. Robots and scenes derived from it keep the engine.

    Examples
    --------
    >>> import rne
    >>> robot = rne.load("irb140")
    >>> robot.inverse_dynamics([0] * 6, [0] * 6, [0] * 6).shape
    (6,)
    """

    def __init__(self, model: Model, engine: str = "numpy") -> None:
        if not isinstance(model, Model):
            raise TypeError(f"`model` must be an rne.Model, got {type(model).__name__}")
        self._model = model
        self.kernels = KernelCache(model, engine)
        self.cache: dict[str, Any] = {}  # compiled by simulations of the robot, for the next run

    def __reduce__(self) -> tuple[Any, ...]:
        return Robot, (self._model, self.engine)

    def kernel(self, function: Declared, *wrt: str, **fixed: Any) -> Kernel:
        """The function traced on this robot, on first use, and kept.

        Parameters
        ----------
        function : callable
            One of this package's functions of a model, such as `rne.mass_matrix`.
        *wrt : str
            Arguments to differentiate by; none for the function itself.
        **fixed
            Arguments other than joint arrays, such as `link="link_6"`, or `external=["link_6"]` for its wrench.

        Returns
        -------
        Kernel
            See `rne.compile` and `rne.derivative`.
        """
        return self.kernels.kernel(function, *wrt, **fixed)

    def compile(self, *functions: Declared) -> None:
        """Trace quantities now, instead of at the second call or the first batch.

        Parameters
        ----------
        *functions : callable
            Functions of a model and joint arrays, such as `rne.mass_matrix`. Without any: inverse dynamics, M, bias and
            gravity torques, and forward dynamics.
        """
        for function in functions or COMPILED:
            self.kernel(function)
        if not functions:
            self.kernels.forward_kernel()

    @property
    def model(self) -> Model:
        """The robot's parameters."""
        return self._model

    @property
    def engine(self) -> str:
        """What runs its kernels: "numpy" or "numba"."""
        return self.kernels.engine

    @property
    def n(self) -> int:
        """Number of joint coordinates."""
        return self._model.n

    @property
    def joint_names(self) -> tuple[str, ...]:
        """The joints in the order of q."""
        return self._model.joint_names

    def joint_order(self, library: str) -> Array:
        """Indices that bring joint arrays into another library's order.

        Parameters
        ----------
        library : {"pinocchio"}
            Pinocchio visits the tree depth first, siblings in alphabetical order of their joints' names. Here the next
            joint is always the first one in the file whose parent link has been placed.

        Returns
        -------
        ndarray of int, shape (n,)
            `q[..., order]` is in that library's order, and `q_other[..., np.argsort(order)]` is in this one's.
            Joints that mimic others are not coordinates here, but they are in Pinocchio unless it is told otherwise.

        Raises
        ------
        ValueError
            For any other library.

        Examples
        --------
        >>> import rne
        >>> rne.load("irb140").joint_order("pinocchio").tolist()
        [0, 1, 2, 3, 4, 5]
        """
        if library != "pinocchio":
            raise ValueError(f"`library` must be 'pinocchio', got {library!r}")
        return pinocchio_order(self._model)

    @property
    def link_names(self) -> tuple[str, ...]:
        """The links in the order of `link_poses`, the root first."""
        return self._model.link_names

    def inverse_dynamics(
        self, q: ArrayLike, qd: ArrayLike, qdd: ArrayLike, *, external: External | None = None
    ) -> Array:
        """Torques tau = M qdd + C qd + g, shape (..., n) [N m or N]; see `rne.inverse_dynamics`."""
        if external is None:
            return self.kernels.value(inverse_dynamics, q, qd, qdd)
        return self.kernels.value_under(external, inverse_dynamics, q, qd, qdd)

    def mass_matrix(self, q: ArrayLike) -> Array:
        """M(q), shape (..., n, n), full and exactly symmetric [kg m^2, kg m or kg]; see `rne.mass_matrix`."""
        return self.kernels.value(mass_matrix, q)

    def forward_dynamics(
        self, q: ArrayLike, qd: ArrayLike, tau: ArrayLike, *, external: External | None = None
    ) -> Array:
        """Accelerations, shape (..., n) [rad/s^2 or m/s^2]; see `rne.forward_dynamics`."""
        qdd, verdict = self.kernels.accelerations(q, qd, tau, external)
        verdict.raise_or_warn(stacklevel=2)
        return qdd

    def diagnose(
        self,
        q: ArrayLike,
        qd: ArrayLike | None = None,
        tau: ArrayLike | None = None,
        *,
        dtype: DTypeLike | None = None,
    ) -> Diagnosis:
        """How near M is to singular, by which motion, and the digits left in forward dynamics; see `rne.diagnose`."""
        return diagnose(self._model, q, qd, tau, dtype=dtype)

    def bias_torque(self, q: ArrayLike, qd: ArrayLike, *, external: External | None = None) -> Array:
        """C qd + g, shape (..., n) [N m or N]; see `rne.bias_torque`."""
        if external is None:
            return self.kernels.value(bias_torque, q, qd)
        return self.kernels.value_under(external, bias_torque, q, qd)

    def inverse_dynamics_derivatives(self, q: ArrayLike, qd: ArrayLike, qdd: ArrayLike) -> tuple[Array, Array, Array]:
        """Exact derivatives of the inverse dynamics.

        Parameters
        ----------
        q, qd, qdd : array_like, shape (..., n)
            Joint positions, rates and accelerations [rad or m; rad/s or m/s; rad/s^2 or m/s^2].

        Returns
        -------
        dtau_dq, dtau_dqd, M : ndarray, shape (..., n, n)
            Row i is of torque i; M is the derivative by qdd.
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
        dqdd_dq, dqdd_dqd, dqdd_dtau : ndarray, shape (..., n, n)
            Row i is of acceleration i; the last one is the inverse of M.

        Raises
        ------
        SingularMassMatrixError
            If M is singular to working precision.

        Notes
        -----
        From M qdd + h = tau: M dqdd = -d(M qdd + h) at constant qdd. Carpentier and Mansard 2018.
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
        B : ndarray, shape (..., 2 n, n)

        Raises
        ------
        SingularMassMatrixError
            If M is singular to working precision.
        """
        slopes, verdict = self.kernels.forward_derivatives(q, qd, tau)
        verdict.raise_or_warn(stacklevel=2)
        n = self.n
        system = np.zeros((*slopes.shape[:-2], 2 * n, 3 * n), dtype=slopes.dtype)
        system[..., :n, n : 2 * n] = np.eye(n)
        system[..., n:, :] = slopes
        return system[..., : 2 * n], system[..., 2 * n :]

    def gravity_torque(self, q: ArrayLike) -> Array:
        """g(q), shape (..., n) [N m or N]; see `rne.gravity_torque`."""
        return self.kernels.value(gravity_torque, q)

    def coriolis_torque(self, q: ArrayLike, qd: ArrayLike) -> Array:
        """C(q, qd) qd, shape (..., n) [N m or N]; see `rne.coriolis_torque`."""
        return self.kernels.value(coriolis_torque, q, qd)

    def coriolis_matrix(self, q: ArrayLike, qd: ArrayLike) -> Array:
        """C(q, qd) of the Christoffel symbols, shape (..., n, n); see `rne.coriolis_matrix`."""
        return self.kernels.value(coriolis_matrix, q, qd)

    def kinetic_energy(self, q: ArrayLike, qd: ArrayLike) -> Array:
        """Kinetic energy, shape (...) [J]; see `rne.kinetic_energy`."""
        return self.kernels.value(kinetic_energy, q, qd)

    def potential_energy(self, q: ArrayLike) -> Array:
        """Potential energy, zero at the root link's origin, shape (...) [J]; see `rne.potential_energy`."""
        return self.kernels.value(potential_energy, q)

    def momentum(self, q: ArrayLike, qd: ArrayLike) -> Array:
        """[Angular; linear] momentum about the root link's origin, shape (..., 6); see `rne.momentum`."""
        return self.kernels.value(momentum, q, qd)

    def link_poses(self, q: ArrayLike) -> Array:
        """Pose of every link, shape (..., n_links, 4, 4) [1, m]; see `rne.link_poses`."""
        return self.kernels.value(link_poses, q)

    def jacobian(self, q: ArrayLike, link: str) -> Array:
        """[omega; v] of a link's origin per joint rate, shape (..., 6, n); see `rne.jacobian`."""
        self._model.link_index(link)
        return self.kernels.evaluate(jacobian, q, link=link)[0]

    def jacobian_rate(self, q: ArrayLike, qd: ArrayLike, link: str) -> Array:
        """Time derivative of the Jacobian, shape (..., 6, n); see `rne.jacobian_rate`."""
        self._model.link_index(link)
        return self.kernels.evaluate(jacobian_rate, q, qd, link=link)[0]

    def recursion(self, q: ArrayLike, qd: ArrayLike, qdd: ArrayLike, *, external: External | None = None) -> Recursion:
        """Every omega, alpha, a, f and tau of every link; see `rne.recursion`."""
        record: Recursion = recursion.evaluate(self._model, q, qd, qdd, external=external)[0]
        return record

    def with_payload(
        self,
        mass: float,
        com: ArrayLike = (0.0, 0.0, 0.0),
        inertia: ArrayLike | None = None,
        link: str | None = None,
    ) -> Robot:
        """The robot with a rigid body fixed to a link, by default a chain's last one; see `rne.with_payload`."""
        return Robot(modify.with_payload(self._model, mass, com, inertia, link), self.engine)

    def locked(self, positions: Mapping[str, float]) -> Robot:
        """The smaller robot with some joints fixed, {joint: position}; see `rne.locked`."""
        return Robot(modify.locked(self._model, positions), self.engine)

    def mounted(self, rpy: ArrayLike) -> Robot:
        """The robot with its root link turned in the world; see `rne.mounted`."""
        return Robot(modify.mounted(self._model, rpy), self.engine)

    def __repr__(self) -> str:
        model = self._model
        lines = [
            f"Robot '{short(model.name)}': {counted(model.n, 'joint')}, {counted(len(model.link_names), 'link')}, "
            f"{model.mass.sum():.6g} kg moving, gravity {model.gravity.tolist()} m/s^2"
        ]
        if model.has_mimics:
            further = model.nb - model.n
            lines.append(f"  {counted(further, 'further joint')} mimic{'s' * (further == 1)} these")
        if model.damping.any() or model.friction.any():
            lines.append("  damping and friction of its <dynamics> are on record, not applied")
        return "\n".join(lines)
