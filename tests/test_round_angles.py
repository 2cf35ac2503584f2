"""round_angles=True: angles that are multiples of 15 degrees as far as written are these, others and axes as written."""

import io
import re
from decimal import ROUND_DOWN, ROUND_HALF_EVEN, Decimal, localcontext

import mpmath
import numpy as np
import pytest

import rne
from rne.__main__ import main
from rne.urdf.angles import multiple_of_step

from .helpers import Oracle, data_robots, kept, loaded, relative, states

with mpmath.workdps(60):  # another source of digits than the package's constant
    PI = Decimal(mpmath.nstr(mpmath.pi, 60))
MULTIPLES = [k for k in range(-24, 25) if k]
DIGITS = range(3, 17)
TOLERANCE = 1e-13  # of torques, relative to the largest of a state: two programs, some hundred roundings each


def exact(k):
    with localcontext(prec=70):
        return k * PI / 12


def written(k, decimals, how):
    """The multiple k of 15 degrees in decimals, rounded or cut off."""
    with localcontext(prec=70):
        return exact(k).quantize(Decimal(1).scaleb(-decimals), how)


def full(k):
    """The multiple in double precision, with all digits."""
    return repr(float(exact(k)))


@pytest.mark.parametrize("how", [ROUND_HALF_EVEN, ROUND_DOWN])
def test_every_multiple_is_found_in_any_number_of_decimals_and_its_neighbours_are_not(how):
    """Beside what rounding and truncation give, all numbers with as many decimals are more than half a unit away."""
    for decimals in DIGITS:
        unit = Decimal(1).scaleb(-decimals)
        for k in MULTIPLES:
            value = written(k, decimals, how)
            assert multiple_of_step(f"{value}") == (k, decimals)
            both = {written(k, decimals, x) for x in (ROUND_HALF_EVEN, ROUND_DOWN)}
            for beside in {max(both) + unit, min(both) - unit}:
                assert multiple_of_step(f"{beside}") == (0, 0)


FORMS = {
    "1.5708": (6, 4), "+1.5708": (6, 4), "-1.57079": (-6, 5), "1.571": (6, 3), "1.570": (6, 3), ".785398163": (3, 9),
    "3.1416": (12, 4), "3.14159265": (12, 8), "1.5708e0": (6, 4), "157.08E-2": (6, 4), "15708e-4": (6, 4),
    "0.15708e1": (6, 4), "0.00015708e+4": (6, 4), "0.2618": (1, 4), "6.2832": (24, 4), "-6.283": (-24, 3),
    "1.57": (0, 0), "1.57e0": (0, 0), "1.57079e+4": (0, 0), "0.01571e2": (6, 3), "1.5709": (0, 0), "1.57000": (0, 0),
    "0": (0, 0), "0.000": (0, 0), "-0.0001": (0, 0), "6.545": (0, 0), "90.000": (0, 0), "1e999": (0, 0), "1e-9999": (0, 0),
    f"1.5708{'0' * 900}": (0, 0), f"{str(PI)[:50]}": (12, 48), f"0.{'0' * 900}15708e901": (6, 4), "1.570796325": (0, 0),
}  # fmt: skip


def test_the_decimals_that_count_are_those_of_the_number():
    assert {number: multiple_of_step(number) for number in FORMS} == FORMS


LINK = (
    '<link name="{0}"><inertial><origin xyz="0.1 0.02 0.03" rpy="{1}"/><mass value="2"/><inertia ixx="0.01" iyy="0.02" '
    'izz="0.025" ixy="0" ixz="0" iyz="0"/></inertial><visual><origin rpy="1.5708 0 0"/><geometry><box size="1 1 1"/>'
    "</geometry></visual></link>"
)
JOINT = (
    '<joint name="j{0}" type="{3}"><parent link="l{1}"/><child link="l{0}"/><origin xyz="0.1 0.2 0.3" rpy="{2}"/>'
    '<axis xyz="{4}"/><limit lower="-3" upper="3" effort="1e3" velocity="1"/></joint>'
)


def chain(angles, axis="0.7071 0 0.7071"):
    """URDF of a chain: the angles (n, 2, 3) of n joints and of their links' inertias, one joint of three fixed."""
    lines = ['<robot name="r">', '<link name="l0"/>']
    for k, (rpy, of_inertia) in enumerate(angles, 1):
        kind = "fixed" if k % 3 == 0 else "revolute"
        lines += [LINK.format(f"l{k}", " ".join(of_inertia)), JOINT.format(k, k - 1, " ".join(rpy), kind, axis)]
        lines[-1] = lines[-1].replace(f'<axis xyz="{axis}"/>', "") if kind == "fixed" else lines[-1]
    return "\n".join([*lines, "</robot>"])


