"""Archives of objects: arrays in a NumPy archive, all the rest as JSON; nothing in it is executed."""

from __future__ import annotations

import io
import json
import math
import zipfile
from collections.abc import Callable, Iterator, Mapping
from dataclasses import fields, is_dataclass
from os import PathLike
from pathlib import Path
from stat import S_ISDIR, S_ISREG
from types import UnionType
from typing import Any, ClassVar, Self, Union, get_args, get_origin, get_type_hints

import numpy as np
from numpy.lib.format import read_array_header_1_0, read_array_header_2_0, read_magic

from .arrays import output_file
from .marks import TEXTS
from .text import cut

LARGEST = 2**29  # most bytes of a file's arrays together, numbers in double precision
BIGGEST = 5 * 2**27  # most bytes of a file that is read whole
FREE, RATIO = 2**26, 100  # bytes to which every file may unpack, and times its size
LONGEST, LINE = 2**24, 400  # bytes of the texts of an archive; characters of an error
NOT_KEPT = "source"  # field of a Model that is not saved: the path of a file, which pages of the robot read

File = str | PathLike[str]
Kinds = dict[Any, tuple[tuple[str, ...], Callable[..., Any]]]  # of each type in files its fields and its constructor


class TooLargeError(ValueError):
    """Error about a file whose arrays take more memory than is allowed for a file of its size."""

    def __init__(self, most: int) -> None:
        super().__init__(f"its arrays take more than {most} bytes in double precision, the most for a file of its size")


def most_unpacked(file: Path) -> int:
    """Largest memory of a file's arrays in double precision [bytes]."""
    return min(LARGEST, FREE + RATIO * file.stat().st_size)


def check_regular(file: Path) -> None:
    """Raise a ValueError for a pipe or a device, which may never end, an OSError if there is no such file."""
    mode = file.stat().st_mode
    if not (S_ISREG(mode) or S_ISDIR(mode)):  # opening a folder raises an OSError
        raise ValueError(f"{file}: is not a regular file; copy to one what it gives")


def bytes_of(file: Path) -> bytes:
    """Bytes of a regular file; a ValueError if there are too many."""
    check_regular(file)
    if (size := file.stat().st_size) > BIGGEST:
        raise ValueError(f"{file}: has {size} bytes, more than {BIGGEST}; split it, or leave out what is not needed")
    return file.read_bytes()


class Arrays(Mapping[str, Any]):
    """Arrays of a NumPy archive, each read on access; TooLargeError if those read are too large."""

    def __init__(self, file: Path, most: int = LARGEST) -> None:
        self._archive = zipfile.ZipFile(io.BytesIO(bytes_of(file)))
        self.entries = {x.filename.removesuffix(".npy"): x for x in self._archive.infolist()}
        if len(self.entries) < len(self._archive.infolist()):
            raise ValueError("an array is there twice")
        self._left = self._most = most

    def stated(self, name: str) -> tuple[Any, tuple[int, ...], bool, np.dtype[Any]]:
        """Stream, shape, order and type of an array, by its header."""
        if self.entries[name].compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):
            raise ValueError("it is compressed in a way that numpy.savez does not use")
        stream = self._archive.open(self.entries[name])
        header = read_array_header_1_0 if read_magic(stream) == (1, 0) else read_array_header_2_0
        return stream, *header(stream)

    def __getitem__(self, name: str) -> Any:
        stream, shape, is_fortran, kind = self.stated(name)
        size = math.prod(shape)
        self._left -= size * max(kind.itemsize, 8)
        if self._left < 0 or min(shape, default=0) < 0:
            raise TooLargeError(self._most)
        if kind.hasobject:
            what = f"array {cut(name, 80)!r} holds Python objects, as allow_pickle=True would load"
            raise ValueError(f"{what}; save texts by numpy.array(x, dtype=str)")
        data = stream.read(size * kind.itemsize)
        return np.frombuffer(data, kind, size).reshape(shape, order="F" if is_fortran else "C")

    def __iter__(self) -> Iterator[str]:
        return iter(self.entries)

    def __len__(self) -> int:
        return len(self.entries)


def contents(file: Path, what: str) -> tuple[Mapping[str, Any], dict[str, Any]]:
    """Arrays and the rest of an archive; a ValueError for any file other than `what` it should be."""
    file.stat()  # OSError if it is not there
    try:
        arrays = Arrays(file)
        if arrays.entries[TEXTS].file_size > LONGEST:
            raise ValueError
        texts = json.loads(str(arrays[TEXTS]))
        del arrays.entries[TEXTS]
        return arrays, dict(texts.items())
    except Exception:  # NumPy, zipfile, zlib and JSON raise many types for other and damaged files
        raise ValueError(f"{str(file)!r} is not {what}") from None


def write(path: File, kinds: Kinds, value: Any, version: int) -> Path:
    """Write an object of one of the kinds to an archive."""
    file, arrays = output_file(path, ".npz"), dict[str, Any]()
    texts = {"version": version, "value": _encoded(value, kinds, arrays)}
    if (size := sum(x.nbytes for x in arrays.values())) > LARGEST:
        raise ValueError(f"the arrays take {size} bytes, more than the {LARGEST} that are read; keep fewer samples")
    np.savez_compressed(file, allow_pickle=False, **arrays, **{TEXTS: np.array(json.dumps(texts))})
    return file


