"""Files with damage that a seed chooses, each from a file that reads: bytes, truncation, values, nesting, stated sizes.

`read` is what a user does with such a file: it loads and can be used, or is refused by one class of error.
"""

import copy
import io
import json
import struct
import sys
import tempfile
import time
import warnings
import zipfile
from collections import Counter
from importlib.util import find_spec
from pathlib import Path

import numpy as np
from lxml import etree

import rne

from .helpers import archived, loaded

VALUES = ["", "nan", "-inf", "1e999", "-1", "0", "1e300 0 0", "0 0 0", "9" * 1200, "x" * 300, "a\x9bb", "\u202ea", "../../a.stl", "0x10", "1_0", "true"]  # fmt: skip
LEAVES = [None, True, "text", "", -1, 10**400, 1.5, float("nan"), [], {}, [[]] * 3, {"array": "array_0"}, {"mapping": 3}, {"type": "Box"}, {"slice": 1}]  # fmt: skip
MEMORY = 3 * 2**30  # bytes of addresses that a process may have, of which the interpreter and its packages take some
BAGS = ("mcap", "db3", "bag")
KINDS = ("urdf", "mjcf", "motion", "mat", "npz", "mcap", "db3", "bag", "result")
ROBOT = """<mujoco><compiler angle="radian"/><option gravity="0 0 -9"/><default><default class="c"><geom density="100"/>
    </default></default><asset><mesh name="m" vertex="0 0 0 1 0 0 0 1 0 0 0 1"/><material name="g"/></asset><worldbody>
    <body name="a" childclass="c"><joint name="j" axis="0 0 1" range="-1 1"/><geom type="capsule" size="0.1 0.2"/>
    <body name="b" pos="0 0 1"><joint name="k" type="slide"/><inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/>
    <geom type="mesh" mesh="m"/></body><body name="d"><frame pos="1 0 0"><joint name="l"/></frame><geom size="0.1"/></body>
    </body></worldbody><tendon><fixed name="t"><joint joint="j" coef="1"/></fixed></tendon><equality><joint joint1="k"
    joint2="j" polycoef="0 1 0 0 0"/></equality><actuator><motor joint="j" gear="10"/><muscle joint="l"/></actuator>
    <sensor><jointpos joint="j"/></sensor></mujoco>"""


def result(folder):
    """The bytes of an identification of two joints."""
    arm, t = rne.load("irb140").locked({f"joint_{k}": 0 for k in (3, 4, 5, 6)}), np.arange(0, 4, 0.01)
    q = np.column_stack([np.sin(2 * t) + 0.4 * np.sin(5 * t), np.cos(3 * t) + 0.3 * np.sin(7 * t)])
    qd = np.column_stack([2 * np.cos(2 * t) + 2 * np.cos(5 * t), -3 * np.sin(3 * t) + 2.1 * np.cos(7 * t)])
    qdd = np.column_stack([-4 * np.sin(2 * t) - 10 * np.sin(5 * t), -9 * np.cos(3 * t) - 14.7 * np.sin(7 * t)])
    tau = arm.inverse_dynamics(q, qd, qdd) + 0.1 * np.random.default_rng(0).normal(size=q.shape)
    return rne.identify(arm, rne.identification.Record(t, q, tau)).save(folder / "result.npz").read_bytes()


def originals(folder):
    """The bytes of a file of each kind that reads; without those whose packages are not installed."""
    t = np.linspace(0, 1, 60)
    q = np.column_stack([np.sin(3 * t), np.cos(5 * t)])
    motion = rne.simulate(loaded("irb140"), [0] * 6, [0] * 6, 0.02).save(folder / "motion.npz")
    np.savez_compressed(folder / "log.npz", t=t, q=q, tau=q, joint_names=np.array(["one", "two"]))
    found = {"urdf": rne.to_urdf(rne.irb140()).encode(), "mjcf": ROBOT.encode()}
    found |= {"motion": motion.read_bytes(), "npz": (folder / "log.npz").read_bytes(), "mat": matlab(t, q)}
    if find_spec("rosbags"):
        found |= {kind: messages(kind, t, q, np.random.default_rng(0), hostile=False) for kind in BAGS}
    return found


def matlab(t, q):
    from scipy.io import savemat

    file = io.BytesIO()
    savemat(file, {"log": {"time": t, "position": q, "effort": q}, "names": ["one", "two"]}, do_compression=True)
    plain = io.BytesIO()
    savemat(plain, {"gains": q[:1], "note": "of none"})
    return file.getvalue() + plain.getvalue()[128:]


