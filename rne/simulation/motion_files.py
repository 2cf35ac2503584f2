"""Files of a motion: an archive that holds all of it, a table for other programs."""

from __future__ import annotations

import csv
import io
import json
import zipfile
import zlib
from collections.abc import Mapping
from dataclasses import fields
from math import isfinite
from os import PathLike
from pathlib import Path
from typing import Any, Self

import numpy as np

from ..basics.paths import output_file
from ..basics.spatial import Array
from ..errors import ModelError
from ..model.model import Model
from ..model.solids import Box, Cylinder

# What NumPy, zlib and JSON raise for other files and damaged ones.
DAMAGED = (
    *(ValueError, KeyError, EOFError, AttributeError, TypeError, NotImplementedError),
    *(zipfile.BadZipFile, zlib.error),
)
TEXTS = "texts"  # entry of the archive: what is not an array, as JSON
FORM = "rne motion 1"
SHAPES: dict[str, tuple[str, ...]] = {
    **dict.fromkeys(("t", "kinetic", "potential", "energy", "work"), ("T",)),
    **dict.fromkeys(("q", "qd", "qdd", "tau"), ("T", "n")),
    "controller_state": ("T", "m"),
    "jumps": ("K",),
    **dict.fromkeys(("qdd_before", "tau_before"), ("K", "n")),
}
MAY_BE_EMPTY = ("controller_state", "qdd_before", "tau_before")
KINDS: dict[str, type | tuple[type, ...]] = {
    **dict.fromkeys(("method", "message", "scene"), str),
    **dict.fromkeys(("evaluations", "status"), int),
    **dict.fromkeys(("energy_drift", "energy_start"), (int, float)),
    "at_steps": bool,
}


class MotionFiles:
    """Writing and reading of a Trajectory."""

    t: Array
    q: Array
    model: Model | None

    def save(self, path: str | PathLike[str]) -> Path:
        """Write the motion, its model and its scene's description to a NumPy archive.

        Parameters
        ----------
        path : str or path-like
            Ending in .npz, in an existing folder.

        Returns
        -------
        pathlib.Path
            The file written; `Trajectory.load` reads it. It names the path of the robot's URDF file, as `model.source`.

        Raises
        ------
        ValueError
            If `path` does not end in .npz.
        FileNotFoundError
            If its folder does not exist.

        Examples
        --------
        >>> import rne
        >>> swing = rne.simulate(rne.load("irb140"), [0] * 6, [0] * 6, 0.5)
        >>> file = swing.save("swing.npz")  # doctest: +SKIP
        """
        file = output_file(path, ".npz")
        values = {f.name: getattr(self, f.name) for f in fields(self) if f.name != "error_estimate"}  # type: ignore[arg-type]
        arrays, texts = _parted(values)
        entries: dict[str, Any] = {**arrays, TEXTS: np.array(json.dumps(texts, default=float))}
        np.savez_compressed(file, **entries)
        return file

    @classmethod
    def load(cls, path: str | PathLike[str]) -> Self:
        """Read a motion that `save` has written; every number is the same.

        Parameters
        ----------
        path : str or path-like
            The file.

        Returns
        -------
        Trajectory
            It has forgotten its scene's controller, so that `trusted_horizon` is not to be had.

        Raises
        ------
        ValueError
            If the file is no such archive, or a damaged one, or an entry of it has the wrong shape or type or is not
            finite, or the times do not ascend.
        FileNotFoundError
            If there is no such file.

        Examples
        --------
        >>> import rne
        >>> rne.Trajectory.load("swing.npz").message  # doctest: +SKIP
        """
        arrays, texts = _contents(Path(path))
        try:
            dissipated = {name: arrays.pop(f"dissipated.{name}") for name in texts.pop("dissipated")}
            parts = {"dissipated": dissipated, "model": _model(arrays, texts)}  # takes its entries out of both
            motion: Self = cls(**(arrays | texts | parts))
        except (KeyError, TypeError) as error:
            raise ValueError(f"{str(path)!r} is not a complete motion: {error}") from None
        try:
            _check(motion)
        except ValueError as error:
            raise ValueError(f"{str(path)!r}: {error}") from None
        return motion

    def to_csv(self, path: str | PathLike[str]) -> Path:
        """Write times, positions, velocities, accelerations and torques as comma-separated values.

        Parameters
        ----------
        path : str or path-like
            In an existing folder.

        Returns
        -------
        pathlib.Path
            The file written: a heading `t`, `q.<joint>`, `qd.<joint>`, `qdd.<joint>`, `tau.<joint>`, then one row per
            sample in SI units, with all digits. `rne.trajectories.read_csv` reads it.

        Raises
        ------
        FileNotFoundError
            If its folder does not exist.

        Examples
        --------
        >>> import rne
        >>> swing = rne.simulate(rne.load("irb140"), [0] * 6, [0] * 6, 0.5)
        >>> file = swing.to_csv("swing.csv")  # doctest: +SKIP
        """
        return write_columns(path, self.t, self._columns())

    def to_dataframe(self) -> Any:
        """Times, positions, velocities, accelerations and torques as a table of pandas.

        Returns
        -------
        pandas.DataFrame
            Indexed by the time `t` [s], with columns `q.<joint>`, `qd.<joint>`, `qdd.<joint>`, `tau.<joint>`.

        Raises
        ------
        ImportError
            If pandas is not installed.

        Examples
        --------
        >>> import rne
        >>> swing = rne.simulate(rne.load("irb140"), [0] * 6, [0] * 6, 0.5)
        >>> swing.to_dataframe()["q.joint_2"].max()  # doctest: +SKIP
        """
        try:
            import pandas
        except ModuleNotFoundError:
            raise ImportError("`to_dataframe` needs pandas, which is not installed: pip install pandas") from None
        return pandas.DataFrame(self._columns(), index=pandas.Index(self.t, name="t"))

    def _columns(self) -> dict[str, Array]:
        names = numbered_joints(self.q.shape[1]) if self.model is None else self.model.joint_names
        parts = ("q", "qd", "qdd", "tau")
        return {f"{part}.{name}": getattr(self, part)[:, k] for part in parts for k, name in enumerate(names)}


