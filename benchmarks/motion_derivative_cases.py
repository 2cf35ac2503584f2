"""The motions that are differentiated, their numbers, and how derivatives are compared.

A drive's torque is that of PD control with gravity compensation, along a sway that does not come to rest or towards a
pose; at the joints are rotors and smoothed friction. Errors of derivatives are those of changes in shares of a number,
relative to the largest.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

import rne
from rne.graph.program import evaluate
from rne.integrators.tableaus import tableau
from rne.kernels import Kernel
from rne.simulation.frozen_motion import FrozenScene

Array = np.ndarray
ROTORS, VISCOUS, COULOMB, SMOOTHING = 0.1, 2.0, 1.0, 0.1  # [kg m^2, N m s/rad, N m, rad/s]
KP = np.array([200.0, 200.0, 150.0, 50.0, 50.0, 50.0])  # [N m/rad]
KD = np.array([40.0, 40.0, 30.0, 10.0, 10.0, 10.0])  # [N m s/rad]
POSE = np.array([0.6, -0.8, 0.9, 0.5, -0.4, 0.3])  # [rad]
START = np.linspace(0.1, 0.6, 6), np.linspace(-0.25, 0.3, 6)  # [rad], [rad/s]
GOAL = 1.0  # [rad], of the cost
GAINS = "controller.kp", "controller.kd"
OF_SWAY = "q0", "qd0", *GAINS, "controller.amplitude", "friction.viscous", "friction.coulomb"  # 42 numbers
OF_POSE = "q0", "qd0", *GAINS, "controller.reference", "friction.viscous"  # 36 numbers
OF_FIT = "q0", "qd0", "friction.viscous", "parameters"  # 78 numbers


@dataclass(frozen=True, eq=False)
class Sway:
    """PD control with gravity compensation along centre + amplitude sin(2 t)."""

    robot: rne.Robot
    kp: Array
    kd: Array
    centre: Array
    amplitude: Array
    traceable = True

    def __call__(self, t: float, q: Array, qd: Array) -> Array:
        """Torques of the drives [N m]."""
        torques: Array = self.kp * (self.centre + self.amplitude * np.sin(2.0 * t) - q) - self.kd * qd
        return torques + self.robot.gravity_torque(q)


def final(q: Array, qd: Array) -> Any:
    """The cost of the end."""
    return ((q - GOAL) ** 2).sum(-1) + (qd**2).sum(-1)


def arm(name: str, engine: str) -> rne.Robot:
    """A robot with rotors."""
    return rne.load(name, engine=engine).with_armature(ROTORS)


def sway(name: str, engine: str) -> rne.Scene:
    """A robot that sways."""
    robot = arm(name, engine)
    friction = rne.Friction(viscous=VISCOUS, coulomb=COULOMB, smoothing=SMOOTHING)
    return rne.Scene(robot, controller=Sway(robot, KP, KD, POSE, np.full(6, 0.3)), friction=friction)


def pose(name: str, engine: str) -> rne.Scene:
    """A robot that is driven to a pose, without Coulomb friction, whose law other engines do not have."""
    robot = arm(name, engine)
    return rne.Scene(
        robot, controller=rne.control.pd_gravity(robot, KP, KD, POSE), friction=rne.Friction(viscous=VISCOUS)
    )


def values(scene: rne.Scene, names: Sequence[str]) -> dict[str, Array]:
    """The numbers by name, starts among them."""
    given = {**scene.numbers, "q0": START[0], "qd0": START[1]}
    return {name: np.asarray(given[name]) for name in names}


def elasticities(slopes: Mapping[str, Array], numbers: Mapping[str, Array]) -> Array:
    """Derivatives by shares of each number, in a row; they may have axes of results in front."""
    return np.concatenate([np.asarray(slopes[name]) * x.reshape(-1) for name, x in numbers.items()], axis=-1)


def error(found: Mapping[str, Array], expected: Mapping[str, Array], numbers: Mapping[str, Array]) -> float:
    """Worst error of an elasticity, relative to the largest."""
    ours, theirs = elasticities(found, numbers), elasticities(expected, numbers)
    return float(np.abs(ours - theirs).max() / np.abs(theirs).max())


def largest_decay(scene: rne.Scene) -> float:
    """The largest decay rate at the start [1/s]: of damping and friction at rest against the joints' inertia."""
    friction = scene.resolved.friction
    damping = KD + friction.viscous + (friction.coulomb / friction.smoothing if np.any(friction.coulomb) else 0.0)
    M = scene.resolved.robot.mass_matrix(START[0])
    return float(np.abs(np.linalg.eigvals(np.linalg.solve(M, np.diag(damping)))).max())


def rates(scene: rne.Scene, names: Sequence[str], engine: str = "numpy") -> tuple[Kernel, dict[str, slice], Array]:
    """dx/dt as a kernel of (t, x, numbers), the places of names among these, and their values."""
    frozen = FrozenScene(scene, tuple(names))
    places, first = dict[str, slice](), 0
    for name, mask in frozen.dynamics.masks.items():
        places[name], first = slice(first, first + int(mask.sum())), first + int(mask.sum())
    given = frozen.dynamics.right_hand_side
    given = replace(given, quantity=replace(given.quantity, of_run=None))  # numbers stay inputs
    return Kernel(given, scene.resolved.robot.model, {}, engine=engine), places, frozen.dynamics.vector


def by_names(by_start: Array, by_numbers: Array, places: Mapping[str, slice]) -> dict[str, Array]:
    """Derivatives by name from those by the state at the start and by the numbers of `rates`."""
    n = len(by_start) // 2
    return {"q0": by_start[:n], "qd0": by_start[n:]} | {k: by_numbers[place] for k, place in places.items()}


def by_complex_steps(scene: rne.Scene, names: Sequence[str], end: float, steps: int) -> dict[str, Array]:
    """Derivatives of the cost by complex steps through DOP853 with equal steps, by NumPy: shares nothing with ours."""
    kernel, places, vector = rates(scene, names)
    x0, method = np.concatenate(START), tableau("DOP853")
    rows = np.tile(np.concatenate([[0.0], x0, vector]), (len(x0) + len(vector), 1)).astype(complex)
    rows[:, 1:] += 1e-30j * np.eye(len(rows))
    x, h = rows[:, 1 : 1 + len(x0)].copy(), end / steps

    def slope(moved: Array) -> Array:
        rows[:, 1 : 1 + len(x0)] = moved
        return evaluate(kernel.traced.program, len(x0), rows)

    for _ in range(steps):
        K: list[Array] = []
        for row in method.A:
            K.append(slope(x + h * sum((a * k for a, k in zip(row, K, strict=False) if a), 0 * x)))
        x = x + h * sum(b * k for b, k in zip(method.B, K, strict=False))
    found = final(*np.split(x, 2, axis=1)).imag / 1e-30
    return by_names(*np.split(found, [len(x0)]), places)


def differences(motions: Callable[[list[dict[str, Array]]], Array], numbers: Mapping[str, Array], share: float) -> Any:
    """Derivatives of costs by forward differences in shares of each number; `motions` gives the cost of each case."""
    cases = [dict(numbers)]
    for name, x in numbers.items():
        for k in range(x.size):
            cases.append({**numbers, name: x + np.where(np.arange(x.size) == k, share * x, 0.0)})
    costs, found, first = motions(cases), dict[str, Array](), 1
    for name, x in numbers.items():
        found[name] = (costs[first : first + x.size] - costs[0]) / (share * x)
        first += x.size
    return found
