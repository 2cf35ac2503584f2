"""Command line: rne [report | check FILE ... | urdf NAME | source ROBOT], also as python -m rne."""

from __future__ import annotations

import argparse
import inspect
import os
import sys
import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path

LANGUAGES = ("python", "numpy", "matlab", "c")
REPORT_FOLDER = Path("rne-report")


def main(argv: Sequence[str] | None = None) -> int:
    """Run a command.

    Parameters
    ----------
    argv : sequence of str, optional
        The arguments; those of the process if not given.

    Returns
    -------
    int
        Exit code: 0 on success, 1 if a file has errors or a comparison exceeds its bound, 2 for a wrong call.
    """
    arguments = _parser().parse_args(argv)
    run: Callable[[argparse.Namespace], int] = arguments.run
    try:
        code = run(arguments)
        sys.stdout.flush()
        return code
    except BrokenPipeError:  # the reader of the output, such as head, has seen enough
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 1
    except OSError as error:
        return _fail(_text(error))


def quantities() -> list[str]:
    """Names of the functions of a model that take joint arrays alone and return an array."""
    import rne

    def takes_joint_arrays_alone(name: str) -> bool:
        declared = getattr(getattr(rne, name), "quantity", None)
        if declared is None or not declared.returns_array:
            return False
        parameters = inspect.signature(getattr(rne, name)).parameters.values()
        needed = [p.name for p in parameters if p.default is p.empty and p.name != "model"]
        return needed == list(declared.widths)

    return [name for name in rne.__all__ if takes_joint_arrays_alone(name)]


def _parser() -> argparse.ArgumentParser:
    import rne

    as_module = Path(sys.argv[0]).name == "__main__.py"
    parser = argparse.ArgumentParser(
        prog="python -m rne" if as_module else "rne",
        description="Dynamics of robot manipulators. Without a command: a report on the ABB IRB 140, with pictures.",
    )
    parser.set_defaults(run=_main_page)
    parser.add_argument("--version", action="version", version=f"rne {rne.__version__}")
    out = "folder of the report, made if it does not exist (default: rne-report)"
    parser.add_argument("--out", metavar="DIR", type=Path, default=REPORT_FOLDER, help=out)
    commands = parser.add_subparsers(title="commands", metavar="COMMAND")
    check = commands.add_parser("check", help="print all errors and warnings on URDF files")
    check.add_argument("files", metavar="FILE", nargs="+")
    check.set_defaults(run=_check)
    urdf = commands.add_parser("urdf", help="print a built-in robot as URDF")
    urdf.add_argument("name", metavar="NAME", help="irb140")
    urdf.set_defaults(run=_urdf)
    source = commands.add_parser("source", help="print a quantity of a robot as straight-line source code")
    source.add_argument("robot", metavar="ROBOT", help="irb140, or the path of a URDF file")
    choices = quantities()
    default = f"{', '.join(choices)} (default: inverse_dynamics, or that of the element)"
    source.add_argument("--quantity", metavar="QUANTITY", choices=choices, help=default)
    element = "one entry alone: m23 of M, c3 of C q', g2 of g, tau4, h1, qdd5; joints from 1, m2_13 beyond nine"
    source.add_argument("--element", metavar="ELEMENT", help=element)
    source.add_argument("--language", default="python", choices=LANGUAGES)
    source.set_defaults(run=_source)
    report = commands.add_parser("report", help="simulate every experiment of the thesis; takes about two minutes")
    report.add_argument("--out", metavar="DIR", type=Path, default=argparse.SUPPRESS, help=out)
    report.add_argument("--markdown", metavar="FILE", type=Path, help="also write the page there, such as thesis.md")
    report.set_defaults(run=_thesis_page)
    return parser


def _check(arguments: argparse.Namespace) -> int:
    from .urdf import check

    code = 0
    for file in arguments.files:
        try:
            findings = check(file)
        except OSError as error:
            code = _fail(_text(error))
        else:
            code = max(code, int(any(finding.severity == "error" for finding in findings)))
    return code


def _urdf(arguments: argparse.Namespace) -> int:
    from .model.robots import BUILDERS
    from .urdf import to_urdf

    if arguments.name not in BUILDERS:
        return _fail(f"no robot {arguments.name!r}; there are {', '.join(BUILDERS)}")
    print(to_urdf(BUILDERS[arguments.name]()), end="")
    return 0


def _source(arguments: argparse.Namespace) -> int:
    import rne

    from .kernels.elements import quantity_of_element

    try:
        quantity = arguments.quantity or "inverse_dynamics"
        if arguments.element is not None and arguments.quantity is None:
            quantity = quantity_of_element(arguments.element)
        kernel = rne.load(arguments.robot).kernel(getattr(rne, quantity))
    except (rne.RneError, ValueError) as error:
        return _fail(str(error).replace("`element`", "--element"))
    try:
        print(kernel.source(arguments.language, arguments.element), end="")
    except ValueError as error:
        return _fail(str(error).replace("`element`", "--element"))
    except TypeError as error:  # the kernel is too large to be written out
        return _fail(str(error))
    return 0


def _main_page(arguments: argparse.Namespace) -> int:
    from .thesis.main_page import run

    problem = _folder_problem(arguments.out)
    if problem:
        return _fail(problem)
    return 0 if run(arguments.out, _say) else 1


def _thesis_page(arguments: argparse.Namespace) -> int:
    from .thesis.experiments_page import run

    problem = _file_problem(arguments.markdown) or _folder_problem(arguments.out)
    if problem:
        return _fail(problem)
    run(arguments.out, _say, arguments.markdown)
    return 0


def _folder_problem(folder: Path) -> str:
    """Make the folder and try to write into it, before anything long is computed."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            return ""
    except FileExistsError:
        return f"--out: cannot write into {str(folder)!r}: Not a directory"
    except OSError as error:
        return f"--out: cannot write into {str(folder)!r}: {error.strerror}"


def _file_problem(file: Path | None) -> str:
    if file is not None and file.is_dir():
        return f"--markdown: {str(file)!r} is a folder, not a file"
    if file is not None and not file.parent.is_dir():
        return f"--markdown: there is no folder {str(file.parent)!r}"
    return ""


def _text(error: OSError) -> str:
    return f"{error.filename}: {error.strerror}" if error.filename and error.strerror else str(error)


def _say(line: str) -> None:
    print(line, flush=True)


def _fail(message: str) -> int:
    print(f"error: {message}", file=sys.stderr)
    return 2


if __name__ == "__main__":
    sys.exit(main())
