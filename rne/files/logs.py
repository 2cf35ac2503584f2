"""Log files as robots write them: named columns of text, messages and arrays."""

from __future__ import annotations

import json
import math
import os
import re
from collections import Counter
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import islice
from operator import itemgetter
from pathlib import Path
from statistics import mode
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ..basics.archive import Arrays, TooLargeError, bytes_of, check_regular, most_unpacked
from ..basics.spatial import Array
from ..basics.text import MAX_NAME, cut, plain
from . import ros_bags, tables
from .matlab import matlab_arrays
from .ros_bags import CONTROLLER_STATE, JOINT_STATE, STATES, Message, is_bag
from .tables import TableBody, as_number, listed_names

Rows = list[tuple[int, list[str]]]  # rows of a text with their numbers

JSON = (".json", ".jsonl", ".ndjson")
LISTED = 12  # columns listed in an error
LONGEST = 200  # most characters of a name
UNIT = re.compile(r"s|ms|us|ns|(rad|deg|mm?)(/s)?|rpm|m?Nm|N|m?A")
SPELT = {  # of units as they are written
    r"[\s.·⋅*^⁻¹-]": "", r"(?<=deg|rad)(_s|ps|s1|_?per_?s(ec(ond)?)?)$": "/s",
    r"°|deg(ree)?s?": "deg", r"rad(ian)?s?": "rad", r"[µμ]|micro": "u", r"milli": "m", r"nano": "n",
    r"newtonmet(er|re)s?|^n_?m$": "Nm", r"sec(ond)?s?": "s",
    r"^(m?)amp(ere)?s?$": r"\1A", r"^(1|rev|r|u)[/p]min$": "rpm",
}  # fmt: skip
DATE = re.compile(r"(\d{4}-\d\d-\d\d[T ]\d\d:\d\d:\d\d(?:\.\d+)?)(?:Z|[+-]\d\d:?\d\d)?")
JOINTS = 64  # most joints with rows of their own
WHOLE = re.compile(r"\s*\d+(\.0)?\s*")
OTHERS = {  # first bytes of files that are not read, what they are, and the cure
    b"MATLAB 7": "a MATLAB file of version 7.3; save it by save(file, ..., '-v7')",
    b"\x89HDF": "an HDF5 file; write its arrays as text, .npz or .mat",
    b"PK\x03\x04": "a ZIP archive or a spreadsheet; write it as text",
    b"\x1f\x8b": "compressed; decompress it first",
}
FORMS = {  # beginnings of texts that are not read, likewise
    r"\s*<\?*\w": "XML; write its numbers as CSV, a row per sample",
    r"(---\s*)?(header|name|position):\s": "YAML as of ros2 topic echo; add --csv, or -p with rostopic",
}
NAMES = re.compile(
    r"(?:.*[./])?(?:joint|axis|motor|servo)?_?(?:names?|id)|joints?|axis|motor|servo", re.IGNORECASE
)  # of arrays of joints' names
CELL = re.compile(r"\s*(?:array\('\w', *)?[\[(](.*?)[\])]\)?\s*")  # an entry that is a list
NUMBERED = re.compile(r"(.*?)[_.\[( ]*(\d+)[\])]?")  # columns of an array
NUMBERS = re.compile(r"((fixed_size_|large_)?list<.*)?\b(halffloat|float|double|u?int\d+)\b(>.*)?")  # types of Arrow


@dataclass(frozen=True)
class LogOptions:
    """Options for reading a log, as described by `rne.identification.Record.from_log`; None where not given."""

    joints: Sequence[str] | None = None
    columns: Sequence[str] | Mapping[str, Any] | None = None
    units: Mapping[str, Any] = field(default_factory=dict)
    time_unit: str | None = None
    sample_rate: float | None = None
    gains: ArrayLike | None = None
    offsets: ArrayLike = 0.0
    separator: str | None = None
    decimal: str | None = None
    topic: str | None = None
    episode: int | None = None
    torques: bool = True  # where there are such, else commands
    quantity: str = ""  # that alone stands in the file
    exact: bool = False  # names of columns are `t`, `q.<joint>` and so on, in the first row that is no comment

    @property
    def given(self) -> Mapping[str, Any]:
        """Columns by quantity, where they are given so."""
        return self.columns if isinstance(self.columns, Mapping) else {}


