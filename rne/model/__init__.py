"""Model of a robot: its validation, construction and modification; built-in robots."""

from typing import TYPE_CHECKING

from ..basics import on_first_use
from .model import Model
from .parameters import with_parameters
from .solids import Box, Cylinder, cylinder_inertia

if TYPE_CHECKING:
    from .abb_irb140 import irb140
    from .chains import chain, dh_chain
    from .coupling import coupled
    from .linkages import cylinder, four_bar, slider_crank
    from .modify import locked, mounted, with_armature, with_limits, with_payload
    from .standard_parameters import StandardParameters
else:
    __getattr__ = on_first_use(
        __name__,
        {
            "abb_irb140": "irb140",
            "chains": "chain dh_chain",
            "coupling": "coupled",
            "linkages": "cylinder four_bar slider_crank",
            "modify": "locked mounted with_armature with_limits with_payload",
            "standard_parameters": "StandardParameters",
        },
    )

__all__ = [
    "Box",
    "Cylinder",
    "Model",
    "StandardParameters",
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
