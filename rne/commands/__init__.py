"""The subcommands of the command line, one module each: its `add` registers the parser, whose `run` does the work.

A new subcommand is a module with `add`, and its place in `COMMANDS`, which is the order of `rne --help`.
"""

from . import check, report, simulate, source, torques, urdf, view

COMMANDS = (check, view, simulate, torques, source, urdf, report)