class Log(NamedTuple):
    """Columns of a log by name, as numbers or texts, and remarks on how it was read."""

    place: str  # its file, in errors
    columns: dict[str, Array]
    said: tuple[str, ...] = ()
    time_unit: str | None = None  # where the format says it
    decimal: str = "."
    rows: Sequence[int] = ()  # of texts, for messages
    heading: int = 1  # row of the names of columns, likewise
    is_lerobot: bool = False  # positions in degrees, or normalised
    robot: str = ""  # whose data set it is
    joints: Mapping[str, str] = {}  # by columns, where the file names the joints apart
    twice: Collection[str] = ()  # names of different columns
    unused: Sequence[str] = ()  # names of joints that are as many as no numbered columns
    long: str = ""  # name of the column of joints, of each of which there are rows
    called: Mapping[str, str] = {}  # names in the file, where columns have others

    @property
    def names(self) -> str:
        """First names of columns, for errors."""
        return listed_names(list(self.columns), LISTED)

    def error(self, text: str) -> ValueError:
        """Error of this log."""
        return ValueError(f"{self.place}: {text}")

    def numbers(self, name: str) -> Array:
        """Column as numbers, NaN for empty entries."""
        x = self.columns[name]
        if name in self.twice:
            raise self.error(f"column {name!r} is there twice; give names of all columns as `columns`")
        if x.dtype.kind == "U" and DATE.fullmatch(str(x[0])):
            with suppress(ValueError):
                dates = np.array([DATE.sub(r"\1", text) for text in x.tolist()], dtype="datetime64[ns]")
                return np.asarray((dates - dates[0]) / np.timedelta64(1, "s"))
        return self.decimals(name)

    def decimals(self, name: str, gaps: bool = True) -> Array:
        """Column of decimal numbers; with `gaps`, NaN for empty entries."""
        x = self.columns[name]
        are_texts = x.dtype.kind == "U"
        return tables.finite_numbers(self.place, name, self.rows, x.tolist(), self.decimal, gaps) if are_texts else x


def symbol(unit: str) -> str:
    """Symbol of a unit, such as Nm of `N.m`, `N·m`, `N m`, or the text if it is none."""
    for spelt, short in SPELT.items():
        unit = re.sub(spelt, short, unit, flags=re.IGNORECASE)
    return unit


def read_log(path: Path, options: LogOptions) -> Log:
    """Columns of a file, whose format is recognised by its first bytes, or of a data set or bag in a folder."""
    if path.is_dir():
        if (path / "meta" / "info.json").is_file():
            return _parquet(sorted(path.glob("data/*/*.parquet")), path / "meta" / "info.json", options)
        if bags := sorted(file for file in path.iterdir() if is_bag(file, b"")):
            return _bags(bags, options)
        kinds = ", ".join(ros_bags.KINDS.values())
        raise ValueError(f"{path}: is a folder without meta/info.json, as LeRobot data sets have, or bags ({kinds})")
    check_regular(path)
    with open(path, "rb") as stream:
        first, suffix = stream.read(16), path.suffix.lower()
    if suffix == ".npz":
        return _arrays(path, _whole(path, lambda: _numpy(Arrays(path, most_unpacked(path)))))
    for mark, what in OTHERS.items():
        if first.startswith(mark):
            raise ValueError(f"{path}: is {what}")
    if is_bag(path, first):
        return _bags([path], options)
    if first.startswith(b"PAR1") or suffix == ".parquet":
        return _parquet([path], None, options)
    if first.startswith(b"MATLAB 5"):
        return _arrays(path, _whole(path, lambda: matlab_arrays(memoryview(bytes_of(path)), most_unpacked(path))))
    if suffix == ".mat":
        raise ValueError(f"{path}: is no MATLAB file of version 5 to 7; save it by save(file, ..., '-v7')")
    return _text(path, options)


