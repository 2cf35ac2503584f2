"""Logs as robots write them: every kind of file, made by the library that writes it, gives the samples it was made of."""

import bz2
import itertools
import json
import re
import shutil
import struct

import numpy as np
import pytest
from scipy.io import savemat

import rne
from rne.__main__ import main, parser
from rne.commands.identifying import _record
from rne.files.log_columns import _meaning as meaning
from rne.files.ros_bags import _unpacked
from rne.files.samples import read_samples
from rne.files.tables import as_number, numeric_block
from rne.identification import Record

JOINTS = ("shoulder", "elbow", "wrist")
T = np.arange(200) / 100
W = np.array([2.0, 3.0, 4.0])
Q, QD, TAU = np.sin(np.outer(T, W)), W * np.cos(np.outer(T, W)), 5 * np.cos(np.outer(T, W[::-1]))
EPOCH = 1_700_000_000_123_000_000  # [ns]
NS = [EPOCH + 10_000_000 * k for k in range(len(T))]
NUMBERS = "numbered columns are taken in the robot's order; else give their names as `joints`"
ALIKE = "else name the columns alike"
CUT = "remove the row if the log was cut off there"
TOO_LARGE = (
    "bytes in double precision, the most for a file of its size; write fewer samples, or fewer other arrays, to a file"
)
EXACT, ROUNDED = 0.0, 4 * np.finfo(float).eps * 200  # one rounding to degrees and back, of up to 200


def exactly(text):
    return pytest.raises(ValueError, match=f"^{re.escape(text)}$")


def table(path, names, *columns, separator=",", decimal=".", heading=""):
    rows = [separator.join(f"{x!r}" for x in row).replace(".", decimal) for row in np.column_stack(columns).tolist()]
    path.write_text("\n".join([*heading.splitlines(), *([separator.join(names)] if names else []), *rows, ""]))
    return path


def names_of(*quantities, joints=JOINTS, form="{}.{}"):
    return [form.format(x, joint) for x in quantities for joint in joints]


def same(record, joints=JOINTS, tolerance=EXACT, velocities=True, t0=0.0):
    """The record has the samples above."""
    assert record.joint_names == tuple(joints)
    assert abs(record.t - T - t0).max() <= 4 * np.finfo(float).eps * (1 + t0 + T[-1])
    for given, expected in ((record.q, Q), (record.tau, TAU), *([(record.qd, QD)] if velocities else [])):
        assert abs(given - expected).max() <= tolerance
    assert velocities or record.qd is None


def guesses(record):
    return [finding.message for finding in record.findings if finding.kind == "guess"]


# Text


@pytest.mark.parametrize(
    ("separator", "decimal"), [(",", "."), (";", ","), (";", "."), ("\t", ","), ("  ", "."), (" ", ",")]
)
def test_separators_and_decimal_commas_are_found(separator, decimal, tmp_path):
    path = table(
        tmp_path / "log.csv", ["t", *names_of("q", "qd", "tau")], T, Q, QD, TAU, separator=separator, decimal=decimal
    )
    record = Record.from_log(path)
    same(record)
    assert guesses(record) == []
    assert record.name == "log.csv"
    if separator != ",":
        assert record.source.startswith(
            f"separator {separator[0]!r}, decimal sign {decimal!r}; t: 't'; q: 'q.shoulder' to 'q.wrist'"
        )
    given = Record.from_log(path, separator=separator[0], decimal=decimal)
    assert np.array_equal(given.q, record.q)


def test_a_separator_that_is_not_guessed_can_be_given(tmp_path):
    path = table(tmp_path / "log.csv", ["t", *names_of("q", "tau")], T, Q, TAU, separator="|")
    same(Record.from_log(path, separator="|"), velocities=False)


ENTRIES = ["7", "-1.5", "1e5", "-1e+05", "1E-3", ".5", "-.5", "5.", "+1", "007", "-0", "1e-400", "1e999", "1.2.3", "1e", "1e-", "1-2", "--1", "-+1", "1e5.3", "1ee5", "nan", "-inf", "0x1", "1_0", "٣", "-", ".", "-.", "e5", ".e1", "1,", "1;2", "1d5", '"1"', '"1"', "2026-11-29", "", " 1", "1 ", "1 2", "\t1", "1\r", "1\x0c2"]  # fmt: skip


@pytest.mark.parametrize(("separator", "decimal"), [(",", "."), (";", ","), ("\t", "."), (" ", ".")])
def test_tables_that_are_read_at_once_are_those_that_are_read_by_entry(separator, decimal):
    """One odd entry in a table: each number is that of float(), or the table is left to the careful reader."""
    numbers = np.random.default_rng(0).normal(size=(6, 3)) * 10.0 ** np.arange(-4, 5, 4)
    at_once = set()
    for entry, (row, column) in itertools.product(ENTRIES, ((0, 0), (3, 1), (5, 2))):
        cells = [[f"{x!r}".replace(".", decimal) for x in line] for line in numbers.tolist()]
        cells[row][column] = entry
        text = "\n".join(["# t q tau", *map(separator.join, cells)])
        found = numeric_block(text + "\n" * (row == 3), separator, decimal)
        if found is not None:
            lines = [line.split(separator if separator != " " else None) for line in text.splitlines()[1:]]
            np.testing.assert_array_equal(found[1].numbers, [[as_number(x, decimal) for x in line] for line in lines])
            assert (found[0], found[1].places) == ("# t q tau\n", range(2, 8))
            at_once.add(entry)
    assert at_once >= {"7", "1e5", "-0", "007"}
    moved = [*map(separator.join, [["1", "2"], ["1", "2", "3", "4"], ["1", "2", "3"]])]  # nine entries of three rows
    assert numeric_block("\n".join(["a", "1 2 3".replace(" ", separator), *moved]), separator, decimal) is None
    as_they_are = [separator.join(f"{x!r}".replace(".", decimal) for x in line) for line in numbers.tolist()]
    above, read = numeric_block("\r\n".join(["a", *as_they_are]), separator, decimal)
    assert above == "a\r\n"
    np.testing.assert_array_equal(read.numbers, numbers)


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("t", ("t", "", "")),
        ("Time [ms]", ("t", "", "ms")),
        ("time_us", ("t", "", "us")),
        ("q.joint_1", ("q", "joint_1", "")),
        ("q.position motor", ("q", "position motor", "")),
        ("actual_q_0", ("q", "0", "")),
        ("actual_current_5", ("current", "5", "")),
        ("dq_3", ("qd", "3", "")),
        ("tau_J_0", ("tau", "0", "")),
        ("joint1 pos [deg]", ("q", "joint1", "deg")),
        ("joint1 pos (°)", ("q", "joint1", "deg")),
        ("torque_A1 (N m)", ("tau", "A1", "Nm")),
        ("shoulder_pan.pos", ("q", "shoulder_pan", "")),
        ("observation.state.shoulder_pan.pos", ("q", "shoulder_pan", "")),
        ("observation.state.3", ("q", "3", "")),
        ("panda_joint1.effort", ("tau", "panda_joint1", "")),
        ("left_arm_q1", ("q", "left_arm_1", "")),
        ("jointPosition1", ("q", "joint_1", "")),
        ("q[2]", ("q", "2", "")),
        ("q_dot_2", ("qd", "2", "")),
        ("qDot[2]", ("qd", "2", "")),
        ("q_vel_2", ("qd", "2", "")),
        ("theta_dot_2", ("qd", "2", "")),
        ("theta2", ("q", "2", "")),
        ("theta2_effort", ("tau", "2", "")),
        ("tau_q2", ("tau", "2", "")),
        ("current_position_2", ("q", "2", "")),
        ("Present Position 2", ("q", "2", "")),
        ("torque_current_2", ("current", "2", "")),
        ("MotorTorque.A2 [N·m]", ("tau", "A2", "Nm")),
        ("A2 (degrees)", ("q", "A2", "deg")),
        ("position[left wrist]", ("q", "left wrist", "")),
        ("J2 torque [counts]", ("tau", "2", "counts")),
        ("speed J2 [1/min]", ("qd", "2", "rpm")),
        ("vel_2_rad_s", ("qd", "2", "rad/s")),
        ("arm_vel_deg_per_sec", ("qd", "arm", "deg/s")),
        ("arm_torque_N_m", ("tau", "arm", "Nm")),
        ("arm_current_A", ("current", "arm", "A")),
        ("Speed A2 [RAD s^-1]", ("qd", "A2", "rad/s")),
        ("Torque A2 (N-m)", ("tau", "A2", "Nm")),
        ("panda_joint2_eff", ("tau", "panda_joint2", "")),
        ("motor_state[2].tau_est", ("tau", "motor_state_2", "")),
        ("qvel_elbow", ("qd", "elbow", "")),
        ("dQ2", ("qd", "2", "")),
        ("dTheta_elbow", ("qd", "elbow", "")),
        ("τ2", ("tau", "2", "")),
        ("épaule_position", ("q", "épaule", "")),
        ("/arm/joint_states/elbow/velocity", ("qd", "elbow", "")),
        ("/arm/joint_states/position[4]", ("q", "4", "")),
        ("joint_states_elbow_effort", ("tau", "elbow", "")),
        ("/arm_controller/state/actual/positions.4", ("q", "4", "")),
        ("left_q.4", ("q", "left_4", "")),
        ("/joint_states/torque_tube/angle", ("q", "torque_tube", "")),
        ("velocity[state_joint]", ("qd", "state_joint", "")),
        ("effort.t", ("tau", "t", "")),
        ("x.q", ("q", "x", "")),
        ("run.q.4", ("q", "4", "")),
        ("header.stamp", ("t", "header", "")),
        *((name, ("", "", "")) for name in ("temperature_1", "index", "loop_time", "robot_state", "qdd_1", "ddQ1", "q_ddot_1", "dtau_J_1", "acceleration_1")),
    ],
)  # fmt: skip
def test_names_of_columns(name, expected):
    assert meaning(name) == (*expected, None, "")


@pytest.mark.parametrize(
    ("name", "own"),
    [
        *((name, "") for name in ("target_q_0", "effort_limit_1", "max pos 1", "action.elbow.pos", "/arm/desired/positions[0]", "position_soll_A1", "MAIN.Axis_1.SetPos")),
        ("d3_pos", "d3"),
        ("q_d_1", "d_1"),
        ("tau_ext_3", "ext_3"),
        ("ref_arm_effort", "ref_arm"),
    ],
)  # fmt: skip
def test_names_of_commands(name, own):
    """They may be those of joints only where the word beside the joint is no clear one."""
    assert meaning(name).own == own


