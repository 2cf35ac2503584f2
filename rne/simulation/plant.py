"""The equations of motion as a solver calls them: f(t, x) and its Jacobian, with calls counted and laws checked."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from math import isfinite
from typing import Any

import numpy as np

from ..basics.arrays import real_numbers
from ..basics.spatial import Array
from ..dynamics.quantity import OK, PrecisionStatus
from ..errors import NotFiniteError
from ..kernels.program import NeedsRecursion
from .equations_of_motion import RightHandSide
from .events import Event
from .law import torques_and_rates


class System:
    """Equations of motion that a solver integrates, and what may switch in them: nothing by itself.

    `Plant` is that of a scene, `DryPlant` of one with friction that sticks, `Hamilton` of a free motion in (q, p).

    Attributes
    ----------
    events : sequence of callable
        What ends a segment, beside samples, breaks and stops.
    at_rest : ndarray or None
        Entries of the state that are held at zero.
    has_changed : bool
        True if the equations changed at the beginning of the segment, so that the solver starts anew.
    note : str
        For the message of a run.
    """

    events: Sequence[Event] = ()
    at_rest: Array | None = None
    has_changed = False
    note = ""

    def start(self, x: Array) -> Array:
        """The solver's state at the start of a run, of (q, qd, z)."""
        return x

    def begin(self, t: float, x: Array, span: tuple[float, float]) -> None:
        """Prepare for a segment that begins at t; torques are evaluated within `span`."""

    def after(self, event: Event, x: Array) -> Array:
        """The state with which motion goes on after one of `events`."""
        return x

    def longest_step(self, duration: float) -> float:
        """Longest step that the solver may take in a run of this duration [s]."""
        return float("inf")

    def reported(self, x: Array) -> Array:
        """The state to report of a solver's state."""
        return x

    def accelerations_at(self, t: Array, X: Array, same: float) -> Array | None:
        """Accelerations to report, (T, n), at times (T,), where they do not follow from time, state and torques.

        Times up to a relative rounding `same` before a sample count as being there.
        """
        return None

    def states(self, X: Array) -> Array:
        """All reported states, shape (T, size), as (q, qd, z)."""
        return X


