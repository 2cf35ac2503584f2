"""The right-hand side of a scene: one function of time and state, traced into one kernel.

The state x is q, qd, the controller's own states z, and the energies of the ledger: what the drives have supplied, what
viscous and Coulomb friction have taken. An energy that the scene cannot have is not there.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import cached_property
from typing import Any

import numpy as np

from .dynamics.checks import check_result
from .dynamics.forward import raise_if_singular
from .dynamics.precision import DOUBTFUL, pivots_below, warn_of_few_digits
from .elementwise import clip
from .errors import NotFiniteError
from .friction import Friction
from .robot import Robot
from .spatial import Array
from .tape.kernel import Kernel

TRIALS = 3  # random states on which a traced law must agree with a call of it
AGREE = 1e-9  # relative


class Torques:
    """What acts on the arm's joints and what else changes with time: net torques, dz/dt, powers.

    Parameters
    ----------
    arm : Robot
    friction : Friction or None
    limit : ndarray, shape (n,), or None
        Largest torque of each drive.
    law : callable or None
        A traceable law.
    given : bool
        True if the drives' torques are an argument, `u`; without `given` and `law` there are no drives.
    """

    groups = True
    __name__ = "torques"

    def __init__(self, arm: Robot, friction: Friction | None, limit: Array | None, law: Any, given: bool) -> None:
        self.arm, self.friction, self.limit, self.law, self.given = arm, friction, limit, law, given
        self.own_states = int(getattr(law, "states", 0))
        self.ledger = tuple(name for name, there in self._entries().items() if there)
        self.widths: Mapping[str, int] = {"t": 1, "x": self.size}
        if given:
            self.widths = {**self.widths, "u": arm.n}

    def __getstate__(self) -> dict[str, Any]:
        return {name: value for name, value in self.__dict__.items() if not isinstance(value, Kernel | Torques)}

    def _entries(self) -> dict[str, bool]:
        f = self.friction
        return {
            "drives": self.law is not None or self.given,
            "viscous": f is not None and bool(np.any(f.viscous) or np.any(f.viscous_back)),
            "coulomb": f is not None and bool(np.any(f.coulomb) or np.any(f.coulomb_back)),
        }

    @property
    def size(self) -> int:
        """Length of the state."""
        return 2 * self.arm.n + self.own_states + len(self.ledger)

    def drives(self, t: Any, x: Array, u: Array | None) -> tuple[Array | None, Array | None]:
        """Torques of the drives within their limits, and the rates of the law's own states."""
        n = self.arm.n
        q, qd = x[..., :n], x[..., n : 2 * n]
        rates = None
        if self.law is not None:
            z = (x[..., 2 * n : 2 * n + self.own_states],) if hasattr(self.law, "states") else ()
            u = self.law(t, q, qd, *z)
            if z:
                u, rates = u
            u = _shaped_like(u, q)
        if u is not None and self.limit is not None:
            u = clip(u, -self.limit, self.limit)
        return u, rates

    def parts(self, t: Any, x: Array, u: Array | None) -> tuple[Array, list[Array]]:
        """Net torques, and the other rates one after the other."""
        n = self.arm.n
        qd = x[..., n : 2 * n]
        u, rates = self.drives(t, x, u)
        net, further = 0 * qd if u is None else u, [] if rates is None else [rates]
        if u is not None:
            further.append((u * qd).sum(-1, keepdims=True))
        for name in ("viscous", "coulomb"):
            if self.friction is not None and name in self.ledger:
                torque = getattr(self.friction, f"{name}_torque")(qd)
                net = net - torque
                further.append((torque * qd).sum(-1, keepdims=True))
        return net, further

    def core(self, model: Any, t: Array, x: Array, u: Array | None = None) -> Array:
        """[net torques, dz/dt, powers], traced."""
        net, further = self.parts(t, x, u)
        return np.concatenate([net, *further], axis=-1)

    def __call__(self, model: Any, t: Array, x: Array, u: Array | None = None) -> Array:
        """The same, with numbers."""
        with np.errstate(all="ignore"):
            result = self.core(model, np.asarray(t), np.asarray(x), u)
        check_result("the torques", result)
        return result

    @cached_property
    def kernel(self) -> Kernel:
        """The traced function, checked against calls of the law."""
        kernel = Kernel(self, self.arm.model, {})  # type: ignore[arg-type]
        if self.law is not None:
            _compare_law(self, kernel)
        return kernel

    @cached_property
    def slopes(self) -> Kernel:
        """Its exact derivatives by x, and by u where that is given."""
        return Kernel(self, self.arm.model, {}, ("x", "u") if self.given else ("x",))  # type: ignore[arg-type]


class RightHandSide(Torques):
    """dx/dt of a scene; see `Torques` for its parameters."""

    __name__ = "right_hand_side"

    def core(self, model: Any, t: Array, x: Array, u: Array | None = None) -> Any:
        """(dx/dt, pivots, diagonal of M), traced."""
        n = self.arm.n
        q, qd = x[..., :n], x[..., n : 2 * n]
        net, further = self.parts(t, x, u)
        qdd, pivots, diagonal = self.arm.forward_method.core(model, q, qd, net)
        return np.concatenate([qd, qdd, *further], axis=-1), pivots, diagonal

    def __call__(self, model: Any, t: Array, x: Array, u: Array | None = None) -> Array:
        """dx/dt with numbers, by the recursion; SingularMassMatrixError or NotFiniteError say what is wrong."""
        x = np.asarray(x)
        typed = model if x.dtype == model.mass.dtype else model.astype(x.dtype)
        with np.errstate(all="ignore"):
            rates, pivots, diagonal = self.core(typed, np.asarray(t), x, u)
        n = self.arm.n
        raise_if_singular(typed, pivots, diagonal, x[..., :n])
        check_result("the right-hand side", rates)
        doubtful = np.asarray(pivots_below(DOUBTFUL, pivots, diagonal).any(axis=-1))
        if doubtful.any():
            state = x[..., :n], x[..., n : 2 * n], self.parts(np.asarray(t), x, u)[0]
            warn_of_few_digits(typed, state, np.asarray(rates[..., n : 2 * n]), doubtful)
        return np.asarray(rates)

    @cached_property
    def torques(self) -> Torques:
        """The torques alone, for Jacobians and reports."""
        return Torques(self.arm, self.friction, self.limit, self.law, self.given)


