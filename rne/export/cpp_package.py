"""Export of a robot, a scene or an identified model as a CMake package: header-only C++17 with a test."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from math import prod
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..basics.marks import COMMENT, is_marked
from ..basics.spatial import Array
from ..basics.text import UNITS
from ..identification import Identification
from ..kernels.kernel import Kernel
from ..kernels.source import Printable, checked_name, harmless, identifier
from ..kernels.units import unit
from ..robot import Robot
from ..simulation.named_numbers import NamedNumbers, plain_name
from ..simulation.scene import Payload, Scene
from ..simulation.scene_numbers import unbounded, unit_of
from . import cpp_templates as texts

QUANTITIES = ("inverse_dynamics", "gravity_torque", "coriolis_torque", "mass_matrix", "forward_dynamics")
MARKED = r"%([A-Z_]+)%"
STATES, SEED = 4, 0  # number of states and seed of the test
SPREAD = {"q": 3.0, "qd": 2.0, "qdd": 5.0, "tau": 20.0}  # ranges of the test's arguments; others are of size 1
NOTES = (
    "Joints, units and limits are said below, sizes and operations above each function.",
    "Functions allocate nothing, throw nothing and have no memory: any number of threads may call them.",
)
BODY = np.array([1.5, 0.03, -0.02, 0.08, 0.012, 0.001, 0.015, -0.002, 0.001, 0.01])  # a payload, as an argument
TOLERANCE = 8.0  # errors of a sum of n terms in units of n eps, times the condition number where M is inverted


def cmake(
    given: Robot | Scene | Identification,
    folder: str | Path,
    *,
    namespace: str | None = None,
    payload: str | None = None,
    numbers: Sequence[str] = (),
    quantities: Sequence[str] | None = None,
    std: bool = False,
    dtype: str = "float64",
    replace_others: bool = False,
) -> list[Path]:
    """Write a package in C++17 for a controller: a header, one for Eigen, CMake files, a test and an example.

    Functions take and give std::array, allocate nothing, throw nothing, have no memory, and may be called from many
    threads. `find_package` and colcon find the package.

    Parameters
    ----------
    given : Robot, Scene or Identification
        Of a scene and of what was identified, torques and accelerations are with friction and springs.
    folder : path
        Made if it does not exist.
    namespace : str, optional
        Name of the package and its namespace; by default the robot's name.
    payload : str, optional
        A link on which a payload is an argument of the functions: mass, centre of mass and inertia in the link's frame.
    numbers : sequence of str
        Numbers of `Scene.numbers` that are further arguments, such as "gravity", "friction.viscous", "controller.kp",
        and "payload.mass", only its mass: the centre of mass and the inertia about it are the scene's.
    quantities : sequence of str, optional
        Functions of ``rne.dynamics`` of joint arrays only, "friction_torque" and "controller". By default inverse and
        forward dynamics, M, gravity and Coriolis torques, and the last two where a scene has them. "controller" is the
        law alone: its torques are not limited, sampled or delayed, and are followed by what `rne.control.compiled`
        says of a law's states. The example is written if gravity torques and forward dynamics are among them.
    std : bool
        True to add `prediction` of an Identification: torques, then their standard deviations.
    dtype : {"float64", "float32"}
        Of all numbers.
    replace_others : bool
        True to replace files of the same names that rne did not write.

    Returns
    -------
    list of Path
        The files.

    Raises
    ------
    ValueError
        If a link, number, quantity, name or dtype is none, M is singular and forward dynamics is asked for, or `std`
        is given without an Identification.
    FileExistsError
        If a file of such a name was not written by rne; nothing is written then.

    Examples
    --------
    >>> import rne, tempfile
    >>> files = rne.export.cmake(rne.load("ur5"), tempfile.mkdtemp(), payload="tool0")
    >>> sorted(file.name for file in files)[:3]
    ['CMakeLists.txt', 'README.md', 'eigen.hpp']
    """
    how: dict[str, Any] = {"namespace": namespace, "payload": payload, "numbers": numbers, "quantities": quantities}
    files = {Path(folder, path): text for path, text in package(given, **how, std=std, dtype=dtype).items()}
    for file in files:
        is_ours = file.is_file() and (not file.stat().st_size or is_marked(file))
        if file.exists() and not replace_others and not is_ours:
            raise FileExistsError(f"{str(file)!r} was not written by rne; name another folder, or set `replace_others`")
    write(files)
    return [*files]


def write(files: Mapping[Path, str]) -> None:
    """Write texts into their files, and make their folders."""
    for file, text in files.items():
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(text, encoding="ascii")


def package(
    given: Any,
    *,
    namespace: str | None,
    payload: str | None,
    numbers: Sequence[str],
    quantities: Sequence[str] | None,
    dtype: str,
    std: bool = False,
) -> dict[str, str]:
    """Texts of a package by their paths in its folder; see `cmake`."""
    if std and not isinstance(given, Identification):
        raise ValueError(f"`std` is for an Identification, got {type(given).__name__}")
    functions = _named(given, payload, numbers)
    name = checked_name("namespace", namespace or identifier(functions.scene.robot.model.name))
    quantities = _default(functions) if quantities is None else quantities
    if "forward_dynamics" in quantities:
        _check_mass_matrix(functions.scene.resolved.robot)
    kernels = {key: functions.kernel(key) for key in quantities}
    if std:
        kernels["prediction"] = given.kernel(std=True)
    return _texts(functions, kernels, name, dtype)


def _named(given: Any, payload: str | None, numbers: Sequence[str]) -> NamedNumbers:
    """Scene with its numbers that are arguments."""
    if isinstance(given, Identification):
        given = given.scene()
    elif not isinstance(given, Robot | Scene):
        raise TypeError(f"`given` must be a Robot, a Scene or an Identification, got {type(given).__name__}")
    scene = given if isinstance(given, Scene) else Scene(given)
    if payload is not None:
        if scene.payload is not None:
            raise ValueError("`payload`: the scene has one already; numbers=['payload'] makes it an argument")
        links = scene.resolved.robot.link_names
        if payload not in links:
            raise ValueError(f"`payload` must be one of {list(links)}, got {payload!r}")
        scene = replace(scene, payload=Payload(0.0, link=payload))
        numbers = ["payload", *numbers]
    if not scene.n:
        raise ValueError(f"robot {scene.robot.model.name!r} has no joint that moves")
    return NamedNumbers(scene, tuple(numbers))


def _check_mass_matrix(robot: Robot) -> None:
    """Raise a ValueError if M, without a payload that is an argument, is singular at random positions."""
    q, limits = np.random.default_rng(SEED).uniform(-1, 1, (STATES, robot.n)), robot.model.coordinate_limits()
    found = robot.diagnose(np.clip(q, limits["lower"], limits["upper"]))  # beyond, closed linkages have no positions
    if not np.isfinite(found.condition).all():
        raise ValueError(
            f"`quantities`: no forward dynamics, since M is singular: a motion of "
            f"{', '.join(map(repr, found.worst_joint))} moves no inertia; give rotors by `with_armature`, or other "
            "`quantities`, such as inverse_dynamics and gravity_torque"
        )


def _default(functions: NamedNumbers) -> list[str]:
    """Quantities of a scene that are available."""
    scene = functions.scene
    friction, found = scene.resolved.friction, [*QUANTITIES]
    if scene.elastic is not None:
        found = [name for name in found if name not in ("inverse_dynamics", "forward_dynamics")]
    found += ["friction_torque"] if friction is not None and "load" not in friction.losses else []
    return found + ["controller"] * (functions.law is not None)


def _texts(functions: NamedNumbers, kernels: Mapping[str, Kernel], name: str, dtype: str) -> dict[str, str]:
    """Texts of a package by their paths in its folder."""
    model = functions.scene.resolved.robot.model
    notes = [f"{COMMENT} - dynamics of robot {harmless(model.name)}, header-only C++17", *NOTES]
    notes += [f"{plain_name(key)}{unit_of(key)} is an argument" for key in functions.names if key != "payload"]
    fill = {"NAME": name, "LOWERCASE": name.lower(), "ROBOT": harmless(model.name), "JOINTS": str(model.n)}
    fill |= {"REAL": "double" if dtype == "float64" else "float", "ENDING": "" if dtype == "float64" else "f"}
    fill |= {"PAYLOAD": "", "TAKE_PAYLOAD": ""}
    members = {}
    if "payload" in functions.names:
        fill["PAYLOAD"] = filled(texts.PAYLOAD, fill | {"LINK": harmless(functions.payload_link)})
        fill["TAKE_PAYLOAD"], members["payload"] = filled(texts.TAKE_PAYLOAD, fill), texts.MEMBERS
    fill |= _constants(functions)
    inside = filled(texts.CONSTANTS + fill["PAYLOAD"], fill).split("\n")
    text = unit(kernels, "c++", name=name, dtype=dtype, notes=notes, members=members, inside=[*inside, ""])
    files = {"CMakeLists.txt": texts.CMAKE, "package.xml": texts.PACKAGE, "README.md": texts.READ_ME}
    files |= {f"include/{name}/eigen.hpp": texts.EIGEN, "test/numbers.cpp": texts.NUMBERS}
    fill["FUNCTIONS"] = "".join(_with_eigen(key, function) for key, function in text.functions.items())
    fill["ROWS"], fill["CALLS"] = _numbers(functions, kernels, text.functions, dtype)
    if {"gravity_torque", "forward_dynamics"} <= kernels.keys():
        files["example/gravity_compensation.cpp"] = texts.EXAMPLE
        fill |= _example(functions, text.functions)
    return {f"include/{name}/{name}.hpp": text.header} | {path: filled(body, fill) for path, body in files.items()}


def filled(text: str, fill: Mapping[str, str]) -> str:
    """Template whose words between signs of per cent are filled in, also within what was filled in."""
    while re.search(MARKED, text):
        text = re.sub(MARKED, lambda found: fill[found[1]], text)
    return text


def _number(x: float) -> str:
    """Number in C++ of the type %REAL%."""
    size = "std::numeric_limits<%REAL%>::infinity()" if np.isinf(x) else f"{abs(x)!r}%ENDING%"
    return f"-{size}" if x < 0 else size


def _list(numbers: ArrayLike) -> str:
    return ", ".join(_number(x) for x in np.ravel(numbers).tolist())


def _constants(functions: NamedNumbers) -> dict[str, str]:
    """Names and limits of the joints."""
    model = functions.scene.resolved.robot.model
    slides = [not model.is_revolute[i] for i in model.independent_joints]
    limits = model.coordinate_limits()
    effort = functions.scene.resolved.effort_limit
    limits["effort_limit"] = limits["effort_limit"] if effort is None else effort
    fill = {key.split("_")[0].upper(): _list(unbounded(x)) for key, x in limits.items()}
    for key, unit_name in (("POSITIONS", "q"), ("RATES", "qd"), ("TORQUES", "tau")):
        fill[key] = ", ".join(UNITS[unit_name][kind] for kind in (slides if any(slides) else slides[:1]))
    names = ("".join(_character(b) for b in name.encode()) for name in model.joint_names)
    return {**fill, "NAMES": ", ".join(f'"{name}"' for name in names)}


def _character(byte: int) -> str:
    """Byte in a literal of C++; all but letters, digits and a few signs by its number."""
    return chr(byte) if re.match(r"[A-Za-z0-9_.+ -]", chr(byte), re.ASCII) else f"\\{byte:03o}"


def _with_eigen(key: str, function: Printable) -> str:
    """Function of Eigen's types."""
    kinds = {"payload": "const Payload& ", "t": "%REAL% "}
    taken = ", ".join(f"{kinds.get(name, f'const Given<{w}>& ')}{name}" for name, w in function.taken.items())
    given = [name if name in kinds else f"to_array<{w}>({name})" for name, w in function.taken.items()]
    call, rows, columns = f"%NAME%::{key}({', '.join(given)})", prod(function.shape[:-1]), [*function.shape[-1:], 1][0]
    size = f"{columns}, 1" if len(function.shape) == 1 else f"{rows}, {columns}"
    found = "%REAL%" if not (function.shape or function.may_fail) else f"Array<{size}>"
    lines = [f"return to_eigen<{size}>({call});" if found != "%REAL%" else f"return {call};"]
    if function.may_fail:
        lines = [f"const auto found = {call};", "if (!found)", "    return std::nullopt;"]
        lines, found = [*lines, f"return to_eigen<{size}>(*found);"], f"std::optional<{found}>"
    head = f"[[nodiscard]] inline {found} {key}({taken}) noexcept"
    return "\n".join(["", head, "{", *(f"    {line}" for line in lines), "}", ""])


