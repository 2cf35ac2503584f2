"""rne check: what a file probably does not mean, in these words; nothing of it in sound files; alike findings together."""

import io
import re
import sys
from dataclasses import replace

import numpy as np
import pytest
from lxml import etree

import rne
from rne.__main__ import main
from rne.urdf.loading import urdf_files
from rne.urdf.plausibility import bodies, robot_size
from rne.urdf.read import parts_of

from .helpers import kept

INERTIA = '<inertia ixx="{0}" ixy="0" ixz="0" iyy="{0}" iyz="0" izz="{0}"/>'


def link(name, mass="1", inertia="0.001", origin="", shape=""):
    return f'<link name="{name}"><inertial>{origin}<mass value="{mass}"/>{INERTIA.format(inertia)}</inertial>{shape}</link>'


def joint(name, parent, child, kind="revolute", rpy="0 0 0", lower="-1", upper="1", effort="5", velocity="2", more=""):
    return (
        f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>'
        f'<origin xyz="0 0 0.5" rpy="{rpy}"/>'
        f'<limit lower="{lower}" upper="{upper}" effort="{effort}" velocity="{velocity}"/>{more}</joint>'
    )


def solid(geometry, kind="visual"):
    return f"<{kind}><geometry>{geometry}</geometry></{kind}>"


BASE = '<link name="base"/>'
SOUND = [BASE, link("arm"), joint("elbow", "base", "arm"), link("hand"), joint("wrist", "arm", "hand")]
FAR_OUT = '<origin xyz="3 0 4"/>'
BALL = '<sphere radius="0.05"/>'


@pytest.fixture
def check(tmp_path, monkeypatch, capsys):
    """What is printed about a robot of one element per line, from line 2, in the file r.urdf of the current folder."""
    monkeypatch.chdir(tmp_path)

    def check(elements, name="r.urdf", **options):
        text = "\n".join(['<robot name="r">', *elements, "</robot>"]) if isinstance(elements, list) else elements
        (tmp_path / name).write_text(text, encoding="utf-8")
        findings = rne.check(tmp_path / name, **options)
        printed = capsys.readouterr().out.splitlines()
        if all(finding.severity == "warning" for finding in findings):
            rne.load(tmp_path / name)
        return printed

    return check


def test_a_sound_robot_has_no_findings(check):
    assert check(SOUND) == ["r.urdf: no findings"]


def changed(position, element):
    return [element if k == position else old for k, old in enumerate(SOUND)]


