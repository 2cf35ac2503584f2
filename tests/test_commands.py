"""rne simulate and rne torques, and what all subcommands share: help, errors in one line, robots by name."""

import contextlib
import csv
import re
import subprocess
import sys
import warnings
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

import rne
from rne.__main__ import main, parser
from rne.basics.marks import is_marked
from rne.commands.shared import as_options, join_numbers, warnings_in_one_line
from rne.plotting import html_page

from .faulty_logs import SCARA
from .helpers import ROOT, first_joints
from .helpers import kept as kept_parameters

pytestmark = pytest.mark.usefixtures("irb140_once")

IRB140 = str(ROOT / "robots" / "irb140.urdf")
LIFT = """<robot name="lift"><link name="base"/><link name="car"><inertial><mass value="2"/>
<inertia ixx="0" ixy="0" ixz="0" iyy="0" iyz="0" izz="0"/></inertial></link><joint name="up" type="prismatic">
<parent link="base"/><child link="car"/><axis xyz="0 0 1"/><limit lower="0" upper="1" effort="25" velocity="2"/></joint>
</robot>"""


@pytest.fixture
def lift(tmp_path):
    path = tmp_path / "lift.urdf"
    path.write_text(LIFT)
    return str(path)


def table(path):
    """The columns of a CSV file by name."""
    with open(path, newline="", encoding="utf-8") as file:
        heading, *rows = csv.reader(file)
    return dict(zip(heading, np.array(rows, dtype=float).T, strict=True))


def columns(data, quantity, robot):
    return np.column_stack([data[f"{quantity}.{joint}"] for joint in robot.joint_names])


NAMES = (
    "check",
    "compare",
    "view",
    "simulate",
    "torques",
    "cycle",
    "identify",
    "source",
    "export",
    "urdf",
    "report",
    "cache",
)


def test_help_lists_every_command_in_a_line(capsys):
    with pytest.raises(SystemExit, match=r"^0$"):
        main(["--help"])
    said = capsys.readouterr().out
    assert len(re.findall(r"^    \w+ +\w.*$", said, re.MULTILINE)) == len(NAMES)
    for name in NAMES:
        assert len(re.findall(rf"^    {name} +\w.*$", said, re.MULTILINE)) == 1
    assert " ".join(said.split()).endswith(
        "rne COMMAND --help shows options of a command, and an example. Exit codes: 0 all went well, 1 a file has errors, "
        "robots differ or a computation fails, 2 a wrong call or file, 130 interrupted."
    )


def test_examples_of_the_help_run(tmp_path, monkeypatch, capsys):
    """Those that need no file of a user's, one after the other."""
    monkeypatch.chdir(tmp_path)
    for name in ("urdf", "check", "compare", "simulate", "torques", "source"):
        with pytest.raises(SystemExit, match=r"^0$"):
            main([name, "--help"])
        words, _, file = capsys.readouterr().out.split("example:\n  ")[1].strip().partition(" > ")
        assert main(words.split()[1:]) == 0
        if file:
            (tmp_path / file).write_text(capsys.readouterr().out, encoding="utf-8")


def test_the_parser_loads_numpy_and_the_standard_library_only():
    code = "import sys, numpy; before = set(sys.modules); import rne.__main__ as m; m.parser(); print(*set(sys.modules) - before)"
    loaded = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=ROOT).stdout
    assert {name.split(".")[0] for name in loaded.split()} <= {"rne", "numpy", *sys.stdlib_module_names}


@pytest.mark.parametrize("name", NAMES)
def test_help_of_every_command_has_an_example(name, capsys):
    with pytest.raises(SystemExit, match=r"^0$"):
        main([name, "--help"])
    assert re.search(rf"\nexample:\n  rne {name} \S+", capsys.readouterr().out)


def test_a_falling_mass_is_at_its_closed_form(lift, tmp_path, capsys):
    out = tmp_path / "fall.csv"
    arguments = ["simulate", lift, "--q0", "-1", "--gravity", "0 0 -2", "--duration", "1", "--every", "0.25"]
    assert main([*arguments, "--torque", "-1e0", "--out", str(out)]) == 0
    data = table(out)
    np.testing.assert_array_equal(data["t"], [0, 0.25, 0.5, 0.75, 1])
    np.testing.assert_allclose(data["q.up"], -1 - (2 + 1 / 2) * data["t"] ** 2 / 2, rtol=1e-9)
    said = capsys.readouterr().out.splitlines()
    assert said[:5] == [
        "robot lift, joints up, gravity 0 0 -2 m/s^2",
        "q0 -1 m",
        "qd0 0 m/s (not given: zero)",
        "torque -1 N",
        "only rigid bodies: no friction, stops or torque limits",
    ]
    assert said[5].startswith("DOP853: ")
    assert re.fullmatch(r"energy drift \S+ J", said[6])
    assert said[7:10] == [
        "limits exceeded: 2",
        "  up: position -2.25 m below 0 m, worst at 1 s, first at 0 s",
        "  up: velocity -2.5 m/s below -2 m/s, worst at 1 s, first at 1 s",
    ]
    assert said[10:] == [f"{out}: 5 samples from 0 to 1 s"]


