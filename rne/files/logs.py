"""Log files as robots write them: named columns of text, messages and arrays."""

from __future__ import annotations

import json
import math
import os
import re
import struct
import sys
import zlib
from array import array
from collections import Counter
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from itertools import islice
from pathlib import Path
from statistics import mode
from typing import Any, NamedTuple

import numpy as np

from ..basics.archive import FREE, LARGEST, RATIO, Arrays, TooLargeError, bytes_of, check_regular, most_unpacked
from ..basics.spatial import Array
from ..basics.text import MAX_NAME, cut, plain
from .tables import as_number, csv_rows, finite_numbers, listed_names, text_of

Message = tuple[int, Sequence[str], Sequence[Sequence[float]]]  # time [ns], joints, and their q, qd, tau

LISTED = 12  # columns that an error lists
MOST_PARTS, LONGEST = 100_000, 200  # parts of an array of MATLAB, characters of a name
UNIT = re.compile(r"s|ms|us|ns|(rad|deg|mm?)(/s)?|rpm|m?Nm|N|m?A")
SPELT = {  # of units as they are written
    r"[\s.·⋅*^⁻¹-]": "", r"(?<=deg|rad)(_s|ps|s1|_?per_?s(ec(ond)?)?)$": "/s",
    r"°|deg(ree)?s?": "deg", r"rad(ian)?s?": "rad", r"[µμ]|micro": "u", r"milli": "m", r"nano": "n",
    r"newtonmet(er|re)s?|^n_?m$": "Nm", r"sec(ond)?s?": "s",
    r"^(m?)amp(ere)?s?$": r"\1A", r"^(1|rev|r|u)[/p]min$": "rpm",
}  # fmt: skip
DATE = re.compile(r"(\d{4}-\d\d-\d\d[T ]\d\d:\d\d:\d\d(?:\.\d+)?)(?:Z|[+-]\d\d:?\d\d)?")
WIDE = "p.columns = p.columns.map('{0[0]}.{0[1]}'.format), p.to_csv(NEW)"
JOINTS = 64  # joints at most, of which a row each is looked for
SNIFFED = 20  # rows from which separator and decimal sign are guessed
FORMATS = [(";", "."), (";", ","), ("\t", "."), ("\t", ","), (",", "."), (" ", "."), (" ", ",")]
JOINT_STATE = "sensor_msgs/msg/JointState"
DEFINITION = (  # of it: that in a file may be any text
    "std_msgs/Header header\nstring[] name\nfloat64[] position\nfloat64[] velocity\nfloat64[] effort\n{0}MSG: "
    "std_msgs/Header\nbuiltin_interfaces/Time stamp\nstring frame_id\n{0}MSG: builtin_interfaces/Time\nint32 sec\n"
    "uint32 nanosec\n"
).format("=" * 80 + "\n")
TO_MCAP = (
    "convert it to MCAP, without ROS: pip install rosbags; rosbags-convert --src BAG --dst FOLDER --dst-storage mcap"
)
OTHERS = {  # first bytes of files that are not read, what they are, and the cure
    b"#ROSBAG": f"a ROS 1 bag; {TO_MCAP}",
    b"SQLite": f"a ROS 2 bag in SQLite; {TO_MCAP}",
    b"MATLAB 7": "a MATLAB file of version 7.3; save it by save(file, ..., '-v7')",
    b"\x89HDF": "an HDF5 file; write its arrays as text, .npz or .mat",
    b"PK\x03\x04": "a ZIP archive or a spreadsheet; write it as text",
    b"\x1f\x8b": "compressed; decompress it first",
}
FORMS = {  # beginnings of texts that are not read, likewise
    r"\s*[\[{]\s*[\[{\"]": "JSON; write its arrays as .npz by numpy.savez('log.npz', t=..., q=..., tau=...)",
    r"\s*<\?*\w": "XML; write its numbers as CSV, a row per sample",
    r"(---\s*)?(header|name|position):\s": "YAML as of ros2 topic echo; add --csv, or -p with rostopic",
}
NAMES = re.compile(
    r"(?:.*[./])?(?:joint|axis|motor|servo)?_?(?:names?|id)|joints?|axis|motor|servo", re.IGNORECASE
)  # of arrays of joints' names
CELL = re.compile(r"\s*(?:array\('\w', *)?[\[(](.*?)[\])]\)?\s*")  # an entry that is a list
NUMBERED = re.compile(r"(.*?)[_.\[( ]*(\d+)[\])]?")  # columns of an array
NUMERIC = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 9: "f8", 12: "i8", 13: "u8"}  # of MATLAB
COMPRESSED, CELLS, STRUCTURE, TEXT = 15, 1, 2, 4  # kinds of elements and of arrays
NUMBERS = re.compile(r"((fixed_size_|large_)?list<.*)?\b(halffloat|float|double|u?int\d+)\b(>.*)?")  # types of Arrow