def _numbers(
    functions: NamedNumbers, kernels: Mapping[str, Kernel], named: Mapping[str, Printable], dtype: str
) -> tuple[str, str]:
    """Rows of arguments and results of the recursion, and calls that compare with them."""
    rows, calls = list[str](), list[str]()
    for key, kernel in kernels.items():
        arrays = _arguments(functions, kernel, dtype)
        result = kernel.by_recursion(*(arrays[name] for name in kernel.names))[0].reshape(STATES, -1)
        table = np.concatenate([*(arrays[name] for name in named[key].taken), result], axis=1)
        texts_of = ",\n".join("    {" + ", ".join(map(repr, row)) + "}" for row in table.tolist())
        rows.append(f"const double {key}_rows[][{table.shape[1]}] = {{\n{texts_of},\n}};")
        given, place = list[str](), 0
        for name, width in named[key].taken.items():
            at = f"row + {place}"
            one = "take_payload({})" if name == "payload" else f"take<{width}>({{}})"
            given.append(f"static_cast<%REAL%>(row[{place}])" if name == "t" else one.format(at))
            place += width
        tolerance = _tolerance(functions, arrays if named[key].may_fail else {}, dtype)
        call = f"%NAME%::{key}({', '.join(given)})"
        calls.append(f"    for (const auto& row : {key}_rows)")
        calls.append(f'        compare("{key}", {call}, row + {place}, {tolerance!r});')
    return "\n".join(rows), "\n".join(calls)


