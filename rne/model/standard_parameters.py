"""The standard parameters: everything that joint torques are linear in, bodies, rotors, friction and offsets."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..basics.arrays import positive_number, real_array, vector
from ..basics.spatial import Array
from ..basics.text import summary
from .model import Model, model_argument
from .parameters import PARAMETERS, parameters_of
from .topology import refuse_couplings

BODY_SYMBOLS = ("m", "mcx", "mcy", "mcz", "Ixx", "Ixy", "Iyy", "Ixz", "Iyz", "Izz")
FRICTION = (None, "viscous", "coulomb", "viscous+coulomb")
OF_MOTORS = ("Ia", "Fv", "Fc")  # symbols of coupled motors too


@dataclass(frozen=True, eq=False)
class DriveModel:
    """Torques of the drives that a fit includes: rotors, friction, offsets. All are linear in their parameters.

    Without arguments none is: torques are those of the bodies alone.

    Attributes
    ----------
    rotor : bool
        True for the inertia Ia of each drive's rotor, reflected to its joint: `armature`.
    friction : {None, "viscous", "coulomb", "viscous+coulomb"}
        Viscous friction Fv, Coulomb friction Fc or both of each drive.
    offset : bool
        True for a constant torque tau0 of each drive: the zero error of its sensor, or unequal Coulomb friction.
    coupled_motors : array_like, shape (s, n), optional
        Rows a of motors that turn at a^T qd, coupled to several joints; with rotor and friction if the drives have
        them.
    smoothing : float, optional
        Coulomb friction is Fc tanh(qd / smoothing), or with 0 Fc sign(qd), which is the default for measurements
        [rad/s or m/s].
    stribeck : array_like, shape (n,), optional
        Velocities vs at which the Stribeck effect of each joint has fallen to 1/e, Fs sign(qd) exp(-|qd| / vs), or 0
        for a joint without [rad/s or m/s].

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
    friction: str | None = None
    offset: bool = False
    coupled_motors: ArrayLike | None = None
    smoothing: float | None = None
    stribeck: ArrayLike | None = None

    __repr__ = summary

    def __post_init__(self) -> None:
        if self.friction not in FRICTION:
            raise ValueError(f"`friction` must be one of {list(FRICTION)}, got {self.friction!r}")
        if not all(isinstance(x, bool | np.bool_) for x in (self.rotor, self.offset)):
            raise ValueError(f"`rotor` and `offset` must be True or False, got {self.rotor!r} and {self.offset!r}")
        if self.smoothing is not None:
            positive_number("smoothing", self.smoothing, zero_allowed=True)


MEASURED = DriveModel(rotor=True, friction="viscous+coulomb", offset=True)  # what drives of real robots have


def drive_argument(drives: Any) -> DriveModel:
    """The argument `drives`: an rne.DriveModel, or None for bodies alone."""
    if drives is None:
        return DriveModel()
    if not isinstance(drives, DriveModel):
        raise TypeError(f"`drives` must be an rne.DriveModel, got {type(drives).__name__}")
    return drives


