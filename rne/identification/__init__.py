"""From measurements to a model: motions that excite it, records of motions, their fit, and how far to trust it."""

from .certificate.candidate import Candidate
from .certificate.comparison import ModelComparison, compare_models
from .certificate.consistency import consistency
from .certificate.energy import EnergyBalance
from .certificate.verdict import Consistency
from .checking import Check
from .estimation.least_squares import LeastSquares
from .exciting_motions.excitation_result import Excitation
from .exciting_motions.search_excitation import excitation
from .fit import identify
from .measurements.findings import RecordFinding
from .measurements.prepared import Prepared
from .measurements.record import Record
from .result import Identification

__all__ = [
    "Candidate",
    "Check",
    "Consistency",
    "EnergyBalance",
    "Excitation",
    "Identification",
    "LeastSquares",
    "ModelComparison",
    "Prepared",
    "Record",
    "RecordFinding",
    "compare_models",
    "consistency",
    "excitation",
    "identify",
]


def __dir__() -> list[str]:
    return __all__
