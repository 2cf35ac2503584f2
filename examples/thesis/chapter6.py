"""Sections of the page on chapter 6: constant torque, free swings, closed loops, and what 6.5.3 mentions."""

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import numpy as np

import rne
from rne.commands.pages import STRETCHED_OUT, settling_time
from rne.model.abb_irb140 import CLOSED_LOOPS, KD, KP
from rne.plotting.html_page import Report

from . import figures, verdicts
from . import numbered_figures as numbered
from .closed_loop import (
    IDEAL,
    SAMPLE_TIME,
    VARIATIONS,
    Outcome,
    gravity_on_the_way,
    lyapunov,
    lyapunov_deviation,
)
from .experiments import HANGING, gravity_slope, wrong_height
from .loop_plots import plot_errors

BEYOND = "What the figures do not show"
_, VISCOUS, MORE_VISCOUS, COULOMB, LIMITED, WEAK, RATE, LAGGING = (variation.name for variation in VARIATIONS)
RUNS = tuple(f"6.5-{k + 1}" for k in range(3))
BLOCKS = """\
reference ---> (-) ---> Kp ---> (-) --- u ---> irb140 ---+---> q, qd
                ^                ^                       |
                |                +------ Kd <------ qd --+
                +------------------------------- q ------+"""


def figure_of_the_thesis(page: Report, number: str, draw: Callable[[], Any]) -> None:
    """Add one of the thesis's figures under a heading with its number."""
    figure = numbered.BY_NUMBER[number]
    page.heading(figure.title, 3)
    page.figure(figure.file, draw, figure.title)
    if figure.note:
        page.text(figure.note)


def _row(numbers: Sequence[float]) -> str:
    return f"({', '.join(f'{x:g}' for x in numbers)})"


def first_time(motion: rne.Trajectory, centre: np.ndarray, distance: float) -> float:
    """The first sample at which some joint is farther than `distance` from `centre` [s]; infinity if there is none."""
    far = np.flatnonzero(np.abs(motion.q - centre).max(axis=1) > distance)
    return float(motion.t[far[0]]) if len(far) else np.inf


def holding(page: Report, found: dict[str, Any]) -> None:
    """6.3, with figures 6.2 to 6.5."""
    runs = found["holding"]
    page.heading("6.3: constant holding torque")
    page.text(
        "Claim: the torque of (6.21), which holds the arm at (0, π/2, -π/2, 0, 0, 0), cannot hold it elsewhere; a "
        "start 0.05 rad off stays for about 4 s and then collapses."
    )
    starts = ("q = 0", "(0, π, -π/2, 0, 0, 0)", "(0, π/2, -π/2, 0, 0, 0)", "the same, joint_2 0.05 rad off")
    centres = (0 * STRETCHED_OUT, HANGING, STRETCHED_OUT, STRETCHED_OUT)
    times = [[first_time(m, c, d) for d in (0.1, 1.0)] for m, c in zip(runs, centres, strict=True)]
    farthest = [float(np.abs(m.q - c).max()) for m, c in zip(runs, centres, strict=True)]
    page.table(
        ["run", "start", "deviation 0.1 rad after", "deviation 1 rad after", "largest deviation"],
        [
            [f"6.3-{k + 1}", start, *(f"{t:.4g} s" if np.isfinite(t) else "never" for t in times[k])]
            + [f"{farthest[k]:.2g} rad in {runs[k].t[-1]:g} s"]
            for k, start in enumerate(starts)
        ],
    )
    page.text("Deviations are those of the joint farthest from the start; for 6.3-4, from the start of 6.3-3.")
    page.text(f"6.3-1 and 6.3-2: {verdicts.not_held([times[0][1], times[1][1]])}")
    page.text(f"6.3-3: {verdicts.held(farthest[2], runs[2].t[-1])}")
    page.text(f"6.3-4: {verdicts.collapses(*times[3])}")
    for number, motion in zip(("6.2", "6.3", "6.4", "6.5"), runs, strict=True):
        figure_of_the_thesis(page, number, partial(numbered.holding, number, motion))
    page.heading(f"{BEYOND}: how the deviation grows", 3)
    page.text(
        "At the pose of (6.19) the derivative of the gravity torque vanishes "
        f"(norm {gravity_slope():.0e} N m/rad; it would be zero but for rounding). A small deviation meets neither a "
        "restoring nor a driving torque, and grows at first as a power of time, not exponentially."
    )
    page.figure("holding", lambda: figures.plot_holding(runs), "Distance of the joints from the start, on log axes")


