"""rne simulate: a motion from an initial state, written to a file."""

from __future__ import annotations

import argparse
import re
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from .shared import (
    CommandError,
    add_parser,
    add_robot,
    check_file,
    fail,
    in_one_line,
    number,
    numbers,
    robot_of,
    say,
    say_limits,
    say_samples,
    units_of,
    used,
    warnings_in_one_line,
    written,
)

if TYPE_CHECKING:
    import rne

NOT_GIVEN = " (not given: zero)"
SUFFIXES = (".npz", ".csv")
EXAMPLE = "rne simulate irb140 --q0 0 0.5 0 0 0 0 --duration 2 --out motion.csv"


def add(commands: Any) -> None:
    """Register the subcommand."""
    title = "simulate a motion and write it to a file"
    parser = add_parser(commands, "simulate", title, EXAMPLE)
    add_robot(parser)
    joints = "one number per joint, separated by blanks or commas"
    parser.add_argument("--q0", metavar="Q", type=numbers, help=f"initial positions [rad or m], {joints}; else zero")
    parser.add_argument("--qd0", metavar="QD", type=numbers, help="initial velocities [rad/s or m/s]; else at rest")
    parser.add_argument("--duration", metavar="S", type=number, required=True, help="[s]")
    parser.add_argument("--torque", metavar="TAU", type=numbers, help="constant drive torques [N m or N]; else none")
    parser.add_argument("--method", default="auto", help="solver of rne.simulate (default: auto)")
    parser.add_argument("--rtol", type=number, default=1e-6, help="relative tolerance (default: 1e-6)")
    parser.add_argument("--every", metavar="S", type=number, help="time between samples [s]; else the solver's steps")
    out = "file to write: .npz for rne.Trajectory.load, .csv for anything else"
    parser.add_argument("--out", metavar="FILE", type=Path, required=True, help=out)
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Simulate, write the file, and say from what and with which result; 1 if the simulation failed."""
    import rne

    check_file(arguments.out, suffixes=SUFFIXES)
    robot = robot_of(arguments)
    times = _times(arguments.duration, arguments.every)
    q0, qd0, torque = (_per_joint(robot, name, getattr(arguments, name)) for name in ("q0", "qd0", "torque"))
    say(used(robot, arguments))
    say(f"q0 {written(q0)} {units_of(robot, 'rad', 'm')}{NOT_GIVEN if arguments.q0 is None else ''}")
    say(f"qd0 {written(qd0)} {units_of(robot, 'rad/s', 'm/s')}{NOT_GIVEN if arguments.qd0 is None else ''}")
    say(f"torque {written(torque)} {units_of(robot, 'N m', 'N')}{NOT_GIVEN if arguments.torque is None else ''}")
    say("rigid bodies alone: no friction, stops or torque limits")
    try:
        with warnings_in_one_line():
            options = {"method": arguments.method, "rtol": arguments.rtol, "t_eval": times}
            law = None if arguments.torque is None else torque
            motion = rne.simulate(robot, q0, qd0, arguments.duration, torque=law, **options)
    except ValueError as error:
        raise CommandError(re.sub("`(method|rtol|duration)`", r"--\1", in_one_line(error))) from None
    except rne.SimulationError as error:
        fail(in_one_line(error))
        return 1
    (motion.save if arguments.out.suffix.lower() == ".npz" else motion.to_csv)(arguments.out)
    say(motion.message)
    say(f"energy drift {motion.energy_drift:.3g} J")
    say_limits(say, robot, motion.check_limits())
    say_samples(arguments.out, motion.t)
    return 0


def _per_joint(robot: rne.Robot, option: str, given: list[float] | None) -> list[float]:
    if given is None:
        return [0.0] * robot.n
    if len(given) != robot.n:
        names = ", ".join(robot.joint_names)
        raise CommandError(f"--{option}: must be {robot.n} numbers, for {names}; got {len(given)}")
    return given


def _times(duration: float, every: float | None) -> list[float] | None:
    """Samples at equal intervals from 0, the end included."""
    if every is None:
        return None
    if not 0 < every <= duration:
        raise CommandError(f"--every: must be positive and at most the duration of {duration:g} s, got {every:g}")
    return [*np.arange(0.0, duration - 1e-9 * every, every).tolist(), duration]
