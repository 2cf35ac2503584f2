"""Joint origins that a file places far out along the joint's own axis are moved back to the robot.

A revolute joint's frame may have its origin anywhere on the joint's axis: the robot is the same. But a lever of 1e6 m
costs six digits in M and twelve in articulated-body dynamics. Such origins are slid along their axes when the file is
read, in long double and from the file's own numbers, neither rounded nor snapped. Links keep the frames they have in
the file (`Part.link_origin`).

Accuracy: a joint is moved off its axis by about one rounding of long double, 1e-19 of the distance slid. Measured on
robots of about a metre against 50 digits, errors stay at a few roundings of double for distances up to 1e4 m; at 1e6 m
inverse dynamics and M are accurate to 1.5e-13, and forward dynamics to 4e-12, the same error times the condition of M.
Where long double is no wider than double, an origin slid by 1e6 m is accurate to about 1e-10 m, as the file is there.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ..basics.spatial import Array, dot, rotate, rotate_back, rotation_from_rpy
from ..model.builder import Extended, Part, Pose
from ..model.model import REVOLUTE_TYPES

# Origins stay where they are unless one is farther out along its axis than this many times the robot's size; then all
# are slid that are farther out than the robot is large. In example-robot-data the farthest is 1.04 sizes out.
FAR = 10


def slide_far_origins(parts: list[Part], unrounded: Sequence[tuple[Array, Array]]) -> list[Part]:
    """Parts with far joint origins slid along their axes, or `parts` itself if there are none.

    `unrounded` has, for each part, its joint's roll, pitch and yaw [rad] and unit axis in long double, nothing snapped.
    """
    with np.errstate(all="ignore"):  # numbers near the largest double overflow here; the Model reports them
        distances = far_origins(parts)
    return _moved(parts, unrounded, distances) if any(distances) else parts


def far_origins(parts: Sequence[Part]) -> list[float]:
    """The distance to slide each joint's origin along its axis; 0 for those that stay, in ordinary robots all [m]."""
    poses: list[Pose] = []  # in the root's frame, all joints at zero
    for part in parts:
        poses.append(poses[part.parent].then(part.placement) if part.parent >= 0 else part.placement)
    origins = [p for _, p in poses]
    axes = [rotate(R, part.axis.astype(Extended)) for part, (R, _) in zip(parts, poses, strict=True)]
    coms = [p + rotate(R, part.com.astype(Extended)) for part, (R, p) in zip(parts, poses, strict=True)]
    masses = [Extended(part.mass) for part in parts]
    firsts = [m * c for m, c in zip(masses, coms, strict=True)]
    sizes = []  # of bodies, squared [m^2]
    slides: list[float] = [0.0] * len(parts)
    centre = sum(firsts[1:], np.zeros(3)) / (sum(masses[1:]) or 1)
    for k in reversed(range(1, len(parts))):
        part, parent = parts[k], parts[k].parent
        if part.mass:
            spread = coms[k] - centre
            sizes += [dot(spread, spread), np.trace(part.inertia) / masses[k]]
        if part.kind in REVOLUTE_TYPES and masses[k] > 0:
            lever = firsts[k] / masses[k] - origins[k]
            slides[k] = float(dot(axes[k], lever))
            across = lever - slides[k] * axes[k]
            sizes.append(dot(across, across))
        masses[parent] = masses[parent] + masses[k]
        firsts[parent] = firsts[parent] + firsts[k]
    reach = np.sqrt(max(sizes, default=Extended(0)))
    if not any(abs(s) > FAR * reach > 0 for s in slides) or not np.isfinite(slides).all():
        return [0.0] * len(parts)
    return [s if abs(s) > reach else 0.0 for s in slides]


def _moved(parts: list[Part], unrounded: Sequence[tuple[Array, Array]], distances: Sequence[float]) -> list[Part]:
    shifts: list[Array] = [np.zeros(3, dtype=Extended) for _ in parts]  # of each part's frame, in its own axes
    moved = [parts[0]]
    for k, part in enumerate(parts[1:], 1):
        rpy, axis = unrounded[k]
        R = rotation_from_rpy(rpy, snapped=False)  # 4 eps of a double are 1e-9 m at a million metres
        p, above = part.placement.p, shifts[part.parent]
        if distances[k]:
            shifts[k] = distances[k] * axis
        elif part.kind == "fixed" and any(above):  # a fixed link's frame moves to the near origin of its body
            shifts[k] = rotate_back(R, above - p)
        shift = shifts[k]
        if any(shift) or any(above):
            place = Pose(part.placement.R, p + rotate(R, shift) - above)
            part = replace(part, placement=place, com=part.com - shift, link_origin=-shift)
        moved.append(part)
    return moved
