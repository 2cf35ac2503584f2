"""Sections of the page on chapter 7: equilibria, and Newton-Euler beside Euler-Lagrange."""

from functools import partial
from typing import Any

import numpy as np

from rne.plotting.html_page import Report

from . import figures, verdicts
from . import numbered_figures as numbered
from .chapter6 import BEYOND, figure_of_the_thesis
from .formulations import RUNS, TABLE, Motion, Pair, slower, torque_difference

NUMBERS = dict(zip(("7.1", "7.2", "7.3", "7.4", "7.5"), RUNS, strict=True))


def equilibria(page: Report, found: dict[str, Any]) -> None:
    """7.1 and 7.2: figures 7.1 to 7.5."""
    pairs = {run: found[f"chapter 7, run {run}"] for run in RUNS}
    page.heading("7.1: the same motions by Euler-Lagrange")
    page.text(
        "Claim: 7.1-1 stays at rest in both formulations; 7.1-2 is unstable, and the two motions are similar but not "
        "identical. The Euler-Lagrange model of chapter 7 counts q3 the other way: it is simulated so here too, from "
        "its own equations, and its positions are turned back for comparison."
    )
    page.table(
        ["run", "simulated", "largest difference of a joint", "0.1 rad from the start, Newton-Euler", "Euler-Lagrange"],
        [[run, f"{p.newton.t[-1]:g} s", f"{difference(p):.0e} rad", *map(leaves, p)] for run, p in pairs.items()],
    )
    page.text(f"7.1-1 with tight tolerances: {verdicts.held(found['equilibrium 7.1-1'], 10.0)}")
    page.text(verdicts.alike(difference(pairs["7.1-2"])))
    for number, run in NUMBERS.items():
        figure_of_the_thesis(page, number, partial(numbered.formulations, number, pairs[run]))
    tipped, lagrange = found["equilibrium 7.1-2"], found["equilibrium 7.1-2, Euler-Lagrange"]
    page.heading(f"{BEYOND}: how fast 7.1-2 tips over", 3)
    page.text(
        "When 7.1-2 leaves its equilibrium depends on the errors of the solver. How fast a deviation grows does not: "
        f"{verdicts.grows(tipped.measured, tipped.rate)} By Euler-Lagrange: "
        f"{verdicts.grows(lagrange.measured, lagrange.rate)}"
    )
    caption = "Growth of 1e-6 rad at the unstable equilibrium"
    page.figure("tipping", lambda: figures.plot_tipping(tipped.motion, tipped.distance, tipped.rate), caption)


def difference(pair: Pair) -> float:
    """Largest difference of the joint positions by both formulations [rad]."""
    return float(np.abs(pair.newton.q - pair.lagrange.q).max())


def leaves(motion: Motion) -> str:
    """When a motion is first 0.1 rad from its start."""
    far = np.flatnonzero(np.abs(motion.q - motion.q[0]).max(axis=1) > 0.1)
    return f"after {motion.t[far[0]]:.3g} s" if len(far) else "never"


def costs(page: Report, found: dict[str, Any]) -> None:
    """Table 7.1."""
    page.heading("Table 7.1: Newton-Euler or Euler-Lagrange?")
    page.table(
        ["run", "Newton-Euler, thesis", "Euler-Lagrange, thesis", "ratio per simulated second"],
        [
            [run, *(f"{_duration(s)} for {simulated:g} s" for s, simulated in TABLE[run]), f"{slower(run):.0f}"]
            for run in TABLE
        ],
    )
    pairs = {run: found[f"chapter 7, run {run}"] for run in TABLE}
    page.text(
        "The same runs here, in the same tolerances as above, with both formulations traced into kernels; the times "
        "are those of this run of the page, beside which other simulations ran:"
    )
    page.table(
        ["run", "simulated", "Newton-Euler", "Euler-Lagrange", "evaluations", "ratio"],
        [
            [
                run,
                f"{p.newton.t[-1]:g} s",
                f"{p.newton.seconds:.2g} s",
                f"{p.lagrange.seconds:.2g} s",
                f"{p.newton.evaluations} and {p.lagrange.evaluations}",
                f"{p.lagrange.seconds / p.newton.seconds:.1f}",
            ]
            for run, p in pairs.items()
        ],
    )
    rows = found["formulations"]
    newton, lagrange = rows[-1], rows[-2]
    page.text("One evaluation of the inverse dynamics here:")
    page.table(
        ["formulation", "operations", "µs per evaluation", "relative to the Newton-Euler kernel"],
        [
            [r.name, str(r.operations or "-"), f"{r.microseconds:.1f}", f"{r.microseconds / newton.microseconds:.1f}"]
            for r in rows
        ],
    )
    ratio = lagrange.microseconds / newton.microseconds
    page.text(
        verdicts.formulations(ratio, slower("7.1-2"), torque_difference()) + " Batches: python -m benchmarks.lagrange."
    )


def _duration(seconds: float) -> str:
    if seconds < 60:
        return f"{seconds:g} s"
    return f"{seconds / 60:g} min" if seconds < 3600 else f"{seconds / 3600:g} h"
