"""Records with commanded positions: what they keep, what is said of their commands, and who needs torques."""

import json
import pickle
import re
import sqlite3
from contextlib import closing

import numpy as np
import pytest

import rne
from rne.__main__ import main, parser
from rne.commands.commanded import scene_of
from rne.identification import Record

from .helpers import first_joints


def exactly(text):
    return pytest.raises(ValueError, match=f"^{re.escape(text)}$")


RATE = 100
T = np.arange(400) / RATE
COMMAND = np.column_stack([np.sin(2 * T) - 0.3, 0.8 * np.cos(3 * T)])
Q = COMMAND - 0.02 * np.column_stack([np.cos(2 * T), -np.sin(3 * T)])  # which follow by some ten milliseconds


def said(command=COMMAND, q=Q, t=T, **options):
    """Findings of a record with these commands, as joint, kind and samples."""
    record = Record(t, q, command=command, **options)
    return [(x.joint, x.kind, x.samples) for x in record.findings]


def test_a_record_keeps_its_commands_in_si_units_and_has_no_torques():
    record = Record(T, np.rad2deg(Q), command=np.rad2deg(COMMAND), command_rate=np.rad2deg(Q), unit="deg")
    for found, given in ((record.q, Q), (record.command, COMMAND), (record.command_rate, Q)):
        np.testing.assert_allclose(found, given, rtol=1e-14)  # of degrees and back, by rounding
    assert record.tau is None
    assert record.command_hold
    assert not record.findings
    assert repr(record) == "Record 'record': 400 samples of 2 joints, 3.99 s, commands without torques, 0 findings"


def test_parts_and_copies_have_their_commands():
    whole = Record(T, Q, command=COMMAND, command_rate=2 * COMMAND, command_hold=False)
    part, again = whole.between(1, 2), pickle.loads(pickle.dumps(whole))
    assert np.array_equal(part.command, COMMAND[100:201])
    assert np.array_equal(part.command_rate, 2 * COMMAND[100:201])
    assert np.array_equal(again.command, COMMAND)
    assert again.tau is None
    assert not (part.command_hold)
    assert not (again.command_hold)
    assert not (whole.in_motion().command_hold)


def test_rest_ends_with_the_command_that_ends_it():
    """Which is before the motion, by the delay that is to be found."""
    command = np.where(T < 1, 0.0, 0.5)[:, None]
    q = 0.5 * np.clip((T[:, None] - 1.1) / 0.3, 0, 1) ** 2
    part = Record(T, q, command=command).in_motion()
    assert part.t[0] == T[99]
    assert part.command[:2, 0].tolist() == [0.0, 0.5]
    assert Record(T, q, q).in_motion().t[0] > 1.1


def test_torques_are_what_they_are_without_commands_beside_them():
    tau = np.cos(5 * Q)
    both, alone = Record(T, Q, tau, command=COMMAND), Record(T, Q, tau)
    assert np.array_equal(both.prepare().tau, alone.prepare().tau)
    assert not both.findings
    assert np.array_equal(both.cleaned.command, COMMAND)
    assert alone.cleaned.command is None


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        ({}, "`tau` or `command` must be given, got neither"),
        ({"tau": Q, "command_rate": Q}, "`command_rate` must come with the positions, `command`"),
        ({"command": COMMAND.T}, "`command` must have shape (400, 2), got (2, 400)"),
        ({"command": COMMAND, "command_rate": Q[1:]}, "`command_rate` must have shape (400, 2), got (399, 2)"),
    ],
)
def test_wrong_arguments_are_named(arguments, text):
    with pytest.raises(ValueError, match=f"^{re.escape(text)}$"):
        Record(T, Q, **arguments)


@pytest.mark.parametrize(
    "call",
    [
        lambda arm, record: record.prepare(),
        lambda arm, record: rne.identify(arm, record),
        lambda arm, record: rne.identify_payload(arm, record, record),
        lambda arm, record: rne.identification.regression(arm, record, arm.base_parameters()),
    ],
)
def test_who_needs_torques_says_what_fits_a_model_without(call):
    text = (
        "servo: the record has commands and no torques: fit it by rne.identify_motion (rne identify --without-torques)"
    )
    with exactly(text):
        call(first_joints(2), Record(T, Q, command=COMMAND, name="servo"))


