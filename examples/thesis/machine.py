"""Sections of the page on the machine itself: what the data sheet allows, loads on bearings, printed equations."""

import math
from typing import Any

import numpy as np

import rne
from rne.model.abb_irb140 import DATA_SHEET, LINKS
from rne.plotting.html_page import Report
from rne.simulation.limits import Violation

from . import figures, verdicts

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
    page.heading("Appendix C: the printed equations")
    page.text(
        "The thesis prints single entries of its model. rne source irb140 --element m23 prints one here, --element "
        "c3 an entry of C q', g2 of g, tau4 a torque, with --language matlab or c if wanted. Two labels of appendix "
        "C are wrong (errata.md, entry 14)."
    )
    page.text(rne.load("irb140").kernel(rne.dynamics.mass_matrix).source("python", ELEMENT).rstrip(), "pre")


def long_swing(page: Report, found: dict[str, Any]) -> None:
    """6.4-1 for much longer."""
    symplectic, explicit = (found[f"long {name}"] for name in ("gauss-4", "RK45"))
    page.heading(f"The free swing for {symplectic.motion.t[-1]:g} s")
    rows, sentences = [], []
    for name, (motion, seconds) in (("gauss-4", symplectic), ("RK45", explicit)):
        error = motion.energy - motion.energy[0]
        trend, band = float(np.polyfit(motion.t, error, 1)[0] * motion.t[-1]), float(np.ptp(error))
        rows.append([name, f"{band:.2g} J", f"{trend:.1e} J", f"{motion.evaluations}", f"{seconds:.0f} s"])
        sentences.append(verdicts.long_run(name, band, trend))
    page.table(["method", "band of the energy error", "trend over the run", "evaluations", "wall time"], rows)
    page.text(
        f"{' '.join(sentences)} Criterion: a trend of at most a tenth of the band is none. After about 10 s the "
        "positions of both are meaningless, since the motion is chaotic."
    )
    page.figure("long", lambda: figures.plot_long(symplectic.motion, explicit.motion), "Energy error over the long run")


def bearings(page: Report, found: dict[str, Any]) -> None:
    """Loads on the bearings in the free swing."""
    page.heading("Loads on the bearings during the free swing 6.4-1")
    page.text(str(rne.bearing_peaks(rne.load("irb140"), found["swings"][0])), "pre")