def swings(page: Report, found: dict[str, Any]) -> None:
    """6.4, with figures 6.6 to 6.9."""
    one, other, *loose = found["swings"]
    page.heading("6.4: free swing and energy")
    page.text(
        "Claim: without torques the arm swings like a chaotic pendulum; energy is constant but for small variations of "
        "the solver; a start 1e-6 rad off moves entirely differently."
    )
    apart = np.abs(one.q - other.q).max(axis=1)
    begins, parted = (float(one.t[np.argmax(apart > d)]) if (apart > d).any() else np.inf for d in (1e-3, 1.0))
    printed = [float(np.ptp(wrong_height(m)[m.t <= 5])) for m in (one, other)]
    spreads = [float(np.ptp(m.energy)) for m in loose]
    page.table(
        ["what", "6.4-1", "6.4-2"],
        [
            ["energy, zero level at frame 0", *(f"{m.energy[0]:.6f} J" for m in (one, other))],
            ["largest kinetic energy in 10 s", *(f"{m.kinetic.max():.1f} J" for m in (one, other))],
            ["smallest potential energy", *(f"{m.potential.min():.1f} J" for m in (one, other))],
            ["spread of the total, rtol 1e-9", *(f"{np.ptp(m.energy):.1e} J" for m in (one, other))],
            ["spread at the thesis's tolerance", *(f"{spread:.1e} J" for spread in spreads)],
            ["spread with the height of (6.38), first 5 s", *(f"{spread:.2f} J" for spread in printed)],
        ],
    )
    page.text(f"Energy: {verdicts.energy_is_constant(max(spreads), float(one.energy[0]))}")
    page.text(
        f"The two swings are 1e-3 rad apart after {verdicts.seconds([begins], 2)}: "
        f"{verdicts.swings_part(parted, float(one.t[-1]))}"
    )
    for k, (swing, beside) in enumerate(((one, None), (other, one))):
        figure_of_the_thesis(page, f"6.{6 + 2 * k}", partial(numbered.swing_positions, f"6.{6 + 2 * k}", swing, beside))
        figure_of_the_thesis(page, f"6.{7 + 2 * k}", partial(numbered.swing_energies, f"6.{7 + 2 * k}", loose[k]))
    page.heading(f"{BEYOND}: the difference, and the height of the wrist", 3)
    page.figure("swings", lambda: figures.plot_swings(one, other), "Difference between the two free swings")
    page.text(verdicts.height_of_wrist(min(printed), max(spreads)))
    page.figure("energies", lambda: figures.plot_energies((one, other)), "Total energy with the height of (6.38)")


def loops(page: Report, found: dict[str, Any]) -> None:
    """6.5, with figures 6.11 to 6.16."""
    page.heading("6.5: PD control with gravity compensation")
    page.text("Claim: all three runs converge in about 3 s; V of (6.50) decreases at the rate of (6.55).")
    motions = [found[f"loop {k}"]["grid"].motion for k in range(3)]
    energies = [lyapunov(m, k)[0] for k, m in enumerate(motions)]
    rises = [max(0.0, float(np.diff(V).max()) / float(V[0])) for V in energies]
    deviations = [lyapunov_deviation(m, k) for k, m in enumerate(motions)]
    settled = [settling_time(m, CLOSED_LOOPS[k].reference) for k, m in enumerate(motions)]
    page.table(
        ["run", "claimed", "within 0.01 rad after", "method", "V at the start", "largest rise of V / V at the start"],
        [
            [
                RUNS[k],
                "about 3 s",
                verdicts.seconds([settled[k]]),
                m.method,
                f"{energies[k][0]:.0f} J",
                f"{rises[k]:.0e}",
            ]
            for k, m in enumerate(motions)
        ],
    )
    page.text(f"Convergence: {verdicts.settles(settled)}")
    page.text(f"Lyapunov function: {verdicts.lyapunov_falls(max(rises), max(deviations))}")
    page.heading("Figure 6.10: blocks of the closed loop", 3)
    page.text(BLOCKS, "pre")
    page.text(
        "A block diagram in Simulink, described here in words. The block irb140 is the model without gravity, to save "
        "time: (6.57). The arm with gravity moves alike under u + g(q), (6.48), which is simulated here: "
        "rne.control.pd_gravity(robot, KP, KD, reference) as the controller of an rne.Scene. Figure 6.1, the open "
        "loop, is the same block irb140 with gravity and a constant torque in place of the controller. "
        f"KP is {_row(KP)} N m/rad and KD {_row(KD)} N m s/rad; concordance.md has starts and references."
    )
    for k, m in enumerate(motions):
        number = f"6.{11 + 2 * k}"
        figure_of_the_thesis(page, number, partial(numbered.loop_positions, number, m, k))
        number = f"6.{12 + 2 * k}"
        figure_of_the_thesis(page, number, partial(numbered.loop_inputs, number, m, k))
    page.heading(f"{BEYOND}: small errors, and the Lyapunov function", 3)
    for k, m in enumerate(motions):
        draw = partial(plot_errors, f"Errors of run {RUNS[k]}", m, CLOSED_LOOPS[k].reference)
        page.figure(f"loop_{k + 1}", draw, f"Errors of {RUNS[k]} on a log axis")
    page.figure("lyapunov", lambda: figures.plot_lyapunov(motions), "The Lyapunov function and its decrease")


