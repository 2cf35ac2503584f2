"""Scene of a viewer page by viser: links with their shapes or lines, joint axes, frames and masses, on link nodes."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from ..basics.spatial import Array, rotate, rotate_back
from ..model.model import Model
from ..simulation.springs import Spring, Springs
from .shapes import PosedRobot

if TYPE_CHECKING:
    from trimesh import Trimesh
    from viser import FrameHandle, SceneApi

Rgb = tuple[int, int, int]
SKY, NIGHT = "#e4e9f0", "#434d5b"  # behind the scene, on which white and dark robots can be seen
TONES = ((126, 148, 182), (86, 104, 132))  # colours in turn of links whose shapes have none
GHOST = (240, 120, 20)
GHOST_OPACITY = 0.4
GHOST_SCALE = 1.004  # scale of the other motion's surfaces, so that they are just outside where both agree
GLASS = 0.35  # opacity of the links where what is inside them is to be seen
MASSES = ("centres of mass", "solids of the same inertia")  # the groups that show what the model weighs
AXIS, CENTRE, SOLID, LINE, SPRING = (176, 48, 176), (30, 30, 30), (20, 140, 140), (90, 100, 115), (200, 30, 30)
FLOOR: dict[str, Any] = {"cell_color": (172, 180, 190), "section_color": (140, 150, 163), "fade_strength": 0.0}
MAX_FACES = 20_000  # most faces of a robot's meshes; with more, all are simplified alike
SMALL = 60  # most faces of a mesh that is never simplified
ALIKE = 1e-9  # relative difference of equal principal moments
CREASE = np.radians(35)  # angle of a mesh's edge from which it is shown as an edge [rad]


class SceneGroup:
    """Named part of viser's scene, with one node per link that moves as the link does."""

    def __init__(self, scene: SceneApi, name: str, robot: PosedRobot, visible: bool = True) -> None:
        self.scene, self.name, self.robot = scene, name, robot
        self.links: dict[int, FrameHandle] = {}
        self.wxyz, self.position = quaternions(robot.R).astype(np.float32), robot.p.astype(np.float32)
        self.moves = np.ptp(robot.R, axis=0).any(axis=(-2, -1)) | np.ptp(robot.p, axis=0).any(axis=-1)
        scene.add_frame(f"/{name}", show_axes=False, visible=visible)

    def on(self, link: int, what: str) -> str:
        """Name of a new node on a link."""
        node = f"/{self.name}/{_node(self.robot.model.link_names[link])}"
        if link not in self.links:
            place = {"wxyz": self.wxyz[0, link], "position": self.position[0, link]}
            self.links[link] = self.scene.add_frame(node, show_axes=False, **place)
        return f"{node}/{_node(what)}"

    def place(self, frame: int) -> None:
        """Move the links to a frame."""
        for link, node in self.links.items():
            if self.moves[link]:
                node.wxyz, node.position = self.wxyz[frame, link], self.position[frame, link]


class SpringLines:
    """Springs between links as lines, whose ends move with these."""

    def __init__(self, scene: SceneApi, robot: PosedRobot, springs: Sequence[Spring], size: float) -> None:
        ends = [(robot.model.link_index(link), np.array(x)) for spring in springs for link, x in spring.ends]
        points = np.stack([rotate(robot.R[:, k], x) + robot.p[:, k] for k, x in ends], axis=1)
        self.points = points.reshape(len(points), -1, 2, 3).astype(np.float32)  # (frames, springs, 2, 3)
        self.node = scene.add_line_segments("/springs", self.points[0], SPRING, thickness=0.012 * size)

    def place(self, frame: int) -> None:
        """Move the ends to a frame."""
        self.node.points = self.points[frame]


def build(
    scene: SceneApi,
    robot: PosedRobot,
    other: PosedRobot | None,
    springs: Springs | None,
    *,
    frames: bool,
    inertia: bool,
) -> list[SceneGroup | SpringLines]:
    """Add the robots and springs to viser's scene, at the first frame."""
    size = float(np.ptp(corners(robot, np.array([0])), axis=0).max()) or 1.0
    groups = [SceneGroup(scene, "robot", robot)]
    _add_robot(groups[0], size, opacity=GLASS if frames or inertia else None)
    if other is not None:
        groups.append(SceneGroup(scene, "other", other))
        _add_robot(groups[-1], size, GHOST, GHOST_OPACITY, GHOST_SCALE)
    groups += [SceneGroup(scene, "joint axes", robot), SceneGroup(scene, "link frames", robot, frames)]
    _add_axes(groups[-2], size)
    for k in range(len(robot.model.link_names)):
        scene.add_frame(groups[-1].on(k, "axes"), axes_length=0.09 * size, axes_radius=0.003 * size, origin_radius=0.0)
    groups += [SceneGroup(scene, name, robot, inertia) for name in MASSES]
    _add_masses(groups[-2], groups[-1], size)
    drawn = [spring for spring in springs.each if isinstance(spring, Spring)] if springs is not None else []
    return [*groups, SpringLines(scene, robot, drawn, size)] if drawn else [*groups]


