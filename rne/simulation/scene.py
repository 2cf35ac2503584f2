"""Scene: the modelled parts of a robot and its surroundings. Parts that are not given add no operations."""

from __future__ import annotations

import logging
import os
import weakref
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from copy import copy
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, ClassVar, NamedTuple, Protocol, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike

from ..basics.arrays import UNBOUNDED, ReadOnlyArrays, per_joint_array, positive_number, read_only, vector
from ..basics.spatial import Array
from ..basics.text import listed, summary
from ..control.feedback_loop import LinearisedLoop
from ..control.law_numbers import models_of, numbers_of, samples_of
from ..control.traced_law import TracedLaw, check_law, check_sample_time, is_discrete, is_ours
from ..kernels.cache import KernelCache
from ..kernels.kernel import Kernel, with_table
from ..model.model import joint_array
from ..model.modify import LimitValues, limit_array
from ..robot import Robot
from .elastic_joints import ElasticDynamics, ElasticJoints, part_at_joints
from .friction import Friction, one_per_joint, urdf_friction
from .scene_dynamics import Bodies, MotorSide, SceneDynamics
from .scene_numbers import BODIES, SceneNumbers, moments_of_payloads, numbers_of_scene, scene_at
from .scene_numbers import checked as checked_numbers
from .springs import JointSpring, Spring, Springs, resolved_springs

LOGGER = logging.getLogger("rne")
GIVEN = "mounting", "gravity", "payload", "locked", "armature", "effort_limit", "torque_rate", "springs"
_announced: weakref.WeakValueDictionary[int, Any] = weakref.WeakValueDictionary()  # laws that are called, by id


class Payload(NamedTuple):
    """A rigid body fixed to a link, for a Scene.

    Parameters
    ----------
    mass : float
        Mass of the body [kg].
    com : array_like, shape (3,)
        Its centre of mass in the link's frame; the link's origin if not given [m].
    inertia : array_like, shape (3, 3), or None
        About its centre of mass, in the link's axes; None for a point mass [kg m^2].
    link : str, optional
        One of the robot's links. If not given, the last link of the chain, a fixed frame such as a flange distal to
        the last joint included.

    Examples
    --------
    >>> import rne
    >>> scene = rne.Scene(rne.load("irb140"), payload=rne.Payload(5.0, com=[0, 0, 0.1]))
    >>> scene.resolved.robot.model.mass[-1].item()  # with 1 kg of the last link
    6.0
    """

    mass: float
    com: ArrayLike = (0.0, 0.0, 0.0)
    inertia: ArrayLike | None = None
    link: str | None = None


@runtime_checkable
class HasPayload(Protocol):
    """Object with an estimated payload, such as an rne.identification.PayloadEstimate."""

    @property
    def payload(self) -> Payload: ...


def payload_argument(given: Payload | HasPayload | float) -> Payload:
    """Payload from a Payload, an estimate, or a mass."""
    given = given.payload if isinstance(given, HasPayload) else given
    if isinstance(given, Mapping) or (isinstance(given, tuple) and not 1 <= len(given) <= len(Payload._fields)):
        got = f"{len(given)} values" if isinstance(given, tuple) else type(given).__name__
        raise ValueError(f"`payload` must be a mass or rne.Payload(mass, com, inertia, link), got {got}")
    return Payload(*given) if isinstance(given, tuple) else Payload(given)


def _kept(given: Any) -> Any:
    """Copy of a part of a scene: mappings, sequences and arrays are copied."""
    if isinstance(given, Mapping):
        return dict(given)
    is_list = isinstance(given, Sequence) and not isinstance(given, str)
    return read_only(tuple(given) if is_list else given)


@dataclass(frozen=True, eq=False)
class ResolvedScene(ReadOnlyArrays):
    """Parts of a scene in numbers, for the simulation."""

    robot: Robot  # mounted, with payload, joints locked, the drives' inertia added
    friction: Friction | None
    effort_limit: Array | None  # (n,), largest torque of each drive; None if none is limited [N m or N]
    torque_rate: Array | None  # (n,), largest change of a held torque per second [N m/s or N/s]
    motor_side: MotorSide | None  # of elastic joints, whose robot has no rotors
    springs: Springs | None  # those that move


