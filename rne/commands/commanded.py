"""Command rne identify --without-torques: numbers of a robot and its controller from commands and positions."""

from __future__ import annotations

import argparse
import importlib.util
from typing import Any

import numpy as np

import rne

from ..basics.text import counted, listed
from . import shared
from .shared import CommandError, note, number, numbers, used, work

NUMBERS = {  # of options with one number for all joints or one for each
    "kp": "gains of the position [N m/rad or N/m]",
    "kd": "gains of the velocity [N m s/rad or N s/m]",
    "stall_torque": "of servos, largest torques at rest [N m]",
    "no_load_speed": "of servos, speeds without load [rad/s]",
    "viscous": "viscous friction of each joint [N m s/rad or N s/m]",
    "coulomb": "Coulomb friction of each joint [N m or N]",
    "rotors": "inertias of rotors, times the gear ratio squared [kg m^2 or kg]",
}
OF_SERVOS = ("servo", "stall_torque", "no_load_speed")
OTHERS = ("controller", *NUMBERS, "servo", "wrt", "starts", "shot", "robust")  # options that need --without-torques


def add_commanded(parser: argparse.ArgumentParser) -> None:
    """Add the options of fits to commands and positions."""
    text = "the fit starts from these, which may be wrong by a factor of two; zeros stay zero"
    group = parser.add_argument_group("without torques", text)
    group.add_argument("--without-torques", action="store_true", help="fit a model to commanded and measured positions")
    group.add_argument("--controller", choices=("pd", "servo"), help="control of the drives (default: pd)")
    published = "servo of rne.control.servo_figures, whose published figures are the start, such as sts3215-7.4v"
    group.add_argument("--servo", metavar="NAME", help=published)
    for name, what in NUMBERS.items():
        letter = name[0].upper() if name[0] != "k" else name.upper()
        group.add_argument(f"--{name.replace('_', '-')}", metavar=letter, type=numbers, help=what)
    names = "what is fitted, such as controller.kp,parameters (default: all that there is)"
    group.add_argument("--wrt", metavar="NAME,...", type=lambda text: text.split(","), help=names)
    starts = "starts of which the best is followed (default: 4)"
    group.add_argument("--starts", metavar="K", type=int, help=starts)
    group.add_argument("--shot", metavar="S", type=number, help="longest part of a log that is simulated at once [s]")
    group.add_argument("--robust", action="store_true", help="let outliers of the positions count less")


def check_options(arguments: argparse.Namespace) -> None:
    """Raise a CommandError for options that belong to the other way of identifying."""
    if not arguments.without_torques:
        if given := [name for name in OTHERS if getattr(arguments, name) not in (None, False)]:
            raise CommandError(f"--{given[0].replace('_', '-')}: needs --without-torques")
        return
    if given := [name for name in ("cutoff", "gains", "details") if getattr(arguments, name)]:
        raise CommandError(f"--{given[0]}: is of torques, and cannot be given with --without-torques")
    if arguments.controller != "servo" and (given := [name for name in OF_SERVOS if getattr(arguments, name)]):
        raise CommandError(f"--{given[0].replace('_', '-')}: needs --controller servo")


def scene_of(robot: rne.Robot, arguments: argparse.Namespace) -> rne.Scene:
    """Robot under its controller, with friction and rotors, at the numbers from which the fit starts."""
    every = {name: shared.one_or_each(getattr(arguments, name)) for name in NUMBERS}
    given: dict[str, Any] = {name: x for name, x in every.items() if x is not None}
    figures = rne.control.servo_figures(arguments.servo) if arguments.servo else None
    if "kp" not in given and figures is None:
        or_servo = ", or --servo" * (arguments.controller == "servo")
        raise CommandError(f"--kp: is needed{or_servo}: gains to start from, which may be wrong by a factor of two")
    if figures is not None:
        law: Any = figures.law(robot)
        of_law = {"kp": law.kp, "stall_torque": figures.stall_torque, "no_load_speed": figures.no_load_speed}
        of_gear = {"viscous": figures.viscous, "coulomb": figures.coulomb, "rotors": figures.armature}
        given = of_law | of_gear | given
    gains = given["kp"], given.get("kd", 0.0), 0.0
    limits = {name: given[name] for name in OF_SERVOS if name in given}
    is_servo = arguments.controller == "servo"
    law = rne.control.servo(robot, *gains, **limits) if is_servo else rne.control.pd(robot, *gains)
    friction: Any = {name: given[name] for name in ("viscous", "coulomb") if name in given}
    if friction:
        friction = rne.Friction(**friction)
    elif (robot.model.damping + robot.model.friction).any():
        friction = "urdf"
    return rne.Scene(robot, controller=law, friction=friction or None, armature=given.get("rotors"))


def run_commanded(
    robot: rne.Robot, records: list[rne.identification.Record], page: Any, arguments: argparse.Namespace
) -> Any:
    """Fit, print the report and the errors of each record, and return the rne.identification.MotionFit."""
    if importlib.util.find_spec("llvmlite") is not None:
        robot = rne.Robot(robot.model, "numba")
    scene, fitted = scene_of(robot, arguments), records[: len(arguments.logs)]
    given = {name: x for name in ("wrt", "starts", "shot") if (x := getattr(arguments, name)) is not None}
    work.begin(f"fitting the model's motion to {counted(len(fitted), 'record')}")
    try:
        with shared.warnings_in_one_line(arguments):
            found = rne.identify_motion(scene, fitted, robust=arguments.robust, progress=_tell, **given)
    except KeyError as error:  # of a name in `wrt`
        raise CommandError(shared.as_options(str(error.args[0]), arguments)) from None
    page.text(used(robot, arguments))
    page.text(f"controller: {arguments.controller or 'pd'}; fitted: {listed(list(found.numbers))}")
    page.lines(found.report())
    for k, record in enumerate(records):
        work.begin(f"simulating and drawing {record.name}")
        page.heading(f"{record.name}, {'fitted' if k < len(fitted) else 'predicted'}")
        _followed(found, record, page)
        caption = f"{record.name}: measured positions, those of the model, and their difference"
        page.figure(f"positions_{k}", lambda record=record: found.plot(record), caption)
    return found


def _tell(iteration: int, residual: float) -> None:
    note(f"  iteration {iteration}: residual {residual:.4g} standard deviations of the positions")


def _followed(found: Any, record: rne.identification.Record, page: Any) -> None:
    """Add the deviations of a record's positions from those of the model."""
    record = record.on_grid()
    names, predicted = found.initial.robot.joint_names, found.predict(record)
    own = [record.joint_names.index(name) if name in record.joint_names else j for j, name in enumerate(names)]
    rms = np.sqrt(np.nanmean((record.q[:, own] - predicted) ** 2, axis=0))
    rows = [[name, f"{x:.4g}", f"{step:.3g}"] for name, x, step in zip(names, rms, found.resolution, strict=True)]
    page.table(["joint", "rms residual [rad or m]", "resolution"], rows)
