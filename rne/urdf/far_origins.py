"""Joint origins that a file put far out along the joint's own axis, slid back to the robot.

A frame may sit anywhere on its joint's axis without the robot being another one, but a lever of a million metres costs
six digits in M and twelve in articulated bodies. Sliding is done on the file's own numbers, with 80 digits, before
anything is rounded; the links stay where the file has them (`Part.link_origin`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from decimal import Decimal, localcontext
from typing import Any, NamedTuple

import numpy as np

from ..basics.spatial import Array, dot, rotate
from ..model.builder import Exact, Part, Pose
from ..model.model import REVOLUTE_TYPES

DIGITS = 80
# An origin this many times the robot's size away along its axis is no robot's but a habit of CAD: then all are slid
# that are farther away than the robot is large. In example-robot-data the farthest is 1.04 times its robot's size away.
FAR = 10

Decimals = list[Decimal]


class Written(NamedTuple):
    """A joint's angles and axis as the file has them; the axis of any length."""

    rpy: Any
    axis: Any


def slid(parts: list[Part], written: Sequence[Written]) -> list[Part]:
    """The same robot with far joint origins slid along their axes; the parts themselves if there are none.

    `written` holds one entry a part; the root's is not looked at.
    """
    with np.errstate(all="ignore"):  # numbers near the largest are no robot's; the Model says so
        distances = far_origins(parts)
    if not any(distances):
        return parts
    with localcontext() as context:
        context.prec = DIGITS
        return _moved(parts, written, distances)


def far_origins(parts: Sequence[Part]) -> list[float]:
    """How far to slide each joint's origin along its axis; 0 for those that stay, in ordinary robots all."""
    origins, axes, coms = _at_zero(parts)
    masses = [Exact(part.mass) for part in parts]
    firsts = [m * c for m, c in zip(masses, coms, strict=True)]
    sizes = []  # squares of lengths
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
    reach = np.sqrt(max(sizes, default=Exact(0)))
    if not any(abs(s) > FAR * reach > 0 for s in slides) or not np.isfinite(slides).all():
        return [0.0] * len(parts)
    return [s if abs(s) > reach else 0.0 for s in slides]


def _at_zero(parts: Sequence[Part]) -> tuple[list[Array], list[Array], list[Array]]:
    """Origin, axis and centre of mass of every part in the root's frame, all joints at zero."""
    poses: list[Pose] = []
    for part in parts:
        poses.append(poses[part.parent].then(part.placement) if part.parent >= 0 else part.placement)
    axes = [rotate(pose.R, np.asarray(part.axis, dtype=Exact)) for part, pose in zip(parts, poses, strict=True)]
    coms = [pose.p + rotate(pose.R, np.asarray(part.com, dtype=Exact)) for part, pose in zip(parts, poses, strict=True)]
    return [pose.p for pose in poses], axes, coms


def _moved(parts: list[Part], written: Sequence[Written], distances: Sequence[float]) -> list[Part]:
    shifts: list[Decimals] = [[Decimal(0)] * 3 for _ in parts]  # of each part's frame, in its own axes
    moved = [parts[0]]
    for k, part in enumerate(parts[1:], 1):
        R = _rotation(written[k].rpy)
        p, above = _decimals(part.placement.p), shifts[part.parent]
        if distances[k]:
            shifts[k] = [Decimal(distances[k]) * b for b in _unit(written[k].axis)]
        elif part.kind == "fixed" and any(above):  # all that a body is made of is seen from its near origin
            back = [a - x for a, x in zip(above, p, strict=True)]
            shifts[k] = [sum((R[j][i] * back[j] for j in range(3)), Decimal(0)) for i in range(3)]
        shift = shifts[k]
        if not any(shift) and not any(above):
            moved.append(part)
            continue
        turned = [sum((R[i][j] * shift[j] for j in range(3)), Decimal(0)) for i in range(3)]
        place = [x + t - a for x, t, a in zip(p, turned, above, strict=True)]
        com = [c - s for c, s in zip(_decimals(part.com), shift, strict=True)]
        moved.append(
            replace(
                part,
                placement=Pose(part.placement.R, _rounded(place)),
                com=_rounded(com),
                link_origin=_rounded([-s for s in shift]),
            )
        )
    return moved


def _decimals(vector: Any) -> Decimals:
    """The file's doubles, which long double holds as they are."""
    return [Decimal(float(x)) for x in vector]


def _rounded(vector: Decimals) -> Array:
    return np.array([Exact(str(x)) for x in vector])


def _unit(axis: Any) -> Decimals:
    b = _decimals(axis)
    length = sum((x * x for x in b), Decimal(0)).sqrt()
    return [x / length for x in b]


def _rotation(rpy: Any) -> list[Decimals]:
    """Rz(yaw) Ry(pitch) Rx(roll), nothing snapped."""
    (sr, cr), (sp, cp), (sy, cy) = (_sincos(x) for x in _decimals(rpy))
    return [
        [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
        [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
        [-sp, cp * sr, cp * cr],
    ]


def _sincos(x: Decimal) -> tuple[Decimal, Decimal]:
    """From the series of a small angle, doubled as often as it was halved."""
    halvings = max(0, 4 * (x.adjusted() + 2)) if x else 0
    small = x / 2**halvings
    sin, cos, term, n = Decimal(0), Decimal(0), Decimal(1), 0
    while abs(term) > Decimal(10) ** (-DIGITS - 2) or n < 2:
        if n % 2:
            sin += term if n % 4 == 1 else -term
        else:
            cos += term if n % 4 == 0 else -term
        n += 1
        term = term * small / n
    for _ in range(halvings):
        sin, cos = 2 * sin * cos, cos * cos - sin * sin
    return sin, cos
