"""The subcommands of the command line: each `add` registers a parser, whose `run` does the work.

A new subcommand is a function `add` in `COMMANDS`, which is the order of `rne --help`.
"""

from . import printing, report, simulate, torques, view

COMMANDS = (
    printing.add_check,
    view.add,
    simulate.add,
    torques.add,
    printing.add_source,
    printing.add_urdf,
    report.add,
)