@dataclass(frozen=True, eq=False)
class Scene:
    """A robot with all that a simulation models: payload, friction, springs, limits, stops, a controller.

    Parameters
    ----------
    robot : Robot
        The robot without the parts below.
    mounting : array_like, shape (3,), optional
        Roll, pitch and yaw of the root link in the world; see `rne.model.mounted` [rad].
    gravity : array_like, shape (3,), optional
        Gravity instead of the robot's, in the axes of the root link before it is turned [m/s^2].
    payload : Payload, PayloadEstimate or float, optional
        A body on a link, given or found by `rne.identify_payload`, or the mass of a point mass at the origin of the
        last link [kg].
    locked : mapping of str to float, optional
        Joints held at a position, by name; they are not coordinates of the scene [rad or m].
    friction : Friction or "urdf", optional
        "urdf" takes the damping and friction of the file's `<dynamics>`. Under Coulomb friction that is smoothed, as
        by default, joints at rest creep: `Friction(..., smoothing=0)` holds them.
    armature : float, array_like of shape (nb,), or mapping, optional
        Inertias of rotors at the joints that move, instead of the robot's: see `Robot.with_armature` [kg m^2 or kg].
    effort_limit : float or array_like, shape (n,), or "urdf", optional
        Largest torque of each drive; "urdf" takes the file's `effort`, as far as it limits any [N m or N].
    torque_rate : float or array_like, shape (n,), optional
        Largest change of a drive's torque per second, from one sample to the next; the first sample's torque is taken
        as if it had been held before the start [N m/s or N/s].
    stops : bool
        True to end a run, with status 1, when a joint reaches a limit of its range.
    controller : callable, optional
        A control law: f(t, q, qd) -> torques, or, with an attribute `states`, f(t, q, qd, z) -> (torques, dz/dt), or,
        if it also has ``discrete = True``, -> (torques, z at the next sample), which needs a `sample_time`. Marked by
        `rne.traceable` it becomes part of the kernel if possible, otherwise it is called.
    sample_time : float, optional
        The controller is evaluated every `sample_time`, and its torque is held in between; its states follow Euler's
        rule, z + `sample_time` dz/dt, or are those that a discrete law returns [s].
    elastic : ElasticJoints, optional
        Flexible transmissions between motors and links.
    springs : sequence of Spring, optional
        Springs between links or at joints. Their energy counts as potential energy. Springs at locked joints, or
        between links that these hold together, do nothing.
    delay : float, optional
        A sampled controller's torque acts this long after its sample, until the next one's does; none acts before the
        first has arrived [s].

    Raises
    ------
    ValueError
        If a part has the wrong shape, is negative or not finite, or needs another part that is not there.
    TypeError
        If a part has the wrong type, or the controller takes other arguments.

    Examples
    --------
    >>> import rne
    >>> scene = rne.Scene(rne.load("irb140"), gravity=[0, 0, 0], locked={"joint_4": 0, "joint_5": 0, "joint_6": 0})
    >>> scene.n, sum(scene.kernel.operations.values()) < 160
    (3, True)
    >>> payload, friction = rne.Payload(5.0, [0.1, 0, 0.1]), rne.Friction(viscous=2.0)
    >>> scene = rne.Scene(rne.load("irb140"), payload=payload, friction=friction)
    >>> tau = scene.inverse_dynamics([0] * 6, [1] * 6, [3] * 6)
    >>> scene.forward_dynamics([0] * 6, [1] * 6, tau).round(9).tolist()
    [3.0, 3.0, 3.0, 3.0, 3.0, 3.0]
    >>> scene.cost()["payload"] > 0
    True
    >>> scene.to_fmu("irb140.fmu")  # doctest: +SKIP
    ('x86_64-linux', 'x86_64-windows', 'x86_64-darwin')
    """

    robot: Robot
    mounting: ArrayLike | None = None
    gravity: ArrayLike | None = None
    payload: Payload | HasPayload | float | None = None
    locked: Mapping[str, float] | None = None
    friction: Friction | str | None = None
    armature: LimitValues = None
    effort_limit: ArrayLike | str | None = None
    torque_rate: ArrayLike | None = None
    stops: bool = False
    controller: Any = None
    sample_time: float | None = None
    elastic: ElasticJoints | None = None
    springs: Sequence[Spring | JointSpring] | None = None
    delay: float | None = None

    _named: ClassVar[frozenset[str]] = frozenset()  # numbers that are inputs of kernels as wholes, set by `naming`
    varying: ClassVar[Array | None] = None  # mask of the bodies' moments that are inputs, unless the nonzero ones are

    __repr__ = summary

    def __post_init__(self) -> None:
        if not isinstance(self.robot, Robot):
            raise TypeError(f"`robot` must be an rne.Robot, got {type(self.robot).__name__}")
        if not isinstance(self.stops, bool | np.bool_):
            raise TypeError(f"`stops` must be True or False, got {type(self.stops).__name__}")
        if not isinstance(self.elastic, ElasticJoints | None):
            raise TypeError(f"`elastic` must be an rne.ElasticJoints, got {type(self.elastic).__name__}")
        self._check_sampling()
        for name in GIVEN:  # the caller may change it later
            object.__setattr__(self, name, _kept(getattr(self, name)))
        if self.payload is not None:
            object.__setattr__(self, "payload", Payload(*map(read_only, payload_argument(self.payload))))
        _ = self.resolved  # raises the errors in the parts
        self._check_robot_of_controller()

    def _check_sampling(self) -> None:
        """Check the controller and the arguments that only a sampled one has."""
        if self.controller is not None:
            check_law("controller", self.controller)
        self._check_discrete()
        if self.sample_time is not None:
            if self.controller is None:
                raise ValueError("`sample_time` needs a `controller`")
            positive_number("sample_time", self.sample_time)
        if self.torque_rate is not None and self.sample_time is None:
            raise ValueError(
                "`torque_rate` needs a `sample_time`: it limits the change from one held torque to the next"
            )
        if self.delay is not None:
            if self.sample_time is None:
                raise ValueError("`delay` needs a `sample_time`: it is that of a sampled controller's torques")
            positive_number("delay", self.delay, zero_allowed=True)

    def _check_discrete(self) -> None:
        """Check that a controller whose states change from sample to sample is sampled."""
        if self.sample_time is None and is_discrete(self.controller):
            raise ValueError("`controller` is discrete: its states change from sample to sample; give a `sample_time`")
        check_sample_time(self.controller, self.sample_time)

    def _check_robot_of_controller(self) -> None:
        """Check that a controller made for a robot is used with this one."""
        meant_for = getattr(self.controller, "robot", None)
        if not isinstance(meant_for, Robot):
            return
        if meant_for.n != self.n:
            raise ValueError(f"`controller` is for a robot of {meant_for.n} joints, the scene has {self.n}")
        if meant_for.joint_names != self.resolved.robot.joint_names:
            names = (listed(robot.joint_names) for robot in (meant_for, self.resolved.robot))
            raise ValueError("`controller` is for a robot with the joints {}; the scene has {}".format(*names))
        if self.elastic is not None and self.elastic.reads == "both" and is_ours(self.controller):
            raise ValueError(f"`controller` reads {self.n} numbers: `reads` of `elastic` must be 'motor' or 'link'")

    @cached_property
    def resolved(self) -> ResolvedScene:
        """Parts of the scene in numbers."""
        robot, motor_side = self._resolved_robot(), None
        if self.elastic is not None:
            robot, motor_side = part_at_joints(robot, self.elastic)
        friction = resolved_friction(self.friction, robot)
        effort, rate = (resolved_limits(k, getattr(self, k), robot) for k in ("effort_limit", "torque_rate"))
        springs = resolved_springs(self.springs or (), self.robot, robot)
        return ResolvedScene(robot, friction, effort, rate, motor_side, springs)

    def _resolved_robot(self) -> Robot:
        robot = self.robot
        if self.gravity is not None:
            robot = robot.with_model(replace(robot.model, gravity=vector("gravity", self.gravity, 3)))
        if self.mounting is not None:
            robot = robot.mounted(self.mounting)
        if self.payload is not None:
            robot = robot.with_payload(*payload_argument(self.payload))
        if self.locked is not None:
            robot = robot.locked(self.locked)
        return robot.with_armature(self.armature)

    @property
    def n(self) -> int:
        """Number of joint coordinates, without locked joints."""
        return self.resolved.robot.model.n

    @property
    def dynamics(self) -> SceneDynamics:
        """Equations of motion of the scene with the present controller; equal scenes share their kernels."""
        law = self.traced_law() if self.sample_time is None else None
        return self.dynamics_without_law if law is None else self.dynamics_under("none", law)

    @property
    def dynamics_without_law(self) -> SceneDynamics:
        """The equations of motion with the torques of a controller as an input."""
        inputs = "none" if self.controller is None else "called" if self.sample_time is None else "held"
        return self.dynamics_under(inputs)

    def dynamics_under(self, inputs: str, law: TracedLaw | None = None) -> SceneDynamics:
        """The equations of motion with torques of a controller as inputs ("called", "held") or of a traced law."""
        parts, is_held, kernels = self.resolved, self.sample_time is not None, self.kernels
        limit, states = parts.effort_limit, 0 if is_held else int(getattr(self.controller, "states", 0))
        if states:
            self._check_discrete()  # it may have become so
        known: SceneDynamics | None = self.__dict__.get(f"_dynamics_{inputs}")
        if known is not None and known.law is law and known.states == states:
            return known
        has_impulses, side = limit is not None and self.controller is not None and not is_held, parts.motor_side
        inertia = kernels.typical_inertia.tolist() if side is None else side.rotor
        known = self.__dict__[f"_dynamics_{inputs}"] = (SceneDynamics if side is None else ElasticDynamics)(
            parts.robot.n * (1 if side is None else 2),
            kernels.forward_method,
            parts.friction and one_per_joint(parts.friction, parts.robot.n, self._named_of("friction.")),
            None if limit is None else tuple(limit.tolist()),
            law,
            inputs,
            states,
            tuple(inertia) if has_impulses else None,
            motor_side=side,
            springs=parts.springs,
            bodies=Bodies.of(parts.robot.model, self.varying) if self._named & {*BODIES} else None,
            named=self._named,
        )
        return known

    def _named_of(self, part: str) -> frozenset[str]:
        return frozenset(name.removeprefix(part) for name in self._named if name.startswith(part))

    @property
    def kernels(self) -> KernelCache:
        """Kernels of the scene: those of its robot, or of the robot whose bodies are numbers."""
        return self.__dict__.get("_kernels") or self.resolved.robot.kernels

    @property
    def numbers(self) -> SceneNumbers:
        """Numbers that may change without recompilation, by name: read-only arrays in SI units.

        "friction.<field>", one number per joint (`smoothing` is one); "effort_limit", "torque_rate", (n,); "delay";
        "controller.<name>" of the floats and arrays of floats that a law holds, as fields, attributes, in the cells of
        its closure or as defaults, and of the samples of a spline that it follows, (K, n); "springs[k].<field>";
        "elastic.<field>", (n,). By a second program: "parameters", (10 nb,), of the robot with its payload as
        `Robot.parameters`; "payload", (10,), of only the added body, about the origin of its link; "armature", (nb,);
        "gravity", (3,), as the scene takes it. Its print says the units. Parts that the scene does not have give no
        names.

        Examples
        --------
        >>> import rne
        >>> scene = rne.Scene(rne.load("irb140"), friction=rne.Friction(viscous=2.0))
        >>> scene.numbers["friction.viscous"].tolist()
        [2.0, 2.0, 2.0, 2.0, 2.0, 2.0]
        """
        return SceneNumbers(numbers_of_scene(self))

    @property
    def numbers_of_controller(self) -> dict[str, Array]:
        """Numbers of the controller that can be traced."""
        if self.controller is None:
            return {}
        found = numbers_of(self.controller)
        if getattr(self.controller, "traceable", False):  # those that it decides on, if only where they are 0, are none
            how = self.dynamics_without_law.law_inputs, frozenset(found), self.kernels
            law = TracedLaw.known(self.controller, self.n, *how)
            found = found if law.formula[1] is None else law.numbers
        models = models_of(self.controller, self._named_of("controller."))
        return {f"controller.{name}": x for name, x in (found | models | samples_of(self.controller)).items()}

    def with_numbers(self, numbers: Mapping[str, ArrayLike]) -> Scene:
        """Scene with other numbers, which runs the same program.

        Parameters
        ----------
        numbers : mapping of str to array_like
            By the names of `numbers`, in their shapes, or one number for all joints. An array that is named here stays
            an input as a whole from then on, zeros included; infinite limits stay no limits.

        Returns
        -------
        Scene
            Equal to one that is made with these numbers; its parts check them.

        Raises
        ------
        KeyError
            If the scene has no such number; lists those that it has.
        ValueError
            If an array has the wrong shape, has a NaN, or an infinity where it is no limit, or does not fit its part.
        TypeError
            If `numbers` is no mapping.

        Examples
        --------
        >>> import rne
        >>> arm = rne.load("irb140")
        >>> scene = rne.Scene(arm, controller=rne.control.pd_gravity(arm, 50, 20, 0), friction=rne.Friction(viscous=2))
        >>> stiffer = scene.with_numbers({"controller.kp": 80.0, "friction.viscous": [1, 1, 1, 2, 2, 2]})
        >>> stiffer.controller.kp[0].item(), stiffer.friction.viscous.tolist()
        (80.0, [1.0, 1.0, 1.0, 2.0, 2.0, 2.0])
        """
        return self.naming(checked_numbers(self, numbers), numbers)

    def naming(self, numbers: Mapping[str, Array], names: Iterable[str], varying: Array | None = None) -> Scene:
        """Scene with other, checked numbers; `names` are inputs of its kernels as wholes."""
        found = scene_at(self, numbers) if numbers else copy(self)
        for name in [key for key in vars(found) if key.startswith("_dynamics_") or key == "_law_before"]:
            del vars(found)[name]
        named = self._named | set(names)
        vars(found)["_named"] = named
        if named & {*BODIES}:
            vars(found)["_kernels"], before = self.kernels, self.varying
            of_payloads = moments_of_payloads(found) if "payload" in named and found.payload is not None else None
            mask = [m for m in (varying, before, of_payloads) if m is not None]
            if mask:
                vars(found)["varying"] = np.logical_or.reduce([*mask, Bodies.mask(found.resolved.robot.model)])
        return found

    @property
    def _law(self) -> TracedLaw:
        """Controller in its present state."""
        given = self.dynamics_without_law.law_inputs
        law = TracedLaw.known(self.controller, self.n, given, self._named_of("controller."), self.kernels)
        before: TracedLaw | None = self.__dict__.get("_law_before")
        same = before == law and before.law is law.law and before.table is law.table
        if before is not None and same and np.array_equal(before.vector, law.vector):
            return before
        self.__dict__["_law_before"] = law
        return law

    def traced_law(self) -> TracedLaw | None:
        """Traced controller, if it can be; logs a line if it is marked as traceable but cannot."""
        if not getattr(self.controller, "traceable", False):
            return None
        law = self._law
        reason = law.why_not_traced(self.kernels)
        if reason is None:
            return law
        if _announced.get(id(self.controller)) is not self.controller:
            LOGGER.warning("`controller` is called, not traced: %s", reason)
            with suppress(TypeError):  # an object without weak references
                _announced[id(self.controller)] = self.controller
        return None

    @property
    def traced_samples(self) -> TracedLaw | None:
        """Sampled controller in machine code, if possible."""
        if self.sample_time is None or self.resolved.robot.engine != "numba":
            return None
        return self.traced_law()

    @property
    def is_traced(self) -> bool:
        """True if the controller is part of the kernel, False if it is called or there is none."""
        return self.dynamics.law is not None

    @property
    def why_called(self) -> str:
        """Reason why a controller is called rather than traced."""
        law = self._law if getattr(self.controller, "traceable", False) else None
        why = law.why_not_traced(self.kernels) if law else "it is not marked by rne.traceable"
        return why or "a sampled law is called at each sample; engine 'numba' samples it in machine code"

    @property
    def kernel(self) -> Kernel:
        """Kernel of the whole right-hand side, including the controller if it is traceable."""
        dynamics = replace(self.dynamics, has_energies=False)
        numbers = tuple(dynamics.vector.tolist())
        return with_table(self.kernels.scene_kernel(dynamics.right_hand_side, numbers=numbers), dynamics.table)

    def to_casadi(
        self, name: str = "scene", *, symbolic: str = "SX", steps: int | None = None, parameters: bool = False
    ) -> Any:
        """The equations of motion as a CasADi function, with friction, limits and a traced controller.

        Parameters
        ----------
        name : str
            Name of the function.
        symbolic : {"SX", "MX"}
            Scalar operations, or calls of a function made of scalar operations.
        steps : int, optional
            Runge-Kutta steps of order 4 from t to t + h, for a function in discrete time. They diverge, which a solver
            may not notice, where something decays faster than 2.7 steps / h: friction at a joint of inertia m decays at
            (viscous + coulomb / smoothing) / m, which is thousands per second at the default smoothing.
        parameters : bool
            True for the inertial parameters of the robot with its payload as an argument, such as
            `scene.resolved.robot.parameters`. Laws keep the parameters of their own robot.

        Returns
        -------
        casadi.Function
            Of t and x = (q, qd, the law's states), with elastic joints (q, motor_q, qd, motor_qd, ...), of torques u
            where there is no controller, of `parameters`, and of the `piece` of samples that the controller follows,
            `scene.kernel.piece([t])`, the same for all `steps`. It gives dx, the rate of x, and tau, the drives'
            torques within their limits. With `steps` it has h as last argument and gives x_next instead of dx, with u
            held. It checks nothing.

        Raises
        ------
        ValueError
            If a part is no function of time and state: a sampled or called controller, dry friction that sticks, stops.
        ImportError, TypeError
            If CasADi is missing, or the equations are too large to be written out.

        Examples
        --------
        >>> import rne
        >>> scene = rne.Scene(rne.load("irb140"), payload=2.0, friction=rne.Friction(viscous=1.0))
        >>> scene.to_casadi(steps=1)  # doctest: +SKIP
        Function(scene:(t,x[12],u[6],h)->(x_next[12],tau[6]) SXFunction)
        """
        from ..kernels.exports.casadi import scene_to_casadi

        dynamics, model = self.exported(), self.resolved.robot.model
        fixed = {"parameters": parameters, "numbers": tuple(dynamics.vector.tolist())}
        return scene_to_casadi(Kernel(dynamics.rates_and_drives, model, fixed), name, symbolic, steps)

    def to_fmu(
        self,
        path: str | os.PathLike[str],
        *,
        fmi: str = "2.0",
        q0: ArrayLike | None = None,
        qd0: ArrayLike | None = None,
        payload: str | None = None,
        numbers: Sequence[str] = (),
        derivatives: bool = True,
        platforms: Sequence[str] | None = None,
    ) -> tuple[str, ...]:
        """Write a Functional Mock-up Unit: the arm with torques as inputs, or the closed loop with references.

        Parameters
        ----------
        path : str or path
            The file, such as "arm.fmu"; one that exists is replaced.
        fmi : {"2.0", "3.0"}
            The standard; each has model exchange and co-simulation.
        q0, qd0 : array_like, shape (n,), optional
            Initial values of the parameters `q0[1]`, ..., 0 if not given; motors of elastic joints follow from them, or
            are given after the links, (2 n,) [rad or m; rad/s or m/s].
        payload : str, optional
            A link that carries a body whose mass, centre of mass and inertia are parameters, `payload.mass`, ...; they
            start at the values of the scene's payload, or at 0.
        numbers : sequence of str
            Names of `numbers` that are parameters, and "payload.mass", only the mass of the scene's payload.
        derivatives : bool
            False without directional derivatives: a smaller file.
        platforms : sequence of str, optional
            Platforms of the binaries, such as "x86_64-linux". By default all, with the extra `fmu`, or this machine's,
            with its compiler; without either the unit has only sources, and the logger says so.

        Returns
        -------
        tuple of str
            The platforms whose binaries are inside.

        Raises
        ------
        ValueError
            If a part is no function of time and state: a called controller, dry friction that sticks, `torque_rate`;
            or an argument has the wrong shape or name.
        TypeError, ImportError, RuntimeError
            If the equations are too large to be written out, or no compiler for `platforms` is there, or it fails.

        Notes
        -----
        A constant reference of the controller is an input. Sampled controllers sample and hold by themselves, with
        their delay; `stops` end the simulation. Binaries for Windows and macOS are built, but have never been run.
        For the first unit on a machine Zig compiles its C libraries, for all platforms 90 s of one core, for one 5 s.
        """
        from .fmu_model import SceneUnit

        return SceneUnit(self, q0, qd0, payload, tuple(numbers), derivatives).write(path, fmi, platforms)

    def exported(self) -> SceneDynamics:
        """Equations as a function of time, state and perhaps torques; a ValueError for parts without such a form."""
        friction, controller, refused = self.resolved.friction, self.controller, ""
        if self.stops:
            refused = "`stops` end a run: set `stops` to False, and bound the positions"
        elif friction is not None and friction.sticks:
            refused = (
                "dry `friction` sticks and slips by events: give it a `smoothing` above 0, a large one for `steps`"
            )
        elif controller is not None and (self.sample_time is not None or not self.is_traced):
            how = "sampled" if self.sample_time is not None else f"called, as {self.why_called}"
            refused = f"`controller` is {how}; without it the torques are an argument u"
        if refused:
            raise ValueError(f"no function of time and state: {refused}")
        inputs = "called" if controller is None else "none"
        return replace(self.dynamics, inputs=inputs, inertia=None, has_energies=False)

    def inverse_dynamics(self, q: ArrayLike, qd: ArrayLike, qdd: ArrayLike) -> Array:
        """Torques of the drives for given accelerations, friction and springs included.

        Parameters
        ----------
        q, qd, qdd : array_like, shape (..., n)
            Joint positions, velocities and accelerations [rad or m; rad/s or m/s; rad/s^2 or m/s^2].

        Returns
        -------
        ndarray, shape (..., n)
            Torques of the drives [N m or N].

        Raises
        ------
        ValueError
            If an array has the wrong shape or is not finite, or the torque overflows.
        """
        self.refuse_elastic("inverse_dynamics", "torques of drives also depend on how accelerations change")
        robot, friction = self.resolved.robot, self.resolved.friction
        load = robot.inverse_dynamics(q, qd, qdd)
        if self.resolved.springs is not None:
            load = load + self.resolved.springs.torque(robot, q, qd)
        return load if friction is None else load + friction.torque(robot.model, qd, load)

    def forward_dynamics(self, q: ArrayLike, qd: ArrayLike, tau: ArrayLike) -> Array:
        """Accelerations under the drives' torques, friction and springs included.

        Parameters
        ----------
        q, qd, tau : array_like, shape (..., n)
            Joint positions, velocities and the drives' torques [rad or m; rad/s or m/s; N m or N].

        Returns
        -------
        ndarray, shape (..., n)
            Accelerations [rad/s^2 or m/s^2]. Dry friction has the size of slipping; at rest, where it may hold, it is
            left out.

        Raises
        ------
        ValueError
            If an array has the wrong shape or is not finite, or the acceleration overflows.
        SingularMassMatrixError
            If M is singular to working precision.
        """
        self.refuse_elastic("forward_dynamics", "accelerations follow from the torsion, not from the drives' torques")
        robot, friction = self.resolved.robot, self.resolved.friction
        net = joint_array("tau", tau, robot.model)
        if friction is not None:
            net = net - friction.torque(robot.model, qd, np.zeros(robot.n))
            net = friction.transmitted(net, joint_array("qd", qd, robot.model)) if "load" in friction.losses else net
        if self.resolved.springs is not None:
            net = net - self.resolved.springs.torque(robot, q, qd)
        return robot.forward_dynamics(q, qd, net)

    def refuse_elastic(self, name: str, why: str, cure: str = "use scene.resolved.robot for the links alone") -> None:
        """Raise a ValueError if the scene has elastic joints."""
        if self.elastic is not None:
            raise ValueError(f"`{name}` is not for elastic joints: {why}; {cure}")

    def check_gains(self, q: ArrayLike) -> LinearisedLoop:
        """Stability of the closed loop near a target, for any controller, by linearisation.

        PD gains over the whole workspace are `rne.check_gains`.

        Parameters
        ----------
        q : array_like, shape (n,)
            The target, at which the scene is at rest [rad or m].

        Returns
        -------
        LinearisedLoop
            Poles, windows of sample times, margins of gain and delay, and whether the target is an equilibrium.

        Raises
        ------
        ValueError
            If there is no controller, or one that has noise or torques that jump at the target; if friction sticks, or
            `q` has the wrong shape or is not finite.

        Notes
        -----
        The loop includes the scene's delay, springs and elastic joints; the motors are where they hold the links at
        rest. A controller with memory that is not in its `states` gives a warning.

        Examples
        --------
        >>> import numpy as np, rne
        >>> arm, q = rne.load("irb140"), np.array([0, 0, 0, 0, 1.0, 0])
        >>> law = rne.control.impedance(arm, "tool0", [50] * 3 + [1000] * 3, [5] * 3 + [80] * 3, arm.link_poses(q)[-1])
        >>> rne.Scene(arm, controller=law, sample_time=1e-3).check_gains(q).stable
        False
        """
        from .linearised_loop import linearised_loop

        target, friction = per_joint_array("q", q, self.n), self.resolved.friction
        if self.controller is None:
            raise ValueError("`controller` of the scene must be given")
        if friction is not None and friction.sticks:
            raise ValueError("dry `friction` holds the joints at the target: leave it out, or give it a `smoothing`")
        return linearised_loop(self, target)

    def cost(self) -> dict[str, int | str | None]:
        """Operations per call of the right-hand side, and the share of each part.

        Returns
        -------
        dict
            "total"; for payload, friction, springs, effort_limit, controller (where given), armature and gravity, the
            operations saved without it; "law", whether the controller is "traced", "called" or "none", and "why" it is
            called. The costs of a called controller and of a robot too large to be written out are not known: then
            "total" is None.
        """
        law: dict[str, int | str | None] = {"law": "none"}
        if self.controller is not None:
            is_traced = self.is_traced or self.traced_samples is not None
            law = {"law": "traced"} if is_traced else {"law": "called", "why": self.why_called}
        if not self.kernel.is_unrolled:
            return {"total": None} | law

        def operations(**changes: Any) -> int:
            return sum(replace(self, **changes).kernel.operations.values())

        total = sum(self.kernel.operations.values())
        costs: dict[str, int | str | None] = {"total": total}
        for part in ("payload", "friction", "springs", "effort_limit", "controller"):
            if getattr(self, part) is not None:
                needing = ("sample_time", "torque_rate", "effort_limit", "delay") if part == "controller" else ()
                costs[part] = total - operations(**dict.fromkeys((part, *needing)))
        for part, nothing in (("armature", 0.0), ("gravity", np.zeros(3))):
            if np.any(getattr(self.resolved.robot.model, part)):
                costs[part] = total - operations(**{part: nothing})
        return costs | law


