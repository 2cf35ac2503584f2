"""Files of a motion: a complete archive, and a table for other programs."""

from __future__ import annotations

import csv
import io
from collections.abc import Mapping
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np

from ..basics.archive import Kinds, names_of, read, write
from ..basics.arrays import output_file
from ..basics.marks import TABLE
from ..basics.spatial import Array
from ..model.model import Model
from ..model.solids import Box, Cylinder

VERSION = 2  # version of the archives
NOT_KEPT = ("error_estimate", "run")  # fields that may hold laws
MOTORS = ("motor_q", "motor_qd")
SHAPES: dict[str, tuple[str, ...]] = {
    **dict.fromkeys(("t", "kinetic", "potential", "energy", "work"), ("T",)),
    **dict.fromkeys(("q", "qd", "qdd", "tau", *MOTORS), ("T", "n")),
    "controller_state": ("T", "m"),
    "jumps": ("K",),
    **dict.fromkeys(("qdd_before", "tau_before"), ("K", "n")),
}


def _kinds(motion: type) -> Kinds:
    """Types in an archive with their fields: the motion, its model, shapes, and couplings as traced programs."""
    from ..model.coupling import IN_FILES  # loaded with the first file

    kinds = (motion, Model, Box, Cylinder, *IN_FILES)
    return {x: (tuple(name for name in names_of(x) if x is not motion or name not in NOT_KEPT), x) for x in kinds}


def write_archive(path: str | PathLike[str], motion: Any) -> Path:
    """Write a Trajectory to a NumPy archive."""
    return write(path, _kinds(type(motion)), motion, VERSION)


def read_archive(path: str | PathLike[str], kind: type) -> Any:
    """Trajectory in an archive, checked."""
    return read(path, _kinds(kind), kind, VERSION, _check)


def write_columns(path: str | PathLike[str], t: Array, columns: Mapping[str, Array]) -> Path:
    """Write times and named columns to a file of comma-separated values."""
    file = output_file(path)
    file.write_text(csv_text(t, columns).replace("t", TABLE, 1), encoding="utf-8", newline="")  # its first letter
    return file


def csv_text(t: Array, columns: Mapping[str, Array]) -> str:
    """Times and named columns as comma-separated values, one row per sample, with all digits."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(["t", *columns])
    writer.writerows(np.column_stack([t, *columns.values()]).tolist())
    return text.getvalue()


def _check(motion: Any) -> None:
    """Raise a ValueError for the first array with a wrong shape or a non-finite number, or for late times."""
    sizes: dict[str, int] = {}
    for name, shape in SHAPES.items():
        _check_array(name, getattr(motion, name), shape, sizes)
    for name, energy in motion.dissipated.items():
        _check_array(f"dissipated.{name}", energy, ("T",), sizes)
    for name, number in vars(motion).items():
        if isinstance(number, float) and not np.isfinite(number):
            raise ValueError(f"`{name}` must be finite, got {number}")
    late = np.flatnonzero(np.diff(motion.t) <= 0)
    if late.size:
        before, after = motion.t[late[0] : late[0] + 2].tolist()
        raise ValueError(f"`t` must ascend, got {after:.6g} s after {before:.6g} s")
    if not np.isin(motion.jumps, motion.t).all() or (np.diff(motion.jumps) <= 0).any():
        raise ValueError("`jumps` must be among the times `t`, and ascend")
    if motion.model is not None and len(motion.model.joint_names) != sizes["n"]:
        raise ValueError(f"`q` must have {len(motion.model.joint_names)} columns, as its model, got {sizes['n']}")
    for _, drivers, coupling in motion.model.coupled_joints if motion.model is not None else ():
        coupling.derivatives(motion.q[:1, drivers])  # fails if its program is damaged


def _check_array(name: str, value: Array, shape: tuple[str, ...], sizes: dict[str, int]) -> None:
    """Check an array; letters of its shape that are not among the `sizes` yet are added to them."""
    if value.shape == (0, 0) and (shape[1] == "m" or name in MOTORS or sizes.get("K") == 0):  # as where none is given
        return
    expected = ", ".join(str(sizes.get(letter, letter)) for letter in shape)
    same = (sizes.setdefault(letter, length) == length for letter, length in zip(shape, value.shape, strict=False))
    if value.ndim != len(shape) or not all(same):
        raise ValueError(f"`{name}` must have shape ({expected}{',' * (len(shape) == 1)}), got {value.shape}")
    if not np.isfinite(value).all():
        place = tuple(int(k) for k in np.argwhere(~np.isfinite(value))[0])
        raise ValueError(f"`{name}` must be finite, got {value[place]} at index {place}")
