"""Xacro files: expanded for `load` and `check` by their name alone, with arguments and packages; every error names the file."""

import io
import re
import sys

import pytest

import rne

pytest.importorskip("xacrodoc")

ARM = """<robot name="r" xmlns:xacro="http://www.ros.org/wiki/xacro">
  <xacro:include filename="parts/links.xacro"/>
  <xacro:arg name="mass" default="2"/>
  <xacro:property name="length" value="0.3"/>
  <link name="base"/>
  <xacro:arm name="arm" mass="$(arg mass)"/>
  <joint name="elbow" type="revolute"><parent link="base"/><child link="arm"/><axis xyz="0 1 0"/>
    <origin xyz="0 0 ${2 * length}"/><limit lower="-1" upper="1" effort="5" velocity="2"/></joint>
</robot>"""
LINKS = """<robot xmlns:xacro="http://www.ros.org/wiki/xacro">
  <xacro:macro name="arm" params="name mass">
    <link name="${name}"><inertial><origin xyz="0 0 0.1"/><mass value="${mass}"/>
      <inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial>
      <visual><geometry><mesh filename="package://shapes/box.stl"/></geometry></visual></link>
  </xacro:macro>
</robot>"""
SAYS = "xacro says: "
CURE = "; fix the file, or give what it needs by `arguments` and `packages`"


@pytest.fixture
def arm(tmp_path):
    """The path of a xacro file, written from a text, with what it includes and the folder of a package."""
    (tmp_path / "parts").mkdir()
    (tmp_path / "parts" / "links.xacro").write_text(LINKS)
    (tmp_path / "meshes").mkdir()

    def write(text=ARM, name="arm.urdf.xacro"):
        file = tmp_path / name
        file.write_text(text)
        return file

    write.packages = {"shapes": tmp_path / "meshes"}
    return write


def test_a_file_is_expanded_with_arguments(arm):
    file = arm()
    assert rne.load(file, packages=arm.packages).model.mass.tolist() == [2]
    robot = rne.load(str(file), arguments={"mass": 3.5}, packages=arm.packages)
    assert robot.model.mass.tolist() == [3.5]
    assert robot.model.translation.tolist() == [[0, 0, 0.6]]
    assert robot.effort_limit.tolist() == [5]


def test_an_argument_that_a_file_does_not_declare_is_used_where_it_stands(arm):
    file = arm(ARM.replace('<xacro:arg name="mass" default="2"/>', ""))
    assert rne.load(file, arguments={"mass": 3.5}, packages=arm.packages).model.mass.tolist() == [3.5]


def test_meshes_of_packages_are_shown(arm, tmp_path):
    trimesh = pytest.importorskip("trimesh")
    from rne.plotting.shapes import link_shapes

    trimesh.creation.box((0.1, 0.2, 0.3)).export(tmp_path / "meshes" / "box.stl")
    (shape,) = link_shapes(rne.load(arm(), packages=arm.packages).model)
    assert [shape.link, shape.kind] == ["arm", "mesh"]
    assert shape.mesh.volume == pytest.approx(0.006, rel=1e-6)  # float32


def test_packages_are_those_of_the_call(arm):
    rne.load(arm(), packages=arm.packages)
    with pytest.raises(
        rne.UrdfError,
        match=rf"arm.urdf.xacro: file: {SAYS}PackageNotFoundError: (Package not found: )?shapes{re.escape(CURE)}$",
    ):
        rne.load(arm())


def test_packages_above_the_file_are_found(arm, tmp_path):
    (tmp_path / "package.xml").write_text("<package><name>shapes</name></package>")
    assert rne.load(arm()).n == 1


