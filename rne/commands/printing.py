"""Commands rne check, compare, urdf, source and report: findings in a file, two robots, URDF, code, and a page."""

from __future__ import annotations

import argparse
import inspect
import io
import os
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

import rne

from ..basics.text import counted, listed
from ..model import Model
from . import shared
from .shared import ROBOT, CommandError, fail, in_one_line, number, say, work, written

FIRST = 4096  # bytes examined at the start of a file
MARK = 8  # most bytes before "<", for the mark of an encoding
FOLDER = Path("rne-report")
REPORT = "write a page on a robot: a motion, comparison with Pinocchio or energies, gravity torques, joints and links"
COMPARED = (
    *("joint_types", "lower", "upper", "velocity_limit", "effort_limit", "damping", "friction", "armature"),
    *("axis", "translation", "rotation", "mass", "com", "inertia"),
)
LANGUAGES, TYPES = ("python", "numpy", "matlab", "c", "c++", "rust"), ("float64", "float32")


def quantities() -> list[str]:
    """Names of the functions of a model that take only joint arrays and return an array."""
    found = []
    for name in rne.dynamics.__all__:
        declared = getattr(function := getattr(rne.dynamics, name), "quantity", None)
        if declared is not None and declared.returns_array:
            parameters = inspect.signature(function).parameters.values()
            needed = [p.name for p in parameters if p.default is p.empty and p.name != "model"]
            found += [name] if needed == list(declared.widths) else []
    return found


def add_check(commands: Any) -> None:
    """Register `rne check`."""
    title = "print errors and warnings about robots' files"
    parser = shared.add_parser(commands, "check", title, "rne check irb140.urdf", run_check)
    parser.add_argument("robots", metavar="ROBOT", nargs="+", help=ROBOT)
    parser.add_argument("--all", action="store_true", help="print findings that are alike one by one")
    what = "round angles as rne.load(..., round_angles=True) does, and name each"
    parser.add_argument("--round-angles", action="store_true", help=what)
    what = "two points, as LINK,X,Y,Z in metres: print how far apart they come over the ranges of the joints"
    parser.add_argument("--loops", metavar="POINT", nargs=2, help=what)


def run_check(arguments: argparse.Namespace) -> int:
    """Check every file, also after one that cannot be read."""
    code = 0
    for robot in arguments.robots:
        try:
            work.begin(f"checking {robot}")
            _refuse_other_files(robot)
            findings = rne.check(robot, grouped=not arguments.all, round_angles=arguments.round_angles)
        except (CommandError, OSError) as error:
            code = fail(in_one_line(error))
        else:
            failed = any(finding.severity == "error" for finding in findings)
            code = max(code, int(failed))
            if arguments.loops and not failed:
                code = max(code, _print_gap(robot, arguments.loops))
    return code


def _print_gap(robot: str, points: Sequence[str]) -> int:
    """Print the distance of two points of a robot over its motions."""
    from .agreement import loop_gap

    try:
        ends = [(link, [float(x) for x in place.split(",")]) for link, _, place in (p.partition(",") for p in points)]
        work.begin("measuring how far the points of --loops come apart")
        gap, q = loop_gap(rne.load(robot), *ends)
    except ValueError as error:
        return fail(f"--loops: {in_one_line(error)}")
    say(f"{robot}: the points of --loops come {gap:.3g} m apart, at q = {np.round(q, 4).tolist()}")
    return 0


def _refuse_other_files(robot: str) -> None:
    """Refuse folders, and files that are not XML, with clearer errors than the parser's."""
    if os.path.isdir(robot):
        raise CommandError(f"{robot}: is a folder; a URDF file is needed")
    if os.path.isfile(robot):
        with open(robot, "rb") as stream:
            if b"<" not in stream.read(FIRST).lstrip()[:MARK]:
                raise CommandError(f"{robot}: is not an XML file; a URDF file is needed")