FOUND = {
    "degrees of a joint's origin": (
        changed(2, joint("elbow", "base", "arm", rpy="0 90 0")),
        "4: joint 'elbow': attribute 'rpy' of <origin> looks like degrees: '0 90 0'; give radians: degrees times pi/180",
    ),
    "degrees of a centre of mass": (
        changed(1, link("arm", origin='<origin rpy="0 0 -45"/>')),
        "3: link 'arm': attribute 'rpy' of <origin> looks like degrees: '0 0 -45'; give radians: degrees times pi/180",
    ),
    "degrees of a visual": (
        changed(1, link("arm", shape=f'<visual><origin rpy="180 0 0"/><geometry>{BALL}</geometry></visual>')),
        "3: link 'arm': attribute 'rpy' of <origin> looks like degrees: '180 0 0'; give radians: degrees times pi/180",
    ),
    "degrees of a range": (
        changed(2, joint("elbow", "base", "arm", lower="-170", upper="170")),
        "4: joint 'elbow': the range of <limit> looks like degrees: -170 to 170; give radians: degrees times pi/180",
    ),
    "no torque": (
        changed(2, joint("elbow", "base", "arm", effort="0")),
        "4: joint 'elbow': attribute 'effort' of <limit> is 0; give what the drive can do; as written it can do nothing",
    ),
    "no speed": (
        changed(2, joint("elbow", "base", "arm", velocity="0.0")),
        "4: joint 'elbow': attribute 'velocity' of <limit> is 0; give what the drive can do; as written it can do nothing",
    ),
    "neither torque nor speed": (
        changed(2, joint("elbow", "base", "arm", effort="0", velocity="0")),
        "4: joint 'elbow': attributes 'effort' and 'velocity' of <limit> are 0; give what the drive can do; as written it "
        "can do nothing",
    ),
    "centre of mass in millimetres": (
        changed(1, link("arm", origin='<origin xyz="300 0 0"/>')),
        "3: link 'arm': the centre of mass is far outside the robot: 300 m from the link's origin, the robot measures 1 m; "
        "check <origin> of <inertial>: metres",
    ),
    # 1 kg in a ball of I = 2/5 m r^2 = 0.4 kg m^2, r = 1 m: 0.24 kg/m^3.
    "inertia of a ball of air": (
        changed(1, link("arm", inertia="0.4")),
        "3: link 'arm': mass and inertia are those of a body lighter than air: 0.24 kg/m^3; check ixx ... izz: kg m^2",
    ),
    "inertia of a ball of air that is large": (
        changed(3, link("hand", mass="2", inertia="8", shape=f'<collision><origin xyz="0 0 1"/><geometry>{BALL}</geometry></collision>')),
        "5: link 'hand': mass and inertia are those of a body lighter than air: 0.015 kg/m^3; check ixx ... izz: kg m^2; is "
        "the file in millimetres? give metres",
    ),
    "link in millimetres": (
        [*SOUND[:2], joint("elbow", "base", "arm", effort="1e4"), SOUND[3], joint("wrist", "arm", "hand").replace("0 0 0.5", "0 300 0")],
        "6: joint 'wrist': the <origin> makes a link longer than 20 m: 300 m; is the file in millimetres? give metres",
    ),
    # 20 kg on a horizontal lever of 0.25 m at most: 49.05 N m.
    "effort in kN m": (
        [BASE, link("arm", mass="20", inertia="0.2", origin='<origin xyz="0 0.25 0"/>'), joint("elbow", "base", "arm", effort="0.05")],
        "4: joint 'elbow': the drive cannot carry the robot's weight: 49.03 N m or N of 0.05; check masses, lengths and "
        "'effort' of <limit>",
    ),
    "inertia in kg mm^2": (
        changed(1, link("arm", inertia="1000")),
        "3: link 'arm': mass and inertia are those of a body larger than the robot: radius of gyration 31.6 m, the robot "
        "measures 1 m; check ixx ... izz: kg m^2 about the centre of mass",
    ),
    # A solid sphere with I = 2/5 m r^2 = 0.001 kg m^2 and 2500 kg has r = 1 mm: 2500 kg / (4/3 pi 1e-9 m^3).
    "mass in grams": (
        changed(1, link("arm", mass="2500")),
        "3: link 'arm': mass and inertia are those of a body denser than any metal: 6e+11 kg/m^3; check the units of "
        "<mass> and <inertia>: kg and kg m^2",
    ),
    # 100 kg / (0.1 m)^3 = 1e5 kg/m^3; a point mass says nothing of its size.
    "mass of a small box": (
        changed(1, link("arm", mass="100", inertia="0", shape=solid('<box size="0.1 0.1 0.1"/>'))),
        "3: link 'arm': the mass makes its shapes denser than any metal: 1e+05 kg/m^3; check the units of <mass> and of "
        "the shapes: kg and m",
    ),
    # 0.5 kg / (pi (0.5 m)^2 2 m) = 0.32 kg/m^3
    "mass of a large cylinder": (
        changed(1, link("arm", mass="0.5", inertia="0.001", shape=solid('<cylinder radius="0.5" length="2"/>', "collision"))),
        "3: link 'arm': the mass makes its shapes lighter than air: 0.32 kg/m^3; check the units of <mass> and of the "
        "shapes: kg and m",
    ),
}  # fmt: skip


@pytest.mark.parametrize("case", FOUND)
def test_what_is_probably_not_meant_is_a_warning_in_these_words(case, check):
    elements, message = FOUND[case]
    assert check(elements) == [f"warning: r.urdf:{message}", "r.urdf: 1 warning: loads as written"]


