"""Visual shapes of a robot's links: the cylinders of its model, or all <visual> elements of its URDF file."""

from __future__ import annotations

import os
import warnings
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ..basics.spatial import Array, rotation_from_rpy
from ..model.model import Model
from ..model.solids import Cylinder

INSTALL = "pip install 'rne[view]'"
NAMED = 4  # shapes named in a warning; the others are counted
SIZES = {"cylinder": ("radius", "length"), "box": ("size",), "sphere": ("radius",)}


class Mesh(NamedTuple):
    """Triangles: vertices in the shape's frame, shape (V, 3) [m], and their indices, shape (F, 3)."""

    vertices: Array
    faces: Array


@dataclass(frozen=True, eq=False)
class Shape:
    """A visual shape of a link.

    Attributes
    ----------
    link : str
    kind : {"cylinder", "box", "sphere", "mesh"}
    size : tuple of float
        Radius and length along z of a cylinder, edges of a box along x, y and z, radius of a sphere; () for a mesh [m].
    pose : ndarray, shape (4, 4)
        Of the shape's frame, which is in the middle of a cylinder, box or sphere, in the link's frame [1, m].
    color : tuple of float, or None
        Red, green, blue and opacity from 0 to 1, where the file gives them.
    mesh : Mesh or None
        The triangles of a mesh.
    """

    link: str
    kind: str
    size: tuple[float, ...]
    pose: Array
    color: tuple[float, float, float, float] | None = None
    mesh: Mesh | None = None


def link_shapes(model: Model) -> list[Shape]:
    """The visual shapes of a robot's links.

    Parameters
    ----------
    model : Model

    Returns
    -------
    list of Shape
        Those of the URDF file the robot was read from, by yourdfpy and trimesh; the cylinders of `model.shapes` for a
        robot without a file. The shapes are in the links' frames, so that a robot with a payload, with joints locked
        or mounted otherwise keeps them.

    Warns
    -----
    UserWarning
        One for all shapes that are lost, which names the links and why: a mesh is not found or not readable, or
        yourdfpy is not installed.

    Examples
    --------
    >>> import rne
    >>> from rne.plotting.shapes import link_shapes
    >>> [(shape.link, shape.kind) for shape in link_shapes(rne.irb140())][:2]
    [('link_1', 'cylinder'), ('link_2', 'cylinder')]
    """
    shapes = [_from_model(cylinder) for cylinder in model.shapes]
    if model.source is None:
        return shapes
    try:
        read, lost = _from_file(model.source, os.stat(model.source).st_mtime_ns)
    except FileNotFoundError:
        lost = (f"all but cylinders: file {model.source!r} is not there any more",)
    except ModuleNotFoundError:
        lost = _beside_cylinders(model.source)
    else:
        shapes = [shape for shape in read if shape.link in model.link_names]
    if lost:
        more = f" and {len(lost) - NAMED} more" if len(lost) > NAMED else ""
        text = f"robot {model.name!r}: visual shapes are not shown: {'; '.join(lost[:NAMED])}{more}"
        warnings.warn(f"{text}; links without shapes are drawn as lines", stacklevel=2)
    return shapes


def _from_model(cylinder: Cylinder) -> Shape:
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = rotation_from_rpy(np.array(cylinder.rpy)), cylinder.position
    return Shape(cylinder.link, "cylinder", (cylinder.radius, cylinder.length), pose)


def _beside_cylinders(source: str) -> tuple[str, ...]:
    """What is lost of a file without yourdfpy."""
    from lxml import etree

    kinds = {geometry.tag for geometry in etree.parse(source).iterfind("link/visual/geometry/*")} - {"cylinder"}
    found = ", ".join(f"<{kind}>" for kind in sorted(str(kind) for kind in kinds))
    return (f"{found} need yourdfpy, which is not installed: {INSTALL}",) if found else ()


