"""Files from elsewhere: nothing outside of their folder is read, sizes are bounded, and what is wrong is one kind of error."""

import io
import json
import os
import re
import struct
import subprocess
import sys
import zipfile
import zlib
from dataclasses import replace

import numpy as np
import pytest

import rne
from rne.basics.archive import Arrays
from rne.plotting.shapes import link_shapes

from . import hostile_files
from .helpers import ROOT, archived

INERTIAL = '<inertial pos="0 0 0" mass="2" diaginertia="0.1 0.1 0.1"/>'
BODY = f'<body name="arm"><joint name="hinge"/>{INERTIAL}</body>'
MESHED = '<asset>{}</asset><worldbody><body name="arm"><joint name="hinge"/><geom type="mesh" mesh="part"/></body></worldbody>'
LINK = '<link name="base"/>'


def mjcf(folder, text):
    pytest.importorskip("mujoco")
    file = folder / "arm.xml"
    file.write_text(f"<mujoco>{text}</mujoco>")
    return file


def urdf(folder, text):
    file = folder / "arm.urdf"
    file.write_text(f'<robot name="arm">{text}</robot>')
    return file


@pytest.fixture(scope="module")
def originals(tmp_path_factory):
    return hostile_files.originals(tmp_path_factory.mktemp("originals"))


@pytest.mark.parametrize(
    ("element", "name"),
    [
        ('<include xmlns="n" file="FILE"/>', "{n}include"),
        ('<n:include xmlns:n="n" file="FILE"/>', "{n}include"),
        ('<n:include file="FILE"/>', "n:include"),
        ('<replicate xmlns="n" count="9"><body/></replicate>', "{n}replicate"),
        ('<body xmlns:n="n" n:childclass="c"/>', "{n}childclass"),
    ],
)
def test_names_with_a_namespace_are_refused_in_mjcf(element, name, tmp_path):
    """MuJoCo would take them for those without, which are checked."""
    other = tmp_path / "other.xml"
    other.write_text('<mujoco><body><joint name="stolen"/><geom size="0.1"/></body></mujoco>')
    (folder := tmp_path / "folder").mkdir()
    file = mjcf(folder, f"<worldbody>{BODY}{element.replace('FILE', str(other))}</worldbody>")
    expected = f"the name {name!r} has a namespace; MJCF has no namespaces: remove xmlns and prefixes"
    with pytest.raises(rne.UrdfError, match=re.escape(expected)):
        rne.load(file)


@pytest.mark.parametrize(
    ("text", "where"),
    [
        (f"<Worldbody>{BODY}</Worldbody>", "<Worldbody> is no element of MJCF in <mujoco>"),
        (f"<worldbody>{BODY}</worldbody><defaults/>", "<defaults> is no element of MJCF in <mujoco>"),
        (f"<worldbody>{BODY}</worldbody><equality><jnt/></equality>", "<jnt> is no element of MJCF in <equality>"),
    ],
)
def test_unknown_elements_are_refused_where_known_ones_are_left_out(text, where, tmp_path):
    """Bodies, defaults and couplings below a name that is misspelt would be lost."""
    with pytest.raises(rne.UrdfError, match=re.escape(f"{where}; correct its name")):
        rne.load(mjcf(tmp_path, text))


def test_what_nothing_reads_is_not_compiled(tmp_path):
    """Ranges of actuators would be found by simulating for 1e9 s; sizes stated for users' data would be allocated."""
    text = f"""<compiler><lengthrange mode="all" useexisting="false" inttotal="1e9"/></compiler><size memory="900G"/>
        <custom><numeric name="n" size="2000000000"/></custom><worldbody>{BODY}</worldbody><actuator>
        <general joint="hinge" dyntype="user" actdim="2000000000"/><muscle joint="hinge"/></actuator>
        <asset><mesh name="unused" builtin="supersphere" params="5000 1 1"/></asset>"""
    assert rne.load(mjcf(tmp_path, text)).joint_names == ("hinge",)