def _whole(path: Path, read: Callable[[], Any]) -> Any:
    """Result of a library's reader; one kind of error if the file is damaged."""
    try:
        return read()
    except Exception as error:  # each library has its own
        if isinstance(error, ImportError | FileNotFoundError | PermissionError):
            raise
        if isinstance(error, ros_bags.NotReadError):
            raise ValueError(f"{path}: {error}") from None
        if isinstance(error, TooLargeError):
            raise ValueError(f"{path}: {error}; write fewer samples, or fewer other arrays, to a file") from None
        reason = cut(" ".join(str(error).split()), 3 * MAX_NAME) or type(error).__name__
        raise ValueError(f"{path}: is damaged or cut off ({reason})") from None


# Text


def _text(path: Path, options: LogOptions) -> Log:
    """Columns of a text, which may be JSON or a table."""
    text = tables.text_of(path)
    if path.suffix.lower() in JSON or re.match(r"\s*[\[{]\s*[\[{\"]", text):
        return _arrays(path, _whole(path, lambda: _json(text, most_unpacked(path))))
    for beginning, what in FORMS.items():
        if re.match(beginning, text):
            raise ValueError(f"{path}: is {what}")
    return read_table(os.fspath(path), text, options)


def read_table(name: str, text: str, options: LogOptions) -> Log:
    """Columns of a table in a text, or of the messages in its rows."""
    text, separator, decimal = tables.formatted(text, options.separator, options.decimal)
    rows, body = _rows(name, text, (separator, decimal), options.exact)
    are_named, first = rows or isinstance(options.columns, Sequence), next(iter(body.texts), ())
    if not are_named and len(first) > 4 and first[1].isdigit() and math.isnan(as_number(first[3])):
        return _states(name, ros_bags.echoed(name, body), options.joints, "as of ros2 topic echo --csv")
    if not (heading := _heading(rows, body.width, options)):
        cure = 'columns=["t", "q.shoulder", "tau.shoulder"], with "" for one to ignore'
        raise ValueError(f"{name}: the names of its {body.width} columns are missing; give them, such as {cure}")
    of, cure = (" as the heading has", "") if options.exact else ("", "; remove the row if the log was cut off there")
    data = map(np.asarray, body.columns(name, len(heading), of, cure))
    if "field.position0" in heading:
        return _states(name, ros_bags.rostopic(name, heading, body), options.joints, "as of rostopic echo -p")
    cells = [(x, column) for x, column in zip(heading, data, strict=True) if x]
    columns, at = dict(cells), rows[-1][0] if rows else 0
    said = (f"separator {separator!r}, decimal sign {decimal!r}",) * ((separator, decimal) != (",", "."))
    more = [(x, column) for x, column in cells if column is not columns[x]]
    twice = {x for x, column in more if options.exact or not np.array_equal(column, columns[x])}
    joints = {} if options.exact else _joints_of(name, columns)
    return Log(name, columns, said, None, decimal, body.places, at, twice=twice, **joints)


def _rows(name: str, text: str, form: tuple[str, str], exact: bool) -> tuple[Rows, TableBody]:
    """Rows above the first one of numbers, and the others; the heading and all below it where names are exact."""
    is_rostopic = "field.position0" in text.partition("\n")[0]  # names of joints may be numbers
    above, body = (not is_rostopic and tables.numeric_block(text, *form)) or (text, None)
    rows = tables.csv_rows(name, above, form[0])
    if exact and body is not None and len(tables.below_comments(rows)) != 1:
        rows, body = tables.csv_rows(name, text, form[0]), None
    rows = tables.below_comments(rows) if exact else rows
    if body is not None:
        return rows, body
    if not rows:
        raise ValueError(f"{name}: the file is empty")
    if exact:
        first = 1
    else:
        rows = _without_lists(name, rows)
        width = mode(len(row) for _, row in rows)
        numeric = (k for k, (_, row) in enumerate(rows) if len(row) == width or (k == 0 and len(row) > 4))
        first = next((k for k in numeric if _is_numeric(rows[k][1], form[1])), len(rows))
        if first == len(rows):
            raise ValueError(f"{name}: there are no rows of numbers")
    return rows[:first], TableBody([at for at, _ in rows[first:]], texts=[row for _, row in rows[first:]])


