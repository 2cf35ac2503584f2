"""The page on any robot: what its file holds, how it compares with an independent source, a free swing."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np

from ..basics.arrays import UNBOUNDED
from ..basics.spatial import Array
from ..errors import SimulationError, SingularMassMatrixError
from ..model.model import Model
from ..plotting import draw, plot
from ..robot import Robot
from ..simulation.simulator import simulate
from ..thesis.page import Page
from ..validation.agreement import ROUNDING, random_states, validate

SAMPLES = 1000  # random states
DURATION = 2.0  # of the swing [s]


def write_robot_page(robot: Robot, findings: str, folder: Path, say: Callable[[str], None]) -> bool:
    """Examine a robot and write the page.

    Parameters
    ----------
    robot : Robot
    findings : str
        What `rne.check` prints about its file; empty for a robot that has none.
    folder : Path
        For the HTML page and its pictures; made if it does not exist.
    say : callable
        Called with each line of text.

    Returns
    -------
    bool
        True if all differences from the independent source are within their bounds.
    """
    folder.mkdir(parents=True, exist_ok=True)
    page = Page(f"Robot {robot.model.name}", say, folder)
    for line in repr(robot).splitlines():
        page.text(line.strip())
    home = _home(robot)
    page.figure("robot", lambda: draw(robot, home), f"The robot at {_place(home)}")
    if findings:
        page.heading("Findings in the file")
        for line in findings.splitlines():
            page.text(line)
    _parts(robot.model, page)
    held = _comparison(robot, page)
    _gravity(robot, home, page)
    _swing(robot, home, page)
    page.end()
    say(f"page: {page.write()}")
    return held


def _parts(model: Model, page: Page) -> None:
    page.heading("Joints and links")
    units = ["rad" if revolute else "m" for revolute in model.is_revolute]
    page.table(
        ["joint", "type", "range", "largest rate", "largest effort"],
        [
            [
                name,
                kind if i in model.independent_joints else f"{kind}, mimics another",
                f"{_limit(model.lower[i])} ... {_limit(model.upper[i])} {unit}",
                f"{_limit(model.velocity_limit[i])} {unit}/s",
                f"{_limit(model.effort_limit[i])} {'N m' if unit == 'rad' else 'N'}",
            ]
            for i, (name, kind, unit) in enumerate(zip(model.moving_joints, model.joint_types, units, strict=True))
        ],
    )
    page.text("Masses, centres and principal inertias of the moving bodies, links on fixed joints included:")
    page.table(
        ["body behind", "mass [kg]", "centre of mass in the joint's frame [m]", "principal inertias [kg m^2]"],
        [
            [name, f"{model.mass[i]:.4g}", _numbers(model.com[i]), _numbers(np.linalg.eigvalsh(model.inertia[i]))]
            for i, name in enumerate(model.moving_joints)
        ],
    )


def _comparison(robot: Robot, page: Page) -> bool:
    page.heading("Comparison with an independent source")
    source, rows = validate(robot, SAMPLES, by_terms=True)
    page.text(f"Largest difference over {SAMPLES} random states, rates up to 10 rad/s or m/s, against {source}:")
    return page.comparison(rows, "term")


def _gravity(robot: Robot, home: Array, page: Page) -> None:
    page.heading("Torques against gravity")
    largest = np.abs(robot.gravity_torque(_positions(robot))).max(axis=0)
    holding = robot.gravity_torque(home)
    page.text(f"At {_place(home)}, and the largest over {SAMPLES} random positions within the joints' ranges:")
    page.table(
        ["joint", "at that position [N m or N]", "largest [N m or N]", "largest / effort"],
        [
            [name, _torque(hold, largest), _torque(most, largest), _share(most, bound)]
            for name, hold, most, bound in zip(robot.joint_names, holding, largest, robot.effort_limit, strict=True)
        ],
    )


def _home(robot: Robot) -> Array:
    """The position nearest to q = 0 within the joints' ranges."""
    home: Array = np.clip(0.0, robot.lower, robot.upper)
    return home


def _place(home: Array) -> str:
    return "q = 0" if not home.any() else f"q = ({_numbers(home)}), within the ranges nearest to 0"


def _positions(robot: Robot) -> Array:
    """Random positions within the ranges of the joints; where one has no end, it is 2 pi long."""
    q, _, _ = random_states(robot.n, SAMPLES)
    low = np.where(np.isfinite(robot.lower), robot.lower, np.minimum(-np.pi, robot.upper - 2 * np.pi))
    high = np.where(np.isfinite(robot.upper), robot.upper, np.maximum(np.pi, low + 2 * np.pi))
    within: Array = low + (q / (2 * np.pi) + 0.5) * (high - low)
    return within


def _swing(robot: Robot, home: Array, page: Page) -> None:
    page.heading(f"Free swing of {DURATION:g} s from rest at that position, without friction and limits")
    try:
        motion = simulate(robot, home, np.zeros(robot.n), DURATION)
    except (SimulationError, SingularMassMatrixError) as error:
        page.text(f"The swing cannot be simulated: {error}")
        return
    page.text(f"{motion.evaluations} evaluations, largest energy error {motion.energy_drift:.1e} J. {motion.message}.")
    page.figure("swing", lambda: plot(motion), f"Free swing from rest at {_place(home)}")


def _torque(x: float, largest: Array) -> str:
    """A torque; what rounding leaves of zero is 0."""
    return f"{x:.4g}" if abs(x) > ROUNDING * largest.max(initial=0.0) else "0"


def _share(most: float, effort: float) -> str:
    if effort == 0:
        return "the drive has none"
    return f"{most / effort:.0%}" if effort < UNBOUNDED else "effort unknown"


def _limit(x: float) -> str:
    return "unlimited" if abs(x) >= UNBOUNDED else f"{x:.4g}"


def _numbers(x: Array) -> str:
    return ", ".join(f"{value:.3g}" for value in x + 0.0)
