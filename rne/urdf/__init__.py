"""URDF text <-> Model. A file is untrusted input: every element is validated before it is used."""

from .findings import Finding
from .loading import check
from .read import read_urdf
from .write import to_urdf

__all__ = ["Finding", "check", "read_urdf", "to_urdf"]
