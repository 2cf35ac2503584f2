"""The page of the main job: the IRB 140 validated, in free motion and under the thesis's control."""

from __future__ import annotations

import time
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np

from ..basics.spatial import Array
from ..control.laws import pd_gravity
from ..model.abb_irb140 import CLOSED_LOOPS, KD, KP
from ..model.model import Model
from ..robot import Robot
from ..simulation.simulator import simulate
from ..urdf.loading import load
from ..validation.agreement import validate
from .chapter6 import figure_of_the_thesis
from .closed_loop import fine_grid, settling_time
from .figures import plot_errors, plot_free_motion, plot_robot
from .numbered_figures import loop_inputs, loop_positions
from .page import Page
from .verdicts import settles

UPRIGHT = (0, np.pi / 2, -np.pi / 2, 0, 0, 0)  # [rad], the pose of (6.21)


def run(folder: Path, say: Callable[[str], None]) -> bool:
    """Run the main job and write its page.

    Parameters
    ----------
    folder : Path
        For the HTML page and its pictures; made if it does not exist.
    say : callable
        Called with each line of text.

    Returns
    -------
    bool
        True if all differences from the independent source are within their bounds.
    """
    started = time.perf_counter()
    folder.mkdir(parents=True, exist_ok=True)
    robot = load("irb140")
    page = Page("ABB IRB 140 by recursive Newton-Euler", say, folder)
    page.text(repr(robot))
    page.text("Joints are called joint_1 to joint_6 as in the model; the thesis writes q_1 to q_6.")
    page.figure("robot", lambda: plot_robot(robot, UPRIGHT), "The robot held at (0, π/2, -π/2, 0, 0, 0)")
    held = _checks(robot, page)
    _free_swing(robot, page)
    _closed_loop(robot, page)
    page.end()
    page.text(f"Done in {time.perf_counter() - started:.1f} s.")
    say(f"page: {page.write()}")
    return held


def carried_masses(model: Model) -> Array:
    """The mass behind each joint: the body that it moves and all bodies beyond, shape (nb,) [kg]."""
    carried = model.mass.copy()
    for i in reversed(range(model.nb)):
        if model.parent[i] >= 0:
            carried[model.parent[i]] += carried[i]
    return carried


def _checks(robot: Robot, page: Page) -> bool:
    page.heading("Model and checks")
    model, carried = robot.model, carried_masses(robot.model)
    holding = robot.gravity_torque(UPRIGHT) / 9.81
    page.table(
        ["joint", "mass behind the joint [kg]", "working range [rad]", "holding torque (6.21) / g [kg m]"],
        [
            [
                name,
                f"{carried[i]:g}",
                f"{model.lower[i]:.3f} ... {model.upper[i]:.3f}",
                f"{round(holding[i], 4) + 0.0:.4f}",
            ]
            for i, name in enumerate(robot.joint_names)
        ],
    )
    samples = 1000
    source, rows = validate(robot, samples)
    page.text(f"Largest difference over {samples} random states, rates up to 10 rad/s, against {source}:")
    return page.comparison(rows, "entry")


def _free_swing(robot: Robot, page: Page) -> None:
    page.heading("Free swing, 10 s from rest at q = 0 (thesis 6.4-1, Figure 6.9)")
    swing = simulate(robot, np.zeros(robot.n), np.zeros(robot.n), 10.0, rtol=1e-9)
    page.text(
        f"{swing.method}, rtol 1e-9: {swing.evaluations} evaluations, energy {swing.energy[0]:.5f} J, "
        f"largest energy error {swing.energy_drift:.1e} J."
    )
    page.text(swing.message)
    caption = "Joint positions as in Figure 6.9, energies and energy error of the free swing"
    page.figure("free_swing", lambda: plot_free_motion(swing, "Free swing 6.4-1 (Figure 6.9)"), caption)


def _closed_loop(robot: Robot, page: Page) -> None:
    page.heading("PD control with gravity compensation (thesis 6.5-1, Figures 6.11 and 6.12)")
    scene = CLOSED_LOOPS[0]
    reference = np.array(scene.reference)
    law = pd_gravity(robot, KP, KD, reference)
    times = fine_grid(scene.duration)
    motion = simulate(robot, scene.start, np.zeros(robot.n), scene.duration, torque=law, t_eval=times)
    settled = settling_time(motion, reference)
    page.text(f"{motion.method}: {motion.evaluations} evaluations. {settles([settled])}")
    page.text(motion.message)
    for number, draw in (("6.11", loop_positions), ("6.12", loop_inputs)):
        figure_of_the_thesis(page, number, partial(draw, number, motion, 0))
    page.subheading("Not in the thesis: small errors")
    page.figure("loop_1", lambda: plot_errors(motion, 0), "Errors of 6.5-1 on a log axis")