class Log(NamedTuple):
    """The columns of a log by name, as numbers or texts, and what was chosen to read it, in words."""

    columns: dict[str, Array]
    said: tuple[str, ...] = ()
    time_unit: str | None = None  # where the format says it
    decimal: str = "."
    rows: Sequence[int] = ()  # of texts, for messages
    is_lerobot: bool = False  # positions in degrees, or normalised
    joints: Mapping[str, str] = {}  # by columns, where the file names the joints apart
    twice: Collection[str] = ()  # names of different columns
    unused: Sequence[str] = ()  # names of joints that are as many as no numbered columns

    def numbers(self, place: str, name: str) -> Array:
        """A column as numbers, NaN where entries are left out."""
        x = self.columns[name]
        if name in self.twice:
            raise ValueError(f"{place}: column {name!r} is there twice; give names of all columns as `columns`")
        if x.dtype.kind != "U":
            return x
        if DATE.fullmatch(str(x[0])):
            with suppress(ValueError):
                dates = np.array([DATE.sub(r"\1", text) for text in x.tolist()], dtype="datetime64[ns]")
                return np.asarray((dates - dates[0]) / np.timedelta64(1, "s"))
        return finite_numbers(place, name, self.rows, x.tolist(), self.decimal)


def symbol(unit: str) -> str:
    """The symbol of a unit, such as Nm of `N.m`, `N·m`, `N m`, or the text if it is none."""
    for spelt, short in SPELT.items():
        unit = re.sub(spelt, short, unit, flags=re.IGNORECASE)
    return unit


def read_log(path: Path, options: Mapping[str, Any]) -> Log:
    """The columns of a file, whose format its first bytes say, or of a data set in a folder."""
    if path.is_dir():
        if (path / "meta" / "info.json").is_file():
            return _parquet(sorted(path.glob("data/*/*.parquet")), path / "meta" / "info.json", options)
        if any(path.glob("*.db3")):
            raise ValueError(f"{path}: is {OTHERS[b'SQLite']}")
        if not (bags := sorted(path.glob("*.mcap"))):
            raise ValueError(f"{path}: is a folder without meta/info.json, as LeRobot data sets have, or .mcap files")
        return _mcap(bags, options)
    check_regular(path)
    with open(path, "rb") as stream:
        first, suffix = stream.read(16), path.suffix.lower()
    if suffix == ".npz":
        return _arrays(path, _whole(path, lambda: _numpy(Arrays(path, most_unpacked(path)))))
    for mark, what in OTHERS.items():
        if first.startswith(mark):
            raise ValueError(f"{path}: is {what}")
    if first.startswith(b"MATLAB 5") or suffix == ".mat":
        data = memoryview(bytes_of(path))
        if not first.startswith(b"MATLAB 5"):
            raise ValueError(f"{path}: is no MATLAB file of version 5 to 7; save it by save(file, ..., '-v7')")
        order = "<" if bytes(data[126:128]) == b"IM" else ">"
        return _arrays(path, _whole(path, lambda: _matlab(data[128:], order, most_unpacked(path))))
    if first.startswith(b"\x89MCAP") or suffix == ".mcap":
        return _mcap([path], options)
    if first.startswith(b"PAR1") or suffix == ".parquet":
        return _parquet([path], None, options)
    return _text(path, options)


