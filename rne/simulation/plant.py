"""The equations of motion as a solver calls them: f(t, x) and its Jacobian, with calls counted and laws checked."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from ..basics.spatial import Array
from ..dynamics.verdict import SOUND, Verdict
from ..errors import NotFiniteError
from ..kernels.python_backend import Refused
from .equations_of_motion import RightHandSide


class Plant:
    """f(t, x) for a solver, counting its calls; an untraced law is called for the drives' torques.

    Parameters
    ----------
    rhs : RightHandSide
    law : callable or None
        f(t, q, qd) for the torques where `rhs.torque_given`.
    law_name : {"controller", "torque"}
        The argument that the user gave the law as, for error messages.

    Attributes
    ----------
    verdict : Verdict
        The loss of precision in the worst state evaluated so far.
    """

    def __init__(self, rhs: RightHandSide, law: Callable[..., Any] | None, law_name: str = "controller") -> None:
        self.rhs = rhs
        self.robot = rhs.robot
        self.law, self.law_name = law, law_name
        self.evaluations = 0
        self.verdict = SOUND
        self.kernel = rhs.kernel
        self._state_function = self.kernel.state_function_at_any_rate if self.kernel.is_unrolled else None

    def note(self, verdict: Verdict) -> None:
        """Raise an error; keep a loss if it is the worst so far."""
        if verdict.error is not None:
            raise verdict.error
        self.verdict = self.verdict.worse(verdict.with_state(lambda state: ()))

    def torque(self, t: float, x: Array) -> Array | None:
        """Torques that the law returns, checked: a NaN or a wrong shape is named with its time."""
        if self.law is None:
            return None
        n = self.robot.n
        returned = self.law(t, x[:n].copy(), x[n : 2 * n].copy())  # a law may modify its arguments
        try:
            tau = np.asarray(returned)
        except ValueError:
            raise ValueError(
                f"`{self.law_name}` must return shape ({n},), got rows of unequal length at t = {t:.6g} s"
            ) from None
        if tau.dtype.kind not in "fiu":
            raise ValueError(f"`{self.law_name}` must return real numbers, got dtype {tau.dtype} at t = {t:.6g} s")
        if tau.shape != (n,):
            raise ValueError(f"`{self.law_name}` must return shape ({n},), got {tau.shape} at t = {t:.6g} s")
        if not np.isfinite(tau).all():
            i = int(np.argmin(np.isfinite(tau)))
            raise NotFiniteError(f"torque of {self.robot.joint_names[i]!r} is {tau[i]} at t = {t:.6g} s", t)
        return tau.astype(np.float64)

    def __call__(self, t: float, x: Array) -> Array:
        """dx/dt."""
        self.evaluations += 1
        if self.law is None:
            return self.rates(t, x, None)
        self._check_state(t, x)
        return self.rates(t, x, self.torque(t, x))

    def rates(self, t: float, x: Array, u: Array | None) -> Array:
        """dx/dt under given torques."""
        if self._state_function is not None:
            try:
                if u is None:
                    return self._state_function((t,), x.tolist())
                return self._state_function((t,), x.tolist(), u.tolist())
            except Refused:
                pass  # examined below, by the recursion
        self._check_state(t, x)
        try:
            rates, verdict = self.rhs.evaluate(self.robot.model, np.array([t]), x, u)
        except NotFiniteError as error:
            raise NotFiniteError(f"{error} at t = {t:.6g} s", t) from None
        self.note(verdict)
        return rates

    def all_rates(self, t: Array, X: Array, u: Array | None = None) -> Array:
        """dx/dt at many times, shapes (T,) and (T, size), for laws that are traced or torques that are given."""
        rates, verdict = self.kernel.evaluate(t[:, None], X) if u is None else self.kernel.evaluate(t[:, None], X, u)
        self.note(verdict)
        return rates

    def _check_state(self, t: float, x: Array) -> None:
        if not np.isfinite(x[: 2 * self.robot.n]).all():
            raise NotFiniteError(f"state is not finite at t = {t:.6g} s", t)

    def jacobian(self, t: float, x: Array) -> Array:
        """df/dx: dynamics, friction and traced laws exactly, called laws by forward differences.

        Counted as 2 n evaluations, the cost of differences.
        """
        self._check_state(t, x)
        self.evaluations += 2 * self.robot.n
        u = self.torque(t, x)
        return self._jacobian(np.array([t]), x, u, None if u is None else self._law_slopes(t, x, u))

    def jacobians(self, t: Array, X: Array) -> Array:
        """df/dx at many times, shapes (T,) and (T, size)."""
        if self.law is None:
            return self._jacobian(t[:, None], X, None, None)
        return np.array([self.jacobian(float(time), x) for time, x in zip(t, X, strict=True)])

    def _jacobian(self, t: Array, x: Array, u: Array | None, by_law: Array | None) -> Array:
        n, size = self.robot.n, x.shape[-1]
        torques = () if u is None else (u,)
        net = self.rhs.torques.kernel(t, x, *torques)[..., :n]
        slopes = self.rhs.torques.slopes(t, x, *torques)
        by_x = slopes[..., :size]
        if by_law is not None:
            by_x = by_x + slopes[..., size:] @ by_law
        dqdd, verdict = self.robot.kernels.forward_derivatives(x[..., :n], x[..., n : 2 * n], net)
        self.note(verdict)
        J = np.zeros((*x.shape, size))
        J[..., :n, n : 2 * n] = np.eye(n)
        J[..., n : 2 * n, :] = dqdd[..., 2 * n :] @ by_x[..., :n, :]
        J[..., n : 2 * n, : 2 * n] += dqdd[..., : 2 * n]
        J[..., 2 * n :, :] = by_x[..., n:, :]
        return J

    def _law_slopes(self, t: float, x: Array, u: Array) -> Array:
        """Derivatives of a called law's torques by the state, shape (n, size)."""
        slopes = np.zeros((len(u), len(x)))
        for j in range(2 * self.robot.n):
            moved = x.copy()
            moved[j] += np.sqrt(np.finfo(float).eps) * max(abs(x[j]), 1.0)
            slopes[:, j] = (np.asarray(self.torque(t, moved)) - u) / (moved[j] - x[j])
        return slopes