NOT_FOUND = {
    "full turn": changed(2, joint("elbow", "base", "arm", rpy="6.283185307179586 -6.283185307179586 0")),
    "two turns": changed(2, joint("elbow", "base", "arm", lower="-12.5664", upper="12.5664")),
    "robot far from the origin of the world": [
        BASE, link("cell", inertia="0"), '<joint name="w" type="fixed"><parent link="base"/><child link="cell"/><origin xyz="99 0 0"/></joint>',
        link("arm"), joint("elbow", "cell", "arm").replace("0 0 0.5", "0 50 0"),
    ],
    "axis that bears no weight": [BASE, link("arm", mass="20", inertia="0.1", origin='<origin xyz="0.3 0 0"/>'), joint("elbow", "base", "arm", effort="1e-3")],
    "rod of 2 m": changed(1, link("arm").replace(INERTIA.format("0.001"), '<inertia ixx="0.4" ixy="0" ixz="0" iyy="0.4" iyz="0" izz="0"/>')),
    "winch": changed(2, joint("elbow", "base", "arm", lower="0", upper="1000")),
    "long slide": changed(2, joint("elbow", "base", "arm", kind="prismatic", lower="0", upper="20")),
    "mimic without a drive": [
        *SOUND,
        link("finger"),
        joint("f", "hand", "finger", effort="0", velocity="0", more='<mimic joint="wrist"/>'),
    ],
    "iron ball": changed(1, link("arm", mass="4", inertia="0.004", shape=solid(BALL))),
    "point mass": changed(1, link("arm", inertia="0")),
    "point mass with rounding error": changed(1, link("arm", inertia="1e-20")),
    "placeholder": changed(1, link("arm", mass="1e-6", inertia="1", shape=solid('<box size="1 1 1"/>'))),
    "mesh beside a small box": changed(
        1,
        link("arm", mass="100", inertia="0", shape=solid('<box size="0.01 0.01 0.01"/>') + solid('<mesh filename="a"/>')),
    ),
    "robot that slides far": [
        BASE,
        link("arm", origin='<origin xyz="0 0 40"/>'),
        joint("elbow", "base", "arm", kind="prismatic", lower="0", upper="20"),
    ],
    "pole on a small car": [BASE, link("arm", inertia="0.1", origin='<origin xyz="0 0 1.5"/>'), joint("elbow", "base", "arm")],
}  # fmt: skip


@pytest.mark.parametrize("case", NOT_FOUND)
def test_what_may_be_meant_is_no_finding(case, check):
    assert check(NOT_FOUND[case]) == ["r.urdf: no findings"]


def test_a_robot_in_numbers_too_large_to_square_is_no_error_of_the_check(check):
    """Nor of what is not read otherwise, such as the sides of a box."""
    box = solid('<box size="1e200 1e200 1e999"/>') + solid('<sphere radius="1e200"/>', "collision")
    printed = check(changed(1, link("arm", inertia="1e300", origin='<origin xyz="1e150 0 0"/>', shape=box)))
    assert printed[-1].startswith("r.urdf: ")


@pytest.mark.parametrize("k", np.flatnonzero(rne.irb140().mass))
def test_every_mass_of_the_irb140_in_grams_is_seen(k, check):
    model = rne.irb140()
    masses = model.mass.copy()
    masses[k] *= 1000
    printed = check(rne.to_urdf(replace(model, mass=masses)))
    assert printed[-1] == "r.urdf: 1 warning: loads as written"
    assert "denser than any metal" in printed[0]


MASS = [
    BASE,
    *(element for k in range(12) for element in (link(f"l{k}"), joint(f"j{k}", f"l{k - 1}" if k else "base", f"l{k}"))),
]


@pytest.mark.parametrize(("excess", "lines"), [(1e-7, 1), (1e-5, 2)])
def test_moments_beyond_the_triangle_are_warned_of_beyond_the_decimals_of_files(excess, lines, check):
    """Relative to the trace: a largest moment above the sum of the others by rounding of six decimals is none."""
    moments = np.array([1.0, 1.0, 2 * (1 + 2 * excess)]) * 1e-3
    text = "".join(f' i{a}{a}="{x:.17g}"' for a, x in zip("xyz", moments, strict=True))
    inertial = f'<inertial><mass value="1"/><inertia{text} ixy="0" ixz="0" iyz="0"/></inertial>'
    assert len(check(changed(1, f'<link name="arm">{inertial}</link>'))) == lines


def placed(geometry, xyz="0 0 0", rpy="0 0 0", kind="visual"):
    return f'<{kind}><origin xyz="{xyz}" rpy="{rpy}"/><geometry>{geometry}</geometry></{kind}>'


def measured(shapes, mass="8", inertia="0.064", origin='<origin xyz="0.3 0 0.4"/>'):
    root = etree.fromstring(f"<robot>{link('arm', mass, inertia, origin, shapes)}</robot>")
    (body,) = bodies(root, parts_of(root))
    return body


