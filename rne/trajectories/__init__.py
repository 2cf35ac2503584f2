"""Reference motions: functions of time that return (q, qd, qdd), from rest to rest, through samples, or along paths."""

from typing import TYPE_CHECKING

from ..basics import on_first_use
from ..files.samples import Samples, read_csv
from .profiles import (
    Path,
    Quintic,
    ReferenceMotion,
    Sampled,
    Spline,
    Trapezoidal,
    quintic,
    sampled,
    spline,
    through,
    trapezoidal,
)

if TYPE_CHECKING:
    from .time_optimal import FastestMotion, fastest
else:
    __getattr__ = on_first_use(__name__, {"time_optimal": "FastestMotion fastest"})

__all__ = [
    "FastestMotion",
    "Path",
    "Quintic",
    "ReferenceMotion",
    "Sampled",
    "Samples",
    "Spline",
    "Trapezoidal",
    "fastest",
    "quintic",
    "read_csv",
    "sampled",
    "spline",
    "through",
    "trapezoidal",
]
