"""The scene of a viewer page by viser: links with their shapes or lines, joint axes, frames and masses.

Everything hangs on nodes with the poses of links, so that a frame of the recording is a list of poses.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from ..basics.spatial import Array, rotate, rotate_back
from ..model.model import Model
from .shapes import Shape

TONES = ((126, 148, 182), (86, 104, 132))  # of links whose shapes have no colour of their own, in turn
GHOST = (240, 120, 20)
GHOST_OPACITY = 0.4
GHOST_SCALE = 1.004  # where both motions agree, the surfaces of the other one are just outside
GLASS = 0.35  # opacity of the links where what is inside them is to be seen
AXIS, CENTRE, ELLIPSOID, LINE, JOINT = (176, 48, 176), (30, 30, 30), (20, 140, 140), (90, 100, 115), (60, 68, 80)
MAX_FACES = 20_000  # of a robot's meshes; with more, all are simplified alike
SMALL = 60  # faces of a mesh that is never simplified
CREASE = np.radians(35)  # of a mesh: edges that are sharper are shown as edges


class Motion(NamedTuple):
    """A robot, its shapes, and the poses of its links in all frames in a world whose z is up."""

    model: Model
    shapes: list[Shape]
    poses: Array  # (frames, n_links, 4, 4)

    def joint_links(self) -> list[int]:
        """The links that the moving joints carry."""
        return [self.model.link_joints.index(joint) for joint in self.model.moving_joints]


class Style(NamedTuple):
    """How a robot is shown: the colour and opacity of all its shapes where they are not their own."""

    color: tuple[int, ...] | None = None
    opacity: float | None = None
    scale: float = 1.0


class Group:
    """A named part of the scene, with one node per link that moves as the link does.

    Parameters
    ----------
    scene : viser.SceneApi
    name : str
    motion : Motion
    visible : bool
    """

    def __init__(self, scene: Any, name: str, motion: Motion, visible: bool = True) -> None:
        self.scene, self.name, self.motion = scene, name, motion
        self.links: dict[int, Any] = {}
        self.wxyz = quaternions(motion.poses[..., :3, :3]).astype(np.float32)
        self.position = motion.poses[..., :3, 3].astype(np.float32)
        self.moves = np.ptp(motion.poses, axis=0).max(axis=(-2, -1)) > 0
        scene.add_frame(f"/{name}", show_axes=False, visible=visible)

    def on(self, link: int, what: str) -> str:
        """The name of a new node on a link."""
        node = f"/{self.name}/{self.motion.model.link_names[link].replace('/', ' ')}"
        if link not in self.links:
            place = {"wxyz": self.wxyz[0, link], "position": self.position[0, link]}
            self.links[link] = self.scene.add_frame(node, show_axes=False, **place)
        return f"{node}/{what}"

    def place(self, frame: int) -> None:
        """Move the links to a frame."""
        for link, node in self.links.items():
            if self.moves[link]:
                node.wxyz, node.position = self.wxyz[frame, link], self.position[frame, link]


def build(scene: Any, motion: Motion, other: Motion | None, *, frames: bool, inertia: bool) -> list[Group]:
    """Add the robots to viser's scene, at the first frame."""
    size = float(np.ptp(corners(motion, np.array([0])), axis=0).max()) or 1.0
    robot = Group(scene, "robot", motion)
    _add_robot(robot, size, Style(opacity=GLASS if frames or inertia else None))
    groups = [robot]
    if other is not None:
        groups.append(Group(scene, "other", other))
        _add_robot(groups[-1], size, Style(GHOST, GHOST_OPACITY, GHOST_SCALE))
    groups += [Group(scene, "joint axes", motion), Group(scene, "link frames", motion, frames)]
    _add_axes(groups[-2], size)
    for k in range(len(motion.model.link_names)):
        scene.add_frame(groups[-1].on(k, "axes"), axes_length=0.09 * size, axes_radius=0.003 * size, origin_radius=0.0)
    groups += [Group(scene, name, motion, inertia) for name in ("centres of mass", "inertia ellipsoids")]
    _add_masses(groups[-2], groups[-1], size)
    return groups


def corners(motion: Motion, frames: Array) -> Array:
    """Link origins, centres of mass and corners of the boxes around shapes in some frames, shape (points, 3) [m]."""
    poses = motion.poses[frames]
    carried = poses[:, motion.joint_links()]
    model = motion.model
    points = [poses[..., :3, 3], rotate(carried[..., :3, :3], model.com - model.joint_origin) + carried[..., :3, 3]]
    for shape in motion.shapes:
        T = poses[:, model.link_index(shape.link)] @ shape.pose
        points.append(rotate(T[:, None, :3, :3], _box(shape)) + T[:, None, :3, 3])
    return np.concatenate([x.reshape(-1, 3) for x in points])


