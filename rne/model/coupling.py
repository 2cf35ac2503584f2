"""Coupled joints: traced functions of their drivers' positions, and the ranges in which these exist."""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import Any, NamedTuple

import numpy as np

from ..basics.spatial import Array, note_finite, zeros
from ..basics.text import listed
from ..errors import ModelError
from ..graph.differentiation import differentiate
from ..graph.graph import Graph
from ..graph.program import ON_ARRAYS, Instruction, Operand, Program, interpret, lower
from ..graph.scalar import Scalar, inputs, references
from .model import Loop, Model, of_either, with_unchecked

LOGGER = logging.getLogger("rne")
SAMPLES = 1000  # samples of a driver's range on either side of its zero, in two spacings
NEAREST, FARTHEST = 1e-7, 1e3  # nearest and farthest samples of an unlimited slide from its zero [m]
HALVINGS = 60
JUMP = 0.1  # tolerance of a jump by a full turn between samples [rad], as functions such as arctan2 have
Followed = tuple[Sequence[str], Callable[..., Any]]  # drivers and function


class Linked(NamedTuple):
    """Coupled joint of a linkage: drivers, function, the first driver's range, and the loop."""

    drivers: Sequence[str]
    position: Callable[..., Any]
    ends: tuple[float, float]
    loop: Loop | None


@dataclass(frozen=True)
class Coupling:
    """Position of a joint as a function of the positions of `drivers`, all of them coordinates, in their order.

    `program` is the function, traced: data, so that models that have it are equal, pickled and traced again.
    """

    joint: str
    drivers: tuple[str, ...]
    program: Program

    def position(self, drivers: Array) -> Array:
        """Position of the joint, shape (...), from those of the drivers, (..., d), of any type of number."""
        return _run(self.program, drivers)[..., 0]

    def derivatives(self, drivers: Array) -> tuple[Array, Array]:
        """First and second derivatives with respect to the drivers' positions, shapes (..., d) and (..., d, d)."""
        d, found = len(self.drivers), _run(self.slopes, drivers)
        return found[..., :d], found[..., d:].reshape(*drivers.shape[:-1], d, d)

    @cached_property
    def slopes(self) -> Program:
        """Program of the first and second derivatives."""
        d, graph = len(self.drivers), Graph()
        position = references(graph, self.position(inputs(graph, (1, d), 0)))
        first = differentiate(graph, "jacobian", position, range(d), d)
        return lower(graph, first + differentiate(graph, "jacobian", first, range(d), d), d)

    def at(self, values: Mapping[str, float]) -> Followed:
        """Remaining drivers, without values here, and the position as a function of theirs."""
        free = tuple(name for name in self.drivers if name not in values)

        def position(*given: Any) -> Any:
            known = {**values, **dict(zip(free, given, strict=True))}
            return self.position(np.array([[known[name] for name in self.drivers]], dtype=object))[0]

        return free, position


IN_FILES = (Loop, Coupling, Program, Instruction, Operand)  # types that couplings and linkages consist of


def _run(program: Program, given: Array) -> Array:
    """Outputs of a program, shape (..., outputs), for inputs (..., width); kernels check their finiteness."""
    number: Any = np.asarray if given.dtype == object else given.dtype.type
    found = zeros((*given.shape[:-1], len(program.outputs)), like=given)
    with np.errstate(all="ignore"):  # arrays, of single numbers too
        for k, output in enumerate(interpret(program, np.moveaxis(given[..., None], -2, 0), ON_ARRAYS, number)):
            found[..., k] = np.asarray(output)[..., 0] if np.ndim(output) else output
    note_finite(found)
    return found


