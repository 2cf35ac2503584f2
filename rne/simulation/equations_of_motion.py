"""The equations of motion of a scene: dx/dt as one function of time and state, traced into one kernel.

| control law                  | where it is evaluated                 | `law`  | `torque_given` |
|------------------------------|---------------------------------------|--------|----------------|
| none                         |                                       | None   | False          |
| marked by `rne.traceable`    | in the kernel, traced if it can be    | given  | False          |
| called, or `torque=`         | by Plant.torque; `u` has its torques, | None   | True           |
|                              | and the rates of its states           |        |                |
| sampled                      | by ZeroOrderHold; its torques are `u` | None   | True           |

The state x is q, qd and the controller's states z. The ledger names the powers that the scene has: those of the drives
and of viscous and Coulomb friction; an ensemble integrates them as further states.

While a drive is at its limit, the motion tells a solver nothing of the law, and steps grow until they jump over the
time at which the torque leaves the limit. The error control therefore follows the law as well: the impulses of the
torques without limits, divided by a constant inertia, are further states of such a scene.
"""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from functools import cache, cached_property
from typing import Any, TypeVar

import numpy as np

from ..basics.arrays import check_function, whole_number
from ..basics.spatial import Array, rotate
from ..dynamics.crba import mass_matrix, solve_with_pivots
from ..dynamics.precision import check_accelerations, check_singularity
from ..dynamics.quantity import OK, PrecisionStatus, Quantity, check_result, model_for
from ..dynamics.rnea import bias_torque, inverse_dynamics
from ..elementwise import clip
from ..kernels.kernel import Kernel
from ..model.model import Model
from ..model.parameters import at_parameters
from ..robot import Robot
from .friction import Friction

AGREEMENT = 1e-9  # relative: torques that differ by less are the same
TRIALS = 3  # random states on which a traced law must agree with a call of it

T = TypeVar("T", bound="AppliedTorques")


def check_law(name: str, law: Any) -> None:
    """Raise a TypeError if a law cannot be called with its arguments, a ValueError if it has no number of states."""
    has_states = hasattr(law, "states") and not isinstance(law, type)
    check_function(name, law, "(t, q, qd, z), as it has `states`" if has_states else "(t, q, qd)")
    if has_states:
        whole_number(f"{name}.states", law.states, least=0)


def call_law(law: Any, t: Any, x: Array, n: int) -> tuple[Any, Any]:
    """The torques that a law returns in a state (q, qd, z), and the rates of its states; None without states."""
    q, qd = x[..., :n].copy(), x[..., n : 2 * n].copy()  # a law may modify its arguments
    if not hasattr(law, "states"):
        return law(t, q, qd), None
    returned = law(t, q, qd, x[..., 2 * n : 2 * n + int(law.states)].copy())
    if not isinstance(returned, tuple) or len(returned) != 2 or returned[1] is None:
        got = f"a tuple of {len(returned)}" if isinstance(returned, tuple) else type(returned).__name__
        got = "(torques, None)" if got == "a tuple of 2" else got
        raise ValueError(f"`controller` with states must return (torques, rates of its states), got {got}")
    return returned


