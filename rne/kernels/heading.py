"""The comment at the head of printed source: which robot, which joints in which order, which units.

Names come from a file, and the file may be anybody's. In a comment they are plain ASCII of a few harmless characters,
so that no name can end the comment or continue its line, in any of the languages.
"""

from __future__ import annotations

import re
import textwrap
from collections.abc import Iterable, Mapping, Sequence

from ..model.model import Model

MAX_NAME = 60  # characters
WIDTH = 100

# Of joint arrays, and of results with an entry for each joint: for a rotating and for a sliding joint.
UNITS = {
    "q": ("rad", "m"),
    "qd": ("rad/s", "m/s"),
    "qdd": ("rad/s^2", "m/s^2"),
    "qdr": ("rad/s", "m/s"),
    "qddr": ("rad/s^2", "m/s^2"),
    "tau": ("N m", "N"),
}
PER_JOINT = {
    "inverse_dynamics": "tau",
    "bias_torque": "tau",
    "gravity_torque": "tau",
    "coriolis_torque": "tau",
    "forward_dynamics": "qdd",
    "articulated_forward_dynamics": "qdd",
}
MASS = ("kg m^2", "kg m", "kg")  # of an entry of M with none, one or two sliding joints
SCALAR = {"kinetic_energy": "J", "potential_energy": "J"}
# Quantities with a column for each inertial parameter.
REGRESSORS = ("regressor", "control_regressor", "kinetic_energy_regressor", "potential_energy_regressor")
TEN = (
    "ten per body: m kg, m cx, m cy, m cz kg m, Ixx, Ixy, Iyy, Ixz, Iyz, Izz kg m^2, about the origin of the body's "
    "joint frame in the URDF, in its axes"
)


def heading(
    model: Model,
    quantity: str,
    arguments: Sequence[str],
    entry: tuple[int, ...] | None,
    wrenches: Mapping[str, str],
) -> list[str]:
    """Lines of the comment, without the language's comment signs.

    Parameters
    ----------
    model : Model
        The robot's parameters.
    quantity : str
        What is printed, with "by" and the arguments of a derivative.
    arguments : sequence of str
    entry : tuple of int, or None
        The place of the only entry that is printed.
    wrenches : mapping of str to str
        The arguments that are wrenches, each with its link.
    """
    sliding = [not model.is_revolute[i] for i in model.independent_joints]
    what = f"{quantity} of robot {harmless(model.name)}"
    if entry is not None:
        what = f"Entry {', '.join(str(k + 1) for k in entry)} of {what}"
    names = ", ".join(f"{k} {harmless(name)}" for k, name in enumerate(model.joint_names, 1))
    lines = [what, *textwrap.wrap(f"Joints in order - {names or 'none'}", WIDTH, subsequent_indent="  ")]
    for title, kind in (("rotating", 0), ("sliding", 1)):
        joints = [k for k, slides in enumerate(sliding) if slides == bool(kind)]
        units = [f"{name} {UNITS[name][kind]}" for name in arguments if name in UNITS]
        if joints and units:
            which = "" if len(joints) == len(sliding) else f" of {title} joints {', '.join(str(k + 1) for k in joints)}"
            lines += textwrap.wrap(f"Units{which} - {', '.join(units)}", WIDTH, subsequent_indent="  ")
    for name, link in wrenches.items():
        what = f"{name} - moment N m, then force N, on link {harmless(link)} at its origin, in its axes"
        lines += textwrap.wrap(what, WIDTH, subsequent_indent="  ")
    lines += _of_parameters(model, quantity, arguments)
    return [*lines, f"Unit of the result - {_unit(quantity, sliding, entry)}"]


def harmless(name: str) -> str:
    """A name in which every character but ASCII letters, digits, spaces and _.+- is written as its number."""
    cut = name if len(name) <= MAX_NAME else name[:MAX_NAME]
    return re.sub(r"[^A-Za-z0-9_.+ -]", lambda match: f"<U+{ord(match.group()):04X}>", cut)


def _of_parameters(model: Model, quantity: str, arguments: Sequence[str]) -> list[str]:
    """The order of inertial parameters among the arguments, or of the columns of a regressor."""
    whose = {"parameters": "parameters" in arguments, "Columns of the result": quantity in REGRESSORS}
    texts = [f"{what} - {TEN}" for what, there in whose.items() if there]
    if texts:
        bodies = ", ".join(f"{k} {harmless(name)}" for k, name in enumerate(model.moving_joints, 1))
        texts.append(f"Bodies by their joints - {bodies or 'none'}")
    return [line for text in texts for line in textwrap.wrap(text, WIDTH, subsequent_indent="  ")]


def _unit(quantity: str, sliding: Sequence[bool], entry: tuple[int, ...] | None) -> str:
    places: Iterable[int] = range(len(sliding))
    if quantity in SCALAR:
        return SCALAR[quantity]
    if quantity in PER_JOINT:
        units = UNITS[PER_JOINT[quantity]]
        found = [units[sliding[k]] for k in (places if entry is None else entry)]
    elif quantity == "mass_matrix":
        pairs = [(i, j) for i in places for j in places] if entry is None else [(entry[0], entry[1])]
        found = [MASS[sliding[i] + sliding[j]] for i, j in pairs]
    else:
        return "SI"
    return " or ".join(dict.fromkeys(found)) or "none"
