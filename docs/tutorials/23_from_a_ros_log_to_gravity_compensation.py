r"""
From a ROS log to gravity compensation
======================================

A low-cost arm, the SO-101, carries a camera that is not in its URDF. ROS 2 recorded its
joint states in an MCAP file, with the currents of the servos as efforts. This tutorial
reads the file without ROS, identifies the masses, and compensates gravity. The log is
simulated, so we know the truth.

Needs: ``pip install '.[plot,robots,identify,ros]'``
"""

import tempfile
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

import rne

# %%
# The recording
# -------------
# The arm waits, moves for 20 s, and waits again. A servo gives 1.1 N m per ampere,
# loses some of it to friction, and reports milliamperes with a noise of 15 mA.

robot = rne.load("so101")
arm = robot.with_payload(0.12, link="gripper_link").locked({"gripper": 0.0})
gain = 1.1  # [N m/A]
t = np.arange(0, 24, 0.01)
moving = np.clip(t - 2, 0, 20)
ramp = np.sin(np.pi * moving / 20) ** 2  # from rest to rest
w = 2 * np.pi * np.array([0.25, 0.3, 0.35, 0.4, 0.45])  # [rad/s]
size = np.array([0.8, 0.6, 0.6, 0.8, 1.0])  # [rad]
q = np.outer(ramp, size) * np.sin(np.outer(moving, w))
qd = np.gradient(q, t, axis=0)
qdd = np.gradient(qd, t, axis=0)
friction = 0.04 * qd + 0.06 * np.tanh(qd / 0.01)
rng = np.random.default_rng(0)
current = 1e3 * (arm.inverse_dynamics(q, qd, qdd) + friction) / gain
current = current + 15 * rng.standard_normal(current.shape)
step = 2 * np.pi / 4096  # of the encoders

# %%
# ``rosbags`` writes the file as ``ros2 bag record --storage mcap /joint_states`` does.

store = get_typestore(Stores.ROS2_HUMBLE)
Time = store.types["builtin_interfaces/msg/Time"]
Header = store.types["std_msgs/msg/Header"]
JointState = store.types["sensor_msgs/msg/JointState"]
folder = tempfile.TemporaryDirectory()
log = Path(folder.name) / "so101"
names = [*arm.joint_names, "gripper"]
with Writer(log, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
    kind = JointState.__msgtype__
    connection = writer.add_connection("/joint_states", kind, typestore=store)
    for k in range(len(t)):
        ns = 1_790_000_000_000_000_000 + int(1e7) * k
        header = Header(Time(ns // 10**9, ns % 10**9), "")
        position = np.array([*step * np.rint(q[k] / step), 0.0])
        effort = np.array([*np.rint(current[k]), 0.0])
        message = JointState(header, names, position, np.empty(0), effort)
        writer.write(connection, ns, store.serialize_cdr(message, kind))

# %%
# Reading it
# ----------
# The file does not contain the unit of the efforts, milliamperes, nor the torque per
# ampere: we give both. ``joints`` excludes the gripper, which did not move.
# ``in_motion`` removes the waiting times. ``source`` describes what was read, and
# findings would list faults of the log.

record = rne.identification.Record.from_log(
    log, joints=arm.joint_names, units={"tau": "mA"}, gains=gain
).in_motion()
print(record.source, *record.findings, sep="\n")
assert "rest cut off" in record.source

# %%
# Identify the masses
# -------------------
# The robot is the one of the URDF, without the camera. Its gripper is not in the
# record: we lock it at its position. Servos have friction; we do not fit their rotors.

drives = rne.DriveModel(friction="viscous+coulomb")
known = robot.locked({"gripper": 0.0})
found = rne.identify(known, record, drives=drives)
print(*found.report().split("\n\n")[:3], sep="\n\n")
figure = found.plot()

# %%
# Gravity compensation
# --------------------
# Gravity compensation is ``gravity_torque`` of the identified robot; where the fit has
# offsets, which it has not here, ``found.friction.offset`` is added. The table compares
# it with that of the URDF and with the true one, from the middle of the arm's range to
# either side.

pose = np.linspace(-1, 1, 100)[:, None] * [0.0, 0.9, 0.9, 0.9, 0.0]
true = arm.gravity_torque(pose)
before = known.gravity_torque(pose)
after = found.robot.gravity_torque(pose)
holding = Figure(figsize=(6.4, 3.2), layout="constrained")
ax = holding.subplots()
for torque, label, style in (
    (true, "true", "k-"),
    (before, "URDF", "C3--"),
    (after, "identified", "C0:"),
):
    ax.plot(pose[:, 1], torque[:, 1], style, label=label)
ax.set(xlabel="position of shoulder_lift [rad]", ylabel="holding torque [N m]")
ax.legend()
for torque, name in ((before, "URDF"), (after, "identified")):
    print(f"{name}: up to {1e3 * abs(torque - true).max():.0f} mN m missing")
assert abs(after - true).max() < 0.1 * abs(before - true).max()

# %%
# The same on the command line, from the log to a URDF and a page of pictures:
#
# .. code-block:: sh
#
#    rne identify so101 so101.mcap --locked gripper=0 --units tau=mA --gains 1.1 --out camera.urdf
#
# The same call reads LeRobot data sets (extra ``lerobot``). Most of them contain only
# positions and commands; record the currents of the servos as well.

folder.cleanup()
holding
