"""Files of an identification: a NumPy archive of its arrays, with all the rest as JSON; nothing in it is executed."""

from __future__ import annotations

import io
import json
from collections.abc import Mapping
from dataclasses import MISSING, fields, is_dataclass
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np

from ..basics.arrays import output_file
from ..dynamics.base_inertial_parameters import BaseParameters
from ..model.model import Model
from ..model.solids import Box, Cylinder
from ..model.standard_parameters import DriveModel, StandardParameters
from ..robot import Robot
from ..simulation.motion_files import DAMAGED, TEXTS
from .diagnosis.hypotheses import Cause
from .fit.equations import Equations, RegressionData
from .fit.least_squares import LeastSquares, Unexplained
from .log.prepared import Prepared
from .result import Identification

FORM = "rne identification"
VERSION = 1  # raised when a field changes its meaning; new fields with a default need no new version
OBJECTS = (Identification, StandardParameters, BaseParameters, DriveModel, Model, Box, Cylinder)
OBJECTS += (Equations, RegressionData, LeastSquares, Unexplained, Prepared, Cause)
TYPES: dict[str, Any] = {kind.__name__: kind for kind in OBJECTS}


def save(found: Identification, path: str | PathLike[str]) -> Path:
    """Write an identification to a NumPy archive."""
    file, arrays = output_file(path, ".npz"), dict[str, Any]()
    texts = {"form": FORM, "version": VERSION, "found": _encoded(found, arrays)}
    np.savez_compressed(file, allow_pickle=False, **arrays, **{TEXTS: np.array(json.dumps(texts))})
    return file


def load(path: str | PathLike[str]) -> Identification:
    """Read an identification that was written by `Identification.save`.

    Parameters
    ----------
    path : str or path-like
        A NumPy archive, ``.npz``.

    Returns
    -------
    Identification
        As it was saved, with all that was measured and fitted; its robot's engine is "numpy".

    Raises
    ------
    ValueError
        If the file is another one or damaged, of a later version, or has a field that this version does not know.
    OSError
        If the file cannot be read.

    Examples
    --------
    >>> import rne
    >>> rne.identification.load("found.npz")  # doctest: +SKIP
    Identification(54 base parameters of 'irb140' from 5886 equations, least squares, held-out error in motion at most 0.01 %)
    """
    file = Path(path)
    data = file.read_bytes()  # NumPy leaves a damaged file open
    try:
        with np.load(io.BytesIO(data), allow_pickle=False) as archive:
            arrays = {name: archive[name] for name in archive.files}
        texts = dict(json.loads(str(arrays.pop(TEXTS))))
    except DAMAGED:
        texts = {}
    if texts.get("form") != FORM:
        raise ValueError(f"{str(file)!r} is not a file written by Identification.save")
    if texts.get("version") != VERSION:
        raise ValueError(f"{str(file)!r} has version {texts.get('version')!r}, this package reads {VERSION}")
    try:
        found = _decoded(texts.get("found"), arrays, "found")
    except DAMAGED as error:
        raise ValueError(f"{str(file)!r}: {error}") from None
    if not isinstance(found, Identification):
        raise ValueError(f"{str(file)!r}: `found` must be an Identification, got {type(found).__name__}")
    return found


def _encoded(value: Any, arrays: dict[str, Any]) -> Any:
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
    if isinstance(value, Robot):
        return {"robot": _encoded(value.model, arrays)}
    if isinstance(value, Mapping):
        return {"mapping": {name: _encoded(x, arrays) for name, x in value.items()}}
    if type(value).__name__ in TYPES:
        names = [f.name for f in fields(value)] if is_dataclass(value) else value._fields
        kept = {name: x for name in names if not callable(x := getattr(value, name))}
        return {"type": type(value).__name__, "fields": {name: _encoded(x, arrays) for name, x in kept.items()}}
    if isinstance(value, tuple | list):
        return [_encoded(x, arrays) for x in value]
    raise TypeError(f"{type(value).__name__} cannot be written")


def _decoded(value: Any, arrays: Mapping[str, Any], place: str) -> Any:
    """A value that was encoded; a ValueError names the place of what is not known."""
    if isinstance(value, list):
        return tuple(_decoded(x, arrays, f"{place}[{k}]") for k, x in enumerate(value))
    if not isinstance(value, dict):
        return value
    if "array" in value:
        if (name := value["array"]) not in arrays:
            raise ValueError(f"`{place}` is missing")
        return arrays[name]
    if "slice" in value:
        return slice(*value["slice"])
    if "robot" in value:
        return Robot(_decoded(value["robot"], arrays, place))
    if "mapping" in value:
        return {name: _decoded(x, arrays, f"{place}.{name}") for name, x in value["mapping"].items()}
    kind = TYPES.get(value.get("type", ""))
    if kind is None:
        raise ValueError(f"`{place}` must be of a type that this version knows, got {value.get('type')!r}")
    given = {name: _decoded(x, arrays, f"{place}.{name}") for name, x in value["fields"].items()}
    if kind is BaseParameters:
        given["body_regressor"] = Robot(given["standard"].model).regressor
    names, needed = _fields(kind)
    for name in given.keys() - names:
        raise ValueError(f"`{place}.{name}` is not known to this version")
    for name in needed - given.keys():
        raise ValueError(f"`{place}.{name}` is missing")
    return kind(**given)


def _fields(kind: Any) -> tuple[set[str], set[str]]:
    """Names of a type's fields, and of those without a default."""
    if is_dataclass(kind):
        own = [f for f in fields(kind) if f.init]
        needed = {f.name for f in own if f.default is MISSING and f.default_factory is MISSING}
        return {f.name for f in own}, needed
    return set(kind._fields), set(kind._fields) - set(kind._field_defaults)
