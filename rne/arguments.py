"""Arrays that come from a user: what is wrong with one is said with its name, what was expected and what came."""

from __future__ import annotations

from numbers import Number

import numpy as np
from numpy.typing import ArrayLike

from .model import Model
from .spatial import Array


def model_argument(model: object) -> Model:
    """The model itself, or a TypeError for anything else."""
    if not isinstance(model, Model):
        raise TypeError(f"`model` must be an rne.Model, got {type(model).__name__}; a Robot has it as .model")
    return model


def joint_shaped(name: str, value: ArrayLike, model: Model, width: int | None = None) -> Array:
    """Check one array of joint values, or of `width` others, for its shape and dtype only."""
    n = model.n if width is None else width
    return _shaped(name, _numbers(name, value, f"(..., {n})"), model, n)


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


def real_array(name: str, value: ArrayLike, shape: str) -> Array:
    """An array of finite real numbers."""
    array = number_array(name, value, shape)
    if array.dtype.kind == "c":
        raise ValueError(f"`{name}` must be real, got dtype {array.dtype}")
    return array


def positive_number(name: str, value: float, *, zero_allowed: bool = False) -> float:
    """One finite real number above zero."""
    array = real_array(name, value, "()")
    if array.ndim:
        raise ValueError(f"`{name}` must be one number, got shape {array.shape}")
    number = float(array)
    if number < 0 or (number == 0 and not zero_allowed):
        raise ValueError(f"`{name}` must be positive, got {number!r}")
    return number


def number_array(name: str, value: ArrayLike, shape: str) -> Array:
    """An array of finite numbers; integers become float64."""
    array = _numbers(name, value, shape)
    finite = is_finite(array)
    if not finite.all():
        index = tuple(int(k) for k in np.argwhere(~finite)[0])
        raise ValueError(f"`{name}` must be finite, got {array[index]} at index {index}")
    return array


def _numbers(name: str, value: ArrayLike, shape: str) -> Array:
    try:
        array = np.asarray(value)
    except ValueError:
        raise ValueError(f"`{name}` must be an array of numbers of shape {shape}, got rows of unequal length") from None
    if array.dtype.kind in "iu":
        array = array.astype(np.float64)
    if array.dtype == np.float16:
        array = array.astype(np.float32)  # half precision is for storage
    numbers_only = array.dtype.kind != "O" or all(isinstance(x, Number) or hasattr(x, "context") for x in array.flat)
    if array.dtype.kind not in "fcO" or not numbers_only:
        raise ValueError(f"`{name}` must be an array of numbers of shape {shape}, got dtype {array.dtype}")
    return _plain(name, array) if array.dtype.kind == "O" else array


def _plain(name: str, array: Array) -> Array:
    """Python's own numbers as float64; mpmath's stay what they are, with all their digits."""
    if any(hasattr(x, "context") for x in array.flat):
        return array
    try:
        return array.astype(np.float64)
    except OverflowError:
        raise ValueError(f"`{name}` must be numbers within the range of float64") from None
    except TypeError:
        return array.astype(np.complex128)


def is_finite(array: Array) -> Array:
    """Elementwise finiteness, for mpmath numbers too."""
    if array.dtype == object:
        return np.asarray((array - array) == 0, dtype=bool)
    return np.isfinite(array)
