"""rne torques: the drive torques of a motion given by samples in a CSV file."""

from __future__ import annotations

import argparse
import csv
import io
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..basics.text import UNITS
from . import motion_files as files
from .shared import (
    CommandError,
    add_parser,
    add_robot,
    check_file,
    in_one_line,
    note,
    number,
    robot_of,
    say,
    say_limits,
    say_samples,
    units_of,
    used,
    warnings_in_one_line,
)

if TYPE_CHECKING:
    import rne

    from ..basics.spatial import Array

NOISY = 0.05  # torque made by noise, relative to the torque of the joint (rms), above which a warning is given


def add(commands: Any) -> None:
    """Register the subcommand."""
    title = "compute the torques of a motion in a CSV file"
    parser = add_parser(commands, "torques", title, "rne torques irb140 motion.csv --out torques.csv")
    add_robot(parser)
    columns = "CSV with columns t and q.<joint>, if known qd.<joint> and qdd.<joint>, in any order [s, rad or m]"
    parser.add_argument("motion", metavar="MOTION.csv", type=Path, help=columns)
    degrees = "q, qd and qdd of rotating joints are in degrees"
    parser.add_argument("--degrees", action="store_true", help=degrees)
    cutoff = "filter the columns without delay before they are differentiated: Butterworth, cut off at HZ"
    parser.add_argument("--cutoff", metavar="HZ", type=number, help=cutoff)
    out = "CSV file to write, columns t and tau.<joint> (default: standard output)"
    parser.add_argument("--out", metavar="FILE", type=Path, help=out)
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Write the torques, and say how they were computed: on standard error if the torques go to standard output."""
    from ..simulation.limits import limit_violations

    check_file(arguments.out)
    robot = robot_of(arguments)
    try:
        given = files.read_motion(arguments.motion, robot, degrees=arguments.degrees)
        if given.qd is None:
            files.refuse_wrapped_angles(given, robot, arguments.motion)
        motion, change = given, ""
        if arguments.cutoff is not None:
            motion, change = files.filtered(given, arguments.cutoff)
        q, qd, qdd, source = files.differentiated(motion, arguments.motion)
        with warnings_in_one_line():
            tau = robot.inverse_dynamics(q, qd, qdd)
    except ValueError as error:
        raise CommandError(in_one_line(error)) from None
    tell = note if arguments.out is None else say
    tell(used(robot, arguments))
    tell(source)
    if change:
        tell(change)
    if given.qd is None or given.qdd is None:
        files.warn_of_uneven_steps(given.t)
        warn_of_noise(robot, given, arguments, tau)
    tell(f"tau in {units_of(robot, *UNITS['tau'])}: rigid bodies alone, without friction and inertia of the drives")
    say_limits(tell, robot, limit_violations(robot.model, motion.t, q, qd, tau))
    text = _csv(robot, motion.t, tau)
    if arguments.out is None:
        print(text, end="")
    else:
        arguments.out.write_text(text, encoding="utf-8", newline="")
        say_samples(arguments.out, motion.t)
    return 0


def warn_of_noise(robot: rne.Robot, given: files.SampledMotion, arguments: argparse.Namespace, tau: Array) -> None:
    """Warn if noise makes more than 5 % of a joint's torque; computed by adding noise of the same size once more."""
    name = "q" if given.qd is None else "qd"  # the column that is differentiated
    x: Array = getattr(given, name)
    sigma = files.noise(given.t, x)
    if not sigma.any():
        return
    shaken = given._replace(**{name: x + sigma * np.random.default_rng(0).normal(size=x.shape)})
    if arguments.cutoff is not None:
        shaken, _ = files.filtered(shaken, arguments.cutoff)
    q, qd, qdd, _ = files.differentiated(shaken, arguments.motion)
    made, own = _rms(robot.inverse_dynamics(q, qd, qdd) - tau), _rms(tau) + _rms(robot.gravity_torque(q))
    share = made / np.maximum(own, 1e-3 * own.max())  # a joint that carries nothing is compared with the others
    if share.max() <= NOISY:
        return
    k, worst = int(np.where(share > NOISY, made, 0.0).argmax()), int(sigma.argmax())
    cutoff = files.suggested_cutoff(given.t, x, sigma)
    cure = "give samples at even steps and --cutoff" if cutoff is None else f"give --cutoff {cutoff:.2g}"
    unit = UNITS["tau"][not files.rotating(robot)[k]]
    note(
        f"warning: {name}.{robot.joint_names[worst]} scatters by about {sigma[worst]:.1g} from sample to sample, and "
        f"derivatives turn such noise into about {made[k]:.3g} {unit} (rms) on {robot.joint_names[k]}, more than "
        f"{NOISY:.0%} of its torque: {cure}, or give velocities and accelerations"
    )


def _rms(x: Array) -> Array:
    size: Array = np.sqrt((x**2).mean(axis=0))
    return size


def _csv(robot: rne.Robot, t: Array, tau: Array) -> str:
    text = io.StringIO()
    table = csv.writer(text, lineterminator="\n")
    table.writerow(["t", *(f"tau.{joint}" for joint in robot.joint_names)])
    table.writerows([time, *row] for time, row in zip(t.tolist(), tau.tolist(), strict=True))
    return text.getvalue()