def _box(shape: Shape) -> Array:
    """Corners of the box around a shape in its own frame, shape (8, 3) [m]."""
    if shape.mesh is not None:
        low, high = shape.mesh.vertices.min(axis=0), shape.mesh.vertices.max(axis=0)
    else:
        r = shape.size[0]
        halves = {"cylinder": (r, r, shape.size[-1] / 2), "sphere": (r, r, r)}
        high = np.array(halves.get(shape.kind, np.array(shape.size) / 2))
        low = -high
    return np.array([[x, y, z] for x in (low[0], high[0]) for y in (low[1], high[1]) for z in (low[2], high[2])])


def quaternions(R: Array) -> Array:
    """Unit quaternions (w, x, y, z) of rotations, shape (..., 4)."""
    from scipy.spatial.transform import Rotation

    xyzw: Array = Rotation.from_matrix(R.reshape(-1, 3, 3)).as_quat()
    return np.roll(xyzw, 1, axis=-1).reshape(*R.shape[:-2], 4)


def _add_robot(group: Group, size: float, style: Style) -> None:
    motion = group.motion
    faces = sum(len(shape.mesh.faces) for shape in motion.shapes if shape.mesh is not None)
    keep = min(1.0, MAX_FACES / max(faces, 1))
    number: dict[int, int] = {}
    for shape in motion.shapes:
        k = motion.model.link_index(shape.link)
        number[k] = number.get(k, 0) + 1
        own = shape.color or (*(x / 255 for x in TONES[k % 2]), 1.0)
        color = style.color or tuple(round(255 * x) for x in own[:3])
        opacity = style.opacity or (own[3] if own[3] < 1 else None)
        look = Style(color, opacity, style.scale)
        _add_shape(group.scene, group.on(k, f"{shape.kind} {number[k]}"), shape, look, keep)
    bare = [k for k in range(len(motion.model.link_names)) if k not in number]
    _add_lines(group, bare, size, style)


def _add_shape(scene: Any, name: str, shape: Shape, style: Style, keep: float) -> None:
    place = {"wxyz": quaternions(shape.pose[:3, :3]), "position": shape.pose[:3, 3]}
    look = place | style._asdict()
    if shape.mesh is not None:
        scene.add_mesh_simple(name, *simplified(shape.mesh.vertices, shape.mesh.faces, keep), side="double", **look)
    elif shape.kind == "cylinder":
        scene.add_cylinder(name, *shape.size, radial_segments=48, **look)
    elif shape.kind == "box":
        scene.add_box(name, dimensions=shape.size, **look)
    else:
        scene.add_icosphere(name, *shape.size, **look)


def simplified(vertices: Array, faces: Array, keep: float) -> tuple[Array, Array]:
    """A share of a mesh's faces, by quadric decimation, with vertices doubled along sharp edges for smooth shading."""
    import fast_simplification
    import trimesh

    mesh = trimesh.Trimesh(vertices, faces)  # merges equal vertices
    if keep < 1 and len(mesh.faces) > SMALL:
        points, triangles = mesh.vertices.astype(np.float32), mesh.faces.astype(np.int32)
        mesh = trimesh.Trimesh(*fast_simplification.simplify(points, triangles, target_reduction=1 - keep))
    mesh = trimesh.graph.smooth_shade(mesh, angle=CREASE)
    return mesh.vertices, mesh.faces


def _add_lines(group: Group, bare: list[int], size: float, style: Style) -> None:
    """Tubes from each link without shapes to its children or, at an end, to its centre of mass; their joints."""
    model = group.motion.model
    carriers = group.motion.joint_links()
    joints: dict[int, int] = {}
    for k in bare:
        children = [child for child, parent in enumerate(model.link_tree) if parent == k]
        for child in children:
            _add_line_to(group, k, child, size, style)
        moved = [i for i, carrier in enumerate(carriers) if carrier in (k, *children)]
        joints |= {i: carriers[i] for i in moved}
        if not children and k in carriers and model.mass[carriers.index(k)] > 0:
            i = carriers.index(k)
            _add_tube(group, k, "line", np.zeros(3), model.com[i] - model.joint_origin[i], 0.012 * size, style, LINE)
    for i, k in joints.items():
        half = model.axis[i] * (0.03 if model.is_revolute[i] else 0.05) * size
        sides = 32 if model.is_revolute[i] else 4
        _add_tube(group, k, "joint", -half, half, 0.028 * size, style, JOINT, sides)


