"""rne torques: the drive torques of a motion given by samples in a CSV file."""

from __future__ import annotations

import argparse
import csv
import io
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any

from .shared import (
    CommandError,
    add_parser,
    add_robot,
    check_file,
    in_one_line,
    note,
    robot_of,
    say,
    units_of,
    used,
    warnings_in_one_line,
)

UNEVEN = 100  # times the shortest step, from which the longest is worth a word

if TYPE_CHECKING:
    import rne

    from ..basics.spatial import Array
    from ..trajectories import Samples


def add(commands: Any) -> None:
    """Register the subcommand."""
    title = "compute the torques of a motion in a CSV file"
    parser = add_parser(commands, "torques", title, "rne torques irb140 motion.csv --out torques.csv")
    add_robot(parser)
    columns = "CSV with columns t and q.<joint>, if known qd.<joint> and qdd.<joint>, in any order [s, rad or m]"
    parser.add_argument("motion", metavar="MOTION.csv", type=Path, help=columns)
    out = "CSV file to write, columns t and tau.<joint> (default: standard output)"
    parser.add_argument("--out", metavar="FILE", type=Path, help=out)
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Write the torques; what was used goes to standard error if the torques go to standard output."""
    import rne

    from ..simulation.limits import limit_violations

    check_file(arguments.out)
    robot = robot_of(arguments)
    try:
        samples = rne.trajectories.read_csv(arguments.motion, robot.joint_names)
        q, qd, qdd, source = _motion(samples, robot, arguments.motion)
        with warnings_in_one_line():
            tau = robot.inverse_dynamics(q, qd, qdd)
    except ValueError as error:
        raise CommandError(in_one_line(error)) from None
    text = _csv(robot, samples.t, tau)
    tell = note if arguments.out is None else say
    tell(used(robot, arguments))
    tell(source)
    if samples.qd is None or samples.qdd is None:
        tell_of_uneven_steps(samples.t)
    tell(f"tau in {units_of(robot, 'N m', 'N')}: rigid bodies alone, without friction and inertia of the drives")
    exceeded = limit_violations(robot.model, samples.t, q, qd, tau)
    tell(f"limits exceeded: {len(exceeded) or 'none'}")
    for violation in exceeded:
        tell(f"  {violation}")
    if arguments.out is None:
        print(text, end="")
    else:
        arguments.out.write_text(text, encoding="utf-8", newline="")
        say(f"{arguments.out}: {len(tau)} samples from {samples.t[0]:g} to {samples.t[-1]:g} s")
    return 0


def _motion(samples: Samples, robot: rne.Robot, file: Path) -> tuple[Array, Array, Array, str]:
    """Positions, rates and accelerations of the file, or from splines through what it has; a line says which."""
    import rne

    if samples.q is None:
        needed = ", ".join(repr(f"q.{joint}") for joint in robot.joint_names)
        raise CommandError(f"{file}, row 1: there are no positions; needed are {needed}")
    if samples.qd is not None and samples.qdd is not None:
        return samples.q, samples.qd, samples.qdd, f"q, qd and qdd from {file}"
    given = samples.q if samples.qd is None else samples.qd
    try:
        path = rne.trajectories.spline(samples.t, given)
    except ValueError as error:
        what = "rates and accelerations" if samples.qd is None else "accelerations"
        raise CommandError(f"{file}: {what} are missing, and no spline gives them: {in_one_line(error)}") from None
    _, first, second = path(samples.t)
    kind = f"spline of degree {path.degree}"
    if samples.qd is not None:
        return samples.q, samples.qd, first, f"q and qd from {file}; qdd: derivative of a {kind} through qd"
    if samples.qdd is not None:
        return samples.q, first, samples.qdd, f"q and qdd from {file}; qd: derivative of a {kind} through q"
    return samples.q, first, second, f"q from {file}; qd and qdd: derivatives of a {kind} through q"


def tell_of_uneven_steps(t: Array) -> None:
    """Warn where a derivative amplifies the rounding of samples that are close together."""
    steps = [later - sooner for sooner, later in pairwise(t.tolist())]
    shortest, longest = min(steps, default=1.0), max(steps, default=1.0)
    if longest > UNEVEN * shortest:
        note(
            f"warning: the times are {shortest:.2g} to {longest:.2g} s apart; where they are close, derivatives "
            "amplify the rounding of the samples: give samples at even times, or rates and accelerations"
        )


def _csv(robot: rne.Robot, t: Array, tau: Array) -> str:
    text = io.StringIO()
    table = csv.writer(text, lineterminator="\n")
    table.writerow(["t", *(f"tau.{joint}" for joint in robot.joint_names)])
    table.writerows([time, *row] for time, row in zip(t.tolist(), tau.tolist(), strict=True))
    return text.getvalue()