def _heading(above: Rows, width: int, options: LogOptions) -> list[str]:
    """Names of columns with their units, given or in the rows above the numbers; empty if there are none."""
    given = options.columns
    if isinstance(given, Sequence):
        return list(given)
    if not above:
        return [str(k) for k in range(width)] if given is not None or options.quantity else []
    heading = [plain(entry.strip().lstrip("#% ")) for entry in above[-1][1]]
    heading = heading[len(heading) == width + 1 and not heading[0] :]  # "# t q1", separated by blanks
    units = [symbol(unit.strip("[]() ")) for unit in heading]
    names = above[-2][1] if above[1:] else []
    if len(names) == len(units) and any(units) and all(UNIT.fullmatch(x or "s") for x in units):
        return [x.strip() + f" [{unit}]" * bool(unit) for x, unit in zip(names, units, strict=True)]
    return heading


def _without_lists(name: str, rows: Rows) -> Rows:
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
    """Return the entries of a list, or the entry itself."""
    found = CELL.fullmatch(entry)
    return [x.strip("'\"") for x in re.split(r"[,;\s]+", found[1].strip()) if x] if found else [entry]


def _joints_of(place: str, columns: Mapping[str, Array]) -> dict[str, Any]:
    """Fields of a Log: joints of numbered columns, by columns or an array of names; or the column of a long form."""
    _check_names(place, columns)
    found = {x: NUMBERED.fullmatch(x) for x in columns}
    named = sorted((int(m[2]) if m else 0, x) for x, m in found.items() if NAMES.fullmatch(m[1] if m else x))
    texts = [columns[x] for _, x in named if re.match(r"(?!nan$|inf)[^\W\d]", str(columns[x][:1][0]), re.IGNORECASE)]
    are_rows = len({len(x) for x in columns.values()}) == 1
    for _, x in named[: are_rows and len(named) == 1]:
        values = [*map(str, columns[x].tolist())]
        if 1 < len({*values}) <= min(JOINTS, len(values) - 1) and (texts or all(map(WHOLE.fullmatch, values))):
            return {"long": x}
    own, *others = np.unique(np.column_stack(texts) if are_rows else texts[:1], axis=0).tolist() if texts else [[]]
    if others or len(set(own)) < len(own):
        both = " and ".join(map(listed_names, [own, *others[:1]]))
        what = f"the names of joints must be different, and the same in all rows, got {both}"
        raise ValueError(f"{place}: {what}; keep the rows of one, or read the bag as MCAP")
    groups: dict[str, dict[int, str]] = {}
    for column, m in found.items():
        if m and not NAMES.fullmatch(m[1]):
            groups.setdefault(m[1], {})[int(m[2])] = column
    whole = [group for group in groups.values() if sorted(group) in ([*range(len(own))], [*range(1, len(own) + 1)])]
    joints = {x[k]: joint for x in whole for k, joint in zip(sorted(x), own, strict=True)}
    return {"joints": joints, "unused": () if whole else own}


def with_stamps(log: Log) -> Log:
    """Log whose times in seconds include the nanoseconds of a column of their own."""
    columns = dict(log.columns)
    for name in log.columns:
        found = re.fullmatch(r"(.*?)(?:nano|n)(sec(?:ond)?s?)", name, re.IGNORECASE)
        if found and (whole := found[1] + found[2]) in columns:
            t = log.numbers(whole)
            columns[whole] = t - t[0] + 1e-9 * log.numbers(name)
    return log._replace(columns=columns)


