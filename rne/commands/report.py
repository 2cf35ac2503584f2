"""Pages: `rne` without a command about the ABB IRB 140, `rne report ROBOT` about any robot."""

from __future__ import annotations

import argparse
import io
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..basics.arrays import UNBOUNDED
from ..basics.text import UNITS
from .shared import ROBOT, add_parser, check_folder, say

if TYPE_CHECKING:
    import rne

    from ..basics.spatial import Array
    from ..plotting.html_page import Report

FOLDER = Path("rne-report")
SAMPLES = 1000  # random states
DURATION = 2.0  # of the swing [s]
ROUNDING = 1e-13  # of the largest torque: what is left of zero


def add_out(parser: argparse.ArgumentParser, default: Any) -> None:
    """The option for the folder of a page."""
    text = "folder of the page, made if it does not exist (default: rne-report)"
    parser.add_argument("--out", metavar="DIR", type=Path, default=default, help=text)


def add(commands: Any) -> None:
    """Register the subcommand."""
    parser = add_parser(commands, "report", "write a page on a robot", "rne report arm.urdf --out arm-page")
    parser.add_argument("robot", metavar="ROBOT", help=ROBOT)
    add_out(parser, argparse.SUPPRESS)  # where it is not given here, that before the subcommand holds
    parser.set_defaults(run=run)


def run_main_page(arguments: argparse.Namespace) -> int:
    """Write the main page; 1 if a comparison exceeds its bound."""
    from .main_page import run

    check_folder(arguments.out)
    return 0 if run(arguments.out, say) else 1


def run(arguments: argparse.Namespace) -> int:
    """Write the page on the robot; 1 if a comparison exceeds its bound."""
    import rne

    from ..urdf.loading import resolve

    robot = rne.load(arguments.robot)
    check_folder(arguments.out)
    printed = io.StringIO()
    if isinstance(resolve(arguments.robot), str):  # the path of a file
        rne.check(arguments.robot, out=printed)
    return 0 if write_robot_page(robot, printed.getvalue().strip(), arguments.out, say) else 1


def write_robot_page(robot: rne.Robot, findings: str, folder: Path, say: Callable[[str], None]) -> bool:
    """Examine a robot and write the page.

    Parameters
    ----------
    robot : Robot
    findings : str
        The lines that `rne.check` prints about its file; empty for a robot that has none.
    folder : Path
        For the HTML page and its pictures; made if it does not exist.
    say : callable
        Called with each line of text.

    Returns
    -------
    bool
        True if all differences from the independent source are within their bounds; False if M is singular.
    """
    from ..plotting import draw
    from ..plotting.html_page import Report

    page = Report(f"Robot {robot.model.name}", say, folder)
    for line in repr(robot).splitlines():
        page.text(line.strip())
    home: Array = np.clip(0.0, robot.lower, robot.upper)  # the position nearest to q = 0 within the joints' ranges
    place = f"q = ({_numbers(home)}), within the ranges nearest to 0" if home.any() else "q = 0"
    page.figure("robot", lambda: draw(robot, home), f"The robot at {place}")
    if findings:
        page.heading("Findings in the file")
        for line in findings.splitlines():
            page.text(line)
    _parts(robot.model, page)
    held = _comparison(robot, page)
    _gravity(robot, home, place, page)
    _swing(robot, home, place, page)
    say(f"page: {page.write()}")
    return held


def _parts(model: rne.Model, page: Report) -> None:
    page.heading("Joints and links")
    rows = []
    for i, (name, kind) in enumerate(zip(model.moving_joints, model.joint_types, strict=True)):
        unit, speed, effort = (UNITS[quantity][not model.is_revolute[i]] for quantity in ("q", "qd", "tau"))
        rows.append(
            [
                name,
                kind if i in model.independent_joints else f"{kind}, mimics another",
                f"{_limit(model.lower[i])} ... {_limit(model.upper[i])} {unit}",
                f"{_limit(model.velocity_limit[i])} {speed}",
                f"{_limit(model.effort_limit[i])} {effort}",
            ]
        )
    page.table(["joint", "type", "range", "largest velocity", "largest effort"], rows)
    page.text("Masses, centres and principal inertias of the moving bodies, links on fixed joints included:")
    page.table(
        ["body behind", "mass [kg]", "centre of mass in the joint's frame [m]", "principal inertias [kg m^2]"],
        [
            [name, f"{model.mass[i]:.4g}", _numbers(model.com[i]), _numbers(np.linalg.eigvalsh(model.inertia[i]))]
            for i, name in enumerate(model.moving_joints)
        ],
    )


def _comparison(robot: rne.Robot, page: Report) -> bool:
    import rne

    from ..validation.agreement import validate

    page.heading("Comparison with an independent source")
    try:
        source, rows = validate(robot, SAMPLES, by_terms=True)
    except rne.SingularMassMatrixError as error:
        page.text(f"Not compared, as forward dynamics do not exist: {error}.")
        return False
    page.text(f"Largest difference over {SAMPLES} random states, velocities up to 10 rad/s or m/s, against {source}:")
    return page.comparison(rows, "term")


def _gravity(robot: rne.Robot, home: Array, place: str, page: Report) -> None:
    page.heading("Torques against gravity")
    largest = np.abs(robot.gravity_torque(_positions(robot))).max(axis=0)
    rounding = ROUNDING * largest.max(initial=0.0)
    page.text(f"At {place}, and the largest over {SAMPLES} random positions within the joints' ranges:")
    page.table(
        ["joint", "at that position [N m or N]", "largest [N m or N]", "largest / effort"],
        [
            [name, *(f"{x:.4g}" if abs(x) > rounding else "0" for x in (hold, most)), _share(most, bound)]
            for name, hold, most, bound in zip(
                robot.joint_names, robot.gravity_torque(home), largest, robot.effort_limit, strict=True
            )
        ],
    )


def _positions(robot: rne.Robot) -> Array:
    """Random positions within the ranges of the joints; where one has no end, it is 2 pi long."""
    low = np.where(np.isfinite(robot.lower), robot.lower, np.minimum(-np.pi, robot.upper - 2 * np.pi))
    high = np.where(np.isfinite(robot.upper), robot.upper, np.maximum(np.pi, low + 2 * np.pi))
    return np.random.default_rng(0).uniform(low, high, (SAMPLES, robot.n))


def _swing(robot: rne.Robot, home: Array, place: str, page: Report) -> None:
    import rne

    page.heading(f"Free swing of {DURATION:g} s from rest at that position, without friction and limits")
    try:
        motion = rne.simulate(robot, home, np.zeros(robot.n), DURATION)
    except (rne.SimulationError, rne.SingularMassMatrixError) as error:
        page.text(f"The swing cannot be simulated: {error}")
        return
    page.text(f"{motion.evaluations} evaluations, largest energy error {motion.energy_drift:.1e} J. {motion.message}.")
    page.figure("swing", lambda: rne.plotting.plot(motion), f"Free swing from rest at {place}")


def _share(most: float, effort: float) -> str:
    if effort == 0:
        return "the drive has none"
    return f"{most / effort:.0%}" if effort < UNBOUNDED else "effort unknown"


def _limit(x: float) -> str:
    return "unlimited" if abs(x) >= UNBOUNDED else f"{x:.4g}"


def _numbers(x: Array) -> str:
    return ", ".join(f"{value:.3g}" for value in x + 0.0)
