"""Visual shapes of a robot's links: cylinders and boxes of its model, or what its URDF or MJCF file shows."""

from __future__ import annotations

import os
import warnings
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..basics.spatial import Array, rotate, rotation_from_rpy
from ..basics.text import cut
from ..model.model import Model
from ..model.solids import Box, Cylinder
from ..urdf.document import below, parse, read_bytes
from ..urdf.findings import ECHO, FindingsReport, echo, some
from ..urdf.mjcf import drawn, names_of, rotation_of

if TYPE_CHECKING:
    from trimesh import Trimesh

INSTALL = "pip install 'rne[view]'"
NAMED = 4  # most shapes named in a warning
SIDES = 32  # sides of the prism that approximates a cylinder, a multiple of 4
SHOWN = 3  # number of geom groups, from 0, that MuJoCo's viewer shows
NO_COLOR = (0.5, 0.5, 0.5, 1.0)  # MuJoCo's, of geoms whose material may have one
GEOMS = {2: "sphere", 3: "capsule", 4: "ellipsoid", 5: "cylinder", 6: "box", 7: "mesh"}  # numbers of mujoco.mjtGeom
Color = tuple[float, ...]
MESHES = (".stl", ".obj", ".dae", ".ply", ".glb", ".gltf", ".off")  # suffixes of files that are opened: no archives
LARGEST, OF_TRIANGLE = 2**27, 50  # size of the meshes of a robot, and of a triangle in STL [bytes]


@dataclass(frozen=True, eq=False)
class Shape:
    """Visual shape of a link; its frame is in the middle of a cylinder, box or sphere."""

    link: str
    kind: str  # "cylinder", "box", "sphere" or "mesh"
    pose: Array  # of the shape's frame in the link's, shape (4, 4) [1, m]
    color: Color | None = None  # red, green, blue and opacity from 0 to 1, where the file gives them
    radius: float = 0.0  # of a cylinder along z [m]
    length: float = 0.0
    size: tuple[float, ...] = ()  # of a box [m]
    mesh: Trimesh | None = None  # the triangles of other kinds, vertices in the shape's frame [m]

    def faces(self) -> Array:
        """Corners of the faces in the link's frame, shape (faces, 4, 3); triangles have their last one twice [m]."""
        if self.mesh is not None:
            own = self.mesh.triangles[:, [0, 1, 2, 2]]
        else:
            own = _box(self.size) if self.size else _cylinder(self.radius, self.length)
        return rotate(self.pose[:3, :3], own) + self.pose[:3, 3]


class PosedRobot:
    """Robot, its shapes, by default of its file, and the poses of its links, shape (frames, n_links, 4, 4) [1, m]."""

    def __init__(self, model: Model, poses: Array, shapes: Sequence[Shape] | None = None) -> None:
        T = poses.astype(np.float64)
        self.model, self.shapes = model, link_shapes(model) if shapes is None else shapes
        self.R, self.p = T[..., :3, :3], T[..., :3, 3]
        # Of the moving joints: the link that each carries, unit vectors along the axes, shape (frames, nb, 3), and the
        # bodies' centres of mass, in the frames of these links, shape (nb, 3), and of the root, (frames, nb, 3) [m].
        self.carried = [model.link_joints.index(joint) for joint in model.moving_joints]
        self.axes = rotate(self.R[:, self.carried], model.axis.astype(np.float64))
        self.com = (model.com - model.joint_origin).astype(np.float64)
        self.centres = rotate(self.R[:, self.carried], self.com) + self.p[:, self.carried]


