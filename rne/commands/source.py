"""rne source: a quantity of a robot as straight-line source code."""

from __future__ import annotations

import argparse
import inspect
from typing import Any

from .shared import ROBOT, CommandError, add_parser

LANGUAGES = ("python", "numpy", "matlab", "c")


def quantities() -> list[str]:
    """Names of the functions of a model that take joint arrays alone and return an array."""
    from .. import dynamics

    def takes_joint_arrays_alone(name: str) -> bool:
        declared = getattr(getattr(dynamics, name), "quantity", None)
        if declared is None or not declared.returns_array:
            return False
        parameters = inspect.signature(getattr(dynamics, name)).parameters.values()
        needed = [p.name for p in parameters if p.default is p.empty and p.name != "model"]
        return needed == list(declared.widths)

    return [name for name in dynamics.__all__ if takes_joint_arrays_alone(name)]


def add(commands: Any) -> None:
    """Register the subcommand."""
    title = "print a quantity as C, MATLAB, Python or NumPy code"
    parser = add_parser(commands, "source", title, "rne source irb140 --quantity mass_matrix --language c > M.c")
    parser.add_argument("robot", metavar="ROBOT", help=ROBOT)
    choices = quantities()
    default = f"{', '.join(choices)} (default: inverse_dynamics, or that of the element)"
    parser.add_argument("--quantity", metavar="QUANTITY", choices=choices, help=default)
    element = "one entry alone: m23 of M, c3 of C q', g2 of g, tau4, h1, qdd5; joints from 1, m2_13 beyond nine"
    parser.add_argument("--element", metavar="ELEMENT", help=element)
    parser.add_argument("--language", default="python", choices=LANGUAGES, help="(default: python)")
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Print the source."""
    import rne

    from ..kernels.source import quantity_of_element

    try:
        quantity = arguments.quantity or "inverse_dynamics"
        if arguments.element is not None and arguments.quantity is None:
            quantity = quantity_of_element(arguments.element)
        kernel = rne.load(arguments.robot).kernel(getattr(rne.dynamics, quantity))
        text = kernel.source(arguments.language, arguments.element)
    except (rne.RneError, ValueError, TypeError) as error:  # TypeError: the kernel is too large to be written out
        raise CommandError(str(error).replace("`element`", "--element")) from error
    print(text, end="")
    return 0
