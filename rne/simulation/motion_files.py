"""Files of a motion: an archive that holds all of it, a table for other programs."""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Callable, Mapping
from dataclasses import fields
from math import isfinite
from os import PathLike
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np

from ..basics.archive import TEXTS, contents
from ..basics.arrays import output_file
from ..basics.spatial import Array
from ..errors import ModelError
from ..model.model import Model
from ..model.solids import Box, Cylinder
from ..model.topology import refuse_couplings

FORM = "rne motion 1"
NOT_KEPT = ("error_estimate", "run")  # fields that may hold laws
MOTORS = ("motor_q", "motor_qd")  # which files from before there were elastic joints do not have
OF_MODEL = {f.name: str(f.type) for f in fields(Model) if f.name != "couplings"}  # which have programs
SHAPES: dict[str, tuple[str, ...]] = {
    **dict.fromkeys(("t", "kinetic", "potential", "energy", "work"), ("T",)),
    **dict.fromkeys(("q", "qd", "qdd", "tau", *MOTORS), ("T", "n")),
    "controller_state": ("T", "m"),
    "jumps": ("K",),
    **dict.fromkeys(("qdd_before", "tau_before"), ("K", "n")),
}
KINDS: dict[str, tuple[str, Callable[[Any], bool]]] = {  # by the type of a field
    "Array": ("an array of real numbers", lambda x: isinstance(x, np.ndarray) and x.dtype.kind in "fiu"),
    "str": ("a text", lambda x: isinstance(x, str)),
    "str | None": ("a text or null", lambda x: x is None or isinstance(x, str)),
    "int": ("a whole number", lambda x: type(x) is int),
    "float": ("a finite number", lambda x: type(x) in (int, float) and isfinite(x)),
    "bool": ("true or false", lambda x: isinstance(x, bool)),
    "tuple[str, ...]": ("a list of texts", lambda x: isinstance(x, list) and all(isinstance(k, str) for k in x)),
    "tuple[int, ...]": ("a list of whole numbers", lambda x: isinstance(x, list) and all(type(k) is int for k in x)),
    "tuple[Cylinder | Box, ...]": ("a list", lambda x: isinstance(x, list)),
    "Mapping[str, str]": (
        "texts by name",
        lambda x: isinstance(x, dict) and all(isinstance(k, str) for k in x.values()),
    ),
    "Moments | None": ("null", lambda x: x is None),
}


def write_archive(file: Path, values: dict[str, Any]) -> Path:
    """Write the fields of a Trajectory to a NumPy archive."""
    arrays, texts = _parted(values)
    entries: dict[str, Any] = {**arrays, TEXTS: np.array(json.dumps(texts, default=float))}
    np.savez_compressed(file, **entries)
    return file


def read_archive(file: Path, types: dict[str, str]) -> dict[str, Any]:
    """The fields of a Trajectory in an archive, checked; `types` names the type of each field."""
    arrays, texts = _contents(file)
    arrays = dict.fromkeys(MOTORS, np.zeros((0, 0))) | arrays
    try:
        _check_entries(arrays, texts, types)
        dissipated = {name: arrays.pop(f"dissipated.{name}") for name in texts.pop("dissipated")}
        model = _model(arrays, texts)  # takes its entries out of both
        values = arrays | texts | {"dissipated": dissipated, "model": model}
        _check(SimpleNamespace(**values))
    except ValueError as error:
        raise ValueError(f"{str(file)!r}: {error}") from None
    return values


def write_columns(path: str | PathLike[str], t: Array, columns: Mapping[str, Array]) -> Path:
    """Write times and named columns to a file of comma-separated values."""
    file = output_file(path)
    file.write_text(csv_text(t, columns), encoding="utf-8", newline="")
    return file


def csv_text(t: Array, columns: Mapping[str, Array]) -> str:
    """Times and named columns as comma-separated values, one row per sample, with all digits."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(["t", *columns])
    writer.writerows(np.column_stack([t, *columns.values()]).tolist())
    return text.getvalue()


def numbered_joints(n: int) -> tuple[str, ...]:
    """Names of joints that have none."""
    return tuple(f"joint_{k + 1}" for k in range(n))


def _parted(values: dict[str, Any]) -> tuple[dict[str, Array], dict[str, Any]]:
    """Arrays and the rest, which JSON can hold, of a trajectory's fields."""
    values = dict(values)
    model, dissipated = values.pop("model"), values.pop("dissipated")
    values |= {f"dissipated.{name}": energy for name, energy in dissipated.items()}
    if model is not None:
        refuse_couplings(model, "files of motions take")
        values |= {f"model.{name}": getattr(model, name) for name in OF_MODEL}
        values["model.notes"] = dict(model.notes)
    arrays = {name: value for name, value in values.items() if isinstance(value, np.ndarray)}
    texts = {name: value for name, value in values.items() if name not in arrays}
    return arrays, {"form": FORM, "dissipated": list(dissipated), "has_model": model is not None} | texts