def messages(kind, t, q, rng, hostile=True):
    """Joint states in a bag; hostile ones have other definitions, names and numbers of values."""
    from rosbags import rosbag1, rosbag2

    is_old, text = kind == "bag", ""
    if hostile and rng.random() < 0.5:
        text = str(
            rng.choice(["", "a" * 9, "string[<=99999999999] name", "uint8[99999999999] a", "MSG: x\n=" * 99, "\0"])
        )
    odd = rng.integers(len(t)) if hostile else -1
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name) / "log"
        if is_old:
            writer = rosbag1.Writer(file := Path(name) / "log.bag")
            if rng.random() < 0.7:
                writer.set_compression(list(rosbag1.Writer.CompressionFormat)[rng.integers(2)])
        else:
            plugin = rosbag2.StoragePlugin.MCAP if kind == "mcap" else rosbag2.StoragePlugin.SQLITE3
            writer, file = rosbag2.Writer(folder, version=9, storage_plugin=plugin), folder / f"log.{kind}"
            if kind == "mcap" and rng.random() < 0.7:
                writer.set_compression(rosbag2.CompressionMode.STORAGE, rosbag2.CompressionFormat.ZSTD)
        with writer:
            form = {} if is_old or not hostile else {"serialization_format": str(rng.choice(["cdr", "cdr", "json"]))}
            own = {"msgdef": text, "md5sum" if is_old else "rihs01": "x", **form}
            channel = writer.add_connection("/joint_states", "sensor_msgs/msg/JointState", **own)
            for k in range(len(t)):
                names = ["one", "two"]
                if k == odd:
                    names = [["one", "one"], ["x" * 300, "y"], ["one"], [], ["\x9b", "\u202e"]][rng.integers(5)]
                sizes = [len(q[k]) if k != odd or rng.random() < 0.7 else 2**32 - 1 for _ in range(3)]
                writer.write(channel, k if k != odd else 2**31 - 1, packed(k, names, q[k], sizes, is_old))
        return file.read_bytes()


def packed(k, names, values, sizes, is_old):
    """A joint state at second k, with these numbers of positions, velocities and efforts, in ROS 1 or CDR."""

    def aligned(size):
        return b"" if is_old else b"\0" * ((4 - len(data)) % size)

    data = struct.pack("<IIII", k, k, 0, 0) if is_old else b"\0\1\0\0" + struct.pack("<iII", k, 0, 1) + b"\0\0\0\0"
    data += struct.pack("<I", len(names))
    for name in (name.encode() + b"\0" * (not is_old) for name in names):
        data += aligned(4) + struct.pack("<I", len(name)) + name
    for size in sizes:
        data += aligned(4) + struct.pack("<I", size)
        data += aligned(8) + values.tobytes()
    return data


def bytes_damaged(data, rng):
    """Some bytes exchanged, cut off, repeated, or replaced by the largest numbers."""
    data, at = bytearray(data), int(rng.integers(len(data)))
    kind = rng.integers(4)
    if kind == 0:
        for place in rng.integers(len(data), size=rng.integers(1, 9)):
            data[place] = rng.integers(256)
    elif kind == 1:
        del data[at:]
    elif kind == 2:
        data[at:at] = data[at : at + rng.integers(1, 200)]
    else:
        data[at : at + 4] = rng.choice([b"\xff" * 4, b"\0" * 4, b"\xff\xff\xff\x7f"])
    return bytes(data)


def xml_damaged(data, rng):
    """One or a few values, names, elements or namespaces of a text exchanged."""
    root = etree.fromstring(data)
    for _ in range(rng.integers(1, 4)):
        elements = [x for x in root.iter() if isinstance(x.tag, str)]
        element, other = (elements[k] for k in rng.integers(len(elements), size=2))
        kind = rng.integers(7)
        if kind <= 2 and element.attrib:
            with_text = str(rng.choice(VALUES))
            name = str(rng.choice(list(element.attrib)))
            element.set(name, with_text if with_text.isprintable() else "b\u202e")
        elif kind == 3 and element is not root:
            element.getparent().remove(element)
        elif kind == 4 and other not in element.iterancestors() and other is not element:
            other.append(copy.deepcopy(element))
        elif kind == 5:
            element.tag = other.tag if rng.random() < 0.5 else "{n}" + other.tag.rpartition("}")[2]
        else:
            inner = element
            for _ in range(rng.integers(1, 400)):
                inner = etree.SubElement(inner, other.tag)
    return etree.tostring(root)


