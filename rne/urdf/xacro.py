"""Expansion of a xacro file, a program that makes URDF, by xacrodoc."""

from __future__ import annotations

import copy
import os
from collections.abc import Mapping
from typing import Any

from ..basics.text import cut, plain
from .findings import ECHO, FindingsReport, listed, near_path

Options = Mapping[str, Any] | None  # arguments or packages of a xacro file
LONG = 3 * ECHO  # most characters of an error of xacro


class _Arguments(dict[str, str]):
    """Arguments of a xacro file that record which of them it has."""

    def __init__(self, values: Mapping[str, Any]) -> None:
        super().__init__({name: str(value) for name, value in values.items()})
        self.known: set[object] = set()

    def __contains__(self, name: object) -> bool:
        self.known.add(name)
        return super().__contains__(name)

    def __getitem__(self, name: str) -> str:
        self.known.add(name)
        return super().__getitem__(name)


def expanded(report: FindingsReport, arguments: Options, packages: Options) -> str | None:
    """URDF text made by the report's xacro file, with absolute paths of meshes.

    None with an error, or without one if xacrodoc is not installed. A xacro file may read other files, environment
    variables and ROS packages.
    """
    try:
        from xacrodoc import packages as finders
        from xacrodoc import xacrodoc
    except ImportError:
        return None
    path = os.path.abspath(report.file)
    given, finder = _Arguments(arguments or {}), finders._finder
    finders._finder = copy.copy(finder)  # the folders given are those of this call
    finders._finder.finder_funcs, finders._finder.package_cache = list(finder.finder_funcs), dict(finder.package_cache)
    try:
        finders.update_package_cache(dict(packages or {}))
        xacrodoc.xacro.init_stacks(path)  # includes are relative to the file
        text: str = xacrodoc.XacroDoc.from_file(path, subargs=given).to_urdf_string()
    except Exception as error:  # whatever its expressions raise
        message = cut(plain(" ".join(f"{type(error).__name__}: {error}".split())), LONG)
        cure = "fix the file, or give what it needs by `arguments` and `packages`"
        report.error(None, "file", f"xacro says: {message}", cure)
        return None
    finally:
        finders._finder = finder
    if "<link" not in text:
        from lxml import etree

        if names := [str(macro.get("name")) for macro in etree.parse(path).iter("{*}macro")]:
            message = f"there is no <link>, as no macro is called; it defines {listed(names)}"
            report.error(None, "robot", message, "give a file that includes this one and calls them")
            return None
    unknown = [name for name in given if name not in given.known]
    if unknown:
        raise ValueError(f"`arguments` has {listed(unknown)}, which {near_path(report.file)} does not use")
    return text
