"""rne cycle: from via points to the fastest motion and what the drives bear, as text and as a page."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

import numpy as np

from .shared import (
    CommandError,
    add_parser,
    add_robot,
    check_folder,
    in_one_line,
    number,
    numbers,
    robot_of,
    say,
    used,
    work,
)

EXAMPLE = "rne cycle irb140 via.csv --effort 250 250 150 50 50 20 --gear 100 --rotor 1e-4 --efficiency 0.85"
FILM = 0.02  # [s] between the positions of the film


def add_cycle(commands: Any) -> None:
    """Register `rne cycle`."""
    parser = add_parser(commands, "cycle", "drive through via points in least time and report on the drives", EXAMPLE)
    add_robot(parser)
    columns = "CSV with columns q.<joint>, a row for each via point [rad or m]"
    parser.add_argument("via", metavar="VIA.csv", type=Path, help=columns)
    parser.add_argument("--degrees", action="store_true", help="angles are in degrees")
    parser.add_argument("--stops", action="store_true", help="stand still at every via point")
    each = "one number for all joints or one for each"
    parser.add_argument("--acceleration", metavar="A", type=numbers, help=f"acceleration limits, {each} [rad/s^2]")
    smoothing = "time over which the motion is averaged, 0 for none (default: 0.01, more if jerk limits need it) [s]"
    parser.add_argument("--smoothing", metavar="S", type=number, help=smoothing)
    friction = "friction of the URDF's <dynamics> counts too"
    parser.add_argument("--friction", action="store_const", const="urdf", help=friction)
    options = ("gear", "gear ratios", 1.0), ("rotor", "rotors [kg m^2]", 0.0), ("efficiency", "of the gears, to 1", 1.0)
    for option, text, value in options:
        parser.add_argument(
            f"--{option}", metavar=option[0].upper(), type=numbers, default=[value], help=f"{text}, {each}"
        )
    folder = "folder for the page (default: rne-cycle)"
    parser.add_argument("--out", metavar="FOLDER", type=Path, default=Path("rne-cycle"), help=folder)
    parser.set_defaults(run=run_cycle)


def run_cycle(arguments: argparse.Namespace) -> int:
    """Plan the motion, print the reports and write the page."""
    import rne

    from ..plotting.html_page import Report
    from ..plotting.plots import small_plots, torque_speed
    from ..trajectories.csv_file import read_samples
    from .motion_files import rotating

    check_folder(arguments.out)
    robot = robot_of(arguments)
    try:
        if arguments.acceleration is not None:
            robot = robot.with_limits(acceleration=_per_joint(arguments.acceleration))
        q = read_samples(arguments.via, robot.joint_names, needed=["q"], timed=False).q
        assert q is not None
        if len(q) < 2:
            raise CommandError(f"{arguments.via}: a path needs two via points at least, there is one row")
        points = q * np.where(rotating(robot) & arguments.degrees, np.pi / 180, 1.0)
        path = rne.trajectories.through(points, stops=arguments.stops)
        work.begin("planning the motion")
        motion = rne.trajectories.fastest(robot, path, friction=arguments.friction, smoothing=arguments.smoothing)
        names = ("gear", "rotor", "efficiency")
        gear, rotor, efficiency = (_per_joint(getattr(arguments, name)) for name in names)
        report = rne.drives(robot, motion, gear=gear, rotor=rotor, efficiency=efficiency)
    except (ValueError, ImportError) as error:
        raise CommandError(in_one_line(error) + _cure(error, robot)) from None
    page = Report(f"A cycle of {robot.model.name}", say, arguments.out)
    page.text(used(robot, arguments))
    t = np.linspace(0, motion.duration, max(int(motion.duration / FILM), 2))
    page.film("motion", (t, motion(t)[0]), "The motion", robot)
    for title, result in (("Motion", motion), ("Drives", report)):
        page.heading(title)
        page.lines(str(result))
    page.figure("torque_speed", lambda: torque_speed(report), "Torque over speed of each joint, with its limits")
    page.heading("Positions, velocities and torques")
    for k, (label, draw) in enumerate(small_plots((report.t, report.q, report.qd, report.qdd, report.tau), robot)):
        page.figure(f"motion_{k}", draw, f"The motion: {label}")
    say(f"page: {page.write()}")
    return 0


def _cure(error: Exception, robot: Any) -> str:
    """What to do about an error on the command line, in words."""
    from ..trajectories.csv_file import MissingColumn
    from ..trajectories.time_optimal import MissingLimit, OutOfRange

    if isinstance(error, MissingLimit):
        return "; on the command line: --effort or --acceleration"
    if isinstance(error, MissingColumn):
        return f"; the first row must be {','.join(f'q.{name}' for name in robot.joint_names)}"
    return "; if the positions are in degrees, give --degrees" if isinstance(error, OutOfRange) else ""


def _per_joint(values: list[float]) -> float | list[float]:
    return values[0] if len(values) == 1 else values
