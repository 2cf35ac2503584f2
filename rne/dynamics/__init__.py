"""The quantities of a model as functions: one file per algorithm, `rnea.py` first."""

from typing import TYPE_CHECKING

from ..basics import on_first_use
from .aba import articulated_forward_dynamics
from .crba import mass_matrix
from .energy import kinetic_energy, link_kinetic_energies, momentum, potential_energy
from .forward import forward_dynamics
from .kinematics import centre_of_mass, centre_of_mass_jacobian, jacobian, jacobian_rate, link_poses
from .precision import Diagnosis, diagnose
from .rnea import bias_torque, coriolis_torque, gravity_torque, inverse_dynamics
from .task_space import task_bias, task_inertia, task_inverse

if TYPE_CHECKING:
    from .base_inertial_parameters import BaseParameters, base_parameters
    from .lagrange import christoffel_symbols, coriolis_matrix, lagrange_forward_dynamics, lagrange_inverse_dynamics
    from .recursion_record import Recursion, bearing_loads, recursion
    from .regressors import control_regressor, kinetic_energy_regressor, potential_energy_regressor, regressor
else:
    __getattr__ = on_first_use(
        __name__,
        {
            "base_inertial_parameters": "BaseParameters base_parameters",
            "lagrange": "christoffel_symbols coriolis_matrix lagrange_forward_dynamics lagrange_inverse_dynamics",
            "recursion_record": "Recursion bearing_loads recursion",
            "regressors": "control_regressor kinetic_energy_regressor potential_energy_regressor regressor",
        },
    )

__all__ = [
    "BaseParameters",
    "Diagnosis",
    "Recursion",
    "articulated_forward_dynamics",
    "base_parameters",
    "bearing_loads",
    "bias_torque",
    "centre_of_mass",
    "centre_of_mass_jacobian",
    "christoffel_symbols",
    "control_regressor",
    "coriolis_matrix",
    "coriolis_torque",
    "diagnose",
    "forward_dynamics",
    "gravity_torque",
    "inverse_dynamics",
    "jacobian",
    "jacobian_rate",
    "kinetic_energy",
    "kinetic_energy_regressor",
    "lagrange_forward_dynamics",
    "lagrange_inverse_dynamics",
    "link_kinetic_energies",
    "link_poses",
    "mass_matrix",
    "momentum",
    "potential_energy",
    "potential_energy_regressor",
    "recursion",
    "regressor",
    "task_bias",
    "task_inertia",
    "task_inverse",
]