def test_logs_of_a_controller_by_numbers(tmp_path):
    """Asked-for values stand beside the measured ones; times are milliseconds, angles degrees, which is guessed and said."""
    names = [
        "timestamp",
        *(f"{x}_{k}" for x in ("target_q", "actual_q", "actual_qd", "actual_torque") for k in range(3)),
    ]
    path = table(tmp_path / "ur.csv", names, 1e3 * T, 0 * Q, 60 * np.degrees(Q), 60 * np.degrees(QD), TAU)
    record = Record.from_log(path)
    assert record.joint_names == ("joint_1", "joint_2", "joint_3")
    assert abs(record.q - 60 * Q).max() <= 60 * ROUNDED
    assert abs(record.t - T).max() <= ROUNDED
    numbers, degrees, stamps = guesses(record)
    assert numbers == f"ur.csv: guess that {NUMBERS}"
    assert (
        degrees == 'ur.csv: guess that positions are in degrees, as most pass two turns; else give units={"q": "rad"}'
    )
    assert re.fullmatch(
        r"ur\.csv: guess that column 'timestamp' looks like milliseconds, .*; else give time_unit=\"s\"", stamps
    )
    given = Record.from_log(path, units={"q": "deg"}, time_unit="ms")
    assert guesses(given) == [numbers]
    assert np.array_equal(given.q, record.q)
    part = record.between(0.5, 1.0)
    assert (guesses(part), part.source) == (guesses(record), record.source)
    for options, text in (({"units": {"q": "rad"}}, 1), ({"time_unit": "ms"}, 1)):
        assert len(guesses(Record.from_log(path, joints=JOINTS, **options))) == text + 1


def test_units_are_read_from_names_and_given(tmp_path):
    names = ["Time [ms]", *names_of("pos", "vel", "torque", form="{1} {0} [%]")]
    units = ["deg"] * 3 + ["rpm"] * 3 + ["mNm"] * 3
    named = [names[0], *(name.replace("%", unit) for name, unit in zip(names[1:], units, strict=True))]
    path = table(tmp_path / "log.csv", named, 1e3 * T, np.degrees(Q), QD * 30 / np.pi, 1e3 * TAU)
    same(Record.from_log(path), tolerance=1e3 * ROUNDED)
    assert guesses(Record.from_log(path)) == []
    path = table(tmp_path / "log.csv", ["t", *names_of("q", "tau")], T, Q / [0.5, 1, np.pi / 180], TAU)
    same(Record.from_log(path, units={"q": [0.5, "rad", "deg"]}), tolerance=ROUNDED, velocities=False)
    for units, text in (
        (
            {"q": "grad"},
            "`units` of q must be 'rad', 'deg', 'm', 'mm', or a number of SI units, for all or 3 joints, got 'grad'",
        ),
        (
            {"q": ["deg"]},
            "`units` of q must be 'rad', 'deg', 'm', 'mm', or a number of SI units, for all or 3 joints, got ['deg']",
        ),
        (
            {"torque": "Nm"},
            '`units` must be a mapping of "q", "qd", "tau", "command" and "command_rate", got {\'torque\': \'Nm\'}',
        ),
        ("deg", '`units` must be a mapping of "q", "qd", "tau", "command" and "command_rate", got \'deg\''),
    ):
        with exactly(text):
            Record.from_log(path, units=units)
    each = ["t", "q.turn [deg]", "q.lift [mm]", "qd.turn [°/s]", "qd.lift [mm/s]", "tau.turn [N·m]", "tau.lift [N]"]
    x = [T, np.degrees(Q[:, 0]), 1e3 * Q[:, 1], np.degrees(QD[:, 0]), 1e3 * QD[:, 1], TAU[:, :2]]
    record = Record.from_log(table(path, each, *x))
    for given, expected in ((record.q, Q), (record.qd, QD), (record.tau, TAU)):
        assert abs(given - expected[:, :2]).max() < ROUNDED
    for wrong, text in (
        ("tau.lift", "some of the columns 'tau.turn [N·m]' to 'tau.lift' name no unit; give units={'tau': ...}"),
        ("tau.lift [%]", "the unit '%' of column 'tau.lift [%]' is not known; give units={'tau': ...}, by name or as SI units per unit of the log"),
    ):  # fmt: skip
        with exactly(f"{path}: {text}"):
            Record.from_log(table(path, [*each[:-1], wrong], *x))


def test_degrees_are_guessed_where_most_joints_turn_twice_and_not_where_half_do(tmp_path):
    names = ["t", *(f"{x}.{y}" for x in ("q", "tau") for y in ("joint", "motor"))]
    path = table(tmp_path / "log.csv", names, T, Q[:, :1], 100 * Q[:, :1], TAU[:, :2])
    record = Record.from_log(path)
    assert guesses(record) == []
    np.testing.assert_array_equal(record.q, Q[:, :1] * [1, 100])


def test_times_since_1970_count_from_the_first(tmp_path):
    path = table(tmp_path / "log.csv", ["t", *names_of("q", "tau")], T + 1.7e9, Q, TAU)
    record = Record.from_log(path)
    assert abs(record.t - T).max() < 1e-6  # double precision
    assert record.source.startswith("times from the first sample on, at 1700000000.000 s; t: 't'")


def test_a_text_with_a_long_head_and_thousands(tmp_path):
    path = table(
        tmp_path / "log.csv", ["t", *names_of("q", "tau")], T, Q, TAU, separator=";", decimal=",", heading="a, b\n" * 30
    )
    same(Record.from_log(path), velocities=False)
    path.write_text(path.read_text().replace("5,0;5,0;5,0", "1.005;5,0;5,0"))
    with exactly(f"{path}, row 32, column 'tau.shoulder': must be a finite number, got '1.005'"):
        Record.from_log(path)


def test_columns_without_names(tmp_path):
    path = table(tmp_path / "log.txt", [], T, TAU, 0 * T, Q, separator=" ")
    text = 'the names of its 8 columns are missing; give them, such as columns=["t", "q.shoulder", "tau.shoulder"], with "" for one to ignore'
    with exactly(f"{path}: {text}"):
        Record.from_log(path)
    same(Record.from_log(path, columns=["t", *names_of("tau"), "", *names_of("q")]), velocities=False)
    numbered = Record.from_log(path, columns={"t": 0, "q": [5, 6, 7], "tau": [1, 2, 3]}, joints=JOINTS)
    same(numbered, velocities=False)
    with exactly(f"{path}, row 1: must have 7 entries, got 8; {CUT}"):
        Record.from_log(path, columns=["t", *names_of("tau", "q")])
    with exactly(
        f"{path}: there is no column 8, which `columns` asks for; there are '0', '1', '2', '3', '4', '5', '6', '7'"
    ):
        Record.from_log(path, columns={"t": 8, "q": [5], "tau": [1]})


def test_a_file_for_each_quantity(tmp_path):
    files = {
        "q": table(tmp_path / "positions.csv", ["t", *JOINTS], T, Q),
        "qd": table(tmp_path / "velocities.csv", ["t", *JOINTS], T, QD),
        "tau": table(tmp_path / "efforts.csv", ["t", *JOINTS], T, TAU),
    }
    same(Record.from_log(files))
    bare = {
        kind: table(tmp_path / f"{kind}.txt", [], x, separator=" ") for kind, x in (("t", T), ("q", Q), ("tau", TAU))
    }
    same(Record.from_log(bare, joints=JOINTS), velocities=False)
    same(Record.from_log({"q": bare["q"], "tau": bare["tau"]}, joints=JOINTS, sample_rate=100), velocities=False)
    table(files["tau"], ["t", *JOINTS], T + 1e-3, TAU)
    with exactly(f"{files['tau']}: its times are not those of {files['q']}; interpolate by numpy.interp"):
        Record.from_log(files)
    with exactly(
        f"{bare['q']}: there are no times; there are 'q.0', 'q.1', 'q.2', 'tau.0', 'tau.1', 'tau.2'; give columns={{\"t\": ...}} or `sample_rate`"
    ):
        Record.from_log({"q": bare["q"], "tau": bare["tau"]})
    with exactly(
        '`path` must be a file, or files by "t", "q", "qd", "tau", "command" and "command_rate", got \'effort\''
    ):
        Record.from_log({"q": bare["q"], "effort": bare["tau"]})


def test_joints_are_chosen_by_name(tmp_path):
    """Fingers have positions and no torques, and are left out; their robot is locked there."""
    path = table(tmp_path / "log.csv", ["t", *names_of("q"), "q.finger", *names_of("tau")], T, Q, T, TAU)
    record = Record.from_log(path)
    same(record, velocities=False)
    assert "without torques, left out: 'finger'" in record.source
    two = Record.from_log(path, joints=["wrist", "elbow"])
    assert np.array_equal(two.q, Q[:, [2, 1]])
    with exactly(f"{path}: there are no positions and torques of joint 'wirst'; did you mean 'wrist'?"):
        Record.from_log(path, joints=["wirst"])
    with exactly(
        f"{path}: there are no positions and torques of joint 'finger'; there are 'shoulder', 'elbow', 'wrist'"
    ):
        Record.from_log(path, joints=["finger"])
    with exactly(
        f"{path}: there are no positions and torques of joint 'j1'; there are 'shoulder', 'elbow', 'wrist'; to name them so, give "
        'columns={"q": ..., "tau": ...} in the order of `joints`'
    ):
        Record.from_log(path, joints=["j1", "j2", "j3"])
    columns = {"q": names_of("q"), "tau": names_of("tau")}
    renamed = Record.from_log(path, joints=["j1", "j2", "j3"], columns=columns)
    same(renamed, ("j1", "j2", "j3"), velocities=False)
    assert guesses(renamed) == []
    moved = [*names_of("q"), *names_of("tau")]  # one name of three is the robot's, and of the next joint
    paths = table(tmp_path / "log.csv", ["t", *moved], T, Q, TAU)
    same(
        Record.from_log(paths, joints=("elbow", "wrist", "tool"), columns=columns),
        ("elbow", "wrist", "tool"),
        velocities=False,
    )
    numbered = table(tmp_path / "log.csv", ["t", "q1", "q2", "q3", "tau1", "tau2", "tau3"], T, Q, TAU)
    record = Record.from_log(numbered, joints=JOINTS)
    same(record, velocities=False)
    assert guesses(record) == [
        "log.csv: guess that 'q1' to 'q3' are of 'shoulder' to 'wrist' in this order; else name the columns alike"
    ]
    motors = table(tmp_path / "log.csv", ["t", "q1", "q2", "q3", *(f"motor {k} torque" for k in "123")], T, Q, TAU)
    assert guesses(Record.from_log(motors)) == [
        f"log.csv: guess that 'motor 1 torque' to 'motor 3 torque' are of the joints of 'q1' to 'q3' in this order; {ALIKE}",
        f"log.csv: guess that {NUMBERS}",
    ]


def rows_of(path, names, rows):
    path.write_text("\n".join([",".join(names), *rows]))
    return path