@of_either
def coupled(model: Model, couplings: Mapping[str, Followed | Linked | Callable[..., Linked]]) -> Model:
    """Robot with some joints coupled to others, by functions of their positions.

    Parameters
    ----------
    model : Model or Robot
        The robot, or its parameters.
    couplings : mapping of str to (sequence of str, callable)
        By the joint that is to follow: its drivers, which may follow others themselves, and its position as a function
        of theirs, traced once: arithmetic, NumPy's sin, cos, sqrt, `rne.elementwise`. Or what `slider_crank` returns.

    Returns
    -------
    Model or Robot
        As `model`, with fewer coordinates. A linear function of one driver is a mimic. The ranges of drivers are cut to
        where the joints that follow, other drivers at zero, have positions within their own ranges; a line on the
        logger "rne" and a note say so.

    Raises
    ------
    ValueError, TypeError
        If the mapping has another form, names no joint, one that follows already or a circle; if a function is constant
        or returns something else than one number.
    ModelError
        If a joint has no position within its range, wherever its driver is, or its position jumps by a turn.

    Notes
    -----
    With the joints' positions phi(q) and G = dphi/dq, torques are G^T tau(phi, G q', G q'' + G' q') and M is G^T M G.

    Examples
    --------
    >>> import numpy as np, rne
    >>> cam = rne.model.coupled(rne.irb140(), {"joint_3": (["joint_2"], lambda x: 0.2 * np.sin(x))})
    >>> cam.n, rne.Robot(cam).mass_matrix([0] * 5).shape
    (5, (5, 5))
    """
    followers = _checked(model, couplings)
    linked = {joint: value for joint, value in followers.items() if isinstance(value, Linked)}
    coordinates = [name for name in model.joint_names if name not in followers]
    place = [model.joint_names[k] for k in model.coordinate]  # a coordinate of each joint
    multiplier, offset, found = model.multiplier.copy(), model.offset.copy(), list[Coupling]()
    before = [c.joint for c in model.couplings]
    for i, joint in enumerate(model.moving_joints):
        if place[i] not in coordinates or joint in before:
            coupling = _traced(model, followers, coordinates, joint)
            place[i], multiplier[i], offset[i] = coupling.drivers[0], 0.0, 0.0
            (slope, *others) = coupling.slopes.outputs
            if slope.kind == "constant" and len(others) == 1:
                multiplier[i], offset[i] = slope.value, coupling.position(np.zeros(1))
            else:
                found.append(coupling)
    whole = replace(
        model,
        coordinate=tuple(map(coordinates.index, place)),
        independent_joints=tuple(map(model.moving_joints.index, coordinates)),
        multiplier=multiplier,
        offset=offset,
        couplings=tuple(found),
        loops=(*model.loops, *dict.fromkeys(value.loop for value in linked.values() if value.loop)),
    )
    of_linkages = [value.drivers[0] for value in linked.values() if np.isfinite(value.ends).any()]
    for driver in dict.fromkeys((*of_linkages, *(name for coupling in found for name in coupling.drivers))):
        whole = _with_range_cut(whole, driver, linked)
    return whole


def with_ratio(model: Model, joint: str, factor: float) -> Model:
    """Robot with a coupled joint's displacement from rest multiplied by `factor`, for dynamics only."""
    i, found = model.moving_joints.index(joint), list(model.couplings)
    for k, (own, drivers, coupling) in enumerate(model.coupled_joints):
        if own == i:
            graph, rest = Graph(), float(np.nan_to_num(model.rest[i]))  # none where it cannot follow at zero
            position = rest + factor * (coupling.position(inputs(graph, (1, len(drivers)), 0)) - rest)
            found[k] = replace(coupling, program=lower(graph, references(graph, position), len(drivers)))
    ratios = np.where(np.arange(model.nb) == i, factor, 1.0)
    return with_unchecked(model, multiplier=ratios * model.multiplier, couplings=tuple(found))


def _checked(model: Model, couplings: Any) -> dict[str, Followed | Linked]:
    """Drivers and function of each coupled joint, with the names checked."""
    if not isinstance(couplings, Mapping):
        raise TypeError(f"`couplings` must map joints to (drivers, function), got {type(couplings).__name__}")
    found, joints = {}, list(model.moving_joints)
    for joint, value in couplings.items():
        if joint not in model.joint_names:
            raise ValueError(f"`couplings` must name joints of {list(model.joint_names)}, got {joint!r}")
        if callable(value):
            alike = [name for name, other in couplings.items() if callable(other) and other == value]
            value = value(model, joint, alike)
        form = isinstance(value, Linked) or (isinstance(value, tuple) and len(value) == 2)
        if not form or isinstance(value[0], str) or not callable(value[1]):
            raise TypeError(f"`couplings[{joint!r}]` must be (drivers, function), got {value!r}")
        if not value[0] or not set(value[0]) <= set(joints):
            raise ValueError(f"the drivers of joint {joint!r} must be of {joints}, got {list(value[0])}")
        found[joint] = value
    return found


