"""From measurements to a model: motions that excite it, records of motions, their fit, and how far to trust it."""

from ..validation.comparison import ModelComparison, compare_models
from ..validation.torque_difference import Candidate
from .causes import Cause
from .checking import Check
from .drive_gains import DriveGains, identify_drive_gains
from .exciting_motion import Excitation, excitation
from .fit import identify
from .least_squares import LeastSquares, Unexplained
from .payload import PayloadEstimate, identify_payload
from .prepared import Prepared
from .record import Record
from .result import Identification
from .rigid_body_test import Consistency, EnergyBalance
from .screening import RecordFinding

__all__ = [
    "Candidate",
    "Cause",
    "Check",
    "Consistency",
    "DriveGains",
    "EnergyBalance",
    "Excitation",
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
