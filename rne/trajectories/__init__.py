"""Reference motions: functions of time that return (q, qd, qdd), from rest to rest or through samples."""

from .csv_file import Samples, read_csv
from .profiles import Quintic, Spline, Trapezoidal, quintic, spline, trapezoidal

__all__ = ["Quintic", "Samples", "Spline", "Trapezoidal", "quintic", "read_csv", "spline", "trapezoidal"]


def __dir__() -> list[str]:
    return __all__
