r"""
Adaptive control with an unknown payload
========================================

A robot picks up a part, and nobody knows its mass. An adaptive law tracks the motion
nevertheless, and estimates the mass meanwhile. How large are the errors? What does it
learn, and when does it learn nothing?

Needs: ``pip install '.[plot]'``
"""

import numpy as np
from matplotlib.figure import Figure

import rne

arm = rne.load("irb140")  # what the controller knows
held = arm.with_payload(3.0)  # the robot that moves
t = np.linspace(0, 10, 1001)

# %%
# The motion
# ----------
# Neighbouring joints run on circles at 0.5 Hz. Any function of time that returns
# positions, velocities and accelerations is a reference. If it uses NumPy's sine and
# cosine, it can be traced into the equations of motion.

centre = np.array([0, 0.2, -0.3, 0.2, 0.8, 0.1])  # [rad]
radius = np.array([0.4, 0.3, 0.3, 0.4, 0.4, 0.5])  # [rad]
phase = np.array([0, np.pi / 2] * 3)


def circle(t):
    angle = np.pi * np.asarray(t) + phase
    return (
        centre + radius * np.sin(angle),
        np.pi * radius * np.cos(angle),
        -(np.pi**2) * radius * np.sin(angle),
    )


def run(law, reference=circle):
    scene = rne.Scene(held, controller=law)
    return rne.simulate(scene, *reference(0)[:2], t[-1], t_eval=t)


def error(motion, reference=circle):
    """Largest tracking error of a joint at each time [rad]."""
    return np.abs(motion.q - reference(t[:, None])[0]).max(axis=1)


# %%
# Two laws that know the arm alone
# --------------------------------
# The adaptive law gives the torques of its estimated parameters. It corrects them in
# proportion to the composite error :math:`s = \dot e + \lambda e`:
#
# .. math:: u = Y \hat\pi - K_d s, \qquad \dot{\hat\pi} = -\Gamma\, Y^T s.
#
# Only the last link carries the part, so we adapt only its ten parameters. They are
# states of the controller, and the solver integrates them with the motion. With
# ``consistent=True`` the estimate stays a possible body: it never has a negative mass
# or an impossible inertia.

rate, kd = np.full(6, 20.0), np.array([40, 60, 20, 4, 2, 1.0])  # [1/s], [N m s/rad]
adaptive = rne.control.adaptive(
    arm, kd, rate, circle, bodies=["joint_6"], gain=30.0, consistent=True
)
computed = rne.control.computed_torque(arm, rate**2, 2 * rate, circle)
motions = {"computed torque": run(computed), "adaptive": run(adaptive)}
late = t >= 8
for name, motion in motions.items():
    print(f"{name}: largest error after 8 s {error(motion)[late].max() * 1e3:.2f} mrad")
worst = [error(motion)[late].max() for motion in motions.values()]
assert worst[1] < worst[0] / 10

figure = Figure(figsize=(8, 3.6), layout="constrained")
ax = figure.subplots()
for name, motion in motions.items():
    ax.semilogy(t[1:], error(motion)[1:], label=name)
ax.set(xlabel="time [s]", ylabel="largest error of a joint [rad]", ylim=(1e-5, 3))
ax.legend(frameon=False)
figure

# %%
# Computed torque multiplies its gains by the model's inertia. Without the part, the
# inertia of the wrist is so small that joint 5 sinks under 3 kg.
#
# What it learnt
# --------------
# ``parameters`` translates the states into mass, first moment and inertia of each body.

estimate = adaptive.parameters(motions["adaptive"].controller_state)[:, -10:]
truth = held.parameters[-10:]
print("mass and first moment, learnt:", estimate[-1, :4].round(3) + 0.0)
print("mass and first moment, true:  ", truth[:4].round(2) + 0.0)
assert abs(estimate[-1, 0] - truth[0]) < 0.05

figure = Figure(figsize=(8, 3.2), layout="constrained")
ax = figure.subplots()
ax.plot(t, estimate[:, 0], label="estimate")
ax.axhline(truth[0], color="black", linestyle="--", linewidth=0.8, label="true")
ax.set(xlabel="time [s]", ylabel="mass of link 6 with the part [kg]", ylim=(0, None))
ax.legend(frameon=False)
figure

# %%
# A motion that teaches nothing
# -----------------------------
# The proof promises that the error goes to zero. It does not promise that the
# parameters become right. At rest, only the torques of gravity in one configuration
# have to be right. Here they determine the mass, but not its position: many centres of
# mass and inertias fit.


def rest(t):
    return centre + 0 * circle(t)[0], 0 * circle(t)[0], 0 * circle(t)[0]


still = rne.control.adaptive(
    arm, kd, rate, rest, bodies=["joint_6"], gain=30.0, consistent=True
)
motion = run(still, rest)
resting = still.parameters(motion.controller_state)[-1, -10:]
print(f"at rest: error {error(motion, rest)[-1] * 1e3:.3f} mrad")
print("mass and first moment, learnt:", resting[:4].round(2) + 0.0)
assert error(motion, rest)[-1] < 1e-3
assert np.abs(resting[1:4] - truth[1:4]).max() > 0.05

# %%
# The proof does not hold either if there is friction that the model does not have, or
# if drives reach their limits. The page on adaptive and robust control shows both.