@lru_cache(maxsize=8)
def _from_file(source: str, changed: int) -> tuple[tuple[Shape, ...], tuple[str, ...]]:
    """The shapes of a URDF file as of its last change, and what is lost of it."""
    import yourdfpy

    robot = yourdfpy.URDF.load(source, build_scene_graph=False, load_meshes=False).robot
    colors = {material.name: material.color for material in robot.materials if material.color is not None}
    shapes: list[Shape] = []
    lost: list[str] = []
    for link in robot.links:
        for visual in link.visuals:
            try:
                shapes += _shapes_of(link.name, visual, colors, Path(source).parents)
            except (ValueError, TypeError, OSError) as error:  # TypeError: yourdfpy's for an attribute that is missing
                lost.append(f"link {link.name!r}: {error}")
    return tuple(shapes), tuple(lost)


def _shapes_of(link: str, visual: Any, colors: dict[str, Any], folders: Sequence[Path]) -> Iterator[Shape]:
    pose = np.eye(4) if visual.origin is None else np.array(visual.origin, dtype=float)
    color = _color(visual.material, colors)
    for kind, names in SIZES.items():
        given = getattr(visual.geometry, kind)
        if given is not None:
            size = np.hstack([getattr(given, name) for name in names]).astype(float)
            _check(f"<{kind}>", pose, size)
            yield Shape(link, kind, tuple(size.tolist()), pose, color)
    mesh = visual.geometry.mesh
    if mesh is not None:
        scale = np.broadcast_to(1.0 if mesh.scale is None else mesh.scale, 3).astype(float)
        _check(f"mesh {mesh.filename!r}", pose, np.abs(scale))
        for part, own in _parts(_find(mesh.filename, folders), mesh.filename):
            yield Shape(link, "mesh", (), pose, color or own, Mesh(part.vertices * scale, part.faces))


def _check(what: str, pose: Array, size: Array) -> None:
    if not (np.isfinite(pose).all() and np.isfinite(size).all() and (size > 0).all()):
        raise ValueError(f"{what} has a size or origin that is not positive and finite")


def _color(material: Any, colors: dict[str, Any]) -> tuple[float, float, float, float] | None:
    if material is None:
        return None
    color = material.color or colors.get(material.name)
    return None if color is None else _rgba(color.rgba)


def _rgba(values: Any) -> tuple[float, float, float, float]:
    r, g, b, a = np.clip(np.array(values, dtype=float), 0, 1).tolist()
    return r, g, b, a


def _find(name: str, folders: Sequence[Path]) -> Path:
    """The file of a mesh in or above the URDF's folder, with the name of its package as a folder and without."""
    from yourdfpy import filename_handler_ignore_directive, filename_handler_ignore_directive_package

    handlers: tuple[Callable[[str], str], ...] = (
        filename_handler_ignore_directive,
        filename_handler_ignore_directive_package,
    )
    for folder in folders:
        for handler in handlers:
            file = folder / handler(name)
            if file.is_file():
                return file
    raise FileNotFoundError(f"mesh {name!r} is not found")


def _parts(file: Path, name: str) -> Iterator[tuple[Mesh, tuple[float, float, float, float] | None]]:
    """The meshes of a file in its own frame, each with its colour where it has one."""
    import trimesh

    try:
        scene = trimesh.load_scene(file)
    except Exception as error:  # each of trimesh's readers raises its own
        raise ValueError(f"mesh {name!r} is not readable ({type(error).__name__}: {error})") from None
    found = False
    for part in scene.dump():
        if isinstance(part, trimesh.Trimesh) and len(part.faces) and np.isfinite(part.vertices).all():
            found = True
            yield Mesh(np.array(part.vertices), np.array(part.faces)), _own_color(part.visual)
    if not found:
        raise ValueError(f"mesh {name!r} has no triangles")


def _own_color(visual: Any) -> tuple[float, float, float, float] | None:
    """The main colour of a mesh, or None where it has none."""
    if not visual.defined:
        return None
    material = getattr(visual, "material", None)
    main = visual.main_color if material is None else material.main_color
    return _rgba(np.array(main) / 255)