def read(path: File, kinds: Kinds, wanted: type, version: int, check: Callable[[Any], Any] = lambda _: None) -> Any:
    """Object in an archive; a ValueError names unexpected parts, or the failure of the final check."""
    arrays, texts = contents(file := Path(path), f"written by {wanted.__name__}.save")
    try:
        if texts.get("version") != version:
            raise ValueError(f"`version` must be {version}, got {texts.get('version')!r}")
        found = _decoded(texts.get("value"), {kind.__name__: kind for kind in kinds}, kinds, arrays, wanted.__name__)
        if not isinstance(found, wanted):
            raise ValueError(f"the object must be of type {wanted.__name__}, got {type(found).__name__}")
        check(found)
    except Exception as error:  # likewise, and errors of the constructors
        is_told = isinstance(error, ValueError | TypeError)
        text = str(error) if is_told else f"is damaged ({type(error).__name__}: {error})"
        raise ValueError(f"{str(file)!r}: {cut(text, LINE)}") from None
    return found


class Archived:
    """Base of results that are saved in NumPy archives."""

    _version: ClassVar[int] = 1  # of files, increased when a field changes its meaning

    @staticmethod
    def _kinds() -> Kinds:
        """Classes that the result consists of, with their fields."""
        raise NotImplementedError

    def _whole(self) -> Any:
        """Text that depends on all fields, without which a file is damaged."""
        raise NotImplementedError

    def save(self, path: File) -> Path:
        """Write the result to a NumPy archive, which `load` reads in this version and later ones.

        Parameters
        ----------
        path : str or path-like
            Of a file ``.npz``, which is overwritten.

        Returns
        -------
        Path
            The file.

        Raises
        ------
        ValueError, FileNotFoundError
            If the path has another ending, or its folder does not exist.
        TypeError
            If a part, such as the controller of a scene, is of a class that is not of this package.
        """
        return write(path, self._kinds(), self, self._version)

    @classmethod
    def load(cls, path: File) -> Self:
        """Read a result written by `save`.

        Parameters
        ----------
        path : str or path-like
            A NumPy archive, ``.npz``.

        Returns
        -------
        Identification or MotionFit
            As it was saved, with all that was measured and fitted.

        Raises
        ------
        ValueError
            If the file is another one or damaged, of another version, or has a field that this version does not know.
        OSError
            If the file cannot be read.
        """
        found: Self = read(path, cls._kinds(), cls, cls._version, cls._whole)
        return found


def _encoded(value: Any, kinds: Kinds, arrays: dict[str, Any]) -> Any:
    """Value in a form for JSON; arrays by their number."""
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
        parts = {name: _encoded(getattr(value, name), kinds, arrays) for name in kinds[type(value)][0]}
        return {"type": type(value).__name__, "fields": parts}
    if isinstance(value, tuple | list):
        return [_encoded(x, kinds, arrays) for x in value]
    raise TypeError(f"{type(value).__name__} cannot be written to a file")


def _decoded(value: Any, types: Mapping[str, type], kinds: Kinds, arrays: Mapping[str, Any], place: str) -> Any:
    """Value decoded from JSON; a ValueError names the place of unknown contents."""

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
    kind: Any = types[value["type"]]
    (names, make), stated = kinds[kind], value["fields"]
    for name in stated.keys() - {*names, NOT_KEPT}:
        raise ValueError(f"`{place}.{cut(name, 80)}` is not known to this version")
    found = {name: inner(stated[name], f".{name}") for name in names if name in stated}
    hints = get_type_hints(kind if is_dataclass(kind) or hasattr(kind, "_fields") else kind.__init__)
    for name, x in found.items():
        if not _fits(x, hints.get(name, Any)):
            of = kind.__annotations__.get(name, hints[name])
            raise ValueError(f"`{place}.{name}` must be of type {of}, got {cut(repr(x), 80)}")
    return make(**found)


def _fits(value: Any, hint: Any) -> bool:
    """True if a value and its entries are of an annotated type; types that files do not have are not checked."""
    origin, parts = get_origin(hint), get_args(hint)
    if origin in (Union, UnionType):
        return any(_fits(value, part) for part in parts)
    if origin is tuple:
        kinds = parts[:1] * len(value) if parts[1:] == (...,) and isinstance(value, tuple) else parts
        return isinstance(value, tuple) and len(value) == len(kinds) and all(map(_fits, value, kinds))
    if isinstance(origin, type) and issubclass(origin, Mapping):
        return isinstance(value, Mapping) and all(_fits(x, parts[1]) for x in value.values())
    if hint in (int, float):
        return isinstance(value, int | hint) and not isinstance(value, bool)
    kind = origin or hint
    is_open = not isinstance(kind, type) or kind is Any or getattr(kind, "_is_protocol", False)
    return is_open or isinstance(value, kind)


def names_of(made: Any) -> tuple[str, ...]:
    """Names of the fields of a dataclass or a NamedTuple that are kept in files."""
    names = (f.name for f in fields(made)) if is_dataclass(made) else made._fields
    return tuple(name for name in names if name != NOT_KEPT)