@dataclass(frozen=True, eq=False)
class AppliedTorques:
    """Net joint torques of a scene, the rates of its controller's states, and the powers of its ledger."""

    robot: Robot  # with payload and locked joints
    friction: Friction | None
    effort_limit: Array | None  # (n,), largest torque of each drive
    law: Any  # a traceable one, or None
    torque_given: bool  # torques of the drives are an argument, `u`; without this and `law` there are no drives
    controller_states: int = 0  # of a law that is called, their rates follow the torques in `u`
    with_impulses: bool = False  # of the torques without limits, per inertia, behind the other states

    name = "applied_torques"
    title = "the sum of torques"

    def __getstate__(self) -> dict[str, Any]:
        return {k: value for k, value in self.__dict__.items() if not isinstance(value, Kernel | AppliedTorques)}

    def of_kind(self, kind: type[T]) -> T:
        """Another function of the same scene."""
        return kind(*(getattr(self, field.name) for field in fields(AppliedTorques)))

    @cached_property
    def ledger(self) -> tuple[str, ...]:
        """Names of the powers that the scene has."""
        f, names = self.friction, ["drives"] if self.law is not None or self.torque_given else []
        names += [k for k in ("viscous", "coulomb") if np.any(getattr(f, k, 0)) or np.any(getattr(f, f"{k}_back", 0))]
        return tuple(names)

    @property
    def size(self) -> int:
        """Length of the state."""
        return 2 * self.robot.n + self.controller_states + self.with_impulses * self.robot.n

    @cached_property
    def typical_inertia(self) -> Array:
        """Diagonal of M in one configuration: it makes impulses rates."""
        diagonal = np.diagonal(self.robot.mass_matrix(np.zeros(self.robot.n)))
        return np.where(diagonal > 0, diagonal, 1.0)

    @property
    def widths(self) -> dict[str, int | None]:
        """Lengths of the arguments: t, x and, where torques are given, u."""
        widths: dict[str, int | None] = {"t": 1, "x": self.size}
        return widths | {"u": self.robot.n + self.controller_states} if self.torque_given else widths

    @property
    def quantity(self) -> Quantity:
        """What is traced."""
        return Quantity(name=self.name, core=self.core, widths=self.widths, moments=True, base_parameters=True)

    def law_torques(self, t: Any, x: Array) -> tuple[Array, Array | None]:
        """(torques, dz/dt) of the traceable law; times have shape (..., 1).

        It is called with one state at a time: laws are written so. Numbers of many states are handed over at once if
        the law takes them so.
        """
        if x.ndim == 1:
            return self._call(np.asarray(t).item(), x)
        if x.dtype != object and self._takes_batches:
            return self._call(t, x)
        times = np.broadcast_to(t, (*x.shape[:-1], 1)).reshape(-1)
        found = [self._call(*state) for state in zip(times, x.reshape(-1, x.shape[-1]), strict=True)]
        u = np.array([torques for torques, _ in found]).reshape(*x.shape[:-1], -1)
        return u, None if found[0][1] is None else np.array([r for _, r in found]).reshape(*x.shape[:-1], -1)

    def _call(self, t: Any, x: Array) -> tuple[Array, Array | None]:
        """The law's torques with one row per state, where a constant is repeated, and the rates of its states."""
        n = self.robot.n
        u, rates = call_law(self.law, t, x, n)
        try:
            torques = np.asarray(u)
        except ValueError:
            torques = np.asarray(None)
        shape = x.shape[:-1] + (n,)
        if torques.shape != shape and (torques.shape != (n,) or (torques.dtype == object and n == 0)):
            raise ValueError(f"`controller` must return shape (..., {n}) for states of that shape, got {torques.shape}")
        rates = None if rates is None else np.asarray(rates)
        return torques if torques.shape == shape else torques + 0 * x[..., :n], rates

    @cached_property
    def _takes_batches(self) -> bool:
        """True if the law gives for some states at once what it gives for each."""
        n = self.robot.n
        t, X = _trials(n + 1, 2 * n + self.controller_states)  # a matrix (n, n) times these fails
        try:
            together, _ = self._call(t, X)
            single = [self._call(float(s[0]), x)[0] for s, x in zip(t, X, strict=True)]
        except Exception:  # whatever the law raises
            return False
        return together.shape == (n + 1, n) and np.allclose(together, single, rtol=AGREEMENT, atol=AGREEMENT)

    def drives(self, t: Any, x: Array, u: Array | None) -> tuple[Array | None, list[Array]]:
        """Torques of the drives within their limits, and the rates of the states behind (q, qd)."""
        n, rates = self.robot.n, None
        if self.law is not None:
            u, rates = self.law_torques(t, x)
        elif u is not None and self.controller_states:
            u, rates = u[..., :n], u[..., n:]
        further = [] if rates is None else [rates]
        if u is None or self.effort_limit is None:
            return u, further
        if self.with_impulses:
            further.append(u * (1 / self.typical_inertia))
        return clip(u, -self.effort_limit, self.effort_limit), further

    def parts(self, t: Any, x: Array, u: Array | None) -> tuple[Array, list[Array], list[Array]]:
        """Net torques, the rates of the states behind (q, qd), and the powers of the ledger."""
        qd = x[..., self.robot.n : 2 * self.robot.n]
        u, rates = self.drives(t, x, u)
        net, powers = 0 * qd if u is None else u, []
        if u is not None:
            powers.append((u * qd).sum(-1, keepdims=True))
        for name in ("viscous", "coulomb"):
            if self.friction is not None and name in self.ledger:
                torque = getattr(self.friction, f"{name}_torque")(qd)
                net = net - torque
                powers.append((torque * qd).sum(-1, keepdims=True))
        return net, rates, powers

    def core(self, model: Model, t: Array, x: Array, u: Array | None = None) -> Any:
        """[net torques, dz/dt, powers], traced."""
        net, rates, powers = self.parts(t, x, u)
        return np.concatenate([net, *rates, *powers], axis=-1)

    def evaluate(
        self, model: Model, *arguments: Any, parameters: Array | None = None, **named: Any
    ) -> tuple[Array, PrecisionStatus]:
        """The function with numbers, by the recursion, with its PrecisionStatus; NotFiniteError where it overflows."""
        named |= dict(zip(self.widths, arguments, strict=False))
        given = {name: np.asarray(named[name]) for name in self.widths if named.get(name) is not None}
        leading = np.broadcast_shapes(*(a.shape[:-1] for a in given.values()))  # a complex step moves one of them alone
        dtype, quantity, status = np.result_type(*given.values()), self.quantity, OK
        given = {k: np.broadcast_to(a.astype(dtype, copy=False), leading + a.shape[-1:]) for k, a in given.items()}
        model = model_for(model, dtype, list(given.values()))
        model = model if parameters is None else at_parameters(model, np.asarray(parameters))
        with np.errstate(all="ignore"):
            result = self.core(model, **given)
            if quantity.check is not None:
                result, *pivots = result
                status = quantity.check(model, given, result, *pivots)
        if status.error is None:
            check_result(self.title, result, leading)
        return np.asarray(result), status

    @cached_property
    def kernel(self) -> Kernel:
        """The traced function."""
        return Kernel(self, self.robot.model, {}, engine=self.robot.engine)

    def why_not_traced(self) -> str | None:
        """Why the law must be called: it cannot be traced, or its trace differs from calls. None if it is traced."""
        try:
            worst = self._error_of_trace()
        except Exception as error:  # whatever the law raises when it meets traced numbers
            return f"{type(error).__name__}: {error}".splitlines()[0]
        if worst <= AGREEMENT:
            return None
        return f"traced, it differs by {worst:.3g} from a call: it has memory, noise or a branch"

    def is_current(self) -> bool:
        """False if the law has been changed since it was traced: its parameters are constants of the kernel."""
        return self.law is None or self._error_of_trace() <= AGREEMENT

    def _error_of_trace(self) -> float:
        """Largest difference between traced and called torques in some states, relative where they exceed 1."""
        kernel, (t, x) = self.kernel, _trials(TRIALS, self.size)
        called, _ = self.evaluate(self.robot.model, t, x)
        scales = np.abs(called).max(axis=1, initial=1.0)
        return float((np.abs(kernel(t, x) - called).max(axis=1, initial=0.0) / scales).max())