def test_names_in_the_file_come_before_numbers(tmp_path):
    """Lists of names, a column for each name, and arrays of names, of joints in another order than the robot's."""
    form = names_of("position", "velocity", "effort", joints="012", form="{}_{}")
    numbers = [",".join(map(repr, x)) for x in np.column_stack([Q, QD, TAU]).tolist()]
    path = tmp_path / "log.csv"
    bagpy = [
        f"{t!r},{k},\"['shoulder', 'elbow', 'wrist']\",{x}"
        for k, (t, x) in enumerate(zip(T.tolist(), numbers, strict=True))
    ]
    same(Record.from_log(rows_of(path, ["Time", "header.seq", "name", *form], bagpy)))
    assert Record.from_log(path).findings == ()
    listed = [
        f"{t!r},\"['shoulder', 'elbow', 'wrist']\",{','.join(chr(34) + str(x[k].tolist()) + chr(34) for x in (Q, QD, TAU))}"
        for k, t in enumerate(T.tolist())
    ]
    same(Record.from_log(rows_of(path, ["time", "name", "position", "velocity", "effort"], listed)))
    each = [f"{k // 100},{k % 100 * 10_000_000},shoulder,elbow,wrist,{x}" for k, x in enumerate(numbers)]
    stamped = ["header.stamp.sec", "header.stamp.nanosec", "name_0", "name_1", "name_2", *form]
    same(Record.from_log(rows_of(path, stamped, each)))
    with exactly(
        f"{path}: the names of joints must be different, and the same in all rows, got 'elbow', 'shoulder', 'wrist' and 'shoulder', 'elbow', 'wrist'; keep the rows of one, or read the bag as MCAP"
    ):
        Record.from_log(rows_of(path, stamped, [each[0].replace("shoulder,elbow", "elbow,shoulder"), *each[1:]]))
    with exactly(f"{path}, row 3: entry 2 must be a list of 3, got \"['finger']\""):
        Record.from_log(
            rows_of(
                path,
                ["t", "name", *form],
                [bagpy[0].replace(",0,", ","), f"0.01,\"['finger']\",{numbers[1]}", bagpy[2].replace(",2,", ",")],
            )
        )
    arrays = {"t": T, "q": Q, "qd": QD, "tau": TAU}
    np.savez(tmp_path / "log.npz", joint_names=np.array(JOINTS), **arrays)
    same(Record.from_log(tmp_path / "log.npz"))
    for names in (list(JOINTS), np.array(JOINTS, dtype=object)):
        savemat(tmp_path / "log.mat", {"run": {**arrays, "jointNames": names}})
        same(Record.from_log(tmp_path / "log.mat"))


def test_names_of_joints_that_fit_no_columns_are_refused(tmp_path):
    """Names of another count, without which numbered columns would be taken in the robot's order."""
    path = tmp_path / "log.csv"
    names = ["t", *(f"{x}_{k}" for x in ("position", "effort") for k in range(3))]
    table(path, [*names, "name_0", "name_1"], T, Q, TAU, np.tile(["'elbow'", "'wrist'"], (len(T), 1)))
    error = f"{path}: there are 2 names of joints, 'elbow' to 'wrist', and 3 numbered positions; give "
    path.write_text(path.read_text().replace("'", "").replace('"', ""))
    with exactly(f'{error}columns={{"q": ..., "tau": ...}} and `joints`'):
        Record.from_log(path)
    same(Record.from_log(path, columns={"q": names[1:4], "tau": names[4:]}, joints=JOINTS), velocities=False)
    np.savez(tmp_path / "log.npz", t=T, q=Q, tau=TAU[:, :2], joint_names=JOINTS)
    with pytest.raises(ValueError, match=r"no joint has positions and torques; positions are 'q\.1' to 'q\.3'"):
        Record.from_log(tmp_path / "log.npz", joints=JOINTS)


def test_columns_that_are_given_are_of_one_quantity(tmp_path):
    savemat(tmp_path / "log.mat", {"q": {"Time": T, "Data": Q}, "tau": {"Time": T, "Data": TAU}})
    record = Record.from_log(tmp_path / "log.mat", columns={"t": "q.Time"})
    same(record, ("Data.1", "Data.2", "Data.3"), velocities=False)
    assert guesses(record) == [
        f"log.mat: guess that 'tau.Time' are not of the joints of the positions and not read; {ALIKE}"
    ]


def test_numbers_come_before_the_order_in_the_file(tmp_path):
    """Numbers from 0 or 1, in any order; where one quantity is named, its names are of the numbers in this order."""
    path = tmp_path / "log.csv"
    for q, tau, qd in (("q1 q0 q2", "tau0 tau1 tau2", "dq_2 dq_0 dq_1"), ("q_2 q_1 q_3", "tau_0 tau_1 tau_2", "dq3 dq1 dq2"), ("q2 q1 q3", "tau.wrist tau.elbow tau.shoulder", "qd.elbow qd.wrist qd.shoulder")):  # fmt: skip
        qdot = QD[:, [2, 0, 1]] if qd.startswith("dq") else QD[:, [1, 0, 2]]
        record = Record.from_log(
            table(path, ["t", *q.split(), *qd.split(), *tau.split()], T, Q[:, [1, 0, 2]], qdot, TAU)
        )
        assert record.joint_names == (
            ("wrist", "elbow", "shoulder") if "wrist" in tau else ("joint_1", "joint_2", "joint_3")
        )
        for given, expected in ((record.q, Q), (record.qd, QD), (record.tau, TAU)):
            np.testing.assert_array_equal(given, expected)
        assert (f"log.csv: guess that {NUMBERS}" in guesses(record)) == ("wrist" not in tau)
    speeds = [f"TCP_speed_{k}" for k in range(3)]  # more velocities than joints name none of them
    names = ["t", *(f"{x}{k}" for x in ("q", "joint_torque", "qd") for k in (1, 2, 3)), *speeds]
    record = Record.from_log(table(path, names, T, Q, TAU, QD, Q))
    same(record, ("joint_1", "joint_2", "joint_3"))
    some = Record.from_log(table(path, ["t", "q1", "q3", "tau1", "tau3"], T, Q[:, :2], TAU[:, :2]))
    assert some.joint_names == ("joint_1", "joint_3")
    names = ["t", "q.elbow", "q.wrist", "qd.wrist", "qd.elbow", "tau_2", "tau_1"]
    record = Record.from_log(table(path, names, T, Q[:, :2], QD[:, 1::-1], TAU[:, 1::-1]))
    for given, expected in ((record.q, Q), (record.qd, QD), (record.tau, TAU)):
        np.testing.assert_array_equal(given, expected[:, :2])
    other = table(path, ["t", "q.a", "q.b", "tau.c", "tau.d", "qd.a", "tau.a"][:5], T, Q[:, :2], TAU[:, :2])
    with pytest.raises(
        ValueError,
        match=r'torques \'tau\.c\' to \'tau\.d\'; if these are of the same joints, give columns={"q": \.\.\., "tau": ',
    ):
        Record.from_log(other)
    given = Record.from_log(other, columns={"q": ["q.a", "q.b"], "tau": ["tau.d", "tau.c"]})
    assert (given.joint_names, guesses(given)) == (("a", "b"), [])
    np.testing.assert_array_equal(given.tau, TAU[:, 1::-1])


def test_motions_that_rne_wrote_are_read(tmp_path):
    """Also those of elastic joints, whose motors have positions and velocities of their own."""
    names = ["t", *names_of("motor_q", "q", "motor_qd", "qd", "qdd", "tau")]
    record = Record.from_log(table(tmp_path / "motion.csv", names, T, 0 * Q, Q, 0 * Q, QD, 0 * Q, TAU))
    same(record)
    assert guesses(record) == []


def test_what_is_not_read_is_said(tmp_path):
    """Velocities of some joints, and torques of joints without positions."""
    path = tmp_path / "log.csv"
    names = ["t", *names_of("q"), "qd.elbow", *names_of("tau"), "tau.hand"]
    record = Record.from_log(table(path, names, T, Q, QD[:, 1], TAU, T))
    same(record, velocities=False)
    lost = [
        f"log.csv: guess that '{x}' are not of the joints of the positions and not read; {ALIKE}"
        for x in ("tau.hand", "qd.elbow")
    ]
    assert guesses(record) == lost


def test_joints_that_are_called_like_commands(tmp_path):
    """The slide d3 of a SCARA and an axis "ext" are joints; columns of commands beside measured ones are not."""
    joints = ("turn", "d3", "ext")
    path = table(
        tmp_path / "log.csv", ["t", *names_of("pos", "vel", "effort", joints=joints, form="{1}_{0}")], T, Q, QD, TAU
    )
    record = Record.from_log(path)
    same(record, joints)
    assert guesses(record) == [
        f"log.csv: guess that '{x}_pos' is of a joint '{x}', not a command; else give `columns`" for x in joints[1:]
    ]
    franka = [
        "time",
        *(f"{x}_{k}" for x in ("q", "q_d", "dq", "dq_d", "tau_J", "tau_J_d", "tau_ext") for k in range(3)),
    ]
    record = Record.from_log(table(path, franka, T, Q, 0 * Q, QD, 0 * Q, TAU, 0 * Q, 0 * Q), joints=JOINTS)
    same(record)
    table(path, ["t", *names_of("q_d", "tau_d", joints="123", form="{}_{}")], T, Q, TAU)
    with exactly(
        f"{path}: there are no positions; there are 't', 'q_d_1', 'q_d_2', 'q_d_3', 'tau_d_1', 'tau_d_2', 'tau_d_3'; 'q_d_1' to 'q_d_3' look like commands or errors; if some are, give columns={{\"q\": ...}}"
    ):
        Record.from_log(path)
    table(
        path,
        ["t", *names_of("q", "cmd_q", "tau", "error_tau", joints="1", form="{}_{}"), "target_q_2"],
        T,
        Q[:, 0],
        T,
        TAU[:, 0],
        T,
        T,
    )
    assert guesses(Record.from_log(path)) == [
        "log.csv: guess that 'target_q_2' are commands or errors and not read; else give `columns`"
    ]
    table(
        path,
        ["t", *names_of("q", "torque", joints="12", form="{}_{}"), "q_z", "force_z"],
        T,
        Q[:, :2],
        TAU[:, :2],
        Q[:, 2],
        TAU[:, 2],
    )
    same(Record.from_log(path), joints=("1", "2", "z"), velocities=False)
    names = [
        "t",
        *names_of("pos", joints=("turn", "d3", "Ext"), form="{1}_{0}"),
        "turn_torque",
        "d3_force",
        "ext_torque",
    ]
    same(Record.from_log(table(path, names, T, Q, TAU)), ("turn", "d3", "Ext"), velocities=False)