def link_shapes(model: Model) -> list[Shape]:
    """Visual shapes in the links' frames: those of the URDF or MJCF file, or of a model without a file.

    One UserWarning lists the shapes that cannot be shown, with the reasons.
    """
    shapes = [_from_model(shape) for shape in model.shapes]
    if model.source is None:
        return shapes
    is_text = model.source.startswith("<")  # of xacro
    try:
        read, lost = _from_file(model.source, 0 if is_text else os.stat(model.source).st_mtime_ns)
    except FileNotFoundError:
        lost = (f"all but cylinders and boxes: file {model.source!r} is not there any more",)
    except ImportError as error:
        lost = _beyond_the_model(model.source, error.name)
    else:
        shapes = [shape for shape in read if shape.link in model.link_names]
    if lost:
        more = f" and {len(lost) - NAMED} more" if len(lost) > NAMED else ""
        text = f"robot {model.name!r}: visual shapes are not shown: {'; '.join(lost[:NAMED])}{more}"
        warnings.warn(f"{text}; links without shapes are drawn as lines", stacklevel=2)
    return shapes


def _from_model(shape: Cylinder | Box) -> Shape:
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = rotation_from_rpy(np.array(shape.rpy)), shape.position
    if isinstance(shape, Box):
        return Shape(shape.link, "box", pose, size=shape.size)
    return Shape(shape.link, "cylinder", pose, None, shape.radius, shape.length)


def _root(source: str) -> Any:
    """Root element of a file, or of the URDF text that xacro made."""
    report = FindingsReport(source)
    root = parse(source.encode() if source.startswith("<") else read_bytes(source, report) or b"", report)
    report.raise_first_error()
    return root


def _beyond_the_model(source: str, package: str | None) -> tuple[str, ...]:
    """Text on the shapes of a file that need a package."""
    root = _root(source)
    kinds = {geometry.tag for geometry in root.iterfind("link/visual/geometry/*")} - {"cylinder", "box"}
    found = some(f"<{cut(kind, ECHO)}>" for kind in sorted(kinds | {x.tag for x in root.iter("geom")}))
    cure = "pip install 'rne[mjcf]'" if package == "mujoco" else INSTALL
    return (f"{found} need {package}, which is not installed: {cure}",) if found else ()


@lru_cache(maxsize=8)
def _from_file(source: str, changed: int) -> tuple[tuple[Shape, ...], tuple[str, ...]]:
    """Shapes of a URDF or MJCF file as of its last change, and remarks on missing ones."""
    root = _root(source)
    if root.tag == "mujoco":
        return _from_mjcf(source)
    import yourdfpy
    from lxml import etree

    folders = [Path(os.sep)] if source.startswith("<") else _folders(Path(source))
    robot = yourdfpy.URDF.load(BytesIO(etree.tostring(root)), build_scene_graph=False, load_meshes=False).robot
    colors = {material.name: material.color for material in robot.materials if material.color is not None}
    shapes: list[Shape] = []
    lost: list[str] = []
    left = LARGEST
    for link in robot.links:
        for visual in link.visuals:
            try:
                mesh = visual.geometry.mesh
                file, size = (None, 0) if mesh is None else _find(mesh.filename, folders, left)
                left -= size
                shapes += _shapes_of(link.name, visual, colors, file)
            except (ValueError, TypeError, OSError) as error:  # TypeError: yourdfpy's for an attribute that is missing
                lost.append(f"link {link.name!r}: {error}")
    return tuple(shapes), tuple(lost)


