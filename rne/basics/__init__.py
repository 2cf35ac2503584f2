"""Vectors, rotations, arrays and tables of numbers: nothing here knows about robots."""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping
from importlib import import_module
from typing import Any


def on_first_use(package: str, names: Mapping[str, str]) -> Callable[[str], Any]:
    """Function `__getattr__` of a package, from its modules and the names in each of them, separated by blanks.

    The package also gets a `__dir__`, which lists its `__all__`, unless it has its own.
    """
    module_of = {name: module for module, given in names.items() for name in given.split()}

    def find(name: str) -> Any:
        if name in names:
            return import_module(f"{package}.{name}")
        if name not in module_of:
            raise AttributeError(f"module {package!r} has no attribute {name!r}")
        value = getattr(import_module(f"{package}.{module_of[name]}"), name)
        setattr(sys.modules[package], name, value)
        return value

    module = sys.modules[package]
    vars(module).setdefault("__dir__", lambda: module.__all__)
    return find
