"""From measurements to a model: records of motions, screened and filtered."""

from .prepared import Prepared
from .record import Record

__all__ = ["Prepared", "Record"]


def __dir__() -> list[str]:
    return __all__
