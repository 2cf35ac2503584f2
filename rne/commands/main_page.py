"""The page of the main job: the IRB 140 compared with an independent source, swinging freely and under control."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from ..basics.spatial import Array
from ..control.laws import pd_gravity
from ..model.abb_irb140 import CLOSED_LOOPS, KD, KP
from ..model.model import Model
from ..plotting import draw
from ..plotting.html_page import BELOW, WIDTH, Report, column, joint_grid, lines, log_lines
from ..plotting.plots import blank_figure
from ..robot import Robot
from ..simulation.simulator import simulate
from ..simulation.trajectory import Trajectory
from ..urdf.loading import load
from ..validation.agreement import validate

if TYPE_CHECKING:
    from matplotlib.figure import Figure

UPRIGHT = np.array([0, np.pi / 2, -np.pi / 2, 0, 0, 0])  # [rad], the pose of (6.21)
JOINTS = tuple(f"joint_{k}" for k in range(1, 7))
FIRST = 0.02  # [s], in which the wrist's torques fall from their peak
SETTLED = 0.01  # [rad], every joint
SETTLING = (2.25, 3.75)  # [s], for "about 3 s"
SMALLEST = 1e-8  # [rad], lower end of the axis of errors
REFERENCE = "Dotted: the references."
GRAVITY = (
    "The thesis plots u = -Kp q̃ - Kd q̇ of (6.57)-(6.58), with gravity taken out of the model: the first two "
    "panels, the first 20 ms on a time axis of their own because of the wrist's peak. Below them what the drives of "
    "an arm with gravity must give, τ = u + g(q)."
)


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
    robot = load("irb140")
    page = Report("ABB IRB 140 by recursive Newton-Euler", say, folder)
    page.text(repr(robot))
    page.text("Joints are called joint_1 to joint_6 as in the model; the thesis writes q_1 to q_6.")
    page.figure("robot", lambda: plot_robot(robot, UPRIGHT), "The robot held at (0, π/2, -π/2, 0, 0, 0)")
    held = _checks(robot, page)
    _free_swing(robot, page)
    _closed_loop(robot, page)
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


def _checks(robot: Robot, page: Report) -> bool:
    page.heading("Model and checks")
    model, carried = robot.model, carried_masses(robot.model)
    holding = np.round(robot.gravity_torque(UPRIGHT) / 9.81, 4) + 0.0
    page.table(
        ["joint", "mass behind the joint [kg]", "working range [rad]", "holding torque (6.21) / g [kg m]"],
        [
            [name, f"{carried[i]:g}", f"{model.lower[i]:.3f} ... {model.upper[i]:.3f}", f"{holding[i]:.4f}"]
            for i, name in enumerate(robot.joint_names)
        ],
    )
    samples = 1000
    source, rows = validate(robot, samples)
    page.text(f"Largest difference over {samples} random states, velocities up to 10 rad/s, against {source}:")
    return page.comparison(rows, "entry")


def _free_swing(robot: Robot, page: Report) -> None:
    page.heading("Free swing, 10 s from rest at q = 0 (thesis 6.4-1, Figure 6.9)")
    swing = simulate(robot, np.zeros(robot.n), np.zeros(robot.n), 10.0, rtol=1e-9)
    page.text(
        f"{swing.method}, rtol 1e-9: {swing.evaluations} evaluations, energy {swing.energy[0]:.5f} J, "
        f"largest energy error {swing.energy_drift:.1e} J."
    )
    page.text(swing.message)
    caption = "Joint positions as in Figure 6.9, energies and energy error of the free swing"
    page.figure("free_swing", lambda: plot_free_motion(swing, "Free swing 6.4-1 (Figure 6.9)"), caption)


def _closed_loop(robot: Robot, page: Report) -> None:
    page.heading("PD control with gravity compensation (thesis 6.5-1, Figures 6.11 and 6.12)")
    loop = CLOSED_LOOPS[0]
    law = pd_gravity(robot, KP, KD, loop.reference)
    motion = simulate(robot, loop.start, np.zeros(robot.n), loop.duration, torque=law, t_eval=fine_grid(loop.duration))
    low, high = SETTLING
    settled = settling_time(motion, loop.reference)
    page.text(
        f"{motion.method}: {motion.evaluations} evaluations. "
        f"{'Confirmed' if low <= settled <= high else 'Not confirmed'}. "
        f"Criterion: every joint within {SETTLED:g} rad for good after {low:g} to {high:g} s. "
        f"Found: {f'after {settled:.3f} s' if np.isfinite(settled) else 'never'}."
    )
    page.text(motion.message)
    for title, name, note, plot in (
        ("Figure 6.11: joint positions of run 6.5-1", "figure_6_11", REFERENCE, plot_loop_positions),
        ("Figure 6.12: control inputs of run 6.5-1", "figure_6_12", GRAVITY, plot_loop_inputs),
    ):
        page.heading(title, 3)
        page.figure(name, lambda title=title, plot=plot: plot(title, motion, loop.reference), title)  # type: ignore[misc]
        page.text(note)
    page.heading("Not in the thesis: small errors", 3)
    title = "Errors of run 6.5-1"
    page.figure("loop_1", lambda: plot_errors(title, motion, loop.reference), "Errors of 6.5-1 on a log axis")


def fine_grid(duration: float) -> Array:
    """Times 5e-5 s apart at first, then 1e-3 s [s]."""
    first = min(FIRST, duration)
    later = np.linspace(first, duration, 1 + round((duration - first) / 1e-3))
    times: Array = np.r_[np.linspace(0, first, 401)[:-1], later]
    return times


def settling_time(motion: Trajectory, reference: ArrayLike) -> float:
    """First sample from which on every joint stays within 0.01 rad of its reference [s]; infinity if there is none."""
    outside = np.flatnonzero((np.abs(motion.q - np.asarray(reference)) > SETTLED).any(axis=1))
    return float(np.append(motion.t, np.inf)[outside[-1] + 1 if len(outside) else 0])


def plot_robot(robot: Robot, q: ArrayLike) -> Figure:
    """The robot at q, with its legend below."""
    figure = blank_figure(WIDTH, 5.6)
    figure.set_layout_engine("none")
    ax = figure.add_axes((0.0, 0.24, 0.96, 0.76), projection="3d")
    draw(robot, q, axes=ax)
    beside: Any = ax.get_legend()
    beside.remove()
    labels = [text.get_text() for text in beside.get_texts()]
    figure.legend(beside.legend_handles, labels, loc="lower center", ncols=2)
    return figure


def plot_free_motion(motion: Trajectory, title: str) -> Figure:
    """Joint positions, energies and the energy error of a motion without drives."""
    figure, small, (upper, lower) = joint_grid(title, JOINTS, [2.0, 1.6])
    for k, ax in enumerate(small):
        lines(ax, motion.t, motion.q[:, [k]], [""])
    energies = np.stack([motion.kinetic, motion.potential, motion.energy], axis=1)
    drawn = lines(upper, motion.t, energies, ("kinetic", "potential", "total"))
    upper.set_title("energy [J]")
    lines(lower, motion.t, motion.balance[:, None], [""], color="0.5")
    lower.set_title("energy error [J]")
    figure.legend(handles=drawn, **BELOW)
    return figure


def plot_loop_positions(title: str, motion: Trajectory, reference: ArrayLike) -> Figure:
    """Joint positions of a closed loop, and their references."""
    figure, (ax,) = column(title, [2.8])
    drawn = lines(ax, motion.t, motion.q, JOINTS)
    for k, q in enumerate(np.asarray(reference)):
        ax.axhline(q, color=f"C{k}", linestyle=":", linewidth=1)
    ax.set_title("q [rad]")
    figure.legend(handles=drawn, **BELOW)
    return figure


def plot_loop_inputs(title: str, motion: Trajectory, reference: ArrayLike) -> Figure:
    """Inputs of a closed loop, without gravity's share as in the thesis, and with it."""
    u = inputs(motion, reference)
    figure, axes = column(title, [1.9, 2.3, 2.3], share=False)
    later = motion.t >= min(FIRST, motion.t[-1])
    for ax, values, part, scale, text in (
        (axes[0], u, ~later, 1e3, "u without gravity's share, at first [N m]"),
        (axes[1], u, later, 1, "u without gravity's share, (6.58) [N m]"),
        (axes[2], motion.tau, later, 1, "τ = u + g(q), with gravity's share [N m]"),
    ):
        drawn = lines(ax, scale * motion.t[part], values[part], JOINTS)
        ax.set_title(text)
    axes[0].set_xlabel("time [ms]")
    figure.legend(handles=drawn, **BELOW)
    return figure


def inputs(motion: Trajectory, reference: ArrayLike) -> Array:
    """The inputs u = -Kp q~ - Kd qd of (6.57)-(6.58), without gravity's share, shape (T, 6) [N m]."""
    u: Array = -np.array(KP) * (motion.q - np.asarray(reference)) - np.array(KD) * motion.qd
    return u


def plot_errors(title: str, motion: Trajectory, reference: ArrayLike) -> Figure:
    """Errors of a closed loop on a log axis."""
    figure, (ax,) = column(title, [2.8])
    error = np.abs(motion.q - np.asarray(reference))
    drawn = log_lines(ax, motion.t, np.maximum(error, SMALLEST), JOINTS)
    ax.set_ylim(SMALLEST, 10)
    ax.axhline(SETTLED, color="0.5", linestyle="--", linewidth=1)
    ax.set_title("|q - reference| [rad]; dashed: 0.01 rad")
    figure.legend(handles=drawn, **BELOW)
    return figure
