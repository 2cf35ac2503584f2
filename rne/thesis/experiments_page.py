"""The page of the thesis's experiments: what it claims, what is measured here, and why they differ."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path

from ..urdf.loading import load
from . import chapter6, chapter7, machine, stiff
from .experiments import UPRIGHT, run_all
from .figures import plot_robot
from .page import Page

SECTIONS = (
    chapter6.holding,
    chapter6.swings,
    chapter6.loops,
    chapter6.variations,
    stiff.stiffness,
    stiff.sampled,
    chapter7.equilibria,
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
    folder.mkdir(parents=True, exist_ok=True)
    page = Page("The thesis's experiments, measured", say, folder)
    page.text(
        "Høifødt 2011 simulated the ABB IRB 140 with ode45 at a relative tolerance of 1e-6. Each section says what "
        "it claims, what is measured here, and why they differ; its figures stand under their numbers, drawn from "
        "our runs. A verdict names its criterion. The thesis's misprints are listed in errata.md; concordance.md says "
        "where each of its equations and figures is in the code. Joints are called joint_1 to joint_6 as in the "
        "model; the thesis writes q_1 to q_6."
    )
    page.figure("robot", lambda: plot_robot(load("irb140"), UPRIGHT), "The arm at (0, π/2, -π/2, 0, 0, 0)")
    say("simulating in parallel processes")
    found = run_all(say)
    for section in SECTIONS:
        section(page, found)
    page.end()
    if markdown is not None:
        page.write_markdown(markdown)
    say(f"page: {page.write()}, in {time.perf_counter() - started:.0f} s")