# Screening


def test_gaps_and_clocks_are_those_of_positions():
    """A sample that is missing or there twice, and one time for different samples, which commands tell apart."""
    lost = np.delete(np.arange(400), [200, 201])
    record = Record(T[lost], Q[lost], command=COMMAND[lost])
    assert [x.kind for x in record.findings] == ["missing samples"]
    held = np.vstack([COMMAND[:200], COMMAND[[199, 199]], COMMAND[202:]])
    assert np.array_equal(record.cleaned.command, held)  # a command holds until the next
    between = Record(T[lost], Q[lost], command=COMMAND[lost], command_hold=False).cleaned.command
    curve = np.array([4.0, 7.2]) / 8 * (3 / RATE) ** 2  # of a line over three periods from a curve of this much bend
    assert (abs(between - COMMAND).max(axis=0) < curve).all()
    assert (abs(held - COMMAND).max(axis=0) > curve).all()
    twice = np.insert(np.arange(400), 100, 100)
    assert said(COMMAND[twice], Q[twice], T[twice]) == [("", "sample twice", (101,))]
    other = COMMAND[twice] + 0.1 * (np.arange(401) == 101)[:, None]
    assert said(other, Q[twice], T[twice]) == [("", "one time for different samples", (101,))]


def test_commands_that_are_missing_are_held_or_interpolated_and_said():
    command = COMMAND.copy()
    command[50:52, 1] = command[:3, 0] = np.nan
    held = Record(T, Q, command=command)
    assert [str(x) for x in held.findings] == [
        "warning: record: joint_1: no command before sample 3 (t = 0.03 s); the record begins there",
        "warning: record: joint_2: no finite command at 2 samples: 50 (t = 0.5 s), 51 (t = 0.51 s); the last one holds",
    ]
    assert len(held.cleaned.t) == 397
    assert held.cleaned.command[47:50, 1].tolist() == [COMMAND[49, 1]] * 2 + [COMMAND[52, 1]]
    linear = Record(T, Q, command=command, command_hold=False).cleaned.command
    np.testing.assert_allclose(linear[46:50, 1], np.linspace(*COMMAND[[49, 52], 1], 4), rtol=1e-14)
    command[:, 1] = np.nan
    record = Record(T, Q, command=command)
    assert ("joint_2", "no command") in [(x.joint, x.kind) for x in record.findings if x.severity == "error"]


def test_what_is_simulated_has_no_invented_positions():
    """Of spikes, missing samples and positions, on a grid; commands are those that held."""
    q, rows = Q.copy(), np.delete(np.arange(400), [200, 201])
    q[100, 0] += 0.1
    q[150] = np.nan
    record = Record(T[rows], q[rows], np.cos(Q[rows]), command=COMMAND[rows])
    grid = record.on_grid()
    unknown = np.zeros(Q.shape, bool)
    unknown[100, 0] = unknown[[150, 200, 201]] = True
    assert np.array_equal(np.isnan(grid.q), unknown)
    assert np.array_equal(record.cleaned.interpolated, unknown)
    assert abs(grid.t - T).max() < 1e-12  # of sums of periods
    assert abs(grid.q - Q)[~unknown].max() < 1e-9  # of a spline through the samples, beside these
    assert np.array_equal(grid.command[:200], COMMAND[:200])
    assert grid.tau is None
    assert Record(T, Q, command=COMMAND).on_grid().q is not None
    back = Record(T[::-1], Q, command=COMMAND)
    with pytest.raises(ValueError, match="time that goes back"):
        back.on_grid()


def test_positions_that_are_missing_take_no_command_with_them():
    """The command of such a sample acts on what comes after it."""
    q = Q.copy()
    q[100] = np.nan
    record = Record(T, q, command=COMMAND)
    assert np.array_equal(record.cleaned.command, COMMAND)
    assert abs(record.cleaned.q - Q).max() < 1e-6  # of a cubic spline over four periods: h^4 q''''/24


