"""Numbers of a scene by name, which may change, or differ between motions, without recompilation."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..basics.arrays import UNBOUNDED, convert_numbers, read_only
from ..basics.inertia import (
    ENTRIES,
    PARAMETERS,
    body_of_parameters,
    parameters_of_bodies,
    parameters_seen_from,
    pseudo_inertia,
)
from ..basics.numbers import part_of
from ..basics.spatial import Array, rotate_back, rotation_from_rpy
from ..basics.text import brief, did_you_mean
from ..control.law_numbers import law_at, models_of
from ..control.traced_law import is_ours
from ..model.parameters import at_parameters, moments_as_vector, with_fewest_terms
from ..model.topology import end_link
from ..robot import Robot
from .elastic_joints import ElasticJoints
from .scene_dynamics import Bodies

LIMITS = ("effort_limit", "torque_rate", "windup", "stall_torque", "no_load_speed")  # may be infinite
# Rounding of an inertia about the centre of mass relative to that about the link's origin
ROUNDING = 16 * float(np.finfo(np.float64).eps)
# Numbers of laws of rne.control that may be negative
OF_ANY_SIGN = "reference", "pose", "stiffness", "damping", "offset", "stribeck_rise", "parameters"
BODIES = ("parameters", "payload", "armature", "gravity")  # names of numbers with the second program of a scene
UNITS = {
    "friction.viscous": "N m s/rad or N s/m",
    "friction.load": "1",
    "effort_limit": "N m or N",
    "torque_rate": "N m/s or N/s",
    "delay": "s",
    "elastic.stiffness": "N m/rad or N/m",
    "elastic.damping": "N m s/rad or N s/m",
    "elastic.rotor": "kg m^2 or kg",
    "parameters": "kg, kg m, kg m^2; ten per body",
    "payload": "kg, kg m, kg m^2; about the link's origin",
    "payload.mass": "kg",
    "armature": "kg m^2 or kg",
    "gravity": "m/s^2",
    "stiffness": "N/m; N m/rad at joints",
    "length": "m",
    "force": "N",
    "rest": "rad or m",
    "damping": "N s/m; N m s/rad at joints",
} | dict.fromkeys(("friction.smoothing", "friction.stribeck", "friction.saturation"), "rad/s or m/s")


class SceneNumbers(Mapping[str, Array]):
    """Arrays by name, read-only; see `Scene.numbers`."""

    def __init__(self, numbers: Mapping[str, Array]) -> None:
        self._numbers: dict[str, Array] = read_only(
            {name: np.array(x, dtype=np.float64) for name, x in numbers.items()}
        )

    def __getitem__(self, name: str) -> Array:
        try:
            return self._numbers[name]
        except KeyError:
            raise KeyError(unknown(name, self._numbers)) from None

    def __iter__(self) -> Iterator[str]:
        return iter(self._numbers)

    def __len__(self) -> int:
        return len(self._numbers)

    def unit(self, name: str) -> str:
        """Unit of a number; empty for those of controllers, known only to their authors.

        Parameters
        ----------
        name : str
            Its name.

        Returns
        -------
        str
            Such as "N m s/rad or N s/m".

        Examples
        --------
        >>> import rne
        >>> rne.Scene(rne.load("irb140"), friction=rne.Friction(viscous=2.0)).numbers.unit("friction.viscous")
        'N m s/rad or N s/m'
        """
        return unit_of(name).strip(" []")

    def __repr__(self) -> str:
        width = max(map(len, self), default=0)
        lines = [f"  {name:{width}}  {x.shape!s:8} {brief(x)}{unit_of(name)}" for name, x in self.items()]
        return "\n".join(["Numbers of a scene, by name, with their shapes:", *lines])


def unknown(name: Any, known: Mapping[str, Any]) -> str:
    """Error message for a name that a scene does not have."""
    near = [x for x in known if x.rpartition(".")[2] == name]
    hint = f"; did you mean {near[0]!r}?" if near else did_you_mean(str(name), tuple(known))
    return f"the scene has the numbers {', '.join(known)}; got {name!r}{hint}"


def unit_of(name: str) -> str:
    """Unit of a number in brackets; empty for a controller's, known only to its author."""
    part, _, field = name.partition(".")
    unit = UNITS.get(field if part.startswith("springs[") else name.removesuffix("_back"))
    unit = "N m or N" if unit is None and part == "friction" else unit
    return "" if unit is None else f" [{unit}]"