def _shaped_like(u: Any, q: Array) -> Array:
    """A traced law's torques for every state; a constant one is the same for all."""
    try:
        torques = np.asarray(u)
    except ValueError:
        torques = np.asarray(None)
    if torques.shape != q.shape and (torques.shape != q.shape[-1:] or (torques.dtype == object and torques.size == 0)):
        raise ValueError(
            f"`controller` must return shape (..., {q.shape[-1]}) for states of that shape, got {torques.shape}"
        )
    return torques + 0 * q if torques.shape != q.shape else torques


def _compare_law(torques: Torques, kernel: Kernel) -> None:
    """A law with memory, noise or a table would be frozen by tracing: it must agree with calls of it."""
    rng = np.random.default_rng(0)
    for _ in range(TRIALS):
        t, x = rng.uniform(0, 1, 1), rng.uniform(-1, 1, torques.size)
        traced = kernel(t, x)
        called = torques(torques.arm.model, t, x)
        worst = float(np.abs(traced - called).max()) if traced.size else 0.0
        if not np.isfinite(worst):
            raise ValueError("`controller` gives torques that are not finite")
        if not worst <= AGREE * max(1.0, float(np.abs(called).max(initial=0.0))):
            raise ValueError(
                f"the controller is marked traceable, but traced it gives torques that differ by {worst:.3g} from a "
                "call of it: it has memory, noise or a branch; leave the mark off and it is called"
            )


class Plant:
    """f(t, x) for a solver, counting its calls; an untraced law is called for the drives' torques.

    Parameters
    ----------
    rhs : RightHandSide
    law : callable or None
        f(t, q, qd) for the torques where `rhs.given`.
    """

    def __init__(self, rhs: RightHandSide, law: Callable[..., Any] | None) -> None:
        self.rhs = rhs
        self.robot = rhs.arm
        self.law = law
        self.evaluations = 0
        self.kernel = rhs.kernel
        self._single = self.kernel.single if self.kernel.is_unrolled else None

    def torque(self, t: float, x: Array) -> Array | None:
        """What the law asks for, checked: a NaN or a wrong shape is named with its time."""
        if self.law is None:
            return None
        n = self.robot.n
        tau = np.asarray(self.law(t, x[:n].copy(), x[n : 2 * n].copy()))  # a law may change what it is given
        if tau.dtype.kind not in "fiu":
            raise ValueError(f"`torque` must return real numbers, got dtype {tau.dtype} at t = {t:.6g} s")
        if tau.shape != (n,):
            raise ValueError(f"`torque` must return shape ({n},), got {tau.shape} at t = {t:.6g} s")
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
        if self._single is not None:
            try:
                if u is None:
                    return self._single((t,), x.tolist())
                return self._single((t,), x.tolist(), u.tolist())
            except (ValueError, ArithmeticError):
                pass  # something is wrong: said by the recursion
        self._check_state(t, x)
        try:
            return self.rhs(self.robot.model, np.array([t]), x, u)
        except NotFiniteError as error:
            raise NotFiniteError(f"{error} at t = {t:.6g} s", t) from None

    def _check_state(self, t: float, x: Array) -> None:
        if not np.isfinite(x[: 2 * self.robot.n]).all():
            raise NotFiniteError(f"state is not finite at t = {t:.6g} s", t)

    def jacobian(self, t: float, x: Array) -> Array:
        """df/dx: dynamics, friction and traced laws exactly, called laws by forward differences.

        Counted as one evaluation for each component of the state, as differences would cost.
        """
        self._check_state(t, x)
        self.evaluations += 2 * self.robot.n
        u = self.torque(t, x)
        return self._jacobian(np.array([t]), x, u, None if u is None else self._law_slopes(t, x, u))

    def jacobians(self, t: Array, X: Array) -> Array:
        """The same at many times, shapes (T,) and (T, size)."""
        if self.law is None:
            return self._jacobian(t[:, None], X, None, None)
        return np.array([self.jacobian(float(time), x) for time, x in zip(t, X, strict=True)])

    def _jacobian(self, t: Array, x: Array, u: Array | None, by_law: Array | None) -> Array:
        n, size = self.robot.n, x.shape[-1]
        given = () if u is None else (u,)
        net = self.rhs.torques.kernel(t, x, *given)[..., :n]
        slopes = self.rhs.torques.slopes(t, x, *given)
        by_x = slopes[..., :size]
        if by_law is not None:
            by_x = by_x + slopes[..., size:] @ by_law
        dq, dqd, dtau = self.robot.forward_dynamics_derivatives(x[..., :n], x[..., n : 2 * n], net)
        J = np.zeros((*x.shape, size))
        J[..., :n, n : 2 * n] = np.eye(n)
        J[..., n : 2 * n, :] = dtau @ by_x[..., :n, :]
        J[..., n : 2 * n, :n] += dq
        J[..., n : 2 * n, n : 2 * n] += dqd
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
