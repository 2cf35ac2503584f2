r"""
Sampling-based control at 50 Hz
===============================

A UR5 moves its tool past a ball, and its target jumps on the way. Every 20 ms it tries
1000 random variations of its torques over the next second, 50,000 steps of Runge-Kutta,
and keeps their mean, weighted by their costs. The cost need not be smooth: nothing is
differentiated.

Needs: ``pip install '.[plot,numba,robots]'``
"""

from time import process_time

import numpy as np
from matplotlib.figure import Figure

import rne
from rne.elementwise import less, maximum, where

robot, n = rne.load("ur5", engine="numba"), 6
effort, fastest = robot.effort_limit, robot.velocity_limit
start = np.array([-0.7, -1.2, 1.6, -1.9, -1.57, 0.0])
targets = np.array([[0.5, 0.4, 0.3], [0.5, -0.4, 0.3]])  # the second from 1.5 s on [m]
ball, radius, margin = np.array([0.55, 0.0, 0.3]), 0.15, 0.05  # [m]
period, N, samples, knots = 0.02, 50, 1000, 8

# %%
# The model
# ---------
# It has rotors, friction and the drives' limits; friction and rotors are assumed. A
# `Stepper` advances all samples by one period at once, each with its own torques. A
# step of RK4 must not be longer than 2.7 times the time constant with which friction
# slows a joint down: with Coulomb friction smoothed over 0.1 rad/s one step a period is
# enough.

viscous = np.array([10, 10, 5, 1, 1, 1])  # [N m s/rad]
coulomb = np.array([5, 5, 3, 0.5, 0.5, 0.5])  # [N m]
rotors = 0.1  # [kg m^2]
friction = rne.Friction(viscous=viscous, coulomb=coulomb, smoothing=0.1)
parts = {"armature": rotors, "effort_limit": effort}
stepper = rne.Stepper(rne.Scene(robot, friction=friction, **parts), sample_time=period)
inertia = robot.with_armature(rotors).mass_matrix(start)
decay = np.linalg.eigvals(np.linalg.solve(inertia, np.diag(viscous + coulomb / 0.1)))
print(stepper)
print(f"largest decay times the step: {decay.real.max() * period:.2f}")
assert decay.real.max() * period < 2.7

# %%
# The cost
# --------
# The cost of one state is the tool's distance from its target, a penalty if the wrist
# or the tool is closer to the ball than the margin, and a barrier below the speed
# limits. It is traced like a control law, and becomes machine code. A traced function
# of a robot takes joint arrays by their names: the target is in the first three entries
# of ``qdr``.

watched = [robot.link_names.index(f"wrist_{k}_link") for k in (1, 2, 3)]
tool = robot.link_names.index("tool0")


@rne.traceable
def cost_of(q, qd, qdr):
    poses = robot.link_poses(q)
    way, speed = poses[tool, :3, 3] - qdr[:3], np.sqrt(qd * qd)
    paid = np.sqrt((way * way).sum() + 1e-4) + 0.01 * (qd * qd).sum()
    paid = paid + 50 * (maximum(speed / fastest - 0.9, 0 * speed) ** 2).sum()
    for link in (*watched, tool):
        off = poses[link, :3, 3] - ball
        is_near = less((off * off).sum(), (radius + margin) ** 2)
        paid = paid + where(is_near, 5.0, 0.0)
    return paid


cost = robot.kernel(cost_of)

# %%
# The controller
# --------------
# Model-predictive path integral control (Williams et al. 2017): samples are the plan
# plus noise, which is drawn at 8 times and linear in between. A sample's weight is
# exp(-cost / 0.01). As a plan takes time to compute, a plan from one measured state
# acts one period later; so the state at that time is predicted first.

grid = np.arange(N)[:, None] / (N - 1) * (knots - 1)
straight = np.maximum(0, 1 - abs(grid - np.arange(knots)))  # (N, knots)


def motions(x, plan, noise):
    """States of all samples after each period, in one array that changes."""
    torques = np.empty((samples, n))
    x = np.tile(x, (samples, 1))
    for planned, own in zip(plan, noise):
        np.add(planned, own, out=torques)
        yield stepper.into(x, torques, x)


