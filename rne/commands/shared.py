"""Common parts of the subcommands: robots, numbers, early checks of output files, messages."""

from __future__ import annotations

import argparse
import math
import re
import sys
import tempfile
import threading
import time
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NoReturn

import numpy as np

import rne

from ..basics.arrays import UNBOUNDED
from ..basics.spatial import Array
from ..basics.text import did_you_mean, listed, plain
from ..model.topology import end_links

ROBOT = "path of a URDF, MJCF or xacro file, or a name of rne.robots() such as irb140"
ARGUMENT = re.compile(r"`(?P<name>\w+)(?P<rest>[^`]*)`|\b(?P<key>\w+)=(?P<value>\[.*?\]|\{.*?\}|\"[^\"]*\"|[\w.]+)")
QUOTES = str.maketrans({"'": "", '"': "", "[": "", "]": "", "{": "", "}": ""})
INPUTS = {"robot": "robot", "logs": "log", "check": "log", "via": "path"} | dict.fromkeys(("motion", "other"), "motion")
PAGE = ".html", ".png", ".gif"  # suffixes of the files of a page
NUMBER = re.compile(r"[+-]?\.?[0-9][0-9.eE+,-]*")


class CommandError(Exception):
    """Raised for a wrong call: the command ends with this message and exit code 2."""


class Parser(argparse.ArgumentParser):
    """Parser whose errors are one line."""

    def _check_value(self, action: argparse.Action, value: Any) -> None:
        """Refuse a value that is none of the choices, with those that are near, or all of them."""
        if action.choices is not None and value not in action.choices:
            choices = [str(choice) for choice in action.choices]
            hint = did_you_mean(str(value), choices) or f" (choose from {', '.join(map(repr, choices))})"
            raise argparse.ArgumentError(action, f"invalid choice: {value!r}{hint}")

    def error(self, message: str) -> NoReturn:
        """End with exit code 2."""
        self.exit(2, f"error: {plain(message)}; {self.prog} --help shows what there is\n")


def add_parser(
    commands: Any, name: str, title: str, example: str, run: Callable[[argparse.Namespace], int]
) -> argparse.ArgumentParser:
    """Parser of a subcommand done by `run`, whose help ends with an example."""
    texts = {"help": title, "description": f"{title[0].upper()}{title[1:]}.", "epilog": f"example:\n  {example}"}
    form = argparse.RawDescriptionHelpFormatter
    parser: argparse.ArgumentParser = commands.add_parser(name, formatter_class=form, allow_abbrev=False, **texts)
    parser.set_defaults(run=run, parser=parser)
    return parser


def add_robot(parser: argparse.ArgumentParser) -> None:
    """Add the arguments for the robot, its payload, gravity and effort limits."""
    add_loaded_robot(parser)
    gravity = "in the axes of the root link [m/s^2] (default: of an MJCF file its own, else 0 0 -9.81)"
    parser.add_argument("--gravity", metavar="X Y Z", type=numbers, help=gravity)
    locked = "joints that stay where they are, such as finger=0.02,wrist=1 [rad or m]"
    parser.add_argument("--locked", metavar="JOINT=Q,...", type=positions, help=locked)
    effort = "effort limits instead of the robot's, one number for all joints or one for each [N m or N]"
    parser.add_argument("--effort", metavar="TAU", type=numbers, help=effort)


def add_loaded_robot(parser: argparse.ArgumentParser) -> None:
    """Add the arguments for only the robot and its payload."""
    parser.add_argument("robot", metavar="ROBOT", help=ROBOT)
    parser.set_defaults(gravity=None, locked=None, effort=None)
    parser.add_argument("--payload", metavar="KG", type=number, help="mass of a further body on the last link [kg]")
    com = "its centre of mass in the link's frame (default: 0 0 0) [m]"
    parser.add_argument("--payload-com", metavar="X Y Z", type=numbers, help=com)
    inertia = "about its centre of mass, in the link's axes (default: a point mass) [kg m^2]"
    parser.add_argument("--payload-inertia", metavar="XX YY ZZ XY XZ YZ", type=numbers, help=inertia)
    carrier = "link that carries it (default: the last one; needed where joints branch or last links have other frames)"
    parser.add_argument("--payload-link", metavar="LINK", help=carrier)


