"""Files of MATLAB, versions 5 to 7, read with limits; SciPy crashes on damaged ones and unpacks without limit."""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterator, Mapping
from itertools import islice
from typing import Any

import numpy as np

from ..basics.archive import TooLargeError

MOST_PARTS = 100_000  # most parts of an array
NUMERIC = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 9: "f8", 12: "i8", 13: "u8"}  # kinds of parts
COMPRESSED, CELLS, STRUCTURE, TEXT = 15, 1, 2, 4  # kinds of elements and of arrays


def matlab_arrays(data: memoryview, most: int) -> dict[str, Any]:
    """Arrays of numbers and texts, and structures of them, in a file of at most so many bytes of numbers."""
    arrays, left = dict[str, Any](), most
    order = "<" if bytes(data[126:128]) == b"IM" else ">"
    for kind, body in _elements(data[128:], order):
        if kind == COMPRESSED:  # one element, which begins with its size
            stream = zlib.decompressobj()
            head = stream.decompress(body, 8)
            left -= (size := struct.unpack(f"{order}II", head)[1])
            if left < 0:
                raise TooLargeError(most)
            ((_, body),) = _elements(memoryview(head + stream.decompress(stream.unconsumed_tail, size)), order)
        name, value = _matrix(body, order)
        arrays |= {} if value is None else {name: value}
    if 8 * _count(arrays) > most:
        raise TooLargeError(most)
    return arrays


def _count(value: Any) -> int:
    """Number of values in an array, or in a structure of arrays."""
    return sum(map(_count, value.values())) if isinstance(value, Mapping) else np.size(value)


def _elements(data: memoryview, order: str) -> Iterator[tuple[int, memoryview]]:
    """Kind and bytes of each element: after eight bytes and up to the next multiple of eight, or within eight bytes."""
    at = 0
    while at < len(data):
        kind, size = struct.unpack_from(f"{order}II", data, at)
        start, end = at + 8, at + 8 + (size if kind == COMPRESSED else -(-size // 8) * 8)
        if kind >> 16:
            kind, size, start, end = kind & 0xFFFF, kind >> 16, at + 4, at + 8
        if end > len(data):
            raise ValueError("an element ends beyond the file")
        yield kind, data[start : start + size]
        at = end


def _matrix(body: memoryview, order: str) -> tuple[str, Any]:
    """Name and value of an array: real numbers, texts, the fields of a structure, or None."""
    if not body:
        return "", None
    (_, flags), (_, sizes), (_, name), *parts = islice(_elements(body, order), MOST_PARTS)
    if len(parts) == MOST_PARTS - 3:
        raise ValueError(f"an array has {MOST_PARTS} parts or more")
    shape, kind = np.frombuffer(sizes, f"{order}i4"), flags[0 if order == "<" else 3]
    value: Any = None
    if kind == STRUCTURE and shape.prod() == 1:
        (_, length), (_, fields), *values = parts
        width = int(np.frombuffer(length, f"{order}i4")[0])
        names = np.frombuffer(fields[: width * MOST_PARTS], f"S{width}").tolist()
        value = {x.decode(): _matrix(part, order)[1] for x, (_, part) in zip(names, values, strict=True)}
    elif kind == CELLS:
        texts = [_matrix(part, order)[1] for _, part in parts]
        value = np.concatenate(texts) if all(isinstance(x, np.ndarray) and x.dtype.kind == "U" for x in texts) else None
    elif kind == TEXT and len(parts) == 1 and len(parts[0][1]) < MOST_PARTS:
        codes = np.frombuffer(parts[0][1], order + ("u2" if parts[0][0] == 4 else "u1")).reshape(shape, order="F")
        value = np.array(["".join(map(chr, row)).strip() for row in codes])
    elif len(parts) == 1 and parts[0][0] in NUMERIC and kind in range(6, 16):
        value = np.frombuffer(parts[0][1], order + NUMERIC[parts[0][0]]).reshape(shape, order="F").squeeze()
    return bytes(name).decode(), value
