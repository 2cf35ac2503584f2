"""The Model of a robot, its validation, its construction and modification, built-in robots."""

from .abb_irb140 import irb140
from .chains import chain, dh_chain
from .model import Model
from .modify import locked, mounted, with_armature, with_limits, with_payload
from .parameters import with_parameters
from .solids import Box, Cylinder, cylinder_inertia

__all__ = [
    "Box",
    "Cylinder",
    "Model",
    "chain",
    "cylinder_inertia",
    "dh_chain",
    "irb140",
    "locked",
    "mounted",
    "with_armature",
    "with_limits",
    "with_parameters",
    "with_payload",
]
