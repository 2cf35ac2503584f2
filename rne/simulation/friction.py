"""Joint friction: viscous, Coulomb, the Stribeck effect, friction under load; and a constant torque of the drives."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..basics.arrays import ReadOnlyArrays, copy_with, read_only, real_numbers
from ..basics.docstrings import describe_parameters
from ..basics.spatial import Array
from ..basics.text import listed, short, summary
from ..dynamics.crba import mass_matrix
from ..dynamics.rnea import gravity_torque, inverse_dynamics
from ..elementwise import less, tanh, where
from ..graph.scalar import is_present
from ..model.checks import domain_error
from ..model.friction_laws import SMOOTHING, direction, magnitude, saturating, saturating_slope, stribeck_effect
from ..model.model import Model, joint_array
from ..model.topology import refuse_couplings
from ..robot import Robot

SIZES = ("viscous", "coulomb", "viscous_back", "coulomb_back", "static", "load", "saturation", "stribeck")
SIGNED = ("stribeck_rise", "offset")  # coefficients that may be negative
OPTIONAL = ("static", "saturation", "stribeck")
BACK = ("viscous", "coulomb")  # coefficients that may differ between directions
REPORTED = {"rad": 0.01, "m": 0.001}  # creep above which a run's message reports it, by unit


class Following(np.ndarray[Any, Any]):
    """Coefficient of the negative direction that was not given and equals that of the positive one."""


@describe_parameters(
    """
    model : Model
        The robot, for the number of its joints.
    qd : array_like, shape (..., n)
        Joint velocities [rad/s or m/s].
    """
)
@dataclass(frozen=True, eq=False)
class Friction(ReadOnlyArrays):
    """Joint friction torques, which the drives must supply in addition to inverse dynamics.

    Attributes
    ----------
    viscous, viscous_back : ndarray, shape (n,) or a number
        Torque per unit velocity in the positive and negative direction; the negative one defaults to the positive one
        [N m s/rad or N s/m].
    coulomb, coulomb_back : ndarray, shape (n,) or a number
        Magnitude of Coulomb friction; the negative direction defaults to the positive one [N m or N].
    smoothing : float
        Coulomb friction is smoothed to tanh(qd / smoothing), 0.01 if not given; 0 for dry friction that sticks and
        slips by events [rad/s or m/s].
    static : ndarray, shape (n,), or a number, optional
        Torque at which a sticking joint breaks away, at least `coulomb`, which is its default [N m or N].
    stribeck_rise, stribeck : ndarray, shape (n,), or a number, optional
        The Stribeck effect: by how much Coulomb friction rises towards rest, and the velocity at which that has fallen
        to 1/e, s exp(-|qd| / vs); a negative rise, of at most `coulomb`, is pre-sliding friction [N m or N; rad/s or
        m/s].
    saturation : ndarray, shape (n,), or a number, optional
        Velocity vs at which viscous friction saturates, Fv vs tanh(qd / vs), or 0 for a joint where it is Fv qd [rad/s
        or m/s].
    load : ndarray, shape (n,), or a number
        Part of the transmitted torque that friction takes, below 1: of a torque L of inverse dynamics, rotors and
        springs included, it is load |L| s, s being the direction of motion, tanh(qd / smoothing).
    offset : ndarray, shape (n,), or a number
        Constant torque that the drive must supply in addition, such as the zero error of a torque sensor. While a joint
        moves, Coulomb friction that differs by direction is the same as the mean of both and an offset [N m or N].

    Raises
    ------
    ValueError
        For negative or non-finite numbers, `static` below `coulomb`, `static` with smoothed friction, a `load` of 1 or
        more, or a Stribeck effect without its velocity or of more than `coulomb` below zero.

    Notes
    -----
    Smoothed friction does not hold a joint. Under a torque below `coulomb` it creeps, without viscous friction at the
    rate smoothing artanh(torque / coulomb): 2 mrad/s under a fifth of it. Dry friction, `smoothing=0`, holds, and often
    takes a fraction of the evaluations, as smoothed friction is stiff. The message of a run reports a joint's creep
    above 0.01 rad or 0.001 m: how far it moved while its speed had fallen below `smoothing` and the load on it had not
    exceeded `coulomb` since. The load is the friction that would keep the joint from accelerating. For a robot without
    drives that starts at rest and would stay there, all its motion is creep.

    Examples
    --------
    >>> import numpy as np, rne
    >>> arm, friction, qd = rne.irb140(), rne.Friction(viscous=2.0, coulomb=1.0), np.array([0.5, -0.5])
    >>> friction.viscous_torque(qd).tolist(), friction.coulomb_torque(qd).round(9).tolist()
    ([1.0, -1.0], [1.0, -1.0])
    >>> friction.check(arm)  # an error if it were for another number of joints
    >>> friction.at({"viscous": 3.0}).torque(arm, [0.5] * 6).round(9)[0].item()
    2.5
    """

    viscous: ArrayLike = 0.0
    coulomb: ArrayLike = 0.0
    viscous_back: ArrayLike | None = None
    coulomb_back: ArrayLike | None = None
    smoothing: float = SMOOTHING
    static: ArrayLike | None = None
    stribeck_rise: ArrayLike = 0.0
    stribeck: ArrayLike | None = None
    saturation: ArrayLike | None = None
    load: ArrayLike = 0.0
    offset: ArrayLike = 0.0

    def __repr__(self) -> str:
        hidden = [f"{name}_back" for name in BACK if self._same_back(name)]
        hidden += [name for name in ("load", *SIGNED) if not np.any(getattr(self, name))]
        return summary(self, **dict.fromkeys(hidden))

    @cached_property
    def _values(self) -> tuple[object, ...]:
        """Which coefficients follow others, and all of them, for equality."""
        sizes = ((name, size.shape, size.tobytes()) for name, size in self._given().items())
        return *map(self._same_back, BACK), *sizes

    def __eq__(self, other: object) -> bool:
        if type(self) is not Friction or type(other) is not Friction:  # a subclass may have more than the numbers
            return self is other
        return self._values == other._values

    def __hash__(self) -> int:
        return hash(self._values)

    def _same_back(self, name: str) -> bool:
        return isinstance(getattr(self, f"{name}_back"), Following)

    @property
    def numbers(self) -> dict[str, Array]:
        """Coefficients by name, as arrays; without those of the negative direction that were not given."""
        follow = [f"{name}_back" for name in BACK if self._same_back(name)]
        return {name: size for name, size in self._given().items() if name not in follow}

    def at(self, numbers: Mapping[str, Any]) -> Friction:
        """Friction with other numbers, which are not checked.

        Parameters
        ----------
        numbers : mapping of str to array_like
            By the names of `numbers`; traced numbers, too.

        Returns
        -------
        Friction
            Coefficients of the negative direction that were not given equal the new ones of the positive direction.
        """
        found = {name: np.array(number) for name, number in numbers.items()}
        for name in BACK:
            if self._same_back(name) and name in found:
                found.setdefault(f"{name}_back", found[name].view(Following))
        return copy_with(self, **read_only(found))

    def __post_init__(self) -> None:
        for name in SIZES:
            value = getattr(self, name)
            if name.endswith("_back") and (value is None or isinstance(value, Following)):
                object.__setattr__(self, name, getattr(self, name.removesuffix("_back")).view(Following))
            elif value is not None or name not in OPTIONAL:
                object.__setattr__(self, name, _not_negative(name, value))
        for name in SIGNED:
            object.__setattr__(self, name, _read_only(name, getattr(self, name)))
        if _not_negative("smoothing", self.smoothing).ndim:
            raise ValueError("`smoothing` must be one number")
        shapes = {size.shape for size in self._given().values() if size.ndim}
        if len(shapes) > 1 or any(len(shape) > 1 for shape in shapes):
            raise ValueError(f"friction must be numbers or arrays of one shape (n,), got {sorted(shapes)}")
        if np.any(np.asarray(self.load) >= 1):
            raise ValueError(f"`load` must be below 1, the part of the torque that friction takes, got {self.load}")
        rise, slow = np.asarray(self.stribeck_rise), np.asarray(0.0 if self.stribeck is None else self.stribeck)
        if np.any((rise != 0) & (slow == 0)):
            raise ValueError("`stribeck_rise` needs `stribeck`, the velocity at which it has fallen to 1/e, above 0")
        dry = np.asarray(self.coulomb), np.asarray(self.coulomb_back)
        if np.any(np.minimum(*dry) + rise < 0):
            raise ValueError("`stribeck_rise` must be at least -`coulomb`: friction does not drive a joint")
        if self.static is None:
            return
        if np.any(np.asarray(self.static) < np.maximum(*dry)):
            raise ValueError("`static` must be at least `coulomb`: friction at rest is no less than when slipping")
        if self.smoothing != 0:
            raise ValueError("`static` needs dry friction: set `smoothing` to 0")

    def _given(self) -> dict[str, Array]:
        names = (*SIZES, *SIGNED, "smoothing")
        return {name: np.asarray(size) for name in names if (size := getattr(self, name)) is not None}

    @property
    def sticks(self) -> bool:
        """True for dry friction, under which a joint can stick."""
        dry = ("coulomb", "coulomb_back", "static", "stribeck_rise", "load")
        return not is_present(self.smoothing) and any(is_present(x) for k, x in self._given().items() if k in dry)

    @property
    def varying(self) -> str:
        """Names of the coefficients that make Coulomb friction vary with speed or load; empty for none."""
        return " and ".join(f"`{name}`" for name in ("stribeck_rise", "load") if is_present(getattr(self, name)))

    @cached_property
    def losses(self) -> tuple[str, ...]:
        """Names of the torques that are not zero: "viscous", "coulomb", "offset" and "load"."""
        sizes = {"viscous": ("viscous", "viscous_back"), "coulomb": ("coulomb", "coulomb_back", "stribeck_rise")}
        sizes |= {"offset": ("offset",), "load": ("load",)}
        return tuple(name for name, of in sizes.items() if any(is_present(getattr(self, size)) for size in of))

    def check(self, model: Model) -> None:
        """Raise an error for arrays that do not have one entry per joint.

        Raises
        ------
        ValueError
            If a coefficient is neither a number nor of shape (n,).
        """
        n = model.n
        for name, size in self._given().items():
            if size.shape not in ((), (n,)):
                raise ValueError(f"`{name}` of the friction must be a number or of shape ({n},), got {size.shape}")

    def viscous_torque(self, qd: Array) -> Array:
        """Viscous friction at given joint velocities.

        Returns
        -------
        ndarray, shape (..., n)
            Torque that the drive must supply, with the sign of the velocity [N m or N].
        """
        qd = saturating(qd, self.saturation)
        if self._same_back("viscous"):
            return np.asarray(self.viscous) * qd
        return where(less(qd, 0), np.asarray(self.viscous_back) * qd, np.asarray(self.viscous) * qd)

    def coulomb_torque(self, qd: Array) -> Array:
        """Coulomb friction at joint velocities with its Stribeck effect, smoothed around zero.

        Dry friction has its value while slipping, and is zero at rest.

        Returns
        -------
        ndarray, shape (..., n)
            Torque that the drive must supply, with the sign of the velocity [N m or N].
        """
        forward, back = np.asarray(self.coulomb), np.asarray(self.coulomb_back)
        if self.stribeck is not None and is_present(self.stribeck_rise):
            effect = np.asarray(self.stribeck_rise) * stribeck_effect(qd, self.stribeck, self.smoothing)
            both: Array = self.at({"stribeck_rise": 0.0}).coulomb_torque(qd) + effect
            return both
        if not (is_present(forward) or is_present(back)):
            return 0 * qd
        if not is_present(self.smoothing):
            return where(less(0, qd), forward, 0) - where(less(qd, 0), back, 0)
        size = forward if self._same_back("coulomb") else where(less(qd, 0), back, forward)
        return size * tanh(qd * (1 / self.smoothing))

    def transmitted(self, tau: Array, qd: Array) -> Array:
        """Torque transmitted to the bodies: L of tau = L + load |L| s.

        It is solved joint by joint, and needs no accelerations; L has the sign of tau, the torques of the drives less
        all other friction, both of shape (..., n) [N m or N].
        """
        way = direction(qd, self.smoothing)
        reaching: Array = tau / (1 + np.asarray(self.load) * where(less(tau, 0), -way, way))
        return reaching

    def torque(self, model: Model, qd: ArrayLike, load: ArrayLike | None = None) -> Array:
        """Friction torque of a robot's joints, and the constant torque.

        Parameters
        ----------
        load : array_like, shape (..., n), optional
            Torques of inverse dynamics, for friction under load [N m or N].

        Returns
        -------
        ndarray, shape (..., n)
            Torque that the drives must supply; friction has the sign of the velocity [N m or N].

        Raises
        ------
        ValueError
            If `qd` or a coefficient has the wrong shape, `qd` is not finite, or friction depends on a `load` that is
            not given.
        """
        self.check(model)
        given = ("qd", qd), ("load", load)  # of numbers, or traced, in a law
        rates, by = (
            x if x is None or np.asarray(x).dtype == object else joint_array(name, x, model) for name, x in given
        )
        total = self.viscous_torque(np.asarray(rates)) + self.coulomb_torque(np.asarray(rates))
        if "offset" in self.losses:
            total = total + np.asarray(self.offset)
        if "load" not in self.losses:
            return total
        if by is None:
            raise ValueError("friction under load needs `load`, the torques of inverse dynamics")
        size = np.asarray(self.load) * magnitude(by)
        with_load: Array = total + size * direction(np.asarray(rates), self.smoothing)
        return with_load


def viscous_slope(friction: Friction, qd: Array) -> Array:
    """Derivative of viscous friction with respect to the velocity, shape (..., n)."""
    forward, back = np.asarray(friction.viscous), np.asarray(friction.viscous_back)
    size: Array = 0 * qd + (forward if friction._same_back("viscous") else where(less(qd, 0), back, forward))
    return size if friction.saturation is None else size * saturating_slope(qd, friction.saturation)


def one_per_joint(friction: Friction, n: int, named: Collection[str]) -> Friction:
    """Friction with n numbers per coefficient; both directions share one if equal and neither is named."""
    sizes = {k: read_only(np.broadcast_to(x, (n,))) for k, x in friction.numbers.items() if k != "smoothing"}
    for name in BACK:
        back = f"{name}_back"
        if back not in sizes or (np.array_equal(sizes[name], sizes[back]) and not {name, back} & {*named}):
            sizes[back] = read_only(sizes[name].view(Following))
    return copy_with(friction, **sizes)


def creep(
    friction: Friction, robot: Robot, motion: Sequence[Array], rest: Array | None, springs: Any, rotor: Any
) -> str:
    """Text on the creep of joints that dry friction would have held, over samples (T, n); empty where it is small.

    `rest` has the initial positions of a robot without drives that starts at rest, and is None for others. `motion` is
    (q, qd, qdd), with elastic joints of the motors, with their `rotor`.
    """
    q, qd, _ = motion
    forward, back = np.asarray(friction.coulomb, dtype=float), np.asarray(friction.coulomb_back, dtype=float)
    if friction.smoothing == 0 or not (forward.any() or back.any()) or len(q) < 2:
        return ""
    evaluate, sample = robot.kernels.evaluate_some, np.arange(len(q))[:, None]

    def release(rows: Any) -> None:
        """Note the joints whose load exceeds what dry friction can hold."""
        q, qd, qdd = (x[rows] for x in motion)
        inverse, passed = np.linalg.inv(evaluate(mass_matrix, q) if rotor is None else np.diag(rotor)), 0 * qd
        if np.any(friction.load):
            passed = evaluate(inverse_dynamics, q, qd, qdd) + (0.0 if springs is None else springs.torque(robot, q, qd))
        resisting = friction.torque(robot.model, qd, passed) - np.asarray(friction.offset)
        # Friction that would keep each joint from accelerating
        load = resisting + qdd / np.diagonal(inverse, axis1=-2, axis2=-1)
        rise = np.asarray(friction.stribeck_rise) + np.asarray(friction.load) * np.abs(passed)
        releases[rows] = np.abs(load) >= np.where(load < 0, back, forward) + rise

    slow = np.abs(qd) <= friction.smoothing
    some, releases = slow.any(axis=1), np.ones_like(slow)
    if not some.any():
        return ""
    release(some)
    later = np.logical_or.accumulate((slow & ~releases).any(axis=1)) & ~some
    if later.any():
        release(later)
    caught, released = (np.maximum.accumulate(np.where(now, sample, -1)) for now in (slow & ~releases, releases))
    held = caught > released
    moved = (np.abs(np.diff(q, axis=0)) * (held[1:] & held[:-1])).sum(axis=0)
    weight = None if rest is None else evaluate(gravity_torque, rest) + np.asarray(friction.offset)
    if weight is not None and rest is not None and springs is not None:
        weight = weight + springs.torque(robot, rest, 0 * rest)
    if weight is not None and (np.abs(weight) < np.where(weight > 0, back, forward)).all():
        moved = np.abs(q - rest).max(axis=0)
    units = ["rad" if robot.model.is_revolute[k] else "m" for k in robot.model.independent_joints]
    reported = np.array([REPORTED[unit] for unit in units])
    names = [f"{short(robot.joint_names[k])} by {moved[k]:.2g} {units[k]}" for k in np.flatnonzero(moved > reported)]
    return f"crept where dry friction (smoothing=0) would hold: {listed(names)}" if names else ""


def urdf_friction(model: Model) -> Friction:
    """The damping and friction of a URDF's `<dynamics>`, mapped to the robot's coordinates."""
    for name in ("damping", "friction"):
        for joint, value in zip(model.moving_joints, getattr(model, name).tolist(), strict=True):
            if error := domain_error(name, value):
                raise ValueError(f"`friction` 'urdf': {name} of joint {joint!r} {error}, got {value!r}")
    if any(model.damping[i] or model.friction[i] for i, *_ in model.coupled_joints):
        refuse_couplings(model, "`friction` 'urdf' takes")
    G = np.abs(np.asarray(model.mimic_map, dtype=float)) if model.has_mimics else np.eye(model.nb)
    return Friction(viscous=model.damping @ G**2, coulomb=model.friction @ G)


def _not_negative(name: str, value: ArrayLike) -> Array:
    array = _read_only(name, value)
    if (array < 0).any():
        raise ValueError(f"`{name}` must not be negative, got {array.min()}")
    return array


def _read_only(name: str, value: ArrayLike) -> Array:
    array: Array = read_only(real_numbers(name, value, "(n,)").astype(np.float64))
    return array
