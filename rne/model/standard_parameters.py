"""Standard parameters: all that joint torques are linear in, bodies, rotors, friction and offsets."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..basics.arrays import ReadOnlyArrays, cached_array, positive_number, real_array, vector
from ..basics.inertia import PARAMETERS
from ..basics.spatial import Array
from ..basics.text import listed, summary
from ..elementwise import less, where
from .friction_laws import direction, magnitude, saturating, stribeck_effect
from .model import Model, model_argument
from .parameters import parameters_of

BODY_SYMBOLS = ("m", "mcx", "mcy", "mcz", "Ixx", "Ixy", "Iyy", "Ixz", "Iyz", "Izz")
FRICTION = {"viscous": "Fv", "asymmetric": "Fvb", "coulomb": "Fc", "load": "Fl"}  # friction terms and symbols
SYMBOLS = ("Ia", "Fv", "Fvb", "Fc", "Fs", "Fl", "tau0")  # symbols of a drive, in the order of its parameters
OF_MOTORS = ("Ia", "Fv", "Fc")  # symbols of coupled motors


@dataclass(frozen=True, eq=False)
class DriveModel:
    """Torques of the drives that a fit includes: rotors, friction, offsets. All are linear in their parameters.

    Without arguments it has none of these: torques are those of the bodies only.

    Attributes
    ----------
    rotor : bool
        True for the inertia Ia of each drive's rotor, reflected to its joint: `armature`.
    friction : str or mapping of joint names to str, optional
        Words joined by "+", for each drive, or for those of some joints by name, such as "viscous+coulomb": "viscous"
        friction Fv; "asymmetric" for another coefficient Fvb of viscous friction at negative velocities; "coulomb"
        friction Fc; "load" for friction Fl that is proportional to the transmitted torque.
    offset : bool
        True for a constant torque tau0 of each drive: the zero error of its sensor, or Coulomb friction that differs by
        direction, which is the mean of both and an offset while the joint moves.
    coupled_motors : array_like, shape (s, n), optional
        Rows a of motors that turn at a^T qd, coupled to several joints; with rotor and friction if the drives have
        them.
    smoothing : float, optional
        Coulomb friction is Fc tanh(qd / smoothing), or with 0 Fc sign(qd), which is the default for measurements
        [rad/s or m/s].
    stribeck : array_like, shape (n,), optional
        Velocities vs at which the Stribeck effect of each joint has fallen to 1/e, Fs sign(qd) exp(-|qd| / vs), or 0
        for a joint without [rad/s or m/s].
    saturation : array_like, shape (n,), optional
        Velocities vs at which viscous friction of each joint saturates, Fv vs tanh(qd / vs), or 0 for a joint where it
        is Fv qd [rad/s or m/s].

    Raises
    ------
    ValueError
        If an option has a wrong value.

    Examples
    --------
    >>> import rne
    >>> rne.load("irb140").base_parameters(drives=rne.DriveModel(friction="viscous")).count
    42
    """

    rotor: bool = False
    friction: str | Mapping[str, str] | None = None
    offset: bool = False
    coupled_motors: ArrayLike | None = None
    smoothing: float | None = None
    stribeck: ArrayLike | None = None
    saturation: ArrayLike | None = None

    __repr__ = summary

    def __post_init__(self) -> None:
        by_joint = self.friction if isinstance(self.friction, Mapping) else {"": self.friction}
        for words in by_joint.values():
            kinds = set() if words is None else set(words.split("+")) if isinstance(words, str) else {words}
            if not kinds <= FRICTION.keys():
                known = ", ".join(repr(word) for word in FRICTION)
                raise ValueError(f"`friction` must be of the words {known}, joined by '+', got {words!r}")
            if "asymmetric" in kinds and "viscous" not in kinds:
                raise ValueError(f'`friction` "asymmetric" is of viscous friction, and needs "viscous", got {words!r}')
        if not all(isinstance(x, bool | np.bool_) for x in (self.rotor, self.offset)):
            raise ValueError(f"`rotor` and `offset` must be True or False, got {self.rotor!r} and {self.offset!r}")
        if self.smoothing is not None:
            positive_number("smoothing", self.smoothing, zero_allowed=True)


def drive_argument(drives: Any) -> DriveModel:
    """Argument `drives`: an rne.DriveModel, or None for bodies without drives."""
    if drives is None:
        return DriveModel()
    if not isinstance(drives, DriveModel):
        raise TypeError(f"`drives` must be an rne.DriveModel, got {type(drives).__name__}")
    return drives


@dataclass(frozen=True, eq=False)
class StandardParameters(ReadOnlyArrays):
    """Parameters that the torques of the drives are a linear function of, and their order.

    tau = L + Fv qd + Fc sign(qd) + Fs sign(qd) exp(-|qd| / vs) + Fl |L| sign(qd) + tau0, with L = Y pi + Ia qdd, and
    for each coupled motor, which turns at a^T qd, the terms of rotor, viscous and Coulomb friction in a^T qd, times a.
    Springs add functions of the positions to L. The load L in the term of Fl has parameters of its own, so that the
    equations are linear: those of the last fit.

    Attributes
    ----------
    model : Model
        The robot, whose bodies have ten parameters each.
    drives : DriveModel
        Which torques of the drives are modelled; by default none.
    springs : Springs or None
        Springs of a Scene, whose parameters come last.

    Examples
    --------
    >>> import rne
    >>> standard = rne.model.StandardParameters(rne.irb140(), rne.DriveModel(rotor=True, friction="viscous+coulomb"))
    >>> standard.count, standard.names[10], standard.names[-1]
    (78, 'm_2', 'Fc_6')
    """

    model: Model
    drives: DriveModel = DriveModel()
    springs: Any = None

    __repr__ = summary

    def __post_init__(self) -> None:
        n = model_argument(self.model).n
        drive_argument(self.drives)
        for name in ("stribeck", "saturation"):
            if getattr(self.drives, name) is not None:
                vector(name, getattr(self.drives, name), n, sign="not negative")
        if len(self.motors) and self.asked["Fvb"].any():
            raise ValueError('`friction` "asymmetric" is of drives without `coupled_motors`')

    @cached_array
    def motors(self) -> Array:
        """Rows of coupled motors, shape (s, n)."""
        n, rows = self.model.n, self.drives.coupled_motors
        return np.zeros((0, n)) if rows is None else np.array(real_array("coupled_motors", rows, f"(s, {n})"))

    @property
    def smoothing(self) -> float:
        """Velocity at which Coulomb friction is smoothed, 0 for a step."""
        return self.drives.smoothing or 0.0

    @cached_array
    def asked(self) -> dict[str, Array]:
        """Mask of the joints with each kind of friction in the model, shape (n,), by its symbol."""
        given, names = self.drives.friction, self.model.joint_names
        if isinstance(given, Mapping) and (unknown := [name for name in given if name not in names]):
            raise ValueError(f"`friction` is for {listed(unknown)}, the robot's joints are {listed(names)}")
        words = [((given.get(name) if isinstance(given, Mapping) else given) or "").split("+") for name in names]
        asked = {symbol: np.array([word in of for of in words], bool) for word, symbol in FRICTION.items()}
        return asked | ({} if self.drives.stribeck is None else {"Fs": np.asarray(self.drives.stribeck) > 0})

    @cached_property
    def terms(self) -> tuple[str, ...]:
        """Symbols of the modelled parameters of a drive, from Ia, Fv, Fvb, Fc, Fs, Fl and tau0."""
        present = {"Ia": self.drives.rotor, "tau0": self.drives.offset, "Fs": self.drives.stribeck is not None}
        present |= {symbol: bool(self.asked[symbol].any()) for symbol in FRICTION.values()}
        return tuple(symbol for symbol in SYMBOLS if present[symbol])

    @cached_property
    def groups(self) -> dict[str, slice]:
        """Slices of the parameters: "bodies", then each of `terms`, of the joints' drives, then of coupled motors."""
        groups = {"bodies": slice(0, PARAMETERS * self.model.nb)}
        widths = {symbol: self.model.n for symbol in self.terms}
        widths |= {f"{symbol} of coupled motors": len(self.motors) for symbol in self.terms if symbol in OF_MOTORS}
        widths |= {} if self.springs is None else {"springs": len(self.springs.symbols)}
        start = groups["bodies"].stop
        for name, width in widths.items():
            groups[name] = slice(start, start + width)
            start += width
        return groups

    @property
    def count(self) -> int:
        """Number of standard parameters."""
        return int(max(group.stop for group in self.groups.values()))

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Symbol and number of each parameter.

        The number is that of the moving joint, counted from 1 in the order of `model.moving_joints`; s1, s2, ... are
        the coupled motors. m is the mass, mcx the first moment, Ixx ... the inertia about the joint's origin. Springs
        are counted from 1.
        """
        names = [f"{symbol}_{i + 1}" for i in range(self.model.nb) for symbol in BODY_SYMBOLS]
        names += [f"{symbol}_{i + 1}" for symbol in self.terms for i in self.model.independent_joints]
        motors = range(1, len(self.motors) + 1)
        names += [f"{symbol}_s{k}" for symbol in self.terms if symbol in OF_MOTORS for k in motors]
        return (*names, *(() if self.springs is None else self.springs.symbols))

    @cached_array
    def values(self) -> Array:
        """Parameters of the model; zero for offsets, coupled motors and other friction.

        Drives of joints that mimic others count with these; those of joints that follow by couplings are left out.
        """
        model, G = self.model, self.model.mimic_map
        known = {"bodies": parameters_of(model), "Ia": G.T**2 @ model.armature}
        known |= {symbol: self.asked[symbol] * (G.T**2 @ model.damping) for symbol in ("Fv", "Fvb")}
        known |= {"Fc": self.asked["Fc"] * (np.abs(G.T) @ model.friction)}
        found = np.zeros(self.count)
        for name in known.keys() & self.groups.keys():
            found[self.groups[name]] = known[name]
        return found

    def load(self, Y: Array, q: Array, qdd: Array, x: Array) -> Array | None:
        """Torques L (..., n) of bodies with the regressor Y, rotors and springs with parameters x; None without Fl."""
        if "Fl" not in self.terms:
            return None
        return np.asarray(Y @ x[self.groups["bodies"]] + self.rotor_torques(qdd, x) + self.spring_torques(q, x))

    def rotor_torques(self, qdd: Array, x: Array) -> Array:
        """Torques of rotors, without coupled motors, with standard parameters x, shape (..., n)."""
        return np.asarray(x[self.groups["Ia"]] * qdd) if "Ia" in self.terms else np.zeros(qdd.shape)

    def drive_columns(self, qd: Array, qdd: Array, load: Array | None = None) -> Array:
        """Torques of the drives per unit of each of their parameters, which follow the bodies', shape (..., n, k).

        `qd` and `qdd` (..., n) are joint velocities and accelerations, and `load` the torques L where friction depends
        on them [rad/s or m/s; rad/s^2 or m/s^2; N m or N].
        """
        found = sorted(self._shafts(qd, qdd, load), key=lambda part: part[0].start)
        blocks = [shafts.T * factor[..., None, :] for _, shafts, factor in found]
        return np.concatenate([np.zeros((*qd.shape, 0)), *blocks], axis=-1)

    def spring_columns(self, q: Array) -> Array:
        """Torques of the drives per unit of each parameter of the springs, the last ones, shape (..., n, k)."""
        return np.zeros((*q.shape, 0)) if self.springs is None else self.springs.columns(self.model, q)

    def spring_torques(self, q: Array, pi: Array) -> Array:
        """Torques of the drives against springs, of standard parameters pi, shape (..., n)."""
        return np.asarray(self.spring_columns(q) @ pi[self.groups.get("springs", slice(0))])

    def drive_torques(self, qd: Array, qdd: Array, x: Array, load: Array | None = None) -> Array:
        """Torques of the drives with parameters x, which follow the bodies', shape (..., n)."""
        total = np.zeros(qd.shape)
        for places, shafts, factor in self._shafts(qd, qdd, load):
            total += (factor * x[places]) @ shafts
        return total

    def drive_columns_of(self, j: int, qd: Array, qdd: Array, load: Array | None = None) -> tuple[Array, Array]:
        """Indices and values, shape (..., k), of the entries of row j of `drive_columns` that are not always zero."""
        found = [
            (k, shafts[row, j] * factor[..., row])
            for places, shafts, factor in self._shafts(qd, qdd, load)
            for row, k in enumerate(range(places.start, places.stop))
            if shafts[row, j] != 0
        ]
        values = [values for _, values in found]
        return np.array([k for k, _ in found], int), np.stack(values, -1) if found else np.zeros((*qd.shape[:-1], 0))

    def _shafts(self, qd: Array, qdd: Array, load: Array | None) -> Iterator[tuple[slice, Array, Array]]:
        """For each symbol: slice of its parameters after the bodies', rows of its shafts, torques of these per unit."""
        first, joints = self.groups["bodies"].stop, np.eye(self.model.n)
        for symbol in self.terms:
            place, saturation = self.groups[symbol], self.drives.saturation
            factor = self._factor(symbol, qd, qdd, saturation, load) * self.asked.get(symbol, 1)
            if symbol == "Fv" and "Fvb" in self.terms:
                factor = where(less(qd, 0), ~self.asked["Fvb"] * factor, factor)
            yield slice(place.start - first, place.stop - first), joints, factor
            if symbol in OF_MOTORS and len(self.motors):
                place = self.groups[f"{symbol} of coupled motors"]
                factor = self._factor(symbol, qd @ self.motors.T, qdd @ self.motors.T)
                yield slice(place.start - first, place.stop - first), self.motors, factor

    def _factor(self, symbol: str, qd: Array, qdd: Array, saturation: Any = None, load: Array | None = None) -> Array:
        """Torque of a shaft per unit of a symbol."""
        if symbol == "Ia":
            return qdd
        if symbol == "tau0":
            return np.ones(qd.shape)
        if symbol in ("Fv", "Fvb"):
            viscous = saturating(qd, saturation)
            return where(less(qd, 0), viscous, 0.0 * viscous) if symbol == "Fvb" else viscous
        if symbol == "Fs":
            return stribeck_effect(qd, np.asarray(self.drives.stribeck), self.smoothing)
        if symbol == "Fl" and load is None:
            raise ValueError('`friction` "load" of `drives` depends on the load, which is not known here')
        return direction(qd, self.smoothing) * (magnitude(load) if symbol == "Fl" else 1.0)
