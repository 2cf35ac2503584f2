"""The Model of a robot, its validation, its construction and modification, built-in robots."""

from typing import TYPE_CHECKING

from ..basics.first_use import on_first_use
from .model import Model
from .parameters import with_parameters
from .solids import Cylinder, cylinder_inertia

if TYPE_CHECKING:
    from .abb_irb140 import irb140
    from .chains import chain, dh_chain
    from .modify import locked, mounted, with_limits, with_payload
else:
    __getattr__ = on_first_use(
        __name__,
        {
            "abb_irb140": ("irb140",),
            "chains": ("chain", "dh_chain"),
            "modify": ("locked", "mounted", "with_limits", "with_payload"),
        },
    )

__all__ = [
    "Cylinder",
    "Model",
    "chain",
    "cylinder_inertia",
    "dh_chain",
    "irb140",
    "locked",
    "mounted",
    "with_limits",
    "with_parameters",
    "with_payload",
]
