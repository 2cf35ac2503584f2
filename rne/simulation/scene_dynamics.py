"""The equations of motion of a scene: functions of time, state and inputs, of which kernels are traced for its robot.

| control law                  | where it is evaluated                 | `law`  | `inputs`  |
|------------------------------|---------------------------------------|--------|-----------|
| none                         |                                       | None   | "none"    |
| marked by `rne.traceable`    | in the kernel, traced if it can be    | given  | "none"    |
| called, or `torque=`         | by Plant.torque; `u` has its torques, | None   | "called"  |
|                              | and the rates of its states           |        |           |
| sampled                      | by ZeroOrderHold; its torques are `u` | None   | "held"    |

The state x is q, qd (`elastic_joints` has more), the controller's states z, and energies since the start: the work of
the drives and what friction and damping dissipate, as far as the scene has them. Energies are integrated with the
motion; their errors are controlled loosely, so that they hold back no step that the motion does not. The work of
torques that are held follows from the positions.

While a drive is at its limit, the motion does not depend on the law, and steps grow until they jump over the
time at which the torque leaves the limit. The error control therefore follows the law as well: the impulses of the
torques without limits, divided by a constant inertia, are further states of such a scene, before the energies.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, fields, replace
from functools import cached_property, partial
from typing import Any, NamedTuple, Self

import numpy as np
from numpy.typing import ArrayLike

from ..basics.arrays import cached_array
from ..basics.numbers import WithNumbers, part_of
from ..basics.piecewise import NO_TABLE
from ..basics.spatial import Array, note_finite, rotate
from ..control.traced_law import LawInputs, TracedLaw
from ..dynamics.crba import mass_matrix, solve_with_pivots
from ..dynamics.energy import kinetic_energy, potential_energy
from ..dynamics.precision import check_accelerations, check_singularity
from ..dynamics.quantity import OK, Declared, MethodQuantity, PrecisionStatus, Quantity
from ..dynamics.rnea import bias_torque, inverse_dynamics
from ..elementwise import clip
from ..graph.graph import Graph
from ..graph.scalar import inputs, is_present, references
from ..kernels.trace import LIMIT
from ..model.model import Model, joint_array, with_unchecked
from ..model.parameters import moments_as_vector, moments_of_vector, with_fewest_terms
from ..robot import Robot
from .friction import Friction, viscous_slope
from .springs import Springs


class MotorSide(NamedTuple):
    """Motors of elastic joints, one number per joint, and the side that laws read."""

    stiffness: tuple[float, ...]
    damping: tuple[float, ...]
    rotor: tuple[float, ...]
    reads: str


class UserFunction:
    """User's function of one state, such as a running cost, that returns a number; equal if the operations are.

    So its kernel is found again unless something has changed that the function reads. `widths` are the lengths of its
    arguments, 0 for a number.
    """

    def __init__(self, name: str, function: Callable[..., Any], widths: tuple[int, ...]) -> None:
        self.name, self.function, self.widths = name, function, widths
        graph, ends = Graph(8 * LIMIT, outline=True), np.cumsum(np.maximum(widths, 1))
        arguments = np.split(inputs(graph, (int(ends[-1]),), 0), ends[:-1])
        try:
            returned = function(*(x if w else x[0] for w, x in zip(widths, arguments, strict=True)))
            self.formula: tuple[Any, ...] = *graph.nodes, *references(graph, returned)
        except Exception:  # whatever it raises for traced numbers: the trace for a kernel reports it
            self.formula = (id(function),)
        self._hash = hash(self.formula)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, UserFunction) and self.widths == other.widths and self.formula == other.formula

    def __hash__(self) -> int:
        return self._hash

    def __call__(self, t: Any, q: Array, qd: Array, tau: Array) -> Array:
        """Values in states of shape (..., n), shape (..., 1)."""
        leading = q.shape[:-1]
        times = np.broadcast_to(t, (*leading, 1))
        each = [self.value(times[k][0], q[k].copy(), qd[k].copy(), tau[k].copy()) for k in np.ndindex(leading)]
        return np.array(each).reshape(*leading, 1)

    def value(self, *arguments: Any) -> Any:
        """Number returned in one state; errors name the function."""
        try:
            found = self.function(*arguments)
        except TypeError as error:
            raise TypeError(f"`{self.name}` must be a formula that can be traced: {error}") from error
        if found is None or np.size(found) != 1:
            got = "None" if found is None else f"shape {np.shape(found)}"
            raise ValueError(f"`{self.name}` must return one number, got {got}")
        return np.reshape(found, ()).item()


class Bodies(NamedTuple):
    """Bodies, rotors and gravity as numbers of a scene: regrouped moments, in the order of `moments_as_vector`.

    `varying` is the mask of the moments that are inputs of kernels.
    """

    moments: Any
    armature: Any
    gravity: Any
    varying: tuple[bool, ...]

    @classmethod
    def of(cls, model: Model, varying: Array | None = None) -> Bodies:
        """Bodies of a model."""
        moments = moments_as_vector(with_fewest_terms(model))
        mask = moments != 0 if varying is None else varying
        m, armature, gravity = map(_hashable, (moments, model.armature, model.gravity))
        return cls(m, armature, gravity, tuple(mask.tolist()))

    @staticmethod
    def mask(model: Model) -> Array:
        """Mask of a model's regrouped moments that are nonzero in any of its states."""
        moments = moments_as_vector(with_fewest_terms(model))
        return np.asarray((moments.reshape(-1, moments.shape[-1]) != 0).any(axis=0))

    def in_model(self, model: Model) -> Model:
        """Model with these bodies, for dynamics only."""
        moments, rotors = moments_of_vector(np.asarray(self.moments)), np.array(self.armature)
        return with_unchecked(model, given_moments=moments, armature=rotors, gravity=np.array(self.gravity))


