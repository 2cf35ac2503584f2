"""rne check: errors and warnings about URDF files."""

from __future__ import annotations

import argparse
import os
from typing import Any

from .shared import ROBOT, CommandError, add_parser, fail, in_one_line

FIRST = 4096  # bytes that are looked at
MARK = 8  # bytes that may precede "<": the mark of an encoding


def add(commands: Any) -> None:
    """Register the subcommand."""
    title = "print errors and warnings about URDF files"
    parser = add_parser(commands, "check", title, "rne check arm.urdf")
    parser.add_argument("files", metavar="FILE", nargs="+", help=ROBOT)
    parser.add_argument("--all", action="store_true", help="print findings that are alike one by one")
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Check every file, also after one that cannot be read."""
    import rne

    code = 0
    for file in arguments.files:
        try:
            findings = rne.check(file_of(file), grouped=not arguments.all)
        except (CommandError, OSError) as error:
            code = fail(in_one_line(error))
        else:
            code = max(code, int(any(finding.severity == "error" for finding in findings)))
    return code


def file_of(file: str) -> str | os.PathLike[str]:
    """The URDF file of a path or of a robot by name."""
    from ..urdf.loading import BUILDERS, library

    if os.path.isdir(file):
        raise CommandError(f"{file}: is a folder; a URDF file is needed")
    if os.path.isfile(file):
        with open(file, "rb") as stream:
            if b"<" not in stream.read(FIRST).lstrip()[:MARK]:
                raise CommandError(f"{file}: is not an XML file; a URDF file is needed")
        return file
    if file in BUILDERS:
        raise CommandError(f"robot {file!r} is built in and has no file; rne urdf {file} prints it")
    return library().get(file, file)