def _whole(path: Path, read: Callable[[], Any]) -> Any:
    """What a library reads from a file, or one kind of error if it is damaged."""
    try:
        return read()
    except Exception as error:  # each library has its own
        if isinstance(error, ImportError | FileNotFoundError | PermissionError):
            raise
        if isinstance(error, TooLargeError):
            raise ValueError(f"{path}: {error}; write fewer samples, or less beside them, to a file") from None
        reason = cut(" ".join(str(error).split()), 3 * MAX_NAME) or type(error).__name__
        raise ValueError(f"{path}: is damaged or cut off ({reason})") from None


# Text


def _text(path: Path, options: Mapping[str, Any]) -> Log:
    name, text = os.fspath(path), text_of(path)
    for beginning, what in FORMS.items():
        if re.match(beginning, text):
            raise ValueError(f"{path}: is {what}")
    separator, decimal = _format(text, options["separator"], options["decimal"])
    rows = _without_lists(name, csv_rows(name, text, separator))
    width = mode(len(row) for _, row in rows) if rows else 0
    numeric = (k for k, (_, row) in enumerate(rows) if len(row) == width or (k == 0 and len(row) > 4))
    first = next((k for k in numeric if _is_numeric(rows[k][1], decimal)), None)
    if first is None:
        raise ValueError(f"{name}: there are no rows of numbers" if rows else f"{name}: the file is empty")
    given, heading, body = options["columns"], rows[first - 1][1] if first else [], rows[first:]
    if isinstance(given, Sequence):
        heading = list(given)
    elif heading:
        heading = [entry.strip().lstrip("#% ") for entry in heading]
        heading = heading[len(heading) == width + 1 and not heading[0] :]  # "# t q1", separated by blanks
        units = [symbol(unit.strip("[]() ")) for unit in heading]
        above = rows[first - 2][1] if first > 1 else []
        if len(above) == len(units) and any(units) and all(UNIT.fullmatch(x or "s") for x in units):
            heading = [x.strip() + f" [{unit}]" * bool(unit) for x, unit in zip(above, units, strict=True)]
    elif width > 4 and body[0][1][1].isdigit() and math.isnan(as_number(body[0][1][3])):
        return _states(name, _echoed(name, body), options["joints"], "as of ros2 topic echo --csv")
    elif given is not None or options["quantity"]:
        heading = [str(k) for k in range(width)]
    else:
        cure = 'columns=["t", "q.shoulder", "tau.shoulder"], with "" for one to ignore'
        raise ValueError(f"{name}: the names of its {width} columns are missing; give them, such as {cure}")
    _check_names(name, heading)
    for row, fields in body:
        if len(fields) != len(heading):
            cure = "remove the row if the log was cut off there"
            raise ValueError(f"{name}, row {row}: must have {len(heading)} entries, got {len(fields)}; {cure}")
    if "field.position0" in heading:
        return _states(name, _rostopic(name, heading, body), options["joints"], "as of rostopic echo -p")
    cells = [*zip(heading, zip(*(row for _, row in body), strict=True), strict=True)]
    columns = {x: np.array(column) for x, column in cells if x}
    said = (f"separator {separator!r}, decimal sign {decimal!r}",) * ((separator, decimal) != (",", "."))
    twice = {x for x, column in cells if x and heading.count(x) > 1 and [*column] != columns[x].tolist()}
    joints, unused = _joints_of(name, columns)
    return Log(columns, said, None, decimal, [row for row, _ in body], joints=joints, twice=twice, unused=unused)


def _without_lists(name: str, rows: list[tuple[int, list[str]]]) -> list[tuple[int, list[str]]]:
    """Rows with an entry for each number, or name, of the lists that stand in entries."""
    sizes = {k: len(_entries(x)) for k, x in enumerate(rows[-1][1]) if CELL.fullmatch(x)} if rows else {}
    for at, row in rows if sizes else ():
        parts = [_entries(x) for x in row]
        if not any(CELL.fullmatch(x) for x in row):  # names of columns
            parts = [[f"{x.strip()}_{i}" for i in range(sizes[k])] if k in sizes else [x] for k, x in enumerate(row)]
        elif wrong := [k for k, size in sizes.items() if k < len(row) and len(parts[k]) != size]:
            got = cut(row[wrong[0]], MAX_NAME)
            raise ValueError(f"{name}, row {at}: entry {wrong[0] + 1} must be a list of {sizes[wrong[0]]}, got {got!r}")
        row[:] = [x for part in parts for x in part]
    return rows


