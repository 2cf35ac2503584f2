"""
From via points to the drives
=============================

A UR5 picks a part and places it elsewhere. How fast can it move, and what are the loads
on motors, gears and bearings? We plan the fastest motion along a path, compute the
loads of its drives, and compare with a payload.

Needs: ``pip install '.[plot,robots,fastest]'``
"""

import numpy as np
from matplotlib.figure import Figure

import rne

robot = rne.load("ur5").with_limits(acceleration=40.0)  # [rad/s^2]
print(robot.effort_limit, robot.velocity_limit)  # of its URDF [N m, rad/s]

# %%
# The path
# --------
# Via points are joint positions: taught ones, or points of a Cartesian path converted
# by inverse kinematics. At points 2 and 4 the arm stops for the gripper.

home, above, pick = (
    [0, -1.6, 1.6, -1.6, -1.6, 0],
    [0.6, -1.2, 1.6, -2, -1.6, 0.6],
    [0.6, -1.0, 1.7, -2.3, -1.6, 0.6],
)
via, place = [0, -1.5, 1.5, -1.6, -1.6, 0], [-0.8, -1.0, 1.7, -2.3, -1.6, -0.8]
path = rne.trajectories.through([home, above, pick, via, place, home], stops=[2, 4])
print(path)

# %%
# The fastest motion
# ------------------
# Friction and payload are included. In the time-optimal motion some limit is active at
# every instant, so that torques jump. By default the motion is averaged over 10 ms,
# which drives can follow and which adds that time between two stops.

friction = rne.Friction(viscous=3.0, coulomb=4.0)
motion = rne.trajectories.fastest(robot, path, friction=friction, payload=2.0)
print(motion)
empty = rne.trajectories.fastest(robot, path, friction=friction)
print(f"{empty.duration:.3f} s without the payload, {motion.duration:.3f} s with it")
assert empty.duration <= motion.duration
sharp = rne.trajectories.fastest(
    robot, path, friction=friction, payload=2.0, smoothing=0
)
assert motion.steps()[0].max() < 0.2 * sharp.steps()[0].max()

# %%
# How good is it? On 100 random paths each of a UR5, the IRB 140 and a Panda's arm, half
# of them with friction, no limit was exceeded by more than 0.09 % at 10,000 instants,
# with torques of rne and of Pinocchio; some limit was used to 99 % at all but at most 2
# of them; durations agreed with those of toppra with Pinocchio's dynamics to 0.001 %.
# PD control at 1 kHz with the planned torques as feed-forward kept simulated arms
# within 0.1 mrad of their paths, and within 0.3 mrad without smoothing, if each sample
# holds the mean of the planned torques over it: a torque that jumps within a sample
# then gives the arm the same impulse. ``python -m benchmarks.fastest`` repeats this.
#
# Loads of the drives
# -------------------
# Take gear ratios, rotors and efficiencies from your data sheets; these are examples.
# The energy that motors take and do not return is work on the arm (here only friction,
# as the arm ends where it began) and losses in the gears.

report = rne.drives(robot, motion, gear=101, rotor=5e-5, efficiency=0.8)
print(report)
spent = report.work + report.gear_losses + report.rotor_energy
balance = report.energy_taken - report.energy_returned - spent
assert abs(balance).max() < 1e-9 * report.energy_taken.max()
rne.plotting.torque_speed(report)

# %%
# The command does the same with a file of via points, and writes a page with a 3-D view:
# ``rne cycle ur5 via.csv --acceleration 40 --gear 101``.
#
# Torques over time show where the limits are active.

figure = Figure(figsize=(6.5, 3), layout="constrained")
ax = figure.subplots()
t = np.linspace(0, motion.duration, 1000)
ax.plot(
    t, motion.torques(t)[:, :3] / robot.effort_limit[:3], label=robot.joint_names[:3]
)
ax.set(xlabel="time [s]", ylabel="torque / limit", title="The first three joints")
figure.legend(loc="outside right upper")
figure
