"""Robots by name or from a file."""

from __future__ import annotations

import difflib
import os
from collections import Counter
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path

from numpy.typing import ArrayLike

from ..basics.arrays import real_array
from ..model.abb_irb140 import irb140
from ..model.model import STANDARD_GRAVITY, Model
from ..robot import Robot
from .read import read_urdf

PACKAGE = "example-robot-data"
BUILDERS: dict[str, Callable[[], Model]] = {"irb140": irb140}  # the built-in robots, for which no file is read


@cache
def urdf_files() -> dict[str, Path]:
    """URDF files of example-robot-data by "folder/file" without suffix; empty without that package."""
    import importlib.metadata  # slow to load, and only this function needs it

    try:
        files = importlib.metadata.files(PACKAGE) or []
    except importlib.metadata.PackageNotFoundError:
        return {}
    urdfs = sorted((file for file in files if file.suffix == ".urdf"), key=str)
    folder = [file.parts[file.parts.index("robots") + 1] for file in urdfs]
    return {f"{f}/{file.stem}": Path(str(file.locate())) for f, file in zip(folder, urdfs, strict=True)}


def library() -> dict[str, Path]:
    """The same by name: that of the file, "ur5" for "ur5_robot", and "folder/file" where two folders have the same."""
    count = Counter(path.stem for path in urdf_files().values())
    found = {}
    for folder_and_file, path in urdf_files().items():
        short = path.stem.removesuffix("_robot")
        name = path.stem if count[path.stem] == 1 else folder_and_file
        found[name if short in count else short] = path
    return found


def robots() -> tuple[str, ...]:
    """Names that `rne.load` takes: built-in robots first, then those of the package example-robot-data.

    Returns
    -------
    tuple of str
        Without example-robot-data (`pip install 'rne[robots]'`) the built-in ones alone.

    Examples
    --------
    >>> import rne
    >>> rne.robots()[0]
    'irb140'
    """
    return (*BUILDERS, *(name for name in library() if name not in BUILDERS))


def unknown(name: str) -> str:
    """The error about a name that is neither a file nor a robot."""
    near = [x for x in robots() if x.lower() == name.lower()] or difflib.get_close_matches(name, robots(), n=3)
    hint = f"; did you mean {' or '.join(repr(x) for x in near)}?" if near else ""
    if not library():
        built_in = f"{name!r} is neither a file nor a built-in robot"
        return f"{built_in}; some 60 more, such as 'ur5', come with pip install 'rne[robots]'{hint.replace(';', ' -')}"
    return f"{name!r} is neither a file nor one of rne.robots(){hint}"


def load(source: str | os.PathLike[str], *, gravity: ArrayLike = STANDARD_GRAVITY, engine: str = "numpy") -> Robot:
    """Load a robot by name or from a URDF file.

    Parameters
    ----------
    source : str or path-like
        A name of `rne.robots()`, such as "irb140", or the path of a URDF file, which goes before a name. For "irb140"
        no file is read; the others are files of example-robot-data.
    gravity : array_like, shape (3,)
        In the axes of the root link [m/s^2].
    engine : {"numpy", "numba"}
        What runs the robot's kernels; see `rne.compile`.

    Returns
    -------
    Robot
        Its joints in the order of `joint_names`.

    Raises
    ------
    UrdfError
        For the first error in the file, naming file, element and attribute.
    FileNotFoundError
        If it is neither a file nor a robot's name; suggests names that are near.
    ValueError
        If `gravity` is not three finite numbers, or there is no such engine.
    ImportError
        If the engine is "numba" and Numba is not installed.

    Examples
    --------
    >>> import rne
    >>> rne.load("irb140").joint_names[0]
    'joint_1'
    """
    g = real_array("gravity", gravity, "(3,)")
    if g.shape != (3,):
        raise ValueError(f"`gravity` must have shape (3,), got {g.shape}")
    if isinstance(source, str) and source in BUILDERS:
        return Robot(replace(BUILDERS[source](), gravity=g), engine)
    name = os.fspath(source)
    if not os.path.isfile(source) and name in library():
        return Robot(read_urdf(library()[name], gravity=g), engine)
    if not os.path.exists(source):
        raise FileNotFoundError(unknown(name))
    return Robot(read_urdf(source, gravity=g), engine)
