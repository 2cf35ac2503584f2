"""Paths of files to write."""

from __future__ import annotations

import os
from pathlib import Path


def output_file(path: str | os.PathLike[str], *suffixes: str) -> Path:
    """The path of a file in an existing folder, with one of the endings if any are given.

    The first ending is the one that an error names.
    """
    if not isinstance(path, str | os.PathLike):
        raise TypeError(f"`path` must be a str or path-like, got {type(path).__name__}")
    file = Path(path)
    if suffixes and file.suffix.lower() not in suffixes:
        raise ValueError(f"`path` must end in {suffixes[0]}, got {file.name!r}")
    if not file.parent.is_dir():
        raise FileNotFoundError(f"`path` must be in an existing folder, got {str(file)!r}")
    return file
