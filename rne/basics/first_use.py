"""Names of a package that are imported when they are first used (PEP 562)."""

from __future__ import annotations

import importlib
import sys
from collections.abc import Callable, Mapping, Sequence
from typing import Any


def on_first_use(package: str, names: Mapping[str, Sequence[str]]) -> Callable[[str], Any]:
    """The `__getattr__` of a package.

    Parameters
    ----------
    package : str
        Its name.
    names : mapping of str to sequence of str
        Its modules, and the names of each that the package shows; a module is shown itself, too.

    Examples
    --------
    >>> on_first_use("rne", {"elementwise": ("tanh",)})("tanh").__name__
    'tanh'
    """
    module_of = {name: module for module, shown in names.items() for name in shown}

    def find(name: str) -> Any:
        if name not in module_of and name not in names:
            raise AttributeError(f"module {package!r} has no attribute {name!r}")
        value = importlib.import_module(f"{package}.{module_of.get(name, name)}")
        if name in module_of:
            value = getattr(value, name)
            setattr(sys.modules[package], name, value)
        return value

    return find