def test_topics_are_no_part_of_joints_names(tmp_path):
    path = tmp_path / "log.csv"
    for form, options in (("/left/joint_states/{1}/{0}", {"joints": JOINTS}), ("/dynamic_joint_states/{1}/{0}", {}), ("robot.{1}.{0}/value", {})):  # fmt: skip
        table(path, ["__time", *names_of("position", "velocity", "effort", form=form)], T, Q, QD, TAU)
        record = Record.from_log(path, **options)
        same(record)
        assert guesses(record) == []
    two = names_of("position", "effort", form="/left/{1}/{0}") + ["/right/elbow/position"]
    table(path, ["__time", *two], T, Q, TAU, T)
    with exactly(
        f"{path}: columns '/left/elbow/position' and '/right/elbow/position' are both q of elbow; say which in columns={{\"q\": ...}}, "
        "or give the joints with more of these names as `joints`"
    ):
        Record.from_log(path)
    left = [f"left/{joint}" for joint in JOINTS]
    same(Record.from_log(path, joints=left), left, velocities=False)


def test_velocities_that_are_missing_are_not_used(tmp_path):
    """Of one joint or of all, in most samples; a log of messages of which some have none keeps the others."""
    for missing, rows in ((slice(0, 3), slice(0, None)), (slice(1, 2), slice(60, None))):
        qd = QD.copy()
        qd[rows, missing] = np.nan
        record = Record.from_log(table(tmp_path / "log.csv", ["t", *names_of("q", "qd", "tau")], T, Q, qd, TAU))
        said = f"no finite velocity in {len(T[rows])} samples of 200; the velocities are not used"
        assert [finding.message for finding in record.findings] == [f"log.csv: {x}: {said}" for x in JOINTS[missing]]
        assert {finding.severity for finding in record.findings} == {"warning"}
    path = echoed(tmp_path / "log.csv")
    lines = [
        ",".join([*(x := line.split(","))[:9], "", *x[12:]]) if k % 50 == 7 else line
        for k, line in enumerate(path.read_text().splitlines())
    ]
    path.write_text("\n".join(lines))
    assert np.flatnonzero(np.isnan(Record.from_log(path).qd[:, 0])).tolist() == [7, 57, 107, 157]


def test_lists_in_entries_as_programs_write_them(tmp_path):
    for form in ("({})", "array('d', [{}])", "[{}] "):
        sign = " " if form.endswith(" ") else ", "
        lists = [
            ",".join('"' + form.format(sign.join(map(repr, x[k].tolist()))) + '"' for x in (Q, TAU)) for k in range(200)
        ]
        rows = [f"{t!r},{x}" for t, x in zip(T.tolist(), lists, strict=True)]
        path = rows_of(tmp_path / "log.csv", ["time", "position", "effort"], rows)
        same(Record.from_log(path), ("joint_1", "joint_2", "joint_3"), velocities=False)


def test_dates_and_rows_above_the_names(tmp_path):
    rows = [f"2026-02-28T23:59:{58 + 0.01 * k:06.3f}Z" for k in range(200)]
    numbers = [",".join(map(repr, x)) for x in np.column_stack([Q, TAU]).tolist()]
    path = rows_of(
        tmp_path / "log.csv", ["time", *names_of("q", "tau")], [f"{a},{b}" for a, b in zip(rows, numbers, strict=True)]
    )
    same(Record.from_log(path), velocities=False)
    path.write_text(path.read_text().replace("2026-02-28T", "28.2., ").replace("time,", "day,time,"))
    with exactly(f"{path}, row 2, column 'time': must be a finite number, got ' 23:59:58.000Z'"):
        Record.from_log(path)
    path = table(
        tmp_path / "log.txt",
        ["time", *names_of("q", "tau")],
        T,
        Q,
        TAU,
        separator="\t",
        heading="Version\t2\nEnd of head",
    )
    same(Record.from_log(path), velocities=False)


def test_entries_are_left_out_in_the_first_rows(tmp_path):
    """Such rows are no names of columns; times of points without times are not read."""
    path = table(tmp_path / "log.csv", ["t", *names_of("q", "tau")], T, Q, TAU)
    lines = path.read_text().splitlines()
    lines[1:3] = [f"{T[0]}" + "," * 6, f"{T[1]},{Q[1, 0]}" + "," * 5]
    path.write_text("\n".join(lines))
    for record in (Record.from_csv(path, JOINTS), Record.from_log(path)):
        assert (len(record.t), np.isnan(record.q).sum(), np.isnan(record.tau).sum()) == (len(T), 5, 6)
        np.testing.assert_array_equal(record.q[2:], Q[2:])
    for times in (("", ""), ("home", "pick"), ("1", "0")):
        path.write_text("t,q.a,q.b\n" + "".join(f"{t},0.{k},0.2\n" for k, t in enumerate(times)))
        points = read_samples(path, ["a", "b"], needed=["q"], timed=False)
        assert (points.t.tolist(), points.q.tolist()) == ([0, 1], [[0.0, 0.2], [0.1, 0.2]])


def test_texts_with_other_separators_stand_beside_commas(tmp_path):
    for entry in ('"1;2;3;4;5;6;7;8;9"', "1 2 3 4 5 6 7 8 9"):
        path = tmp_path / "log.csv"
        rows = [f"{k},{k}.5,2.5,{entry}" for k in range(9)]
        path.write_text("\n".join(["# of a cell; t and more", "# t,q.a,tau.a,note", *rows]))
        for record in (Record.from_csv(path, ["a"]), Record.from_log(path)):
            np.testing.assert_array_equal(record.q[:, 0], np.arange(9) + 0.5)


def test_entries_in_quotes(tmp_path):
    path = table(tmp_path / "log.csv", ["t", *names_of("q", "tau")], T, Q, TAU)
    path.write_text('"' + path.read_text().strip().replace(",", '","').replace("\n", '"\n"') + '"')
    same(Record.from_log(path), velocities=False)


def test_names_that_differ_in_signs_alone(tmp_path):
    """j1_2 and j12 are two joints; Elbow_Pan and elbow-pan are one."""
    names = ["t", "q.j1_2", "q.j12", "tau.j12", "tau.j1_2"]
    record = Record.from_log(table(tmp_path / "log.csv", names, T, Q[:, :2], TAU[:, 1::-1]))
    np.testing.assert_array_equal(record.tau, TAU[:, :2])
    names = ["t", "Elbow_Pan pos", "Wrist pos", "wrist effort", "elbow-pan effort"]
    record = Record.from_log(
        table(tmp_path / "log.csv", names, T, Q[:, :2], TAU[:, 1::-1]), joints=["elbow_pan", "wrist"]
    )
    np.testing.assert_array_equal(record.tau, TAU[:, :2])


def test_currents_beside_torques_are_not_read(tmp_path):
    """Not even where two are of one joint; without torques that one has to be chosen."""
    names = ["t", *names_of("q", "tau"), "elbow current", "elbow raw current", "elbow value current"]
    path = table(tmp_path / "log.csv", names, T, Q, TAU, T, T, T)
    same(Record.from_log(path), velocities=False)
    table(path, [x for x in names if "tau" not in x], T, Q, T, T, T)
    both = "'elbow current' and 'elbow value current' are both current of elbow"
    with exactly(f'{path}: columns {both}; say which in columns={{"tau": ...}}'):
        Record.from_log(path)


def test_a_column_that_is_not_read_may_be_there_twice(tmp_path):
    names = ["t", *names_of("q", "tau"), "temperature", "temperature"]
    path = table(tmp_path / "log.csv", names, T, Q, TAU, T, 2 * T)
    same(Record.from_log(path), velocities=False)


def test_currents_need_gains(tmp_path):
    gains = np.array([20.0, 10.0, 5.0])
    path = table(
        tmp_path / "log.csv", ["t", *names_of("q"), *names_of("current", form="{1}_{0}_mA")], T, Q, 1e3 * TAU / gains
    )
    with exactly(
        f"{path}: 'shoulder_current_mA' to 'wrist_current_mA' are currents, not torques; give `gains` [N m/A]; gains=1 keeps "
        "currents, for `rne.identify_drive_gains`; at motors behind gears, Record.from_motors takes `drive_gains`"
    ):
        Record.from_log(path)
    same(Record.from_log(path, gains=gains), tolerance=1e3 * ROUNDED, velocities=False)
    assert abs(Record.from_log(path, gains=1).tau - TAU / gains).max() < ROUNDED
    for wrong, text in (([1, 2], "have shape (3,), got (2,)"), (0, "not be zero, got 0")):
        with exactly(f"`gains` must {text}"):
            Record.from_log(path, gains=wrong)


@pytest.mark.parametrize(
    "lines",
    [
        "t,q,tau\n[ms],deg,Nm\n",
        "t,q,tau,mode\nms,°,N.m,-\n",
        "t [ms],q [deg],tau [N m]\n",
        "Log 7\n\n# t_ms,q_deg,tau_Nm\n",
    ],
)
def test_units_stand_beside_or_below_names(lines, tmp_path):
    path = tmp_path / "log.csv"
    path.write_text(lines + "".join(f"{10 * k},{180 + k},{k}{',1' * ('mode' in lines)}\n" for k in range(20)))
    record = Record.from_log(path)
    assert guesses(record) == []
    assert (record.t[1], record.tau[2, 0]) == (0.01, 2)
    assert abs(record.q[0, 0] - np.pi) < ROUNDED


