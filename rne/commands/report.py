"""Pages: `rne` without a subcommand and rne report about the ABB IRB 140, rne report ROBOT about any robot."""

from __future__ import annotations

import argparse
import contextlib
import io
from pathlib import Path
from typing import Any

from .check import file_of
from .shared import ROBOT, CommandError, add_parser, check_file, check_folder, say

FOLDER = Path("rne-report")


def add_out(parser: argparse.ArgumentParser, default: Any) -> None:
    """The option for the folder of a page."""
    text = "folder of the page, made if it does not exist (default: rne-report)"
    parser.add_argument("--out", metavar="DIR", type=Path, default=default, help=text)


def add(commands: Any) -> None:
    """Register the subcommand."""
    title = "write a page on a robot, or on the thesis's experiments (two minutes)"
    parser = add_parser(commands, "report", title, "rne report arm.urdf --out arm-page")
    parser.add_argument("robot", metavar="ROBOT", nargs="?", help=f"{ROBOT}; without it, the thesis's experiments")
    add_out(parser, argparse.SUPPRESS)  # where it is not given here, that before the subcommand holds
    parser.add_argument("--markdown", metavar="FILE", type=Path, help="also write the page there, such as thesis.md")
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Write the page on the robot, or simulate every experiment of the thesis; 1 if a comparison exceeds its bound."""
    if arguments.robot is not None:
        return _run_robot_page(arguments)
    from ..thesis.experiments_page import run

    check_file(arguments.markdown, "--markdown")
    check_folder(arguments.out)
    run(arguments.out, say, arguments.markdown)
    return 0


def _run_robot_page(arguments: argparse.Namespace) -> int:
    import rne

    from ..urdf.loading import BUILDERS
    from .robot_page import write_robot_page

    if arguments.markdown is not None:
        raise CommandError("--markdown: is for the thesis's experiments, without ROBOT")
    robot = rne.load(arguments.robot)
    check_folder(arguments.out)
    printed = io.StringIO()
    if arguments.robot not in BUILDERS or Path(arguments.robot).exists():
        with contextlib.redirect_stdout(printed):
            rne.check(file_of(arguments.robot))
    return 0 if write_robot_page(robot, printed.getvalue().strip(), arguments.out, say) else 1


def run_main_page(arguments: argparse.Namespace) -> int:
    """Write the main page; 1 if a comparison exceeds its bound."""
    from ..thesis.main_page import run

    check_folder(arguments.out)
    return 0 if run(arguments.out, say) else 1