def robot_of(arguments: argparse.Namespace) -> rne.Robot:
    """Robot described by the arguments of `add_robot` or `add_loaded_robot`."""
    names = "com", "inertia", "link"
    given = {name: x for name in names if (x := getattr(arguments, f"payload_{name}")) is not None}
    if arguments.payload is None and given:
        raise CommandError(f"--payload-{next(iter(given))}: needs --payload")
    gravity = {} if arguments.gravity is None else {"gravity": arguments.gravity}
    if "inertia" in given:
        if len(given["inertia"]) != 6:
            raise CommandError(f"--payload-inertia: must be 6 numbers, xx yy zz xy xz yz, got {len(given['inertia'])}")
        given["inertia"] = np.array(given["inertia"])[[[0, 3, 4], [3, 1, 5], [4, 5, 2]]]
    try:
        robot = rne.load(arguments.robot, effort=one_or_each(arguments.effort), **gravity)
        robot = robot.locked(arguments.locked or {})
        return robot if arguments.payload is None else robot.with_payload(arguments.payload, **given)
    except rne.RneError:
        raise
    except ValueError as error:
        text = re.sub("`(com|inertia|link)`", r"--payload-\1", in_one_line(error)).replace("`positions`", "--locked")
        raise CommandError(re.sub("^payload on", "--payload on", text)) from None


def used(robot: rne.Robot, arguments: argparse.Namespace) -> str:
    """Line on the robot used: joints, gravity, payload."""
    model, com, inertia = robot.model, arguments.payload_com, arguments.payload_inertia
    line = f"robot {model.name}, joints {' '.join(robot.joint_names)}, gravity {written(model.gravity.tolist())} m/s^2"
    if arguments.payload is None:
        return line
    where, *others = carriers(robot, arguments)
    line += f", payload {arguments.payload:g} kg at {f'{written(com)} m' if com else 'the origin'} of link {where}"
    line += f" (the same as of {listed(others)})" if others else ""
    return line + (f" with inertia {written(inertia)} kg m^2" if inertia else "")


def carriers(robot: rne.Robot, arguments: argparse.Namespace) -> Sequence[str]:
    """Link that carries the payload, and others of the same frame."""
    if arguments.payload_link:
        return [arguments.payload_link]
    return end_links(robot.model, axes_count=any((*(arguments.payload_com or ()), *(arguments.payload_inertia or ()))))


def numbers(text: str) -> list[float]:
    """Parse numbers separated by blanks or commas."""
    try:
        values = [float(part) for part in text.replace(",", " ").split()]
    except ValueError:
        values = []
    if not values or not all(map(math.isfinite, values)):
        raise argparse.ArgumentTypeError(f"must be numbers separated by blanks or commas, got {text!r}")
    return values


def number(text: str) -> float:
    """Finite number."""
    try:
        (value,) = numbers(text)
    except (ValueError, argparse.ArgumentTypeError):
        raise argparse.ArgumentTypeError(f"must be one number, got {text!r}") from None
    return value


def positions(text: str) -> dict[str, float]:
    """Positions by joint, such as `finger=0.02,wrist=1`."""
    try:
        pairs = [(joint, number(q)) for joint, q in (part.split("=") for part in text.split(","))]
    except (ValueError, argparse.ArgumentTypeError):
        pairs = []
    if not pairs or len(dict(pairs)) < len(pairs):
        raise argparse.ArgumentTypeError(f"must be JOINT=Q of each joint once, separated by commas, got {text!r}")
    return dict(pairs)


def one_or_each(values: list[float] | None) -> Any:
    """Number for all joints, or one for each."""
    return values[0] if values and len(values) == 1 else values


def join_numbers(argv: Sequence[str]) -> list[str]:
    """Arguments with the numbers after an option as one argument, which may begin with a minus sign.

    Examples
    --------
    >>> join_numbers(["simulate", "irb140", "--q0", "-1", "2e-3,0", "--duration", "2"])
    ['simulate', 'irb140', '--q0=-1 2e-3,0', '--duration=2']
    """
    joined: list[str] = []
    is_open = False  # the last argument is an option that takes what follows
    for word in argv:
        if is_open and NUMBER.fullmatch(word):
            joined[-1] += (" " if "=" in joined[-1] else "=") + word
        else:
            joined.append(word)
            is_open = word.startswith("--") and len(word) > 2
    return joined


