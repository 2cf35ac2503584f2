"""rne urdf: a built-in robot as URDF."""

from __future__ import annotations

import argparse
from typing import Any

from .shared import CommandError, add_parser


def add(commands: Any) -> None:
    """Register the subcommand."""
    parser = add_parser(commands, "urdf", "print a built-in robot as URDF", "rne urdf irb140 > irb140.urdf")
    parser.add_argument("name", metavar="NAME", help="irb140")
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Print the file."""
    from ..urdf import to_urdf
    from ..urdf.loading import BUILDERS

    if arguments.name not in BUILDERS:
        raise CommandError(f"no robot {arguments.name!r}; there are {', '.join(BUILDERS)}")
    print(to_urdf(BUILDERS[arguments.name]()), end="")
    return 0