def model_of(path, text, **options):
    path.write_text(text)
    return rne.load(path, **options).model


@pytest.mark.parametrize("decimals", kept(DIGITS, [3, 14]))
@pytest.mark.parametrize("how", [ROUND_HALF_EVEN, ROUND_DOWN])
def test_a_file_with_few_decimals_is_bit_for_bit_the_one_with_all(decimals, how, tmp_path):
    k = np.random.default_rng(decimals).choice(MULTIPLES + [0], (4, 2, 3)).tolist()
    few, every = (
        [[[f(x) for x in rpy] for rpy in pair] for pair in k] for f in (lambda x: f"{written(x, decimals, how)}", full)
    )
    file = tmp_path / "r.urdf"
    whole = model_of(file, chain(every))
    assert model_of(file, chain(few), round_angles=True) == whole
    assert model_of(file, chain(every), round_angles=True) == whole
    if decimals < 14:  # nearer, entries of rotations may be the same numbers
        assert model_of(file, chain(few)) != whole


def test_nothing_changes_by_default_nor_what_is_no_such_angle(tmp_path):
    """`read_urdf` does not know of the option; axes of 45 degrees and pictures stay what they are."""
    file, zero, right = tmp_path / "r.urdf", ["0"] * 3, ["1.571", "-1.5707", "3.14159"]
    written_so = model_of(file, chain([(right, right)] * 2))
    assert written_so == rne.load(file, round_angles=False).model == rne.read_urdf(file)
    others = [["1.57", "0.3", "1.5709"], ["-0.0001", "2.0000", "1.570796325"]]
    assert model_of(file, chain([others]), round_angles=True) == rne.read_urdf(file)
    one, other = (model_of(file, chain([(right, zero)]), round_angles=x) for x in (True, False))
    assert np.array_equal(one.axis, other.axis)
    assert one.shapes == other.shapes
    assert one.shapes[0].rpy[0] == 1.5708


@pytest.mark.parametrize("decimals", [3, 10])
def test_multiples_of_90_degrees_give_exact_zeros_and_ones(decimals, tmp_path):
    k = 6 * np.random.default_rng(0).integers(-4, 5, (5, 2, 3))
    angles = [[[f"{written(x, decimals, ROUND_DOWN)}" for x in rpy] for rpy in pair] for pair in k.tolist()]
    model = model_of(tmp_path / "r.urdf", chain(angles, "0 0 1"), round_angles=True)
    assert set(np.unique(model.rotation)) <= {-1.0, 0.0, 1.0}
    assert all(np.count_nonzero(model.inertia[k]) == 3 for k in (0, 2))  # of bodies that have one link


SAVED = {  # operations as written and rounded
    "xarm7": ("mass_matrix", 795, 414),
    "kinova": ("inverse_dynamics", 798, 461),
    "so101": ("inverse_dynamics", 903, 759),
}


@pytest.mark.skipif(not data_robots(), reason="example-robot-data is not installed")
class TestRobotsOfExampleRobotData:
    @pytest.mark.parametrize("name", kept(SAVED, ["kinova"]))  # and one by check, below
    def test_operations_are_saved(self, name):
        quantity, before, after = SAVED[name]
        robots = loaded(name), rne.load(name, round_angles=True)
        kernels = [rne.compile(getattr(rne.dynamics, quantity), robot.model) for robot in robots]
        assert [sum(kernel.operations.values()) for kernel in kernels] == [before, after]

    def test_check_says_what_it_saves_and_by_how_much_torques_change(self, capsys):
        assert main(["check", "xarm7"]) == 0
        finding, summary = capsys.readouterr().out.splitlines()
        assert finding.endswith(
            "xarm7.urdf: robot: 6 angles are pi/2 to 4 decimals; with round_angles=True M takes 414 operations for 795, "
            "inverse dynamics takes 636 operations for 878, torques change by 3e-6 of the largest"
        )
        assert summary.endswith("xarm7.urdf: 1 warning: loads as written")

    @pytest.mark.long
    def test_pinocchio_has_the_same_torques_of_the_file_with_full_digits(self):
        pytest.importorskip("pinocchio")
        rounded, few = rne.load("xarm7", round_angles=True), loaded("xarm7")
        with open(few.model.source, encoding="utf-8") as file:
            text = file.read()
        oracle = Oracle(rounded.model, text.replace('"1.5708 ', f'"{full(6)} ').replace('"-1.5708 ', f'"{full(-6)} '))
        q, qd, qdd = states(rounded.n, 20)
        theirs = np.array([oracle.inverse_dynamics(*state) for state in zip(q, qd, qdd, strict=True)])
        assert relative(rounded.inverse_dynamics(q, qd, qdd), theirs) < TOLERANCE
        assert relative(few.inverse_dynamics(q, qd, qdd), theirs) > 1e6 * TOLERANCE