def test_sizes_that_mujoco_compiles_are_bounded(tmp_path, monkeypatch):
    file = mjcf(tmp_path, MESHED.format('<mesh name="part" builtin="supersphere" params="3000 1 1"/>'))
    most = "at most 134217728 bytes of mesh files and 300000 vertices of built-in meshes are compiled, got 0 and 9.0025e+06"
    with pytest.raises(rne.UrdfError, match=re.escape(f"{file}: file: {most}; make meshes smaller")):
        rne.load(file)
    assert rne.load(mjcf(tmp_path, MESHED.format('<mesh name="part" builtin="sphere" params="1"/>'))).n == 1
    (tmp_path / "part.stl").write_bytes(bytes(100))
    monkeypatch.setattr("rne.urdf.mjcf.MAX_MESHES", 99)
    with pytest.raises(rne.UrdfError, match=r"at most 99 bytes of mesh files .* got 100 and 0; make meshes smaller"):
        rne.load(mjcf(tmp_path, MESHED.format('<mesh name="part" file="part.stl"/>')))
    monkeypatch.setattr("rne.urdf.mjcf.MAX_ELEMENTS", 9)
    cure = "split the robot, or remove what is not it"
    with pytest.raises(rne.UrdfError, match=f"file: has 14 elements to compile, more than 9; {cure}"):
        rne.load(mjcf(tmp_path, f"<worldbody>{BODY}</worldbody><default>{'<default/>' * 6}</default>"))


def test_included_files_are_small_together(tmp_path, monkeypatch):
    file = mjcf(tmp_path, '<include file="a.xml"/><include file="b.xml"/>')
    for name in "ab":
        (tmp_path / f"{name}.xml").write_text(f"<mujoco><!-- {'x' * 40} --></mujoco>")
    monkeypatch.setattr("rne.urdf.mjcf.MAX_BYTES", 100)
    with pytest.raises(
        rne.UrdfError, match=r"b\.xml: file: makes the files included larger than 100 bytes; include less"
    ):
        rne.load(file)


def test_numbers_of_urdf_have_a_longest_token(tmp_path):
    """All digits of the smallest double, and none of a file's text that takes quadratic time."""
    mass = '<link name="base"><inertial><mass value="{}"/><inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial></link>'
    assert rne.load(urdf(tmp_path, mass.format("0." + "0" * 1000 + "1"))).model.base_mass == 0
    digits = "1" * 400_000 + "x"
    with pytest.raises(rne.UrdfError, match=f"must be one number, finite and decimal, got '{'1' * 80}...'; fix"):
        rne.load(urdf(tmp_path, mass.format(digits)))


@pytest.mark.parametrize(
    ("text", "error"),
    [
        (LINK + "<t/>" * 5000, "arm.urdf: file: has 5003 tags, more than 5000; split the robot"),
        (
            "<link name='base' " + " ".join(f"a{k}=''" for k in range(1000)) + "/>",
            "arm.urdf:1: <link>: has 1001 attributes, more than 1000; remove those that are not URDF",
        ),
        (
            "".join(f"<link name='l{k}'/>" for k in range(2000)),
            "several roots: links 'l0', 'l1', 'l2', 'l3', 'l4', 'l5', 'l6', 'l7', 'l8', 'l9' and 1990 more; connect them",
        ),
        (
            LINK + "<joint name='j' type='floating'/>" * 30,
            "unsupported joints: " + ", ".join(["joint 'j' of type 'floating'"] * 10) + " and 20 more",
        ),
    ],
    ids=["tags", "attributes", "names", "types"],
)
def test_urdf_of_many_parts_ends_in_a_short_error(text, error, tmp_path, monkeypatch):
    monkeypatch.setattr("rne.urdf.document.MAX_TAGS", 5000)  # of 300 000, which take some seconds
    found = rne.check(urdf(tmp_path, text), out=io.StringIO())
    assert any(error in str(finding) for finding in found if finding.severity == "error")
    assert max(len(str(finding)) for finding in found) < 20 * 83


def test_names_are_suggested_for_the_first_unknown_elements_alone(tmp_path, monkeypatch):
    """Each takes a comparison with all names."""
    monkeypatch.setattr("rne.urdf.document.SUGGESTED", 2)
    found = rne.check(urdf(tmp_path, LINK + "<lonk/>" * 4), out=io.StringIO())
    assert [finding.cure for finding in found] == ["remove it, or write <link> if that is meant"] * 2 + [
        "remove it"
    ] * 2


def test_rotors_of_one_transmission_are_read_in_linear_time(tmp_path, monkeypatch):
    """Each joint of the transmission is looked up once, however many rotors it has."""
    rotor, calls = '<actuator><drake:rotor_inertia value="1"/></actuator>', []
    monkeypatch.setattr("rne.urdf.rotors.listed", lambda names: calls.append(0) or ", ".join(names))
    rne.check(urdf(tmp_path, f"{LINK}<transmission><joint name='j'/>{rotor * 50}</transmission>"), out=io.StringIO())
    assert len(calls) == 1


def archive(file, **arrays):
    np.savez_compressed(file, **arrays)
    return file