def add_compare(commands: Any) -> None:
    """Register `rne compare`."""
    title = "print how two robots differ: joints, limits, bodies, and the likely cause of other torques"
    parser = shared.add_parser(commands, "compare", title, "rne compare irb140 irb140.urdf", run_compare)
    shared.add_robot(parser)
    other = (
        "another robot, of as many joints for torques to be compared; payload and locked joints are only those of ROBOT"
    )
    parser.add_argument("other", metavar="OTHER", help=other)
    least = "differences below this part of a joint's torques are rounding (default: that of rne.compare_models)"
    parser.add_argument("--tolerance", metavar="PART", type=number, help=least)


def run_compare(arguments: argparse.Namespace) -> int:
    """Print the differences, of two different robots in three lines; 1 if there are any."""
    from ..identification import thresholds
    from ..identification.diagnosis.compare_models import different_robots

    tolerance = thresholds.TOLERANCE if arguments.tolerance is None else arguments.tolerance
    names = arguments.robot, arguments.other
    alone = dict.fromkeys(("payload", "payload_com", "payload_inertia", "payload_link", "locked"))
    second = argparse.Namespace(**vars(arguments) | alone | {"robot": arguments.other})
    one, other = shared.robot_of(arguments), shared.robot_of(second)
    differences = list(_differences(one.model, other.model, names, tolerance))
    lines = [*differences] or ["joints: the same, with the same limits, bodies and frames"]
    if one.n != other.n:
        different, differs = different_robots(one.model, other.model), True
        lines += [f"torques: not compared, {names[0]} has {counted(one.n, 'joint')}, {names[1]} {other.n}"]
    else:
        work.begin(f"searching the cause by which torques of {names[1]} differ from those of {names[0]}")
        found = rne.compare_models(one, other, tolerance=tolerance)
        different, differs = found.different, bool(differences) or found.causes != ("none",)
        lines += [f"torques of {names[1]} compared with those of {names[0]}, and the likely cause by torques only"]
        lines += found.report().split("\n")
    if different:
        lines = [different, *(f"{name}: {_in_short(x)}" for name, x in zip(names, (one, other), strict=True))]
    for line in lines:
        say(line)
    return int(differs)


def _in_short(robot: rne.Robot) -> str:
    """Number and names of the joints of a robot, and the mass that they move."""
    joints = f"{counted(robot.n, 'joint')} ({listed(robot.joint_names)})" if robot.n else "no joints"
    return f"{joints}, {robot.model.mass.sum():.4g} kg moving"


def _differences(one: Model, other: Model, names: Sequence[str], tolerance: float) -> Iterator[str]:
    """Differences: joints that only one robot has; joints of the same name with other numbers."""
    of = [{joint: i for i, joint in enumerate(model.moving_joints)} for model in (one, other)]
    for k, name in enumerate(names):
        if alone := [joint for joint in of[k] if joint not in of[1 - k]]:
            yield f"joints that only {name} has: {', '.join(alone)}"
    for joint in (joint for joint in of[0] if joint in of[1]):
        for what in COMPARED:
            values = [getattr(model, what)[k[joint]] for model, k in zip((one, other), of, strict=True)]
            if both := _unequal(values, tolerance):
                yield f"{joint}: {what.replace('types', 'type').replace('_', ' ')} {both}"
    for link in (link for link in one.link_names if link in other.link_names):
        for what in "translation", "rotation":
            values = [getattr(model, f"link_{what}")[model.link_index(link)] for model in (one, other)]
            if both := _unequal(values, tolerance):
                yield f"{link}: {what} on its body {both}"


def _unequal(values: Sequence[Any], tolerance: float) -> str:
    """Text of two values, empty if they are equal, numbers within the tolerance."""
    a, b = map(np.ravel, values)
    if np.array_equal(a, b) or (a.dtype == float and np.allclose(a, b, tolerance, tolerance)):
        return ""
    return ", of the other ".join(" ".join(x if isinstance(x, str) else f"{x:.9g}" for x in value) for value in (a, b))


def add_urdf(commands: Any) -> None:
    """Register `rne urdf`."""
    title = "print a robot as URDF, without shapes that are meshes"
    parser = shared.add_parser(commands, "urdf", title, "rne urdf irb140 > irb140.urdf", run_urdf)
    parser.add_argument("robot", metavar="ROBOT", help=ROBOT)


def run_urdf(arguments: argparse.Namespace) -> int:
    """Print the robot as `rne.to_urdf` writes it."""
    print(rne.to_urdf(rne.load(arguments.robot).model), end="")
    return 0


