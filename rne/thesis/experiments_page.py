"""The page of the thesis's experiments: what it claims, what is measured here, and why they differ."""

from __future__ import annotations

import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from ..analysis.bearings import bearing_peaks
from ..basics.spatial import Array
from ..control.gains import check_gains
from ..model.robots.abb_irb140 import CLOSED_LOOPS, KD, KP
from ..simulation.trajectory import Trajectory
from ..urdf.loading import load
from .experiments import HANGING, SAMPLE_TIMES, SOLVERS, UPRIGHT, gravity_slope, run_all, wrong_height
from .figures import lyapunov
from .main_page import has_matplotlib, settling_time
from .page import Page

CLAIMED_SETTLING = "about 3 s"


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
        "Høifødt 2011 simulated the ABB IRB 140 with ode45 at a relative tolerance of 1e-6. Each section says what it "
        "claims, what is measured here, and why they differ. Its misprints are listed in errata.md."
    )
    say("simulating in parallel processes")
    found = run_all(say)
    for section in (_holding, _swings, _loops, _stiffness, _sampled, _equilibria, _formulations, _long, _bearings):
        section(page, found)
    if not has_matplotlib():
        page.text("matplotlib is not installed: no pictures (pip install 'rne[plot]').")
    if markdown is not None:
        page.write_markdown(markdown)
    say(f"page: {page.write()}, in {time.perf_counter() - started:.0f} s")


def _first(motion: Trajectory, centre: Array, distance: float) -> str:
    apart = np.abs(motion.q - centre).max(axis=1)
    k = int(np.argmax(apart > distance))
    return f"{motion.t[k]:.4g} s" if apart[k] > distance else "never"


def _figure(page: Page, name: str, caption: str, *arguments: Any) -> None:
    if has_matplotlib():
        from . import figures

        page.figure(name, lambda: getattr(figures, f"plot_{name}")(*arguments), caption)


def _holding(page: Page, found: dict[str, Any]) -> None:
    page.heading("6.3: constant holding torque")
    page.text(
        "Claim: the torque of (6.21), which holds the arm at (0, π/2, -π/2, 0, 0, 0), cannot hold it elsewhere; a "
        "start 0.05 rad off stays for about 4 s and then collapses."
    )
    starts = ("q = 0", "(0, π, -π/2, 0, 0, 0)", "(0, π/2, -π/2, 0, 0, 0)", "the same, joint_2 0.05 rad off")
    centres = (0 * UPRIGHT, HANGING, UPRIGHT, UPRIGHT)
    page.table(
        ["run", "start", "deviation 0.1 rad after", "deviation 1 rad after", "largest deviation"],
        [
            [
                f"6.3-{k + 1}",
                start,
                _first(m, c, 0.1),
                _first(m, c, 1.0),
                f"{np.abs(m.q - c).max():.2g} rad in {m.t[-1]:g} s",
            ]
            for k, (m, start, c) in enumerate(zip(found["holding"], starts, centres, strict=True))
        ],
    )
    page.text(
        "Confirmed. Where the torque balances gravity, the derivative of the gravity torque vanishes "
        f"(norm {gravity_slope():.0e} N m/rad): a small deviation meets neither a restoring nor a driving torque, and "
        "grows at first as a power of time, not exponentially."
    )
    _figure(page, "holding", "Distance of the joints from the start under the constant torque", found["holding"])


