"""Loading and checking of robots by name or from a file."""

from __future__ import annotations

import os
import sys
from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any, TextIO

import numpy as np
from numpy.typing import ArrayLike

from ..basics.arrays import real_array
from ..basics.text import did_you_mean
from ..errors import ModelError, UrdfError
from ..model.abb_irb140 import irb140
from ..model.model import STANDARD_GRAVITY, Model
from ..model.modify import LimitValues, with_armature, with_limits
from ..robot import Robot
from .angles import LARGEST, origins, read_angles, report_savings
from .document import Element, parse, read_bytes
from .findings import Finding, FindingsReport, written
from .mjcf import mjcf_model
from .plausibility import check_bodies, check_elements
from .read import loaded, model_of, validated
from .strict import validate
from .write import to_urdf
from .xacro import Options, expanded

PACKAGE = "example-robot-data"
BUILDERS: dict[str, Callable[[], Model]] = {"irb140": irb140}  # built-in robots, which need no file


@cache
def urdf_files() -> dict[str, Path]:
    """URDF files of example-robot-data by "folder/file" without suffix; empty without that package."""
    import importlib.metadata  # slow to load, and only this function needs it

    try:
        files = importlib.metadata.files(PACKAGE) or []
    except importlib.metadata.PackageNotFoundError:
        return {}
    urdfs = sorted((file for file in files if file.suffix == ".urdf"), key=str)
    folder = [file.parts[file.parts.index("robots") + 1] for file in urdfs]
    return {f"{f}/{file.stem}": Path(str(file.locate())) for f, file in zip(folder, urdfs, strict=True)}


def library() -> dict[str, Path]:
    """URDF files by name: that of the file, "ur5" for "ur5_robot", "folder/file" where two folders have the same."""
    count = Counter(path.stem for path in urdf_files().values())
    found = {}
    for folder_and_file, path in urdf_files().items():
        short = path.stem.removesuffix("_robot")
        name = path.stem if count[path.stem] == 1 else folder_and_file
        found[name if short in count else short] = path
    return found


def robots() -> tuple[str, ...]:
    """Names that `rne.load` takes: built-in robots first, then those of the package example-robot-data.

    Returns
    -------
    tuple of str
        Without example-robot-data (`pip install 'rne[robots]'`) only the built-in ones. Files are listed unread; in
        version 6.0.0, three have errors, such as impossible inertias, which `rne.load` reports.

    Examples
    --------
    >>> import rne
    >>> rne.robots()[0]
    'irb140'
    """
    return (*BUILDERS, *(name for name in library() if name not in BUILDERS))


def resolve(source: str | os.PathLike[str], *given: Options) -> Model | str:
    """Built-in robot of a name, or the path of a URDF file, which has priority over a name of example-robot-data.

    Raises FileNotFoundError if it is neither a file nor a robot's name, ValueError if what is given is not for it.
    """
    if not isinstance(source, str | os.PathLike):
        raise TypeError(f"`source` must be the path of a file or a name of rne.robots(), got {type(source).__name__}")
    name = os.fspath(source)
    for values in given:
        if not isinstance(values, Mapping | None):
            raise TypeError(f"`arguments` and `packages` must be mappings from names, got {type(values).__name__}")
    if any(given) and not name.endswith(".xacro"):
        raise ValueError(f"`arguments` and `packages` are for files that end in .xacro, got {name!r}")
    if isinstance(source, str) and source in BUILDERS:
        return BUILDERS[source]()
    if not os.path.isfile(source) and name in library():
        return str(library()[name])
    if not os.path.exists(source):
        raise FileNotFoundError(unknown(name))
    return name


def unknown(name: str) -> str:
    """Error about a name that is neither a file nor a robot."""
    hint = did_you_mean(name, robots())
    if not library():
        built_in = f"{name!r} is neither a file nor a built-in robot"
        return f"{built_in}; about 60 more, such as 'ur5', come with pip install 'rne[robots]'{hint.replace(';', ' -')}"
    return f"{name!r} is neither a file nor one of rne.robots(){hint}"