def add_source(commands: Any) -> None:
    """Register `rne source`."""
    title = "print a quantity as C, C++, Rust, MATLAB, Python or NumPy"
    parser = shared.add_parser(commands, "source", title, "rne source irb140 --language c > tau.c", run_source)
    shared.add_loaded_robot(parser)
    choices = quantities()
    default = f"{', '.join(choices)} (default: inverse_dynamics, or that of the element)"
    parser.add_argument("--quantity", metavar="QUANTITY", choices=choices, help=default)
    element = "only one entry: m23 of M, c3 of C q', g2 of g, tau4, h1, qdd5; joints from 1, m2_13 beyond nine"
    parser.add_argument("--element", metavar="ELEMENT", help=element)
    parser.add_argument("--language", default="python", choices=LANGUAGES, help="(default: python)")
    numbers = "numbers of C, C++ and Rust (default: float64)"
    parser.add_argument("--dtype", default="float64", choices=TYPES, help=numbers)


def run_source(arguments: argparse.Namespace) -> int:
    """Print the source."""
    from ..kernels.source import harmless, quantity_of_element

    try:
        quantity = arguments.quantity or "inverse_dynamics"
        if arguments.element is not None and arguments.quantity is None:
            quantity = quantity_of_element(arguments.element)
        robot = shared.robot_of(arguments)
        work.begin(f"deriving {quantity} of {robot.model.name} and writing it in {arguments.language}")
        kernel = robot.kernel(getattr(rne.dynamics, quantity))
        text = kernel.source(arguments.language, arguments.element, arguments.dtype)
        if arguments.payload is not None:  # the comment at the head says so, in a line that no long name cuts
            link, inertia = harmless(shared.carriers(robot, arguments)[0]), arguments.payload_inertia
            what = f"{arguments.payload:g} kg at {written(arguments.payload_com or [0, 0, 0])} m of {link}"
            what += f" with inertia {written(inertia)} kg m^2" if inertia else ""
            head = next(line for line in text.split("\n") if " of robot " in line)
            text = text.replace(head, f"{head}\n{head.split()[0]} Payload - {what}{' */' * head.endswith('*/')}", 1)
    except (rne.RneError, ValueError, TypeError) as error:  # TypeError: the kernel is too large to be written out
        raise CommandError(str(error)) from error
    print(text, end="")
    return 0


def add_export(commands: Any) -> None:
    """Register `rne export`."""
    title = "write a robot as a CMake package in C++17, or as a Functional Mock-up Unit"
    example = "rne export ur10 ur10_dynamics --payload-at tool0"
    parser = shared.add_parser(commands, "export", title, example, run_export)
    parser.add_argument("robot", metavar="ROBOT", help=ROBOT)
    what = "folder of the package, made if it does not exist; a name that ends in .fmu is the file of a unit"
    parser.add_argument("folder", metavar="FOLDER", type=Path, help=what)
    standard = "of a unit, the standard (default: 2.0)"
    parser.add_argument("--fmi", choices=("2.0", "3.0"), default="2.0", help=standard)
    what = "of a unit, platforms of the binaries, such as x86_64-linux (default: all that can be built)"
    parser.add_argument("--platforms", metavar="PLATFORM", nargs="+", help=what)
    parser.add_argument("--namespace", metavar="NAME", help="name of package and namespace (default: the robot's)")
    payload = "link on which a payload is an argument of the functions"
    parser.add_argument("--payload-at", metavar="LINK", dest="payload", help=payload)
    numbers = "further arguments, such as gravity or armature"
    parser.add_argument("--numbers", metavar="NAME", nargs="+", default=[], help=numbers)
    functions = "functions (default: those of a controller and its example)"
    parser.add_argument("--quantities", metavar="QUANTITY", nargs="+", help=functions)
    parser.add_argument("--dtype", default="float64", choices=TYPES, help="type of all numbers (default: float64)")
    shared.add_force(parser)


