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
def urdf_files() -> dict[str, Path]:
    """URDF files of example-robot-data by "folder/file" without suffix; empty without that package."""
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