def test_numbers_of_a_body_are_those_of_its_mass_and_inertia():
    body = measured("")
    assert (body.mass, body.com, body.reach, body.shapes) == (8.0, 0.5, 0.0, None)
    assert body.radius_of_gyration == pytest.approx(np.sqrt(0.064 / 8))
    radius = np.sqrt(5 / 2 * 0.064 / 8)  # a ball: I = 2/5 m r^2
    assert body.density == pytest.approx(8 / (4 / 3 * np.pi * radius**3))
    assert measured("", mass="0").density == measured("", inertia="1e-13").density == 0
    rod = '<inertial><mass value="2"/><inertia ixx="2" ixy="0" ixz="0" iyy="2" iyz="0" izz="0"/></inertial>'
    root = etree.fromstring(f'<robot><link name="rod">{rod}</link></robot>')
    (body,) = bodies(root, parts_of(root))
    axes = np.sqrt(5) * np.array([1, 0.1, 0.1])  # as thick as a tenth of its length
    assert body.density == pytest.approx(2 / (4 / 3 * np.pi * axes.prod()))


def test_shapes_of_a_body_are_in_the_box_around_them_all():
    box, ball = '<box size="0.2 0.4 0.6"/>', '<sphere radius="0.1"/>'
    body = measured(placed(box, "1 0 0") + placed(ball, "0 0 -1"))
    assert body.reach == pytest.approx(np.linalg.norm([1.1, 0.2, 0.3]))
    low, high = np.array([-0.1, -0.2, -1.1]), np.array([1.1, 0.2, 0.3])
    assert body.shapes.surrounding_volume == pytest.approx((high - low).prod())
    assert body.shapes.radius == pytest.approx(np.linalg.norm(high - low) / 2)
    assert body.shapes.largest_volume == pytest.approx(0.2 * 0.4 * 0.6)


def test_a_turned_cylinder_is_in_the_turned_box():
    turned = placed('<cylinder radius="0.1" length="1"/>', rpy=f"{np.pi / 2} 0 0")
    body = measured(turned)
    assert body.shapes.surrounding_volume == pytest.approx(0.2 * 0.2 * 1)
    assert body.reach == pytest.approx(np.linalg.norm([0.1, 0.5, 0.1]))
    assert body.shapes.largest_volume == pytest.approx(np.pi * 0.1**2)


def test_of_visuals_and_collisions_those_count_that_accuse_less():
    small, large = '<box size="0.1 0.1 0.1"/>', '<sphere radius="0.5"/>'
    both = measured(placed(small) + placed(large, kind="collision"))
    assert both.shapes.largest_volume == pytest.approx(1e-3)
    assert both.shapes.surrounding_volume == pytest.approx(1.0)


@pytest.mark.parametrize("shape", ['<mesh filename="a"/>', '<box size="1 1"/>', "", '<sphere radius="one"/>'])
def test_shapes_that_are_not_known_are_no_evidence(shape):
    assert measured(placed('<box size="2 2 2"/>') + placed(shape)).shapes is None


def test_the_size_of_a_robot_is_its_longest_way_with_strokes():
    slide = joint("s", "arm", "hand", kind="prismatic", lower="-3", upper="2")
    text = f"<robot>{BASE}{link('arm')}{joint('e', 'base', 'arm')}{link('hand', origin=FAR_OUT)}{slide}</robot>"
    root = etree.fromstring(text)
    parts = parts_of(root)
    assert robot_size(parts, bodies(root, parts)) == pytest.approx(0.5 + 0.5 + 3)
    assert robot_size(parts, bodies(root, parts), with_coms=True) == pytest.approx(0.5 + 0.5 + 3 + 5)


def test_findings_of_one_kind_are_one_line_that_names_the_joints(check):
    more = '<dynamics D="1" K="7000"/>'
    elements = [BASE]
    for k in range(3):
        elements += [
            link(f"l{k}"),
            joint(f"j{k}", f"l{k - 1}" if k else "base", f"l{k}", rpy=f"0 {90 + k} 0", more=more),
        ]
    elements[2] = elements[2].replace(' K="7000"', "")
    assert check(elements) == [
        "warning: r.urdf:4: joint 'j0': unknown attribute 'D' of <dynamics> is ignored; remove it",
        "warning: r.urdf:4: joints 'j0' ('0 90 0'), 'j1' ('0 91 0'), 'j2' ('0 92 0'): attribute 'rpy' of <origin> looks "
        "like degrees; give radians: degrees times pi/180",
        "warning: r.urdf:6: joints 'j1', 'j2': unknown attributes 'D', 'K' of <dynamics> are ignored; remove them",
        "r.urdf: 6 warnings: loads as written",
    ]


