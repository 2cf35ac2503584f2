"""Messages of ROS, sensor_msgs/JointState, in bags of ROS 1 and ROS 2 and in texts of `rostopic` and `ros2 topic`."""

from __future__ import annotations

import bz2
import math
import re
import struct
import sys
from array import array
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any

from ..basics.archive import FREE, LARGEST, RATIO, TooLargeError, most_unpacked
from ..basics.text import MAX_NAME, cut
from .tables import TableBody, as_number

# time [ns], joints, and their q, qd, tau, of controllers also commands and their rates
Message = tuple[int, Sequence[str], Sequence[Sequence[float]]]

JOINT_STATE, CONTROLLER_STATE = "sensor_msgs/msg/JointState", "control_msgs/msg/JointTrajectoryControllerState"
STATES = {JOINT_STATE: "joint states", CONTROLLER_STATE: "states of controllers"}
POINT = "trajectory_msgs/JointTrajectoryPoint"
FIELDS = {  # of the bodies of messages; controllers have more fields after these, and other names for them
    JOINT_STATE: "string[] name\nfloat64[] position\nfloat64[] velocity\nfloat64[] effort\n",
    CONTROLLER_STATE: f"string[] name\n{POINT} reference\n{POINT} feedback\n{{0}}MSG: {POINT}\nfloat64[] positions\n"
    "float64[] velocities\nfloat64[] accelerations\nfloat64[] effort\nbuiltin_interfaces/Duration time_from_start\n"
    "{0}MSG: builtin_interfaces/Duration\nint32 sec\nuint32 nanosec\n",
}
DEFINITION = (  # of ROS 2; that in a file may be any text
    "std_msgs/Header header\n{2}{0}MSG: std_msgs/Header\n{1}builtin_interfaces/Time stamp\nstring frame_id\n"
    "{0}MSG: builtin_interfaces/Time\nint32 sec\nuint32 nanosec\n"
)
KINDS = {b"#ROSBAG V2.0\n": ".bag", b"SQLite format 3\0": ".db3", b"\x89MCAP": ".mcap"}  # of bags by their first bytes
FOOTER, CHUNK, TAIL = 2, 6, 37  # kinds of records of MCAP, and bytes from the footer on


class NotReadError(ValueError):
    """Raised for an intact file of a kind that is not read."""


def echoed(name: str, body: TableBody) -> Iterator[Message]:
    """Columns of `ros2 topic echo --csv`: seconds, nanoseconds, frame, names, positions, velocities, efforts."""
    for at, row in zip(body.places, body.texts, strict=True):
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


def rostopic(name: str, heading: Sequence[str], body: TableBody) -> Iterator[Message]:
    """Columns of `rostopic echo -p`, such as field.position0; times are those of headers, or of receipt."""
    fields = ("name", "position", "velocity", "effort")
    places = [[k for k, x in enumerate(heading) if re.fullmatch(rf"field\.{field}\d+", x)] for field in fields]
    stamps = [heading.index(x) for x in ("field.header.stamp", "time") if x in heading]
    for at, row in zip(body.places, body.texts, strict=True):
        stamp = next((row[k] for k in stamps if row[k] != "0"), "")
        if not stamp.isdigit():
            raise ValueError(f"{name}, row {at}: must have a time in nanoseconds, got {cut(stamp, MAX_NAME)!r}")
        names, *values = ([row[k] for k in place] for place in places)
        yield int(stamp), names, [[as_number(x) for x in part] for part in values]


def is_bag(path: Path, first: bytes) -> bool:
    """True for a bag by its first bytes or its suffix."""
    return path.suffix.lower() in KINDS.values() or first.startswith(tuple(KINDS))


@contextmanager
def _opened(path: Path) -> Iterator[tuple[Any, str]]:
    """Open reader of a bag, with checked sizes of its chunks, and the kind of the bag."""
    try:
        from rosbags import rosbag1, rosbag2
    except ImportError:
        raise ImportError("reading bags of ROS needs rosbags: pip install 'rne[ros]'") from None
    with open(path, "rb") as stream:
        first = stream.read(64)
    kind = next((kind for mark, kind in KINDS.items() if first.startswith(mark)), "")
    if not kind:
        raise ValueError("it does not begin as a bag does")
    most = FREE + RATIO * path.stat().st_size
    _refuse_others(path, kind, first)
    chunks = _checked_chunks(path, most) if kind == ".mcap" else {}
    place = Path(re.sub("[#%?]", lambda x: f"%{ord(x[0]):x}", str(path))) if kind == ".db3" else path  # of an address
    reader: Any = rosbag1.Reader(path) if kind == ".bag" else rosbag2.Reader.STORAGE_PLUGINS[kind](place)
    try:
        reader.open()
    except KeyError as error:  # of the encoding of a schema
        what = f"has messages in {cut(str(error.args[0]), MAX_NAME)!r}, not of ROS 2"
        raise NotReadError(f"{what}; keep others by mcap filter FILE -o OUT -y TOPIC") from None
    try:
        indexed = [(x.chunk_start_offset, _stated(x)) for x in reader.chunks] if kind == ".mcap" else []
        if not Counter(indexed) <= Counter(chunks.items()):
            raise ValueError("its index names chunks that are not there; repair it: mcap recover FILE")
        if kind == ".bag":
            own = {"decompressor": partial(_unpacked, compression="", stated=LARGEST, left=[most])}
            reader.chunks = {at: chunk._replace(**own) for at, chunk in reader.chunks.items()}
        yield reader, kind
    finally:
        reader.close()


