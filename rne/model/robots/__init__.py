"""Robots built in code: no file is read."""

from __future__ import annotations

from collections.abc import Callable

from ..model import Model
from .abb_irb140 import PAYLOAD, irb140, irb140_mirrored

__all__ = ["BUILDERS", "RATED_PAYLOADS", "irb140", "irb140_mirrored"]

BUILDERS: dict[str, Callable[[], Model]] = {"irb140": irb140}
RATED_PAYLOADS: dict[str, float] = {"irb140": PAYLOAD}  # [kg], by the model's name
