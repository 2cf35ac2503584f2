"""Memory layout of arrays and tuples, and a check of it in this process.

Machine code reads them after the head that all Python objects have (numpy/ndarraytypes.h, PyArrayObject_fields).
"""

from __future__ import annotations

import ctypes
import functools
import sysconfig
from typing import Any

import numpy as np

HEAD = object.__basicsize__  # ends with the type
DATA, AXES, SHAPE, STRIDES, DTYPE, FLAGS = (HEAD + k for k in (0, 8, 16, 24, 40, 48))
CONTIGUOUS, ALIGNED, WRITEABLE = 0x1, 0x100, 0x400  # NPY_ARRAY_C_CONTIGUOUS, NPY_ARRAY_ALIGNED, NPY_ARRAY_WRITEABLE
PLAIN = CONTIGUOUS | ALIGNED
ITEMS = tuple.__basicsize__
TUPLES = 1 << 26  # Py_TPFLAGS_TUPLE_SUBCLASS


@functools.cache
def is_known() -> bool:
    """True if test arrays and a tuple are read correctly; False in a Python without the interpreter's lock."""
    if sysconfig.get_config_var("Py_GIL_DISABLED") or np.ndarray.__basicsize__ < FLAGS + 4:
        return False
    a, misaligned = np.arange(24.0).reshape(4, 6), np.zeros(17, np.uint8)[1:].view(np.float64)
    arrays = a, a[1:, ::2], a.T, a[0], a.reshape(2, 3, 4), np.arange(3), a.astype(np.float32), misaligned, a[1]
    arrays[-1].flags.writeable = False
    items = [len(arrays), *map(id, arrays)]
    is_tuple = [_at(id(arrays) + HEAD), *(_at(id(arrays) + ITEMS + 8 * k) for k in range(len(arrays)))] == items
    return is_tuple and bool(tuple.__flags__ & TUPLES) and all(map(_reads_right, arrays))


def _at(address: int, kind: Any = ctypes.c_int64) -> int:
    return int(kind.from_address(address).value)


def _reads_right(a: Any) -> bool:
    """True if all fields of an array are read correctly; addresses are followed only if the others are."""
    shape, strides = _at(id(a) + SHAPE), _at(id(a) + STRIDES)
    found = [_at(id(a) + offset) for offset in (HEAD - 8, DATA, DTYPE)]
    axes, flags = (_at(id(a) + offset, ctypes.c_int32) for offset in (AXES, FLAGS))
    expected = [id(np.ndarray), a.ctypes.data, id(a.dtype)]
    stated = CONTIGUOUS * a.flags.c_contiguous + ALIGNED * a.flags.aligned + WRITEABLE * a.flags.writeable
    is_flagged = flags & (PLAIN | WRITEABLE) == stated
    in_a_row = strides - shape == 8 * a.ndim  # as NumPy has them
    if found != expected or axes != a.ndim or not is_flagged or not in_a_row:
        return False
    return [_at(shape + 8 * k) for k in range(2 * a.ndim)] == [*a.shape, *a.strides]
