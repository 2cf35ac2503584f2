"""Files from elsewhere: nothing outside of their folder is read, sizes are bounded, and what is wrong is one kind of error."""

import io
import re

import pytest

import rne
from rne.urdf.findings import ECHO

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
    with pytest.raises(
        rne.UrdfError, match=f"must be one number, finite and decimal, got '{'1' * (ECHO - 3)}...'; fix"
    ):
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
    assert max(len(str(finding)) for finding in found) < 20 * ECHO


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
