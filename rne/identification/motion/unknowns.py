"""Unknowns of a fit of motions: numbers of a scene as functions of one vector, with starts and spreads."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from ...basics.arrays import convert_numbers
from ...basics.inertia import PARAMETERS, pseudo_inertia
from ...basics.spatial import Array
from ...basics.text import counted, did_you_mean
from ...dynamics.base_inertial_parameters import BaseParameters
from ...model.standard_parameters import DriveModel
from ...robot import Robot
from ...simulation.commanded import CommandedMotion
from ...simulation.scene import Scene
from ..fit.consistent import sizes_of_parameters

DELAY, SCALE, OFFSET = OF_COMMANDS = CommandedMotion.NAMES
SENSORS = SENSOR_SCALE, SENSOR_OFFSET = "sensor.scale", "sensor.offset"
POSITION = "rad or m"
UNITS = {DELAY: "s", SCALE: "1", OFFSET: POSITION, SENSOR_SCALE: "1", SENSOR_OFFSET: POSITION} | {
    "kp": "N m/rad or N/m",
    "kd": "N m s/rad or N s/m",
    "dead_band": POSITION,
    "stall_torque": "N m or N",
    "no_load_speed": "rad/s or m/s",
}
OUTSIDE = OF_COMMANDS + SENSORS  # numbers outside of the scene
OF_ANY_SIGN = "offset", "stribeck_rise", "gravity", "pose"
CONSTANT = "smoothing", "reference", "gravity", "payload", "torque_rate", "static"  # numbers that "auto" does not fit
LOG_SPREAD, SCALE_SPREAD, OFFSET_SPREAD = 2.0, 0.1, 0.1  # of logarithms; of scales; of offsets [rad or m]
BODY_SPREAD = 2.0  # standard deviation of bodies' parameters relative to the robot's
SHORTEST = 0.05  # shortest lever arm for the expected size of links' first moments [m]
PERIODS = 3.0  # standard deviation of a delay [sample times]


def exponentials(x: Array, is_log: Array) -> Array:
    """Exponentials of the entries that are logarithms, and the other entries."""
    return np.where(is_log, np.exp(np.minimum(x, 700.0)), x)


@dataclass(frozen=True, eq=False)
class Unknown:
    """Entries of one quantity: value = start + directions (x - x_start), or exp(x) where `is_log`."""

    name: str
    labels: tuple[str, ...]
    unit: str
    number: Array  # the quantity at the start
    directions: Array  # (entries, k)
    start: Array  # (k,)
    spread: Array  # (k,), standard deviations of x that are allowed for
    is_log: Array  # (k,)
    is_given: bool = False  # True if the spread is known beforehand

    def value(self, x: Array) -> Array:
        """Quantity at x, (k,)."""
        change = self.directions @ (exponentials(x, self.is_log) - exponentials(self.start, self.is_log))
        return np.asarray(self.number + change.reshape(self.number.shape))


@dataclass(frozen=True, eq=False)
class Unknowns:
    """Unknowns, one after the other in a vector x, (P,)."""

    scene: Scene
    parts: tuple[Unknown, ...]

    @cached_property
    def places(self) -> dict[str, slice]:
        """Slices of x, one per unknown."""
        ends = np.cumsum([0, *(len(part.start) for part in self.parts)]).tolist()
        return {part.name: slice(a, b) for part, a, b in zip(self.parts, ends, ends[1:], strict=False)}

    def together(self, field: str) -> Array:
        """Array of all parts in the order of x."""
        return np.concatenate([np.zeros(0), *(getattr(part, field) for part in self.parts)])

    @cached_property
    def is_log(self) -> Array:
        """True for entries of x that are logarithms."""
        return self.together("is_log").astype(bool)

    @cached_property
    def is_given(self) -> Array:
        """True for entries of x with a known spread."""
        return np.concatenate([np.full(len(part.start), part.is_given) for part in self.parts])

    @property
    def left_out(self) -> tuple[str, ...]:
        """Quantities with zero entries that are not fitted, with their number."""
        found = []
        for part in self.parts:
            fitted = (part.directions != 0).any(axis=1)
            count = int(((part.number.reshape(-1) == 0) & ~fitted).sum())
            found += [f"{part.name} of {counted(count, 'joint')}"] * (count > 0 and part.name != "parameters")
        return tuple(found)

    @property
    def labels(self) -> tuple[str, ...]:
        """Names of the entries of x."""
        return tuple(label for part in self.parts for label in part.labels)

    @property
    def units(self) -> tuple[str, ...]:
        """Units of the entries of x."""
        return tuple(part.unit for part in self.parts for _ in part.labels)

    @property
    def of_scene(self) -> tuple[str, ...]:
        """Unknowns that are numbers of the scene."""
        return tuple(part.name for part in self.parts if part.name not in OUTSIDE)

    @property
    def directions(self) -> dict[str, Array]:
        """Directions of differentiation of the motion, without sensor errors."""
        return {part.name: part.directions for part in self.parts if part.name not in SENSORS}

    def numbers(self, x: Array) -> dict[str, Array]:
        """Quantities at x by name."""
        return {part.name: part.value(x[self.places[part.name]]) for part in self.parts}

    def entries(self, x: Array) -> Array:
        """Values of the entries of x, (P,), exponentials of logarithms."""
        return exponentials(x, self.is_log)

    def slopes(self, x: Array) -> Array:
        """Derivatives of the values with respect to x."""
        return np.where(self.is_log, self.entries(x), 1.0)

    def command(self, numbers: Mapping[str, Array]) -> tuple[float, Array, Array]:
        """Scale, offset and delay of commands."""
        found = outside(self.scene) | dict(numbers)
        return float(found[DELAY][0]), found[SCALE], found[OFFSET]


def unknowns_of(
    scene: Scene,
    wrt: str | Sequence[str],
    period: float,
    start: Mapping[str, ArrayLike],
    priors: Mapping[str, ArrayLike],
) -> Unknowns:
    """Unknowns of these names, "auto" for all of the scene, with given starts and standard deviations by name."""
    every = dict(scene.numbers) | outside(scene)
    if isinstance(wrt, str) and wrt == "auto":
        names = _of_itself(scene)
    else:
        names = list(dict.fromkeys([wrt] if isinstance(wrt, str) else wrt))
        if not names:
            raise ValueError("`wrt` must name one number at least")
    for argument, given in (("wrt", names), ("start", start), ("priors", priors)):
        for name in given:
            if name not in every:
                hint = did_you_mean(str(name), every)
                raise KeyError(f"`{argument}` must name some of {', '.join(every)}; got {name!r}{hint}")
    if DELAY in names and scene.sample_time is not None:
        raise ValueError(f"`wrt`: the law is sampled, so that the delay of its commands is 'delay', not {DELAY!r}")
    if lost := [name for name in (*start, *priors) if name not in names]:
        raise ValueError(f"`start` and `priors` must be of what is fitted, which {lost[0]!r} is not: name it in `wrt`")
    if refused := [name for name in names if name.endswith((".reference", ".breaks"))]:
        raise ValueError(f"`wrt`: {refused[0]!r} is replaced by the commands of records")
    numbers = every | {name: _shaped(name, x, every[name].shape) for name, x in start.items()}
    parts = []
    for name in names:
        is_of_bodies, number = name == "parameters", numbers[name]
        part = _bodies(scene, number) if is_of_bodies else _entries(scene, name, number, period, names)
        parts.append(_under_prior(part, priors[name]) if name in priors else part)
    return Unknowns(scene, tuple(parts))


def _of_itself(scene: Scene) -> list[str]:
    """Numbers selected by "auto"."""
    found = [name for name in scene.numbers if name.rpartition(".")[2] not in CONSTANT]
    found = [name for name in found if (np.isfinite(x := scene.numbers[name]) & (x != 0)).any()]
    if not _rotors_apart(scene).any():
        found = [name for name in found if name != "armature"]
    followed = OF_COMMANDS if scene.sample_time is None else OF_COMMANDS[1:]
    return [*found, *followed]


def outside(scene: Scene) -> dict[str, Array]:
    """Values of the numbers of commands and sensors without errors."""
    ones, zeros = np.ones(scene.n), np.zeros(scene.n)
    return {DELAY: np.zeros(1), SCALE: ones, OFFSET: zeros, SENSOR_SCALE: ones, SENSOR_OFFSET: zeros}


def _shaped(name: str, value: ArrayLike, shape: tuple[int, ...]) -> Array:
    """Value to start from, one number for all entries or an array of its shape."""
    array = np.asarray(convert_numbers(f"start[{name!r}]", value, str(shape)), dtype=float)
    if array.shape not in ((), shape) or np.isnan(array).any():
        raise ValueError(f"`start[{name!r}]` must be of shape {shape} without NaN, got {array.shape}")
    return np.broadcast_to(array, shape).copy()


def _entries(scene: Scene, name: str, number: Array, period: float, names: Sequence[str]) -> Unknown:
    """Entries of a number that are neither zero nor infinite: logarithms of those that can only be positive."""
    flat, field = number.reshape(-1), name.rpartition(".")[2]
    may_be_zero = name in OUTSIDE or field in OF_ANY_SIGN
    taken = np.isfinite(flat) & ((flat != 0) | may_be_zero)
    if not taken.any():
        raise ValueError(f"`wrt`: {name!r} is {flat[0]:g}: give it a value above 0 to start from, by `start`")
    if name == "armature" and "parameters" in names:
        taken &= _rotors_apart(scene)
        if not taken.any():
            raise ValueError("`wrt`: 'armature' acts as inertias of bodies do: leave it or 'parameters' out")
    own, k = flat[taken], np.flatnonzero(taken)
    usual = scene.numbers[name].reshape(-1)[taken] if name in scene.numbers else own
    if not may_be_zero and ((usual > 0) & (own < 0)).any():
        raise ValueError(f"`start[{name!r}]` must be positive, got {own.min():g}")
    is_log = (own > 0) & (not may_be_zero)
    scales = {DELAY: PERIODS * period, SCALE: SCALE_SPREAD, SENSOR_SCALE: SCALE_SPREAD}
    spread = np.where(is_log, LOG_SPREAD, scales.get(name, np.maximum(np.abs(own), OFFSET_SPREAD)))
    start = np.where(is_log, np.log(np.where(is_log, own, 1.0)), own)
    joints = scene.resolved.robot.joint_names
    moving = scene.resolved.robot.model.moving_joints
    of_each = [names for names in (joints, moving) if len(names) == flat.size and name != "gravity"]
    per_joint = of_each[0] if of_each else [str(i) for i in range(flat.size)]
    labels = tuple(name if flat.size == 1 else f"{name} of {per_joint[i]}" for i in k)
    unit = UNITS.get(name.removeprefix("controller."), "") or scene.numbers.unit(name)
    return Unknown(name, labels, unit, number, np.eye(flat.size)[:, k], start, spread, is_log)


def _rotors_apart(scene: Scene) -> Array:
    """Rotors whose inertia is identifiable apart from that of bodies."""
    robot = scene.resolved.robot
    kept = set(robot.base_parameters(drives=DriveModel(rotor=True)).names)
    return np.array([f"Ia_{i + 1}" in kept for i in range(robot.model.nb)])


def _bodies(scene: Scene, parameters: Array) -> Unknown:
    """Inertial parameters regrouped as motions depend on them, including rotors of equal effect."""
    robot = scene.resolved.robot
    base, matrix = regrouped(robot)
    E = base.back[: PARAMETERS * robot.model.nb, : len(matrix)]
    sizes = np.linalg.norm(matrix[:, : len(E)] * _sizes(robot), axis=1)
    values = matrix @ np.append(parameters, rotors(robot))
    labels = tuple(f"parameters: {name}" for name in base.names[: len(matrix)])
    none, unit = np.zeros(len(matrix), bool), "kg, kg m, kg m^2"
    return Unknown("parameters", labels, unit, parameters, E, values, BODY_SPREAD * sizes, none)


def rotors(robot: Robot) -> Array:
    """Rotor inertias of a model of drives."""
    model = robot.model
    return np.asarray(model.armature[list(model.independent_joints)])


def regrouped(robot: Robot) -> tuple[BaseParameters, Array]:
    """Base parameters with rotors, and the rows of their matrix for those of bodies, the first ones."""
    base = robot.base_parameters(drives=DriveModel(rotor=True))
    count = sum(k < PARAMETERS * robot.model.nb for k in base.independent)
    return base, base.matrix[:count]


def _sizes(robot: Robot) -> Array:
    """Expected sizes of standard parameters, (10 nb,): of bodies with the mass and extent of the robot's."""
    return sizes_of_parameters(pseudo_inertia(robot.parameters), SHORTEST).ravel()


def _under_prior(part: Unknown, std: ArrayLike) -> Unknown:
    """Unknown with a known standard deviation, in units of the quantity."""
    given = np.asarray(convert_numbers(f"priors[{part.name!r}]", std, "of the quantity"), dtype=float)
    shape = part.start.shape if part.name == "parameters" else part.number.shape
    if given.shape not in ((), shape):
        raise ValueError(f"`priors[{part.name!r}]` must be one number or of shape {shape}, got {given.shape}")
    given = np.broadcast_to(given, shape).reshape(-1)
    given = given if part.name == "parameters" else given[np.argmax(part.directions != 0, axis=0)]
    if not ((given > 0) & np.isfinite(given)).all():
        raise ValueError(f"`priors[{part.name!r}]` must be positive, got {given.min()}")
    spread = np.where(part.is_log, given / np.exp(np.where(part.is_log, part.start, 0.0)), given)
    return replace(part, spread=spread, is_given=True)
