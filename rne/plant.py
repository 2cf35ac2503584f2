"""The right-hand side of a simulation: x = (q, qd), and the drives' work if there are drives."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike

from .errors import NotFiniteError
from .robot import Robot
from .spatial import Array


class Plant:
    """dx/dt = f(t, x) of a robot under a torque law, counting its calls.

    Parameters
    ----------
    robot : Robot
    law : callable
        f(t, q, qd) -> torques, shape (n,).
    works : bool
        False if the drives do nothing, so that no work is summed.
    """

    def __init__(self, robot: Robot, law: Callable[[float, Array, Array], ArrayLike], *, works: bool) -> None:
        self.robot = robot
        self.law = law
        self.works = works
        self.evaluations = 0

    def torque(self, t: float, q: Array, qd: Array) -> Array:
        """The law's torques, checked: a NaN or a wrong shape is named with its time."""
        tau = np.asarray(self.law(t, q.copy(), qd.copy()))  # a law may change what it is given
        if tau.dtype.kind not in "fiu":
            raise ValueError(f"`torque` must return real numbers, got dtype {tau.dtype} at t = {t:.6g} s")
        tau = tau.astype(np.float64)
        if tau.shape != (self.robot.n,):
            raise ValueError(f"`torque` must return shape ({self.robot.n},), got {tau.shape} at t = {t:.6g} s")
        if not np.isfinite(tau).all():
            i = int(np.argmin(np.isfinite(tau)))
            raise NotFiniteError(f"torque of {self.robot.joint_names[i]!r} is {tau[i]} at t = {t:.6g} s", t)
        return tau

    def _split(self, t: float, x: Array) -> tuple[Array, Array]:
        n = self.robot.n
        if not np.isfinite(x[: 2 * n]).all():
            raise NotFiniteError(f"state is not finite at t = {t:.6g} s", t)
        return x[:n], x[n : 2 * n]

    def __call__(self, t: float, x: Array) -> Array:
        """dx/dt."""
        self.evaluations += 1
        q, qd = self._split(t, x)
        tau = self.torque(t, q, qd)
        qdd = self.robot.forward_dynamics(q, qd, tau)
        if not self.works:
            return np.concatenate([qd, qdd])
        with np.errstate(over="ignore", invalid="ignore"):
            power = tau @ qd
        if not np.isfinite(power):
            raise NotFiniteError(f"the power of the drives overflows at t = {t:.6g} s", t)
        return np.concatenate([qd, qdd, [power]])

    def jacobian(self, t: float, x: Array) -> Array:
        """df/dx: the dynamics exactly, the law by forward differences.

        SciPy's own differences fail on a cyclic coordinate, for which no step is ever large enough. Counted as one
        evaluation for each component of the state, as differences would cost.
        """
        n = self.robot.n
        q, qd = self._split(t, x)
        tau = self.torque(t, q, qd)
        dtau = self._law_derivatives(t, x[: 2 * n], tau) if self.works else np.zeros((2 * n, n))
        self.evaluations += 2 * n
        A, B = self.robot.linearize(q, qd, tau)
        J = np.zeros((len(x), len(x)))
        J[: 2 * n, : 2 * n] = A + B @ dtau.T
        if self.works:
            J[-1, : 2 * n] = dtau @ qd
            J[-1, n : 2 * n] += tau
        return J

    def _law_derivatives(self, t: float, state: Array, tau: Array) -> Array:
        """Row j: derivative of the torques by component j of (q, qd)."""
        n = self.robot.n
        rows = np.zeros((2 * n, n))
        for j, x in enumerate(state):
            moved = state.copy()
            moved[j] += np.sqrt(np.finfo(float).eps) * max(abs(x), 1.0)
            rows[j] = (self.torque(t, moved[:n], moved[n:]) - tau) / (moved[j] - x)
        return rows