@pytest.mark.parametrize(
    ("command", "q", "text"),
    [
        (np.rad2deg(COMMAND), Q, "unit of the command: degrees, positions in rad"),
        (COMMAND, np.rad2deg(Q), "unit of the command: rad, positions in degrees"),
        (1e3 * COMMAND, Q, "unit of the command: mm, positions in m"),
        (COMMAND + 4 * np.pi, Q, "command is 2 turns from the position"),
        (COMMAND + 2 * np.pi - 0.75, Q, ""),
        (np.mod(COMMAND + np.pi, 2 * np.pi) - np.pi + 0 * Q, Q, ""),
        (np.mod(COMMAND, 2 * np.pi), Q, "jump of the command"),
        (0 * COMMAND + 1, Q, "constant command of 1 in all samples, while the position keeps moving"),
    ],
)
def test_commands_that_are_not_those_of_the_positions_are_said(command, q, text):
    findings = Record(T, q, command=command).findings
    assert all(text in str(x) for x in findings if "position" not in x.kind)
    assert bool(findings) == bool(text)


def test_constant_commands_are_steps_where_the_position_comes_to_rest():
    q = np.column_stack([np.exp(-5 * T), 1 - np.exp(-3 * T)])
    assert said(np.broadcast_to([0.0, 1.0], (400, 2)), q) == []


def test_commands_that_repeat_themselves_are_said_where_they_make_up_for_it():
    """Steps, ramps that end and counts of an encoder repeat commands as well, and move on from there."""
    late = COMMAND.copy()
    late[60:63, 0] = late[59, 0]
    assert said(late) == [("joint_1", "repeated command", (60, 61, 62))]
    steps = np.repeat(COMMAND[::8], 8, axis=0)
    ramps = np.clip(np.outer(T - 1, [0.5, -0.5]), -0.4, 0.6)
    counts = np.rint(COMMAND / 0.0015) * 0.0015
    for command in (steps, ramps, counts):
        assert [x for x in said(command, Q + command - COMMAND) if "command" in x[1]] == []


def test_commands_that_come_after_the_motion_are_said():
    """Columns of commands and positions that are exchanged, or of clocks that differ."""
    record = Record(T, COMMAND, command=Q)
    assert [(x.joint, x.kind) for x in record.findings] == [
        (x, "command after the position") for x in record.joint_names
    ]
    assert str(record.findings[0]).endswith("by about 10 ms; are columns exchanged, or clocks different?")
    assert said(Q, Q) == []  # of no delay at all


def test_steps_of_an_encoder_at_rest_are_no_jumps():
    """After a step response, with too few changes for the step of the encoder to be told."""
    step = 2 * np.pi / 2**12
    moved = np.clip(T[:, None] / 0.15, 0, 1)
    q = step * np.rint(0.06 * (3 * moved**2 - 2 * moved**3) / step)
    q[300:] -= step
    assert said(np.full((400, 1), 0.06), q) == []


# Logs


def write(path, names, *columns):
    rows = [",".join(names), *(",".join(map(repr, row)) for row in np.column_stack(columns).tolist())]
    path.write_text("\n".join(rows))
    return path


def columns(*forms, joints=("lift", "turn")):
    return [form.format(joint) for form in forms for joint in joints]


def read(record, joints=("lift", "turn"), tolerance=0.0, rate=False, count=400):
    """The record has the first samples above, and no finding but guesses."""
    assert record.joint_names == tuple(joints)
    assert record.tau is None
    assert abs(record.t - T[:count]).max() <= 1e-15 * T[-1]  # of one rounding
    for found, given in ((record.q, Q), (record.command, COMMAND), *[(record.command_rate, 3 * Q)] * rate):
        assert abs(found - given[:count]).max() <= tolerance
    assert rate or record.command_rate is None
    assert {x.kind for x in record.findings} <= {"guess"}


