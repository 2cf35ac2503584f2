"""Command rne identify: a robot's masses, rotors and friction from its logs."""

from __future__ import annotations

import argparse
import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

import rne

from ..basics.marks import URDF
from ..basics.text import counted
from ..files.tables import as_number
from . import shared
from .commanded import add_commanded, check_options, run_commanded
from .moving import add_units, rotating
from .shared import CommandError, as_options, fail, in_one_line, note, number, numbers, say, used, work

if TYPE_CHECKING:
    from ..plotting.html_page import Report

IDENTIFY = """rne identify ur5 run1.mcap run2.mcap --check run3.mcap --out ur5.urdf
  rne identify so101.urdf lerobot_data --units q=deg --without-torques --controller servo --servo sts3215-7.4v"""


def add_identify(commands: Any) -> None:
    """Register `rne identify`."""
    title = "find masses, rotors and friction from logs of motions"
    parser = shared.add_parser(commands, "identify", title, IDENTIFY, run_identify)
    shared.add_robot(parser)
    logs = "files for rne.identification.Record.from_log: text, JSON, bags of ROS, .mat, .npz, LeRobot data sets"
    parser.add_argument("logs", metavar="LOG", type=Path, nargs="+", help=logs)
    parser.add_argument("--check", metavar="LOG", type=Path, help="another motion, to be predicted")
    add_units(parser)
    units = "such as q=deg, qd=rpm or tau=mA, or of each joint q=deg,deg,m; once for each quantity"
    parser.add_argument("--units", metavar="Q=UNIT", type=_named, action="append", help=f"units of the logs, {units}")
    parser.add_argument("--joints", metavar="NAME,...", type=lambda text: text.split(","), help="joints to read")
    names = "names of all columns of logs without, such as t,q.a,tau.a, nothing for one to ignore; or the columns of a "
    names += "quantity, names or numbers from 0: q=A,B, once for each"
    parser.add_argument("--columns", metavar="NAME,...", type=_named, action="append", help=names)
    parser.add_argument("--sample-rate", metavar="HZ", type=number, help="of logs without times [Hz]")
    parser.add_argument("--gains", metavar="K", type=numbers, help="torques per ampere, for all joints or each [N m/A]")
    parser.add_argument("--offsets", metavar="Q", type=numbers, default=[0.0], help="where logs have zero [rad or m]")
    parser.add_argument("--topic", help="topic of the joint states, where a log has several")
    parser.add_argument("--episode", metavar="K", type=int, help="episode of a data set that has several")
    parser.add_argument("--cutoff", metavar="HZ", type=number, help="of the low-pass filter (default: from the log)")
    parser.add_argument("--details", action="store_true", help="report everything, parameters with standard errors too")
    parser.add_argument("--out", metavar="FILE.urdf", type=Path, help="file for the robot found")
    page = "folder for the page (default: rne-identify)"
    parser.add_argument("--page", metavar="FOLDER", type=Path, default=Path("rne-identify"), help=page)
    add_commanded(parser)
    shared.add_force(parser)


def run_identify(arguments: argparse.Namespace) -> int:
    """Identify, print the report, write the page and the robot; 1 if no possible robot was found."""
    from ..plotting.html_page import Report

    shared.check_file(arguments.out, arguments, suffixes=(".urdf",))
    shared.check_folder(arguments.page, arguments, "--page")
    check_options(arguments)
    robot, held_out = shared.robot_of(arguments), [arguments.check] * (arguments.check is not None)
    work.begin(f"reading {counted(len(arguments.logs) + len(held_out), 'log')}")
    records = [_record(file, robot, arguments) for file in (*arguments.logs, *held_out)]
    for record in records:
        say(f"{record.name}: {record.source}")
    for finding in held_out and records[-1].findings:
        note(as_options(f"{finding}", arguments))
    page = Report(f"{robot.model.name} identified", say, arguments.page, work.begin)
    found = (run_commanded if arguments.without_torques else _run_with_torques)(robot, records, page, arguments)
    say(f"page: {page.write()}")
    if arguments.without_torques and not arguments.out:
        return 0
    try:
        work.begin("fitting bodies that are possible, for the URDF file")
        urdf = found.to_urdf()
    except rne.IdentificationError as error:
        fail(in_one_line(error))
        return 1
    if arguments.out:
        arguments.out.write_text(urdf.replace("?>\n", f"?>\n{URDF}", 1), encoding="utf-8")
        say(f"{arguments.out}: the robot found")
    return 0


def _run_with_torques(
    robot: rne.Robot, records: list[rne.identification.Record], page: Report, arguments: argparse.Namespace
) -> rne.identification.Identification:
    """Identify, print the report and the validation of each record, and return the result."""
    fitted = counted(len(arguments.logs), "record")
    work.begin(f"fitting masses, rotors and friction to {fitted}, and searching causes of residuals")
    with shared.warnings_in_one_line(arguments):
        found = rne.identify(robot, records[: len(arguments.logs)], cutoff=arguments.cutoff)
    page.text(used(robot, arguments))
    report = found.report(details=arguments.details).replace("`report(details=True)`", "--details")
    page.lines(as_options(report, arguments))
    for k, record in enumerate(records):
        work.begin(f"predicting the torques of {record.name}")
        check, how = found.check(record), "fitted" if k < len(arguments.logs) else "predicted"
        page.heading(f"{record.name}, {how}")
        page.lines(check.report())
        page.figure(f"torques_{k}", check.plot, f"{record.name}: measured torques, {how} ones, and their difference")
    return found


def _record(file: Path, robot: rne.Robot, arguments: argparse.Namespace) -> rne.identification.Record:
    """Record of a log, in the units of `add_units`; with torques, without rest at its ends."""
    given = {name: getattr(arguments, name) for name in ("time_unit", "sample_rate", "joints", "topic", "episode")}
    given |= {name: shared.one_or_each(getattr(arguments, name)) for name in ("gains", "offsets")}
    units, columns = _merged("--units", arguments.units), _merged("--columns", arguments.columns)
    if arguments.degrees:
        turns = dict(zip(robot.joint_names, rotating(robot), strict=True))
        if not all(turns.values()):  # the joints of the log have to be known
            given["joints"] = given["joints"] or robot.joint_names
        unit = ["deg" if turns.get(joint, True) else "m" for joint in given["joints"] or ()] or "deg"
        units = {"q": unit, "qd": unit} | units
    given |= {"units": units, "columns": columns.get("", columns) or None, "torques": not arguments.without_torques}
    record = rne.identification.Record.from_log(file, **given)
    return record if arguments.without_torques else record.in_motion()


def _named(text: str) -> dict[str, Any]:
    """Names or numbers of a quantity, or of none: `q=A,2` is {"q": ["A", 2]}, `A,2` is {"": ["A", "2"]}."""
    kind, _, names = text.rpartition("=")
    read = [(x, as_number(x)) for x in names.split(",")]
    values = [x if not kind or math.isnan(y) else int(x) if x.isdigit() else y for x, y in read]
    return {kind: values if len(values) > 1 or not kind else values[0]}


def _merged(option: str, given: list[dict[str, Any]] | None) -> dict[str, Any]:
    """Values of all uses of an option by quantity."""
    merged = {kind: value for part in given or () for kind, value in part.items()}
    if len(merged) < len(given or ()) or ("" in merged and len(merged) > 1):
        raise CommandError(f"{option}: must name each quantity once, or be given once without a quantity")
    return merged