class Residual(AppliedTorques):
    """[M a + C qd + g - net torques, dz/dt] at accelerations a: its slopes linearise the motion, see Plant.jacobian."""

    name = "residual"
    title = "the equations of motion"

    @property
    def widths(self) -> dict[str, int | None]:
        """Lengths of the arguments: t, x, a and, where torques are given, u."""
        return {"t": 1, "x": self.size, "a": self.robot.n} | super().widths

    def core(self, model: Model, t: Array, x: Array, a: Array, u: Array | None = None) -> Any:  # type: ignore[override]
        """The residual, traced."""
        n = self.robot.n
        net, rates, _ = self.parts(t, x, u)
        needed = inverse_dynamics.core(model, x[..., :n], x[..., n : 2 * n], a)
        return np.concatenate([needed - net, *rates], axis=-1)

    @cached_property
    def slopes(self) -> Kernel:
        """Its exact derivatives by x and a, and by u where that is given."""
        wrt = ("x", "a", "u") if self.torque_given else ("x", "a")
        return Kernel(self, self.robot.model, {}, wrt, self.robot.engine)

    @cached_property
    def slopes_in_time(self) -> Kernel:
        """Its exact derivatives by x, a and t."""
        return Kernel(self, self.robot.model, {}, ("x", "a", "t"), self.robot.engine)


@dataclass(frozen=True, eq=False)
class RightHandSide(AppliedTorques):
    """dx/dt of a scene."""

    with_energies: bool = False  # of the ledger, behind the other states

    name = "right_hand_side"
    title = "the right-hand side"

    @property
    def size(self) -> int:
        """Length of the state."""
        return super().size + self.with_energies * len(self.ledger)

    @property
    def quantity(self) -> Quantity:
        """What is traced: as for the torques, with M's pivots behind the rates."""
        velocities = ("x", slice(self.robot.n, 2 * self.robot.n))
        return replace(super().quantity, check=self._check, velocities=velocities)

    def core(self, model: Model, t: Array, x: Array, u: Array | None = None) -> Any:
        """(dx/dt, pivots, diagonal of M), traced."""
        n = self.robot.n
        q, qd = x[..., :n], x[..., n : 2 * n]
        net, further, powers = self.parts(t, x, u)
        forward = self.robot._kernels.forward_method()
        qdd, pivots, diagonal = forward.quantity.core(model, q, qd, net)
        rates = [qd, qdd, *further, *(powers if self.with_energies else [])]
        return np.concatenate(rates, axis=-1), pivots, diagonal

    def _check(self, model: Model, arguments: Any, rates: Array, pivots: Array, diagonal: Array) -> PrecisionStatus:
        n, t, x = self.robot.n, arguments["t"], arguments["x"]
        net, _, _ = self.parts(t, x, arguments.get("u"))
        state = {"q": x[..., :n], "qd": x[..., n : 2 * n], "tau": np.broadcast_to(net, x[..., :n].shape)}
        return check_accelerations(model, state, np.asarray(rates[..., n : 2 * n]), pivots, diagonal)

    @cached_property
    def kernel_at_parameters(self) -> Kernel:
        """dx/dt with the inertial parameters as a further argument; a law keeps those that it was made with."""
        return Kernel(self, self.robot.model, {"parameters": True}, engine=self.robot.engine)

    @cached_property
    def torques(self) -> AppliedTorques:
        """The torques alone, for reports."""
        return self.of_kind(AppliedTorques)

    @cached_property
    def residual(self) -> Residual:
        """The equations of motion, for Jacobians."""
        return self.of_kind(Residual)

    @cached_property
    def under_modes(self) -> RatesUnderModes:
        """dx/dt while some joints slip and others stick."""
        return self.of_kind(RatesUnderModes)

    @cached_property
    def loads(self) -> LoadsUnderModes:
        """What dry friction must hold while some joints slip and others stick."""
        return self.of_kind(LoadsUnderModes)


