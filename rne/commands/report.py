"""Pages: `rne` without a command about the ABB IRB 140, `rne report ROBOT` about any robot."""

from __future__ import annotations

import argparse
import io
from pathlib import Path
from typing import Any

from .shared import ROBOT, add_parser, check_folder, say

FOLDER = Path("rne-report")


def add_out(parser: argparse.ArgumentParser, default: Any) -> None:
    """The option for the folder of a page."""
    text = "folder of the page, made if it does not exist (default: rne-report)"
    parser.add_argument("--out", metavar="DIR", type=Path, default=default, help=text)


def add(commands: Any) -> None:
    """Register the subcommand."""
    parser = add_parser(commands, "report", "write a page on a robot", "rne report arm.urdf --out arm-page")
    parser.add_argument("robot", metavar="ROBOT", help=ROBOT)
    add_out(parser, argparse.SUPPRESS)  # where it is not given here, that before the subcommand holds
    parser.set_defaults(run=run)


def run_main_page(arguments: argparse.Namespace) -> int:
    """Write the main page; 1 if a comparison exceeds its bound."""
    from . import pages

    check_folder(arguments.out)
    return 0 if pages.write_main_page(arguments.out, say) else 1


def run(arguments: argparse.Namespace) -> int:
    """Write the page on the robot; 1 if a comparison exceeds its bound."""
    import rne

    from ..urdf.loading import resolve
    from . import pages

    robot = rne.load(arguments.robot)
    check_folder(arguments.out)
    printed = io.StringIO()
    if isinstance(resolve(arguments.robot), str):  # the path of a file
        rne.check(arguments.robot, out=printed)
    return 0 if pages.write_robot_page(robot, printed.getvalue().strip(), arguments.out, say) else 1
