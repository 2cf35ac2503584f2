r"""
Torques along a path
====================

A UR5 with a gripper of 3 kg moves from one pose to another in a given time. Which
torque does each drive deliver? Which joint comes nearest to its limit? How fast could
you run the same path?

Needs: ``pip install '.[plot,robots]'``
"""

import numpy as np
from matplotlib.figure import Figure

import rne

robot = rne.load("ur5").with_payload(3.0, com=[0, 0, 0.08], link="tool0")
effort_limit = robot.effort_limit  # as in the URDF [N m]
speed_limit = robot.velocity_limit  # [rad/s]
for name, torque, speed in zip(robot.joint_names, effort_limit, speed_limit):
    print(f"{name:20} at most {torque:.0f} N m, {speed:.2f} rad/s")

# %%
# The reference motion
# --------------------
# A reference is a function of time that returns the positions, velocities and
# accelerations of all joints. The quintic polynomial starts and ends at rest with zero
# acceleration. The trapezoidal profile accelerates at a constant rate, cruises and
# brakes, so its accelerations jump. Angles are in radians, in the order of
# ``robot.joint_names``.

start = np.deg2rad([-20, -15, 40, -25, -90, 0])
end = np.deg2rad([20, -55, 75, -20, -60, 30])
duration = 0.6  # [s]
references = {
    "quintic": rne.trajectories.quintic(start, end, duration),
    "trapezoidal": rne.trajectories.trapezoidal(
        start, end, duration, ramp=duration / 3
    ),
}
t = np.linspace(0, duration, 601)
torques = {
    name: robot.inverse_dynamics(*reference(t))
    for name, reference in references.items()
}

# %%
# One call of ``inverse_dynamics`` takes all 601 states. The picture shows the torques
# divided by the limits: a curve outside the grey band exceeds the limit of its drive.
# Before and after the motion the torques compensate gravity only. In between, they also
# accelerate and brake the arm and its load. Where the trapezoidal acceleration jumps,
# the torques jump.

figure = Figure(figsize=(9, 4), layout="constrained")
axes = figure.subplots(1, 2, sharey=True)
for ax, (name, tau) in zip(axes, torques.items()):
    ax.axhspan(-1, 1, color="0.93")
    ax.plot(t, tau / effort_limit, label=robot.joint_names)
    ax.set(title=f"{name} reference", xlabel="time [s]")
axes[0].set_ylabel("torque / limit of the joint")
axes[1].legend(loc="center left", bbox_to_anchor=(1, 0.5), frameon=False)
figure

# %%
# The bottleneck
# --------------
# The joint with the largest ratio of peak torque to limit decides whether the drives
# can follow the reference.

for name, tau in torques.items():
    used = abs(tau).max(axis=0) / effort_limit
    print(f"{name}: bottleneck {robot.joint_names[used.argmax()]}")
    for joint, peak, ratio in zip(robot.joint_names, abs(tau).max(axis=0), used):
        print(f"    {joint:20} peak {peak:6.2f} N m, {ratio:4.0%} of the limit")

# %%
# How fast could it be?
# ---------------------
# Run the same path in the time :math:`T` instead of :math:`T_0`. All velocities are
# then multiplied by :math:`T_0/T`, and all accelerations by :math:`(T_0/T)^2`. Gravity
# does not change. The rest of the equations of motion is quadratic in the velocities or
# linear in the accelerations. So the torques are
#
# .. math:: \tau_T = g + (T_0 / T)^2 \, (\tau_{T_0} - g)
#
# and one evaluation of inverse dynamics and one of gravity give them for every
# duration.

T = np.linspace(0.25, 1.0, 301)
figure = Figure(figsize=(6.5, 3.8), layout="constrained")
ax = figure.subplots()
shortest = {}
for name, reference in references.items():
    q, qd, qdd = reference(t)
    g = robot.gravity_torque(q)
    factor = (duration / T[:, None, None]) ** 2
    scaled = g + factor * (torques[name] - g)  # durations, samples, joints
    torque_use = (abs(scaled) / effort_limit).max(axis=(1, 2))
    speed_use = duration / T * (abs(qd) / speed_limit).max()
    (line,) = ax.plot(T, torque_use, label=f"{name}: torque")
    ax.plot(T, speed_use, "--", color=line.get_color(), label=f"{name}: speed")
    shortest[name] = [
        np.interp(-1, -use, T) for use in (torque_use, speed_use)
    ]  # where the use falls to 1
    by_torque, by_speed = shortest[name]
    print(f"{name}: at least {by_torque:.3f} s by torque, {by_speed:.3f} s by speed")
ax.axhline(1, color="black", linewidth=0.8)
ax.set(xlabel="duration of the motion [s]", ylabel="largest use of a limit")
ax.set_ylim(0, 3)
ax.legend(frameon=False)
figure

# %%
# The longer of its two times is the shortest in which the motion can be run. For the
# same duration the quintic has the higher peak velocity and the higher peak
# acceleration. That is the price of its smoothness.
#
# Check it: run the quintic in the shortest time that its torques allow. The largest
# torque meets its limit, up to the resolution of the curve above.

by_torque, _ = shortest["quintic"]
fastest = rne.trajectories.quintic(start, end, by_torque)
tau = robot.inverse_dynamics(*fastest(t * by_torque / duration))
use = (abs(tau) / effort_limit).max()
print(f"quintic in {by_torque:.3f} s: largest torque / limit = {use:.4f}")
assert abs(use - 1) < 1e-3
