"""The page of the main job: the IRB 140 validated, in free motion and under the thesis's control."""

from __future__ import annotations

import importlib.util
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

from ..analysis.validation import validate
from ..basics.spatial import Array
from ..control.laws import pd_gravity
from ..model.model import Model
from ..model.robots.abb_irb140 import CLOSED_LOOPS, KD, KP
from ..robot import Robot
from ..simulation.simulator import simulate
from ..simulation.trajectory import Trajectory
from ..urdf.loading import load
from .page import Page

SETTLED = 0.01  # [rad], every joint
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
    if has_matplotlib():
        from ..plotting.robot_picture import draw

        page.figure("robot", lambda: draw(robot, UPRIGHT), "The robot held at (0, π/2, -π/2, 0, 0, 0)")
    held = _checks(robot, page)
    _free_swing(robot, page)
    _closed_loop(robot, page)
    if not has_matplotlib():
        page.text("matplotlib is not installed: no pictures (pip install 'rne[plot]').")
    page.text(f"Done in {time.perf_counter() - started:.1f} s.")
    say(f"page: {page.write()}")
    return held


def has_matplotlib() -> bool:
    """True if matplotlib is installed."""
    return importlib.util.find_spec("matplotlib") is not None


def settling_time(trajectory: Trajectory, reference: Array) -> float:
    """First sample from which on every joint stays within 0.01 rad of its reference [s]; infinity if there is none."""
    outside = np.nonzero((np.abs(trajectory.q - reference) > SETTLED).any(axis=1))[0]
    if not len(outside):
        return float(trajectory.t[0])
    return float(trajectory.t[outside[-1] + 1]) if outside[-1] + 1 < len(trajectory.t) else float("inf")


def carried_masses(model: Model) -> Array:
    """The mass that each joint carries: its own body and all bodies beyond it, shape (nb,) [kg]."""
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
        ["joint", "mass carried [kg]", "working range [rad]", "holding torque (6.21) / g [kg m]"],
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
    page.table(
        ["quantity", "symbol", "largest difference, relative to the largest entry", "bound", "within bound"],
        [
            [r.quantity, r.symbol, f"{r.worst:.1e}", f"{r.bound:.1e}", "yes" if r.worst <= r.bound else "NO"]
            for r in rows
        ],
    )
    return all(r.worst <= r.bound for r in rows)


def _free_swing(robot: Robot, page: Page) -> None:
    page.heading("Free swing, 10 s from rest at q = 0 (thesis 6.4-1)")
    swing = simulate(robot, np.zeros(robot.n), np.zeros(robot.n), 10.0, rtol=1e-9)
    page.text(
        f"{swing.method}, rtol 1e-9: {swing.evaluations} evaluations, energy {swing.energy[0]:.5f} J, "
        f"largest energy error {swing.energy_drift:.1e} J."
    )
    page.text(swing.message)
    if has_matplotlib():
        from ..plotting.plots import plot_free_motion

        title = "Free swing of the IRB 140"
        page.figure(
            "free_swing",
            lambda: plot_free_motion(swing, robot.joint_names, title),
            "Joint positions, energies and energy error of the free swing",
        )


def _closed_loop(robot: Robot, page: Page) -> None:
    page.heading("PD control with gravity compensation (thesis 6.5-1)")
    scene = CLOSED_LOOPS[0]
    reference = np.array(scene.reference)
    law = pd_gravity(robot, KP, KD, reference)
    times = np.linspace(0, scene.duration, 1001)
    motion = simulate(robot, scene.start, np.zeros(robot.n), scene.duration, torque=law, t_eval=times)
    page.text(
        f"{motion.method}: {motion.evaluations} evaluations; every joint within {SETTLED} rad after "
        f"{settling_time(motion, reference):.3f} s."
    )
    page.text(motion.message)
    if has_matplotlib():
        from ..plotting.plots import plot_closed_loop

        title = "Closed loop 6.5-1 of the IRB 140"
        page.figure(
            "closed_loop",
            lambda: plot_closed_loop(motion, reference, robot.joint_names, title),
            "Errors, also on a log scale, and torques of the closed loop",
        )