def _is_numeric(row: Sequence[str], decimal: str) -> bool:
    """True if half of the entries that are not empty are numbers."""
    filled = [x for x in row if x.strip()]
    return 2 * sum(math.isfinite(as_number(x, decimal)) for x in filled) >= len(filled) > 0


def _check_names(place: str, names: Iterable[str]) -> None:
    if long := next((name for name in names if len(name) > LONGEST), None):
        cure = f"{cut(long, MAX_NAME)!r} has {len(long)}"
        raise ValueError(f"{place}: names of columns and joints must have at most {LONGEST} characters, {cure}")


# Messages


def _states(place: str, messages: Iterable[Message], joints: Sequence[str] | None, said: str) -> Log:
    """Columns of the messages that have all joints asked for, or of all messages."""
    found: list[tuple[int, dict[str, int], Sequence[Sequence[float]]]] = []
    groups = Counter[tuple[str, ...]]()
    for ns, names, values in _checked(place, messages):
        groups[tuple(sorted(names))] += 1
        if joints is None or set(joints) <= set(names):
            found.append((ns, dict(zip(names, range(len(names)), strict=True)), values))
    if joints is None and len(groups) > 1:
        few = islice(groups.items(), LISTED)
        sets = " and ".join(f"{listed_names(group)} ({count} messages)" for group, count in few)
        raise ValueError(f"{place}: joint states are of different joints, {sets}; give those to read as `joints`")
    if not found:
        there = " and ".join(map(listed_names, islice(groups, LISTED))) or "no message"
        raise ValueError(f"{place}: no message has all of `joints`, {listed_names(joints or ())}; there is {there}")
    start = found[0][0]
    columns = {"t": np.array([(ns - start) / 1e9 for ns, *_ in found])}
    of, called = dict[str, str](), dict[str, str]()
    for k, quantity in enumerate(("q", "qd", "tau", "command", "command_rate")[: len(found[0][2])]):
        for joint in (joints or found[0][1]) if any(x[k] for *_, x in found) else ():
            numbers = [x[k][order[joint]] if x[k] else math.nan for _, order, x in found]
            columns[f"{quantity}.{joint}"] = np.array(numbers, float)
            if k > 2:  # whatever words are in the joint's name
                of[f"{quantity}.{joint}"], called[f"{quantity}.{joint}"] = joint, quantity
    when = f"{said}, times from the first message on, at {start / 1e9:.3f} s"
    return Log(place, columns, (when,), "s", joints=of, called=called)


def _checked(place: str, messages: Iterable[Message]) -> Iterator[Message]:
    """Messages; an error if one has names twice, or not as many of them as numbers."""
    for k, message in enumerate(messages):
        _, names, values = message
        _check_names(place, names)
        if any(len(part) not in (0, len(names)) for part in values) or len(set(names)) < len(names):
            sizes = f"{len(set(names))} different names, and {', '.join(str(len(part)) for part in values)}"
            both = "" if len(values) == 3 else ", commands and their velocities"
            raise ValueError(f"{place}: message {k + 1} has {sizes} positions, velocities and efforts{both}")
        yield message


def _bags(paths: Sequence[Path], options: LogOptions) -> Log:
    """States of joints, or of their controller, of one topic of a bag, or of the files of one."""
    topics: dict[str, str] = {}
    for path in paths:
        topics |= _whole(path, partial(ros_bags.bag_topics, path))
    topic, of = options.topic, {kind: [x for x, own in topics.items() if own == kind] for kind in STATES}
    controllers = of[CONTROLLER_STATE]
    has_commands = bool(controllers) and (not (options.torques and of[JOINT_STATE]) or topic in controllers)
    kind = CONTROLLER_STATE if has_commands or not options.torques else JOINT_STATE
    states = of[kind]
    if topic is None and len(states) > 1:
        raise ValueError(f"{paths[0]}: there are {STATES[kind]} of {listed_names(states)}; give one as `topic`")
    if not states or topic not in (None, *states):
        there = ", ".join(f"{name} ({kind})" for name, kind in sorted(topics.items())[:LISTED]) or "nothing"
        raise ValueError(f"{paths[0]}: there is no topic {topic or ''} of {kind}; there is {plain(there)}")
    topic = topic or states[0]
    parts = [_whole(path, partial(ros_bags.bag_states, path, topic, kind)) for path in paths]
    messages = [message for _, message in sorted((x for part in parts for x in part), key=itemgetter(0))]
    log = _states(os.fspath(paths[0]), messages, options.joints, f"topic {plain(topic)}")
    lacks_torques = kind == JOINT_STATE and not any(x.startswith("tau.") for x in log.columns)
    return _bags(paths, replace(options, torques=False)) if lacks_torques and controllers and not options.topic else log