def test_simulate_is_the_simulation_of_the_package(tmp_path):
    q0, payload = [0, 0.5, -0.3, 0, 0.2, 0], 5.0
    out = tmp_path / "motion.npz"
    words = ["--q0", *map(str, q0), "--payload", str(payload), "--duration", "0.3", "--method", "RK45"]
    assert main(["simulate", IRB140, *words, "--rtol", "1e-4", "--out", str(out)]) == 0
    robot = rne.load(IRB140).with_payload(payload)
    expected = rne.simulate(robot, q0, [0] * 6, 0.3, method="RK45", rtol=1e-4)
    np.testing.assert_array_equal(rne.Trajectory.load(out).q, expected.q)


def test_no_limit_exceeded_is_said(lift, tmp_path, capsys):
    arguments = ["simulate", lift, "--q0", "0.5", "--duration", "0.1", "--out", str(tmp_path / "m.csv")]
    assert main(arguments) == 0
    assert "limits exceeded: none" in capsys.readouterr().out.splitlines()


def test_the_end_is_a_sample_also_between_two_intervals(lift, tmp_path):
    out = tmp_path / "m.csv"
    assert main(["simulate", lift, "--duration", "0.1", "--every", "0.03", "--out", str(out)]) == 0
    np.testing.assert_allclose(table(out)["t"], [0, 0.03, 0.06, 0.09, 0.1], rtol=1e-15)


@pytest.fixture(scope="module")
def swing():
    """A robot and its motion with drive torques, sampled every 10 ms."""
    robot = rne.load(IRB140)
    path = rne.trajectories.quintic([0] * 6, [0.5, -0.4, 0.3, 0.6, 0.2, -0.5], 1.0)
    law = rne.control.computed_torque(robot, [100] * 6, [20] * 6, path)
    scene = rne.Scene(robot, controller=law)
    return robot, rne.simulate(scene, [0] * 6, [0] * 6, 1.0, t_eval=np.linspace(0, 1, 101), rtol=1e-8, atol=1e-10)


@pytest.fixture
def motion(swing, tmp_path):
    """The same, with the motion as CSV."""
    swing[1].to_csv(tmp_path / "motion.csv")
    return swing


def kept(path, quantities):
    """The file with the columns of some quantities alone, backwards."""
    data = table(path)
    names = [name for name in reversed(data) if name.partition(".")[0] in quantities]
    with open(path, "w", newline="", encoding="utf-8") as file:
        csv.writer(file).writerows([names, *np.column_stack([data[name] for name in names]).tolist()])


def test_torques_of_the_files_accelerations_are_those_of_the_drives(motion, tmp_path, capsys):
    """Inverse dynamics of forward dynamics: equal up to rounding, times the condition of M."""
    robot, simulated = motion
    out = tmp_path / "torques.csv"
    assert main(["torques", "irb140", str(tmp_path / "motion.csv"), "--out", str(out)]) == 0
    data = table(out)
    assert list(data) == ["t", *(f"tau.{joint}" for joint in robot.joint_names)]
    scale = np.abs(simulated.tau).max()
    np.testing.assert_allclose(columns(data, "tau", robot), simulated.tau, rtol=0, atol=1e-12 * scale)
    direct = robot.inverse_dynamics(simulated.q, simulated.qd, simulated.qdd)
    np.testing.assert_array_equal(columns(data, "tau", robot), direct)
    assert capsys.readouterr().out.splitlines() == [
        f"robot irb140, joints {' '.join(robot.joint_names)}, gravity 0 0 -9.81 m/s^2",
        f"q, qd and qdd from {tmp_path / 'motion.csv'}",
        "tau in N m: only rigid bodies, without friction and inertia of the drives",
        "limits exceeded: none; the model has no effort limits",
        f"{out}: 101 samples from 0 to 1 s",
    ]


@pytest.mark.parametrize(
    ("quantities", "said", "bound"),
    [
        (("t", "q"), "q from {}; qd and qdd: derivatives of a spline of degree 5 through q", 1e-4),
        (("t", "q", "qd"), "q and qd from {}; qdd: derivative of a spline of degree 5 through qd", 1e-6),
        (("t", "q", "qdd"), "q and qdd from {}; qd: derivative of a spline of degree 5 through q", 1e-6),
    ],
    ids=["positions", "rates", "accelerations"],
)
def test_what_is_missing_comes_from_a_spline_and_is_said(quantities, said, bound, motion, tmp_path, capsys):
    """Equal within the error of the spline: of the order h^4 in qdd from q, less from qd."""
    robot, simulated = motion
    file = tmp_path / "motion.csv"
    kept(file, quantities)
    assert main(["torques", IRB140, str(file)]) == 0
    output = capsys.readouterr()
    assert output.err.splitlines()[1] == said.format(file)
    (tmp_path / "torques.csv").write_text(output.out)
    difference = columns(table(tmp_path / "torques.csv"), "tau", robot) - simulated.tau
    assert 0 < np.abs(difference).max() < bound * np.abs(simulated.tau).max()


def test_uneven_times_are_worth_a_warning(lift, tmp_path, capsys):
    file = tmp_path / "uneven.csv"
    file.write_text("t,q.up\n" + "".join(f"{t},{t}\n" for t in (0, 1e-6, 0.1, 0.2, 0.3, 0.4)))
    assert main(["torques", lift, str(file)]) == 0
    assert capsys.readouterr().err.splitlines()[2] == (
        "warning: the times are 1e-06 to 0.1 s apart; where they are close, derivatives amplify the rounding of the samples: "
        "give samples at even times, or velocities and accelerations"
    )