def run_export(arguments: argparse.Namespace) -> int:
    """Write the package or the unit."""
    if arguments.folder.suffix == ".fmu":
        return _write_unit(arguments)
    from ..export.cpp_package import package, write

    names = "namespace", "payload", "numbers", "quantities", "dtype"
    try:
        robot = rne.load(arguments.robot)
        work.begin(f"deriving the functions of {robot.model.name} and writing them in C++")
        texts = package(robot, **{name: getattr(arguments, name) for name in names})
    except (ValueError, TypeError) as error:
        raise CommandError(in_one_line(error)) from error
    shared.check_folder(arguments.folder, arguments, "FOLDER", [*texts])
    write({arguments.folder / path: text for path, text in texts.items()})
    say(f"{arguments.folder}: {', '.join(texts)}")
    return 0


def _write_unit(arguments: argparse.Namespace) -> int:
    """Write the Functional Mock-up Unit of an arm, torques in."""
    shared.check_file(arguments.folder, arguments, "FOLDER")
    names = "fmi", "payload", "numbers", "platforms"
    try:
        scene = rne.Scene(rne.load(arguments.robot))
        work.begin(f"deriving the equations of {scene.robot.model.name} and building the unit's binaries")
        built = scene.to_fmu(arguments.folder, **{name: getattr(arguments, name) for name in names})
    except (ValueError, TypeError, ImportError, RuntimeError) as error:
        raise CommandError(in_one_line(error)) from error
    what = f"binaries for {', '.join(built)}" if built else "only sources"
    say(f"{arguments.folder}: FMI {arguments.fmi}, {what}")
    return 0


def add_out(parser: argparse.ArgumentParser, default: Any) -> None:
    """Add the option for the folder of a page."""
    text = "folder of the page, made if it does not exist (default: rne-report)"
    parser.add_argument("--out", metavar="FOLDER", type=Path, default=default, help=text)


def add_report(commands: Any) -> None:
    """Register `rne report`."""
    parser = shared.add_parser(commands, "report", REPORT, "rne report irb140.urdf --out irb140-page", run_report)
    parser.add_argument("robot", metavar="ROBOT", help=ROBOT)
    add_out(parser, argparse.SUPPRESS)  # where it is not given here, that before the subcommand holds
    shared.add_force(parser)


def run_main_page(arguments: argparse.Namespace) -> int:
    """Write the main page; 1 if a comparison exceeds its bound."""
    from . import pages

    shared.check_folder(arguments.out, arguments)
    return 0 if pages.write_main_page(arguments.out, say) else 1


def run_report(arguments: argparse.Namespace) -> int:
    """Write the page on the robot; 1 if a comparison exceeds its bound."""
    from ..urdf.loading import resolve
    from . import pages

    robot = rne.load(arguments.robot)
    shared.check_folder(arguments.out, arguments)
    printed = io.StringIO()
    if isinstance(resolve(arguments.robot), str):  # the path of a file
        work.begin(f"checking {arguments.robot}")
        rne.check(arguments.robot, out=printed)
    return 0 if pages.write_robot_page(robot, printed.getvalue().strip(), arguments.out, say) else 1


def add_cache(commands: Any) -> None:
    """Register `rne cache`."""
    title = "show where object code of compiled kernels is kept, or remove it"
    parser = shared.add_parser(commands, "cache", title, "rne cache --clear", run_cache)
    parser.add_argument("--clear", action="store_true", help="remove all of it")


def run_cache(arguments: argparse.Namespace) -> int:
    """Print the cache's place, size and number of files."""
    from ..basics import disk_cache

    place = disk_cache.folder()
    if place is None:
        empty = os.environ.get("RNE_CACHE") == ""
        print("no cache:", "RNE_CACHE is empty" if empty else "platformdirs is not installed: pip install 'rne[numba]'")
        return 0
    sizes = [state.st_size for _, state in disk_cache.entries(place)]
    if place.exists() and not disk_cache.is_own(place):
        text = "not used, since another user owns it or may write to it"
    elif arguments.clear:
        text = f"{disk_cache.clear()} files removed"
    elif sizes:
        used, most = sum(sizes) / 1e6, disk_cache.LIMIT / 1e6
        text = f"{len(sizes)} files of object code, {used:.1f} MB of at most {most:.1f} MB"
    else:
        text = "empty"
    say(f"{place}: {text}")
    return 0