@pytest.mark.parametrize(
    ("text", "error"),
    [
        ("", ": the file is empty"),
        ("t,q1,tau1\n", ": there are no rows of numbers"),
        ("\0\1", ": is not a text file in UTF-8; a CSV file is needed"),
        ("t,q1,tau1\n0,1,2\n1,1\n", f", row 3: must have 3 entries, got 2; {CUT}"),
        ("t,q1,tau1\n0,1,2\n1,one,3\n", ", row 3, column 'q1': must be a finite number, got 'one'"),
        ("t,q1,tau1\n0,1,2\n1,inf,3\n", ", row 3, column 'q1': must be a finite number, got 'inf'"),
        ("t (min),q1,tau1\n0,1,2\n1,2,3\n", ": the unit 'min' of column 't (min)' is not known; give `time_unit`, or `sample_rate` instead of the times"),
        ("t,q1,tau1\n0,1,2\n,2,3\n", ": the time of sample 1 is missing"),
        ("t,q1,q1,tau1\n0,1,2,3\n1,2,3,4\n", ": column 'q1' is there twice; give names of all columns as `columns`"),
        ("t,q1,pos1,tau1\n0,1,2,3\n", ": columns 'q1' and 'pos1' are both q of 1; say which in columns={\"q\": ...}"),
        ("{\"t\": [0, 1], \"q\": [1, 2]}", ": there are no torques or currents; there are 't', 'q'; if some are, give columns={\"tau\": ...}"),
        ("{\"t\": 0, \"q\": [1]}\n{\"t\": 1, \"q\": [2]}\n", ": there are no torques or currents; there are 't', 'q'; if some are, give columns={\"tau\": ...}"),
        ("{\"t\": [0, 1], \"q\": [[1], [1, 2]], \"tau\": [1, 2]}", ": there are no positions; there are 't', 'tau'; if some are, give columns={\"q\": ...}"),
        ("{\"t\": [0, 1], \"q\": [1, 2", ": is damaged or cut off (Expecting ',' delimiter: line 1 column 25 (char 24))"),
        ("[[0, 1], [1, 2]]", ": is damaged or cut off (an object of arrays, or a list or lines of objects is needed)"),
        ("<?xml version='1.0'?><Rob/>", ": is XML; write its numbers as CSV, a row per sample"),
        ("header:\n  stamp: 1\n---\n", ": is YAML as of ros2 topic echo; add --csv, or -p with rostopic"),
        ("t,motor_id,q,tau\n0,1,1,2\n0,2,1,2\n1,1,1,2\n1,1,1,2\n", ": a joint that column 'motor_id' names has two rows at one time; keep one of them"),
        ("t,joint,q,tau\n0,a,1,2\n1,b,1,2\n2,a,1,2\n3,b,1,2\n", ": joints that column 'joint' names have times of their own; interpolate to common ones by numpy.interp, a column for each joint"),
        ("t,q1,q2\n0,1,2\n1,2,3\n", ": there are no torques or currents; there are 't', 'q1', 'q2'; if some are, give columns={\"tau\": ...}"),
        ("t,x,tau\n0,1,2\n1,2,3\n", ": there are no positions; there are 't', 'x', 'tau'; if some are, give columns={\"q\": ...}"),
        ("k,q,tau\n0,1,2\n1,2,3\n", ": there are no times; there are 'k', 'q', 'tau'; give columns={\"t\": ...} or `sample_rate`"),
        ("t,q.a,q.b,tau.c\n0,1,2,3\n", ": no joint has positions and torques; positions are 'q.a' to 'q.b', torques 'tau.c'; if these are of the same joints, give columns={\"q\": ..., \"tau\": ...} in the same order"),
        ("1700000000,5,,a,b,1,2,3,4,5\n", ", row 1: must be seconds, nanoseconds, frame, and as many names of joints, positions, velocities and efforts"),
        ("MATLAB 7.3 MAT-file", ": is a MATLAB file of version 7.3; save it by save(file, ..., '-v7')"),
        ("1700000000,5\n2,3\n", ": the names of its 2 columns are missing; give them, such as columns=[\"t\", \"q.shoulder\", \"tau.shoulder\"], with \"\" for one to ignore"),
        ("PK\3\4xl/", ": is a ZIP archive or a spreadsheet; write it as text"),
    ],
)  # fmt: skip
def test_other_and_damaged_texts_are_refused(text, error, tmp_path):
    path = tmp_path / "log.csv"
    path.write_text(text)
    with exactly(f"{path}{error}"):
        Record.from_log(path)


def test_arguments_that_do_not_belong_are_refused(tmp_path):
    path = table(tmp_path / "log.csv", ["t", *names_of("q", "tau")], T, Q, TAU)
    for options, text in (
        ({"unit": "deg"}, "give `units` and `joints` instead of `unit` and `joint_names`"),
        ({"columns": {"torque": 1}}, '`columns` must be of "t", "q", "qd", "tau", "command" and "command_rate", got \'torque\''),
        ({"columns": {"tau": "effort"}}, f"{path}: there is no column 'effort', which `columns` asks for; there are 't', 'q.shoulder', 'q.elbow', 'q.wrist', 'tau.shoulder', 'tau.elbow', 'tau.wrist'"),
        ({"time_unit": "min"}, '`time_unit` must be "s", "ms", "us" or "ns", got \'min\''),
        ({"sample_rate": 0}, "`sample_rate` must be positive, got 0.0"),
    ):  # fmt: skip
        with exactly(text):
            Record.from_log(path, **options)
    with pytest.raises(
        TypeError, match=r"^`joints` and `columns` must be sequences of names, such as robot\.joint_names, got str$"
    ):
        Record.from_log(path, joints="shoulder")
    with pytest.raises(FileNotFoundError):
        Record.from_log(tmp_path / "missing.mcap")
    with exactly(
        f"{tmp_path}: is a folder without meta/info.json, as LeRobot data sets have, or bags (.bag, .db3, .mcap)"
    ):
        Record.from_log(tmp_path)


def test_units_of_joints_may_be_of_torques_forces_and_currents(tmp_path):
    """Currents need gains, wherever they stand; where a joint has two of these, currents and forces are not read."""
    path = tmp_path / "log.csv"
    for units, gains in ((("A", "Nm"), [2.0, 1.0]), (("Nm", "A"), [1.0, 2.0]), (("A", "N"), [2.0, 1.0])):
        names = ["t", "pos_a [rad]", "pos_b [m]", *(f"effort_{x} [{u}]" for x, u in zip("ab", units, strict=True))]
        table(path, names, T, Q[:, :2], TAU[:, :2])
        with pytest.raises(ValueError, match=r"'effort_a .*' to 'effort_b .*' are currents, not torques; give `gains`"):
            Record.from_log(path)
        record = Record.from_log(path, gains=gains)
        assert (record.joint_names, guesses(record)) == (("a", "b"), [])
        np.testing.assert_array_equal(record.tau, TAU[:, :2] * gains)
    names = ["t", "q_1", "q_2", "torque_1 [Nm]", "torque_2 [Nm]", "current_2 [A]", "force_2 [N]"]
    record = Record.from_log(table(path, names, T, Q[:, :2], TAU[:, :2], T, T))
    np.testing.assert_array_equal(record.tau, TAU[:, :2])
    names = ["t", "q.arm", "q.hand", "torque.arm", "current.hand"]  # of which none says what the numbers are
    assert Record.from_log(table(path, names, T, Q[:, :2], TAU[:, 0], T)).joint_names == ("arm",)


# Messages