@dataclass(frozen=True, eq=False)
class StandardParameters:
    """The parameters that the torques of the drives are a linear function of, and their order.

    tau = Y pi + Ia qdd + Fv qd + Fc sign(qd) + Fs sign(qd) exp(-|qd| / vs) + tau0, and for each coupled motor, which
    turns at a^T qd, the terms of rotor and friction in a^T qd, times a. Springs add functions of the positions.

    Attributes
    ----------
    model : Model
        The robot's parameters.
    drives : DriveModel
        Which torques of the drives are modelled.
    springs : Springs or None
        Springs whose parameters follow those of drives and coupled motors.

    Examples
    --------
    >>> import rne
    >>> from rne.model.standard_parameters import StandardParameters
    >>> standard = StandardParameters(rne.irb140(), rne.DriveModel(rotor=True, friction="viscous+coulomb"))
    >>> standard.count, standard.names[10], standard.names[-1]
    (78, 'm_2', 'Fc_6')
    """

    model: Model
    drives: DriveModel = DriveModel()
    springs: Any = None

    __repr__ = summary

    def __post_init__(self) -> None:
        n = model_argument(self.model).n
        refuse_couplings(self.model, "standard parameters, base parameters and identification take")
        drive_argument(self.drives)
        if self.drives.stribeck is not None:
            vector("stribeck", self.drives.stribeck, n, sign="not negative")
        _ = self.motors

    @cached_property
    def motors(self) -> Array:
        """Rows of coupled motors, shape (s, n)."""
        n, rows = self.model.n, self.drives.coupled_motors
        return np.zeros((0, n)) if rows is None else np.array(real_array("coupled_motors", rows, f"(s, {n})"))

    @property
    def smoothing(self) -> float:
        """The velocity at which Coulomb friction is smoothed, 0 for a step."""
        return self.drives.smoothing or 0.0

    @cached_property
    def terms(self) -> tuple[str, ...]:
        """Symbols of the parameters of a drive: Ia, Fv, Fc, Fs and tau0, those that are modelled."""
        given, kinds = self.drives, (self.drives.friction or "").split("+")
        asked = {"Ia": given.rotor, "Fv": "viscous" in kinds, "Fc": "coulomb" in kinds}
        asked |= {"Fs": given.stribeck is not None, "tau0": given.offset}
        return tuple(symbol for symbol, present in asked.items() if present)

    @cached_property
    def groups(self) -> dict[str, slice]:
        """Places of the parameters: "bodies", then each of `terms`, of the joints' drives, then of coupled motors."""
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

    @cached_property
    def values(self) -> Array:
        """The parameters that the model has; offsets, Stribeck effects and those of coupled motors are zero."""
        model, G = self.model, self.model.coordinate_map
        known = {
            "bodies": parameters_of(model),
            "Ia": G.T**2 @ model.armature,
            "Fv": G.T**2 @ model.damping,
            "Fc": np.abs(G.T) @ model.friction,
        }
        found = np.zeros(self.count)
        for name in known.keys() & self.groups.keys():
            found[self.groups[name]] = known[name]
        return found

    def drive_columns(self, qd: Array, qdd: Array) -> Array:
        """Torques of the drives per unit of each parameter of theirs, behind those of the bodies, shape (..., n, k).

        `qd` and `qdd` (..., n) are joint velocities and accelerations [rad/s or m/s; rad/s^2 or m/s^2].
        """
        found = sorted(self._shafts(qd, qdd), key=lambda part: part[0].start)
        blocks = [shafts.T * factor[..., None, :] for _, shafts, factor in found]
        return np.concatenate([np.zeros((*qd.shape, 0)), *blocks], axis=-1)

    def spring_columns(self, q: Array) -> Array:
        """Torques of the drives per unit of each parameter of the springs, the last ones, shape (..., n, k)."""
        return np.zeros((*q.shape, 0)) if self.springs is None else self.springs.columns(self.model, q)

    def spring_torques(self, q: Array, pi: Array) -> Array:
        """Torques of the drives against springs, of standard parameters pi, shape (..., n)."""
        return np.asarray(self.spring_columns(q) @ pi[self.groups.get("springs", slice(0))])

    def drive_torques(self, qd: Array, qdd: Array, x: Array) -> Array:
        """Torques of the drives with parameters x, those behind the bodies', shape (..., n)."""
        total = np.zeros(qd.shape)
        for places, shafts, factor in self._shafts(qd, qdd):
            total += (factor * x[places]) @ shafts
        return total

    def drive_columns_of(self, j: int, qd: Array, qdd: Array) -> tuple[Array, Array]:
        """Places and values, shape (..., k), of the entries of row j of `drive_columns` that are not always zero."""
        found = [
            (k, shafts[row, j] * factor[..., row])
            for places, shafts, factor in self._shafts(qd, qdd)
            for row, k in enumerate(range(places.start, places.stop))
            if shafts[row, j] != 0
        ]
        values = [values for _, values in found]
        return np.array([k for k, _ in found], int), np.stack(values, -1) if found else np.zeros((*qd.shape[:-1], 0))

    def _shafts(self, qd: Array, qdd: Array) -> Iterator[tuple[slice, Array, Array]]:
        """Places of each symbol's parameters behind the bodies', the rows of their shafts, torques per unit there."""
        first, joints = self.groups["bodies"].stop, np.eye(self.model.n)
        for symbol in self.terms:
            place = self.groups[symbol]
            yield slice(place.start - first, place.stop - first), joints, self._factor(symbol, qd, qdd)
            if symbol in OF_MOTORS and len(self.motors):
                place = self.groups[f"{symbol} of coupled motors"]
                factor = self._factor(symbol, qd @ self.motors.T, qdd @ self.motors.T)
                yield slice(place.start - first, place.stop - first), self.motors, factor

    def _factor(self, symbol: str, velocity: Array, acceleration: Array) -> Array:
        """Torque of a shaft per unit of a symbol."""
        if symbol == "Ia":
            factor = acceleration
        elif symbol == "tau0":
            factor = np.ones(velocity.shape)
        elif symbol == "Fs":
            rates = np.asarray(self.drives.stribeck, np.float64)
            falling = np.exp(-np.abs(velocity) / np.where(rates > 0, rates, np.inf))
            factor = np.where(rates > 0, self.sign(velocity) * falling, 0.0)
        else:
            factor = velocity if symbol == "Fv" else self.sign(velocity)
        return np.asarray(factor)

    def sign(self, velocity: Array) -> Any:
        """The direction of Coulomb friction; 0 at rest."""
        return np.tanh(velocity / self.smoothing) if self.smoothing else np.sign(velocity)
