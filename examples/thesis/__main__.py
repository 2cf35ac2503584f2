"""The page of the thesis's experiments: what it claims, what is measured here, and why they differ.

python -m examples.thesis [--out DIR] [--markdown FILE]
"""

import sys
import time
from argparse import ArgumentParser
from collections.abc import Callable
from pathlib import Path

import rne
from rne.commands.pages import STRETCHED_OUT
from rne.commands.shared import CommandError, add_force, check_file, check_folder, fail, say
from rne.plotting.html_page import Report
from rne.plotting.robot_picture import small_picture

from . import chapter6, chapter7, machine, stiff
from .experiments import run_all
from .markdown import write_markdown

FOLDER = Path("thesis-report")
SECTIONS = (
    chapter6.holding,
    chapter6.swings,
    chapter6.loops,
    chapter6.variations,
    stiff.stiffness,
    stiff.sampled,
    chapter7.equilibria,
    chapter7.closed_loops,
    chapter7.costs,
    machine.limits,
    machine.printed,
    machine.bearings,
    machine.long_swing,
)


def run(folder: Path, say: Callable[[str], None], markdown: Path | None = None) -> None:
    """Simulate all experiments and write the page.

    Parameters
    ----------
    folder : Path
        For the HTML page and its pictures; made if it does not exist.
    say : callable
        Called with each line of progress and text.
    markdown : Path, optional
        Also write the page as Markdown, with its pictures in the folder `pictures` beside it.
    """
    started = time.perf_counter()
    page = Report("The thesis's experiments, measured", say, folder)
    page.text(
        "Høifødt 2011 simulated the ABB IRB 140 with ode45 at a relative tolerance of 1e-6. Each section says what "
        "it claims, what is measured here, and why they differ; its figures stand under their numbers, drawn from "
        "our runs. The text gives durations for 6.5 (5 s), figure 7.2 (10 s) and figures 7.3 to 7.5 (2.3 s), but no "
        "absolute tolerances and not the solver of its Euler-Lagrange model: all others are ours. A verdict names its "
        "criterion. The thesis's misprints are listed in errata.md; concordance.md says where each of its equations "
        "and figures is in the code. Joints are called joint_1 to joint_6 as in the model; the thesis writes q_1 to "
        "q_6."
    )
    page.figure("robot", lambda: small_picture(rne.load("irb140"), STRETCHED_OUT), "The arm at (0, π/2, -π/2, 0, 0, 0)")
    say("simulating in parallel processes")
    found = run_all(say)
    for section in SECTIONS:
        section(page, found)
    if markdown is not None:
        write_markdown(page, markdown)
    say(f"page: {page.write()}, in {time.perf_counter() - started:.0f} s")


def main() -> int:
    """Read the arguments, and write the page."""
    parser = ArgumentParser(prog="python -m examples.thesis", description="Simulate the thesis's experiments: 2 min.")
    parser.add_argument("--out", metavar="DIR", type=Path, default=FOLDER, help=f"folder of the page ({FOLDER})")
    parser.add_argument("--markdown", metavar="FILE", type=Path, help="also write the page there, such as thesis.md")
    add_force(parser)
    arguments = parser.parse_args()
    try:
        check_file(arguments.markdown, arguments, "--markdown", (".md",))
        check_folder(arguments.out, arguments)
        run(arguments.out, say, arguments.markdown)
    except (CommandError, OSError) as error:
        return fail(str(error))
    return 0


if __name__ == "__main__":
    sys.exit(main())
