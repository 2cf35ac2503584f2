"""Springs between points of two links and at joints: coil and gas springs, counterbalances, torsion springs.

A spring of length l pulls with k (l - l0) - F + d dl/dt. At its joints the drives must supply this tension times dl/dq,
which in a scene without drives acts as minus that torque. With k l0 + F = c the tension is k l - c, linear in k and c.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..basics.arrays import positive_number, real_array, vector
from ..basics.spatial import IDENTITY, Array, cross, dot, rotate, sqrt, zeros
from ..basics.text import did_you_mean, listed, short
from ..dynamics.kinematics import BASE, joint_positions, joint_transforms, point_of_body
from ..dynamics.quantity import MethodQuantity, Quantity
from ..errors import NotFiniteError
from ..model.model import Model
from ..robot import Robot

Point = tuple[float, float, float]


@dataclass(frozen=True)
class Spring:
    """A spring between a point of a link and a point of another, for a Scene; equal by value.

    Its tension is stiffness (l - length) - force + damping dl/dt, where l is the distance of the points: it pulls
    where this is positive. So a gas spring, which pushes, has force > 0.

    Parameters
    ----------
    link, other : str
        The links that it joins; one may be the root link.
    point, other_point : array_like, shape (3,)
        Its ends, each in the frame of its link [m].
    stiffness : float
        Tension per length [N/m].
    length : float
        Length at which the stiffness makes no tension. With 0, and without force and damping, the tension is
        proportional to the distance, and its ends may meet, as those of ideal counterbalances do [m].
    force : float
        Force with which it pushes at every length, negative for a preload that pulls [N].
    damping : float
        Tension per rate of the length [N s/m].

    Raises
    ------
    ValueError
        If a number is not finite, stiffness, length or damping is negative, or a point has another shape.
    TypeError
        If a link is not named by a text.

    Examples
    --------
    A counterbalance: the upper end is fixed to link 1, the lower one moves with link 2.

    >>> import rne
    >>> spring = rne.Spring("link_1", [0.1, 0, 0.5], "link_2", [0, 0.1, 0.2], stiffness=2000, length=0.3)
    >>> arm = rne.load("irb140")
    >>> held = rne.Scene(arm, springs=[spring]).inverse_dynamics([0] * 6, [0] * 6, [0] * 6)
    >>> (held - arm.gravity_torque([0] * 6)).round(3).tolist()  # at joint 2 alone [N m]
    [0.0, 0.0, 0.0, 0.0, 0.0, 0.0]
    """

    link: str
    point: ArrayLike
    other: str
    other_point: ArrayLike
    stiffness: float
    length: float
    force: float = 0.0
    damping: float = 0.0

    def __post_init__(self) -> None:
        for name in ("link", "other"):
            if not isinstance(getattr(self, name), str):
                raise TypeError(f"`{name}` must be the name of a link, got {type(getattr(self, name)).__name__}")
        for name in ("point", "other_point"):
            object.__setattr__(self, name, tuple(vector(name, getattr(self, name), 3).tolist()))
        _set_numbers(self, "force", stiffness=self.stiffness, length=self.length, damping=self.damping)

    @staticmethod
    def at_joint(joint: str, stiffness: float, rest: float, damping: float = 0.0) -> JointSpring:
        """A torsion spring at a rotating joint, or a coil spring along a sliding one.

        Parameters
        ----------
        joint : str
            The joint whose position the spring pulls towards `rest`.
        stiffness : float
            Torque per angle, or force per length [N m/rad or N/m].
        rest : float
            Position without torque; it may be out of the joint's range, as of a spring with preload [rad or m].
        damping : float
            Torque per velocity [N m s/rad or N s/m].

        Returns
        -------
        JointSpring
            What Scene(springs=[...]) takes, as a Spring.

        Raises
        ------
        ValueError
            If a number is not finite, or stiffness or damping is negative.

        Examples
        --------
        >>> import rne
        >>> scene = rne.Scene(rne.load("irb140"), gravity=[0, 0, 0], springs=[rne.Spring.at_joint("joint_2", 100, 0.5)])
        >>> scene.inverse_dynamics([0] * 6, [0] * 6, [0] * 6).round(9).tolist()
        [0.0, -50.0, 0.0, 0.0, 0.0, 0.0]
        """
        return JointSpring(joint, stiffness, rest, damping)

    def __str__(self) -> str:
        return f"spring between {short(self.link)!r} and {short(self.other)!r}"

    @property
    def has_length(self) -> bool:
        """False if its tension is proportional to the distance, so that its ends may meet."""
        return bool(self.length or self.force or self.damping)

    @property
    def symbols(self) -> tuple[str, ...]:
        """Numbers that torques are linear in: k, and c = k length + force if it has a length."""
        return ("k", "c") if self.has_length else ("k",)

    def columns(self, model: Model, q: Array) -> Array:
        """Torques that drives must supply per unit of each, (..., n, 2) or (..., n, 1)."""
        d, J = self.offset(model, q)
        pull = rotate(J, d)
        return np.stack([pull, -pull / sqrt(dot(d, d))[..., None]][: len(self.symbols)], axis=-1)

    def at(self, k: float, c: float = 0.0) -> Spring:
        """The spring of these numbers: of its force and not negative length, or else of length 0."""
        length = max((c - self.force) / k, 0.0) if k and self.has_length else 0.0
        return replace(self, stiffness=k, length=length, force=c - k * length)

    def bodies(self, model: Model) -> list[list[int]]:
        """The bodies that carry each end but not the other, from the base to the tips."""
        paths = []
        for link in (self.link, self.other):
            path, body = [], model.link_body[model.link_index(link)]
            while body != BASE:
                path, body = [body, *path], model.parent[body]
            paths.append(path)
        return [[i for i in path if i not in other] for path, other in (paths, paths[::-1])]

    def offset(self, model: Model, q: Array) -> tuple[Array, Array]:
        """The vector d from one end to the other, and dd/dq, shape (..., n, 3), in the axes of what carries both."""
        R, p = joint_transforms(model, q)
        ends, J = [], zeros((*q.shape[:-1], model.nb, 3), like=q)
        sides = (-1, self.link, self.point), (1, self.other, self.other_point)
        for path, (sign, link, point) in zip(self.bodies(model), sides, strict=True):
            axes, origin = {BASE: IDENTITY}, {BASE: zeros((3,), like=q)}
            for i, before in zip(path, [BASE, *path], strict=False):
                origin[i], axes[i] = origin[before] + rotate(axes[before], p[i]), axes[before] @ R[i]
            tip = path[-1] if path else BASE
            end = origin[tip] + rotate(axes[tip], point_of_body(model, link, point)[1].astype(model.mass.dtype))
            for i in path:
                turned = cross(rotate(axes[i], model.angular_axis[i]), end - origin[i])
                J[..., i, :] = sign * (turned + rotate(axes[i], model.linear_axis[i]))
            ends.append(end)
        return ends[1] - ends[0], by_coordinates(model, J)

    def stretch(self, model: Model, q: Array) -> tuple[Array, Array]:
        """Length l and its slope dl/dq, (...) and (..., n)."""
        d, J = self.offset(model, q)
        l = sqrt(dot(d, d))
        return l, rotate(J, d) / l[..., None]

    def elastic(self, model: Model, q: Array) -> Array:
        """Torques of stiffness and force, the slope of the energy, (..., n)."""
        if not self.has_length:
            d, J = self.offset(model, q)
            return self.stiffness * rotate(J, d)
        l, slope = self.stretch(model, q)
        return (self.stiffness * (l - self.length) - self.force)[..., None] * slope

    def energy(self, model: Model, q: Array) -> Array:
        """Potential energy, of the force from length 0 on, (...)."""
        d, _ = self.offset(model, q)
        if not self.has_length:
            return self.stiffness / 2 * dot(d, d)
        l = sqrt(dot(d, d))
        return self.stiffness / 2 * (l - self.length) * (l - self.length) - self.force * l


@dataclass(frozen=True)
class JointSpring:
    """A spring at a joint, made by `Spring.at_joint`, with its arguments."""

    joint: str
    stiffness: float
    rest: float
    damping: float = 0.0

    def __post_init__(self) -> None:
        if not isinstance(self.joint, str):
            raise TypeError(f"`joint` must be the name of a joint, got {type(self.joint).__name__}")
        _set_numbers(self, "rest", stiffness=self.stiffness, damping=self.damping)

    def __str__(self) -> str:
        return f"spring at {short(self.joint)!r}"

    @property
    def symbols(self) -> tuple[str, ...]:
        """The number that torques are linear in; another rest is an offset of the drive."""
        return ("k",)

    def columns(self, model: Model, q: Array) -> Array:
        """Torques that drives must supply per unit of the stiffness, (..., n, 1)."""
        return replace(self, stiffness=1.0).elastic(model, q)[..., None]

    def at(self, k: float) -> JointSpring:
        """The spring of this stiffness."""
        return replace(self, stiffness=k)

    def stretch(self, model: Model, q: Array) -> tuple[Array, Array]:
        """Position l of the joint and its slope dl/dq, (...) and (..., n)."""
        i = model.moving_joints.index(self.joint)
        unit = zeros((*q.shape[:-1], model.nb, 1), like=q)
        unit[..., i, 0] = 1
        return joint_positions(model, q)[..., i], by_coordinates(model, unit)[..., 0]

    def elastic(self, model: Model, q: Array) -> Array:
        """Torques of the stiffness, the slope of the energy, (..., n)."""
        l, slope = self.stretch(model, q)
        return (self.stiffness * (l - self.rest))[..., None] * slope

    def energy(self, model: Model, q: Array) -> Array:
        """Potential energy, (...)."""
        l, _ = self.stretch(model, q)
        return self.stiffness / 2 * (l - self.rest) * (l - self.rest)


@dataclass(frozen=True)
class Springs:
    """The springs of a scene as functions of the joints; equal by value, so that kernels are found."""

    each: tuple[Spring | JointSpring, ...]

    @property
    def dissipates(self) -> bool:
        """True if any has damping."""
        return any(spring.damping for spring in self.each)

    def torques(self, model: Model, q: Array, qd: Array) -> tuple[Array, Array | None]:
        """What drives must supply against the springs, and the part of it against damping, None without, (..., n)."""
        elastic, damping = 0 * q, None
        for spring in self.each:
            elastic = elastic + spring.elastic(model, q)
            if spring.damping:
                _, slope = spring.stretch(model, q)
                torque = spring.damping * dot(slope, qd)[..., None] * slope
                damping = torque if damping is None else damping + torque
        return elastic if damping is None else elastic + damping, damping

    def torque_core(self, model: Model, q: Array, qd: Array) -> Array:
        """What drives must supply against the springs, traced."""
        return self.torques(model, q, qd)[0]

    def energy_core(self, model: Model, q: Array) -> Array:
        """Potential energy, traced."""
        total: Array = sum((spring.energy(model, q) for spring in self.each), 0 * q.sum(-1))
        return total

    @property
    def symbols(self) -> tuple[str, ...]:
        """What torques are linear in, spring by spring."""
        return tuple(f"{symbol}_spring{k}" for k, spring in enumerate(self.each, 1) for symbol in spring.symbols)

    def columns(self, model: Model, q: Array) -> Array:
        """Torques that drives must supply per unit of each, (..., n, k)."""
        return np.concatenate([spring.columns(model, q) for spring in self.each], axis=-1)

    def at(self, numbers: Array) -> tuple[Spring | JointSpring, ...]:
        """The springs of these numbers."""
        left = iter(numbers.tolist())
        return tuple(spring.at(*(next(left) for _ in spring.symbols)) for spring in self.each)

    def torque(self, robot: Robot, q: ArrayLike, qd: ArrayLike) -> Array:
        """What the drives of a robot must supply against the springs, (..., n) [N m or N]."""
        return self._evaluate("torque", robot, q, qd)

    def energy(self, robot: Robot, q: ArrayLike) -> Array:
        """Potential energy, (...) [J]."""
        return self._evaluate("energy", robot, q)

    def _evaluate(self, name: str, robot: Robot, *arrays: ArrayLike) -> Array:
        widths = dict.fromkeys(("q", "qd")[: len(arrays)])
        how = Quantity(
            name=name, core=getattr(self, f"{name}_core"), widths=widths, moments=False, base_parameters=False
        )
        try:
            return robot._kernels.evaluate_scene(MethodQuantity(self, how, f"{name} of the springs"), (), *arrays)
        except NotFiniteError:
            self.check_ends(robot.model, np.asarray(arrays[0]))
            raise

    def check_ends(self, model: Model, q: Array) -> None:
        """Raise an error that names a spring whose ends meet, as its tension has no direction there."""
        for spring in self.each:
            if isinstance(spring, Spring) and spring.has_length:
                d, _ = spring.offset(model, q)
                if (meet := ~d.any(axis=-1)).any():
                    text = (
                        f"the ends of the {spring} meet, where its tension has no direction; only one of length, force "
                        "and damping 0 may pass there"
                    )
                    raise NotFiniteError(text, state=tuple(np.argwhere(meet)[0].tolist()))


def by_coordinates(model: Model, rows: Array) -> Array:
    """Slopes by the coordinates of slopes by the positions of moving joints, (..., nb, k) to (..., n, k)."""
    return model.coordinate_map.T @ rows if model.has_mimics else rows


def resolved_springs(springs: Sequence[Spring | JointSpring] | None, robot: Robot, scene: Robot) -> Springs | None:
    """The springs given for a robot, checked, that act in a scene whose robot may have locked joints."""
    if springs is None:
        return None
    if isinstance(springs, Spring | JointSpring | str) or not isinstance(springs, Sequence):
        raise TypeError(f"`springs` must be a sequence of rne.Spring, got {type(springs).__name__}")
    for k, spring in enumerate(springs):
        _check_places(f"springs[{k}]", spring, robot.model)
    moving = [s for s in springs if acts_on(s, scene.model)]
    return Springs(tuple(moving)) if moving else None


def acts_on(spring: Spring | JointSpring, model: Model) -> bool:
    """True if a joint that moves stretches the spring."""
    return spring.joint in model.moving_joints if isinstance(spring, JointSpring) else any(spring.bodies(model))


def _check_places(name: str, spring: Any, model: Model) -> None:
    """Refuse what is no spring, or is at links or joints that the robot does not have or that do not stretch it."""
    if isinstance(spring, JointSpring):
        asked, known, what = {"joint": spring.joint}, model.moving_joints, "moving joints"
    elif isinstance(spring, Spring):
        asked, known, what = {"link": spring.link, "other": spring.other}, model.link_names, "links"
    else:
        raise TypeError(f"`{name}` must be an rne.Spring, got {type(spring).__name__}")
    for part, given in asked.items():
        if given not in known:
            near = did_you_mean(given, known)
            raise ValueError(f"`{name}.{part}` must be one of the {what} {listed(known)}, got {given!r}{near}")
    if not acts_on(spring, model):
        raise ValueError(f"`{name}` joins {spring.link!r} and {spring.other!r}, between which no joint moves")


def _set_numbers(spring: Any, signed: str, **not_negative: float) -> None:
    """The numbers of a spring as floats, checked: one of any sign, the others not negative."""
    value = real_array(signed, getattr(spring, signed), "()")
    object.__setattr__(spring, signed, float(value))
    for name, number in not_negative.items():
        object.__setattr__(spring, name, positive_number(name, number, zero_allowed=True))
