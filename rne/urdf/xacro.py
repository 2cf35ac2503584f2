"""Files of the macro language xacro, which are URDF only after their macros are expanded."""

from __future__ import annotations

import os
import shlex
from pathlib import PurePath
from typing import Any

from .findings import Report, cut, echo, near_path
from .grammar import elements

NAMESPACE = "xacro}"  # how that of its elements ends, in all its versions


def check_expanded(root: Any, report: Report) -> bool:
    """True if nothing of xacro is left in what is read; otherwise an error that says how to expand the file."""
    for element, _ in elements(root):
        macros = [child for child in element if NAMESPACE in child.tag]
        values = [value for value in element.attrib.values() if "${" in value or "$(" in value]
        if macros or values:
            what = echo(values[0]) if values else f"<xacro:{cut(macros[0].tag.rpartition('}')[2])}>"
            where = element if values else macros[0]
            message = f"is a xacro file, not yet a URDF: there is {what}"
            report.error(where, "file", message, f"expand it: {_command(report.file)}")
            return False
    return True


def _command(file: str) -> str:
    path = PurePath(near_path(file))
    bare = path.name.removesuffix(".xacro")
    if bare == path.name:  # xacro in a file called .urdf
        bare = f"{path.stem}_expanded.urdf"
    elif not bare.endswith(".urdf"):
        bare += ".urdf"
    return f"xacro {shlex.quote(os.fspath(path))} > {shlex.quote(os.fspath(path.with_name(bare)))}"
