"""Conversion between URDF text and Model. A file is untrusted input: every element is validated before use."""

from .findings import Finding
from .loading import check
from .read import read_urdf
from .write import to_urdf

__all__ = ["Finding", "check", "read_urdf", "to_urdf"]