class Sampling:
    def __init__(self, seed=0):
        self.rng = np.random.default_rng(seed)
        self.plan = np.tile(robot.gravity_torque(start), (N, 1))
        self.torque, self.seconds, self.kept = self.plan[0], [], {}

    def noise(self):
        drawn = self.rng.standard_normal((knots, samples, n)) * (0.06 * effort)
        drawn[:, 0] = 0  # one sample is the plan itself
        return drawn, (straight @ drawn.reshape(knots, -1)).reshape(N, samples, n)

    def __call__(self, t, q, qd):
        applied, began = self.torque, process_time()
        x = stepper(np.concatenate([q, qd]), applied)
        self.plan = np.vstack([self.plan[1:], self.plan[-1:]])
        self.kept[round(t / period)] = x, self.plan
        goal = np.zeros((samples, n))
        goal[:, :3] = targets[int(t >= 1.5)]
        drawn, noise = self.noise()
        total = sum(
            cost(x[:, :n], x[:, n:], goal) for x in motions(x, self.plan, noise)
        )
        weights = np.exp((total.min() - total) / (0.01 * N))
        self.plan = self.plan + straight @ (weights / weights.sum() @ drawn)
        self.torque = np.clip(self.plan[0], -effort, effort)
        self.seconds.append(process_time() - began)
        return applied


# %%
# The closed loop
# ---------------
# The simulated arm has dry friction, which holds joints at rest. In the controller's
# model it is smoothed.

law = Sampling()
dry = rne.Friction(viscous=viscous, coulomb=coulomb, smoothing=0)
arm = rne.Scene(robot, friction=dry, **parts, controller=law, sample_time=period)
motion = rne.simulate(arm, start, np.zeros(n), 3.0)
poses = robot.link_poses(motion.q)
path = poses[:, tool, :3, 3]
way = np.linalg.norm(path - targets[(motion.t >= 1.5).astype(int)], axis=1)
before = way[np.searchsorted(motion.t, 1.5) - 1]
print(f"a plan takes {np.median(law.seconds) * 1e3:.0f} ms of one core")
print(f"from the targets at 1.5 and 3 s: {before * 1e3:.0f} and {way[-1] * 1e3:.0f} mm")

# %%
# How close did the arm come to the ball? The distance is measured along straight lines
# from the shoulder through the origins of the links to the tool; the cost contains only
# four points of them:

chain = ["upper_arm", "forearm", "wrist_1", "wrist_2", "wrist_3"]
at = [robot.link_names.index(f"{name}_link") for name in chain] + [tool]
points = poses[:, at, :3, 3]
along = np.linspace(0, 1, 21)[:, None, None, None]
lines = points[:, :-1] + along * np.diff(points, axis=1)
gap = np.linalg.norm(lines - ball, axis=-1).min() - radius
print(f"{gap * 1e3:.0f} mm from the ball at least")
print(f"fastest joint: {(abs(motion.qd) / fastest).max():.2f} of its limit")
assert max(before, way[-1]) < 0.04
assert gap > 0
assert (abs(motion.qd) < fastest).all()

# %%
# On the left the tool, seen from above and from the front. It passes below the ball,
# and on the way back above it. Blue lines are predictions of 60 samples for the second
# after 1.7 s.

figure = Figure(figsize=(9, 5), layout="constrained")
axes = figure.subplots(2, 2, sharex="col", width_ratios=[1, 1.1])
states = motions(*law.kept[85], law.noise()[1])
fan = np.array([robot.link_poses(x[:60, :n])[:, tool, :3, 3] for x in states])
angle = np.linspace(0, 2 * np.pi, 100)
for panel, i, letter in zip(axes[:, 0], (0, 2), "xz"):
    panel.plot(fan[..., 1], fan[..., i], color="C0", alpha=0.2, linewidth=0.7)
    round_y, round_i = ball[[1, i], None] + radius * np.array(
        [np.cos(angle), np.sin(angle)]
    )
    panel.fill(round_y, round_i, color="0.8")
    panel.plot(path[:, 1], path[:, i], "k", linewidth=1.5)
    panel.plot(targets[:, 1], targets[:, i], "C3+", markersize=12, markeredgewidth=2)
    panel.set(ylabel=f"{letter} [m]", aspect="equal", xlim=(-0.7, 0.55))
    panel.set_ylim(ball[i] - 0.35, ball[i] + 0.35)
axes[0, 0].set(title="The tool and the ball")
axes[1, 0].set(xlabel="y [m]")
axes[0, 1].plot(motion.t, way, "k")
axes[0, 1].set(ylabel="[m]", title="Distance to the target")
axes[1, 1].plot(motion.t, motion.tau / effort, linewidth=0.8, label=robot.joint_names)
axes[1, 1].set(xlabel="time [s]", ylabel="torque / limit", title="The drives")
figure.legend(loc="outside lower center", ncols=6, fontsize="small", frameon=False)
figure
