"""The user's handle on a robot: each quantity a method. It alone chooses between methods."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, DTypeLike

from . import edit
from .diagnosis import Diagnosis, diagnose
from .dynamics.articulated import articulated_forward_dynamics
from .dynamics.checks import Checked
from .dynamics.composite import mass_matrix
from .dynamics.coriolis import coriolis_matrix
from .dynamics.energy import kinetic_energy, momentum, potential_energy
from .dynamics.forward import factorise, forward_dynamics, solve_factored, solve_mass_matrix
from .dynamics.jacobians import jacobian, jacobian_rate
from .dynamics.kinematics import link_poses
from .dynamics.newton_euler import External, bias_torque, coriolis_torque, gravity_torque, inverse_dynamics
from .dynamics.precision import gather, give, may_be_fast, warn_of_few_digits
from .dynamics.record import Recursion, recursion
from .dynamics.refine import WON
from .dynamics.refine import refine as refined
from .model import Model
from .spatial import Array
from .tape.kernel import Kernel, compile, derivative

# Counted on straight chains and on random ones: M with L^T D L takes fewer operations up to the first number of
# joints, articulated bodies beyond the second.
FEW_JOINTS, MANY_JOINTS = 9, 20
FORWARD = "forward"  # the chosen kernel's place


class Robot:
    """A robot and what can be asked of it.

    Arrays of joint values have shape (..., n): leading axes are independent states. All quantities are in SI units,
    angles in radians; see the functions of the same names for details.

    Parameters
    ----------
    model : Model

    Examples
    --------
    >>> import rne
    >>> robot = rne.load("irb140")
    >>> robot.inverse_dynamics([0] * 6, [0] * 6, [0] * 6).shape
    (6,)
    """

    def __init__(self, model: Model) -> None:
        if not isinstance(model, Model):
            raise TypeError(f"`model` must be an rne.Model, got {type(model).__name__}")
        self._model = model
        self._kernels: dict[Any, Kernel] = {}
        self.kept: dict[str, Any] = {}  # what simulation compiles for the bare robot, for its next run

    def __reduce__(self) -> tuple[Any, ...]:
        return Robot, (self._model,)

    def kernel(self, function: Checked[Any, Any, Any], *wrt: str, **fixed: Any) -> Kernel:
        """The function traced on this robot, on first use, and kept.

        Parameters
        ----------
        function : callable
            One of this package's functions of a model, such as `rne.mass_matrix`.
        *wrt : str
            Arguments to differentiate by; none for the function itself.
        **fixed
            Arguments other than joint arrays, such as `link="link_6"`.

        Returns
        -------
        Kernel
            See `rne.compile` and `rne.derivative`.
        """
        key = (function, *wrt, *fixed.items())
        kernel = self._kernels.get(key)
        if kernel is None:
            make = derivative if wrt else compile
            kernel = self._kernels[key] = make(function, self._model, *wrt, **fixed)
        return kernel

    def _forward(self) -> Kernel:
        """Forward dynamics by the method with fewer operations.

        That is M with L^T D L for few joints, articulated bodies for many; in between both are counted. They lose
        about the same digits on few joints, and on long chains articulated bodies lose fewer.
        """
        kernel = self._kernels.get(FORWARD)
        if kernel is None:
            methods = [forward_dynamics, articulated_forward_dynamics]
            if self.n <= FEW_JOINTS or self._model.has_mimics:
                methods = [forward_dynamics]
            elif self.n > MANY_JOINTS:
                methods = [articulated_forward_dynamics]
            kernels = [self.kernel(method) for method in methods]
            kernel = min(kernels, key=lambda k: sum(k.operations.values()) or float("inf"))
            self._kernels[FORWARD] = kernel
        return kernel

    @property
    def forward_method(self) -> Checked[Any, Any, Any]:
        """The function that forward dynamics of this robot take."""
        return self._forward().function

    @property
    def model(self) -> Model:
        """The robot's parameters."""
        return self._model

    @property
    def n(self) -> int:
        """Number of joint coordinates."""
        return self._model.n

    @property
    def joint_names(self) -> tuple[str, ...]:
        """The joints in the order of q."""
        return self._model.joint_names

    @property
    def link_names(self) -> tuple[str, ...]:
        """The links in the order of `link_poses`, the root first."""
        return self._model.link_names

    def inverse_dynamics(
        self, q: ArrayLike, qd: ArrayLike, qdd: ArrayLike, *, external: External | None = None
    ) -> Array:
        """Torques tau = M qdd + C qd + g, shape (..., n) [N m or N]; see `rne.inverse_dynamics`."""
        if external is None:
            return self.kernel(inverse_dynamics)(q, qd, qdd)
        return inverse_dynamics(self._model, np.asarray(q), np.asarray(qd), np.asarray(qdd), external=external)

    def mass_matrix(self, q: ArrayLike) -> Array:
        """M(q), shape (..., n, n), full and exactly symmetric [kg m^2, kg m or kg]; see `rne.mass_matrix`."""
        return self.kernel(mass_matrix)(q)

    def forward_dynamics(
        self, q: ArrayLike, qd: ArrayLike, tau: ArrayLike, *, external: External | None = None, refine: int = 0
    ) -> Array:
        """Accelerations, shape (..., n) [rad/s^2 or m/s^2]; see `rne.forward_dynamics`.

        `refine` passes of iterative refinement win back digits lost to M's condition; a ValueError if that is no whole
        number, or the arrays are neither float32 nor float64.
        """
        if external is None and type(refine) is int and refine == 0 and not may_be_fast(qd):
            return self._forward()(q, qd, tau)
        with gather() as few:
            if external is None:
                qdd = self._forward()(q, qd, tau)
                warn_of_few_digits(self._model, (q, qd, tau), qdd)
            else:
                qdd = forward_dynamics(self._model, np.asarray(q), np.asarray(qd), np.asarray(tau), external=external)
            state = np.asarray(q), np.asarray(qd), np.asarray(tau)
            if refine != 0 or isinstance(refine, bool):
                qdd = refined(self._model, self.kernel(solve_mass_matrix), state, qdd, refine, external)
        give(few, WON if refine else 0.0)
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
            return self.kernel(bias_torque)(q, qd)
        return bias_torque(self._model, np.asarray(q), np.asarray(qd), external=external)

    def inverse_dynamics_derivatives(self, q: ArrayLike, qd: ArrayLike, qdd: ArrayLike) -> tuple[Array, Array, Array]:
        """Exact derivatives of the inverse dynamics.

        Parameters
        ----------
        q, qd, qdd : array_like, shape (..., n)
            Joint positions, rates and accelerations [rad or m, /s, /s^2].

        Returns
        -------
        dtau_dq, dtau_dqd, M : ndarray, shape (..., n, n)
            Row i is of torque i; M is the derivative by qdd.
        """
        slopes = self.kernel(inverse_dynamics, "q", "qd")(q, qd, qdd)
        dq, dqd = slopes[..., : self.n], slopes[..., self.n :]
        M = self.mass_matrix(np.asarray(q).astype(slopes.dtype, copy=False))
        return dq, dqd, np.broadcast_to(M, dq.shape).copy()

    def forward_dynamics_derivatives(self, q: ArrayLike, qd: ArrayLike, tau: ArrayLike) -> tuple[Array, Array, Array]:
        """Exact derivatives of the forward dynamics.

        Parameters
        ----------
        q, qd, tau : array_like, shape (..., n)
            Joint positions, rates and torques [rad or m, /s, N m or N].

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
        qdd = self.forward_dynamics(q, qd, tau)
        dq, dqd, M = self.inverse_dynamics_derivatives(q, qd, qdd)
        identity = np.broadcast_to(np.eye(self.n, dtype=qdd.dtype), dq.shape)
        right = np.concatenate([-dq, -dqd, identity], axis=-1)
        if M.dtype.char in "fdFD":
            solved = np.linalg.solve(M, right)
        else:  # LAPACK has no other types
            parent = self._model.coordinate_parent
            L, D = factorise(M, parent)
            rows = solve_factored(L[..., None, :, :], D[..., None, :], parent, np.swapaxes(right, -1, -2))
            solved = np.swapaxes(rows, -1, -2)
        n = self.n
        return solved[..., :n], solved[..., n : 2 * n], solved[..., 2 * n :]

    def linearize(self, q: ArrayLike, qd: ArrayLike, tau: ArrayLike) -> tuple[Array, Array]:
        """The motion near a state: d(q, qd)/dt changes by A d(q, qd) + B dtau.

        Parameters
        ----------
        q, qd, tau : array_like, shape (..., n)
            Joint positions, rates and torques [rad or m, /s, N m or N].

        Returns
        -------
        A : ndarray, shape (..., 2 n, 2 n)
        B : ndarray, shape (..., 2 n, n)

        Raises
        ------
        SingularMassMatrixError
            If M is singular to working precision.
        """
        dq, dqd, dtau = self.forward_dynamics_derivatives(q, qd, tau)
        zero = np.zeros_like(dq)
        identity = zero + np.eye(self.n, dtype=dq.dtype)
        A = np.concatenate([np.concatenate([zero, identity], -1), np.concatenate([dq, dqd], -1)], -2)
        return A, np.concatenate([zero, dtau], -2)

    def gravity_torque(self, q: ArrayLike) -> Array:
        """g(q), shape (..., n) [N m or N]; see `rne.gravity_torque`."""
        return self.kernel(gravity_torque)(q)

    def coriolis_torque(self, q: ArrayLike, qd: ArrayLike) -> Array:
        """C(q, qd) qd, shape (..., n) [N m or N]; see `rne.coriolis_torque`."""
        return self.kernel(coriolis_torque)(q, qd)

    def coriolis_matrix(self, q: ArrayLike, qd: ArrayLike) -> Array:
        """C(q, qd) of the Christoffel symbols, shape (..., n, n); see `rne.coriolis_matrix`."""
        return self.kernel(coriolis_matrix)(q, qd)

    def kinetic_energy(self, q: ArrayLike, qd: ArrayLike) -> Array:
        """Kinetic energy, shape (...) [J]; see `rne.kinetic_energy`."""
        return self.kernel(kinetic_energy)(q, qd)

    def potential_energy(self, q: ArrayLike) -> Array:
        """Potential energy, zero at the root link's origin, shape (...) [J]; see `rne.potential_energy`."""
        return self.kernel(potential_energy)(q)

    def momentum(self, q: ArrayLike, qd: ArrayLike) -> Array:
        """[Angular; linear] momentum about the root link's origin, shape (..., 6); see `rne.momentum`."""
        return self.kernel(momentum)(q, qd)

    def link_poses(self, q: ArrayLike) -> Array:
        """Pose of every link, shape (..., n_links, 4, 4) [1, m]; see `rne.link_poses`."""
        return self.kernel(link_poses)(q)

    def jacobian(self, q: ArrayLike, link: str) -> Array:
        """[omega; v] of a link's origin per joint rate, shape (..., 6, n); see `rne.jacobian`."""
        self._model.link_index(link)
        return self.kernel(jacobian, link=link)(q)

    def jacobian_rate(self, q: ArrayLike, qd: ArrayLike, link: str) -> Array:
        """Time derivative of the Jacobian, shape (..., 6, n); see `rne.jacobian_rate`."""
        self._model.link_index(link)
        return self.kernel(jacobian_rate, link=link)(q, qd)

    def recursion(self, q: ArrayLike, qd: ArrayLike, qdd: ArrayLike, *, external: External | None = None) -> Recursion:
        """Every omega, alpha, a, f and tau of every link; see `rne.recursion`."""
        return recursion(self._model, np.asarray(q), np.asarray(qd), np.asarray(qdd), external=external)

    def with_payload(
        self,
        mass: float,
        com: ArrayLike = (0.0, 0.0, 0.0),
        inertia: ArrayLike | None = None,
        link: str | None = None,
    ) -> Robot:
        """The robot with a rigid body bolted to a link, the last one if not said; see `rne.with_payload`."""
        return Robot(edit.with_payload(self._model, mass, com, inertia, self.link_names[-1] if link is None else link))

    def locked(self, positions: Mapping[str, float]) -> Robot:
        """The smaller robot with some joints fixed, {joint: position}; see `rne.locked`."""
        return Robot(edit.locked(self._model, positions))

    def mounted(self, rpy: ArrayLike) -> Robot:
        """The robot with its root link turned in the world; see `rne.mounted`."""
        return Robot(edit.mounted(self._model, rpy))

    def __repr__(self) -> str:
        model = self._model
        lines = [
            f"Robot {model.name!r}: {model.n} joints, {len(model.link_names)} links, "
            f"{model.mass.sum():.6g} kg moving, gravity {model.gravity.tolist()} m/s^2"
        ]
        if model.has_mimics:
            lines.append(f"  {model.nb - model.n} further joints mimic these")
        if model.damping.any() or model.friction.any():
            lines.append("  damping and friction of its <dynamics> are on record, not applied")
        return "\n".join(lines)