@contextmanager
def warnings_in_one_line(arguments: argparse.Namespace) -> Iterator[None]:
    """Print the warnings raised in this block without the place in the source, with the command's options."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        yield
    for text in dict.fromkeys(str(warning.message) for warning in caught):
        note(f"warning: {as_options(text, arguments)}")


def add_force(parser: argparse.ArgumentParser, default: Any = argparse.SUPPRESS) -> None:
    """Add the option to replace foreign files."""
    text = "replace files that rne did not write too; those that the command reads never are"
    parser.add_argument("--force", action="store_true", default=default, help=text)


def check_folder(folder: Path, arguments: argparse.Namespace, option: str = "--out", names: Sequence[str] = ()) -> None:
    """Make the folder, test that it is writable, and refuse to replace pages, pictures and `names` of others."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        tempfile.TemporaryFile(dir=folder).close()
        there = [file for file in sorted(folder.iterdir()) if file.suffix.lower() in PAGE and not names]
    except FileExistsError:
        raise CommandError(f"{option}: cannot write into {str(folder)!r}: Not a directory") from None
    except OSError as error:
        raise CommandError(f"{option}: cannot write into {str(folder)!r}: {error.strerror}") from None
    for file in (*there, *(folder / name for name in names)):
        _check_replaced(file, arguments, option, "folder")


def _check_replaced(file: Path, arguments: argparse.Namespace, option: str, kind: str = "file") -> None:
    """Refuse to replace an input of the command, or without --force any file not written by rne."""
    if not (file.exists() or file.is_symlink()):
        return
    from ..basics.marks import is_marked
    from ..urdf.loading import library

    for name, what in INPUTS.items():
        given = getattr(arguments, name, None) or []
        for path in map(Path, given if isinstance(given, list) else [given]):
            path = path if path.exists() else library().get(str(path), path)
            if file.exists() and path.exists() and path.samefile(file):
                raise CommandError(f"{option}: {str(file)!r} is the {what} that is read; name another {kind}")
    if not file.is_file():
        raise CommandError(f"{option}: {str(file)!r} is no regular file; name another {kind}")
    try:
        file.open("r+b").close()
        if getattr(arguments, "force", False) or not file.stat().st_size or is_marked(file):
            return
    except OSError as error:
        raise CommandError(f"{option}: cannot write {str(file)!r}: {error.strerror}") from None
    cure = f"name another {kind}, or give --force to replace it"
    raise CommandError(f"{option}: {str(file)!r} was not written by rne; {cure}")


def check_file(
    file: Path | None, arguments: argparse.Namespace, option: str = "--out", suffixes: Sequence[str] = ()
) -> None:
    """Refuse a file that cannot be written or is not to be replaced; the file itself is not touched."""
    if file is None:
        return
    if file.is_dir():
        raise CommandError(f"{option}: {str(file)!r} is a folder, not a file")
    _check_replaced(file, arguments, option)
    if suffixes and file.suffix.lower() not in suffixes:
        raise CommandError(f"{option}: must end in {' or '.join(suffixes)}, got {str(file)!r}")
    if not file.parent.is_dir():
        raise CommandError(f"{option}: there is no folder {str(file.parent)!r}")
    try:
        if not file.exists():
            tempfile.TemporaryFile(dir=file.parent).close()
    except OSError as error:
        raise CommandError(f"{option}: cannot write {str(file)!r}: {error.strerror}") from None


def say(line: str) -> None:
    """Print a line at once, with escapes for control characters."""
    work.said = work.clock()
    print(plain(line), flush=True)


def note(line: str) -> None:
    """Print a line on standard error, where it does not mix with output that is piped on."""
    work.said = work.clock()
    print(plain(line), file=sys.stderr, flush=True)


class Work:
    """Progress of a command: its step and time, printed on standard error after two seconds without other output."""

    pause = 2.0  # [s]

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self.clock, self.is_told = clock, False
        self.begin("reading the robot")

    def begin(self, what: str) -> None:
        """Begin a step, after the time of the one before if its progress was printed."""
        self.end()
        self.what, self.share, self.begun = what, 0.0, self.clock()
        self.said = self.begun

    def end(self) -> None:
        """Print how long the step took if its progress was printed."""
        if self.is_told:
            note(f"  {self.what}: took {self.clock() - self.begun:.0f} s")
        self.is_told = False

    def progress(self, done: float, total: float) -> None:
        """Set the share of the step that is done."""
        self.share = done / total

    def tell(self) -> None:
        """Print the step, its time and how much is left, if nothing was printed for a while."""
        now = self.clock()
        if now - self.said < self.pause:
            return
        passed = now - self.begun
        left = f"{self.share:.0%} done, about {passed * (1 / self.share - 1):.0f} s left" if self.share else ""
        self.said, self.is_told = now, True
        note(f"  {self.what}{', ' if left else ''}{left} ... {passed:.0f} s")

    @contextmanager
    def reported(self) -> Iterator[None]:
        """Print the progress while the block runs, and the time of its last step if nothing is raised."""
        self.is_told = False
        self.begin("reading the robot")
        ended = threading.Event()

        def tell() -> None:
            while not ended.wait(self.pause / 8):
                self.tell()

        thread = threading.Thread(target=tell, daemon=True)
        thread.start()
        try:
            yield
        finally:
            ended.set()
            thread.join()
        self.end()


