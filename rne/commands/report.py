"""The two pages about the ABB IRB 140: `rne` without a subcommand, and rne report."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from .shared import add_parser, check_file, check_folder, say

FOLDER = Path("rne-report")


def add_out(parser: argparse.ArgumentParser, default: Any) -> None:
    """The option for the folder of a page."""
    text = "folder of the page, made if it does not exist (default: rne-report)"
    parser.add_argument("--out", metavar="DIR", type=Path, default=default, help=text)


def add(commands: Any) -> None:
    """Register the subcommand."""
    title = "write a page on the thesis's experiments (two minutes)"
    parser = add_parser(commands, "report", title, "rne report --out thesis-page")
    add_out(parser, argparse.SUPPRESS)  # where it is not given here, that before the subcommand holds
    parser.add_argument("--markdown", metavar="FILE", type=Path, help="also write the page there, such as thesis.md")
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Simulate every experiment and write the page."""
    from ..thesis.experiments_page import run

    check_file(arguments.markdown, "--markdown")
    check_folder(arguments.out)
    run(arguments.out, say, arguments.markdown)
    return 0


def run_main_page(arguments: argparse.Namespace) -> int:
    """Write the main page; 1 if a comparison exceeds its bound."""
    from ..thesis.main_page import run

    check_folder(arguments.out)
    return 0 if run(arguments.out, say) else 1
