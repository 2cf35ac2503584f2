"""Recursive Newton-Euler dynamics of robot manipulators in pure NumPy."""

from typing import TYPE_CHECKING, Any

from . import dynamics, model
from .basics import on_first_use
from .basics.text import InNotebooks
from .errors import (
    IdentificationError,
    IdentificationWarning,
    ModelError,
    NotFiniteError,
    PrecisionWarning,
    RneError,
    SimulationError,
    SimulationInterrupted,
    SingularMassMatrixError,
    UrdfError,
)
from .model import Model
from .robot import Robot, wrench

if TYPE_CHECKING:
    from . import bounds, control, elementwise, environments, export, identification, kernels, plotting, trajectories
    from .control.gains import Gains, check_gains
    from .control.laws import traceable
    from .identification import (
        Consistency,
        Excitation,
        Identification,
        excitation,
        identify,
        identify_drive_gains,
        identify_motion,
        identify_payload,
    )
    from .identification.diagnosis.compare_models import ModelComparison, compare_models
    from .kernels.compilation import compile
    from .model import dh_chain, irb140
    from .model.standard_parameters import DriveModel
    from .plotting.viewer import view
    from .simulation.bearings import BearingPeaks, bearing_peaks
    from .simulation.drive_report import DriveReport, drives
    from .simulation.elastic_joints import ElasticJoints
    from .simulation.ensembles import Ensemble, ensemble
    from .simulation.friction import Friction
    from .simulation.motion_gradients import motion_gradient
    from .simulation.scene import Payload, Scene
    from .simulation.sensitivities import Sensitivities, sensitivities
    from .simulation.simulator import simulate
    from .simulation.springs import Spring
    from .simulation.stepper import Stepper
    from .simulation.trajectory import Trajectory
    from .urdf import Finding, check, read_urdf, to_urdf
    from .urdf.loading import load, robots
else:
    __getattr__ = on_first_use(
        __name__,
        {
            "bounds": "",
            "control": "",
            "control.gains": "Gains check_gains",
            "control.laws": "traceable",
            "elementwise": "",
            "environments": "",
            "export": "",
            "identification": "Consistency Excitation Identification "
            "excitation identify identify_drive_gains identify_motion identify_payload",
            "kernels": "",
            "kernels.compilation": "compile",
            "model.abb_irb140": "irb140",
            "model.chains": "dh_chain",
            "model.standard_parameters": "DriveModel",
            "plotting": "",
            "plotting.viewer": "view",
            "simulation.bearings": "BearingPeaks bearing_peaks",
            "simulation.drive_report": "DriveReport drives",
            "simulation.elastic_joints": "ElasticJoints",
            "simulation.ensembles": "Ensemble ensemble",
            "simulation.friction": "Friction",
            "simulation.motion_gradients": "motion_gradient",
            "simulation.scene": "Payload Scene",
            "simulation.sensitivities": "Sensitivities sensitivities",
            "simulation.simulator": "simulate",
            "simulation.springs": "Spring",
            "simulation.stepper": "Stepper",
            "simulation.trajectory": "Trajectory",
            "trajectories": "",
            "urdf": "Finding check read_urdf to_urdf",
            "urdf.loading": "load robots",
            "identification.diagnosis.compare_models": "ModelComparison compare_models",
        },
    )


def _repr_html_(thing: Any) -> str:
    from .plotting.notebook import html  # loaded for the first page

    return html(thing)


def _plotted(thing: Any, *how: Any, **options: Any) -> Any:
    from .plotting.plots import sensitivity_plot  # loaded for the first picture

    return sensitivity_plot(thing, *how, **options)


InNotebooks._repr_html_, InNotebooks._plotted = _repr_html_, _plotted

__version__ = "0.4.0"

__all__ = [
    "BearingPeaks",
    "Consistency",
    "DriveModel",
    "DriveReport",
    "ElasticJoints",
    "Ensemble",
    "Excitation",
    "Finding",
    "Friction",
    "Gains",
    "Identification",
    "IdentificationError",
    "IdentificationWarning",
    "Model",
    "ModelComparison",
    "ModelError",
    "NotFiniteError",
    "Payload",
    "PrecisionWarning",
    "RneError",
    "Robot",
    "Scene",
    "Sensitivities",
    "SimulationError",
    "SimulationInterrupted",
    "SingularMassMatrixError",
    "Spring",
    "Stepper",
    "Trajectory",
    "UrdfError",
    "bearing_peaks",
    "bounds",
    "check",
    "check_gains",
    "compare_models",
    "compile",
    "control",
    "dh_chain",
    "drives",
    "dynamics",
    "elementwise",
    "ensemble",
    "environments",
    "excitation",
    "export",
    "identification",
    "identify",
    "identify_drive_gains",
    "identify_motion",
    "identify_payload",
    "irb140",
    "kernels",
    "load",
    "model",
    "motion_gradient",
    "plotting",
    "read_urdf",
    "robots",
    "sensitivities",
    "simulate",
    "to_urdf",
    "traceable",
    "trajectories",
    "view",
    "wrench",
]


def __dir__() -> list[str]:
    return [*__all__, "__version__"]