def numbers_of_scene(scene: Any) -> dict[str, Array]:
    """Numbers of a scene by name, for the parts it has."""
    parts, n = scene.resolved, scene.n
    found: dict[str, Array] = {}
    if parts.friction is not None:
        sizes = parts.friction.numbers
        found |= {f"friction.{k}": x if k == "smoothing" else np.broadcast_to(x, (n,)) for k, x in sizes.items()}
    limits = {name: getattr(parts, name) for name in ("effort_limit", "torque_rate")}
    found |= {name: unbounded(limit) for name, limit in limits.items() if limit is not None}
    found |= {} if scene.delay is None else {"delay": np.array(float(scene.delay))}
    found |= {name: unbounded(x) for name, x in scene.numbers_of_controller.items()}
    found |= {} if parts.springs is None else parts.springs.numbers
    if parts.motor_side is not None:
        found |= {f"elastic.{k}": np.array(getattr(parts.motor_side, k)) for k in parts.motor_side._fields[:3]}
    found["parameters"] = parts.robot.parameters
    found |= {} if scene.payload is None else {"payload": payload_parameters(scene.payload)}
    found |= {} if parts.motor_side is not None else {"armature": parts.robot.model.armature}
    gravity = scene.robot.model.gravity if scene.gravity is None else scene.gravity
    return found | {"gravity": np.asarray(gravity)}


def unbounded(limit: Array) -> Array:
    """Limits, infinite where there are none."""
    return np.where(np.abs(limit) >= UNBOUNDED, np.copysign(np.inf, limit), limit)


def payload_parameters(payload: Any) -> Array:
    """Mass, first moment and inertia of a payload about the origin of its link, in the link's axes, shape (10,)."""
    mass, com, inertia, _ = payload
    inertia = np.zeros((3, 3)) if inertia is None else np.asarray(inertia, dtype=np.float64)
    return parameters_of_bodies(np.asarray(mass, dtype=np.float64), np.asarray(com, dtype=np.float64), inertia)


def checked(scene: Any, numbers: Mapping[str, ArrayLike], count: int | None = None) -> dict[str, Array]:
    """Numbers by name as arrays of the right shapes, with a leading axis of `count` motions if it is given."""
    if not isinstance(numbers, Mapping):
        raise TypeError(f"`numbers` must be a mapping of names to arrays, got {type(numbers).__name__}")
    known, found = scene.numbers, dict[str, Array]()
    asked = models_of(scene.controller, [str(name).removeprefix("controller.") for name in numbers])
    known = SceneNumbers({**known, **{f"controller.{name}": x for name, x in asked.items()}})
    for name, value in numbers.items():
        shape = known[name].shape
        wanted = shape if count is None else (count, *shape)
        array = np.asarray(convert_numbers(name, value, str(wanted)))
        if array.dtype.kind != "f" or np.isnan(array).any():
            raise ValueError(f"`numbers[{name!r}]` must be real numbers, none of them NaN")
        if array.ndim == 0 and count is None and shape == (scene.n,) and name not in (*BODIES[:2], "gravity"):
            array = np.full(shape, array)  # one for all joints
        if array.shape != wanted:
            raise ValueError(f"`numbers[{name!r}]` must have shape {wanted}, got {array.shape}")
        law, field = name.startswith("controller."), name.rpartition(".")[2]
        may_be_infinite = field in LIMITS or (law and not is_ours(scene.controller))
        if not may_be_infinite and not np.isfinite(array).all():
            raise ValueError(f"`numbers[{name!r}]` must be finite, got {array[~np.isfinite(array)][0]}")
        if law and is_ours(scene.controller) and field not in OF_ANY_SIGN and (array < 0).any():
            raise ValueError(f"`numbers[{name!r}]` must not be negative, got {array.min()}")
        found[name] = array.astype(np.float64)
    if "parameters" in found and "payload" in found:
        raise ValueError("`numbers` must have 'parameters', which contain the payload, or 'payload', not both")
    return found


