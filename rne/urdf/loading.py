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


def load(source: str | os.PathLike[str], *, gravity: ArrayLike = STANDARD_GRAVITY, engine: str = "numpy") -> Robot:
    """Load a robot by name or from a URDF file.

    Parameters
    ----------
    source : str or path-like
        "irb140", for which no file is read, or the path of a URDF file.
    gravity : array_like, shape (3,)
        In the axes of the root link [m/s^2].
    engine : {"numpy", "numba"}
        What runs the robot's kernels; see `rne.compile`.

    Returns
    -------
    Robot

    Raises
    ------
    UrdfError
        For the first error in the file, naming file, element and attribute.
    FileNotFoundError
        If it is neither a robot's name nor a file.
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
    if not os.path.exists(source):
        raise FileNotFoundError(f"{os.fspath(source)!r} is neither a robot ({', '.join(BUILDERS)}) nor a file")
    return Robot(read_urdf(source, gravity=g), engine)
