"""Packages of source text for other programs, from a robot, a scene, or a model that was identified."""

from .cpp_package import cmake

__all__ = ["cmake"]
