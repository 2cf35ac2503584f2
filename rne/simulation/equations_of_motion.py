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

from dataclasses import dataclass
from functools import cache, cached_property
from typing import Any

import numpy as np

from ..basics.spatial import Array, rotate
from ..dynamics.crba import mass_matrix, solve_with_pivots
from ..dynamics.lagrange import lagrange_forward_dynamics
from ..dynamics.precision import check_accelerations, check_singularity
from ..dynamics.quantity import OK, PrecisionStatus, Quantity, check_result
from ..dynamics.rnea import bias_torque, inverse_dynamics
from ..elementwise import clip
from ..kernels.kernel import Kernel
from ..model.model import Model
from ..model.parameters import at_parameters
from ..robot import Robot
from .friction import Friction
from .law import AGREEMENT, TracedLaw

TRIALS = 3  # random states on which a traced law must agree with a call of it


@dataclass(frozen=True, eq=False)
class SceneDynamics:
    """What the equations of motion of a scene contain.

    Attributes
    ----------
    robot : Robot
        The scene's robot, with payload and locked joints.
    friction : Friction or None
    effort_limit : ndarray, shape (n,), or None
        Largest torque of each drive.
    law : callable or None
        A traceable law.
    torque_given : bool
        True if the drives' torques are an argument, `u`; without `torque_given` and `law` there are no drives.
    states : int
        Number of states of a law that is called, whose rates follow the torques in `u`.
    with_impulses : bool
        True to append to the state, for each joint, the impulse of the torque without limit per inertia.
    """

    robot: Robot
    friction: Friction | None
    effort_limit: Array | None
    law: Any
    torque_given: bool
    states: int = 0
    with_impulses: bool = False


class AppliedTorques:
    """Net joint torques of a scene, the rates of its controller's states, and the powers of its ledger."""

    name = "applied_torques"

    def __init__(self, dynamics: SceneDynamics) -> None:
        self.dynamics = dynamics
        self.robot, self.friction, self.effort_limit = dynamics.robot, dynamics.friction, dynamics.effort_limit
        self.law, self.torque_given = dynamics.law, dynamics.torque_given
        self._traced_law = None if dynamics.law is None else TracedLaw(dynamics.law, dynamics.robot.n)
        self.controller_states = dynamics.states if self._traced_law is None else self._traced_law.states
        has_drives = dynamics.law is not None or dynamics.torque_given
        self.with_impulses = dynamics.with_impulses and dynamics.effort_limit is not None and has_drives
        f = dynamics.friction
        ledger = {
            "drives": has_drives,
            "viscous": f is not None and bool(np.any(f.viscous) or np.any(f.viscous_back)),
            "coulomb": f is not None and bool(np.any(f.coulomb) or np.any(f.coulomb_back)),
        }
        self.ledger = tuple(name for name, present in ledger.items() if present)

    def __getstate__(self) -> dict[str, Any]:
        return {k: value for k, value in self.__dict__.items() if not isinstance(value, Kernel | AppliedTorques)}

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
    def quantity(self) -> Quantity:
        """What is traced: arrays t, x and, where torques are given, u."""
        return Quantity(name=self.name, core=self.core, widths=self._widths, moments=True, base_parameters=True)

    @property
    def _widths(self) -> dict[str, int | None]:
        widths: dict[str, int | None] = {"t": 1, "x": self.size}
        return widths | {"u": self.robot.n + self.controller_states} if self.torque_given else widths

    def drives(self, t: Any, x: Array, u: Array | None) -> tuple[Array | None, Array | None]:
        """Torques of the drives within their limits, and the rates of the states behind (q, qd)."""
        n, rates = self.robot.n, None
        if self._traced_law is not None:
            u, rates = self._traced_law(t, x)
        elif u is not None and self.controller_states:
            u, rates = u[..., :n], u[..., n:]
        if u is None or self.effort_limit is None:
            return u, rates
        if self.with_impulses:
            impulses = u * (1 / self.typical_inertia)
            rates = impulses if rates is None else np.concatenate([rates, impulses], axis=-1)
        return clip(u, -self.effort_limit, self.effort_limit), rates

    def parts(self, t: Any, x: Array, u: Array | None) -> tuple[Array, list[Array], list[Array]]:
        """Net torques, the rates of the controller's states, and the powers of the ledger."""
        n = self.robot.n
        qd = x[..., n : 2 * n]
        u, rates = self.drives(t, x, u)
        net, powers = 0 * qd if u is None else u, []
        if u is not None:
            powers.append((u * qd).sum(-1, keepdims=True))
        for name in ("viscous", "coulomb"):
            if self.friction is not None and name in self.ledger:
                torque = getattr(self.friction, f"{name}_torque")(qd)
                net = net - torque
                powers.append((torque * qd).sum(-1, keepdims=True))
        return net, [] if rates is None else [rates], powers

    def core(self, model: Model, t: Array, x: Array, u: Array | None = None) -> Any:
        """[net torques, dz/dt, powers], traced."""
        net, rates, powers = self.parts(t, x, u)
        return np.concatenate([net, *rates, *powers], axis=-1)

    def evaluate(self, model: Model, t: Array, x: Array, u: Array | None = None) -> tuple[Array, PrecisionStatus]:
        """The same, with numbers."""
        with np.errstate(all="ignore"):
            result = self.core(model, np.asarray(t), np.asarray(x), u)
        check_result("the torques", result)
        return result, OK

    @cached_property
    def kernel(self) -> Kernel:
        """The traced function."""
        return Kernel(self, self.robot.model, {}, engine=self.robot.engine)

    def why_not_traced(self) -> str | None:
        """Why the law must be called: it cannot be traced, or its trace differs from calls. None if it is traced."""
        try:
            worst = _difference(self, self.kernel)
        except Exception as error:  # whatever the law raises when it meets traced numbers
            return f"{type(error).__name__}: {error}".splitlines()[0]
        if worst <= AGREEMENT:
            return None
        return f"traced, it differs by {worst:.3g} from a call: it has memory, noise or a branch"

    def is_current(self) -> bool:
        """False if the law has been changed since it was traced: its parameters are constants of the kernel."""
        return _difference(self, self.kernel) <= AGREEMENT