def test_arrays_are_compared_with_the_size_of_a_file_before_they_are_unpacked(originals, tmp_path, monkeypatch):
    """Small numbers that take eight times as much in double precision; what is not asked for is not unpacked."""
    monkeypatch.setattr("rne.basics.archive.FREE", 1000)  # of 64 MiB
    count = 20_000
    log = archive(tmp_path / "log.npz", t=np.zeros(9), q=np.zeros(count, np.int8))
    with pytest.raises(
        ValueError, match=r"its arrays take more than .* bytes in double precision, the most for a file"
    ):
        rne.identification.Record.from_log(log)
    (motion := tmp_path / "motion.npz").write_bytes(originals["motion"])
    with np.load(motion) as found:
        arrays = dict(found)
    file = archive(motion, **arrays, other=np.zeros(count, np.int8))
    unpacked = []

    class Reader(Arrays):
        def __getitem__(self, name):
            unpacked.append(name)
            return super().__getitem__(name)

    monkeypatch.setattr("rne.basics.archive.Arrays", Reader)
    rne.Trajectory.load(file)
    assert set(unpacked) == set(arrays)


def test_an_array_that_takes_more_than_its_entry_has_is_refused(tmp_path):
    """Its header says 8 TB."""
    file, text = tmp_path / "log.npz", io.BytesIO()
    np.lib.format.write_array_header_1_0(text, {"descr": "<f8", "fortran_order": False, "shape": (10**6, 10**6)})
    with zipfile.ZipFile(file, "w") as entries:
        entries.writestr("q.npy", text.getvalue())
    with pytest.raises(ValueError, match="its arrays take more than"):
        rne.identification.Record.from_log(file)


@pytest.mark.filterwarnings("ignore:Duplicate name")
def test_an_array_that_is_there_twice_is_refused(tmp_path):
    file = tmp_path / "log.npz"
    np.savez(file, t=np.arange(9.0))
    with zipfile.ZipFile(file, "a") as archive:
        archive.writestr("t.npy", archive.read("t.npy"))
    with pytest.raises(ValueError, match=r"is damaged or cut off \(an array is there twice\)"):
        rne.identification.Record.from_log(file)


def test_an_archive_names_no_file_that_is_read(tmp_path):
    """Neither one that is saved, nor one of a former version or another author."""
    (tmp_path / "arm.urdf").write_text(rne.to_urdf(rne.irb140()))
    motion = rne.simulate(rne.load(tmp_path / "arm.urdf"), [0] * 6, [0] * 6, 0.01)
    file = motion.save(tmp_path / "motion.npz")
    arrays, texts = archived(file)
    assert "source" not in texts["value"]["fields"]["model"]["fields"]
    texts["value"]["fields"]["model"]["fields"]["source"] = "/dev/zero"
    back = rne.Trajectory.load(archive(file, texts=np.array(json.dumps(texts)), **arrays))
    assert back.model == motion.model
    assert back.model.source is None


@pytest.mark.parametrize(
    ("place", "value", "error"),
    [
        (["evaluations"], "many", "`Trajectory.evaluations` must be of type int, got 'many'"),
        (["model", "fields", "name"], 3, "`Trajectory.model.name` must be of type str, got 3"),
        (["model", "fields", "moving_joints"], [1] * 6, "`Trajectory.model.moving_joints` must be of type tuple[str, ...]"),
        (["model", "fields", "shapes", 0, "fields", "size"], [1.0], "`Trajectory.model.shapes[0].size` must be of type"),
        (["dissipated"], {"mapping": {"viscous": 0.5}}, "`Trajectory.dissipated` must be of type Mapping[str, Array]"),
        (["dissipated"], [[[]]] * 2, "`Trajectory.dissipated` must be of type Mapping[str, Array]"),
        (["model", "fields"], 4, "is damaged (AttributeError: "),
    ],
)  # fmt: skip
def test_types_in_archives_are_those_of_annotations(place, value, error, originals, tmp_path):
    (file := tmp_path / "motion.npz").write_bytes(originals["motion"])
    arrays, texts = archived(file)
    *above, last = place
    part = texts["value"]["fields"]
    for name in above:
        part = part[name]
    part[last] = value
    with pytest.raises(ValueError, match=re.escape(f"{str(file)!r}: {error}")):
        rne.Trajectory.load(archive(file, texts=np.array(json.dumps(texts)), **arrays))