# Arrays


def _arrays(path: Path, arrays: Mapping[str, Any]) -> Log:
    """Columns of arrays by name, of the joints that an array of texts names."""
    place, columns = os.fspath(path), _columns(arrays)
    return Log(place, columns, **_joints_of(place, columns))


def _columns(arrays: Mapping[str, Any], names: Mapping[str, Sequence[str]] | None = None) -> dict[str, Array]:
    """Columns of arrays of numbers, of a matrix each, and names of joints; structures are joined by points."""
    columns: dict[str, Array] = {}
    for name, value in arrays.items():
        if isinstance(value, Mapping):
            columns |= {f"{name}.{part}": x for part, x in _columns(value).items()}
        elif NAMES.fullmatch(name) and np.asarray(value).dtype.kind in "US":
            x = np.char.strip(np.asarray(value).astype(str))
            rows = x.T if x.ndim == 2 and min(x.shape) > 1 else [np.ravel(x)]  # names of each sample
            columns |= {name if len(rows) == 1 else f"{name}.{k + 1}": row for k, row in enumerate(rows)}
        elif not name.startswith("__") and np.asarray(value).dtype.kind in "fiu" and np.ndim(value) in (1, 2):
            x = np.atleast_2d(np.asarray(value, dtype=np.float64).T)
            x = x.T if len(x) > x.shape[1] else x
            own = (names or {}).get(name, ())
            own = own if len(own) == len(x) else [str(k + 1) for k in range(len(x))]
            columns |= {name if len(x) == 1 else f"{name}.{k}": row for k, row in zip(own, x, strict=True)}
    return columns


def _json(text: str, most: int) -> dict[str, Any]:
    """Arrays in JSON, or in lines of it: those of an object or of a list of objects, of `most` bytes."""
    try:
        found = json.loads(text)
    except json.JSONDecodeError as error:
        if error.msg != "Extra data":
            raise
        found = list[Any]()
        for k, line in enumerate(re.split("\r\n?|\n", text), 1):
            try:
                found += [json.loads(line)] if line.strip() else []
            except json.JSONDecodeError as wrong:  # in the first line there are no lines of JSON
                raise (ValueError(f"{wrong.msg}: line {k} column {wrong.colno}") if found else error) from None
    while isinstance(found, dict) and len(parts := [x for x in found.values() if isinstance(x, dict | list)]) == 1:
        found = parts[0]  # in addition to settings, such as a gain
    arrays = _array_of(found, [most, most])
    if not isinstance(arrays, dict):
        raise ValueError("an object of arrays, or a list or lines of objects is needed")
    return arrays


def _array_of(value: Any, left: list[int]) -> Any:
    """Arrays of numbers, null as NaN, or of texts, or a mapping of these; `left` are bytes still and ever allowed."""
    if isinstance(value, list) and value and all(isinstance(x, dict) for x in value):
        keys, count = dict.fromkeys(key for x in value for key in x), len(value)
        _take(8 * len(keys) * count, left)
        value = {key: [x.get(key) for x in value] for key in keys}
        for key in keys:  # an array instead of a list
            _take(-8 * count, left)
            value[key] = _array_of(value[key], left)
        return value
    if isinstance(value, dict):
        return {key: _array_of(x, left) for key, x in value.items()}
    try:
        x = np.array(value, dtype=np.float64)
    except (ValueError, TypeError):
        return _texts_of(value, left)
    _take(x.nbytes, left)
    return x