def test_findings_one_by_one(check):
    elements = [BASE, link("arm"), joint("elbow", "base", "arm", effort="0", rpy="0 90 0"), "<colour/>", "<colour/>"]
    assert check(elements, grouped=False) == [
        "warning: r.urdf:4: joint 'elbow': attribute 'rpy' of <origin> looks like degrees: '0 90 0'; give radians: degrees "
        "times pi/180",
        "warning: r.urdf:4: joint 'elbow': attribute 'effort' of <limit> is 0; give what the drive can do; as written it "
        "can do nothing",
        "warning: r.urdf:5: robot: unknown element 'colour' in <robot> is ignored; remove it",
        "warning: r.urdf:6: robot: unknown element 'colour' in <robot> is ignored; remove it",
        "r.urdf: 4 warnings: loads as written",
    ]
    assert (
        check(elements)[2]
        == "warning: r.urdf:5: robot (2 times): unknown element 'colour' in <robot> is ignored; remove it"
    )


def test_more_than_ten_names_are_counted(check):
    elements = [element.replace('effort="5"', 'effort="0"') for element in MASS]
    names = ", ".join(f"'j{k}'" for k in range(10))
    assert check(elements)[0] == (
        f"warning: r.urdf:4: joints {names} and 2 more: attribute 'effort' of <limit> is 0; give what the drive can do; "
        "as written it can do nothing"
    )


def test_findings_are_in_the_order_of_the_lines(check, tmp_path):
    elements = [
        "<colour/>",
        BASE,
        joint("elbow", "base", "arm", rpy="0 90 0"),
        link("arm", mass="-1"),
        joint("wrist", "arm", "hand", lower="1", upper="-1"),
        link("hand"),
    ]
    printed = check(elements)
    assert [int(line.split(":")[2]) for line in printed[:-1]] == [2, 4, 5, 6]
    assert printed[-1] == "r.urdf: 1 error, 3 warnings: does not load"
    lines = [finding.line for finding in rne.check(tmp_path / "r.urdf", out=io.StringIO())]
    assert lines == [2, 4, 5, 6]


def test_a_path_is_relative_to_the_current_folder_where_it_is_below_it(tmp_path, monkeypatch, capsys):
    (tmp_path / "robots").mkdir()
    file = tmp_path / "robots" / "r.urdf"
    file.write_text('<robot name="r"><link name="base"/></robot>')
    monkeypatch.chdir(tmp_path)
    rne.check(file)
    assert capsys.readouterr().out == "robots/r.urdf: no findings\n"
    (tmp_path / "other").mkdir()
    monkeypatch.chdir(tmp_path / "other")
    rne.check(file)
    assert capsys.readouterr().out == f"{file}: no findings\n"


XACRO = '<robot name="r" xmlns:xacro="http://{}">\n{}\n<link name="base"/></robot>'
EXPAND = {
    "arm.urdf.xacro": "xacro arm.urdf.xacro > arm.urdf",
    "arm.xacro": "xacro arm.xacro > arm.urdf",
    "arm.urdf": "xacro arm.urdf > arm_expanded.urdf",
    "my arm.xacro": "xacro 'my arm.xacro' > 'my arm.urdf'",
}


@pytest.mark.parametrize("name", EXPAND)
def test_of_a_xacro_file_how_to_expand_it_is_said_and_nothing_else(name, check, monkeypatch):
    monkeypatch.setitem(sys.modules, "xacrodoc", None)  # with it, the file is expanded: tests/test_xacro.py
    inside = '<xacro:macro name="m"><link name="arm"/></xacro:macro><link name="arm" colour="red"/><xacro:m/>'
    assert check(XACRO.format("www.ros.org/wiki/xacro", inside), name) == [
        f"error: {name}:2: file: is a xacro file, not yet a URDF: there is <xacro:m>; expand it: {EXPAND[name]}",
        f"{name}: 1 error: does not load",
    ]


