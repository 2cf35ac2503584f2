"""Sections of the page on the machine itself: what the data sheet allows, loads on bearings, printed equations."""

import math
from typing import Any

import numpy as np

import rne
from rne.dynamics.limits import Violation
from rne.model.abb_irb140 import DATA_SHEET, LINKS
from rne.plotting.html_page import Report

from . import appendix_c, figures, verdicts
from .experiments import LEVELS, LONG_RTOL, levels

STATED_DENSITY = 1500.0  # [kg/m^3]
ELEMENT = "m23"


def limits(page: Report, found: dict[str, Any]) -> None:
    """Which limits of the data sheet the closed loops exceed; the model beside the data sheet."""
    motions = [found[f"loop {k}"]["grid"].motion for k in range(3)]
    page.heading("Appendix A: what the data sheet allows, and what the runs do")
    page.text(
        "Nothing in the simulations keeps the joints within the ranges and speeds of the data sheet. What "
        f"trajectory.check_limits() finds in the closed loops, on {len(motions[0].t)} samples 0.05 ms apart for the "
        "first 20 ms and 1 ms apart after them (the data sheet states ranges as totals; that they lie about zero is "
        "assumed):"
    )
    rows = [[f"6.5-{k + 1}", *violation_row(v)] for k, motion in enumerate(motions) for v in motion.check_limits()]
    page.table(["run", "joint", "exceeds", "worst", "allowed", "first at", "worst at"], rows)
    largest = np.asarray(DATA_SHEET["tcp_speed"].value).item()
    speeds = [flange_speed(motion) for motion in motions]
    page.table(
        ["run", "largest speed of the flange", "the sheet's largest", "exceeded"],
        [
            [f"6.5-{k + 1}", f"{speed:.2f} m/s at {time:.3g} s", f"{largest:g} m/s", "yes" if speed > largest else "no"]
            for k, (speed, time) in enumerate(speeds)
        ],
    )
    page.text(
        f"The cylinders of table 4.1 have densities of {', '.join(f'{d:.1f}' for d in densities())} kg/m³ (link_1, "
        f"link_2, link_4, link_6). {verdicts.density(densities(), STATED_DENSITY)}"
    )
    stated = np.asarray(DATA_SHEET["reach"].value).item() / 1000
    page.text(f"Reach of axis 5 from axis 1. {verdicts.reach(reach(), stated)}")


def violation_row(violation: Violation) -> list[str]:
    """Joint, quantity, worst value, limit and times of a violation, in degrees."""
    v, unit = violation, violation.unit.replace("rad", "deg")
    values = [f"{math.degrees(x):.1f} {unit}" for x in (v.value, v.limit)]
    return [
        v.joint,
        "range" if v.quantity == "position" else "speed",
        *values,
        f"{v.first_time:.4g} s",
        f"{v.worst_time:.4g} s",
    ]


def flange_speed(motion: rne.Trajectory) -> tuple[float, float]:
    """The largest speed of the flange [m/s] and its time [s]."""
    velocity = (rne.load("irb140").jacobian(motion.q, "tool0") @ motion.qd[..., None])[:, 3:, 0]
    speed = np.linalg.norm(velocity, axis=1)
    k = int(speed.argmax())
    return float(speed[k]), float(motion.t[k])


def densities() -> list[float]:
    """Mass by volume of the links that have a cylinder [kg/m^3]."""
    return [link.mass / (math.pi * link.radius**2 * link.height) for link in LINKS if link.mass]


def reach() -> float:
    """Distance of axis 5 from axis 1 with the arm stretched out horizontally [m]."""
    return LINKS[0].r_end[0] + LINKS[1].r_end[0] + LINKS[3].r_end[1]


def printed(page: Report, _: dict[str, Any]) -> None:
    """Appendix C."""
    robot = rne.load("irb140")
    page.heading("Appendix C: the printed equations")
    page.text(
        "The thesis prints two of its expressions in full, the kinetic energy and the torque of joint 1, sums of "
        "cosines and sines of q2 to q5. Their coefficients here are the Fourier coefficients of M(q) and of C q' on a "
        "grid. Left out is what is damaged in the copy that was read; of two more, the constant of q1'² and the "
        "term of q1' q4', only the number is legible there."
    )
    difference = float(np.abs(appendix_c.ours(robot) - appendix_c.printed()).max())
    page.text(str(verdicts.same_coefficients(difference, len(appendix_c.PRINTED))))
    page.text(
        "rne source irb140 --element m23 prints an entry of M, --element c3 one of C q', g2 of g, tau4 a torque, with "
        "--language matlab or c if wanted. Two labels of appendix C are wrong (errata.md, entry 14)."
    )
    page.text(robot.kernel(rne.dynamics.mass_matrix).source("python", ELEMENT).rstrip(), "pre")


def long_swing(page: Report, found: dict[str, Any]) -> None:
    """6.4-1 for much longer."""
    runs = {f"{name}, rtol {rtol:.0e}": found[f"long {name}"] for name, rtol in LONG_RTOL.items()}
    motions = {name: run.motion for name, run in runs.items()}
    page.heading(f"The free swing for {motions[min(motions)].t[-1]:g} s")
    rows, sentences = [], []
    for name, (motion, seconds) in runs.items():
        band, wander = float(np.ptp(motion.energy)), float(np.ptp(levels(motion)[1]))
        rows.append([name, f"{band:.2g} J", f"{wander:.1e} J", f"{motion.evaluations}", f"{seconds:.0f} s"])
        sentences.append(verdicts.long_run(name, band, wander, float(motion.energy[0])))
    page.table(["method", "band of the energy error", "range of its level", "evaluations", "wall time"], rows)
    for sentence in sentences:
        page.text(sentence)
    page.text(
        f"The level is the median over each {LEVELS}th part of the run, so that bursts do not count; an error "
        f"accumulates if its level wanders through more than {verdicts.ACCUMULATED:.0%} of the band. The motion is "
        "chaotic: after about 10 s positions mean nothing, and band and level are others on each processor."
    )
    page.figure("long", lambda: figures.plot_long(motions), "Energy error over the long run")


def bearings(page: Report, found: dict[str, Any]) -> None:
    """Loads on the bearings in the free swing."""
    page.heading("Loads on the bearings during the free swing 6.4-1")
    page.text(str(rne.bearing_peaks(rne.load("irb140"), found["swings"][0])), "pre")
