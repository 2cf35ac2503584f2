"""Command line: rne [COMMAND ...], also as python -m rne; the commands are in rne/commands."""

from __future__ import annotations

import argparse
import io
import os
import sys
from collections.abc import Callable, Sequence
from pathlib import Path

from .commands import COMMANDS
from .commands.printing import FOLDER, add_out, run_main_page
from .commands.shared import CommandError, Parser, add_force, as_options, fail, in_one_line, join_numbers, note, work
from .errors import RneError


def main(argv: Sequence[str] | None = None) -> int:
    """Run a command, by default that of the process's arguments.

    Returns the exit code: 0 on success; 1 if a file has errors, robots differ, a comparison exceeds its bound or a
    computation fails; 2 for a wrong call or a file that cannot be used; 130 if it was interrupted.
    """
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            # Files and pipes are UTF-8 on every platform; a console may not have all characters of names.
            stream.reconfigure(encoding=None if stream.isatty() else "utf-8", errors="backslashreplace")
    arguments, unknown = parser().parse_known_args(join_numbers(sys.argv[1:] if argv is None else argv))
    if unknown:
        arguments.parser.error(f"unrecognized arguments: {' '.join(unknown)}")
    run: Callable[[argparse.Namespace], int] = arguments.run
    try:
        with work.reported():
            code = run(arguments)
        sys.stdout.flush()
        return code
    except BrokenPipeError:  # the reader of the output, such as head, has seen enough
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 1
    except KeyboardInterrupt as interrupt:
        note(f"interrupted{f': {interrupt}' if interrupt.args else ''}")
        return 130  # as shells say it
    except (CommandError, RneError, ValueError, OSError, ImportError) as error:
        return fail(as_options(in_one_line(error), arguments))


def parser() -> argparse.ArgumentParser:
    """The parser of all commands."""
    import rne

    as_module = Path(sys.argv[0]).name == "__main__.py"
    top = Parser(
        prog="python -m rne" if as_module else "rne",
        description="Dynamics of robot manipulators. Without a command: a report on the ABB IRB 140, with pictures.",
        epilog="rne COMMAND --help shows options of a command, and an example. Exit codes: 0 all went well, 1 a file "
        "has errors, robots differ or a computation fails, 2 a wrong call or file, 130 interrupted.",
    )
    top.set_defaults(run=run_main_page, parser=top)
    top.add_argument("--version", action="version", version=f"rne {rne.__version__}")
    add_out(top, FOLDER)
    add_force(top, False)
    commands = top.add_subparsers(title="commands", metavar="COMMAND")
    for add in COMMANDS:
        add(commands)
    return top


if __name__ == "__main__":
    sys.exit(main())