def texts_damaged(data, rng):
    """One or two values of an archive's texts, or an array, exchanged."""
    arrays, texts = archived(io.BytesIO(data))
    for _ in range(changes := rng.integers(3)):
        part, above, key = texts, None, None
        while part and isinstance(part, dict | list) and (above is None or rng.random() < 0.85):
            above, key = part, rng.choice(list(part)) if isinstance(part, dict) else int(rng.integers(len(part)))
            part = part[key]
        if above is not None:
            above[key] = copy.deepcopy(LEAVES[rng.integers(len(LEAVES))])
    name = str(rng.choice(list(arrays)))
    x = np.atleast_1d(arrays[name])
    odd = [
        x[:1],
        x[:0],
        x * np.nan,
        x.astype("U9"),
        np.zeros((0, 6)),
        np.array(3.0),
        x.T,
        x * 1e300,
        x * -1,
        np.concatenate([x, x]),
    ]
    if not changes or rng.random() < 0.3:
        arrays[name] = odd[rng.integers(len(odd))]
    file = io.BytesIO()
    np.savez(file, **arrays, **{"texts": np.array(json.dumps(texts))})
    return file.getvalue()


def entries_damaged(data, rng):
    """An archive one of whose headers says another shape or type, or that is compressed otherwise."""
    with np.load(io.BytesIO(data)) as archive:
        arrays = dict(archive)
    file, odd = io.BytesIO(), str(rng.choice(list(arrays)))
    shape = [(2**40,), (-3,), (2**62, 4), (0, 2**60), (3, 3, 3), ()][rng.integers(6)]
    kind = str(rng.choice(["<f8", "|O", "<U5", "<c16", "|b1", "|S0", "<M8[ns]", "[('a', '<f8')]"]))
    method = [zipfile.ZIP_STORED, zipfile.ZIP_BZIP2, zipfile.ZIP_LZMA][rng.integers(3)]
    with zipfile.ZipFile(file, "w") as entries:
        for name, x in arrays.items():
            text = io.BytesIO()
            np.save(text, x)
            if name == odd:
                text = io.BytesIO()
                header = {"descr": kind, "fortran_order": bool(rng.integers(2)), "shape": shape}
                np.lib.format.write_array_header_1_0(text, header)
                text.write(x.tobytes()[:2000])
            entries.writestr(f"{name}.npy", text.getvalue(), method if name == odd else zipfile.ZIP_DEFLATED)
    return file.getvalue()


def damaged(kind, data, rng):
    """A file of a kind with damage."""
    if kind in ("urdf", "mjcf"):
        ways = [bytes_damaged, xml_damaged, xml_damaged]
    elif kind in BAGS:
        ways = [bytes_damaged, lambda data, rng: messages(kind, np.zeros(60), np.zeros((60, 2)), rng)]
    else:
        of_texts = [texts_damaged, texts_damaged] * (kind in ("motion", "result"))
        ways = [bytes_damaged, *of_texts, *([entries_damaged] * (kind != "mat"))]
    return ways[rng.integers(len(ways))](data, rng)


def read(kind, data, folder):
    """Load a file and use it; "read", or the error if it is refused."""
    suffix = {"urdf": ".urdf", "mjcf": ".xml", "motion": ".npz", "result": ".npz"}.get(kind, f".{kind}")
    file = folder / f"hostile{suffix}"
    file.write_bytes(data)
    try:
        if kind in ("urdf", "mjcf"):
            found = rne.load(file)
        elif kind in ("motion", "result"):
            found = (rne.Trajectory if kind == "motion" else rne.Identification).load(file)
        else:
            found = rne.identification.Record.from_log(file)
    except rne.UrdfError as error:
        return error
    except ValueError as error:
        if kind in ("urdf", "mjcf") or (str(file) not in str(error) and "at least" not in str(error)):
            raise AssertionError(f"{type(error).__name__}: {error}") from error
        return error
    assert repr(found)
    if kind in ("urdf", "mjcf"):
        rne.check(file, out=io.StringIO())
        rne.to_urdf(found.model)
    elif kind == "motion":
        assert str(found)
        if found.model is not None:
            rne.to_urdf(found.model)
    elif kind == "result":
        found.report(details=True)
    return "read"


def main(kind, count):
    """Read as many files of a kind in a process whose memory is limited; prints the worst time and memory."""
    import resource

    resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
    with tempfile.TemporaryDirectory() as name, warnings.catch_warnings():
        warnings.simplefilter("ignore")
        folder, found, worst = Path(name), Counter(), 0.0
        data = result(folder) if kind == "result" else originals(folder)[kind]
        for seed in range(count):
            hostile = damaged(kind, data, np.random.default_rng([seed, KINDS.index(kind)]))
            start = time.process_time()
            try:
                found[type(read(kind, hostile, folder)).__name__] += 1
            except Exception as error:
                raise AssertionError(f"seed {seed}") from error
            worst = max(worst, time.process_time() - start)
    memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    sys.stdout.write(f"{kind}: {dict(found)}, at most {worst:.2f} s of CPU, {memory:.0f} MB\n")


if __name__ == "__main__":
    main(sys.argv[1], int(sys.argv[2]))