def variations(page: Report, found: dict[str, Any]) -> None:
    """6.5.3: friction, saturation and rate limits."""
    outcomes = [found[f"6.5.3, run {k + 1}"] for k in range(3)]
    page.heading("6.5.3: friction, saturation and rate limits tried out")
    page.text(
        "6.5.3 names what the simulations leave out. It says that friction makes no real difference while torques are "
        "not saturated, that limits to the rate of torques make no significant one, and that the proof of stability "
        "covers limited torques as it stands; none of the three holds (errata.md, entries 18, 17 and 6). The same "
        "three runs with each of these, equal on all joints:"
    )
    page.table(["added", *RUNS], [[v.name, *(settling(o[v.name]) for o in outcomes)] for v in VARIATIONS])
    for what, names in (("Friction", (VISCOUS, MORE_VISCOUS, COULOMB)), ("Rate limits", (RATE, LAGGING))):
        times = [[o[name].settling for name in names] for o in outcomes]
        page.text(f"{what}: {verdicts.no_difference(times, [o[IDEAL.name].settling for o in outcomes])}")
    for sentence in reasons(outcomes, gravity_on_the_way(found["loop 1"]["grid"].motion)):
        page.text(sentence)
    rising = []
    for variation in VARIATIONS:
        runs = [RUNS[k] for k, o in enumerate(outcomes) if o[variation.name].increase > verdicts.RISE]
        if runs:
            rising.append(f"{variation.name} ({', '.join(runs)})")
    page.text(f"V rises on its way, by more than {verdicts.RISE:g} J, with: {'; '.join(rising) or 'none of these'}.")


def settling(outcome: Outcome) -> str:
    """When a run settles, or why it does not."""
    if np.isfinite(outcome.settling):
        return f"{outcome.settling:.3f} s"
    if outcome.rate > verdicts.DIVERGING:
        return f"diverges: {outcome.rate:.0e} rad/s in {outcome.duration:g} s"
    return f"not in {outcome.duration:g} s, {outcome.error:.2g} rad off"


def reasons(outcomes: list[dict[str, Outcome]], gravity: np.ndarray) -> list[str]:
    """Why each addition does to the settling what it does, with the figures of the runs."""

    def slowest(name: str) -> float:
        return max(o[name].settling for o in outcomes)

    viscous = [
        f"With {v} N m s {verdicts.viscous(slowest(name), wrist_settling(v), slowest(IDEAL.name))}"
        for v, name in ((5, VISCOUS), (20, MORE_VISCOUS))
    ]
    limited = [
        verdicts.saturation(o.settling, o.saturated, o.joint, float(gravity[1]), limit)
        for o, limit in ((outcomes[1][LIMITED], 100.0), (outcomes[1][WEAK], 60.0))
    ]
    lags = [o[LAGGING] for o in outcomes]
    return [
        "Viscous friction adds to Kd: the light joints of the wrist follow (Kd + F) q̃' + Kp q̃ = 0, from π to 0.01 "
        f"rad within ln(314) (Kd + F)/Kp. {' '.join(viscous)}",
        "Coulomb friction of 5 N m can hold a joint up to 5/50 = 0.1 rad from its reference, since nothing "
        f"integrates the error; {verdicts.coulomb(max(o[COULOMB].error for o in outcomes), 5 / KP[0])}",
        f"A torque limit bites where gravity asks for more. On {RUNS[1]} gravity alone takes up to {gravity[1]:.0f} "
        f"N m at joint_2. {' '.join(limited)}",
        f"Limits to the rate of torques (sampled every {SAMPLE_TIME:g} s) act on the wrist: joint_6 starts with u = "
        "60 π = 188 N m on I = 1.4e-3 kg m², which has to fall within some 1/15000 s. If it falls at R = 1e5 N m/s, "
        "the joint gains u²/(2 R I). "
        f"{verdicts.overshoot(max(o[RATE].rate for o in outcomes), wrist_peak(1e5), ideal_rate(outcomes))} With 3e3 "
        f"N m/s {verdicts.lagging([o.rate for o in lags], [o.increase for o in lags], lags[0].duration)}",
    ]


def wrist_settling(viscous: float) -> float:
    """Time in which joint_4 alone goes from π to 0.01 rad with viscous friction [s]."""
    return float(np.log(np.pi / verdicts.SETTLED)) * (KD[3] + viscous) / KP[3]


def wrist_peak(rate: float) -> float:
    """Rate that joint_6 gains while its first torque falls at `rate` [rad/s]."""
    inertia = rne.load("irb140").mass_matrix(np.zeros(6))[5, 5]
    return float((KP[5] * np.pi) ** 2 / (2 * rate * inertia))


def ideal_rate(outcomes: list[dict[str, Outcome]]) -> float:
    """Largest rate of the runs without additions [rad/s]."""
    return max(o[IDEAL.name].rate for o in outcomes)
