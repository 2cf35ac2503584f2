"""Elastic joints: a spring and a damper between each motor, reflected through its gear, and its link.

Spong 1987, Modeling and control of elastic joint robots, J. Dyn. Sys., Meas., Control 109, (15) and (16): rotors turn
about their own axes so fast that the rest of their motion is neglected; their masses belong to the links. With
torsion K (theta - q) + D (theta' - q') of the joints,

    M(q) q'' + C q' + g = K (theta - q) + D (theta' - q')
    B theta'' + K (theta - q) + D (theta' - q') = torque of the drives - friction(theta')

The state is x = (q, theta, q', theta', z, energies), so that a scene of n joints has 2 n coordinates.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..basics.arrays import read_only, real_numbers
from ..basics.spatial import Array
from ..basics.text import listed, summary
from ..dynamics.rnea import gravity_torque, inverse_dynamics
from ..graph.scalar import is_present
from ..model.model import Model, joint_array
from ..model.modify import LimitValues, limit_array
from ..robot import Robot
from .scene_dynamics import MotorSide, SceneDynamics

READS = ("motor", "link", "both")
RIGID = "; where one is rigid, give it a stiffness far above the others' and critical damping, 2 sqrt(stiffness rotor)"


@dataclass(frozen=True, eq=False)
class ElasticJoints:
    """Joints with a flexible transmission between motor and link, for a Scene (Spong's model); all joints are flexible.

    Parameters
    ----------
    stiffness : float, array_like of shape (n,), or mapping
        Stiffness of each joint, gear included: one number for all joints, one each, or by name [N m/rad or N/m].
    damping : float, array_like of shape (n,), or mapping
        Damping parallel to each spring; 0 for joints that a mapping leaves out [N m s/rad or N s/m].
    rotor : float, array_like of shape (n,), or mapping, optional
        Inertias of rotors reflected through their gears; the armature of robot or scene if not given [kg m^2 or kg].
    reads : {"motor", "link", "both"}
        Positions and velocities that control laws are given: of the motors, reflected through the gears, of the links,
        or of both in arrays of length 2 n, the links first.

    Notes
    -----
    Friction and torque limits belong to the motors, ranges to the links. Rotors turn only about the axes of their
    joints, and their masses belong to the links. The scene checks the numbers. A rigid joint among flexible ones has a
    stiffness far above theirs and critical damping, 2 sqrt(stiffness rotor), which a stiff method integrates.

    Examples
    --------
    >>> import rne
    >>> robot = rne.load("irb140")
    >>> scene = rne.Scene(robot, elastic=rne.ElasticJoints(stiffness=2e4, damping=5.0, rotor=1.5))
    >>> motion = rne.simulate(scene, [0] * 6, [0] * 6, 0.1)
    >>> torsion = 2e4 * (motion.motor_q - motion.q)
    >>> bool(abs(torsion[0] - robot.gravity_torque([0] * 6)).max() < 1e-9)  # it holds the links at first [N m]
    True
    """

    stiffness: LimitValues
    damping: LimitValues = 0.0
    rotor: LimitValues | None = None
    reads: str = "motor"

    __repr__ = summary

    def __post_init__(self) -> None:
        if self.reads not in READS:
            raise ValueError(f"`reads` must be one of {list(READS)}, got {self.reads!r}")
        for name in ("stiffness", "damping", "rotor"):  # the caller may change them later
            value = getattr(self, name)
            object.__setattr__(self, name, dict(value) if isinstance(value, Mapping) else read_only(value))


def part_at_joints(robot: Robot, elastic: ElasticJoints) -> tuple[Robot, MotorSide]:
    """Links without rotors and the motor sides; a ValueError where the two do not fit."""
    model, names = robot.model, robot.joint_names
    if driven := [name for k, name in enumerate(model.moving_joints) if k not in model.independent_joints]:
        raise ValueError(f"`elastic` is not for joints that follow others, got {listed(driven)}")
    if elastic.rotor is not None and model.armature.any():
        raise ValueError("`rotor` of the elastic joints is given, and so is an armature: give one of them")
    missing = [name for name, rotor in zip(names, model.armature, strict=True) if not rotor]
    if elastic.rotor is None and missing:
        raise ValueError(f"elastic joints need a `rotor`, or an armature, got none for {listed(missing)}")
    stiffness, damping = (_numbers(name, getattr(elastic, name), names) for name in ("stiffness", "damping"))
    inertia = _numbers("rotor", model.armature if elastic.rotor is None else elastic.rotor, names)
    links = robot.with_model(replace(model, armature=0 * model.armature))
    return links, MotorSide(stiffness, damping, inertia, elastic.reads)


def _numbers(name: str, value: LimitValues, joints: tuple[str, ...]) -> tuple[float, ...]:
    """Array of one number per joint, positive, or nonnegative for damping; a ValueError names the joint at fault."""
    found = limit_array("armature", value, joints, np.zeros(len(joints)), name).tolist()
    cure = RIGID if name == "stiffness" else ""
    missing = [joint for joint in joints if joint not in value] if isinstance(value, Mapping) else []
    if missing and name != "damping":
        raise ValueError(f"`{name}` must name all joints, as all are flexible, got none for {listed(missing)}{cure}")
    for joint, number in zip(joints, found, strict=True):
        if number == np.inf or (number == 0 and name != "damping"):
            need = "finite" if name == "damping" else "positive and finite"
            raise ValueError(f"`{name}` of joint {joint!r} must be {need}, got {number:g}{cure * (number > 0)}")
    return tuple(found)


class ElasticDynamics(SceneDynamics):
    """The equations of motion of a scene with elastic joints; `n` counts the coordinates of links and motors."""

    motor_side: MotorSide

    def _parts(self, x: Array) -> list[Array]:
        """q, theta, q', theta'."""
        return [x[..., k * self.joints : (k + 1) * self.joints] for k in range(4)]

    def start(
        self, robot: Robot, q0: ArrayLike, qd0: ArrayLike, parameters: Array | None = None
    ) -> tuple[Array, Array]:
        """Coordinates and velocities of links and motors: as given, or where torsion holds the links at rest."""
        width, given = f"(..., {robot.n}), or (..., {self.n}) with the motors' after them", []
        for name, value in (("q0", q0), ("qd0", qd0)):
            array = real_numbers(name, value, width)
            given.append(joint_array(name, array, robot.model, self.n if array.shape[-1:] == (self.n,) else None))
        q, qd = given
        if q.shape[-1] == robot.n:
            weight = robot.gravity_torque(q, parameters=parameters)
            weight = weight if self.springs is None else weight + self.springs.torque(robot, q, 0 * q)
            q = np.concatenate([q, q + weight / np.array(self.motor_side.stiffness)], axis=-1)
        return q, np.concatenate([qd, qd], axis=-1) if qd.shape[-1] == robot.n else qd

    def start_of_motors_core(self, model: Model, q: Array) -> Array:
        """Positions of motors whose torsion holds the links at rest, traced."""
        weight = gravity_torque.core(model, q)
        weight = weight if self.springs is None else weight + self.springs.torques(model, q, 0 * q)[0]
        start: Array = q + weight / np.array(self.motor_side.stiffness)
        return start

    def energies_of(self, robot: Robot, x: Array) -> tuple[Array, Array]:
        """Kinetic and potential energy in states, those of rotors and torsion included [J]."""
        kinetic, potential = super().energies_of(robot, x)
        q, motor_q, _, motor_qd = self._parts(x)
        kinetic = kinetic + (np.array(self.motor_side.rotor) * motor_qd**2).sum(-1) / 2
        return kinetic, potential + (np.array(self.motor_side.stiffness) * (motor_q - q) ** 2).sum(-1) / 2

    def _reaction(self, model: Model, x: Array) -> tuple[Array, Any, list[Array]]:
        """Torsion of the joints, the links' net torques, and the powers that are lost, where energies are states."""
        q, motor_q, qd, motor_qd = self._parts(x)
        torsion, lost = np.array(self.motor_side.stiffness) * (motor_q - q), list[Array]()
        if is_present(self.motor_side.damping):
            damped = np.array(self.motor_side.damping) * (motor_qd - qd)
            torsion, lost = torsion + damped, self._powers(motor_qd - qd, {"joint_damping": damped})
        if self.springs is None:
            return torsion, torsion, lost
        held, by_springs = self._held(model, x)
        return torsion, torsion - held, [*by_springs, *lost]

    def _acting(self, model: Model, t: Any, x: Array, u: Array | None) -> tuple[Array, list[Array]]:
        """Net torques on links and motors, and the rates of the states after (q, theta, q', theta')."""
        net, further = self._driving(t, x, u)
        torsion, links, lost = self._reaction(model, x)
        return np.concatenate([links, net - torsion], axis=-1), [*further, *lost]

    def right_hand_side_core(self, model: Model, t: Array, x: Array, u: Array | None = None) -> Any:
        """(dx/dt, pivots, diagonal of the links' M), traced."""
        (q, _, qd, motor_qd), m = self._parts(x), self.joints
        net, further = self._acting(model, t, x, u)
        qdd, pivots, diagonal = self.forward.quantity.core(model, q, qd, net[..., :m])
        rotor = np.array(self.motor_side.rotor) + np.stack(self._damping(motor_qd), axis=-1)
        motor_qdd = net[..., m:] * (1 / rotor)
        return np.concatenate([qd, motor_qd, qdd, motor_qdd, *further], axis=-1), pivots, diagonal

    def residual_core(self, model: Model, t: Array, x: Array, a: Array, u: Array | None = None) -> Any:
        """[M a + C q' + g, B a of the motors] - net torques, rates of further states, at accelerations a, traced."""
        (q, _, qd, _), m = self._parts(x), self.joints
        net, further = self._acting(model, t, x, u)
        links = inverse_dynamics.core(model, q, qd, a[..., :m])
        motors = np.array(self.motor_side.rotor) * a[..., m:]
        return np.concatenate([np.concatenate([links, motors], axis=-1) - net, *further], axis=-1)

    def _balance(self, model: Model, x: Array, slips: Array, dry: Array, net: Array, links: Any) -> tuple[Any, ...]:
        """Balance of forces: links always move; drives less friction and torsion accelerate the motors."""
        (q, _, qd, _), rotor = self._parts(x), np.array(self.motor_side.rotor)
        qdd, pivots, diagonal = self.forward.quantity.core(model, q, qd, links)
        loads = slips * dry + (1 - slips) * net
        found = [qdd, slips * (net - dry) / rotor], [0 * qdd, loads], [links, net], [0 * qdd + 1, 0 * qdd + rotor]
        return *(np.concatenate(part, axis=-1) for part in found), pivots, diagonal