def test_steps_that_differ_a_hundredfold_are_even_enough(lift, tmp_path, capsys):
    file = tmp_path / "uneven.csv"
    for ratio, is_told in ((99, False), (101, True)):
        file.write_text(
            "t,q.up\n" + "".join(f"{t},{t}\n" for t in (0, 0.001, *(0.001 * (1 + ratio * k) for k in (1, 2))))
        )
        assert main(["torques", lift, str(file)]) == 0
        assert ("warning: the times are" in capsys.readouterr().err) == is_told


def test_payload_and_gravity_count(lift, tmp_path, capsys):
    file = tmp_path / "rest.csv"
    file.write_text("t,q.up,qd.up,qdd.up\n0,0.5,0,0\n")
    assert main(["torques", lift, str(file), "--payload", "3", "--gravity", "0,0,-2"]) == 0
    said = capsys.readouterr()
    assert said.out == "t,tau.up\n0.0,10.0\n"
    first = "robot lift, joints up, gravity 0 0 -2 m/s^2, payload 3 kg at the origin of link car"
    assert said.err.splitlines()[0] == first


def test_a_payload_has_centre_and_inertia(tmp_path, capsys):
    file, out = tmp_path / "motion.csv", tmp_path / "tau.csv"
    robot = rne.load("irb140").locked({"joint_6": 0.3})
    names = [f"{x}.{joint}" for x in ("q", "qd", "qdd") for joint in robot.joint_names]
    states = np.random.default_rng(0).uniform(-1, 1, (2, 15))
    file.write_text("\n".join(",".join(map(str, row)) for row in [["t", *names], *np.c_[[0, 1], states].tolist()]))
    body = ["--payload", "3", "--payload-com", "0.1", "0", "-0.2", "--payload-inertia", "0.1 0.2 0.15 0.01 0 -0.02"]
    assert main(["torques", "irb140", str(file), *body, "--locked", "joint_6=0.3", "--out", str(out)]) == 0
    carrying = robot.with_payload(3.0, (0.1, 0, -0.2), [[0.1, 0.01, 0], [0.01, 0.2, -0.02], [0, -0.02, 0.15]])
    tau = carrying.inverse_dynamics(*np.split(states, 3, axis=1))
    np.testing.assert_array_equal(columns(table(out), "tau", robot), tau)
    assert (
        capsys.readouterr()
        .out.splitlines()[0]
        .endswith("payload 3 kg at 0.1 0 -0.2 m of link tool0 with inertia 0.1 0.2 0.15 0.01 0 -0.02 kg m^2")
    )


def test_robots_are_compared_joint_by_joint_and_by_their_torques(lift, tmp_path, capsys):
    other = tmp_path / "other.urdf"
    other.write_text(LIFT.replace('effort="25"', 'effort="30"').replace('mass value="2"', 'mass value="3"'))
    assert main(["compare", lift, str(other)]) == 1
    said = capsys.readouterr().out.splitlines()
    assert said[:5] == [
        "up: effort limit 25, of the other 30",
        "up: mass 2, of the other 3",
        f"torques of {other} compared with those of {lift}, and the likely cause by torques only",
        "cause: torque unit",
        "  torques are 1.5 times this robot's",
    ]
    other.write_text(LIFT.replace('effort="25"', 'effort="30"'))
    assert main(["compare", lift, str(other)]) == 1
    assert "cause: none" in capsys.readouterr().out
    assert main(["compare", lift, lift]) == 0
    said = capsys.readouterr().out.splitlines()
    assert said[0] == "joints: the same, with the same limits, bodies and frames"
    assert said[2:4] == ["cause: none", "  the torques agree"]
    other.write_text(LIFT.replace('type="prismatic"', 'type="revolute"'))
    assert main(["compare", lift, str(other)]) == 1
    assert capsys.readouterr().out.startswith("up: joint type prismatic, of the other revolute\n")
    arm = rne.load("irb140").model
    k = arm.link_index("tool0")
    moved = arm.link_translation + np.where(np.arange(len(arm.link_names)) == k, 0.1, 0.0)[:, None] * [0, 0, 1]
    (tmp_path / "tool.urdf").write_text(rne.to_urdf(replace(arm, link_translation=moved)))
    assert main(["compare", "irb140", str(tmp_path / "tool.urdf")]) == 1
    place = f"{arm.link_translation[k, 2]:.9g}, of the other 0 0 {arm.link_translation[k, 2] + 0.1:.9g}"
    assert capsys.readouterr().out.startswith(f"tool0: translation on its body 0 0 {place}\n")
    locked = ["--locked", "joint_6=0", "--payload", "2", "--payload-com", "0 0 0.1"]
    (tmp_path / "five.urdf").write_text(rne.to_urdf(rne.load("irb140").locked({"joint_6": 0.0}).model))
    assert main(["compare", "irb140", str(tmp_path / "five.urdf"), *locked]) == 1
    said = capsys.readouterr().out
    assert "joint_5: mass 3, of the other 1" in said
    assert "cause: payload" in said
    assert main(["compare", "irb140", "irb140", "--gravity", "0 0 -1.62"]) == 0  # of both
    capsys.readouterr()
    assert main(["compare", lift, "irb140"]) == 1
    assert capsys.readouterr().out.splitlines() == [
        "different robots: 0 of 1 joints have the same name, axis and place",
        f"{lift}: 1 joint (up), 2 kg moving",
        f"irb140: 6 joints (joint_1, joint_2, joint_3, joint_4, joint_5, joint_6), {arm.mass.sum():.4g} kg moving",
    ]
    (tmp_path / "four.urdf").write_text(rne.to_urdf(rne.load("irb140").locked({"joint_6": 0, "joint_5": 0}).model))
    assert main(["compare", "irb140", str(tmp_path / "four.urdf")]) == 1  # most joints are the same
    said = capsys.readouterr().out.splitlines()
    assert said[0] == "joints that only irb140 has: joint_5, joint_6"
    assert said[-1] == f"torques: not compared, irb140 has 6 joints, {tmp_path / 'four.urdf'} 4"
    locked = {f"joint_{k}": 0.0 for k in (3, 4, 5, 6)}
    (tmp_path / "two.urdf").write_text(rne.to_urdf(rne.load("irb140").locked(locked).model))
    for names in (("irb140", str(tmp_path / "two.urdf")), (str(tmp_path / "two.urdf"), "irb140")):
        assert main(["compare", *names]) == 1  # all joints of the smaller one are the same
        assert "joints that only irb140 has: joint_3, joint_4, joint_5, joint_6" in capsys.readouterr().out