def _swings(page: Page, found: dict[str, Any]) -> None:
    page.heading("6.4: free swing and energy")
    page.text(
        "Claim: energy is constant but for small variations of the solver; a start 1e-6 rad off moves entirely "
        "differently."
    )
    one, other, loose = found["swings"]
    apart = np.abs(one.q - other.q).max(axis=1)
    printed, half = wrong_height(loose), loose.t <= 5
    page.table(
        ["what", "measured"],
        [
            ["energy of 6.4-1, zero level at frame 0", f"{one.energy[0]:.5f} J"],
            ["spread of the energy over 10 s, rtol 1e-9", f"{np.ptp(one.energy):.1e} J"],
            ["spread at the thesis's tolerance, correct height", f"{np.ptp(loose.energy):.1e} J"],
            ["spread at the thesis's tolerance, height of (6.38), first 5 s", f"{np.ptp(printed[half]):.2f} J"],
            ["difference of the two swings 1e-3 rad after", f"{one.t[np.argmax(apart > 1e-3)]:.2f} s"],
            ["difference of the two swings 1 rad after", f"{one.t[np.argmax(apart > 1)]:.2f} s"],
        ],
    )
    page.text(
        "The second claim is confirmed. Most of the variations of 6.4.5 are not due to the solver: (6.38) omits q4 in "
        "the height of the wrist, which changes the energy a thousand times more than the solver's errors do."
    )
    _figure(page, "swings", "Two free swings and the difference between them", one, other)
    _figure(page, "energies", "Energies with the correct height and with (6.38)", loose)


def _loops(page: Page, found: dict[str, Any]) -> None:
    page.heading("6.5: PD control with gravity compensation")
    page.text(f"Claim: all three runs converge in {CLAIMED_SETTLING}; V of (6.50) decreases at the rate of (6.55).")
    grids = [found[f"loop {k}"]["grid"].motion for k in range(3)]
    energies = [lyapunov(m, k)[0] for k, m in enumerate(grids)]
    page.table(
        ["run", "claimed", "all joints within 0.01 rad after", "method", "largest increase of V between samples"],
        [
            [
                f"6.5-{k + 1}",
                CLAIMED_SETTLING,
                f"{settling_time(m, np.array(CLOSED_LOOPS[k].reference)):.3f} s",
                m.method,
                f"{max(0.0, np.diff(V).max()):.1e} J of {V[0]:.0f} J",
            ]
            for k, (m, V) in enumerate(zip(grids, energies, strict=True))
        ],
    )
    page.text("Confirmed.")
    if has_matplotlib():
        from ..plotting.plots import plot_closed_loop

        for k, m in enumerate(grids):
            names, reference = load("irb140").joint_names, np.array(CLOSED_LOOPS[k].reference)
            page.figure(
                f"loop_{k + 1}",
                partial(plot_closed_loop, m, reference, names, f"Closed loop 6.5-{k + 1}"),
                f"Errors and torques of 6.5-{k + 1}",
            )
    _figure(page, "lyapunov", "The Lyapunov function and its decrease", grids)


def _stiffness(page: Page, found: dict[str, Any]) -> None:
    page.heading("Why the closed loop took three hundred times longer than the open one")
    robot = load("irb140")
    page.text(
        "In Table 7.1, 10 s of open loop take 6 s to compute, and 5 s of closed loop about 30 min; the thesis "
        "gives no reason. The closed loop is stiff: the wrist's drives act on 1.4e-3 kg m², so that M⁻¹Kd has a mode a "
        "thousand times faster than the motion, and the step of an explicit method is limited by it at any tolerance."
    )
    page.verbatim(str(check_gains(robot, KP, KD, SAMPLE_TIMES[0])))
    loops = [found[f"loop {k}"] for k in range(3)]
    rows = []
    for method in (*SOLVERS, "auto"):
        runs = [loop[method] for loop in loops]
        rows.append(
            [
                method,
                " / ".join(str(r.motion.evaluations) for r in runs),
                " / ".join(f"{r.seconds:.2f}" for r in runs),
                f"{max(_apart(r.motion, loop['Radau'].motion) for r, loop in zip(runs, loops, strict=True)):.0e}",
            ]
        )
    page.table(
        ["method", "evaluations, runs 1 / 2 / 3", "wall time [s]", "difference from Radau at the end [rad]"], rows
    )
    ratios = [loop["RK45"].seconds / loop["auto"].seconds for loop in loops]
    page.text(
        f"auto chooses {loops[0]['auto'].motion.method} and is {min(ratios):.0f} to {max(ratios):.0f} times faster "
        f"than RK45. Its message: {loops[0]['auto'].motion.message}"
    )
    _figure(page, "stiffness", "Evaluations of the right-hand side by each solver", loops)