RIGHT = [["1.5708", "0", "0"], ["0", "0", "0"]]


@pytest.fixture
def file(tmp_path, monkeypatch):
    """A file with two links, of which one angle is written to four decimals, in the current folder."""
    monkeypatch.chdir(tmp_path)
    file = tmp_path / "r.urdf"
    file.write_text(chain([[["0", "0", "0"]] * 2, RIGHT], "0 0 1"))
    return file


def test_the_command_names_each_angle_that_it_rounds(file, capsys):
    file.write_text(file.read_text().replace('rpy="0 0 0"/><mass', 'rpy="-3.14159 0 1.57"/><mass'))
    assert main(["check", "--round-angles", str(file)]) == 0
    assert capsys.readouterr().out.splitlines() == [
        "warning: r.urdf:3: links 'l1' (-3.14159 to -pi), 'l2' (-3.14159 to -pi): angles of 'rpy' are rounded to multiples of "
        "15 degrees; write 17 digits",
        "warning: r.urdf:6: joint 'j2': angles of 'rpy' are rounded to multiples of 15 degrees: 1.5708 to pi/2; write 17 digits",
        "r.urdf: 3 warnings: loads with angles rounded",
    ]


def test_multiples_have_names_in_terms_of_pi(file, capsys):
    text = file.read_text()
    for k, name in {1: "pi/12", -6: "-pi/2", 12: "pi", -9: "-3 pi/4", 24: "2 pi", 5: "5 pi/12"}.items():
        file.write_text(text.replace("1.5708", f"{k * np.pi / 12:.5f}"))
        assert main(["check", "--round-angles", str(file)]) == 0
        assert f" to {name}; write 17 digits" in capsys.readouterr().out


def test_one_angle_is_said_as_one_and_the_file_stays(file, capsys):
    text = file.read_text()
    (finding,) = rne.check(file)
    assert (
        capsys.readouterr()
        .out.splitlines()[0]
        .startswith("warning: r.urdf: robot: 1 angle is pi/2 to 4 decimals; with round_angles=True M takes ")
    )
    assert (finding.severity, finding.line, finding.message) == ("warning", None, "1 angle is pi/2 to 4 decimals")
    assert file.read_text() == text


def test_nothing_is_said_where_the_arithmetic_stays_the_same_or_the_robot_is_large(file, capsys, monkeypatch):
    with monkeypatch.context() as small:
        small.setattr("rne.urdf.loading.LARGEST", 1)
        rne.check(file)
    file.write_text(chain([[["0.3", "0.5236", "0"], ["0", "0", "0"]]], "0.6 0 0.8"))
    rne.check(file)
    assert capsys.readouterr().out == "r.urdf: no findings\n" * 2
    assert len(rne.check(file, round_angles=True)) == 1


def test_kernels_that_are_too_large_to_be_written_out_count_no_operations(file, capsys, monkeypatch):
    rne.check(file)
    before = [int(x) for x in re.findall(r" for ([0-9]+)", capsys.readouterr().out)]
    monkeypatch.setattr("rne.kernels.trace.LIMIT", max(before) - 1)
    rne.check(file)
    assert re.findall(r" for ([0-9]+)", capsys.readouterr().out) == [str(min(before))]


def test_full_digits_are_no_finding(file):
    file.write_text(file.read_text().replace("1.5708", full(6)))
    assert rne.check(file, round_angles=True, out=io.StringIO()) == []


def test_robots_without_a_file_and_exact_ones_take_the_option():
    assert rne.load("irb140", round_angles=True).model == rne.irb140()
    out = io.StringIO()
    assert rne.check(rne.irb140(), round_angles=True, out=out) == []
    assert out.getvalue().endswith(": no findings\n")


@pytest.mark.parametrize("function", [rne.load, rne.check])
def test_the_option_is_true_or_false(function, file):
    for value in (1, None, "yes"):
        with pytest.raises(TypeError) as error:
            function(file, round_angles=value)
        assert str(error.value) == f"`round_angles` must be True or False, got {type(value).__name__}"