@pytest.mark.parametrize("value", ["${mass}", "$(arg mass)"])
def test_a_value_that_xacro_fills_in_says_so(value, check):
    printed = check(changed(1, link("arm", mass=value)))
    expected = f"there is '{value}'; expand it: xacro r.urdf > r_expanded.urdf"
    assert printed[0] == f"error: r.urdf:3: file: is a xacro file, not yet a URDF: {expected}"


def test_the_namespace_of_xacro_alone_is_no_finding(check):
    assert check(XACRO.format("ros.org/wiki/xacro", "")) == ["r.urdf: no findings"]


MOVES = link("arm") + joint("elbow", "base", "arm")
UNUSED = "is left over from xacro and not read; remove it"
ELSEWHERE = "is not expanded, and not read; expand it for others"
LEFT = {
    "property": (MOVES + '<xacro:property name="m" value="${2 * n}"/>', f"robot: <xacro:property> {UNUSED}"),
    "arg": (MOVES + '<xacro:arg name="m" default="$(find p)"/>', f"robot: <xacro:arg> {UNUSED}"),
    "include": (MOVES + '<xacro:include filename="$(find p)/a.xacro"/>', f"robot: <xacro:include> {UNUSED}"),
    "macro": (MOVES + '<xacro:macro name="m"><link name="${p}"/><xacro:n/></xacro:macro>', f"robot: <xacro:macro> {UNUSED}"),
    "call in a visual": ('<link name="base"><visual><xacro:grey/></visual></link>', f"link 'base': <xacro:grey> in <visual> {ELSEWHERE}"),
    "condition in a collision": ('<link name="base"><collision><xacro:if/></collision></link>', f"link 'base': <xacro:if> in <collision> {ELSEWHERE}"),
    "call in gazebo": ("<gazebo><xacro:camera/></gazebo>", f"robot: <xacro:camera> in <gazebo> {ELSEWHERE}"),
    "value in gazebo": ('<gazebo><plugin path="$(env HOME)"/></gazebo>', f"robot: '$(env HOME)' of <plugin> {ELSEWHERE}"),
    "text in gazebo": ("<gazebo><rate>${r}</rate></gazebo>", f"robot: '${{r}}' of <rate> {ELSEWHERE}"),
    "value of a mesh": (
        '<link name="base"><visual><geometry><mesh filename="$(find p)/a.stl"/></geometry></visual></link>',
        f"link 'base': '$(find p)/a.stl' of <mesh> {ELSEWHERE}",
    ),
}  # fmt: skip


@pytest.mark.parametrize("namespace", [' xmlns:xacro="http://ros.org/wiki/xacro"', ""])
@pytest.mark.parametrize("name", LEFT)
def test_what_xacro_leaves_where_nothing_is_read_is_a_warning(name, namespace, check):
    inside, message = LEFT[name]
    base = "" if "base" in inside and "joint" not in inside else BASE
    printed = check(f'<robot name="r"{namespace}>\n{base}{inside}</robot>')
    assert printed == [f"warning: r.urdf:2: {message}", "r.urdf: 1 warning: loads as written"]


HALF = {
    "<xacro:inertia_of_box>": link("arm").replace("<inertial>", "<inertial><xacro:inertia_of_box/>"),
    "<xacro:box>": link("arm", shape="<xacro:box/>"),
}


@pytest.mark.parametrize("call", HALF)
def test_of_a_half_expanded_file_the_element_is_named(call, check):
    """xacro does not know these macros either, so that to expand the file again ends in an error of xacro."""
    printed = check(XACRO.format("ros.org/wiki/xacro", HALF[call] + joint("elbow", "base", "arm")))
    told = f"is half expanded: {call} is left in link 'arm', a macro that the file does not define"
    assert printed[0] == f"error: r.urdf:2: file: {told}; write what it stands for, or remove it"


@pytest.mark.parametrize(
    "inside",
    [
        '<xacro:include filename="arm.urdf"/>',  # which may hold the arm
        '<xacro:if value="1"><link name="a"/></xacro:if>',
        '<xacro:include filename="m.xacro"/><xacro:arm/>' + MOVES,
    ],
)
def test_what_xacro_would_still_fill_in_is_an_error(inside, check):
    assert "is a xacro file, not yet a URDF" in check(XACRO.format("ros.org/wiki/xacro", inside))[0]