class Residual(AppliedTorques):
    """[M a + C qd + g - net torques, dz/dt] at accelerations a: its slopes linearise the motion, see Plant.jacobian."""

    name = "residual"

    @property
    def _widths(self) -> dict[str, int | None]:
        widths = super()._widths
        return {"t": 1, "x": self.size, "a": self.robot.n} | widths

    def core(self, model: Model, t: Array, x: Array, a: Array, u: Array | None = None) -> Any:  # type: ignore[override]
        """The residual, traced."""
        n = self.robot.n
        net, rates, _ = self.parts(t, x, u)
        needed = inverse_dynamics.core(model, x[..., :n], x[..., n : 2 * n], a)
        return np.concatenate([needed - net, *rates], axis=-1)

    def evaluate(  # type: ignore[override]
        self, model: Model, t: Array, x: Array, a: Array, u: Array | None = None
    ) -> tuple[Array, PrecisionStatus]:
        """The same, with numbers."""
        arrays = [np.asarray(v) for v in (t, x, a, *(() if u is None else (u,)))]
        leading = np.broadcast_shapes(*(v.shape[:-1] for v in arrays))  # a complex step moves one of them alone
        dtype = np.result_type(*arrays)
        arrays = [np.broadcast_to(v.astype(dtype, copy=False), leading + v.shape[-1:]) for v in arrays]
        with np.errstate(all="ignore"):
            result = self.core(model, *arrays)
        check_result("the equations of motion", result)
        return result, OK

    @cached_property
    def slopes(self) -> Kernel:
        """Its exact derivatives by x and a, and by u where that is given."""
        wrt = ("x", "a", "u") if self.torque_given else ("x", "a")
        return Kernel(self, self.robot.model, {}, wrt, self.robot.engine)

    @cached_property
    def slopes_in_time(self) -> Kernel:
        """Its exact derivatives by x, a and t."""
        return Kernel(self, self.robot.model, {}, ("x", "a", "t"), self.robot.engine)