def _apart(one: Trajectory, other: Trajectory) -> float:
    return float(np.abs(one.q[-1] - other.q[-1]).max())


def _sampled(page: Page, found: dict[str, Any]) -> None:
    page.heading("Sampled control: the same gains, with torques held between samples")
    page.text(
        "The thesis's controller is continuous in time. With torques held between samples the loop is stable for "
        "sample times below 2/λ = 1.308e-4 s, where λ is the fastest mode above, and unstable for longer ones."
    )
    runs = [found[f"sampled {k}"] for k in range(3)]
    rows = []
    for j, T in enumerate(SAMPLE_TIMES):
        for k, pair in enumerate(runs):
            m = pair[j].motion
            rows.append(
                [
                    f"{T:.3g} s",
                    f"6.5-{k + 1}",
                    f"{m.t[-1]:.3g} s",
                    f"{np.abs(m.qd).max():.3g} rad/s",
                    f"{np.abs(m.qd[-1]).max():.2g} rad/s",
                ]
            )
    page.table(["sample time", "run", "simulated", "largest rate", "rate at the end"], rows)
    _figure(page, "sampled", "Largest joint rates just below and just above the limit", runs)


def _equilibria(page: Page, found: dict[str, Any]) -> None:
    page.heading("7.1: equilibria, and the arm with the opposite sign of q3")
    hanging, other, tipped, rate = found["equilibria"]
    flip = np.array([1, 1, -1, 1, 1, 1])
    page.text("Claim: 7.1-1 stays at rest, also in the Euler-Lagrange model of chapter 7; 7.1-2 is unstable.")
    still, alike = np.abs(hanging.q - HANGING).max(), np.abs(hanging.q - other.q * flip).max()
    page.text(
        f"Confirmed: 7.1-1 stays within {still:.0e} rad in 10 s, and both arms within {alike:.0e} rad of each other "
        "(rtol 1e-9, atol 1e-12). When 7.1-2 tips over depends on rounding; that deviations grow as "
        f"exp({rate:.3f} t) does not."
    )
    _figure(page, "tipping", "Growth of 1e-6 rad at the unstable equilibrium", tipped, rate)


def _formulations(page: Page, found: dict[str, Any]) -> None:
    page.heading("Table 7.1: Newton-Euler or Euler-Lagrange?")
    rows = found["formulations"]
    fastest = rows[-1][2]
    page.table(
        ["formulation", "operations", "µs per evaluation", "relative to the Newton-Euler kernel"],
        [[name, str(count) if count else "-", f"{us:.1f}", f"{us / fastest:.1f}"] for name, count, us in rows],
    )
    page.text(
        "Claim: Euler-Lagrange takes 70 times longer. With zeros removed and repeated terms shared it takes about five "
        "times as long, and both give the same torques to rounding. The rest of the factor of 70 is due to the "
        "expanded code, not to the formulation (python -m benchmarks.lagrange measures batches)."
    )


def _long(page: Page, found: dict[str, Any]) -> None:
    page.heading("A hundred times longer: the free swing for 1000 s")
    rows = []
    for name in ("gauss-4", "RK45"):
        motion, seconds = found[f"long {name}"]
        error = motion.energy - motion.energy[0]
        trend = np.polyfit(motion.t, error, 1)[0] * motion.t[-1]
        rows.append([name, f"{np.ptp(error):.2g} J", f"{trend:.1e} J", f"{motion.evaluations}", f"{seconds:.0f} s"])
    page.table(["method", "band of the energy error", "trend over 1000 s", "evaluations", "wall time"], rows)
    page.text(
        "The energy error of the symplectic method stays within a band, that of RK45 drifts. After about 10 s the "
        "positions of both are meaningless, since the motion is chaotic."
    )
    _figure(page, "long", "Energy error over 1000 s", found["long gauss-4"].motion, found["long RK45"].motion)


def _bearings(page: Page, found: dict[str, Any]) -> None:
    page.heading("Loads on the bearings during the free swing 6.4-1")
    page.verbatim(str(bearing_peaks(load("irb140"), found["swings"][0])))
