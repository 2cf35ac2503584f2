"""Faces of shapes for pictures: few enough for matplotlib, four corners each, anticlockwise seen from outside."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from ..basics.spatial import Array, rotate, rotation_from_rpy
from ..model.solids import Cylinder
from .shapes import Shape

SIDES = 32  # of the prism that approximates a cylinder, a multiple of 4
RINGS = 8  # of a sphere, from pole to pole
DIRECTIONS = 120  # in which a mesh's furthest point is kept


def surface(shapes: Sequence[Shape]) -> Array:
    """Faces of a link's shapes in the link's frame, of its meshes those of their common convex hull.

    Parameters
    ----------
    shapes : sequence of Shape
        Of one link.

    Returns
    -------
    ndarray, shape (faces, 4, 3)
        Triangles have their last corner twice [m].
    """
    parts = [np.zeros((0, 4, 3))]
    points = []
    for shape in shapes:
        R, p = shape.pose[:3, :3], shape.pose[:3, 3]
        if shape.mesh is not None:
            points.append(rotate(R, shape.mesh.vertices) + p)
        else:
            parts.append(rotate(R, PRIMITIVES[shape.kind](*shape.size)) + p)
    if points:
        parts.append(_hull(np.concatenate(points)))
    return np.concatenate(parts)


def cylinder_faces(shape: Cylinder) -> Array:
    """The faces of a cylinder as a prism, in its link's frame.

    Parameters
    ----------
    shape : Cylinder

    Returns
    -------
    ndarray, shape (64, 4, 3)
        Four corners of each face, anticlockwise seen from outside [m].
    """
    R, p = rotation_from_rpy(np.array(shape.rpy)), np.array(shape.position)
    faces: Array = rotate(R, _cylinder(shape.radius, shape.length)) + p
    return faces


def _cylinder(radius: float, length: float) -> Array:
    angle = np.linspace(0, 2 * np.pi, SIDES + 1)
    ring = np.stack([radius * np.cos(angle), radius * np.sin(angle), np.zeros(SIDES + 1)], axis=-1)
    up = np.array([0, 0, length / 2])
    sides = np.stack([ring[:-1] - up, ring[1:] - up, ring[1:] + up, ring[:-1] + up], axis=1)
    centre = np.zeros((SIDES // 2, 3))
    fan = np.stack([centre, ring[:-2:2], ring[1:-1:2], ring[2::2]], axis=1)
    return np.concatenate([sides, fan + up, fan[:, ::-1] - up])


def _box(x: float, y: float, z: float) -> Array:
    square = np.array([[-1, -1, 1], [1, -1, 1], [1, 1, 1], [-1, 1, 1]])  # seen from +z
    faces = [np.roll(square, shift, axis=-1) for shift in range(3)]  # cyclic: handedness stays
    both: Array = np.array([*faces, *(-face[::-1] for face in faces)]) * np.array([x, y, z]) / 2
    return both


def _sphere(radius: float) -> Array:
    polar = np.linspace(0, np.pi, RINGS + 1)[:, None]
    around = np.linspace(0, 2 * np.pi, 2 * RINGS + 1)
    grid = np.stack(
        [np.sin(polar) * np.cos(around), np.sin(polar) * np.sin(around), np.cos(polar) + 0 * around], axis=-1
    )
    corners = [grid[:-1, :-1], grid[1:, :-1], grid[1:, 1:], grid[:-1, 1:]]
    return radius * np.stack(corners, axis=2).reshape(-1, 4, 3)


def _hull(points: Array) -> Array:
    """Triangles of the convex hull of the points that are furthest in many directions."""
    from scipy.spatial import ConvexHull

    k = np.arange(DIRECTIONS) + 0.5
    polar, around = np.arccos(1 - 2 * k / DIRECTIONS), np.pi * (1 + 5**0.5) * k  # evenly spread over the sphere
    rays = np.stack([np.sin(polar) * np.cos(around), np.sin(polar) * np.sin(around), np.cos(polar)])
    middle = (points.min(axis=0) + points.max(axis=0)) / 2
    kept = points[np.unique(((points - middle) @ rays).argmax(axis=0))]
    hull = ConvexHull(kept, qhull_options="QJ")  # joggled: flat meshes have a hull too
    triangles = kept[hull.simplices]
    normal = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    inwards = (normal * hull.equations[:, :3]).sum(axis=-1) < 0
    triangles[inwards] = triangles[inwards][:, ::-1]
    faces: Array = triangles[:, [0, 1, 2, 2]]
    return faces


PRIMITIVES: dict[str, Callable[..., Array]] = {"cylinder": _cylinder, "box": _box, "sphere": _sphere}
