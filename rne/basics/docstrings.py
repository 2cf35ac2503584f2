"""Parameters that several methods of a class have in common, described once for all their docstrings."""

from __future__ import annotations

import inspect
import re
from collections.abc import Callable
from typing import TypeVar

T = TypeVar("T")
HEAD = "Parameters\n----------\n"
SECTION = re.compile(r"^\w+\n---", re.MULTILINE)
ENTRY = re.compile(r"^(\w+(?:, \w+)*) : .+\n(?:    .+\n)+", re.MULTILINE)


def describe_parameters(descriptions: str) -> Callable[[type[T]], type[T]]:
    """Decorator of a class that completes the section Parameters of its methods' docstrings.

    `descriptions` has the entries of that section, one for each name. A method has those of its arguments that its own
    docstring does not describe; its own entries follow them.
    """
    shared = {entry[1]: entry[0] for entry in ENTRY.finditer(inspect.cleandoc(descriptions) + "\n")}

    def decorate(cls: type[T]) -> type[T]:
        for name, method in vars(cls).items():
            if inspect.isfunction(method) and method.__doc__ and not name.startswith("_"):
                method.__doc__ = _completed(method.__doc__, [*inspect.signature(method).parameters], shared)
        return cls

    return decorate


def _completed(docstring: str, arguments: list[str], shared: dict[str, str]) -> str:
    text = inspect.cleandoc(docstring) + "\n"
    first = SECTION.search(text)
    summary, sections = (text[: first.start()], text[first.start() :]) if first else (text + "\n", "")
    own, rest = sections.removeprefix(HEAD), "" if sections.startswith(HEAD) else "\n"
    described = "" if rest else own.partition("\n\n")[0] + "\n"
    names = {name for entry in ENTRY.finditer(described) for name in entry[1].split(", ")}
    added = "".join(shared[name] for name in arguments if name in shared and name not in names)
    return f"{summary}{HEAD}{added}{rest}{own}" if added else docstring