class RatesUnderModes(RightHandSide):
    """dx/dt while some joints stick, the others slip under dry friction.

    `u` ends with the modes: 1 for each joint that slips and 0 for one that sticks, then the dry friction torques of
    those that slip. The place of a sticking joint's rate has the acceleration that its load would give it if nothing
    held it, for the error control to follow.
    """

    name = "rates_under_modes"

    @property
    def widths(self) -> dict[str, int | None]:
        """Lengths of the arguments: t, x and u, which ends with the modes."""
        widths = super().widths
        return widths | {"u": (widths.get("u") or 0) + 2 * self.robot.n}

    @property
    def quantity(self) -> Quantity:
        """What is traced: M's pivots are those of the joints that slip."""
        return replace(super().quantity, velocities=None)

    def balance(self, model: Model, t: Array, x: Array, u: Array) -> tuple[Any, ...]:
        """Accelerations, loads, net torques without dry friction, rates of further states, M's diagonal, pivots.

        The rows and columns of sticking joints in M are those of the unit matrix: M_ss qdd_s = (net - dry)_s.
        """
        assert self.friction is not None
        n = self.robot.n
        given, slips, dry = u[..., : -2 * n], u[..., -2 * n : -n], u[..., -n:]
        q, qd = x[..., :n], slips * x[..., n : 2 * n]
        moving = np.concatenate([q, qd, x[..., 2 * n :]], axis=-1)
        drives, rates = self.drives(t, moving, given if self.torque_given else None)
        resisting = bias_torque.core(model, q, qd) + self.friction.viscous_torque(qd)
        net = -resisting if drives is None else drives - resisting
        M = mass_matrix.core(model, q)
        among = M * slips[..., :, None] * slips[..., None, :] + np.eye(n) * (1 - slips)[..., None]
        qdd, pivots, diagonal = solve_with_pivots(among, model.coordinate_parent, slips * (net - dry))
        loads = slips * dry + (1 - slips) * (net - rotate(M, qdd))
        return qdd, loads, net, rates, np.diagonal(M, axis1=-2, axis2=-1), pivots, diagonal

    def core(self, model: Model, t: Array, x: Array, u: Array) -> Any:  # type: ignore[override]
        """(dx/dt, pivots, their diagonal), traced."""
        n = self.robot.n
        slips = u[..., -2 * n : -n]
        qdd, loads, _, further, inertia, pivots, diagonal = self.balance(model, t, x, u)
        held = (1 - slips) * loads / (slips + (1 - slips) * inertia)
        return np.concatenate([slips * x[..., n : 2 * n], qdd + held, *further], axis=-1), pivots, diagonal

    def _check(self, model: Model, arguments: Any, rates: Array, pivots: Array, diagonal: Array) -> PrecisionStatus:
        return check_singularity(model, {"q": arguments["x"][..., : self.robot.n]}, rates, pivots, diagonal)


class LoadsUnderModes(RatesUnderModes):
    """[accelerations, dry friction torques or loads of sticking joints, net torques without dry friction]."""

    name = "loads_under_modes"

    def core(self, model: Model, t: Array, x: Array, u: Array) -> Any:  # type: ignore[override]
        """The three, pivots, their diagonal, traced."""
        *found, _, _, pivots, diagonal = self.balance(model, t, x, u)
        return np.concatenate(found, axis=-1), pivots, diagonal


@cache
def _trials(count: int, size: int) -> tuple[Array, Array]:
    """Times and states in which a law is compared with its trace."""
    rng = np.random.default_rng(0)
    return rng.uniform(0, 1, (count, 1)), rng.uniform(-1, 1, (count, size))
