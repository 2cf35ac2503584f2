"""Limits of a robot that a motion uses or exceeds: ranges, speeds, accelerations and efforts of the joints.

A simulation applies only the limits of its scene (stops, torque limits); here the others are checked afterwards.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Literal

import numpy as np

from ..basics.spatial import Array
from ..basics.text import UNITS, short, summary
from ..model.model import Model
from .kinematics import joint_positions, joint_velocities

MET = 1e-9  # tolerance relative to the larger limit: at a stop or with saturated torque, none is exceeded
SYMBOL = {"position": "q", "velocity": "qd", "torque": "tau"}


def limit_shares(limits: Mapping[str, Array], qd: Array, qdd: Array, tau: Array) -> dict[str, Array]:
    """Magnitudes of torques, accelerations and velocities over their limits, 0 where there is none, shape (..., n).

    `limits` are those of `Model.coordinate_limits`; accelerations against the motion have the deceleration limit.
    """
    along = np.where(qd * qdd < 0, limits["deceleration_limit"], limits["acceleration_limit"])
    pairs = {"torque": (tau, limits["effort_limit"]), "acceleration": (qdd, along)}
    pairs["velocity"] = qd, limits["velocity_limit"]
    with np.errstate(divide="ignore", invalid="ignore"):
        return {name: np.asarray(np.abs(value) / limit) for name, (value, limit) in pairs.items()}


def share_texts(shares: Array, limits: Array) -> list[str]:
    """Largest share of each joint's limit as a column of a table; a dash where there is no limit."""
    pairs = zip(shares.max(axis=0), limits, strict=True)
    return [f"{share:.1%}" if math.isfinite(limit) else "-" for share, limit in pairs]


@dataclass(frozen=True)
class Violation:
    """Limit of a joint that a motion exceeds; `str` gives it in a line.

    Attributes
    ----------
    joint : str
    quantity : {"position", "velocity", "torque"}
    value, limit : float
        The value farthest beyond the limit, and the limit on that side [`unit`].
    unit : str
        Radians for rotating joints.
    first_time, worst_time : float
        The first instant beyond the limit, to a sixteenth of the solver's step, and that of `value` [s].
    """

    joint: str
    quantity: Literal["position", "velocity", "torque"]
    value: float
    limit: float
    unit: str
    first_time: float
    worst_time: float

    __repr__ = summary

    def __str__(self) -> str:
        beyond = "above" if self.value > self.limit else "below"
        return (
            f"{short(self.joint)}: {self.quantity} {self._written(self.value)} {beyond} {self._written(self.limit)}, "
            f"worst at {self.worst_time:.6g} s, first at {self.first_time:.6g} s"
        )

    def _written(self, value: float) -> str:
        digits = 4 if f"{self.value:.4g}" != f"{self.limit:.4g}" else 11  # as many as distinguish them
        degrees = f" ({math.degrees(value):.{digits}g} {self.unit.replace('rad', 'deg')})" if "rad" in self.unit else ""
        return f"{value:.{digits}g} {self.unit}{degrees}"


def limit_violations(model: Model, t: Array, q: Array, qd: Array, tau: Array) -> list[Violation]:
    """Limits of a model that a motion exceeds at its samples, of shapes (T,) and (T, n).

    In the order of the joints, for each its position (each side), velocity and torque. A limit counts as exceeded by
    more than 1e-9 of it, so that motions that end at a stop, or with saturated torque, violate none.

    Examples
    --------
    >>> import numpy as np, rne
    >>> from rne.dynamics.limits import limit_violations
    >>> fast = np.array([[4.0, 0, 0, 0, 0, 0]])
    >>> print(*limit_violations(rne.irb140(), np.zeros(1), 0 * fast, fast, 0 * fast))
    joint_1: velocity 4 rad/s (229.2 deg/s) above 3.491 rad/s (200 deg/s), worst at 0 s, first at 0 s
    """
    found = []
    for joint, quantity, values, lower, upper in _limited(model, q, qd, tau):
        finite = [abs(limit) for limit in (lower, upper) if math.isfinite(limit)]
        tolerance = MET * max(finite, default=0.0)
        unit = UNITS[SYMBOL[quantity]][not model.is_revolute[joint]]
        below, above = lower - values, values - upper
        for excess in (below, above) if quantity == "position" else (np.maximum(below, above),):
            beyond = np.flatnonzero(excess > tolerance)
            if len(beyond):
                k = int(np.argmax(excess))
                value, limit = float(values[k]), lower if below[k] > above[k] else upper
                times = float(t[beyond[0]]), float(t[k])
                found.append(Violation(model.moving_joints[joint], quantity, value, limit, unit, *times))
    return found


def _limited(
    model: Model, q: Array, qd: Array, tau: Array
) -> Iterator[tuple[int, Literal["position", "velocity", "torque"], Array, float, float]]:
    """Joint, quantity, its values over time, and its lower and upper limit."""
    positions, velocities = joint_positions(model, q), joint_velocities(model, q, qd)
    for i in range(model.nb):
        speed, effort = float(model.velocity_limit[i]), float(model.effort_limit[i])
        yield i, "position", positions[:, i], float(model.lower[i]), float(model.upper[i])
        yield i, "velocity", velocities[:, i], -speed, speed
        if i in model.independent_joints:
            yield i, "torque", tau[:, model.coordinate[i]], -effort, effort
