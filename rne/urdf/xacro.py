"""Files of the macro language xacro, which are URDF only after their macros are expanded."""

from __future__ import annotations

import os
import shlex
from pathlib import PurePath
from typing import Any

from .findings import Report, near_path

TAG = "xacro}"  # how the namespace of its elements ends, in all its versions


def check_expanded(root: Any, report: Report) -> bool:
    """True if nothing of xacro is left; otherwise an error that says how to expand the file."""
    for element in root.iter():
        name = element.tag if isinstance(element.tag, str) else ""
        inside = any("${" in value for value in element.attrib.values())
        if TAG in name or inside:
            what = f"<xacro:{name.rpartition('}')[2]}>" if TAG in name else "${...}"
            message = f"is a xacro file with {what}, not yet a URDF"
            report.error(element, "file", message, f"expand it: {_command(report.file)}")
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