def _traced(model: Model, followers: Mapping[str, Any], coordinates: Sequence[str], joint: str) -> Coupling:
    """Position of a joint as a traced function of the coordinates that it depends on."""
    graph, own = Graph(), {c.joint: c.at({}) for c in model.couplings} | {**followers}

    def position(name: str, *asked: str) -> Any:
        if name in coordinates:
            return Scalar(graph, graph.input(coordinates.index(name)))
        if name in asked:
            raise ValueError(f"`couplings` must not follow each other in a circle, got {[*asked, name]}")
        if name in own:
            found = np.asarray(own[name][1](*(position(driver, *asked, name) for driver in own[name][0])))
            if found.shape != ():
                raise ValueError(f"the function of joint {name!r} must return one number, got shape {found.shape}")
            return found.item()
        i = model.moving_joints.index(name)
        of = position(model.joint_names[model.coordinate[i]], *asked, name)
        return of * float(model.multiplier[i]) + float(model.offset[i])

    program = lower(graph, references(graph, np.asarray(position(joint))), len(coordinates))
    read = {*program.outputs, *(arg for instruction in program.instructions for arg in instruction.args)}
    by = sorted(int(arg.value) for arg in read if arg.kind == "input")
    if not by:
        raise ValueError(f"the function of joint {joint!r} must depend on its drivers, got a constant")

    def moved(args: Sequence[Operand]) -> tuple[Operand, ...]:
        return tuple(Operand("input", by.index(int(arg.value))) if arg.kind == "input" else arg for arg in args)

    instructions = tuple(Instruction(kind, moved(args)) for kind, args in program.instructions)
    return Coupling(joint, tuple(coordinates[k] for k in by), Program(instructions, moved(program.outputs), len(by)))


def _with_range_cut(model: Model, driver: str, linked: Mapping[str, Linked]) -> Model:
    """Robot with a driver's range reduced to where all coupled joints have positions within their ranges."""
    k = model.moving_joints.index(driver)
    was, own = (float(model.lower[k]), float(model.upper[k])), [x for x in linked.items() if x[1].drivers[0] == driver]
    ends = [max([was[0], *(x.ends[0] for _, x in own)]), min([was[1], *(x.ends[1] for _, x in own)])]
    by = {joint for joint, x in own if x.ends[0] > was[0] or x.ends[1] < was[1]}
    if driver in model.joint_names:
        by |= _where_followed(model, k, ends)
    if not by:
        return model
    limits = {name: getattr(model, name).copy() for name in ("lower", "upper")}
    before, now = (f"{low:.6g} ... {high:.6g}" for low, high in (was, ends))
    names = listed([joint for joint in model.moving_joints if joint in by])
    text = f"range cut from {before} to {now}, beyond which {names} cannot follow within the joints' ranges"
    LOGGER.warning("joint %r: %s", driver, text)
    limits["lower"][k], limits["upper"][k] = ends
    kinds = tuple("revolute" if i == k and kind == "continuous" else kind for i, kind in enumerate(model.joint_types))
    return replace(model, **limits, joint_types=kinds, notes={**model.notes, driver: text})


