"""Checks of a model and of joint arrays given by a user."""

from __future__ import annotations

from numpy.typing import ArrayLike

from ..basics.arrays import convert_numbers, number_array
from ..basics.spatial import Array
from .model import Model


def model_argument(model: object) -> Model:
    """The model itself, or a TypeError for anything else."""
    if not isinstance(model, Model):
        raise TypeError(f"`model` must be an rne.Model, got {type(model).__name__}; a Robot has it as .model")
    return model


def joint_shaped(name: str, value: ArrayLike, model: Model, width: int | None = None) -> Array:
    """Check one array of joint values, or of `width` others, for its shape and dtype only."""
    n = model.n if width is None else width
    return _shaped(name, convert_numbers(name, value, f"(..., {n})"), model, n)


def joint_array(name: str, value: ArrayLike, model: Model, width: int | None = None) -> Array:
    """Check one array of joint values, or of `width` others: finite numbers, these along the last axis."""
    n = model.n if width is None else width
    return _shaped(name, number_array(name, value, f"(..., {n})"), model, n)


def _shaped(name: str, array: Array, model: Model, n: int) -> Array:
    if array.ndim == 0 or array.shape[-1] != n:
        cure = ""
        if array.ndim == 2 and array.shape[0] == n:
            cure = f"; states go along the first axis: pass `{name}`.T, of shape {array.shape[::-1]}"
        raise ValueError(f"`{name}` must have shape (..., {n}) for robot {model.name!r}, got {array.shape}{cure}")
    return array