def write_columns(path: str | PathLike[str], t: Array, columns: Mapping[str, Array]) -> Path:
    """Write times and named columns, one row per sample, as comma-separated values."""
    file = output_file(path)
    with file.open("w", newline="", encoding="utf-8") as opened:
        writer = csv.writer(opened, lineterminator="\n")
        writer.writerow(["t", *columns])
        writer.writerows(np.column_stack([t, *columns.values()]).tolist())
    return file


def numbered_joints(n: int) -> tuple[str, ...]:
    """Names of joints that have none."""
    return tuple(f"joint_{k + 1}" for k in range(n))


def _parted(values: dict[str, Any]) -> tuple[dict[str, Array], dict[str, Any]]:
    """Arrays and the rest, which JSON can hold, of a trajectory's fields."""
    values = dict(values)
    model, dissipated = values.pop("model"), values.pop("dissipated")
    values |= {f"dissipated.{name}": energy for name, energy in dissipated.items()}
    if model is not None:
        values |= {f"model.{f.name}": getattr(model, f.name) for f in fields(model)}
        values["model.notes"] = dict(model.notes)
    arrays = {name: value for name, value in values.items() if isinstance(value, np.ndarray)}
    texts = {name: value for name, value in values.items() if name not in arrays}
    return arrays, {"form": FORM, "dissipated": list(dissipated), "has_model": model is not None} | texts


def _contents(file: Path) -> tuple[dict[str, Array], dict[str, Any]]:
    """Arrays and the rest of an archive; a ValueError for any other file."""
    data = file.read_bytes()  # NumPy leaves a damaged file open
    try:
        with np.load(io.BytesIO(data), allow_pickle=False) as archive:
            arrays = {name: archive[name] for name in archive.files}
        texts: dict[str, Any] = dict(json.loads(str(arrays.pop(TEXTS))).items())
    except DAMAGED:
        raise ValueError(f"{str(file)!r} is not a motion written by Trajectory.save") from None
    if texts.pop("form", None) != FORM:
        raise ValueError(f"{str(file)!r} is of another version of this package: expected {FORM!r}")
    return arrays, texts


def _check(motion: Any) -> None:
    """A ValueError that names the first entry with a wrong type or shape, a number that is not finite, or late time."""
    for name, kind in KINDS.items():
        value = getattr(motion, name)
        if not isinstance(value, kind) or (isinstance(value, bool) and kind is not bool):
            expected = {str: "a text", int: "a whole number", bool: "true or false"}.get(kind, "a number")  # type: ignore[arg-type]
            raise ValueError(f"`{name}` must be {expected}, got {value!r}")
        if isinstance(value, float) and not isfinite(value):
            raise ValueError(f"`{name}` must be finite, got {value}")
    sizes: dict[str, int] = {}
    for name, shape in SHAPES.items():
        _check_array(name, getattr(motion, name), shape, sizes)
    for name, energy in motion.dissipated.items():
        _check_array(f"dissipated.{name}", energy, ("T",), sizes)
    late = np.flatnonzero(np.diff(motion.t) <= 0)
    if late.size:
        before, after = motion.t[late[0] : late[0] + 2].tolist()
        raise ValueError(f"`t` must ascend, got {after:.6g} s after {before:.6g} s")
    if motion.model is not None and len(motion.model.joint_names) != sizes["n"]:
        raise ValueError(f"`q` must have {len(motion.model.joint_names)} columns, as its model, got {sizes['n']}")


def _check_array(name: str, value: Any, shape: tuple[str, ...], sizes: dict[str, int]) -> None:
    """Check an array; letters of its shape that are not among the `sizes` yet are added to them."""
    if not isinstance(value, np.ndarray) or value.dtype.kind not in "fiu":
        got = f"dtype {value.dtype}" if isinstance(value, np.ndarray) else repr(value)
        raise ValueError(f"`{name}` must be an array of real numbers, got {got}")
    if name in MAY_BE_EMPTY and not value.size:
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
        return Model(**values)
    except (KeyError, TypeError, ValueError, ModelError) as error:
        raise ValueError(f"the model in the file is not complete: {error}") from None


def _shape(link: str, *sizes: Any) -> Cylinder | Box:
    """A shape of a model from its fields, whose vectors are lists in the file; a cylinder has one more than a box."""
    values: list[Any] = [tuple(x) if isinstance(x, list) else x for x in sizes]
    return Cylinder(link, *values) if len(values) > 3 else Box(link, *values)
