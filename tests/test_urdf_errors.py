"""Errors in a file name file, line, element and attribute; oddities are warnings. A file is untrusted input."""

import builtins
import io
import os
import re

import numpy as np
import pytest

import rne

from .helpers import Oracle

INERTIAL = '<inertial><mass value="1"/><inertia ixx="0.1" ixy="0" ixz="0" iyy="0.1" iyz="0" izz="0.1"/></inertial>'
POINT_MASS = (
    '<inertial><origin xyz="0 0 0.1"/><mass value="1"/>'
    '<inertia ixx="0" ixy="0" ixz="0" iyy="0" iyz="0" izz="0"/></inertial>'
)
LIMIT = '<limit lower="-1" upper="1" effort="1" velocity="1"/>'


def link(name, inside=INERTIAL):
    return f'<link name="{name}">{inside}</link>'


def joint(name, parent, child, kind="revolute", inside='<axis xyz="0 0 1"/>' + LIMIT):
    return f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>{inside}</joint>'


def robot(*elements, head='<?xml version="1.0"?>'):
    """One element per line, so that lines in messages are easy to see."""
    return "\n".join([head, '<robot name="r">', *elements, "</robot>"])


ARM = [link("base"), link("arm"), joint("elbow", "base", "arm")]


@pytest.fixture
def write(tmp_path):
    def write(text):
        path = tmp_path / "robot.urdf"
        path.write_bytes(text if isinstance(text, bytes) else text.encode())
        return path

    return write


