"""Equations of motion for integrators: f(t, x) and its Jacobian, with counted calls and checked laws."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from copy import copy, deepcopy
from functools import cached_property, partial
from math import isfinite
from typing import Any

import numpy as np

from ..basics.arrays import real_array
from ..basics.numbers import part_of
from ..basics.piecewise import pieces_at
from ..basics.spatial import Array
from ..control.traced_law import call_law
from ..dynamics.precision import velocity_bound
from ..dynamics.quantity import OK, PrecisionStatus
from ..errors import NotFiniteError, RneError
from ..integrators.base import Implicit
from ..integrators.step_control import EPS
from ..kernels.cache import KernelCache
from ..kernels.soundness import NeedsRecursion
from ..robot import Robot
from .events import Event
from .scene_dynamics import SceneDynamics

NONE: Mapping[str, Array] = {}


class Plant:
    """Function dx/dt of a scene with its kernels; events that switch it are in `DryPlant`.

    The robot has payload, armature and locked joints. The law, f(t, q, qd) for the torques where `dynamics.inputs` is
    "called", has the name of the argument that the user gave it as, "controller" or "torque".
    """

    events: Sequence[Event] = ()  # what ends a segment in addition to samples, breaks and stops
    modes: Array | None = None  # of friction that sticks, (2 n,): inputs of the equations after the torques
    has_changed = False  # at the beginning of the segment, so that the solver starts anew
    note = ""  # for the message of a run

    def __init__(
        self,
        dynamics: SceneDynamics,
        robot: Robot,
        law: Callable[..., Any] | None = None,
        law_name: str = "controller",
        kernels: KernelCache | None = None,
    ) -> None:
        self.dynamics, self.robot, self.law, self.law_name = dynamics, robot, law, law_name
        self.numbers = dynamics.vector  # of the scene, the last argument of its kernels
        self.table = dynamics.table  # of the motion that a traced law holds
        self.kernels = kernels or robot.kernels  # of another robot if bodies are numbers of the scene
        self.counted = dynamics.counted  # entries of the state that are held to the tolerances
        self.width = dynamics.size  # of what the kernel gives
        self.sticks = dynamics.sticks  # True if friction can hold joints
        # True without drives and friction: nothing damps the motion
        self.is_conservative = not dynamics.ledger and dynamics.friction is None
        self.kernel = kernel = self.kernels.scene_kernel(self._function)
        # Of one state, without the check of joint velocities; None where the recursion itself runs
        self._state_function = kernel.state_function_at(self.numbers) if kernel.is_unrolled else None
        self.sampled: Array | None = None  # torques (n,) of a sampled controller since its last sample
        # As it is now: a law may be changed before someone asks for torques.
        self._law_kernel = None if dynamics.law is None else self.kernels.scene_kernel(dynamics.law.outputs)
        self.evaluations, self.status = 0, OK  # the status of the worst state so far
        self.span = (-np.inf, np.inf)  # times at which torques are evaluated: inside the segment, between its breaks
        self._time = np.zeros(1)  # t as an argument of the kernel

    @property
    def _function(self) -> Any:
        return self.dynamics.right_hand_side

    @property
    def integral_scale(self) -> float:
        """Kinetic energy with all joints at 1 rad/s or m/s: the absolute scale of energy errors [J]."""
        return float(self.robot.kernels.typical_inertia.sum()) / 2 or 1.0

    @property
    def held(self) -> Array | None:
        """Inputs of the equations held over the segment: torques, and the modes of friction that sticks."""
        return with_modes(self.sampled, self.modes)

    @property
    def is_compiled(self) -> bool:
        """True if no law is called and the kernel is machine code."""
        return self.law is None and self.kernel.is_unrolled and self.kernel.engine == "numba"

    @cached_property
    def implicit(self) -> Implicit:
        """Equations of motion with their mass matrix, for Rodas5P, which also needs the time."""
        kernel = self.kernels.scene_kernel(self.dynamics.residual, "x", "a", "t")
        return Implicit(self.dynamics.n, kernel)

    def keep_kernels(self) -> None:
        """Register the kernels of this run in the cache, so that it can be repeated with the law as it was."""
        _, slopes = self.__dict__.get("implicit", (0, None))
        for kernel in (self.kernel, self._law_kernel, slopes):
            if kernel is not None:
                self.kernels.keep_scene(kernel)

    def begin(self, t: float, x: Array, span: tuple[float, float]) -> None:
        """Prepare for a segment that begins at t; torques are evaluated within `span`."""
        self.span = span

    def apply_event(self, event: Event, x: Array) -> Array:
        """State after one of `events`."""
        return x

    def longest_step(self, duration: float) -> float:
        """Longest step of the solver in a run of this duration [s]."""
        return float("inf")

    def reported(self, x: Array) -> Array:
        """State to report for a solver's state."""
        return x

    def within(self, t: float) -> float:
        """The time of `span` closest to t."""
        first, last = self.span
        return first if t < first else last if t > last else t

    def note_loss(self, status: PrecisionStatus) -> None:
        """Raise an error, or record a loss of digits if it is the worst so far."""
        if status.error is not None:
            raise status.error
        self.status = self.status.worse(status.with_state(lambda state: ()))

    def torque(self, t: float, x: Array) -> Array | None:
        """Torques of the law, and the rates of its states; errors name the time of a NaN or a wrong shape."""
        if self.law is None:
            return self.sampled
        u, rates = self.called(self.law, t, x)
        torques = checked_torques(self.law_name, u, self.robot, t)
        return torques if rates is None else np.append(torques, checked_of_states(rates, self.dynamics.states, t))

    def called(self, law: Callable[..., Any], t: float, x: Array) -> tuple[Any, Any]:
        """Result of a law; an exception in it becomes the cause of the error that ends the run."""
        try:
            return call_law(law, t, x, self.dynamics.law_inputs)
        except (RneError, ArithmeticError) as error:
            text = f"`{self.law_name}` raised {type(error).__name__} at t = {t:.6g} s: {error}"
            text = str(error) if isinstance(error, RneError) else text
            raise NotFiniteError(text, getattr(error, "time", t)) from error

    def __call__(self, t: float, x: Array) -> Array:
        """dx/dt."""
        self.evaluations += 1
        t = self.within(t)
        if self.law is not None:
            self._check_state(t, x)
        return self.rates(t, x, self.inputs(t, x))

    def inputs(self, t: float, x: Array) -> Array | None:
        """Inputs of the equations: the torques, held or those that a law returns, and the modes."""
        return with_modes(self.sampled if self.law is None else self.torque(t, self.reported(x)), self.modes)

    def rates(self, t: float, x: Array, u: Array | None) -> Array:
        """dx/dt under given inputs."""
        return self.outputs(t, x, u)[: self.dynamics.size]

    def outputs(self, t: float, x: Array, u: Array | None) -> Array:
        """Results in one state, dx/dt first, of the equations' kernel or else of the recursion, for its errors."""
        if self._state_function is not None:
            try:
                self._time[0] = t
                return self._state_function(*self._inputs(self._time, x, u))
            except NeedsRecursion:
                pass
        self._check_state(t, x)
        try:
            rates: Array
            inputs = self._inputs(np.array([t]), x, u)
            rates, status = self._function.evaluate(self.kernels.model, *inputs, self.numbers)
        except NotFiniteError as error:
            drives = None if self.dynamics.law is None else self.dynamics.drives(np.array([t]), x, None)[0]
            of_law = None if drives is None else _not_finite(np.asarray(drives, dtype=float), self.robot, t)
            raise of_law or NotFiniteError(f"{error} at t = {t:.6g} s", t) from None
        self.note_loss(status)
        return rates

    def _inputs(self, t: Array, x: Array, u: Array | None = None) -> tuple[Array, ...]:
        """Arguments of a kernel without the numbers, at times of shape (..., 1)."""
        pieces = pieces_at(self.table, t)
        return (t, x, *pieces) if u is None else (t, x, u, *pieces)

    def all_outputs(self, t: Array, X: Array, u: Array | None = None, few: int = 1) -> Array:
        """Results of the equations' kernel at times (T,) in states (T, size), for traced laws or given inputs.

        A few states are evaluated one by one in machine code: loading the code for many takes about 8 ms.
        """
        states = self._inputs(t[:, None], X, u)
        fastest = np.abs(X[:, self.dynamics.n : 2 * self.dynamics.n]).max(initial=0.0)
        if 0 < len(t) <= few and self._state_function is not None and fastest <= velocity_bound(X.dtype):
            with suppress(NeedsRecursion):
                return np.array([self._state_function(*row) for row in zip(*states, strict=True)])
        found, status = self.kernel.evaluate(*states, self.numbers)
        self.note_loss(status)
        return found

    def drive_torques(
        self,
        t: Array,
        X: Array,
        u: Array | None = None,
        own: Mapping[str, Array] = NONE,
        pieces: tuple[Array, ...] = (),
    ) -> Array:
        """Torques of the drives at times (T,), within their limits, zero without drives, shape (T, n).

        Numbers of the scene that each time has of its `own` have shapes (T, ...), and its own `pieces` (T, width).
        """
        law, limit = self.dynamics.law, self.dynamics.effort_limit
        if self._law_kernel is not None and law is not None:
            states, numbers = X[:, : self._law_kernel.widths[1]], law.vector
            if mine := part_of(own, "controller."):
                numbers = law.vectors(mine)
            given = (t[:, None], states, *pieces) if pieces else self._inputs(t[:, None], states)
            found = self._law_kernel.evaluate(*given, numbers)[0][:, : self.robot.n]
            bound = own.get("effort_limit", limit)
            return np.asarray(found if bound is None else np.clip(found, -np.asarray(bound), bound))
        drives, _ = self.dynamics.drives(t[:, None], X, self.torques_at(t, X) if u is None else u)
        return np.zeros((len(t), self.robot.n)) if drives is None else np.asarray(drives, dtype=np.float64)

    def torques_at(self, t: Array, X: Array) -> Array | None:
        """Inputs at times (T,): torques of a called law and the rates of its states, shape (T, n + m), or None."""
        if self.law is None:
            return None
        found = [self.torque(float(time), x) for time, x in zip(t, X, strict=True)]
        return np.array(found).reshape(len(t), self.robot.n + self.dynamics.states)

    def _check_state(self, t: float, x: Array) -> None:
        if not isfinite(sum(x.tolist())) and not np.isfinite(x[: 2 * self.dynamics.n]).all():
            raise NotFiniteError(f"state is not finite at t = {t:.6g} s", t)

    def jacobian(self, t: float, x: Array) -> Array:
        """Jacobian df/dx for an implicit solver: exact, except for called laws, by forward differences.

        From M qdd + h - torques = 0: M dqdd = -d(M qdd + h - torques) at constant qdd. Counted as one evaluation per
        component of the state, the cost of differences.
        """
        self._check_state(t, x)
        self.evaluations += self.counted
        t, n, size, dynamics = self.within(t), self.dynamics.n, len(x), self.dynamics
        qdd = self.rates(t, x, self.torque(t, x))[n : 2 * n]
        torque: Callable[..., Any] = partial(self.torque, t)
        u = torque(x) if dynamics.torque_given else None
        has_u = u is not None
        wrt = ("x", "a", "u") if has_u else ("x", "a", "t") if self.is_compiled else ("x", "a")  # t is for Rodas5P
        time, _, *others = self._inputs(np.array([t]), x, u)
        given = time, x, qdd, *others, self.numbers
        slopes = self.kernels.scene_kernel(dynamics.residual, *wrt)(*given)
        by_x, M = slopes[:, :size], slopes[:n, size : size + n]
        if has_u and self.sampled is None:
            law_slopes = differences(torque, x, self.counted)
            by_x = by_x + slopes[:, size + n :] @ law_slopes
        accelerations = np.linalg.solve(M, -by_x[:n])
        return np.concatenate([np.eye(n, size, n), accelerations, by_x[n:]])

    def linearised(self, t: float, x: Array) -> Array:
        """Jacobian df/dx for estimates of its modes, by differences: nothing is traced for it."""
        self._check_state(t, x)
        return differences(partial(self, t), x, self.counted)


