"""Subcommands of the command line: each `add_...` registers a parser, whose `run` does the work.

A new subcommand is a function in `COMMANDS`, which is the order of `rne --help`.
"""

from . import identifying, moving, printing

COMMANDS = (
    printing.add_check,
    printing.add_compare,
    moving.add_view,
    moving.add_simulate,
    moving.add_torques,
    moving.add_cycle,
    identifying.add_identify,
    printing.add_source,
    printing.add_export,
    printing.add_urdf,
    printing.add_report,
    printing.add_cache,
)
