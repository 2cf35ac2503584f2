"""Archives of objects: their arrays in a NumPy archive, with all the rest as JSON; nothing in it is executed."""

from __future__ import annotations

import io
import json
import zipfile
import zlib
from collections.abc import Callable, Mapping
from dataclasses import fields, is_dataclass
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np

from .arrays import output_file
from .marks import TEXTS
from .text import cut

# What NumPy, zlib and JSON raise for other files and damaged ones.
DAMAGED = (
    *(ValueError, KeyError, EOFError, AttributeError, TypeError, NotImplementedError),
    *(zipfile.BadZipFile, zlib.error),
)
SIMPLE: dict[str, Any] = {
    "Array": np.ndarray,
    "str": str,
    "int": int,
    "float": int | float,
    "bool": bool,
}  # by annotation

Kinds = dict[Any, tuple[tuple[str, ...], Callable[..., Any]]]  # of each type in files its fields, and what makes it


def contents(file: Path, what: str) -> tuple[dict[str, Any], dict[str, Any]]:
    """Arrays and the rest of an archive; a ValueError for any other file, which is not `what` it should be."""
    data = file.read_bytes()  # NumPy leaves a damaged file open
    try:
        with np.load(io.BytesIO(data), allow_pickle=False) as archive:
            arrays = {name: archive[name] for name in archive.files}
        return arrays, dict(json.loads(str(arrays.pop(TEXTS))).items())
    except DAMAGED:
        raise ValueError(f"{str(file)!r} is not {what}") from None


def write(path: str | PathLike[str], kinds: Kinds, value: Any, version: int) -> Path:
    """Write an object of one of the kinds to an archive."""
    file, arrays = output_file(path, ".npz"), dict[str, Any]()
    texts = {"version": version, "value": _encoded(value, kinds, arrays)}
    np.savez_compressed(file, allow_pickle=False, **arrays, **{TEXTS: np.array(json.dumps(texts))})
    return file


def read(path: str | PathLike[str], kinds: Kinds, wanted: type, version: int) -> Any:
    """The object in an archive; a ValueError names what is not as expected."""
    arrays, texts = contents(file := Path(path), f"written by {wanted.__name__}.save")
    try:
        if texts.get("version") != version:
            raise ValueError(f"`version` must be {version}, got {texts.get('version')!r}")
        found = _decoded(texts.get("value"), {kind.__name__: kind for kind in kinds}, kinds, arrays, wanted.__name__)
        if not isinstance(found, wanted):
            raise ValueError(f"the object must be of type {wanted.__name__}, got {type(found).__name__}")
    except DAMAGED as error:
        raise ValueError(f"{str(file)!r}: {error}") from None
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
        names, _ = kinds[type(value)]
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
        array = arrays[value["array"]]
        if array.dtype.kind not in "biuf":
            raise ValueError(f"`{place}` must be an array of real numbers, got dtype {array.dtype}")
        return array
    if "slice" in value:
        return slice(*value["slice"])
    if "mapping" in value:
        return {name: inner(x, f".{name}") for name, x in value["mapping"].items()}
    if value.get("type") not in types:
        raise ValueError(f"`{place}` is of a type that is not known to this version, {value.get('type')!r}")
    names, make = kinds[types[value["type"]]]
    for name in value["fields"].keys() - names:
        raise ValueError(f"`{place}.{name}` is not known to this version")
    found = {name: inner(x, f".{name}") for name, x in value["fields"].items()}
    for name, x in found.items():
        stated = types[value["type"]].__annotations__.get(name, "")
        if not isinstance(x, SIMPLE.get(stated, object)):
            raise ValueError(f"`{place}.{name}` must be of type {stated}, got {cut(repr(x), 80)}")
    return make(**found)


def names_of(made: Any) -> tuple[str, ...]:
    """Names of the fields of a dataclass or a NamedTuple."""
    return tuple(f.name for f in fields(made)) if is_dataclass(made) else tuple(made._fields)
