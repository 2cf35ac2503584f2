r"""
Payload study
=============

How heavy a tool may a UR5 carry, and how far from the flange may the tool's centre of
mass lie? Beyond that, a drive would have to deliver more than its largest torque. The
answer is a load diagram, like those in the data sheets of robots.

Needs: ``pip install '.[plot,robots]'``
"""

import numpy as np
from matplotlib.figure import Figure

import rne

robot = rne.load("ur5")
limit = robot.effort_limit  # [N m]

# %%
# A payload on a link
# -------------------
# ``with_payload`` returns a new robot with one more rigid body fixed to a link. The
# first robot stays as it is. You give the centre of mass in the axes of that link.
# Several links of this URDF could be called its end, and their axes point in different
# directions:

for link in ("wrist_3_link", "ee_link", "tool0"):
    pose = robot.link_poses(np.zeros(6))[robot.link_names.index(link)]
    origin, z_axis = pose[:3, 3], pose[:3, 2]
    print(f"{link:13} origin [m] {origin.round(3)}, z axis {z_axis.round(3) + 0.0}")

# %%
# The flange is ``tool0``. Its z axis points away from the arm. In the axes of the other
# links, the same numbers would place the load to the side of the flange. If a robot has
# only one end, you may leave out the link. Otherwise you get an error:

try:
    rne.load("panda").with_payload(3.0)
except ValueError as error:
    print(error)

# %%
# The states of the study
# -----------------------
# What a joint has to carry depends on the posture and the motion. Here we take 4000
# random states: all postures, velocities up to a third of the limits, and accelerations
# up to 3 rad/s\ :sup:`2`. One call computes the whole batch, (4000, 6) in and (4000, 6)
# out.

rng = np.random.default_rng(0)
q = rng.uniform(-np.pi, np.pi, (4000, 6))
qd = rng.uniform(-1, 1, (4000, 6)) * robot.velocity_limit / 3
qdd = rng.uniform(-3, 3, (4000, 6))
empty = robot.inverse_dynamics(q, qd, qdd)

figure = Figure(figsize=(8, 3.6), layout="constrained")
ax = figure.subplots()
for k, mass in enumerate((0, 3, 6)):
    loaded = robot.with_payload(mass, com=[0, 0, 0.1], link="tool0")
    used = abs(loaded.inverse_dynamics(q, qd, qdd)) / limit
    colour = f"C{k}"
    ax.boxplot(
        used,
        positions=np.arange(6) + 0.25 * (k - 1),
        widths=0.2,
        whis=(0, 100),
        label=f"{mass} kg at 0.1 m",
        patch_artist=True,
        boxprops={"facecolor": colour, "alpha": 0.5},
        medianprops={"color": "black"},
    )
ax.axhline(1, color="black", linewidth=0.8)
ax.set_xticks(
    range(6),
    [name.removesuffix("_joint").replace("_", "\n", 1) for name in robot.joint_names],
)
ax.set(ylabel="torque / limit of the joint", xlabel="joint")
ax.legend(frameon=False)
figure

# %%
# The boxes hold the middle half of the states, the whiskers all of them. The shoulder
# carries the arm even without a load. The smaller drives of the wrist need almost no
# torque then, and their share of the limit grows faster with the mass.
#
# The load diagram
# ----------------
# If the centre of mass does not change, the torques are linear in the mass of the
# payload: :math:`\tau(m) = \tau(0) + m\,y`, with :math:`y = \tau(1\,\mathrm{kg}) -
# \tau(0)`. So a division gives the largest mass that a joint can carry in one state.
# The study needs one batch per position of the load, but no further batch per mass.

offsets = np.linspace(0, 0.4, 21)  # of the load from the flange, along its axis [m]
carried = []
for offset in offsets:
    loaded = robot.with_payload(1.0, com=[0, 0, offset], link="tool0")
    y = loaded.inverse_dynamics(q, qd, qdd) - empty
    room = np.where(y > 0, limit - empty, limit + empty)
    carried.append((room / np.maximum(abs(y), 1e-12)).min(axis=0))  # in all states
carried = np.array(carried)  # offsets, joints [kg]

figure = Figure(figsize=(8, 4), layout="constrained")
ax = figure.subplots()
ax.plot(offsets, carried, label=robot.joint_names)
ax.fill_between(offsets, carried.min(axis=1), color="0.9")
ax.text(0.01, 0.5, "every drive within its limit in every state")
ax.set_xlabel("offset of the centre of mass from the flange [m]")
ax.set_ylabel("mass of the payload [kg]")
ax.set(xlim=(0, 0.4), ylim=(0, 20))
ax.legend(loc="center left", bbox_to_anchor=(1, 0.5), frameon=False, title="allowed by")
figure

# %%
# Below the lowest curve all drives stay within their limits in all states of the study.
# Curves above 20 kg are left out. One joint limits the load close to the flange, and
# another one far from it. The torque of a wrist joint grows with the offset from its
# own axis; that of the shoulder hardly changes.

for k in (0, 5, 10, 20):
    joint = robot.joint_names[carried[k].argmin()]
    print(f"{offsets[k]:.2f} m: at most {carried[k].min():.2f} kg, limited by {joint}")
assert len(set(carried.argmin(axis=1))) > 1

# %%
# Check this with the full computation: with the largest mass at one offset, the worst
# joint of the worst state is at its limit.

mass, offset = carried[10].min(), offsets[10]
loaded = robot.with_payload(mass, com=[0, 0, offset], link="tool0")
tau = loaded.inverse_dynamics(q, qd, qdd)
use = (abs(tau) / limit).max()
print(f"{mass:.3f} kg at {offset:.2f} m: largest torque / limit = {use:.12f}")
assert np.isclose(use, 1, rtol=1e-10)