def _contents(file: Path) -> tuple[dict[str, Array], dict[str, Any]]:
    """Arrays and the rest of an archive; a ValueError for any other file."""
    arrays, texts = contents(file, "a motion written by Trajectory.save")
    if texts.pop("form", None) != FORM:
        raise ValueError(f"{str(file)!r} is of another version of this package: expected {FORM!r}")
    return arrays, texts


def _check_entries(arrays: dict[str, Array], texts: dict[str, Any], types: dict[str, str]) -> None:
    """A ValueError that names the first entry that is missing, of another kind than its field, or unknown."""
    types = {"has_model": "bool"} | types | {"dissipated": "tuple[str, ...]"}
    types = {name: kind for name, kind in types.items() if name not in ("model", *NOT_KEPT)}
    _check_kinds(arrays, texts, types)
    further = {f"dissipated.{name}": "Array" for name in texts["dissipated"]}
    further |= {f"model.{name}": kind for name, kind in OF_MODEL.items()} if texts["has_model"] else {}
    _check_kinds(arrays, texts, further)
    for name in (*arrays, *texts):
        if (types | further).get(name) is None or name in arrays.keys() & texts.keys():
            raise ValueError(f"`{name}` is no entry of a motion")


def _check_kinds(arrays: dict[str, Array], texts: dict[str, Any], types: dict[str, str]) -> None:
    for name, kind in types.items():
        words, fits = KINDS[kind]
        held: dict[str, Any] = arrays if kind == "Array" else texts
        if name not in held:
            raise ValueError(f"`{name}` is missing, {words}")
        if not fits(held[name]):
            got = f"dtype {held[name].dtype}" if kind == "Array" else repr(held[name])
            raise ValueError(f"`{name}` must be {words}, got {got}")


def _check(motion: Any) -> None:
    """A ValueError that names the first array with a wrong shape or a number that is not finite, or late time."""
    sizes: dict[str, int] = {}
    for name, shape in SHAPES.items():
        _check_array(name, getattr(motion, name), shape, sizes)
    for name, energy in motion.dissipated.items():
        _check_array(f"dissipated.{name}", energy, ("T",), sizes)
    late = np.flatnonzero(np.diff(motion.t) <= 0)
    if late.size:
        before, after = motion.t[late[0] : late[0] + 2].tolist()
        raise ValueError(f"`t` must ascend, got {after:.6g} s after {before:.6g} s")
    if not np.isin(motion.jumps, motion.t).all() or (np.diff(motion.jumps) <= 0).any():
        raise ValueError("`jumps` must be among the times `t`, and ascend")
    if motion.model is not None and len(motion.model.joint_names) != sizes["n"]:
        raise ValueError(f"`q` must have {len(motion.model.joint_names)} columns, as its model, got {sizes['n']}")


def _check_array(name: str, value: Array, shape: tuple[str, ...], sizes: dict[str, int]) -> None:
    """Check an array; letters of its shape that are not among the `sizes` yet are added to them."""
    if value.shape == (0, 0) and (shape[1] == "m" or name in MOTORS or sizes["K"] == 0):  # as where none is given
        return
    expected = ", ".join(str(sizes.get(letter, letter)) for letter in shape)
    same = (sizes.setdefault(letter, length) == length for letter, length in zip(shape, value.shape, strict=False))
    if value.ndim != len(shape) or not all(same):
        raise ValueError(f"`{name}` must have shape ({expected}{',' * (len(shape) == 1)}), got {value.shape}")
    if not np.isfinite(value).all():
        place = tuple(int(k) for k in np.argwhere(~np.isfinite(value))[0])
        raise ValueError(f"`{name}` must be finite, got {value[place]} at index {place}")


def _model(arrays: dict[str, Array], texts: dict[str, Any]) -> Model | None:
    """The model, whose entries are taken from both."""
    if not texts.pop("has_model"):
        return None
    values: dict[str, Any] = {}
    for part in (arrays, texts):
        for name in [name for name in part if name.startswith("model.")]:
            value = part.pop(name)
            values[name.removeprefix("model.")] = tuple(value) if isinstance(value, list) else value
    try:
        values["shapes"] = tuple(_shape(*fields) for fields in values["shapes"])
    except (TypeError, ValueError):
        raise ValueError("`model.shapes` must be the fields of cylinders and boxes") from None
    try:
        return Model(**values)
    except (ValueError, ModelError) as error:
        raise ValueError(f"the model in the file is not complete: {error}") from None


def _shape(link: str, *sizes: Any) -> Cylinder | Box:
    """A shape of a model from its fields, whose vectors are lists in the file; a cylinder has one more than a box."""
    values: list[Any] = [tuple(x) if isinstance(x, list) else x for x in sizes]
    return Cylinder(link, *values) if len(values) > 3 else Box(link, *values)
