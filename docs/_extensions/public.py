"""The public names: they have a page in the reference, and `tests/test_documentation.py` checks their docstrings."""

from __future__ import annotations

import inspect
from collections.abc import Iterator
from functools import cached_property
from typing import Any

import rne

MODULES = (
    "dynamics",
    "model",
    "kernels",
    "bounds",
    "control",
    "trajectories",
    "elementwise",
    "environments",
    "plotting",
    "identification",
    "export",
)
# What one part of the package offers to another: neither documented in the reference nor kept stable.
INTERNAL = {
    "Cases.inertia_bounds",
    "Friction.losses",
    "Friction.transmitted",
    "Friction.varying",
    "Kernel.blocks",
    "Kernel.by_recursion",
    "Kernel.checked_into",
    "Kernel.coefficients",
    "Kernel.evaluate",
    "Kernel.fast_call",
    "Kernel.is_unrolled",
    "Kernel.printable",
    "Kernel.printed",
    "Kernel.state_function",
    "Kernel.state_function_at",
    "Kernel.state_function_unguarded",
    "Kernel.traced",
    "Kernel.whole",
    "LeastSquares.with_covariance",
    "Model.angular_axis",
    "Model.body_moments",
    "Model.coordinate_map",
    "Model.coordinate_parent",
    "Model.is_revolute",
    "Model.joint_origin",
    "Model.linear_axis",
    "Model.moments",
    "Path.via",
    "Record.given_names",
    "Record.is_of",
    "Record.on_grid",
    "Record.part",
    "RegressionData.at_lower_cutoff",
    "RegressionData.correlation_time",
    "RegressionData.in_torques",
    "RegressionData.parts",
    "RegressionData.segments",
    "Robot.with_model",
    "Scene.dynamics",
    "Scene.dynamics_under",
    "Scene.dynamics_without_law",
    "Scene.exported",
    "Scene.naming",
    "Scene.refuse_elastic",
    "Scene.resolved",
    "Scene.traced_law",
    "Scene.varying",
    "Scene.why_called",
    "StandardParameters.drive_columns",
    "StandardParameters.drive_columns_of",
    "StandardParameters.drive_torques",
    "StandardParameters.load",
    "StandardParameters.rotor_torques",
    "StandardParameters.spring_columns",
    "StandardParameters.spring_torques",
    # The interface of gymnasium, which documents it.
    "ArmEnv.reset",
    "ArmEnv.step",
    "ArmVectorEnv.close",
    "ArmVectorEnv.reset",
    "ArmVectorEnv.step",
}

# The head of a class's page lists its methods and properties by these groups; what is in none comes last.
GROUPS = {
    "Robot": {
        "Dynamics": "inverse_dynamics forward_dynamics mass_matrix gravity_torque bias_torque coriolis_torque "
        "coriolis_matrix recursion diagnose bounds",
        "Kinematics and energies": "link_poses jacobian jacobian_rate centre_of_mass "
        "centre_of_mass_jacobian kinetic_energy potential_energy momentum",
        "Task space": "task_inertia task_bias task_inverse null_space",
        "Derivatives": "inverse_dynamics_derivatives forward_dynamics_derivatives linearize inverse_dynamics_gradient "
        "forward_dynamics_gradient inverse_dynamics_hessian forward_dynamics_hessian",
        "Inertial parameters": "parameters regressor control_regressor base_parameters",
        "Changed robots": "with_payload with_armature with_parameters with_limits locked mounted",
        "Joints, links and limits": "model n joint_names link_names joint_order lower upper velocity_limit "
        "effort_limit acceleration_limit deceleration_limit jerk_limit",
        "Kernels": "engine compile kernel",
    },
    "Trajectory": {
        "Questions to a motion": "torques check_limits trusted_horizon balance breaks",
        "Files": "save load to_csv to_dataframe",
    },
    "Scene": {
        "Dynamics": "n inverse_dynamics forward_dynamics check_gains",
        "The kernel": "kernel is_traced traced_samples cost to_casadi",
    },
}
FEWEST = 3  # members that make a list worth its lines
OWN_PAGES = {"rne.Robot"}  # classes so large that each member has a page of its own


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


def member_lists() -> dict[str, list[tuple[str, list[str]]]]:
    """Titles and members at the head of each class's page: {"rne.Robot": [("Dynamics", [...]), ...]}."""
    lists = {}
    for name in names():
        if not inspect.isclass(owner := resolve(name)):
            continue
        found = [member for member in vars_of(owner) if f"{owner.__name__}.{member}" not in INTERNAL]
        groups = [(title, group.split()) for title, group in GROUPS.get(name, {}).items()]
        rest = [member for member in found if not any(member in group for _, group in groups)]
        if len(found) >= FEWEST:
            title = "Further" if groups else "Methods and properties"
            lists[f"rne.{name}"] = groups + ([(title, rest)] if rest else [])
    return lists


def summaries() -> dict[str, str]:
    """What each class is, in one sentence: {"rne.Robot": "..."}."""
    classes = {name: found for name in names() if inspect.isclass(found := resolve(name))}
    return {f"rne.{name}": (inspect.getdoc(owner) or "").partition("\n\n")[0] for name, owner in classes.items()}


def pages() -> set[str]:
    """Names of the generated pages of the reference."""
    single = {f"rne.{name}" for name in members() if f"rne.{name.rpartition('.')[0]}" in OWN_PAGES}
    return single | {f"rne.{name}" for name in names()}


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
