"""Loading a robot by name or from a file."""

from __future__ import annotations

import os
from dataclasses import replace

from numpy.typing import ArrayLike

from ..basics.arrays import real_array
from ..model.model import STANDARD_GRAVITY
from ..model.robots import BUILDERS
from ..robot import Robot
from . import read_urdf
from .library import library, unknown


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