def _add_line_to(group: Group, k: int, child: int, size: float, style: Style) -> None:
    """The line from a link's origin to its child's, or to the nearest point of the rail that the child slides on."""
    motion = group.motion
    poses = motion.poses
    seen = rotate_back(poses[:, k, :3, :3], poses[:, child, :3, 3] - poses[:, k, :3, 3])
    radius = 0.012 * size
    name = f"line to {motion.model.link_names[child].replace('/', ' ')}"
    near = seen[0]
    joints = motion.joint_links()
    if child in joints and not motion.model.is_revolute[joints.index(child)]:
        along = rotate(poses[0, k, :3, :3].T @ poses[0, child, :3, :3], motion.model.axis[joints.index(child)])
        reach = (seen - near) @ along
        ends = near + reach.min() * along, near + reach.max() * along
        _add_tube(group, k, f"rail of {name}", *ends, radius, style, LINE)
        near = near + np.clip(-near @ along, reach.min(), reach.max()) * along
    _add_tube(group, k, name, np.zeros(3), near, radius, style, LINE)


def _add_tube(
    group: Group, k: int, what: str, start: Array, end: Array, radius: float, style: Style, color: Any, sides: int = 24
) -> None:
    """A cylinder, or a prism, between two points of a link's frame."""
    length = float(np.linalg.norm(end - start))
    if length > 0:
        look = {"color": style.color or color, "opacity": style.opacity, "scale": style.scale}
        place = {"wxyz": _turning_z_to(end - start), "position": (start + end) / 2}
        smooth = {"radial_segments": sides, "flat_shading": sides < 8}
        group.scene.add_cylinder(group.on(k, what), radius, length, **look, **place, **smooth)


def _turning_z_to(direction: Array) -> Array:
    """The quaternion of a rotation that turns the z axis to a direction."""
    x, y, z = direction / np.linalg.norm(direction)
    q = np.array([1 + z, -y, x, 0.0]) if z > -1 + 1e-9 else np.array([0.0, 1.0, 0.0, 0.0])
    unit: Array = q / np.linalg.norm(q)
    return unit


def _add_axes(group: Group, size: float) -> None:
    model = group.motion.model
    radii = {"shaft_radius": 0.004 * size, "head_radius": 0.011 * size, "head_length": 0.03 * size}
    for i, k in enumerate(group.motion.joint_links()):
        points = np.stack([-0.1 * size * model.axis[i], 0.16 * size * model.axis[i]])
        group.scene.add_arrows(group.on(k, model.moving_joints[i].replace("/", " ")), points[None], AXIS, **radii)


def _add_masses(centres: Group, inertias: Group, size: float) -> None:
    """Centres of mass, and solid ellipsoids of the same mass and inertia, of the moving bodies."""
    model = centres.motion.model
    axes, half = ellipsoids(model)
    for i, k in enumerate(centres.motion.joint_links()):
        if model.mass[i] > 0:
            p = model.com[i] - model.joint_origin[i]
            centres.scene.add_icosphere(centres.on(k, "centre of mass"), 0.015 * size, CENTRE, position=p)
            scale = tuple(np.maximum(half[i], 1e-3 * size).tolist())
            look = {"wxyz": quaternions(axes[i]), "position": p, "scale": scale, "opacity": 0.5}
            inertias.scene.add_icosphere(inertias.on(k, "ellipsoid"), 1.0, ELLIPSOID, subdivisions=4, **look)


def ellipsoids(model: Model) -> tuple[Array, Array]:
    """Principal axes and half axes of solid ellipsoids that have the bodies' masses and inertias.

    Parameters
    ----------
    model : Model

    Returns
    -------
    axes : ndarray, shape (nb, 3, 3)
        Right-handed, in columns, in the bodies' frames.
    half : ndarray, shape (nb, 3)
        0 where the principal moments of inertia are those of no rigid body, or there is no mass [m].
    """
    moments, axes = np.linalg.eigh(model.inertia)
    axes[..., 0] *= np.sign(np.linalg.det(axes))[:, None]
    mass = np.where(model.mass > 0, model.mass, np.inf)[:, None]
    squares = 5 / mass * (moments.sum(axis=-1, keepdims=True) / 2 - moments)
    return axes, np.sqrt(np.maximum(squares, 0.0))
