"""Command line: python -m rne [report | check FILE | urdf NAME | source ROBOT ...]."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

QUANTITIES = (
    "inverse_dynamics",
    "mass_matrix",
    "forward_dynamics",
    "bias_torque",
    "gravity_torque",
    "coriolis_torque",
    "coriolis_matrix",
    "kinetic_energy",
    "potential_energy",
    "link_poses",
)
LANGUAGES = ("python", "numpy", "matlab", "c")


def main(argv: Sequence[str] | None = None) -> int:
    """Run a command; the exit code is 0 if all is well, 1 if something was found, 2 for a wrong call."""
    parser = argparse.ArgumentParser(prog="python -m rne", description="Dynamics of robot manipulators.")
    parser.add_argument(
        "--out", type=Path, default=Path("rne-report"), help="folder of the report (default: %(default)s)"
    )
    commands = parser.add_subparsers(dest="command", metavar="COMMAND", help="without one: the report on the IRB 140")
    check = commands.add_parser("check", help="print everything wrong or odd in a URDF file")
    check.add_argument("file")
    urdf = commands.add_parser("urdf", help="print a built-in robot as URDF")
    urdf.add_argument("name", help="irb140")
    source = commands.add_parser("source", help="print a quantity as straight-line source code")
    source.add_argument("robot", help="irb140 or a URDF file")
    source.add_argument("--quantity", default="inverse_dynamics", choices=QUANTITIES)
    source.add_argument("--language", default="python", choices=LANGUAGES)
    report = commands.add_parser("report", help="reproduce every experiment of the thesis, in about two minutes")
    report.add_argument("--markdown", type=Path, help="write the page there too, such as docs/thesis.md")
    arguments = parser.parse_args(argv)
    if arguments.command == "report":
        return _thesis(arguments.out, arguments.markdown)
    if arguments.command == "source":
        return _source(arguments.robot, arguments.quantity, arguments.language)
    if arguments.command == "check":
        return _check(arguments.file)
    if arguments.command == "urdf":
        return _urdf(arguments.name)
    return _report(arguments.out)


def _check(file: str) -> int:
    from .urdf import check

    try:
        findings = check(file)
    except OSError as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    return 1 if any(finding.severity == "error" for finding in findings) else 0


def _urdf(name: str) -> int:
    from .model.robots import BUILDERS
    from .urdf import to_urdf

    if name not in BUILDERS:
        print(f"error: no robot {name!r}; there are {', '.join(BUILDERS)}", file=sys.stderr)
        return 2
    print(to_urdf(BUILDERS[name]()), end="")
    return 0


def _source(robot: str, quantity: str, language: str) -> int:
    import rne

    try:
        print(rne.load(robot).kernel(getattr(rne, quantity)).source(language), end="")
    except (OSError, rne.RneError) as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    return 0


def _thesis(folder: Path, markdown: Path | None) -> int:
    from .thesis.experiments_page import run

    run(folder, lambda line: print(line, flush=True), markdown)
    return 0


def _report(folder: Path) -> int:
    from .thesis.main_page import run

    return 0 if run(folder, lambda line: print(line, flush=True)) else 1


if __name__ == "__main__":
    sys.exit(main())