def echoed(path, order=lambda k: [0, 1, 2]):
    """As `ros2 topic echo --csv /joint_states` writes it, with the joints of message k in an order."""
    rows = []
    for k, ns in enumerate(NS):
        at = order(k)
        numbers = map(repr, np.concatenate([x[k][at] for x in (Q, QD, TAU)]).tolist())
        rows.append(",".join([str(ns // 10**9), str(ns % 10**9), "", *(JOINTS[j] for j in at), *numbers]))
    path.write_text("\n".join(rows))
    return path


def test_ros_2_echo(tmp_path):
    record = Record.from_log(echoed(tmp_path / "log.csv"))
    same(record)
    assert record.source.startswith(
        "as of ros2 topic echo --csv, times from the first message on, at 1700000000.123 s; t: "
    )
    same(Record.from_log(echoed(tmp_path / "log.csv", lambda k: np.roll([0, 1, 2], k).tolist())))
    by_number = {"t": 0, "q": [1, 2, 3], "qd": [4, 5, 6], "tau": [7, 8, 9]}
    same(Record.from_log(tmp_path / "log.csv", columns=by_number))
    bare = tmp_path / "bare.csv"  # without velocities, of which an empty entry is left
    bare.write_text(
        "\n".join(
            ",".join([*(x := line.split(","))[:9], "", *x[12:]]) for line in echoed(bare).read_text().splitlines()
        )
    )
    same(Record.from_log(bare), velocities=False)
    gripper = "1700000000,0,,finger,0.1,0,1"
    mixed = tmp_path / "log.csv"
    mixed.write_text("\n".join(f"{line}\n{gripper}" for line in mixed.read_text().splitlines()))
    same(Record.from_log(mixed, joints=JOINTS))
    with exactly(
        f"{mixed}: joint states are of different joints, 'elbow', 'shoulder', 'wrist' (200 messages) and 'finger' (200 messages); "
        "give those to read as `joints`"
    ):
        Record.from_log(mixed)
    with exactly(
        f"{mixed}: no message has all of `joints`, 'knee'; there is 'elbow', 'shoulder', 'wrist' and 'finger'"
    ):
        Record.from_log(mixed, joints=["knee"])


@pytest.mark.parametrize("stamped", [True, False])
def test_ros_1_echo(stamped, tmp_path):
    fields = [f"field.{x}{k}" for x in ("name", "position", "velocity", "effort") for k in range(3)]
    heading = ["%time", "field.header.seq", "field.header.stamp", "field.header.frame_id", *fields]
    rows = [
        ",".join([str(ns + 777 * stamped), str(k), str(ns * stamped), "", *JOINTS, *map(repr, np.concatenate([Q[k], QD[k], TAU[k]]).tolist())])
        for k, ns in enumerate(NS)
    ]  # fmt: skip
    path = tmp_path / "log.csv"
    path.write_text("\n".join([",".join(heading), *rows]))
    same(Record.from_log(path))
    numbered = [row.replace(",,", ",0,").replace(",".join(JOINTS), "1,2,3") for row in rows]  # numbers alone
    path.write_text("\n".join([",".join(heading), *numbered]))
    same(Record.from_log(path, joints=["1", "2", "3"]), ("1", "2", "3"))
    now = rows[7].replace(f",{NS[7] * stamped},", ",now,")
    path.write_text("\n".join([",".join(heading), *rows[:7], now, *rows[8:]]))
    with exactly(f"{path}, row 9: must have a time in nanoseconds, got 'now'"):
        Record.from_log(path)
    path.write_text("\n".join([",".join(heading), *rows[:-1], rows[-1][: len(rows[-1]) // 2]]))
    with pytest.raises(ValueError, match=rf"^{re.escape(str(path))}, row 201: must have 16 entries, got \d+; {CUT}$"):
        Record.from_log(path)


def bag(path, topics=("/joint_states",), names=JOINTS, kind="sensor_msgs/msg/JointState", stamped=True, stamps=NS):
    """A bag of the kind that its suffix says, as rosbags writes it: of ROS 1 compressed, of ROS 2 the file alone."""
    pytest.importorskip("rosbags", reason="rosbags is not installed, which reads bags of ROS")
    from rosbags import rosbag1, rosbag2, typesys

    is_old, folder = path.suffix == ".bag", path.with_suffix("")
    store = typesys.get_typestore(typesys.Stores.ROS1_NOETIC if is_old else typesys.Stores.ROS2_HUMBLE)
    State, Header, Time, String = (
        store.types[f"{x}"]
        for x in (
            "sensor_msgs/msg/JointState",
            "std_msgs/msg/Header",
            "builtin_interfaces/msg/Time",
            "std_msgs/msg/String",
        )
    )
    definition, digest = store.generate_msgdef("sensor_msgs/msg/JointState", ros_version=1 if is_old else 2)
    own = {"msgdef": definition, "md5sum" if is_old else "rihs01": digest}
    if is_old:
        path.unlink(missing_ok=True)
        writer = rosbag1.Writer(path)
        writer.set_compression(rosbag1.Writer.CompressionFormat.LZ4)
    else:
        shutil.rmtree(folder, ignore_errors=True)
        plugin = rosbag2.StoragePlugin.MCAP if path.suffix == ".mcap" else rosbag2.StoragePlugin.SQLITE3
        writer = rosbag2.Writer(folder, version=9, storage_plugin=plugin)
        if path.suffix == ".mcap":
            writer.set_compression(rosbag2.CompressionMode.STORAGE, rosbag2.CompressionFormat.ZSTD)
    pack = store.serialize_ros1 if is_old else store.serialize_cdr
    with writer:
        states = [writer.add_connection(topic, kind, **own) for topic in topics]
        other = writer.add_connection("/chatter", String.__msgtype__, typestore=store)
        for k, (ns, at) in enumerate(zip(NS, stamps, strict=True)):
            stamp = Time(at // 10**9 * stamped, at % 10**9 * stamped)
            header = Header(**({"seq": k} if is_old else {}), stamp=stamp, frame_id="base")
            message = pack(State(header, list(names), Q[k], QD[k], TAU[k]), State.__msgtype__)
            for connection in states:
                writer.write(connection, ns, message)
            writer.write(other, ns, pack(String("hello"), String.__msgtype__))
    if not is_old:
        (folder / f"{folder.name}{path.suffix}").replace(path)
        shutil.rmtree(folder)
    return path


@pytest.mark.parametrize("suffix", ["mcap", "db3", "bag"])
def test_bags(suffix, tmp_path, monkeypatch):
    path = bag(tmp_path / f"log.{suffix}")
    record = Record.from_log(path)
    same(record)
    assert record.source.startswith(
        "topic /joint_states, times from the first message on, at 1700000000.123 s; t: 't'; q: "
    )
    same(Record.from_log(tmp_path))  # the folder of a bag
    same(Record.from_log(bag(path, stamped=False)))  # times are those of the recorder
    whole = path.read_bytes()
    for part in (b"", whole[:5], whole[:100], whole[: len(whole) // 2], whole[: len(whole) // 2] + b"\xff" * 99 + whole[len(whole) // 2 + 99 :]):  # fmt: skip
        path.write_bytes(part)
        with pytest.raises(ValueError, match=rf"^{re.escape(str(path))}: is damaged or cut off \(.*\)$"):
            Record.from_log(path)
    monkeypatch.setattr("rne.files.ros_bags.FREE", 8000)
    monkeypatch.setattr("rne.files.ros_bags.RATIO", 0)
    path.write_bytes(whole)
    if suffix != "db3":  # which is not compressed
        with pytest.raises(
            ValueError,
            match=r"\(its chunks unpack to more bytes than they say or a file of its size may, or are cut off\)$",
        ):
            Record.from_log(path)


def test_messages_are_in_the_order_in_which_they_were_recorded(tmp_path):
    """Not in that of their stamps, which would hide that these do not ascend."""
    stamps = [NS[1], NS[0], *NS[2:]]
    record = Record.from_log(bag(tmp_path / "log.db3", stamps=stamps))
    np.testing.assert_array_equal(record.q, Q)
    np.testing.assert_allclose(record.t[:3], [0.0, -0.01, 0.01], rtol=1e-12)
    assert [(finding.kind, finding.samples) for finding in record.findings] == [("time that goes back", (1,))]


def test_messages_of_a_bag_that_is_not_compressed_are_counted_too(tmp_path, monkeypatch):
    path = bag(tmp_path / "log.db3")
    monkeypatch.setattr("rne.basics.archive.FREE", 8000)
    monkeypatch.setattr("rne.basics.archive.RATIO", 0)
    with exactly(f"{path}: its arrays take more than 8000 {TOO_LARGE}"):
        Record.from_log(path)


def test_sizes_of_chunks_of_mcap_are_those_they_say(tmp_path):
    path = bag(tmp_path / "log.mcap")
    data = bytearray(path.read_bytes())
    place = data.index(b"zstd") - 16  # of the size, before a checksum and the length of the name
    stated, packed = (*struct.unpack_from("<Q", data, place), *struct.unpack_from("<Q", data, place + 20))
    for said, text in (
        (stated + 1, "a chunk has more bytes than it says, or fewer"),
        (2**60, f"a chunk is said to have {2**60} bytes, and {packed} of {packed + 44} as it is stored"),
    ):
        struct.pack_into("<Q", data, place, said)
        path.write_bytes(data)
        with exactly(f"{path}: is damaged or cut off ({text})"):
            Record.from_log(path)


def test_messages_that_an_index_counts_and_does_not_find_are_missed(tmp_path, monkeypatch):
    path = bag(tmp_path / "log.db3")
    storage = pytest.importorskip("rosbags.rosbag2.storage_sqlite3").Sqlite3Reader
    read = storage.messages
    monkeypatch.setattr(storage, "messages", lambda reader, own: itertools.islice(read(reader, own), len(T) - 1))
    with exactly(f"{path}: is damaged or cut off (1 of 200 messages cannot be found; repair its index)"):
        Record.from_log(path)


def test_bags_are_known_by_their_first_bytes(tmp_path):
    path = bag(tmp_path / "log.mcap")
    same(Record.from_log(path.rename(tmp_path / "log.dat")))


def test_chunks_of_mcap_that_the_index_does_not_name_are_missed(tmp_path):
    """An index of other places would have bytes unpacked that were not counted."""
    path = bag(tmp_path / "log.mcap")
    data = bytearray(path.read_bytes())
    index = data.rindex(b"\x08", 0, data.rindex(b"zstd"))  # the record of the chunk's place, at 8 + 16 bytes in it
    start = struct.unpack_from("<Q", data, index + 25)[0]
    struct.pack_into("<Q", data, index + 25, start + 1)
    path.write_bytes(data)
    with exactly(
        f"{path}: is damaged or cut off (its index names chunks that are not there; repair it: mcap recover FILE)"
    ):
        Record.from_log(path)


def test_records_of_mcap_end_with_the_footer(tmp_path):
    """Those behind one of no kind would be unpacked, and chunks that the index names twice, without being counted."""
    path = bag(tmp_path / "log.mcap")
    data = path.read_bytes()
    start = 17 + data[9]  # behind the header
    whole = data[:-28] + struct.pack("<Q", 0) + data[-20:]  # without an index
    path.write_bytes(whole)
    same(Record.from_log(path))
    for kind in (b"\0", b"\2"):
        path.write_bytes(whole[:start] + kind + bytes(8) + whole[start:])
        what = f"a record at byte {start} is of no kind, or longer than the file"
        with exactly(f"{path}: is damaged or cut off ({what})"):
            Record.from_log(path)
    index = data.rindex(b"\x08", 0, data.rindex(b"zstd"))
    end = index + 9 + data[index + 1]
    path.write_bytes(data[:end] + data[index:end] + data[end:])
    with pytest.raises(ValueError, match="its index names chunks that are not there"):
        Record.from_log(path)
    left = [10**9]
    with pytest.raises(ValueError, match="more bytes than they say"):
        _unpacked(bz2.compress(bytes(10**6)), "", 100, left)
    assert left[0] > 10**9 - 10**3


def test_bags_that_are_whole_and_not_read(tmp_path):
    """Messages in a file beside; other profiles and encodings; signs of addresses in names are read."""
    path = bag(tmp_path / "log.db3")
    odd = path.rename(tmp_path / "a#b%41.db3")
    same(Record.from_log(odd))
    (tmp_path / f"{odd.name}-wal").write_bytes(b"")
    same(Record.from_log(odd))
    (tmp_path / f"{odd.name}-wal").write_bytes(b"1")
    cure = 'add them by sqlite3 FILE "pragma wal_checkpoint(truncate)"'
    with exactly(f"{odd}: has messages in {odd.name}-wal; {cure}"):
        Record.from_log(odd)
    path = bag(tmp_path / "log.mcap")
    data = path.read_bytes()
    path.write_bytes(data.replace(b"ros2msg", b"ros1msg"))
    with exactly(f"{path}: has messages in 'ros1msg', not of ROS 2; keep others by mcap filter FILE -o OUT -y TOPIC"):
        Record.from_log(path)
    path.write_bytes(data.replace(b"ros2", b"ros1", 1))
    with exactly(f"{path}: is MCAP of the profile 'ros1'; 'ros2' is needed"):
        Record.from_log(path)


@pytest.mark.parametrize("suffix", ["mcap", "db3", "bag"])
def test_bags_of_other_topics(suffix, tmp_path):
    path = bag(tmp_path / f"two.{suffix}", ("/left/joint_states", "/right/joint_states"))
    with exactly(f"{path}: there are joint states of '/left/joint_states', '/right/joint_states'; give one as `topic`"):
        Record.from_log(path)
    same(Record.from_log(path, topic="/left/joint_states"))
    there = "/chatter (std_msgs/msg/String), /left/joint_states (sensor_msgs/msg/JointState), /right/joint_states (sensor_msgs/msg/JointState)"
    with exactly(f"{path}: there is no topic /up of sensor_msgs/msg/JointState; there is {there}"):
        Record.from_log(path, topic="/up")
    path = bag(tmp_path / f"controls.{suffix}", ("/a\x1b[31m\u202e",), kind="arm/msg/State")
    with exactly(
        f"{path}: there is no topic  of sensor_msgs/msg/JointState; there is /a\\x1b[31m\\u202e (arm/msg/State), "
        "/chatter (std_msgs/msg/String)"
    ):
        Record.from_log(path)
    for names, count in ((("elbow", "elbow", "wrist"), 2), (JOINTS[:2], 2)):
        path = bag(tmp_path / f"names.{suffix}", names=names)
        with exactly(f"{path}: message 1 has {count} different names, and 3, 3, 3 positions, velocities and efforts"):
            Record.from_log(path)


# JSON, rows of joints


def test_json(tmp_path):
    """An object of arrays, a list or lines of objects, beside settings or not, with joints by number, name or object."""
    path = tmp_path / "log.json"
    arrays = {"time": T.tolist(), "position": Q.tolist(), "velocity": QD.tolist(), "effort": TAU.tolist()}
    rows = [dict(zip(arrays, x, strict=True)) for x in zip(*arrays.values(), strict=True)]
    of_joints = [
        {"time": t, **{name: {"q": q, "qd": qd, "tau": tau} for name, q, qd, tau in zip(JOINTS, *x, strict=True)}}
        for t, *x in zip(*arrays.values(), strict=True)
    ]
    numbered = ("joint_1", "joint_2", "joint_3")
    for content, joints in (
        (arrays, numbered),
        ({"joint_names": list(JOINTS), **arrays}, JOINTS),
        ({"rate": 100, "run": arrays}, numbered),
        (rows, numbered),
        ([{"name": list(JOINTS), **row} for row in rows], JOINTS),
        ({"kp": 32, "arm": "left", "entries": rows}, numbered),
        (of_joints, JOINTS),
    ):
        path.write_text(json.dumps(content, indent=1))
        same(Record.from_log(path), joints)
    path.write_text("\n".join(map(json.dumps, rows)))
    same(Record.from_log(path.rename(path := tmp_path / "log.txt")), numbered)
    path.write_text(path.read_text()[:-20])
    match = rf"^{re.escape(str(path))}: is damaged or cut off \(Expecting .*: line 200 column \d+\)$"
    with pytest.raises(ValueError, match=match):
        Record.from_log(path)
    path.write_text(json.dumps(arrays, indent=1) + "\n}")
    end = path.read_text().count("\n") + 1
    with pytest.raises(ValueError, match=rf"\(Extra data: line {end} column 1 \(char \d+\)\)$"):
        Record.from_log(path)


def test_what_json_leaves_out_is_missing(tmp_path, monkeypatch):
    """null, NaN and entries without a value."""
    rows = [
        {"t": t, "q": q, "tau": tau} for t, q, tau in zip(T.tolist(), Q[:, 0].tolist(), TAU[:, 0].tolist(), strict=True)
    ]
    rows[20]["q"], rows[30]["q"] = None, float("nan")
    del rows[40]["tau"], rows[0]["tau"]
    (path := tmp_path / "log.jsonl").write_text("\n".join(map(json.dumps, rows)))
    record = Record.from_log(path)
    assert np.flatnonzero(np.isnan(record.q[:, 0])).tolist() == [20, 30]
    assert np.flatnonzero(np.isnan(record.tau[:, 0])).tolist() == [0, 40]
    path.write_text("\n".join(json.dumps({"t": k, f"q_{k}": 1}) for k in range(4000)))  # names grow with the rows
    with pytest.raises(ValueError, match=rf"^{re.escape(str(path))}: its arrays take more than \d+ bytes"):
        Record.from_log(path)
    monkeypatch.setattr("rne.files.logs.most_unpacked", lambda path: 100_000)
    for growing in ({x: [{f"q_{k}": 1} for k in range(80)] for x in "ab"}, {"q": [0], "name": ["a" * 1000] + ["b"] * 99}):  # fmt: skip
        path.write_text(json.dumps(growing))  # all lists together, and texts that are as long as the longest
        with pytest.raises(ValueError, match=rf"^{re.escape(str(path))}: its arrays take more than 100000 bytes"):
            Record.from_log(path)


@pytest.mark.parametrize("is_json", [False, True])
def test_rows_of_joints(is_json, tmp_path):
    """A row for each joint and time, in any order of joints, with units; joints by name or number."""
    for joints, heading in ((JOINTS, ["t [ms]", "joint", "position [deg]", "velocity", "effort [Nm]"]), ("123", ["t [ms]", "motor_id", "q [deg]", "qd", "tau [Nm]"])):  # fmt: skip
        rows = [
            [1e3 * t, joints[j], np.degrees(Q[k, j]), np.degrees(QD[k, j]), TAU[k, j]]
            for k, t in enumerate(T.tolist())
            for j in np.roll([0, 1, 2], k % 3)
        ]
        path = tmp_path / ("log.json" if is_json else "log.csv")
        lines = [",".join(heading), *(",".join(map(str, row)) for row in rows)]
        path.write_text(
            json.dumps([dict(zip(heading, row, strict=True)) for row in rows]) if is_json else "\n".join(lines)
        )
        record = Record.from_log(path)
        same(record, joints if joints == JOINTS else ("joint_1", "joint_2", "joint_3"), tolerance=ROUNDED)
        assert record.source.startswith(f"rows of joints, which column {heading[1]!r} names; ")
        assert len(guesses(record)) == (joints != JOINTS)
    del rows[301]
    path = tmp_path / "part.csv"
    path.write_text("\n".join([",".join(heading[1:]), *(",".join(map(str, row[1:])) for row in rows[:300])]))
    assert len(Record.from_log(path, sample_rate=100).t) == 100  # rows of each joint are counted
    path.write_text("\n".join([",".join(heading), *(",".join(map(str, row)) for row in rows)]))
    assert np.isnan(Record.from_log(path).q).sum() == 1  # a joint without a row
    with exactly(f"{path}: has rows of joints, which column 'motor_id' names; a column for each joint is needed, or one file of all quantities"):  # fmt: skip
        Record.from_log({"q": path, "tau": path})
    path.write_text("\n".join([",".join(heading[1:]), *(",".join(map(str, row[1:])) for row in rows)]))
    with exactly(f"{path}: joints that column 'motor_id' names have 199 to 200 rows, and no times that show which are missing; give columns={{\"t\": ...}}"):  # fmt: skip
        Record.from_log(path, sample_rate=100)
    path.write_text("\n".join([",".join(["t [ms]", "id", *heading[2:]]), *(",".join(map(str, row)) for row in rows)]))
    said = "column 'id' numbers joints, each of which has rows of its own; else remove it"
    assert guesses(Record.from_log(path)) == [f"part.csv: guess that {x}" for x in (said, NUMBERS)]


def test_columns_of_rows_of_joints_are_given_as_the_log_has_them(tmp_path):
    path = tmp_path / "log.csv"
    rows = [f"{t!r},{joint},{q!r},{tau!r}" for t, *x in zip(T.tolist(), Q.tolist(), TAU.tolist(), strict=True) for joint, q, tau in zip(JOINTS, *x, strict=True)]  # fmt: skip
    rows_of(path, ["time", "joint", "position", "effort"], rows)
    for columns in ({"q": 2, "tau": 3}, {"t": 0}, {"t": ["time"], "q": "position"}, {"tau": ["effort"]}):
        same(Record.from_log(path, columns=columns), velocities=False)
    with exactly(f"{path}: there is no column 'tim', which `columns` asks for; did you mean 'time'?"):
        Record.from_log(path, columns={"t": "tim"})


def test_forces_are_torques_of_joints_that_slide(tmp_path):
    """By the unit, whatever the word; a force beside an angle is none."""
    path = tmp_path / "log.csv"
    names = ["t", "z position [mm]", "turn position [deg]", "z effort [N]", "turn effort [Nm]"]
    table(path, names, T, 1e3 * Q[:, 0], np.degrees(Q[:, 1]), TAU[:, :2])
    record = Record.from_log(path)
    same_two = [abs(record.q - Q[:, :2]).max(), abs(record.tau - TAU[:, :2]).max()]
    assert max(same_two) < ROUNDED
    assert guesses(record) == []
    for names, guess in ((["t", "Position [m]", "Force"], 0), (["t", "Position", "Force [N]"], 1)):
        record = Record.from_log(table(path, names, T, Q[:, 0], TAU[:, 0]))
        assert abs(record.tau[:, 0] - TAU[:, 0]).max() == EXACT
        said = "'Force [N]' are forces of joints that slide; else give units={\"q\": ...}"
        assert guesses(record) == [f"log.csv: guess that {said}"] * guess
    table(path, ["t", "Angle [deg]", "Force [N]"], T, Q[:, 0], TAU[:, 0])
    cure = 'if they are torques, give columns={"tau": ...}'
    with exactly(f"{path}: 'Force [N]' are forces, and the positions of their joints angles; {cure}"):
        Record.from_log(path)
    table(path, ["t", "Position [rad]", "Torque current [Nm]"], T, Q[:, 0], TAU[:, 0])
    assert abs(Record.from_log(path).tau[:, 0] - TAU[:, 0]).max() == EXACT
    table(path, ["t", "Position [rad]", "effort [mA]"], T, Q[:, 0], TAU[:, 0])
    with pytest.raises(ValueError, match=r"'effort \[mA\]' are currents, not torques; give `gains` \[N m/A\]"):
        Record.from_log(path)


# Arrays


def test_matlab_and_numpy_files(tmp_path):
    path = tmp_path / "log.mat"
    for content in (
        {"t": T, "q": Q, "qd": QD, "tau": TAU},
        {"t": T[None], "q": Q.T, "qd": QD.T, "tau": TAU.T, "note": "a text"},
        {"log": {"time": T, "position": Q, "velocity": QD, "effort": TAU}},
    ):
        savemat(path, content)
        same(Record.from_log(path), joints=("joint_1", "joint_2", "joint_3"))
    path.write_bytes(path.read_bytes()[:600])
    with pytest.raises(ValueError, match=rf"^{re.escape(str(path))}: is damaged or cut off \(.*\)$"):
        Record.from_log(path)
    path = tmp_path / "log.npz"
    np.savez(path, t=T, q=Q, qd=QD, tau=TAU)
    same(Record.from_log(path, joints=JOINTS))
    path.write_bytes(path.read_bytes()[:-200])
    with pytest.raises(ValueError, match=rf"^{re.escape(str(path))}: is damaged or cut off \(.*\)$"):
        Record.from_log(path)
    np.savez(path, t=T, q=Q, tau=TAU[1:])
    with exactly(f"{path}: there are 200 times and 199 samples of tau"):
        Record.from_log(path)
    np.savez(path, t=T, q=np.array([{}], dtype=object))
    with pytest.raises(
        ValueError,
        match=r"is damaged or cut off .*allow_pickle=True would load; save texts by numpy\.array\(x, dtype=str\)\)$",
    ):
        Record.from_log(path)


def test_arrays_of_matlab_files_that_are_not_compressed_are_counted_in_double_precision(tmp_path, monkeypatch):
    savemat(path := tmp_path / "log.mat", {"t": T, "q": np.zeros(9), "tau": np.zeros(1000, np.int8)})
    monkeypatch.setattr("rne.basics.archive.FREE", 8000)
    monkeypatch.setattr("rne.basics.archive.RATIO", 0)
    with exactly(f"{path}: its arrays take more than 8000 {TOO_LARGE}"):
        Record.from_log(path)


def lerobot(folder, episodes=1, named=True, **features):
    parquet = pytest.importorskip("pyarrow.parquet", reason="pyarrow is not installed, which reads LeRobot data sets")
    import pyarrow as arrow

    (folder / "meta").mkdir(parents=True, exist_ok=True)
    (folder / "data" / "chunk-000").mkdir(parents=True, exist_ok=True)
    names = {name: {"dtype": "float32", "shape": [3], "names": [f"{j}{'.pos' * (name != 'observation.current')}" for j in JOINTS] if named else None} for name in features}  # fmt: skip
    (folder / "meta" / "info.json").write_text(json.dumps({"codebase_version": "v3.0", "fps": 100, "features": names}))
    count = len(T) * episodes
    lists = {
        name: arrow.array(np.tile(x, (episodes, 1)).tolist(), arrow.list_(arrow.float64(), 3))
        for name, x in features.items()
    }
    index = {
        "timestamp": np.tile(T, episodes),
        "episode_index": np.repeat(np.arange(episodes), len(T)),
        "index": np.arange(count),
    }
    parquet.write_table(arrow.table({**lists, **index}), folder / "data" / "chunk-000" / "file-000.parquet")
    return folder


def test_lerobot_data_sets(tmp_path):
    normalised = 100 * (Q - 0.1) / 2
    data = {"observation.state": normalised, "action": 0 * Q, "observation.current": 1e3 * TAU / 2}
    folder = lerobot(tmp_path, **data)
    file = folder / "data" / "chunk-000" / "file-000.parquet"
    options = {"units": {"q": 0.02, "tau": "mA"}, "offsets": 0.1, "gains": 2}
    record = Record.from_log(folder, **options)
    same(record, tolerance=1e3 * ROUNDED, velocities=False)
    assert record.source.startswith("episode 0; t: 'timestamp'; q: 'observation.state.shoulder.pos' to ")
    same(Record.from_log(file, joints=JOINTS, **options), tolerance=1e3 * ROUNDED, velocities=False)
    lerobot(tmp_path, named=False, **data)
    same(Record.from_log(folder, joints=JOINTS, **options), tolerance=1e3 * ROUNDED, velocities=False)
    with exactly(
        f'{folder}: positions of LeRobot data sets are in degrees or normalised; give units={{"q": "deg"}}, or rad per unit of '
        "each joint and `offsets`"
    ):
        Record.from_log(folder, units={"tau": "mA"}, gains=2)
    lerobot(tmp_path, episodes=3, **data)
    with exactly(f"{file}: there are episodes 0 to 2; give one as `episode`"):
        Record.from_log(folder, **options)
    same(Record.from_log(folder, episode=1, **options), tolerance=1e3 * ROUNDED, velocities=False)
    lerobot(tmp_path, **{"observation.state": normalised})
    there = ", ".join(f"'observation.state.{j}.pos'" for j in JOINTS)
    with exactly(
        f"{folder}: there are no torques or currents; there are {there}, 'timestamp', 'episode_index', 'index'; if some are, "
        'give columns={"tau": ...}'
    ):
        Record.from_log(folder, units={"q": "deg"})
    for part in (file.read_bytes()[:1000], b"PAR1", b""):
        file.write_bytes(part)
        with pytest.raises(ValueError, match=rf"^{re.escape(str(file))}: is damaged or cut off \(.*\)$"):
            Record.from_log(folder, units={"q": "deg"})
    (folder / "meta" / "info.json").write_text('{"features": ')
    with pytest.raises(ValueError, match=r"info\.json: is damaged or cut off \(.*\)$"):
        Record.from_log(folder, units={"q": "deg"})


def test_lerobot_data_sets_have_files_of_a_limited_size(tmp_path, monkeypatch):
    """Lists of numbers, whose columns have longer names in the file, count as times and indices do."""
    folder = lerobot(tmp_path, **{"observation.state": Q})
    file = folder / "data" / "chunk-000" / "file-000.parquet"
    most = 32 * len(Q)  # of times and indices alone: 24 bytes a sample
    monkeypatch.setattr("rne.basics.archive.FREE", most)
    monkeypatch.setattr("rne.basics.archive.RATIO", 0)
    with exactly(f"{file}: its arrays take more than {most} {TOO_LARGE}"):
        Record.from_log(folder)
    file.unlink()
    with exactly(f"{folder / 'meta' / 'info.json'}: the data set has no files data/*/*.parquet"):
        Record.from_log(folder)


@pytest.mark.parametrize(
    ("module", "file", "extra"), [("rosbags", "log.mcap", "ros"), ("pyarrow", "log.parquet", "lerobot")]
)
def test_extras_that_are_missing_are_named(module, file, extra, tmp_path, monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, module if extra == "ros" else "pyarrow.parquet", None)
    (tmp_path / file).write_bytes(b"")
    with pytest.raises(ImportError, match=rf"pip install 'rne\[{extra}\]'$"):
        Record.from_log(tmp_path / file)


# Motion, and the command


def test_rest_at_both_ends_is_cut(tmp_path):
    rest = [np.repeat(Q[:1], 150, 0), Q, np.repeat(Q[-1:], 80, 0)]
    noise = 1e-4 * np.random.default_rng(0).normal(size=(430, 3))
    q = np.concatenate(rest) + noise
    record = Record(np.arange(430) / 100, q, q, name="run")
    part = record.in_motion()
    assert abs(part.t[0] - 1.5) <= 0.02
    assert abs(part.t[-1] - 3.49) <= 0.02
    assert re.fullmatch(r"rest cut off: 1\.\d+ s at the start, 0\.\d+ s at the end", part.source)
    slow = np.append(np.sin(np.arange(500) / 50), np.full(300, np.sin(499 / 50)))[:, None]
    parts = [Record(np.arange(800) / 100, q, q).in_motion() for q in (slow[::-1], slow)]  # at rest first, and last
    assert len(parts[0].t) == len(parts[1].t)
    assert parts[1].source.replace("end", "start") == parts[0].source
    t, steps = np.arange(600) / 100, 0.01 * (np.arange(600) // 7 % 2)[:, None]  # an encoder that flickers at rest
    flicker = 0.01 * np.rint(np.clip(t - 3, 0, 1)[:, None] / 0.01) + steps * (t < 3)[:, None]
    assert abs(Record(t, flicker, flicker).in_motion().t[0] - 3) < 0.1
    whole = Record(T, Q, TAU).in_motion()
    assert (len(whole.t), whole.source) == (len(T), "")
    with exactly("still: no joint moves"):
        Record(T, 0 * Q, TAU, name="still").in_motion()


def test_rne_identify(tmp_path, monkeypatch, capsys):
    """From two logs to a URDF with the masses of the arm that wrote them."""
    monkeypatch.setattr("rne.plotting.html_page.has_matplotlib", lambda: False)  # pictures have tests of their own
    arm = rne.load("irb140").locked(dict.fromkeys(["joint_3", "joint_4", "joint_5", "joint_6"], 0))
    t, w = np.arange(0, 5, 0.02), 2 * np.pi * np.array([0.4, 0.55])
    names = [f"{x}.{joint}" for x in ("q", "tau") for joint in arm.joint_names]
    for name, sign in (("a.csv", 1), ("b.csv", -1)):
        q, qd, qdd = (
            sign * np.sin(np.outer(t, w)),
            sign * w * np.cos(np.outer(t, w)),
            -sign * w**2 * np.sin(np.outer(t, w)),
        )
        table(tmp_path / name, ["t", *names], 1e3 * t, np.degrees(q), arm.inverse_dynamics(q, qd, qdd) + 3 * qd)
    (tmp_path / "arm.urdf").write_text(rne.to_urdf(arm.model))
    call = ["identify", str(tmp_path / "arm.urdf"), str(tmp_path / "a.csv"), "--check", str(tmp_path / "b.csv")]
    out = ["--page", str(tmp_path / "page"), "--out", str(tmp_path / "found.urdf")]
    assert main([*call, *out, "--degrees", "--time-unit", "ms"]) == 0
    said = capsys.readouterr().out
    report, _ = said.split("\na.csv, fitted\n")
    assert re.search(r"^\d+ base parameters of irb140 from \d+ equations, condition number ", report, re.MULTILINE)
    assert report.rstrip().endswith(
        "--details: filters, base parameters with standard errors, bodies, the test for one rigid body"
    )
    assert "b.csv, predicted" in said
    assert "a.csv, fitted" in (tmp_path / "page" / "index.html").read_text()
    found = rne.load(tmp_path / "found.urdf")
    states = np.random.default_rng(0).uniform(-1, 1, (3, 50, 2))
    exact = arm.inverse_dynamics(*states)
    assert np.linalg.norm(found.inverse_dynamics(*states) - exact) < 0.02 * np.linalg.norm(exact)
    assert main([*call, *out, "--joints", "knee"]) == 2
    assert capsys.readouterr().err.endswith(
        "there are no positions and torques of joint 'knee'; there are 'joint_1', 'joint_2'\n"
    )
    table(tmp_path / "a.csv", ["t", "q1", "tau1"], t, t, np.cos(3 * t))
    assert main([*call, *out]) == 2
    assert "has 1 joint without names: give the names of those measured as --joints" in capsys.readouterr().err
    table(tmp_path / "a.csv", ["t", "q.hip", "tau.hip", "q.knee", "tau.knee"], t, t, np.cos(3 * t), t, np.cos(2 * t))
    assert main([*call, *out]) == 2
    assert capsys.readouterr().err.endswith(", as --joints with --columns q=...,tau=... in this order\n")
    table(tmp_path / "a.csv", ["t", "q.joint_1", "current.joint_1"], t, t, t)
    assert main([*call, *out]) == 2
    assert "are currents, not torques; give --gains [N m/A]" in capsys.readouterr().err
    assert main([*call, "--out", str(tmp_path / "no" / "found.urdf")]) == 2


def test_options_of_rne_identify_read_logs_as_from_log_does(tmp_path):
    """Columns, units and joints by quantity."""
    path = table(tmp_path / "log.csv", ["a", "b", "c", "d", "e", "f"], np.degrees(Q), 1e3 * TAU / 2)
    call = ["identify", "irb140", str(path), "--columns", "q=a,b,c", "--columns", "tau=3,4,5", "--sample-rate", "250"]
    call += ["--units", "q=deg", "--units", "tau=mA,A,0.5", "--gains", "2", "--offsets", "0.1", "--joints", "x,y,z"]
    read = _record(path, rne.load("irb140"), parser().parse_args(call))
    units = {"q": "deg", "tau": ["mA", "A", 0.5]}
    given = {"columns": {"q": ["a", "b", "c"], "tau": ["d", "e", "f"]}, "units": units, "joints": ["x", "y", "z"]}
    expected = Record.from_log(path, sample_rate=250, gains=2, offsets=0.1, **given).in_motion()
    assert read.joint_names == ("x", "y", "z")
    for name in ("t", "q", "tau"):
        np.testing.assert_array_equal(getattr(read, name), getattr(expected, name))
    named = ["t", *(f"{x}.{joint}" for x in ("q", "tau") for joint in "xyz")]
    bare = tmp_path / "bare.csv"
    bare.write_text(path.read_text().split("\n", 1)[1])
    call = ["identify", "irb140", str(bare), "--columns", ",".join(named[1:]), "--sample-rate", "250"]
    assert _record(bare, rne.load("irb140"), parser().parse_args(call)).joint_names == ("x", "y", "z")
