"""The standard parameters: everything that joint torques are linear in, bodies, rotors, friction and offsets."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..basics.arrays import positive_number, real_array
from ..basics.spatial import Array
from ..basics.text import summary
from .model import Model, model_argument
from .parameters import PARAMETERS, parameters_of

BODY_SYMBOLS = ("m", "mcx", "mcy", "mcz", "Ixx", "Ixy", "Iyy", "Ixz", "Iyz", "Izz")
FRICTION = (None, "viscous", "coulomb", "viscous+coulomb")


@dataclass(frozen=True, eq=False)
class StandardParameters:
    """The parameters that the torques of the drives are a linear function of, and their order.

    tau = Y pi + Ia qdd + Fv qd + Fc sign(qd) + tau0, and for each further shaft, which turns at a^T qd, the same terms
    in a^T qd, times a.

    Attributes
    ----------
    model : Model
        The robot's parameters.
    rotor : bool
        True for the inertia Ia of each drive's rotor, reflected to its joint: `armature`.
    friction : {None, "viscous", "coulomb", "viscous+coulomb"}
        Fv, Fc or both of each drive.
    offset : bool
        True for a constant torque tau0 of each drive: the zero error of its sensor, or unequal Coulomb friction.
    shafts : array_like, shape (s, n), optional
        Rows a of further shafts, for example of a motor that is coupled to two joints; with rotor and friction if the
        joints have them.
    smoothing : float
        Coulomb friction is Fc tanh(qd / smoothing); 0 for Fc sign(qd) [rad/s or m/s].

    Examples
    --------
    >>> import rne
    >>> from rne.model.standard_parameters import StandardParameters
    >>> standard = StandardParameters(rne.irb140(), rotor=True, friction="viscous+coulomb")
    >>> standard.count, standard.names[10], standard.names[-1]
    (78, 'm_2', 'Fc_6')
    """

    model: Model
    rotor: bool = False
    friction: str | None = None
    offset: bool = False
    shafts: ArrayLike | None = None
    smoothing: float = 0.0

    __repr__ = summary

    def __post_init__(self) -> None:
        n = model_argument(self.model).n
        if self.friction not in FRICTION:
            raise ValueError(f"`friction` must be one of {list(FRICTION)}, got {self.friction!r}")
        positive_number("smoothing", self.smoothing, zero_allowed=True)
        shafts = np.zeros((0, n)) if self.shafts is None else real_array("shafts", self.shafts, f"(s, {n})")
        object.__setattr__(self, "shafts", shafts)

    @cached_property
    def terms(self) -> tuple[str, ...]:
        """Symbols of the parameters of a drive: Ia, Fv, Fc and tau0, those that are modelled."""
        kinds = (self.friction or "").split("+")
        asked = {"Ia": self.rotor, "Fv": "viscous" in kinds, "Fc": "coulomb" in kinds, "tau0": self.offset}
        return tuple(symbol for symbol, present in asked.items() if present)

    @cached_property
    def groups(self) -> dict[str, slice]:
        """Places of the parameters: "bodies", then each of `terms`, of the joints' drives, then of the shafts."""
        groups = {"bodies": slice(0, PARAMETERS * self.model.nb)}
        widths = {symbol: self.model.n for symbol in self.terms}
        widths |= {f"{symbol} of shafts": len(np.asarray(self.shafts)) for symbol in self.terms if symbol != "tau0"}
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
        the shafts. m is the mass, mcx the first moment, Ixx ... the inertia about the joint's origin.
        """
        names = [f"{symbol}_{i + 1}" for i in range(self.model.nb) for symbol in BODY_SYMBOLS]
        names += [f"{symbol}_{i + 1}" for symbol in self.terms for i in self.model.independent_joints]
        shafts = range(1, len(np.asarray(self.shafts)) + 1)
        return (*names, *(f"{symbol}_s{k}" for symbol in self.terms if symbol != "tau0" for k in shafts))

    @cached_property
    def values(self) -> Array:
        """The parameters that the model has; offsets and those of shafts are zero."""
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
        """Torques of the drives per unit of each parameter behind those of the bodies, shape (..., n, count - 10 nb).

        `qd` and `qdd` (..., n) are joint velocities and accelerations [rad/s or m/s; rad/s^2 or m/s^2].
        """
        joints, shafts = np.eye(self.model.n), np.asarray(self.shafts)
        blocks = [self._columns(symbol, joints, qd, qdd) for symbol in self.terms]
        blocks += [self._columns(symbol, shafts, qd, qdd) for symbol in self.terms if symbol != "tau0"]
        return np.concatenate([np.zeros((*qd.shape, 0)), *blocks], axis=-1)

    def _columns(self, symbol: str, shafts: Array, qd: Array, qdd: Array) -> Array:
        """Columns of one symbol: a times the function of the shaft's velocity or acceleration, for each row a."""
        if symbol == "Ia":
            factor = qdd @ shafts.T
        elif symbol == "tau0":
            factor = np.ones((*qd.shape[:-1], len(shafts)))
        else:
            velocity = qd @ shafts.T
            factor = velocity if symbol == "Fv" else self.sign(velocity)
        return np.asarray(shafts.T * factor[..., None, :])

    def sign(self, velocity: Array) -> Any:
        """The direction of Coulomb friction; 0 at rest."""
        return np.tanh(velocity / self.smoothing) if self.smoothing else np.sign(velocity)
