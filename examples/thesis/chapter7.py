"""Sections of the page on chapter 7: equilibria, and Newton-Euler beside Euler-Lagrange."""

from functools import partial
from typing import Any

import numpy as np

from rne.plotting.html_page import Report

from . import figures, verdicts
from . import numbered_figures as numbered
from .chapter6 import BEYOND, figure_of_the_thesis
from .formulations import CONTROLLED, FREE, STARTS, TABLE, Motion, Pair, slower, torque_difference

LOOPS = ("6.5-1", "6.5-2", "6.5-3")


def equilibria(page: Report, found: dict[str, Any]) -> None:
    """7.1, with figures 7.1 and 7.2."""
    pairs = {run: found[f"chapter 7, run {run}"] for run in STARTS}
    page.heading("7.1: the same motions by Euler-Lagrange")
    page.text(
        "Claim: 7.1-1 stays at rest in both formulations; 7.1-2 is unstable, and the two motions are similar but not "
        "identical. The Euler-Lagrange model of chapter 7 counts q3 the other way, (7.4) and (7.10): so it does here, "
        "simulated from its own equations."
    )
    page.table(
        ["run", "simulated", "largest difference of a joint", "0.1 rad from the start, Newton-Euler", "Euler-Lagrange"],
        [[run, f"{FREE:g} s", f"{farthest(p):.0e} rad", *map(leaves, p)] for run, p in pairs.items()],
    )
    page.text(f"7.1-1 with tight tolerances: {verdicts.held(found['equilibrium 7.1-1'], 10.0)}")
    page.text(verdicts.alike(farthest(pairs["7.1-2"])))
    for number, run in (("7.1", "7.1-1"), ("7.2", "7.1-2")):
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


def closed_loops(page: Report, found: dict[str, Any]) -> None:
    """7.2.2, with figures 7.3 to 7.5."""
    runs = [found[f"figure 7.{k + 3}"] for k in range(3)]
    pairs = {run: found[f"chapter 7, run {run}"] for run in LOOPS}
    page.heading("7.2.2: the closed loops by Euler-Lagrange")
    page.text(
        "The thesis gives its Euler-Lagrange model the numbers (6.61) to (6.69) as they are. As q3 counts the other "
        "way there, these are other motions of the arm than those of 6.5. Claim: that is why the transients differ; "
        f"stopped at {CONTROLLED:g} s, the runs are just short of their steady state."
    )
    page.table(
        ["figure", "within 0.01 rad after", f"largest error at {CONTROLLED:g} s", "farthest from", "by", "joint"],
        [
            [
                f"7.{k + 3}",
                verdicts.seconds([run.settled]),
                f"{run.left:.4f} rad",
                f"figure 6.{11 + 2 * k}",
                f"{np.abs(run.distance).max():.3f} rad",
                f"joint_{1 + np.abs(run.distance).max(axis=0).argmax()}",
            ]
            for k, run in enumerate(runs)
        ],
    )
    numbers, motions = [float(np.abs(r.distance).max()) for r in runs], [farthest(p) for p in pairs.values()]
    page.text(f"Transients: {verdicts.other_motions(numbers, motions)}")
    for k, run in enumerate(runs):
        number = f"7.{k + 3}"
        figure_of_the_thesis(page, number, partial(numbered.same_numbers, number, run))
    page.heading(f"{BEYOND}: one motion by both formulations", 3)
    page.text(
        "With q3 turned in start and reference, the Euler-Lagrange model makes the motions of 6.5 themselves, and the "
        "two formulations agree to the errors of their solvers."
    )
    page.figure("formulations", lambda: figures.plot_formulations(pairs), "Difference of the formulations")


def farthest(pair: Pair) -> float:
    """Largest difference of a joint in one motion by both formulations [rad]."""
    return float(np.abs(pair.difference).max())


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
        "One motion by both formulations here, in the tolerances of the table in 7.1, both traced into kernels "
        "and run by SciPy's solver; the times are those of this run of the page, beside which other simulations ran:"
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
