"""Recursive Newton-Euler dynamics of robot manipulators in pure NumPy."""

import importlib
from typing import TYPE_CHECKING, Any

from . import dynamics, elementwise, kernels, model
from .dynamics.recursion_record import BearingPeaks, bearing_peaks
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
from .kernels.kernel import compile
from .model.abb_irb140 import irb140
from .model.chains import dh_chain
from .model.model import Model
from .robot import Robot
from .urdf import Finding, check, read_urdf, to_urdf
from .urdf.loading import load, robots

if TYPE_CHECKING:
    from . import control, identification, plotting, trajectories
    from .control.gains import Gains, check_gains
    from .control.laws import traceable
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
    from .plotting.viewer import view
    from .simulation.ensembles import Ensemble, ensemble
    from .simulation.friction import Friction
    from .simulation.parts import Payload
    from .simulation.scene import Scene
    from .simulation.simulator import simulate
    from .simulation.trajectory import Trajectory

__version__ = "0.1.0"

__all__ = [
    "BearingPeaks",
    "Consistency",
    "Ensemble",
    "Excitation",
    "Finding",
    "Friction",
    "Gains",
    "Identification",
    "IdentificationError",
    "Model",
    "ModelComparison",
    "ModelError",
    "NotFiniteError",
    "Payload",
    "PrecisionWarning",
    "RneError",
    "Robot",
    "Scene",
    "SimulationError",
    "SingularMassMatrixError",
    "Trajectory",
    "UrdfError",
    "bearing_peaks",
    "check",
    "check_gains",
    "compare_models",
    "compile",
    "consistency",
    "control",
    "dh_chain",
    "dynamics",
    "elementwise",
    "ensemble",
    "excitation",
    "identification",
    "identify",
    "irb140",
    "kernels",
    "load",
    "model",
    "plotting",
    "read_urdf",
    "robots",
    "simulate",
    "to_urdf",
    "traceable",
    "trajectories",
    "view",
]

_ON_FIRST_USE = {
    "control.gains": ("Gains", "check_gains"),
    "control.laws": ("traceable",),
    "identification": (
        "Consistency",
        "Excitation",
        "Identification",
        "ModelComparison",
        "compare_models",
        "consistency",
        "excitation",
        "identify",
    ),
    "plotting.viewer": ("view",),
    "simulation.ensembles": ("Ensemble", "ensemble"),
    "simulation.friction": ("Friction",),
    "simulation.parts": ("Payload",),
    "simulation.scene": ("Scene",),
    "simulation.simulator": ("simulate",),
    "simulation.trajectory": ("Trajectory",),
}
_MODULE_OF = {name: module for module, names in _ON_FIRST_USE.items() for name in names}


def __getattr__(name: str) -> Any:
    """Import what a first call does not need when it is first used (PEP 562)."""
    if name in ("control", "identification", "plotting", "trajectories"):
        return importlib.import_module(f".{name}", __name__)
    if name not in _MODULE_OF:
        raise AttributeError(f"module 'rne' has no attribute {name!r}")
    value = globals()[name] = getattr(importlib.import_module(f".{_MODULE_OF[name]}", __name__), name)
    return value


def __dir__() -> list[str]:
    return [*__all__, "__version__"]