def load(
    source: str | os.PathLike[str],
    *,
    gravity: ArrayLike | None = None,
    engine: str = "numpy",
    arguments: Mapping[str, Any] | None = None,
    packages: Mapping[str, str | os.PathLike[str]] | None = None,
    effort: LimitValues = None,
    velocity: LimitValues = None,
    acceleration: LimitValues = None,
    deceleration: LimitValues = None,
    jerk: LimitValues = None,
    armature: LimitValues = None,
    round_angles: bool = False,
) -> Robot:
    """Load a robot by name or from a URDF, MJCF or xacro file.

    Parameters
    ----------
    source : str or path-like
        A name of `rne.robots()`, such as "irb140", or the path of a file, which has priority over a name. "irb140" is
        built in; the others are files of example-robot-data. A file whose root element is `<mujoco>` is MJCF.
        A file that ends in .xacro is run: it is a program that may read other files and the environment.
    gravity : array_like, shape (3,), optional
        In the axes of the root link [m/s^2]; that of an MJCF file if not given, and (0, 0, -9.81) of all others.
    engine : {"numpy", "numba"}
        Engine of the robot's kernels; see `rne.compile`.
    arguments : mapping of str, optional
        Values of the arguments of a xacro file, by name.
    packages : mapping of str to path-like, optional
        Folders of ROS packages that a xacro file uses, in addition to those that xacrodoc finds.
    effort, velocity, acceleration, deceleration, jerk : float, array_like of shape (n,), or mapping, optional
        Limits instead of those of the file, as for `Robot.with_limits`: one number for all joints, one for each, or
        some by the joint's name [N m or N; rad/s or m/s; rad/s^2 or m/s^2, twice; rad/s^3 or m/s^3].
    armature : float, array_like of shape (nb,), or mapping, optional
        Inertias of the rotors at the joints instead of those of the file, as for `Robot.with_armature` [kg m^2 or kg].
    round_angles : bool
        True to take angles of joints and inertials (`rpy` of a URDF or expanded xacro file, `euler` in radians of MJCF)
        as the multiples of 15 degrees that they are rounded or truncated from, such as 1.5708 as pi/2, if at least
        three decimals are written. Axes stay as written. `rne.check` lists the angles and the operations saved.

    Returns
    -------
    Robot
        Its joints in the order of `joint_names`.

    Raises
    ------
    UrdfError
        For the first error in the file, with its element and attribute, and the number of other errors.
    FileNotFoundError
        If it is neither a file nor a robot's name; suggests similar names.
    TypeError
        If `round_angles` is not True or False, or `source` is neither text nor a path.
    ValueError
        If `gravity` is not three finite numbers, a limit or rotor negative or not one per joint, the engine none, or
        `arguments` are not those of a xacro file.
    ImportError
        If the engine is "numba" and Numba is not installed, or the file is MJCF and MuJoCo is not.

    Examples
    --------
    >>> import rne
    >>> robot = rne.load("irb140", effort=300)
    >>> robot.joint_names[0], robot.effort_limit[0].item()
    ('joint_1', 300.0)
    """
    g = None if gravity is None else real_array("gravity", gravity, "(3,)")
    _check_flag(round_angles)
    found = resolve(source, arguments, packages)
    try:
        options = arguments, packages
        model = found if isinstance(found, Model) else _model_of_file(found, *options, round_angles=round_angles)
    except UrdfError as error:
        name = os.fspath(source)
        if name == found:
            raise
        other = f"; {name + '_robot'!r} is another one" if f"{name}_robot" in library() else ""
        raise UrdfError(f"the file of {PACKAGE} has an error: {error}{other}", error.finding) from None
    model = model if g is None else replace(model, gravity=g)
    rates = {"velocity": velocity, "acceleration": acceleration, "deceleration": deceleration, "jerk": jerk}
    model = with_armature(with_limits(model, effort=effort, **rates), armature)
    return Robot(model, engine)


def _check_flag(round_angles: object) -> None:
    if not isinstance(round_angles, bool):
        raise TypeError(f"`round_angles` must be True or False, got {type(round_angles).__name__}")


def described(
    path: str, report: FindingsReport, *options: Options, round_angles: bool = False
) -> tuple[Element | Model | None, str]:
    """Element <robot> of a URDF or xacro file, or the Model of an MJCF file, or None with an error; and its source."""
    text = None
    if path.endswith(".xacro"):
        text = expanded(report, *options)
        report.has_lines = text is None
    data = None if report.errors else read_bytes(path, report) if text is None else text.encode()
    root = None if data is None else parse(data, report)
    if root is not None and root.tag == "mujoco":
        return mjcf_model(root, report, round_angles=round_angles), os.path.abspath(path)
    if root is None or not validate(root, report):
        return None, text or os.path.abspath(path)
    read_angles(origins(root), "rpy", report, rounded=round_angles)
    return root, text or os.path.abspath(path)


def _model_of_file(path: str, *options: Options, round_angles: bool) -> Model:
    report = FindingsReport(path)
    found, source = described(path, report, *options, round_angles=round_angles)
    return found if isinstance(found, Model) else loaded(found, report, STANDARD_GRAVITY, source)