def test_what_is_no_number_is_the_error_of_the_file(file):
    file.write_text(file.read_text().replace('"1.5708 0 0"', '"1.5708 0 pi"'))
    with pytest.raises(rne.UrdfError, match=r"finite and decimal, got '1.5708 0 pi'"):
        rne.load(file, round_angles=True)


def test_a_xacro_file_takes_the_option_too(file):
    pytest.importorskip("xacrodoc")
    turn = '"1.5708 0 0"/><axis'
    xacro = file.with_suffix(".urdf.xacro")
    ns = '<robot xmlns:xacro="http://www.ros.org/wiki/xacro" '
    xacro.write_text(file.read_text().replace("<robot ", ns).replace(turn, '"${3.1416 / 2} 0 ${-1.5708}"/><axis'))
    file.write_text(file.read_text().replace(turn, f'"{full(6)} 0 {full(-6)}"/><axis'))
    assert rne.load(xacro, round_angles=True).model == rne.load(file).model
    assert rne.load(xacro).model != rne.load(file).model


MJCF = """<mujoco model="r"><compiler angle="{unit}" {more}/><include file="part.xml"/><worldbody>
<body name="a" pos="0 0 0.4" euler="{h} 0 0"><joint name="ja" axis="0 0 1"/>
<inertial pos="0.1 0.02 0.03" euler="0 {h} 0" mass="3" diaginertia="0.01 0.02 0.025"/>
<frame euler="0 {t} {h}"><body name="b" pos="0 0.3 0.4" euler="{h} {h} 0"><joint name="jb" axis="0.6 0 0.8"/>
<geom type="box" size="0.1 0.2 0.05" mass="2" pos="0.1 0.05 0.02" euler="{h} 0 0"/>
</body></frame></body></worldbody></mujoco>"""
PART = '<mujoco><worldbody><body name="c" euler="{h} {p} {h}"><joint name="jc" axis="0 1 0"/><geom size="0.1" pos="0.1 0.2 0.3" euler="{h} 0 0"/></body></worldbody></mujoco>'
FEW = {"h": "-1.5707", "p": "3.14159", "t": "0.7854"}
ALL = {"h": full(-6), "p": full(12), "t": full(3)}
DEGREES = {"h": "-90.000", "p": "180.000", "t": "45.000"}


@pytest.fixture
def mjcf(file):
    """Write the robot of MJCF with an included file in these numbers; its path."""
    pytest.importorskip("mujoco")

    def write(numbers, unit="radian", more=""):
        file.with_name("part.xml").write_text(PART.format(**numbers))
        path = file.with_suffix(".xml")
        path.write_text(MJCF.format(**numbers, unit=unit, more=more))
        return path

    return write


@pytest.mark.parametrize("more", ["", 'eulerseq="zxz"', 'eulerseq="XYZ"'])
def test_euler_angles_of_mjcf_in_any_order_are_those_with_full_digits(mjcf, more):
    whole = rne.load(mjcf(ALL, more=more)).model
    file = mjcf(FEW, more=more)
    assert rne.load(file, round_angles=True).model == whole
    assert rne.load(file).model != whole


def test_degrees_of_mjcf_are_multiples_as_written(mjcf):
    for numbers in (DEGREES, FEW):  # degrees by default; 1.5707 degrees are no multiple
        file = mjcf(numbers, "degree")
        file.write_text(file.read_text().replace('angle="degree"', ""))
        assert rne.load(file, round_angles=True).model == rne.load(file).model
        assert rne.check(file, round_angles=True, out=io.StringIO()) == rne.check(file, out=io.StringIO())


def test_inertias_of_mjcf_turned_by_90_degrees_have_exact_zeros(mjcf):
    inertia = rne.load(mjcf(FEW), round_angles=True).model.inertia[1]
    assert np.count_nonzero(inertia) == 3


def test_check_says_of_mjcf_what_rounding_saves_and_names_the_angles(mjcf, capsys):
    rne.check(mjcf(FEW))
    assert (
        "robot: 11 angles are pi/4, pi/2, pi to 4-5 decimals; with round_angles=True M takes "
        in capsys.readouterr().out
    )
    findings = rne.check(mjcf(FEW), round_angles=True)
    assert len(findings) == 11
    assert {finding.element for finding in findings} == {"link 'a'", "link 'b'", "link 'c'"}
    assert capsys.readouterr().out.endswith("r.xml: 11 warnings: loads with angles rounded\n")
