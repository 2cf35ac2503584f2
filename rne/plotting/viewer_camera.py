"""The floor under a robot and the camera that sees all of it, for the viewer's pages."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from ..basics.spatial import Array

SKY = (228, 233, 240)  # of the background, before which white and dark robots can be seen
FOV = np.radians(38)  # of the camera, vertical


def add_floor(scene: Any, points: Array) -> float:
    """A grid under the points, at the root's height if they are above it; returns the edge of a cell [m]."""
    scene.set_background_image(np.full((2, 2, 3), SKY, dtype=np.uint8), format="png")
    low, high = points.min(axis=0), points.max(axis=0)
    across = float((high - low).max()) or 1.0
    cell = float(10.0 ** np.floor(np.log10(across / 4)))
    cell *= next(factor for factor in (5, 2, 1) if 4 * cell * factor <= across or factor == 1)
    height = 0.0 if low[2] + high[2] >= 0 else low[2]
    middle = np.round((low + high)[:2] / 2 / cell) * cell
    edge = float(np.ceil(1.6 * across / cell)) * cell
    colors = {"cell_color": (196, 203, 212), "section_color": (160, 170, 182)}
    look = colors | {"cell_size": cell, "section_size": 5 * cell, "shadow_opacity": 0.15, "fade_strength": 0.0}
    scene.add_grid("/floor", edge, edge, position=(*middle, height), **look)
    return cell


class Camera(NamedTuple):
    """Where a camera looks at, from which side (a unit vector), and how far it must be away to see all points [m]."""

    target: Array
    side: Array
    distance: float  # in a window as wide as high or wider
    width: float  # in one of aspect ratio a < 1 it is width / a + depth
    depth: float

    @property
    def position(self) -> Array:
        """Of the camera in a wide window [m]."""
        return self.target + self.distance * self.side


def aim(points: Array) -> Camera:
    """The camera that sees all points from the front, the right and above, with z upwards."""
    side = np.array([0.72, -0.95, 0.55]) / np.linalg.norm([0.72, -0.95, 0.55])
    right = np.cross([0.0, 0.0, 1.0], side)
    axes = np.stack([right / np.linalg.norm(right), np.cross(side, right / np.linalg.norm(right)), side])
    seen = points @ axes.T
    middle = (seen.min(axis=0) + seen.max(axis=0)) / 2
    x, y, z = np.abs(seen - middle).T[0], np.abs(seen - middle).T[1], (seen - middle).T[2]
    tangent = 0.84 * np.tan(FOV / 2)  # leaves a margin
    distance = float((np.maximum(x, y) / tangent + z).max()) or 1.0
    return Camera(middle @ axes, side, distance, float(x.max() / tangent), float(z.max()))
