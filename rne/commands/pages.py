"""The pages of the main job, on the ABB IRB 140, and of `rne report`, on any robot."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from ..basics.arrays import UNBOUNDED
from ..basics.spatial import Array
from ..control.laws import pd_gravity
from ..errors import SimulationError, SingularMassMatrixError
from ..model.abb_irb140 import CLOSED_LOOPS, KD, KP
from ..model.model import Model
from ..plotting.html_page import Report, column, lines, log_lines
from ..plotting.notebook import BODIES, body_table, joint_table
from ..plotting.plots import BELOW
from ..plotting.robot_picture import small_picture
from ..robot import Robot
from ..simulation.simulator import simulate
from ..simulation.trajectory import Trajectory
from ..urdf.loading import load
from ..validation.agreement import validate
from .shared import units_of

if TYPE_CHECKING:
    from matplotlib.figure import Figure

SAMPLES = 1000  # random states
ROUNDING = 1e-13  # of the largest torque: what is left of zero
SWING, MAIN_SWING = 2.0, 10.0  # durations of free swings [s]
STRETCHED_OUT = np.array([0, np.pi / 2, -np.pi / 2, 0, 0, 0])  # [rad], horizontally: (6.19)
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


def write_main_page(folder: Path, say: Callable[[str], None]) -> bool:
    """Run the main job and write its page; True if all differences from the source are within their bounds."""
    started = time.perf_counter()
    robot = load("irb140")
    page = Report("ABB IRB 140 by recursive Newton-Euler", say, folder)
    page.text("Joints are called joint_1 to joint_6 as in the model; the thesis writes q_1 to q_6.")
    held = _examination(robot, STRETCHED_OUT, "q = (0, π/2, -π/2, 0, 0, 0), the pose of (6.19)", "", page)
    page.heading("Free swing, 10 s from rest at q = 0 (thesis 6.4-1, Figure 6.6; the duration is ours)")
    swing = simulate(robot, np.zeros(robot.n), np.zeros(robot.n), MAIN_SWING, rtol=1e-9)
    page.text(repr(swing), "pre")
    caption = "Figure 6.6: joint positions of run 6.4-1"
    page.figure("figure_6_6", lambda: plot_each_joint(caption, swing), caption)
    page.motion("swing", swing, "Free swing")
    _closed_loop(robot, page)
    page.text(f"Done in {time.perf_counter() - started:.1f} s.")
    say(f"page: {page.write()}")
    return held


def write_robot_page(robot: Robot, findings: str, folder: Path, say: Callable[[str], None]) -> bool:
    """Examine a robot and write the page; `findings` are the lines that `rne.check` prints about its file.

    True if all differences from the independent source are within their bounds; False if M is singular.
    """
    page = Report(f"Robot {robot.model.name}", say, folder)
    home: Array = np.clip(0.0, robot.lower, robot.upper)  # the position nearest to q = 0 within the joints' ranges
    place = f"q = ({', '.join(f'{x:.3g}' for x in home)}), within the ranges nearest to 0" if home.any() else "q = 0"
    held = _examination(robot, home, place, findings, page, by_terms=True)
    page.heading(f"Free swing of {SWING:g} s from rest at {place}, without friction and limits")
    _swing(robot, home, page)
    say(f"page: {page.write()}")
    return held


def _examination(robot: Robot, q: Array, place: str, findings: str, page: Report, *, by_terms: bool = False) -> bool:
    """What the robot consists of, whether the independent source agrees, and torques against gravity."""
    for line in repr(robot).splitlines():
        page.text(line.strip())
    page.figure("robot", lambda: small_picture(robot, q), f"The robot at {place}")
    if findings:
        page.heading("Findings in the file")
        for line in findings.splitlines():
            page.text(line)
    page.heading("Joints and links")
    heads, *rows = joint_table(robot.model)
    page.table(heads, rows)
    page.text(BODIES)
    heads, *rows = body_table(robot.model)
    page.table(heads, rows)
    page.heading("Comparison with an independent source")
    held = _comparison(robot, page, by_terms)
    page.heading("Torques against gravity")
    _gravity(robot, q, place, page)
    return held


def _comparison(robot: Robot, page: Report, by_terms: bool) -> bool:
    try:
        source, rows = validate(robot, SAMPLES, by_terms=by_terms)
    except SingularMassMatrixError as error:
        page.text(f"Not compared, as forward dynamics do not exist: {error}.")
        return False
    page.text(f"Largest difference over {SAMPLES} random states, velocities up to 10 rad/s or m/s, against {source}:")
    difference = f"largest difference, relative to the largest {'term' if by_terms else 'entry'}"
    held = [row.worst <= row.bound for row in rows]
    page.table(
        ["quantity", "symbol", difference, "bound", "within bound"],
        [
            [row.quantity, row.symbol, f"{row.worst:.1e}", f"{row.bound:.1e}", "yes" if is_held else "NO"]
            for row, is_held in zip(rows, held, strict=True)
        ],
    )
    return all(held)


def carried_masses(model: Model) -> Array:
    """The mass behind each joint: the body that it moves and all bodies beyond, shape (nb,) [kg]."""
    carried = model.mass.copy()
    for i in reversed(range(model.nb)):
        if model.parent[i] >= 0:
            carried[model.parent[i]] += carried[i]
    return carried


def _gravity(robot: Robot, q: Array, place: str, page: Report) -> None:
    holding, largest = robot.gravity_torque(q), np.abs(robot.gravity_torque(_positions(robot))).max(axis=0)
    rounding = ROUNDING * largest.max(initial=0.0)
    carried = carried_masses(robot.model)[list(robot.model.independent_joints)]
    unit = units_of(robot, "N m", "N")
    page.text(f"At {place}, and the largest over {SAMPLES} random positions within the joints' ranges:")
    numbers = zip(robot.joint_names, carried, holding, largest, robot.effort_limit, strict=True)
    page.table(
        [
            "joint",
            "mass behind the joint [kg]",
            f"at that position [{unit}]",
            f"largest [{unit}]",
            "largest / effort",
        ],
        [
            [name, f"{mass:g}", *(f"{x:.5g}" if abs(x) > rounding else "0" for x in (hold, most)), _share(most, bound)]
            for name, mass, hold, most, bound in numbers
        ],
    )


def _positions(robot: Robot) -> Array:
    """Random positions within the ranges of the joints; where one has no end, it is at least 2 pi long."""
    low = np.where(np.isfinite(robot.lower), robot.lower, np.minimum(-np.pi, robot.upper - 2 * np.pi))
    high = np.where(np.isfinite(robot.upper), robot.upper, np.maximum(np.pi, low + 2 * np.pi))
    return np.random.default_rng(0).uniform(low, high, (SAMPLES, robot.n))


def _share(most: float, effort: float) -> str:
    if effort == 0:
        return "the drive has none"
    return f"{most / effort:.0%}" if effort < UNBOUNDED else "effort unknown"


def _swing(robot: Robot, start: Array, page: Report) -> None:
    try:
        motion = simulate(robot, start, np.zeros(robot.n), SWING)
    except (SimulationError, SingularMassMatrixError) as error:
        page.text(f"The swing cannot be simulated: {error}")
        return
    page.text(repr(motion), "pre")
    page.motion("swing", motion, "Free swing")


def _closed_loop(robot: Robot, page: Report) -> None:
    page.heading("PD control with gravity compensation (thesis 6.5-1, Figures 6.11 and 6.12)")
    loop = CLOSED_LOOPS[0]
    law = pd_gravity(robot, KP, KD, loop.reference)
    motion = simulate(robot, loop.start, np.zeros(robot.n), loop.duration, torque=law, t_eval=fine_grid(loop.duration))
    low, high = SETTLING
    settled = settling_time(motion, loop.reference)
    page.text(
        f"{'Confirmed' if low <= settled <= high else 'Not confirmed'}. "
        f"Criterion: every joint within {SETTLED:g} rad for good after {low:g} to {high:g} s. "
        f"Found: {f'after {settled:.3f} s' if np.isfinite(settled) else 'never'}."
    )
    page.text(repr(motion), "pre")
    for heading, name, note, plot in (
        ("Figure 6.11: joint positions of run 6.5-1", "figure_6_11", REFERENCE, plot_loop_positions),
        ("Figure 6.12: control inputs of run 6.5-1", "figure_6_12", GRAVITY, plot_loop_inputs),
        ("Not in the thesis: errors of run 6.5-1", "loop_1", "", plot_errors),
    ):
        page.heading(heading, 3)
        page.figure(name, lambda title=heading, plot=plot: plot(title, motion, loop.reference), heading)  # type: ignore[misc]
        if note:
            page.text(note)


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


def plot_each_joint(title: str, motion: Trajectory) -> Figure:
    """Joint positions, each on a panel of its own."""
    figure, axes = column(title, [1.2] * len(JOINTS))
    for k, ax in enumerate(axes):
        lines(ax, motion.t, motion.q[:, [k]], [JOINTS[k]])
        ax.set_title(f"{JOINTS[k]} [rad]")
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