@pytest.mark.parametrize("searched", [False, pytest.param(True, marks=pytest.mark.long)])
def test_of_two_different_robots_it_is_said_first_and_no_cause_is_guessed(searched, tmp_path, capsys, monkeypatch):
    if not searched:
        first = "different robots: 0 of 2 joints have the same name, axis and place"
        found = SimpleNamespace(causes=("unknown",), different=first, report=lambda: "|table")  # the search is long
        monkeypatch.setattr(rne, "compare_models", lambda one, other, tolerance: found)
    arm = first_joints(2).model
    (tmp_path / "a.urdf").write_text(rne.to_urdf(arm))
    tilted = np.array([[0, 0.6, 0.8], [0.8, 0, 0.6]])
    longer = replace(arm, axis=tilted, translation=0.3 + arm.translation, com=0.2 + arm.com)
    (tmp_path / "b.urdf").write_text(rne.to_urdf(longer))
    files = [str(tmp_path / name) for name in ("a.urdf", "b.urdf")]
    assert main(["compare", *files]) == 1
    assert capsys.readouterr().out.splitlines() == [
        "different robots: 0 of 2 joints have the same name, axis and place",
        *(f"{file}: 2 joints (joint_1, joint_2), {arm.mass.sum():.4g} kg moving" for file in files),
    ]


def test_of_a_robot_with_other_names_it_is_said_that_torques_agree(tmp_path, capsys):
    """No joint has the same name, and yet the torques have a cause: none."""
    arm = first_joints(2).model
    (tmp_path / "a.urdf").write_text(rne.to_urdf(arm))
    (tmp_path / "b.urdf").write_text(rne.to_urdf(arm).replace("joint_", "axis_"))
    assert main(["compare", str(tmp_path / "a.urdf"), str(tmp_path / "b.urdf")]) == 1
    said = capsys.readouterr().out.splitlines()
    assert said[0].endswith("a.urdf has: joint_1, joint_2")
    assert "cause: none" in said
    assert "different" not in "".join(said)


EVIL = "a\x9b31m", "b&#10;error: no", "c\u202ed"  # names that colour a terminal, forge a line and turn a text round
FILE, MOTION = "x\x1b[2J.urdf", "m\u202e.csv"