def check(
    source: str | os.PathLike[str] | Robot | Model,
    *,
    arguments: Mapping[str, Any] | None = None,
    packages: Mapping[str, str | os.PathLike[str]] | None = None,
    out: TextIO | None = None,
    grouped: bool = True,
    round_angles: bool = False,
) -> list[Finding]:
    """Print all errors and warnings about a URDF, MJCF or xacro file, or about a robot, and return them.

    A file with errors does not load. Warnings are about parts that are ignored and probable mistakes: degrees or
    millimetres, centres of mass far outside the robot, masses and inertias of impossible bodies, drives without torque
    or speed; also about rotors, which add to M. Elements of other programs, such as `<gazebo>` and `<ros2_control>`,
    are no findings. For angles that `round_angles` rounds, a warning gives the operations of M and inverse dynamics
    that rounding saves, if any, and the change of torques in 64 random states.

    Parameters
    ----------
    source : str, path-like, Robot or Model
        The path of a file as for `rne.load`, a name of `rne.robots()`, or a robot, such as one of `rne.dh_chain`. For
        robots that were built and MJCF, the URDF that `to_urdf` writes is examined, but the weight on drives includes
        couplings.
    arguments, packages : mapping of str, optional
        Of a xacro file, as for `rne.load`.
    out : text stream, optional
        Where to print; standard output by default.
    grouped : bool
        True to print findings of one kind in one line, with the names of the links or joints.
    round_angles : bool
        True to check the robot as `rne.load` loads it with this option; each rounded angle is a warning.

    Returns
    -------
    list of Finding
        Every finding, in the order of the lines. A file with errors does not load; warnings change nothing.

    Raises
    ------
    FileNotFoundError
        If it is neither a file nor a robot's name.
    TypeError
        If `round_angles` is not True or False.
    ValueError
        If `arguments` or `packages` are given for a file that does not end in .xacro, or it does not use an argument.
    ImportError
        If the file is MJCF and MuJoCo is not installed.

    Notes
    -----
    Probable mistakes are: angles of an `<origin>` above 6.3 rad; ranges of revolute joints that end between 12.6
    and 720 rad; a centre of mass farther from its link's origin than five times the robot's size; a radius of gyration
    larger than twice that size. The size is the longest way along the joints' origins, with the strokes of sliding
    joints and the boxes, cylinders and spheres of the links; meshes are not read. A body is denser than any metal if
    the solid ellipsoid with its mass and inertia has more than 23 000 kg/m^3, as every body with these is at least as
    dense somewhere. It is lighter than air if an ellipsoid at least a hundredth as thick as long has less than
    1 kg/m^3. Sizes and densities of links of 1 g or less are not examined, as they often serve only as frames. Links
    longer than 20 m, and weight of more than ten times the effort limits, are reported too.

    Examples
    --------
    >>> import rne
    >>> rne.check("robots/irb140.urdf")
    robots/irb140.urdf: no findings
    []
    """
    _check_flag(round_angles)
    given = source.model if isinstance(source, Robot) else source
    found = given if isinstance(given, Model) else resolve(given, arguments, packages)
    name = given.name if isinstance(given, Model) else given
    report = FindingsReport(os.fspath(name if isinstance(found, Model) else found))
    options = arguments, packages
    read = described(found, report, *options, round_angles=round_angles)[0] if isinstance(found, str) else found
    root = read
    coupled = root if isinstance(root, Model) and root.couplings else None
    if isinstance(root, Model):  # the URDF that `to_urdf` writes is examined
        report.has_lines = isinstance(found, Model) and found is not given
        root = validated(to_urdf(replace(root, armature=np.zeros(root.nb)), couplings="drop").encode(), report)
    if root is not None:
        check_elements(root, report)
    if root is not None and not report.errors:
        try:
            model = coupled or model_of(root, STANDARD_GRAVITY)
        except ModelError as error:
            report.error(None, "robot", str(error), "fix the file")
        else:
            check_bodies(root, model, report)
            if report.angles and not round_angles and 0 < model.nb <= LARGEST:
                _report_rounding(read, model, report, *options)
    findings = sorted(report.findings, key=lambda finding: finding.line or 0)
    how = "with angles rounded" if round_angles and report.angles else "as written"
    stream = sys.stdout if out is None else out
    stream.write("\n".join(written(findings, report.file, grouped=grouped, how=how)) + "\n")
    return findings


def _report_rounding(read: Element | Model, model: Model, report: FindingsReport, *options: Options) -> None:
    """Report the operations saved by rounding angles of a <robot> and its Model, or of a file compiled anew."""
    if isinstance(read, Model):
        rounded = _model_of_file(report.file, *options, round_angles=True)
    else:
        read_angles(origins(read), "rpy", FindingsReport(report.file), rounded=True)
        rounded = model_of(read, STANDARD_GRAVITY)
    report_savings(read if isinstance(read, Model) else model, rounded, report)
