"""rne view: a robot or its motion as an HTML page with a 3-D view."""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from .motion_files import read_motion
from .shared import (
    CommandError,
    add_parser,
    add_robot,
    check_file,
    in_one_line,
    number,
    robot_of,
    say,
    warnings_in_one_line,
)

if TYPE_CHECKING:
    import rne

    from ..basics.spatial import Array

EXAMPLE = "rne view panda.urdf --motion model.npz --other measured.csv --out panda.html"
MOTION = ".npz of rne.Trajectory.save, or .csv with columns t and q.<joint> [s, rad or m]"
SUFFIXES = (".html", ".htm")


def add(commands: Any) -> None:
    """Register the subcommand."""
    parser = add_parser(commands, "view", "write a robot or its motion as an HTML page with a 3-D view", EXAMPLE)
    add_robot(parser)
    parser.add_argument("--motion", metavar="FILE", type=Path, help=f"{MOTION}; else the zero position")
    parser.add_argument("--other", metavar="FILE", type=Path, help="a second motion, shown half transparent")
    parser.add_argument("--degrees", action="store_true", help="angles of .csv files are in degrees")
    parser.add_argument("--out", metavar="FILE.html", type=Path, help="page to write (default: <name of ROBOT>.html)")
    parser.add_argument("--speed", type=number, default=1.0, help="seconds of the motion per second (default: 1)")
    parser.add_argument("--frames", action="store_true", help="show the links' frames at first")
    parser.add_argument("--inertia", action="store_true", help="show centres of mass and inertia ellipsoids at first")
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Write the page, and say where and how large it is."""
    import rne

    out = arguments.out or Path(f"{Path(arguments.robot).stem}.html")
    check_file(out, suffixes=SUFFIXES)
    robot = robot_of(arguments)
    labels = [file.stem for file in (arguments.motion or out, arguments.other or out)]
    try:
        motion, other = (
            None if file is None else _motion(file, robot, arguments.degrees)
            for file in (arguments.motion, arguments.other)
        )
        shown = {name: getattr(arguments, name) for name in ("speed", "frames", "inertia")}
        with warnings_in_one_line():
            if isinstance(motion, rne.Trajectory):
                page = rne.view(motion, out, other=other, labels=labels, **shown)
            else:
                t, q = (None, None) if motion is None else motion
                page = rne.view(robot, out, q=q, t=t, other=other, labels=labels, **shown)
    except (ValueError, ImportError) as error:
        raise CommandError(in_one_line(error).replace("`speed`", "--speed")) from None
    say(f"{page.path}: {len(page.html.encode()) / 1e6:.2f} MB")
    return 0


def _motion(file: Path, robot: rne.Robot, degrees: bool) -> rne.Trajectory | tuple[Array, Array]:
    """The motion in a file: with this robot's model, or times and positions."""
    import rne

    if file.suffix.lower() == ".npz":
        motion = rne.Trajectory.load(file)
        if motion.q.shape[1] != robot.n:
            raise ValueError(f"{file}: robot {robot.model.name!r} has {robot.n} joints, the motion {motion.q.shape[1]}")
        names = () if motion.model is None else motion.model.joint_names
        if names and names != robot.joint_names:
            raise ValueError(f"{file}: the motion is of joints {list(names)}, the robot has {list(robot.joint_names)}")
        return replace(motion, model=robot.model)
    if file.suffix.lower() != ".csv":
        raise ValueError(f"{file}: a motion must be a file ending in .npz or .csv")
    samples = read_motion(file, robot, degrees=degrees)
    return samples.t, samples.q