def _refuse_others(path: Path, kind: str, first: bytes) -> None:
    """Raise a NotReadError for MCAP that is not of ROS 2, and for messages that are not in the file itself."""
    if kind == ".mcap" and len(first) == 64 and first[8] == 1:
        profile = first[21:][: struct.unpack_from("<I", first, 17)[0]].decode(errors="replace")
        if profile != "ros2":
            raise NotReadError(f"is MCAP of the profile {profile!r}; 'ros2' is needed")
    wal = path.with_name(f"{path.name}-wal")
    if kind == ".db3" and wal.is_file() and wal.stat().st_size:
        raise NotReadError(f'has messages in {wal.name}; add them by sqlite3 FILE "pragma wal_checkpoint(truncate)"')


def bag_topics(path: Path) -> dict[str, str]:
    """Types of the messages of a bag by their topics."""
    with _opened(path) as (reader, _):
        return {x.topic: x.msgtype for x in reader.connections}


def bag_states(path: Path, topic: str, kind: str = JOINT_STATE) -> list[tuple[int, Message]]:
    """States of joints, or of their controller, of a topic with the times at which they were recorded [ns]."""
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    most, numbers, messages = most_unpacked(path), 0, list[tuple[int, Message]]()
    with _opened(path) as (reader, suffix):
        store, line = get_typestore(Stores.EMPTY), "=" * 80 + "\n"
        text = DEFINITION.format(line, "uint32 seq\n" * (suffix == ".bag"), FIELDS[kind].format(line))
        store.register(get_types_from_msg(text, kind))
        own = [x for x in reader.connections if (x.topic, x.msgtype) == (topic, kind)]
        for _, logged, raw in reader.messages(own) if own else ():
            state: Any = _decoded(store, kind, raw, is_old=suffix == ".bag")
            if kind == JOINT_STATE:
                parts = [state.position, state.velocity, state.effort]
            else:
                asked, found = state.reference, state.feedback
                parts = [found.positions, found.velocities, found.effort, asked.positions, asked.velocities]
            values = [array("d", x) for x in parts]
            if (numbers := numbers + 4 + sum(map(len, values))) * 8 > most:
                raise TooLargeError(most)
            ns = state.header.stamp.sec * 10**9 + state.header.stamp.nanosec or logged
            messages.append((int(logged), (ns, tuple(map(sys.intern, state.name)), values)))
        if (count := sum(x.msgcount for x in own)) > len(messages):
            raise ValueError(f"{count - len(messages)} of {count} messages cannot be found; repair its index")
    return messages


def _decoded(store: Any, kind: str, raw: bytes, *, is_old: bool) -> Any:
    """Decoded message; of a controller's the fields that all versions begin with."""
    if kind == JOINT_STATE:
        return store.deserialize_ros1(raw, kind) if is_old else store.deserialize_cdr(raw, kind)
    definition = store.get_msgdef(kind)
    read = definition.deserialize_ros1 if is_old else definition.deserialize_cdr_le
    if not is_old and bytes(raw[:2]) != b"\0\1":
        raise NotReadError("has messages of controllers in another byte order than little-endian")
    return read(raw if is_old else raw[4:], 0, definition.cls, store)[0]


def _checked_chunks(path: Path, most: int) -> Mapping[int, tuple[str, int, int]]:
    """Compression and sizes of all chunks of an MCAP file by their places; an error if they unpack to more bytes."""
    found, left = dict[int, tuple[str, int, int]](), [most]
    with open(path, "rb") as stream:
        at, end = stream.seek(8), path.stat().st_size
        while len(head := stream.read(9)) == 9:
            kind, size = struct.unpack("<BQ", head)
            if kind == FOOTER and at == end - TAIL:
                return found
            if kind in (0, FOOTER) or size > end - at - 9:
                raise ValueError(f"a record at byte {at} is of no kind, or longer than the file")
            if kind == CHUNK:
                _, _, stated, _, length = struct.unpack("<QQQII", stream.read(32))
                compression = stream.read(min(length, size)).decode()
                (packed,) = struct.unpack("<Q", stream.read(8))
                if stated > LARGEST or packed > size:
                    raise ValueError(f"a chunk is said to have {stated} bytes, and {packed} of {size} as it is stored")
                if len(_unpacked(stream.read(packed), compression, stated, left)) != stated:
                    raise ValueError("a chunk has more bytes than it says, or fewer")
                found[at] = (compression, packed, stated)
            at = stream.seek(at + 9 + size)
    raise ValueError("its last record is missing")


def _stated(index: Any) -> tuple[str, int, int]:
    return index.compression, index.compressed_size, index.uncompressed_size


def _unpacked(data: bytes, compression: str, stated: int, left: list[int]) -> bytes:
    """Bytes of a chunk; an error if they are more than stated. For ROS 1 its first bytes give the compression."""
    unpacking: Any = None
    if compression == "zstd":
        if sys.version_info >= (3, 14):
            from compression.zstd import ZstdDecompressor
        else:
            from backports.zstd import ZstdDecompressor
        unpacking = ZstdDecompressor()
    elif compression == "lz4" or data[:4] == b"\x04\x22\x4d\x18":
        from lz4.frame import LZ4FrameDecompressor

        unpacking = LZ4FrameDecompressor()
    elif data[:3] == b"BZh":
        unpacking = bz2.BZ2Decompressor()
    found: bytes = unpacking.decompress(data, min(left[0], stated) + 1) if unpacking else data
    left[0] -= len(found)
    if left[0] < 0 or (unpacking and (not unpacking.eof or unpacking.unused_data)):
        raise ValueError("its chunks unpack to more bytes than they say or a file of its size may, or are cut off")
    return found
