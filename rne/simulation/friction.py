"""Joint friction: viscous and Coulomb, each with its own size in either direction."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from ..basics.arrays import real_array
from ..basics.spatial import Array
from ..elementwise import less, tanh, where
from ..model.model import Model

SMOOTHING = 0.01  # rad/s or m/s: at this rate Coulomb friction has three quarters of its size


@dataclass(frozen=True, eq=False)
class Friction:
    """Friction of the joints: torque against the motion, added to what the dynamics ask for.

    Attributes
    ----------
    viscous, viscous_back : ndarray, shape (n,) or a number
        Torque a unit rate, forwards and backwards [N m s/rad or N s/m]; backwards as forwards if not given.
    coulomb, coulomb_back : ndarray, shape (n,) or a number
        Torque whatever the rate [N m or N].
    smoothing : float
        Coulomb friction grows as tanh(rate / smoothing); 0 for dry friction that sticks, handled by events [rad/s].
    static : ndarray, shape (n,), or a number, optional
        What a sticking joint resists before it breaks away, at least `coulomb`; equal to it if not given [N m or N].

    Raises
    ------
    ValueError
        For negative or non-finite numbers, or `static` below `coulomb`.

    Examples
    --------
    >>> import rne
    >>> rne.Friction(viscous=2.0, coulomb=1.0).torque(rne.load("irb140").model, [0.5] * 6)[0].round(9).item()
    2.0
    """

    viscous: ArrayLike = 0.0
    coulomb: ArrayLike = 0.0
    viscous_back: ArrayLike | None = None
    coulomb_back: ArrayLike | None = None
    smoothing: float = SMOOTHING
    static: ArrayLike | None = None

    def __post_init__(self) -> None:
        for name in ("viscous", "coulomb", "viscous_back", "coulomb_back", "static"):
            value = getattr(self, name)
            if value is None and name != "static":
                value = getattr(self, name.removesuffix("_back"))
            if value is not None:
                object.__setattr__(self, name, _not_negative(name, value))
        if _not_negative("smoothing", self.smoothing).ndim:
            raise ValueError("`smoothing` must be one number")
        shapes = {np.shape(value) for value in self._sizes() if np.ndim(value)}
        if len(shapes) > 1:
            raise ValueError(f"friction must be numbers or arrays of one shape (n,), got {sorted(shapes)}")
        largest = np.maximum(np.asarray(self.coulomb), np.asarray(self.coulomb_back))
        if self.static is not None and (np.asarray(self.static) < largest).any():
            raise ValueError("`static` must be at least `coulomb`: a joint resists no less at rest than slipping")

    def _sizes(self) -> list[ArrayLike]:
        values = (self.viscous, self.coulomb, self.viscous_back, self.coulomb_back, self.static)
        return [value for value in values if value is not None]

    @property
    def sticks(self) -> bool:
        """True for dry friction, which holds a joint at rest."""
        sizes = (self.coulomb, self.coulomb_back, self.static)
        return self.smoothing == 0 and any(np.any(np.asarray(size)) for size in sizes if size is not None)

    def check(self, model: Model) -> None:
        """Refuse numbers that are not one a joint."""
        for name in ("viscous", "coulomb", "viscous_back", "coulomb_back", "static"):
            array = np.asarray(getattr(self, name)) if getattr(self, name) is not None else np.zeros(())
            if array.shape not in ((), (model.n,)):
                shape = f"({model.n},)"
                raise ValueError(f"`{name}` of the friction must be a number or of shape {shape}, got {array.shape}")

    def viscous_torque(self, qd: Array) -> Array:
        """The part that grows with the rate, shape of qd."""
        if np.array_equal(np.asarray(self.viscous), np.asarray(self.viscous_back)):
            return np.asarray(self.viscous) * qd
        return where(less(qd, 0), np.asarray(self.viscous_back) * qd, np.asarray(self.viscous) * qd)

    def coulomb_torque(self, qd: Array) -> Array:
        """The part that does not, smoothed around rest, or of the size of slipping if it is dry; shape of qd."""
        forward, back = np.asarray(self.coulomb, dtype=float), np.asarray(self.coulomb_back, dtype=float)
        if not (forward.any() or back.any()):
            return 0 * qd
        if self.smoothing == 0:
            return where(less(0, qd), forward, 0) - where(less(qd, 0), back, 0)
        size = forward if np.array_equal(forward, back) else where(less(qd, 0), back, forward)
        return size * tanh(qd * (1 / self.smoothing))

    def torque(self, model: Model, qd: ArrayLike) -> Array:
        """Both parts for rates of a robot's joints: what the drives must give beyond the dynamics [N m or N]."""
        self.check(model)
        rates = np.asarray(qd)
        return self.viscous_torque(rates) + self.coulomb_torque(rates)


def urdf_friction(model: Model, smoothing: float = SMOOTHING) -> Friction:
    """The damping and friction that a URDF's `<dynamics>` names, brought to the robot's coordinates."""
    G = np.abs(np.asarray(model.coordinate_map, dtype=float)) if model.has_mimics else np.eye(model.nb)
    return Friction(viscous=model.damping @ G**2, coulomb=model.friction @ G, smoothing=smoothing)


def _not_negative(name: str, value: ArrayLike) -> Array:
    array = real_array(name, value, "(n,)").astype(np.float64)
    if (array < 0).any():
        raise ValueError(f"`{name}` must not be negative, got {array.min()}")
    array.flags.writeable = False
    return array
