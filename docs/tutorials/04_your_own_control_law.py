r"""
Your own control law
====================

A control law is a Python function of time and state that returns torques. This tutorial
writes one for a UR5 in four forms: as a plain function, traced into the equations of
motion, with states, and sampled as on a real controller. For each form you see whether
it is called or traced, and what it costs in arithmetic operations.

Needs: ``pip install '.[plot,robots]'``
"""

import logging
import sys

import numpy as np
from matplotlib.figure import Figure

import rne

arm = rne.load("ur5")
target = np.deg2rad([30, -60, 80, -20, -90, 0])
inertia = np.diag(arm.mass_matrix(target))
kp, kd = 100 * inertia, 20 * inertia  # [N m/rad], [N m s/rad]: poles near -10 1/s
bound = arm.effort_limit / 5  # of torques due to errors of position [N m]
start, rest = np.zeros(6), np.zeros(6)
t = np.linspace(0, 2, 401)

# %%
# A plain function
# ----------------
# ``law(t, q, qd)`` gets a number and two arrays of shape (6,), and returns the torques.
# It may do whatever Python can. The solver calls it at every evaluation of the
# equations of motion, and some more times to choose its method and to report the
# torques:

calls = 0


def plain(t, q, qd):
    global calls
    calls += 1
    return arm.gravity_torque(q) - np.clip(kp * (q - target), -bound, bound) - kd * qd


motion = rne.simulate(rne.Scene(arm, controller=plain), start, rest, t[-1], t_eval=t)
print(f"{motion.method}: {motion.evaluations} evaluations, {calls} calls of the law")

# %%
# A traced function
# -----------------
# If your law is a formula, it can become part of the program that computes the
# accelerations. Mark it with ``rne.traceable``. It is then called once with symbols
# instead of numbers, and its operations are recorded. It shares terms with the robot:
# gravity torques need the same sines and cosines as the dynamics. In ``rne.ensemble``
# and in the compiled engine, traced laws are much faster than called ones.
#
# A symbol has no value, so an ``if`` on a position or ``np.clip`` cannot be recorded.
# The law is then called as before, and the logger "rne" reports it:

handler = logging.StreamHandler(sys.stdout)
logging.getLogger("rne").addHandler(handler)
marked = rne.Scene(arm, controller=rne.traceable(plain))
print(marked.cost()["law"])
logging.getLogger("rne").removeHandler(handler)

# %%
# ``rne.elementwise`` has functions that can be recorded: clip, minimum, maximum, where,
# less, sign, tanh, exp, arctan2.


@rne.traceable
def traced(t, q, qd):
    return (
        arm.gravity_torque(q)
        - rne.elementwise.clip(kp * (q - target), -bound, bound)
        - kd * qd
    )


scene = rne.Scene(arm, controller=traced)
same = rne.simulate(scene, start, rest, t[-1], t_eval=t)
print("largest difference from the plain function [rad]:", abs(same.q - motion.q).max())
assert abs(same.q - motion.q).max() < 1e-8

gravity = sum(arm.kernel(rne.dynamics.gravity_torque).operations.values())
cost = scene.cost()
print(f"together: {cost['total']} operations, {cost['controller']} of them for the law")
print(f"apart: {gravity} for the gravity torques, and 7 per joint, {7 * 6}")
assert cost["controller"] < gravity + 7 * 6

# %%
# A law with states
# -----------------
# An integral of the error, a filter or an observer is a differential equation. Set the
# attribute ``states`` to the number of its states z. The law is then called as ``law(t,
# q, qd, z)``, and returns the torques and dz/dt. The solver integrates z together with
# the motion, from zero. In this example the arm rests in its target position and gets a
# load of 2 kg that is not in the law. The integral of the error compensates the weight,
# up to half of each drive's torque.


class WithIntegral:
    states = 6

    def __call__(self, t, q, qd, z):
        error = q - target
        learned = rne.elementwise.clip(300 * inertia * z, -2.5 * bound, 2.5 * bound)
        return traced(t, q, qd) - learned, error


loaded = arm.with_payload(2.0, link="tool0")
t_load = np.linspace(0, 4, 401)
laws = {
    "gravity of the empty arm": traced,
    "with an integral": rne.traceable(WithIntegral()),
}
scenes = {name: rne.Scene(loaded, controller=law) for name, law in laws.items()}
held = {
    name: rne.simulate(scenes[name], target, rest, t_load[-1], t_eval=t_load)
    for name in laws
}
for name, run in held.items():
    off, operations = run.q[-1, 1] - target[1], scenes[name].cost()["total"]
    print(f"{name}: {operations} operations, joint 2 ends {off:+.5f} rad off")

learned = -300 * inertia * held["with an integral"].controller_state[-1]
weight = loaded.gravity_torque(target) - arm.gravity_torque(target)
for name, values in (("learned", learned), ("weight of the load", weight)):
    print(f"{name:18}", " ".join(f"{value + 0:7.2f}" for value in values), "N m")
assert np.allclose(learned, weight, atol=0.05)

# %%
# A sampled law
# -------------
# A real controller runs every few milliseconds on measured positions, and holds its
# torques in between. With ``sample_time`` the law is called once per sample, so it may
# keep values from one sample to the next. (A law that is not sampled must not: a solver
# tries steps and repeats them.) The law below has no measured velocities. It computes
# them from differences of encoder counts.


class OnEncoders:
    def __init__(self, sample_time, resolution):
        self.sample_time, self.resolution = sample_time, resolution

    def __call__(self, t, q, qd):
        measured = np.round(q / self.resolution) * self.resolution
        previous = measured if t == 0 else self.previous
        self.previous = measured
        return plain(t, measured, (measured - previous) / self.sample_time)


limit = rne.check_gains(arm, kp, kd).sample_time_limit
print(f"with exact rates these gains are stable up to {limit * 1e3:.1f} ms")
law = OnEncoders(sample_time=0.004, resolution=2e-4)
calls = 0
scene = rne.Scene(arm, controller=law, sample_time=0.004)
sampled = rne.simulate(scene, start, rest, t[-1], t_eval=t)
print(f"{sampled.evaluations} evaluations, {calls} calls of the law, one per sample")

figure = Figure(figsize=(9, 4), layout="constrained")
left, right = figure.subplots(1, 2)
for name, run in held.items():
    left.plot(t_load, np.rad2deg(run.q[:, 1] - target[1]), label=name)
left.axhline(0, color="black", linewidth=0.8)
left.set(title="shoulder lift, unknown load", xlabel="time [s]", ylabel="error [deg]")
right.plot(t, sampled.tau[:, 2], "C3", label="sampled, on encoders", linewidth=0.8)
right.plot(t, motion.tau[:, 2], label="continuous", color="black")
right.set(
    title="elbow, empty arm",
    xlabel="time [s]",
    ylabel="torque [N m]",
    xlim=(0.1, 2),
    ylim=(-16, -10),
)
for ax in (left, right):
    ax.legend(frameon=False)
figure

# %%
# On the left, the load pulls the arm off its target, and the integral brings it back.
# On the right, one count of the encoder between two samples changes the measured
# velocity by resolution / sample time, and the torque by that times the gain:

print(f"{kd[2] * law.resolution / law.sample_time:.2f} N m per count at the elbow")