class _Followers:
    """Joints coupled to one driver, as functions of its position; their other drivers are as near to 0 as possible."""

    def __init__(self, model: Model, k: int) -> None:
        self.model, self.k, self.driver = model, k, model.moving_joints[k]
        self.zero = np.minimum(np.maximum(0.0, model.lower), model.upper)
        self.couplings = [(i, coupling) for i, _, coupling in model.coupled_joints if self.driver in coupling.drivers]

    def found(self, coupling: Coupling, x: Array) -> tuple[Array, Array, Array]:
        """Position, its derivative with respect to the driver, and True where both are finite."""
        others = {d: self.zero[self.model.moving_joints.index(d)] for d in coupling.drivers if d != self.driver}
        q = np.stack([np.full(x.shape, others[d]) if d in others else x for d in coupling.drivers], -1)
        position, (slopes, _) = coupling.position(q), coupling.derivatives(q)
        fine = np.isfinite(position) & np.isfinite(slopes).all(-1)
        return position, slopes[..., coupling.drivers.index(self.driver)], np.asarray(fine)

    def fails(self, x: Array) -> Array:
        """Mask of the coupled joints that fail, shape (joints, ...)."""
        failing, model = [np.zeros(x.shape, dtype=bool)], self.model
        for i, coupling in self.couplings:
            position, _, fine = self.found(coupling, x)
            failing.append(~(fine & (model.lower[i] <= position) & (position <= model.upper[i])))
        return np.array(failing)

    def samples(self, ends: Sequence[float]) -> Array:
        """Positions of the driver between two ends, dense around zero, and where positions of followers are extreme."""
        start, model = min(max(float(self.zero[self.k]), ends[0]), ends[1]), self.model
        limits = np.abs([(model.lower[i], model.upper[i]) for i, _ in self.couplings])
        turns = 2 * np.pi + float(np.max(limits, initial=0.0, where=np.isfinite(limits)))
        steps = np.append(np.linspace(0, 1, SAMPLES + 1), np.geomspace(NEAREST / FARTHEST, 1, SAMPLES))
        farthest = turns if model.is_revolute[self.k] else FARTHEST
        below, above = (min(abs(end - start), farthest) * steps for end in ends)
        values = np.unique(np.clip(np.append(start - below, start + above), ends[0], ends[1]))
        for _, coupling in self.couplings:
            values = np.union1d(values, _extremes(values, partial(self.found, coupling)))
        return values

    def refuse_jumps(self, values: Array) -> None:
        """Raise a ModelError if a position jumps by a turn between some positions of the driver."""
        for i, coupling in self.couplings:
            position, slope, _ = self.found(coupling, values)
            expected = np.maximum(np.abs(slope[1:]), np.abs(slope[:-1])) * np.diff(values)
            jumps = (np.abs(np.abs(np.diff(position)) - 2 * np.pi) < JUMP) & (expected < JUMP)
            jumps &= self.model.is_revolute[i]
            places = _jumps(values[:-1][jumps], values[1:][jumps], partial(self.found, coupling))
            if places.size:
                what = f"the position of joint {coupling.joint!r} jumps by a turn where {self.driver!r} is"
                cure = "give it a function without the jump, or the driver a range that ends before"
                raise ModelError(f"{what} {places[0]:.4g}; {cure}")


def _where_followed(model: Model, k: int, ends: list[float]) -> set[str]:
    """Reduce `ends` to where the coupled joints have positions within their ranges; returns those that limit them."""
    followers = _Followers(model, k)
    values, by = followers.samples(ends), set[str]()
    bad = np.asarray(followers.fails(values).any(0))
    if bad.all():
        what = f"the joints that follow {followers.driver!r} have no positions within their ranges"
        raise ModelError(f"{what}, wherever it is")
    first = int(np.argmin(np.where(bad, np.inf, np.abs(values - followers.zero[k]))))
    for side, step in enumerate((-1, 1)):
        if (beyond := np.flatnonzero(bad[first::step])).size:
            inside, outside = values[first + step * (beyond[0] - 1)], values[first + step * beyond[0]]
            while inside != (middle := (inside + outside) / 2) != outside:
                inside, outside = (inside, middle) if followers.fails(middle).any() else (middle, outside)
            ends[side] = float(inside)
            by |= {followers.couplings[j - 1][1].joint for j in np.flatnonzero(followers.fails(outside))}
    followers.refuse_jumps(values[(values >= ends[0]) & (values <= ends[1])])
    return by


def _jumps(low: Array, high: Array, found: Callable[[Array], tuple[Array, ...]]) -> Array:
    """Neighbouring positions, as near as floats allow, between which a position jumps by a turn."""

    def changes(x: Array, y: Array) -> Array:
        return np.asarray(np.abs(found(y)[0] - found(x)[0]))

    low, high = _halved(low, high, lambda low, middle, high: changes(middle, high) > changes(low, middle))
    return np.asarray(low[np.abs(changes(low, high) - 2 * np.pi) < JUMP])


def _extremes(x: Array, found: Callable[[Array], tuple[Array, ...]]) -> Array:
    """Positions at which the sign of a derivative changes, between neighbouring samples."""
    rising = found(x)[1] > 0
    turns = np.flatnonzero(rising[1:] != rising[:-1])
    ends = _halved(x[turns], x[turns + 1], lambda _, middle, __: (found(middle)[1] > 0) == rising[turns])
    return np.concatenate(ends)


def _halved(low: Array, high: Array, is_above: Callable[[Array, Array, Array], Array]) -> tuple[Array, Array]:
    """Intervals bisected to rounding, with the values above or below their middles."""
    for _ in range(HALVINGS):
        middle = (low + high) / 2
        above = is_above(low, middle, high)
        low, high = np.where(above, middle, low), np.where(above, high, middle)
    return low, high