ERRORS = {
    "undefined argument": (
        ARM.replace('<xacro:arg name="mass" default="2"/>', ""),
        "Undefined substitution argument mass",
    ),
    "no such property": (ARM.replace("2 * length", "2 * lengt"), "name 'lengt' is not defined"),
    "division by zero": (ARM.replace("2 * length", "1 / 0"), "division by zero"),
    "no such file": (ARM.replace("parts/links", "links"), "No such file or directory"),
    "no such macro": (ARM.replace("<xacro:arm ", "<xacro:arn "), "unknown macro name: xacro:arn"),
    "hidden characters": (ARM.replace("2 * length", "\u202e2 * length"), r"'\u202e2 * length'"),
    "truncated": (ARM[:300], "unclosed token"),
}


@pytest.mark.parametrize("name", ERRORS)
def test_an_error_of_xacro_names_the_file(name, arm):
    text, expected = ERRORS[name]
    file = arm(text)
    with pytest.raises(rne.UrdfError) as caught:
        rne.load(file, packages=arm.packages)
    message = str(caught.value)
    assert message.startswith(f"{file}: file: {SAYS}")
    assert expected in message
    assert message.endswith(CURE)
    assert len(message.splitlines()) == 1
    (finding,) = rne.check(file, packages=arm.packages, out=io.StringIO())
    assert str(finding) == f"error: {message}"


def test_an_error_of_the_urdf_names_the_xacro_file_without_a_line(arm):
    file = arm(ARM.replace('lower="-1" upper="1" ', 'lower="-1" upper="nan" '))
    with pytest.raises(rne.UrdfError, match=f"^{re.escape(str(file))}: joint 'elbow': attribute 'upper' of <limit>"):
        rne.load(file, packages=arm.packages)


def test_arguments_that_a_file_does_not_use_are_refused(arm):
    file = arm()
    with pytest.raises(ValueError, match=r"^`arguments` has 'mas', 'x', which .*arm.urdf.xacro does not use$"):
        rne.load(file, arguments={"mas": 1, "x": 2, "mass": 3}, packages=arm.packages)


@pytest.mark.parametrize("given", [{"arguments": {"mass": 1}}, {"packages": {"shapes": "."}}])
def test_other_files_have_no_arguments(given):
    for source in ("robots/irb140.urdf", "irb140"):
        expected = f"^`arguments` and `packages` are for files that end in .xacro, got '{source}'$"
        for function in (rne.load, rne.check):
            with pytest.raises(ValueError, match=expected):
                function(source, **given)


def test_arguments_are_mappings(arm):
    with pytest.raises(TypeError, match=r"^`arguments` and `packages` must be mappings from names, got list$"):
        rne.load(arm(), arguments=["mass:=3"])


def test_only_a_file_that_ends_in_xacro_is_run(arm):
    """A program in a file of another name is not."""
    with pytest.raises(rne.UrdfError, match="is a xacro file, not yet a URDF"):
        rne.load(arm(name="arm.urdf"))


def test_check_finds_what_is_wrong_with_the_robot_that_is_made(arm, capsys):
    file = arm()
    assert rne.check(file, packages=arm.packages) == []
    findings = rne.check(file, arguments={"mass": 1e6}, packages=arm.packages, out=io.StringIO())
    assert "link 'arm': mass and inertia are those of a body denser than any metal" in str(findings[-1])
    assert {finding.line for finding in findings} == {None}


def test_without_xacrodoc_how_to_expand_the_file_is_said(arm, monkeypatch):
    monkeypatch.setitem(sys.modules, "xacrodoc", None)
    with pytest.raises(
        rne.UrdfError, match=r"is a xacro file, not yet a URDF.*expand it: xacro .*arm.urdf.xacro > .*arm.urdf$"
    ):
        rne.load(arm())


def test_of_a_file_of_macros_alone_their_names_are_said(arm):
    expected = "robot: there is no <link>, as no macro is called; it defines 'arm'; give a file that includes this one"
    with pytest.raises(
        rne.UrdfError, match=rf"^{re.escape(str(arm(LINKS, 'links.xacro')))}: {expected} and calls them$"
    ):
        rne.load(arm(LINKS, "links.xacro"))