def test_texts_and_arrays_of_archives_have_a_longest_and_a_largest_one(originals, tmp_path, monkeypatch):
    """What is read back is written; nothing larger."""
    (file := tmp_path / "motion.npz").write_bytes(originals["motion"])
    motion, again = rne.Trajectory.load(file), tmp_path / "again.npz"
    monkeypatch.setattr("rne.basics.archive.LONGEST", 1000)
    with pytest.raises(ValueError, match=f"^{re.escape(repr(str(file)))} is not written by Trajectory.save$"):
        rne.Trajectory.load(file)
    monkeypatch.setattr("rne.basics.archive.LARGEST", 1000)
    with pytest.raises(
        ValueError, match=r"^the arrays take \d+ bytes, more than the 1000 that are read; keep fewer samples$"
    ):
        motion.save(again)
    assert not again.exists()


def test_what_an_archive_cannot_have_is_no_part_of_a_motion(originals, tmp_path):
    (file := tmp_path / "motion.npz").write_bytes(originals["motion"])
    with pytest.raises(TypeError, match=r"^set cannot be written to a file$"):
        replace(rne.Trajectory.load(file), scene={"a", "b"}).save(tmp_path / "again.npz")


def test_texts_nested_deeply_are_no_archive(tmp_path):
    for text, error in (("[" * 9**5, "is not written by Trajectory.save"), ('{"version": 2, "value": ' + "[" * 900 + "]" * 900 + "}", "is damaged (RecursionError")):  # fmt: skip
        with pytest.raises(ValueError, match=re.escape(error)):
            rne.Trajectory.load(archive(tmp_path / "motion.npz", texts=np.array(text)))