def _from_mjcf(file: str) -> tuple[tuple[Shape, ...], tuple[str, ...]]:
    """Geoms of an MJCF file that MuJoCo's viewer shows; of a link with visual-only geoms, those alone."""
    from trimesh import Trimesh
    from trimesh.creation import icosphere

    m, lost = drawn(file)
    links, shapes, left = names_of(m, "body"), list[Shape](), LARGEST // OF_TRIANGLE
    gone = [f"mesh {name!r} is no file below that of the MJCF file" for name in lost]
    shown = [g for g in range(m.ngeom) if m.geom_group[g] < SHOWN]
    touched = {g: bool(m.geom_contype[g] or m.geom_conaffinity[g]) for g in shown}
    untouched = {m.geom_bodyid[g] for g in shown if not touched[g]}
    for g in (g for g in shown if not (touched[g] and m.geom_bodyid[g] in untouched)):
        pose, size, material, color = np.eye(4), m.geom_size[g], m.geom_matid[g], m.geom_rgba[g]
        pose[:3, :3], pose[:3, 3] = rotation_of(m.geom_quat[g]), m.geom_pos[g]
        color = _rgba(m.mat_rgba[material] if material >= 0 and np.allclose(color, NO_COLOR) else color)
        kind, link = GEOMS.get(int(m.geom_type[g]), ""), links[m.geom_bodyid[g]]
        if kind == "box":
            shapes.append(Shape(link, kind, pose, color, size=tuple((2 * size).tolist())))
        elif kind == "cylinder":
            shapes.append(Shape(link, kind, pose, color, float(size[0]), float(2 * size[1])))
        elif kind == "mesh":
            k = m.geom_dataid[g]
            if (left := left - int(m.mesh_facenum[k])) < 0:
                gone.append(f"link {link!r}: a mesh is beyond the {LARGEST // OF_TRIANGLE} triangles read for a robot")
                continue
            corners = m.mesh_vert[m.mesh_vertadr[k] :][: m.mesh_vertnum[k]]
            faces = m.mesh_face[m.mesh_faceadr[k] :][: m.mesh_facenum[k]]
            shapes.append(Shape(link, kind, pose, color, mesh=Trimesh(corners, faces)))
        elif kind:  # a ball, stretched
            ball = icosphere()
            corners = ball.vertices * (size if kind == "ellipsoid" else size[0])
            corners[:, 2] += (kind == "capsule") * size[1] * np.sign(corners[:, 2])
            shapes.append(Shape(link, "sphere", pose, color, mesh=Trimesh(corners, ball.faces)))
    return tuple(shapes), tuple(gone)


def _shapes_of(link: str, visual: Any, colors: dict[str, Any], file: Path | None) -> Iterator[Shape]:
    """Shapes of a <visual> element as yourdfpy reads it, and of the file of its mesh."""
    from trimesh.creation import icosphere

    pose = np.eye(4) if visual.origin is None else np.array(visual.origin, dtype=float)
    given = visual.material and (visual.material.color or colors.get(visual.material.name))
    color = _rgba(given.rgba) if given else None
    solids = {"cylinder": ("radius", "length"), "box": ("size",), "sphere": ("radius",)}
    for kind, names in solids.items():
        geometry = getattr(visual.geometry, kind)
        if geometry is not None:
            size = np.hstack([getattr(geometry, name) for name in names]).astype(float)
            _check(f"<{kind}>", pose, size)
            if kind == "cylinder":
                yield Shape(link, kind, pose, color, *size.tolist())
            elif kind == "box":
                yield Shape(link, kind, pose, color, size=tuple(size.tolist()))
            else:
                yield Shape(link, kind, pose, color, mesh=icosphere(radius=size[0]))
    mesh = visual.geometry.mesh
    if file is not None:
        scale = np.broadcast_to(1.0 if mesh.scale is None else mesh.scale, 3).astype(float)
        _check(f"mesh {echo(mesh.filename)}", pose, np.abs(scale))
        for part in _meshes(file, mesh.filename):
            look: Any = part.visual
            main = np.array(getattr(look, "material", look).main_color) / 255 if look.defined else None
            own = color or (None if main is None else _rgba(main))
            yield Shape(link, "mesh", pose, own, mesh=part.apply_transform(np.diag([*scale, 1.0])))


def _check(what: str, pose: Array, size: Array) -> None:
    if not (np.isfinite(pose).all() and np.isfinite(size).all() and (size > 0).all()):
        raise ValueError(f"{what} has a size or origin that is not positive and finite")


def _folders(file: Path) -> list[Path]:
    """Folders from which a URDF file, or the one that it links to, may read meshes: its own and its package's."""
    found: list[Path] = []
    for path in dict.fromkeys((file, file.resolve())):
        near = next((k for k, folder in enumerate(path.parents) if (folder / "package.xml").is_file()), 0)
        found += path.parents[: near + 1]
    return found