def _hashable(numbers: Any) -> Any:
    """Floats as a tuple; traced numbers unchanged."""
    array = np.asarray(numbers)
    return tuple(array.tolist()) if array.dtype.kind == "f" else array


def declared(name: str, title: str, **how: Any) -> cached_property[MethodQuantity]:
    """Property with the declared function of the method `name`_core, of which kernels are traced."""
    return cached_property(lambda dynamics: dynamics._declared(name, title, **how))


@dataclass(frozen=True)
class SceneDynamics(WithNumbers):
    """Forces, limits and controller of a scene; equal by value, laws by their formulas.

    Kernels of its functions take its numbers as their last argument. They are traced on its `template`.
    """

    n: int  # number of coordinates
    forward: Declared  # the function for accelerations under net torques
    friction: Friction | None = None
    effort_limit: tuple[float, ...] | None = None  # largest torque of each drive [N m or N]
    law: TracedLaw | None = None
    inputs: str = "none"  # or "called", "held": whether torques of the drives are an argument u, and from where
    states: int = 0  # of the controller; if it is called, their rates follow the torques in u
    inertia: tuple[float, ...] | None = None  # constant, makes rates of impulses, if the state has some [kg m^2 or kg]
    has_energies: bool = True  # False without the energies as states
    motor_side: MotorSide | None = None  # of elastic joints
    springs: Springs | None = None
    bodies: Bodies | None = None  # if they are numbers of the scene, instead of the model's
    cost: UserFunction | None = None  # integrated along with the motion, the last state
    damped_over: float = 0.0  # step over which viscous friction is implicit, as further inertia of the joints [s]
    named: frozenset[str] = field(default=frozenset(), compare=False)  # numbers that are inputs even where they are 0

    @cached_property
    def _hash(self) -> int:
        return hash(tuple(getattr(self, f.name) for f in fields(self) if f.compare))

    def __hash__(self) -> int:  # several times a run, to find kernels
        return self._hash

    def __getstate__(self) -> dict[str, Any]:
        return {f.name: getattr(self, f.name) for f in fields(self)}

    @cached_property
    def ledger(self) -> tuple[str, ...]:
        """Names of the energies that the scene exchanges; includes those of named numbers that are 0."""
        if self.template is not self:
            return self.template.ledger
        names = ["drives"] if self.law is not None or self.inputs != "none" else []
        names += () if self.friction is None else self.friction.losses
        names += ["springs"] if self.springs is not None and self.springs.dissipates else []
        names += ["joint_damping"] if self.motor_side is not None and is_present(self.motor_side.damping) else []
        return tuple(names)

    @cached_property
    def energies(self) -> tuple[str, ...]:
        """Names of the energies that are states."""
        without = self.ledger if not self.has_energies else ("drives",) if self.inputs == "held" else ()
        return tuple(name for name in self.ledger if name not in without)

    @cached_property
    def counted(self) -> int:
        """Length of the state without the energies: the entries whose errors are controlled."""
        return 2 * self.n + self.states + len(self.inertia or ())

    @cached_property
    def size(self) -> int:
        """Length of the state."""
        return self.counted + len(self.energies) + (self.cost is not None)

    @property
    def joints(self) -> int:
        """Number of joints and of drives; the joints' coordinates come first."""
        return self.n if self.motor_side is None else len(self.motor_side.rotor)

    @property
    def driven(self) -> slice:
        """Coordinates that the drives act on, the last ones."""
        return slice(self.n - self.joints, self.n)

    @property
    def law_inputs(self) -> LawInputs:
        """Coordinates that the controller is given."""
        reads = "both" if self.motor_side is None else self.motor_side.reads
        return LawInputs(self.joints if reads == "motor" else 0, self.joints if reads == "link" else self.n, self.n)

    @property
    def torque_given(self) -> bool:
        """True if torques of the drives are an argument."""
        return self.inputs != "none"

    @cached_property
    def sticks(self) -> bool:
        """True if friction can hold joints."""
        return self.friction is not None and self.friction.sticks and self.joints > 0

    @cached_array
    def numbers(self) -> dict[str, Array]:
        """Numbers of the parts by their names in a scene."""
        found = {} if self.friction is None else {f"friction.{k}": x for k, x in self.friction.numbers.items()}
        if self.effort_limit is not None:
            found["effort_limit"] = np.array(self.effort_limit)
        if self.law is not None:
            found |= {f"controller.{k}": x for k, x in self.law.numbers.items()}
        found |= {} if self.springs is None else self.springs.numbers
        if self.motor_side is not None:
            found |= {f"elastic.{k}": np.array(getattr(self.motor_side, k)) for k in MotorSide._fields[:3]}
        if self.bodies is not None:
            found |= {k: np.array(getattr(self.bodies, k)) for k in Bodies._fields[:3]}
        return found

    def at(self, numbers: Mapping[str, Any]) -> Self:
        """Dynamics with other numbers of some names, which are not checked and may be traced."""
        found: dict[str, Any] = {}
        if self.friction is not None and (own := part_of(numbers, "friction.")):
            found["friction"] = self.friction.at(own)
        if "effort_limit" in numbers:
            found["effort_limit"] = _hashable(numbers["effort_limit"])
        if self.law is not None and (own := part_of(numbers, "controller.")):
            found["law"] = self.law.at(own)
        if self.springs is not None and part_of(numbers, "springs["):
            found["springs"] = self.springs.with_numbers(numbers)
        if self.motor_side is not None and (own := part_of(numbers, "elastic.")):
            found["motor_side"] = self.motor_side._replace(**{k: _hashable(x) for k, x in own.items()})
        if self.bodies is not None:
            bodies = {k: _hashable(numbers[k]) for k in Bodies._fields[:3] if k in numbers}
            found["bodies"] = self.bodies._replace(**bodies)
        changed = replace(self, **found)
        vars(changed)["masks"] = self.masks
        return changed

    @cached_array
    def masks(self) -> dict[str, Array]:
        """Masks of the entries of the numbers that are kernel inputs."""
        found = super().masks
        found |= {} if self.bodies is None else {"moments": np.array(self.bodies.varying)}
        return {name: found[name] for name in self.numbers if name in found and found[name].any()}

    @property
    def table(self) -> Array:
        """Table of pieces of the motion that a traced law follows; empty without one."""
        return NO_TABLE if self.law is None else self.law.table

    @cached_property
    def template(self) -> Self:
        """Dynamics with all numbers except those of the law set to 1: equal templates share their kernels."""
        kept = {name: mask for name, mask in self.masks.items() if not name.startswith("controller.")}
        found = self.at({name: np.where(mask, 1.0, self.numbers[name]) for name, mask in kept.items()})
        vars(found)["template"] = found
        return found

    def filled(self, vector: Array) -> Self:
        """Dynamics with the entries of a vector as numbers, and the energies of its template."""
        found = super().filled(vector)
        vars(found)["template"] = self.template
        return found

    def core_at(self, name: str, model: Model, *, numbers: Any, **arrays: Array) -> Any:
        """Core of a function under a vector of numbers, or one vector per state."""
        given, width = np.asarray(numbers), len(self.vector)
        rows = given.reshape(-1, width) if width else np.zeros((1, 0))
        if given.dtype.kind == "c" and not given.imag.any():
            rows = rows.real
        differ = np.zeros(width, bool) if rows.dtype == object else (rows != rows[:1]).any(axis=0)
        if not differ.any():
            return self.filled(rows[0]).evaluated(name, model, arrays)
        if not differ[~self._side_by_side].any():
            common = np.where(self._side_by_side, given, rows[0])
            return self.filled(common).evaluated(name, model, arrays)
        each = [
            self.filled(row).evaluated(name, model, {k: a[index][None] for k, a in arrays.items()})
            for index, row in zip(np.ndindex(given.shape[:-1]), rows, strict=True)
        ]
        if not isinstance(each[0], tuple):
            return np.concatenate(each).reshape(*given.shape[:-1], -1)
        return tuple(np.concatenate(part).reshape(*given.shape[:-1], -1) for part in zip(*each, strict=True))

    @cached_array
    def _side_by_side(self) -> Array:
        """Mask of the vector entries that may differ between the states of one call: moments of bodies."""
        counts = {name: int(mask.sum()) for name, mask in self.masks.items()}
        return np.concatenate([np.zeros(0, bool), *(np.full(k, name == "moments") for name, k in counts.items())])

    def _model_at(self, model: Model, numbers: Array) -> Model:
        """Model in some states, for checks of its mass matrix."""
        bodies = None if self.bodies is None else self.filled(numbers).bodies
        return model if bodies is None else bodies.in_model(model)

    def evaluated(self, name: str, model: Model, arrays: Mapping[str, Array]) -> Any:
        given, dynamics = dict(arrays), self
        if self.law is not None and "piece" in given:
            dynamics = replace(self, law=self.law.on_piece(given.pop("piece")))
            vars(dynamics)["template"] = self.template
        return getattr(dynamics, name)(model if self.bodies is None else self.bodies.in_model(model), **given)

    def drives(self, t: Any, x: Array, u: Array | None) -> tuple[Array | None, list[Array]]:
        """Torques of the drives within their limits, and the rates of the states after (q, qd), without energies."""
        n, rates = self.joints, None
        if self.law is not None:
            u, rates = self.law(t, x)
        elif u is not None and self.states:
            u, rates = u[..., :n], u[..., n:]
        further = [] if rates is None else [rates]
        if u is None or self.effort_limit is None:
            return u, further
        if self.inertia is not None:
            further.append(u * (1 / np.array(self.inertia)))
        limit = np.asarray(self.effort_limit)
        return clip(u, -limit, limit), further

    def start(
        self, robot: Robot, q0: ArrayLike, qd0: ArrayLike, parameters: Array | None = None
    ) -> tuple[Array, Array]:
        """Initial coordinates and velocities, checked; for other inertial parameters if given."""
        return joint_array("q0", q0, robot.model), joint_array("qd0", qd0, robot.model)

    def energies_of(self, robot: Robot, x: Array) -> tuple[Array, Array]:
        """Kinetic and potential energy in states [J]."""
        q, evaluate = x[..., : self.joints], robot.kernels.evaluate_some
        potential = evaluate(potential_energy, q)
        potential = potential if self.springs is None else potential + self.springs.energy(robot, q)
        return evaluate(kinetic_energy, q, x[..., self.n : self.n + self.joints]), potential

    def _powers(self, qd: Array, torques: dict[str, Array | None]) -> list[Array]:
        """Rates of the energies under given torques."""
        given = {name: torque for name, torque in torques.items() if torque is not None and name in self.energies}
        return [(torque * qd).sum(-1, keepdims=True) for torque in given.values()]

    def _acting(self, model: Model, t: Any, x: Array, u: Array | None) -> tuple[Array, list[Array]]:
        """Net torques, and the rates of the states after (q, qd)."""
        net, further = self._driving(t, x, u)
        if self.springs is None:
            return net, further
        held, lost = self._held(model, x)
        return net - held, [*further, *lost]

    def _held(self, model: Model, x: Array) -> tuple[Array, list[Array]]:
        """Torques that springs need of the joints, and their power where energies are states."""
        assert self.springs is not None
        qd = x[..., self.n : self.n + self.joints]
        held, damped = self.springs.torques(model, x[..., : self.joints], qd)
        return held, [] if damped is None else self._powers(qd, {"springs": damped})

    def _driving(self, t: Any, x: Array, u: Array | None) -> tuple[Array, list[Array]]:
        """Torques of drives and friction, and the rates of the states without other losses."""
        qd = x[..., self.n : 2 * self.n][..., self.driven]
        drives, further = self.drives(t, x, u)
        torques: dict[str, Array | None] = {"drives": drives}
        net = 0 * qd if drives is None else drives
        for name in ("viscous", "coulomb"):
            if self.friction is not None and name in self.ledger:
                torques[name] = torque = getattr(self.friction, f"{name}_torque")(qd)
                net = net - torque
        if self.friction is not None and "offset" in self.ledger:
            torques["offset"] = np.asarray(self.friction.offset)
            net = net - torques["offset"]
        if self.friction is not None and "load" in self.ledger:
            passed = self.friction.transmitted(net, qd)
            torques["load"], net = net - passed, passed
        further = [*further, *self._powers(qd, torques)]
        if self.cost is not None:
            moved = x[..., : self.joints], x[..., self.n : self.n + self.joints]
            further.append(self.cost(t, *moved, 0 * qd if drives is None else drives))
        return net, further

    def _damping(self, qd: Array) -> list[Any]:
        """Increment of the inertia of each drive's joint by implicit viscous friction over a step, (...) each."""
        if not self.damped_over or self.friction is None or "viscous" not in self.ledger:
            return [0.0] * self.joints
        return list(np.moveaxis(self.damped_over * viscous_slope(self.friction, qd), -1, 0))

    def _damped(self, model: Model, qd: Array) -> Model:
        """Robot with viscous friction over a step as added rotor inertia, (nb, ...), for dynamics only."""
        if not is_present(added := self._damping(qd)):
            return model
        armature = [*model.armature]
        for i, inertia in zip(model.independent_joints, added, strict=True):
            armature[i] = armature[i] + inertia
        return with_unchecked(model, armature=np.stack(np.broadcast_arrays(*armature)))

    def right_hand_side_core(self, model: Model, t: Array, x: Array, u: Array | None = None) -> Any:
        """(dx/dt, pivots, diagonal of M), traced."""
        q, qd = x[..., : self.n], x[..., self.n : 2 * self.n]
        net, further = self._acting(model, t, x, u)
        note_finite(net)  # else a division in friction or a law would cast doubt on all that follows
        qdd, pivots, diagonal = self.forward.quantity.core(self._damped(model, qd), q, qd, net)
        return np.concatenate([qd, qdd, *further], axis=-1), pivots, diagonal

    def rates_and_drives_core(self, model: Model, t: Array, x: Array, u: Array | None = None) -> Any:
        """([dx/dt, torques of the drives], pivots, diagonal of M), traced."""
        rates, pivots, diagonal = self.right_hand_side_core(model, t, x, u)
        return np.concatenate([rates, self.drive_torques_core(model, t, x, u)], axis=-1), pivots, diagonal

    def drive_torques_core(self, model: Model, t: Array, x: Array, u: Array | None = None) -> Array:
        """Torques of the drives within their limits."""
        drives, _ = self.drives(t, x, u)
        return 0 * x[..., : self.joints] if drives is None else drives

    def accelerations_core(self, model: Model, t: Array, x: Array, u: Array | None = None) -> Array:
        """Rates dx/dt without the rates of positions, which are entries of the state."""
        rates: Array = self.right_hand_side_core(model, t, x, u)[0]
        return rates[..., self.n :]

    def net_core(self, model: Model, t: Array, x: Array, u: Array | None = None) -> Array:
        """Net torques."""
        return self._acting(model, t, x, u)[0]

    def residual_core(self, model: Model, t: Array, x: Array, a: Array, u: Array | None = None) -> Any:
        """[M a + C qd + g - net torques, rates of the states after (q, qd)] at accelerations a, traced."""
        net, further = self._acting(model, t, x, u)
        needed = inverse_dynamics.core(model, x[..., : self.n], x[..., self.n : 2 * self.n], a)
        return np.concatenate([needed - net, *further], axis=-1)

    def right_hand_side_under_modes_core(self, model: Model, t: Array, x: Array, u: Array) -> Any:
        """([dx/dt, loads, net torques without dry friction], pivots, their diagonal) while some joints stick, traced.

        `u` ends with the modes: 1 for each joint that slips and 0 for one that sticks, then the dry friction torques of
        those that slip; loads are these, and what holds the joints that stick. The place of a sticking joint's rate has
        the acceleration that its load would give it if nothing held it, for the error control to follow.
        """
        assert self.friction is not None
        n, given, modes, dry = self.n, u[..., : -2 * self.n], u[..., -2 * self.n : -self.n], u[..., -self.joints :]
        slips = modes[..., self.driven]
        qd = slips * x[..., n : 2 * n][..., self.driven]
        x = np.concatenate([x[..., : 2 * n - self.joints], qd, x[..., 2 * n :]], axis=-1)
        drives, further = self.drives(t, x, given if self.torque_given else None)
        viscous, offset = self.friction.viscous_torque(qd), np.asarray(self.friction.offset)
        bodies, links, lost = self._reaction(model, x)
        resisting = bodies + viscous + offset
        net = -resisting if drives is None else drives - resisting
        qdd, loads, net, inertia, pivots, diagonal = self._balance(model, x, slips, dry, net, links)
        held = (1 - modes) * loads / (modes + (1 - modes) * inertia)
        torques = {"drives": drives, "viscous": viscous, "coulomb": dry, "offset": offset}
        further = [*further, *self._powers(qd, torques), *lost]
        return np.concatenate([x[..., n : 2 * n], qdd + held, *further, loads, net], axis=-1), pivots, diagonal

    def _reaction(self, model: Model, x: Array) -> tuple[Array, Any, list[Array]]:
        """Torques of bodies and springs on the drives, those on links of elastic joints, and powers that are lost."""
        bias = bias_torque.core(model, x[..., : self.n], x[..., self.n : 2 * self.n])
        if self.springs is None:
            return bias, None, []
        held, lost = self._held(model, x)
        return bias + held, None, lost

    def _balance(self, model: Model, x: Array, slips: Array, dry: Array, net: Array, links: Any) -> tuple[Any, ...]:
        """Accelerations, loads, net torques without dry friction, M's diagonal, pivots.

        The rows and columns of sticking joints in M are those of the unit matrix: M_ss qdd_s = (net - dry)_s.
        """
        M = mass_matrix.core(model, x[..., : self.n])
        among = M * slips[..., :, None] * slips[..., None, :] + np.eye(self.n) * (1 - slips)[..., None]
        qdd, pivots, diagonal = solve_with_pivots(among, model.coordinate_parent, slips * (net - dry))
        loads = slips * dry + (1 - slips) * (net - rotate(M, qdd))
        return qdd, loads, net, np.diagonal(M, axis1=-2, axis2=-1), pivots, diagonal

    def _judged(self, check: str, model: Model, arguments: Any, rates: Array, pivots: Array, diagonal: Array) -> Any:
        """Check of the mass matrix; one by one where numbers other than those of bodies differ between states."""
        numbers, status = arguments["numbers"], OK
        rows = numbers.reshape(-1, numbers.shape[-1]) if numbers.size else numbers[None]
        if numbers.ndim < 2 or not (rows != rows[:1])[:, ~self._side_by_side].any():
            model = self._model_at(model, numbers)
            if self.springs is not None:
                self.springs.check_ends(model, arguments["x"][..., : self.joints])
            return getattr(self, check)(model, arguments, rates, pivots, diagonal)
        for k in np.ndindex(numbers.shape[:-1]):
            own = {name: a[k] for name, a in arguments.items()}
            found = self._judged(check, model, own, rates[k], pivots[k], diagonal[k])
            status = status.worse(found.with_state(lambda _, k=k: k))
        return status

    def _check_rates(
        self, model: Model, arguments: Any, rates: Array, pivots: Array, diagonal: Array
    ) -> PrecisionStatus:
        x, joints = arguments["x"], slice(self.n, self.n + self.joints)
        net = self.core_at("net_core", model, **arguments)
        q, qd = x[..., : self.joints], x[..., joints]
        state = {"q": q, "qd": qd, "tau": np.broadcast_to(net[..., : self.joints], q.shape)}
        return check_accelerations(model, state, np.asarray(rates[..., joints]), pivots, diagonal)

    def _check_balance(
        self, model: Model, arguments: Any, rates: Array, pivots: Array, diagonal: Array
    ) -> PrecisionStatus:
        return check_singularity(model, {"q": arguments["x"][..., : self.joints]}, rates, pivots, diagonal)

    def _declared(
        self, name: str, title: str, *, a: bool = False, modes: bool = False, start: bool = False, **how: Any
    ) -> MethodQuantity:
        """Declared function with the lengths of its arguments: t, x, perhaps a, u where there are inputs, piece."""
        inputs = (self.joints + self.states if self.torque_given else 0) + (2 * self.n if modes else 0)
        widths: dict[str, int | None] = {"q": self.joints} if start else {"t": 1, "x": self.size}
        widths |= {"a": self.n} if a else {}
        widths |= {"u": inputs} if modes or (self.torque_given and not start) else {}
        widths |= {} if self.law is None or start else self.law.piece_width
        widths["numbers"] = len(self.vector)
        core = partial(self.template.core_at, f"{name}_core")
        how |= {"check": partial(self.template._judged, how["check"])} if "check" in how else {}
        how |= {"core": core, "moments": True, "base_parameters": True, "of_run": "numbers"}
        how |= {"analytic": not start and self.law is None and type(self.friction) in (type(None), Friction)}
        return MethodQuantity(self.template, Quantity(name=name, widths=widths, **how), title)

    @cached_property
    def right_hand_side(self) -> MethodQuantity:
        """dx/dt."""
        velocities = ("x", slice(self.n, self.n + self.joints))
        how: dict[str, Any] = {"check": "_check_rates", "velocities": velocities}
        return self._declared("right_hand_side", "the right-hand side", **how)

    rates_and_drives = declared("rates_and_drives", "the right-hand side", check="_check_rates")  # dx/dt, then torques
    drive_torques = declared("drive_torques", "the torques of the drives")
    accelerations = declared("accelerations", "the accelerations")  # dx/dt without the rates of positions
    residual = declared("residual", "the equations of motion", a=True)  # its derivatives linearise the motion
    start_of_motors = declared("start_of_motors", "the start of the motors", start=True)  # as a function of the links'
    right_hand_side_under_modes = declared(
        "right_hand_side_under_modes", "the right-hand side", modes=True, check="_check_balance"
    )