@contextmanager
def named(names: Iterable[str]) -> Iterator[None]:
    """Context in which errors of parts have the name of the number instead of the field's."""
    try:
        yield
    except ValueError as error:
        field = re.match(r"`(\w+)", str(error))
        name = next((x for x in names if field and x.rpartition(".")[2] == field[1]), None)
        if field is not None and field[1] == "numbers":
            raise
        if field is None or name is None:
            raise ValueError(f"`numbers`: {error}") from None
        raise ValueError(f"`numbers[{name!r}]{str(error)[field.end() :]}") from None


def scene_at(scene: Any, numbers: Mapping[str, Array]) -> Any:
    """Scene with other numbers, checked by its parts."""
    with named(numbers):
        return _scene_at(scene, numbers)


def _scene_at(scene: Any, numbers: Mapping[str, Array]) -> Any:
    parts, as_given = scene.resolved, ("effort_limit", "torque_rate", "gravity", "armature")
    changed: dict[str, Any] = {name: numbers[name] for name in as_given if name in numbers}
    if "delay" in numbers:
        changed["delay"] = float(numbers["delay"])
    if own := part_of(numbers, "friction."):
        smoothing = {"smoothing": float(own.pop("smoothing"))} if "smoothing" in own else {}
        changed["friction"] = replace(parts.friction, **own, **smoothing)
    if own := part_of(numbers, "controller."):
        changed["controller"] = law_at(scene.controller, own)
    if any(name.startswith("springs[") for name in numbers):
        changed["springs"] = _springs_at(scene.springs, numbers)
    if own := part_of(numbers, "elastic."):
        given = {k: np.array(getattr(parts.motor_side, k)) for k in parts.motor_side._fields[:3]} | own
        changed["elastic"] = ElasticJoints(**given, reads=parts.motor_side.reads)
        changed["armature"] = 0.0  # rotors are in `elastic` now
    if "payload" in numbers:
        changed["payload"] = _payload_at(scene.payload, numbers["payload"])
    found = replace(scene, **changed)
    return at_parameters_of(found, numbers["parameters"]) if "parameters" in numbers else found


def scene_of_all(scene: Any, own: Mapping[str, Array]) -> Any:
    """Scene whose kernels take numbers (N, ...) of N motions, checked by its parts."""
    finite, known = dict[str, Array](), scene.numbers
    for name, array in own.items():
        if name not in known:  # the model of a law, whose parameters are not checked entry by entry
            continue
        infinite = np.abs(known[name]) >= UNBOUNDED  # which is structure
        if (np.isfinite(array) & infinite).any():
            finite[name] = np.where(infinite, np.where(np.isfinite(array), array, 0.0).max(axis=0), known[name])
        least = np.zeros((len(array), 1))
        if name == "armature" and (array < 0).any():
            raise ValueError(f"`numbers[{name!r}]` must not be negative, got {array.min()}")
        if name == "payload":  # in axes that are those of one link; of possible bodies, up to rounding
            if scene.payload.link is None:
                end_link(scene.robot.model, axes_count=bool(array[:, 1:].any()))
            P = pseudo_inertia(array)[:, 0]
            least = np.linalg.eigvalsh(P) / np.maximum(np.abs(P).max(axis=(-2, -1)), 1e-300)[:, None]
        if len(array) and least.min(initial=0.0) < -ROUNDING:
            k = int(np.argmin(least.min(axis=1)))
            raise ValueError(f"`numbers[{name!r}]` must be of physically possible bodies; start {k} has others")
        if not name.startswith("friction.") and name not in BODIES and len(array):
            for end in (array.min(axis=0), array.max(axis=0)):  # what they accept at both they accept in between
                scene_at(scene, {name: end})
    varying = Bodies.mask(bodies_of(scene, own)) if {*BODIES} & {*own} else None
    found = (scene_at(scene, finite) if finite else scene).naming({}, own, varying)
    law = found.dynamics.law
    if absent := [x for x in own if law and x not in known and x.removeprefix("controller.") not in law.numbers]:
        raise ValueError(f"`numbers[{absent[0]!r}]` cannot differ: the law reads its robot where it cannot be traced")
    return found


