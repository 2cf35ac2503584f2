"""The public names: they have a page in the reference, and `tests/test_documentation.py` checks their docstrings."""

from __future__ import annotations

import inspect
from collections.abc import Iterator
from functools import cached_property
from typing import Any

import rne

MODULES = ("dynamics", "model", "kernels", "control", "trajectories", "elementwise", "plotting", "identification")
# What one part of the package offers to another: neither documented in the reference nor kept stable.
INTERNAL = {
    "Candidate.followed_by",
    "Candidate.of",
    "Cases.inertia_bounds",
    "Kernel.blocks",
    "Kernel.by_recursion",
    "Kernel.evaluate",
    "Kernel.is_unrolled",
    "Kernel.state_function",
    "Kernel.state_function_unguarded",
    "Kernel.traced",
    "Model.angular_axis",
    "Model.body_moments",
    "Model.coordinate_map",
    "Model.coordinate_parent",
    "Model.is_revolute",
    "Model.joint_origin",
    "Model.linear_axis",
    "Model.moments",
    "Scene.current_right_hand_side",
    "Scene.resolved",
    "Scene.right_hand_side",
    "Scene.right_hand_side_with_energies",
}


def names() -> list[str]:
    """Names as in the reference: "load", "control.pd", ..."""
    own = [name for name in rne.__all__ if name not in MODULES]
    return own + [f"{module}.{name}" for module in MODULES for name in members_of(getattr(rne, module))]


def members_of(module: Any) -> list[str]:
    """The public names of a module; where it has no list of them, the functions that it defines."""
    if hasattr(module, "__all__"):
        return [name for name in module.__all__ if name not in rne.__all__]  # such as "traceable" and "view"
    found = inspect.getmembers(module, inspect.isfunction)
    return [name for name, thing in found if thing.__module__ == module.__name__ and not name.startswith("_")]


def members() -> Iterator[str]:
    """Public methods and properties of the public classes, such as "Robot.mass_matrix"."""
    for name in names():
        owner = resolve(name)
        if inspect.isclass(owner):
            yield from (f"{name}.{member}" for member in vars_of(owner) if f"{owner.__name__}.{member}" not in INTERNAL)


def vars_of(owner: type) -> list[str]:
    """Methods and properties that the package defines for a class, its own base classes included."""
    own = [base for base in owner.__mro__ if base.__module__.startswith("rne")]
    found = {name: thing for base in reversed(own) for name, thing in vars(base).items()}
    return [name for name, thing in found.items() if not name.startswith("_") and is_member(thing)]


def is_member(thing: Any) -> bool:
    """True for a method or a property."""
    return inspect.isroutine(thing) or isinstance(thing, property | cached_property)


def is_property(name: str) -> bool:
    """True for "Robot.n", False for "Robot.mass_matrix" and "load"."""
    owner, _, member = name.rpartition(".")
    return inspect.isclass(resolve(owner)) and not callable(getattr(resolve(owner), member))


def resolve(name: str) -> Any:
    """The thing itself."""
    thing: Any = rne
    for part in filter(None, name.split(".")):
        thing = getattr(thing, part)
    return thing
