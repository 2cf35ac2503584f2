"""Sections of the page on the stiffness of the closed loop, which the thesis does not mention."""

from typing import Any

import numpy as np

import rne
from rne.model.abb_irb140 import KD, KP
from rne.plotting.html_page import Report

from . import figures, verdicts
from .experiments import SAMPLE_TIMES, SOLVERS
from .formulations import closed_by_open


def stiffness(page: Report, found: dict[str, Any]) -> None:
    """Why the closed loop takes an explicit method so long."""
    observed = closed_by_open()
    page.heading("Why the closed loop took so much longer than the open one")
    page.text(
        f"In Table 7.1, 10 s of open loop take 6 s to compute, and 5 s of closed loop about 30 min, {observed:.0f} "
        "times as long for run 6.5-1; the thesis gives no reason. The closed loop is stiff: the wrist's drives act "
        "on 1.4e-3 kg m², so that M⁻¹Kd has a mode thousands of times faster than the motion, and the step of an "
        "explicit method is limited by it at any tolerance."
    )
    page.text(str(rne.check_gains(rne.load("irb140"), KP, KD, SAMPLE_TIMES[0])), "pre")
    loops = [found[f"loop {k}"] for k in range(3)]
    rows = []
    for method in (*SOLVERS, "auto"):
        runs = [loop[method] for loop in loops]
        differences = [_apart(r.motion, loop["Radau"].motion) for r, loop in zip(runs, loops, strict=True)]
        counts = " / ".join(str(r.motion.evaluations) for r in runs)
        rows.append([method, counts, " / ".join(f"{r.seconds:.2f}" for r in runs), f"{max(differences):.0e}"])
    page.table(
        ["method", "evaluations, runs 1 / 2 / 3", "wall time [s]", "difference from Radau at the end [rad]"], rows
    )
    explicit, stiff = ([loop[method].motion.evaluations for loop in loops] for method in ("RK45", "LSODA"))
    page.text(verdicts.stiffness(explicit, stiff, found["chapter 7, run 7.1-2"].newton.evaluations, observed))
    ratios = [loop["RK45"].seconds / loop["auto"].seconds for loop in loops]
    page.text(
        f"auto chooses {loops[0]['auto'].motion.method} and takes {min(ratios):.0f} to {max(ratios):.0f} times less "
        f"time than RK45. Its message: {loops[0]['auto'].motion.message}"
    )
    page.figure("stiffness", lambda: figures.plot_stiffness(loops), "Evaluations of the right-hand side by each solver")


def _apart(one: rne.Trajectory, other: rne.Trajectory) -> float:
    return float(np.abs(one.q[-1] - other.q[-1]).max())


def sampled(page: Report, found: dict[str, Any]) -> None:
    """Control by the thesis's gains with torques held between samples."""
    limit = 2 / rne.check_gains(rne.load("irb140"), KP, KD).largest_mode
    page.heading("Sampled control: the same gains, with torques held between samples")
    page.text(
        "The thesis's controller is continuous in time. With torques held between samples the loop should be stable "
        f"for sample times below 2/λ = {limit:.4g} s, where λ is the fastest mode above, and unstable for longer ones."
    )
    runs = [found[f"sampled {k}"] for k in range(3)]
    rows = []
    for j, T in enumerate(SAMPLE_TIMES):
        for k, pair in enumerate(runs):
            m = pair[j].motion
            rates = f"{np.abs(m.qd).max():.3g} rad/s", f"{np.abs(m.qd[-1]).max():.2g} rad/s"
            rows.append([f"{T:.3g} s", f"6.5-{k + 1}", f"{m.t[-1]:.3g} s", *rates])
    page.table(["sample time", "run", "simulated", "largest rate", "rate at the end"], rows)
    calm = [float(np.abs(pair[0].motion.qd[-1]).max()) for pair in runs]
    wild = [float(np.abs(pair[1].motion.qd).max()) for pair in runs]
    page.text(str(verdicts.sampling(calm, wild, limit)))
    caption = "Largest joint rates just below and just above the limit"
    page.figure("sampled", lambda: figures.plot_sampled(runs, limit), caption)