TALOS = ("full_v2", "full_v2_box", "reduced", "reduced_box", "reduced_corrected")
PLACEHOLDERS = {  # every file of example-robot-data in which a body, a range or an angle is doubted; each was looked at
    # Cubes of 1 cm or less that stand for real parts.
    "anymal_b_simple_description/anymal-kinova": ["denser"],
    "finger_edu_description/finger_edu": ["denser"],
    "tiago_pro_description/tiago_pro": ["denser"],
    # The unit matrix for an inertia.
    "double_pendulum_description/double_pendulum_simple": ["larger"],
    # Inertias that were enlarged: fingers of 0.1 kg with those of bodies of 1 m, frames of cameras, soles, wrists.
    "baxter_description/baxter": ["denser", "lighter"],
    "pr2_description/pr2": ["lighter"],
    "simple_humanoid_description/simple_humanoid": ["lighter"],
    "simple_humanoid_description/simple_humanoid_classical": ["lighter"],
    **{f"talos_data/talos_{name}": ["lighter"] for name in TALOS},
    # Both, a laser and a camera as points, and a column of 0.3 kg in a box of 0.6 m^3.
    "tiago_description/tiago": ["denser", "denser", "lighter", "lighter"],
    "tiago_description/tiago_dual": ["denser", "denser", "lighter", "lighter"],
    "tiago_description/tiago_no_hand": ["denser", "denser", "lighter"],
}
DOUBTS = re.compile(r"looks like degrees|far outside|larger than the robot|denser|lighter|longer|cannot")


LOOKED_AT = ["ur_description/ur5_robot", "panda_description/panda", "finger_edu_description/finger_edu"]
LOOKED_AT += ["double_pendulum_description/double_pendulum_simple"]


@pytest.mark.parametrize("name", kept(list(urdf_files()), LOOKED_AT))
def test_no_false_alarm_on_a_robot_of_example_robot_data(name):
    messages = {f.kind for f in rne.check(urdf_files()[name], out=io.StringIO())}
    doubts = sorted(match.group().split()[0] for match in map(DOUBTS.search, messages) if match)
    assert doubts == PLACEHOLDERS.get(name, [])


def test_every_robot_of_example_robot_data_is_looked_at():
    assert len(urdf_files()) > 60
    assert set(LOOKED_AT) <= set(urdf_files())


def test_the_panda_is_two_lines(capsys):
    assert main(["check", "panda"]) == 0
    finding, summary = capsys.readouterr().out.splitlines()
    joints = ", ".join(f"'panda_joint{k}'" for k in range(1, 8))
    message = "unknown attributes 'D', 'K', 'mu_coulomb', 'mu_viscous' of <dynamics> are ignored; remove them"
    assert finding.endswith(f"panda.urdf:48: joints {joints}: {message}")
    assert summary.endswith("panda.urdf: 7 warnings: loads as written")
    assert main(["check", "--all", "panda"]) == 0
    assert len(capsys.readouterr().out.splitlines()) == 8


def test_a_misspelt_element_is_answered_with_the_near_one(tmp_path, capsys):
    path = tmp_path / "arm.urdf"
    path.write_text(
        '<robot name="arm">\n<link name="base"/>\n<link name="rod"><inertial><mass value="1"/><inertia ixx="0.1" ixy="0" '
        'ixz="0" iyy="0.1" iyz="0" izz="0.1"/></inertial></link>\n<joint name="turn" type="continuous"><parent link="base"/>'
        '<child link="rod"/>\n<axes xyz="0 0 1"/></joint></robot>'
    )
    rne.check(path)
    finding, _ = capsys.readouterr().out.splitlines()
    told = "arm.urdf:5: joint 'turn': unknown element 'axes' in <joint> is ignored; remove it, or write <axis> if that is meant"
    assert finding.endswith(told)


def ball_of(density):
    radius = (3 / (4 * np.pi * density)) ** (1 / 3)
    return f"{2 / 5 * radius**2:.17g}"


