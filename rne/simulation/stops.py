"""The ends of the joints' ranges, as events that end a run."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..basics.spatial import Array
from ..model.model import Model

EPS = float(np.finfo(np.float64).eps)


class Stop:
    """One end of a joint's range, for a joint at `multiplier * q[coordinate] + offset`: mimic joints have stops too.

    As a function it is the distance beyond the stop, see `events`.
    """

    def __init__(self, model: Model, i: int, bound: float, sign: float) -> None:
        self.joint, self.bound, self.sign = model.moving_joints[i], bound, sign
        self.coordinate = int(model.coordinate[i])
        self.multiplier, self.offset = float(model.multiplier[i]), float(model.offset[i])
        self.slack = 4 * EPS * max(1.0, abs(bound))  # a joint at rest on its stop has not just reached it

    def position(self, x: Array) -> float:
        """The joint's position [rad or m]."""
        return self.multiplier * float(x[self.coordinate]) + self.offset

    def __call__(self, t: float, x: Array) -> float:
        return self.sign * (self.position(x) - self.bound) - self.slack

    def message(self, t: float) -> str:
        """The message of a run that ended here."""
        return f"{self.joint!r} reached its stop at {self.bound:.6g} at t = {t:.6g} s"


def stops(model: Model) -> list[Stop]:
    """The stops of every moving joint."""
    ends = [(i, model.upper[i], 1.0) for i in range(len(model.moving_joints))]
    ends += [(i, model.lower[i], -1.0) for i in range(len(model.moving_joints))]
    return [Stop(model, i, float(bound), sign) for i, bound, sign in ends if np.isfinite(bound)]


def check_within_stops(found: Sequence[Stop], x0: Array) -> None:
    """Refuse an initial state beyond a stop."""
    for stop in found:
        if stop(0.0, x0) > 0:
            raise ValueError(
                f"`q0` must be within the stops, got {stop.position(x0):.6g} for joint {stop.joint!r}, "
                f"whose stop is at {stop.bound:.6g}"
            )