class Plant(System):
    """f(t, x) for a solver, counting its calls; an untraced law is called for the drives' torques.

    Nothing in it switches by itself; see `DryPlant` for what does.

    Parameters
    ----------
    rhs : RightHandSide
    law : callable or None
        f(t, q, qd) for the torques where `rhs.torque_given` and the controller is not sampled.
    law_name : {"controller", "torque"}
        The argument that the user gave the law as, for error messages.

    Attributes
    ----------
    held : ndarray, shape (n,), or None
        The torques held since the last sample, of a sampled controller.
    span : (float, float)
        Times within which torques are evaluated: just inside the segment, on this side of the breaks at its ends.
    verdict : PrecisionStatus
        The loss of precision in the worst state evaluated so far.
    """

    def __init__(self, rhs: RightHandSide, law: Callable[..., Any] | None, law_name: str = "controller") -> None:
        self.rhs = rhs
        self.robot = rhs.robot
        self.law, self.law_name = law, law_name
        self.held: Array | None = None
        self.span = (-np.inf, np.inf)
        self.evaluations = 0
        self._time = np.zeros(1)  # t as an argument of the kernel
        self.verdict = OK
        self.kernel = rhs.kernel
        self._state_function = self.kernel.state_function_unguarded if self.kernel.is_unrolled else None

    @property
    def is_compiled(self) -> bool:
        """True if no law is called and the kernel is machine code."""
        return self.law is None and self.kernel.is_unrolled and self.robot.engine == "numba"

    @property
    def is_conservative(self) -> bool:
        """True without drives and friction: nothing damps the motion."""
        return self.rhs.friction is None and self.rhs.law is None and not self.rhs.torque_given

    def begin(self, t: float, x: Array, span: tuple[float, float]) -> None:
        """Evaluate torques within the segment that begins here."""
        self.span = span

    def note_loss(self, verdict: PrecisionStatus) -> None:
        """Raise an error; keep a loss if it is the worst so far."""
        if verdict.error is not None:
            raise verdict.error
        self.verdict = self.verdict.worse(verdict.with_state(lambda state: ()))

    def torque(self, t: float, x: Array) -> Array | None:
        """Torques that the law returns, and the rates of its states; a NaN or a wrong shape is named with its time."""
        if self.law is None:
            return self.held
        n = self.robot.n
        arguments = x[:n].copy(), x[n : 2 * n].copy()  # a law may modify them
        if self.rhs.controller_states:
            return self._with_states(t, self.law(t, *arguments, x[2 * n : 2 * n + self.rhs.controller_states].copy()))
        returned = self.law(t, *arguments)
        plain = type(returned) is np.ndarray and returned.dtype == np.float64 and returned.shape == (n,)
        return returned.copy() if plain and isfinite(sum(returned.tolist())) else self._checked(t, returned)

    def _with_states(self, t: float, returned: Any) -> Array:
        """What a law with states returned: torques, then the rates of its states."""
        u, rates = torques_and_rates(returned)
        m = self.rhs.controller_states
        slopes = real_numbers("rates of the controller's states", rates, f"({m},)")
        if slopes.shape != (m,):
            raise ValueError(f"`controller` must return rates of its states of shape ({m},), got {slopes.shape}")
        return np.concatenate([self._checked(t, u), slopes])

    def _checked(self, t: float, returned: Any) -> Array:
        """What a law returned as an array of torques."""
        n = self.robot.n
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
        first, last = self.span
        t = first if t < first else last if t > last else t
        if self.law is None:
            return self.rates(t, x, self.held)
        self._check_state(t, x)
        return self.rates(t, x, self.torque(t, x))

    def rates(self, t: float, x: Array, u: Array | None) -> Array:
        """dx/dt under given torques."""
        if self._state_function is not None:
            try:
                self._time[0] = t
                if u is None:
                    return self._state_function(self._time, x)
                return self._state_function(self._time, x, u)
            except NeedsRecursion:
                pass  # examined below, by the recursion
        self._check_state(t, x)
        try:
            rates, verdict = self.rhs.evaluate(self.robot.model, np.array([t]), x, u)
        except NotFiniteError as error:
            raise self._named(error, t, x) from None
        self.note_loss(verdict)
        return rates

    def _named(self, error: NotFiniteError, t: float, x: Array) -> NotFiniteError:
        """The error of rates that are not finite: the traced law's torque, if that is not finite itself."""
        drives = None if self.rhs.law is None else self.rhs.drives(np.array([t]), x, None)[0]
        if drives is not None and not np.isfinite(np.asarray(drives, dtype=float)).all():
            i = int(np.argmin(np.isfinite(np.asarray(drives, dtype=float))))
            return NotFiniteError(f"torque of {self.robot.joint_names[i]!r} is {drives[i]} at t = {t:.6g} s", t)
        return NotFiniteError(f"{error} at t = {t:.6g} s", t)

    def all_rates(self, t: Array, X: Array, u: Array | None = None) -> Array:
        """dx/dt at many times, shapes (T,) and (T, size), for laws that are traced or torques that are given."""
        rates, verdict = self.kernel.evaluate(t[:, None], X) if u is None else self.kernel.evaluate(t[:, None], X, u)
        self.note_loss(verdict)
        return rates

    @property
    def integrated(self) -> tuple[str, ...]:
        """The energies to integrate: the work of torques that are held is exact without."""
        return tuple(name for name in self.rhs.ledger if name != "drives" or self.held is None)

    def powers(self, t: Array, X: Array) -> Array:
        """Powers of the `integrated` at many times, shapes (T,) and (T, size); held torques have none among them."""
        u = None if self.held is None else np.zeros((len(t), self.robot.n))
        if self.law is not None:
            u = self.torques_at(t, X)
        arguments = (t[:, None], X) if u is None else (t[:, None], X, u)
        found, _ = self.rhs.torques.kernel.evaluate(*arguments)
        return found[:, -len(self.integrated) :]

    def drive_torques(self, t: Array, X: Array) -> Array | None:
        """Torques of the drives at many times, shape (T, n); None without drives."""
        u = None if self.law is None else self.torques_at(t, X)
        return self.drives_under(t, X, u)

    def drives_under(self, t: Array, X: Array, u: Array | None) -> Array | None:
        """Torques of the drives, within their limits, of a traced law or of torques `u`; None without drives."""
        if self.rhs.law is not None and self.rhs.friction is None:  # the kernel's net torques are the drives' then
            return self.rhs.torques.kernel(t[:, None], X)[:, : self.robot.n]
        drives, _ = self.rhs.drives(t[:, None], X, u)
        return None if drives is None else np.asarray(drives, dtype=np.float64)

    def torques_at(self, t: Array, X: Array) -> Array:
        """Torques of a called law at many times, and the rates of its states, shape (T, n + m)."""
        found = [self.torque(float(time), x) for time, x in zip(t, X, strict=True)]
        return np.array(found).reshape(len(t), -1)

    def _check_state(self, t: float, x: Array) -> None:
        if not isfinite(sum(x.tolist())) and not np.isfinite(x[: 2 * self.robot.n]).all():
            raise NotFiniteError(f"state is not finite at t = {t:.6g} s", t)

    def jacobian(self, t: float, x: Array) -> Array:
        """df/dx: dynamics, friction and traced laws exactly, called laws by forward differences.

        Counted as one evaluation per component of the state, the cost of differences.
        """
        self._check_state(t, x)
        self.evaluations += len(x)
        t = min(max(t, self.span[0]), self.span[1])
        u = self.torque(t, x)
        by_law = None if self.law is None or u is None else self._law_slopes(t, x, u)
        return self._jacobian(np.array([t]), x, self.rates(t, x, u), u, by_law)

    def jacobians(self, t: Array, X: Array) -> Array:
        """df/dx at many times, shapes (T,) and (T, size)."""
        if self.law is None:
            return self._jacobian(t[:, None], X, self.all_rates(t, X), None, None)
        return np.array([self.jacobian(float(time), x) for time, x in zip(t, X, strict=True)])

    def _jacobian(self, t: Array, x: Array, rates: Array, u: Array | None, by_law: Array | None) -> Array:
        """From M qdd + h - torques = 0: M dqdd = -d(M qdd + h - torques) at constant qdd."""
        n, size = self.robot.n, x.shape[-1]
        qdd = rates[..., n : 2 * n]
        residual = self.rhs.residual
        kernel = residual.slopes_in_time if self.is_compiled else residual.slopes
        slopes = kernel(t, x, qdd, *(() if u is None else (u,)))
        by_x, M = slopes[..., :size], slopes[..., :n, size : size + n]
        if by_law is not None:
            by_x = by_x + slopes[..., size + n :] @ by_law
        J = np.zeros((*x.shape, size))
        J[..., range(n), range(n, 2 * n)] = 1.0
        J[..., n : 2 * n, :] = np.linalg.solve(M, -by_x[..., :n, :])
        if size > 2 * n:
            J[..., 2 * n :, :] = by_x[..., n:, :]
        return J

    def _law_slopes(self, t: float, x: Array, u: Array) -> Array:
        """Derivatives of a called law's torques and of the rates of its states, shape (n + m, size)."""
        slopes = np.zeros((len(u), len(x)))
        for j in range(len(x)):
            moved = x.copy()
            moved[j] += np.sqrt(np.finfo(float).eps) * max(abs(x[j]), 1.0)
            slopes[:, j] = (np.asarray(self.torque(t, moved)) - u) / (moved[j] - x[j])
        return slopes
