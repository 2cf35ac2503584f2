"""Checks of numbers, arrays and paths given by a user: errors name the argument, the expectation and the value."""

from __future__ import annotations

import inspect
import os
import re
from collections.abc import Callable
from functools import cache, cached_property, wraps
from numbers import Number
from typing import TYPE_CHECKING, Any, Literal, TypeVar

import numpy as np
from numpy.typing import ArrayLike

from .spatial import Array

if TYPE_CHECKING:
    from pathlib import Path

FULL_TURN = 6.3  # full turn with a margin [rad]
T = TypeVar("T")
Sign = Literal["any", "not negative", "positive"]
UNBOUNDED = 1e300  # number instead of infinity, which a kernel cannot hold
lengths = cache(lambda shape: re.findall(r"[\w.]+", shape[: shape.index(")")]))  # in a shape such as "(n, 3)"
TIME_ROUNDING = 1e-12  # rounding of times relative to the last one, of a solver's last step and its stages


def real_array(name: str, value: ArrayLike, shape: str) -> Array:
    """Array of finite real numbers of a shape such as "(3,)", "(n, 3)" or "(..., 6)".

    Letters stand for any length, "..." for any leading axes; text after the parenthesis appears in errors only.
    """
    array = real_numbers(name, value, shape)
    wanted = lengths(shape)
    got = [str(k) for k in array.shape]
    if wanted[:1] == ["..."]:
        wanted, got = wanted[1:], got[max(0, len(got) - len(wanted) + 1) :]
    if len(wanted) != len(got) or any(k.isdigit() and k != x for k, x in zip(wanted, got, strict=True)):
        raise ValueError(f"`{name}` must have shape {shape}, got {array.shape}")
    return array


def real_numbers(name: str, value: ArrayLike, shape: str) -> Array:
    """Array of finite real numbers of any shape; `shape` is only for the text of errors."""
    array = number_array(name, value, shape)
    if array.dtype.kind == "c":
        raise ValueError(f"`{name}` must be real, got dtype {array.dtype}")
    return array


def positive_number(name: str, value: float, *, zero_allowed: bool = False) -> float:
    """Finite real number above zero, or nonnegative."""
    if type(value) in (float, int) and 0 < value < UNBOUNDED:  # most are, and need no array
        return float(value)
    if np.ndim(value):
        raise ValueError(f"`{name}` must be one number, got shape {np.shape(value)}")
    if not isinstance(value, Number) and plain_array(name, value).dtype.kind not in "fiu":
        raise ValueError(f"`{name}` must be one number, got {type(value).__name__}")
    number = float(real_array(name, value, "()"))
    if number < 0 or (number == 0 and not zero_allowed):
        raise ValueError(f"`{name}` must {'not be negative' if zero_allowed else 'be positive'}, got {number!r}")
    return number


def whole_number(name: str, value: Any, *, least: int = 1) -> int:
    """Whole number above zero, or of at least `least`, of Python or NumPy."""
    if isinstance(value, bool) or not isinstance(value, int | np.integer) or value < least:
        wanted = "above zero" if least == 1 else f"of at least {least}"
        raise ValueError(f"`{name}` must be a whole number {wanted}, got {value!r}")
    return int(value)


def check_function(name: str, function: Any, arguments: str) -> None:
    """Raise a TypeError unless `function` takes arguments such as "(t, q, qd)"; text may follow them."""
    if not callable(function) or isinstance(function, type):
        got = f"the class {function.__name__}" if isinstance(function, type) else type(function).__name__
        raise TypeError(f"`{name}` must be a function of {arguments}, got {got}")
    try:
        signature = inspect.signature(function)
    except (TypeError, ValueError):  # compiled functions may have none
        return
    try:
        signature.bind(*arguments[: arguments.index(")")].split(","))
    except TypeError:
        raise TypeError(f"`{name}` must be a function of {arguments}, got one of {signature}") from None


def output_file(path: str | os.PathLike[str], *suffixes: str) -> Path:
    """Path of a file in an existing folder, with one of the suffixes if any are given; errors name the first one."""
    from pathlib import Path  # takes a twentieth of `import rne`

    if not isinstance(path, str | os.PathLike):
        raise TypeError(f"`path` must be a str or path-like, got {type(path).__name__}")
    file = Path(path)
    if suffixes and file.suffix.lower() not in suffixes:
        raise ValueError(f"`path` must end in {suffixes[0]}, got {file.name!r}")
    if not file.parent.is_dir():
        raise FileNotFoundError(f"`path` must be in an existing folder, got {str(file)!r}")
    return file


def number_array(name: str, value: ArrayLike, shape: str) -> Array:
    """Array of finite numbers; integers become float64."""
    array = convert_numbers(name, value, shape)
    finite = is_finite(array)
    if not finite.all():
        index = tuple(int(k) for k in np.argwhere(~finite)[0])
        raise ValueError(f"`{name}` must be finite, got {array[index]} at index {index}")
    return array


def vector(name: str, value: ArrayLike, n: int, *, sign: Sign = "any") -> Array:
    """A read-only float64 copy of n finite real numbers, all of the required sign."""
    array = np.array(real_array(name, value, f"({n},)"), dtype=np.float64)
    if sign != "any" and ((array < 0) | ((array == 0) & (sign == "positive"))).any():
        need = "be positive" if sign == "positive" else "not be negative"
        raise ValueError(f"`{name}` must {need}, got {array.min()}")
    array.flags.writeable = False
    return array


