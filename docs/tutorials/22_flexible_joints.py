"""
Gains for an arm with soft joints
=================================

Gears with harmonic drives, belts and torque sensors twist under load, so that the link
oscillates even if the motor stands still. A rigid model does not contain this and
predicts stability for gains that make the arm vibrate. This tutorial compares the rigid
model of an IRB 140 with one that has flexible joints, and chooses better PD gains.

Needs: ``pip install '.[plot]'``
"""

from dataclasses import replace

import numpy as np
from matplotlib.figure import Figure

import rne

# %%
# The arm, rigid and soft
# -----------------------
# Six kilograms at the flange, the wrist locked. Rotors are reflected through the gears;
# joints of 10 kN m/rad are softer than those of a real IRB 140.

wrist = {"joint_4": 0, "joint_5": 0, "joint_6": 0}
rotor, stiffness = np.array([2.5, 3.0, 1.5]), np.array([1e4, 1e4, 8e3])
rigid = rne.Scene(rne.load("irb140"), payload=6.0, locked=wrist, armature=rotor)
arm = rigid.resolved.robot  # with load and rotors, for check_gains
start, target = np.zeros(3), np.array([0.6, 0.3, -0.2])
M = arm.mass_matrix(target)  # rotors on its diagonal
damping = 0.008 * np.sqrt(stiffness * np.diag(M))  # about 0.4 % of the critical one
soft = replace(rigid, elastic=rne.ElasticJoints(stiffness, damping))
print(soft)

# %%
# Prediction of the rigid model
# -----------------------------
# PD gains that make each joint of the rigid arm return at a rate w, critically damped.
# According to the rigid model all of them are stable if they are sampled every few
# milliseconds.


def gains(w):
    return w**2 * np.diag(M), 2 * w * np.diag(M)


for w in (80, 20):
    limit = rne.check_gains(arm, *gains(w)).sample_time_limit
    print(f"w = {w} 1/s: stable up to a sample time of {1e3 * limit:.1f} ms")
    assert limit > 4e-3

# %%
# Motion of the links
# -------------------
# The same gains act on the motors' encoders, with the gravity torque at the target as
# feed-forward. The scene moves the arm's rotors to the motor side of the joints, and
# starts at rest, with joints deflected by gravity.


def simulated(w, duration=1.5):
    (kp, kd), weight = gains(w), arm.gravity_torque(target)
    law = rne.traceable(lambda t, q, qd: kp * (target - q) - kd * qd + weight)
    scene, t = replace(soft, controller=law), np.linspace(0, duration, 751)
    return rne.simulate(scene, start, start, duration, t_eval=t)


stiff_gains, soft_gains = simulated(80), simulated(20)
for motion in (stiff_gains, soft_gains):
    late = motion.t > 1
    swing = np.ptp(motion.q[late], axis=0) * 1e3
    print(f"after 1 s links still swing by {swing.round(2)} mrad ({motion.message})")
late = stiff_gains.t > 1
assert np.ptp(stiff_gains.q[late, 0]) > 3 * np.ptp(stiff_gains.motor_q[late, 0])

figure = Figure(figsize=(7, 4), layout="constrained")
ax = figure.subplots()
for motion, w, color in ((stiff_gains, 80, "C1"), (soft_gains, 20, "C0")):
    error = (motion.q - target)[:, 0], (motion.motor_q - target)[:, 0]
    ax.plot(motion.t, error[0], color, label=f"link, w = {w} 1/s")
    ax.plot(motion.t, error[1], color, linestyle="--", label=f"motor, w = {w} 1/s")
ax.set(xlabel="time [s]", ylabel="error of joint 1 [rad]", ylim=(-0.3, 0.3))
ax.legend()
figure

# %%
# Why lower gains are better
# --------------------------
# High gains hold the motor as if its shaft were clamped: then nothing but the joint's
# own damping takes energy from the link. A motor with lower gains moves and dissipates
# energy too. The poles that ``Scene.check_gains`` finds at the target show this. They
# also show that with encoders on the link side the same gains are unstable.


def modes(w, reads="motor"):
    (kp, kd), weight = gains(w), arm.gravity_torque(target)
    rest = target + weight / stiffness if reads == "motor" else target
    law = rne.traceable(lambda t, q, qd: kp * (rest - q) - kd * qd + weight)
    scene = replace(soft, elastic=replace(soft.elastic, reads=reads), controller=law)
    return scene.check_gains(target).poles


rates = np.array([5, 10, 20, 40, 80, 160])
slowest = np.array([-modes(w).real.max() for w in rates])
for w, decay in zip(rates, slowest, strict=True):
    print(f"w = {w:3} 1/s: the slowest mode decays at {decay:5.2f} 1/s")
assert rates[np.argmax(slowest)] == 20
assert modes(20, reads="link").real.max() > 0

bars = Figure(figsize=(5, 3), layout="constrained")
axes = bars.subplots()
axes.loglog(rates, slowest, "o-")
axes.set(xlabel="w of the gains [1/s]", ylabel="slowest decay [1/s]")
bars

# %%
# The simulation agrees: gains on the links' positions diverge within half a second,
# while ``rne.check_gains``, which considers only the rigid arm, found them stable.

law = rne.control.pd(arm, *gains(40), target)
on_links = replace(soft, elastic=replace(soft.elastic, reads="link"), controller=law)
speeds = np.abs(rne.simulate(on_links, start, start, 0.2).motor_qd).max(axis=1)
print(f"fastest motor: {speeds.max():.0f} rad/s, and growing")
assert speeds[-1] > 100

# %%
# Smooth references
# -----------------
# The remaining vibration is excited by the step of the target. A smooth reference, here
# a polynomial that lasts about three periods of the slowest vibration, deflects the
# joints by a fraction of that.

period = 2 * np.pi / np.sqrt((stiffness / np.diag(M - np.diag(rotor))).min())
path = rne.trajectories.quintic(start, target, 3 * period)
followed = rne.control.pd_gravity(arm, *gains(20), path)
smooth = rne.simulate(replace(soft, controller=followed), start, start, 1.5)
twists = [
    1e3 * np.ptp(motion.motor_q - motion.q, axis=0) for motion in (soft_gains, smooth)
]
print("step: joints twist within {} mrad, path: {}".format(*np.round(twists, 1)))
assert twists[1][0] < 0.5 * twists[0][0]