class RightHandSide(AppliedTorques):
    """dx/dt of a scene.

    Parameters
    ----------
    dynamics : SceneDynamics
    with_energies : bool
        True to append the energies of the ledger to the state.
    formulation : {"newton-euler", "euler-lagrange"}
        Which forward dynamics give the accelerations.
    """

    name = "right_hand_side"

    def __init__(self, dynamics: SceneDynamics, with_energies: bool = False, formulation: str = "newton-euler") -> None:
        super().__init__(dynamics)
        self.with_energies, self.formulation = with_energies, formulation

    @property
    def size(self) -> int:
        """Length of the state."""
        return super().size + self.with_energies * len(self.ledger)

    @property
    def quantity(self) -> Quantity:
        """What is traced: as for the torques, with M's pivots behind the rates."""
        n = self.robot.n
        velocities = ("x", slice(n, 2 * n))
        return Quantity(
            name=self.name,
            core=self.core,
            widths=self._widths,
            check=self._check,
            velocities=velocities,
            moments=self.formulation == "newton-euler",
            base_parameters=True,
        )

    def core(self, model: Model, t: Array, x: Array, u: Array | None = None) -> Any:
        """(dx/dt, pivots, diagonal of M), traced."""
        n = self.robot.n
        q, qd = x[..., :n], x[..., n : 2 * n]
        net, further, powers = self.parts(t, x, u)
        lagrange = self.formulation == "euler-lagrange"
        forward = lagrange_forward_dynamics if lagrange else self.robot._kernels.forward_method()
        qdd, pivots, diagonal = forward.quantity.core(model, q, qd, net)
        rates = [qd, qdd, *further, *(powers if self.with_energies else [])]
        return np.concatenate(rates, axis=-1), pivots, diagonal

    def _check(self, model: Model, arguments: Any, rates: Array, pivots: Array, diagonal: Array) -> PrecisionStatus:
        n, t, x = self.robot.n, arguments["t"], arguments["x"]
        net, _, _ = self.parts(t, x, arguments.get("u"))
        state = {"q": x[..., :n], "qd": x[..., n : 2 * n], "tau": np.broadcast_to(net, x[..., :n].shape)}
        return check_accelerations(model, state, np.asarray(rates[..., n : 2 * n]), pivots, diagonal)

    def evaluate(
        self, model: Model, t: Array, x: Array, u: Array | None = None, parameters: Array | None = None
    ) -> tuple[Array, PrecisionStatus]:
        """dx/dt with numbers, by the recursion, with the PrecisionStatus on M; NotFiniteError where it overflows."""
        t, x = np.asarray(t), np.asarray(x)
        typed = model if x.dtype == model.mass.dtype else model.astype(x.dtype)
        typed = typed if parameters is None else at_parameters(typed, np.asarray(parameters))
        with np.errstate(all="ignore"):
            rates, pivots, diagonal = self.core(typed, t, x, u)
            verdict = self._check(typed, {"t": t, "x": x, "u": u}, rates, pivots, diagonal)
        if verdict.error is None:
            check_result("the right-hand side", rates)
        return np.asarray(rates), verdict

    def is_current(self) -> bool:
        """False if the law has been changed since it was traced: its parameters are constants of the kernel."""
        return self.law is None or self.torques.is_current()

    @cached_property
    def kernel_at_parameters(self) -> Kernel:
        """dx/dt with the inertial parameters as a further argument; a law keeps those that it was made with."""
        return Kernel(self, self.robot.model, {"parameters": True}, engine=self.robot.engine)

    @cached_property
    def torques(self) -> AppliedTorques:
        """The torques alone, for reports."""
        return AppliedTorques(self.dynamics)

    @cached_property
    def residual(self) -> Residual:
        """The equations of motion, for Jacobians."""
        return Residual(self.dynamics)

    @cached_property
    def under_modes(self) -> RatesUnderModes:
        """dx/dt while some joints slip and others stick."""
        return RatesUnderModes(self.dynamics)

    @cached_property
    def loads(self) -> LoadsUnderModes:
        """What dry friction must hold while some joints slip and others stick."""
        return LoadsUnderModes(self.dynamics)


class RatesUnderModes(RightHandSide):
    """dx/dt while some joints stick, the others slip under dry friction.

    `u` ends with the modes: 1 for each joint that slips and 0 for one that sticks, then the dry friction torques of
    those that slip. The place of a sticking joint's rate has the acceleration that its load would give it if nothing
    held it, for the error control to follow.
    """

    name = "rates_under_modes"

    @property
    def _widths(self) -> dict[str, int | None]:
        widths = super()._widths
        return widths | {"u": (widths.get("u") or 0) + 2 * self.robot.n}

    @property
    def quantity(self) -> Quantity:
        """What is traced: M's pivots are those of the joints that slip."""
        widths = self._widths
        return Quantity(
            name=self.name, core=self.core, widths=widths, check=self._check, moments=True, base_parameters=True
        )

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
        return qdd, loads, net, [] if rates is None else [rates], np.diagonal(M, axis1=-2, axis2=-1), pivots, diagonal

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


def _difference(torques: AppliedTorques, kernel: Kernel) -> float:
    """Largest difference between traced and called torques in some states, relative where they exceed 1."""
    t, x = _trials(torques.size)
    called, _ = torques.evaluate(torques.robot.model, t, x)
    scales = np.abs(called).max(axis=1, initial=1.0)
    return float((np.abs(kernel(t, x) - called).max(axis=1, initial=0.0) / scales).max())


@cache
def _trials(size: int) -> tuple[Array, Array]:
    """Times and states in which a law is compared with its trace."""
    rng = np.random.default_rng(0)
    return rng.uniform(0, 1, (TRIALS, 1)), rng.uniform(-1, 1, (TRIALS, size))