def common_and_own(
    scene: Any, numbers: Mapping[str, ArrayLike], count: int, sticking: str, *, is_one: bool = False
) -> tuple[Any, dict[str, Array]]:
    """Scene with the numbers common to N motions, and each motion's own numbers, (N, ...).

    Limits that are all infinite are each motion's own, as the scene would have none; the ValueError for joints that can
    stick is `sticking`.
    """
    known, common = scene.numbers, numbers
    if isinstance(numbers, Mapping) and not is_one:
        common = {name: x for name, x in numbers.items() if name in known and np.shape(x) in ((), known[name].shape)}
    found = scene.with_numbers(common) if common else scene
    if lost := [name for name in common if name in known and name not in found.numbers]:
        found = scene.with_numbers({name: x for name, x in common.items() if name not in lost})
    own = checked(found, {name: x for name, x in numbers.items() if name not in common}, count)
    own |= {name: np.full((count, *known[name].shape), common[name]) for name in lost}
    if not own or not count:
        return found, {}
    if (friction := friction_of_all(found, own)) is not None and friction.sticks:
        raise ValueError(sticking)
    return scene_of_all(found, own), own


def numbers_of_dynamics(scene: Any, own: Mapping[str, Array]) -> dict[str, Array]:
    """Numbers of motions for the equations: moments of bodies instead of their parameters."""
    found = {name: array for name, array in own.items() if name not in BODIES}
    return found | (bodies_as_numbers(scene, own) if {*BODIES} & {*own} else {})


def friction_of_all(scene: Any, own: Mapping[str, Array]) -> Any:
    """Friction of N motions as one of N n joints, so that it is checked at once; None without friction.

    It has the smallest of their smoothings, by which joints can stick or not.
    """
    friction, mine = scene.resolved.friction, part_of(own, "friction.")
    if not mine or not len(next(iter(mine.values()))):
        return friction
    shape = len(next(iter(mine.values()))), scene.n
    smoothing = mine.pop("smoothing", np.array([friction.smoothing]))
    sizes = {k: np.broadcast_to(mine.get(k, x), shape).reshape(-1) for k, x in friction.numbers.items()}
    with named(own):
        found = [replace(friction, **sizes | {"smoothing": float(s)}) for s in (smoothing.max(), smoothing.min())]
    return found[1]


def _springs_at(springs: Any, numbers: Mapping[str, Array]) -> list[Any]:
    found = []
    for k, spring in enumerate(springs):
        own = part_of(numbers, f"springs[{k}].")
        with named(f"springs[{k}].{name}" for name in own):
            found.append(replace(spring, **{name: float(x) for name, x in own.items()}))
    return found


def _payload_at(payload: Any, pi: Array) -> Any:
    """Payload with given parameters about the origin of its link."""
    if not pi[0] and pi[1:4].any():
        raise ValueError(f"`payload` without mass must have no first moment, got {pi[1:4].tolist()}")
    mass, centre, inertia = body_of_parameters(pi)
    rounded = np.abs(inertia) <= ROUNDING * np.abs(pi[4:]).max()  # of a point mass it may be no body's
    return payload._replace(mass=float(mass), com=centre, inertia=np.where(rounded, 0.0, inertia))


