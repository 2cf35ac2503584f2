"""Robots by name: the built-in ones, and the URDF files of the package example-robot-data where that is installed."""

from __future__ import annotations

import difflib
import importlib.metadata
from collections import Counter
from functools import cache
from pathlib import Path

from ..model.robots import BUILDERS

PACKAGE = "example-robot-data"


@cache
def library() -> dict[str, Path]:
    """URDF files of example-robot-data by name; empty without that package.

    A name is that of the file, or "folder/file" if two folders have the same; "ur5_robot" is "ur5", since no file is.
    """
    try:
        files = importlib.metadata.files(PACKAGE) or []
    except importlib.metadata.PackageNotFoundError:
        return {}
    urdfs = sorted((file for file in files if file.suffix == ".urdf"), key=str)
    count = Counter(file.stem for file in urdfs)
    found = {}
    for file in urdfs:
        folder, short = file.parts[file.parts.index("robots") + 1], file.stem.removesuffix("_robot")
        name = file.stem if count[file.stem] == 1 else f"{folder}/{file.stem}"
        found[name if short in count else short] = Path(str(file.locate()))
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
    near = difflib.get_close_matches(name, robots(), n=3)
    hint = f"; did you mean {' or '.join(repr(x) for x in near)}?" if near else ""
    more = "" if library() else " (more names: pip install 'rne[robots]')"
    return f"{name!r} is neither a file nor one of rne.robots(){hint}{more}"