def _arguments(functions: NamedNumbers, kernel: Kernel, dtype: str) -> dict[str, Array]:
    """Random arguments of a kernel, (STATES, width), that the dtype holds."""
    rng, found = np.random.default_rng(SEED), dict[str, Array]()
    numbers = {plain_name(name): functions.value(name) for name in functions.names}
    limits = functions.scene.resolved.robot.model.coordinate_limits()
    for name, width in zip(kernel.names, kernel.widths, strict=True):
        x = rng.uniform(-1, 1, (STATES, width)) * SPREAD.get(name, 1.0)
        if name == "q":
            x = np.clip(x, limits["lower"], limits["upper"])
        elif name == "t":
            x = abs(x) if not len(kernel.table) else rng.uniform(kernel.table[0, 0], kernel.table[-1, 1], x.shape)
        elif name in ("payload", "payload_mass"):
            x = BODY[:width] * (1 + x / 4)
        elif name == "piece":
            x = kernel.piece(found["t"])
        elif name in numbers:
            x = numbers[name] * (1 + x / 4)
        found[name] = x.astype(dtype).astype(float)
    return found


def _tolerance(functions: NamedNumbers, arrays: Mapping[str, Array], dtype: str) -> float:
    """Tolerance relative to the largest entry: rounding of a sum, times errors of solutions with M and differences."""
    robot, growth = functions.scene.resolved.robot, 1.0
    if "tau" in arrays:
        M, h, tau = robot.mass_matrix(arrays["q"]), robot.bias_torque(arrays["q"], arrays["qd"]), arrays["tau"]
        sizes = [np.linalg.norm(x, axis=-1) for x in (tau, h, tau - h)]
        growth = float((np.linalg.cond(M) * (sizes[0] + sizes[1]) / sizes[2]).max())
    return float(TOLERANCE * robot.n * np.finfo(dtype).eps * growth)


def _example(functions: NamedNumbers, named: Mapping[str, Printable]) -> dict[str, str]:
    """Call in the example of gravity compensation, with the numbers of the scene."""
    numbers = {plain_name(name): functions.value(name) for name in functions.names}
    used = {name for key in ("gravity_torque", "forward_dynamics") for name in named[key].taken}
    arrays = {name: x for name, x in numbers.items() if name in used and name != "payload"}
    constants = [f"const std::array<%REAL%, {x.size}> {name}{{{{{_list(x)}}}}};\n" for name, x in arrays.items()]
    constants += ["const %NAME%::Payload payload{}; // without mass\n"] * ("payload" in used)
    limits = functions.scene.resolved.robot.model.coordinate_limits()
    has_both = np.isfinite(limits["lower"]) & np.isfinite(limits["upper"])
    middle = sum(np.where(has_both, limits[end], 0.0) / 2 for end in ("lower", "upper"))
    return {
        "EXAMPLE_NUMBERS": "".join(constants),
        "START": _list(middle),
        "FORWARD": ", ".join({"tau": "torque"}.get(name, name) for name in named["forward_dynamics"].taken),
        "GRAVITY": ", ".join({"q": "arm.q"}.get(name, name) for name in named["gravity_torque"].taken),
    }
