"""Joints that follow others: from functions of their drivers to couplings, with the ranges where these exist."""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from ..basics.spatial import Array
from ..basics.text import listed
from ..errors import ModelError
from ..graph.differentiation import differentiate
from ..graph.graph import Graph
from ..graph.program import Instruction, Operand, Program, lower
from ..graph.scalar import Scalar, inputs, references
from .coupling import Coupling
from .model import Model, model_argument

LOGGER = logging.getLogger("rne")
SAMPLES = 2001  # of a driver's range, at which a coupling is looked at for where its loop closes
Followed = tuple[Sequence[str], Callable[..., Any]]  # drivers and function


def coupled(model: Model, couplings: Mapping[str, Followed]) -> Model:
    """The robot with some joints following others: each position a function of those of its drivers."""
    followers = _checked(model_argument(model), couplings)
    coordinates = [name for name in model.joint_names if name not in followers]
    place, found = {}, []
    multiplier, offset = model.multiplier.copy(), model.offset.copy()
    for i, joint in enumerate(model.moving_joints):
        independent = model.joint_names[model.coordinate[i]]
        place[i] = independent
        if independent in coordinates and joint not in {c.joint for c in model.couplings}:
            continue  # it mimics a coordinate as before, or is one
        coupling = _traced(model, followers, coordinates, joint)
        place[i] = coupling.drivers[0]
        constant = _linear(coupling)
        multiplier[i], offset[i] = constant or (0.0, 0.0)
        found += [] if constant else [coupling]
    whole = replace(
        model,
        coordinate=tuple(coordinates.index(place[i]) for i in range(model.nb)),
        independent_joints=tuple(model.moving_joints.index(name) for name in coordinates),
        multiplier=multiplier,
        offset=offset,
        couplings=tuple(found),
    )
    for driver in dict.fromkeys(name for coupling in found for name in coupling.drivers):
        whole = _with_range_cut(whole, driver)
    return whole


def _checked(model: Model, couplings: Any) -> dict[str, Followed]:
    """The drivers and function of each joint that is to follow, with the names checked."""
    if not isinstance(couplings, Mapping):
        raise TypeError(f"`couplings` must map joints to (drivers, function), got {type(couplings).__name__}")
    found = {}
    for joint, value in couplings.items():
        if joint not in model.joint_names:
            raise ValueError(f"`couplings` must name independent joints of {list(model.joint_names)}, got {joint!r}")
        value = value.of(model, joint) if hasattr(value, "of") else value
        if not isinstance(value, tuple) or len(value) != 2 or isinstance(value[0], str) or not callable(value[1]):
            raise TypeError(f"`couplings[{joint!r}]` must be (drivers, function), got {value!r}")
        unknown = [driver for driver in value[0] if driver not in model.moving_joints]
        if unknown or not value[0]:
            joints = list(model.moving_joints)
            raise ValueError(f"drivers of {joint!r} must be joints of {joints}, got {list(value[0])}")
        found[joint] = value
    return found


def _traced(model: Model, followers: Mapping[str, Followed], coordinates: Sequence[str], joint: str) -> Coupling:
    """The position of a joint as a function of those coordinates that it depends on."""
    graph, width = Graph(), len(coordinates)
    q = {name: Scalar(graph, graph.input(k)) for k, name in enumerate(coordinates)}
    position = np.asarray(_position(model, followers, q, joint, ()))
    if position.shape != ():
        raise ValueError(f"the function of joint {joint!r} must return one number, got shape {position.shape}")
    (ref,) = references(graph, position)
    needed = {ref >> 1, *(k for operation in graph.needed([ref]) for k in graph.arguments(operation))}
    by = [k for k in range(width) if graph.input(k) >> 1 in needed]
    if not by:
        raise ValueError(f"the function of joint {joint!r} must depend on its drivers, got a constant")
    program, at = lower(graph, [ref], width), {k: j for j, k in enumerate(by)}

    def moved(arg: Operand) -> Operand:
        return Operand("input", at[int(arg.value)]) if arg.kind == "input" else arg

    instructions = tuple(Instruction(kind, tuple(map(moved, args))) for kind, args in program.instructions)
    of_drivers = Program(instructions, tuple(map(moved, program.outputs)), len(by))
    return Coupling(joint, tuple(coordinates[k] for k in by), of_drivers)


