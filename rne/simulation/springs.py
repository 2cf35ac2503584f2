"""Springs between points of two links and at joints: coil and gas springs, counterbalances, torsion springs.

A spring of length l pulls with k (l - l0) - F + d dl/dt. At its joints the drives must supply this tension times dl/dq,
which in a scene without drives acts as minus that torque. With k l0 + F = c the tension is k l - c, linear in k and c.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, cast

import numpy as np
from numpy.typing import ArrayLike

from ..basics.arrays import copy_with, positive_number, real_array, vector
from ..basics.numbers import part_of
from ..basics.spatial import IDENTITY, Array, cross, dot, rotate, rotate_back, sqrt, transpose, zeros
from ..basics.text import did_you_mean, listed, short
from ..dynamics.kinematics import BASE, coordinate_map, joint_positions, joint_transforms, point_of_body
from ..dynamics.quantity import MethodQuantity, Quantity
from ..errors import NotFiniteError
from ..graph.scalar import is_present, is_traced
from ..model.model import Model, joint_array
from ..robot import Robot


@dataclass(frozen=True)
class Spring:
    """Spring between points of two links, for a Scene; equal by value.

    Its tension is stiffness (l - length) - force + damping dl/dt, where l is the distance of the points: it pulls
    where this is positive. So a gas spring, which pushes, has force > 0. With only `force`, without stiffness, it is a
    constant force between the points, with only `damping` a damper.

    Parameters
    ----------
    link : str
        A link that it joins, or the root link.
    point : array_like, shape (3,)
        Its end there, in the frame of that link [m].
    other, other_point : str, and array_like of shape (3,)
        Link and point of its other end [m].
    stiffness : float, optional
        Tension per length; 0 by default if force or damping is not zero [N/m].
    length : float, optional
        Length at which the stiffness makes no tension. With 0, and without force and damping, the tension is
        proportional to the distance, and its ends may meet, as those of ideal counterbalances do [m].
    force : float, optional
        Force with which it pushes at every length, negative for a preload that pulls [N].
    damping : float, optional
        Tension per rate of the length [N s/m].

    Raises
    ------
    ValueError
        If a number is not finite, stiffness, length or damping is negative, no stiffness, force or damping is given, or
        a point has another shape.
    TypeError
        If the name of a link is not a str.

    Examples
    --------
    A gas spring in front of the arm pushes it back, and takes most of the load off joint 2.

    >>> import rne
    >>> arm = rne.load("irb140")
    >>> gas = rne.Spring("link_1", [0.3, -0.2, 0], "link_2", [0.2, 0.05, 0], stiffness=1000, length=0.3, force=500)
    >>> leaning = [0, 0.6, 0, 0, 0, 0]
    >>> held = rne.Scene(arm, springs=[gas]).inverse_dynamics(leaning, [0] * 6, [0] * 6)
    >>> arm.gravity_torque(leaning)[1].round(1).item(), held[1].round(1).item()
    (-95.8, -3.7)
    """

    link: str
    point: Any  # a tuple
    other: str
    other_point: Any
    stiffness: float = cast(float, None)  # 0.0 if force or damping is given
    length: float = 0.0
    force: float = 0.0
    damping: float = 0.0

    def __post_init__(self) -> None:
        if not_given := self.stiffness is None:  # a stiffness of 0 is one that is varied, or to be found
            object.__setattr__(self, "stiffness", 0.0)
        _check(self, ("link", "other"), "force", "stiffness", "length", "damping")
        if not_given and not (self.force or self.damping):
            raise ValueError(f"one of `stiffness`, `force` and `damping` of the {self} must be given")
        for name in ("point", "other_point"):
            object.__setattr__(self, name, tuple(vector(name, getattr(self, name), 3).tolist()))

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
            Position without torque; it may be out of the joint's range, as for a spring with preload [rad or m].
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
    def ends(self) -> tuple[tuple[str, Any], tuple[str, Any]]:
        """Link and point of both ends."""
        return (self.link, self.point), (self.other, self.other_point)

    @property
    def has_length(self) -> bool:
        """False for a tension proportional to the distance, for which the end points may coincide."""
        return any(map(is_present, (self.length, self.force, self.damping)))

    @property
    def symbols(self) -> tuple[str, ...]:
        """Symbols of the numbers that torques are linear in: k, and c = k length + force if it has a length."""
        return ("k", "c") if self.has_length else ("k",)

    def _columns(self, model: Model, q: Array) -> Array:
        """Torques that drives must supply per unit of each, (..., n, 2) or (..., n, 1)."""
        d, J = self._offset(model, q)
        return np.stack([rotate(J, d), -self._stretch(model, q)[1]][: len(self.symbols)], axis=-1)

    def _at(self, k: float, c: float = 0.0) -> Spring:
        """Spring with these numbers: force kept and length nonnegative, or else length 0."""
        length = max((c - self.force) / k, 0.0) if k and self.has_length else 0.0
        return replace(self, stiffness=k, length=length, force=self.force if length else c)

    def _bodies(self, model: Model) -> list[list[int]]:
        """Bodies that carry one end but not the other, from the base to the tips; [] if none stretch it."""
        paths = []
        for link in (self.link, self.other):
            path = [model.link_body[model.link_index(link)]]
            while path[0] != BASE:
                path.insert(0, model.parent[path[0]])
            paths.append(path)
        return [[i for i in path if i not in other] for path, other in (paths, paths[::-1])]

    def _offset(self, model: Model, q: Array) -> tuple[Array, Array]:
        """Vector d from one end to the other and dd/dq, (..., n, 3), in the axes of the body that carries both."""
        R, p = joint_transforms(model, q)
        ends, J = [], zeros((*q.shape[:-1], model.nb, 3), like=q)
        for sign, path, (link, point) in zip((-1, 1), self._bodies(model), self.ends, strict=True):
            axes, origin = [IDENTITY], [zeros((3,), like=q)]  # of what carries both, then of each body
            for i in path:
                origin.append(origin[-1] + rotate(axes[-1], p[i]))
                axes.append(axes[-1] @ R[i])
            end = origin[-1] + rotate(axes[-1], point_of_body(model, link, point)[1].astype(model.mass.dtype))
            for i, R0, p0 in zip(path, axes[1:], origin[1:], strict=True):
                turned = cross(rotate(R0, model.angular_axis[i]), end - p0)
                J[..., i, :] = sign * (turned + rotate(R0, model.linear_axis[i]))
            ends.append(end)
        return ends[1] - ends[0], by_coordinates(model, q, J)

    def _stretch(self, model: Model, q: Array) -> tuple[Array, Array]:
        """Length l and its derivative dl/dq, (...) and (..., n)."""
        d, J = self._offset(model, q)
        l = sqrt(dot(d, d))
        return l, rotate(J, d) / l[..., None]

    def _pull(self, d: Array) -> Array:
        """Force towards the other end, at distance d from the first, from stiffness and `force`, (..., 3)."""
        if not self.has_length:
            return self.stiffness * d
        l = sqrt(dot(d, d))[..., None]
        return (self.stiffness * (l - self.length) - self.force) * (d / l)

    def _elastic(self, model: Model, q: Array) -> Array:
        """Torques of stiffness and force, the gradient of the energy, (..., n)."""
        d, J = self._offset(model, q)
        return rotate(J, self._pull(d))

    def _energy(self, model: Model, q: Array) -> Array:
        """Potential energy, with the force integrated from length 0, (...)."""
        d, _ = self._offset(model, q)
        l = sqrt(dot(d, d))
        return self.stiffness / 2 * (l - self.length) * (l - self.length) - self.force * l


@dataclass(frozen=True)
class JointSpring:
    """Spring at a joint, made by `Spring.at_joint`, with its arguments."""

    joint: str
    stiffness: float
    rest: float
    damping: float = 0.0
    symbols = ("k",)  # symbol of the stiffness: another rest position is an offset of the drive

    def __post_init__(self) -> None:
        _check(self, ("joint",), "rest", "stiffness", "damping")

    def __str__(self) -> str:
        return f"spring at {short(self.joint)!r}"

    def _columns(self, model: Model, q: Array) -> Array:
        """Torques that drives must supply per unit of stiffness, (..., n, 1)."""
        return self._at(1.0)._elastic(model, q)[..., None]

    def _at(self, k: float) -> JointSpring:
        """Spring of this stiffness."""
        return replace(self, stiffness=k)

    def _bodies(self, model: Model) -> list[str]:
        """The joint, if it moves."""
        return [self.joint] if self.joint in model.moving_joints else []

    def _stretch(self, model: Model, q: Array) -> tuple[Array, Array]:
        """Position l of the joint and its derivative dl/dq, (...) and (..., n)."""
        i = model.moving_joints.index(self.joint)
        unit = zeros((*q.shape[:-1], model.nb, 1), like=q)
        unit[..., i, 0] = 1
        return joint_positions(model, q)[..., i], by_coordinates(model, q, unit)[..., 0]

    def _elastic(self, model: Model, q: Array) -> Array:
        """Torques of the stiffness, the gradient of the energy, (..., n)."""
        l, slope = self._stretch(model, q)
        return (self.stiffness * (l - self.rest))[..., None] * slope

    def _wrenches(self, model: Model, T: Array, q: Array) -> dict[str, Array]:
        """Wrenches of the spring on the links on both sides of the joint, from the poses of all links."""
        i, k = model.moving_joints.index(self.joint), model.link_joints.index(self.joint)
        axis = rotate(T[..., k, :3, :3], model.axis[i])
        found, load = {}, self.stiffness * (self.rest - self._stretch(model, q)[0])[..., None] * axis
        for sign, link in ((1, k), (-1, model.link_parent[k])):
            pull = sign * rotate_back(T[..., link, :3, :3], load)
            arm = rotate_back(T[..., link, :3, :3], T[..., k, :3, 3] - T[..., link, :3, 3])
            pair = (pull, 0 * pull) if model.is_revolute[i] else (cross(arm, pull), pull)
            found[model.link_names[link]] = np.concatenate(pair, axis=-1)
        return found

    def _energy(self, model: Model, q: Array) -> Array:
        """Potential energy, (...)."""
        stretch = self._stretch(model, q)[0] - self.rest
        return self.stiffness / 2 * stretch * stretch


@dataclass(frozen=True)
class Springs:
    """Springs of a scene as functions of the joint positions; equal by value, so that kernels are found."""

    each: tuple[Spring | JointSpring, ...]
    places: tuple[int, ...]  # among the springs that the scene was given

    @property
    def numbers(self) -> dict[str, Array]:
        """Numbers by name, "springs[0].stiffness"."""
        return {
            f"springs[{k}].{name}": np.array(getattr(spring, name))
            for k, spring in zip(self.places, self.each, strict=True)
            for name in ("stiffness", "length", "force", "rest", "damping")
            if hasattr(spring, name)
        }

    def with_numbers(self, numbers: Mapping[str, Any]) -> Springs:
        """Springs with other numbers, which are not checked and may be traced."""
        found = []
        for k, spring in zip(self.places, self.each, strict=True):
            own = part_of(numbers, f"springs[{k}].")
            found.append(copy_with(spring, **{name: np.asarray(x)[()] for name, x in own.items()}))
        return replace(self, each=tuple(found))

    @property
    def dissipates(self) -> bool:
        """True if any has damping."""
        return any(is_present(spring.damping) for spring in self.each)

    def torques(self, model: Model, q: Array, qd: Array) -> tuple[Array, Array | None]:
        """Torques that drives must supply against the springs, and the part against damping or None, (..., n)."""
        total, damping = sum((spring._elastic(model, q) for spring in self.each), 0 * q), None
        for spring in self.each:
            if is_present(spring.damping):
                _, slope = spring._stretch(model, q)
                torque = spring.damping * dot(slope, qd)[..., None] * slope
                total, damping = total + torque, torque if damping is None else damping + torque
        return total, damping

    @property
    def symbols(self) -> tuple[str, ...]:
        """Symbols of the numbers that torques are linear in, spring by spring."""
        return tuple(f"{symbol}_spring{k}" for k, spring in enumerate(self.each, 1) for symbol in spring.symbols)

    def columns(self, model: Model, q: Array) -> Array:
        """Torques that drives must supply per unit of each, (..., n, k)."""
        return np.concatenate([spring._columns(model, q) for spring in self.each], axis=-1)

    def at(self, numbers: Array) -> tuple[Spring | JointSpring, ...]:
        """Springs with these numbers."""
        left = iter(numbers.tolist())
        return tuple(spring._at(*(next(left) for _ in spring.symbols)) for spring in self.each)

    def torque(self, robot: Robot, q: ArrayLike, qd: ArrayLike) -> Array:
        """Torques that drives must supply against the springs, (..., n) [N m or N]."""
        return self._evaluate(robot, lambda model, q, qd: self.torques(model, q, qd)[0], "torque", q=q, qd=qd)

    def energy(self, robot: Robot, q: ArrayLike) -> Array:
        """Potential energy, (...) [J]."""
        return self._evaluate(robot, lambda model, q: sum(s._energy(model, q) for s in self.each), "energy", q=q)

    def _evaluate(self, robot: Robot, core: Any, name: str, **arrays: ArrayLike) -> Array:
        given: dict[str, Any] = {k: x if is_traced(x) else joint_array(k, x, robot.model) for k, x in arrays.items()}
        how = Quantity(name=name, core=core, widths=dict.fromkeys(given), moments=False, base_parameters=False)
        try:
            return robot.kernels.evaluate_some(MethodQuantity(self, how, "the springs"), *given.values())
        except NotFiniteError:
            self.check_ends(robot.model, given["q"])
            raise

    def wrenches(self, robot: Robot, q: Array) -> dict[str, Array]:
        """Wrenches of springs on links, without damping, as `external` of the robot's recursion.

        Those at joints belong to the torque along the axis, but at joints of closed linkages pivots balance them.
        """
        T, found = robot.link_poses(q), dict[str, Array]()
        for spring in self.each:
            if isinstance(spring, Spring):
                sides = [(link, robot.model.link_index(link), np.array(x)) for link, x in spring.ends]
                start, end = (rotate(T[..., k, :3, :3], x) + T[..., k, :3, 3] for _, k, x in sides)
                pull = spring._pull(end - start)
                for sign, (link, k, x) in zip((1, -1), sides, strict=True):
                    force = sign * rotate_back(T[..., k, :3, :3], pull)
                    found[link] = found.get(link, 0) + np.concatenate([cross(x, force), force], axis=-1)
            elif any(spring.joint in loop.followers for loop in robot.model.loops):
                found |= {link: found.get(link, 0) + w for link, w in spring._wrenches(robot.model, T, q).items()}
        return found

    def check_ends(self, model: Model, q: Array) -> None:
        """Raise an error for a spring whose end points coincide: its tension has no direction there."""
        for spring in self.each:
            if not isinstance(spring, Spring) or not spring.has_length:
                continue
            meet = ~spring._offset(model, q)[0].any(-1)
            if meet.any():
                text = f"the ends of the {spring} coincide, where its tension has no direction: only those of a spring "
                text += "without length, force and damping may"
                raise NotFiniteError(text, state=tuple(np.argwhere(meet)[0].tolist()))


def _check(spring: Any, texts: Sequence[str], signed: str, *not_negative: str) -> None:
    """Check fields of a spring: names, a number of any sign, and numbers that are not negative, which become floats."""
    for name in texts:
        if not isinstance(getattr(spring, name), str):
            raise TypeError(f"`{name}` must be a name, got {type(getattr(spring, name)).__name__}")
    object.__setattr__(spring, signed, float(real_array(signed, getattr(spring, signed), "()")))
    for name in not_negative:
        object.__setattr__(spring, name, positive_number(name, getattr(spring, name), zero_allowed=True))


def by_coordinates(model: Model, q: Array, rows: Array) -> Array:
    """Derivatives by coordinates from those by the positions of moving joints, (..., nb, k) to (..., n, k)."""
    return transpose(coordinate_map(model, q)) @ rows if model.has_mimics else rows


def resolved_springs(springs: Any, robot: Robot, scene: Robot) -> Springs | None:
    """Springs for a robot, checked, without those that do not act because joints are locked."""
    if not isinstance(springs, Sequence) or isinstance(springs, str):
        raise TypeError(f"`springs` must be a sequence of rne.Spring, got {type(springs).__name__}")
    for k, spring in enumerate(springs):
        if not isinstance(spring, Spring | JointSpring):
            raise TypeError(f"`springs[{k}]` must be an rne.Spring, got {type(spring).__name__}")
        is_at_joint = isinstance(spring, JointSpring)
        known = robot.model.moving_joints if is_at_joint else robot.model.link_names
        for part in ("joint",) if is_at_joint else ("link", "other"):
            if (given := getattr(spring, part)) not in known:
                of = f"{listed(known)}, got {given!r}{did_you_mean(given, known)}"
                raise ValueError(f"`springs[{k}].{part}` must be one of {of}")
        if not any(spring._bodies(robot.model)):
            raise ValueError(f"`springs[{k}]`: no joint moves between the ends of the {spring}")
    places = tuple(k for k, spring in enumerate(springs) if any(spring._bodies(scene.model)))
    return Springs(tuple(springs[k] for k in places), places) if places else None