def differences(f: Callable[[Array], Array], x: Array, count: int) -> Array:
    """Jacobian of f at x by forward differences over the first components of x; 0 for the others."""
    value = f(x)
    slopes = np.zeros((len(value), len(x)))
    for j in range(count):
        moved = np.array(x)
        moved[j] += EPS**0.5 * max(abs(x[j]), 1.0)
        slopes[:, j] = (f(moved) - value) / (moved[j] - x[j])
    return slopes


def own_copy(law: Any) -> Any:
    """Copy of a law, whose memory is that of one motion; the law itself if it cannot be copied."""
    with suppress(Exception):  # of a law that holds a file, a generator, a lock
        return deepcopy(law)
    return law


def with_own_law(scene: Any) -> Any:
    """Scene with a copy of its called law; unchanged with another one or none."""
    if scene.controller is None or scene.dynamics.law is not None or scene.traced_samples is not None:
        return scene
    own = copy(scene)
    object.__setattr__(own, "controller", own_copy(scene.controller))
    return own


def with_modes(u: Array | None, modes: Array | None) -> Array | None:
    """Inputs of the equations: torques, followed by the modes of sticking friction, if any."""
    if u is None or modes is None:
        return modes if u is None else u
    return np.concatenate([u, modes], axis=-1)


def checked_torques(name: str, returned: Any, robot: Robot, t: float) -> Array:
    """Torques returned by a law, as a checked array."""
    n = robot.n
    if type(returned) is np.ndarray and returned.dtype == np.float64 and returned.shape == (n,):
        tau = returned.copy()
        if isfinite(sum(tau.tolist())):
            return tau
    try:
        tau = np.asarray(returned)
    except ValueError:
        raise ValueError(f"`{name}` must return shape ({n},), got rows of unequal length at t = {t:.6g} s") from None
    if tau.dtype.kind not in "fiu":
        raise ValueError(f"`{name}` must return real numbers, got dtype {tau.dtype} at t = {t:.6g} s")
    if tau.shape != (n,):
        raise ValueError(f"`{name}` must return shape ({n},), got {tau.shape} at t = {t:.6g} s")
    error = _not_finite(tau, robot, t)
    if error is not None:
        raise error
    return tau.astype(np.float64)


def checked_of_states(returned: Any, m: int, t: float, *, discrete: bool = False) -> Array:
    """Rates of the m states returned by a law, or their next values by a discrete law, checked."""
    one, all_of_them = ("next value", "next values") if discrete else ("rate", "rates")
    numbers = np.asarray(returned)
    if numbers.shape == (m,) and numbers.dtype.kind == "f" and not np.isfinite(numbers).all():
        i = int(np.argmin(np.isfinite(numbers)))
        raise NotFiniteError(f"{one} of state {i} of the controller is {numbers[i]} at t = {t:.6g} s", t)
    return real_array(f"{all_of_them} of the controller's states", returned, f"({m},)")


def _not_finite(tau: Array, robot: Robot, t: float) -> NotFiniteError | None:
    """Error for torques that are not finite; None if they are."""
    finite = np.isfinite(tau)
    if finite.all():
        return None
    i = int(np.argmin(finite))
    return NotFiniteError(f"torque of {robot.joint_names[i]!r} is {tau[i]} at t = {t:.6g} s", t)
