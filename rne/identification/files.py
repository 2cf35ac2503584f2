"""Archives of objects: their arrays in a NumPy archive, with all the rest as JSON; nothing in it is executed."""

from __future__ import annotations

import io
import json
from collections.abc import Callable, Mapping
from dataclasses import MISSING, fields, is_dataclass
from os import PathLike
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ..basics.arrays import output_file
from ..simulation.motion_files import DAMAGED, TEXTS


class Kind(NamedTuple):
    """A type of objects in files: the names of its fields, those without a default, what makes it of them."""

    names: tuple[str, ...]
    needed: frozenset[str]
    make: Callable[..., Any]


Kinds = Mapping[type, Kind]


def write(path: str | PathLike[str], kinds: Kinds, value: Any, **header: Any) -> Path:
    """Write an object of one of the kinds to an archive, below a header."""
    file, arrays = output_file(path, ".npz"), dict[str, Any]()
    texts = header | {"value": _encoded(value, kinds, arrays)}
    np.savez_compressed(file, allow_pickle=False, **arrays, **{TEXTS: np.array(json.dumps(texts))})
    return file


def read(path: str | PathLike[str], kinds: Kinds, wanted: type, **header: Any) -> Any:
    """The object in an archive; a ValueError names what is not as expected."""
    file = Path(path)
    data = file.read_bytes()  # NumPy leaves a damaged file open
    try:
        with np.load(io.BytesIO(data), allow_pickle=False) as archive:
            arrays = {name: archive[name] for name in archive.files}
        texts = dict(json.loads(str(arrays.pop(TEXTS))))
    except DAMAGED:
        raise ValueError(f"{str(file)!r} is no archive of this package, or damaged") from None
    for name, expected in header.items():
        if texts.get(name) != expected:
            raise ValueError(f"{str(file)!r}: `{name}` must be {expected!r}, got {texts.get(name)!r}")
    try:
        found = _decoded(texts.get("value"), {kind.__name__: kind for kind in kinds}, kinds, arrays, wanted.__name__)
    except DAMAGED as error:
        raise ValueError(f"{str(file)!r}: {error}") from None
    if not isinstance(found, wanted):
        raise ValueError(f"{str(file)!r} must have a value of type {wanted.__name__}, got {type(found).__name__}")
    return found


def _encoded(value: Any, kinds: Kinds, arrays: dict[str, Any]) -> Any:
    """A value as JSON can hold it; arrays by their number."""
    if isinstance(value, np.ndarray):
        arrays[name := f"array_{len(arrays)}"] = value
        return {"array": name}
    if isinstance(value, np.generic):
        value = value.item()
    if value is None or isinstance(value, bool | int | float | str):
        return value
    if isinstance(value, slice):
        return {"slice": [value.start, value.stop]}
    if isinstance(value, Mapping):
        return {"mapping": {name: _encoded(x, kinds, arrays) for name, x in value.items()}}
    if type(value) in kinds:
        names = kinds[type(value)].names
        return {"type": type(value).__name__} | {
            "fields": {n: _encoded(getattr(value, n), kinds, arrays) for n in names}
        }
    if isinstance(value, tuple | list):
        return [_encoded(x, kinds, arrays) for x in value]
    raise TypeError(f"{type(value).__name__} cannot be written to a file")


def _decoded(value: Any, types: Mapping[str, type], kinds: Kinds, arrays: Mapping[str, Any], place: str) -> Any:
    """A value that was encoded; a ValueError names the place of what is not known."""

    def inner(x: Any, name: str) -> Any:
        return _decoded(x, types, kinds, arrays, f"{place}{name}")

    if isinstance(value, list):
        return tuple(inner(x, f"[{k}]") for k, x in enumerate(value))
    if not isinstance(value, dict):
        return value
    if "array" in value:
        if value["array"] not in arrays:
            raise ValueError(f"`{place}` is missing")
        return arrays[value["array"]]
    if "slice" in value:
        return slice(*value["slice"])
    if "mapping" in value:
        return {name: inner(x, f".{name}") for name, x in value["mapping"].items()}
    if value.get("type") not in types:
        raise ValueError(f"`{place}` is of a type that is not known to this version, {value.get('type')!r}")
    kind = kinds[types[value["type"]]]
    for name in value["fields"].keys() - kind.names:
        raise ValueError(f"`{place}.{name}` is not known to this version")
    for name in kind.needed - value["fields"].keys():
        raise ValueError(f"`{place}.{name}` is missing")
    return kind.make(**{name: inner(x, f".{name}") for name, x in value["fields"].items()})


def kind_of(made: type) -> tuple[type, Kind]:
    """The kind of a dataclass or NamedTuple, with all of its fields."""
    if is_dataclass(made):
        own = [f for f in fields(made) if f.init]
        needed = [f.name for f in own if f.default is MISSING and f.default_factory is MISSING]
        return made, Kind(tuple(f.name for f in own), frozenset(needed), made)
    given: Any = made
    return made, Kind(given._fields, frozenset(given._fields) - given._field_defaults.keys(), made)