def _entries(entry: str) -> list[str]:
    """What stands in a list, or the entry itself."""
    found = CELL.fullmatch(entry)
    return [x.strip("'\"") for x in re.split(r"[,;\s]+", found[1].strip()) if x] if found else [entry]


def _joints_of(place: str, columns: Mapping[str, Array], rows: bool = True) -> tuple[dict[str, str], Sequence[str]]:
    """The joints of numbered columns, where other columns name them in all `rows`, or an array; names of no columns."""
    found = {x: NUMBERED.fullmatch(x) for x in columns}
    named = sorted((int(m[2]) if m else 0, x) for x, m in found.items() if NAMES.fullmatch(m[1] if m else x))
    texts = [columns[x] for _, x in named if re.match(r"(?!nan$|inf)[^\W\d]", str(columns[x][0]), re.IGNORECASE)]
    for _, x in named[: rows and len(named) == 1]:
        if 1 < len({*columns[x].tolist()}) <= JOINTS and (texts or all(map(str.isdigit, columns[x].tolist()))):
            cure = f"p = pandas.read_csv(LOG).pivot(index=TIME, columns={x!r}), {WIDE}"
            what = f"has a row for each joint, which column {x!r} names"
            raise ValueError(f"{place}: {what}; make columns of all: {cure}")
    own, *others = np.unique(np.column_stack(texts) if rows else texts[:1], axis=0).tolist() if texts else [[]]
    if others or len(set(own)) < len(own):
        both = " and ".join(map(listed_names, [own, *others[:1]]))
        what = f"the names of joints must be different, and the same in all rows, got {both}"
        raise ValueError(f"{place}: {what}; keep the rows of one, or read the bag as MCAP")
    groups: dict[str, dict[int, str]] = {}
    for column, m in found.items():
        if m and not NAMES.fullmatch(m[1]):
            groups.setdefault(m[1], {})[int(m[2])] = column
    whole = [group for group in groups.values() if sorted(group) in ([*range(len(own))], [*range(1, len(own) + 1)])]
    return {x[k]: joint for x in whole for k, joint in zip(sorted(x), own, strict=True)}, () if whole else own


def with_stamps(place: str, log: Log) -> Log:
    """A log whose times in seconds have the nanoseconds that stand in a column of their own."""
    columns = dict(log.columns)
    for name in log.columns:
        found = re.fullmatch(r"(.*?)(?:nano|n)(sec(?:ond)?s?)", name, re.IGNORECASE)
        if found and (whole := found[1] + found[2]) in columns:
            t = log.numbers(place, whole)
            columns[whole] = t - t[0] + 1e-9 * log.numbers(place, name)
    return log._replace(columns=columns)