def add_floor(scene: SceneApi, points: Array) -> float:
    """Add a grid under the points, at the root's height if they are above it; returns the edge of a cell [m]."""
    low, high = points.min(axis=0), points.max(axis=0)
    across = float((high - low).max()) or 1.0
    cell = float(10.0 ** np.floor(np.log10(across / 4)))
    cell *= next(factor for factor in (5, 2, 1) if 4 * cell * factor <= across or factor == 1)
    height = 0.0 if low[2] + high[2] >= 0 else low[2]
    middle = np.round((low + high)[:2] / 2 / cell) * cell
    edge = float(np.ceil(1.6 * across / cell)) * cell
    scene.add_grid("/floor", edge, edge, position=(*middle, height), cell_size=cell, section_size=5 * cell, **FLOOR)
    return cell


def corners(robot: PosedRobot, frames: Array) -> Array:
    """Link origins, centres of mass and corners of the boxes around shapes in some frames, shape (points, 3) [m]."""
    points = [robot.p[frames], robot.centres[frames]]
    for shape in robot.shapes:
        k = robot.model.link_index(shape.link)
        points.append(rotate(robot.R[frames, None, k], _box(shape.faces())) + robot.p[frames, None, k])
    return np.concatenate([x.reshape(-1, 3) for x in points])


def _box(faces: Array) -> Array:
    """Corners of the box around faces, shape (8, 3) [m]."""
    ends = np.stack([faces.min(axis=(0, 1)), faces.max(axis=(0, 1))])
    return np.stack(np.meshgrid(*ends.T), axis=-1).reshape(8, 3)


def quaternions(R: Array) -> Array:
    """Unit quaternions (w, x, y, z) of rotations, shape (..., 4)."""
    from viser.transforms import SO3

    return SO3.from_matrix(R).wxyz


def _at(R: Array, p: Array) -> dict[str, Any]:
    """Pose of a node in viser's form."""
    return {"wxyz": quaternions(R), "position": p}


def _node(name: str) -> str:
    """Name without the separator of viser's nodes."""
    return name.replace("/", " ")


def _add_robot(
    group: SceneGroup, size: float, color: Rgb | None = None, opacity: float | None = None, scale: float = 1.0
) -> None:
    """Add shapes and, for links that have none, lines; colour and opacity are those of the file by default."""
    robot, scene = group.robot, group.scene
    faces = sum(len(shape.mesh.faces) for shape in robot.shapes if shape.mesh is not None)
    keep = min(1.0, MAX_FACES / max(faces, 1))
    number: dict[int, int] = {}
    for shape in robot.shapes:
        k = robot.model.link_index(shape.link)
        number[k] = number.get(k, 0) + 1
        *own, solid = shape.color or (*(x / 255 for x in TONES[k % 2]), 1.0)
        look = _at(shape.pose[:3, :3], shape.pose[:3, 3]) | {"scale": scale}
        look |= {"color": color or [round(255 * x) for x in own], "opacity": opacity or (solid if solid < 1 else None)}
        name = group.on(k, f"{shape.kind} {number[k]}")
        if shape.size:
            scene.add_box(name, dimensions=np.array(shape.size), **look)
        elif shape.mesh is None:
            scene.add_cylinder(name, shape.radius, shape.length, radial_segments=48, **look)
        else:
            mesh = simplified(shape.mesh, keep)
            scene.add_mesh_simple(name, mesh.vertices, mesh.faces, side="double", **look)
    for k in set(range(len(robot.model.link_names))) - set(number):
        if bare := link_lines(robot, k):
            scene.add_line_segments(group.on(k, "lines"), np.stack(bare), color or LINE, thickness=0.024 * size)