def test_names_with_control_characters_are_printed_as_escapes(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    text = LIFT.replace('"lift"', f'"{EVIL[0]}"').replace('"up"', f'"{EVIL[1]}"').replace('"car"', f'"{EVIL[2]}"')
    (tmp_path / FILE).write_text(text, encoding="utf-8")
    for words, shown in (
        (["check", FILE], "warning: x\\x1b[2J.urdf:1: <robot>: attribute 'name' has control characters, read as the"),
        (["simulate", FILE, "--duration", "0.1", "--every", "0.05", "--out", MOTION], "\nm\\u202e.csv: 3 samples"),
        (["torques", FILE, MOTION], "robot a\\x9b31m, joints b error: no, gravity"),
        (["torques", FILE, "no\n\x1b.csv"], "error: no\\n\\x1b.csv: No such file or directory"),
        (["compare", FILE, FILE], "torques of x\\x1b[2J.urdf compared"),
        (["compare", FILE, "irb140"], "\nx\\x1b[2J.urdf: 1 joint (b error: no), 2 kg moving\n"),
        (["identify", FILE, MOTION, "--page", "p\x1b"], "error: m\\u202e.csv: "),
        (["x\x9by"], "invalid choice: 'x\\x9by'"),
        (["check", FILE, "--\x1b"], "unrecognized arguments: --\\x1b"),
    ):
        with contextlib.suppress(SystemExit):
            main(words)
        said = "".join(capsys.readouterr())
        assert shown in said
        assert said.replace("\n", "").isprintable()
        assert "\nerror: no" not in said


def test_names_in_pages_and_messages_of_mujoco_are_escapes(tmp_path, capsys):
    page = html_page.Report("A\x9b", lambda line: None, tmp_path)
    page.table(["a\x1b"], [["b\u202e"]])
    assert page.write().read_text(encoding="utf-8").replace("\n", "").isprintable()
    text = '<mujoco><worldbody><body><joint name="j\x9b"/><geom size="1" class="k\x9b"/></body></worldbody></mujoco>'
    (tmp_path / "m.xml").write_text(text, encoding="utf-8")
    assert main(["check", str(tmp_path / "m.xml")]) == 1
    assert "MuJoCo's compiler says: unknown default class name 'k\\x9b'" in capsys.readouterr().out


def test_arguments_in_a_message_are_shown_as_options(capsys):
    given = parser().parse_args(["identify", "irb140", "log.csv"])
    for text, shown in {
        'give columns=["t", "q.a"], with "" for one to ignore': 'give --columns t,q.a, with "" for one to ignore',
        'columns={"t": ...} or `sample_rate`': "--columns t=... or --sample-rate",
        "give units={'q': \"deg\"}": "give --units q=deg",
        'else give time_unit="s"': "else give --time-unit s",
        "`gains` [N m/A]; gains=1": "--gains [N m/A]; --gains 1",
        "`robot.locked({'a': 0.5, 'b': 0})`": "--locked a=0.5,b=0",
        "lock them by `robot.locked`": "lock them by --locked",
        "`rne.excitation`, prior=2 and `prior`": "`rne.excitation`, prior=2 and `prior`",
    }.items():
        assert as_options(text, given) == shown
        with warnings_in_one_line(given):
            warnings.warn(text, stacklevel=1)
        assert capsys.readouterr().err == f"warning: {shown}\n"


@pytest.mark.parametrize(
    ("text", "read"),
    [("t,1", {"": ["t", "1"]}), ("q=3", {"q": 3}), ("q=a,4", {"q": ["a", 4]}), ("tau=0.5", {"tau": 0.5})],
)
def test_columns_and_units_are_names_or_numbers(text, read):
    assert repr(parser().parse_args(["identify", "irb140", "log.csv", "--columns", text]).columns) == repr([read])


def test_rotors_of_the_file_are_said_to_be_in_the_torques(tmp_path, capsys):
    joint = '<joint name="j" axis="0 0 1" armature="0.25"/><inertial pos="0 0 0" mass="1" diaginertia=".1 .1 .1"/>'
    (tmp_path / "r.xml").write_text(f"<mujoco><worldbody><body>{joint}</body></worldbody></mujoco>")
    (tmp_path / "r.csv").write_text("t,q.j,qd.j,qdd.j\n0,0,0,2\n1,1,2,2\n")
    assert main(["torques", str(tmp_path / "r.xml"), str(tmp_path / "r.csv")]) == 0
    said = capsys.readouterr()
    assert said.out == "t,tau.j\n0.0,0.7\n1.0,0.7\n"
    assert "tau in N m: rigid bodies and rotors (j 0.25 kg m^2), without friction\n" in said.err
    assert main(["simulate", str(tmp_path / "r.xml"), "--duration", "0.1", "--out", str(tmp_path / "m.csv")]) == 0
    assert "rigid bodies and rotors (j 0.25 kg m^2): no friction, stops" in capsys.readouterr().out


def test_limits_that_the_torques_exceed_are_said(lift, tmp_path, capsys):
    file = tmp_path / "rest.csv"
    file.write_text("t,q.up,qd.up,qdd.up\n0,0.5,0,0\n0.1,0.5,0,5.19\n")
    assert main(["torques", lift, str(file)]) == 0
    assert capsys.readouterr().err.splitlines()[2:] == [
        "tau in N: only rigid bodies, without friction and inertia of the drives",
        "limits exceeded: 1",
        "  up: torque 30 N above 25 N, worst at 0.1 s, first at 0.1 s",
    ]


def test_numbers_after_an_option_may_be_negative_and_separated_by_commas():
    words = ["torques", "a.urdf", "m.csv", "--gravity", "-1e-3,2", "-3.5", "--payload", ".5", "--out", "x.csv"]
    assert join_numbers(words) == [*words[:3], "--gravity=-1e-3,2 -3.5", "--payload=.5", "--out", "x.csv"]
    assert join_numbers(["check", "1.urdf", "--all"]) == ["check", "1.urdf", "--all"]


WRONG = {
    "q0 of another robot": (
        ["simulate", "{lift}", "--q0", "1", "2", "--duration", "1", "--out", "{dir}/m.csv"],
        "--q0: must be 1 numbers, for up; got 2",
    ),
    "q0 in words": (
        ["simulate", "{lift}", "--q0", "up", "--duration", "1", "--out", "{dir}/m.csv"],
        "argument --q0: must be numbers separated by blanks or commas, got 'up'; rne simulate --help shows what there is",
    ),
    "duration that is none": (
        ["simulate", "{lift}", "--duration", "nan", "--out", "{dir}/m.csv"],
        "argument --duration: must be one number, got 'nan'; rne simulate --help shows what there is",
    ),
    "two durations": (
        ["simulate", "{lift}", "--duration", "1", "2", "--out", "{dir}/m.csv"],
        "argument --duration: must be one number, got '1 2'; rne simulate --help shows what there is",
    ),
    "negative duration": (
        ["simulate", "{lift}", "--duration", "-1", "--out", "{dir}/m.csv"],
        "--duration must not be negative, got -1.0",
    ),
    "no duration": (
        ["simulate", "{lift}", "--out", "{dir}/m.csv"],
        "the following arguments are required: --duration; rne simulate --help shows what there is",
    ),
    "samples farther apart than the end": (
        ["simulate", "{lift}", "--duration", "1", "--every", "2", "--out", "{dir}/m.csv"],
        "--every: must be positive and at most the duration of 1 s, got 2",
    ),
    "solver that there is not": (
        ["simulate", "{lift}", "--duration", "1", "--method", "Euler", "--out", "{dir}/m.csv"],
        "--method must be 'auto' or one of ['RK45', 'RK23', 'DOP853', 'Tsit5', 'Radau', 'BDF', 'LSODA', 'Rodas5P'], "
        "got 'Euler'",
    ),
    "gravity in two axes": (
        ["simulate", "{lift}", "--duration", "1", "--gravity", "0 -9.81", "--out", "{dir}/m.csv"],
        "--gravity must have shape (3,), got (2,)",
    ),
    "another kind of file": (
        ["simulate", "{lift}", "--duration", "1", "--out", "{dir}/m.txt"],
        "--out: must end in .npz or .csv, got '{dir}/m.txt'",
    ),
    "no folder": (
        ["simulate", "{lift}", "--duration", "1", "--out", "{dir}/none/m.csv"],
        "--out: there is no folder '{dir}/none'",
    ),
    "out is a folder": (["torques", "{lift}", "{motion}", "--out", "{dir}"], "--out: '{dir}' is a folder, not a file"),
    "out is the motion": (
        ["torques", "{lift}", "{motion}", "--out", "{motion}"],
        "--out: '{motion}' is the motion that is read; name another file",
    ),
    "link without payload": (
        ["torques", "{lift}", "{motion}", "--payload-link", "car"],
        "--payload-link: needs --payload",
    ),
    "centre without payload": (
        ["torques", "{lift}", "{motion}", "--payload-com", "0 0 1"],
        "--payload-com: needs --payload",
    ),
    "centre in two axes": (
        ["torques", "{lift}", "{motion}", "--payload", "1", "--payload-com", "0 1"],
        "--payload-com must have shape (3,), got (2,)",
    ),
    "inertia of three numbers": (
        ["torques", "{lift}", "{motion}", "--payload", "1", "--payload-inertia", "1 1 1"],
        "--payload-inertia: must be 6 numbers, xx yy zz xy xz yz, got 3",
    ),
    "another joint locked": (
        ["torques", "{lift}", "{motion}", "--locked", "down=1"],
        "--locked must name joints of ['up'], got 'down'",
    ),
    "a joint locked twice": (
        ["torques", "{lift}", "{motion}", "--locked", "up=1,up=2"],
        "argument --locked: must be JOINT=Q of each joint once, separated by commas, got 'up=1,up=2'; rne torques --help "
        "shows what there is",
    ),
    "a unit given twice": (
        ["identify", "{lift}", "{motion}", "--units", "q=deg", "--units", "q=rad"],
        "--units: must name each quantity once, or be given once without a quantity",
    ),
    "columns of all and of one": (
        ["identify", "{lift}", "{motion}", "--columns", "t,q.up", "--columns", "tau=3"],
        "--columns: must name each quantity once, or be given once without a quantity",
    ),
    "a lock without a position": (
        ["torques", "{lift}", "{motion}", "--locked", "up"],
        "argument --locked: must be JOINT=Q of each joint once, separated by commas, got 'up'; rne torques --help shows what there is",
    ),
    "negative tolerance": (
        ["compare", "{lift}", "{lift}", "--tolerance", "-1"],
        "--tolerance must be positive, got -1.0",
    ),
    "negative payload": (
        ["torques", "{lift}", "{motion}", "--payload", "-1"],
        "--payload on link 'car': the mass must be 0 or positive, got -1.0",
    ),
    "no robot": (
        ["torques", "irb14", "{motion}"],
        "'irb14' is neither a file nor one of rne.robots(); did you mean 'irb140'?",
    ),
    "another robot's motion": (
        ["torques", "irb140", "{motion}"],
        "{motion}, row 1: there are 'q.up', but no column of a joint here, such as 'q.joint_1'; the first row must be "
        "t,q.joint_1,q.joint_2,q.joint_3,q.joint_4,q.joint_5,"
        "q.joint_6, with qd. and qdd. of the joints if they are known",
    ),
    "another heading": (
        ["torques", "{lift}", "{headed}"],
        "{headed}, row 1: there is no column 't'; there are 'time', 'up'; the first row must be t,q.up, with qd. and "
        "qdd. of the joints if they are known",
    ),
    "no motion": (["torques", "{lift}", "{dir}/none.csv"], "{dir}/none.csv: No such file or directory"),
    "folder for a motion": (["torques", "{lift}", "{dir}"], "{dir}: Is a directory"),
    "picture for a motion": (
        ["torques", "{lift}", "{picture}"],
        "{picture}: is not a text file in UTF-8; a CSV file is needed",
    ),
    "archive for a motion": (
        ["torques", "{lift}", "{archive}"],
        "{archive}: is not a text file in UTF-8; a CSV file is needed",
    ),
    "empty motion": (["torques", "{lift}", "{empty}"], "{empty}: the file is empty"),
    "one position alone": (
        ["torques", "{lift}", "{single}"],
        "{single}: velocities and accelerations are missing, and no spline gives them: "
        "`t` must have shape (K,) with two times at least, got (1,)",
    ),
    "folder for a robot": (
        ["torques", "{dir}", "{motion}"],
        "{dir}: file: is not a regular file; give the path of a URDF file",
    ),
    "check of a folder": (["check", "{dir}"], "{dir}: is a folder; a URDF file is needed"),
    "check of a picture": (["check", "{picture}"], "{picture}: is not an XML file; a URDF file is needed"),
    "check of an archive": (["check", "{archive}"], "{archive}: is not an XML file; a URDF file is needed"),
    "check of an empty file": (["check", "{empty}"], "{empty}: is not an XML file; a URDF file is needed"),
}


@pytest.mark.parametrize("case", WRONG)
def test_a_wrong_call_is_answered_in_one_line(case, lift, tmp_path, capsys, monkeypatch):
    monkeypatch.setattr("sys.argv", ["rne"])
    places = {"lift": lift, "dir": str(tmp_path)}
    for name, content in {
        "motion": b"t,q.up\n0,0.1\n1,0.2\n",
        "single": b"t,q.up\n0,0.1\n",
        "picture": b"\x89PNG\r\n\x1a\n\x00\x00\xff",
        "empty": b"",
        "headed": b"time,up\n0,0.1\n",
    }.items():
        (tmp_path / name).write_bytes(content)
        places[name] = str(tmp_path / name)
    np.savez(tmp_path / "archive.npz", a=np.zeros(3))
    places["archive"] = str(tmp_path / "archive.npz")
    words, message = WRONG[case]
    try:
        code = main([word.format(**places) for word in words])
    except SystemExit as ending:
        code = ending.code
    said = capsys.readouterr()
    assert said.err == f"error: {message.format(**places)}\n"
    assert code == 2
    assert said.out.count("error") == 0


def test_a_command_that_there_is_not_is_answered_in_one_line(capsys):
    with pytest.raises(SystemExit, match=r"^2$"):
        main(["chek"])
    near = "error: argument COMMAND: invalid choice: 'chek'; did you mean 'check' or 'cache'?; "
    assert capsys.readouterr().err.startswith(near)
    with pytest.raises(SystemExit, match=r"^2$"):
        main(["source", "irb140", "--quantity", "massmatrix"])
    assert "'massmatrix'; did you mean 'mass_matrix'?" in capsys.readouterr().err
    with pytest.raises(SystemExit, match=r"^2$"):
        main(["source", "irb140", "--dtyp", "float32"])
    assert re.fullmatch(
        r"error: unrecognized arguments: --dtyp float32; .*rne source --help shows what there is\n",
        capsys.readouterr().err,
    )


@pytest.mark.parametrize("command", ["source", "simulate"])
@pytest.mark.parametrize("content", [b"", b"\x89PNG\r\n\x1a\n\x00\x00\xff", b"PK\x03\x04\x14\x00"])
def test_a_robot_that_is_no_urdf_is_answered_in_one_line(command, content, tmp_path, capsys):
    """The reason is the XML parser's own, which differs between its versions."""
    is_what = r"is not well-formed XML \(.+\); give a URDF file, .*" if content else "is empty; give a URDF file"
    (tmp_path / "robot").write_bytes(content)
    options = [] if command == "source" else ["--duration", "1", "--out", str(tmp_path / "m.csv")]
    assert main([command, str(tmp_path / "robot"), *options]) == 2
    said = capsys.readouterr()
    pattern = re.escape(f"error: {tmp_path / 'robot'}") + rf"(:\d+)?: file: {is_what}\n"
    assert re.fullmatch(pattern, said.err)
    assert said.out == ""


def test_a_place_without_permission_is_refused_before_anything_is_computed(lift, tmp_path, capsys, monkeypatch):
    def refuse(*_, **__):
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr("tempfile.TemporaryFile", refuse)  # the owner root may write anywhere
    monkeypatch.setattr("rne.simulate", lambda *_, **__: pytest.fail("a motion was simulated"))
    out = tmp_path / "m.csv"
    assert main(["simulate", lift, "--duration", "1", "--out", str(out)]) == 2
    assert capsys.readouterr().err == f"error: --out: cannot write {str(out)!r}: Permission denied\n"


def test_a_refused_call_leaves_the_old_file(lift, tmp_path):
    out = tmp_path / "m.csv"
    out.write_text("kept")
    assert main(["simulate", lift, "--duration", "-1", "--out", str(out)]) == 2
    assert out.read_text() == "kept"


def test_a_simulation_that_fails_is_told_with_exit_code_1(tmp_path, capsys):
    """A massless link leaves no forward dynamics."""
    path = tmp_path / "massless.urdf"
    path.write_text(re.sub(r"<inertial>.*</inertial>", "", LIFT, flags=re.DOTALL))
    assert main(["simulate", str(path), "--duration", "1", "--out", str(tmp_path / "m.csv")]) == 1
    assert capsys.readouterr().err.startswith("error: ")
    assert not (tmp_path / "m.csv").exists()


def test_an_interrupted_command_leaves_no_traceback(lift, tmp_path, capsys, monkeypatch):
    def interrupt(*_, **__):
        raise KeyboardInterrupt

    monkeypatch.setattr("rne.simulate", interrupt)
    assert main(["simulate", lift, "--duration", "1", "--out", str(tmp_path / "m.csv")]) == 130
    assert capsys.readouterr().err == "interrupted\n"


def test_every_command_takes_the_names_of_robots(capsys):
    assert main(["check", "irb140"]) == 0
    assert capsys.readouterr().out == "irb140: no findings\n"
    assert main(["check", "irb14"]) == 2
    assert capsys.readouterr().err.startswith("error: 'irb14' is neither a file nor")
    assert main(["urdf", "ur5"]) == 0
    assert '<robot name="ur5">' in capsys.readouterr().out


def test_a_robot_of_example_robot_data_goes_by_its_name(tmp_path, capsys):
    assert main(["check", "ur5"]) == 0
    assert capsys.readouterr().out.endswith("ur5_robot.urdf: 1 warning: loads as written\n")  # angles to 11 decimals
    assert main(["simulate", "ur5", "--duration", "0.01", "--out", str(tmp_path / "m.csv")]) == 0
    assert main(["torques", "ur5", str(tmp_path / "m.csv")]) == 0


class TestReportOnARobot:
    @pytest.mark.parametrize("pictures", kept_parameters([False, True], [False]))
    def test_page_on_a_file(self, lift, tmp_path, capsys, monkeypatch, pictures):
        monkeypatch.setattr(html_page, "DPI", 50)  # the pictures are not looked at
        monkeypatch.setattr(html_page, "FILM_FPS", 1.0)
        if not pictures:
            monkeypatch.setitem(sys.modules, "matplotlib", None)
        assert main(["report", lift, "--out", str(tmp_path / "page")]) == 0
        said = capsys.readouterr().out
        page = (tmp_path / "page" / "index.html").read_text(encoding="utf-8")
        # 2 kg lifted by 2 * 9.81 N of 25 N
        assert re.search(r"^ +up +2 +19\.62 +19\.62 +78%$", said, re.MULTILINE)
        assert re.search(r">0 to 1 m</td><td[^>]*>2 m/s</td><td[^>]*>25 N</td>", page)
        assert "lift.urdf: 1 warning: loads as written" in page or "lift.urdf: no findings" in page
        assert ">NO</td>" not in page
        made = {"index.html", "swing.html"} | ({"swing.gif", "swing_1.png"} if pictures else set())
        assert {file.name for file in (tmp_path / "page").iterdir()} >= made
        assert all(map(is_marked, (tmp_path / "page").iterdir()))  # by which the next call may replace it

    def test_sliding_joints_are_held_while_the_arm_swings(self, tmp_path, capsys, monkeypatch):
        monkeypatch.setitem(sys.modules, "matplotlib", None)  # no pictures
        monkeypatch.setattr(html_page, "view", lambda motion, _: None)
        (tmp_path / "scara.urdf").write_text(SCARA)
        assert main(["report", str(tmp_path / "scara.urdf"), "--out", str(tmp_path)]) == 0
        said = capsys.readouterr().out
        assert "Sliding joints are held: c." in said
        assert "Joints that gravity hardly moves are pushed [N m]: a by " in said
        assert " evaluations of the accelerations; the energy balance is met within " in said

    def test_a_robot_without_a_file_has_no_findings(self, tmp_path, capsys, monkeypatch):
        monkeypatch.setitem(sys.modules, "matplotlib", None)  # no pictures
        monkeypatch.setattr(html_page, "view", lambda motion, _: None)
        assert main(["report", "irb140", "--out", str(tmp_path)]) == 0
        assert "Findings" not in capsys.readouterr().out

    def test_crossed_ends_of_a_range_are_a_finding(self, tmp_path, capsys, monkeypatch):
        monkeypatch.setitem(sys.modules, "matplotlib", None)  # no pictures
        monkeypatch.setattr(html_page, "view", lambda motion, _: None)
        path = tmp_path / "scara.urdf"
        path.write_text(re.sub('lower="([^"]*)" upper="([^"]*)"', r'lower="\2" upper="\1"', SCARA))
        assert main(["report", str(path), "--out", str(tmp_path)]) == 0
        assert "is above upper" in capsys.readouterr().out

    def test_a_robot_that_there_is_not(self, tmp_path, capsys):
        assert main(["report", "nobody", "--out", str(tmp_path)]) == 2
        assert capsys.readouterr().err == "error: 'nobody' is neither a file nor one of rne.robots()\n"


def test_torques_of_a_pendulum_that_cancel_are_no_difference(tmp_path, capsys, monkeypatch):
    """Of 1000 random states some need nearly no torque: what is left there is rounding of its terms."""
    monkeypatch.setitem(sys.modules, "matplotlib", None)  # no pictures
    path = tmp_path / "pendulum.urdf"
    path.write_text(
        '<robot name="pendulum"><link name="base"/><link name="rod"><inertial><origin xyz="0 0 -0.5"/><mass value="1.3"/>'
        '<inertia ixx="0.11" ixy="0" ixz="0" iyy="0.1" iyz="0" izz="0.01"/></inertial></link><joint name="turn" '
        'type="continuous"><parent link="base"/><child link="rod"/><axis xyz="0 1 0"/></joint></robot>'
    )
    assert main(["report", str(path), "--out", str(tmp_path / "page")]) == 0
    assert " NO" not in capsys.readouterr().out


PAGE = (ROOT / "docs" / "reference" / "command-line.md").read_text(encoding="utf-8")
SESSION = re.compile(r"^```sh\n(.*?)^```\n(?:\n```text\n(.*?)^```$)?", re.DOTALL | re.MULTILINE)


def without_numbers(text):
    """Energy drifts and last digits are others on other processors."""
    return re.sub(r"\d+(\.\d+)?(e-\d+)?", "#", text)


def test_page_of_the_command_line_lists_every_command():
    listed = re.findall(r"^\| `rne (\w+)", PAGE, re.MULTILINE)
    assert sorted(listed) == sorted(NAMES)


def test_session_of_the_page_prints_what_it_says(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    for lines, said in SESSION.findall(PAGE):
        for line in lines.splitlines():
            words, _, file = line.partition(" > ")
            if words.startswith("rne view"):
                assert parser().parse_args(words.split()[1:]).out.name == "arm.html"  # test_view.py writes such pages
                continue
            assert main(words.split()[1:]) == 0
            printed = capsys.readouterr().out
            if file:
                (tmp_path / file).write_text(printed, encoding="utf-8")
        if said:
            assert without_numbers(printed) == without_numbers(said)