def per_joint_array(name: str, value: ArrayLike, n: int, *, sign: Sign = "any") -> Array:
    """A read-only float64 array of n finite real numbers: one per joint, or one number that is meant for all joints."""
    array = real_numbers(name, value, f"({n},)")
    return vector(name, array if array.ndim else np.full(n, array), n, sign=sign)


def refuse_degrees(name: str, angles: Array) -> None:
    """Raise ValueError if an angle of a placement exceeds a full turn, as in degrees."""
    large = np.abs(angles) > FULL_TURN
    if large.any():
        index = tuple(int(k) for k in np.argwhere(large)[0])
        got = f"got {float(angles[index]):g} at index {index}"
        raise ValueError(f"`{name}` looks like degrees; pass np.deg2rad({name}), {got}")


def refuse_masked(name: str, value: ArrayLike) -> None:
    """Raise ValueError if entries are masked: np.asarray would take the numbers under the mask."""
    for part in value if isinstance(value, list | tuple) else (value,):
        if isinstance(part, np.ndarray) and (mask := getattr(part, "mask", False)) is not False and np.any(mask):
            hidden = f"got {np.sum(mask)} of {part.size}; fill them or leave their rows out"
            raise ValueError(f"`{name}` must have no masked entries, {hidden}")


def plain_array(name: str, value: ArrayLike) -> Array:
    """Value as an array of any type, without masked entries."""
    refuse_masked(name, value)
    return np.asarray(value)


def convert_numbers(name: str, value: ArrayLike, shape: str) -> Array:
    """Array of numbers of a type that the dynamics support, finite or not; integers become float64."""
    refuse_masked(name, value)
    try:
        array = np.asarray(value)
    except ValueError:
        raise ValueError(f"`{name}` must be an array of numbers of shape {shape}, got rows of unequal length") from None
    except TypeError:  # symbols of CasADi and JAX refuse to be arrays
        package = type(value).__module__.split(".")[0].removesuffix("lib")
        if package not in ("casadi", "jax"):
            raise
        cure = f"make a function of them, as by robot.kernel(rne.dynamics.inverse_dynamics).to_{package}()"
        raise TypeError(f"`{name}` must be an array of numbers, got symbols of {package}: {cure}") from None
    if array.dtype.kind in "iu":
        array = array.astype(np.float64)
    if array.dtype == np.float16:
        array = array.astype(np.float32)  # half precision is a storage format
    numbers_only = array.dtype.kind != "O" or all(isinstance(x, Number) or hasattr(x, "context") for x in array.flat)
    if array.dtype.kind not in "fcO" or not numbers_only:
        raise ValueError(f"`{name}` must be an array of numbers of shape {shape}, got dtype {array.dtype}")
    return _convert_objects(name, array) if array.dtype.kind == "O" else array


def _convert_objects(name: str, array: Array) -> Array:
    """Python numbers as float64; mpmath numbers unchanged, with all their digits."""
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


def convert_array(array: Array, number: Callable[[float], Any]) -> Array:
    """Object array of the results of `number` for the array's entries."""
    return np.asarray(np.frompyfunc(lambda x: number(float(x)), 1, 1)(array), dtype=object)


def is_equal(a: Any, b: Any) -> bool:
    """True if two values are equal, arrays in every entry and in their dtype."""
    if isinstance(a, np.ndarray) and isinstance(b, np.ndarray):
        return a.dtype == b.dtype and np.array_equal(a, b)
    return bool(a == b)


def is_read_only(array: Any) -> bool:
    """True for an array that is read-only with the memory that it is a view of."""
    if not isinstance(array, np.ndarray) or array.flags.writeable:
        return False
    return array.base is None or is_read_only(array.base)


def read_only(value: Any) -> Any:
    """Read-only copy of an array, or of the arrays in a tuple, list or dictionary; read-only ones are not copied."""
    if isinstance(value, np.ndarray) and not is_read_only(value):
        value = value.copy()
        value.flags.writeable = False
    elif type(value) in (tuple, list):
        value = type(value)(map(read_only, value))
    elif hasattr(value, "_make"):  # of a named tuple
        value = value._make(map(read_only, value))
    elif type(value) is dict:
        value = {name: read_only(part) for name, part in value.items()}
    return value


def cached_array(make: Callable[[Any], T]) -> cached_property[T]:
    """Property that is computed once, whose arrays are read-only."""
    return cached_property(wraps(make)(lambda owner: read_only(make(owner))))


def copy_with(thing: T, **parts: Any) -> T:
    """Copy with other attributes, which are not checked; cached properties are dropped."""
    kind: Any = type(thing)
    own: T = object.__new__(kind)
    kept = {k: v for k, v in vars(thing).items() if not isinstance(getattr(kind, k, None), cached_property)}
    vars(own).update(kept | parts)
    return own


class ReadOnlyArrays:
    """Base of dataclasses with arrays that cached numbers depend on: NumPy refuses to change them."""

    def __post_init__(self) -> None:
        self.__setstate__(self.__dict__)

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update({name: read_only(value) for name, value in state.items()})
