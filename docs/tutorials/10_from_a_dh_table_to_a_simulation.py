r"""
From a DH table to a simulation
===============================

You know a SCARA robot by its Denavit-Hartenberg table, the masses of its links and
their dimensions. This tutorial makes a model of it, writes a URDF file for other
programs, and simulates a pick-and-place motion under control.

Needs: ``pip install '.[plot]'``
"""

import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np

import rne

# %%
# The table
# ---------
# Two arms turn about vertical axes, a quill slides down, and a gripper turns about the
# quill's axis:
#
# =====  =====  ===========  =====  =======
# joint  a [m]  alpha [rad]  d [m]  theta
# =====  =====  ===========  =====  =======
# 1      0.35   0            0.40   q1
# 2      0.25   pi           0      q2
# 3      0      0            q3     0
# 4      0      0            0.05   q4
# =====  =====  ===========  =====  =======
#
# Leave the joint variables out of the arrays: their entries are the values at q = 0.
# The rotation by pi in the second row makes the z axis of the quill point down, so the
# quill moves down with growing q3.

masses = np.array([8.0, 5.0, 1.5, 0.8])  # [kg]
model = rne.dh_chain(
    a=[0.35, 0.25, 0, 0],
    alpha=[0, np.pi, 0, 0],
    d=[0.40, 0, 0, 0.05],
    theta=[0, 0, 0, 0],
    types=["revolute", "revolute", "prismatic", "revolute"],
    masses=masses,
    centres=[[-0.175, 0, 0], [-0.125, 0, 0], [0, 0, -0.10], [0, 0, -0.02]],
    inertias=[
        rne.model.cylinder_inertia(8.0, 0.06, 0.35, "x"),
        rne.model.cylinder_inertia(5.0, 0.05, 0.25, "x"),
        rne.model.cylinder_inertia(1.5, 0.01, 0.30, "z"),
        rne.model.cylinder_inertia(0.8, 0.04, 0.04, "z"),
    ],
    lower=[-2.3, -2.5, 0.0, -6.3],
    upper=[2.3, 2.5, 0.2, 6.3],
    velocity=[5.0, 7.0, 1.0, 20.0],
    effort=[60.0, 30.0, 100.0, 5.0],
    name="scara",
)
print(rne.Robot(model))
rne.check(
    model
)  # millimetres, impossible inertias, ranges that are the wrong way round

# %%
# You give each link's centre of mass and inertia in its DH frame. In the standard
# convention this frame lies at the far end of the link. That is why the arms' centres
# have a negative x, half a length back. ``convention="modified"`` takes Craig's table
# instead.
#
# Shapes are for pictures only. They are placed in the frames of the links. These have
# the axes of the DH frames, and their origins lie on the axes of the links' own joints.

lying, upright = (0.0, np.pi / 2, 0.0), (0.0, 0.0, 0.0)
shapes = (
    rne.model.Cylinder("base_link", 0.06, 0.40, (0.0, 0.0, 0.20), upright),
    rne.model.Cylinder("link_1", 0.06, 0.35, (0.175, 0.0, 0.40), lying),
    rne.model.Cylinder("link_2", 0.05, 0.25, (0.125, 0.0, 0.0), lying),
    rne.model.Cylinder("link_3", 0.01, 0.30, (0.0, 0.0, -0.10), upright),
    rne.model.Cylinder("link_4", 0.04, 0.04, (0.0, 0.0, 0.03), upright),
)
robot = rne.Robot(replace(model, shapes=shapes))
pick, place = np.array([-0.6, 1.6, 0.15, 0.0]), np.array([0.9, 0.8, 0.15, 1.57])
picture = rne.plotting.draw(robot, pick)

# %%
# Two checks by hand
# ------------------
# You can compute the position of the gripper from the table by hand. Gravity acts along
# the axes of the rotating joints, so it loads only the quill: its drive holds the
# weight of quill and gripper, against the downward direction of the joint.

q1, q2, q3, _ = pick
by_hand = [
    0.35 * np.cos(q1) + 0.25 * np.cos(q1 + q2),
    0.35 * np.sin(q1) + 0.25 * np.sin(q1 + q2),
    0.40 - q3 - 0.05,
]
gripper = robot.link_poses(pick)[-1, :3, 3]
print("gripper [m]:", gripper.round(4), "by hand:", np.round(by_hand, 4))
print("torques at rest [N m, N m, N, N m]:", robot.gravity_torque(pick).round(3) + 0.0)
assert np.allclose(gripper, by_hand, rtol=0, atol=1e-15)
assert np.allclose(
    robot.gravity_torque(pick), [0, 0, -(1.5 + 0.8) * 9.81, 0], rtol=0, atol=1e-12
)

# %%
# A URDF file
# -----------
# Other programs read the robot from a URDF. Read it back, and you get the same robot.

with tempfile.TemporaryDirectory() as folder:
    file = Path(folder) / "scara.urdf"
    file.write_text(rne.to_urdf(robot.model))
    again = rne.load(str(file))
q = np.random.default_rng(0).uniform(-1, 1, (100, 4))
difference = abs(again.mass_matrix(q) - robot.mass_matrix(q)).max()
print(f"largest difference of the mass matrices: {difference:.1e}")
assert difference < 1e-14 * abs(robot.mass_matrix(q)).max()

# %%
# Pick and place
# --------------
# The quill lifts, the arms turn, the quill lowers: three quintic motions one after the
# other. A reference is any function of time that returns positions, velocities and
# accelerations.

lift = np.array([0, 0, 0.13, 0])
ways = [
    (pick, pick - lift, 0.35),
    (pick - lift, place - lift, 0.6),
    (place - lift, place, 0.35),
]
legs = [rne.trajectories.quintic(*way) for way in ways]
begins = np.cumsum([0.0, *(leg.duration for leg in legs[:-1])])


def reference(t):
    """The motions added up: before its start and after its end each of them rests."""
    parts = [leg(t - begin) for leg, begin in zip(legs, begins)]
    q, qd, qdd = (sum(part) for part in zip(*parts))
    return q - legs[1].start - legs[2].start, qd, qdd


law = rne.control.computed_torque(robot, [400] * 4, [40] * 4, reference)
off = pick + [0.02, -0.02, 0.0, 0.0]  # the arms start 0.02 rad beside the reference
scene = rne.Scene(robot, controller=law)
motion = rne.simulate(scene, off, np.zeros(4), 1.6)
cost = scene.cost()
print(
    f"the law is {cost['law']}; with the robot {cost['total']} operations per evaluation"
)
print(motion.message)
print(f"largest error at the end: {abs(motion.q[-1] - place).max():.1e} rad or m")
assert abs(motion.q[-1] - place).max() < 1e-4

# %%
# ``check_limits`` compares the motion with the ranges, speeds and efforts of the model:

print(*(motion.check_limits() or ["no limit is exceeded"]), sep="\n")
figure = rne.plotting.plot(motion, quantities=["q", "tau"])

# %%
# The first torques remove the initial error. The force of the quill is its weight, plus
# more while it accelerates upwards, and less while it brakes.
