"""Limits of a motion's positions, rates, accelerations and torques."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ...basics.arrays import convert_numbers
from ...basics.spatial import Array
from ...robot import Robot

NAMES = ("lower", "upper", "velocity_limit", "acceleration_limit", "effort_limit")


@dataclass(frozen=True, eq=False)
class MotionLimits:
    """Limits per coordinate, shape (n,) each; accelerations and torques may be unlimited."""

    lower: Array
    upper: Array
    velocity_limit: Array
    acceleration_limit: Array
    effort_limit: Array

    @property
    def centre(self) -> Array:
        """The middle of the ranges."""
        return (self.lower + self.upper) / 2

    @property
    def half_range(self) -> Array:
        """Half the width of the ranges."""
        return (self.upper - self.lower) / 2


def motion_limits(robot: Robot, given: Mapping[str, ArrayLike] | None) -> MotionLimits:
    """The robot's limits, replaced by those given.

    Raises
    ------
    TypeError
        If `given` is no mapping.
    ValueError
        If a name is unknown, a shape wrong, a range empty, a limit negative, or a joint has no range or rate limit.
    """
    if given is None:
        given = {}
    if not isinstance(given, Mapping):
        raise TypeError(f"`limits` must be a mapping of names to arrays, got {type(given).__name__}")
    for name in given:
        if name not in NAMES:
            raise ValueError(f"`limits` must name some of {list(NAMES)}, got {name!r}")
    values: dict[str, Array] = _of_robot(robot)
    for name, limit in given.items():
        values[name] = _limit(f"limits[{name!r}]", limit, robot.n)
    _check(robot, values)
    return MotionLimits(**values)


def _of_robot(robot: Robot) -> dict[str, Array]:
    """Those of the robot's joints, joints that mimic others included."""
    model = robot.model
    lower, upper, rate = robot.lower.copy(), robot.upper.copy(), robot.velocity_limit.copy()
    for i, k in enumerate(model.coordinate):
        m = model.multiplier[i]
        if i == model.independent_joints[k] or m == 0:
            continue
        ends = sorted(((model.lower[i] - model.offset[i]) / m, (model.upper[i] - model.offset[i]) / m))
        lower[k], upper[k] = max(lower[k], ends[0]), min(upper[k], ends[1])
        rate[k] = min(rate[k], model.velocity_limit[i] / abs(m))
    free = np.full(robot.n, np.inf)
    return {
        "lower": lower,
        "upper": upper,
        "velocity_limit": rate,
        "acceleration_limit": free,
        "effort_limit": robot.effort_limit,
    }


def _limit(name: str, value: Any, n: int) -> Array:
    array = np.array(convert_numbers(name, value, f"({n},)"), dtype=float)
    if array.shape != (n,):
        raise ValueError(f"`{name}` must have shape ({n},), got {array.shape}")
    if np.isnan(array).any():
        raise ValueError(f"`{name}` must not be NaN, got nan at index ({int(np.isnan(array).argmax())},)")
    return array


def _check(robot: Robot, values: Mapping[str, Array]) -> None:
    for k, joint in enumerate(robot.joint_names):
        low, high, rate = (float(values[name][k]) for name in NAMES[:3])
        if not np.isfinite([low, high]).all():
            raise ValueError(f"joint {joint!r} has no finite range; give `limits` with 'lower' and 'upper'")
        if not np.isfinite(rate):
            raise ValueError(f"joint {joint!r} has no finite rate limit; give `limits` with 'velocity_limit'")
        if not low < high:
            raise ValueError(f"`limits`: the range of joint {joint!r} is empty, from {low:g} to {high:g}")
        for name in NAMES[2:]:
            if not values[name][k] > 0:
                raise ValueError(f"`limits`: {name} of joint {joint!r} must be positive, got {values[name][k]:g}")