def bodies_of(scene: Any, own: Mapping[str, Array]) -> Any:
    """Robot with payload of a scene, whose bodies differ between motions, for dynamics only."""
    model = scene.resolved.robot.model
    if "parameters" in own:
        return at_parameters(model, own["parameters"])
    if "payload" not in own:
        return model
    added = parameters_on_body(model, scene.payload.link, own["payload"])
    without = replace(scene, payload=None).resolved.robot.parameters
    return at_parameters(model, without + added)


def bodies_as_numbers(scene: Any, own: Mapping[str, Array]) -> dict[str, Array]:
    """Numbers of the equations for bodies, rotors and gravity of motions by name, (N, ...) each."""
    found: dict[str, Array] = {}
    if "parameters" in own or "payload" in own:
        found["moments"] = moments_as_vector(with_fewest_terms(bodies_of(scene, own)))
    if "armature" in own:
        found["armature"] = own["armature"]
    if "gravity" in own:
        found["gravity"] = gravity_in_base(scene, own["gravity"]) + 0.0
    return found


def gravity_in_base(scene: Any, gravity: Array) -> Array:
    """Gravity of a scene, (..., 3), in the frame of the robot's base."""
    turn = np.zeros(3) if scene.mounting is None else np.asarray(scene.mounting, float)
    return rotate_back(rotation_from_rpy(turn), gravity)


def parameters_on_body(model: Any, link: str | None, pi: Array) -> Array:
    """Increment of a robot's inertial parameters, (..., 10 nb), by bodies (..., 10) about the origin of a link."""
    index = model.link_index(end_link(model) if link is None else link)
    R, p, body = model.link_rotation[index], model.link_translation[index], model.link_body[index]
    m, h, I = pi[..., 0], pi[..., 1:4], pi[..., 4:].take(ENTRIES, -1)
    seen = parameters_seen_from(m, h @ R.T, R @ I @ R.T, p - model.joint_origin[body])
    return np.concatenate([seen if k == body else 0 * seen for k in range(model.nb)], axis=-1)


def moments_of_payloads(scene: Any) -> Array:
    """Mask of a robot's regrouped moments that the payload of a scene can change."""
    model = scene.resolved.robot.model
    return Bodies.mask(at_parameters(model, parameters_on_body(model, scene.payload.link, _general(1))))


def with_inputs(scene: Any, names: Sequence[str]) -> Any:
    """Scene whose kernels have the numbers of these names as inputs, with all moments that bodies can have."""
    model = scene.resolved.robot.model
    varying = Bodies.mask(at_parameters(model, _general(model.nb))) if "parameters" in names else None
    return scene.naming({}, names, varying)


def _general(bodies: int) -> Array:
    """Parameters of bodies among which no relation makes a regrouped moment zero."""
    return np.asarray(np.sqrt(np.arange(2.0, 2.0 + PARAMETERS * bodies)))


def at_parameters_of(scene: Any, parameters: Array) -> Any:
    """Scene with other inertial parameters of its robot with payload."""
    parts = scene.resolved
    robot = Robot(at_parameters(parts.robot.model, parameters), parts.robot.engine)
    contained: dict[str, Any] = dict.fromkeys(("payload", "locked", "armature"))
    if parts.motor_side is not None:
        contained["elastic"] = ElasticJoints(**parts.motor_side._asdict())
    springs = scene.springs if scene.locked is None else parts.springs and parts.springs.each
    kept: dict[str, Any] = {"friction": parts.friction, "effort_limit": parts.effort_limit, "springs": springs}
    kept["gravity"] = scene.robot.model.gravity if scene.gravity is None else scene.gravity  # which `mounting` turns
    return replace(scene, robot=robot, **kept, **contained)