work = Work()


def in_one_line(error: BaseException) -> str:
    """Message of an error without line breaks; for an error of the system, file and reason."""
    if isinstance(error, OSError) and error.filename and error.strerror:
        return f"{error.filename}: {error.strerror}"
    return " ".join(str(error).split())


def as_options(text: str, arguments: argparse.Namespace) -> str:
    """Text on Python arguments rewritten for the command's options, `units={"q": "deg"}` as `--units q=deg`."""
    text = re.sub(r"`robot\.locked(?:\((.*?)\))?`", lambda m: f"locked={m[1]}" if m[1] else "`locked`", text)
    text = text.replace("`joint_names` of the Record", "`joints`")
    known = set(re.findall(r"--[\w-]+", arguments.parser.format_usage()))

    def option(found: re.Match[str]) -> str:
        name = f"--{(found['name'] or found['key']).replace('_', '-')}"
        if name not in known:
            return found[0]
        value = re.sub("[\"']: ", "=", found["value"] or "").replace(", ", ",").translate(QUOTES)
        return f"{name} {value}" if value else name + (found["rest"] or "")

    return ARGUMENT.sub(option, text)


def fail(message: str) -> int:
    """Print an error; returns the exit code of a wrong call."""
    note(f"error: {message}")
    return 2


def written(values: Sequence[float]) -> str:
    """Numbers in a line, such as `0 0.5 -1`."""
    return " ".join(f"{value:.6g}" for value in values)


def units_of(robot: rne.Robot, rotating: str, sliding: str) -> str:
    """Unit of a joint array: `N m`, or where joints slide too `N m (N of joints x, y)`."""
    model = robot.model
    slides = [n for n, i in zip(robot.joint_names, model.independent_joints, strict=True) if not model.is_revolute[i]]
    if len(slides) in (0, robot.n):
        return sliding if slides else rotating
    return f"{rotating} ({sliding} of {'joint' if len(slides) == 1 else 'joints'} {', '.join(slides)})"


def bodies(robot: rne.Robot) -> str:
    """Components of the robot's torques: its bodies, and the rotors that its file gives."""
    model = robot.model
    units = np.where(model.is_revolute, "kg m^2", "kg")
    of = [f"{model.moving_joints[i]} {model.armature[i]:.6g} {units[i]}" for i in np.flatnonzero(model.armature)]
    return f"rigid bodies and rotors ({listed(of)})" if of else "only rigid bodies"


def say_limits(tell: Callable[[str], None], robot: rne.Robot, exceeded: Sequence[object]) -> None:
    """Print the limits that a motion exceeds, and those that the model does not have."""
    model, line = robot.model, f"limits exceeded: {len(exceeded) or 'none'}"
    drives = np.isin(np.arange(model.nb), model.independent_joints)  # a joint that mimics another has none
    ends = np.array(model.joint_types) != "continuous"
    for kind, limit, has in (
        ("position", model.upper - model.lower, ends),
        ("velocity", model.velocity_limit, np.ones(model.nb, dtype=bool)),
        ("effort", model.effort_limit, drives),
    ):
        missing = (limit >= UNBOUNDED) & has
        names = [name for name, is_missing in zip(model.moving_joints, missing, strict=True) if is_missing]
        if names:
            of = "" if (missing == has).all() else f" for {', '.join(names)}"
            line += f"; the model has no {kind} limits{of}"
    for text in (line, *(f"  {violation}" for violation in exceeded)):
        tell(text)


def say_samples(file: Path, t: Array) -> None:
    """Print the number of samples in a file, and their time span."""
    say(f"{file}: {len(t)} samples from {t[0]:.13g} to {t[-1]:.13g} s")