def simplified(mesh: Trimesh, keep: float) -> Trimesh:
    """Mesh reduced to a share of its faces by quadric decimation, with vertices doubled along sharp edges."""
    from trimesh.graph import smooth_shade

    if keep < 1 and len(mesh.faces) > SMALL:
        mesh = mesh.copy()
        mesh.merge_vertices(merge_tex=True, merge_norm=True)  # seams that files leave would open
        mesh = mesh.simplify_quadric_decimation(percent=1 - keep)
    smooth: Trimesh = smooth_shade(mesh, angle=CREASE)
    return smooth


def link_lines(robot: PosedRobot, k: int) -> list[Array]:
    """Lines (2, 3) from a link to its children, with the paths of sliding ones, or at an end to its centre of mass."""
    lines = []
    for child in [child for child, parent in enumerate(robot.model.link_parent) if parent == k]:
        way = rotate_back(robot.R[:, k], robot.p[:, child] - robot.p[:, k])
        lines.append(np.stack([np.zeros(3), way[np.linalg.norm(way, axis=-1).argmin()]]))
        if child in robot.carried and not robot.model.is_revolute[robot.carried.index(child)]:
            along = way @ (way[np.linalg.norm(way - way[0], axis=-1).argmax()] - way[0])
            lines.append(way[[along.argmin(), along.argmax()]])
    if not lines and k in robot.carried:
        lines.append(np.stack([np.zeros(3), robot.com[robot.carried.index(k)]]))
    return lines


def _add_axes(group: SceneGroup, size: float) -> None:
    model = group.robot.model
    for i, k in enumerate(group.robot.carried):
        points = np.outer([-0.1 * size, 0.16 * size], model.axis[i])
        arrow: dict[str, Any] = {"shaft_radius": 0.004 * size, "head_radius": 0.011 * size, "head_length": 0.03 * size}
        group.scene.add_arrows(group.on(k, model.moving_joints[i]), points[None], AXIS, **arrow)


def _add_masses(centres: SceneGroup, inertias: SceneGroup, size: float) -> None:
    """Add centres of mass, and solid cylinders or ellipsoids of the same mass and inertia, of the moving bodies."""
    robot = centres.robot
    axes, half = ellipsoids(robot.model)
    for i, k in enumerate(robot.carried):
        if robot.model.mass[i] > 0:
            p, scale = robot.com[i], tuple(np.maximum(half[i], 1e-3 * size).tolist())
            centres.scene.add_icosphere(centres.on(k, "centre of mass"), 0.015 * size, CENTRE, position=p)
            name, cylinder = inertias.on(k, "solid"), cylinder_of(robot.model.mass[i], robot.model.inertia[i])
            if cylinder is not None:
                R, radius, length = cylinder
                inertias.scene.add_cylinder(name, radius, length, SOLID, radial_segments=48, opacity=0.5, **_at(R, p))
            else:
                look = _at(axes[i], p) | {"scale": scale, "opacity": 0.5, "subdivisions": 4}
                inertias.scene.add_icosphere(name, 1.0, SOLID, **look)


def ellipsoids(model: Model) -> tuple[Array, Array]:
    """Right-handed principal axes (nb, 3, 3) and half axes (nb, 3) of homogeneous ellipsoids with the bodies' inertias.

    Half axes are 0 if the principal moments of inertia are those of no rigid body, or there is no mass.
    """
    moments, axes = np.linalg.eigh(model.inertia)
    axes[..., 0] *= np.sign(np.linalg.det(axes))[:, None]
    mass = np.where(model.mass > 0, model.mass, np.inf)[:, None]
    squares = 5 / mass * (moments.sum(axis=-1, keepdims=True) / 2 - moments)
    return axes, np.sqrt(np.maximum(squares, 0.0))


def cylinder_of(mass: float, inertia: Array) -> tuple[Array, float, float] | None:
    """Homogeneous cylinder with this mass and inertia: its axes, z along it, radius, length; None if there is none."""
    moments, axes = np.linalg.eigh(inertia)
    alike = np.diff(moments) <= ALIKE * moments[2]
    if not alike.any() or not moments[0] > 0:
        return None
    k = 0 if alike[1] else 2  # the axis: that of the other moment
    radius = np.sqrt(2 * moments[k] / mass)
    square = 12 * moments[1] / mass - 3 * radius**2
    if square <= 0:
        return None
    R = np.roll(axes, 2 - k, axis=1)
    R[:, 0] *= np.sign(np.linalg.det(R))
    return R, float(radius), float(np.sqrt(square))