def _texts_of(value: Any, left: list[int]) -> Array | None:
    """Array of texts, numbers included, in lists of one size; each takes as much memory as the longest."""
    entries = _flat(value)
    if not all(isinstance(x, str | int | float) for x in entries):
        return None
    _take(4 * len(entries) * max((len(x) if isinstance(x, str) else 32 for x in entries), default=0), left)
    with suppress(ValueError):
        return np.array(value)
    return None


def _flat(value: Any) -> list[Any]:
    return [entry for part in value for entry in _flat(part)] if isinstance(value, list) else [value]


def _take(size: int, left: list[int]) -> None:
    left[0] -= size
    if left[0] < 0:
        raise TooLargeError(left[1])


def _numpy(arrays: Arrays) -> dict[str, Any]:
    """Vectors and matrices of numbers, and texts, of a NumPy archive."""
    stated = {name: arrays.stated(name)[1:] for name in arrays}
    return {x: arrays[x] for x, (shape, _, kind) in stated.items() if len(shape) <= 2 and kind.kind in "fiuUSO"}


def _parquet(paths: Sequence[Path], info: Path | None, options: LogOptions) -> Log:
    """Columns of one episode of a LeRobot data set."""
    try:
        import pyarrow.parquet as parquet
    except ImportError:
        raise ImportError("reading LeRobot data sets needs pyarrow: pip install 'rne[lerobot]'") from None

    def arrays_of(path: Path) -> dict[str, Array]:
        file, most = parquet.ParquetFile(path), most_unpacked(path)
        kept = [column.name for column in file.schema_arrow if NUMBERS.fullmatch(str(column.type))]
        groups = [file.metadata.row_group(k) for k in range(file.metadata.num_row_groups)]
        columns = [group.column(k) for group in groups for k in range(group.num_columns)]
        parents = tuple(f"{name}." for name in kept)  # of a list: name.list.element
        if 8 * sum(x.num_values for x in columns if f"{x.path_in_schema}.".startswith(parents)) > most:
            raise TooLargeError(most)
        table = file.read(columns=kept)
        return {name: np.array(table[name].to_pylist(), dtype=np.float64) for name in kept}

    if not paths:
        raise ValueError(f"{info}: the data set has no files data/*/*.parquet")
    names, robot = ({}, "") if info is None else _whole(info, lambda: _names_of_features(info))
    parts = [_whole(path, partial(arrays_of, path)) for path in paths]
    arrays = {x: np.concatenate([part[x] for part in parts]) for x in parts[0] if all(x in part for part in parts)}
    episodes, wanted = arrays.get("episode_index", np.zeros(1)), options.episode
    if wanted not in episodes if wanted is not None else np.ptp(episodes):
        low, high = f"{episodes.min():g}", f"{episodes.max():g}"
        raise ValueError(f"{paths[0]}: there are episodes {low} to {high}; give one as `episode`")
    if wanted is not None:
        arrays = {name: x[episodes == wanted] for name, x in arrays.items()}
    is_lerobot, said = "episode_index" in arrays, (f"episode {wanted or 0}",)
    return Log(os.fspath(paths[0]), _columns(arrays, names), said, "s", is_lerobot=is_lerobot, robot=robot)


def _names_of_features(info: Path) -> tuple[dict[str, list[str]], str]:
    """Names of the entries of each array, those of a list, or of a list in a mapping; and the kind of robot."""
    names, told = {}, json.loads(info.read_text(encoding="utf-8"))
    for name, feature in told["features"].items():
        own = feature.get("names") or []
        names[name] = [str(x) for part in (own.values() if isinstance(own, dict) else [own]) for x in part]
    return names, plain(str(told.get("robot_type") or ""))
