"""Short texts that say what an object is, for consoles and notebooks: never pages of arrays."""

from __future__ import annotations

import textwrap
from collections.abc import Mapping, Sequence
from dataclasses import fields
from typing import Any

import numpy as np

from .text_table import short

WIDTH = 100  # of a line
LONGEST = 120  # characters of one value
FEW = 7  # numbers that are written out
FEW_NAMES = 6
UNBROKEN = "\xa0"  # a space at which no line ends


def summary(thing: Any, **shown: Any) -> str:
    """Class and fields of a dataclass, each value in a few words.

    Parameters
    ----------
    thing : dataclass
        Fields that are None or have their default value are left out.
    **shown
        Values to show instead of those of the fields of these names.

    Returns
    -------
    str
        Lines of at most 100 characters.
    """
    values = {f.name: shown.get(f.name, getattr(thing, f.name)) for f in fields(thing)}
    left_out = {f.name for f in fields(thing) if values[f.name] is None or values[f.name] is f.default}
    parts = [f"{name}={brief(value)}".replace(" ", UNBROKEN) for name, value in values.items() if name not in left_out]
    return wrapped(f"{type(thing).__name__}({', '.join(parts)})").replace(UNBROKEN, " ")


def wrapped(text: str) -> str:
    """Text in lines of at most 100 characters, the further ones indented."""
    lines = (textwrap.wrap(line, WIDTH, subsequent_indent="  ") for line in text.splitlines())
    return "\n".join(part for line in lines for part in line)


def brief(value: Any) -> str:
    """A value of any type in at most 120 characters."""
    text = _brief(value)
    return text if len(text) <= LONGEST else f"{text[: LONGEST - 3]}..."


def _brief(value: Any) -> str:
    if isinstance(value, str):
        return f"'{short(value)}'"
    if isinstance(value, bool | np.bool_) or value is None:
        return str(value)
    if isinstance(value, float | np.floating):
        return f"{value:.6g}"
    if isinstance(value, Mapping):
        return "{" + _cut([f"{brief(key)}: {brief(x)}" for key, x in value.items()]) + "}"
    numbers = _numbers(value)
    if numbers is not None:
        return brief_array(numbers)
    if isinstance(value, Sequence) and not hasattr(value, "_fields"):
        return "[" + _cut([brief(x) for x in value]) + "]"
    model: Any = getattr(value, "model", None)
    if hasattr(model, "moving_joints"):
        return f"{type(value).__name__} '{short(model.name)}'"
    if hasattr(value, "__qualname__"):  # functions, of which the rest is an address
        return str(value.__qualname__)
    return " ".join(repr(value).split())


def brief_array(x: Any) -> str:
    """An array of numbers: all of a few, otherwise the shape, the smallest and the largest."""
    if x.ndim == 0:
        return f"{x[()]:.6g}"
    if x.ndim == 1 and len(x) <= FEW:
        return "[" + ", ".join(f"{entry:.4g}" for entry in x) + "]"
    shape = " x ".join(map(str, x.shape))
    if not x.size:
        return f"<{shape} numbers>"
    low, high = x.min(), x.max()
    return f"<{shape} numbers, " + (f"all {low:.4g}>" if low == high else f"{low:.4g} to {high:.4g}>")


def listed(names: Sequence[str]) -> str:
    """The first names, and how many more there are."""
    return _cut([short(name) for name in names])


def counted(number: int, noun: str) -> str:
    """A number of things, such as "1 joint" or "6 joints"."""
    return f"{number} {noun}{'s' * (number != 1)}"


def _cut(texts: list[str]) -> str:
    more = [f"... {len(texts) - FEW_NAMES + 1} more"] if len(texts) > FEW_NAMES else []
    return ", ".join(texts[: FEW_NAMES - 1] + more if more else texts)


def _numbers(value: Any) -> Any:
    """The value as an array of real numbers, or None."""
    if not isinstance(value, np.ndarray | list | tuple | int | np.number) or hasattr(value, "_fields"):
        return None
    try:
        array = np.asarray(value)
    except ValueError:  # ragged
        return None
    return array if array.dtype.kind in "iuf" else None