BOUNDS = {  # of the robot of 1 m
    "a centre of mass at five times the size": lambda x: link("arm", origin=f'<origin xyz="{5 * x} 0 0"/>'),
    "a radius of gyration of twice the size": lambda x: link("arm", mass="1e3", inertia=f"{1e3 * (2 * x) ** 2}"),
    "lighter than air": lambda x: link("arm", inertia=ball_of(1 / x)),
    "densest metal": lambda x: link("arm", inertia=ball_of(23e3 * x)),
    "air": lambda x: link("arm", mass=f"{1.2 / x}", inertia="0.1", shape=solid('<box size="1 1 1"/>')),
    "densest metal of a shape": lambda x: link(
        "arm", mass=f"{23 * x}", inertia="0", shape=solid('<box size="0.1 0.1 0.1"/>')
    ),
    "a frame of a gram": lambda x: link("arm", mass=f"{1e-3 * x}", inertia="1e-12"),
}


@pytest.mark.parametrize("case", BOUNDS)
def test_bounds_are_where_the_documentation_says(case, check):
    assert check(changed(1, BOUNDS[case](0.999))) == ["r.urdf: no findings"]
    assert check(changed(1, BOUNDS[case](1.001)))[-1] == "r.urdf: 1 warning: loads as written"


def test_the_size_that_an_inertia_is_compared_with_counts_centres_of_mass(check):
    """A radius of gyration of 3 m is large for a robot of 1 m, and not for one whose centre of mass is 4 m away."""
    for x, findings in ((0.0, "1 warning: loads as written"), (4.0, "no findings")):
        arm = link("arm", mass="1e3", inertia="9e3", origin=f'<origin xyz="{x} 0 0"/>')
        assert check(changed(1, arm))[-1] == f"r.urdf: {findings}"


def test_volumes_of_balls_are_theirs():
    assert measured(placed('<sphere radius="0.5"/>')).shapes.largest_volume == pytest.approx(np.pi / 6)


def test_a_robot_that_was_built_is_examined_as_the_file_it_becomes(capsys):
    table = {"a": [400, 0.2], "alpha": [0, 0], "d": [0, 0], "theta": [0, 0]}
    bodies_of = {"masses": [1, 1], "centres": [[0, 0, 0]] * 2, "inertias": [[0.001, 0.001, 1]] * 2}
    model = rne.dh_chain(**table, **bodies_of, lower=[1, 0], upper=[-1, 1], name="odd")
    assert rne.check(model) == rne.check(rne.Robot(model))
    first, second = np.array_split(capsys.readouterr().out.splitlines(), 2)
    assert first.tolist() == second.tolist()
    assert first[0].startswith(
        "warning: odd: links 'link_1', 'link_2': <inertia>: the largest principal moment exceeds"
    )
    assert first[1:3].tolist() == [
        "warning: odd: joint 'joint_1': <limit>: lower 1 is above upper -1; exchange them",
        "warning: odd: joint 'joint_2': the <origin> makes a link longer than 20 m: 400 m; is the file in millimetres? "
        "give metres",
    ]


@pytest.mark.parametrize("source", [None, 3, ["irb140"]])
def test_what_is_no_path_is_refused(source):
    text = f"`source` must be the path of a file or a name of rne.robots(), got {type(source).__name__}"
    for read in (rne.load, rne.check):
        with pytest.raises(TypeError, match=f"^{re.escape(text)}$"):
            read(source)


def test_the_root_may_be_a_world_that_has_no_link(tmp_path, capsys):
    """As Drake's files have it; another parent without a link is an error."""
    welded = '<joint name="weld" type="fixed"><parent link="world"/><child link="base"/></joint>'
    for name, inner in (("w.urdf", welded), ("v.urdf", f'<link name="world"/>{welded}')):
        (tmp_path / name).write_text(f'<robot name="r"><link name="base"/>{inner}</robot>')
    models = [rne.load(tmp_path / name).model for name in ("w.urdf", "v.urdf")]
    assert models[0].link_names == models[1].link_names == ("world", "base")
    (finding,) = rne.check(tmp_path / "w.urdf")
    assert str(finding).endswith(
        """w.urdf:1: joint 'weld': <parent> names 'world', which has no <link>; it is the fixed root; add <link name="world"/>"""
    )
    (tmp_path / "n.urdf").write_text(f'<robot name="r"><link name="base"/>{welded.replace("world", "floor")}</robot>')
    with pytest.raises(rne.UrdfError, match="<parent> names the unknown link 'floor'"):
        rne.load(tmp_path / "n.urdf")
