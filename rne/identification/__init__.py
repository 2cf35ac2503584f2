"""From measurements to a model: motions that excite it; records of motions, screened and filtered."""

from .exciting_motion import Excitation
from .prepared import Prepared
from .record import Record
from .search_excitation import excitation

__all__ = ["Excitation", "Prepared", "Record", "excitation"]


def __dir__() -> list[str]:
    return __all__
