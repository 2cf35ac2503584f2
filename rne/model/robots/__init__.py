"""Built-in robots, and generators of robots for tests and benchmarks. No file is read."""

from __future__ import annotations

from collections.abc import Callable

from ..model import Model
from .abb_irb140 import irb140, irb140_mirrored

__all__ = ["BUILDERS", "irb140", "irb140_mirrored"]

BUILDERS: dict[str, Callable[[], Model]] = {"irb140": irb140}
