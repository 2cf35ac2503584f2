"""The Model of a robot, its validation, its construction and modification, built-in robots."""

from typing import TYPE_CHECKING

from ..basics import on_first_use
from .abb_irb140 import irb140
from .chains import chain, dh_chain
from .model import Model
from .modify import locked, mounted, with_armature, with_limits, with_payload
from .parameters import with_parameters
from .solids import Box, Cylinder, cylinder_inertia

if TYPE_CHECKING:
    from .coupling import coupled
    from .linkages import cylinder, four_bar, slider_crank
else:
    __getattr__ = on_first_use(__name__, {"coupling": "coupled", "linkages": "cylinder four_bar slider_crank"})

__all__ = [
    "Box",
    "Cylinder",
    "Model",
    "chain",
    "coupled",
    "cylinder",
    "cylinder_inertia",
    "dh_chain",
    "four_bar",
    "irb140",
    "locked",
    "mounted",
    "slider_crank",
    "with_armature",
    "with_limits",
    "with_parameters",
    "with_payload",
]
