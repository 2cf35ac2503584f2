"""The quantities of a model as functions: one file per algorithm, `rnea.py` first."""

from .aba import articulated_forward_dynamics
from .base_inertial_parameters import BaseParameters, base_parameters
from .crba import mass_matrix
from .energy import kinetic_energy, link_kinetic_energies, momentum, potential_energy
from .forward import forward_dynamics
from .kinematics import jacobian, jacobian_rate, link_poses
from .lagrange import christoffel_symbols, coriolis_matrix, lagrange_forward_dynamics, lagrange_inverse_dynamics
from .precision import Diagnosis, diagnose
from .recursion_record import Recursion, bearing_loads, recursion
from .regressors import control_regressor, kinetic_energy_regressor, potential_energy_regressor, regressor
from .rnea import bias_torque, coriolis_torque, gravity_torque, inverse_dynamics

__all__ = [
    "BaseParameters",
    "Diagnosis",
    "Recursion",
    "articulated_forward_dynamics",
    "base_parameters",
    "bearing_loads",
    "bias_torque",
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
]
