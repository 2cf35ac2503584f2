"""Model of a robot: a frozen set of read-only arrays that checks itself on construction."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, fields
from functools import cached_property, wraps
from types import MappingProxyType
from typing import Any, Concatenate, NamedTuple, ParamSpec, Protocol, Self, TypeVar, cast, overload

import numpy as np
from numpy.typing import ArrayLike, DTypeLike

from ..basics.arrays import cached_array, convert_array, convert_numbers, is_equal, number_array, plain_array
from ..basics.spatial import Array, point_mass_inertia
from ..basics.text import brief_array, counted, listed, short, wrapped
from ..errors import ModelError
from .checks import LIMITS, check_model
from .solids import Box, Cylinder, Moments

STANDARD_GRAVITY = (0.0, 0.0, -9.81)  # [m/s^2], the thesis's value
REVOLUTE_TYPES = ("revolute", "continuous")

UNSET: Any = None  # replaced in __post_init__ by a default of the right shape
NOT_COMPARED = ("notes", "link_parent", "source", "given_moments")


class Loop(NamedTuple):
    """Closed linkage: its two coupled joints, and the pivot that closes it, a point of two links [m]."""

    followers: tuple[str, ...]
    ends: tuple[tuple[str, tuple[float, ...]], ...]

    @property
    def name(self) -> str:
        """Name of the pivot, from its links."""
        return " to ".join(link for link, _ in self.ends)


@dataclass(frozen=True, eq=False, kw_only=True)
class Model:
    """Fixed-base tree of rigid bodies, one per moving joint.

    Body i moves with joint i, and its frame has its origin on that joint's axis; `nb` is the number of moving
    joints, which is the number n of coordinates unless some joints mimic others. Units are SI.

    Attributes
    ----------
    name : str
    moving_joints : tuple of str, length nb
        In tree order: `parent[i] < i`.
    joint_types : tuple of str, length nb
        "revolute", "continuous" or "prismatic".
    parent : tuple of int, length nb
        The body that joint i is mounted on; -1 is the base.
    axis : ndarray, shape (nb, 3)
        Unit vector of the joint's axis in frame i.
    rotation, translation : ndarray, shapes (nb, 3, 3) and (nb, 3)
        Pose of frame i at zero position, seen from the parent body's frame [1, m].
    mass, com, inertia : ndarray, shapes (nb,), (nb, 3), (nb, 3, 3)
        Of each body i; the inertia is about the centre of mass, in the axes of frame i [kg, m, kg m^2].
    base_mass, base_com, base_inertia
        Mass, centre of mass and inertia of the bodies fixed to the base; not used by dynamics.
    lower, upper, velocity_limit, effort_limit, acceleration_limit, jerk_limit : ndarray, shape (nb,)
        Infinite where unknown. Dynamics ignore them; a Scene can apply ranges and efforts
        [rad or m; rad/s or m/s; N m or N; rad/s^2 or m/s^2; rad/s^3 or m/s^3].
    deceleration_limit : ndarray, shape (nb,)
        Largest accelerations against the direction of motion; infinite where they are those of `acceleration_limit`
        [rad/s^2 or m/s^2].
    damping, friction : ndarray, shape (nb,)
        From the URDF's <dynamics>. Dynamics ignore them; a Scene can apply them [N m s/rad or N s/m; N m or N].
    armature : ndarray, shape (nb,)
        Inertia of each joint's rotor reflected through its gear, part of M; zero unless the file has it [kg m^2 or kg].
    coordinate, multiplier, offset : shapes (nb,)
        The position of joint i is `multiplier[i] * q[coordinate[i]] + offset[i]` (URDF's mimic) [rad or m].
    independent_joints : tuple of int, length n
        The joint of each coordinate; all other joints mimic one of these, or follow some by a coupling.
    couplings : tuple of Coupling
        Joints whose positions are other functions of the coordinates, in the order of `moving_joints`, made by
        `rne.model.coupled`, `four_bar` and `cylinder`; their multipliers and offsets are 0.
    loops : tuple of Loop
        Closed linkages, with the pivots that are no joints of the tree.
    gravity : ndarray, shape (3,)
        In the axes of the root link [m/s^2].
    link_names : tuple of str
        The root, then every link in tree order, including those on fixed joints.
    link_joints : tuple of str
        The joint that carries each link; "" for the root.
    link_parent : tuple of int, optional
        Index in `link_names` of the link that each link is attached to by its joint, -1 for the root. By default, links
        on fixed joints are attached to their body's first link. Not compared.
    link_body : tuple of int
        The body that each link is part of, -1 for the base.
    link_rotation, link_translation : ndarray, shapes (n_links, 3, 3) and (n_links, 3)
        Pose of each link in its body's frame; the identity for a link carried by a moving joint, unless the joint's
        origin was moved along its axis at load.
    shapes : tuple of Cylinder or Box
        For drawing; not used by dynamics.
    notes : mapping of str to str
        Sources of the numbers of a link or joint. Not compared.
    source : str or None
        Absolute path of the URDF or MJCF file it was read from, or the URDF text that a xacro file made, from which
        pictures read the visual shapes. Not compared.
    given_moments : Moments or None
        For dynamics at other parameters, which may differ from state to state: used instead of the moments of `mass`,
        `com` and `inertia`. Not compared.

    Raises
    ------
    ModelError
        If the arrays are inconsistent or not physical; the message names the joint or body.

    Examples
    --------
    >>> import dataclasses, rne
    >>> model = rne.irb140()
    >>> model.n, model.joint_names[1], model.mass[1].item()
    (6, 'joint_2', 22.0)
    >>> dataclasses.replace(model, mass=2 * model.mass).mass[1].item()
    44.0
    """

    name: str
    moving_joints: tuple[str, ...]
    joint_types: tuple[str, ...]
    parent: tuple[int, ...]
    axis: Array
    rotation: Array
    translation: Array
    mass: Array
    com: Array
    inertia: Array
    link_names: tuple[str, ...]
    link_joints: tuple[str, ...]
    link_body: tuple[int, ...]
    link_rotation: Array
    link_translation: Array
    link_parent: tuple[int, ...] = UNSET
    lower: Array = UNSET
    upper: Array = UNSET
    velocity_limit: Array = UNSET
    effort_limit: Array = UNSET
    acceleration_limit: Array = UNSET
    deceleration_limit: Array = UNSET
    jerk_limit: Array = UNSET
    damping: Array = UNSET
    friction: Array = UNSET
    armature: Array = UNSET
    coordinate: tuple[int, ...] = UNSET
    independent_joints: tuple[int, ...] = UNSET
    multiplier: Array = UNSET
    offset: Array = UNSET
    couplings: tuple[Any, ...] = ()
    loops: tuple[Loop, ...] = ()
    base_mass: float = 0.0
    base_com: Array = field(default_factory=lambda: np.zeros(3))
    base_inertia: Array = field(default_factory=lambda: np.zeros((3, 3)))
    gravity: Array = field(default_factory=lambda: np.array(STANDARD_GRAVITY))
    shapes: tuple[Cylinder | Box, ...] = ()
    notes: Mapping[str, str] = field(default_factory=dict)
    source: str | None = None
    given_moments: Moments | None = None

    def __post_init__(self) -> None:
        nb = len(self.moving_joints)
        defaults: dict[str, Any] = {"lower": np.full(nb, -np.inf), "multiplier": np.ones(nb)}
        defaults |= dict.fromkeys(("upper", *LIMITS), np.full(nb, np.inf))
        defaults |= dict.fromkeys(("damping", "friction", "armature", "offset"), np.zeros(nb))
        defaults |= dict.fromkeys(("coordinate", "independent_joints"), tuple(range(nb)))
        values = {f.name: getattr(self, f.name) for f in fields(self)}
        values |= {name: default for name, default in defaults.items() if values[name] is None}
        values |= {name: np.array(plain_array(name, values[name]), dtype=np.float64) for name in ARRAY_FIELDS}
        self._freeze(values)
        check_model({f.name: getattr(self, f.name) for f in fields(self)})
        if self.link_parent is None:
            place = {joint: k for k, joint in enumerate(self.link_joints)}
            carrier = {i: place[joint] for i, joint in enumerate(self.moving_joints)} | {-1: 0}
            above = {carrier[i]: carrier[parent] for i, parent in enumerate(self.parent)}
            likely = (-1 if k == 0 else above.get(k, carrier[body]) for k, body in enumerate(self.link_body))
            object.__setattr__(self, "link_parent", tuple(likely))

    def __repr__(self) -> str:
        kinds = dict.fromkeys(self.joint_types)
        types = ", ".join(f"{self.joint_types.count(kind)} {kind}" for kind in kinds)
        joints = f"{types}: {listed(self.moving_joints)}" if types else "none"
        return wrapped(
            f"Model '{short(self.name)}': {counted(self.n, 'joint')}, {counted(len(self.link_names), 'link')}, "
            f"{self.mass.sum():.6g} kg moving, gravity {brief_array(self.gravity)} m/s^2\n"
            f"  moving joints: {joints}"
        )

    def _freeze(self, values: dict[str, Any]) -> None:
        for name, value in values.items():
            if isinstance(value, np.ndarray):
                value.setflags(write=False)
            elif isinstance(value, list):
                value = tuple(value)
            elif isinstance(value, Mapping):
                value = MappingProxyType(dict(value))
            object.__setattr__(self, name, value)

    def __reduce__(self) -> tuple[Any, ...]:
        values = {f.name: getattr(self, f.name) for f in fields(self)}
        return unchecked_model, (values | {"notes": dict(self.notes)},)

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Model):
            return NotImplemented
        pairs = ((getattr(self, f.name), getattr(other, f.name)) for f in fields(self) if f.name not in NOT_COMPARED)
        return all(is_equal(a, b) for a, b in pairs)

    def __hash__(self) -> int:
        return hash((self.name, self.moving_joints, self.link_names, self.mass.tobytes()))

    @cached_property
    def nb(self) -> int:
        """Number of moving joints, and of moving bodies."""
        return len(self.moving_joints)

    @cached_property
    def n(self) -> int:
        """Number of coordinates: moving joints that are neither mimic nor coupled joints."""
        return len(self.independent_joints)

    @cached_property
    def joint_names(self) -> tuple[str, ...]:
        """Names of the joints that the coordinates q belong to, in their order."""
        return tuple(self.moving_joints[i] for i in self.independent_joints)

    @cached_property
    def has_mimics(self) -> bool:
        """True if some joints are mimic or coupled ones, so that q is not the list of the joints' positions."""
        return self.n != self.nb

    @cached_array
    def coordinate_map(self) -> Array:
        """Matrix G of q_joints = G q + offset, shape (nb, n); a ModelError where couplings make it depend on q."""
        if self.couplings:
            raise ModelError(f"joint {self.couplings[0].joint!r} of robot {self.name!r} follows others by no constant")
        return self.mimic_map

    @cached_array
    def mimic_map(self) -> Array:
        """Matrix of `coordinate_map`, with rows of zeros for coupled joints."""
        G = np.zeros((self.nb, self.n), dtype=self.multiplier.dtype)
        G[range(self.nb), self.coordinate] = self.multiplier
        return G

    @cached_property
    def coupled_joints(self) -> tuple[tuple[int, list[int], Any], ...]:
        """Coupled joints: each one's index, its drivers' indices among the coordinates, and the coupling."""
        place, joints = self.moving_joints.index, self.joint_names
        return tuple((place(c.joint), [joints.index(name) for name in c.drivers], c) for c in self.couplings)

    @cached_array
    def rest(self) -> Array:
        """Positions of the moving joints where the coordinates are 0, shape (nb,)."""
        rest = self.offset.copy()
        for i, drivers, coupling in self.coupled_joints:
            rest[i] = coupling.position(np.zeros(len(drivers), dtype=rest.dtype))
        return rest

    def coordinate_limits(self) -> dict[str, Array]:
        """Limits of the coordinates, those of the joints that mimic them included.

        Returns
        -------
        dict of str to ndarray, shape (n,) each
            By name: `lower`, `upper`, and the velocity, effort, acceleration, deceleration (`braking_limit`) and jerk
            limits. A joint i with q_i = m q + o limits q to its range minus o, divided by m, and to its other limits
            divided by abs(m). The effort limit is that of the coordinate's own joint, which has the drive.

        Examples
        --------
        >>> import rne
        >>> rne.irb140().coordinate_limits()["velocity_limit"].round(2).tolist()
        [3.49, 3.49, 4.54, 6.28, 6.28, 7.85]
        """
        own = list(self.independent_joints)
        of_joints = {name: getattr(self, name) for name in ("lower", "upper", *LIMITS)}
        of_joints["deceleration_limit"] = self.braking_limit
        limits = {name: limit[own] for name, limit in of_joints.items()}
        for i, k in enumerate(self.coordinate):
            m = self.multiplier[i]
            if i == own[k] or m == 0:
                continue
            low, high = sorted(((self.lower[i] - self.offset[i]) / m, (self.upper[i] - self.offset[i]) / m))
            limits["lower"][k], limits["upper"][k] = max(limits["lower"][k], low), min(limits["upper"][k], high)
            for name in ("velocity_limit", "acceleration_limit", "deceleration_limit", "jerk_limit"):
                limits[name][k] = min(limits[name][k], of_joints[name][i] / abs(m))
        return limits

    @cached_array
    def braking_limit(self) -> Array:
        """Largest decelerations of the moving joints; those of accelerations where unknown, shape (nb,)."""
        return np.where(np.isinf(self.deceleration_limit), self.acceleration_limit, self.deceleration_limit)

    @cached_property
    def coordinate_parent(self) -> tuple[int, ...]:
        """Parent of each coordinate in the sparsity pattern of M; the previous one if mimics fill it."""
        return tuple(range(-1, self.n - 1)) if self.has_mimics else self.parent

    @cached_array
    def moments(self) -> Moments:
        """Mass, first moment and inertia of the bodies about their frames' origins: the inertial parameters."""
        if self.given_moments is not None:
            return self.given_moments
        m, c = self.mass, self.com
        return Moments(m, m[..., None] * c, self.inertia + point_mass_inertia(m[..., None, None], c))

    def body_moments(self, i: int) -> Moments:
        """Mass (..., 1), first moment (..., 3) and inertia (..., 3, 3) of body i about its frame's origin."""
        m, h, I = self.moments
        return Moments(m[..., i, None], h[..., i, :], I[..., i, :, :])

    @cached_array
    def is_revolute(self) -> Array:
        """True for each moving joint that rotates, False for each that slides, shape (nb,)."""
        return np.array([kind in REVOLUTE_TYPES for kind in self.joint_types], dtype=bool)

    @cached_array
    def joint_origin(self) -> Array:
        """Origin of each moving joint in its file, in frame i, shape (nb, 3); 0 unless it was moved at load [m]."""
        place = {joint: k for k, joint in enumerate(self.link_joints)}
        return np.array([self.link_translation[place[joint]] for joint in self.moving_joints]).reshape(self.nb, 3)

    @cached_array
    def angular_axis(self) -> Array:
        """Angular part s of each joint's motion per unit velocity: its axis, 0 for a sliding joint, shape (nb, 3)."""
        return self.axis * self.is_revolute.astype(np.int8)[:, None]

    @cached_array
    def linear_axis(self) -> Array:
        """Linear part t of each joint's motion per unit velocity: its axis, 0 for a rotating joint, shape (nb, 3)."""
        return self.axis * (~self.is_revolute).astype(np.int8)[:, None]

    def link_index(self, link: str) -> int:
        """Position of a link in `link_names`.

        Parameters
        ----------
        link : str
            One of `link_names`.

        Returns
        -------
        int
            Its index, also into `link_poses`.

        Raises
        ------
        ValueError
            If there is no such link; the message lists all links.

        Examples
        --------
        >>> import rne
        >>> rne.irb140().link_index("link_2")
        2
        """
        if link not in self.link_names:
            raise ValueError(f"`link` must be one of {list(self.link_names)}, got {link!r}")
        return self.link_names.index(link)

    def astype(self, dtype: DTypeLike, number: Callable[[float], Any] | None = None) -> Model:
        """Model with every array in another dtype, for arithmetic in that dtype.

        Rotations and axes keep the values they have in float64: in a finer dtype they are orthogonal and of unit length
        to about 1e-16 only, so that identities between different formulas hold to that accuracy.

        Parameters
        ----------
        dtype : data type
            Real floating point, or object.
        number : callable, optional
            For object arrays: makes one number from a float, for example `mpmath.mpf`.

        Returns
        -------
        Model
            With the same numbers in that dtype; they are not checked again.

        Examples
        --------
        >>> import numpy as np, rne
        >>> rne.irb140().astype(np.float32).mass.dtype
        dtype('float32')
        """

        def converted(array: Array) -> Array:
            return array.astype(dtype) if number is None else convert_array(array, number)

        values = {f.name: getattr(self, f.name) for f in fields(self)}
        values |= {name: converted(values[name]) for name in ARRAY_FIELDS}
        if self.given_moments is not None:  # complex steps and traced numbers keep their own
            moments = (x if x.dtype.kind in "cO" else converted(x) for x in self.given_moments)
            values["given_moments"] = Moments(*moments)
        return unchecked_model(values)


def unchecked_model(values: dict[str, Any]) -> Model:
    """Model of values, by the names of all fields, without checks."""
    model = object.__new__(Model)
    model._freeze(values)
    return model


def with_unchecked(model: Model, **values: Any) -> Model:
    """Model with other values of some fields, which are not checked and may be traced, for dynamics only."""
    return unchecked_model({f.name: getattr(model, f.name) for f in fields(model)} | values)


ARRAY_FIELDS = frozenset(f.name for f in fields(Model) if f.type == "Array")


def model_argument(model: object) -> Model:
    """The argument, if it is a Model; otherwise a TypeError."""
    if not isinstance(model, Model):
        raise TypeError(f"`model` must be an rne.Model, got {type(model).__name__}; a Robot has it as .model")
    return model


class HasModel(Protocol):
    """Object with a model that can be replaced: an rne.Robot, which this module does not import."""

    @property
    def model(self) -> Model:
        """The model."""

    def with_model(self, model: Model) -> Self:
        """Copy with another model."""


P = ParamSpec("P")
R = TypeVar("R", bound=HasModel)


class OfEither(Protocol[P]):
    """Function that returns a Model for a Model and a Robot for a Robot."""

    @overload
    def __call__(self, model: Model, /, *args: P.args, **kwargs: P.kwargs) -> Model: ...

    @overload
    def __call__(self, model: R, /, *args: P.args, **kwargs: P.kwargs) -> R: ...


def of_either(change: Callable[Concatenate[Model, P], Model]) -> OfEither[P]:
    """Decorator of a function from Model to Model: with a Robot it returns a Robot of the same engine."""

    @wraps(change)
    def changed(model: Any, *args: P.args, **kwargs: P.kwargs) -> Any:
        if isinstance(model, Model):
            return change(model, *args, **kwargs)
        if not hasattr(model, "with_model"):
            raise TypeError(f"`model` must be an rne.Model or rne.Robot, got {type(model).__name__}")
        return model.with_model(change(model.model, *args, **kwargs))

    return cast("OfEither[P]", changed)


def joint_array(
    name: str, value: ArrayLike, model: Model, width: int | None = None, *, may_be_infinite: bool = False
) -> Array:
    """Array of numbers with the joints, or `width` entries, along the last axis; an error that names it otherwise."""
    n = model.n if width is None else width
    array = (convert_numbers if may_be_infinite else number_array)(name, value, f"(..., {n})")
    if array.ndim == 0 or array.shape[-1] != n:
        turned = f"; states go along the first axis: pass `{name}`.T, of shape {array.shape[::-1]}"
        cure = turned if array.ndim == 2 and array.shape[0] == n else ""
        raise ValueError(f"`{name}` must have shape (..., {n}) for robot {model.name!r}, got {array.shape}{cure}")
    return array