def _position(
    model: Model, followers: Mapping[str, Followed], q: Mapping[str, Any], joint: str, asked: tuple[str, ...]
) -> Any:
    """The position of a joint, traced: a coordinate, or what its drivers make it."""
    if joint in q:
        return q[joint]
    if joint in asked:
        raise ValueError(f"`couplings` must not follow each other in a circle, got {[*asked, joint]}")

    def of(name: str) -> Any:
        return _position(model, followers, q, name, (*asked, joint))

    if joint in followers:
        drivers, function = followers[joint]
        return function(*map(of, drivers))
    for coupling in model.couplings:
        if coupling.joint == joint:
            return coupling.at({})[1](*map(of, coupling.drivers))
    i = model.moving_joints.index(joint)
    return of(model.joint_names[model.coordinate[i]]) * float(model.multiplier[i]) + float(model.offset[i])


def _linear(coupling: Coupling) -> tuple[float, float] | None:
    """Multiplier and offset of a coupling that is a mimic; None of any other."""
    graph = Graph()
    (ref,) = references(graph, coupling.position(inputs(graph, (1, len(coupling.drivers)), 0)))
    (slope, *others) = differentiate(graph, "jacobian", [ref], range(len(coupling.drivers)), len(coupling.drivers))
    multiplier = graph.value(slope)
    if others or multiplier is None:
        return None
    return multiplier, float(coupling.position(np.zeros(1)))


def _with_range_cut(model: Model, driver: str) -> Model:
    """The robot with a driver's range cut to where all joints that follow it have a position within their ranges."""
    k = model.moving_joints.index(driver)
    low, high = float(model.lower[k]), float(model.upper[k])
    rest = {name: min(max(0.0, model.lower[i]), model.upper[i]) for i, name in enumerate(model.moving_joints)}

    def failing(values: Array) -> tuple[Array, str]:
        """Where some joint fails, and which is the first."""
        bad, first = np.zeros(values.shape, dtype=bool), ""
        for i, _, coupling in model.coupled_joints:
            if driver in coupling.drivers:
                q = np.stack([values if d == driver else np.full(values.shape, rest[d]) for d in coupling.drivers], -1)
                position, slopes = coupling.position(q), coupling.derivatives(q)[0]
                fails = ~(np.isfinite(slopes).all(-1) & (model.lower[i] <= position) & (position <= model.upper[i]))
                first = first or (coupling.joint if fails.any() else "")
                bad |= fails
        return bad, first

    reach = 2 * np.pi if model.is_revolute[k] else 1e3
    values = np.linspace(max(low, rest[driver] - reach), min(high, rest[driver] + reach), SAMPLES)
    values = np.sort(np.append(values, rest[driver]))
    bad, joint = failing(values)
    if bad.all():
        raise ModelError(f"joint {joint!r} has no position within its range, wherever {driver!r} is")
    start = int(np.argmin(np.where(bad, np.inf, np.abs(values - rest[driver]))))
    ends, found = [low, high], []
    for side, step in enumerate((-1, 1)):
        beyond = np.flatnonzero(bad[start::step])
        if len(beyond):
            inside, outside = values[start + step * (beyond[0] - 1)], values[start + step * beyond[0]]
            while inside != (middle := (inside + outside) / 2) != outside:
                fails, joint = failing(np.array([middle]))
                inside, outside = (inside, middle) if fails[0] else (middle, outside)
            ends[side] = float(inside)
            found.append(failing(np.array([outside]))[1])
    if not found:
        return model
    joints = listed(list(dict.fromkeys(found)))
    text = f"range cut from {low:.6g} ... {high:.6g} to {ends[0]:.6g} ... {ends[1]:.6g} by {joints}, which follows it"
    LOGGER.warning("joint %r: %s", driver, text)
    lower_, upper = model.lower.copy(), model.upper.copy()
    lower_[k], upper[k] = ends
    kinds = tuple("revolute" if i == k and kind == "continuous" else kind for i, kind in enumerate(model.joint_types))
    return replace(model, lower=lower_, upper=upper, joint_types=kinds, notes={**model.notes, driver: text})