def _format(text: str, separator: str | None, decimal: str | None) -> tuple[str, str]:
    """Separator and decimal sign with which most entries in the middle of a text are numbers."""
    lines = [line for line in text.splitlines() if line.strip()]
    lines = [re.sub(r'\[.*?\]|"', "", line) for line in lines[len(lines) // 2 :][:SNIFFED]]

    def numbers(form: tuple[str, str]) -> int:
        fields = [x for line in lines for x in (line.split() if form[0] == " " else line.split(form[0]))]
        return sum(math.isfinite(as_number(x, form[1])) for x in fields)

    possible = [f for f in FORMATS if separator in (None, f[0]) and decimal in (None, f[1])]
    return max(possible or [(separator or ",", decimal or ".")], key=numbers)


def _is_numeric(row: Sequence[str], decimal: str) -> bool:
    """True if half of the entries that are not left out are numbers."""
    filled = [x for x in row if x.strip()]
    return 2 * sum(math.isfinite(as_number(x, decimal)) for x in filled) >= len(filled) > 0


def _check_names(place: str, names: Iterable[str]) -> None:
    if long := next((name for name in names if len(name) > LONGEST), None):
        cure = f"{cut(long, MAX_NAME)!r} has {len(long)}"
        raise ValueError(f"{place}: names of columns and joints must have at most {LONGEST} characters, {cure}")


# Messages: sensor_msgs/JointState


def _echoed(name: str, body: Iterable[tuple[int, list[str]]]) -> Iterator[Message]:
    """Columns of `ros2 topic echo --csv`: seconds, nanoseconds, frame, names, positions, velocities, efforts."""
    for at, row in body:
        (*stamp, _), fields, parts = row[:3], row[3:], list[list[float]]()
        n = next((k for k, x in enumerate(fields) if x in ("", "nan") or math.isfinite(as_number(x))), 0)
        names, rest = fields[:n], fields[n:]
        for _ in range(3):  # an array without entries is an entry left out
            count = n if rest[:1] != [""] else 1
            parts.append([as_number(x) for x in rest[:count] if x])
            rest = rest[count:]
        if rest or {len(part) for part in parts} - {0, n} or not n or not "".join(stamp).isdigit():
            what = "as many names of joints, positions, velocities and efforts"
            raise ValueError(f"{name}, row {at}: must be seconds, nanoseconds, frame, and {what}")
        yield int(stamp[0]) * 10**9 + int(stamp[1]), names, parts


def _rostopic(name: str, heading: Sequence[str], body: Iterable[tuple[int, list[str]]]) -> Iterator[Message]:
    """Columns of `rostopic echo -p`, such as field.position0; times are those of headers, or of receipt."""
    fields = ("name", "position", "velocity", "effort")
    places = [[k for k, x in enumerate(heading) if re.fullmatch(rf"field\.{field}\d+", x)] for field in fields]
    stamps = [heading.index(x) for x in ("field.header.stamp", "time") if x in heading]
    for at, row in body:
        stamp = next((row[k] for k in stamps if row[k] != "0"), "")
        if not stamp.isdigit():
            raise ValueError(f"{name}, row {at}: must have a time in nanoseconds, got {cut(stamp, MAX_NAME)!r}")
        names, *values = ([row[k] for k in place] for place in places)
        yield int(stamp), names, [[as_number(x) for x in part] for part in values]


def _states(place: str, messages: Iterable[Message], joints: Sequence[str] | None, said: str) -> Log:
    """Columns of the messages that have all joints asked for, or of all messages."""
    found: list[tuple[int, dict[str, int], Sequence[Sequence[float]]]] = []
    groups = Counter[tuple[str, ...]]()
    for k, (ns, names, values) in enumerate(messages):
        _check_names(place, names)
        groups[group := tuple(sorted(names))] += 1
        if any(len(part) not in (0, len(names)) for part in values) or len(set(names)) < len(names):
            sizes = f"{len(set(names))} different names, and {', '.join(str(len(part)) for part in values)}"
            raise ValueError(f"{place}: message {k + 1} has {sizes} positions, velocities and efforts")
        if joints is None or set(joints) <= set(group):
            found.append((ns, {name: j for j, name in enumerate(names)}, values))
    if joints is None and len(groups) > 1:
        few = islice(groups.items(), LISTED)
        sets = " and ".join(f"{listed_names(group)} ({count} messages)" for group, count in few)
        raise ValueError(f"{place}: joint states are of different joints, {sets}; give those to read as `joints`")
    if not found:
        there = " and ".join(map(listed_names, islice(groups, LISTED))) or "no message"
        raise ValueError(f"{place}: no message has all of `joints`, {listed_names(joints or ())}; there is {there}")
    start = found[0][0]
    columns = {"t": np.array([(ns - start) / 1e9 for ns, *_ in found])}
    for k, quantity in enumerate(("q", "qd", "tau")):
        if any(values[k] for *_, values in found):
            for joint in joints or found[0][1]:
                values_ = [values[k][order[joint]] if values[k] else math.nan for _, order, values in found]
                columns[f"{quantity}.{joint}"] = np.array(values_, float)
    return Log(columns, (f"{said}, times from the first message on, at {start / 1e9:.3f} s",), "s")


def _mcap(paths: Sequence[Path], options: Mapping[str, Any]) -> Log:
    """Joint states of one topic of an MCAP file, or of the files of a bag."""
    try:
        from mcap.reader import make_reader
        from mcap.records import Schema
        from mcap_ros2.decoder import DecoderFactory
    except ImportError:
        raise ImportError("reading MCAP files needs mcap-ros2-support: pip install 'rne[mcap]'") from None
    topics: dict[str, str] = {}
    messages: list[tuple[int, Message]] = []
    decode: Any = DecoderFactory().decoder_for("cdr", Schema(1, DEFINITION.encode(), "ros2msg", JOINT_STATE))

    def read(path: Path, wanted: str | None) -> None:
        most, numbers = most_unpacked(path), 0
        with open(path, "rb") as stream:
            reader = make_reader(stream, validate_crcs=True)
            if (summary := reader.get_summary()) is None:
                raise ValueError("it has no summary; mend it: mcap recover FILE")
            if (size := max((x.uncompressed_size for x in summary.chunk_indexes), default=0)) > LARGEST:
                raise ValueError(f"a chunk is said to have {size} bytes")
            schemas = {k: schema.name for k, schema in summary.schemas.items()}
            topics.update({x.topic: schemas.get(x.schema_id, "unknown") for x in summary.channels.values()})
            if wanted is None:
                return
            _check_chunks(stream, summary.chunk_indexes, FREE + RATIO * path.stat().st_size)
            for _, _, raw in reader.iter_messages(topics=[wanted], log_time_order=False):
                state = decode(raw.data)
                values = [array("d", x) for x in (state.position, state.velocity, state.effort)]
                if (numbers := numbers + 4 + sum(map(len, values))) * 8 > most:
                    raise TooLargeError(most)
                ns = state.header.stamp.sec * 10**9 + state.header.stamp.nanosec or raw.log_time
                messages.append((raw.log_time, (ns, tuple(map(sys.intern, state.name)), values)))
        messages.sort(key=lambda message: message[0])

    for path in paths:
        _whole(path, lambda path=path: read(path, None))  # type: ignore[misc]
    states, topic = [name for name, kind in topics.items() if kind == JOINT_STATE], options["topic"]
    if topic is None and len(states) > 1:
        raise ValueError(f"{paths[0]}: there are joint states of {listed_names(states)}; give one as `topic`")
    if not states or topic not in (None, *states):
        there = ", ".join(f"{name} ({kind})" for name, kind in sorted(topics.items())[:LISTED]) or "nothing"
        raise ValueError(f"{paths[0]}: there is no topic {topic or ''} of {JOINT_STATE}; there is {plain(there)}")
    topic = topic or states[0]
    for path in paths:
        _whole(path, lambda path=path: read(path, topic))  # type: ignore[misc]
    return _states(os.fspath(paths[0]), (x for _, x in messages), options["joints"], f"topic {plain(topic)}")


def _check_chunks(stream: Any, indexes: Iterable[Any], most: int) -> None:
    """An error if a chunk unpacks to more bytes than it says, or all to more than most."""
    import zstandard
    from lz4.frame import LZ4FrameDecompressor
    from mcap.stream_reader import StreamReader

    for index in indexes:
        stream.seek(index.chunk_start_offset)
        chunk: Any = next(StreamReader(stream, skip_magic=True, emit_chunks=True, record_size_limit=LARGEST).records)
        size = chunk.uncompressed_size + 1
        if (most := most - size) < 0:
            raise ValueError("its chunks unpack to more bytes than a file of its size may")
        if chunk.compression == "zstd":
            found = len(zstandard.ZstdDecompressor().stream_reader(chunk.data).read(size))
        else:
            found = len(LZ4FrameDecompressor().decompress(chunk.data, size)) if chunk.compression == "lz4" else 0
        if found == size:
            raise ValueError("a chunk has more bytes than it says")


# Arrays


def _arrays(path: Path, arrays: Mapping[str, Any]) -> Log:
    """The columns of arrays by name, of the joints that an array of texts names."""
    columns = _columns(arrays)
    _check_names(os.fspath(path), columns)
    joints, unused = _joints_of(os.fspath(path), columns, rows=False)
    return Log(columns, joints=joints, unused=unused)


def _columns(arrays: Mapping[str, Any], names: Mapping[str, Sequence[str]] | None = None) -> dict[str, Array]:
    """Columns of arrays of numbers, of a matrix each, and names of joints; structures are joined by points."""
    columns: dict[str, Array] = {}
    for name, value in arrays.items():
        if isinstance(value, Mapping):
            columns |= {f"{name}.{part}": x for part, x in _columns(value).items()}
        elif NAMES.fullmatch(name) and np.asarray(value).dtype.kind in "US":
            columns[name] = np.char.strip(np.ravel(value).astype(str))
        elif not name.startswith("__") and np.asarray(value).dtype.kind in "fiu" and np.ndim(value) in (1, 2):
            x = np.atleast_2d(np.asarray(value, dtype=np.float64).T)
            x = x.T if len(x) > x.shape[1] else x
            own = (names or {}).get(name, ())
            own = own if len(own) == len(x) else [str(k + 1) for k in range(len(x))]
            columns |= {name if len(x) == 1 else f"{name}.{k}": row for k, row in zip(own, x, strict=True)}
    return columns


def _numpy(arrays: Arrays) -> dict[str, Any]:
    """The vectors and matrices of numbers, and texts, of a NumPy archive."""
    stated = {name: arrays.stated(name)[1:] for name in arrays}
    return {x: arrays[x] for x, (shape, _, kind) in stated.items() if len(shape) <= 2 and kind.kind in "fiuUSO"}


def _matlab(data: memoryview, order: str, most: int) -> dict[str, Any]:
    """Arrays of numbers, and structures of them, of a MATLAB file of version 5 to 7; SciPy crashes on damaged ones."""
    arrays, left = dict[str, Any](), most
    for kind, body in _elements(data, order):
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
    """How many numbers stand in an array, or in a structure of them."""
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


def _parquet(paths: Sequence[Path], info: Path | None, options: Mapping[str, Any]) -> Log:
    """One episode of a LeRobot data set."""
    try:
        import pyarrow.parquet as parquet
    except ImportError:
        raise ImportError("reading LeRobot data sets needs pyarrow: pip install 'rne[lerobot]'") from None

    def arrays_of(path: Path) -> dict[str, Array]:
        file, most = parquet.ParquetFile(path), most_unpacked(path)
        kept = [column.name for column in file.schema_arrow if NUMBERS.fullmatch(str(column.type))]
        groups = [file.metadata.row_group(k) for k in range(file.metadata.num_row_groups)]
        columns = [group.column(k) for group in groups for k in range(group.num_columns)]
        if 8 * sum(x.num_values for x in columns if x.path_in_schema.partition(".")[0] in kept) > most:
            raise TooLargeError(most)
        table = file.read(columns=kept)
        return {name: np.array(table[name].to_pylist(), dtype=np.float64) for name in kept}

    if not paths:
        raise ValueError(f"{info}: the data set has no files data/*/*.parquet")
    names = {} if info is None else _whole(info, lambda: _names_of_features(info))
    parts = [_whole(path, lambda path=path: arrays_of(path)) for path in paths]  # type: ignore[misc]
    arrays = {x: np.concatenate([part[x] for part in parts]) for x in parts[0] if all(x in part for part in parts)}
    episodes, wanted = arrays.get("episode_index", np.zeros(1)), options["episode"]
    if wanted not in episodes if wanted is not None else np.ptp(episodes):
        low, high = f"{episodes.min():g}", f"{episodes.max():g}"
        raise ValueError(f"{paths[0]}: there are episodes {low} to {high}; give one as `episode`")
    if wanted is not None:
        arrays = {name: x[episodes == wanted] for name, x in arrays.items()}
    return Log(_columns(arrays, names), (f"episode {wanted or 0}",), "s", is_lerobot="episode_index" in arrays)


def _names_of_features(info: Path) -> dict[str, list[str]]:
    """Names of the entries of each array: those of a list, or of a list in a mapping."""
    names = {}
    for name, feature in json.loads(info.read_text(encoding="utf-8"))["features"].items():
        own = feature.get("names") or []
        names[name] = [str(x) for part in (own.values() if isinstance(own, dict) else [own]) for x in part]
    return names