def _find(name: str, folders: Sequence[Path], left: int) -> tuple[Path, int]:
    """File of a mesh below one of the folders, with the name of its package as a folder or without; its size.

    A package without package.xml is the folder of its name above the URDF file's folder `urdf`.
    """
    from urllib.request import url2pathname

    place = name.split("://", 1)[-1]
    places = [place] + [place.partition("/")[2]] * name.startswith("package://")
    places += [url2pathname(name.removeprefix("file://"))] * name.startswith("file://")
    named = [x.parent for x in folders if x.name == "urdf" and name.startswith(f"package://{x.parent.name}/")]
    folders = [*folders, *named]
    found = (below(folder / place, *folders) for folder in folders for place in places)
    if (file := next(filter(None, found), None)) is None:
        there = " below the folder of the URDF file or of its package, which has a package.xml"
        raise FileNotFoundError(f"mesh {echo(name)} is not found{there}")
    if file.suffix.lower() not in MESHES:
        raise ValueError(f"mesh {echo(name)} is no file of {', '.join(MESHES)}")
    if (size := file.stat().st_size) > left:
        most = f"at most {LARGEST} bytes are read for a robot, meshes shown twice counted twice"
        raise ValueError(f"mesh {echo(name)} has {size} bytes, {left} remain: {most}; simplify meshes")
    return file, size


def _meshes(file: Path, name: str) -> list[Trimesh]:
    """Meshes of a file, in its own frame."""
    import trimesh

    try:
        parts = trimesh.load_scene(file).dump()
    except Exception as error:  # each of trimesh's readers raises its own
        raise ValueError(f"mesh {echo(name)} is not readable ({type(error).__name__}: {echo(error)})") from None
    found = [x for x in parts if isinstance(x, trimesh.Trimesh) and len(x.faces) and np.isfinite(x.vertices).all()]
    if not found:
        raise ValueError(f"mesh {echo(name)} has no triangles")
    return found


def _rgba(values: Any) -> Color:
    return tuple(np.clip(np.array(values, dtype=float), 0, 1).tolist())


def surface(shapes: Sequence[Shape]) -> Array:
    """Faces of one link's shapes as by `Shape.faces`, anticlockwise seen from outside; of meshes their convex hull."""
    parts = [shape.faces() for shape in shapes if shape.kind != "mesh"]
    meshes = [shape.faces().reshape(-1, 3) for shape in shapes if shape.kind == "mesh"]
    return np.concatenate([*parts, *([_hull(np.concatenate(meshes))] if meshes else [])])


def _hull(points: Array) -> Array:
    """Triangles of the convex hull of the points that are furthest in 162 directions."""
    from trimesh.convex import convex_hull
    from trimesh.creation import icosphere

    rays = icosphere(subdivisions=2).vertices.T
    kept: Array = points[np.unique((points @ rays).argmax(axis=0))]
    if len(kept) < 4:  # of a single triangle
        return kept[None, [0, len(kept) // 2, -1, -1]]
    with np.errstate(invalid="ignore"):  # a flat mesh has no volume, of which trimesh takes the centre
        triangles: Array = convex_hull(kept).triangles
    return triangles[:, [0, 1, 2, 2]]


def _cylinder(radius: float, length: float) -> Array:
    angle = np.linspace(0, 2 * np.pi, SIDES + 1)
    ring = np.stack([radius * np.cos(angle), radius * np.sin(angle), np.zeros(SIDES + 1)], axis=-1)
    up = np.array([0, 0, length / 2])
    sides = np.stack([ring[:-1] - up, ring[1:] - up, ring[1:] + up, ring[:-1] + up], axis=1)
    centre = np.zeros((SIDES // 2, 3))
    fan = np.stack([centre, ring[:-2:2], ring[1:-1:2], ring[2::2]], axis=1)
    return np.concatenate([sides, fan + up, fan[:, ::-1] - up])


def _box(size: Sequence[float]) -> Array:
    """The six faces, as x = +-1 with two of the axes exchanged in turn."""
    side = np.array([[1.0, -1, -1], [1, 1, -1], [1, 1, 1], [1, -1, 1]])
    faces = np.stack([np.roll(side, k, axis=1) for k in range(3)])
    corners: Array = np.concatenate([faces, -faces[:, ::-1]]) * np.array(size) / 2
    return corners
