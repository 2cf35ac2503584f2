"""Identification of models from measurements: exciting motions, records, their fit, and its uncertainty."""

from typing import TYPE_CHECKING

from ..basics import on_first_use
from .check import Check
from .diagnosis.compare_models import ModelComparison, compare_models
from .diagnosis.hypotheses import Cause, Hypothesis
from .diagnosis.rigid_body_test import Consistency, EnergyBalance
from .drive_gains import DriveGains, identify_drive_gains
from .exciting_motions.motion import Excitation, excitation
from .fit.bodies import BodiesFit, fit_bodies
from .fit.equations import RegressionData
from .fit.least_squares import Bias, LeastSquares, Unexplained, fit_base_parameters
from .log.findings import CleanRecord, RecordFinding
from .log.prepared import Prepared
from .log.record import Record
from .payload import PayloadEstimate, identify_payload
from .pipeline import assemble, diagnose, identify, regression
from .result import Identification

if TYPE_CHECKING:
    from .motion.motion_fit import MotionFit, identify_motion
else:
    __getattr__ = on_first_use(__name__, {"motion.motion_fit": "MotionFit identify_motion"})

__all__ = [
    "Bias",
    "BodiesFit",
    "Cause",
    "Check",
    "CleanRecord",
    "Consistency",
    "DriveGains",
    "EnergyBalance",
    "Excitation",
    "Hypothesis",
    "Identification",
    "LeastSquares",
    "ModelComparison",
    "MotionFit",
    "PayloadEstimate",
    "Prepared",
    "Record",
    "RecordFinding",
    "RegressionData",
    "Unexplained",
    "assemble",
    "compare_models",
    "diagnose",
    "excitation",
    "fit_base_parameters",
    "fit_bodies",
    "identify",
    "identify_drive_gains",
    "identify_motion",
    "identify_payload",
    "regression",
]


def __dir__() -> list[str]:
    return __all__
