"""From measurements to a model: motions that excite it, records of motions, their fit, and how far to trust it."""

from .diagnosis.compare_models import Candidate, ModelComparison, compare_models
from .diagnosis.hypotheses import Cause, Hypothesis
from .diagnosis.rigid_body_test import Consistency, EnergyBalance
from .drive_gains import DriveGains, identify_drive_gains
from .exciting_motions.motion import Excitation, excitation
from .fit.least_squares import Bias, LeastSquares, Unexplained
from .log.prepared import Prepared
from .log.record import Record
from .log.screening import RecordFinding
from .model_fit import identify
from .payload import PayloadEstimate, identify_payload
from .result import Check, Identification

__all__ = [
    "Bias",
    "Candidate",
    "Cause",
    "Check",
    "Consistency",
    "DriveGains",
    "EnergyBalance",
    "Excitation",
    "Hypothesis",
    "Identification",
    "LeastSquares",
    "ModelComparison",
    "PayloadEstimate",
    "Prepared",
    "Record",
    "RecordFinding",
    "Unexplained",
    "compare_models",
    "excitation",
    "identify",
    "identify_drive_gains",
    "identify_payload",
]


def __dir__() -> list[str]:
    return __all__