ERRORS = {
    "not a robot": ("<sdf/>", ":1: file: the root element must be <robot>, got 'sdf'; give a URDF file"),
    "no link": ('<robot name="r"/>', ":1: robot: there is no <link>; a robot needs at least its root link"),
    "nan mass": (
        robot(link("base", INERTIAL.replace('value="1"', 'value="nan"'))),
        ":3: link 'base': attribute 'value' of <mass> must be one number, finite and decimal, got 'nan'; fix the attribute",
    ),
    "infinite mass": (
        robot(link("base", INERTIAL.replace('value="1"', 'value="1e999"'))),
        ":3: link 'base': attribute 'value' of <mass> must be one number, finite and decimal, got '1e999'; fix the attribute",
    ),
    "mass in other digits": (
        robot(link("base", INERTIAL.replace('value="1"', 'value="1_0"'))),
        ":3: link 'base': attribute 'value' of <mass> must be one number, finite and decimal, got '1_0'; fix the attribute",
    ),
    "two masses in one": (
        robot(link("base", INERTIAL.replace('value="1"', 'value="1 2"'))),
        ":3: link 'base': attribute 'value' of <mass> must be one number, got '1 2'; fix the attribute",
    ),
    "negative mass": (
        robot(link("base", INERTIAL.replace('value="1"', 'value="-1"'))),
        ":3: link 'base': attribute 'value' of <mass> must be 0 or positive, got '-1'; fix the mass",
    ),
    "no mass": (
        robot(link("base", INERTIAL.replace('<mass value="1"/>', ""))),
        ":3: link 'base': <mass> is missing in <inertial>; give it, or remove <inertial>",
    ),
    "no mass value": (
        robot(link("base", INERTIAL.replace('value="1"', ""))),
        ":3: link 'base': attribute 'value' of <mass> is missing; give one number",
    ),
    "missing ixx": (
        robot(link("base", INERTIAL.replace('ixx="0.1"', ""))),
        ":3: link 'base': attribute 'ixx' of <inertia> is missing; give one number",
    ),
    "no inertia": (
        robot(link("base", '<inertial><mass value="1"/></inertial>')),
        ":3: link 'base': <inertia> is missing in <inertial>; give it, or remove <inertial>",
    ),
    "negative inertia": (
        robot(link("base"), link("arm", INERTIAL.replace('ixx="0.1"', 'ixx="-0.1"')), ARM[2]),
        ":4: link 'arm': <inertia>: the inertia must have no negative eigenvalue, got -0.1 kg m^2; "
        "check signs and units of ixx ... izz",
    ),
    "negative inertia behind a fixed joint that moves": (
        robot(*ARM, link("hand", INERTIAL.replace('ixx="0.1"', 'ixx="-1e-9"')), joint("f", "arm", "hand", "fixed", "")),
        ":6: link 'hand': <inertia>: the inertia must have no negative eigenvalue, got -1e-09 kg m^2; "
        "check signs and units of ixx ... izz",
    ),
    "inertia row by row": (
        robot(link("base"), link("arm", INERTIAL.replace('ixy="0" ', 'ixy="-0.01" ').replace('iyy="0.1"', 'iyy="-0.01"')), ARM[2]),
        ":4: link 'arm': <inertia>: the inertia must have no negative eigenvalue, got -0.0109017 kg m^2; "
        "give ixx ixy ixz iyy iyz izz; these look like ixx ixy ixz iyx iyy iyz",
    ),
    "negative effort": (
        robot(*ARM[:2], joint("elbow", "base", "arm", inside=LIMIT.replace('effort="1"', 'effort="-5"'))),
        ":5: joint 'elbow': attribute 'effort' of <limit> must not be negative, got '-5'; leave it out for no limit",
    ),
    "negative velocity of a continuous joint": (
        robot(*ARM[:2], joint("elbow", "base", "arm", "continuous", inside='<limit effort="1" velocity="-0.5"/>')),
        ":5: joint 'elbow': attribute 'velocity' of <limit> must not be negative, got '-0.5'; leave it out for no limit",
    ),
    "infinite effort": (
        robot(*ARM[:2], joint("elbow", "base", "arm", inside=LIMIT.replace('effort="1"', 'effort="inf"'))),
        ":5: joint 'elbow': attribute 'effort' of <limit> must be one number, finite and decimal, got 'inf'; "
        "leave it out for no limit",
    ),
    "infinite ends of a range": (
        robot(*ARM[:2], joint("elbow", "base", "arm", inside=LIMIT.replace("-1", "-inf"))),
        ":5: joint 'elbow': attribute 'lower' of <limit> must be one number, finite and decimal, got '-inf'; "
        "write -1.7976931348623157e+308 for no end; left out it is 0",
    ),
    "macros alone": (
        '<robot name="r" xmlns:xacro="http://ros.org/wiki/xacro"><xacro:macro name="arm"/></robot>',
        ":1: robot: there is no <link>; give the expanded file of a robot that calls these macros",
    ),
    "link with an undeclared prefix": (
        robot(*ARM, '<x:link name="a"/>'),
        ":6: robot: the prefix of 'x:link' is not declared; add xmlns:x=\"...\" to <robot>, or write 'link' without it",
    ),
    "limit with an undeclared prefix": (
        robot(*ARM[:2], joint("elbow", "base", "arm", inside=LIMIT.replace("effort", "x:effort"))),
        ":5: joint 'elbow': the prefix of 'x:effort' is not declared; add xmlns:x=\"...\" to <robot>, "
        "or write 'effort' without it",
    ),
    "robot in capitals": ('<Robot name="r"/>', ":1: file: the root element must be <robot>, got 'Robot'; write <robot>"),
    "robot with a prefix": ('<x:robot/>', ":1: file: the root element must be <robot>, got 'x:robot'; write <robot>"),
    "two inertials": (
        robot(link("base", INERTIAL * 2)),
        ":3: link 'base': <inertial> is duplicated in <link>; keep one of them",
    ),
    "duplicate link": (
        robot(*ARM, link("arm")),
        ":6: link 'arm': the name is duplicated, first used in line 4; rename one link",
    ),
    "duplicate joint": (
        robot(*ARM, link("hand"), joint("elbow", "arm", "hand")),
        ":7: joint 'elbow': the name is duplicated, first used in line 5; rename one joint",
    ),
    "nameless link": (
        robot('<link/>'),
        ":3: <link>: attribute 'name' is missing; give every link and joint a name",
    ),
    "zero axis": (
        robot(*ARM[:2], joint("elbow", "base", "arm", inside='<axis xyz="0 0 0"/>' + LIMIT)),
        ":5: joint 'elbow': attribute 'xyz' of <axis> is zero; give the direction of the joint's axis",
    ),
    "short axis": (
        robot(*ARM[:2], joint("elbow", "base", "arm", inside='<axis xyz="0 1"/>' + LIMIT)),
        ":5: joint 'elbow': attribute 'xyz' of <axis> must be 3 numbers, got '0 1'; fix the attribute",
    ),
    "axis without xyz": (
        robot(*ARM[:2], joint("elbow", "base", "arm", inside="<axis/>" + LIMIT)),
        ":5: joint 'elbow': attribute 'xyz' of <axis> is missing; give 3 numbers",
    ),
    "no type": (
        robot(*ARM[:2], '<joint name="elbow"><parent link="base"/><child link="arm"/></joint>'),
        ":5: joint 'elbow': attribute 'type' is missing; give one of revolute, continuous, prismatic, fixed",
    ),
    "unsupported joints": (
        robot(*ARM[:2], link("hand"), joint("a", "base", "arm", "floating"), joint("b", "arm", "hand", "planar")),
        ":6: joint 'a': unsupported joints: joint 'a' of type 'floating', joint 'b' of type 'planar'; "
        "supported are revolute, continuous, prismatic, fixed",
    ),
    "no parent": (
        robot(*ARM[:2], '<joint name="elbow" type="fixed"><child link="arm"/></joint>'),
        ':5: joint \'elbow\': <parent> is missing; give <parent link="..."/>',
    ),
    "unknown child": (
        robot(*ARM[:2], joint("elbow", "base", "hand")),
        ":5: joint 'elbow': <child> names the unknown link 'hand'; correct the name or add the link",
    ),
    "two parents": (
        robot(*ARM, link("hand"), joint("b", "base", "hand"), joint("c", "arm", "hand")),
        ":8: link 'hand': two parents, through joint 'b' and joint 'c'; loops are not supported; remove one of the joints",
    ),
    "cycle": (
        robot(link("base"), link("a"), link("b"), joint("x", "a", "b"), joint("y", "b", "a")),
        ":6: joint 'x': joints form a loop: 'x', 'y'; loops are not supported; remove one of the joints",
    ),
    "own parent": (
        robot(link("base"), link("a"), joint("x", "a", "a")),
        ":5: joint 'x': joints form a loop: 'x'; loops are not supported; remove one of the joints",
    ),
    "two roots": (
        robot(*ARM, link("moon")),
        ":2: robot: several roots: links 'base', 'moon'; connect them, or remove all but one",
    ),
    "mimic of an unknown joint": (
        robot(*ARM[:2], joint("elbow", "base", "arm", inside=LIMIT + '<mimic joint="knee"/>')),
        ":5: joint 'elbow': <mimic> names the unknown joint 'knee'; correct the name or add the joint",
    ),
    "mimic of itself": (
        robot(*ARM[:2], joint("elbow", "base", "arm", inside=LIMIT + '<mimic joint="elbow"/>')),
        ":5: joint 'elbow': joints mimic each other in a circle: 'elbow'; make one of them independent",
    ),
    "mimics in a circle": (
        robot(
            *ARM[:2],
            link("hand"),
            joint("a", "base", "arm", inside=LIMIT + '<mimic joint="b"/>'),
            joint("b", "arm", "hand", inside=LIMIT + '<mimic joint="a"/>'),
        ),
        ":6: joint 'a': joints mimic each other in a circle: 'a', 'b'; make one of them independent",
    ),
    "mimic of a fixed joint": (
        robot(
            *ARM[:2],
            link("hand"),
            joint("a", "base", "arm", "fixed", inside=""),
            joint("b", "arm", "hand", inside=LIMIT + '<mimic joint="a"/>'),
        ),
        ":7: joint 'b': <mimic> names the fixed joint 'a'; name a moving joint, or make this one fixed",
    ),
    "long value": (
        robot(link("base", INERTIAL.replace('value="1"', f'value="{"9x" * 100}"'))),
        f":3: link 'base': attribute 'value' of <mass> must be one number, finite and decimal, got '{'9x' * 40}...'; "
        "fix the attribute",
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", ERRORS)
def test_mistake_is_an_error_in_these_words(name, write):
    text, message = ERRORS[name]
    path = write(text)
    with pytest.raises(rne.UrdfError) as caught:
        rne.load(path)
    assert str(caught.value) == f"{path}{message}"
    assert caught.value.finding.severity == "error"
    assert isinstance(caught.value, ValueError)


@pytest.mark.parametrize("name", ERRORS)
def test_check_prints_the_same_error(name, write, capsys):
    text, message = ERRORS[name]
    path = write(text)
    findings = rne.check(path)
    assert any(f.severity == "error" for f in findings)
    place, rest = re.match(r"(:\d+)?: (.*)", message, re.DOTALL).groups()
    assert f"error: {path}{place or ''}: {rest}" in capsys.readouterr().out


WARNINGS = {
    "triangle inequality": (
        [link("base", INERTIAL.replace('ixx="0.1"', 'ixx="0.3"'))],
        ":3: link 'base': <inertia>: the largest principal moment exceeds the sum of the two others, which no rigid body has; "
        "check ixx ... izz; torques are computed as written",
    ),
    "crossed limits": (
        [*ARM[:2], joint("elbow", "base", "arm", inside=LIMIT.replace("-1", "2"))],
        ":5: joint 'elbow': <limit>: lower 2 is above upper 1; exchange them",
    ),
    "range without its upper end": (
        [*ARM[:2], joint("elbow", "base", "arm", inside='<limit lower="2" effort="1" velocity="1"/>')],
        ":5: joint 'elbow': <limit>: lower 2 is above upper 0; give 'upper', which is 0 if left out",
    ),
    "zero range": (
        [*ARM[:2], joint("elbow", "base", "arm", inside=LIMIT.replace("-1", "1"))],
        ":5: joint 'elbow': <limit>: lower and upper are both 1, a range of zero; give the range",
    ),
    "no limit": (
        [*ARM[:2], joint("elbow", "base", "arm", inside="")],
        ":5: joint 'elbow': a revolute joint without <limit>; give it, or make the joint continuous",
    ),
    "largest effort -1": (
        [*ARM[:2], joint("elbow", "base", "arm", inside=LIMIT.replace('effort="1"', 'effort="-1.0"'))],
        ":5: joint 'elbow': attribute 'effort' of <limit> is -1, taken as no limit; leave it out, or write the limit",
    ),
    "deceleration -1": (
        [*ARM[:2], joint("elbow", "base", "arm", inside=LIMIT.replace("/>", ' deceleration="-1e0"/>'))],
        ":5: joint 'elbow': attribute 'deceleration' of <limit> is -1, taken as no limit; leave it out, or write the limit",
    ),
    "negative inertia that no joint moves": (
        [
            link("base"),
            link("sign", INERTIAL.replace('ixx="0.1"', 'ixx="-3.5e-8"')),
            joint("j", "base", "sign", "fixed", ""),
        ],
        ":4: link 'sign': <inertia>: the inertia must have no negative eigenvalue, got -3.5e-08 kg m^2, without effect as "
        "no joint moves it; check signs and units of ixx ... izz",
    ),
    "undeclared prefix in what is not read": (
        [link("base"), "<gazebo><sensor:camera><sensor:fov/></sensor:camera></gazebo>"],
        ":4: robot: the prefix 'sensor' is not declared, what has it is ignored; add xmlns:sensor=\"...\" to <robot> for "
        "other programs",
    ),
    "undeclared prefix of a picture": (
        [link("base", INERTIAL + "<visual><geometry><x:box size='1 1 1'/></geometry></visual>")],
        ":3: link 'base': the prefix 'x' is not declared, what has it is ignored; add xmlns:x=\"...\" to <robot> for "
        "other programs",
    ),
    "undeclared prefix of an attribute": (
        [link("base"), '<gazebo x:reference="base"/>'],
        ":4: robot: the prefix 'x' is not declared, what has it is ignored; add xmlns:x=\"...\" to <robot> for other programs",
    ),
    "massless": (
        [link("base"), link("arm", ""), joint("elbow", "base", "arm")],
        ":5: joint 'elbow': moves no inertia: forward dynamics raises SingularMassMatrixError, or its digits are rounding; "
        "give its links inertia about its axis, its rotor in Python (`with_armature`), or make it fixed",
    ),
    "a point mass on the axis": (
        [
            *(link(name, INERTIAL.replace('"0.1"', '"0.001"')) for name in ("base", "arm")),
            joint("elbow", "base", "arm"),
            link("tip", POINT_MASS),
            joint("wrist", "arm", "tip"),
        ],
        ":7: joint 'wrist': moves no inertia: forward dynamics raises SingularMassMatrixError, or its digits are rounding; "
        "give its links inertia about its axis, its rotor in Python (`with_armature`), or make it fixed",
    ),
    "axis of a fixed joint": (
        [*ARM[:2], joint("elbow", "base", "arm", "fixed", '<axis xyz="0 0 0"/>')],
        ":5: joint 'elbow': <axis> of a fixed joint is ignored; remove it",
    ),
    "mimic on a fixed joint": (
        [*ARM[:2], joint("elbow", "base", "arm", "fixed", '<mimic joint="nobody"/>')],
        ":5: joint 'elbow': <mimic> of a fixed joint is ignored; remove it",
    ),
    "unknown element": (
        [link("base", INERTIAL + "<colour/>")],
        ":3: link 'base': unknown element 'colour' in <link> is ignored; remove it",
    ),
    "unknown attribute of a massless link's inertia": (
        [link("base", INERTIAL.replace('"1"', '"0"').replace("0.1", "0").replace("<inertia ", '<inertia note="x" '))],
        ":3: link 'base': unknown attribute 'note' of <inertia> is ignored; remove it",
    ),
    "unknown attribute": (
        ['<link name="base" colour="red"/>'],
        ":3: link 'base': unknown attribute 'colour' of <link> is ignored; remove it",
    ),
    "nameless robot": (
        None,
        ":1: robot: attribute 'name' is missing; give the robot a name; other readers require it",
    ),
    "namespaced child": (
        [link("base", '<x:inertial xmlns:x="urn:x"/>')],
        ":3: link 'base': unknown element '{urn:x}inertial' in <link> is ignored; remove it, or write <inertial> if that is meant",
    ),
    "broken visual": (
        [link("base", '<visual><geometry><cylinder radius="a" length="1"/></geometry></visual>')],
        ":3: link 'base': visual ignored: attribute 'radius' of <cylinder> must be one number, finite and decimal, got 'a'; "
        "fix the attribute",
    ),
}


def test_control_characters_in_many_attributes_are_one_finding(write):
    names = joint("x&#133;", "base", "y&#133;"), link("y&#133;")
    found = [str(x) for x in rne.check(write(robot(link("base"), *names))) if "control characters" in str(x)]
    assert len(found) == 1
    assert found[0].endswith(r" read as the escapes in 'x\x85'; remove them here and elsewhere")


@pytest.mark.parametrize("name", WARNINGS)
def test_oddity_is_a_finding_and_the_robot_loads(name, write, capsys):
    elements, message = WARNINGS[name]
    path = write("<robot>" + link("base") + "</robot>" if elements is None else robot(*elements))
    findings = rne.check(path)
    assert [f.severity for f in findings] == ["warning"]
    assert capsys.readouterr().out == f"warning: {path}{message}\n{path}: 1 warning: loads as written\n"
    assert rne.load(path).link_names[0] == "base"


def test_no_file_but_the_urdf_is_opened(write, monkeypatch):
    mesh = '<visual><geometry><mesh filename="file:///etc/hostname"/></geometry></visual>'
    path = write(robot(link("base", INERTIAL + mesh), *ARM[1:]))
    rne.load(path)  # imports everything
    opened = []
    real = {"open": builtins.open, "os.open": os.open, "io.open": io.open}

    def watch(name):
        def call(file, *args, **kwargs):
            opened.append(file)
            return real[name](file, *args, **kwargs)

        return call

    monkeypatch.setattr(builtins, "open", watch("open"))
    monkeypatch.setattr(io, "open", watch("io.open"))
    monkeypatch.setattr(os, "open", watch("os.open"))
    rne.load(path)
    assert {os.fspath(file) for file in opened} == {os.fspath(path)}


LIMIT_BYTES = 16 * 2**20


def padded(text, size):
    """The file filled up to a size by comments of a mebibyte; libxml2 allows none of ten."""
    head, tail = text[: text.index("<robot")], text[text.index("<robot") :]
    missing = size - len(text)
    comments = ["<!--" + " " * (min(2**20, missing - k) - 7) + "-->" for k in range(0, missing, 2**20)]
    return head + "".join(comments) + tail


def test_a_file_of_16_mebibytes_loads_and_one_byte_more_does_not(write):
    assert rne.load(write(padded(robot(*ARM), LIMIT_BYTES))).n == 1
    path = write(padded(robot(*ARM), LIMIT_BYTES + 1))
    with pytest.raises(rne.UrdfError) as caught:
        rne.load(path)
    message = f"{path}: file: is larger than 16777216 bytes; split the robot or remove what is not URDF"
    assert str(caught.value) == message


def nested(depth):
    """A robot whose elements are nested to a depth, the robot itself included."""
    return robot(*ARM, "<a>" * (depth - 1) + "</a>" * (depth - 1))


def test_256_nested_elements_load(write):
    assert rne.load(write(nested(256))).n == 1


@pytest.mark.parametrize("depth", [258, 1000, 1_000_000])
def test_deeper_elements_are_an_error(depth, write):
    """At 257 elements it depends on the version of libxml2."""
    path = write(nested(depth))
    with pytest.raises(rne.UrdfError) as caught:
        rne.load(path)
    assert str(caught.value) == f"{path}:6: file: is nested deeper than 256 elements; a URDF needs about 6"


BOMB = '<!ENTITY a "aaaaaaaaaa">' + "".join(
    f'<!ENTITY {b} "{("&" + a + ";") * 10}">' for a, b in zip("abcdefghijk", "bcdefghijkl", strict=True)
)
SECRET = '<!ENTITY s SYSTEM "file:///etc/hostname">'
DOCTYPES = {
    "entity bomb": robot(link("&l;"), head=f"<!DOCTYPE robot [{BOMB}]>"),
    "entity bomb in an attribute": robot('<link name="&l;"/>', head=f"<!DOCTYPE robot [{BOMB}]>"),
    "one entity": robot('<link name="&a;"/>', head='<!DOCTYPE robot [<!ENTITY a "base">]>'),
    "external entity": robot(link("base", "&s;"), head=f"<!DOCTYPE robot [{SECRET}]>"),
    "external entity, not used": robot(*ARM, head=f"<!DOCTYPE robot [{SECRET}]>"),
    "parameter entity": robot(*ARM, head='<!DOCTYPE robot [<!ENTITY % p SYSTEM "file:///etc/hostname"> %p;]>'),
    "external document type": robot(*ARM, head='<!DOCTYPE robot SYSTEM "file:///etc/hostname">'),
    "document type in the network": robot(*ARM, head='<!DOCTYPE robot PUBLIC "-//x//x" "http://127.0.0.1:9/x.dtd">'),
    "default attribute": robot("<link/>", head='<!DOCTYPE robot [<!ATTLIST link name CDATA "base">]>'),
    "document type alone": robot(*ARM, head="<!DOCTYPE robot>"),
    "truncated within an entity": '<!DOCTYPE robot [<!ENTITY a "b',
    "malformed afterwards": "<!DOCTYPE robot><robot><link></robot>",
}


def doctype_error(path):
    with pytest.raises(rne.UrdfError) as caught:
        rne.load(path)
    message = "file: document type declarations and entities are not allowed; remove the <!DOCTYPE ...>"
    before, _, after = str(caught.value).partition(": ")
    assert after == message
    return before


@pytest.mark.parametrize("name", DOCTYPES)
def test_any_document_type_is_refused_before_it_is_read(name, write):
    """An entity bomb would expand to 10^12 characters; a truncated one would be no document type at all."""
    path = write(DOCTYPES[name])
    assert doctype_error(path) == f"{path}:1"
    path = write('<?xml version="1.0"?>\n<!-- a\ncomment -->' + DOCTYPES[name])
    assert doctype_error(path) == f"{path}:3"


@pytest.mark.parametrize("encoding", ["utf-8-sig", "utf-16", "utf-16-le", "utf-16-be"])
def test_a_document_type_is_seen_in_any_encoding(encoding, write):
    head = f'<?xml version="1.0" encoding="{encoding[:6].rstrip("-").upper()}"?>\n'
    path = write((head + DOCTYPES["entity bomb in an attribute"]).encode(encoding))
    assert doctype_error(path) == f"{path}:2"
    assert rne.load(write((head + robot(*ARM, head="")).encode(encoding))).n == 1


def test_a_document_type_in_a_comment_is_none(write):
    assert rne.load(write(robot(*ARM, head='<!-- <!DOCTYPE robot [<!ENTITY a "b">]> -->'))).n == 1


ENCODING = "save the file as UTF-8, without control characters, and declare no other encoding"
CHARACTERS = "write & as &amp; and < as &lt;, and begin names with a letter"
QUOTES = "close the quotes and the tag before it; within quotes, write < as &lt;"
TRUNCATED = "the file is truncated, get the whole of it"
URDF = "give a URDF file, which begins with <robot ...> or <?xml ...?>"
UNBOUND = "<gazebo><a:b/></gazebo>"  # an undeclared prefix alone is no error, beside one it does not hide it
NOT_XML = {
    "no markup": ("robot", URDF),
    "compressed": (b"\x1f\x8b\x08\x00abc", URDF),
    "control character": (robot(*ARM, "\x00"), ENCODING),
    "not UTF-8": (robot(*ARM).encode() + b"<!-- \xff -->", ENCODING),
    "unknown encoding": (robot(*ARM, head='<?xml version="1.0" encoding="nonsense"?>'), ENCODING),
    "encoding that expat does not know": (
        robot(*ARM, UNBOUND, head='<?xml version="1.0" encoding="gb2312"?>'),
        ENCODING,
    ),
    "UTF-8 that is declared as UTF-16": (robot(*ARM, head='<?xml version="1.0" encoding="utf-16"?>'), ENCODING),
    "UTF-16 without a byte order mark": ("<robot/>".encode("utf-16-le"), ENCODING),
    "unclosed element": (robot("<link>"), "close each element by its own tag, the last opened first"),
    "elements across": (robot("<link><inertial></link>"), "close each element by its own tag, the last opened first"),
    "unclosed beside a prefix": (robot(UNBOUND, "<link>"), "close each element by its own tag, the last opened first"),
    "two roots": (robot(*ARM) + "<robot/>", "end the file after the first </robot>"),
    "text after the robot": (robot(*ARM) + "done", "end the file after the first </robot>"),
    "two roots beside a prefix": (robot(*ARM, UNBOUND) + "<robot/>", "end the file after the first </robot>"),
    "text beside a prefix": (robot(*ARM, UNBOUND) + "/robot>", "end the file after the first </robot>"),
    "robot that ends early": (robot(ARM[0], UNBOUND + "</robot>", *ARM[1:]), "end the file after the first </robot>"),
    "attribute twice": (robot('<link name="a" name="b"/>'), "keep one of the two"),
    "undeclared attribute twice": (robot("<gazebo x:y='1' x:y='2'/>"), "keep one of the two"),
    "attribute twice by two prefixes": (robot("<a xmlns:x='u' xmlns:y='u' x:z='' y:z=''/>"), "keep one of the two"),
    "bare ampersand": (robot('<link name="a & b"/>'), CHARACTERS),
    "bare ampersand in text": (robot("<gazebo>a & b</gazebo>"), CHARACTERS),
    "unclosed beside a prefix of the root": (
        robot("<link>").replace("<robot", "<robot x:y='z'"),
        "close each element by its own tag, the last opened first",
    ),
    "bare ampersand beside a prefix": (robot(UNBOUND, "<gazebo>a & b</gazebo>"), CHARACTERS),
    "undeclared entity": (robot('<link name="&a;"/>'), CHARACTERS),
    "undeclared entity in text": (robot(link("base", "&a;")), CHARACTERS),
    "open merge": (robot("<<<<<<< HEAD", *ARM), CHARACTERS),
    "open quotes": (robot('<link name="a/>', *ARM), QUOTES),
    "no space": (robot('<link name="a"type="b"/>'), QUOTES),
    "open tag": (robot('<link name="a"', '<link name="b"/>'), QUOTES),
    "no quotes": (robot("<mass value=1/>"), "give the attribute a value in quotes"),
    "no value": (robot("<mass value/>"), "give the attribute a value in quotes"),
    "blank line first": ("\n" + robot(*ARM), "put <?xml ...?> at the very start of the file, or remove it"),
    "dashes in a comment": (robot("<!-- a -- b -->"), "write no -- within a comment"),
    "open comment": (robot("<!-- a"), "end the comment by -->, or get the rest of the file"),
    "long name": (robot("<" + "a" * 1000), QUOTES),
    "document type within": (robot("<!DOCTYPE robot>"), CHARACTERS),
}


def cure_of(path):
    """The parser's own reason differs between versions of libxml2; it is cut like all text of a file."""
    with pytest.raises(rne.UrdfError) as caught:
        rne.load(path)
    pattern = re.escape(str(path)) + r"(:\d+)?: file: is not well-formed XML \([^\n]{5,83}\); (.*)"
    return re.fullmatch(pattern, str(caught.value)).group(2)


@pytest.mark.parametrize("name", NOT_XML)
def test_broken_xml_is_an_error_with_its_own_cure_and_never_repaired(name, write):
    text, cure = NOT_XML[name]
    assert cure_of(write(text)) == cure


@pytest.mark.parametrize("inside", [[], [UNBOUND]])
def test_a_file_cut_off_anywhere_is_truncated(write, inside):
    text = robot(ARM[0], *inside)
    cures = {cure_of(write(text[:length])): text[:length][-3:] for length in range(1, len(text), 1 + 2 * len(inside))}
    assert cures.pop(TRUNCATED)
    assert set(cures.values()) <= {"<a:"}  # a name that ends with a colon


@pytest.mark.parametrize("text", ["", " \n", "\ufeff"])
def test_an_empty_file(text, write):
    path = write(text)
    with pytest.raises(rne.UrdfError) as caught:
        rne.load(path)
    assert str(caught.value) == f"{path}: file: is empty; give a URDF file"


def test_a_robot_with_undeclared_prefixes_is_that_without_them(write):
    """As a file of Fetch's maker has them; comments, limits of size and document types count as before."""
    plain = rne.load(write(robot(*ARM)))
    assert rne.load(write(robot(*ARM, "<!-- x:y -->", UNBOUND * 150))).model == plain.model
    path = write(robot(*ARM, UNBOUND, head="<!DOCTYPE robot>"))
    assert doctype_error(path) == f"{path}:1"
    with pytest.raises(rne.UrdfError, match="is nested deeper than 256 elements"):
        rne.load(write(robot(*ARM, "<a:b>" * 300 + "</a:b>" * 300)))


OF_OTHERS = {
    "ros2_control": "<ros2_control name='x'><joint name='j1'/></ros2_control>",
    "mujoco": "<mujoco><compiler meshdir='m'/></mujoco>",
    "a namespace of its own": "<isaac:camera xmlns:isaac='urn:isaac' isaac:rate='30'/>",
    "drake": "<drake:diaphragm xmlns:drake='http://drake.mit.edu'/><frame name='f' link='arm'/>",
    "transmission": "<transmission><joint name='elbow'/></transmission>",
    "gazebo": "<gazebo reference='arm'/>",
    "sensor": "<sensor name='s'/>",
}


@pytest.mark.parametrize("name", OF_OTHERS)
def test_extensions_of_other_programs_are_no_findings(name, write):
    """They are not read, and taking them out would break the other program."""
    assert rne.check(write(robot(*ARM, OF_OTHERS[name])), out=io.StringIO()) == []


def test_attributes_of_the_web_consortium_and_of_drake_are_no_findings(write):
    names = 'xmlns:xsi="http://www.w3.org/2001/XMLSchema-instance" xsi:schemaLocation="a b" xml:lang="en"'
    text = robot(*ARM).replace('<robot name="r">', f'<robot name="r" {names} xmlns:drake="urn:drake" drake:x="1">')
    assert rne.check(write(text), out=io.StringIO()) == []


@pytest.mark.parametrize("name", ["effort", "velocity", "acceleration", "deceleration", "jerk"])
def test_the_reader_has_the_domains_of_arguments(name, write):
    """What `with_limits` refuses is an error in a file, but for -1, which makers write for no limit."""

    def path(value):
        kept = LIMIT.replace(f'{name}="1"', "")
        return write(robot(*ARM[:2], joint("elbow", "base", "arm", inside=kept.replace("/>", f' {name}="{value}"/>'))))

    assert getattr(rne.load(path(-1)), f"{name}_limit").tolist() == [np.inf]
    assert getattr(rne.load(path(0)), f"{name}_limit").tolist() == [0.0]
    for value in (-1e-300, -2.0, -np.finfo(float).max):
        with pytest.raises(rne.UrdfError, match=f"attribute '{name}' of <limit> must not be negative"):
            rne.load(path(repr(float(value))))
        with pytest.raises(ValueError, match=f"`{name}\\[0\\]` of joint 'elbow' must not be negative"):
            rne.load(path(1), **{name: value})
    with pytest.raises(ValueError, match=f"`{name}\\[0\\]` of joint 'elbow' must not be negative, got -1.0"):
        rne.load(path(1), **{name: -1})


def test_negative_limits_of_a_fixed_joint_are_not_read(write):
    inside = LIMIT.replace('"1"', '"-5"')
    assert rne.check(write(robot(*ARM[:2], joint("elbow", "base", "arm", "fixed", inside))), out=io.StringIO()) == []


def test_negative_friction_of_a_file_is_refused_by_a_scene_that_takes_it(write):
    inside = LIMIT + '<dynamics damping="-0.5" friction="1"/>'
    loaded = rne.load(write(robot(*ARM[:2], joint("elbow", "base", "arm", inside=inside))))
    with pytest.raises(
        ValueError, match=r"^`friction` 'urdf': damping of joint 'elbow' must not be negative, got -0\.5$"
    ):
        rne.Scene(loaded, friction="urdf")


def test_a_robot_with_limits_of_minus_one_is_that_of_other_readers(write):
    """Pinocchio refuses the file itself, not what is made of it."""
    inside = LIMIT.replace('"1"', '"-1"').replace('upper="-1"', 'upper="1"')
    loaded = rne.load(write(robot(*ARM[:2], joint("elbow", "base", "arm", inside=inside))))
    text = rne.to_urdf(loaded.model)
    assert Oracle(loaded.model, text).theirs.nv == 1
    assert rne.load(write(text)).model == loaded.model


def test_links_fixed_in_a_circle_end(write):
    joints = [
        joint("a", "base", "l1", "fixed", ""),
        joint("b", "l1", "l2", "fixed", ""),
        joint("c", "l2", "l1", "fixed", ""),
    ]
    with pytest.raises(rne.UrdfError, match="link 'l1': two parents"):
        rne.load(write(robot(link("base"), link("l1"), link("l2"), *joints)))


def test_included_files_are_not_read(write, tmp_path):
    (tmp_path / "other.urdf").write_text(link("base"), encoding="utf-8")
    text = robot('<xi:include xmlns:xi="http://www.w3.org/2001/XInclude" href="other.urdf"/>', *ARM)
    findings = rne.check(write(text), out=io.StringIO())
    assert [f.message for f in findings] == [
        "unknown element '{http://www.w3.org/2001/XInclude}include' in <robot> is ignored"
    ]


def test_a_folder_is_not_a_file(tmp_path):
    with pytest.raises(rne.UrdfError) as caught:
        rne.load(tmp_path)
    assert str(caught.value) == f"{tmp_path}: file: is not a regular file; give the path of a URDF file"


def test_check_of_no_file(tmp_path):
    path = str(tmp_path / "none.urdf")
    with pytest.raises(FileNotFoundError, match=f"^{re.escape(repr(path))} is neither a file nor one of"):
        rne.check(path)


@pytest.mark.parametrize("case", ERRORS)
def test_one_mistake_is_one_error(case, write, capsys):
    findings = rne.check(write(ERRORS[case][0]))
    assert [finding.severity for finding in findings].count("error") == 1, capsys.readouterr().out


@pytest.mark.parametrize("name", ["acceleration", "deceleration", "jerk"])
def test_limits_of_urdf_1_2_are_numbers(name, write):
    inside = f'<axis xyz="0 0 1"/>{LIMIT[:-2]} {name}="fast"/>'
    path = write(robot(*ARM[:2], joint("elbow", "base", "arm", inside=inside)))
    text = f"{path}:5: joint 'elbow': attribute {name!r} of <limit> must be one number, finite and decimal, got 'fast'"
    with pytest.raises(rne.UrdfError, match=f"^{re.escape(text)}"):
        rne.load(path)
    path = write(robot(*ARM[:2], joint("elbow", "base", "arm", inside=inside.replace("fast", "2.5"))))
    assert rne.check(path) == []
    assert getattr(rne.load(path), f"{name}_limit").tolist() == [2.5]


def test_a_default_namespace_is_named_and_ignored(write):
    path = write(robot(*ARM).replace('<robot name="r">', '<robot name="r" xmlns="http://arms.org/urdf">'))
    (finding,) = rne.check(path)
    assert finding.message == "default namespace 'http://arms.org/urdf' is ignored"
    assert rne.load(path).n == 1


def test_further_errors_are_counted(write):
    path = write(robot(link("base", "<mass/>"), link("base"), link("base")))
    errors = [found for found in rne.check(path, out=io.StringIO()) if found.severity == "error"]
    assert len(errors) > 1
    with pytest.raises(rne.UrdfError) as caught:
        rne.load(path)
    assert str(caught.value).endswith(
        f"; and {len(errors) - 1} more error{'s' * (len(errors) > 2)}: `rne check {path}`"
    )