def element(kind, content):
    return struct.pack("<II", kind, len(content)) + content.ljust(-(-len(content) // 8) * 8, b"\0")


def test_elements_of_matlab_state_their_sizes(tmp_path):
    """One that is compressed says how much it unpacks to; a list of nothing ends."""
    file, head = tmp_path / "log.mat", b"MATLAB 5.0".ljust(124) + b"\0\1IM"
    large = zlib.compress(struct.pack("<II", 14, 2**31) + bytes(99))
    file.write_bytes(head + element(15, large))
    with pytest.raises(ValueError, match="its arrays take more than 67"):
        rne.identification.Record.from_log(file)
    cells = (
        element(6, struct.pack("<II", 1, 0)) + element(5, struct.pack("<ii", 1, 1)) + element(1, b"q") + bytes(10**6)
    )
    file.write_bytes(head + element(15, zlib.compress(element(14, cells))))
    with pytest.raises(ValueError, match="an array has 100000 parts or more"):
        rne.identification.Record.from_log(file)


@pytest.mark.parametrize("suffix", ["csv", "npz", "mat", "json", "mcap", "db3", "bag"])
def test_pipes_and_devices_are_no_logs(suffix, tmp_path):
    """They need not end; nor is a file read whole that states more bytes than memory has."""
    pipe, sparse = tmp_path / f"pipe.{suffix}", tmp_path / f"sparse.{suffix}"
    os.mkfifo(pipe)
    with open(sparse, "wb") as stream:
        stream.truncate(2**34)
    with pytest.raises(ValueError, match="is not a regular file; copy to one what it gives"):
        rne.identification.Record.from_log(pipe)
    with pytest.raises(ValueError, match=r"has 17179869184 bytes, more than|no MATLAB file|is damaged"):
        rne.identification.Record.from_log(sparse)
    for read in (rne.Trajectory.load, rne.Identification.load, lambda path: rne.trajectories.read_csv(path, ["a"])):
        with pytest.raises(ValueError, match=r"not a regular file|is not written by \w+.save"):
            read(pipe)


def test_a_matlab_file_of_version_4_is_said_to_be_none_of_5_to_7(tmp_path):
    scipy_io = pytest.importorskip("scipy.io")
    scipy_io.savemat(tmp_path / "log.mat", {"t": np.arange(9.0)}, format="4")
    with pytest.raises(
        ValueError, match=re.escape("is no MATLAB file of version 5 to 7; save it by save(file, ..., '-v7')")
    ):
        rne.identification.Record.from_log(tmp_path / "log.mat")


@pytest.mark.parametrize("name", ["(" * 10**5, "x" + " " * 10**5 + "y", "_" * 10**5])
def test_names_in_logs_have_a_longest_one(name, tmp_path):
    """The patterns that look for units and numbers take quadratic time."""
    file = tmp_path / "log.csv"
    file.write_text(f"t,q.a,tau.a,{name}\n" + "0,0,0,0\n" * 9)
    with pytest.raises(ValueError, match=r"names of columns and joints must have at most 200 characters, .* has 10000"):
        rne.identification.Record.from_log(file)


def test_names_of_joints_in_messages_have_a_longest_one(tmp_path):
    file, name = tmp_path / "log.csv", "x" * 10**5
    file.write_text("".join(f"1700000000,{k},,{name},0,1,2\n" for k in range(9)))
    with pytest.raises(ValueError, match=r"names of columns and joints must have at most 200 characters, .* has 10000"):
        rne.identification.Record.from_log(file)


STL = b"solid\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\nendloop\nendfacet\nendsolid\n"


@pytest.mark.parametrize(
    ("name", "package", "found"),
    [
        ("../urdf/own.stl", False, True),
        ("../near.stl", False, False),
        ("../near.stl", True, True),
        ("package://robot/near.stl", False, True),
        ("package://robot/../far.stl", True, False),
        ("package://folder/far.stl", False, False),
        ("../../far.stl", True, False),
        ("FOLDER/far.stl", True, False),
        ("file://FOLDER/far.stl", True, False),
        ("FOLDER/robot/near.stl", True, True),
        ("link.stl", True, False),
        ("pipe.stl", True, False),
        ("own.zip", True, False),
        ("large.stl", True, False),
    ],
)
def test_meshes_of_urdf_are_below_its_folder_or_that_of_its_package(name, package, found, tmp_path, monkeypatch):
    """As includes and meshes of MJCF are; files of meshes alone, of a limited size."""
    pytest.importorskip("yourdfpy")
    folder = tmp_path / "folder"
    own = folder / "robot" / "urdf"
    own.mkdir(parents=True)
    for file in (own / "own.stl", own / "own.zip", own / "large.stl", own.parent / "near.stl", folder / "far.stl"):
        file.write_bytes(STL + b" " * 1000 * (file.stem == "large"))
    (own / "link.stl").symlink_to(folder / "far.stl")
    if hasattr(os, "mkfifo"):
        os.mkfifo(own / "pipe.stl")
    if package:
        (own.parent / "package.xml").write_text("<package/>")
    monkeypatch.setattr("rne.plotting.shapes.LARGEST", 1000)
    mesh = f'<visual><geometry><mesh filename="{name.replace("FOLDER", folder.as_posix())}"/></geometry></visual>'
    model = rne.load(urdf(own, f'<link name="base">{mesh}</link>')).model
    if found:
        assert [shape.kind for shape in link_shapes(model)] == ["mesh"]
        return
    with pytest.warns(
        UserWarning, match=r"is not found below the folder of the URDF file|is no file of \.stl|1000 remain"
    ):
        assert link_shapes(model) == []


def test_a_mesh_counts_as_often_as_it_is_shown(tmp_path, monkeypatch):
    pytest.importorskip("yourdfpy")
    pytest.importorskip("mujoco")
    (tmp_path / "part.stl").write_bytes(STL)
    monkeypatch.setattr("rne.plotting.shapes.LARGEST", 3 * len(STL))
    visual = '<visual><geometry><mesh filename="part.stl"/></geometry></visual>'
    with pytest.warns(UserWarning, match=r"has \d+ bytes, 0 remain: at most \d+ bytes are read for a robot"):
        assert len(link_shapes(rne.load(urdf(tmp_path, f'<link name="base">{5 * visual}</link>')).model)) == 3
    asset = '<asset><mesh name="part" vertex="0 0 0 1 0 0 0 1 0 0 0 1" face="0 1 2 0 1 3 0 2 3 1 2 3"/></asset>'
    geom = '<geom type="mesh" mesh="part" mass="0"/>'
    shown = f"{asset}<worldbody>{99 * geom}</worldbody>"
    with pytest.warns(UserWarning, match="a mesh is beyond the"):
        assert len(link_shapes(rne.load(mjcf(tmp_path, shown)).model)) == 3 * len(STL) // 50 // 4


@pytest.mark.filterwarnings("ignore")  # of files that are read
@pytest.mark.parametrize("kind", hostile_files.KINDS[:-1])
def test_damaged_files_are_read_or_refused_by_one_class_of_error(kind, originals, tmp_path):
    if kind == "mjcf":
        pytest.importorskip("mujoco")
    if kind not in originals:
        pytest.skip("a package that reads them is not installed")
    assert hostile_files.read(kind, originals[kind], tmp_path) == "read"
    rng = np.random.default_rng(7)
    for _ in range(5):
        hostile_files.read(kind, hostile_files.damaged(kind, originals[kind], rng), tmp_path)


@pytest.mark.long
@pytest.mark.parametrize("kind", hostile_files.KINDS)
def test_500_damaged_files_are_read_or_refused_in_limited_memory(kind):
    pytest.importorskip("resource")
    if module := {"mjcf": "mujoco", **dict.fromkeys(hostile_files.BAGS, "rosbags")}.get(kind):
        pytest.importorskip(module)
    command = [sys.executable, "-m", "tests.hostile_files", kind, "500"]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
