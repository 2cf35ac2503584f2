"""Recursive Newton-Euler dynamics of robot manipulators in pure NumPy."""

from . import control, elementwise, identification, plotting, trajectories
from .analysis.bearings import BearingPeaks, bearing_peaks
from .control.gains import Gains, check_gains
from .control.laws import traceable
from .dynamics.aba import articulated_forward_dynamics
from .dynamics.base_parameters import BaseParameters, base_parameters
from .dynamics.coriolis import coriolis_matrix
from .dynamics.crba import mass_matrix
from .dynamics.diagnosis import Diagnosis, diagnose
from .dynamics.energy import kinetic_energy, link_kinetic_energies, momentum, potential_energy
from .dynamics.forward import forward_dynamics
from .dynamics.jacobians import jacobian, jacobian_rate
from .dynamics.kinematics import link_poses
from .dynamics.lagrange import christoffel_symbols, lagrange_inverse_dynamics
from .dynamics.lagrange_forward import lagrange_forward_dynamics
from .dynamics.record import Recursion, bearing_loads, recursion
from .dynamics.regressor import (
    control_regressor,
    kinetic_energy_regressor,
    potential_energy_regressor,
    regressor,
)
from .dynamics.rnea import bias_torque, coriolis_torque, gravity_torque, inverse_dynamics
from .errors import (
    IdentificationError,
    ModelError,
    NotFiniteError,
    PrecisionWarning,
    RneError,
    SimulationError,
    SingularMassMatrixError,
    UrdfError,
)
from .identification import (
    Consistency,
    Excitation,
    Identification,
    ModelComparison,
    compare_models,
    consistency,
    excitation,
    identify,
)
from .kernels.compilation import compile, derivative
from .kernels.kernel import Kernel
from .model.chains import chain
from .model.denavit_hartenberg import dh_chain
from .model.model import Model
from .model.modify import locked, mounted, with_payload
from .model.parameters import with_parameters
from .model.robots import irb140
from .model.solids import Cylinder, cylinder_inertia
from .plotting.viewer import view
from .robot import Robot
from .simulation.ensembles import Ensemble, ensemble
from .simulation.friction import Friction
from .simulation.parts import Payload
from .simulation.scene import Scene
from .simulation.simulator import simulate
from .simulation.trajectory import Trajectory
from .urdf import Finding, check, read_urdf, to_urdf
from .urdf.library import robots
from .urdf.loading import load

__version__ = "0.1.0"

__all__ = [
    "BaseParameters",
    "BearingPeaks",
    "Consistency",
    "Cylinder",
    "Diagnosis",
    "Ensemble",
    "Excitation",
    "Finding",
    "Friction",
    "Gains",
    "Identification",
    "IdentificationError",
    "Kernel",
    "Model",
    "ModelComparison",
    "ModelError",
    "NotFiniteError",
    "Payload",
    "PrecisionWarning",
    "Recursion",
    "RneError",
    "Robot",
    "Scene",
    "SimulationError",
    "SingularMassMatrixError",
    "Trajectory",
    "UrdfError",
    "articulated_forward_dynamics",
    "base_parameters",
    "bearing_loads",
    "bearing_peaks",
    "bias_torque",
    "chain",
    "check",
    "check_gains",
    "christoffel_symbols",
    "compare_models",
    "compile",
    "consistency",
    "control",
    "control_regressor",
    "coriolis_matrix",
    "coriolis_torque",
    "cylinder_inertia",
    "derivative",
    "dh_chain",
    "diagnose",
    "elementwise",
    "ensemble",
    "excitation",
    "forward_dynamics",
    "gravity_torque",
    "identification",
    "identify",
    "inverse_dynamics",
    "irb140",
    "jacobian",
    "jacobian_rate",
    "kinetic_energy",
    "kinetic_energy_regressor",
    "lagrange_forward_dynamics",
    "lagrange_inverse_dynamics",
    "link_kinetic_energies",
    "link_poses",
    "load",
    "locked",
    "mass_matrix",
    "momentum",
    "mounted",
    "plotting",
    "potential_energy",
    "potential_energy_regressor",
    "read_urdf",
    "recursion",
    "regressor",
    "robots",
    "simulate",
    "to_urdf",
    "traceable",
    "trajectories",
    "view",
    "with_parameters",
    "with_payload",
]


def __dir__() -> list[str]:
    return [*__all__, "__version__"]