def resolved_friction(friction: Friction | str | None, robot: Robot) -> Friction | None:
    """Checked friction of a scene, that of the robot's file for "urdf"."""
    if friction is None:
        return None
    if isinstance(friction, str):
        if friction != "urdf":
            raise ValueError(f"`friction` must be an rne.Friction or 'urdf', got {friction!r}")
        return urdf_friction(robot.model)
    if not isinstance(friction, Friction):
        raise TypeError(f"`friction` must be an rne.Friction or 'urdf', got {type(friction).__name__}")
    friction.check(robot.model)
    if friction.sticks and friction.varying:
        raise ValueError(
            f"`friction` with {friction.varying} needs a `smoothing` above 0: of dry friction that sticks and "
            "slips by events, Coulomb friction is constant"
        )
    return friction


def resolved_limits(name: str, limit: ArrayLike | str | None, robot: Robot) -> Array | None:
    """Largest absolute values, one per joint, those of the robot's file for "urdf"; None without any limit."""
    if limit is None:
        return None
    if isinstance(limit, str | bool) and name == "effort_limit":
        if limit != "urdf":
            raise ValueError(f"`effort_limit` must be an array or 'urdf', got {limit!r}")
        bounds = np.asarray(robot.effort_limit, dtype=float)
    else:
        bounds = limit_array(name, limit, robot.joint_names, np.full(robot.n, np.inf))
    return None if (bounds >= UNBOUNDED).all() else np.minimum(bounds, UNBOUNDED)