@pytest.mark.parametrize(
    ("measured", "command"),
    [
        ("q.{}", "command.{}"),
        ("q.{}", "q_des.{}"),
        ("actual_q.{}", "target_q.{}"),
        ("{}_q", "{}_q_cmd"),
        ("present_position.{}", "goal_position.{}"),
        ("position.{}", "goal.{}"),
        ("observation.state.{}.pos", "action.{}.pos"),
        ("observation.state.{}", "action.{}"),
        ("/arm/state/actual/{}/position", "/arm/state/desired/{}/position"),
        ("/arm/state/feedback/{}/position", "/arm/state/reference/{}/position"),
    ],
)
def test_names_of_commands_beside_positions(measured, command, tmp_path):
    """Words for commands beside the positions; limits, errors, currents and accelerations asked for are none."""
    others = ("q_limit.{}", "error_q.{}", "target_current.{}", "target_qdd.{}", "goal_temperature.{}")
    names = ["t", *columns(command, measured, *others[: 5 if "." in command[:2] or "q" in command else 3])]
    path = write(tmp_path / "log.csv", names, T, COMMAND, Q, *[0 * Q] * ((len(names) - 5) // 2))
    read(Record.from_log(path, torques=False))
    (path := tmp_path / "log.json").write_text(
        json.dumps(
            {"t": T.tolist()} | dict(zip(columns(command, measured), [*COMMAND.T.tolist(), *Q.T.tolist()], strict=True))
        )
    )
    read(Record.from_log(path))


def test_torques_come_before_commands_unless_these_are_asked_for(tmp_path):
    names = ["t", *columns("target_q_{}", "target_qd_{}", "actual_q_{}", "actual_torque_{}", joints="01")]
    path = write(tmp_path / "ur.csv", names, T, COMMAND, 3 * Q, Q, np.cos(Q))
    record = Record.from_log(path)
    assert np.array_equal(record.tau, np.cos(Q))
    assert record.command is None
    read(Record.from_log(path, torques=False), ("joint_1", "joint_2"), rate=True)
    read(Record.from_log(path, torques=False, joints=("lift", "turn")), rate=True)
    both = Record.from_log(path, columns={"command": ["target_q_0", "target_q_1"]})
    assert np.array_equal(both.tau, record.tau)
    assert np.array_equal(both.command, COMMAND)


def test_logs_of_single_servos_and_of_rows_of_joints(tmp_path):
    path = write(tmp_path / "servo.csv", ["t", "goal_position", "present_position"], T, COMMAND[:, 0], Q[:, 0])
    record = Record.from_log(path)
    assert np.array_equal(np.hstack([record.q, record.command]), np.column_stack([Q[:, 0], COMMAND[:, 0]]))
    rows = [f"{t!r},{j},{a!r},{b!r}" for t, x, y in zip(T.tolist(), Q.tolist(), COMMAND.tolist(), strict=True) for j, a, b in zip(("lift", "turn"), x, y, strict=True)]  # fmt: skip
    (path := tmp_path / "long.csv").write_text("\n".join(["t,joint,position,command", *rows]))
    read(Record.from_log(path))
    lines = [json.dumps({"t": t, "q": x, "q_cmd": y}) for t, x, y in zip(T.tolist(), Q.tolist(), COMMAND.tolist(), strict=True)]  # fmt: skip
    (path := tmp_path / "log.jsonl").write_text("\n".join(lines))
    read(Record.from_log(path), ("joint_1", "joint_2"))
    np.savez(path := tmp_path / "log.npz", t=T, q=Q, command=COMMAND, command_rate=3 * Q)
    read(Record.from_log(path), ("joint_1", "joint_2"), rate=True)
    files = {"q": write(tmp_path / "q.csv", ["t", "lift", "turn"], T, Q)}
    read(Record.from_log(files | {"command": write(tmp_path / "c.csv", ["t", "lift", "turn"], T, COMMAND)}))


def test_own_tables_have_commands_in_place_of_torques(tmp_path):
    path = write(tmp_path / "log.csv", ["t", *columns("q.{}", "command.{}", "command_rate.{}")], T, Q, COMMAND, 3 * Q)
    read(Record.from_csv(path, ["lift", "turn"]), rate=True)
    with pytest.raises(
        ValueError, match=r"there is no column 'command\.arm', which is needed; there are 'command\.lift'"
    ):
        Record.from_csv(write(path, ["t", "q.arm", "command.lift"], T, Q), ["arm"])
    names = ["t", *columns("q.{}", "tau.{}"), "command.lift"]
    assert Record.from_csv(write(path, names, T, Q, Q, T), ["lift", "turn"]).command is None


def test_whole_numbers_within_two_turns_are_angles(tmp_path):
    """Of drives that were sent to whole radians, 12 of which are fewer than two turns."""
    q = np.round(6 * np.column_stack([np.sin(T), np.cos(T)]))
    path = write(tmp_path / "log.csv", ["t", *columns("q.{}", "command.{}")], T, q, q)
    assert np.ptp(q) == 12
    np.testing.assert_array_equal(Record.from_log(path).q, q)


def test_units_of_commands_are_those_of_the_positions_unless_they_are_named_or_given(tmp_path):
    counts = [np.rint(x * 4096 / (2 * np.pi)) + 2048 for x in (COMMAND, Q)]
    names = ["t", *columns("goal_position_{}", "present_position_{}", joints="12")]
    path = write(tmp_path / "ticks.csv", names, T, *counts)
    low, high = counts[1].min(), counts[1].max()
    text = (
        f"{path}: 'present_position_1' to 'present_position_2' are whole numbers from {low:g} to {high:g}, degrees or "
    )
    with exactly(text + 'steps; give units={"q": "deg"}, or rad per step, such as 2 * pi / 4096, and `offsets`'):
        Record.from_log(path)
    options = {"units": {"q": 2 * np.pi / 4096}, "offsets": -np.pi}
    half = np.pi / 4096 * (1 + 1e-9)  # of a step, to which counts are rounded
    read(Record.from_log(path, **options), ("joint_1", "joint_2"), half)
    named = [f"{name} [ticks]" if name != "t" else name for name in names]
    read(Record.from_log(write(path, named, T, *counts), **options), ("joint_1", "joint_2"), half)
    with pytest.raises(ValueError, match=r"the unit 'ticks' of column 'present_position_2 \[ticks\]' is not known"):
        Record.from_log(path)
    write(path, ["t", *columns("goal_{} [deg]", "pos_{} [rad]")], T, np.rad2deg(COMMAND), Q)
    read(Record.from_log(path), tolerance=1e-15)  # of one rounding to degrees and back
    write(path, ["t", *columns("goal_{}", "pos_{}")], T, 0.5 * COMMAND, Q)
    read(Record.from_log(path, units={"command": 2.0}))
    path.write_text(path.read_text().replace("pos_turn", "pos_arm"))
    with exactly(f"{path}: there are no positions and commands of joint 'turn'; there are 'lift'"):
        Record.from_log(path, joints=["lift", "turn"])


def test_ambiguous_and_missing_commands_are_refused_by_name(tmp_path):
    names = ["t", *columns("q.{}", "target_q.{}", "q_cmd.{}")]
    path = write(tmp_path / "log.csv", names, T, Q, COMMAND, Q)
    with exactly(f"{path}: columns 'target_q.lift' and 'q_cmd.lift' may both be commands of lift; give columns={{\"command\": ...}}"):  # fmt: skip
        Record.from_log(path)
    read(Record.from_log(path, columns={"command": ["target_q.lift", "target_q.turn"]}))
    read(Record.from_log(write(path, names, T, Q, COMMAND, COMMAND)))  # the same twice
    write(path, ["t", *columns("q.{}", "tau.{}", "q_limit.{}")], T, Q, Q, Q)
    with exactly(f"{path}: there are no commands; there are 't', 'q.lift', 'q.turn', 'tau.lift', 'tau.turn', 'q_limit.lift', 'q_limit.turn'; if some are, give columns={{\"command\": ...}}"):  # fmt: skip
        Record.from_log(path, torques=False)


def data_set(folder, robot="so101_follower", joints=("lift", "turn"), scale=1.0):
    """A LeRobot data set of these joints in degrees, times a scale."""
    parquet = pytest.importorskip("pyarrow.parquet", reason="pyarrow is not installed, which reads LeRobot data sets")
    import pyarrow as arrow

    (folder / "meta").mkdir(parents=True, exist_ok=True)
    (folder / "data" / "chunk-000").mkdir(parents=True, exist_ok=True)
    features = {x: {"names": [f"{joint}.pos" for joint in joints]} for x in ("action", "observation.state")}
    (folder / "meta" / "info.json").write_text(json.dumps({"robot_type": robot, "features": features}))
    lists = {"action": COMMAND, "observation.state": Q}
    table = {
        x: arrow.array((scale * np.rad2deg(y)).tolist(), arrow.list_(arrow.float64(), 2)) for x, y in lists.items()
    }
    table |= {"timestamp": T, "episode_index": 0 * np.arange(400)}
    parquet.write_table(arrow.table(table), folder / "data" / "chunk-000" / "file-000.parquet")
    return folder


def test_lerobot_data_sets_are_in_degrees_where_they_show_it(tmp_path):
    folder = data_set(tmp_path)
    read(Record.from_log(folder, units={"q": "deg"}), tolerance=1e-15)
    unknown = (
        f'{folder}: positions of LeRobot data sets are in degrees or normalised; give units={{"q": "deg"}}, or rad per '
        "unit of each joint and `offsets`"
    )
    for robot, scale in (("so101_follower", 1.0), ("koch_follower", 3.0)):  # normalised ones end at 100
        with exactly(unknown):
            Record.from_log(data_set(tmp_path, robot, scale=scale))
    record = Record.from_log(data_set(tmp_path, scale=3.0))
    assert abs(record.command - 3 * COMMAND).max() < 1e-14
    assert "positions of so101_follower are in degrees, as some pass 100" in str(record.findings[0])
    with pytest.raises(ValueError, match=r"'observation\.state\.gripper\.pos' is in per cent of its range"):
        Record.from_log(data_set(tmp_path, joints=("lift", "gripper"), scale=3.0))


POINT = "trajectory_msgs/JointTrajectoryPoint"
MESSAGES = f"""float64[] positions
float64[] velocities
float64[] accelerations
float64[] effort
builtin_interfaces/Duration time_from_start
{"=" * 80}
MSG: builtin_interfaces/Duration
int32 sec
uint32 nanosec
"""
FIELDS = {  # of the state of a controller, as control_msgs had them in ROS 1, and has them from Humble and Jazzy on
    "bag": f"{POINT} desired\n{POINT} actual\n{POINT} error\n",
    "db3": "".join(f"{POINT} {x}\n" for x in ("reference", "feedback", "error", "output", "desired", "actual"))
    + "string[] multi_dof_joint_names\n",
    "mcap": "".join(f"{POINT} {x}\n" for x in ("reference", "feedback", "error", "output"))
    + "float64 speed_scaling_factor\n",
}


def controller_bag(path, suffix, beside=None):
    """A bag of states of a controller in the layout of FIELDS, and joint states without efforts as the function says."""
    pytest.importorskip("rosbags", reason="rosbags is not installed, which reads bags of ROS")
    from rosbags import rosbag1, rosbag2, typesys

    is_old, kind = suffix == "bag", "control_msgs/msg/JointTrajectoryControllerState"
    store = typesys.get_typestore(typesys.Stores.ROS1_NOETIC if is_old else typesys.Stores.ROS2_HUMBLE)
    text = f"std_msgs/Header header\nstring[] joint_names\n{FIELDS[suffix]}{'=' * 80}\nMSG: {POINT}\n{MESSAGES}"
    own = typesys.get_types_from_msg(text, kind)
    store.register({name: x for name, x in own.items() if name not in store.types})
    State, Point, Joints, Header, Time, Duration = (
        store.types[x]
        for x in (kind, POINT.replace("/", "/msg/"), "sensor_msgs/msg/JointState", "std_msgs/msg/Header", "builtin_interfaces/msg/Time", "builtin_interfaces/msg/Duration")
    )  # fmt: skip
    if is_old:
        writer = rosbag1.Writer(path)
    else:
        plugin = rosbag2.StoragePlugin.MCAP if suffix == "mcap" else rosbag2.StoragePlugin.SQLITE3
        writer = rosbag2.Writer(path, version=9, storage_plugin=plugin)
    pack, none = store.serialize_ros1 if is_old else store.serialize_cdr, np.zeros(0)

    def point(positions, velocities):
        return Point(positions, velocities, none, none, Duration(0, 0))

    with writer:
        topic = writer.add_connection("/arm/controller_state", kind, typestore=store)
        states = writer.add_connection("/joint_states", Joints.__msgtype__, typestore=store) if beside else None
        for k, t in enumerate(np.rint(T[:120] * 1e9).astype(int).tolist()):
            stamp = Header(**({"seq": k} if is_old else {}), stamp=Time(5 + t // 10**9, t % 10**9), frame_id="base")
            first, more = [point(COMMAND[k], 3 * Q[k]), point(Q[k], none)], FIELDS[suffix].count(POINT) - 2
            last = {"bag": [], "db3": [["rail"]], "mcap": [1.0]}[suffix]
            message = State(stamp, ["lift_effort", "turn"], *first, *[point(9 + 0 * Q[k], none)] * more, *last)
            writer.write(topic, 10**10 + t, pack(message, kind))
            if states:
                message = Joints(stamp, ["lift_effort", "turn"], Q[k], none, beside(k))
                writer.write(states, 10**10 + t, pack(message, Joints.__msgtype__))
    return path


@pytest.mark.parametrize("suffix", list(FIELDS))
def test_states_of_controllers_in_bags(suffix, tmp_path):
    """References beside what was measured, in three layouts; whatever words are in joints' names."""
    joints, none = ("lift_effort", "turn"), np.zeros(0)
    path = controller_bag(tmp_path / f"alone.{suffix}", suffix)
    read(Record.from_log(path), joints, rate=True, count=120)
    record = Record.from_log(controller_bag(tmp_path / f"silent.{suffix}", suffix, lambda k: none))
    read(record, joints, rate=True, count=120)
    assert record.source.startswith(
        "topic /arm/controller_state, times from the first message on, at 5.000 s; t: 't'; "
    )
    if suffix == "mcap":
        path = controller_bag(tmp_path / f"loud.{suffix}", suffix, lambda k: np.cos(Q[k]))
        assert np.array_equal(Record.from_log(path).tau, np.cos(Q[:120]))
        read(Record.from_log(path, torques=False), joints, rate=True, count=120)
        with pytest.raises(ValueError, match=r"there is no topic /joint_states of control_msgs/msg/JointTrajectory"):
            Record.from_log(path, torques=False, topic="/joint_states")


def test_controllers_are_read_in_the_usual_order_of_bytes_alone(tmp_path):
    folder = controller_bag(tmp_path / "alone", "db3")
    (file,) = folder.glob("*.db3")
    with closing(sqlite3.connect(file)) as connection, connection:
        messages = connection.execute("select data, id from messages").fetchall()
        swapped = [(b"\0\0" + data[2:], number) for data, number in messages]  # big-endian by its first bytes
        connection.executemany("update messages set data = ? where id = ?", swapped)
    with exactly(f"{file}: has messages of controllers in another byte order than little-endian"):
        Record.from_log(file)


# Command line


@pytest.fixture
def lever(tmp_path):
    """A lever under PD control that follows steps, in two logs of 0.8 s, and the numbers of its scene."""
    level = [[1, 0, 0, 0], [0, 0, -1, 0], [0, 1, 0, 0], [0, 0, 0, 1]]  # the joint's axis
    bodies = {"masses": [0.5], "centres": [[0, 0, 0]], "inertias": [[1e-3, 1e-3, 1e-3]]}
    arm = rne.dh_chain(a=[0.2], alpha=[0], d=[0], theta=[0], base=level, **bodies)
    (tmp_path / "arm.urdf").write_text(rne.to_urdf(arm))
    robot, t = rne.Robot(arm), np.arange(20) / 25
    for name, seed in (("a.csv", 0), ("b.csv", 1)):
        steps = np.repeat(np.random.default_rng(seed).uniform(-1, 1, 2), 10)[:, None]
        law = rne.control.pd(robot, 8.0, 0.0, rne.trajectories.sampled(t, steps, kind="hold"))
        scene = rne.Scene(robot, controller=law, friction=rne.Friction(viscous=0.4), armature=0.02)
        motion = rne.simulate(scene, steps[0], [0.0], t[-1], t_eval=t, rtol=1e-8)
        write(tmp_path / name, ["t", "q.joint_1", "q_cmd.joint_1"], t, np.rint(motion.q * 1e4) / 1e4, steps)
    return tmp_path


def test_rne_identify_without_torques(lever, monkeypatch, capsys):
    monkeypatch.setattr("rne.plotting.html_page.has_matplotlib", lambda: False)  # pictures have tests of their own
    monkeypatch.setattr("rne.commands.commanded.importlib.util.find_spec", lambda name: None)  # nothing is compiled
    call = ["identify", *(str(lever / x) for x in ("arm.urdf", "a.csv")), "--check", str(lever / "b.csv"), "--page", str(lever / "page")]  # fmt: skip
    motion = [*call, "--without-torques", "--kp", "5", "--viscous", "0.3", "--wrt", "controller.kp,friction.viscous"]
    assert main([*motion, "--starts", "1", "--rotors", "0.02", "--out", str(lever / "found.urdf")]) == 0
    said, progress = capsys.readouterr()
    page = (lever / "page" / "index.html").read_text()
    (kp,) = re.findall(r"controller\.kp +(\S+) +(\S+)", said)
    assert abs(float(kp[0]) - 8) < 4 * float(kp[1]) < 0.2  # 4 standard errors
    assert "b.csv, predicted" in said
    assert "a.csv, fitted" in page
    assert re.search(r"^  iteration 1: residual [\d.e+]+ standard deviations of the positions$", progress, re.MULTILINE)
    assert abs(rne.load(lever / "found.urdf").model.damping[0] - 0.4) < 0.004  # 1 %, some standard errors
    for wrong, text in (
        ([*call, "--kp", "5"], "--kp: needs --without-torques"),
        ([*call, "--without-torques"], "--kp: is needed: gains to start from, which may be wrong by a factor of two"),
        ([*motion, "--gains", "2"], "--gains: is of torques, and cannot be given with --without-torques"),
        ([*motion, "--servo", "sts3215-12v"], "--servo: needs --controller servo"),
        ([*motion[:-1], "controller.ki"], "--wrt must name some of "),
    ):
        assert main(wrong) == 2
        assert text in capsys.readouterr().err


def test_options_without_torques_are_a_group_of_the_help(capsys):
    with pytest.raises(SystemExit, match=r"^0$"):
        main(["identify", "--help"])
    assert "\nwithout torques:\n  the fit starts from these, which may be wrong" in capsys.readouterr().out


def test_published_figures_of_servos_are_the_start_where_nothing_else_is_given(lever):
    robot = rne.load(lever / "arm.urdf")
    call = ["identify", "arm.urdf", "a.csv", "--without-torques", "--controller", "servo", "--servo", "sts3215-12v"]
    figures = rne.control.servo_figures("sts3215-12v")
    numbers = scene_of(robot, parser().parse_args([*call, "--coulomb", "0.2"])).numbers
    assert numbers["controller.kp"] == figures.law(robot).kp
    assert numbers["controller.stall_torque"] == figures.stall_torque
    assert numbers["friction.coulomb"] == 0.2
    assert numbers["friction.viscous"] == figures.viscous
    assert numbers["armature"] == figures.armature
